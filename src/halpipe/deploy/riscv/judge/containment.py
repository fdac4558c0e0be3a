"""Containment and health rules proven by faults: what is injected, what has to follow, and what was recorded."""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import combinations, zip_longest
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.records import record
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.conditions import tick_of
from halpipe.deploy.riscv.run.injection import Injection, Kind, consequence, victim
from halpipe.deploy.riscv.run.recording import Flag, meaning
from halpipe.deploy.riscv.run.recording import Kind as Recorded
from halpipe.deploy.riscv.run.sequence import Played, Request, Tour, Wish, played_tables
from halpipe.models import HealthAction, HealthEvent, HealthRule, Schedule, TaskModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.judge.check import Outcome
    from halpipe.deploy.riscv.judge.figures import Dispatch
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer
    from halpipe.deploy.riscv.run.recording import Abandoned
    from halpipe.deploy.riscv.target import Site

FROM_RUNTIME = "the runtime or a monitor is at fault: a job that fails like this on the board is not contained"
PREFIX = "after faults were put into jobs: "


@dataclass(slots=True)
class Injected:
    """Injected faults: count of each kind, and the jobs that they befall."""

    kinds: Counter[Kind] = field(default_factory=Counter)
    places: set[str] = field(default_factory=set)
    trials: int = 0
    delays: int = 0
    held: int = 0
    dispatches: list[Dispatch] = field(default_factory=list)
    findings: list[Diagnostic] = field(default_factory=list)

    def add(self, injections: Sequence[Injection], jobs: Sequence[PlannedJob]) -> None:
        """Count a run."""
        by_place = places(jobs)
        for injection in injections:
            self.kinds[injection.kind] += 1
            self.places.add(by_place[injection.cycle, injection.row].path)

    def take(self, outcome: Outcome) -> None:
        """Add what differs in a run from what has to follow."""
        self.dispatches.append(outcome.dispatch)
        self.findings += prefixed(outcome.findings)

    def lines(self) -> Iterator[str]:
        """Yield the lines of the summary."""
        if self.kinds:
            kinds = len(self.kinds)
            yield f"injected: {self.kinds.total()} faults of {kinds} kinds into {len(self.places)} jobs"
            if not any(found.is_error for found in self.findings):
                yield "each was stopped in its time and recorded; nothing else changed"
        if self.delays and not any(found.is_error for found in self.findings):
            yield f"{self.delays} transfers late by up to a hyperperiod: the {self.held} jobs that wait are abandoned"
        if self.trials and not any(found.is_error for found in self.findings):
            yield f"health rules: {self.trials} runs in which they have to fire, or must not, went as the model says"


def places(jobs: Sequence[PlannedJob]) -> dict[tuple[int, int], PlannedJob]:
    """Return jobs by the number of their table in the run, and their row in it."""
    return {(job.table.cycle, job.row): job for job in jobs}


def sweeps(schedule: Schedule) -> list[Tour]:
    """Return a run for each mode with jobs, of no tables yet."""
    return [Tour(mode.name, (), 0) for mode in schedule.modes if mode.jobs]


def switches(schedule: Schedule) -> list[Tour]:
    """Return a run for each transition whose table has jobs."""
    return [
        Tour(t.source, (Request(schedule.mode(t.source).hyperperiod / 2, t.target),), 4)
        for t in schedule.transitions
        if t.jobs
    ]


def planned(jobs: Sequence[PlannedJob], injections: Sequence[Injection]) -> list[PlannedJob]:
    """Return the plan of a run in which the faults happen."""
    by_place = {(injection.cycle, injection.row): injection for injection in injections}
    pairs = ((job, by_place.get((job.table.cycle, job.row))) for job in jobs)
    return [job if injection is None else consequence(injection, job) for job, injection in pairs]


def recorded(
    run: Run, jobs: Sequence[PlannedJob], injections: Sequence[Injection], tolerance: Duration
) -> Iterator[Diagnostic]:
    """Yield where the runtime's record of abandoned jobs is not what was injected."""
    by_place = places(jobs)
    left = list(run.recording.abandoned)
    slack = int(tolerance / run.site.tick) + 1
    for injection in injections:
        job = by_place.get((injection.cycle, injection.row))
        found = injection.befalls(job) if job is not None else None
        if job is None or found is None:
            continue
        harts = {execution.hart for execution in job.executions} or {found.hart}
        own = (r for r in left if r.cycle == job.table.cycle and r.hart in harts)
        record = next((r for r in own if found.begin <= r.time <= found.end + slack), None)
        if record is None:
            message = f"{injection.kind} was injected; the runtime recorded nothing of it"
            yield codes.NOT_CONTAINED(message, at=job.job.at, path=job.path, help=FROM_RUNTIME)
            continue
        left.remove(record)
        yield from _judge(run, injection, job, found, record)
    if run.recording.lost == 0 and left:
        message = f"{len(left)} jobs were abandoned into which nothing was injected"
        yield codes.NOT_CONTAINED(message, path="trace", help=FROM_RUNTIME)
    elif run.recording.lost:
        message = f"{run.recording.lost} records were overwritten, so that not every fault can be looked up"
        yield codes.NOT_INJECTED(message, path="trace", help="inject into fewer cycles: --cycles 8")


def _judge(
    run: Run, injection: Injection, job: PlannedJob, found: PlannedExecution | PlannedTransfer, record: Abandoned
) -> Iterator[Diagnostic]:
    """Hold the record of a fault against what happened."""
    if not record.flags & injection.flags or record.flags & ~injection.flags:
        message = f"{injection.kind} was injected; the runtime recorded: {meaning(record.flags) or record.flags}"
        yield codes.NOT_CONTAINED(message, at=job.job.at, path=job.path, help=FROM_RUNTIME)
    if not record.flags & (Flag.FAULT | Flag.OVERRUN) and (record.cause or record.epc or record.tval):
        message = f"the runtime recorded cause {record.cause}, pc {record.epc:#x} of a job that did not trap"
        yield codes.NOT_CONTAINED(message, at=job.job.at, path=job.path, help=FROM_RUNTIME)
    traps = [t for t in run.faults if t.hart == found.hart and tick_of(run, t.now) in range(found.begin, found.end + 1)]
    if record.flags & Flag.FAULT and traps:
        trap = traps[0]
        if (record.cause, record.epc, record.tval) != (trap.cause, trap.pc, trap.value):
            seen = f"cause {trap.cause}, pc {trap.pc:#x}, value {trap.value:#x}"
            message = f"the runtime recorded cause {record.cause}, pc {record.epc:#x}, value {record.tval:#x}; {seen}"
            yield codes.NOT_CONTAINED(message + " were seen", at=job.job.at, path=job.path, help=FROM_RUNTIME)


def prefixed(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return the findings of a run with faults, marked as such."""
    own = (codes.NOT_CONTAINED.id, codes.NOT_INJECTED.id, codes.WRONG_HEALTH.id)
    return [each if each.code in own else replace(each, message=PREFIX + each.message) for each in found]


RULE_AT_FAULT = "the runtime is at fault: on the board this rule of the model would not do what it says"
OVERRUNS = (Kind.SPIN, Kind.LATE_DMA)
MOST_SWITCHES = 64
_TICKS, _ANEW = 8, 800
"""Ticks from an event to what is recorded for its rule, at one cycle each; instructions until a monitor begins anew."""


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """A job of a task that is abandoned, found at a tick of the run."""

    tick: int
    task: str
    event: HealthEvent


@record
class Firing:
    """A rule (by its place in the model) that fires for one of the jobs of its task."""

    rule: int
    tick: int


@dataclass(slots=True)
class Course:
    """Expected course of a run: its tables, the jobs that fail in them, and the rules that fire."""

    tables: list[Played]
    injections: list[Injection] = field(default_factory=list)
    firings: list[Firing] = field(default_factory=list)
    stops: bool = False


def events_of(jobs: Sequence[PlannedJob], injections: Sequence[Injection]) -> list[Event]:
    """Return the events that faults lead to: each is found when the time of what it befalls is over."""
    by_place, found = places(jobs), []
    for injection in injections:
        job = by_place.get((injection.cycle, injection.row))
        fallen = injection.befalls(job) if job is not None else None
        if job is not None and fallen is not None:
            event = HealthEvent.OVERRUN if injection.kind in OVERRUNS else HealthEvent.FAULT
            found.append(Event(fallen.end, job.job.task, event))
    return sorted(found)


def firings_of(model: TaskModel, events: Sequence[Event], tables: Sequence[Played], site: Site) -> list[Firing]:
    """Return which rules fire: with an event that, with those before it, lies in so many tables in a row."""
    windows = [deque[int](maxlen=rule.count) for rule in model.health]
    found = []
    for event in events:
        instant = site.tick * event.tick
        table = next((t for t in tables if t.start < instant <= t.start + t.length), None)
        if table is None:
            continue
        for i, rule in enumerate(model.health):
            counts = rule.task == event.task and rule.event in (HealthEvent.ANY, event.event)
            if not counts or (rule.action is HealthAction.SWITCH and rule.mode == table.name):
                continue
            windows[i].append(table.cycle)
            if len(windows[i]) == rule.count and table.cycle - windows[i][0] < rule.cycles:
                found.append(Firing(i, event.tick))
    return found


def course_of(
    target: Target,
    site: Site,
    first: str,
    requests: Sequence[Request],
    tables: int,
    plan: Callable[[Sequence[Played]], tuple[Sequence[PlannedJob], list[Injection]]],
) -> Course:
    """Return how a run goes in which jobs fail: each rule that fires changes what is played, and what fails, after it.

    `plan` gives the jobs of tables, and which of them fail.
    """
    rules = target.model.health
    wishes: list[Wish] = []
    stop = None
    course = Course([])
    for _ in range(MOST_SWITCHES):
        played = played_tables(target.schedule, first, requests, tables, site.tick, wishes, stop)
        jobs, injections = plan(played)
        fired = firings_of(target.model, events_of(jobs, injections), played, site)
        course = Course(played, injections, fired, stop is not None)
        wanted = [
            Wish(site.tick * f.tick, rules[f.rule].mode, f.rule)
            for f in fired
            if rules[f.rule].action is HealthAction.SWITCH
        ]
        ends = [site.tick * f.tick for f in fired if rules[f.rule].action is HealthAction.STOP]
        following = min(ends, default=None)
        if wanted == wishes and following == stop:
            return course
        wishes, stop = wanted, following
    return course


# ---------------------------------------------------------------------------------------------------- runs of rules


@record
class Trial:
    """A run that tries one rule in one mode: jobs of its task fail in these cycles, in a way; `beside` another one."""

    rule: int
    mode: str
    kind: Kind
    cycles: tuple[int, ...]
    tables: int
    beside: Trial | None = None


def trials(target: Target) -> Iterator[Trial]:
    """Yield runs in which each rule just fires, and in which it just does not, in every mode where it holds.

    Those in which rules fire come first, for not all may be played.
    """
    each = [[*_trials_of(target, number, rule)] for number, rule in enumerate(target.model.health)]
    yield from _rivals([trial for several in each for trial in several], target.model.health)
    yield from (trial for row in zip_longest(*each) for trial in row if trial is not None)


def _rivals(several: Sequence[Trial], rules: Sequence[HealthRule]) -> Iterator[Trial]:
    """Yield runs in which rules of two tasks ask for different modes in one table: the first in the model prevails."""
    firing = {(trial.rule, trial.mode): trial for trial in reversed(several)}  # the first of each
    for one, other in combinations(sorted(firing.values(), key=lambda trial: trial.rule), 2):
        own, its = rules[one.rule], rules[other.rule]
        switch = own.action is its.action is HealthAction.SWITCH
        if switch and own.mode != its.mode and own.task != its.task and one.mode == other.mode:
            last = max(one.cycles + other.cycles)
            ends = (tuple(cycle + last - max(t.cycles) for cycle in t.cycles) for t in (one, other))
            first, second = (replace(t, cycles=e, tables=last + 5) for t, e in zip((one, other), ends, strict=True))
            yield replace(first, beside=second)


def _trials_of(target: Target, number: int, rule: HealthRule) -> Iterator[Trial]:
    found = []
    for mode in target.schedule.modes:
        jobs = [job for job in mode.jobs if job.task == rule.task]
        if jobs and not (rule.action is HealthAction.SWITCH and rule.mode == mode.name):
            found.append(
                [
                    Trial(number, mode.name, kind, cycles, max(cycles, default=0) + 5)
                    for kind, cycles in _patterns(rule, len(jobs))
                ]
            )
    yield from (trial for row in zip_longest(*found) for trial in row if trial is not None)


def _patterns(rule: HealthRule, jobs: int) -> Iterator[tuple[Kind, tuple[int, ...]]]:
    """Yield kinds and the cycles of failing jobs: enough of them, others than count, too far apart, and too few."""
    kind, other = (Kind.TRAP, Kind.SPIN) if rule.event is HealthEvent.FAULT else (Kind.SPIN, Kind.TRAP)
    near = tuple(1 + (i + -rule.count % jobs) // jobs for i in range(rule.count))  # the last cycle is full
    yield kind, near
    yield other, near
    if rule.count > 1:
        yield kind, (*near[:-1], near[0] + rule.cycles)
        yield kind, near[:-1]


def failing(trial: Trial, model: TaskModel, jobs: Sequence[PlannedJob]) -> list[Injection]:
    """Return the faults of a trial: as many jobs of the rule's task in each cycle as it states, the first ones."""
    left, task = Counter(trial.cycles), model.health[trial.rule].task
    found = failing(trial.beside, model, jobs) if trial.beside is not None else []
    for job in jobs:
        is_own = job.job.task == task and job.table.name == trial.mode
        if is_own and left[job.table.cycle] and victim(trial.kind, job) is not None:
            left[job.table.cycle] -= 1
            found.append(Injection(trial.kind, job.table.cycle, job.row))
    return found


def rivalling(trial: Trial, target: Target) -> tuple[Request, ...]:
    """Return a request for another mode than the rule's in the table in which it fires: the rule goes first."""
    rule = target.model.health[trial.rule]
    others = [m.name for m in target.schedule.modes if m.name not in (trial.mode, rule.mode)]
    if rule.action is not HealthAction.SWITCH or trial.beside is not None or not others:
        return ()
    hyperperiod = target.schedule.mode(trial.mode).hyperperiod
    return (Request(hyperperiod * Fraction(2 * max(trial.cycles, default=0) + 1, 2), others[0]),)


# ---------------------------------------------------------------------------------------------------- what happened


def rules_recorded(run: Run, model: TaskModel, firings: Sequence[Firing]) -> Iterator[Diagnostic]:
    """Yield where the runtime's record of rules that fired, or what cores did after them, is not what has to follow."""
    yield from _fired(run, model, firings)
    due = [f.tick for f in firings if model.health[f.rule].action is HealthAction.RESTART]
    ticks = [tick_of(run, now) for now in run.recorder.restarts]
    slack = _slack(run) + math.ceil(_ANEW * run.site.cpi * run.site.timebase / run.site.clock)
    is_lacking = any(not any(tick <= seen <= tick + slack for seen in ticks) for tick in due)
    if (is_lacking or bool(ticks) != bool(due)) and not run.recording.lost:
        message = f"cores began anew at ticks {ticks[:8]}, they have to at {due[:8]}, when rules fire"
        yield codes.WRONG_HEALTH(message, path="health", help=RULE_AT_FAULT)


def _slack(run: Run) -> int:
    """Return the ticks by which the runtime may come later to what it does: it looks at the clock then."""
    return math.ceil(_TICKS * run.site.management_cpi)


def _fired(run: Run, model: TaskModel, firings: Sequence[Firing]) -> Iterator[Diagnostic]:
    recording = run.recording
    if recording.lost:
        return
    order = sorted(range(len(model.health)), key=lambda i: model.health[i].task)  # as the runtime numbers them
    records = [r for r in recording.records if r.kind == Recorded.HEALTH]
    seen = Counter((order[r.begin], r.time) for r in records if r.begin < len(order))
    wanted = Counter((f.rule, f.tick) for f in firings)
    slack = _slack(run)
    for (rule, tick), number in sorted(wanted.items()):
        near = [key for key in seen if key[0] == rule and tick <= key[1] <= tick + slack]
        if sum(seen[key] for key in near) < number:
            yield _wrong(model, rule, f"has to fire at tick {tick}; the runtime recorded nothing of it")
    more = sum(seen.values()) - sum(wanted.values())
    if more > 0 or len(records) > sum(seen.values()):
        message = f"{len(records)} rules fired by the runtime's record, {sum(wanted.values())} have to"
        yield codes.WRONG_HEALTH(message, path="health", help=RULE_AT_FAULT)


def _wrong(model: TaskModel, rule: int, message: str) -> Diagnostic:
    path = about(health_rule_of_task=model.health[rule].task)
    return codes.WRONG_HEALTH(message, at=model.health[rule].at, path=path, help=RULE_AT_FAULT)
