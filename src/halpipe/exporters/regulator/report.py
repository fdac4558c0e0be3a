"""Reports of an export: accuracy of each access phase, the tables as JSON, the report for people and for tools."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import accumulate, groupby
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Location, Severity, about
from halpipe.core.files import load_json
from halpipe.core.quantities import format_bandwidth, format_rational
from halpipe.core.records import record
from halpipe.exporters.regulator.codes import BELOW_BURST, OFF_GRID, SHORT_PHASE
from halpipe.exporters.regulator.frames import TRANSITION, Phase
from halpipe.exporters.regulator.windows import cut
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.regulator.tables import Table, Tables
    from halpipe.exporters.regulator.writing import Backend
    from halpipe.models import TaskModel


@record
class Served:
    """A phase with what it was promised and granted, in bytes, when it ends.

    Where each window is rounded up, the windows that a phase touches count in full. `lag` is how far its row is behind
    the promise then, `wait` how long the phase's own bandwidth needs for that, in nanoseconds.
    """

    phase: Phase
    promised: Fraction
    granted: Fraction
    lag: Fraction
    wait: Fraction


def served(tables: Tables, table: Table) -> Iterator[Served]:
    """Yield every phase that ends within a table, or on its circle."""
    p, window, frame = tables.platform, tables.grid.window, table.frame
    per_ns = Fraction(p.guaranteed, 10**9)
    given = {row: [0, *accumulate(bursts)] for row, bursts in table.bursts.items()}
    for phase in frame.phases:
        if phase.end > frame.span and table.successor != table.index:
            continue  # it ends in the table of the mode after
        end = phase.end if phase.end <= frame.span else phase.end - frame.span
        rate = phase.bound * per_ns
        promised = rate * tables.grid.ns(phase.end - phase.begin)
        k = -(-end // window)
        if table.rounding == WHOLE:
            windows = given[phase.row][k] - given[phase.row][max(phase.begin // window, 0)]
            if phase.end > frame.span:  # it began at the end of the circle
                windows += given[phase.row][-1]
            yield Served(phase, promised, Fraction(windows * p.burst), ZERO, ZERO)
            continue
        behind = table.promised[phase.row].at(k) - given[phase.row][k]
        lag = max(ZERO, min(behind * p.burst, promised))
        yield Served(phase, promised, promised - lag, lag, lag / rate)


ZERO = Fraction(0)


def check_phases(model: TaskModel, tables: Tables) -> list[Diagnostic]:
    """Return what is odd about the phases: below a burst, off the grid, too short for their transfers."""
    return [*_below_burst(tables), *_off_grid(model, tables), *_short(model, tables)]


def _below_burst(tables: Tables) -> Iterator[Diagnostic]:
    """Report the bounds that give less than one burst per window, where bursts are rationed."""
    p, seen = tables.platform, set()
    for table in tables.tables:
        for phase in table.frame.phases if table.rounding == CONTROLLED else ():
            per_window = phase.bound * tables.bursts
            if per_window >= 1 or phase.access in seen:
                continue
            seen.add(phase.access)
            least = phase.access.bound / per_window
            thousandths = format_rational(Fraction(int(per_window * 1000), 1000))
            cycles = ceil(p.cycles / per_window)
            message = (
                f"bound {format_rational(phase.access.bound)} is {thousandths} bursts of {p.burst} bytes per "
                f'window for unit "{phase.row.unit}": one burst every {ceil(1 / per_window)} windows'
            )
            named = f"a bound of at least {format_rational(least)}, or " if least <= 1 else ""
            help = f"use {named}a window of at least {cycles} cycles"
            path = about(task=phase.job.task, version=phase.job.version)
            yield BELOW_BURST(message, at=phase.access.at, path=path, help=help)


def _off_grid(model: TaskModel, tables: Tables) -> Iterator[Diagnostic]:
    """Report, once, how many phases begin or end inside a window, and the task with the widest of them."""
    window, p = tables.grid.window, tables.platform
    phases = [phase for table in tables.tables for phase in table.frame.phases]
    off = [phase for phase in phases if phase.begin % window or phase.end % window]
    if off:
        widest = max(off, key=lambda phase: phase.bound)
        task = model.task(widest.job.task)
        message = (
            f"up to {int(widest.bound * p.promise)} bytes can be used outside its phase, which begins or ends inside a "
            f"window of {p.window}; so do {len(off)} of {len(phases)} phases, of {len({f.job.task for f in off})} tasks"
        )
        help = "state starts and ends of phases in multiples of the window; --quantise sees to the starts of jobs"
        yield OFF_GRID(message, at=task.at, path=about(task=task.name), help=help)


def _short(model: TaskModel, tables: Tables) -> Iterator[Diagnostic]:
    """Report the access phases that are promised less than their transfers need."""
    rate = Fraction(tables.platform.guaranteed, 10**9)
    for task in model.tasks:
        for version in task.versions:
            for access in version.accesses:
                needed = sum(transfer.size for transfer in access.transfers)
                promised = access.bound * rate * (access.end - access.start).fraction
                if access.resource != tables.resource or promised >= needed:
                    continue
                longer = needed / (access.bound * rate)
                message = f"{int(promised)} bytes are promised, its transfers need {needed}"
                bound = access.bound * needed / promised
                help = f"let it last at least {ceil(longer)}ns" + (
                    f", or bind it to {format_rational(Fraction(ceil(bound * 1000), 1000))}" if bound <= 1 else ""
                )
                path = about(task=task.name, version=version.name)
                yield SHORT_PHASE(message, at=access.at, path=path, help=help)


VERSION = 1


def format_json(value: Any) -> bytes:
    """Return JSON with short lines: one entry, phase or window sum on each."""
    return (_dump(value, 0) + "\n").encode()


def _dump(value: Any, depth: int) -> str:
    flat = json.dumps(value, ensure_ascii=True)
    if len(flat) <= 160 - depth or not isinstance(value, dict | list) or not value:
        return flat
    pad = " " * (depth + 1)
    if isinstance(value, dict):
        inner = [f"{json.dumps(key)}: {_dump(item, depth + 1)}" for key, item in value.items()]
        first, last = "{", "}"
    else:
        inner = [_dump(item, depth + 1) for item in value]
        first, last = "[", "]"
    return f"{first}\n" + ",\n".join(pad + item for item in inner) + f"\n{' ' * depth}{last}"


# -------------------------------------------------------------------------------------------- tables.json


def describe_tables(tables: Tables, schedule_digest: str, model_digest: str) -> dict[str, Any]:
    """Return the table object as JSON values: what is loaded, and what a check needs to judge it."""
    p = tables.platform
    return {
        "halpipe-regulator": VERSION,
        "backend": tables.backend,
        "schedule_sha256": schedule_digest,
        "model_sha256": model_digest,
        "platform": {
            "name": p.name,
            "resource": tables.resource,
            "clock_hz": p.clock,
            "bus_bytes": p.bus,
            "burst_bytes": p.burst,
            "window_cycles": p.cycles,
            "window_extra": format_rational(p.extra),
            "guaranteed": p.guaranteed,
            "capacity": p.capacity,
            "unspecified": p.unspecified,
            "table_depth": int(p.settings["table"]["depth"]),
        },
        "window_ns": format_rational(p.window.fraction),
        "promise_bytes": format_rational(p.promise),
        "capacity_bytes": p.window_capacity,
        "units": [
            {
                "index": unit.index,
                "unit": unit.name,
                "manager": unit.manager,
                "default": dict(unit.default),
                "overshoot": dict(unit.overshoot),
            }
            for unit in tables.units
        ],
        "tables": [_describe(tables, table) for table in tables.tables],
        "switches": [{"from": s.source, "to": s.target, "request": s.request} for s in tables.switches],
    }


def _describe(tables: Tables, table: Table) -> dict[str, Any]:
    frame, burst = table.frame, tables.platform.burst
    kind: dict[str, Any] = {"mode": frame.source}
    if frame.kind == TRANSITION:
        length = format_rational(tables.grid.ns(frame.length))
        kind = {"from": frame.source, "to": frame.target, "length_ns": length, "cycles": frame.cycles}
    return {
        "index": table.index,
        "name": table.name,
        "kind": frame.kind,
        **kind,
        "windows": table.windows,
        "successor": table.successor,
        "rounding": table.rounding,
        "entries": {
            unit.name: [
                {
                    "window": e.window,
                    "read_bytes": e.read * burst,
                    "write_bytes": e.write * burst,
                    "read_bursts": e.read,
                    "write_bursts": e.write,
                }
                for e in table.entries(unit.name)
            ]
            for unit in tables.units
        },
    }


# -------------------------------------------------------------------------------------------- report.json


def describe_export(
    tables: Tables, backend: Backend, findings: Sequence[Diagnostic], schedule_digest: str
) -> dict[str, Any]:
    """Return the report as JSON values; bytes are exact, as text where they are no integers."""
    p = tables.platform
    return {
        "halpipe-regulator-report": VERSION,
        "model": tables.model,
        "platform": p.name,
        "schedule_sha256": schedule_digest,
        "backend": {"name": backend.name, **backend.facts(tables)},
        "window": {"cycles": p.cycles, "ns": format_rational(p.window.fraction)},
        "burst_bytes": p.burst,
        "promise_bytes": format_rational(p.promise),
        "capacity_bytes": p.window_capacity,
        "reserved_bytes": tables.reserve,
        "room_bursts": tables.room,
        "tables": [_report_table(tables, table) for table in tables.tables],
        "findings": [
            {
                "code": d.code,
                "severity": str(d.severity),
                "file": d.at.file.rpartition("/")[2],
                "line": d.at.line,
                "path": d.path,
                "message": d.message,
                "help": d.help,
            }
            for d in findings
        ],
    }


def findings_of(report: bytes) -> list[Diagnostic]:
    """Return the findings that a report has; they name files without their folders."""
    return [
        Diagnostic(
            d["code"], Severity(d["severity"]), Location(d["file"], d["line"]), d["path"], d["message"], d["help"]
        )
        for d in load_json(report)["findings"]
    ]


def _report_table(tables: Tables, table: Table) -> dict[str, Any]:
    phases = list(served(tables, table))
    burst = tables.platform.burst
    peak = max(table.totals)
    return {
        "name": table.name,
        "windows": table.windows,
        "successor": tables.tables[table.successor].name,
        "rounding": table.rounding,
        "peak_bytes": peak * burst,
        "peak_window": table.totals.index(peak),
        "mean_bytes": format_rational(_rounded(mean(table) * burst)),
        "worst_lag_bytes": format_rational(_rounded(max((s.lag for s in phases), default=Fraction(0)))),
        "window_sums": [{"window": k, "bytes": total * burst} for k, total in _runs(table.totals)],
        "phases": [_report_phase(tables, found) for found in phases],
    }


def _report_phase(tables: Tables, found: Served) -> dict[str, Any]:
    phase = found.phase
    return {
        "task": phase.job.task,
        "job": phase.job.index,
        "unit": phase.row.unit,
        "direction": phase.row.direction,
        "begin_ns": format_rational(tables.grid.ns(phase.begin)),
        "end_ns": format_rational(tables.grid.ns(phase.end)),
        "promised_bytes": format_rational(_rounded(found.promised)),
        "granted_bytes": format_rational(_rounded(found.granted)),
        "lag_bytes": format_rational(_rounded(found.lag)),
        "lag_ns": format_rational(_rounded(found.wait)),
    }


def _rounded(value: Fraction) -> Fraction:
    """Return a value for people, to the thousandth."""
    return Fraction(round(value * 1000), 1000)


def _runs(values: Sequence[int]) -> Iterator[tuple[int, int]]:
    k = 0
    for value, run in groupby(values):
        yield k, value
        k += sum(1 for _ in run)


def mean(table: Table) -> Fraction:
    """Return the mean of the bursts granted per window."""
    return Fraction(sum(table.totals), table.windows)


# -------------------------------------------------------------------------------------------- report.txt


def summarise(tables: Tables, backend: Backend, digest: str) -> str:
    """Return the report for people: the setting, then one line for each table."""
    p = tables.platform
    used = {row.unit for row in tables.rows}
    head = [
        f"regulator tables of {tables.model} for {p.name}, back-end {backend.name}",
        f"window {p.cycles_text} = {p.window}, burst {p.burst} B, guaranteed {format_bandwidth(p.guaranteed)}",
        f"windows end within a cycle of exact ones; a clock off by 1 ppm slips one window in {p.window * 10**6}",
        f"capacity {p.window_capacity} B per window (what memory surely sustains, not the peak of its pins)",
        f"reserved for overshoot: {tables.reserve} B; room for {tables.room} bursts per window",
        f"units: {', '.join(u.name if u.name in used else u.name + ' (no access)' for u in tables.units)}",
    ]
    rows: list[tuple[str, ...]] = [("table", "windows", "then", "rounding", "peak", "mean", "worst lag", "entries")]
    rows += [_line(tables, table) for table in tables.tables]
    facts = [
        f"{key.replace('_', ' ')}: {value}"
        for key, value in backend.facts(tables).items()
        if isinstance(value, int | str)
    ]
    return "\n".join([*head, "", *_aligned(rows), "", *facts, f"schedule {digest}", ""])


def _line(tables: Tables, table: Table) -> tuple[str, ...]:
    burst, capacity = tables.platform.burst, tables.platform.window_capacity
    lag = max((found.lag for found in served(tables, table)), default=Fraction(0))
    entries = max(len(table.entries(unit.name)) for unit in tables.units)
    return (
        table.name,
        str(table.windows),
        tables.tables[table.successor].name,
        table.rounding,
        _share(Fraction(max(table.totals) * burst), capacity),
        _share(mean(table) * burst, capacity),
        f"{cut(lag)} B" if lag else "0",
        str(entries),
    )


def _share(value: Fraction, capacity: int) -> str:
    return f"{cut(value * 100 / capacity)} %"


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
