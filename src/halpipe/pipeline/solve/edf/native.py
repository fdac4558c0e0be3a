"""The border between Python and the simulation, which is C: what it is handed, and how it is asked.

`native/system.h` has the same structs, field by field. The library allocates nothing: room is handed over as well, and
where it turns out too small the simulation begins again with twice as much.
"""

from __future__ import annotations

import ctypes
from itertools import accumulate, chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core import libraries
from halpipe.core.libraries import INTEGER, words
from halpipe.pipeline.solve.edf.plans import Table, releases_of
from halpipe.pipeline.solve.integers import filled, ints

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.pipeline.solve.edf.fixed import Claim
    from halpipe.pipeline.solve.edf.plans import Plan
    from halpipe.pipeline.solve.edf.works import Mode, Way
    from halpipe.pipeline.solve.integers import Ints

SOURCES = Path(__file__).parent / "native"

INSTANTS = 200_000
"""After so many instants at which something happens the library comes back, so that Ctrl-C is heard."""

JOB_WORDS, EVENT_WORDS, PART_WORDS, CLAIM_WORDS = 16, 4, 4, 4
"""Sizes of the library's records."""

LACK, BEGIN, END, PART_COUNT = 0, 1, 2, 6
"""Places of what Python reads and writes of the library's memory."""

FIRST_ROOM = {"events": 256, "history": 64, "parts": 256, "claims": 256, "signature": 256, "open": 16}
"""Records for which there is room at first; where it turns out too small, what is lacking is doubled (system.h)."""

LARGEST = 2**61
"""Longer times than this mean no limit; sums of two of them stay within 64 bits."""


def rows_at(counts: Iterable[int]) -> Ints:
    """Return where the rows of each begin, and where all end."""
    return ints(accumulate(counts, initial=0))


def flat(rows: Iterable[Iterable[int]]) -> Ints:
    """Return rows one after the other."""
    return ints(chain.from_iterable(rows))


class System:
    """A mode as the library sees it."""

    def __init__(self, mode: Mode, most_cycles: int) -> None:
        """Write down the mode. A simulation lasts for at most so many hyperperiods, besides those of its start."""
        self.mode = mode
        every = [way for work in mode.works for way in work.ways]
        self.number = {id(way): number for number, way in enumerate(every)}
        self._every = every
        self.most_phases = max((len(way.phases) for way in every), default=0)
        fixed = mode.fixed
        standing = self._standing()
        walls = [fixed.walls.get(unit) for unit in range(len(mode.units))]
        arrays = {
            "task": flat(
                (w.latest, min(w.deadline, LARGEST), w.is_cyclic, n in fixed.tasks) for n, w in enumerate(mode.works)
            ),
            "ways": flat(self._way_rows()),
            "way_units": flat(way.units for way in every),
            "services": flat(pair for way in every for pair in way.service),
            "ends": flat(way.ends for way in every),
            "phases": flat((p.resource, p.begin, p.end, p.height) for way in every for p in way.phases),
            "by_begin": flat((p.begin, p.end) for way in every for p in sorted(way.phases, key=lambda p: p.begin)),
            "by_end": flat((p.begin, p.end) for way in every for p in sorted(way.phases, key=lambda p: -p.end)),
            "windows": flat((w.task, w.least, min(w.most, LARGEST), w.from_end) for way in every for w in way.windows),
            "capacity": ints(mode.capacity.values()),
            "fixed": flat(self._fixed_rows()),
            "fixed_units": flat(each.units for each in fixed.jobs),
            "standing": flat(claim for claims in standing for claim in claims),
            "standing_at": rows_at(map(len, standing)),
            "longest": ints(max((c.end - c.begin for c in claims), default=0) for claims in standing),
            "places": flat(row for wall in walls if wall is not None for row in wall.rows()),
            "places_at": rows_at(0 if wall is None else len(wall.rows()) for wall in walls),
            "walls": flat(wall.begins for wall in walls if wall is not None),
            "walls_at": rows_at(0 if wall is None else len(wall.begins) for wall in walls),
        }
        sizes = {
            "tasks": len(mode.works),
            "units": len(mode.units),
            "resources": len(mode.capacity),
            "cycle": mode.hyperperiod,
            "most_cycles": most_cycles,
        }
        self.fields = {**sizes, **arrays}
        self.words = words(self.fields.values())

    def _way_rows(self) -> Iterable[tuple[int, ...]]:
        place = [0] * 5
        for way in self._every:
            facts = (way.wcet, way.length, way.anywhere, way.resume, way.max_gaps, way.min_part)
            yield (*place, *facts)
            lists: tuple[Sequence[object], ...] = (way.units, way.service, way.ends, way.phases, way.windows)
            place = [at + len(each) for at, each in zip(place, lists, strict=True)]
        yield (*place, *(0,) * 6)

    def _fixed_rows(self) -> Iterable[tuple[int, ...]]:
        units = 0
        for each in self.mode.fixed.jobs:
            yield each.task, each.start, each.end, units
            units += len(each.units)
        yield 0, 0, 0, units

    def _standing(self) -> list[list[Claim]]:
        """Return the claims of jobs that stay, in the hyperperiod in which they begin, by resource and begin."""
        cycle = self.mode.hyperperiod
        claims = [c.moved(-(c.begin // cycle * cycle)) for each in self.mode.fixed.jobs for c in each.claims]
        ordered = sorted(claims, key=lambda claim: claim.begin)
        return [[c for c in ordered if c.resource == resource] for resource in range(len(self.mode.capacity))]


class Told:
    """A plan as the library sees it."""

    def __init__(self, system: System, plan: Plan, open_parts: int) -> None:
        """Write down the plan, with room for so many parts of each job that has begun."""
        mode = system.mode
        self.releases, self.indices = ints(), ints()
        counts = []
        for found in releases_of(mode, plan):
            self.releases += ints(time for time, _ in found)
            self.indices += ints(index for _, index in found)
            counts.append(len(found))
        on_unit: list[list[int]] = [[] for _ in mode.units]
        followers: list[set[int]] = [set() for _ in mode.works]
        reach = [0] * len(mode.works)
        for task, way in enumerate(plan.ways):
            for unit in way.units if task not in mode.fixed.tasks else ():
                on_unit[unit].append(task)
            for window in way.windows:
                followers[window.task].update(way.units)
                reach[window.task] = max(reach[window.task], min(window.most, LARGEST))
        numbers = accumulate(map(bool, followers))
        self.histories = sum(map(bool, followers))
        self.places = rows_at(counts)
        self.parts_at = rows_at(min(most_parts(way), open_parts) for way in plan.ways)
        self.on_unit_at = rows_at(map(len, on_unit))
        self.fields = {
            "fresh": int(plan.fresh),
            "way": ints(system.number[id(way)] for way in plan.ways),
            "holds": ints(plan.holds),
            "urgency": ints(plan.urgency),
            "releases": self.releases,
            "releases_at": self.places,
            "on_unit": flat(on_unit),
            "on_unit_at": self.on_unit_at,
            "followers": flat(map(sorted, followers)),
            "followers_at": rows_at(map(len, followers)),
            "reach": ints(reach),
            "history": ints(number - 1 if each else -1 for number, each in zip(numbers, followers, strict=True)),
            "parts_at": self.parts_at,
        }
        self.words = words(self.fields.values())

    def first_release(self, task: int) -> int | None:
        """Return when the first job of a task is released; None of a task without jobs."""
        place = self.places[task]
        return self.releases[place] if place < self.places[task + 1] else None


def most_parts(way: Way) -> int:
    """Return how many parts a job may have at most."""
    pieces = way.wcet // way.min_part if way.anywhere else len(way.ends)
    return max(1, min(way.max_gaps + 1, pieces))


class Memory:
    """Memory of the library for one simulation; `room` is its size, where that is not known."""

    def __init__(self, system: System, told: Told, room: Mapping[str, int]) -> None:
        """Make room, and some that grows with the system."""
        tasks, units, resources = len(system.mode.works), len(system.mode.units), len(system.mode.capacity)
        jobs = told.places[tasks]
        events = room["events"] + 4 * tasks + 4 * len(system.mode.fixed.jobs)
        history, parts, claims = room["history"], room["parts"] + 2 * jobs, room["claims"]
        signature = room["signature"] + 16 * tasks
        seats = told.on_unit_at[units]
        self.late = filled(tasks)
        self.firsts, self.counts, self.releases, self.starts, self.ends = (filled(jobs) for _ in range(5))
        self.parts = filled(PART_WORDS * parts)
        links = filled(CLAIM_WORDS * claims)
        links[CLAIM_WORDS - 1 :: CLAIM_WORDS] = ints((*range(1, claims), -1))  # each is followed by the next
        arrays = {
            "jobs": filled(JOB_WORDS * tasks),
            "events": filled(EVENT_WORDS * events),
            "open": filled(PART_WORDS * told.parts_at[tasks]),
            "pending": filled(seats),
            "pending_count": filled(units),
            "stacks": filled(seats),
            "stack_count": filled(units),
            "running": filled(units, -1),
            "is_touched": filled(units),
            "candidates": filled(tasks),
            "past": filled(2 * told.histories * history),
            "past_count": filled(2 * told.histories),
            "claims": links,
            "claims_of": filled(resources, -1),
            "claim_count": filled(resources),
            "claim_most": filled(resources, 64),
            "asked": filled(CLAIM_WORDS * system.most_phases),
            "near": filled(CLAIM_WORDS * claims),
            "signatures": filled(2 * signature),
            "first": self.firsts,
            "count": self.counts,
            "release": self.releases,
            "start": self.starts,
            "finish": self.ends,
            "parts": self.parts,
            "late": self.late,
        }
        counts = dict.fromkeys(("lack", "begin", "end", "sequence", "hurried", "event_count", "part_count"), 0)
        counts |= {"free_claim": 0, "signed_count": 0, "signed_before": -1}
        rooms = {
            "event_room": events,
            "history_room": history,
            "part_room": parts,
            "claim_room": claims,
            "near_room": claims,
            "signature_room": signature,
        }
        self.fields = {**counts, **rooms, **arrays}
        self.words = words(self.fields.values())

    @property
    def lacks_room(self) -> tuple[str, ...]:
        """Return the table that was too small; then no result counts."""
        return tuple(name for bit, name in enumerate(FIRST_ROOM) if self.words[LACK] >> bit & 1)

    def turn(self, begin: int, end: int) -> None:
        """Look at another hyperperiod: jobs that start in it are kept."""
        self.words[BEGIN], self.words[END], self.words[PART_COUNT] = begin, end, 0
        self.counts[:] = filled(len(self.counts))
        self.late[:] = filled(len(self.late))


def function(name: str) -> Any:
    """Return a function of the library."""
    return libraries.function(SOURCES, "edf", f"halpipe_edf_{name}")


class Simulation:
    """One simulation in the library."""

    def __init__(self, system: System, told: Told, room: Mapping[str, int]) -> None:
        """Put down the first releases, and the jobs that stay."""
        self.system, self.told = system, told
        self.memory = Memory(system, told, room)
        self._pointers = [ctypes.byref(each.words) for each in (system, told, self.memory)]
        self._ask("begin")
        for number, each in enumerate(system.mode.fixed.jobs):
            for instant in {t for span in each.spans for t in span}:
                self._ask("fix", instant % system.mode.hyperperiod, number)

    def _ask(self, name: str, *numbers: int) -> int:
        return int(function(name)(*self._pointers, *map(INTEGER, numbers)))

    def run(self, end: int) -> None:
        """Go on to an instant."""
        while not self._ask("run", end, INSTANTS):
            pass

    def is_like_before(self, now: int, turn: int) -> bool:
        """Return whether the future depends on the same as when this was asked the last time."""
        return bool(self._ask("sign", now, turn))

    def is_quiescent(self, now: int) -> bool:
        """Return whether nothing is in progress and no job looks back: the next hyperperiod repeats the first."""
        return not self.told.histories and bool(self._ask("is_quiescent", now))

    def finish(self, end: int) -> None:
        """Go on until all that began before `end` has ended, for at most one hyperperiod more."""
        limit = end + self.system.mode.hyperperiod
        while 0 <= (time := self._ask("unended", end)) < limit and not self.memory.lacks_room:
            self.run(time + 1)

    def table(self, *, closed: bool) -> Table:
        """Return the hyperperiod that was looked at."""
        told, memory, cycle = self.told, self.memory, self.system.mode.hyperperiod
        late = list(memory.late)
        whole = True
        for task in range(len(late)):
            missing = memory.counts[told.places[task] : told.places[task + 1]].count(0)
            late[task] += missing * cycle
            whole = whole and not missing
        arrays = (memory.releases, memory.starts, memory.ends, memory.firsts, memory.counts, memory.parts)
        return Table(told.places, told.indices, *arrays, tuple(late), closed and whole)
