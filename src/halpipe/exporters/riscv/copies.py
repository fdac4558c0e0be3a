"""Copies of logical execution times: buffers of the tasks' own, and who copies when after an instant (MODEL 10.6).

At its release a task with a LET has what it reads copied into buffers of its own, and at release + LET what it wrote is
copied out of them; its phases use these. After each such instant every task has a time of its own for its copies, all
that write before all that read. So no two copies meet, and data are those of the instant whatever copies take.
"""

from __future__ import annotations

import math
from dataclasses import field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.exporters.common.timeline import releases_of
from halpipe.exporters.riscv.codes import COPIES_UNFIT, OFF_GRID
from halpipe.exporters.riscv.phases import COPIES, Clock, transfers_of
from halpipe.models import AccessKind, Job, Schedule, Task, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.exporters.riscv.cores import MainMemory, Shadow
    from halpipe.exporters.riscv.operations import Operation, Program, Release, Table
    from halpipe.exporters.riscv.profile import Profile

_COPY = "copy"


@record
class Turn:
    """Time of a task's copies: `length` ticks, `after` ticks behind an instant that is `at` ticks after the release.

    `sizes` are the bytes of each buffer by version.
    """

    task: str
    kind: AccessKind
    at: int
    after: int
    length: int
    sizes: dict[str, dict[str, int]]


@record
class Copies:
    """The turns of all tasks with a LET that move data, and the releases of their jobs where they start later."""

    turns: tuple[Turn, ...] = ()
    releases: dict[int, Duration] = field(default_factory=dict)

    @property
    def tasks(self) -> frozenset[str]:
        """The tasks whose data are copied."""
        return frozenset(turn.task for turn in self.turns)

    @property
    def shadows(self) -> dict[Shadow, int]:
        """The sizes of the tasks' own buffers."""
        return {
            (turn.task, turn.kind, name): max(sizes[name] for sizes in turn.sizes.values() if name in sizes)
            for turn in self.turns
            for name in dict.fromkeys(name for sizes in turn.sizes.values() for name in sizes)
        }

    @property
    def window(self) -> int:
        """Ticks after an instant until the copies of all tasks are complete."""
        return max((turn.after + turn.length for turn in self.turns), default=0)

    def of(self, task: str) -> list[Turn]:
        """Return the turns of a task, none if it has no LET."""
        return [turn for turn in self.turns if turn.task == task]

    def release(self, job: Job) -> Duration:
        """Return when a job is released, at which its first copies or operations begin."""
        return self.releases.get(id(job), job.start)

    def conflicts(
        self, tables: Sequence[Table], programs: Sequence[Program], memory: MainMemory, model: TaskModel, clock: Clock
    ) -> Iterator[Diagnostic]:
        """Yield what keeps copies from being those of their instants, in all that can follow each other."""
        if not self.turns:
            return
        known = set()
        for line in lines_of(tables):
            for task, message, help in self._conflicts(_released(line, tables), programs, memory, model):
                help = help or self._apart(model, clock)
                if (task, help) not in known:
                    known.add((task, help))
                    yield COPIES_UNFIT(message, at=model.task(task).at, path=about(task=task), help=help)

    def _conflicts(
        self, line: Sequence[tuple[int, Release]], programs: Sequence[Program], memory: MainMemory, model: TaskModel
    ) -> Iterator[tuple[str, str, str]]:
        named = {region.base: name for name, region in memory.buffers.items()}
        areas: list[tuple[int, int, str, bool, str]] = []  # from, to, buffer, whether it is written, task
        direct: list[tuple[int, int, str, bool, str]] = []
        instants: dict[int, str] = {}
        for start, release in line:
            program = programs[release.program]
            begin = start + release.tick
            own = self.of(program.task)
            for turn in own:
                instants.setdefault(begin + turn.at, program.task)
                low = begin + turn.at + turn.after
                for name in turn.sizes[program.version]:
                    areas.append((low, low + turn.length, name, turn.kind is AccessKind.WRITE, program.task))
            reads = [o.at for o in program.operations if _reads(o)]
            ready = max((turn.after + turn.length for turn in own if turn.kind is AccessKind.READ), default=0)
            if reads and min(reads) < ready:
                text = f"reads {min(reads)} ticks after its release, when its copies are complete after {ready}"
                yield program.task, text, "run `halpipe deploy prepare` and schedule the prepared model"
            for o in program.operations if not own else ():
                end = o.source if o.access is not None and o.access.kind is AccessKind.READ else o.target
                if o.kind == _COPY and end in named:
                    writes = end == o.target
                    direct.append((begin + o.at, begin + o.at + o.limit, named[end], writes, program.task))
        for (before, _), (after, task) in pairwise(sorted(instants.items())):
            if after - before < self.window:
                text = f"copies at an instant {after - before} ticks after another, all copies need {self.window}"
                yield task, text, ""
        for low, high, name, writes, task in areas:
            for begin, end, buffer, is_written, other in direct:
                if buffer == name and (writes or is_written) and low < end and begin < high:
                    text = f'"{name}" is copied while a phase of "{other}" moves it'
                    yield task, text, f'state a LET for "{other}", too, or move its phase'
        yield from self._too_many(line, programs, model)

    def _apart(self, model: TaskModel, clock: Clock) -> str:
        """Return what keeps the instants of copies apart: releases and ends of LETs on a grid that holds all copies."""
        tasks = [task for task in model.tasks if task.name in self.tasks]
        periods, lets = ([getattr(task, name) or ZERO for task in tasks] for name in ("period", "let"))
        names, needed = ", ".join(task.name for task in tasks), clock.tick * self.window
        again = f'state offset="0ms" for {names}, and schedule again'
        if (shared := greatest_common_divisor([*periods, *lets])) >= needed:
            return f"{again}: their instants are then {shared} apart"
        if (shared := greatest_common_divisor(periods)) < needed:
            return f"make their periods multiples of a time of at least {needed}, {again}"
        most = math.floor(shared / needed)
        grid = next((shared / n for n in range(most, 1, -1) if (shared / n).in_unit("us") % 10 == 0), shared)
        return f"make their LETs multiples of {grid}, {again}"

    def _too_many(
        self, line: Sequence[tuple[int, Release]], programs: Sequence[Program], model: TaskModel
    ) -> Iterator[tuple[str, str, str]]:
        """Yield the tasks of which a third job is released before the first has written."""
        for task in sorted(self.tasks):
            last = max(turn.at + turn.after + turn.length for turn in self.of(task))
            begins = sorted(s + r.tick for s, r in line if programs[r.program].task == task)
            if any(later - first < last for first, later in zip(begins, begins[2:], strict=False)):
                text = f"its third job is released before the first has written, {model.task(task).let} later"
                yield task, text, "shorten the LET to the period, or lengthen the transition"


def _reads(operation: Operation) -> bool:
    """Whether an operation moves an input into a scratchpad."""
    kind = operation.access.kind if operation.access is not None else None
    return operation.kind == _COPY and kind is AccessKind.READ and not operation.is_copy


def lines_of(tables: Sequence[Table]) -> list[list[int]]:
    """Return every mode twice, and every switch between its modes: what can follow each other."""
    return [[i, i] if table.is_mode else [table.origin, i, table.target] for i, table in enumerate(tables)]


def _released(line: Sequence[int], tables: Sequence[Table]) -> list[tuple[int, Release]]:
    """Return the releases of tables that follow each other, with the starts of their tables."""
    found, start = [], 0
    for index in line:
        found += [(start, release) for release in tables[index].releases]
        start += tables[index].length
    return found


def patience_of(model: TaskModel, profile: Profile) -> int:
    """Return the ticks that the management core may be late with a copy: two operations of every other unit."""
    return math.ceil(2 * len(model.units) * profile.service / profile.tick)


def turns_of(
    model: TaskModel, versions: Iterable[tuple[str, Version]], clock: Clock, patience: int
) -> tuple[Turn, ...]:
    """Return the turns of the tasks with a LET, in the model's order: all that write, then all that read."""
    used = grouped(versions)
    found: list[Turn] = []
    after = 0
    for kind in (AccessKind.WRITE, AccessKind.READ):
        for task in (each for each in model.tasks if each.let is not None and each.name in used):
            sizes = {version.name: _sizes(version, kind) for version in used[task.name]}
            taken = [sum(clock.transfer(COPIES, size, "main") for size in each.values()) for each in sizes.values()]
            if max(taken):
                at = clock.up(task.let) if kind is AccessKind.WRITE and task.let is not None else 0
                found.append(Turn(task.name, kind, at, after, max(taken) + patience, sizes))
                after += found[-1].length
    return tuple(found)


def _sizes(version: Version, kind: AccessKind) -> dict[str, int]:
    sizes = grouped((transfer.buffer, transfer.size) for moved, transfer in transfers_of(version) if moved is kind)
    return {buffer: max(found) for buffer, found in sizes.items()}


def copies_of(
    model: TaskModel,
    schedule: Schedule,
    versions: Sequence[tuple[str, Version]],
    clock: Clock,
    profile: Profile,
    findings: Findings,
) -> Copies:
    """Return the copies of a schedule; collect the jobs whose release the runtime cannot keep."""
    turns = turns_of(model, versions, clock, patience_of(model, profile))
    names = {turn.task for turn in turns}
    tasks = {task.name: task for task in model.tasks if task.name in names}
    releases: dict[int, Duration] = {}
    for mode in schedule.modes:
        for job, release in releases_of(mode, tasks):
            releases[id(job)] = release
            _check(job, release, tasks[job.task], clock, findings)
    for table in schedule.transitions:
        for job in (job for job in table.jobs if job.task in tasks):
            _check(job, job.start, tasks[job.task], clock, findings)
    return Copies(turns, releases)


def _check(job: Job, release: Duration, task: Task, clock: Clock, findings: Findings) -> None:
    let, period = task.let or ZERO, task.period or ZERO
    path = about(task=task.name)
    if job.start < release:
        text = f"job {job.index} starts at {job.start} of the cycle after its release"
        help = f"state an offset of at most {period - let}, or less slack"
        findings.add(COPIES_UNFIT(text, at=job.at, path=path, help=help))
    for instant in (release, let):
        if greatest_common_divisor((instant, clock.tick)) != clock.tick and instant:
            text = f"its data are copied at {instant}, no multiple of the timer's tick {clock.tick}"
            findings.add(OFF_GRID(text, at=job.at, path=path, help=f"schedule with --tick {clock.tick}"))
