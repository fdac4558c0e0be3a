"""Copies of elements in a project of EB tresos, and which of the files that state them counts.

The tool configures modules in ``config/*.xdm`` and writes below ``output`` and ``generated``; the settings of its
importers, in ``.prefs``, name the files that describe the system.
"""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.slim import Slimming
from halpipe.importers.arxml.files.words import NS, child_text, parse_number, path_of, steps_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.files.sniff import Document

_GENERATED = frozenset({"output", "generated"})
_WORDS = {"true": "1", "false": "0"}


@record
class _Configuration:
    """A module configuration, and the file in which it stands."""

    document: Document
    module: etree._Element


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
    configured: dict[str, _Configuration] = {}
    for document in ranked:
        for module in list(document.root.iter(f"{NS}ECUC-MODULE-CONFIGURATION-VALUES")):
            path, holder = path_of(module), module.getparent()
            if path in configured and holder is not None:
                _compare(configured[path], _Configuration(document, module), findings)
                holder.remove(module)
            elif document.is_project_data and module.find(f"{NS}CONTAINERS") is not None:
                configured[path] = _Configuration(document, module)
    return ranked


def _compare(first: _Configuration, second: _Configuration, findings: Findings) -> None:
    """Report how the second configuration of a module differs from the first: as a copy, or as a contradiction."""
    stated, copied = _statements(first.module), _statements(second.module)
    differing = [found for found in copied if found not in stated]
    differing += [found for found in stated if found not in copied and not found[2]]  # a copy may omit default values
    if not differing:
        return
    path, name, _ = differing[0]
    is_equal = second.document.is_project_data

    def shown(found: dict[tuple[str, str, str], tuple[str, int]], of: _Configuration) -> tuple[str, Location]:
        same = (text for key, text in found.items() if key[:2] == (path, name))
        text, line = found.get(differing[0]) or next(same, ("absent", of.module.sourceline or 0))
        return text, Location(of.document.name, line)

    (here, at), (there, source) = shown(copied, second), shown(stated, first)
    findings.report(
        codes.CONFLICT if is_equal else codes.OTHER_COPY,
        f'{name} is "{here}" here, but "{there}" at {source}{", which counts" * (not is_equal)}; '
        f"the configurations differ in {len(differing)} values and containers",
        at=at,
        path=path,
        help="import one project" if is_equal else "generate the file again",
    )


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
