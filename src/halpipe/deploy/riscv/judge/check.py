"""The check of a RISC-V bundle: play every mode and every transition, compare, and say what was measured."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cache, partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, sort_diagnostics
from halpipe.core.durations import ZERO, Duration, milliseconds, seconds
from halpipe.core.suggest import few
from halpipe.deploy.base import Checked, CheckOptions, Target
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.machine import MANAGEMENT, Budget
from halpipe.deploy.riscv.judge import conditions, containment, figures
from halpipe.deploy.riscv.judge.calibration import wrong_measurements
from halpipe.deploy.riscv.judge.comparison import Comparison, Seen
from halpipe.deploy.riscv.judge.containment import Course, Injected, Trial
from halpipe.deploy.riscv.judge.contents import contradictions, wrong_sizes
from halpipe.deploy.riscv.judge.figures import Dispatch, csv_of, measured, rows_of, summary_lines
from halpipe.deploy.riscv.judge.leftovers import Rubbish, cold_start, leftovers
from halpipe.deploy.riscv.judge.report import wrong_reports
from halpipe.deploy.riscv.judge.tables import tables_of, wrong_operations
from halpipe.deploy.riscv.judge.truth import tells_the_truth
from halpipe.deploy.riscv.run.cosimulation import MEASURING, CoSimulation, Run, load_program, plan, read_images
from halpipe.deploy.riscv.run.drivers import REQUEST, Recorded, read_drivers, recorded_inputs
from halpipe.deploy.riscv.run.expectation import Expectation, PlannedJob
from halpipe.deploy.riscv.run.injection import CODES, SPACE, Injection, Kind, Saboteur, assign, delays
from halpipe.deploy.riscv.run.regulators import hold_transfers
from halpipe.deploy.riscv.run.sequence import Played, Tour, played_tables, tables_named, tours
from halpipe.deploy.riscv.target import Site, read_site

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    Make = Callable[[Site, Sequence[PlannedJob], Sequence[Injection]], Saboteur]

CYCLES = 2
"""Hyperperiods of every mode, unless told otherwise: the second has what wraps round the end of the first."""

MOST_SAMPLES = 50
"""Recorded inputs that are played, unless told otherwise."""

OPERATION = 200
"""Instructions that the management core may need for one operation."""

COINCIDING = 8
"""Operations of one unit that may be waiting at one tick; more lateness than they cost is never allowed."""

MARGIN = milliseconds(10)
"""After the end of the last table."""

SPARE = 20_000_000
"""Instructions of each core beyond those that are planned: to come up, and to report."""

SPARE_TRAPS, SPARE_CALLS = 2_000, 1_000_000
"""Traps, and uses of devices, beyond those that are planned."""

BRIEF, ALL = 200_000_000, 800_000_000
"""Instructions that runs with faults may take for each mode, in a check of every day and with --inject."""

MOST_CYCLES = 8
"""Cycles of an instruction up to which the margin is sought."""

SWITCHES = 12
"""Transitions into whose tables faults are put."""

ASKING = 12
"""Tables of the run in which tasks may ask for modes."""

DELAYS, TURNS = 8, 8
"""Late transfers in a run, and such runs for each mode with --inject."""

TRIALS = 12
"""Runs that try health rules in a check of every day."""

PER_OPERATION = 2_000
"""Instructions of the management core for one operation, retries included."""


def tolerance_of(site: Site) -> Duration:
    """Return the lateness that is allowed: the greatest that the export computed for any table, and what comes on top.

    On top come one tick, by which every instant is known, and the operation itself, whose effect is what is seen. The
    phases of the schedule were held to the stated lateness; it is believed only up to a bound of our own.
    """
    operation = seconds(OPERATION * site.management_cpi / site.clock)
    stated = max((table.lateness for table in site.tables), default=ZERO)
    allowed = min(stated, operation * (COINCIDING * len(site.units))) + operation + site.tick
    return site.tick * math.ceil(allowed / site.tick)


@dataclass(slots=True)
class Outcome:
    """Result of one tour: the tables, every job with its observations, and the findings."""

    run: Run
    tables: Sequence[Played]
    jobs: list[Seen]
    findings: list[Diagnostic]
    dispatch: Dispatch = field(default_factory=Dispatch)
    hears: bool = False


def check_by_simulation(target: Target, options: CheckOptions) -> Checked:
    """Play a bundle in the co-simulation and compare it with its schedule; then let jobs fail on purpose."""
    findings = static_findings(target)
    outcomes = [
        simulate(target, tour, execution=options.execution)
        for tour in tours(target.schedule, cycles_of(target, options))
    ]
    if any(driver.function == REQUEST for driver in read_drivers(target.bundle)):
        asking = Tour(target.schedule.modes[0].name, (), ASKING)
        outcomes.append(simulate(target, asking, execution=options.execution, hears=True))
    site = outcomes[0].run.site
    findings += cold_findings(target, site)
    if MEASURING in target.bundle.files:
        findings += wrong_measurements(target, outcomes[0].run)
    lines = list(summary_lines(target, outcomes, tolerance_of(site)))
    held = hold_transfers(target, outcomes)
    lines += held.lines
    findings += [*(found for outcome in outcomes for found in outcome.findings), *held.findings]
    sound = not _fails(findings)
    dispatches = [outcome.dispatch for outcome in outcomes]
    if sound:
        findings += foul_findings(target, outcomes, options)
    if sound and options.inject != "none":
        injected = inject(target, outcomes, everything=options.inject == "all")
        findings += injected.findings
        lines += injected.lines()
        dispatches += injected.dispatches
    findings += figures.slow_dispatch(dispatches)
    lines += figures.dispatch_lines(dispatches, site.management_cpi)
    if options.margin and sound:
        lines += margin_lines(target)
    if not _fails(findings):
        lines.append(f"{target.bundle.path}: every start, end and transfer is as scheduled")
    files = {f"trace-{i}" if i > 1 else "trace": csv_of(rows_of(outcome)) for i, outcome in enumerate(outcomes, 1)}
    files |= {"bandwidth": held.phases} if held.phases else {}
    return Checked(diagnostics=tuple(sort_diagnostics(findings)), lines=tuple(lines), files=files)


def _fails(findings: Iterable[Diagnostic]) -> bool:
    return any(found.is_error for found in findings)


def cycles_of(target: Target, options: CheckOptions) -> int:
    """Return how many hyperperiods of each mode are played: enough for its recorded inputs, unless stated."""
    samples = recorded_inputs(target.bundle, read_site(target.bundle)).values()
    return options.cycles or min(max([CYCLES, *map(len, samples)]), MOST_SAMPLES)


def static_findings(target: Target) -> list[Diagnostic]:
    """Return what is wrong with a bundle before it is played: files that disagree, tables that are others."""
    site = read_site(target.bundle)
    refuse_disagreement(target, site)
    images = read_images(target.bundle, site)
    found = Findings(list(contradictions(target.bundle, site, load_program(target.bundle, site), images)))
    found.extend(wrong_sizes(target.bundle, site, target.model))
    expectation = Expectation(target.bundle, target.model, site, images)
    if not found.has_errors:
        found.extend(wrong_operations(target, site, expectation, images))
    return found.items


def cold_findings(target: Target, site: Site) -> Iterator[Diagnostic]:
    """Yield what a bundle does wrongly that starts by itself: buffers are emptied before, which takes its time."""
    size = sum(area.size for area in site.buffers.values())
    spare = budget_of(site, (), ())
    budget = Budget({**spare.instructions, MANAGEMENT: SPARE + size}, spare.traps, spare.calls + size)
    yield from cold_start(target, budget, MARGIN + seconds(size * site.management_cpi / site.clock))
    yield from wrong_reports(target, budget)


def foul_findings(target: Target, outcomes: Sequence[Outcome], options: CheckOptions) -> Iterator[Diagnostic]:
    """Yield where jobs depend on former contents of scratchpads: a second run of every tour with new versions."""
    known: set[tuple[str, str]] = set()
    foul = partial(Rubbish, read_images(target.bundle, read_site(target.bundle)).values())
    for tour, plain in zip(tours(target.schedule, cycles_of(target, options)), outcomes, strict=False):
        versions = {(job.task, job.version) for table in plain.tables for job in table.jobs}
        if versions - known:
            known |= versions
            yield from leftovers(plain.jobs, simulate(target, tour, execution=options.execution, make=foul).jobs)


def margin_lines(target: Target) -> Iterator[str]:
    """Yield up to how many cycles an instruction may take, in tenths, found by halving: each is a run of its own."""
    tour, most = tours(target.schedule, CYCLES)[0], 10 * MOST_CYCLES

    @cache
    def broken(tenths: int) -> list[Diagnostic]:
        return [d for d in simulate(target, tour, cpi=Fraction(tenths, 10)).findings if d.is_error]

    bad = bisect_left(range(most + 1), True, 11, key=lambda tenths: bool(broken(tenths)))
    good = bad - 1
    yield f"works up to {good // 10}.{good % 10} cycles an instruction, management core included"
    if bad <= most:
        first = broken(bad)[0]
        yield f"with {bad // 10}.{bad % 10}: {first.code} {first.path}: {first.message}"


def inject(target: Target, outcomes: Sequence[Outcome], *, everything: bool) -> Injected:
    """Let jobs fail in every way, in the first mode with jobs, or in `everything`: all modes and transitions."""
    site = outcomes[0].run.site
    kinds = [*CODES, *([Kind.LATE_DMA, Kind.DMA_ERROR] if site.dma.kind == "pdma" else [])]
    tables = sum(len(outcome.tables) for outcome in outcomes)
    price = sum(outcome.run.instructions for outcome in outcomes) // tables + 1
    whole = 2 * len(kinds)
    affordable = max(min((ALL if everything else BRIEF) // price, whole), 2)
    found, lacking = Injected(), 0
    sweeps = containment.sweeps(target.schedule)[: None if everything else 1]
    for tour in sweeps:
        # As many cycles at a time as the runtime can record faults of, and no more than can be afforded.
        jobs = len(target.schedule.mode(tour.first).jobs)
        cycles = max(min(affordable, 2 * site.faults.capacity // jobs), 1)
        turns = range(0, affordable, cycles) if everything else range(1)
        lacking += whole - cycles * len(turns) if cycles * len(turns) < whole else 0
        for turn in turns:
            sabotage(target, replace(tour, tables=cycles + 1), kinds, turn, found)
    for tour in containment.switches(target.schedule)[: SWITCHES if everything else 0]:
        sabotage(target, tour, kinds, 0, found)
    if site.dma.kind == "pdma":
        for tour in sweeps:
            delay(target, tour, min(affordable, DELAYS * SPACE), found, turns=range(TURNS if everything else 1))
    for trial in list(containment.trials(target))[: None if everything else TRIALS]:
        try_rule(target, trial, found)
    if lacking:
        message = f"{lacking} of the {whole} cycles that have every fault in every job were not played"
        help = "deploy check --inject takes more time"
        found.findings.append(codes.NOT_INJECTED(message, help=help))
    return found


def delay(target: Target, tour: Tour, tables: int, found: Injected, turns: Iterable[int]) -> None:
    """Play tours in which transfers are late by up to a hyperperiod, and add what differs from what has to follow."""
    site = read_site(target.bundle)
    tour = replace(tour, tables=max(tables, SPACE) + 1)
    expected = played_tables(target.schedule, tour.first, (), tour.tables, site.tick)
    jobs = plan(target, site, expected)
    length = math.floor(expected[0].length / site.tick)
    margin = math.ceil(tolerance_of(site) / site.tick) + 1
    for turn in turns:
        injections = delays([job for job in jobs if job.table.cycle < tour.tables - 1], length, margin, turn)
        if injections:
            outcome = simulate(target, tour, injections=injections)
            found.delays += sum(i.kind is not Kind.HELD for i in injections)
            found.held += sum(i.kind is Kind.HELD for i in injections)
            found.take(outcome)


def try_rule(target: Target, trial: Trial, found: Injected) -> None:
    """Play one trial of a health rule, and add what differs from what has to follow."""
    site = read_site(target.bundle)

    def failing(tables: Sequence[Played]) -> tuple[Sequence[PlannedJob], list[Injection]]:
        jobs = plan(target, site, tables)
        return jobs, containment.failing(trial, target.model, jobs)

    requests = containment.rivalling(trial, target)
    course = containment.course_of(target, site, trial.mode, requests, trial.tables, failing)
    outcome = simulate(target, Tour(trial.mode, requests, trial.tables), course=course)
    found.trials += 1
    found.take(outcome)


def sabotage(
    target: Target, tour: Tour, kinds: Sequence[Kind], turn: int, found: Injected, make: Make = Saboteur
) -> None:
    """Play one tour in which jobs fail, and add what differs from what has to follow."""
    site = read_site(target.bundle)
    expected = played_tables(target.schedule, tour.first, tour.requests, tour.tables, site.tick)
    jobs = plan(target, site, expected)
    late = math.ceil(tolerance_of(site) / site.tick)
    injections = assign([job for job in jobs if job.table.cycle < tour.tables - 1], kinds, site, late, turn)
    outcome = simulate(target, tour, injections=injections, make=make)
    found.add(injections, jobs)
    found.take(outcome)


def simulate(
    target: Target,
    tour: Tour,
    *,
    execution: str = "real",
    cpi: Fraction | int | None = None,
    injections: Sequence[Injection] = (),
    course: Course | None = None,
    samples: int = 0,
    hears: bool = False,
    make: Make | None = None,
) -> Outcome:
    """Play one tour in the co-simulation and compare it with its plan, or with the `course` that health rules give it.

    Without a course, no health rule follows from injections, which a saboteur carries out, or what is in its place.
    Recorded inputs are played, or only so many `samples`. If tasks may ask for modes (`hears`), the plan follows from
    what they ask for.
    """
    site = read_site(target.bundle)
    refuse_disagreement(target, site)
    expected = played_tables(target.schedule, tour.first, tour.requests, tour.tables, site.tick)
    if course is not None:
        expected, injections = course.tables, course.injections
    if hears:
        expected = tables_named(target.schedule, [table.name for table in site.tables] * tour.tables)
    jobs = plan(target, site, expected)
    make = make or (Saboteur if injections else None)
    inputs = {name: each[: samples or len(each)] for name, each in recorded_inputs(target.bundle, site).items()}
    simulation = CoSimulation(
        target,
        plant=Recorded(inputs),
        budget=budget_of(site, jobs, expected),
        requests=[(request.instant, request.mode) for request in tour.requests],
        cycles=tour.tables,
        first=tour.first,
        execution=execution,
        cpi=cpi,
        saboteur=make(site, jobs, injections) if make else None,
        health=course is not None or not injections,
        hears=hears,
    )
    longest = max((job.end - job.start for table in expected for job in table.jobs), default=Duration(0))
    run = simulation.run(expected[-1].start + expected[-1].length + longest + MARGIN)
    if hears:
        course = Course(played_tables(target.schedule, tour.first, run.requests, tour.tables, site.tick))
    return replace(judge(target, simulation, run, course or Course(expected, [*injections])), hears=hears)


def budget_of(site: Site, jobs: Sequence[PlannedJob], tables: Sequence[Played]) -> Budget:
    """Return what the plan can take at most: each core executes in its planned time."""
    instructions = {unit.hart: SPARE for unit in site.units}
    operations = moved = 0
    for job in jobs:
        for execution in job.executions:
            cycles = math.ceil((execution.end - execution.begin) * Fraction(site.clock, site.timebase) / site.cpi)
            instructions[execution.hart] += cycles + PER_OPERATION
        operations += 2 * len(job.executions) + 2 * len(job.transfers) + len(job.calls)
        moved += sum(transfer.size for transfer in job.transfers)
    ticks = math.ceil(sum((table.length for table in tables), ZERO) / site.tick)
    instructions[MANAGEMENT] = SPARE + PER_OPERATION * operations + (moved if site.dma.kind != "copy" else 100 * ticks)
    return Budget(instructions, SPARE_TRAPS + 4 * operations, SPARE_CALLS + 100 * operations + moved)


def judge(target: Target, simulation: CoSimulation, run: Run, course: Course) -> Outcome:
    """Compare a run that has ended with what had to be played."""
    tolerance = tolerance_of(run.site)
    injections = course.injections
    findings = Findings()
    findings.extend(conditions.is_over(run, stops=course.stops))
    findings.extend(conditions.is_confined(run))
    findings.extend(conditions.plays(run, course.tables, tolerance))
    # After a wrong turn everything else is judged by the tables that are really played, so that it is one finding.
    played = tables_named(target.schedule, [table.name for table in run.tables])
    findings.extend(conditions.decides(run, played, tolerance))
    findings.extend([*conditions.starts_afresh(run), *conditions.feeds(run), *conditions.refuses(run, course.tables)])
    expectation = Expectation(target.bundle, target.model, run.site, simulation.images)
    jobs = expectation.jobs(played)
    findings.extend(expectation.findings.items)
    findings.stop_on_errors() if expectation.findings.has_errors else None
    comparison = Comparison(run, containment.planned(jobs, injections), tolerance)
    findings.extend(comparison.findings.items)
    findings.extend(conditions.calls_drivers(run, containment.planned(jobs, injections), tolerance))
    records = tables_of(target, run.site)
    truth = [*tells_the_truth(run, records, played)]
    findings.extend(truth)
    findings.extend(containment.recorded(run, jobs, injections, tolerance) if injections else ())
    findings.extend(containment.rules_recorded(run, target.model, course.firings))
    try:
        taken = Dispatch() if truth else measured(run, records, played)
    except LookupError:  # a table that nothing uses, and that the linker has left out: that is a finding before
        taken = Dispatch()
    return Outcome(run, played, comparison.jobs, findings.items, taken)


def refuse_disagreement(target: Target, site: Site) -> None:
    """Raise `HalpipeError` unless target.json has the tables and the units of the schedule."""
    findings = Findings()
    modes = [(mode.name, mode.hyperperiod) for mode in target.schedule.modes]
    modes += [(t.name, t.length) for t in target.schedule.transitions]
    stated = [(table.name, site.tick * table.length) for table in site.tables]
    at = target.bundle.at("target.json")
    if stated != modes:
        message = f"its tables are {_listed(stated)}; those of the schedule are {_listed(modes)}"
        findings.add(codes.BROKEN_TARGET(message, at=at, path="tables", help="export the bundle again"))
    used = {unit for job in target.schedule.all_jobs() for unit in job.units}
    for unit in sorted(used - {unit.name for unit in site.units}):
        message = f'has no unit "{unit}", on which jobs are scheduled'
        findings.add(codes.BROKEN_TARGET(message, at=at, path="units", help="export the bundle again"))
    findings.stop_on_errors()


def _listed(tables: Sequence[tuple[str, Duration]]) -> str:
    return few((f"{name} ({length})" for name, length in tables), 8, quote="")
