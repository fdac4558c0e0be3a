"""The whole import: files to `System` to activations to tasks to the task model, with findings and account."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.diagnostics import Diagnostic, Exit, Findings, HalpipeError, Severity, sort_diagnostics
from halpipe.durations import ZERO, Duration
from halpipe.importers.arxml import codes, reports
from halpipe.importers.arxml.activation import find_activations
from halpipe.importers.arxml.coverage import Ledger, note_activations, note_structure
from halpipe.importers.arxml.dataflow import find_dataflow
from halpipe.importers.arxml.ecuc import container_kinds
from halpipe.importers.arxml.execution_modes import VERSION, make_modes
from halpipe.importers.arxml.grouping import GRANULARITIES, group
from halpipe.importers.arxml.names import legal_name
from halpipe.importers.arxml.periods import decide_periods
from halpipe.importers.arxml.platform import Platform
from halpipe.importers.arxml.precedence import find_edges
from halpipe.importers.arxml.reading import read_system, read_tree
from halpipe.importers.base import Imported
from halpipe.models import Anchor, Precedence, Task, TaskModel, Version
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.arxml.grouping import Draft
    from halpipe.importers.arxml.precedence import Edge
    from halpipe.importers.arxml.system import ExecutionTime, Place, System
    from halpipe.importers.base import Coverage, ImportOptions


def import_arxml(paths: Sequence[str], options: ImportOptions) -> Imported:
    """Read ARXML files and directories into one task model.

    Raise `HalpipeError` with every finding if any is an error: unusable files, parts that contradict each other, no
    periodic task; under `options.strict` also every loss (warning), with the exit code for unsupported input.
    """
    _check_granularity(options.granularity)
    findings = Findings()
    try:
        model, coverage = _import(paths, options, findings)
        findings.stop_on_errors()
    except HalpipeError as failure:
        found = sort_diagnostics((*findings.items, *failure.diagnostics))
        raise HalpipeError(*(map(_as_error, found) if options.strict else found), exit=failure.exit) from None
    found = sort_diagnostics(findings.items)
    if options.strict and any(diagnostic.severity is Severity.WARNING for diagnostic in found):
        raise HalpipeError(*map(_as_error, found), exit=Exit.UNSUPPORTED)
    return Imported(model=model, diagnostics=tuple(found), coverage=coverage)


def _import(paths: Sequence[str], options: ImportOptions, findings: Findings) -> tuple[TaskModel, Coverage]:
    tree = read_tree(paths, findings)
    system = read_system(tree)
    dataflow = find_dataflow(system)
    activations = find_activations(system, findings)
    activations = decide_periods(system, activations, dataflow, tree, options.overlay)
    drafts = _kept(group(activations, options.granularity), options)
    reports.report_periodless(activations, findings)
    reports.check_tasks(system, drafts, paths, findings)
    edges = find_edges(system, drafts, dataflow, findings)
    ledger = Ledger()
    modes, transitions = make_modes(system, drafts, ledger, findings)
    platform = Platform(system)
    model = TaskModel(
        name=legal_name(options.name or system.name),
        units=platform.units,
        tasks=tuple(_tasks(system, drafts, edges, platform)),
        modes=modes,
        transitions=transitions,
        origin=system.place.origin if system.place else None,
    )
    note_activations(ledger, activations, drafts)
    note_structure(ledger, system, drafts, dataflow)
    ledger.mapped(*(edge.cause for edge in edges), *_used_times(system, drafts))
    coverage = ledger.close(tree, container_kinds(tree))
    reports.report_assumptions(model, drafts, platform, paths, findings, coverage)
    reports.report_dataflow(system, dataflow, findings)
    reports.report_same_functions(drafts, findings)
    return model, coverage


def _check_granularity(granularity: str) -> None:
    if granularity not in GRANULARITIES:
        known = f"use one of {', '.join(GRANULARITIES)}"
        raise HalpipeError(
            codes.GRANULARITY(
                f'granularity "{granularity}" is unknown', help=did_you_mean(granularity, GRANULARITIES, known)
            ),
            exit=Exit.USAGE,
        )


def _kept(drafts: list[Draft], options: ImportOptions) -> list[Draft]:
    if options.overlay is None:
        return drafts
    overlay = options.overlay
    return [draft for draft in drafts if not overlay.drops(draft.name)]


def _as_error(found: Diagnostic) -> Diagnostic:
    if found.severity is not Severity.WARNING:
        return found
    return Diagnostic(found.code, Severity.ERROR, found.at, found.path, found.message, found.help)


# ------------------------------------------------------------------------------------------------- tasks


def _tasks(system: System, drafts: Sequence[Draft], edges: Iterable[Edge], platform: Platform) -> list[Task]:
    by_name = {draft.name: draft for draft in drafts}
    times = {time.runnable: time for time in system.execution_times}
    incoming: dict[str, list[Edge]] = {}
    for edge in edges:
        incoming.setdefault(edge.second, []).append(edge)
    return [
        Task(
            name=draft.name,
            period=draft.period,
            offset=draft.offset,
            versions=(
                Version(
                    name=VERSION,
                    wcet=_wcet(draft, times),
                    units=platform.units_of(draft),
                    precedences=tuple(
                        _precedence(edge, by_name[edge.first], draft) for edge in incoming.get(draft.name, ())
                    ),
                ),
            ),
            origin=draft.origin,
        )
        for draft in drafts
    ]


def _precedence(edge: Edge, first: Draft, second: Draft) -> Precedence:
    """State an order as the widest window that is one: within the longer of both periods after the end."""
    return Precedence(
        task=first.name,
        min=ZERO,
        max=max(first.period, second.period),
        anchor=Anchor.END,
        origin=edge.cause.origin,
    )


def _wcet(draft: Draft, times: dict[str, ExecutionTime]) -> Duration | None:
    """Add up the execution times of the runnables of a task; None if any of them is unknown."""
    paths = {member.work: member.work[1] for member in draft.members}.values()
    if not all(path in times for path in paths):
        return None
    return Duration(sum(times[path].time.fraction for path in paths))


def _used_times(system: System, drafts: Sequence[Draft]) -> list[Place]:
    runnables = {member.work[1] for draft in drafts for member in draft.members}
    return [time.place for time in system.execution_times if time.runnable in runnables]
