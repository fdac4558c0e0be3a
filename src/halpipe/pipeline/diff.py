"""Differences of two schedules or two task models: elements match by name, values compare exactly."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.models import Access, Job, ModeSchedule, Precedence, Schedule, Split, TaskModel, TransitionTable
from halpipe.models.attributes import texts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.durations import Duration

ADDED, REMOVED, CHANGED = "added", "removed", "changed"
MOVED, PARTS, VERSION, UNITS = "moved", "parts", "version", "units"


@record
class Change:
    """A value that differs: which element, what of it, and both values as text ("" where there is none)."""

    element: str
    what: str
    before: str = ""
    after: str = ""


@record
class JobChange:
    """A job that only one schedule has, or that differs: `before` or `after` is None where it is absent."""

    table: str
    before: Job | None
    after: Job | None

    @property
    def job(self) -> Job:
        """The job, for its task and index."""
        job = self.after or self.before
        assert job is not None, "one of them is there"
        return job

    @property
    def kinds(self) -> tuple[str, ...]:
        """Changes of the job: added, removed, or any of moved, parts, version, units."""
        before, after = self.before, self.after
        if before is None or after is None:
            return (ADDED,) if before is None else (REMOVED,)
        found = (
            (MOVED, before.start != after.start),
            (PARTS, _pieces(before) != _pieces(after)),
            (VERSION, before.version != after.version),
            (UNITS, set(before.units) != set(after.units)),
        )
        # an end that differs although start and version do not tells of another WCET
        return tuple(kind for kind, differs in found if differs) or (CHANGED,)


@record
class TaskSummary:
    """Changed jobs of a task in a table, by kind; `shift` is set where all moved by the same time."""

    table: str
    task: str
    jobs: int
    counts: tuple[tuple[str, int], ...]
    shift: Duration | None


@record
class ScheduleDiff:
    """The differences of two schedules; `about` (who made them, with which seed) does not count as one."""

    about: tuple[Change, ...]
    values: tuple[Change, ...]
    tasks: tuple[TaskSummary, ...]
    jobs: tuple[JobChange, ...]

    @property
    def is_same(self) -> bool:
        """Whether both say the same of the system."""
        return not self.values and not self.jobs


def diff_schedules(before: Schedule, after: Schedule) -> ScheduleDiff:
    """Compare two schedules: their jobs by task and index, and their figures."""
    about = _fields("schedule", before, after, ("generator", "solver", "seed", "tick"))
    values = _fields("schedule", before, after, ("model", "model_sha256", "reactions"))
    summaries: list[TaskSummary] = []
    jobs: list[JobChange] = []
    for name, one, other in _tables(before, after):
        values += _table_values(name, one, other)
        found = list(_jobs(name, one, other))
        summaries += _summaries(name, found, one, other)
        jobs += found
    return ScheduleDiff(tuple(about), tuple(values), tuple(summaries), tuple(jobs))


def _tables(before: Schedule, after: Schedule) -> Iterator[tuple[str, Any, Any]]:
    """Yield the tables of modes and of switches by name, None where one schedule has none."""
    for label, own, others in (
        ("mode", before.modes, after.modes),
        ("transition", before.transitions, after.transitions),
    ):
        ones, twos = _by_key(own), _by_key(others)
        for key in dict.fromkeys((*ones, *twos)):
            yield f'{label} "{key}"', ones.get(key), twos.get(key)


def _table_values(
    name: str, before: ModeSchedule | TransitionTable | None, after: ModeSchedule | TransitionTable | None
) -> list[Change]:
    if before is None or after is None:
        return [Change(name, ADDED if before is None else REMOVED)]
    return _fields(name, before, after, [f.name for f in fields(before) if f.compare and f.name != "jobs"])


def _jobs(
    name: str, before: ModeSchedule | TransitionTable | None, after: ModeSchedule | TransitionTable | None
) -> Iterator[JobChange]:
    ones = {(job.task, job.index): job for job in (before.jobs if before else ())}
    twos = {(job.task, job.index): job for job in (after.jobs if after else ())}
    for key in sorted(ones.keys() | twos.keys()):
        one, two = ones.get(key), twos.get(key)
        if one is None or two is None or _meaning(one) != _meaning(two):
            yield JobChange(name, one, two)


def _meaning(job: Job) -> tuple[object, ...]:
    return job.start, job.end, job.version, frozenset(job.units), job.parts


def _pieces(job: Job) -> list[tuple[Duration, Duration, Duration]]:
    """Return how a job is cut into parts, from its start, so that one that only moved is still cut alike."""
    return [(part.start - job.start, part.executed_from, part.executed_to) for part in job.parts]


def _summaries(
    name: str,
    jobs: Sequence[JobChange],
    before: ModeSchedule | TransitionTable | None,
    after: ModeSchedule | TransitionTable | None,
) -> Iterator[TaskSummary]:
    totals: Counter[str] = Counter()
    for table in (before, after):
        totals |= Counter(job.task for job in (table.jobs if table else ()))
    by_task = grouped((change.job.task, change) for change in jobs)
    hyperperiod = getattr(before, "hyperperiod", None)
    for task, changes in sorted(by_task.items()):
        counts = Counter(kind for change in changes for kind in change.kinds)
        ordered = tuple(
            (kind, counts[kind]) for kind in (ADDED, REMOVED, MOVED, PARTS, VERSION, UNITS, CHANGED) if counts[kind]
        )
        shift = _shift(changes, hyperperiod) if counts[MOVED] == totals[task] else None
        yield TaskSummary(name, task, totals[task], ordered, shift)


def _shift(changes: Sequence[JobChange], hyperperiod: Duration | None) -> Duration | None:
    """Return by how much all jobs start later, the shorter way round the hyperperiod; None where they differ."""
    pairs = ((change.before, change.after) for change in changes)
    found = {(two.start - one.start) for one, two in pairs if one is not None and two is not None}
    if hyperperiod:
        half = hyperperiod / 2
        found = {(shift + half) % hyperperiod - half for shift in found}
    return found.pop() if len(found) == 1 else None


# ------------------------------------------------------------------------------------------------ models


def diff_models(before: TaskModel, after: TaskModel) -> tuple[Change, ...]:
    """Compare two task models element by element, by name; where they were imported from does not count."""
    return tuple(_elements("model", before, after))


def _elements(element: str, before: Any, after: Any) -> list[Change]:
    names = [f.name for f in fields(before) if f.compare and f.name != "origin"]
    return list(_fields(element, before, after, names))


def _fields(element: str, before: Any, after: Any, names: Sequence[str]) -> list[Change]:
    """Compare some fields of two values of one class; elements inside are compared in turn."""
    found: list[Change] = []
    for name in names:
        one, two = getattr(before, name), getattr(after, name)
        what = name.replace("_", "-")
        if isinstance(one, tuple) and isinstance(two, tuple):
            found += _members(element, what, one, two)
        elif isinstance(one, Split) and isinstance(two, Split):
            found += _splits(element, one, two)
        elif is_dataclass(one) and type(one) is type(two):
            found += _elements(f"{element} {what}", one, two)
        elif one != two:
            found.append(Change(element, what, _text(one), _text(two)))
    return found


def _splits(element: str, before: Split, after: Split) -> Iterator[Change]:
    """Compare where jobs may be interrupted, in the words of the model."""
    one, two = ("anywhere" if split.anywhere else _text(split.points) or "none" for split in (before, after))
    if one != two:
        yield Change(element, "split", one, two)
    yield from _fields(element, before, after, ("resume", "max_gaps", "min_part"))


def _members(element: str, what: str, before: tuple[Any, ...], after: tuple[Any, ...]) -> Iterator[Change]:
    """Compare lists: named elements by name, others as a whole."""
    ones, twos = _by_key(before), _by_key(after)
    if len(ones) < len(before) or len(twos) < len(after):  # nothing to tell the members by
        one, two = ", ".join(map(_text, before)), ", ".join(map(_text, after))
        if one != two:
            yield Change(element, what, one, two)
        return
    kind = what.removesuffix("s")
    inside = "" if element == "model" else f"{element} "
    for key in dict.fromkeys((*ones, *twos)):
        name = f'{inside}{kind} "{key}"'
        if key not in ones or key not in twos:
            yield Change(name, ADDED if key not in ones else REMOVED)
        else:
            yield from _elements(name, ones[key], twos[key])
    common = [key for key in ones if key in twos]
    if common != [key for key in twos if key in ones]:
        orders = (" ".join(f'"{key}"' for key in keys) for keys in (common, (k for k in twos if k in ones)))
        yield Change(element, f"order of {what}", *orders)


def _by_key(members: Sequence[Any]) -> dict[str, Any]:
    """Return the members by what tells them apart; those without such a thing are left out."""
    return {key: member for member in members if (key := _key(member))}


def _key(member: Any) -> str:
    if not is_dataclass(member) or isinstance(member, Access | Precedence):
        return ""
    if hasattr(member, "target"):
        return f'{getattr(member, "source", "")}" to "{member.target}'
    for name in ("name", "task", "unit", "resource"):
        if hasattr(member, name):
            return str(getattr(member, name))
    return ""


def _text(value: Any) -> str:
    """Print a value on one line."""
    if value is None:
        return "none"
    if isinstance(value, Fraction):
        return format_rational(value)
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    if isinstance(value, Access):
        kind = f" {value.kind}" if value.kind else ""
        moved = "".join(f" {t.buffer}:{t.symbol}:{t.size}B" for t in value.transfers)
        return f"{value.resource} [{value.start}, {value.end}) {format_rational(value.bound)}{kind}{moved}"
    if isinstance(value, Precedence):
        stated = texts(value, "task", "from", "min", "max")
        more = "".join(f" {name}={stated[name]}" for name in stated)
        return f"{value.task} {value.anchor} [{value.min}, {value.max}]{more}"
    if is_dataclass(value) and not isinstance(value, type):
        return " ".join(f"{f.name}={_text(getattr(value, f.name))}" for f in fields(value) if f.compare)
    return str(value.value if isinstance(value, Enum) else value)
