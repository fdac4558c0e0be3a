"""Faults that are put into a model and its schedule: in the XML, as another tool would write it."""

from __future__ import annotations

from copy import deepcopy
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias

from halpipe.core.durations import ZERO, Duration

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from lxml import etree

    Element: TypeAlias = Any
    Operator: TypeAlias = Callable[[Random, Element, Element], None]

MODEL = "{urn:halpipe:task-model:1}"
SCHEDULE = "{urn:halpipe:schedule:1}"
SMALL = (Fraction(1, 1000), Fraction(1, 3), Fraction(1), Fraction(1000), Fraction(10**6, 3), Fraction(10**6))
"""By how many nanoseconds an instant is moved."""

TIMES = ("start", "end", "from", "to", "length", "worst-latency", "hyperperiod", "reaction", "age", "busy")
DURATIONS = ("period", "deadline", "distance", "offset", "wcet", "min", "max", "resume", "min-part", "max-length")
LIMITS = (*DURATIONS, "max-reaction", "max-age", "start", "end")


def scaled(root: etree._Element, factor: Fraction) -> None:
    """Multiply every duration of a document: what was valid stays valid, with times that no decimal can write."""
    for element in root.iter():
        for name in {*TIMES, *LIMITS} & set(element.attrib):
            _put(element, name, _get(element, name) * factor) if _is_time(element, name) else None
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


def _is_time(element: etree._Element, name: str) -> bool:
    """Tell whether the attribute holds a time: `from` and `to` are names elsewhere."""
    return name not in ("from", "to") or element.tag == f"{SCHEDULE}part"


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


def _drop_job(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    if job is not None:
        job.getparent().remove(job)


def _drop_part(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    parts = schedule.findall(f".//{SCHEDULE}part")
    if parts:
        part = rng.choice(parts)
        part.getparent().remove(part)


def _swap(name: str) -> Operator:
    def swap(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
        one, two = _job(rng, schedule), _job(rng, schedule)
        if one is not None and two is not None:
            mine, theirs = one.get(name), two.get(name)
            one.set(name, theirs)
            two.set(name, mine)

    return swap


def _number(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    if job is not None:
        job.set("index", str(rng.randrange(9)))


def _other_units(rng: Random, model: etree._Element, schedule: etree._Element) -> None:
    job = _job(rng, schedule)
    units = [unit.get("name") for unit in model.iter(f"{MODEL}unit")]
    if job is not None:
        job.set("units", " ".join(sorted(rng.sample(units, rng.randrange(1, min(3, len(units)) + 1)))))


def _figure(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    kinds: tuple[tuple[str, str], ...] = (
        ("mode", "hyperperiod"),
        ("transition", "worst-latency"),
        ("transition", "length"),
    )
    kinds += (("chain", "reaction"), ("chain", "age"))
    places = [(e, name) for kind, name in kinds for e in schedule.iter(SCHEDULE + kind) if name in e.attrib]
    if places:
        _move(rng, *rng.choice(places))


def _limit(rng: Random, model: etree._Element, _: etree._Element) -> None:
    kinds: tuple[tuple[str, str], ...] = (
        ("task", "deadline"),
        ("precedence", "max"),
        ("chain", "max-reaction"),
        ("chain", "max-age"),
    )
    kinds += (("transition", "max-length"),)
    places = [(e, name) for kind, name in kinds for e in model.iter(MODEL + kind) if name in e.attrib]
    if places:
        element, name = rng.choice(places)
        _put(element, name, _get(element, name) * Fraction(rng.randrange(1, 12), 8))


def _bound(rng: Random, model: etree._Element, _: etree._Element) -> None:
    accesses = list(model.iter(f"{MODEL}access"))
    if accesses:
        rng.choice(accesses).set("bound", f"{rng.randrange(1, 8)}/7")


def _slack(rng: Random, model: etree._Element, _: etree._Element) -> None:
    tasks = [task for task in model.iter(f"{MODEL}task") if task.get("slack")]
    if tasks:
        rng.choice(tasks).set("slack", f"{rng.randrange(12)}/11")


def _drop_switch(rng: Random, _: etree._Element, schedule: etree._Element) -> None:
    tables = schedule.findall(f"{SCHEDULE}transition")
    if tables:
        for job in list(rng.choice(tables)):
            job.getparent().remove(job)


OPERATORS: dict[str, Operator] = {
    "a job elsewhere": _shift_job,
    "one instant elsewhere": _bend_time,
    "a job less": _drop_job,
    "a part less": _drop_part,
    "units of another job": _swap("units"),
    "number of another job": _swap("index"),
    "version of another job": _swap("version"),
    "another number": _number,
    "other units": _other_units,
    "a wrong figure": _figure,
    "another limit": _limit,
    "another bound": _bound,
    "another slack": _slack,
    "an empty table": _drop_switch,
}
