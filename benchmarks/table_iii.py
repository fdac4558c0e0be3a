"""The four experiments of Table III of the paper, as parameters of synthetic task sets."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.pipeline.generate import SetParameters

if TYPE_CHECKING:
    from collections.abc import Sequence


class Experiment(NamedTuple):
    """One experiment of Table III: its cells, and the algorithm runtime in seconds that the paper reports."""

    number: int
    varies: str
    cells: tuple[SetParameters, ...]
    paper_seconds: tuple[int, int]


def _experiment(number: int, varies: str, values: Sequence[Any], paper_seconds: tuple[int, int]) -> Experiment:
    """Vary one row of Table III on its platforms. Of ranges that the paper gives by their ends, steps are ours (D)."""
    platforms = itertools.product((2, 3), (Fraction(3, 5), Fraction(7, 10)))
    rows: list[dict[str, Any]] = [{"unit_types": types, "utilisation": share} for types, share in platforms]
    if varies == "tasks":
        rows = [{**row, "multi_version": Fraction(1, 10)} for row in rows]
    if varies == "resources":
        row = {"tasks": 112, "units": 8, "unit_types": 1, "utilisation": Fraction(7, 10)}
        rows = [{**row, "access_windows": windows} for windows in (2, 18, 34, 50)]
    cells = tuple(SetParameters(**{**row, varies: value}) for value in values for row in rows)
    return Experiment(number, varies, cells, paper_seconds)


TABLE_III = (
    _experiment(1, "tasks", (60, 80, 100, 120), (460, 6816)),
    _experiment(2, "multi_version", [Fraction(percent, 100) for percent in (0, 10, 25, 50)], (500, 700)),
    _experiment(3, "precedence", [Fraction(percent, 100) for percent in (0, 20, 40, 60)], (470, 630)),
    _experiment(4, "resources", (1, 2, 3, 4), (240, 400)),
)
"""The parameter grids of Table III; all on 6 units but the last, which has 8."""
