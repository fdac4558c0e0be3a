"""Replicas of one search at fixed temperatures that change places with their neighbours (parallel tempering).

Sets that leave next to nothing idle have many deep basins. A search that cools falls into one of them, and a new cycle
throws away with it all that was good. Of replicas, the cold ones look through their basins while the hot ones go from
one to another; now and then two with neighbouring temperatures change places, so that what a hot one comes across cools
down, and what leads nowhere heats up. Whether they do is drawn as a heat bath draws it, from the costs of both, in
integers only (Hukushima and Nemoto, 1996, with that rule in place of Metropolis').
"""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, cast

from halpipe.pipeline.solve.kernel.kernel import SIZE, gumbel_table
from halpipe.pipeline.solve.kernel.state import COST, CYCLE, CYCLE_LEFT, CYCLE_LENGTH, HEAT, MOVES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept
    from halpipe.pipeline.solve.kernel.state import State

LADDER = (80, 120, 170, 240, 340, 480, 680, 960)
"""Temperatures, in thousandths of that at which a full cycle begins."""

TURN = 32
"""Moves per task that each replica makes before places are changed."""

FOREVER = 10**12
"""Length of a cycle that does not end, and so hardly cools."""

LATE_CYCLE = 16
"""The number of that cycle: entries change places with others by then."""

FRACTION = 20
"""Fraction bits that costs need, so that temperatures of ten bits divide them into noise of ten bits."""


class Replicas:
    """The replicas, and how they are kept: all at once, between two turns, since each depends on the others."""

    def __init__(self, states: Sequence[State], kept: Kept | None) -> None:
        self._states = states
        self._kept = kept
        for level, state in enumerate(states):
            register = state.register
            register[HEAT] = state.heat * LADDER[level] // 1000 + level + 1  # no two alike, however small
            register[CYCLE] = LATE_CYCLE
            register[CYCLE_LENGTH] = register[CYCLE_LEFT] = FOREVER
        if kept is not None:
            kept.restore(self._joined())

    @property
    def moves(self) -> list[int]:
        """The moves that each has made."""
        return [state.register[MOVES] for state in self._states]

    def change_places(self) -> None:
        """Let neighbours change temperatures, from the coldest up; heat that climbs is soon handed on."""
        colder = sorted((state.register for state in self._states), key=lambda register: register[HEAT])
        draws = {id(state.register): state.random[0] for state in self._states}
        for place in range(len(colder) - 1):
            one, other = colder[place : place + 2]
            if _changes(one, other, draws[id(one)]):
                one[HEAT], other[HEAT] = other[HEAT], one[HEAT]
                colder[place : place + 2] = other, one

    def keep(self, *, now: bool) -> None:
        """Save them when it is time, or `now`."""
        if self._kept is not None:
            self._kept.keep(self._joined(), now=now)

    def _joined(self) -> State:
        """Return what keepers take for one state."""
        return cast("State", _Joined(self._states))


def _changes(one: Ints, other: Ints, drawn: int) -> bool:
    """Tell whether a replica changes places with the next hotter one, by 64 bits that were drawn."""
    cold, hot = one[HEAT], other[HEAT]
    gain = ((one[COST] - other[COST]) * (hot - cold) << FRACTION) // (cold * hot)
    noise = gumbel_table()
    return gain + noise[(drawn >> 16) % SIZE] > noise[(drawn >> 40) % SIZE]


class _Joined:
    """The states of all replicas under the names of one."""

    def __init__(self, states: Sequence[State]) -> None:
        self._states = states

    def __getattr__(self, name: str) -> _Across:
        return _Across(list(map(attrgetter(name), self._states)))


class _Across:
    """Arrays of several states, read and written as one."""

    def __init__(self, arrays: Sequence[Ints]) -> None:
        self._arrays = arrays

    def __len__(self) -> int:
        return sum(map(len, self._arrays))

    def __getitem__(self, _: slice) -> Ints:
        return sum(self._arrays[1:], self._arrays[0][:])

    def __setitem__(self, _: slice, values: Ints) -> None:
        begin = 0
        for array in self._arrays:
            array[:] = values[begin : begin + len(array)]
            begin += len(array)
