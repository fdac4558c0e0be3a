"""Files told apart by content: AUTOSAR R4, older releases, vendor formats, other XML, broken and misspelt files.

The schema that a file names is not looked at for that, since tools write names that do not exist. A project of EB
tresos configures modules in ``config/*.xdm`` and holds copies below ``output`` and ``generated``; the settings of its
importers, in ``.prefs``, name the files that describe the system.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from dataclasses import field, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from glob import escape
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, cast

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import (
    MAX_INPUT_BYTES,
    STDIO,
    LargeXmlParser,
    advice_for,
    find_inputs,
    input_size,
    open_input,
    parse_xml,
    read_bytes,
)
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.dialects import drop_seconds, imported_files, modernise, translate
from halpipe.importers.arxml.files.slim import Slimming, tags_to_drop
from halpipe.importers.arxml.files.words import NAMESPACE, NS, child_text, parse_number, path_of, steps_of
from halpipe.importers.common.inputs import read_inputs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lxml import etree


_GENERATED = frozenset({"output", "generated"})
_WORDS = {"true": "1", "false": "0"}


def settle_copies(documents: Sequence[Document], findings: Findings) -> list[Document]:
    """Return the documents, those that count first, without the copies of module configurations.

    Report a copy that differs from the configuration, and configurations of one module that differ.
    """
    folders = (Path(document.name).parent for document in documents if document.is_project_data)
    roots = {folder.parent if folder.name == "config" else folder for folder in folders}
    if not roots:
        return list(documents)
    patterns: dict[Path, list[str]] = {root: [] for root in roots}
    for document in documents:
        root = Path(document.name).parent.parent
        patterns.get(root, []).extend(f"{escape(str(root))}/{name}".casefold() for name in document.imports)

    def rank(document: Document) -> int:
        path = Path(document.name)
        root = next((folder for folder in path.parents if folder in roots), None)
        if root is None or document.is_project_data:
            return 0
        if not _GENERATED.isdisjoint(path.relative_to(root).parts[:-1]):
            return 2
        name = path.as_posix().casefold()
        return int(bool(patterns[root]) and not any(fnmatchcase(name, pattern) for pattern in patterns[root]))

    ranked = [replace(each, rank=found) if (found := rank(each)) else each for each in documents]
    ranked.sort(key=lambda document: (document.rank, not document.is_project_data))
    configured: dict[str, tuple[Document, etree._Element]] = {}
    for document in ranked:
        for module in list(document.root.iter(f"{NS}ECUC-MODULE-CONFIGURATION-VALUES")):
            path, holder = path_of(module), module.getparent()
            if path in configured and holder is not None:
                _compare(*configured[path], document, module, findings)
                holder.remove(module)
            elif document.is_project_data and module.find(f"{NS}CONTAINERS") is not None:
                configured[path] = document, module
    return ranked


def _compare(
    first: Document, module: etree._Element, second: Document, other: etree._Element, findings: Findings
) -> None:
    """Report how the second configuration of a module differs from the first: as a copy, or as a contradiction."""
    stated, copied = _statements(module), _statements(other)
    differing = [found for found in copied if found not in stated]
    differing += [found for found in stated if found not in copied and not found[2]]  # a copy may omit default values
    if not differing:
        return
    path, name, _ = differing[0]
    is_equal = second.is_project_data

    def shown(found: dict[tuple[str, str, str], tuple[str, int]], of: etree._Element) -> tuple[str, int]:
        same = (text for key, text in found.items() if key[:2] == (path, name))
        return found.get(differing[0]) or next(same, ("absent", of.sourceline or 0))

    (here, line), (there, other_line) = shown(copied, other), shown(stated, module)
    at, source = Location(second.name, line), Location(first.name, other_line)
    message = (
        f'{name} is "{here}" here, but "{there}" at {source}{", which counts" * (not is_equal)}; '
        f"the configurations differ in {len(differing)} values and containers"
    )
    help = "import one project" if is_equal else "generate the file again"
    findings.report(codes.CONFLICT if is_equal else codes.OTHER_COPY, message, at=at, path=path, help=help)


def _statements(module: etree._Element) -> dict[tuple[str, str, str], tuple[str, int]]:
    """Return the text and line of each container and value that can matter to timing, by path, definition and value."""
    slim, found = Slimming(), {}
    kinds = ("ECUC-CONTAINER-VALUE", "ECUC-NUMERICAL-PARAM-VALUE", "ECUC-TEXTUAL-PARAM-VALUE", "ECUC-REFERENCE-VALUE")
    for element in module.iter(*(NS + kind for kind in kinds)):
        if element.tag != f"{NS}ECUC-REFERENCE-VALUE" and slim.drops(element):
            continue
        text = (child_text(element, "VALUE") or child_text(element, "VALUE-REF")).strip()
        if text or element.tag.endswith("CONTAINER-VALUE"):
            number = parse_number(text)
            key = _WORDS.get(text.lower(), text) if number is None else str(number)
            name = steps_of(child_text(element, "DEFINITION-REF"))[-1]
            found[path_of(element), name, key] = text or "present", element.sourceline or 0
    return found


# Elements that need a SHORT-NAME to have an effect, and the lists that hold them.
_NAMED = """
APPLICATION-SW-COMPONENT-TYPE ASSEMBLY-SW-CONNECTOR BACKGROUND-EVENT BSW-INTERNAL-BEHAVIOR BSW-MODULE-DESCRIPTION
BSW-SCHEDULABLE-ENTITY BSW-TIMING-EVENT COMPOSITION-SW-COMPONENT-TYPE DATA-RECEIVED-EVENT DELEGATION-SW-CONNECTOR
ECU-INSTANCE ECUC-CONTAINER-VALUE ECUC-MODULE-CONFIGURATION-VALUES EOC-EVENT-REF EOC-EXECUTABLE-ENTITY-REF
EOC-EXECUTABLE-ENTITY-REF-GROUP EXECUTION-ORDER-CONSTRAINT LATENCY-TIMING-CONSTRAINT MACHINE MODE-DECLARATION
MODE-DECLARATION-GROUP MODE-DECLARATION-GROUP-PROTOTYPE OFFSET-TIMING-CONSTRAINT PERIODIC-EVENT-TRIGGERING PROCESS
PROCESSOR PROCESSOR-CORE RUNNABLE-ENTITY SPORADIC-EVENT-TRIGGERING SW-COMPONENT-PROTOTYPE SWC-INTERNAL-BEHAVIOR
TD-EVENT-SWC-INTERNAL-BEHAVIOR TIMING-DESCRIPTION-EVENT-CHAIN TIMING-EVENT VARIABLE-ACCESS
"""
NAMED = tuple(_NAMED.split())
_LISTS = """
AR-PACKAGE AR-PACKAGES COMPONENTS CONNECTORS CONTAINERS DATA-READ-ACCESSS DATA-WRITE-ACCESSS ELEMENTS EVENTS
EXECUTION-TIMES INTERNAL-BEHAVIORS MODE-DECLARATIONS ORDERED-ELEMENTS PARAMETER-VALUES PERIOD REFERENCE-VALUES
RUNNABLES SHORT-NAME START-ON-EVENT-REF STARTS-ON-EVENT-REF SUB-CONTAINERS SUCCESSOR-REF SUCCESSOR-REFS
TIMING-DESCRIPTIONS TIMING-REQUIREMENTS TYPE-TREF
"""
KNOWN = frozenset((*NAMED, *_LISTS.split()))
# Elements of AUTOSAR that are one slip away from those above, and no slips.
_OTHERS = frozenset({"TYPE-IREF", "TYPE-REF"})


def report_misspelt(document: Document, findings: Findings) -> None:
    """Report every tag of a file that is one slip away from one that is read, at its first use."""
    for tag in document.tags:
        space, _, name = tag.rpartition("}")
        meant = _meant(name)
        if meant or space.lstrip("{") != NAMESPACE:
            why = "" if meant else f' of the namespace "{space.lstrip("{")}"'
            found = list(document.root.iter(tag))
            message = f'the element "{name}"{why} is not read, {len(found)} in all'
            help = f"did you mean {meant}?" if meant else f"put them into {NAMESPACE}"
            at = Location(document.name, found[0].sourceline or 0)
            findings.report(codes.UNKNOWN_ELEMENT, message, at=at, help=help)


@lru_cache(maxsize=4096)  # thousands of files use the same few hundred tags
def _meant(name: str) -> str:
    """Return the known tag that `name` is a slip of, empty if it is one itself or resembles none."""
    if name in KNOWN or name in _OTHERS:
        return ""
    folded = name.upper().replace("_", "-")
    if folded in KNOWN:
        return folded
    if name.rstrip("S") in KNOWN or f"{name}S" in KNOWN:
        return ""  # plural and singular are elements of their own
    return next((near for near in sorted(KNOWN) if _is_slip(folded, near)), "")


def _is_slip(word: str, known: str) -> bool:
    """Whether a word has one letter left out, put in, replaced, or exchanged with the next."""
    pairs = enumerate(zip(word, known, strict=False))
    same = next((i for i, (one, other) in pairs if one != other), min(len(word), len(known)))
    rest, right = word[same:], known[same:]
    swapped = len(right) > 1 and rest == right[1::-1] + right[2:]
    return swapped or rest[1:] in (right, right[1:]) or rest == right[1:]


LARGE_INPUT = 32 * 2**20
"""Bytes of all files from which on what cannot matter to timing is dropped while it is read."""

_OLD = re.compile(r"http://(?:www\.)?autosar\.org/(?:schema/)?r?(?P<release>[23](?:\.[0-9A-Za-z]+)*)/?")
_BARE = re.compile(r"(?:http://(?:www\.)?autosar\.org/?)?")


@record
class Document:
    """A parsed AUTOSAR file in the words of release 4, and the name that the user gave it.

    `release` is what an older file says of itself, empty for release 4; `tags` are all tags in it, with their
    namespaces, in order of first appearance. Of a large input, `dropped` counts the elements with a name that were left
    out while it was read, by kind, and `symbols` has the values of their parameters with a line of each, by name.
    `is_project_data` is a configuration of EB tresos, `imports` are the files that settings of that tool name; where
    two files state one value differently, the one of the lower `rank` counts.
    """

    name: str
    root: etree._Element
    release: str = ""
    is_project_data: bool = False
    imports: tuple[str, ...] = ()
    rank: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    symbols: dict[str, dict[str, int]] = field(default_factory=dict)
    tags: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        tags = cast("Iterable[str]", map(attrgetter("tag"), self.root.iter("{*}*")))
        shared = map(sys.intern, dict.fromkeys(tags))  # thousands of files have the same few hundred tags
        object.__setattr__(self, "tags", tuple(shared))


def load(
    paths: Sequence[str],
    findings: Findings,
    *,
    marks: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Document]:
    """Parse every file of `paths`; what a directory holds besides is skipped, what was named directly is an error.

    Of a large input, what cannot matter to timing is left out, and so are the `marks` of tools unless they are wanted.

    Raise `HalpipeError` if any file named directly cannot be used, or if none is left.
    """
    suffixes = (".arxml", ".xdm")
    is_large = sum(map(input_size, find_inputs(paths, suffixes))) > LARGE_INPUT
    slim = SlimReader(on_progress, marks=marks)
    read, note = (slim, slim.show) if is_large else (read_whole, on_progress)
    documents = read_inputs(paths, suffixes, read, codes.SKIPPED_FILE, codes.NO_INPUT, findings, note)
    findings.stop_on_errors()
    _report_releases(documents, findings)
    for document in documents:
        report_misspelt(document, findings)
    return settle_copies(documents, findings)


def read_whole(name: str) -> Document:
    """Parse a file as AUTOSAR of any release; raise `HalpipeError` that says what it is if it is something else."""
    return recognise(parse_xml(read_bytes(name), name, long_texts=True), name)


class SlimReader:
    """Parses the files of a large input, without what cannot matter to timing."""

    def __init__(self, on_progress: Callable[[int, int], None] | None = None, *, marks: bool = False) -> None:
        self._on_progress = on_progress
        self._marks = marks
        self._parser = LargeXmlParser(tags_to_drop(marks=marks))
        self._done = self._total = 0

    def show(self, done: int, total: int) -> None:
        """Tell how many bytes of all files are read before the next one."""
        self._done, self._total = done, total
        self._show(0)

    def _show(self, read: int) -> None:
        if self._on_progress:
            self._on_progress(self._done + read, self._total)

    def __call__(self, name: str) -> Document:
        """Parse a file."""
        if name == STDIO:
            return read_whole(name)
        slim = Slimming(marks=self._marks)
        try:
            with open_input(name) as stream:
                root = self._parser.parse(stream, name, slim.drops, self._show)
        except HalpipeError:
            if not 0 < input_size(name) <= MAX_INPUT_BYTES:
                raise
            return read_whole(name)  # which has no limit on texts, and finds every syntax error
        document = recognise(root, name)
        document.dropped.update(slim.dropped)
        document.symbols.update(slim.symbols)
        return document


def recognise(root: etree._Element, name: str) -> Document:
    """Return a tree as AUTOSAR of any release; raise `HalpipeError` that says what it is if it is something else."""
    namespace, tag = _split(root.tag)
    at = Location(name, root.sourceline or 1)
    if tag == "AUTOSAR" and namespace == NAMESPACE:
        return Document(name, root)
    if tag == "datamodel":
        translated, is_setting = translate(root), Path(name).parent.name == ".prefs"
        if not len(translated[0]) and not is_setting:
            help = "name the configurations of a project (config/*.xdm)"
            raise HalpipeError(codes.EB_XDM("is EB tresos data that configure no module", at=at, help=help))
        return Document(name, translated, is_project_data=not is_setting, imports=imported_files(root))
    if tag != "AUTOSAR":
        help = advice_for(f"<{tag} ".encode(), "arxml", "name ARXML files only")
        raise HalpipeError(codes.NOT_ARXML(f'has the root element "{tag}", not AUTOSAR', at=at, help=help))
    release = _release(root, namespace)
    if release:
        return Document(name, modernise(root), release)
    what = f'is in the namespace "{namespace}"' if namespace else "has no namespace"
    raise HalpipeError(codes.NOT_ARXML(f"{what}, not {NAMESPACE}", at=at, help="export it as AUTOSAR release 4.x"))


def _report_releases(documents: Sequence[Document], findings: Findings) -> None:
    """Note files of older releases, and warn of several releases in one import."""
    old = [document for document in documents if document.release]
    for document in old:
        message = f"is AUTOSAR {document.release}; its elements are read as those of release 4 that replaced them"
        findings.report(codes.OLD_RELEASE, message, at=Location(document.name, document.root.sourceline or 1))
        if count := drop_seconds(document.root):
            message = f"{count} times of its OS configuration are seconds, as in release 2, and are not read"
            help = "state the periods in the overlay (sources), or export the configuration as release 3 or 4"
            at = Location(document.name, document.root.sourceline or 1)
            findings.report(codes.OLD_TIMES, message, at=at, help=help)
    releases = sorted({document.release or "4" for document in documents})
    if len(releases) > 1:
        message = f"files of the releases {', '.join(releases)} are imported together"
        help = "export all parts of the system as one release, if references between them are missing"
        findings.report(codes.MIXED_RELEASES, message, at=Location(old[0].name, old[0].root.sourceline or 1), help=help)


def _release(root: etree._Element, namespace: str) -> str:
    """Return "3.2.3" or such for an old namespace, and for no release in it when old elements follow."""
    match = _OLD.fullmatch(namespace)
    if match:
        return match["release"]
    if _BARE.fullmatch(namespace) and any(_split(child.tag)[1] == "TOP-LEVEL-PACKAGES" for child in root.iter("{*}*")):
        return "2.x or 3.x"
    return ""


def _split(tag: str) -> tuple[str, str]:
    namespace, _, local = tag.rpartition("}")
    return namespace.lstrip("{"), local
