"""Latencies of chains in simulated tables, on the table's grid where that is exact."""

from __future__ import annotations

import ctypes
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.libraries import INTEGER, words
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.edf.native import function
from halpipe.pipeline.solve.edf.tables import named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Chain
    from halpipe.pipeline.solve.edf.jobs import Plan, Table
    from halpipe.pipeline.solve.edf.works import Mode
    from halpipe.pipeline.solve.integers import Ints

Ticks = int | Fraction
Latency = tuple[Ticks, Ticks]
"""Reaction time and data age."""

NEVER = 2**60
"""Stands for the latency of a chain that carries no data to its end: longer than any."""


class ChainTimes:
    """Measures the chains of a mode all of whose tasks run in it."""

    def __init__(self, mode: Mode, chains: Sequence[Chain]) -> None:
        """Look up the tasks of the chains."""
        self._mode = mode
        number = {work.name: task for task, work in enumerate(mode.works)}
        self.chains = tuple(chain for chain in chains if number.keys() >= set(chain.tasks))
        self._tasks = [[number[name] for name in chain.tasks] for chain in self.chains]
        self._is_exact = natural_tick(mode.expansion) % mode.tick == ZERO and not mode.fixed.jobs

    def of(self, plan: Plan, table: Table) -> list[Latency]:
        """Return the latencies of the chains in a table that is closed; NEVER where no data reach the end."""
        if not self._is_exact:
            return self._named(plan, table)
        members = {task: _Member(table, task) for tasks in self._tasks for task in tasks}
        return [self._of([members[task] for task in tasks]) for tasks in self._tasks]

    def _of(self, members: list[_Member]) -> Latency:
        if any(not member.starts for member in members):
            return NEVER, NEVER
        reaction, age = INTEGER(), INTEGER()
        chain = words(word for member in members for word in member.words)
        cycle = INTEGER(self._mode.hyperperiod)
        pointers = ctypes.byref(reaction), ctypes.byref(age)
        function("latency")(ctypes.byref(chain), INTEGER(len(members)), cycle, *pointers)
        return reaction.value, age.value

    def _named(self, plan: Plan, table: Table) -> list[Latency]:
        placement = Placement.of(self._mode.expansion, named(self._mode, plan, table), self._mode.platform)
        found = chain_latencies(placement, self.chains)
        return [(self._ticks(latency.reaction), self._ticks(latency.age)) for latency in found]

    def _ticks(self, time: Duration | None) -> Ticks:
        return NEVER if time is None else time / self._mode.tick


class _Member:
    """A task of a chain, as the library sees it."""

    def __init__(self, table: Table, task: int) -> None:
        own = slice(table.places[task], table.places[task + 1])
        self.starts, self._ends = table.starts[own], table.ends[own]
        self._first = self.starts.index(min(self.starts)) if self.starts else 0

    @property
    def words(self) -> list[int | Ints]:
        """The fields of the library's struct."""
        return [len(self.starts), self._first, self.starts, self._ends]
