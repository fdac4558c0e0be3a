"""Sheets of a workbook: one for each kind of element of a model, and for each table of a schedule."""

from __future__ import annotations

import io
import re
import zipfile
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError, about, error, warning
from halpipe.core.durations import Duration
from halpipe.exporters.common.rows import job_rows, latency_rows, load_rows, switch_rows
from halpipe.models.attributes import SHARE, attributes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.models import Schedule, TaskModel, Version

NO_WRITER = error(
    "HAL1487", "Workbooks cannot be written here", "The package openpyxl, which writes workbooks, is not installed."
)
NO_COLUMN = warning(
    "HAL1488",
    "Workbook has no column for elements of the model",
    "The workbook does not carry these elements; the model file does. An overlay states them for an import.",
)

EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of every file in a workbook, so that the same schedule gives the same bytes."""

_TIME = re.compile(rb"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:]{8}Z")
_WINDOW = {"task": "from", "anchor": "after", "to": "until"}
Table = tuple[str, list[str], list[list[Any]]]


def format_workbook(model: TaskModel, schedule: Schedule) -> bytes:
    """Return the workbook of a model and its schedule."""
    try:
        from openpyxl import Workbook
        from openpyxl.styles import Font
    except ImportError:
        raise HalpipeError(NO_WRITER("openpyxl is not installed", help="pip install openpyxl")) from None
    book = Workbook()
    book.remove(book.active)
    for title, heads, rows in (*_model(model), *_schedule(schedule)):
        if not rows:
            continue
        sheet = book.create_sheet(title)
        for line in (heads, *rows):
            sheet.append(line)
        sheet.freeze_panes = "B2"
        for cell in sheet[1]:
            cell.font = Font(bold=True)
            cell.parent.column_dimensions[cell.column_letter].width = max(10, len(str(cell.value)) + 2)
    packed = io.BytesIO()
    book.save(packed)
    return _with_fixed_times(packed.getvalue())


def _with_fixed_times(packed: bytes) -> bytes:
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(packed)) as source, zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "docProps/core.xml":
                content = _TIME.sub(b"1980-01-01T00:00:00Z", content)
            target.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED)
    return found.getvalue()


# --------------------------------------------------------------------------------------------------------- model


def _model(model: TaskModel) -> Iterator[Table]:
    versions = [(task, version) for task in model.tasks for version in task.versions]
    modes: dict[tuple[str, str], dict[str, None]] = {}
    for mode in model.modes:
        for run in mode.runs:
            for name in run.versions:
                modes.setdefault((run.task, name), {})[mode.name] = None
    tasks = [
        {"task": task.name, "version": version.name, "slack": SHARE.text(task.slack)}
        | _stated(task, "name")
        | _stated(version, "name")
        | {"modes": ", ".join(modes.get((task.name, version.name), ()))}
        for task, version in versions
    ]
    yield _table("Tasks", tasks)
    yield _table("Chains", [_stated(chain) for chain in model.chains])
    accesses, windows = [], []
    for task, version in versions:
        owner = {"version": version.name}
        accesses += [{"task": task.name} | owner | _stated(access) for access in version.accesses]
        windows += [{"to": task.name} | owner | _stated(window, names=_WINDOW) for window in version.precedences]
    yield _table("Accesses", accesses)
    yield _table("Precedences", windows)
    yield _table("Transitions", [_stated(transition) for transition in model.transitions])
    yield _table("Modes", [{"name": "", "edge": ""} | _stated(mode) for mode in model.modes])
    yield _table("Interrupts", [{"unit": unit.name} | _stated(one) for unit in model.units for one in unit.interrupts])
    yield _table("Health", [_stated(rule) for rule in model.health])
    yield _table("Units", [{"name": "", "type": ""} | _stated(unit) for unit in model.units])
    yield _table("Resources", [{"name": "", "bandwidth": ""} | _stated(resource) for resource in model.resources])


def _stated(element: Any, *without: str, names: dict[str, str] | None = None) -> dict[str, Any]:
    """Return the attributes of an element that differ from their defaults, by the names of their columns."""
    kind = type(element)
    found = {}
    for one in (*attributes(kind), *attributes(kind, "units")):
        value = getattr(element, one.field)
        if one.field not in without and (one.is_required or one.is_always_written or value != one.default):
            name = "units" if one.field == "units" else (names or {}).get(one.field, one.name)
            found[name] = value if isinstance(value, Duration) else one.codec.text(value).replace(" ", ", ")
    return found


def _table(title: str, rows: Sequence[dict[str, Any]]) -> Table:
    """Return rows as a table whose columns of times are in milliseconds where a decimal states each of them."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    decimal = {name for name in columns if _is_decimal(row.get(name) for row in rows)}
    heads = [f"{name} [ms]" if name in decimal else name for name in columns]
    return title, heads, [[_cell(row.get(name), name in decimal) for name in columns] for row in rows]


def _is_decimal(values: Iterable[Any]) -> bool:
    times = [value for value in values if value not in (None, "")]
    return bool(times) and all(isinstance(value, Duration) and _milliseconds(value) is not None for value in times)


def _milliseconds(time: Duration) -> float | None:
    """Return the number of Excel whose shortest decimal is the time, None if there is none."""
    exact = time.in_unit("ms")
    number = float(exact)
    return number if Fraction(Decimal(repr(number))) == exact else None


def _cell(value: Any, is_decimal: bool) -> Any:
    if isinstance(value, Duration):
        return _milliseconds(value) if is_decimal else str(value)
    return _safe(value)


def _safe(value: Any) -> Any:
    """Return a text that Excel takes as one, not as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@") else value


def losses(model: TaskModel) -> list[Diagnostic]:
    """Return a warning for each part of a task that no sheet carries."""
    return [
        NO_COLUMN(f"{what} are not written", path=about(task=task.name))
        for task in model.tasks
        for what, has in _LOST.items()
        if any(map(has, task.versions))
    ]


_LOST: dict[str, Callable[[Version], bool]] = {
    "sources": lambda version: version.source is not None,
    "preemption points": lambda version: version.split.is_allowed,
    "transfers": lambda version: any(access.transfers for access in version.accesses),
}


# ------------------------------------------------------------------------------------------------------ schedule


def _schedule(schedule: Schedule) -> Iterator[Table]:
    for title, rows in (
        ("Schedule jobs", job_rows(schedule)),
        ("Schedule loads", load_rows(schedule)),
        ("Schedule latencies", latency_rows(schedule)),
        ("Schedule switches", switch_rows(schedule)),
    ):
        heads = list(rows[0]) if rows else []
        yield title, heads, [[_number(row[name]) for name in heads] for row in rows]


def _number(value: Any) -> Any:
    return float(value) if isinstance(value, Fraction) else _safe(value)
