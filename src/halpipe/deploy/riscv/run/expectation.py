"""Plan of a target from model and schedule: executions and transfers with their instants.

This follows the rules of docs/reference/riscv-bundle.md and shares no code with the exporter, so that a fault in its
operation tables is a difference and not an agreement. All instants here are ticks from the beginning of the run.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Path, Subject, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.deploy.riscv.codes import BROKEN_TARGET
from halpipe.deploy.riscv.run.drivers import PlannedCall, read_drivers
from halpipe.deploy.riscv.run.observation import Outcome
from halpipe.models import Access, AccessKind, Job, TaskModel, Transfer, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.riscv.board.elf import Program
    from halpipe.deploy.riscv.run.sequence import Played
    from halpipe.deploy.riscv.target import ImageSite, Site, Turn


SCALAR = 8
"""Bytes that the members of a gang do not divide."""


@record(kw_only=True)
class PlannedTransfer:
    """Bytes that a phase from `begin` to `end` moves, or a copy between buffers; `what` for people."""

    what: str
    kind: AccessKind
    channel: int
    hart: int
    source: int
    target: int
    size: int
    begin: int
    end: int
    is_copy: bool = False


@record(kw_only=True)
class PlannedExecution:
    """A function that `hart` has to enter at `begin` and to have left by `end`; `stretch` counts them in the job.

    It gets the `rank` of its core in the job's gang, and that of `ranks` members; `ends` is how it may end.
    """

    hart: int
    function: int
    begin: int
    end: int
    stretch: int
    rank: int = 0
    ranks: int = 1
    ends: frozenset[Outcome] = frozenset({Outcome.RETURNED})


@record(kw_only=True)
class PlannedJob:
    """A job of a table that is played."""

    table: Played
    row: int
    job: Job
    begin: int
    end: int
    transfers: tuple[PlannedTransfer, ...]
    executions: tuple[PlannedExecution, ...]
    calls: tuple[PlannedCall, ...] = ()

    @property
    def path(self) -> Path:
        """Name in messages."""
        table, task, index = self.table.name, self.job.task, self.job.index
        subjects = (Subject("table", table), Subject("task", task), Subject("job", str(index)))
        return Path(f'"{table}", job {index} of task "{task}"', subjects)


_Template = tuple[list[PlannedTransfer], list[PlannedExecution], list[PlannedCall]]


@record
class Image:
    """The image of a version on a unit: where target.json says that it is, and the program itself."""

    site: ImageSite
    program: Program
    hart: int


class Expectation:
    """Makes the plan of jobs for what a bundle carries; what cannot be planned is collected in `findings`."""

    def __init__(
        self, bundle: Bundle, model: TaskModel, site: Site, images: Mapping[tuple[str, str, str], Image]
    ) -> None:
        self.findings = Findings()
        self._bundle, self._model, self._site, self._images = bundle, model, site, images
        self._drivers = read_drivers(bundle)
        self._templates: dict[tuple[str, str, tuple[str, ...], _Parts, Duration], _Template] = {}

    def jobs(self, tables: Iterable[Played]) -> list[PlannedJob]:
        """Return every job of the tables, in the order of their starts."""
        found = [
            self._job(table, row, job, release)
            for table in tables
            for row, (job, release) in enumerate(zip(table.jobs, self._releases(table), strict=True))
        ]
        return sorted(found, key=lambda planned: (planned.begin, planned.table.cycle, planned.row))

    def _releases(self, table: Played) -> list[Duration]:
        """Return when the jobs of a table are released: at their starts, or where a LET of theirs begins."""
        copied = {turn.task for turn in self._site.turns} if not table.is_transition else set()
        phases = {name: self._phase_of(name, table) for name in copied}
        return [
            phases[job.task] + (self._model.task(job.task).period or ZERO) * job.index
            if job.task in copied
            else job.start
            for job in table.jobs
        ]

    def _phase_of(self, name: str, table: Played) -> Duration:
        """Return the release of the first job of a task: its offset, or what leaves all jobs the least delay."""
        task = self._model.task(name)
        period = task.period or table.length
        if task.offset is not None:
            return task.offset % period
        starts = sorted({(job.start - period * job.index) % table.length for job in table.jobs if job.task == name})
        before = [*starts[-1:], *starts]
        gaps = [((later - before[i]) % table.length, later) for i, later in enumerate(starts)]
        return ZERO if not starts else max(gaps, key=lambda gap: gap[0])[1]

    def _job(self, table: Played, row: int, job: Job, release: Duration) -> PlannedJob:
        key = (job.task, job.version, job.units, _relative(job), job.start - release)
        if key not in self._templates:
            self._templates[key] = self._template(job, job.start - release)
        transfers, executions, calls = self._templates[key]
        base = self._tick(table.start + release, job)
        return PlannedJob(
            table=table,
            row=row,
            job=job,
            begin=base,
            end=base + math.floor((job.end - release) / self._site.tick),
            transfers=tuple(replace(t, begin=t.begin + base, end=t.end + base) for t in transfers),
            executions=tuple(replace(e, begin=e.begin + base, end=e.end + base) for e in executions),
            calls=tuple(replace(c, begin=c.begin + base) for c in calls),
        )

    def _tick(self, instant: Duration, job: Job) -> int:
        ticks = instant / self._site.tick
        if ticks.denominator != 1:
            message = f"{instant} is no multiple of the timer's tick {self._site.tick}"
            help = f"schedule with --tick {self._site.tick} and export again"
            self.findings.add(BROKEN_TARGET(message, at=job.at, path=about(task=job.task), help=help))
        return math.floor(ticks)

    def _template(self, job: Job, waits: Duration) -> _Template:
        """Return what one job of a version does on its units, from its release at tick 0; it `waits` to start."""
        version = self._model.task(job.task).version(job.version)
        images = [self._images.get((job.task, job.version, unit)) for unit in job.units]
        members = [image for image in images if image is not None]
        if len(members) < len(images):
            message = f'has no image of version "{job.version}" for every unit of {", ".join(job.units)}'
            self._complain(message, f'task "{job.task}"')
            return [], [], []
        moving = [a for a in version.accesses if a.kind is AccessKind.LOAD or a.transfers]
        moving.sort(key=lambda access: (access.start, access.end))
        wall = _Wall(_relative(job), version.split.resume, waits)
        turns = [turn for turn in self._site.turns if turn.task == job.task]
        transfers = [t for turn in turns for t in self._copies(turn, moving, members[0])]
        transfers += [t for access in moving for t in self._phase(access, members, wall)]
        functions = len(members[0].site.entries)
        executions = [
            PlannedExecution(
                hart=image.hart,
                function=image.site.entries[i],
                begin=begin,
                end=end,
                stretch=i,
                rank=rank,
                ranks=len(members),
            )
            for i, (begin, end) in enumerate(self._stretches(version, moving, functions, wall))
            for rank, image in enumerate(members)
            if i < len(image.site.entries)
        ]
        if len(executions) != functions * len(members):
            self._complain(f"its phases leave no {functions} stretches of execution", f'task "{job.task}"')
        calls = [call for access in moving for call in self._calls(job.task, access, members[0], wall, turns)]
        return sorted(transfers, key=lambda t: t.begin), executions, calls

    def _copies(self, turn: Turn, moving: list[Access], leader: Image) -> Iterator[PlannedTransfer]:
        """Yield the copies of what a job reads, at its release, or of what it has written, at release + LET."""
        kind = AccessKind(turn.kind)
        begin = self._instant(turn) + turn.after
        sizes: dict[str, int] = {}
        for transfer in (t for access in moving if access.kind is kind for t in access.transfers):
            sizes[transfer.buffer] = max(sizes.get(transfer.buffer, 0), transfer.size)
        for name, size in sizes.items():
            area, own = self._site.buffers.get(name), turn.buffers.get(name)
            if area is None or own is None or min(area.size, own.size) < size:
                self._complain(f"has no copy of {size} bytes of it", f'buffer "{name}"')
                continue
            source, target = (area, own) if kind is AccessKind.READ else (own, area)
            yield PlannedTransfer(
                what=f'buffer "{name}" for its LET',
                kind=kind,
                channel=self._site.copying,
                hart=leader.hart,
                source=source.base,
                target=target.base,
                size=size,
                begin=begin,
                end=begin + turn.length,
                is_copy=True,
            )

    def _instant(self, turn: Turn) -> int:
        let = self._model.task(turn.task).let or ZERO
        return 0 if turn.kind == AccessKind.READ else math.floor(let / self._site.tick)

    def _calls(
        self, task: str, access: Access, leader: Image, wall: _Wall, turns: Sequence[Turn]
    ) -> Iterator[PlannedCall]:
        """Yield the calls of drivers in a phase: for inputs when it begins, for outputs when it is over."""
        begin = math.ceil(wall.begins(access.start) / self._site.tick)
        end = math.floor(wall.ends(access.end) / self._site.tick)
        for turn in (turn for turn in turns if turn.kind == access.kind):
            begin = self._instant(turn) + turn.after
            end = begin + turn.length
        for driver in self._drivers:
            area = self._site.buffers.get(driver.buffer)
            if driver.serves(task, access) and area is not None:
                at = begin if driver.kind is AccessKind.READ else end
                yield PlannedCall(driver=driver, data=area.base, size=area.size, begin=at)

    def _phase(self, access: Access, members: list[Image], wall: _Wall) -> Iterator[PlannedTransfer]:
        tick = self._site.tick
        begin, end = math.ceil(wall.begins(access.start) / tick), math.floor(wall.ends(access.end) / tick)
        channel = self._site.channels.get(access.resource)
        if channel is None:
            self._complain(f'has no channel for resource "{access.resource}"', "resources")
            channel = 0
        kind = access.kind or AccessKind.READ
        for what, image, source, target, size in self._moves(access, members):
            yield PlannedTransfer(
                what=what,
                kind=kind,
                channel=channel,
                hart=image.hart,
                source=source,
                target=target,
                size=size,
                begin=begin,
                end=end,
            )

    def _moves(self, access: Access, members: list[Image]) -> Iterator[tuple[str, Image, int, int, int]]:
        """Yield what a phase moves, in its order: every member of a gang loads and reads all, and writes its part."""
        if access.kind is AccessKind.LOAD:
            for image in members:
                for segment in sorted(image.program.segments, key=lambda part: part.source):
                    if segment.data:
                        yield "its image", image, segment.source, segment.target, len(segment.data)
        writes = access.kind is AccessKind.WRITE
        for transfer in access.transfers:
            for rank, image in enumerate(members):
                offset, size = _part(rank, len(members), transfer.size) if writes else (0, transfer.size)
                ends = self._ends(transfer, image, access.kind)
                if ends is not None and size:
                    buffer, symbol = (end + offset for end in ends)
                    source, target = (symbol, buffer) if writes else (buffer, symbol)
                    yield f'buffer "{transfer.buffer}"', image, source, target, size

    def _ends(self, transfer: Transfer, image: Image, kind: AccessKind | None) -> tuple[int, int] | None:
        """Return the addresses of the buffer, the task's own if it has a LET, and of the symbol by the program."""
        own = (turn for turn in self._site.turns if (turn.task, turn.kind) == (image.site.task, kind))
        buffer = next((turn.buffers.get(transfer.buffer) for turn in own), self._site.buffers.get(transfer.buffer))
        symbol = image.program.symbols.get(transfer.symbol)
        if buffer is None or buffer.size < transfer.size:
            self._complain(f"has no {transfer.size} bytes for it", f'buffer "{transfer.buffer}"')
        if symbol is None or symbol[1] < transfer.size:
            self._complain(f'symbol "{transfer.symbol}" is missing, or smaller than its transfer', image.site.file)
        return (buffer.base, symbol[0]) if buffer is not None and symbol is not None else None

    def _stretches(
        self, version: Version, moving: list[Access], functions: int, wall: _Wall
    ) -> Iterator[tuple[int, int]]:
        """Yield when the functions execute: between reads and writes, in every gap, or in every piece."""
        tick = self._site.tick
        wcet = version.wcet or ZERO
        writes = [a for a in moving if a.kind is AccessKind.WRITE]
        if functions == 1:
            begin = max((a.end for a in moving if a not in writes), default=ZERO)
            end = min((a.start for a in writes), default=wcet)
            spans = [(begin, end)]
        else:
            ends = [ZERO, *(a.end for a in moving)]
            starts = [*(a.start for a in moving), wcet]
            fronts = [max(ends[: i + 1]) for i in range(len(ends))]
            spans = [(front, start) for front, start in zip(fronts, starts, strict=True) if front < start]
            if len(spans) != functions:
                spans = [piece for span in spans for piece in _pieces(span, version.split.points)]
        for begin, end in spans:
            yield math.ceil(wall.begins(begin) / tick), math.floor(wall.ends(end) / tick)

    def _complain(self, message: str, path: str) -> None:
        help = "export the bundle again"
        self.findings.add(BROKEN_TARGET(message, at=self._bundle.at("target.json"), path=path, help=help))


_Parts = tuple[tuple["Duration", "Duration", "Duration"], ...]
"""The parts of a job: start after the job's, and the execution from and to."""


def _relative(job: Job) -> _Parts:
    return tuple((part.start - job.start, part.executed_from, part.executed_to) for part in job.parts)


@record
class _Wall:
    """Execution of a job in wall-clock time: in its parts, after each gap by `resume` later (MODEL 8.2).

    It `waits` from its release to its start.
    """

    parts: _Parts
    resume: Duration
    waits: Duration = ZERO

    def begins(self, instant: Duration) -> Duration:
        """Return when what begins with `instant` of the execution begins, after the job's start."""
        for k, (start, first, last) in enumerate(self.parts):
            if first <= instant < last:
                return self.waits + start + (self.resume if k else ZERO) + instant - first
        return self.ends(instant) if self.parts else self.waits + instant

    def ends(self, instant: Duration) -> Duration:
        """Return when what ends with `instant` of the execution ends."""
        for k, (start, first, last) in enumerate(self.parts):
            if first < instant <= last:
                return self.waits + start + (self.resume if k else ZERO) + instant - first
        return self.waits + instant


def _pieces(span: tuple[Duration, Duration], points: Iterable[Duration]) -> Iterator[tuple[Duration, Duration]]:
    begin, end = span
    for point in points:
        if begin < point < end:
            yield begin, point
            begin = point
    yield begin, end


def _part(rank: int, ranks: int, size: int) -> tuple[int, int]:
    """Return offset and bytes of what a member writes of a variable: its part, or all of a scalar."""
    if size <= SCALAR:
        return 0, 0 if rank else size
    return rank * (size // ranks), size // ranks
