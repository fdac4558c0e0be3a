"""Systems with one AMALTHEA file for each mode: a list of modes and files, and limits of the switches between them.

Before mode labels, each mode was a model of its own (McSim, DreamCloud project): a ``.modes`` file has lines
``time;mode;file``, a ``.csv`` file lines ``from,to,100ms``. Tasks of one name are one task where period, offset, slack
and deadline agree in all modes, with a version for each difference between modes; otherwise each mode has its own.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.core.files import read_bytes
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.names import few, legal
from halpipe.models import Chain, Mode, Origin, Run, Task, TaskModel, Transition, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Findings

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
    """What the modes come to together; `names` gives the tasks of each mode their names in the whole."""

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
