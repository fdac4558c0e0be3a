"""From files to the task model: the order of the import's steps, the tasks, and callback groups as resources.

The callbacks of a mutually exclusive group share data without locks. A resource that each of their tasks needs wholly,
for its whole WCET, keeps them apart on any units, just as the group does. That takes the WCETs, which an overlay may
state, so it is done once the overlay is on the model. Tasks that all have one and the same unit are apart without it.
A single-threaded executor is not modelled: it is how ROS assigns cores, which the schedule takes over. An executor
configuration of halpipe holds the native model; its executors, groups and timers repeat what the schedule says.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location, Severity, named
from halpipe.core.durations import ZERO
from halpipe.core.embedding import joined
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import counted, few
from halpipe.importers.common.base import Coverage, Imported, imported
from halpipe.importers.common.names import Names, legal
from halpipe.importers.native import parse_model
from halpipe.importers.ros import codes
from halpipe.importers.ros.activation import Activations, Wiring, activate, settled
from halpipe.importers.ros.calibrate import calibrate
from halpipe.importers.ros.caret import read_caret
from halpipe.importers.ros.coverage import Account, prune
from halpipe.importers.ros.dataflow import DataFlow, Edge, chains_of, order_by_data, report_unknown_publishers
from halpipe.importers.ros.design import ModeGraph, ModeModel, merge_modes, read_design
from halpipe.importers.ros.dot import read_dot
from halpipe.importers.ros.graph import Callback, Group, Kind, RosGraph, task_names
from halpipe.importers.ros.options import RESOURCES, RosImportOptions
from halpipe.importers.ros.rosbag import read_bag
from halpipe.importers.ros.sniff import EXECUTORS_KEY, FileKind, Inputs, find
from halpipe.importers.ros.traced import confront, graph_of
from halpipe.importers.ros.yaml_reader import Reader
from halpipe.importers.traces.ros2 import read_ros_trace
from halpipe.models import Access, Anchor, Mode, Origin, Precedence, Resource, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.files import YamlMap
    from halpipe.importers.overlay import OverlayUse

_EXECUTORS_VERSION = "2"
_MODEL = "model-xml"
_TOP = (EXECUTORS_KEY, "model", "model-sha256", "scheduling", "modes", "not-realised", _MODEL)


def read_executors(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> TaskModel:
    """Return the model of a recognised document; raise `HalpipeError` for another version, and what is no model."""
    help = "export the schedule again"
    reader = Reader(file, findings, help)
    reader.check_keys(document, "file", _TOP)
    text, version = document.get(_MODEL), document.get(EXECUTORS_KEY)
    if version != _EXECUTORS_VERSION or not isinstance(text, str):
        what = f'version "{version}" of the format is not {_EXECUTORS_VERSION}, which this halpipe reads'
        what, key = ("holds no native model", _MODEL) if version == _EXECUTORS_VERSION else (what, EXECUTORS_KEY)
        raise HalpipeError(codes.MALFORMED(what, at=Location(file, document.line_of(key)), path="file", help=help))
    model = parse_model(joined([text], document.line_of(_MODEL) + 1), file)
    for kind in ("unit", "resource", "task", "chain", "mode", "transition"):
        coverage.mapped(kind, len(getattr(model, f"{kind}s")))
    for mode in reader.entries(document, "modes", "file"):
        for executor in reader.entries(mode, "executors", "mode"):
            name = f"{mode.get('name')} {executor.get('name')}"
            coverage.ignored("executor", name, "is what the schedule says, not the model", reader.at(executor))
    return model


CALLBACK_GROUP = "callback_group"
DEFAULT_GROUP = "default_callback_group"
"""The group that rclcpp puts callbacks into for which no other is stated; it is mutually exclusive."""

_CORES = "the schedule assigns the cores, not an executor"
_GIVEN_UP = "its tasks may overlap on different units"
_NO_PAIR = "no two of its callbacks that exclude each other are tasks"


def default_groups(graph: RosGraph, coverage: Coverage) -> list[Group]:
    """Return the default groups of nodes: of the callbacks that are in no stated one."""
    stated = {name for group in graph.groups if group.kind == CALLBACK_GROUP for name in group.callbacks}
    others = [callback for callback in graph.callbacks if callback.name not in stated]
    loose = grouped((each.node, each.name) for each in others if each.kind not in (Kind.NODE, Kind.SERVICE))
    places = {node.name: node.at for node in graph.nodes}
    found = []
    for node, callbacks in loose.items():
        if len(callbacks) > 1 and node in places:
            coverage.defaulted(node, "callback group", "mutually exclusive, as rclcpp's default", places[node])
            name = f"{node}/{DEFAULT_GROUP}"
            found.append(
                Group(kind=DEFAULT_GROUP, name=name, exclusive=True, callbacks=tuple(callbacks), at=places[node])
            )
    return found


@record
class Exclusion:
    """The groups of an import and the task of each callback; `as_resources`: whether tasks are to be kept apart."""

    groups: Sequence[Group]
    tasks_of: Mapping[str, str]
    as_resources: bool
    coverage: Coverage

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with a resource for each exclusive group; account for all groups, warn where one is lost."""
        findings = Findings()
        tasks = {task.name: task for task in model.tasks}
        names = Names(findings, codes.RENAMED, {resource.name for resource in model.resources}, mark="_")
        resources: list[Resource] = []
        lost: list[tuple[Group, list[str]]] = []
        executors = []
        done: set[tuple[str, frozenset[str]]] = set()
        for group in self.groups:
            members = self._members(group, model)
            again = (group.name, frozenset(members)) in done
            done.add((group.name, frozenset(members)))
            if not group.exclusive or (len(members) < 2 and not any(_meets_itself(tasks[name]) for name in members)):
                self._ignored(group, _NO_PAIR)
            elif group.kind == "executor":
                executors.append(group)
                self._ignored(group, _CORES)
            elif again:
                self._mapped(group)
            elif self.as_resources and all(_can_hold(tasks[name]) for name in members):
                name = names.unique(group.name, "callback group", group.at)
                resources.append(Resource(name=name, origin=Origin(group.at.file, group.at.line, group.name)))
                tasks |= {member: _holding(tasks[member], name) for member in members}
                self._mapped(group)
            elif _one_unit(tasks[name] for name in members):
                self._mapped(group)
            else:
                lost.append((group, members))
                self._ignored(group, _GIVEN_UP)
        findings.extend(self._reports(lost, executors, tasks))
        model = replace(model, resources=(*model.resources, *resources), tasks=tuple(tasks.values()))
        return model, tuple(dict.fromkeys(findings.items))

    def _members(self, group: Group, model: TaskModel) -> list[str]:
        """Return the tasks of a group, also those that stand for a callback in one mode only."""
        named = {self.tasks_of[name] for name in group.callbacks if name in self.tasks_of}
        named |= {f"{name}@{mode.name}" for name in named for mode in model.modes}
        return [task.name for task in model.tasks if task.name in named]

    def _mapped(self, group: Group) -> None:
        if group.kind != DEFAULT_GROUP:
            self.coverage.mapped(group.kind)

    def _ignored(self, group: Group, reason: str) -> None:
        if group.kind != DEFAULT_GROUP:
            self.coverage.ignored(group.kind, group.name, reason, group.at)

    def _reports(
        self, lost: Sequence[tuple[Group, list[str]]], executors: Sequence[Group], tasks: Mapping[str, Task]
    ) -> Iterable[Diagnostic]:
        if lost:
            group, members = lost[0]
            unable = [name for name in members if not _can_hold(tasks[name])]
            text = (
                f"callbacks of {len(lost)} mutually exclusive callback groups may overlap: "
                f"{few([group.name for group, _ in lost])}"
            )
            help = "omit --groups ignored, or give the tasks of a group one and the same unit"
            if self.as_resources:
                text += (
                    f"; for the first, {few(unable)} cannot hold it to their ends, for want of a WCET or being split"
                )
                help = "state their WCETs in an overlay or with --calibrate, or give them one and the same unit"
            yield codes.EXCLUSION(text, at=group.at, path=named("callback group", group.name), help=help)
        if executors:
            what = counted(len(executors), "single-threaded executor")
            text = f"not represented: {what}, whose callbacks may run in parallel"
            help = "in the overlay, give the tasks of an executor one and the same unit if they share data across nodes"
            yield codes.EXCLUSION(text, at=executors[0].at, help=help, severity=Severity.NOTE)


def _can_hold(task: Task) -> bool:
    """Return whether a resource can be held from start to end: WCETs are known, and no job is split."""
    return all(version.wcet and not version.split.is_allowed for version in task.versions)


def _meets_itself(task: Task) -> bool:
    """Return whether a job may still run when the next one of its task starts."""
    return task.period is not None and task.deadline is not None and task.deadline > task.period


def _one_unit(tasks: Iterable[Task]) -> bool:
    """Return whether only one unit is left for all versions of all tasks."""
    units = {version.units for task in tasks for version in task.versions}
    return len(units) == 1 and len(next(iter(units))) == 1


def _holding(task: Task, resource: str) -> Task:
    """Return the task with the whole of `resource` needed from the start of each job to its WCET."""
    versions = []
    for version in task.versions:
        assert version.wcet is not None
        whole = Access(resource=resource, start=ZERO, end=version.wcet)
        versions.append(replace(version, accesses=(*version.accesses, whole)))
    return replace(task, versions=tuple(versions))


UNIT = "core0"
VERSION = "default"
MODE = "default"


def import_graph(paths: Sequence[str], options: RosImportOptions) -> Imported:
    """Import one graph or design with the recordings that go with it; raise `HalpipeError` when no task comes out."""
    inputs = find(paths)
    return imported(lambda findings: _Import(inputs, options, findings).imported(), options)


@record
class _System:
    """A model, the task of every callback by the callback's name in the source, and the groups of callbacks."""

    model: TaskModel
    tasks_of: Mapping[str, str]
    groups: tuple[Group, ...] = ()
    callbacks: tuple[Callback, ...] = ()


class _Import:
    """One import: its inputs and options, and what is found and accounted for on the way."""

    def __init__(self, inputs: Inputs, options: RosImportOptions, findings: Findings) -> None:
        self.inputs, self.options = inputs, options
        self.findings, self.coverage = findings, Coverage()
        findings.extend(inputs.findings)
        self.rates = [r for bag in inputs.bags for r in read_bag(bag.content, bag.name, self.findings, self.coverage)]
        self.trace = read_ros_trace(inputs.traces[0], self.findings) if inputs.traces else None

    def imported(self) -> Imported:
        """Read the source, fill in WCETs, and leave the groups for when an overlay is on the model."""
        inputs, options, findings, coverage = self.inputs, self.options, self.findings, self.coverage
        for name in inputs.skipped:
            coverage.ignored("file", name, "is no graph and no recording")
        if files := len(inputs.graphs) + len(inputs.bags):
            coverage.mapped("file", files)
        if self.trace is not None:
            coverage.mapped("trace")
            self.rates += graph_of(self.trace, Findings(), Coverage()).rates
        system = self._design() if inputs.designs else self._executors() if self._is_executors() else self._graph()
        model = replace(system.model, name=options.name or system.model.name)
        model = calibrate(model, system.tasks_of, system.callbacks, self.trace, options, findings, coverage)
        exclusion = Exclusion(system.groups, system.tasks_of, options.groups == RESOURCES, coverage)
        return Imported(model=model, diagnostics=(), coverage=coverage, completion=exclusion.complete)

    def _is_executors(self) -> bool:
        return bool(self.inputs.graphs) and self.inputs.graphs[0].kind is FileKind.EXECUTORS

    def _graph(self) -> _System:
        findings, coverage, trace = self.findings, self.coverage, self.trace
        if trace is not None and not self.inputs.graphs:
            graph = replace(graph_of(trace, findings, coverage), rates=())
        elif (source := self.inputs.graphs[0]).kind is FileKind.CARET:
            graph = read_caret(source.content, source.name, findings, coverage)
            graph = graph if trace is None or findings.has_errors else confront(graph, trace, findings)
        else:
            graph = read_dot(source.content, source.name, findings)
        self.findings.stop_on_errors()
        system = self._tasks(ModeGraph(MODE, graph, {}, Location(graph.file)))
        if system is None:
            raise self._no_tasks("graph", graph.file)
        return replace(system, model=replace(system.model, name=_stem(graph.file)))

    def _executors(self) -> _System:
        source = self.inputs.graphs[0]
        model = read_executors(source.content, source.name, self.findings, self.coverage)
        self.findings.stop_on_errors()
        for rate in self.rates:
            self.coverage.ignored("bag_topic", rate.topic, "the executors file states every period", rate.at)
        return _System(model, {})

    def _design(self) -> _System:
        sources = self.inputs.designs
        design = read_design([(source.name, source.content) for source in sources], self.findings, self.coverage)
        self.findings.stop_on_errors()
        parts: list[ModeModel] = []
        tasks_of: dict[str, str] = {}
        groups: list[Group] = []
        for mode in design.modes:
            system = self._tasks(mode)
            if system is not None:
                parts.append(ModeModel(legal(mode.mode), system.model, mode.at))
                tasks_of = {**system.tasks_of, **tasks_of}
                groups += system.groups
            elif len(design.modes) > 1:
                text = f'mode "{mode.mode}" is left out: nothing in it has a period'
                self.findings.add(codes.NO_PERIOD(text, at=mode.at, help="state periods under sources: in an overlay"))
        if not parts:
            raise self._no_tasks("design", sources[0].name)
        model = merge_modes(parts, self.findings)
        name = legal(design.name) if design.name else _stem(sources[0].name)
        return _System(replace(model, name=name), tasks_of, tuple(groups))

    def _tasks(self, part: ModeGraph) -> _System | None:
        """Return the model of one graph; None if nothing in it has a period."""
        findings, coverage, overlay = self.findings, self.coverage, self.options.overlay
        names = task_names(part.graph, Names(findings, codes.RENAMED, mark="_"))
        wiring = Wiring(prune(part.graph, overlay, names, coverage))
        activations = activate(wiring, [*self.rates, *part.graph.rates], overlay, names, findings)
        wiring = settled(wiring, activations)
        report_unknown_publishers(wiring, findings)
        flow = order_by_data(wiring, activations, findings)
        triggers = {callback.name: callback.inputs for callback in part.graph.callbacks}
        Account(triggers, wiring, activations, flow).write(self.rates, findings, coverage)
        if not activations.of:
            return None
        tasks_of = {callback: names[callback] for callback in wiring.callbacks if callback in activations.of}
        model = _Model(wiring, activations, flow, tasks_of, findings, coverage, overlay).of(part.units)
        groups = (*wiring.graph.groups, *default_groups(wiring.graph, coverage))
        return _System(model, {callback: names[callback] for callback in activations.of}, groups, part.graph.callbacks)

    def _no_tasks(self, what: str, file: str) -> HalpipeError:
        help = "state periods under sources: or tasks: in an overlay, or add a rosbag2 metadata.yaml"
        self.findings.add(codes.NO_TASKS(f"nothing in the {what} has a period", at=Location(file), help=help))
        return HalpipeError()


def _stem(file: str) -> str:
    return legal(os.path.basename(os.path.normpath(file)).split(".")[0] or "ros")


@record
class _Model:
    """The model of one mode, still without a name."""

    wiring: Wiring
    activations: Activations
    flow: DataFlow
    tasks_of: Mapping[str, str]
    findings: Findings
    coverage: Coverage
    overlay: OverlayUse | None

    def of(self, placed: Mapping[str, str]) -> TaskModel:
        """Return the model; `placed` is the compute unit of nodes that have one."""
        callbacks, file = self.wiring.callbacks, self.wiring.graph.file
        units = {callback: legal(placed.get(callbacks[callback].node, UNIT)) for callback in self.tasks_of}
        constraints = self._precedences()
        tasks = tuple(self._task(callback, unit, constraints.get(callback, ())) for callback, unit in units.items())
        used = list(dict.fromkeys(units.values()))
        self._report_units(used, len(tasks), Location(file))
        names = Names(self.findings, codes.RENAMED, mark="_")
        chains = chains_of(self.wiring, self.activations, self.tasks_of, names, self.findings, self.coverage)
        mode = Mode(name=MODE, runs=tuple(Run(task=task.name, versions=(VERSION,)) for task in tasks))
        stated = {legal(unit) for unit in placed.values()}
        platform = tuple(Unit(name=unit, origin=Origin(file) if unit in stated else None) for unit in used)
        return TaskModel(name=MODE, units=platform, tasks=tasks, chains=chains, modes=(mode,), origin=Origin(file))

    def _task(self, callback: str, unit: str, constraints: Sequence[Precedence]) -> Task:
        name, stated = self.tasks_of[callback], self.wiring.callbacks[callback]
        activation = self.activations.of[callback]
        if stated.period is None:
            self.coverage.defaulted(name, "period", f"{activation.period} from {activation.cause}", stated.at)
        version = Version(name=VERSION, units=(unit,), precedences=tuple(constraints))
        origin = Origin(stated.at.file, stated.at.line, callback)
        return Task(name=name, period=activation.period, versions=(version,), origin=origin)

    def _precedences(self) -> dict[str, list[Precedence]]:
        """Return the constraints of every callback, one per predecessor.

        A window is the longer of both periods: some end of a job that recurs with period D lies within D before any
        instant. A shorter one can be impossible: a reader faster than its publisher starts up to D after the last end.
        """
        first: dict[tuple[str, str], Edge] = {}
        for edge in self.flow.edges:
            first.setdefault((edge.reader, edge.publisher), edge)
        constraints: dict[str, list[Precedence]] = {}
        for edge in first.values():
            window = max(self.activations.of[name].period for name in (edge.publisher, edge.reader))
            at, publisher = self.wiring.callbacks[edge.reader].at, self.tasks_of[edge.publisher]
            value = f"from the end of {publisher}: {ZERO} to {window}"
            self.coverage.defaulted(self.tasks_of[edge.reader], "precedence window", value, at)
            origin = Origin(at.file, at.line, edge.topic)
            row = Precedence(task=publisher, min=ZERO, max=window, anchor=Anchor.END, origin=origin)
            constraints.setdefault(edge.reader, []).append(row)
        if first:
            text = f"{counted(len(first), 'precedence window')}: 0 to the longer period after the predecessor's end"
            help = "state tighter windows under precedence: in an overlay where the data must be fresher"
            self.findings.add(codes.DEFAULT_WINDOW(text, at=Location(self.wiring.graph.file), help=help))
        return constraints

    def _report_units(self, units: list[str], count: int, at: Location) -> None:
        if UNIT in units:
            self.coverage.defaulted("platform", "units", UNIT)
        if self.overlay is not None and self.overlay.names_units:
            return
        help = "name the units of the computer under platform: in an overlay"
        stated = [unit for unit in units if unit != UNIT]
        if UNIT in units:
            some = counted(count, "task") if not stated else "tasks without a compute unit"
            self.findings.add(codes.DEFAULT_UNIT(f"{some} put on one unit, {UNIT}", at=at, help=help))
        if stated:
            text = f"{len(stated)} compute units are one execution unit each: {few(stated)}"
            self.findings.add(codes.COMPUTE_UNITS(text, at=at, help=help))
