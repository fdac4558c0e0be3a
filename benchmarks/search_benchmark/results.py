"""From records to a report: success, and the spread of times, for every row."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.files import sha256
from halpipe.core.records import record
from search_benchmark.instance import FAULT, VALID, Instance

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from search_benchmark.suites import Row

    Record = Mapping[str, Any]


@record
class Spread:
    """Least value, quartiles and greatest value of a sample, each of them one of the sample's values."""

    least: int
    low: int
    median: int
    high: int
    greatest: int

    @staticmethod
    def of(values: Iterable[int]) -> Spread | None:
        """Return the spread of `values`; None of none."""
        ordered = sorted(values)
        if not ordered:
            return None
        last = len(ordered) - 1
        return Spread(*(ordered[last * quarter // 4] for quarter in range(5)))


@dataclass(frozen=True, slots=True, order=True)
class Ratio:
    """How many times as long CP-SAT took as the whole command; with `is_bound` it took longer than that."""

    times: int
    is_bound: bool


@record
class RowResult:
    """What came of a row. Times, in nanoseconds, and moves are those of the instances that were solved.

    "Shop" is PyJobShop. `ratios` compares CP-SAT with the whole command set by set, least first.
    """

    row: Row
    records: tuple[Record, ...]
    solved: int
    moves: Spread | None
    kernel_ns: Spread | None
    whole_ns: Spread | None
    exact_tried: int
    exact_solved: int
    exact_ns: Spread | None
    shop_tried: int
    shop_solved: int
    shop_ns: Spread | None
    ratios: tuple[Ratio, ...]

    @property
    def gaps_per_second(self) -> Spread | None:
        """How often jobs are interrupted, of the schedules found that have gaps."""
        return Spread.of(r["result"]["gaps_per_second"] for r in self.records if "gaps_per_second" in r["result"])

    @property
    def chains(self) -> Mapping[str, Sequence[str]]:
        """Of each chain reaction time, data age and forward latency, in the first schedule found that has gaps."""
        found = (record["result"]["chains"] for record in self.records if "chains" in record["result"])
        return next(iter(found), {})

    @property
    def median_ratio(self) -> Ratio | None:
        """The median of the ratios, a bound if any up to it is one; None where CP-SAT and the search solved nothing."""
        if not self.ratios:
            return None
        lower = self.ratios[: (len(self.ratios) + 1) // 2]
        return Ratio(lower[-1].times, any(ratio.is_bound for ratio in lower))

    @property
    def meets_goal(self) -> bool:
        """Whether success and median kernel time are what was aimed at."""
        if self.kernel_ns is None or Fraction(self.solved, len(self.records)) < self.row.goal_success:
            return False
        if self.row.goal_whole is not None and self.whole_ns is not None:
            return self.whole_ns.median <= self.row.goal_whole.ns
        return self.row.goal_kernel is None or self.kernel_ns.median <= self.row.goal_kernel.ns


@record
class Report:
    """A whole benchmark: `about` says with what, and on which machine, it was made."""

    suite: str
    about: Mapping[str, Any]
    rows: tuple[RowResult, ...]

    @property
    def faults(self) -> list[str]:
        """What went wrong other than not finding a schedule."""
        return [
            f"{record['key']}: {record['result']['fault']}"
            for row in self.rows
            for record in row.records
            if record["result"]["outcome"] == FAULT
        ]

    @property
    def results_sha256(self) -> str:
        """A hash over everything reproducible: equal in two runs if and only if all their schedules are."""
        results = [[record["key"], record["result"]] for row in self.rows for record in row.records]
        return sha256(json.dumps(results, sort_keys=True).encode())

    def to_json(self) -> str:
        """Return everything as JSON."""
        document = {
            "suite": self.suite,
            **self.about,
            "results_sha256": self.results_sha256,
            "rows": [_row_json(row) for row in self.rows],
        }
        return json.dumps(document, indent=1, sort_keys=False) + "\n"


def instances(
    rows: Sequence[Row],
    seeds: Sequence[int],
    *,
    budget: int,
    limit: int,
    workers: int = 1,
    exact_seconds: int = 0,
    exact_seeds: int = 1,
    exact_workers: int = 2,
) -> list[Instance]:
    """Return every instance of the rows; the first `exact_seeds` seeds of each cell also go to CP-SAT."""
    return [
        Instance(
            key=f"{row.name} / {number} / {seed}",
            parameters=parameters,
            seed=seed,
            budget=None if row.is_open else budget,
            limit=limit,
            workers=workers,
            exact_seconds=exact_seconds if place < exact_seeds else 0,
            exact_workers=exact_workers,
            optimise=row.optimise,
        )
        for row in rows
        for number, parameters in enumerate(row.cells, 1)
        for place, seed in enumerate(seeds)
    ]


def report(suite: str, rows: Sequence[Row], records: Mapping[str, Record], about: Mapping[str, Any]) -> Report:
    """Sum up the records, given by key, in the order of the rows; rows without any record are left out."""
    results = []
    for row in rows:
        own = tuple(record for key, record in records.items() if key.startswith(f"{row.name} / "))
        if own:
            results.append(_row_result(row, tuple(sorted(own, key=_place))))
    return Report(suite, about, tuple(results))


def _place(record: Record) -> tuple[int, int]:
    _, cell, seed = record["key"].rsplit(" / ", 2)
    return int(cell), int(seed)


def _row_result(row: Row, records: tuple[Record, ...]) -> RowResult:
    solved = [record for record in records if record["result"]["outcome"] == VALID]
    exact = [record["timing"]["exact"] for record in records if "exact" in record["timing"]]
    answered = [found for found in exact if found["answer"] == "feasible"]
    shop = [record["timing"]["pyjobshop"] for record in records if "pyjobshop" in record["timing"]]
    done = [found for found in shop if found["answer"] == "feasible"]
    return RowResult(
        row=row,
        records=records,
        solved=len(solved),
        moves=Spread.of(record["result"]["moves"] for record in solved),
        kernel_ns=Spread.of(record["timing"]["kernel_ns"] for record in solved),
        whole_ns=Spread.of(record["timing"]["whole_ns"] for record in solved),
        exact_tried=sum(found["answer"] != "none" for found in exact),
        exact_solved=len(answered),
        exact_ns=Spread.of(found["ns"] for found in answered),
        shop_tried=sum(found["answer"] != "none" for found in shop),
        shop_solved=len(done),
        shop_ns=Spread.of(found["ns"] for found in done),
        ratios=tuple(sorted(_ratios(records))),
    )


def _ratios(records: Iterable[Record]) -> Iterator[Ratio]:
    """Compare what CP-SAT and the search took for the sets that at least one of them solved.

    What CP-SAT did not solve counts with the time that it had; what it alone solved counts as 0.
    """
    for row in records:
        found = row["timing"].get("exact", {"answer": "none"})
        is_solved = row["result"]["outcome"] == VALID
        if found["answer"] == "feasible":
            yield Ratio(found["ns"] // row["timing"]["whole_ns"] if is_solved else 0, is_bound=False)
        elif found["answer"] != "none" and is_solved:
            yield Ratio(found["ns"] // row["timing"]["whole_ns"], is_bound=True)


def _row_json(result: RowResult) -> dict[str, Any]:
    spreads = {"moves": result.moves, "kernel_ns": result.kernel_ns, "whole_ns": result.whole_ns}
    goal, whole = result.row.goal_kernel, result.row.goal_whole
    return {
        "name": result.row.name,
        "instances": len(result.records),
        "solved": result.solved,
        "goal_success": str(result.row.goal_success),
        "goal_kernel": None if goal is None else str(goal),
        "goal_whole": None if whole is None else str(whole),
        "paper_seconds": result.row.paper_seconds,
        **{name: _spread_json(spread) for name, spread in spreads.items()},
        "exact": {
            "tried": result.exact_tried,
            "solved": result.exact_solved,
            "ns": _spread_json(result.exact_ns),
            "times_whole": [{"times": ratio.times, "is_bound": ratio.is_bound} for ratio in result.ratios],
        },
        "pyjobshop": {
            "tried": result.shop_tried,
            "solved": result.shop_solved,
            "ns": _spread_json(result.shop_ns),
        },
        "records": list(result.records),
    }


def _spread_json(spread: Spread | None) -> dict[str, int] | None:
    if spread is None:
        return None
    return {name: getattr(spread, name) for name in ("least", "low", "median", "high", "greatest")}
