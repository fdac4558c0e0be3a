"""Schedules as plain tables: rows of names, whole numbers and exact milliseconds, for notebooks, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.quantities import format_rational

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule

Row = dict[str, Any]

JOB_COLUMNS = ("table", "task", "job", "version", "units", "part", "start_ms", "end_ms")
LOAD_COLUMNS = ("table", "kind", "name", "busy_ms", "share", "peak")
LATENCY_COLUMNS = ("table", "chain", "reaction_ms", "age_ms", "latency_ms")
SWITCH_COLUMNS = ("source", "target", "length_ms", "worst_latency_ms", "jobs", "status")


def job_rows(schedule: Schedule) -> list[Row]:
    """Return one row for each job, or for each part of a job with gaps; tables of switches are called ``a->b``."""
    return [row for name, table in _tables(schedule) for job in table for row in _rows_of(name, job)]


def _tables(schedule: Schedule) -> Iterator[tuple[str, Sequence[Job]]]:
    yield from ((mode.name, mode.jobs) for mode in schedule.modes)
    yield from ((table.name, table.jobs) for table in schedule.transitions)


def _rows_of(table: str, job: Job) -> Iterator[Row]:
    for part, (start, end) in enumerate(job.occupations()):
        where = (table, job.task, job.index, job.version, " ".join(job.units))
        yield _row(JOB_COLUMNS, *where, part, _ms(start), _ms(end))


def _row(columns: Sequence[str], *values: Any) -> Row:
    return dict(zip(columns, values, strict=True))


def load_rows(schedule: Schedule) -> list[Row]:
    """Return one row for each unit and resource of each mode; of a unit, the share is that of its busy time."""
    rows = []
    for mode in schedule.modes:
        rows += [_row(LOAD_COLUMNS, mode.name, "unit", u.unit, _ms(u.busy), u.share, None) for u in mode.unit_loads]
        loads = [(r.resource, None, r.mean, r.peak) for r in mode.resource_loads]
        rows += [_row(LOAD_COLUMNS, mode.name, "resource", *load) for load in loads]
    return rows


def latency_rows(schedule: Schedule) -> list[Row]:
    """Return one row for each chain of each mode; None where no data ever arrives, or the latency is not stated."""
    return [
        _row(LATENCY_COLUMNS, mode.name, c.name, _ms(c.reaction), _ms(c.age), _ms(c.latency))
        for mode in schedule.modes
        for c in mode.chains
    ]


def switch_rows(schedule: Schedule) -> list[Row]:
    """Return one row for each transition table."""
    return [
        _row(SWITCH_COLUMNS, t.source, t.target, _ms(t.length), _ms(t.worst_latency), len(t.jobs), str(t.status))
        for t in schedule.transitions
    ]


def as_floats(rows: Iterable[Mapping[str, Any]]) -> list[Row]:
    """Return the rows with floats in the place of fractions, for data frames and plots; nothing is decided by them."""
    return [{name: _float(value) for name, value in row.items()} for row in rows]


def _float(value: Any) -> Any:
    try:
        return float(value) if isinstance(value, Fraction) else value
    except OverflowError:  # a file may state any number; only verify judges it
        return math.inf


def _ms(time: Duration | None) -> Fraction | None:
    return None if time is None else time.in_unit("ms")


# ------------------------------------------------------------------------------------------------ as text


def as_json(schedule: Schedule) -> str:
    """Return everything as JSON (see the schema ``show-1.schema.json``); exact numbers are texts, such as ``100/3``."""
    document = {
        "halpipe-show": 1,
        "model": schedule.model,
        "modes": [
            {"name": mode.name, "hyperperiod_ms": _plain(_ms(mode.hyperperiod)), "status": str(mode.status)}
            | {"margin": _plain(mode.margin), "margin_bound": _plain(mode.margin_bound)}
            | {"margin_words": mode.margin_words}
            for mode in schedule.modes
        ],
        "jobs": _all_plain(job_rows(schedule)),
        "loads": _all_plain(load_rows(schedule)),
        "latencies": _all_plain(latency_rows(schedule)),
        "switches": _all_plain(switch_rows(schedule)),
    }
    return json.dumps(document, indent=1, ensure_ascii=True) + "\n"


def as_csv(schedule: Schedule) -> str:
    """Return the jobs as CSV with a line of names; exact numbers as in JSON."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(JOB_COLUMNS)
    writer.writerows([_plain(row[name]) for name in JOB_COLUMNS] for row in job_rows(schedule))
    return text.getvalue()


def _all_plain(rows: Iterable[Mapping[str, Any]]) -> list[Row]:
    return [{name: _plain(value) for name, value in row.items()} for row in rows]


def _plain(value: Any) -> Any:
    return format_rational(value) if isinstance(value, Fraction) else value
