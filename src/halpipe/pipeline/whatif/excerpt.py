"""The part of a system that a longer WCET of one version can touch, which verify judges as it would the whole.

A longer job meets the jobs that start next on its units, and what is tied to its task: precedences and chains. The rest
stays as it is and is left out, so that what the look at a version costs does not grow with the system.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import defaultdict
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO, Duration, least_common_multiple
from halpipe.models import Anchor
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.placement import PlacedPart, Placement
from halpipe.pipeline.parts import reserved_length

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Chain, Job, Mode, ModeSchedule, Schedule, TaskModel, Transition, TransitionTable
    from halpipe.pipeline.measure.placement import PlacedJob


class Room(NamedTuple):
    """The way that jobs of a version have before they meet others as they grow, in ticks; None: without end."""

    units: int | None
    """Growth beyond which they certainly run into another job on their units."""
    met: list[tuple[str, int]]
    """The units, and the starts of those jobs."""
    free: int | None
    """Growth within which they meet no job at all, not even of their own task on other units; 0 where
    precedences or chains tie it to others."""


class _Window(NamedTuple):
    """An edge of the windows that the growing ends move towards: so far from an instant of the jobs of a task."""

    task: str
    anchor: Anchor
    point: Duration | None
    shift: Duration


class _Part(NamedTuple):
    """A table from an instant on, `turns` times, or without a cycle once."""

    begin: int
    cycle: int
    turns: int
    placement: Placement

    def instants(self, window: _Window, tick: Duration) -> list[int]:
        """Return the edges of the window in the first turn; a job of a table is released when it starts."""
        anchor = Anchor.START if window.anchor is Anchor.RELEASE and not self.cycle else window.anchor
        jobs = self.placement.by_task.get(window.task, ())
        shift = self.begin + window.shift // tick
        return [shift + self.placement.instant(job, anchor, window.point) for job in jobs]


class Sections:
    """A valid schedule in sections, each a mode or a switch with its two modes; `tick` divides all times."""

    def __init__(self, model: TaskModel, schedule: Schedule, tick: Duration) -> None:
        self.model, self.schedule, self.tick = model, schedule, tick
        self.places = {task.name: place for place, task in enumerate(model.tasks)}
        self.runs = {mode.name: {run.task: run for run in mode.runs} for mode in model.modes}
        self.allowed: dict[tuple[str, str], tuple[Transition, ...]] = defaultdict(tuple)
        for each in model.allowed_transitions() if schedule.transitions else ():
            self.allowed[each.source, each.target] += (each,)
        self.placements = {
            mode.name: Placement.of(expand(model, model.mode(mode.name)), mode.jobs, model.units, tick)
            for mode in schedule.modes
        }

    def modes(self) -> Iterator[Section]:
        """Yield every mode."""
        return (Section(self, (mode,), None) for mode in self.schedule.modes)

    def switches(self) -> Iterator[Section]:
        """Yield every switch."""
        modes = {mode.name: mode for mode in self.schedule.modes}
        for table in self.schedule.transitions:
            yield Section(self, (modes[table.source], modes[table.target]), table)

    @cached_property
    def chains(self) -> dict[str, list[Chain]]:
        """The chains with a limit, by task."""
        found: dict[str, list[Chain]] = defaultdict(list)
        for chain in self.model.chains:
            if (chain.max_latency, chain.max_reaction, chain.max_age) != (None, None, None):
                for name in dict.fromkeys(chain.tasks):
                    found[name].append(chain)
        return found

    @cached_property
    def links(self) -> dict[str, set[str]]:
        """The tasks that precedences tie to each, both ways."""
        found: dict[str, set[str]] = defaultdict(set)
        for task in self.model.tasks:
            for row in (row for version in task.versions for row in version.precedences):
                found[task.name].add(row.task)
                found[row.task].add(task.name)
        return found

    @cached_property
    def keepers(self) -> dict[str, list[str]]:
        """Tasks of each mode, of few jobs, whose periods make its hyperperiod."""
        return {mode.name: list(self._keepers(mode)) for mode in self.model.modes}

    def _keepers(self, mode: Mode) -> Iterator[str]:
        tasks = (self.model.task(run.task) for run in mode.runs)
        length: Duration | None = None
        for period, name in sorted(((t.period, t.name) for t in tasks if t.period is not None), reverse=True):
            longer = period if length is None else least_common_multiple((length, period))
            if longer != length:
                yield name
            length = longer


class Section:
    """A mode, or a switch with its modes, on a line: a cycle before the switch, its table, the cycles after it."""

    def __init__(self, system: Sections, modes: tuple[ModeSchedule, ...], table: TransitionTable | None) -> None:
        self._system, self._modes, self._table = system, modes, table
        self._line = list(self._parts())
        self._starts: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        self._growing: dict[tuple[str, str], list[PlacedJob]] = defaultdict(list)
        self._own: dict[str, list[int]] = defaultdict(list)
        for part in self._line:
            for turn in range(part.turns):
                self._lay(part, turn)
        self._ordered = {unit: sorted(starts) for unit, starts in self._starts.items()}

    def __contains__(self, version: tuple[str, str]) -> bool:
        return version in self._growing

    def _parts(self) -> Iterator[_Part]:
        """Yield the parts of the line: one cycle of each mode, which is looked at alone, too, and what may follow."""
        tick, places = self._system.tick, [self._system.placements[mode.name] for mode in self._modes]
        length = 0
        if self._table is not None:
            length = self._table.length // tick
            yield _Part(-places[0].hyperperiod, places[0].hyperperiod, 1, places[0])
            placed = Placement.of(places[1].expansion, self._table.jobs, self._system.model.units, tick)
            yield _Part(0, 0, 1, placed)
        longest = max((job.end // places[-1].hyperperiod for place in places for job in place.jobs), default=0)
        yield _Part(length, places[-1].hyperperiod, 2 + longest, places[-1])

    def _lay(self, part: _Part, turn: int) -> None:
        begin = part.begin + turn * part.cycle
        for job in part.placement.jobs:
            self._own[job.active.name].append(begin + job.start)
            if turn == 0:
                self._growing[job.active.name, job.version.name].append(replace(job, start=begin + job.start))
            for unit in job.units:
                for start, _ in job.occupations():
                    self._starts[unit][begin + start].add(job.active.name)

    def room(self, task: str, version: str) -> Room:
        """Return what the jobs of a version meet as they grow."""
        met: dict[int, list[tuple[str, int]]] = defaultdict(list)
        own = sorted(self._own[task])
        free = []
        for job in self._growing[task, version]:
            for unit in job.units:
                starts = self._ordered[unit]
                for start in starts[bisect_left(starts, job.end) :][:1]:
                    met[start - job.end].append((unit, start))
            free += [start - job.end for start in own[bisect_left(own, job.end) :][:1]]
        room = min(met, default=None)
        first = met[room] if room is not None else []
        tied = self._system.links.get(task) or self._system.chains.get(task)
        return Room(room, first, 0 if tied else min([*met, *free], default=None))

    def met(self, room: Room) -> str:
        """Say what the jobs meet first, of a switch."""
        unit, start = room.met[0]
        name = min(self._starts[unit][start])
        path = about(transition=(self._modes[0].name, self._modes[1].name))
        return f'{path}: unit "{unit}": "{name}" starts at {self._system.tick * start} after the switch'

    # ---- windows

    def turns(self, task: str, version: str, most: int) -> list[int]:
        """Return each growth below `most` ticks with which an end of the version's jobs may be at the edge of a window.

        Beyond one of them a window may be lost which growth by still more finds again in another cycle.
        """
        found: set[int] = set()
        for window in self._windows(task, version):
            for part in self._line:
                edges = part.instants(window, self._system.tick)
                for own in self._line if edges else ():
                    jobs = [job for job in own.placement.by_task.get(task, ()) if job.version.name == version]
                    for job in jobs:
                        distances = _ahead(edges, own.begin + job.end, math.gcd(part.cycle, own.cycle), most)
                        found.update(_growth(job, distance, self._system.tick) for distance in distances)
        return sorted(found)

    def _windows(self, task: str, version: str) -> Iterator[_Window]:
        model = self._system.model
        for row in model.task(task).version(version).precedences:
            if row.to is Anchor.END:
                yield _Window(row.task, row.anchor, row.point, row.max)
        for name in self._system.links.get(task, ()):
            for row in (row for v in model.task(name).versions for row in v.precedences):
                if row.task == task and row.anchor is Anchor.END:
                    yield _Window(name, row.to, None, ZERO - row.min)

    def around(self, task: str, room: Room) -> tuple[TaskModel, Schedule]:
        """Return the excerpt of a task, of those whose jobs it may meet, and of all that are tied to one of them."""
        owners = (name for unit, start in room.met for name in self._starts[unit][start])
        system = self._system
        chains = tuple(system.chains.get(task, ()))
        names = {task, *owners, *(name for chain in chains for name in chain.tasks)}
        names.update(name for mode in self._modes for name in system.keepers[mode.name])
        waiting = list(names)
        while waiting:
            more = system.links.get(waiting.pop(), set()) - names
            names |= more
            waiting += more
        chosen = sorted(names & system.places.keys(), key=system.places.__getitem__)
        runs = [(mode.name, system.runs[mode.name]) for mode in self._modes]
        model = replace(
            system.model,
            tasks=tuple(map(system.model.task, chosen)),
            modes=tuple(
                replace(system.model.mode(mode), runs=tuple(own[name] for name in chosen if name in own))
                for mode, own in runs
            ),
            chains=chains,
            transitions=system.allowed[self._table.source, self._table.target] if self._table else (),
            health=(),
        )
        modes = tuple(replace(mode, jobs=_jobs_of(mode, chosen)) for mode in self._modes)
        tables = (replace(self._table, jobs=_jobs_of(self._table, chosen)),) if self._table else ()
        return model, system.schedule.alone(modes, tables)


def _jobs_of(table: ModeSchedule | TransitionTable, tasks: Iterable[str]) -> tuple[Job, ...]:
    jobs = table.by_task()
    return tuple(job for name in tasks for job in jobs.get(name, ()))


def _ahead(edges: list[int], end: int, every: int, most: int) -> Iterator[int]:
    """Yield how far below `most` the edges lie ahead of an end, where all that repeats is moved by `every`."""
    if not every:
        yield from (edge - end for edge in edges if 0 <= edge - end < most)
        return
    ahead = sorted({(edge - end) % every for edge in edges})
    for turn in range(0, most, every):
        yield from (turn + distance for distance in ahead[: bisect_left(ahead, most - turn)])


def _growth(job: PlacedJob, distance: int, tick: Duration) -> int:
    """Return the largest growth of the WCET with which the end moves no further than a distance."""
    if not job.service:
        return distance
    *before, last = job.parts or (PlacedPart(0, job.length, 0, (job.version.wcet or ZERO) // tick),)
    work = (job.version.split.resume if before else ZERO) + tick * (last.done - last.begun)

    def moved(growth: int) -> Duration:
        return reserved_length(work + tick * growth, job.service) - reserved_length(work, job.service)

    return bisect_right(range(distance + 1), tick * distance, key=moved) - 1
