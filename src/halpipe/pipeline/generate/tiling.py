"""Fill the hyperperiod of every unit with tasks (paper, section VI-B).

"N_T/N_U random time periods for each execution unit, totaling t_P. For half of these tasks [...] two start times with
a distance of t_P/2, for a quarter three with t_P/3, for the last quarter one start time."

(D) To total t_P exactly, a unit's time is folded into six sextants of t_P/6. At one instant of the fold, a task with
two start times takes two opposite sextants, one with three takes every second, one with a single start takes one. As
two opposite sextants always meet every second one, an instant holds up to three pairs or up to two triples, and single
tasks in what is left: a *band*. Bands of random widths follow each other; what lies at the same sextants in a band is
a column, and a column is cut into one or more tasks. The whole is turned by a random instant for each unit.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left, bisect_right
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.records import record
from halpipe.pipeline.generate.parameters import SEXTANTS, TICK, TOO_SHORT, SetParameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from random import Random


Counts = tuple[int, int, int]
"""How many tasks have one, two and three start times."""

_BANDS = ((0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (0, 2))
"""The kinds of band: how many pairs of opposite sextants, and how many triples of every second sextant."""

_MOST_OF_A_KIND = 2


@record
class Piece:
    """A task as it lies in the filled schedule: the first of its starts, one in every `period`, and its length."""

    units: tuple[int, ...]
    period: int
    start: int
    length: int


@record
class _Column:
    """Column that starts `starts` times, first in `sextant`, and is `length` sextants long each time."""

    starts: int
    sextant: int
    length: int = 1


def unit_types(parameters: SetParameters) -> list[int]:
    """Return the type of every unit; types are of equal size, as far as they can be, and lie side by side (D)."""
    return [unit * parameters.unit_types // parameters.units for unit in range(parameters.units)]


def fill_units(parameters: SetParameters, rng: Random) -> list[Piece]:
    """Return the tasks that fill the units' time."""
    if parameters.periods:
        return _columns_of_periods(parameters, rng)
    hyperperiod = int(parameters.span / TICK)
    counts = _counts(parameters)
    crews = _crews(parameters)
    doubles = [sum(sum(counts[unit]) for unit in crew) if len(crew) == 2 else 0 for crew in crews]
    gangs = _spread(round(parameters.gang * parameters.tasks), doubles)
    pieces: list[Piece] = []
    for crew, gang in zip(crews, gangs, strict=True):
        filled = _fill_crew(crew, [counts[unit] for unit in crew], gang, hyperperiod, rng)
        turn = rng.randrange(hyperperiod)
        pieces += [replace(piece, start=(piece.start + turn) % piece.period) for piece in filled]
    return pieces


# ------------------------------------------------------------------------------------------------ how many


def _counts(parameters: SetParameters) -> list[Counts]:
    """Return every unit's tasks by number of starts: of four tasks, one has one, two have two and one has three.

    (D) They are counted on from unit to unit, so that half and quarter come out over the whole set.
    """
    counts: list[Counts] = []
    before = 0
    for unit in range(parameters.units):
        after = before + parameters.tasks // parameters.units + (unit < parameters.tasks % parameters.units)
        two, three = after // 2 - before // 2, (after + 1) // 4 - (before + 1) // 4
        counts.append((after - before - two - three, two, three))
        before = after
    return counts


def _crews(parameters: SetParameters) -> list[tuple[int, ...]]:
    """Return the units that are filled together: each alone, but with gang tasks two of a type where there are two."""
    if not parameters.gang:
        return [(unit,) for unit in range(parameters.units)]
    types = unit_types(parameters)
    crews: list[tuple[int, ...]] = []
    for kind in range(parameters.unit_types):
        members = [unit for unit, own in enumerate(types) if own == kind]
        crews += [tuple(members[at : at + 2]) for at in range(0, len(members), 2)]
    return crews


def _spread(total: int, weights: Sequence[int]) -> list[int]:
    """Share `total` out in proportion to `weights`, in whole numbers."""
    sums = list(itertools.accumulate(weights, initial=0))
    marks = [total * part // max(1, sums[-1]) for part in sums]
    return [after - before for before, after in itertools.pairwise(marks)]


# ------------------------------------------------------------------------------------------------ one unit, or two


def _fill_crew(
    crew: tuple[int, ...], counts: list[Counts], gang: int, hyperperiod: int, rng: Random
) -> Iterator[Piece]:
    """Fill one unit, or two of which the first part of every sextant is common: there lie the gang tasks.

    (D) Gang tasks have two start times each, and the other tasks of the two units make up for it.
    """
    fold = hyperperiod // SEXTANTS
    if not gang:
        for unit, own in zip(crew, counts, strict=True):
            yield from _fill((unit,), own, 0, fold, hyperperiod, rng)
        return
    one, two, three = (sum(column) for column in zip(*counts, strict=True))
    gang = min(gang, two)
    common = fold * 2 * gang // (gang + one + two + three)
    yield from _fill(crew, (0, gang, 0), 0, common, hyperperiod, rng)
    rest = (one, two - gang, three)
    halves = [tuple((count + place) // 2 for count in rest) for place in (1, 0)]
    for unit, (a, b, c) in zip(crew, halves, strict=True):
        yield from _fill((unit,), (a, b, c), common, fold, hyperperiod, rng)


def _fill(
    units: tuple[int, ...], counts: Counts, begin: int, end: int, hyperperiod: int, rng: Random
) -> Iterator[Piece]:
    """Fill the part of every sextant from `begin` to `end` with tasks."""
    if not sum(counts):
        return
    fold = hyperperiod // SEXTANTS
    bands = _columns(rng.choice(_structures(counts, alone=end - begin == fold)), alone=end - begin == fold)
    loads = _deal(bands, counts, rng)
    weights = [(1 + 600 * sum(load) // len(load)) * rng.randrange(50, 151) for load in loads]
    at = begin
    for columns, load, width in zip(bands, loads, _cut(end - begin, weights), strict=True):
        turn = rng.randrange(SEXTANTS)
        for column, tasks in zip(columns, load, strict=True):
            # A column longer than one sextant lies in the only band, so its sextants follow each other without a gap.
            start = (column.sextant + turn) % SEXTANTS * fold + at
            for length in _cut(width * column.length, [rng.randrange(50, 151) for _ in range(tasks)]):
                yield Piece(units, hyperperiod // column.starts, start, length)
                start += length
        at += width


def _deal(bands: list[list[_Column]], counts: Counts, rng: Random) -> list[list[int]]:
    """Return how many tasks each column of each band is cut into: at least one, as far as there are enough tasks."""
    loads = [[0] * len(columns) for columns in bands]
    for starts, count in enumerate(counts, 1):
        places = [(b, c) for b, band in enumerate(bands) for c, column in enumerate(band) if column.starts == starts]
        rng.shuffle(places)
        chosen = places[:count]
        if places:
            chosen += [places[rng.randrange(len(places))] for _ in range(count - len(chosen))]
        for band, column in chosen:
            loads[band][column] += 1
    return loads


def _cut(length: int, weights: Sequence[int]) -> list[int]:
    """Cut `length` into parts in proportion to `weights`, none of them shorter than one tick."""
    marks = [length * part // sum(weights) for part in itertools.accumulate(weights, initial=0)] if weights else []
    parts = [after - before for before, after in itertools.pairwise(marks)]
    if parts and min(parts) < 1:
        help = "give a longer hyperperiod, or fewer tasks for each unit"
        raise HalpipeError(TOO_SHORT(f"{len(parts)} tasks do not fit into {TICK * length}", help=help))
    return parts


# ------------------------------------------------------------------------------------------------ bands


@cache
def _structures(counts: Counts, *, alone: bool) -> tuple[tuple[int, ...], ...]:
    """Return how often each kind of band can occur so that these tasks leave no column empty, or the fewest."""
    gaps: dict[tuple[int, ...], int] = {}
    for times in itertools.product(range(_MOST_OF_A_KIND + 1), repeat=len(_BANDS)):
        columns = [column.starts for band in _columns(times, alone=alone) for column in band]
        found = [columns.count(starts) for starts in (1, 2, 3)]
        if all(have or not need for have, need in zip(found, counts, strict=True)):
            missing = (max(0, have - need) for have, need in zip(found, counts, strict=True))
            gaps[times] = sum(starts * gap for starts, gap in enumerate(missing, 1))
    least = min(gaps.values())
    return tuple(times for times, gap in gaps.items() if gap == least)


@cache
def _columns(times: tuple[int, ...], *, alone: bool) -> list[list[_Column]]:
    """Return the columns of every band; `alone` where the bands take whole sextants."""
    chosen = [kind for kind, count in zip(_BANDS, times, strict=True) for _ in range(count)]
    bands = []
    for pairs, triples in chosen:
        columns = [_Column(2, sextant) for sextant in range(pairs)] + [
            _Column(3, sextant) for sextant in range(triples)
        ]
        taken = {(c.sextant + n * SEXTANTS // c.starts) % SEXTANTS for c in columns for n in range(c.starts)}
        free = [sextant for sextant in range(SEXTANTS) if sextant not in taken]
        merged = alone and len(chosen) == 1
        bands.append(columns + (list(_runs(free)) if merged else [_Column(1, sextant) for sextant in free]))
    return bands


def _runs(sextants: Iterable[int]) -> Iterator[_Column]:
    """Join single sextants that follow each other: a task with one start time may be longer than a sextant."""
    free = sorted(sextants)
    run: list[int] = []
    for sextant in free:
        if run and sextant != run[-1] + 1:
            yield _Column(1, run[0], len(run))
            run = []
        run.append(sextant)
    if run:
        yield _Column(1, run[0], len(run))


# ------------------------------------------------------------------------------------------------ stated periods


def _columns_of_periods(parameters: SetParameters, rng: Random) -> list[Piece]:
    """Place one task for each stated period (D).

    Two strictly periodic tasks can share a unit only if their lengths together are at most the greatest common divisor
    of their periods. So the divisor of a unit's periods is cut into one column for each of its tasks, and every task
    goes to the unit that would give it the widest one.
    """
    periods = [int(period / TICK) for period in parameters.periods]
    rng.shuffle(periods)
    members: list[list[int]] = [[] for _ in range(parameters.units)]
    for period in periods:
        widths = [math.gcd(period, *own) // (len(own) + 1) for own in members]
        members[widths.index(max(widths))].append(period)
    pieces = []
    for unit, own in enumerate(members):
        width = math.gcd(*own)
        turn = rng.randrange(width) if own else 0
        lengths = _cut(width, [rng.randrange(50, 151) for _ in own])
        for period, length in zip(own, lengths, strict=True):
            start = turn + width * rng.randrange(period // width)
            pieces.append(Piece((unit,), period, start % period, length))
            turn += length
    return pieces


# ------------------------------------------------------------------------------------------------ access windows
# "Afterward, we generated the specified amount of access phase starts. If an access phase start was positioned during a
# task with multiple start times, the access window was replicated to all other executions of this task. If necessary,
# other access phases were moved."
#
# (D) A start is a random instant on a random unit; the task that lies there has the window. Its resource is drawn. The
# paper does not state lengths: they lie between 1/20 and 2/5 of the task, with which the resources of Table III are in
# use for about half of the time (between 1/5 and 4/5 of the task with fractional bounds). Where the replicas would take
# more of the resource than there is, the window is moved within the task to the nearest place where they do not,
# shortened to it if need be, or put on another resource; if nothing of that works, another start is drawn. Windows are
# placed on tasks already shortened to the wanted utilisation: shortened later, they could meet again.

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
        self._edges = [0, hyperperiod]
        self._levels = [0]
        self.area = 0

    def blocked(self, begin: int, length: int, room: int) -> Iterator[tuple[int, int]]:
        """Yield the parts of [begin, begin + length), relative to `begin`, that have no `room` left."""
        for low, high, base in self._spans(begin, length):
            for step in range(bisect_right(self._edges, low) - 1, bisect_left(self._edges, high)):
                if self._levels[step] + room > CAPACITY:
                    end = min(high, self._edges[step + 1])
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
        if self._edges[place] != instant:
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
