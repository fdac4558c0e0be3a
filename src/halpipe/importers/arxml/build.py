"""Import of ARXML: files to `System` to activations to tasks to the task model, with findings and coverage."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about
from halpipe.core.durations import ZERO
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import counted
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.coverage import Ledger, note_activations, note_mappings, note_structure, note_timing
from halpipe.importers.arxml.embedded import find_embedded, read_embedded
from halpipe.importers.arxml.files.variants import Choice
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.options import BUDGET, ArxmlImportOptions
from halpipe.importers.arxml.system.reading import read_system, read_tree
from halpipe.importers.arxml.tasks.activation import Activation, Draft, find_activations, group, slack_of
from halpipe.importers.arxml.tasks.calls import join_calls, report_other_rates, with_one_rate
from halpipe.importers.arxml.tasks.dataflow import Actor, DataFlow, find_dataflow
from halpipe.importers.arxml.tasks.order import Edge, find_edges
from halpipe.importers.arxml.tasks.periods import NOT_CALLED, NOT_MAPPED, NOT_SCHEDULED, decide_periods
from halpipe.importers.arxml.tasks.platform import Platform, make_modes, with_interrupts
from halpipe.importers.arxml.tasks.requirements import Requirements, Spacing, find_requirements
from halpipe.importers.arxml.tasks.versions import Locking, find_locks, make_variants, report_kinds, used_times
from halpipe.importers.common.base import Coverage, Imported, imported
from halpipe.importers.common.names import legal
from halpipe.models import Anchor, Binding, Mode, Precedence, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from halpipe.importers.arxml.files.tree import Tree
    from halpipe.importers.arxml.system.values import System, Trigger
    from halpipe.importers.arxml.tasks.versions import Lock, Variant
    from halpipe.importers.overlay import OverlayUse


def import_arxml(paths: Sequence[str], options: ArxmlImportOptions) -> Imported:
    """Read ARXML files and directories into one task model.

    Raise `HalpipeError` with every finding if any is an error: unusable files, parts that contradict each other, no
    periodic task; under `options.strict` also every loss (warning), with the exit code for unsupported input.
    """
    ordered = sorted(paths)  # of values that contradict each other, and of tasks, the first is that of the first file
    return imported(lambda findings: _import(ordered, options, findings), options)


def _import(paths: Sequence[str], options: ArxmlImportOptions, findings: Findings) -> Imported:
    tree = read_tree(paths, findings, Choice(options.variant, options.conditions), on_progress=options.on_progress)
    data = find_embedded(tree)
    embedded = None if data is None else read_embedded(tree, data, options)
    if embedded is not None:
        model, coverage = embedded
        return Imported(model=model, diagnostics=(), coverage=coverage)
    built = assemble(tree, read_system(tree, options.ecu), paths, options)
    locking = Locking(built.locks, built.coverage)
    return Imported(model=built.model, diagnostics=(), coverage=built.coverage, completion=locking.complete)


@record
class Built:
    """A model with what it was made of: the tasks to be, the units, what recurs in the OS, and locks to come."""

    model: TaskModel
    coverage: Coverage
    drafts: tuple[Draft, ...]
    platform: Platform
    triggers: tuple[Trigger, ...]
    locks: tuple[Lock, ...]


def assemble(tree: Tree, system: System, paths: Sequence[str], options: ArxmlImportOptions) -> Built:
    """Make the model of what was read; findings go to those of the tree."""
    findings = tree.findings
    dataflow = find_dataflow(system)
    activations = find_activations(system, findings)
    activations = decide_periods(system, activations, dataflow, tree, options.overlay)
    activations = join_calls(activations, findings)
    report_other_rates(activations, system.configuration.triggers, findings)
    if options.granularity == "ostask":
        activations = with_one_rate(activations, findings)
    drafts = group(activations, options.granularity)
    if options.overlay is not None:
        drafts = [draft for draft in drafts if not options.overlay.drops(draft.name)]
    report_periodless(activations, findings)
    report_processes(drafts, findings)
    check_tasks(system, drafts, paths, findings)
    required = find_requirements(system, drafts, dataflow, findings)
    edges = find_edges(system, drafts, dataflow, required, findings)
    ledger = Ledger()
    platform = Platform(system)
    variants = make_variants(system, drafts, platform, options, findings)
    versions = {name: tuple(variant.version.name for variant in found) for name, found in variants.items()}
    modes, transitions = make_modes(system, drafts, versions, ledger, findings)
    orders, modes = _by_mode(drafts, edges, modes)
    model = TaskModel(
        name=legal(options.name or system.name),
        units=with_interrupts(platform, system, options.overlay, ledger, findings),
        tasks=tuple(_tasks(drafts, orders, variants, required, findings)),
        chains=tuple(required.chains),
        modes=modes,
        transitions=transitions,
        origin=system.place.origin if system.place else None,
    )
    note_activations(ledger, activations, drafts)
    note_mappings(ledger, system)
    note_structure(ledger, system, drafts, dataflow)
    ledger.mapped(*(place for edge in edges for place in (edge.cause, *edge.also)), *used_times(variants))
    ledger.mapped(*required.used)
    if options.wcet == BUDGET:
        ledger.mapped(*(draft.os_task.protection for draft in drafts if draft.os_task and draft.os_task.protection))
    locks = find_locks(system, drafts)
    ledger.mapped(*(lock.place for lock in locks))
    note_timing(ledger, system, tree)
    coverage = ledger.close(tree, system.configuration.kinds)
    for draft in drafts:
        if draft.os_task is not None and not draft.os_task.schedule:
            at = draft.os_task.place.at
            coverage.defaulted(f'task "{draft.name}"', "OsTaskSchedule", "NON: jobs run in one piece", at)
    report_assumptions(model, drafts, platform, paths, findings, coverage, options.overlay)
    report_kinds(variants, Location(paths[0]), findings)
    report_dataflow(system, dataflow, findings)
    return Built(model, coverage, tuple(drafts), platform, system.configuration.triggers, locks)


# ------------------------------------------------------------------------------------------------- tasks


def _by_mode(
    drafts: Sequence[Draft], edges: Iterable[Edge], modes: Sequence[Mode]
) -> tuple[dict[str, dict[str, tuple[Edge, ...]]], tuple[Mode, ...]]:
    """Return the edges into each task by the suffix of its versions, and the modes with the versions that run in them.

    A version waits for no task that does not run in its mode; an order passes through such a task.
    """
    incoming = grouped((edge.second, edge) for edge in edges)
    orders: dict[str, dict[str, tuple[Edge, ...]]] = {draft.name: {} for draft in drafts}
    result = []
    for mode in modes:
        running = {run.task for run in mode.runs}
        runs = []
        for run in mode.runs:
            found = {(e.first, e.spacing): e for e in _edges_among(run.task, running, incoming)}
            own, known = tuple(found.values()), orders[run.task]
            suffix = next((s for s, same in known.items() if same == own), f".{mode.name}" if known else "")
            known[suffix] = own
            runs.append(replace(run, versions=tuple(f"{version}{suffix}" for version in run.versions)))
        result.append(replace(mode, runs=tuple(runs)))
    return {name: known or {"": tuple(incoming.get(name, ()))} for name, known in orders.items()}, tuple(result)


def _edges_among(name: str, running: Collection[str], incoming: Mapping[str, Sequence[Edge]]) -> Iterator[Edge]:
    """Yield the edges into a task from those that run."""
    for edge in incoming.get(name, ()):
        if edge.first in running:
            yield edge
        elif edge.spacing is None:
            before = _edges_among(edge.first, running, incoming)
            yield from (replace(other, second=name) for other in before if other.spacing is None)


def _tasks(
    drafts: Sequence[Draft],
    orders: Mapping[str, Mapping[str, tuple[Edge, ...]]],
    variants: Mapping[str, tuple[Variant, ...]],
    required: Requirements,
    findings: Findings,
) -> list[Task]:
    by_name = {draft.name: draft for draft in drafts}
    shares = Counter(work for draft in drafts for work in {member.work for member in draft.members})
    tasks = []
    for draft in drafts:
        precedences = {
            suffix: tuple(_precedence(edge, by_name[edge.first], draft) for edge in found)
            for suffix, found in orders[draft.name].items()
        }
        versions = [(v.version, _workers(draft, v.version.units, findings)) for v in variants[draft.name]]
        tasks.append(
            Task(
                name=draft.name,
                period=draft.period,
                slack=_slack(draft, shares, findings),
                offset=draft.offset,
                deadline=required.deadlines.get(draft.name),
                let=required.lets.get(draft.name),
                distance=draft.distance,
                binding=Binding.SYSTEM if draft.os_task and draft.os_task.core is not None else Binding.JOB,
                versions=tuple(
                    replace(version, name=f"{version.name}{suffix}", precedences=found, gang=gang)
                    for suffix, found in precedences.items()
                    for version, gang in versions
                ),
                origin=draft.origin,
            )
        )
    return tasks


def _slack(draft: Draft, shares: Mapping[Actor, int], findings: Findings) -> Fraction:
    """Return the least slack of the calls of a task; report calls within its jobs, which may be later still.

    An offset activates: without a triggering, a job starts from then on, unless its work has other releases.
    """
    found = [(member, share) for member in draft.members if (share := slack_of(member, findings)) is not None]
    for member, _ in found:
        if draft.is_within([member], end=False):
            message = f'JITTER of a call within the jobs of "{draft.name}" is imported as slack of the jobs\' start'
            help = "state the slack of the task in the overlay, or use --granularity runnable"
            member.place.report(findings, codes.TIMING_PART_LOST, message, help=help)
    is_activated = draft.offset is not None and not any(m.arrival or shares[m.work] > 1 for m in draft.members)
    return min((share for _, share in found), default=Fraction(is_activated))


def _workers(draft: Draft, units: Sequence[str], findings: Findings) -> int:
    """Return how many units a job takes together; report more workers than it may use units."""
    process = draft.members[0].process
    gang = process.workers if process else 1
    if gang <= len(units):
        return max(gang, 1)
    message = f"has {gang} workers, but may use {len(units)} cores; one is assumed"
    help = "allow it more cores, or state its versions in the overlay"
    path = about(task=draft.name)
    findings.report(codes.TOO_MANY_WORKERS, message, at=draft.place.at, path=path, help=help)
    return 1


def _precedence(edge: Edge, first: Draft, second: Draft) -> Precedence:
    """State a distance as its window, and an order as the widest window that is one: a period (the longer) long."""
    spacing = edge.spacing or Spacing(first.name, second.name, None, None, Anchor.END, edge.cause)
    low = spacing.low or ZERO
    period = max(first.period or ZERO, second.period or ZERO)
    return Precedence(
        task=first.name,
        min=low,
        max=low + period if spacing.high is None else spacing.high,
        anchor=spacing.anchor,
        to=spacing.to,
        match=spacing.match,
        origin=edge.cause.origin,
    )


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
        message = f"{len(found)} {kind} make no task ({reason}): {listed([a.name for a in found])}"
        help = "" if expected else "give them a period in the overlay (sources), if they belong to the schedule"
        findings.report(code, message, at=found[0].event.place.at if found[0].event else found[0].place.at, help=help)


def report_processes(drafts: Sequence[Draft], findings: Findings) -> None:
    """Report processes without a period."""
    found = [draft for draft in drafts if draft.period is None]
    if found:
        message = f"without a period, {len(found)} of the processes: {listed([draft.name for draft in found])}"
        help = "give them a period in the overlay (tasks: period)"
        findings.report(codes.PROCESS_WITHOUT_PERIOD, message, at=found[0].place.at, help=help)


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
    message = f"no periodic task in the input, which holds {held}"
    help = _what_is_missing(system)
    findings.report(codes.NO_TASKS, message, at=Location(paths[0]), help=help)
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
    overlay: OverlayUse | None,
) -> None:
    """Report and account for what the files do not state: units, bindings, execution times, windows."""
    at = Location(paths[0])
    if platform.assumed:
        names = ", ".join(platform.assumed)
        if overlay is None or not overlay.names_units:
            text, help = f"no core is configured; assumed {names}", "name units in the overlay"
            findings.report(codes.DEFAULT_UNIT, text, at=at, help=help)
        for unit in platform.assumed:
            coverage.defaulted("platform", "units", unit)
    for draft, task in zip(drafts, model.tasks, strict=True):
        if draft.members[0].is_inherited:
            coverage.defaulted(f'task "{draft.name}"', "period", str(draft.period), draft.place.at)
        if task.slack and not draft.members[0].arrival:
            coverage.defaulted(f'task "{draft.name}"', "slack", "1: its offset activates it", draft.place.at)
    unbound = [draft for draft in drafts if not platform.is_bound(draft)]
    if unbound and len(model.units) > 1:
        message = f"bound to no core, {counted(len(unbound), 'task')}: {listed([draft.name for draft in unbound])}"
        help = "bind them in the overlay (units), or leave the choice to the scheduler"
        findings.report(codes.UNMAPPED, message, at=at, help=help)
        for draft in unbound:
            coverage.defaulted(f'task "{draft.name}"', "units", "all", draft.place.at)
    _report_times(model, drafts, at, findings)
    _report_windows(model, at, findings, coverage)


def _report_times(model: TaskModel, drafts: Sequence[Draft], at: Location, findings: Findings) -> None:
    missing = [task.name for task in model.tasks if task.versions[0].wcet is None]
    budgets = sum(draft.os_task is not None and draft.os_task.budget is not None for draft in drafts)
    if missing:
        offer = f", or take the execution budgets that {budgets} of them have: --wcet budget" if budgets else ""
        message = f"{len(missing)} of {len(model.tasks)} tasks have no execution time: {listed(missing)}"
        help = f"give them in an overlay (tasks: wcet){offer}"
        findings.report(codes.NO_WCET, message, at=at, help=help)


def _report_windows(model: TaskModel, at: Location, findings: Findings, coverage: Coverage) -> None:
    count = 0
    for task in model.tasks:
        for precedence in task.versions[0].precedences:
            count += 1
            place = precedence.origin.location if precedence.origin else at
            window = f"{precedence.min} to {precedence.max} after its end"
            coverage.defaulted(f'task "{task.name}"', f'window after "{precedence.task}"', window, place)
    if count:
        message = f"{count} precedence constraints have windows of one period"
        help = "state tighter windows in the overlay (precedence)"
        findings.report(codes.DEFAULT_WINDOW, message, at=at, help=help)


def report_dataflow(system: System, dataflow: DataFlow, findings: Findings) -> None:
    """Report the data dependencies between runnables, which order nothing."""
    if not dataflow.dependencies:
        return
    labels = {instance.context: instance.label for instance in system.instances}

    pairs = [
        " to ".join(f"{labels[context]}/{path.rpartition('/')[2]}" for context, path in pair)
        for pair in dataflow.dependencies
    ]
    (_, writer), _ = dataflow.dependencies[0]
    places = {runnable.place.path: runnable.place for c in system.components for runnable in c.runnables}
    message = f"{len(pairs)} data dependencies between runnables: {listed(pairs)}"
    help = "list those that must be fresh as chains in the overlay"
    findings.report(codes.DATA_FLOW, message, at=places[writer].at, help=help)
