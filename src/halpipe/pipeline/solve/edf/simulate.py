"""Earliest deadline first over parts, on unrolled time, until one hyperperiod repeats the one before it (MODEL 8.3).

What happens from one instant to the next is in `native/edf.c`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.pipeline.solve.edf.native import FIRST_ROOM, LARGEST, Simulation, System, Told
from halpipe.pipeline.solve.limits import too_large

if TYPE_CHECKING:
    from halpipe.pipeline.solve.edf.jobs import Plan, Table
    from halpipe.pipeline.solve.edf.works import Mode, Window

MOST_CYCLES = 8
"""Hyperperiods after which a table that still changes is given up."""


class Simulator:
    """Simulates plans of one mode."""

    def __init__(self, mode: Mode) -> None:
        """Write down the mode; raise `HalpipeError` if its times have too many ticks."""
        self._mode = mode
        self._room = dict(FIRST_ROOM)
        try:
            self._system = System(mode, MOST_CYCLES)
        except OverflowError:
            raise HalpipeError(too_large(mode.expansion, mode.tick)) from None

    def table(self, plan: Plan) -> Table:
        """Return the table that a plan leads to."""
        while True:
            told = Told(self._system, plan, self._room["open"])
            start_up = self._start_up(plan, told)
            simulation = Simulation(self._system, told, self._room)
            closed = self._close(simulation, start_up)
            lacking = simulation.memory.lacks_room
            if not lacking:
                return simulation.table(closed=closed)
            self._room.update((name, 2 * self._room[name]) for name in lacking)

    def _start_up(self, plan: Plan, told: Told) -> int:
        """Return after how many hyperperiods every window has a predecessor to look back at."""
        windows = (window for way in plan.ways for window in way.windows)
        instant = max((earliest_expected(plan, told, window) for window in windows), default=0)
        cycles = -(-instant // self._mode.hyperperiod)
        if (cycles + MOST_CYCLES + 1) * self._mode.hyperperiod > LARGEST:
            raise HalpipeError(too_large(self._mode.expansion, self._mode.tick))
        return cycles

    def _close(self, simulation: Simulation, start_up: int) -> bool:
        """Go on to the first hyperperiod that repeats the one before it; return whether there is one."""
        cycle, closed, end = self._mode.hyperperiod, False, 0
        for turn in range(1, start_up + MOST_CYCLES + 1):
            end = turn * cycle
            simulation.memory.turn(end - cycle, end)
            simulation.run(end)
            repeats = simulation.is_like_before(end, turn)
            closed = turn > start_up and (repeats or (turn == 1 and simulation.is_quiescent(end)))
            if closed or simulation.memory.lacks_room:
                break
        simulation.finish(end)
        return closed


def earliest_expected(plan: Plan, told: Told, window: Window) -> int:
    """Return before when no job may expect a predecessor in a window, since none has run yet."""
    first = told.first_release(window.task)
    if not window.least or first is None:
        return 0
    return first + (plan.ways[window.task].length if window.from_end else 0) + window.least
