"""First-fit construction of whole tables along chains, which learns from the tasks that found no place.

Tasks are placed in the order of their periods, each after its predecessors in chains and windows, at the first phase at
which the table stays valid. Then the table is built again (Joslin and Clements' squeaky wheel): a task without room
gets a better rank, with all that comes before it; of a chain that took too long, the first task begins later.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.kernel import (
    BEST,
    COST,
    FROZEN,
    FROZEN_HINT,
    INSERTED,
    MOVES,
    NEVER,
    bound,
    total_cost,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.pipeline.solve.kernel.kernel import State
    from halpipe.pipeline.solve.problem import Arrays, Problem

TABLES = 64
"""Tables that are built before the annealer gets its turn."""


@record
class _Refused:
    """A task without a place; `late` tells for its chains by how much they would have to begin later."""

    task: int
    late: dict[int, int]


def construct(problem: Problem, state: State, budget: int, go_on: Callable[[int], bool]) -> bool:
    """Build tables until one is valid, which is then the best of the state; else leave hints to try first.

    The state holds the frozen entries alone, as it does again after a failure. `go_on` gets the entries placed.
    """
    arrays, register = problem.arrays, state.register
    place, remove = bound("fit", arrays, state), bound("remove", arrays, state)
    orders = _Orders.of(arrays)
    movable = len(arrays.entry_offset) - register[FROZEN]
    best: list[tuple[int, int]] = []
    for _ in range(TABLES):
        if register[MOVES] + movable > budget:
            break
        table = _Table(arrays, state, orders, place)
        table.fill()
        register[MOVES] += movable
        if not table.refused and _is_valid(arrays, state):
            return True
        if len(table.placed) > len(best):
            best = [(entry, state.phase[arrays.entry_job[entry]]) for entry in table.placed]
        for entry in table.placed:
            remove(entry)
        if not table.refused or not go_on(register[MOVES]):
            break
        orders.learn(table.refused)
    for entry, phase in best:
        task = arrays.job_task[arrays.entry_job[entry]]
        state.hint[entry] = phase % arrays.task_period[task]
    return False


def _is_valid(arrays: Arrays, state: State) -> bool:
    """Note the complete table as the best one if it costs nothing."""
    register = state.register
    if total_cost(arrays, state):
        return False
    register[INSERTED], register[COST], register[BEST] = len(arrays.entry_offset), 0, 0
    state.best_start[:], state.best_option[:] = state.start, state.option
    return True


# ------------------------------------------------------------------------------------------------ one table


@dataclass(slots=True)
class _Table:
    """One table: where its tasks begin and end, counted on from the first tasks of their chains without wrapping."""

    arrays: Arrays
    state: State
    orders: _Orders
    place: Callable[..., int]
    """Places an entry at the first phase in [earliest, last] that costs nothing; returns the phase, or NEVER."""
    begins: dict[int, int] = field(default_factory=dict)
    ends: dict[int, int] = field(default_factory=dict)
    placed: list[int] = field(default_factory=list)
    refused: list[_Refused] = field(default_factory=list)

    def fill(self) -> None:
        """Place one task after the other."""
        arrays, orders = self.arrays, self.orders
        for task in orders.tasks():
            jobs = range(arrays.task_job[task], arrays.task_job[task + 1])
            if not jobs:
                continue
            since = [self.ends[other] for other in orders.before[task] if other in self.ends]
            earliest = max([orders.delay.get(task, 0), *since])
            found = self._place(task, jobs, earliest)
            if found < NEVER:
                self._note(task, jobs, found)
            else:
                late = self._lateness(task, earliest) if found > NEVER else {}
                self.refused.append(_Refused(task, late))

    def _place(self, task: int, jobs: range, earliest: int) -> int:
        """Place all entries of a task; return the phase of the last one, NEVER without room, or more."""
        arrays, state, found = self.arrays, self.state, NEVER
        for entry in range(arrays.job_entry[jobs[0]], arrays.job_entry[jobs[-1]] + 1):
            if state.hint[entry] == FROZEN_HINT:
                found = state.phase[arrays.entry_job[entry]]
                continue
            found = self._place_entry(entry, earliest, arrays.task_period[task])
            if found >= NEVER:
                break
            self.placed.append(entry)
        return found

    def _place_entry(self, entry: int, earliest: int, period: int) -> int:
        offset, hint = self.arrays.entry_offset[entry], self.state.hint[entry]
        if offset >= 0:
            return self.place(entry, offset, offset)
        if hint >= 0:
            found = self.place(entry, hint, hint)
            if found < NEVER:
                return found
        return self.place(entry, earliest, earliest + period - 1)

    def _note(self, task: int, jobs: range, found: int) -> None:
        arrays, state = self.arrays, self.state
        turns = found - found % arrays.task_period[task]  # a fixed phase has none
        self.begins[task] = found
        self.ends[task] = turns + max(state.phase[job] + arrays.option_wcet[state.option[job]] for job in jobs)

    def _lateness(self, task: int, earliest: int) -> dict[int, int]:
        """Return for the first tasks of the chains of a task by how much they would have to begin later, at least."""
        arrays = self.arrays
        wcet = arrays.option_wcet[arrays.task_option[task]]
        late: dict[int, int] = {}
        for chain in arrays.task_chain[arrays.task_chain_first[task] : arrays.task_chain_first[task + 1]]:
            first = arrays.chain_task[arrays.chain_first[chain]]
            if first == task or first not in self.begins or arrays.entry_offset[self._entry(first)] >= 0:
                continue
            limit = max(next(arrays.chain_limit.rows(chain, chain + 1)))
            excess = earliest + wcet - self.begins[first] - limit
            late[first] = max(late.get(first, 0), excess, wcet)
        return late

    def _entry(self, task: int) -> int:
        return self.arrays.job_entry[self.arrays.task_job[task]]


# ------------------------------------------------------------------------------------------------ orders


@dataclass(slots=True)
class _Orders:
    """The order of the tasks, and how late those may begin that nothing comes before, as both change with failures."""

    arrays: Arrays
    before: list[dict[int, None]]
    """For each task those that come before it in a chain or a window."""
    rank: list[int]
    delay: dict[int, int] = field(default_factory=dict)

    @classmethod
    def of(cls, arrays: Arrays) -> _Orders:
        """Return the order for the first table."""
        before = _before(arrays)
        return cls(arrays, before, _ranks(arrays, before))

    def tasks(self) -> Iterator[int]:
        """Yield all tasks: each after what comes before it, else by rank; a predecessor has the rank of its heirs."""
        count, rank = len(self.before), self._inherited()
        after: list[list[int]] = [[] for _ in range(count)]
        waiting = [len(earlier) for earlier in self.before]
        for task, earlier in enumerate(self.before):
            for other in earlier:
                after[other].append(task)
        heap = [(rank[task], task) for task in range(count) if not waiting[task]]
        heapify(heap)
        done = [False] * count
        rest = iter(sorted(range(count), key=rank.__getitem__))
        for _ in range(count):
            if not heap:  # chains that meet themselves leave no first task
                heap.append(next((rank[task], task) for task in rest if not done[task]))
            task = heappop(heap)[1]
            done[task] = True
            yield task
            for other in after[task]:
                waiting[other] -= 1
                if waiting[other] == 0 and not done[other]:
                    heappush(heap, (rank[other], other))

    def _inherited(self) -> list[int]:
        rank = self.rank[:]
        for task in sorted(range(len(rank)), key=rank.__getitem__):
            open_tasks = [task]
            while open_tasks:
                here = open_tasks.pop()
                for other in self.before[here]:
                    if rank[other] > rank[here]:
                        rank[other] = rank[here]
                        open_tasks.append(other)
        return rank

    def learn(self, refused: list[_Refused]) -> None:
        """Let chains that took too long begin later; give tasks without room, and what is before them, better ranks."""
        for each in refused:
            for first, late in each.late.items():
                self.delay[first] = (self.delay.get(first, 0) + late) % self.arrays.task_period[first]
        self._prefer([each.task for each in refused])

    def _prefer(self, tasks: list[int]) -> None:
        chosen, open_tasks = dict.fromkeys(tasks), list(tasks)
        while open_tasks:
            for other in self.before[open_tasks.pop()]:
                if other not in chosen:
                    chosen[other] = None
                    open_tasks.append(other)
        order = sorted(range(len(self.rank)), key=self.rank.__getitem__)
        place = {task: 2 * number + 1 for number, task in enumerate(order)}
        for task in chosen:
            place[task] = place[task] // 2 & ~1
        for number, task in enumerate(sorted(order, key=place.__getitem__)):
            self.rank[task] = number


def _before(arrays: Arrays) -> list[dict[int, None]]:
    before: list[dict[int, None]] = [{} for _ in arrays.task_period]
    for begin, end in pairwise(arrays.chain_first):
        for earlier, later in pairwise(arrays.chain_task[begin:end]):
            if earlier != later:
                before[later][earlier] = None
    for task, (first, last) in enumerate(pairwise(arrays.task_option)):
        for other, *_ in arrays.row.rows(arrays.row_first[first], arrays.row_first[last]):
            earlier, later = (other, task) if arrays.task_cyclic[other] else (task, other)
            before[later][earlier] = None
    return before


def _ranks(arrays: Arrays, before: list[dict[int, None]]) -> list[int]:
    """Return the ranks of the tasks at first: offsets, then by period, those with others before or after them first."""
    levels = _levels(sorted(set(arrays.task_period)))
    linked = [bool(earlier) for earlier in before]
    for earlier in before:
        for other in earlier:
            linked[other] = True

    def key(task: int) -> tuple[bool, int, int, bool, int, int]:
        period, option, job = arrays.task_period[task], arrays.task_option[task], arrays.task_job[task]
        is_free = job == arrays.task_job[task + 1] or arrays.entry_offset[arrays.job_entry[job]] < 0
        return is_free, levels[period], -period, not linked[task], -arrays.option_wcet[option], task

    rank = [0] * len(before)
    for number, task in enumerate(sorted(range(len(before)), key=key)):
        rank[task] = number
    return rank


def _levels(periods: list[int]) -> dict[int, int]:
    """Return for each period the length of the longest row of periods that divide each other and end with it."""
    levels: dict[int, int] = {}
    for period in periods:
        levels[period] = 1 + max((level for other, level in levels.items() if period % other == 0), default=0)
    return levels
