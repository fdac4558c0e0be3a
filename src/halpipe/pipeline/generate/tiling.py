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
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.records import record
from halpipe.pipeline.generate.codes import TOO_SHORT
from halpipe.pipeline.generate.parameters import SEXTANTS, TICK, SetParameters

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
    """What starts `starts` times, first in `sextant`, and is `length` sextants long each time."""

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
