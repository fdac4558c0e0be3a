"""Containment proven by faults: every kind of fault in the jobs of every table, compared with its consequence."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.run.injection import CODES, Injection, Kind, assign, consequence, victim
from halpipe.deploy.riscv.run.recording import Flag, meaning
from halpipe.deploy.riscv.run.sequence import Request, Tour

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.deploy.riscv.judge.dispatch import Dispatch
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer
    from halpipe.deploy.riscv.run.recording import Abandoned
    from halpipe.deploy.riscv.target import Site
    from halpipe.models import Schedule

FROM_RUNTIME = "the runtime or a monitor is at fault: a job that fails like this on the board is not contained"
PREFIX = "after faults were put into jobs: "


@dataclass(slots=True)
class Injected:
    """What was injected: how often each kind, into which jobs, and the pairs that were not."""

    kinds: Counter[Kind] = field(default_factory=Counter)
    jobs: set[str] = field(default_factory=set)
    missed: int = 0
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
            self.jobs.add(by_place[injection.cycle, injection.row].path)

    def lines(self) -> Iterator[str]:
        """Yield the lines of the summary."""
        if self.kinds:
            kinds = len(self.kinds)
            yield f"injected: {sum(self.kinds.values())} faults of {kinds} kinds into {len(self.jobs)} jobs"
            if not any(found.is_error for found in self.findings):
                yield "each was stopped in its time and recorded; nothing else changed"
        if self.delays and not any(found.is_error for found in self.findings):
            yield f"{self.delays} transfers late by up to a hyperperiod: the {self.held} jobs that wait are abandoned"
        if self.trials and not any(found.is_error for found in self.findings):
            yield f"health rules: {self.trials} runs in which they have to fire, or must not, went as the model says"


def places(jobs: Sequence[PlannedJob]) -> dict[tuple[int, int], PlannedJob]:
    """Return jobs by the number of their table in the run, and their row in it."""
    return {(job.table.cycle, job.row): job for job in jobs}


def kinds_for(site: Site) -> tuple[Kind, ...]:
    """Return what can go wrong on a target; without a DMA engine, its faults cannot."""
    return tuple(kind for kind in Kind if kind is not Kind.HELD) if site.dma.kind == "pdma" else CODES


def sweeps(schedule: Schedule, cycles: int) -> list[Tour]:
    """Return a run for each mode with jobs."""
    return [Tour(mode.name, (), cycles) for mode in schedule.modes if mode.jobs]


def switches(schedule: Schedule) -> list[Tour]:
    """Return a run for each transition whose table has jobs."""
    return [
        Tour(t.source, (Request(schedule.mode(t.source).hyperperiod / 2, t.target),), 4)
        for t in schedule.transitions
        if t.jobs
    ]


def injections_for(
    jobs: Sequence[PlannedJob], kinds: Sequence[Kind], site: Site, tolerance: Duration, last: int, turn: int
) -> list[Injection]:
    """Return what to inject into a run whose last table is number `last` and stays as it is."""
    late = math.ceil(tolerance / site.tick)
    return assign([job for job in jobs if job.table.cycle < last], kinds, site, late, turn)


def pairs(jobs: Sequence[PlannedJob], kinds: Sequence[Kind]) -> int:
    """Return how many pairs of a job of a table and a kind there are."""
    rows = {(job.table.name, job.row): job for job in jobs}
    return sum(victim(kind, job) is not None for job in rows.values() for kind in kinds)


def planned(jobs: Sequence[PlannedJob], injections: Sequence[Injection]) -> list[PlannedJob]:
    """Return the plan of a run in which the faults happen."""
    by_place = {(injection.cycle, injection.row): injection for injection in injections}
    found = []
    for job in jobs:
        injection = by_place.get((job.table.cycle, job.row))
        found.append(job if injection is None else consequence(injection, job))
    return found


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
        record = next((r for r in left if _matches(r, job, found, slack)), None)
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


def _matches(record: Abandoned, job: PlannedJob, found: PlannedExecution | PlannedTransfer, slack: int) -> bool:
    harts = {execution.hart for execution in job.executions} or {found.hart}
    in_time = found.begin <= record.time <= found.end + slack
    return record.cycle == job.table.cycle and record.hart in harts and in_time


def _judge(
    run: Run, injection: Injection, job: PlannedJob, found: PlannedExecution | PlannedTransfer, record: Abandoned
) -> Iterator[Diagnostic]:
    """Hold the record of a fault against what happened."""
    if not record.flags & injection.flags or record.flags & ~injection.flags:
        message = f"{injection.kind} was injected; the runtime recorded: {meaning(record.flags) or record.flags}"
        yield codes.NOT_CONTAINED(message, at=job.job.at, path=job.path, help=FROM_RUNTIME)
    traps = [t for t in run.faults if t.hart == found.hart and _tick(run, t.now) in range(found.begin, found.end + 1)]
    if record.flags & Flag.FAULT and traps:
        trap = traps[0]
        if (record.cause, record.epc, record.tval) != (trap.cause, trap.pc, trap.value):
            seen = f"cause {trap.cause}, pc {trap.pc:#x}, value {trap.value:#x}"
            message = f"the runtime recorded cause {record.cause}, pc {record.epc:#x}, value {record.tval:#x}; {seen}"
            yield codes.NOT_CONTAINED(message + " were seen", at=job.job.at, path=job.path, help=FROM_RUNTIME)


def _tick(run: Run, instant: int) -> int:
    return (instant - (run.zero or 0)) // run.tick


def prefixed(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return the findings of a run with faults, marked as such."""
    findings = Findings()
    for each in found:
        is_own = each.code in (codes.NOT_CONTAINED.id, codes.NOT_INJECTED.id, codes.WRONG_HEALTH.id)
        findings.add(each if is_own else replace(each, message=PREFIX + each.message))
    return findings.items
