"""Expected reactions to the health rules of a model, derived from the events of a run.

Written from docs/explanation/model.md, not from the runtime, which is checked by it.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.run.injection import Kind, victim
from halpipe.deploy.riscv.run.recording import Kind as Recorded
from halpipe.deploy.riscv.run.sequence import Wish, played_tables
from halpipe.models import HealthAction, HealthEvent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.expectation import PlannedJob
    from halpipe.deploy.riscv.run.injection import Injection
    from halpipe.deploy.riscv.run.recording import Recording
    from halpipe.deploy.riscv.run.sequence import Played, Request
    from halpipe.deploy.riscv.target import Site
    from halpipe.models import HealthRule, TaskModel

FROM_RUNTIME = "the runtime is at fault: on the board this rule of the model would not do what it says"
OVERRUNS = (Kind.SPIN, Kind.LATE_DMA)
MOST_SWITCHES = 64


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """A job of a task that is abandoned, found at a tick of the run."""

    tick: int
    task: str
    event: HealthEvent


@record
class Firing:
    """A rule (by its place in the model) that fires, in a table of the run, for one of the jobs of its task."""

    rule: int
    tick: int
    cycle: int


@dataclass(slots=True)
class Course:
    """How a run has to go: its tables, the jobs that fail in them, and the rules that fire."""

    tables: list[Played]
    injections: list[Injection] = field(default_factory=list)
    firings: list[Firing] = field(default_factory=list)
    stops: bool = False


def events_of(jobs: Sequence[PlannedJob], injections: Sequence[Injection]) -> list[Event]:
    """Return the events that faults lead to: each is found when the time of what it befalls is over."""
    by_place = {(job.table.cycle, job.row): job for job in jobs}
    found = []
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
                found.append(Firing(i, event.tick, table.cycle))
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
    """A run that tries one rule in one mode: jobs of its task fail in these cycles, in a way."""

    rule: int
    mode: str
    kind: Kind
    cycles: tuple[int, ...]
    tables: int


def trials(target: Target) -> Iterator[Trial]:
    """Yield runs in which each rule just fires, and in which it just does not, in every mode where it holds.

    Those in which rules fire come first, for not all may be played.
    """
    each = [[*_trials_of(target, number, rule)] for number, rule in enumerate(target.model.health)]
    yield from (trial for row in zip_longest(*each) for trial in row if trial is not None)


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
    near = tuple(1 + i // jobs for i in range(rule.count))
    yield kind, near
    yield other, near
    if rule.count > 1:
        yield kind, (*near[:-1], near[0] + rule.cycles)
        yield kind, near[:-1]


def failing(
    trial: Trial, task: str, jobs: Sequence[PlannedJob], make: Callable[[PlannedJob], Injection]
) -> list[Injection]:
    """Return the faults of a trial: as many jobs of the task in each cycle as it states, the first ones."""
    left = Counter(trial.cycles)
    found = []
    for job in jobs:
        is_own = job.job.task == task and job.table.name == trial.mode
        if is_own and left[job.table.cycle] and victim(trial.kind, job) is not None:
            left[job.table.cycle] -= 1
            found.append(make(job))
    return found


# ---------------------------------------------------------------------------------------------------- what happened


def recorded(run: Run, model: TaskModel, firings: Sequence[Firing]) -> Iterator[Diagnostic]:
    """Yield where the runtime's record of rules that fired, or what cores did after them, is not what has to follow."""
    yield from fired_as_recorded(run.recording, model, firings)
    restarts = any(model.health[f.rule].action is HealthAction.RESTART for f in firings)
    seen = sum(run.recorder.restarts.values())
    if bool(seen) != restarts and not run.recording.lost:
        message = f"cores began anew {seen} times; " + (
            "a rule that fired has them" if restarts else "no rule has them"
        )
        yield codes.WRONG_HEALTH(message, path="health", help=FROM_RUNTIME)


def fired_as_recorded(recording: Recording, model: TaskModel, firings: Sequence[Firing]) -> Iterator[Diagnostic]:
    """Yield where the runtime's record of rules that fired is not what has to follow from the events."""
    if recording.lost:
        return
    order = sorted(range(len(model.health)), key=lambda i: model.health[i].task)  # as the runtime numbers them
    records = [r for r in recording.records if r.kind == Recorded.HEALTH]
    seen = Counter((order[r.begin], r.time) for r in records if r.begin < len(order))
    wanted = Counter((f.rule, f.tick) for f in firings)
    # The runtime looks at the clock when it comes to it, so its instant may be some ticks later.
    slack = 8
    for (rule, tick), number in sorted(wanted.items()):
        near = [key for key in seen if key[0] == rule and tick <= key[1] <= tick + slack]
        if sum(seen[key] for key in near) < number:
            yield _wrong(model, rule, f"has to fire at tick {tick}; the runtime recorded nothing of it")
    more = sum(seen.values()) - sum(wanted.values())
    if more > 0 or len(records) > sum(seen.values()):
        message = f"{len(records)} rules fired by the runtime's record, {sum(wanted.values())} have to"
        yield codes.WRONG_HEALTH(message, path="health", help=FROM_RUNTIME)


def _wrong(model: TaskModel, rule: int, message: str) -> Diagnostic:
    path = about(health_rule_of_task=model.health[rule].task)
    return codes.WRONG_HEALTH(message, at=model.health[rule].at, path=path, help=FROM_RUNTIME)
