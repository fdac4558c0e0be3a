"""The driver of the kernel: runs it in slices, assigns units, and gives the answer its names back."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.assign_units import Units, deal, deal_anyhow
from halpipe.pipeline.solve.kernel.first_fit import construct
from halpipe.pipeline.solve.kernel.kernel import BEST, MOVES, NEVER, State, load, new_state
from halpipe.pipeline.solve.kernel.slices import FIRST_STAGE, run
from halpipe.pipeline.solve.kernel.warmstart import Earlier, freeze, hints, known_first, named_jobs, rename_units
from halpipe.pipeline.solve.problem import SAME_CYCLE, Option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from halpipe.models import Job
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.kernel.slices import OnSlice
    from halpipe.pipeline.solve.optimise import Polish
    from halpipe.pipeline.solve.problem import Problem

NOTHING = Earlier()

MANY_TASKS = 200
"""Tasks from which on moves alone do not order the jobs of one cycle."""


@record
class Outcome:
    """Result of a search: all jobs of the mode, valid if `cost` is zero; `changed` shipped tasks could not stay.

    `unimproved` tells that it was stopped while it improved a valid schedule.
    """

    jobs: tuple[Job, ...]
    cost: int
    moves: int
    stopped: bool
    changed: tuple[str, ...] = ()
    unimproved: bool = False


FRESH_SHARE = 4
"""Of a search that a clock ends, turns are this part of the moves that it makes without one."""

NOT_BEGUN = Outcome((), 1, 0, stopped=False)


class Search:
    """The annealer's search for a valid schedule, trying first where `earlier` modes put the tasks.

    `separate` builds the same problem with one lane per unit; it is needed only where the load of a group of
    units fits, but the jobs cannot be assigned to its units as they lie. `polish` improves a valid one further, and
    comes with what builds the problem with the chains that count for that.
    `shipped` jobs stay where they are. What is `kept` is continued.
    """

    def __init__(
        self,
        problem: Problem,
        separate: Callable[[], Problem],
        seed: int,
        earlier: Earlier = NOTHING,
        polish: tuple[Polish, Callable[[], Problem]] | None = None,
        shipped: Mapping[tuple[str, int], Job] | None = None,
        kept: Kept | None = None,
    ) -> None:
        problem = separate() if shipped else problem
        hint = hints(problem, earlier)
        problem = problem.with_construction(known_first(problem.arrays.construction, hint))
        state = new_state(problem.arrays, seed, problem.mean_wcet)
        state.hint[:] = hint
        self._changed: tuple[str, ...] = ()
        if shipped:
            problem, self._changed = freeze(problem, state, shipped)
        self._problem, self._state, self._separate, self._seed = problem, state, separate, seed
        self._earlier, self._polish, self._is_fixed, self._kept = earlier, polish, bool(shipped), kept
        self._apart: tuple[Problem, State] | None = None
        self._is_begun = False

    def run(self, budget: int, on_slice: OnSlice) -> Outcome:
        """Continue until `budget` moves have been made in all."""
        problem, state = self._problem, self._state
        kept = self._kept and self._kept.stage(FIRST_STAGE)
        stopped = False

        def go_on(made: int) -> bool:
            nonlocal stopped
            stopped = not on_slice(made, -1)
            return not stopped

        if not self._is_begun:
            self._is_begun = True
            is_restored = kept is not None and kept.restore(state)
            if _is_constructed(problem) and not is_restored:
                construct(problem, state, budget, go_on)
        # A construction that was stopped is not kept: what it leads to is another search.
        stopped = stopped or run(problem.arrays, state, budget, on_slice, kept)
        moves = before = state.register[MOVES]
        if state.register[BEST] == NEVER:
            state = _completed(problem, state, self._seed)
        units = deal(problem, state.best_start, state.best_option)
        if units is None and state.register[BEST] == 0:
            rest = self._kept and self._kept.stage("units")
            if self._apart is None:
                self._apart = _apart(problem, state, self._separate(), self._seed)
                if rest is not None:
                    rest.restore(self._apart[1])
            problem, state = self._apart
            on_rest = lambda made, best: on_slice(before + made, best)  # noqa: E731
            stopped = stopped or run(problem.arrays, state, budget - before, on_rest, rest)
            moves += state.register[MOVES]
            units = deal(problem, state.best_start, state.best_option)
        unimproved = False
        if units is not None and state.register[BEST] == 0 and self._polish is not None and not stopped:
            from halpipe.pipeline.solve.kernel.quality import improve

            wish, chained = self._polish
            better = improve(problem.with_chains(chained()), state, units, wish, on_slice, self._named, self._kept)
            best, unimproved = better.best, better.stopped
            problem, state, units = best.problem, best.state, best.units
            moves += better.moves
        units = units or deal_anyhow(problem, state.best_start, state.best_option)
        jobs = self._named(problem, state, units)
        return Outcome(jobs, state.register[BEST], moves, stopped, self._changed, unimproved)

    def _named(self, problem: Problem, state: State, units: Units) -> tuple[Job, ...]:
        return _named(None if self._is_fixed else self._earlier, problem, state, units)


class Turns:
    """A search, and after its first `least` moves short ones that begin anew, in turns with it.

    `begin` makes the search of a number. Some searches are soon over and others stuck, and only the seed decides which.
    """

    def __init__(self, begin: Callable[[int], Search], least: int) -> None:
        self._begin, self._least, self._turn = begin, least, max(1, least // FRESH_SHARE)
        self._made, self._stuck = 0, NOT_BEGUN
        self._first = self._other = begin(0)

    def run(self, budget: int, on_slice: OnSlice) -> Outcome:
        """Continue until `budget` moves have been made in all; without a schedule, return what the first search has."""
        while True:
            turn, inside = divmod(self._made - self._least, self._turn)
            is_first = turn < 0 or turn % 2 == 1
            if not (is_first or inside):
                self._other = self._begin(turn // 2 + 1)
            until = min(budget, self._least + max(0, turn + 1) * self._turn)
            others = max(0, turn + 1) // 2 * self._turn if is_first else self._least + turn * self._turn
            search = self._first if is_first else self._other
            end = search.run(until - others, lambda made, best, others=others: on_slice(others + made, best))  # type: ignore[misc]
            self._made = until
            if is_first or end.cost == 0:
                self._stuck = end
            if end.cost == 0 or end.stopped or until >= budget:
                return replace(self._stuck, stopped=end.stopped, moves=others + end.moves)


def improved(
    problem: Problem,
    jobs: Iterable[Job],
    polish: Polish,
    on_slice: OnSlice,
    earlier: Earlier = NOTHING,
    kept: Kept | None = None,
) -> Outcome | None:
    """Improve a valid schedule that another engine has found; None where the kernel cannot take it over.

    The problem counts the chains that the wishes are about, and its tick divides all starts.
    """
    from halpipe.pipeline.solve.kernel.quality import improve
    from halpipe.pipeline.solve.kernel.warmstart import taken_over

    taken = taken_over(problem, jobs, polish.seed)
    if taken is None:
        return None

    better = improve(problem, *taken, polish, on_slice, partial(_named, earlier), kept)
    return Outcome(better.best.jobs, 0, better.moves, stopped=False, unimproved=better.stopped)


def _named(earlier: Earlier | None, problem: Problem, state: State, units: Units) -> tuple[Job, ...]:
    """Return the jobs of the best placement, on units of the same names as earlier where that is given."""
    renamed = units if earlier is None else rename_units(problem, units, earlier)
    return tuple(named_jobs(problem, state.best_start, state.best_option, renamed))


def _is_constructed(problem: Problem) -> bool:
    """Return whether tables are built up before anything moves: with limited chains, or many windows of one cycle."""
    arrays = problem.arrays
    is_large = len(arrays.task_period) > MANY_TASKS
    return bool(len(arrays.chain_limit)) or (is_large and any(arrays.row.column(SAME_CYCLE)))


def _completed(problem: Problem, state: State, seed: int) -> State:
    """Return a state in which a construction that was cut short is complete: the jobs left start at their offsets."""
    arrays = problem.arrays
    fresh = new_state(arrays, seed, problem.mean_wcet)
    fresh.start[:], fresh.option[:], fresh.phase[:] = state.start, state.option, state.phase
    for job, task in enumerate(arrays.job_task):
        if state.start[job] < 0:
            number = job - arrays.task_job[task] if arrays.task_cyclic[task] else 0
            phase = max(0, arrays.entry_offset[arrays.job_entry[job]])
            fresh.start[job] = (phase + number * arrays.task_period[task]) % arrays.hyperperiod
            fresh.option[job], fresh.phase[job] = arrays.task_option[task], phase
    load(arrays, fresh)
    return fresh


def _apart(problem: Problem, state: State, alone: Problem, seed: int) -> tuple[Problem, State]:
    """Carry a schedule over to the problem with one lane per unit; overlaps are left to the kernel."""
    units = deal_anyhow(problem, state.start, state.option)
    fresh = new_state(alone.arrays, seed + 1, alone.mean_wcet)
    group_of = {names[0]: group for group, names in enumerate(alone.groups)}
    task_option, job_task = alone.arrays.task_option, alone.arrays.job_task
    for job, chosen in enumerate(state.option):
        version = problem.options[chosen].version
        wanted = Option(version, tuple(sorted((group_of[name], 1) for name in units[job])))
        task = job_task[job]
        offered = range(task_option[task], task_option[task + 1])
        same = [n for n in offered if alone.options[n].version == version]  # of large gangs, not every set is offered
        fresh.option[job] = next((n for n in same if alone.options[n] == wanted), same[0])
    fresh.start[:] = state.start
    fresh.phase[:] = state.phase
    load(alone.arrays, fresh)
    return alone, fresh
