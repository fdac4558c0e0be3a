"""The check of regulator bundles: exact arithmetic on the tables, then what is loaded is executed.

Of the generic unit its Verilog plays the tables, in simulation; of the other back-ends, a model of the device does.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Checked, CheckOptions, Target
    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.reading import Tables
    from halpipe.deploy.regulator.simulate import Verdict

ARITHMETIC = "arithmetic"


class RegulatorDeployment:
    """Checks what `halpipe export regulator` wrote."""

    name = "regulator"
    summary = "budgets of memory regulators: exact arithmetic, and what is loaded executed"
    takes = ("engine", "cycles", "seconds", "seed")
    facts = ("backend", "platform", "model")
    engines = ("auto", ARITHMETIC, "verilator", "icarus")

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Check the tables, then play them; a simulation of tables that are wrong is only made when asked for."""
        from halpipe.core.diagnostics import Exit, HalpipeError, sort_diagnostics
        from halpipe.core.suggest import did_you_mean
        from halpipe.deploy.base import Checked
        from halpipe.deploy.regulator.arithmetic import Arithmetic
        from halpipe.deploy.regulator.codes import NO_ENGINE
        from halpipe.deploy.regulator.forms import check_forms
        from halpipe.deploy.regulator.reading import compare_facts, read_tables

        if options.engine not in self.engines:
            help = did_you_mean(options.engine, self.engines, "engines: " + ", ".join(self.engines))
            text = f'there is no engine "{options.engine}" for regulators'
            raise HalpipeError(NO_ENGINE(text, help=help), exit=Exit.USAGE)
        tables = read_tables(target.bundle)
        arithmetic = Arithmetic(target, tables)
        findings = [*compare_facts(target.bundle, tables), *arithmetic.findings()]
        if tables.backend == "table":
            findings += check_forms(target.bundle, tables)
        wrong = f"{len(findings)} findings" if findings else "exact"
        text = f"{len(tables.tables)} tables of {len(tables.units)} units, {arithmetic.budgets} budgets"
        if arithmetic.windows:
            text += f", {arithmetic.windows} sums against {tables.platform.capacity_bytes} B a window"
        lines = [f"arithmetic: {wrong}; {text}"]
        is_played = tables.backend == "table"
        if findings and (options.engine == "auto" or not is_played):
            remedy = " (name an --engine to play them all the same)" if is_played else ""
            lines.append(f"nothing executed: the tables are wrong{remedy}")
        else:
            planned = arithmetic.planned
            found, remarks = _simulate(target, tables, options) if is_played else _execute(target, tables, planned)
            findings += found
            lines += remarks
        return Checked(diagnostics=tuple(sort_diagnostics(findings)), lines=tuple(lines))


def _execute(target: Target, tables: Tables, planned: list[Planned]) -> tuple[list[Diagnostic], list[str]]:
    """Execute what is loaded on a model of the device."""
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.deploy.regulator.codes import UNUSABLE_TABLES
    from halpipe.deploy.regulator.loading import Case
    from halpipe.devices import DEVICES

    case = Case(target.bundle, tables, planned)
    try:
        import_module(f"{__package__}.{DEVICES[tables.backend].folder}").execute(case)
    except (ValueError, KeyError, TypeError, AttributeError, ZeroDivisionError) as failure:
        text = f"has a value that the model of {tables.backend} cannot use: {failure}"
        at, help = target.bundle.at("platform.yaml"), "correct the platform file, and export the bundle again"
        raise HalpipeError(UNUSABLE_TABLES(text, at=at, help=help)) from None
    errors = sum(found.is_error for found in case.findings)
    wrong = f"{errors} findings" if errors else "grants what is promised"
    caveat = f" ({case.caveat})" if case.caveat else ""
    return case.findings, [f"device: {tables.backend} {wrong}{caveat}; {case.steps} writes executed on its model"]


def _simulate(target: Target, tables: Tables, options: CheckOptions) -> tuple[list[Diagnostic], list[str]]:
    """Play the tables where they are those of the generic unit and a simulator is there."""
    from halpipe.core.caches import why_no_cache
    from halpipe.deploy.regulator.simulate import CACHE, choose_engine, simulate

    if options.engine == ARITHMETIC:
        return [], []
    engine, remark = choose_engine(options.engine)
    if engine is None:
        return [], [remark]
    runs = list(simulate(target.bundle, tables, engine, seed=options.seed, cycles=options.cycles))
    findings = [found for verdict in runs for found in verdict.findings]
    lines = [f"simulation: {remark}, seed {options.seed}", *_table(tables, runs), *_unplayed(tables, runs)]
    trouble = why_no_cache(CACHE) if engine.name == "verilator" else ""
    return findings, [*lines, f"  compiled anew each time: {trouble}"] if trouble else lines


def _unplayed(tables: Tables, runs: list[Verdict]) -> list[str]:
    """Say which tables no run played to their end, because that takes longer than people want to wait."""
    ended = {
        e.table for verdict in runs for e in verdict.run.expected if e.window + 1 == tables.tables[e.table].windows
    }
    names = [f'"{table.name}"' for table in tables.tables if table.index not in ended]
    return [f"  not played to the end: {', '.join(names)}; --cycles 1 plays all"] if names else []


_COLUMNS = ("traffic", "windows", "tables", "switches", "used of granted", "largest sum", "carried over", "violations")


def _table(tables: Tables, runs: list[Verdict]) -> list[str]:
    """Return one line for each run, in columns."""
    rows = [_COLUMNS]
    for verdict in runs:
        seen = {e.table for e in verdict.run.expected if e.running}
        share = 100 * verdict.used // verdict.granted if verdict.granted else 100
        rows.append(
            (
                verdict.run.traffic.name,
                str(verdict.windows),
                f"{len(seen)} of {len(tables.tables)}",
                str(verdict.run.switches),
                f"{share} %",
                f"{verdict.largest_sum} of {tables.platform.capacity_bytes} B",
                str(verdict.carried),
                str(len(verdict.findings)),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(_COLUMNS))]
    padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows)
    return ["  " + "  ".join(cells).rstrip() for cells in padded]


DEPLOYMENT = RegulatorDeployment()
FOLDER = "regulator/"
"""Of the regulators in a bundle of the cores."""


def regulators_of(target: Target) -> Target | None:
    """Return the regulators of a bundle as one of their own, with the same model and schedule; None if it has none."""
    from halpipe.core.bundles import MODEL, SCHEDULE, Bundle
    from halpipe.core.files import YamlMap

    bundle = target.bundle
    files = {name.removeprefix(FOLDER): data for name, data in bundle.files.items() if name.startswith(FOLDER)}
    if not files:
        return None
    files |= {name: bundle.files[name] for name in (MODEL, SCHEDULE)}
    return replace(target, bundle=Bundle(f"{bundle.path}/{FOLDER.rstrip('/')}", DEPLOYMENT.name, YamlMap(0), files))


def with_tables(target: Target, checked: Checked) -> Checked:
    """Return the check of the programs with that of the tables, where the bundle has any."""
    from halpipe.core.diagnostics import sort_diagnostics
    from halpipe.deploy.base import CheckOptions

    own = regulators_of(target)
    if own is None:
        return checked
    tables = DEPLOYMENT.check(own, CheckOptions(engine=ARITHMETIC))
    lines = (*checked.lines, *(f"regulators: {line}" for line in tables.lines))
    return replace(
        checked, diagnostics=tuple(sort_diagnostics([*checked.diagnostics, *tables.diagnostics])), lines=lines
    )
