"""Wider schedules: searches from nothing in which every job reserves its units for longer than its WCET.

To begin again takes milliseconds; to move the jobs of a dense schedule apart takes a hundred times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record
from halpipe.pipeline.solve.integers import ints
from halpipe.pipeline.solve.kernel.slices import FIRST_STAGE

if TYPE_CHECKING:
    from collections.abc import Generator

    from halpipe.models import Job
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.kernel.search import Outcome
    from halpipe.pipeline.solve.kernel.slices import OnSlice
    from halpipe.pipeline.solve.problem import Arrays, Problem

STEP, FIRST = Fraction(1, 64), Fraction(1, 8)
"""Margins are tried in such steps; a larger one at first, since most systems have it."""

ROUNDS = (30, 300)
"""Moves per task for one margin, or tenths of tables of preemptive jobs: few at first, for what is found easily."""

LATER_ROUNDS = (3000, *(10_000,) * 8)
"""More rounds where a margin is asked for, each from another seed: a search that succeeds does so early."""

FINEST = 128
"""In them, margins are tried until the gap is such a part of the largest possible one."""

Run = Callable[[int, "OnSlice"], "Outcome"]
"""A search of so many moves."""

Begin = Callable[[Fraction, int, "Kept | None"], Run]
"""Returns the search for a margin in a round; it continues what is kept of it from an earlier run."""


@record
class Wider:
    """The jobs with the largest margin that was found, if any, that margin, the moves made, and whether to stop."""

    jobs: tuple[Job, ...] | None
    margin: Fraction
    moves: int
    stopped: bool


NO_WIDER = Wider(None, Fraction(0), 0, stopped=False)


def widened(
    begin: Begin,
    unit: int,
    wanted: tuple[Fraction, Fraction],
    moves: int,
    on_slice: OnSlice,
    kept: Kept | None,
    rounds: tuple[int, ...] = ROUNDS,
) -> Wider:
    """Search in so many moves for margins above the first one `wanted`, up to the second; a `unit` of each round."""
    jobs: tuple[Job, ...] | None = None
    (first, most), made, tries = wanted, 0, 0
    for number, each in enumerate(rounds):
        asked, granted = (margins if number < len(ROUNDS) else halves)(first, most), None
        while made < moves and (margin := following(asked, granted)) is not None:
            stage = kept and kept.stage(f"margin{tries}")
            tries += 1
            if failed := stage and stage.stage(FIRST_STAGE).noted():
                made, granted = made + failed["moves"][0], False
                continue
            tell = lambda now, _, before=made: on_slice(before + now, 0)  # noqa: E731
            outcome = begin(margin, number, stage)(min(each * unit, moves - made), tell)
            made, granted = made + outcome.moves, not outcome.cost
            if outcome.stopped:
                return Wider(jobs, first, made, stopped=True)
            if granted:
                jobs, first = outcome.jobs, margin
            elif stage:
                stage.stage(FIRST_STAGE).note({"moves": ints([outcome.moves])})
    return Wider(jobs, first, made, stopped=False)


def margins(found: Fraction, most: Fraction) -> Generator[Fraction, bool | None, None]:
    """Yield margins to try up to `most`: larger by twice the step while they are granted, then by halves of the gap."""
    step = FIRST
    while found < most and (yield min(found + step, most)):
        found, step = found + step, 2 * step
    while step > STEP and found < most:
        step /= 2
        if (yield min(found + step, most)):
            found += step


def halves(found: Fraction, most: Fraction) -> Generator[Fraction, bool | None, None]:
    """Yield the middle between the largest margin that was granted and the least that was not, as `most` is assumed."""
    beyond, least = most, most / FINEST
    while beyond - found > least:
        middle = (found + beyond) / 2
        if (yield middle):
            found = middle
        else:
            beyond = middle


def following(steps: Generator[Any, bool | None, None], granted: bool | None) -> Any:
    """Say what became of the last wish, and return the next; None at the end."""
    try:
        return steps.send(granted)
    except StopIteration:
        return None


def reserved(problem: Problem, margin: Fraction, plain: Arrays) -> Problem:
    """Return the problem with `plain` rectangles in which every job keeps its units longer than its WCET."""
    rect = plain.rect.copy()
    for number, (lane, _, length, _) in enumerate(plain.rect):
        if lane < len(problem.groups):
            rect[number, 2] = min(length + ceil(length * margin), plain.hyperperiod)
    return replace(problem, arrays=replace(problem.arrays, rect=rect))
