"""Gain of each part of the search: systems found and processor time with the part switched off.

    python benchmarks/parts.py                                    every part on every family, five systems each
    python benchmarks/parts.py --part MOVE_SWAP --family "95 %"   one part, one family
    python benchmarks/parts.py --model a.xml --model b.xml        given models in place of families

Each search has a limit of processor time, so that rows of one run can be compared, and those of different machines not.
"""

from __future__ import annotations

import argparse
import time
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from unittest import mock

import chained
from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.native import read_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.solve.kernel import search
from halpipe.pipeline.solve.kernel.kernel import ALL_PARTS, Part, new_state
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from search_benchmark import SUITES
from table_iii import TABLE_III

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.models import TaskModel

CONSTRUCTION = "construction"
PARTS = ("", CONSTRUCTION, *(part.name or "" for part in Part))
HARD = [row for row in SUITES["hard"] if len(row.cells) == 1 and not row.is_open]
FULL = [cell for experiment in TABLE_III for cell in experiment.cells if cell.utilisation >= Fraction(7, 10)]


def row(text: str, seed: int) -> TaskModel:
    """Return the system of a seed of the first row of the hard benchmark with a text in its name."""
    cell = next(each.cells[0] for each in HARD if text in each.name)
    return generate(cell, seed) if isinstance(cell, SetParameters) else cell.draw(seed)


def with_chains(seed: int) -> TaskModel:
    """Return a system with end-to-end limits."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.xml")
        path.write_text(chained.system(150, seed, 0.8), encoding="utf-8")
        return read_model(str(path))


def rigid(seed: int) -> TaskModel:
    """Return a system of rigid chains."""
    cells = next(each.cells for each in SUITES["hard"] if each.name.startswith("rigid"))
    cell = cells[seed % len(cells)]
    assert not isinstance(cell, SetParameters)
    return cell.draw(seed)


FAMILIES: dict[str, Callable[[int], TaskModel]] = {
    "Table III, 70 %": lambda seed: generate(FULL[seed % len(FULL)], seed),
    "144 on 6, 90 %": lambda seed: row("144 tasks on 6, 90 %", seed),
    "144 on 6, 95 %": lambda seed: row("144 tasks on 6, 95 %", seed),
    "fractional": lambda seed: row("fractional", seed),
    "precedence": lambda seed: row("precedence", seed),
    "unlike units": lambda seed: row("no two units alike", seed),
    "80 tasks, 90 %": lambda seed: generate(SetParameters(tasks=80, utilisation=Fraction(9, 10)), seed),
    "rigid chains": rigid,
    "150 tasks, end-to-end": with_chains,
}


@contextmanager
def without(part: str) -> Iterator[None]:
    """Switch a part off."""
    if part == CONSTRUCTION:
        with mock.patch.object(search, "construct", return_value=False):
            yield
    elif not part:
        yield
    else:
        enabled = ALL_PARTS & ~Part[part]
        with mock.patch.object(search, "new_state", lambda arrays, seed, mean: new_state(arrays, seed, mean, enabled)):
            yield


def measured(models: Sequence[TaskModel], part: str, limit: float) -> tuple[int, float]:
    """Return how many systems are found without a part, and the processor time of all."""
    options = SearchOptions(budget=10**7)
    found, spent = 0, 0.0
    with without(part):
        for model in models:
            begin = time.thread_time()
            try:
                found += schedule_model(model, options, lambda *_, b=begin: time.thread_time() - b < limit).is_complete
            except HalpipeError as failure:
                print(failure)
            spent += time.thread_time() - begin
    return found, spent


def main() -> None:
    """Print a line for each family and part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=PARTS[1:], help="switch off this part only; repeatable")
    parser.add_argument("--family", default="", help="only families with this in their names")
    parser.add_argument("--model", action="append", default=[], help="a native model in place of the families")
    parser.add_argument("--systems", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=3000)
    parser.add_argument("--limit", type=float, default=6, help="seconds of the processor for each search")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.systems)
    families = {"given": [read_model(path) for path in chosen.model]} if chosen.model else {
        name: [draw(seed) for seed in seeds] for name, draw in FAMILIES.items() if chosen.family in name
    }  # fmt: skip
    for name, models in families.items():
        for part in ("", *(chosen.part or PARTS[1:])):
            found, spent = measured(models, part, chosen.limit)
            print(f"{name:24} {'without ' + part if part else '':24} {found}/{len(models)} {spent:7.2f} s", flush=True)


if __name__ == "__main__":
    main()
