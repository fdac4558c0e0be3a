"""Task model of the rows of tables."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import NOWHERE, Findings, HalpipeError, Location, about, error, warning
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files import STDIO, YamlList, YamlMap, advice_for, beginning_of
from halpipe.core.quantities import format_rational, parse_rational, quoted
from halpipe.core.settings import BAD_VALUE, Fields
from halpipe.core.suggest import did_you_mean
from halpipe.importers.common.base import Coverage, Imported, ImportOptions
from halpipe.importers.common.stated import complete_attributes, name, stated_attributes
from halpipe.importers.table.columns import (
    AFTER,
    KINDS,
    MODES,
    PERIOD,
    RATES,
    REMARKS,
    RESULTS,
    SHARES,
    SUMS,
    TASK,
    VERSION,
    Column,
    Kind,
    columns_of,
    is_time,
    is_unit_of,
    kind_of,
    plain,
)
from halpipe.importers.table.sheets import NO_TABLE, Sheet, read_sheets
from halpipe.models import (
    Access,
    Anchor,
    Chain,
    HealthRule,
    Interrupt,
    Match,
    Mode,
    Origin,
    Precedence,
    Resource,
    Run,
    Task,
    TaskModel,
    Transition,
    Unit,
)
from halpipe.models import Version as TaskVersion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence


UNKNOWN_COLUMN = warning(
    "HAL1482",
    "Column of a table is not read",
    "Its name is none of the known ones, so that its cells decide nothing, whatever they state.",
)
UNKNOWN_SHEET = warning(
    "HAL1483",
    "Sheet of a workbook is not read",
    "No row of it has the heads of a known table. A sheet may be called after the table that it is.",
)
UNKNOWN_UNIT = error(
    "HAL1484", "Head of a column has an unusable unit", "Times are in s, ms, us or ns; shares may be in %."
)
CONTRADICTION = error(
    "HAL1485",
    "Rows of a table contradict each other",
    "Two rows name the same element and state different values, or the same version twice.",
)
UNKNOWN_NAME = error(
    "HAL1486", "Row names something that no table has", "The name of a task, resource or mode must occur in its table."
)
ALIKE = warning(
    "HAL1550",
    "Names differ in capitals alone",
    "Names are compared letter by letter, so that two elements come of them.",
)

T = TypeVar("T")

HEADS = 20
"""Rows in which the heads of a table are sought; titles may stand above them."""

DEFAULT = "default"
_ARROWS = re.compile(r"\s*(?:->|=>|→|>|[,;\n])\s*")
_NUMBER = re.compile(r"[+-]?[0-9]+(?:[.,][0-9]+)?")
_RATE = re.compile(r"([0-9.]+)\s*(k?)hz", re.IGNORECASE)
_THOUSANDS = re.compile(r"(?<![0-9])[1-9][0-9]{0,2}(?:,[0-9]{3})+(?![0-9])")
_GROUPED = re.compile(r"(?<=[0-9])(?:[\s'\u2019](?=[0-9]{3}(?![0-9]))|\.(?=[0-9]{3},[0-9])|,(?=[0-9]{3}\.[0-9]))")
"""Signs that separate thousands for sure."""
_DATE = re.compile(r"[0-9]{1,4}[.:/-] ?(?:[0-9]{1,2}[.:/-] ?[0-9]{1,4}\b|[^\W\d_]{3,})")
_WINDOW = {"task": "from", "anchor": AFTER, "to": "until"}


@dataclass
class _Draft:
    """A task while its rows are read: each has one version."""

    stated: dict[str, Any]
    at: Location
    versions: dict[str, TaskVersion] = field(default_factory=dict)
    after: list[tuple[str, Location]] = field(default_factory=list)
    modes: dict[str, list[str]] = field(default_factory=dict)


@dataclass
class _Table:
    """A table with its columns, from which each row becomes a mapping of texts."""

    kind: Kind
    sheet: Sheet
    columns: list[Column]
    width: int
    rows: Sequence[tuple[int, tuple[str, ...]]]

    def names(self) -> set[str]:
        """Return the names of the elements of the table."""
        places = [column.place for column in self.columns if column.key == self.kind.needed[0]]
        return {_name(cells[place]) for _, cells in self.rows for place in places if place < len(cells)}

    def fields(self, findings: Findings, known: set[str]) -> Iterator[Fields]:
        """Yield what the rows state, with their lines; empty cells state nothing. `known` are names of elements."""
        signs = {",": ""} if self.sheet.has_commas else dict[str, str]()
        for line, cells in self.rows:
            if any(cells[self.width :]):
                text = f"{len(cells)} cells below {self.width} heads"
                help = "write a head above each cell, several names into one (A > B), and numbers with a decimal point"
                findings.add(CONTRADICTION(text, at=Location(self.sheet.file, line), help=help))
                continue
            data = YamlMap(line)
            row = Fields(self.sheet.file, findings, data, f"row of {self.kind.name}", ())
            row.addition = 'fill in the column "KEY", or remove the row: each row below the heads is an element'
            for column in self.columns:
                text = cells[column.place] if column.place < len(cells) else ""
                if column.key and text and text not in ("-", "—", "n/a"):
                    is_list = column.key in self.kind.lists
                    read = partial(_name_list, text, known) if is_list else partial(_cell, column, text, signs)
                    value = row.checked(column.key, read, None, line=line)
                    if value is not None:
                        data[column.key] = value
            first = data.get(self.kind.needed[0])
            if isinstance(first, str):
                row.path = about(**{self.kind.name.rstrip("s"): first}) if self.kind.name == "tasks" else row.path
            yield row


def _cell(column: Column, text: str, signs: dict[str, str]) -> str:
    """Return the text of a cell as its reader takes it: names without blanks, numbers with point and unit."""
    if text.startswith("#"):
        raise ValueError(f"{quoted(text)} is what a formula failed with; correct it, or write the value")
    if is_time(column.key):
        number = _with_point(text, signs).replace("µ", "u").replace("μ", "u")
        if _NUMBER.fullmatch(number):
            unit = "Hz" if plain(column.head) in RATES else "ms"
            if not column.unit:
                raise ValueError(
                    f'{quoted(text)} has no unit; write "{text} {unit}", or "{column.head} [{unit}]" as the head'
                )
            number += column.unit
        rate = _RATE.fullmatch(number) if column.key == PERIOD else None
        return _period_of(rate) if rate else number
    if column.key in SHARES:
        number = _with_point(text, signs)
        if number.endswith("%") or column.unit == "%":
            return format_rational(parse_rational(number.removesuffix("%")) / 100)
        return number
    return _name(text)


def _period_of(rate: re.Match[str]) -> str:
    """Return how far the jobs of a rate are apart."""
    if not (a_second := parse_rational(rate[1]) * (1000 if rate[2] else 1)):
        raise ValueError("a rate of 0 has no period; leave the cell of a task without period empty")
    return f"{format_rational(1000 / a_second)}ms"


def _with_point(text: str, signs: dict[str, str]) -> str:
    """Return a number with a decimal point; raise ``ValueError`` where a sign may separate thousands.

    `signs` are the decimal signs of the table so far, each with its first number: beside 2,5 the number 1.000 may be a
    thousand.
    """
    if _DATE.match(text):
        raise ValueError(f"{quoted(text)} is a date or a time of day; format the column as text, and write it again")
    text = _GROUPED.sub("", text)
    thousands = _THOUSANDS.search(text.replace(".", ","))
    if "," in text or thousands:
        signs.setdefault("," if "," in text else ".", text)
    if "," in signs and (thousands or "." in signs):
        doubtful = text if thousands else signs["."]
        *digits, rest = re.findall(r"[0-9]+", doubtful)
        whole = "".join(digits)
        point = f"{whole}.{rest.rstrip('0') if rest.endswith('0') else f'{rest}0'}".rstrip(".")
        raise ValueError(f'{quoted(doubtful)} may be a decimal or thousands; write "{point}", or "{whole}{rest}"')
    return text.replace(",", ".")


def _name(text: str) -> str:
    return re.sub(r"\s+", "_", text.strip())


def _name_list(text: str, known: set[str]) -> YamlList:
    """Return the names of a cell: between commas, semicolons, lines or arrows; else one known name, or many words."""
    is_one = _name(text) in known
    parts = _ARROWS.split(text) if _ARROWS.search(text) else [text] if is_one else text.split()
    found = YamlList(0)
    found.extend(_name(part) for part in parts if part.strip())
    found.lines = [0] * len(found)
    return found


def import_tables(paths: Sequence[str], options: ImportOptions) -> Imported:
    """Read tables into one model; raise `HalpipeError` with everything that is wrong in them."""
    findings, coverage = Findings(), Coverage()
    tables = list(_tables(paths, findings, coverage))
    if not any(table.kind.name == "tasks" and table.rows for table in tables) and not findings.has_errors:
        begin = beginning_of(paths[0]) if paths and paths[0] != STDIO else b"?"
        help = advice_for(begin, "table", "name a table with the columns task, period and wcet")
        findings.add(NO_TABLE("no table has tasks", at=Location(paths[0] if paths else ""), help=help))
    findings.stop_on_errors()
    model = _Builder(tables, findings, coverage).model(options.name or PurePath(paths[0]).stem.replace(" ", "_"))
    findings.stop_on_errors()
    return Imported(model=model, diagnostics=tuple(findings.items), coverage=coverage)


def _tables(paths: Sequence[str], findings: Findings, coverage: Coverage) -> Iterator[_Table]:
    for path in dict.fromkeys(paths):
        try:
            sheets = read_sheets(path)
        except HalpipeError as failure:
            findings.extend(failure.diagnostics)
            continue
        for sheet in sheets:
            table = _table(sheet, findings, coverage)
            if table is not None:
                yield table


def _table(sheet: Sheet, findings: Findings, coverage: Coverage) -> _Table | None:
    """Return a sheet as a table: the first of its rows that has the heads of a kind begins it."""
    if sheet.title.lower().startswith(RESULTS):
        coverage.ignored("sheet", sheet.title, "the result of an export", Location(sheet.file))
        return None
    for place, (line, cells) in enumerate(() if sheet.is_hidden else sheet.rows[:HEADS]):
        kind = kind_of(cells, sheet.title)
        if kind is not None:
            coverage.dropped("row above a table", place) if place else None
            columns = columns_of(cells, kind)
            _judge(columns, kind, Location(sheet.file, line), findings, coverage)
            _refuse_merged(sheet, columns, line, findings)
            return _Table(kind, sheet, columns, len(cells), sheet.rows[place + 1 :])
    if sheet.rows:
        line, why, help = (0, "is hidden", "unhide it, or delete it") if sheet.is_hidden else _unlike(sheet)
        at = Location(sheet.file, line)
        findings.add(UNKNOWN_SHEET(f'sheet "{sheet.title}" {why}', at=at, help=help))
        coverage.ignored("sheet", sheet.title, why, at)
    return None


def _unlike(sheet: Sheet) -> tuple[int, str, str]:
    """Return the row of a sheet that is most like the heads of a table, what it lacks, and what to write."""
    likely = ((line, kind, columns_of(cells, kind)) for line, cells in sheet.rows[:HEADS] for kind in KINDS)
    line, kind, columns = max(likely, key=lambda found: sum(bool(column.key) for column in found[2]))
    keys = {column.key for column in columns} - {""}
    if not keys:
        known = "; ".join(f"{kind.name}: {', '.join(kind.needed)}" for kind in KINDS)
        help = "write heads above the rows, between commas, semicolons or tabs: Task, Period [ms], WCET [ms], Core; "
        return sheet.rows[0][0], "has no heads of a known table", f"{help}tables have: {known}"
    unread = [re.split(r"\s*[\[(]", column.head)[0] for column in columns if not column.key]
    missing = next(key for key in kind.needed if key not in keys)
    help = did_you_mean(missing, unread, f'add the column "{missing}"; each row below is one element')
    return line, f'is no known table: {kind.name} need the column "{missing}"', help


def _refuse_merged(sheet: Sheet, columns: list[Column], heads: int, findings: Findings) -> None:
    """Report merged cells below the heads: only the first of them has the value."""
    for left, top, right, bottom in sheet.merged:
        places = range(left - (top < bottom), right)
        found = [column.head for column in columns if column.key and column.place in places]
        if found and top > heads:
            text = f'sheet "{sheet.title}" has merged cells in the column "{found[0]}"'
            help = "split them, and write the value into each cell"
            findings.add(CONTRADICTION(text, at=Location(sheet.file, top), help=help))


def _judge(columns: list[Column], kind: Kind, at: Location, findings: Findings, coverage: Coverage) -> None:
    """Account for every column of a table."""
    twice = [key for key, count in Counter(column.key for column in columns).items() if key and count > 1]
    for key in twice:
        heads = ", ".join(column.head for column in columns if column.key == key)
        findings.add(CONTRADICTION(f'columns {heads} are all "{key}"', at=at, help="keep one of them"))
    for column in columns:
        if column.key:
            coverage.mapped("column")
            if not is_unit_of(column.unit, column.key):
                help = "write s, ms, us or ns; convert cycles and ticks to time"
                if column.key in SHARES:
                    help = f"state {column.key} as a share, such as 0.2 or 20 %"
                findings.add(UNKNOWN_UNIT(f'"{column.head}" has the unit {quoted(column.unit)}', at=at, help=help))
        elif plain(column.head) in REMARKS:
            coverage.ignored("column", column.head, "a remark", at)
        else:
            help = did_you_mean(plain(column.head), kind.columns, "columns: " + ", ".join(kind.columns))
            findings.add(UNKNOWN_COLUMN(f'column "{column.head}" of {kind.name} is not read', at=at, help=help))
            coverage.ignored("column", column.head, "not known", at)


class _Builder:
    """Collects elements from tables, then connects them by their names."""

    def __init__(self, tables: Sequence[_Table], findings: Findings, coverage: Coverage) -> None:
        self._findings = findings
        self._coverage = coverage
        self._tables = tables
        self._drafts: dict[str, _Draft] = {}
        self._names = set().union(*(table.names() for table in tables))

    def model(self, title: str) -> TaskModel:
        """Return the model of all tables."""
        for row in self._rows("tasks"):
            self._task(row)
        units = dict(self._elements("units", Unit))
        resources = dict(self._elements("resources", Resource))
        for row in self._rows("accesses"):
            self._access(row, resources)
        for draft in self._drafts.values():
            for unit in chain.from_iterable(version.units for version in draft.versions.values()):
                units.setdefault(unit, Unit(name=unit, at=draft.at))
        for row in self._rows("interrupts"):
            self._interrupt(row, units)
        self._fill(tuple(units))
        self._precede()
        modes = self._modes()
        self._tell_alike(units.values(), resources.values(), modes)
        for row in self._rows("precedences"):
            self._precedence(row)
        return TaskModel(
            name=title,
            units=tuple(units.values()),
            resources=tuple(resources.values()),
            tasks=tuple(
                Task(name=task, **one.stated, versions=tuple(one.versions.values()), at=one.at, origin=_origin(one.at))
                for task, one in self._drafts.items()
            ),
            chains=tuple(self._chains()),
            modes=modes,
            transitions=tuple(found for _, found in self._elements("transitions", Transition)),
            health=tuple(self._health()),
        )

    def _tell_alike(self, *elements: Iterable[Unit | Resource | Mode]) -> None:
        """Warn of names that are spelt in two ways: they are two elements."""
        named = [*self._drafts.items(), *((each.name, each) for each in chain.from_iterable(elements))]
        first: dict[tuple[type, str], str] = {}
        for spelt, each in named:
            other = first.setdefault((type(each), spelt.lower()), spelt)
            if other != spelt:
                text = f'"{spelt}" and "{other}" are two names, which differ in capitals alone'
                self._findings.add(ALIKE(text, at=each.at, help=f'write "{other}" in both places if they are one'))

    def _rows(self, kind: str) -> Iterator[Fields]:
        for table in self._tables:
            if table.kind.name == kind:
                for row in table.fields(self._findings, self._names):
                    self._coverage.mapped(f"row of {kind}")
                    yield row

    def _elements(self, kind: str, element: Callable[..., T], **also: Any) -> Iterator[tuple[str, T]]:
        seen: set[tuple[str, ...]] = set()
        for row in self._rows(kind):
            found = complete_attributes(row, element)  # type: ignore[arg-type]
            if found is None:
                continue
            key = (found["name"],) if "name" in found else (found["source"], found["target"])
            if key in seen:
                row.complain(CONTRADICTION, f"{' to '.join(key)} is there twice", help="keep one of the rows")
                continue
            seen.add(key)
            yield key[0], element(**found, **also, at=row.at(), origin=_origin(row.at()))

    # --------------------------------------------------------------------------------------------------- tasks

    def _task(self, row: Fields) -> None:
        task = row.get(TASK, name) if row.require(TASK) else None
        if task is None:
            return
        stated = {one: value.value for one, value in stated_attributes(row, Task, "name").items()}
        if task.value.lower() in SUMS and PERIOD not in row and AFTER not in row:
            row.complain(BAD_VALUE, "has no period and may be a sum", TASK, help="delete the row, or state its period")
            return
        draft = self._drafts.setdefault(task.value, _Draft({}, row.at()))
        for one, value in stated.items():
            if draft.stated.setdefault(one, value) != value:
                message = f"states {one} {value}, and line {draft.at.line} {draft.stated[one]}"
                help = "rename one of the two rows, or state for versions of one task what they share once"
                row.complain(CONTRADICTION, message, help=help)
        version = row.value(VERSION, name, DEFAULT)
        if version in draft.versions:
            help = "rename or remove one of the two rows, or name versions in a column `version`"
            row.complain(CONTRADICTION, f'version "{version}" is there twice', help=help)
        known = stated_attributes(row, TaskVersion, "name")
        values = {one: value.value for one, value in known.items()}
        draft.versions[version] = TaskVersion(name=version, **values, at=row.at(), origin=_origin(row.at()))
        draft.after += [(before.value, row.at(AFTER)) for before in row.texts(AFTER, name)]
        for mode in row.texts(MODES, name):
            draft.modes.setdefault(mode.value, []).append(version)

    def _fill(self, units: tuple[str, ...]) -> None:
        """State what empty cells mean: any unit; the period of what activates a task; a start within the period."""
        for task, draft in self._drafts.items():
            for version in draft.versions.values():
                if not version.units and units:
                    draft.versions[version.name] = replace(version, units=units)
                    self._coverage.defaulted(f'task "{task}"', "units", "all", version.at)
            if "slack" not in draft.stated:
                draft.stated["slack"] = 1
                self._coverage.defaulted(f'task "{task}"', "slack", "1: a job may start up to its deadline", draft.at)
        waiting = [task for task, draft in self._drafts.items() if "period" not in draft.stated]
        while found := {task: period for task in waiting if (period := self._inherited(task)) is not None}:
            for task, period in found.items():
                draft = self._drafts[task]
                draft.stated["period"] = period
                self._coverage.defaulted(f'task "{task}"', "period", f"{period}: that of its predecessor", draft.at)
            waiting = [task for task in waiting if task not in found]

    def _inherited(self, task: str) -> Duration | None:
        """Return the longest period of the predecessors of a task, None where one is not known."""
        periods = [self._period(before) for before, _ in self._drafts[task].after]
        known = [period for period in periods if period is not None]
        return max(known) if known and len(known) == len(periods) else None

    def _period(self, task: str) -> Duration | None:
        return self._drafts[task].stated.get("period") if task in self._drafts else None

    def _access(self, row: Fields, resources: dict[str, Resource]) -> None:
        found = complete_attributes(row, Access)
        task = self._known(row, TASK)
        if found is None or task is None:
            return
        resources.setdefault(found["resource"], Resource(name=found["resource"], at=row.at()))
        access = Access(**found, at=row.at())
        for each in self._versions(row, task):
            self._drafts[task].versions[each.name] = replace(each, accesses=(*each.accesses, access))

    def _versions(self, row: Fields, task: str) -> list[TaskVersion]:
        """Return the version of a task that a row names; all where it names none."""
        version, known = row.value(VERSION, name, ""), self._drafts[task].versions
        if version and version not in known:
            help = did_you_mean(version, known, "name one that its table has")
            row.complain(UNKNOWN_NAME, f'"{version}" is no version of task "{task}"', VERSION, help=help)
        return [each for each in known.values() if version in ("", each.name)]

    # ------------------------------------------------------------------------------------------ connections

    def _precede(self) -> None:
        """Order tasks that come after others: in the same cycle, the predecessor ends before the task starts."""
        for task, draft in self._drafts.items():
            for before, at in draft.after:
                path = about(task=task)
                if self._is_missing(before, at, path):
                    continue
                own, other = self._period(task), self._period(before)
                if before == task or own is None or other is None:
                    message = f'"{before}" cannot come before it in the same cycle: both need a period'
                    help = "state both periods, and name another task"
                    self._findings.add(BAD_VALUE(message, at=at, path=path, help=help))
                    continue
                # No more than these can lie between two jobs of a cycle, so that the constraint is an order alone.
                window = Precedence(
                    task=before, anchor=Anchor.END, match=Match.CYCLE, min=ZERO, max=own + own + other, at=at
                )
                self._add(task, draft.versions.values(), window)

    def _precedence(self, row: Fields) -> None:
        found = complete_attributes(row, Precedence, _WINDOW)
        to, before = self._known(row, "to"), self._known(row, "from")
        if found is None or to is None or before is None:
            return
        self._add(to, self._versions(row, to), Precedence(**found, origin=_origin(row.at()), at=row.at()))

    def _add(self, task: str, versions: Iterable[TaskVersion], window: Precedence) -> None:
        for each in tuple(versions):
            self._drafts[task].versions[each.name] = replace(each, precedences=(*each.precedences, window))

    def _chains(self) -> Iterator[Chain]:
        for _, found in self._elements("chains", Chain):
            for task in found.tasks:
                self._is_missing(task, found.at, about(chain=found.name))
            yield found

    def _is_missing(self, task: str, at: Location, path: str) -> bool:
        """Return whether a name is no task's, and report it."""
        if task not in self._drafts:
            help = did_you_mean(task, self._drafts, "name a task of the table")
            self._findings.add(UNKNOWN_NAME(f'"{task}" is no task', at=at, path=path, help=help))
        return task not in self._drafts

    def _health(self) -> Iterator[HealthRule]:
        for row in self._rows("health"):
            found = complete_attributes(row, HealthRule)
            if found is not None and self._known(row, TASK):
                yield HealthRule(**found, origin=_origin(row.at()), at=row.at())

    def _interrupt(self, row: Fields, units: dict[str, Unit]) -> None:
        found, unit = complete_attributes(row, Interrupt), row.get("unit", name)
        if found is None or unit is None or not row.require("unit"):
            return
        old = units.setdefault(unit.value, Unit(name=unit.value, at=row.at()))
        interrupt = Interrupt(**found, origin=_origin(row.at()), at=row.at())
        units[unit.value] = replace(old, interrupts=(*old.interrupts, interrupt))

    def _modes(self) -> tuple[Mode, ...]:
        """Return the modes that tables name; a task that names none runs in all of them."""
        stated = dict(self._elements("modes", Mode, runs=()))
        named: dict[str, Location] = {}
        for draft in self._drafts.values():
            for mode in draft.modes:
                named.setdefault(mode, draft.at)
        found = []
        for mode in {**stated, **named} or (DEFAULT,):
            runs = [
                Run(task=task, versions=tuple(draft.modes.get(mode, ()) if draft.modes else draft.versions))
                for task, draft in self._drafts.items()
                if not draft.modes or mode in draft.modes
            ]
            found.append(
                replace(stated.get(mode) or Mode(name=mode, runs=(), at=named.get(mode, NOWHERE)), runs=tuple(runs))
            )
        return tuple(found)

    def _known(self, row: Fields, key: str) -> str | None:
        found = row.get(key, name) if row.require(key) else None
        return None if found is None or self._is_missing(found.value, found.at, row.path) else found.value


def _origin(at: Location) -> Origin:
    return Origin(at.file, at.line)
