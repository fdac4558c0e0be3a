"""Findings about an import as a whole: elements that became no task and why, assumptions made, data flows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.names import listed
from halpipe.importers.arxml.tasks.periods import NOT_CALLED, NOT_MAPPED, NOT_SCHEDULED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.system.values import System
    from halpipe.importers.arxml.tasks.activation import Activation
    from halpipe.importers.arxml.tasks.dataflow import Actor, DataFlow
    from halpipe.importers.arxml.tasks.grouping import Draft
    from halpipe.importers.arxml.tasks.platform import Platform
    from halpipe.importers.common.base import Coverage
    from halpipe.models import TaskModel


_UNCALLED = (NOT_CALLED, NOT_MAPPED)


def report_periodless(activations: Sequence[Activation], findings: Findings) -> None:
    """Report events that make no task, one finding for each kind and reason; timing events have theirs already."""
    groups: dict[tuple[str, str], list[Activation]] = {}
    for activation in activations:
        is_told = activation.event is not None and activation.event.is_timing and activation.reason not in _UNCALLED
        if activation.period is None and activation.process is None and not is_told:
            groups.setdefault((activation.kind, activation.reason), []).append(activation)
    for (kind, reason), found in sorted(groups.items(), key=lambda item: item[0]):
        expected = kind in NOT_SCHEDULED
        code = codes.NOT_SCHEDULED if expected else codes.NOT_CALLED if reason in _UNCALLED else codes.NO_PERIOD
        findings.add(
            code(
                f"{len(found)} {kind} make no task ({reason}): {listed([a.name for a in found])}",
                at=found[0].event.place.at if found[0].event else found[0].place.at,
                help="" if expected else "give them a period in the overlay (sources), if they belong to the schedule",
            )
        )


def report_processes(drafts: Sequence[Draft], findings: Findings) -> None:
    """Report processes without a period."""
    found = [draft for draft in drafts if draft.period is None]
    if found:
        findings.add(
            codes.PROCESS_WITHOUT_PERIOD(
                f"{len(found)} processes have no period: {listed([draft.name for draft in found])}",
                at=found[0].place.at,
                help="give them a period in the overlay (tasks: period)",
            )
        )


def check_tasks(system: System, drafts: Sequence[Draft], paths: Sequence[str], findings: Findings) -> None:
    """Raise `HalpipeError` with everything found so far if there is no task at all."""
    if drafts:
        return
    counts = {
        "component types": len(system.components),
        "events": len(system.events),
        "OS tasks": len(system.configuration.tasks),
        "event mappings": len(system.configuration.mappings),
        "timing constraints": len(system.timing.limits) + len(system.timing.arrivals) + len(system.orders),
    }
    held = ", ".join(f"{count} {what}" for what, count in counts.items() if count) or "nothing that runs"
    findings.add(
        codes.NO_TASKS(
            f"no periodic task in the input, which holds {held}",
            at=Location(paths[0]),
            help=_what_is_missing(system),
        )
    )
    raise HalpipeError(*findings.items)


def _what_is_missing(system: System) -> str:
    if system.events and not system.configuration.tasks:
        return (
            "add the ECU configuration of Os and Rte that triggers the events, or give periods in the overlay (sources)"
        )
    if system.configuration.tasks and not system.events:
        return (
            "add the files with component types and their events, or alarms and repeating schedule tables "
            "with the tick of their counter, or give periods in the overlay (sources)"
        )
    return "add the files with component types and their events, or the ECU configuration of Os and Rte"


def report_assumptions(
    model: TaskModel,
    drafts: Sequence[Draft],
    platform: Platform,
    paths: Sequence[str],
    findings: Findings,
    coverage: Coverage,
) -> None:
    """Report and account for what the files do not state: units, bindings, execution times, windows."""
    at = Location(paths[0])
    if platform.assumed:
        names = ", ".join(platform.assumed)
        findings.add(
            codes.DEFAULT_UNIT(f"no core is configured; assumed {names}", at=at, help="name units in the overlay")
        )
        for unit in platform.assumed:
            coverage.defaulted(f'unit "{unit}"', "unit", unit)
    for draft in drafts:
        if draft.members[0].is_inherited:
            coverage.defaulted(f'task "{draft.name}"', "period", str(draft.period), draft.place.at)
    unbound = [draft for draft in drafts if not platform.is_bound(draft)]
    if unbound and len(model.units) > 1:
        findings.add(
            codes.UNMAPPED(
                f"{len(unbound)} tasks are bound to no core: {listed([draft.name for draft in unbound])}",
                at=at,
                help="bind them in the overlay (units), or leave the choice to the scheduler",
            )
        )
        for draft in unbound:
            coverage.defaulted(f'task "{draft.name}"', "units", "all", draft.place.at)
    _report_times(model, drafts, at, findings)
    _report_windows(model, at, findings, coverage)


def _report_times(model: TaskModel, drafts: Sequence[Draft], at: Location, findings: Findings) -> None:
    missing = [task.name for task in model.tasks if task.versions[0].wcet is None]
    budgets = sum(draft.os_task is not None and draft.os_task.budget is not None for draft in drafts)
    if missing:
        offer = f", or take the execution budgets that {budgets} of them have: --wcet budget" if budgets else ""
        findings.add(
            codes.NO_WCET(
                f"{len(missing)} of {len(model.tasks)} tasks have no execution time: {listed(missing)}",
                at=at,
                help=f"give them in an overlay (tasks: wcet){offer}",
            )
        )


def _report_windows(model: TaskModel, at: Location, findings: Findings, coverage: Coverage) -> None:
    count = 0
    for task in model.tasks:
        for precedence in task.versions[0].precedences:
            count += 1
            place = precedence.origin.location if precedence.origin else at
            window = f"{precedence.min} to {precedence.max} after its end"
            coverage.defaulted(f'task "{task.name}"', f'window after "{precedence.task}"', window, place)
    if count:
        findings.add(
            codes.DEFAULT_WINDOW(
                f"{count} precedence constraints have windows of one period",
                at=at,
                help="state tighter windows in the overlay (precedence)",
            )
        )


def report_dataflow(system: System, dataflow: DataFlow, findings: Findings) -> None:
    """Report the data dependencies between runnables, which order nothing."""
    if not dataflow.dependencies:
        return
    labels = {instance.context: instance.label for instance in system.instances}

    def described(pair: tuple[Actor, Actor]) -> str:
        return " to ".join(f"{labels[context]}/{path.rpartition('/')[2]}" for context, path in pair)

    (_, writer), _ = dataflow.dependencies[0]
    places = {runnable.place.path: runnable.place for c in system.components for runnable in c.runnables}
    findings.add(
        codes.DATA_FLOW(
            f"{len(dataflow.dependencies)} data dependencies between runnables: "
            f"{listed(dataflow.dependencies, described)}",
            at=places[writer].at,
            help="list those that must be fresh as chains in the overlay",
        )
    )
