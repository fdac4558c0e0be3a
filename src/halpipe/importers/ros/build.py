"""From files to the task model: the order of the import's steps, and the tasks themselves."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, Findings, HalpipeError, Location, Severity, sort_diagnostics
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.importers.common.base import Coverage, Imported
from halpipe.importers.ros import codes
from halpipe.importers.ros.activation import Wiring, activate, settled
from halpipe.importers.ros.calibrate import calibrate
from halpipe.importers.ros.caret import read_caret
from halpipe.importers.ros.coverage import Result, account, prune
from halpipe.importers.ros.dataflow import Edge, chains_of, order_by_data, report_unknown_publishers
from halpipe.importers.ros.design import ModeGraph, ModeModel, merge_modes, read_design
from halpipe.importers.ros.dot import read_dot
from halpipe.importers.ros.exclusion import Exclusion, default_groups
from halpipe.importers.ros.executors import read_executors
from halpipe.importers.ros.graph import Names, clean, few, task_names
from halpipe.importers.ros.options import RESOURCES
from halpipe.importers.ros.rosbag import read_bag
from halpipe.importers.ros.sniff import FileKind, find
from halpipe.importers.ros.traced import confront, graph_of
from halpipe.importers.traces.ros2 import read_ros_trace
from halpipe.models import Anchor, Mode, Origin, Precedence, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.importers.ros.graph import Callback, Group, Rate, RosGraph
    from halpipe.importers.ros.options import RosImportOptions
    from halpipe.importers.ros.sniff import Input
    from halpipe.importers.traces.ros2 import RosTrace

UNIT = "core0"
VERSION = "default"
MODE = "default"


def import_graph(paths: Sequence[str], options: RosImportOptions) -> Imported:
    """Import one graph or design with the recordings that go with it; raise `HalpipeError` when no task comes out."""
    inputs = find(paths)
    findings, coverage = Findings(list(inputs.findings)), Coverage()
    for name in inputs.skipped:
        coverage.ignored("file", name, "is no graph and no recording")
    rates = [r for bag in inputs.bags for r in read_bag(bag.content, bag.name, findings, coverage)]
    if files := len(inputs.graphs) + len(inputs.bags):
        coverage.mapped("file", files)
    trace = read_ros_trace(inputs.traces[0], findings) if inputs.traces else None
    if trace is not None:
        coverage.mapped("trace")
        rates += graph_of(trace, Findings(), Coverage()).rates
    if inputs.designs:
        system = _from_design(inputs.designs, rates, options, findings, coverage)
    elif trace is not None and not inputs.graphs:
        graph = replace(graph_of(trace, findings, coverage), rates=())
        system = _from_parsed(graph, rates, options, findings, coverage)
    elif inputs.graphs[0].kind is FileKind.EXECUTORS:
        system = _from_executors(inputs.graphs[0], rates, findings, coverage)
    else:
        system = _from_graph(inputs.graphs[0], trace, rates, options, findings, coverage)
    model = replace(system.model, name=options.name or system.model.name)
    model = calibrate(model, system.tasks_of, system.callbacks, trace, options, findings, coverage)
    exclusion = Exclusion(system.groups, system.tasks_of, options.groups == RESOURCES, coverage)
    imported = replace(_finish(model, findings, coverage, options.strict), completion=exclusion.complete)
    return imported.completed() if options.overlay is None else imported


@record
class _System:
    """A model, the task of every callback by the callback's name in the source, and the groups of callbacks."""

    model: TaskModel
    tasks_of: Mapping[str, str]
    groups: tuple[Group, ...] = ()
    callbacks: tuple[Callback, ...] = ()


def _from_graph(
    source: Input,
    trace: RosTrace | None,
    rates: list[Rate],
    options: RosImportOptions,
    findings: Findings,
    coverage: Coverage,
) -> _System:
    if source.kind is FileKind.CARET:
        graph = read_caret(source.content, source.name, findings, coverage)
        graph = graph if trace is None or findings.has_errors else confront(graph, trace, findings)
    else:
        graph = read_dot(source.content, source.name, findings)
    return _from_parsed(graph, rates, options, findings, coverage)


def _from_parsed(
    graph: RosGraph, rates: list[Rate], options: RosImportOptions, findings: Findings, coverage: Coverage
) -> _System:
    _stop_on_errors(findings)
    system = _tasks(ModeGraph(MODE, graph, {}, Location(graph.file)), rates, options, findings, coverage)
    if system is None:
        raise _no_tasks("graph", graph.file, findings)
    return replace(system, model=replace(system.model, name=_stem(graph.file)))


def _from_executors(source: Input, rates: list[Rate], findings: Findings, coverage: Coverage) -> _System:
    model = read_executors(source.content, source.name, findings, coverage)
    _stop_on_errors(findings)
    for rate in rates:
        coverage.ignored("bag_topic", rate.topic, "the executors file states every period", rate.at)
    return _System(model, {})


def _from_design(
    sources: Sequence[Input], rates: list[Rate], options: RosImportOptions, findings: Findings, coverage: Coverage
) -> _System:
    design = read_design([(source.name, source.content) for source in sources], findings, coverage)
    _stop_on_errors(findings)
    parts: list[ModeModel] = []
    tasks_of: dict[str, str] = {}
    groups: list[Group] = []
    for mode in design.modes:
        system = _tasks(mode, rates, options, findings, coverage)
        if system is not None:
            parts.append(ModeModel(clean(mode.mode), system.model, mode.at))
            tasks_of = {**system.tasks_of, **tasks_of}
            groups += system.groups
        elif len(design.modes) > 1:
            text = f'mode "{mode.mode}" is left out: nothing in it has a period'
            findings.add(codes.NO_PERIOD(text, at=mode.at, help="state periods under sources: in an overlay"))
    if not parts:
        raise _no_tasks("design", sources[0].name, findings)
    model = merge_modes(parts, findings)
    name = clean(design.name) if design.name else _stem(sources[0].name)
    return _System(replace(model, name=name), tasks_of, tuple(groups))


def _tasks(
    part: ModeGraph, rates: list[Rate], options: RosImportOptions, findings: Findings, coverage: Coverage
) -> _System | None:
    """Return the model of one graph; None if nothing in it has a period."""
    names = task_names(part.graph, Names(findings))
    wiring = Wiring.of(prune(part.graph, options.overlay, names, coverage))
    activations = activate(wiring, [*rates, *part.graph.rates], options.overlay, names, findings)
    wiring = settled(wiring, activations)
    report_unknown_publishers(wiring, findings)
    flow = order_by_data(wiring, activations, findings)
    triggers = {callback.name: callback.inputs for callback in part.graph.callbacks}
    result = Result(triggers, wiring, activations, flow)
    account(result, rates, findings, coverage)
    if not activations.of:
        return None
    model = _model(result, names, part.units, findings, coverage)
    groups = (*wiring.graph.groups, *default_groups(wiring.graph, coverage))
    return _System(model, {callback: names[callback] for callback in activations.of}, groups, part.graph.callbacks)


def _stem(file: str) -> str:
    return clean(os.path.basename(os.path.normpath(file)).split(".")[0] or "ros")


def _no_tasks(what: str, file: str, findings: Findings) -> HalpipeError:
    help = "state periods under sources: or tasks: in an overlay, or add a rosbag2 metadata.yaml"
    findings.add(codes.NO_TASKS(f"nothing in the {what} has a period", at=Location(file), help=help))
    return HalpipeError(*_unique(findings))


def _stop_on_errors(findings: Findings) -> None:
    if findings.has_errors:
        raise HalpipeError(*_unique(findings))


def _unique(findings: Findings) -> list[Diagnostic]:
    """Return the findings in order, each once: what several modes share is said once."""
    return list(dict.fromkeys(sort_diagnostics(findings.items)))


def _finish(model: TaskModel, findings: Findings, coverage: Coverage, strict: bool) -> Imported:
    found = _unique(findings)
    losses = [d for d in found if d.severity is Severity.WARNING]
    if strict and losses:
        raised = (replace(d, severity=Severity.ERROR) if d.severity is Severity.WARNING else d for d in found)
        raise HalpipeError(*raised, exit=Exit.UNSUPPORTED)
    return Imported(model=model, diagnostics=tuple(found), coverage=coverage)


# ---------------------------------------------------------------------------------------------------- model


def _model(
    result: Result, names: Mapping[str, str], placed: Mapping[str, str], findings: Findings, coverage: Coverage
) -> TaskModel:
    """Return the model of one mode, still without a name; `placed` is the compute unit of nodes that have one."""
    active = result.activations.of
    tasks_of = {callback: names[callback] for callback in result.wiring.callbacks if callback in active}
    units = {callback: clean(placed.get(result.wiring.callbacks[callback].node, UNIT)) for callback in tasks_of}
    file = result.wiring.graph.file
    constraints = _precedences(result, tasks_of, coverage)
    tasks = tuple(
        _task(callback, task, units[callback], result, constraints, coverage) for callback, task in tasks_of.items()
    )
    _report_units(list(dict.fromkeys(units.values())), len(tasks), file, findings, coverage)
    _report_windows(result, file, findings)
    chains = chains_of(result.wiring, result.activations, tasks_of, Names(findings), findings, coverage)
    mode = Mode(name=MODE, runs=tuple(Run(task=task.name, versions=(VERSION,)) for task in tasks))
    stated = {clean(unit) for unit in placed.values()}
    used = tuple(Unit(name=u, origin=Origin(file) if u in stated else None) for u in dict.fromkeys(units.values()))
    return TaskModel(name=MODE, units=used, tasks=tasks, chains=chains, modes=(mode,), origin=Origin(file))


def _task(
    callback: str,
    task: str,
    unit: str,
    result: Result,
    constraints: Mapping[str, list[Precedence]],
    coverage: Coverage,
) -> Task:
    at = result.wiring.callbacks[callback].at
    activation = result.activations.of[callback]
    if result.wiring.callbacks[callback].period is None:
        coverage.defaulted(task, "period", f"{activation.period} from {activation.cause}", at)
    version = Version(name=VERSION, units=(unit,), precedences=tuple(constraints.get(callback, ())))
    return Task(name=task, period=activation.period, versions=(version,), origin=Origin(at.file, at.line, callback))


def _precedences(result: Result, tasks_of: Mapping[str, str], coverage: Coverage) -> dict[str, list[Precedence]]:
    """Return the constraints of every callback, one per predecessor."""
    first: dict[tuple[str, str], Edge] = {}
    for edge in result.flow.edges:
        first.setdefault((edge.reader, edge.publisher), edge)
    constraints: dict[str, list[Precedence]] = {}
    for edge in first.values():
        window = _window(result, edge)
        reader = result.wiring.callbacks[edge.reader]
        publisher = tasks_of[edge.publisher]
        value = f"from the end of {publisher}: {ZERO} to {window}"
        coverage.defaulted(tasks_of[edge.reader], "precedence window", value, reader.at)
        constraints.setdefault(edge.reader, []).append(
            Precedence(
                task=publisher,
                min=ZERO,
                max=window,
                anchor=Anchor.END,
                origin=Origin(reader.at.file, reader.at.line, edge.topic),
            )
        )
    return constraints


def _window(result: Result, edge: Edge) -> Duration:
    """Return the longer of both periods: some end of a job that recurs with period D lies within D before any instant.

    A shorter window can be impossible: a reader faster than its publisher starts up to D after the last end.
    """
    active = result.activations.of
    return max(active[edge.publisher].period, active[edge.reader].period)


def _report_units(units: list[str], count: int, file: str, findings: Findings, coverage: Coverage) -> None:
    help = "name the units of the computer under platform: in an overlay"
    stated = [unit for unit in units if unit != UNIT]
    if UNIT in units:
        coverage.defaulted("platform", "units", UNIT)
        some = f"{count} tasks" if not stated else "tasks without a compute unit"
        findings.add(codes.DEFAULT_UNIT(f"{some} put on one unit, {UNIT}", at=Location(file), help=help))
    if stated:
        text = f"{len(stated)} compute units are one execution unit each: {few(stated)}"
        findings.add(codes.COMPUTE_UNITS(text, at=Location(file), help=help))


def _report_windows(result: Result, file: str, findings: Findings) -> None:
    edges = {(edge.reader, edge.publisher) for edge in result.flow.edges}
    if edges:
        text = f"{len(edges)} precedence windows: 0 to the longer period after the predecessor's end"
        help = "state tighter windows under precedence: in an overlay where the data must be fresher"
        findings.add(codes.DEFAULT_WINDOW(text, at=Location(file), help=help))
