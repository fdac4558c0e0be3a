"""Improving a valid schedule: tighten the problem, search on from the schedule, keep what is found.

The kernel knows validity only. So each wish becomes a tighter problem: a group with one unit less, less slack,
shorter chain limits, jobs that reserve their units for longer. A placement that is valid for the tighter problem is
valid for the stated one too. Every step is an ordinary search with its own small budget; a step that fails
changes nothing. What is found is kept if it is no worse, measured exactly, than the first valid schedule in any
objective, nor than the best so far in those that come first.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record
from halpipe.pipeline.measure.margins import largest_margin
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import optimise
from halpipe.pipeline.solve.integers import Table, ints
from halpipe.pipeline.solve.kernel.assign_units import Units, deal
from halpipe.pipeline.solve.kernel.kernel import (
    BEST,
    FROZEN,
    FROZEN_HINT,
    MOVES,
    NEVER,
    State,
    bound,
    load,
    new_state,
)
from halpipe.pipeline.solve.kernel.slices import run
from halpipe.pipeline.solve.kernel.widen import following, margins, reserved
from halpipe.pipeline.solve.optimise import chain_bounds, stages_of
from halpipe.pipeline.solve.problem import NO_TICK

if TYPE_CHECKING:
    from halpipe.models import Job
    from halpipe.pipeline.measure.objectives import Judge, Worth
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.slices import OnSlice
    from halpipe.pipeline.solve.optimise import Polish
    from halpipe.pipeline.solve.problem import Arrays, Problem

CHAIN_STEPS = (8, 64)
"""Latencies are asked to shrink by one part in so many at a time."""

TRIFLE = 1000
"""A round of wishes that brings all latencies together down by less than one part in so many is the last."""

JITTERY = 32
"""Tasks whose jitter is looked at one by one, those with the most first."""

PLACED = ("best_start", "best_option", "phase")
"""What a step that was granted leaves to the next."""


Named = Callable[["Problem", State, Units], "tuple[Job, ...]"]


@dataclass(slots=True)
class _Best:
    """The best placement so far, for the tightest problem it is valid for, and what it is worth."""

    problem: Problem
    state: State
    units: Units
    jobs: tuple[Job, ...]
    worth: Worth

    @property
    def arrays(self) -> Arrays:
        """The arrays of the problem."""
        return self.problem.arrays

    def tighten(self, **columns: Any) -> None:
        """Tighten the problem to what the placement keeps already."""
        self.problem = replace(self.problem, arrays=replace(self.arrays, **columns))


class Improvement:
    """One improvement: the first and the best placement, the moves made, and whether it was stopped."""

    def __init__(self, best: _Best, polish: Polish, on_slice: OnSlice, named: Named) -> None:
        self.best, self.first, self.plain = best, best.worth, best.arrays
        self.polish, self.on_slice, self.named = polish, on_slice, named
        self.moves, self.stopped = 0, False

    def run(self, kept: Kept | None) -> bool:
        """Grant one wish after the other; return whether it was stopped."""
        number = 0
        for stage, leading in stages_of(self.polish.judge.objectives):
            steps = _wishes(self.best, self.plain, stage, self.polish)
            granted = None
            while (arrays := following(steps, granted)) is not None:
                if self.polish.is_enough(self.best.jobs):
                    return False
                step = kept and kept.stage(f"step{number}")
                found = self._recalled(arrays, step) or self._searched(arrays, step)
                self.moves, number = self.moves + found.moves, number + 1
                if found.stopped:
                    return True
                granted = self._take(found, arrays, leading)
        return False

    def _take(self, found: _Step, arrays: Arrays, leading: int) -> bool:
        """Make what was found the best placement, unless it is worse in what counts."""
        if found.placed is None:
            return False
        state, units = found.placed
        problem = replace(self.best.problem, arrays=arrays)
        jobs = self.named(problem, state, units)
        worth = self.polish.judge.worth(jobs)
        is_worse = worth.values[:leading] > self.best.worth.values[:leading]
        if is_worse or not self.polish.judge.keeps(self.first, worth):
            return False
        best = self.best
        best.problem, best.state, best.units, best.jobs, best.worth = problem, state, units, jobs, worth
        self.polish.on_better(worth)
        return True

    def _searched(self, arrays: Arrays, kept: Kept | None) -> _Step:
        """Search on under tighter arrays."""
        problem, before = replace(self.best.problem, arrays=arrays), self.best.state
        state = self._fresh(problem)
        state.start[:], state.option[:], state.phase[:] = before.best_start, before.best_option, before.phase
        _fit_slack(arrays, state)
        load(arrays, state)
        budget = self.polish.budget * len(arrays.entry_offset)
        if kept is not None:
            kept.restore(state)
        stopped = run(arrays, state, budget, lambda moves, _: self.on_slice(self.moves + moves, 0), kept)
        units = deal(problem, state.best_start, state.best_option) if state.register[BEST] == 0 else None
        if kept is not None and not stopped:
            placed = {} if units is None else {name: getattr(state, name) for name in PLACED}
            kept.note({"moves": state.register[MOVES : MOVES + 1], **placed})
        return _Step(None if units is None else (state, units), state.register[MOVES], stopped)

    def _fresh(self, problem: Problem) -> State:
        """Return an empty state in which what was frozen still is."""
        state, before = new_state(problem.arrays, self.polish.seed, problem.mean_wcet), self.best.state
        state.hint[:] = ints(FROZEN_HINT if hint == FROZEN_HINT else -1 for hint in before.hint)
        state.register[FROZEN] = before.register[FROZEN]
        return state

    def _recalled(self, arrays: Arrays, kept: Kept | None) -> _Step | None:
        """Return what this step found in an earlier run; None if it did not end."""
        facts = kept and kept.noted()
        if not facts:
            return None
        if PLACED[0] not in facts:
            return _Step(None, facts["moves"][0], stopped=False)
        problem = replace(self.best.problem, arrays=arrays)
        state = self._fresh(problem)
        for name in PLACED:
            getattr(state, name)[:] = facts[name]
        state.register[BEST] = 0
        units = deal(problem, state.best_start, state.best_option)
        assert units is not None, "units were assigned before"
        return _Step((state, units), facts["moves"][0], stopped=False)


@record
class _Step:
    """Result of one search: the placement, if any."""

    placed: tuple[State, Units] | None
    moves: int
    stopped: bool


def improve(
    problem: Problem, state: State, units: Units, polish: Polish, on_slice: OnSlice, named: Named, kept: Kept | None
) -> Improvement:
    """Grant one wish after the other; the steps of an earlier run that were `kept` are not searched again."""
    jobs = named(problem, state, units)
    best = _Best(problem, state, units, jobs, polish.judge.worth(jobs))
    polish.first[:] = polish.first or [best.worth]
    improvement = Improvement(best, polish, on_slice, named)
    improvement.stopped = improvement.run(kept)
    return improvement


def _fit_slack(arrays: Arrays, state: State) -> None:
    """Pull jobs that are later than the (tightened) slack allows back to where it ends."""
    for first, last in pairwise(arrays.entry_job):
        task = arrays.job_task[first]
        if state.hint[arrays.job_entry[first]] == FROZEN_HINT:
            continue
        base = _base(arrays, state.phase, first, last)
        for number, job in enumerate(range(first, last)):
            phase = min(state.phase[job], base + arrays.option_late[state.option[job]])
            state.phase[job] = phase
            state.start[job] = (phase + number * arrays.task_period[task]) % arrays.hyperperiod


def _base(arrays: Arrays, phase: Ints, first: int, last: int) -> int:
    """Return from where the delays of jobs [first, last) count: the task's offset, or the earliest of them."""
    offset = arrays.entry_offset[arrays.job_entry[first]]
    return offset if offset >= 0 else min(phase[first:last])


# ------------------------------------------------------------------------------------------------ wishes

Wishes = Generator["Arrays", "bool | None", None]
"""Yields tighter arrays one after the other; it is sent whether a placement was found for the last ones."""


def _wishes(best: _Best, plain: Arrays, stage: str, polish: Polish) -> Wishes:
    """Hold what other objectives have reached, and ask for more of one; `plain` are the arrays of the first problem."""
    judge = polish.judge
    if Objective.CHAINS in judge.objectives and stage != Objective.CHAINS:
        best.tighten(chain_limit=_limits(_latencies(best)))
    if Objective.JITTER in judge.objectives and stage != Objective.JITTER:
        best.tighten(option_late=_lateness(best, _delays(best)))
    if Objective.MARGIN in judge.objectives and stage != Objective.MARGIN:
        margin = -best.worth.values[judge.objectives.index(Objective.MARGIN)]
        best.problem = reserved(best.problem, margin, plain)
    match stage:
        case optimise.UNITS:
            yield from _fewer_units(best)
        case optimise.DELAYS:
            yield from _less_slack(best)
        case Objective.CHAINS:
            least = [
                [ceil(ns / best.problem.tick.ns) for ns in pair]
                for _, pair in chain_bounds(judge.model, judge.expansion)
            ]
            yield from _shorter_chains(best, plain, judge.chain_weights, least)
        case Objective.JITTER:
            yield from _less_jitter(best)
        case Objective.MARGIN:
            yield from _more_margin(best, plain, judge)


def _fewer_units(best: _Best) -> Wishes:
    for group in range(len(best.problem.groups)):
        while best.arrays.lane_capacity[group] > 0:
            capacity = best.arrays.lane_capacity[:]
            capacity[group] -= 1
            if not (yield replace(best.arrays, lane_capacity=capacity)):
                break


def _less_slack(best: _Best) -> Wishes:
    late = best.arrays.option_late
    for part in (0, 1, 2, 3):
        less = ints(delta * part // 4 for delta in late)
        if any(late) and (yield replace(best.arrays, option_late=less)):
            break


# ---- chains


def _shorter_chains(best: _Best, ceiling: Arrays, weights: tuple[int, ...], least: list[list[int]]) -> Wishes:
    """Ask for less of all latencies at once, then for less of one while others give back a part of what it wins.

    None is asked for that is less than the `least` that can be. Rounds go on while they bring down the
    weighted sum by more than a trifle: chains that trade single ticks could go on for as many rounds as there are
    ticks.
    """

    def total() -> int:
        now = _latencies(best)
        return sum(weights[chain] * now[chain][kind] for chain, kind in every)

    every = [(chain, kind) for chain, pair in enumerate(_latencies(best)) for kind in (0, 1) if pair[kind] < NEVER]
    asked: set[tuple[int, ...]] = set()
    for parts in CHAIN_STEPS if every else ():
        before = None
        while before is None or (before - total()) * TRIFLE > before:
            before = total()
            yield from _while_granted(best, partial(_all_shorter, best, least, parts), asked)
            for entry in sorted(every, key=lambda at: -weights[at[0]] * _latencies(best)[at[0]][at[1]]):
                traded = partial(_traded, best, ceiling, weights, least, entry, parts)
                yield from _while_granted(best, traded, asked)


def _while_granted(best: _Best, limits: Callable[[], Table | None], asked: set[tuple[int, ...]]) -> Wishes:
    """Ask again and again for such limits, but for none twice."""
    while (wanted := limits()) is not None and tuple(wanted.flat) not in asked:
        asked.add(tuple(wanted.flat))
        if not (yield replace(best.arrays, chain_limit=wanted)):
            break


def _all_shorter(best: _Best, least: list[list[int]], parts: int) -> Table | None:
    """Return limits that are shorter by a part each; None if no chain can be shorter."""
    now = _latencies(best)
    shorter = [
        [max(low, time - max(1, time // parts)) for time, low in zip(*pairs, strict=True)]
        for pairs in zip(now, least, strict=True)
    ]
    wanted = _limits(shorter)
    return wanted if wanted.flat != _limits(now).flat else None


def _traded(
    best: _Best,
    ceiling: Arrays,
    weights: tuple[int, ...],
    least: list[list[int]],
    entry: tuple[int, int],
    parts: int,
) -> Table | None:
    """Shorten one latency by a part; what that wins, less one, the others may grow by together, up to the ceiling."""
    latencies = _latencies(best)
    chain, kind = entry
    win = min(max(1, latencies[chain][kind] // parts), latencies[chain][kind] - least[chain][kind])
    if win <= 0:
        return None
    others = max(1, 2 * len(latencies) - 1)
    for other, pair in enumerate(latencies):
        give = max(0, weights[chain] * win - 1) // (max(1, weights[other]) * others)
        for place, time in enumerate(pair):
            most = ceiling.chain_limit[other, place]
            pair[place] = min(time + give, most) if most != NO_TICK else time + give
    latencies[chain][kind] = _latencies(best)[chain][kind] - win
    return _limits(latencies)


def _latencies(best: _Best) -> list[list[int]]:
    """Return the worst reaction time and data age of every chain in the best placement, in ticks, or NEVER."""
    arrays, state = best.arrays, best.state
    measures = [bound(name, arrays, state) for name in ("worst_reaction", "worst_age")]
    return [[measure(chain) for measure in measures] for chain in range(len(arrays.chain_limit))]


def _limits(latencies: list[list[int]]) -> Table:
    """Return limits; a chain that carries no data to its end cannot be limited."""
    return Table.of(([time if time < NEVER // 2 else NO_TICK for time in pair] for pair in latencies), 2)


# ---- jitter


def _less_jitter(best: _Best) -> Wishes:
    """Ask for less delay of all jobs, then task by task for none, or half."""
    delays = _delays(best)
    for part in (0, 1, 2, 3):
        less = [delay * part // 4 for delay in delays]
        if any(delays) and (yield replace(best.arrays, option_late=_lateness(best, less))):
            break
    delays = _delays(best)
    for task in sorted(range(len(delays)), key=lambda task: -delays[task])[:JITTERY]:
        for part in (0, 1):
            now = _delays(best)
            less = [delay * part // 2 if place == task else delay for place, delay in enumerate(now)]
            if now[task] and (yield replace(best.arrays, option_late=_lateness(best, less))):
                break


def _delays(best: _Best) -> list[int]:
    """Return for every task the largest delay of its jobs."""
    arrays, delays = best.arrays, [0] * len(best.arrays.task_period)
    for first, last in pairwise(arrays.entry_job):
        base = _base(arrays, best.state.phase, first, last)
        delays[arrays.job_task[first]] = max(best.state.phase[first:last]) - base
    return delays


def _lateness(best: _Best, delays: list[int]) -> Ints:
    """Return the lateness of all options where the jobs of each task may be delayed by so much."""
    late, arrays = best.arrays.option_late[:], best.arrays
    for task, delay in enumerate(delays):
        for option in range(arrays.task_option[task], arrays.task_option[task + 1]):
            late[option] = min(late[option], delay)
    return late


# ---- margin


def _more_margin(best: _Best, plain: Arrays, judge: Judge) -> Wishes:
    """Ask for jobs that reserve their units for longer, see `margins`."""
    now, most = (
        -best.worth.values[judge.objectives.index(Objective.MARGIN)],
        largest_margin(judge.expansion, judge.model),
    )
    asked, granted = margins(now, most), None
    while (margin := following(asked, granted)) is not None:
        granted = yield reserved(best.problem, margin, plain).arrays
