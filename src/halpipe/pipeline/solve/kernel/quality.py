"""Improving a valid schedule: tighten the problem, search on from the schedule, keep what is found.

The kernel knows validity only. So each wish becomes a tighter problem: a group with one unit less, less slack, a
shorter chain limit, jobs that reserve their units for longer. A placement that is valid for the tighter problem is
valid for the stated one too. Every step is an ordinary search with its own small budget; a step that fails
changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.pipeline.solve.integers import ints
from halpipe.pipeline.solve.kernel.assign_units import Units, deal
from halpipe.pipeline.solve.kernel.kernel import load, worst_age, worst_reaction
from halpipe.pipeline.solve.kernel.run_in_slices import Kept, OnSlice, run
from halpipe.pipeline.solve.kernel.state import BEST, MOVES, NEVER, State, new_state

if TYPE_CHECKING:
    from halpipe.models import Job
    from halpipe.pipeline.solve.problem import Arrays, Problem

CHAIN_STEP = 8
"""A chain's latency is asked to shrink by one part in so many at a time."""

MARGIN_STEPS = 64
"""WCET margins are tried in steps of one part in so many."""

PLACED = ("best_start", "best_option", "phase")
"""What a step that was granted leaves to the next."""

LARGEST_MARGIN = 100 * MARGIN_STEPS
"""Beyond a hundred times the WCET nobody asks; a job alone on its unit would have no bound."""


@dataclass(frozen=True, slots=True)
class Polish:
    """The goal (see `Quality`), the moves per task and step, the seed, and a test whether the jobs are good enough."""

    quality: str
    budget: int
    seed: int
    is_enough: Callable[[tuple[Job, ...]], bool]


Named = Callable[["Problem", State, Units], "tuple[Job, ...]"]


@dataclass(slots=True)
class _Best:
    """The best placement so far, for the tightest problem it is valid for."""

    problem: Problem
    state: State
    units: Units


@dataclass(frozen=True, slots=True)
class Improved:
    """The improved placement, the problem it is valid for, its units, the moves made, and whether to stop."""

    problem: Problem
    state: State
    units: Units
    moves: int
    stopped: bool


def improve(
    problem: Problem, state: State, units: Units, polish: Polish, on_slice: OnSlice, named: Named, kept: Kept | None
) -> Improved:
    """Grant one wish after the other; the steps of an earlier run that were `kept` are not searched again."""
    best = _Best(problem, state, units)
    wishes = _cost_wishes if polish.quality == "cost" else _margin_wishes
    moves, number, stopped = 0, 0, False
    steps = wishes(best)
    try:
        arrays = next(steps)
        while not stopped and not polish.is_enough(named(best.problem, best.state, best.units)):
            step = kept and kept.stage(f"step{number}")
            granted, made, stopped = _recall(best, arrays, polish, step) or _grant(
                best, arrays, polish, moves, on_slice, step
            )
            moves, number = moves + made, number + 1
            arrays = steps.send(granted)
    except StopIteration:
        pass
    return Improved(best.problem, best.state, best.units, moves, stopped)


def _grant(
    best: _Best, arrays: Arrays, polish: Polish, before: int, on_slice: OnSlice, kept: Kept | None
) -> tuple[bool, int, bool]:
    """Search on under tighter arrays; return whether it worked, the moves made, and whether to stop."""
    problem = replace(best.problem, arrays=arrays)
    state = new_state(arrays, polish.seed, problem.mean_wcet)
    state.start[:], state.option[:], state.phase[:] = best.state.best_start, best.state.best_option, best.state.phase
    _fit_slack(arrays, state)
    load(arrays, state)
    budget = polish.budget * len(arrays.entry_offset)
    stopped = run(problem, state, budget, lambda moves, _: on_slice(before + moves, 0), kept)
    made = state.register[MOVES]
    units = deal(problem, state.best_start, state.best_option) if state.register[BEST] == 0 else None
    if kept is not None and not stopped:
        placed = {} if units is None else {name: getattr(state, name) for name in PLACED}
        kept.note({"moves": state.register[MOVES : MOVES + 1], **placed})
    if units is None:
        return False, made, stopped
    best.problem, best.state, best.units = problem, state, units
    return True, made, stopped


def _recall(best: _Best, arrays: Arrays, polish: Polish, kept: Kept | None) -> tuple[bool, int, bool] | None:
    """Return what `_grant` returned for this step in an earlier run, with the same effect; None if it did not end."""
    facts = kept and kept.noted()
    if not facts:
        return None
    moves = facts["moves"][0]
    if PLACED[0] not in facts:
        return False, moves, False
    problem = replace(best.problem, arrays=arrays)
    state = new_state(arrays, polish.seed, problem.mean_wcet)
    for name in PLACED:
        getattr(state, name)[:] = facts[name]
    state.register[BEST] = 0
    units = deal(problem, state.best_start, state.best_option)
    assert units is not None, "it was dealt before"
    best.problem, best.state, best.units = problem, state, units
    return True, moves, False


def _fit_slack(arrays: Arrays, state: State) -> None:
    """Pull jobs that are later than the (tightened) slack allows back to where it ends."""
    for first, last in pairwise(arrays.entry_job):
        task = arrays.job_task[first]
        if not arrays.task_cyclic[task]:
            continue
        offset = arrays.entry_offset[arrays.job_entry[first]]
        base = offset if offset >= 0 else min(state.phase[first:last])
        for number, job in enumerate(range(first, last)):
            phase = min(state.phase[job], base + arrays.option_late[state.option[job]])
            state.phase[job] = phase
            state.start[job] = (phase + number * arrays.task_period[task]) % arrays.hyperperiod


# ------------------------------------------------------------------------------------------------ wishes

Wishes = Generator["Arrays", bool, None]
"""Yields tighter arrays one after the other; it is sent whether a placement was found for the last ones."""


def _cost_wishes(best: _Best) -> Wishes:
    """Ask for fewer units, then for jobs at their phases, then for shorter chains."""
    for group in range(len(best.problem.groups)):
        while best.problem.arrays.lane_capacity[group] > 0:
            capacity = best.problem.arrays.lane_capacity[:]
            capacity[group] -= 1
            if not (yield best.problem.arrays._replace(lane_capacity=capacity)):
                break
    late = best.problem.arrays.option_late
    for part in (0, 1, 2, 3):
        less = ints(delta * part // 4 for delta in late)
        if any(late) and (yield best.problem.arrays._replace(option_late=less)):
            break
    for chain in range(len(best.problem.arrays.chain_limit)):
        for kind, measure in enumerate((worst_reaction, worst_age)):
            while (latency := _latency(best, chain, measure)) < NEVER:
                limit = best.problem.arrays.chain_limit.copy()
                limit[chain, kind] = latency - max(1, latency // CHAIN_STEP)
                if not (yield best.problem.arrays._replace(chain_limit=limit)):
                    break


def _latency(best: _Best, chain: int, measure: Callable[..., int]) -> int:
    arrays, state = best.problem.arrays, best.state
    first, last = arrays.chain_first[chain], arrays.chain_first[chain + 1]
    return measure(arrays, state, first, last)


def _margin_wishes(best: _Best) -> Wishes:
    """Ask for jobs that reserve their units for longer: double the margin while it works, then halve the gap."""
    plain = best.problem.arrays
    found, step = 0, 1
    while found < LARGEST_MARGIN and (yield _with_margin(plain, best.problem, found + step)):
        found, step = found + step, 2 * step
    while step > 1:
        step //= 2
        if (yield _with_margin(plain, best.problem, found + step)):
            found += step


def _with_margin(plain: Arrays, problem: Problem, margin: int) -> Arrays:
    """Return arrays in which every job keeps its units for `margin` / `MARGIN_STEPS` longer than its WCET."""
    rect = plain.rect.copy()
    for number, (lane, _, length, _) in enumerate(plain.rect):
        if lane < len(problem.groups):
            longer = length + -(-length * margin // MARGIN_STEPS)
            rect[number, 2] = min(longer, plain.hyperperiod)
    return plain._replace(rect=rect)
