"""The regulators of a bundle: their tables are checked against the schedule that the programs play."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from halpipe.bundles import MODEL, SCHEDULE, Bundle
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.regulator import ARITHMETIC
from halpipe.deploy.regulator import DEPLOYMENT as REGULATORS
from halpipe.deploy.regulator.arithmetic import RATES, Arithmetic
from halpipe.deploy.regulator.counters import Judge, Sample
from halpipe.deploy.regulator.reading import TABLES, read_tables
from halpipe.diagnostics import sort_diagnostics
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.deploy.base import Checked
    from halpipe.deploy.regulator.reading import Table, Tables
    from halpipe.deploy.riscv.check import Outcome
    from halpipe.diagnostics import Diagnostic

FOLDER = "regulator/"


def regulators_of(target: Target) -> Target | None:
    """Return the regulators of a bundle as one of their own, with the same model and schedule; None if it has none."""
    bundle = target.bundle
    files = {name.removeprefix(FOLDER): data for name, data in bundle.files.items() if name.startswith(FOLDER)}
    if not files:
        return None
    files |= {name: bundle.files[name] for name in (MODEL, SCHEDULE)}
    return replace(target, bundle=Bundle(f"{bundle.path}/{FOLDER.rstrip('/')}", REGULATORS.name, {}, files))


def with_tables(target: Target, checked: Checked) -> Checked:
    """Return the check of the programs with that of the tables, where the bundle has any."""
    own = regulators_of(target)
    if own is None:
        return checked
    tables = REGULATORS.check(own, CheckOptions(engine=ARITHMETIC))
    lines = (*checked.lines, *(f"regulators: {line}" for line in tables.lines))
    return replace(
        checked, diagnostics=tuple(sort_diagnostics([*checked.diagnostics, *tables.diagnostics])), lines=lines
    )


def hold_transfers(target: Target, outcomes: Sequence[Outcome]) -> tuple[list[Diagnostic], list[str]]:
    """Hold the transfers of runs against the budgets of the tables that the regulators play meanwhile.

    Transfers of a unit that share a window are one demand. Returns findings, and the bytes promised, granted and used.
    """
    own = regulators_of(target)
    if own is None:
        return [], []
    tables = read_tables(own.bundle)
    arithmetic = Arithmetic(own, tables)
    if tables.backend in RATES or list(arithmetic.findings()):  # said by the check of the tables
        return [], []
    judge = Judge(tables, {plan.table.index: plan for plan in arithmetic.planned})
    findings: list[Diagnostic] = []
    for outcome in outcomes:
        findings += judge.rows(list(_samples(tables, outcome)), f"{own.bundle.path}/{TABLES}")
    lines = [
        f"regulators: {table}, {unit}, {direction}: {usage.used} B used in {usage.samples} stretches of windows, "
        f"{usage.granted} B granted, {round(usage.promised)} B promised"
        for (table, unit, direction), usage in sorted(judge.usage.items())
    ]
    return findings, lines


def _samples(tables: Tables, outcome: Outcome) -> Iterator[Sample]:
    """Yield what each unit moved in each direction, in stretches of windows without a gap."""
    played = _played(tables, outcome)
    units = {unit.hart: unit.name for unit in outcome.run.site.units}
    regulated = {unit.name: unit for unit in tables.units}
    moved: dict[tuple[str, str], list[tuple[Fraction, Fraction, int]]] = {}
    for job in outcome.jobs:
        for planned, seen in zip(job.planned.transfers, job.transfers, strict=False):
            if seen is not None and units.get(planned.hart) in regulated:
                row = units[planned.hart], "write" if planned.kind is AccessKind.WRITE else "read"
                begin, end = (outcome.run.since(instant).fraction for instant in (seen.begin, seen.end))
                moved.setdefault(row, []).append((begin, end, seen.size))
    width = tables.platform.window_ns
    for (unit, direction), several in sorted(moved.items()):
        last: Sample | None = None
        for begin, end, size in sorted(several):
            start, table = next((s, t) for s, t in reversed(played) if s <= begin or s == played[0][0])
            sample = Sample(table, regulated[unit], direction, begin - start, end - start, size, 0)
            if last is not None and last.table is table and sample.start // width < ceil(last.end / width):
                last = replace(last, end=max(last.end, sample.end), used=last.used + size)
                continue
            if last is not None:
                yield last
            last = sample
        if last is not None:
            yield last


def _played(tables: Tables, outcome: Outcome) -> list[tuple[Fraction, Table]]:
    """Return which tables the regulators play from when on: that of a switch may reach into the mode after it."""
    named = {table.name: table for table in tables.tables}
    found: list[tuple[Fraction, Table]] = []
    until = Fraction(-1)
    for played in outcome.tables:
        start, table = played.start.fraction, named.get(played.name)
        if table is not None and start >= until:
            found.append((start, table))
            until = start + table.windows * tables.platform.window_ns
    return found
