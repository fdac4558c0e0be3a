"""The whole import: files to items to drafts to the task model, with findings and the coverage of each element.

Each element and attribute is read, harmless by a listed reason, or reported. The lists stand in `meaning.yaml`. An
element or attribute in none of them is reported where it occurs, so a kind of a later release warns. The page
"AMALTHEA: what is read" is generated from the lists. Kinds are classes; elements without a class of their own have
their tag, which starts with a small letter. APP4MC writes ``_undefined_`` for a value that is not stated.
"""

from __future__ import annotations

import os
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import parse_yaml, refuse_more_than
from halpipe.core.records import record
from halpipe.core.suggest import counted, few
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.documents import load, read_embedded
from halpipe.importers.amalthea.graph import Evaluator
from halpipe.importers.amalthea.hardware import Memories, read_hardware
from halpipe.importers.amalthea.mapping import Allocations, interrupts_of
from halpipe.importers.amalthea.modes import DEFAULT, read_modes
from halpipe.importers.amalthea.parts import make_drafts
from halpipe.importers.amalthea.tasks import TaskBuilder
from halpipe.importers.amalthea.timing import Reactions, read_timing
from halpipe.importers.amalthea.versions import UNIT, Locks, Splitter, VersionMaker
from halpipe.importers.amalthea.xmi import Forest
from halpipe.importers.common.base import Coverage, Imported, imported
from halpipe.importers.common.names import Names, legal
from halpipe.models import Mode, Origin, Resource, ResourceKind, Run, TaskModel, Unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.amalthea import AmaltheaImportOptions
    from halpipe.importers.amalthea.hardware import Hardware
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Drafts
    from halpipe.importers.amalthea.tasks import Built
    from halpipe.importers.amalthea.xmi import Item
    from halpipe.importers.overlay import OverlayUse
    from halpipe.models import Chain, Interrupt

_MEANING = Path(__file__).with_name("meaning.yaml")
_LISTS: dict[str, Any] = parse_yaml(_MEANING.read_bytes(), _MEANING.name)


def _expanded(features: str) -> str:
    groups = _LISTS["groups"]
    return " ".join(groups[word[1:]] if word.startswith("$") else word for word in features.split())


READ: dict[str, str] = {kinds: _expanded(features) for kinds, features in _LISTS["read"].items()}
"""The features that the import reads, by the kinds that have them."""
HARMLESS: dict[str, str] = _LISTS["harmless"]
"""Kinds and features without influence on what a target may do, by the reason; ``*`` stands for every kind."""
UNREACHED: dict[str, str] = _LISTS["unreached"]
"""Kinds that are harmless where the import does not reach them, by the reason."""
_CONTAINERS = frozenset(_LISTS["containers"].split())
"""Kinds that only hold others; these are looked at even where none of them is used."""
_PARTS = frozenset(_LISTS["parts"].split())
_PART_ENDINGS = ("Distribution", "Histogram", "Boundaries", "Statistics", "Constant", "Object", "Estimators")


def is_part(kind: str) -> bool:
    """Return whether elements of a kind are values of the element that holds them, and counted with it."""
    is_value = kind.endswith(_PART_ENDINGS) and not kind.startswith("Instructions")
    return kind[:1].islower() or kind in _PARTS or is_value


_UNSTATED = ("", "_undefined_")


@record
class Rules:
    """The lists by single kinds and features."""

    read: Mapping[str, Mapping[str, tuple[str, ...]]]
    harmless: Mapping[str, str]
    unreached: Mapping[str, str]

    def reads(self, kind: str, feature: str, value: str = "") -> bool:
        """Return whether the import reads a feature of a kind, with a value that it understands."""
        values = self.read.get(kind, {}).get(feature)
        return values is not None and (not values or value in values)

    def reason(self, kind: str, feature: str = "") -> str:
        """Return why a kind or a feature of it is harmless; empty if it is not on the list."""
        if not feature:
            return self.harmless.get(kind, "")
        return self.harmless.get(f"{kind}.{feature}") or self.harmless.get(f"*.{feature}", "")


def _rules() -> Rules:
    read: dict[str, dict[str, tuple[str, ...]]] = {}
    for kinds, features in READ.items():
        parted = (feature.partition("=") for feature in features.split())
        found = {name: tuple(values.split("|")) if values else () for name, _, values in parted}
        for kind in kinds.split():
            read.setdefault(kind, {}).update(found)
    harmless, unreached = (
        {word: reason for reason, words in lists.items() for word in words.split()} for lists in (HARMLESS, UNREACHED)
    )
    return Rules(read, harmless, unreached)


RULES = _rules()


_STATED = "has a warning of its own"
_UNKNOWN = "is not read, and not known to be harmless"
_HELP = "remove it, or state in an overlay what matters of it for the schedule"


def account(
    forest: Forest, drafts: Drafts, memories: Memories, accesses: Mapping[Item, Item], coverage: Coverage
) -> None:
    """Account for every element of all files; `accesses` are those that tasks make, with their labels."""
    for access, label in accesses.items():
        if label.is_used:
            access.use_all()
    accounting = _Accounting(forest, drafts, memories, coverage)
    accounting.made = {*accesses, *accesses.values()}
    for root in forest.roots:
        coverage.mapped("file")
        accounting.visit(root)
    accounting.report()


class _Accounting:
    def __init__(self, forest: Forest, drafts: Drafts, memories: Memories, coverage: Coverage) -> None:
        self.forest = forest
        self.coverage = coverage
        self.reasons = {**drafts.without, **dict.fromkeys(memories.unplaced, "is mapped to no memory")}
        self.kinds: defaultdict[str, list[Item]] = defaultdict(list)
        self.features: defaultdict[tuple[str, str, str], list[Item]] = defaultdict(list)
        tasks = forest.within("SWModel", "tasks", "isrs")
        self.made: set[Item] = set()
        """Accesses and labels that are looked into although no phase of a memory comes of them."""
        self.active = {stimulus for task in tasks for stimulus in forest.refs(task, "stimuli")}

    def visit(self, root: Item) -> None:
        """Account for an element and all within it."""
        rest = [root]
        while rest:
            item = rest.pop()
            if item is not root:
                reason = self.reason(item)
                if reason and item in self.made:
                    self.coverage.ignored(item.kind, item.name or item.path, reason, item.at)
                elif reason:
                    self.ignore(item, reason)
                    continue
                else:
                    self.count(item)
            self.attributes(item)
            for child in reversed(item.children):
                if reason := RULES.reason(item.kind, child.tag):
                    self.ignore(child, reason)
                elif RULES.reads(item.kind, child.tag):
                    rest.append(child)
                else:
                    self.unknown(child)

    def reason(self, item: Item) -> str:
        """Return why an element and all within it is ignored, empty if it is looked into."""
        if harmless := RULES.reason(item.kind):
            return harmless if not item.is_used else ""
        if item.is_used or item.kind in _CONTAINERS or not _is_entity(item):
            return ""
        if reason := self.reasons.get(item) or self.unreached(item):
            return reason
        if item in self.forest.reported:
            return _STATED
        self.kinds[item.kind].append(item)
        return _UNKNOWN

    def unreached(self, item: Item) -> str:
        """Return why an element that is not used decides nothing; empty if it may."""
        if item in self.active:
            return ""
        if item.kind == "HwAccessElement":
            memory = self.forest.ref(item, "destination")
            return "" if memory is not None and memory.is_used else "no access takes its way"
        return RULES.unreached.get(item.kind, "")

    def attributes(self, item: Item) -> None:
        """Note the attributes that are neither read nor harmless."""
        for name, value in item.element.attrib.items():
            kind, feature, stated = item.kind, str(name), str(value)
            if feature.startswith("{") or stated in _UNSTATED or RULES.reason(kind, feature):
                continue
            if not RULES.reads(kind, feature, stated):
                shown = str(value) if name in RULES.read.get(item.kind, {}) else ""
                self.features[item.kind, str(name), shown].append(item)

    def unknown(self, item: Item) -> None:
        if item in self.forest.reported:
            self.ignore(item, _STATED)
            return
        self.kinds[item.kind].append(item)
        self.ignore(item, _UNKNOWN)

    def count(self, item: Item) -> None:
        if _is_entity(item):
            if item.is_used:
                self.coverage.mapped(item.kind)
            else:
                self.coverage.ignored(item.kind, item.name or item.path, "holds nothing of influence", item.at)

    def ignore(self, item: Item, reason: str) -> None:
        for inner in item.walk():
            if _is_entity(inner):
                self.coverage.ignored(inner.kind, inner.name or inner.path, reason, inner.at)

    def report(self) -> None:
        """Report what may decide times, by kind and by attribute."""
        for kind, items in self.kinds.items():
            message = f"{_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))
        for (kind, name, value), items in self.features.items():
            stated = f'{name}="{value}"' if value else name
            message = f"{stated} of {_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))


def _is_entity(item: Item) -> bool:
    """Return whether an element counts on its own; values and references count with what holds them."""
    return not is_part(item.kind) and not (item.get("href") and not item.children)


def _times(count: int, kind: str) -> str:
    return f"{kind} is" if count == 1 else f"{count} of {kind} are"


def _places(items: Sequence[Item]) -> str:
    return few([f"{item.name or item.path} (line {item.at.line})" for item in items], quote="")


MOST_TASKS = 50_000
"""As many are imported within the cost law; vehicles have some thousands."""


def import_amalthea(paths: Sequence[str], options: AmaltheaImportOptions) -> Imported:
    """Read the files of one AMALTHEA model into one task model.

    Raise `HalpipeError` with every finding if any is an error: unusable files, values of a wrong form, no task with a
    period; under `options.strict` also every loss (warning), with the exit code for unsupported input.
    """
    return imported(lambda findings: _import(paths, options, findings), options)


def _import(paths: Sequence[str], options: AmaltheaImportOptions, findings: Findings) -> Imported:
    """Import one model; what its periods decide is added once an overlay is on it."""
    coverage = Coverage()
    model, reactions = _model(paths, options, findings, coverage)
    return Imported(model=model, diagnostics=(), coverage=coverage, completion=reactions.complete)


def _model(
    paths: Sequence[str], options: AmaltheaImportOptions, findings: Findings, coverage: Coverage
) -> tuple[TaskModel, Reactions]:
    """Read files into a model, and what is added once an overlay is on it; `coverage` accounts for every element."""
    documents = load(paths, findings)
    embedded = read_embedded(documents, options, findings, coverage)
    if embedded is not None:
        return embedded, Reactions(())
    forest = Forest(documents, findings)
    count = sum(1 for _ in forest.within("SWModel", "tasks", "isrs"))
    refuse_more_than(MOST_TASKS, count, "tasks and interrupt routines", forest.roots[0].at)
    hardware = read_hardware(forest)
    units = _unit_names(forest, hardware)
    modes = read_modes(forest)
    evaluator = Evaluator(forest)
    drafts = make_drafts(forest, modes, evaluator, options.overlay)
    _stop_without_tasks(forest, drafts, findings)
    memories = Memories(forest, hardware)
    splitter = Splitter(evaluator, options.pieces, added=options.memory == "added")
    locks = Locks(forest, evaluator, [memories.name(item) for item in hardware.memories])
    makers = VersionMaker(forest, evaluator, memories, units, modes, options.memory, splitter, locks)
    mapping = Allocations(forest) if options.mapping == "stated" else None
    timing = read_timing(forest, drafts)
    builder = TaskBuilder(forest, hardware, mapping, makers, coverage)
    built = builder.build(drafts, timing)
    interrupts = interrupts_of(forest, drafts.routines, hardware, mapping, evaluator, modes, options.overlay)
    runs = _modes(modes, built)
    model = TaskModel(
        name=legal(options.name or _name(paths)),
        units=_units(hardware, units, interrupts),
        resources=(*memories.resources(built.resources), *_locks(locks)),
        tasks=built.tasks,
        chains=_named(forest, built.chains),
        modes=runs,
        origin=Origin(forest.roots[0].file, 1),
    )
    makers.report()
    memories.report()
    _report(forest, model, evaluator, coverage, options.overlay)
    account(forest, drafts, memories, evaluator.accesses, coverage)
    return model, Reactions(timing.reactions)


def _stop_without_tasks(forest: Forest, drafts: Drafts, findings: Findings) -> None:
    if drafts.items:
        return
    count = len(drafts.without)
    held = f"{counted(count, 'task')}, none of them with a period" if count else "no task"
    help = "state periods under tasks: in an overlay" if count else "name the file with the software model, too"
    if not count and forest.kinds("SWModel"):
        help = (
            "its software model defines no tasks: let tasks call its runnables, or name the file that defines them, too"
        )
    findings.add(codes.NO_TASKS(f"the model has {held}", at=Location(forest.roots[0].file), help=help))
    raise HalpipeError(*findings.items)


def _name(paths: Sequence[str]) -> str:
    """Return the name of the first file or folder."""
    return os.path.basename(os.path.normpath(paths[0])).removesuffix(".amxmi") or "amalthea"


# --------------------------------------------------------------------------------------------- platform


def _locks(locks: Locks) -> tuple[Resource, ...]:
    kind = ResourceKind.LOCK
    return tuple(Resource(name=name, kind=kind, origin=item.origin) for item, name in locks.names.items())


def _unit_names(forest: Forest, hardware: Hardware) -> dict[Item, str]:
    names = Names(forest.findings, codes.RENAMED)
    return {unit.item: names.unique(unit.item.name, "processing unit", unit.item.at) for unit in hardware.units}


def _units(
    hardware: Hardware, names: dict[Item, str], interrupts: dict[Item, tuple[Interrupt, ...]]
) -> tuple[Unit, ...]:
    found = []
    for unit in hardware.units:
        unit.item.use()
        kind = ""
        if unit.type is not None:
            unit.type.use()
            kind = legal(unit.type.name)
        served = interrupts.get(unit.item, ())
        found.append(Unit(name=names[unit.item], type=kind, interrupts=served, origin=unit.item.origin))
    return tuple(found) or (Unit(name=UNIT),)


def _named(forest: Forest, chains: Sequence[Chain]) -> tuple[Chain, ...]:
    names = Names(forest.findings, codes.RENAMED)
    return tuple(
        replace(chain, name=names.unique(chain.name, "chain", chain.origin.location if chain.origin else Location()))
        for chain in chains
    )


def _modes(modes: Sequence[SystemMode], built: Built) -> tuple[Mode, ...]:
    """Return the modes, each with the tasks and versions that its stimuli and branches choose.

    Modes that make no difference to any task are one.
    """
    found = []
    for mode in modes:
        runs = [
            Run(task=name, versions=tuple(by[mode.name])) for name, by in built.by_mode.items() if by.get(mode.name)
        ]
        found.append(Mode(name=mode.name, runs=tuple(runs), origin=mode.origin.origin if mode.origin else None))
    if all(mode.runs == found[0].runs for mode in found):
        return (Mode(name=DEFAULT, runs=found[0].runs),)
    for mode in modes:
        for label in mode.literals:
            label.use()
        if mode.origin is not None:
            mode.origin.use()
    return tuple(found)


# ---------------------------------------------------------------------------------------------- reports


def _report(
    forest: Forest, model: TaskModel, evaluator: Evaluator, coverage: Coverage, overlay: OverlayUse | None
) -> None:
    help = "state the WCET in an overlay, if no job takes the longest branch of all"
    forest.report_each(codes.BRANCHES, "switches choose at run time", list(evaluator.branched), help)
    help = "state the WCET in an overlay"
    forest.report_each(codes.LOOP, "loops are counted once", list(evaluator.loops), help)
    file = Location(forest.roots[0].file)
    lacking = [task for task in model.tasks if any(version.wcet is None for version in task.versions)]
    if lacking:
        at = lacking[0].origin.location if lacking[0].origin else file
        names = few([task.name for task in lacking], quote="")
        message = f"{len(lacking)} of {len(model.tasks)} tasks have no execution time: {names}"
        forest.findings.add(codes.NO_WCET(message, at=at, help="give them in an overlay (tasks: wcet)"))
    if model.units == (Unit(name=UNIT),):
        coverage.defaulted("platform", "units", UNIT)
        if overlay is not None and overlay.names_units:
            return
        cure = "add the file with the hardware model"
        if forest.kinds("HWModel"):
            cure = "let the hardware model define processing units"
        help = f"{cure}, or name units under platform: in an overlay"
        forest.findings.add(codes.DEFAULT_UNIT(f"no processing unit is defined; assumed {UNIT}", at=file, help=help))
