"""Rectangles that have to fill a board, such as gangs on units or shares of a resource: see `native/boards.c`."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.libraries import library
from halpipe.pipeline.solve.integers import filled, ints
from halpipe.pipeline.solve.kernel.library import INTEGER, words

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.pipeline.solve.draws import Draws

MAX_RECTANGLES = 64
"""On one board."""

MAX_AREA = 2**62
"""Of a board: sums stay within 64 bits."""

TRIES = 2000
"""Rectangles that one filling tries. Of 24 gangs on 8 units (8 sets), 500 to 5000 took about as long in all."""

SHARES = 1000
"""A rectangle's place in the order is its area times a share that is drawn, in so many parts."""


def fill_board(
    rectangles: Sequence[tuple[int, int]],
    height: int,
    length: int,
    draws: Draws,
    fillings: int,
    go_on: Callable[[], bool],
) -> list[int] | None:
    """Return where each rectangle (length, height) begins; None if so many fillings do not find it, or cannot."""
    areas = [long * high for long, high in rectangles]
    spare = height * length - sum(areas)
    if spare < 0 or not 0 < len(rectangles) <= MAX_RECTANGLES or height * length >= MAX_AREA:
        return None
    kinds = ints(rectangles.index(rectangle) for rectangle in rectangles)
    starts = filled(len(rectangles), 0)
    sides = ints(long for long, _ in rectangles), ints(high for _, high in rectangles)
    native = library(Path(__file__).parent / "native", "boards").halpipe_fill_board
    native.restype = INTEGER
    for _ in range(fillings):
        shares = [area * (1 + draws.below(SHARES)) for area in areas]
        order = ints(sorted(range(len(areas)), key=lambda number: (-shares[number], number)))
        board = words([height, length, len(areas), spare, *sides, kinds, order, starts])
        if native(ctypes.byref(board), INTEGER(TRIES)):
            return list(starts)
        if not go_on():
            break
    return None
