"""Columns of each kind of table: their keys, their synonyms, and units of time in the heads of columns."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

TASK, AFTER, MODES, VERSION, PERIOD = "task", "after", "modes", "version", "period"

RATES = ("rate", "frequency", "frequenz")
"""Columns of periods that state how many jobs a second has."""

RESULTS = "schedule "
"""Beginning of the names of sheets that an export fills from a schedule."""

TIMES = ("period", "offset", "deadline", "distance", "let", "wcet", "start", "end", "min", "max", "point")
"""Columns of durations, which may have their unit in the head; those of limits begin with ``max-``."""

SHARES = ("slack", "bound", "weight")

_REMARKS = """
no nr id # comment comments description remark remarks note notes owner author department
kommentar bemerkung beschreibung verantwortlich
"""
REMARKS = frozenset(_REMARKS.split())
"""Columns without influence on timing."""

SUMS = frozenset(("total", "sum", "average", "mean", "summe", "gesamt", "mittelwert"))
"""What a row below all tasks may be called that is none."""


@record(eq=False)
class Kind:
    """A kind of table: names of its sheets, synonyms of its columns by key, and keys that tell it from others.

    Cells of `lists` may have several names.
    """

    name: str
    titles: tuple[str, ...]
    columns: Mapping[str, tuple[str, ...]]
    needed: tuple[str, ...]
    lists: tuple[str, ...] = ()


_TASK = ("task name", "runnable", "process", "name", "aufgabe")
_UNIT = ("unit", "core", "cores", "cpu", "cpus", "processor", "ecu", "allocation", "kern")
_LIMITS = {
    "max-latency": ("latency", "latency limit"),
    "max-reaction": ("reaction", "reaction time", "max reaction time", "end to end limit", "limit"),
    "max-age": ("age", "data age", "max data age"),
}

KINDS = (
    Kind(
        "tasks",
        ("task", "aufgaben"),
        {
            TASK: _TASK,
            VERSION: ("variant",),
            PERIOD: ("cycle time", "cycle", "interval", "t", "periode", "zykluszeit", *RATES),
            "offset": ("phase", "o", "initial offset"),
            "slack": ("start jitter", "jitter", "release window"),
            "deadline": ("relative deadline", "d", "frist"),
            "distance": ("inter arrival time", "min inter arrival time", "minimum inter arrival time", "mit"),
            "let": ("logical execution time",),
            "binding": ("migration",),
            "wcet": ("worst case execution time", "execution time", "runtime", "c", "laufzeit"),
            "units": _UNIT,
            "gang": ("gang size", "cores needed"),
            AFTER: ("predecessor", "predecessors", "depends on", "vorgänger"),
            MODES: ("mode", "modus"),
        },
        (TASK, "wcet"),
        ("units", AFTER, MODES),
    ),
    Kind(
        "chains",
        ("chain", "cause effect chains"),
        {
            "name": ("chain", "chain name", "event chain"),
            "tasks": ("path", "sequence"),
            **_LIMITS,
            "from": (),
            "to": (),
            "weight": (),
        },
        ("name", "tasks"),
        ("tasks",),
    ),
    Kind(
        "accesses",
        ("access", "memory accesses"),
        {
            TASK: _TASK,
            VERSION: ("variant",),
            "resource": ("memory",),
            "start": ("from",),
            "end": ("to", "until"),
            "bound": ("share", "bandwidth share"),
            "kind": ("type",),
        },
        (TASK, "resource", "start", "end"),
    ),
    Kind(
        "precedences",
        ("precedence", "constraints"),
        {
            "from": ("predecessor",),
            "to": ("successor", TASK),
            VERSION: ("variant",),
            AFTER: ("instant",),
            "until": (),
            "point": (),
            "match": (),
            "min": ("min delay", "minimum"),
            "max": ("max delay", "maximum"),
        },
        ("from", "to", "max"),
    ),
    Kind(
        "transitions",
        ("transition", "switches", "mode switches"),
        {"from": ("from mode",), "to": ("to mode",), "max-length": ("max length", "length")},
        ("from", "to"),
    ),
    Kind("modes", ("mode",), {"name": ("mode",), "edge": ()}, ("name", "edge")),
    Kind(
        "interrupts",
        ("interrupt", "isrs"),
        {"unit": _UNIT[1:], "name": ("interrupt",), "distance": ("inter arrival time",), "wcet": ("execution time",)},
        ("name", "unit", "distance", "wcet"),
    ),
    Kind(
        "health",
        ("health rules",),
        {TASK: _TASK, "on": ("event",), "count": (), "cycles": (), "action": (), "mode": ()},
        (TASK, "on", "action"),
    ),
    Kind(
        "resources",
        ("resource", "memories"),
        {"name": ("resource", "memory"), "bandwidth": (), "kind": ()},
        ("name", "bandwidth"),
    ),
    Kind("units", ("unit", "cores", "platform"), {"name": _UNIT, "type": ("core type", "kind")}, ("name", "type")),
)

_HEAD = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])]|(?:\bin\s|[\s_/])\s*([mnuµμ]?s|k?hz))?\s*", re.I)
_UNITS = {"s": "s", "ms": "ms", "us": "us", "µs": "us", "μs": "us", "ns": "ns", "hz": "hz", "khz": "khz", "%": "%"}


@record
class Column:
    """A column of a table: its place, head and key; and the unit of its numbers, empty where each cell has its own."""

    place: int
    head: str
    key: str
    unit: str


def plain(text: str) -> str:
    """Return a name of a sheet or column in small letters, with single blanks between its words."""
    return re.sub(r"[\s_./-]+", " ", text.strip().lower()).strip()


def columns_of(head: Sequence[str], kind: Kind) -> list[Column]:
    """Return the columns of a table that a row of heads names; an unknown one has no key."""
    keys = {plain(word): key for key, words in kind.columns.items() for word in (key, *words)}
    found = []
    for place, text in enumerate(head):
        match = _HEAD.fullmatch(text.strip())
        if not text.strip() or match is None:
            continue
        name, unit = match[1], (match[2] or match[3] or "").strip()
        key = keys.get(plain(name), "")
        found.append(Column(place, text.strip(), key, _UNITS.get(unit.lower(), unit) if key else ""))
    return found


def is_time(key: str) -> bool:
    """Whether the cells of a column are durations."""
    return key in TIMES or key.startswith("max-")


def is_unit_of(unit: str, key: str) -> bool:
    """Whether numbers of a column can have such a unit."""
    if is_time(key):
        return unit in ("s", "ms", "us", "ns", "") or (key == PERIOD and unit in ("hz", "khz"))
    return not unit or (unit == "%" and key in SHARES)


def kind_of(head: Sequence[str], title: str) -> Kind | None:
    """Return the kind of table whose columns a row names: the one that its sheet is called after, or the first."""
    fits = [kind for kind in KINDS if set(kind.needed) <= {column.key for column in columns_of(head, kind)}]
    named = [kind for kind in KINDS if plain(title) in (kind.name, *kind.titles)]
    for kind in named:
        if kind in fits or kind.needed[0] in {column.key for column in columns_of(head, kind)}:
            return kind
    return fits[0] if fits else None
