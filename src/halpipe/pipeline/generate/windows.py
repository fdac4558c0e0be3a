"""Put access windows on generated tasks (paper, section VI-B).

"Afterward, we generated the specified amount of access phase starts. If an access phase start was positioned during a
task with multiple start times, the access window was replicated to all other executions of this task. If necessary,
other access phases were moved."

(D) A start is a random instant on a random unit; the task that lies there has the window. Its resource is drawn. The
paper does not state lengths: they lie between 1/20 and 2/5 of the task, with which the resources of Table III are in
use for about half of the time (between 1/5 and 4/5 of the task with fractional bounds). Where the replicas would take
more of the resource than there is, the window is moved within the task to the nearest place where they do not,
shortened to it if need be, or put on another resource; if nothing of that works, another start is drawn. Windows are
placed on tasks already shortened to the wanted utilisation: shortened later, they could meet again.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator
    from random import Random

    from halpipe.pipeline.generate.parameters import SetParameters
    from halpipe.pipeline.generate.tiling import Piece

CAPACITY = 60
"""A resource in the smallest shares that bounds have: twentieths and thirds."""

_BOUNDS = (9, 15, 20, 30, 42, CAPACITY)
_TRIES = 400
"""Rejected starts in a row before the set is left with fewer windows."""

_MOST_ON_A_TASK = 4


@record
class Window:
    """An access window relative to its job's start; `height` of `CAPACITY` is its bound."""

    resource: int
    start: int
    end: int
    height: int


class Profile:
    """The load of a resource over the cyclic hyperperiod, as steps."""

    def __init__(self, hyperperiod: int) -> None:
        self._hyperperiod = hyperperiod
        self._edges = [0]
        self._levels = [0]
        self.area = 0

    def blocked(self, begin: int, length: int, room: int) -> Iterator[tuple[int, int]]:
        """Yield the parts of [begin, begin + length), relative to `begin`, that have no `room` left."""
        for low, high, base in self._spans(begin, length):
            for step in range(bisect_right(self._edges, low) - 1, bisect_left(self._edges, high)):
                if self._levels[step] + room > CAPACITY:
                    last = step + 1 == len(self._edges)
                    end = high if last else min(high, self._edges[step + 1])
                    yield max(low, self._edges[step]) - low + base, end - low + base

    def add(self, begin: int, length: int, height: int) -> None:
        """Load [begin, begin + length) with `height` more."""
        for low, high, _ in self._spans(begin, length):
            first, last = self._cut(low), self._cut(high)
            for step in range(first, last):
                self._levels[step] += height
        self.area += length * height

    def _spans(self, begin: int, length: int) -> Iterator[tuple[int, int, int]]:
        begin %= self._hyperperiod
        first = min(length, self._hyperperiod - begin)
        yield begin, begin + first, 0
        if length > first:
            yield 0, length - first, first

    def _cut(self, instant: int) -> int:
        """Return the number of the step that begins at `instant`."""
        place = bisect_left(self._edges, instant)
        if instant < self._hyperperiod and (place == len(self._edges) or self._edges[place] != instant):
            self._edges.insert(place, instant)
            self._levels.insert(place, self._levels[place - 1])
        return place


class WindowPlacer:
    """Places windows one after the other; `lengths` are the tasks' lengths after shortening."""

    def __init__(self, parameters: SetParameters, pieces: list[Piece], lengths: list[int], hyperperiod: int) -> None:
        self._fractional = parameters.fractional
        self._pieces, self._lengths, self._hyperperiod = pieces, lengths, hyperperiod
        self._profiles = [Profile(hyperperiod) for _ in range(parameters.resources)]
        self._on_unit: list[list[int]] = [[] for _ in range(parameters.units)]
        for number, piece in enumerate(pieces):
            for unit in piece.units:
                self._on_unit[unit].append(number)
        self.windows: list[list[Window]] = [[] for _ in pieces]

    def place_all(self, parameters: SetParameters, rng: Random) -> None:
        """Place the stated number of windows, or as many as the stated fill needs."""
        fill = parameters.resource_fill
        whole = self._hyperperiod * CAPACITY * len(self._profiles)
        tries, placed = 0, 0
        while tries < _TRIES:
            used = sum(profile.area for profile in self._profiles)
            if placed >= parameters.window_count if fill is None else used >= fill * whole:
                return
            most = self._hyperperiod * CAPACITY if fill is None else int(fill * whole) - used
            if self._place(most, rng):
                tries, placed = 0, placed + 1
            else:
                tries += 1

    def _place(self, most: int, rng: Random) -> bool:
        """Draw one start and place its window; return whether that worked. It loads at most about `most`."""
        unit, instant = rng.randrange(len(self._on_unit)), rng.randrange(self._hyperperiod)
        order = list(range(len(self._profiles)))
        rng.shuffle(order)
        share = rng.randrange(200, 801) if self._fractional else rng.randrange(50, 401)
        height = rng.choice(_BOUNDS) if self._fractional else CAPACITY
        number = self._task_at(unit, instant)
        if number is None or len(self.windows[number]) >= _MOST_ON_A_TASK:
            return False
        piece, length = self._pieces[number], self._lengths[number]
        jobs = self._hyperperiod // piece.period
        wish = (instant - piece.start) % piece.period * length // piece.length
        wanted = max(1, min(length * share // 1000, most // (jobs * height)))
        for resource in order:
            window = self._fit(number, resource, height, wish, wanted)
            if window is not None:
                self.windows[number].append(window)
                for job in range(jobs):
                    begin = piece.start + job * piece.period + window.start
                    self._profiles[resource].add(begin, window.end - window.start, height)
                return True
        return False

    def _task_at(self, unit: int, instant: int) -> int | None:
        """Return the task that lies at `instant` on `unit` in the filled schedule."""
        for number in self._on_unit[unit]:
            piece = self._pieces[number]
            if (instant - piece.start) % piece.period < piece.length:
                return number
        return None

    def _fit(self, number: int, resource: int, height: int, wish: int, wanted: int) -> Window | None:
        """Return the window nearest to `wish` that is free in all jobs, long as `wanted` where possible."""
        length = self._lengths[number]
        least = min(wanted, max(1, length // 20))
        gaps = [(low, high) for low, high in self._gaps(number, resource, height) if high - low >= least]
        if not gaps:
            return None

        def preference(gap: tuple[int, int]) -> tuple[int, int]:
            low, high = gap
            size = min(wanted, high - low)
            return wanted - size, abs(min(max(wish, low), high - size) - wish)

        low, high = min(gaps, key=preference)
        size = min(wanted, high - low)
        start = min(max(wish, low), high - size)
        return Window(resource, start, start + size, height)

    def _gaps(self, number: int, resource: int, height: int) -> Iterator[tuple[int, int]]:
        """Yield the parts of a task where all of its jobs leave room for `height`, without its own windows there."""
        piece, length = self._pieces[number], self._lengths[number]
        taken = [(window.start, window.end) for window in self.windows[number] if window.resource == resource]
        for start in range(piece.start, self._hyperperiod + piece.start, piece.period):
            taken += self._profiles[resource].blocked(start, length, height)
        free = 0
        for low, high in sorted(taken):
            if low > free:
                yield free, low
            free = max(free, high)
        if free < length:
            yield free, length
