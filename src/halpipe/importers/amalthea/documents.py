"""Input files: AMALTHEA models told apart by content, the native model of an export, and lists of modes.

Before mode labels, each mode was a model of its own (McSim, DreamCloud project): a ``.modes`` file has lines
``time;mode;file``, a ``.csv`` file lines ``from,to,100ms``. Tasks of one name are one task where period, offset, slack
and deadline agree in all modes, with a version for each difference between modes; otherwise each mode has its own.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.core.embedding import joined, properties_hash
from halpipe.core.files import parse_xml, read_bytes
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.xmi import Forest, few, legal, text_of
from halpipe.importers.common.inputs import read_inputs
from halpipe.importers.native import parse_model
from halpipe.models import Chain, Mode, Origin, Run, Task, TaskModel, Transition, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lxml import etree

    from halpipe.importers.amalthea.xmi import Item
    from halpipe.importers.common.base import Coverage, ImportOptions

_ITEA = re.compile(r"http://www\.amalthea\.itea2\.org/model/(?P<version>[0-9]+(?:\.[0-9]+)*)/[a-z]+")
_APP4MC = re.compile(r"http://app4mc\.eclipse\.org/amalthea/(?P<version>[0-9]+(?:\.[0-9]+)*)")
_KNOWN_ITEA = ("1.0.3", "1.1.0", "1.1.1", "1.3.0")
KNOWN = (
    *("0.7.0", "0.7.1", "0.7.2", "0.8.0", "0.8.1", "0.8.2", "0.8.3"),
    *(f"0.9.{patch}" for patch in range(10)),
    *("1.0.0", "1.1.0", "1.2.0", "2.0.0", "2.1.0", "2.2.0", "3.0.0", "3.1.0", "3.2.0", "3.3.0"),
)
_MODEL = re.compile(r"(?:[A-Za-z]+Model|CommonElements)")
_SUFFIX = ".amxmi"


@record
class Document:
    """A parsed AMALTHEA file, the name that the user gave it, and its version, such as ``ITEA 1.1.0`` or ``0.9.5``."""

    name: str
    root: etree._Element
    version: str


def load(paths: Sequence[str], findings: Findings) -> list[Document]:
    """Parse every file of `paths`; what a directory holds besides is skipped, what was named directly is an error.

    Raise `HalpipeError` if any file named directly cannot be used, if none is left, or if their versions differ.
    """
    documents = read_inputs(paths, (_SUFFIX,), read_file, codes.SKIPPED_FILE, codes.NO_INPUT, findings)
    _report_versions(documents, findings)
    findings.stop_on_errors()
    return documents


def _report_versions(documents: Sequence[Document], findings: Findings) -> None:
    for other in documents[1:]:
        if other.version != documents[0].version:
            findings.add(
                codes.MIXED_VERSIONS(
                    f'is AMALTHEA {other.version}, but "{documents[0].name}" is {documents[0].version}',
                    at=Location(other.name),
                    help="migrate the files to one version with APP4MC, or import the models one by one",
                )
            )
    for document in documents:
        number = document.version.removeprefix("ITEA ")
        if number not in (KNOWN if number == document.version else _KNOWN_ITEA):
            findings.add(
                codes.UNKNOWN_VERSION(
                    f"is AMALTHEA {document.version}, which the importer does not know",
                    at=Location(document.name),
                    help="check the result with care, or migrate the file with APP4MC",
                )
            )


def read_file(name: str) -> Document:
    """Parse a file as an AMALTHEA model; see `recognise`."""
    return recognise(read_bytes(name), name)


def recognise(data: bytes, name: str) -> Document:
    """Parse `data` if it is an AMALTHEA model; raise `HalpipeError` that says what it is otherwise."""
    if data.startswith(b"PK\x03\x04"):
        help = "unpack it and import the file inside"
        raise HalpipeError(codes.NOT_AMALTHEA("is a compressed file", at=Location(name), help=help))
    root = parse_xml(data, name)
    namespace, _, tag = str(root.tag).rpartition("}")
    namespace = namespace.lstrip("{")
    at = Location(name, root.sourceline or 1)
    version = _version(namespace)
    if version and (tag in ("Amalthea", "AMALTHEA") or _MODEL.fullmatch(tag)):
        return Document(name, root, version)
    help = f"name {_SUFFIX} files of APP4MC"
    if tag == "EPackage":
        raise HalpipeError(codes.NOT_AMALTHEA("is a metamodel (ecore), not a model", at=at, help=help))
    where = f'in the namespace "{namespace}"' if namespace else "without a namespace"
    raise HalpipeError(codes.NOT_AMALTHEA(f'has the root element "{tag}" {where}', at=at, help=help))


def _version(namespace: str) -> str:
    if (match := _ITEA.fullmatch(namespace)) is not None:
        return f"ITEA {match['version']}"
    match = _APP4MC.fullmatch(namespace)
    return match["version"] if match else ""


def read_embedded(
    documents: Sequence[Document], options: ImportOptions, findings: Findings, coverage: Coverage
) -> TaskModel | None:
    """Return the native model of an export; None without one, and, with a warning, where files were changed."""
    roots = Forest(documents, Findings()).roots
    root = next((root for root in roots if text_of(root, "hash") is not None), None)
    if root is None:
        return None
    trouble, model = _read(root, is_alone=len(roots) == 1)
    if model is None:
        help = "nothing to do if the change was meant; otherwise export the model again"
        message = f"{trouble}; the standard elements are imported"
        findings.add(codes.EDITED(message, at=root.at, help=help))
        return None
    coverage.mapped("file")
    for item in root.walk():
        if item.name and item is not root:
            coverage.mapped(item.kind)
    return replace(model, name=legal(options.name)) if options.name else model


def _read(root: Item, *, is_alone: bool) -> tuple[str, TaskModel | None]:
    """Return why the native model does not count, or the model."""
    if not is_alone:
        return "other files stand beside an export of halpipe", None
    if text_of(root, "hash") != properties_hash(root.element):
        return "standard elements were changed after the export", None
    texts: list[str] = []
    while (text := text_of(root, f"model.{len(texts)}")) is not None:
        texts.append(text.replace("\n", " "))  # the whole value stands in one line of the file
    try:
        return "", parse_model(joined(texts, root.at.line), root.file)
    except HalpipeError as failure:
        return f"the native model cannot be read: {failure.diagnostics[0].message}", None


LIST = ".modes"
_LIMITS = ".csv"
_END = "end"


@record
class ModeFile:
    """A mode, the file of its model, and where the list names it."""

    mode: str
    file: str
    at: Location


@record
class ModeList:
    """The modes in order, and the switches that are allowed between them (none: all)."""

    name: str
    files: tuple[ModeFile, ...]
    transitions: tuple[Transition, ...]


def is_list(paths: Sequence[str]) -> bool:
    """Return whether the input is a list of modes."""
    return any(path.endswith(LIST) for path in paths)


def read_list(paths: Sequence[str], findings: Findings) -> ModeList:
    """Read a list of modes and, if there is one, the table of limits; raise `HalpipeError` for anything else."""
    lists = [path for path in paths if path.endswith(LIST)]
    others = [path for path in paths if not path.endswith((LIST, _LIMITS))]
    for path in (*lists[1:], *others):
        help = f"name one {LIST} file, which names the models, and a {_LIMITS} file with the limits of switches"
        findings.add(codes.BAD_MODE_LIST("does not go with a list of modes", at=Location(path), help=help))
    files = _files(lists[0], findings)
    known = {found.mode for found in files}
    transitions = [t for path in paths if path.endswith(_LIMITS) for t in _transitions(path, known, findings)]
    if not files:
        help = "write lines such as 0.01;Drive;drive.amxmi"
        findings.add(codes.BAD_MODE_LIST("names no mode", at=Location(lists[0]), help=help))
    if findings.has_errors:
        raise HalpipeError(*findings.items)
    return ModeList(os.path.basename(lists[0]).removesuffix(LIST), files, tuple(transitions))


def _lines(path: str) -> Iterable[tuple[str, Location]]:
    text = read_bytes(path).decode("utf-8", "replace")
    numbered = ((line.strip(), Location(path, number)) for number, line in enumerate(text.splitlines(), 1))
    return ((line, at) for line, at in numbered if line)


def _files(path: str, findings: Findings) -> tuple[ModeFile, ...]:
    """Return the modes; their files stand beside the list, wherever they stood when it was written."""
    found: dict[str, ModeFile] = {}
    for line, at in _lines(path):
        _, _, rest = line.partition(";")
        mode, _, file = rest.partition(";")
        if mode == _END:
            break
        name = legal(mode.strip())
        if not mode.strip() or not file.strip() or name in found:
            what = "is a mode for the second time" if name in found else "is no line of a list of modes"
            help = "write time;mode;file, each mode once"
            findings.add(codes.BAD_MODE_LIST(f'"{line}" {what}', at=at, help=help))
            continue
        beside = os.path.join(os.path.dirname(path), file.strip().replace("\\", "/").rpartition("/")[2])
        found[name] = ModeFile(name, beside, at)
    return tuple(found.values())


def _transitions(path: str, known: set[str], findings: Findings) -> list[Transition]:
    found = []
    for line, at in _lines(path):
        parts = [part.strip() for part in line.split(",")]
        names = [legal(part) for part in parts[:2]]
        unknown = [name for name in names if name not in known]
        try:
            limit = Duration.parse(parts[2]) if len(parts) == 3 else None  # from, to, limit
        except ValueError:
            limit = None
        if limit is None or unknown:
            help = did_you_mean(unknown[0], known, "write from,to,100ms") if unknown else "write from,to,100ms"
            message = f'"{line}" is no limit of a switch between two of the modes'
            findings.add(codes.BAD_MODE_LIST(message, at=at, help=help))
            continue
        origin = Origin(at.file, at.line, f"{names[0]}-{names[1]}")
        found.append(Transition(source=names[0], target=names[1], max_length=limit, origin=origin))
    return found


# ---------------------------------------------------------------------------------------------- merging


@dataclass(slots=True)
class _Merged:
    """Union of the modes; `names` gives the tasks of each mode their names in the whole."""

    names: dict[tuple[str, str], str] = field(default_factory=dict)
    tasks: dict[str, Task] = field(default_factory=dict)
    chains: dict[str, Chain] = field(default_factory=dict)


def merge(modes: Mapping[str, TaskModel], listed: ModeList, findings: Findings) -> TaskModel:
    """Return one model of the models of all modes; report tasks that differ too much to be one."""
    merged = _Merged()
    _name_tasks(modes, merged, listed, findings)
    found = []
    for mode, model in modes.items():
        runs = []
        for task in model.tasks:
            name = merged.names[mode, task.name]
            versions = [_add_version(mode, name, task, _renamed(v, mode, merged), merged) for v in task.versions]
            runs.append(Run(task=name, versions=tuple(versions)))
        for chain in model.chains:
            _add_chain(mode, chain, merged)
        found.append(Mode(name=mode, runs=tuple(runs), origin=model.origin))
    first = next(iter(modes.values()))
    units = {unit.name: unit for model in reversed(list(modes.values())) for unit in model.units}
    resources = {resource.name: resource for model in reversed(list(modes.values())) for resource in model.resources}
    return replace(
        first,
        name=legal(listed.name),
        units=tuple(units[name] for name in dict.fromkeys(u.name for m in modes.values() for u in m.units)),
        resources=tuple(resources[name] for name in dict.fromkeys(r.name for m in modes.values() for r in m.resources)),
        tasks=tuple(merged.tasks.values()),
        chains=tuple(merged.chains.values()),
        modes=tuple(found),
        transitions=listed.transitions,
        origin=Origin(listed.files[0].at.file, 1),
    )


def _name_tasks(modes: Mapping[str, TaskModel], merged: _Merged, listed: ModeList, findings: Findings) -> None:
    """Let tasks of one name keep it if they agree in all modes; otherwise each gets the name of its mode, too."""
    kinds: dict[str, set[object]] = {}
    for model in modes.values():
        for task in model.tasks:
            kinds.setdefault(task.name, set()).add((task.period, task.offset, task.slack, task.deadline))
    for mode, model in modes.items():
        for task in model.tasks:
            merged.names[mode, task.name] = task.name if len(kinds[task.name]) == 1 else f"{task.name}@{mode}"
    differing = [name for name, found in kinds.items() if len(found) > 1]
    if differing:
        message = f"{len(differing)} tasks have another timing in each mode: {few(differing)}"
        help = "state their periods in an overlay, if each is meant to be one task"
        findings.add(codes.MODES_DIFFER(message, at=listed.files[0].at, help=help))


def _renamed(version: Version, mode: str, merged: _Merged) -> Version:
    precedences = tuple(replace(p, task=merged.names[mode, p.task]) for p in version.precedences)
    return replace(version, precedences=precedences)


def _add_version(mode: str, name: str, task: Task, version: Version, merged: _Merged) -> str:
    """Add a version to a task unless it has one that is the same; return its name."""
    known = merged.tasks.setdefault(name, replace(task, name=name, versions=()))
    for other in known.versions:
        if _plain(other) == _plain(version):
            return other.name
    taken = {other.name for other in known.versions}
    chosen = version.name
    while chosen in taken:
        chosen = f"{chosen}:{mode}"
    merged.tasks[name] = replace(known, versions=(*known.versions, replace(version, name=chosen)))
    return chosen


def _plain(version: Version) -> Version:
    """Return a version without name and places, which do not make a difference."""
    precedences = tuple(replace(p, origin=None) for p in version.precedences)
    return replace(version, name="", origin=None, precedences=precedences)


def _add_chain(mode: str, chain: Chain, merged: _Merged) -> None:
    tasks = tuple(merged.names[mode, task] for task in chain.tasks)
    renamed = replace(chain, tasks=tasks)
    other = merged.chains.setdefault(chain.name, renamed)
    if replace(other, origin=None) != replace(renamed, origin=None):
        merged.chains[f"{chain.name}@{mode}"] = replace(renamed, name=f"{chain.name}@{mode}")
