"""From files to the task model: the order of the import's steps, and the tasks themselves."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.diagnostics import Exit, Findings, HalpipeError, Location, Severity, sort_diagnostics
from halpipe.durations import ZERO, Duration
from halpipe.importers.base import Coverage, Imported
from halpipe.importers.ros import codes
from halpipe.importers.ros.account import Result, account
from halpipe.importers.ros.activation import Wiring, activate
from halpipe.importers.ros.caret import read_caret
from halpipe.importers.ros.chains import chains_of
from halpipe.importers.ros.dataflow import Edge, order_by_data, report_unknown_publishers
from halpipe.importers.ros.drops import prune
from halpipe.importers.ros.names import Names, clean, task_names
from halpipe.importers.ros.rosbag import read_bag
from halpipe.importers.ros.rqt import read_dot
from halpipe.importers.ros.sniff import FileKind, find
from halpipe.models import Anchor, Mode, Origin, Precedence, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.base import ImportOptions
    from halpipe.importers.ros.graph import RosGraph
    from halpipe.importers.ros.sniff import Input

UNIT = "core0"
VERSION = "default"
MODE = "default"


def import_graph(paths: Sequence[str], options: ImportOptions) -> Imported:
    """Import one graph with the recordings that go with it; raise `HalpipeError` when no task comes out."""
    inputs = find(paths)
    findings, coverage = Findings(list(inputs.findings)), Coverage()
    for name in inputs.skipped:
        coverage.ignored("file", name, "is no graph and no recording")
    source = inputs.graphs[0]
    graph = _read(source, findings, coverage)
    rates = [r for bag in inputs.bags for r in read_bag(bag.content, bag.name, findings, coverage)]
    coverage.mapped("file", 1 + len(inputs.bags))
    findings.stop_on_errors()
    names = task_names(graph, Names(findings))
    wiring = Wiring.of(prune(graph, options.overlay, names, coverage))
    activations = activate(wiring, [*rates, *graph.rates], options.overlay, names, findings)
    report_unknown_publishers(wiring, findings)
    flow = order_by_data(wiring, activations, findings)
    result = Result(wiring, activations, flow)
    account(result, rates, findings, coverage)
    _stop_without_tasks(result, source.name, findings)
    model = _model(result, names, options.name or _stem(source.name), findings, coverage)
    return _finish(model, findings, coverage, options.strict)


def _read(source: Input, findings: Findings, coverage: Coverage) -> RosGraph:
    if source.kind is FileKind.CARET:
        return read_caret(source.content, source.name, findings, coverage)
    return read_dot(source.content, source.name, findings)


def _stem(file: str) -> str:
    return clean(os.path.basename(file).split(".")[0] or "ros")


def _stop_without_tasks(result: Result, file: str, findings: Findings) -> None:
    if not result.activations.of:
        help = "state periods under sources: or tasks: in an overlay, or add a rosbag2 metadata.yaml"
        findings.add(codes.NO_TASKS("nothing in the graph has a period", at=Location(file), help=help))
        raise HalpipeError(*sort_diagnostics(findings.items))


def _finish(model: TaskModel, findings: Findings, coverage: Coverage, strict: bool) -> Imported:
    found = sort_diagnostics(findings.items)
    losses = [d for d in found if d.severity is Severity.WARNING]
    if strict and losses:
        raised = (replace(d, severity=Severity.ERROR) if d.severity is Severity.WARNING else d for d in found)
        raise HalpipeError(*raised, exit=Exit.UNSUPPORTED)
    return Imported(model=model, diagnostics=tuple(found), coverage=coverage)


# ---------------------------------------------------------------------------------------------------- model


def _model(result: Result, names: Mapping[str, str], name: str, findings: Findings, coverage: Coverage) -> TaskModel:
    active = result.activations.of
    tasks_of = {callback: names[callback] for callback in result.wiring.callbacks if callback in active}
    file = result.wiring.graph.file
    constraints = _precedences(result, tasks_of, coverage)
    tasks = tuple(_task(callback, task, result, constraints, coverage) for callback, task in tasks_of.items())
    _report_defaults(result, file, findings, coverage)
    chains = chains_of(result.wiring, result.activations, tasks_of, Names(findings), findings, coverage)
    mode = Mode(name=MODE, runs=tuple(Run(task=task.name, versions=(VERSION,)) for task in tasks))
    origin = Origin(file)
    return TaskModel(name=name, units=(Unit(name=UNIT),), tasks=tasks, chains=chains, modes=(mode,), origin=origin)


def _task(
    callback: str, task: str, result: Result, constraints: Mapping[str, list[Precedence]], coverage: Coverage
) -> Task:
    at = result.wiring.callbacks[callback].at
    activation = result.activations.of[callback]
    if result.wiring.callbacks[callback].period is None:
        coverage.defaulted(task, "period", f"{activation.period} from {activation.cause}", at)
    version = Version(name=VERSION, units=(UNIT,), precedences=tuple(constraints.get(callback, ())))
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


def _report_defaults(result: Result, file: str, findings: Findings, coverage: Coverage) -> None:
    count = len(result.activations.of)
    coverage.defaulted("platform", "units", UNIT)
    help = "name the units of the computer under platform: in an overlay"
    findings.add(codes.DEFAULT_UNIT(f"{count} tasks put on one unit, {UNIT}", at=Location(file), help=help))
    edges = {(edge.reader, edge.publisher) for edge in result.flow.edges}
    if edges:
        text = f"{len(edges)} precedence windows: 0 to the longer period after the predecessor's end"
        help = "state tighter windows under precedence: in an overlay where the data must be fresher"
        findings.add(codes.DEFAULT_WINDOW(text, at=Location(file), help=help))
