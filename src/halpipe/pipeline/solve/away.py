"""Searches that have their moves made on a cluster, and come to the same as here.

A turn is sent in pieces of a second or so. The state of the search goes there, and another one comes back that is taken
over as a whole. So a piece may be done twice, as it is where a machine is lost, and a search that is stopped, or loses
the cluster, is where it was before the piece. Who waits for a piece is a thread here, so that turns, winners and
checkpoints are what they are without a cluster.
"""

from __future__ import annotations

from copy import deepcopy
from functools import partial
from typing import TYPE_CHECKING

from halpipe.pipeline.solve.checkpoint import SAVED
from halpipe.pipeline.solve.kernel.kernel import BEST, MOVES
from halpipe.pipeline.solve.kernel.portfolio import advance, best_of, slice_of
from halpipe.pipeline.solve.workers import Workers

if TYPE_CHECKING:
    from typing import Any

    from halpipe.pipeline.solve.kernel.kernel import State
    from halpipe.pipeline.solve.kernel.portfolio import Advance, Kept, OnSlice
    from halpipe.pipeline.solve.problem import Arrays, Problem
    from halpipe.pipeline.solve.run import Cluster

PIECE = 64
"""Slices of a piece: enough for the way there and back not to count, few enough to be lost."""

WAITING = 64
"""Searches that are under way at the same time; a thread here only waits for each."""


class Away:
    """Place where the searches of one command have their moves made."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self.workers = Workers(WAITING)

    def advancing(self, problem: Problem) -> Advance:
        """Return what advances the searches of a problem, whose arrays are sent once."""
        return partial(self._advance, problem.arrays, self._cluster.hold(problem.arrays))

    def _advance(
        self, arrays: Arrays, held: Any, state: State, bound: int, on_slice: OnSlice, kept: Kept | None
    ) -> bool:
        register = state.register

        def go_on() -> bool:
            return on_slice(register[MOVES], best_of(arrays, state))

        while register[MOVES] < bound:
            end = min(bound, register[MOVES] + PIECE * slice_of(arrays))
            moved = self._cluster.ask(_moved, held, state, end, go_on=go_on)
            if moved is None:
                return True
            for name in SAVED:
                getattr(state, name)[:] = getattr(moved, name)
            if register[BEST] == 0 or register[MOVES] < end:
                return False
            if not go_on():
                return True
            if kept is not None:
                kept.keep(state, now=False)
        return False


def _moved(arrays: Arrays, state: State, bound: int) -> State:
    """Advance a search there. What came stays as it is: a cluster inside this process hands on the very object."""
    own = deepcopy(state)
    advance(arrays, own, bound, lambda *_: True)
    return own
