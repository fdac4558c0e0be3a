"""Faults that are put into a model and its schedule: in the XML, as another tool would write it."""

from __future__ import annotations

from copy import deepcopy
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias

from halpipe.core.durations import ZERO, Duration

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from random import Random

    from lxml import etree

    Element: TypeAlias = Any
    Operator: TypeAlias = Callable[[Random, Element, Element], None]

MODEL = "{urn:halpipe:task-model:1}"
SCHEDULE = "{urn:halpipe:schedule:1}"
SMALL = (Fraction(1, 1000), Fraction(1, 3), Fraction(1), Fraction(1000), Fraction(10**6, 3), Fraction(10**6))
"""By how many nanoseconds an instant is moved."""

TIMES = ("start", "end", "from", "to", "length", "worst-latency", "hyperperiod", "latency", "reaction", "age", "busy")
DURATIONS = ("period", "deadline", "distance", "offset", "wcet", "min", "max", "resume", "min-part", "max-length")
LIMITS = (*DURATIONS, "let", "point", "max-latency", "max-reaction", "max-age", "start", "end")
INSTANTS = {"precedence": ("start", "end", "release", "point"), "chain": ("start", "end", "release")}


def scaled(root: etree._Element, factor: Fraction) -> None:
    """Multiply every duration of a document: what was valid stays valid, with times that no decimal can write."""
    for element in root.iter():
        for name in {*TIMES, *LIMITS} & set(element.attrib):
            if name not in ("from", "to") or element.tag == f"{SCHEDULE}part":  # elsewhere these two are names
                _put(element, name, _get(element, name) * factor)
        if element.tag == f"{MODEL}version" and element.get("split", "none") not in ("none", "anywhere"):
            element.set("split", " ".join(str(Duration.parse(p) * factor) for p in element.get("split").split()))


def with_tables(schedule: etree._Element) -> None:
    """Give every switch a table: one cycle of the mode to come, without what enters."""
    modes = {mode.get("name"): mode for mode in schedule.iter(f"{SCHEDULE}mode")}
    for table in schedule.iter(f"{SCHEDULE}transition"):
        if _get(table, "length") == ZERO and table.get("status") == "valid":
            length = _get(modes[table.get("to")], "hyperperiod")
            _put(table, "length", length)
            _put(table, "worst-latency", _get(table, "worst-latency") + length)
            running = {job.get("task") for job in modes[table.get("from")].iter(f"{SCHEDULE}job")}
            jobs = modes[table.get("to")].iter(f"{SCHEDULE}job")
            table.extend(deepcopy(job) for job in jobs if job.get("task") in running)


def _get(element: etree._Element, name: str) -> Duration:
    return Duration.parse(element.get(name))


def _put(element: etree._Element, name: str, value: Duration) -> None:
    element.set(name, str(max(value, ZERO)))


def _move(rng: Random, element: etree._Element, *names: str) -> None:
    by = Duration(rng.choice(SMALL))
    later = rng.random() < Fraction(1, 2)
    for name in names:
        value = _get(element, name)
        _put(element, name, value + by if later or value < by else value - by)


def _job(rng: Random, schedule: etree._Element) -> etree._Element | None:
    jobs = schedule.findall(f".//{SCHEDULE}job")
    return rng.choice(jobs) if jobs else None


def _shift_job(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    if job is None:
        return
    by, later = Duration(rng.choice((*SMALL, Fraction(5 * 10**6)))), rng.random() < Fraction(1, 2)
    for element in (job, *job):
        for name in ("start", "end"):
            value = _get(element, name)
            _put(element, name, value + by if later else value - min(by, value))


def _bend_time(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    places = [
        (e, name) for e in schedule.iter(f"{SCHEDULE}job", f"{SCHEDULE}part") for name in TIMES if name in e.attrib
    ]
    if places:
        _move(rng, *rng.choice(places))


def _drop(kind: str) -> Operator:
    def drop(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
        found = schedule.findall(f".//{SCHEDULE}{kind}")
        if found:
            element = rng.choice(found)
            element.getparent().remove(element)

    return drop


def _change(kind: str, name: str, value: Callable[[Random], str], needs: str = "") -> Operator:
    """Return what changes an attribute of an element of the model, of those that have the attribute it `needs`."""

    def change(rng: Random, model: etree._Element, _: etree._Element) -> None:
        found = [element for element in model.iter(MODEL + kind) if not needs or element.get(needs)]
        if found:
            rng.choice(found).set(name, value(rng))

    return change


def _number(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    if job is not None:
        job.set("index", str(rng.randrange(9)))


def _swap(name: str) -> Operator:
    def swap(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
        one, two = _job(rng, schedule), _job(rng, schedule)
        if one is not None and two is not None:
            mine, theirs = one.get(name), two.get(name)
            one.set(name, theirs)
            two.set(name, mine)

    return swap


def _other_units(rng: Random, model: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    units = [unit.get("name") for unit in model.iter(f"{MODEL}unit")]
    if job is not None:
        job.set("units", " ".join(sorted(rng.sample(units, rng.randrange(1, min(3, len(units)) + 1)))))


FIGURES = {
    SCHEDULE: {
        "mode": ("hyperperiod",),
        "transition": ("worst-latency", "length"),
        "chain": ("latency", "reaction", "age"),
    },
    MODEL: {
        "task": ("deadline", "let"),
        "precedence": ("max", "min"),
        "chain": ("max-latency", "max-reaction", "max-age"),
        "transition": ("max-length",),
    },
}
"""What a schedule reports, and what a model limits, by the name of the element."""


def _stated(root: Element, space: str) -> list[tuple[Element, str]]:
    kinds = FIGURES[space].items()
    return [(e, name) for kind, names in kinds for e in root.iter(space + kind) for name in names if name in e.attrib]


def _figure(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    places = _stated(schedule, SCHEDULE)
    if places:
        _move(rng, *rng.choice(places))


def _limit(rng: Random, model: etree._Element, _: etree._Element) -> None:
    places = _stated(model, MODEL)
    if places:
        element, name = rng.choice(places)
        _put(element, name, _get(element, name) * Fraction(rng.randrange(1, 12), 8))


def _limit_at_its_edge(rng: Random, model: etree._Element, schedule: etree._Element) -> None:
    """Make a limit what the schedule just keeps, or by the least amount does not."""
    places = [*_chain_edges(model, schedule), *_length_edges(model, schedule), *_job_edges(rng, model, schedule)]
    if places:
        element, name, value = rng.choice(places)
        by = Duration(rng.choice((Fraction(0), *SMALL[:3])))
        least = Duration(SMALL[0]) if name != "min" else ZERO
        later = name == "min" or rng.random() < Fraction(1, 4)
        _put(element, name, max(value + by if later else value - min(by, value), least))


Limit: TypeAlias = "tuple[Element, str, Duration]"


def _chain_edges(model: Element, schedule: Element) -> Iterator[Limit]:
    for limited in model.iter(f"{MODEL}chain"):
        for figures in schedule.iter(f"{SCHEDULE}chain"):
            for what in ("latency", "reaction", "age") if figures.get("name") == limited.get("name") else ():
                if figures.get(what):
                    yield limited, f"max-{what}", _get(figures, what)


def _length_edges(model: Element, schedule: Element) -> Iterator[Limit]:
    lengths = {(t.get("from"), t.get("to")): _get(t, "length") for t in schedule.iter(f"{SCHEDULE}transition")}
    for switch in model.iter(f"{MODEL}transition"):
        if (switch.get("from"), switch.get("to")) in lengths:
            yield switch, "max-length", lengths[switch.get("from"), switch.get("to")]


def _job_edges(rng: Random, model: Element, schedule: Element) -> Iterator[Limit]:
    """Yield the limits of the task of one job: from its release, and from jobs of its predecessors."""
    job = _job(rng, schedule)
    if job is None:
        return
    for task in model.iter(f"{MODEL}task"):
        if task.get("name") != job.get("task") or not task.get("period"):
            continue
        release = Duration.parse(task.get("offset", "0ms")) + _get(task, "period") * int(job.get("index"))
        for name in ("deadline", "let") if _get(job, "end") > release else ():
            if task.get(name):
                yield task, name, _get(job, "end") - release
        for row in task.iter(f"{MODEL}precedence"):
            own = _get(job, "end" if row.get("to") == "end" else "start")
            for other in job.getparent().iter(f"{SCHEDULE}job"):
                before = _get(other, "start" if row.get("from") == "start" else "end")
                if other.get("task") == row.get("task") and before <= own:
                    yield from ((row, name, own - before) for name in ("min", "max") if row.get(name))


def _instant(rng: Random, model: etree._Element, _: etree._Element) -> None:
    """Let a window or a chain count between other instants."""
    places = [(e, kind) for kind in INSTANTS for e in model.iter(MODEL + kind)]
    if not places:
        return
    element, kind = rng.choice(places)
    if rng.random() < Fraction(1, 2):
        element.set("to", rng.choice(("start", "end")))
    elif kind == "precedence" and rng.random() < Fraction(1, 2):
        element.set("match", rng.choice(("window", "cycle")))
    else:
        _count_from(element, rng.choice(INSTANTS[kind]), rng)


def _count_from(element: etree._Element, instant: str, rng: Random) -> None:
    element.attrib.pop("point", None)
    element.set("from", instant)
    if instant == "point":
        _put(element, "point", _get(element, "max") * Fraction(rng.randrange(4), 16))


def _let(rng: Random, model: etree._Element, _: etree._Element) -> None:
    tasks = [task for task in model.iter(f"{MODEL}task") if task.get("period")]
    task = rng.choice(tasks)
    _put(task, "let", _get(task, "deadline" if task.get("deadline") else "period") * Fraction(rng.randrange(1, 9), 8))


def _lock(rng: Random, model: etree._Element, _: etree._Element) -> None:
    """Let a resource be held whole; or in shares, if it was."""
    resources = list(model.iter(f"{MODEL}resource"))
    if not resources:
        return
    chosen = rng.choice(resources)
    chosen.set("kind", "memory" if chosen.get("kind") == "lock" else "lock")
    for access in model.iter(f"{MODEL}access"):
        if access.get("resource") == chosen.get("name") and chosen.get("kind") == "lock":
            access.set("bound", "1")


def _edge(rng: Random, model: etree._Element, _: etree._Element) -> None:
    mode = rng.choice(list(model.iter(f"{MODEL}mode")))
    mode.set("edge", "open" if mode.get("edge") == "closed" else "closed")


def _drop_switch(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    tables = schedule.findall(f"{SCHEDULE}transition")
    if tables:
        for job in list(rng.choice(tables)):
            job.getparent().remove(job)


OPERATORS: dict[str, Operator] = {
    "a job elsewhere": _shift_job,
    "one instant elsewhere": _bend_time,
    "a job less": _drop("job"),
    "a part less": _drop("part"),
    "units of another job": _swap("units"),
    "number of another job": _swap("index"),
    "version of another job": _swap("version"),
    "another number": _number,
    "other units": _other_units,
    "a wrong figure": _figure,
    "another limit": _limit,
    "a limit at its edge": _limit_at_its_edge,
    "another instant": _instant,
    "another logical execution time": _let,
    "a lock or none": _lock,
    "another edge": _edge,
    "another binding": _change("task", "binding", lambda rng: rng.choice(("job", "mode", "system"))),
    "another bound": _change("access", "bound", lambda rng: f"{rng.randrange(1, 8)}/7"),
    "another slack": _change("task", "slack", lambda rng: f"{rng.randrange(12)}/11", needs="slack"),
    "an empty table": _drop_switch,
}
