"""A cold start: the behaviour of a board after power-on with unprepared main memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.deploy.riscv.codes import COLD_START
from halpipe.deploy.riscv.judge.conditions import REPORT
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.deploy.riscv.run.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.machine import Budget
    from halpipe.deploy.riscv.run.plant import Board


class _Witness(Plant):
    """Looks at the buffers when the first table begins, and ends the run then."""

    def __init__(self, buffers: list[str]) -> None:
        self.buffers = buffers
        self.first = ""
        self.full: list[str] = []

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """Note what is there."""
        self.first = table
        self.full = [name for name in self.buffers if any(board.read(name))]
        board.stop()


def cold_start(target: Target, budget: Budget, limit: Duration) -> Iterator[Diagnostic]:
    """Yield what a bundle does otherwise than docs/reference/riscv-bundle.md when it starts by itself."""
    witness = _Witness([])
    simulation = CoSimulation(target, plant=witness, budget=budget)
    witness.buffers = list(simulation.site.buffers)
    simulation.run(limit, is_cold=True)
    first = target.schedule.modes[0].name
    if witness.first != first:
        does = f'"{witness.first}" begins' if witness.first else "no table begins"
        yield COLD_START(f'after a cold start {does}; it has to be "{first}"', help=REPORT)
    for name in witness.full:
        message = "holds after a cold start what the memory held before"
        yield COLD_START(message, path=named("buffer", name), help=REPORT)
