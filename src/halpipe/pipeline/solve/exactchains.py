"""Figures of cause-effect chains in the constraint program of the exact engine (MODEL 3 and 10.7).

A job reads at its start and writes at its end; one with a logical execution time reads at its release and writes LET
later. Every step through a chain waits and runs at most a hyperperiod each, or a LET.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO
from halpipe.models import Anchor

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Chain
    from halpipe.pipeline.jobs import ActiveTask
    from halpipe.pipeline.solve.exactmodel import JobVars, Program

_MOST = 2**62
"""Keys by which jobs are compared must stay within 64 bits."""


class TooLarge(Exception):  # noqa: N818 - never leaves the modules of the program
    """The program grows beyond its bound."""


def state_chain(program: Program, chain: Chain) -> None:
    """Follow every job's data through the chain: forward for latency and reaction time, back for the data age."""
    if not all(task in program.tasks for task in chain.tasks):
        return
    figures = Figures(program, chain)
    for found, limit in (
        (figures.latencies, chain.max_latency),
        (figures.reactions, chain.max_reaction),
        (figures.ages, chain.max_age),
    ):
        if limit is not None:
            figures.limit(found(), program.ticks(limit))


class Figures:
    """The figures of one chain, from and to its events, and how far the times of its paths may lie from 0."""

    def __init__(self, program: Program, chain: Chain) -> None:
        self._program = program
        self._chain = chain
        lets = (program.expansion.by_name[name].task.let or ZERO for name in chain.tasks)
        self._far = 2 * program.total * (len(chain.tasks) + 2) + sum(map(program.ticks, lets))

    def limit(self, figures: Iterable[tuple[Any, Any]], limit: Any) -> None:
        """Bound a figure at every job that is there; one at least is."""
        found = list(figures)
        self._program.cp.add_bool_or([present for _, present in found])
        for figure, present in found:
            self._program.cp.add(figure <= limit).only_enforce_if(present)

    def latencies(self) -> Iterator[tuple[Any, Any]]:
        """Yield the latency from each job of the first task, and whether the job is there."""
        tasks = self._chain.tasks
        for job in self._distinct(tasks[0]):
            to = self._event(job, self._chain.to) if len(tasks) == 1 else None
            yield self._forward(job, self._write(job), tasks[1:], to) - self._begin(job), job.present

    def reactions(self) -> Iterator[tuple[Any, Any]]:
        """Yield the reaction time from each job of the first task, to a stimulus that it just missed."""
        for job in self._distinct(self._chain.tasks[0]):
            yield self._forward(job, self._read(job) + 1, self._chain.tasks) - self._begin(job), job.present

    def ages(self) -> Iterator[tuple[Any, Any]]:
        """Yield the data age at each job of the last task, and whether the job is there."""
        tasks = self._chain.tasks
        for job in self._distinct(tasks[-1]):
            time = self._read(job) if len(tasks) > 1 else self._begin(job)
            for number in range(len(tasks) - 2, -1, -1):
                time = self._last(time, tasks[number], job.present, is_first=not number)
            yield self._event(job, self._chain.to) - time, job.present

    def _forward(self, job: JobVars, since: Any, tasks: tuple[str, ...], to: Any = None) -> Any:
        """Return the event at the end of a path that continues from an instant through some tasks."""
        for task in tasks[:-1]:
            since = self._next(since, task, job.present, None)
        return self._next(since, tasks[-1], job.present, self._chain.to) if tasks else to

    # ------------------------------------------------------------------------------------------ instants

    def _read(self, job: JobVars) -> Any:
        return job.theta - job.delay if job.active.task.let is not None else job.theta

    def _write(self, job: JobVars) -> Any:
        let = job.active.task.let
        return job.theta + job.wcet if let is None else job.theta - job.delay + self._program.ticks(let)

    def _begin(self, job: JobVars) -> Any:
        anchor = self._chain.anchor
        return self._read(job) if anchor is None else self._program.instant(job, anchor)

    def _event(self, job: JobVars, to: Anchor | None) -> Any:
        return self._write(job) if to is None else self._program.instant(job, to)

    def _rigid(self, active: ActiveTask, event: Anchor | None) -> tuple[int, int] | None:
        """Return the times from reading to writing and to an event (None: writing), of a task whose are all equal."""
        program, let = self._program, active.task.let
        wcet = program.uniform_wcet(active) or 0
        is_strict = program.is_strict(active) and wcet > 0
        if let is None and not is_strict:
            return None
        written = wcet if let is None else program.ticks(let)
        if event is None:
            return written, written
        if event is Anchor.RELEASE and let is not None:
            return written, 0
        return (written, wcet if event is Anchor.END else 0) if is_strict else None

    def _distinct(self, task: str) -> list[JobVars]:
        """Return the jobs of a task that see the chain differently: fewer than all where its tasks are rigid."""
        program = self._program
        members = [program.expansion.by_name[name] for name in self._chain.tasks]
        if not all(program.is_strict(member) and self._rigid(member, None) for member in members):
            return program.tasks[task]
        periods = [program.ticks(member.task.period or ZERO) for member in members]
        own = program.ticks(program.expansion.by_name[task].task.period or ZERO)
        return program.tasks[task][: math.lcm(*periods) // own]

    # -------------------------------------------------------------------------------------------- paths

    def _next(self, since: Any, task: str, when: Any, event: Anchor | None) -> Any:
        """Return the event of the first job of `task` that reads at or after `since`; None: what it writes.

        (D) of verify: of jobs that read together, the one released earlier is the first; without releases, the lower
        index.
        """
        program = self._program
        active = program.expansion.by_name[task]
        if (rigid := self._rigid(active, event)) is not None:
            return since + self._turned(program.phases[task] - since, active) + rigid[1]
        jobs = program.tasks[task]
        waits = [self._remainder(self._read(job) - since) for job in jobs]
        if task in program.released:
            scale = max(job.most_late for job in jobs) + 1
            ranks = [scale - 1 - job.delay for job in jobs]
        else:
            scale, ranks = len(jobs), list(range(len(jobs)))
        keys = [wait * scale + rank for wait, rank in zip(waits, ranks, strict=True)]
        ends = [since + w + self._event(j, event) - self._read(j) for j, w in zip(jobs, waits, strict=True)]
        return self._chosen(jobs, keys, ends, when, program.total * scale)

    def _last(self, until: Any, task: str, when: Any, *, is_first: bool) -> Any:
        """Return when the job of `task` that wrote last at or before `until` read; of the first task, its event.

        Of jobs that write together the one that read later counts, then the one that was released later.
        """
        program = self._program
        active, anchor = program.expansion.by_name[task], self._chain.anchor if is_first else None
        if (rigid := self._rigid(active, Anchor.RELEASE if active.task.let else Anchor.START)) is not None:
            written, (_, event) = rigid[0], rigid
            moved = self._rigid(active, anchor) if anchor is not None else (written, event)
            if moved is not None:
                return until - self._turned(until - program.phases[task] - written, active) - written + moved[1]
        jobs = program.tasks[task]
        longest = max((program.ticks(v.wcet or ZERO) for job in jobs for v, _ in job.versions), default=0)
        late = max((job.most_late for job in jobs), default=0) if task in program.released else 0
        scale = (longest + 1) * (late + 1)
        ages = [self._remainder(until - self._write(job)) for job in jobs]
        keys = [
            age * scale + job.wcet * (late + 1) + (job.delay if late else 0)
            for job, age in zip(jobs, ages, strict=True)
        ]
        begins = [
            until - age - self._write(job) + (self._begin(job) if is_first else self._read(job))
            for job, age in zip(jobs, ages, strict=True)
        ]
        return self._chosen(jobs, keys, begins, when, program.total * scale + scale)

    def _turned(self, time: Any, active: ActiveTask) -> Any:
        """Return `time` modulo the period of a task."""
        return self._remainder(time, self._program.ticks(active.task.period or ZERO))

    def _remainder(self, time: Any, modulus: int = 0) -> Any:
        """Return `time` modulo the hyperperiod, or what is given."""
        modulus = modulus or self._program.total
        most = self._far // modulus + 2
        rest, turns = self._program.integer(0, modulus - 1), self._program.integer(-most, most)
        self._program.cp.add(rest == time + modulus * turns)
        return rest

    def _chosen(self, jobs: list[JobVars], keys: list[Any], values: list[Any], when: Any, most: int) -> Any:
        """Return the value of the present job with the smallest key."""
        if most >= _MOST:
            raise TooLarge
        program = self._program
        best, value = program.integer(0, most), program.integer(-self._far, self._far)
        picks = []
        for job, key, its in zip(jobs, keys, values, strict=True):
            pick = program.literal()
            picks.append(pick)
            program.cp.add(best == key).only_enforce_if(pick)
            program.cp.add(value == its).only_enforce_if(pick)
            program.cp.add(job.present == 1).only_enforce_if(pick)
            program.cp.add(best <= key).only_enforce_if([job.present, when])
        program.cp.add(sum(picks) == when)
        return value
