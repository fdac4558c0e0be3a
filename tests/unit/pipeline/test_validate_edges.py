"""Findings in full for systems one nanosecond, or one unit, below each limit, at it and above it."""

from dataclasses import replace
from fractions import Fraction

from golden_answers import assert_answers, findings
from halpipe.core.durations import Duration
from halpipe.models import HealthAction, HealthRule, Interrupt, Split
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.codes import UNUSED_RESOURCE, UNUSED_UNIT
from support import access, after, chain, mode, model, ms, task, version

NS = Duration(1)


def one(wcet=4, period=20, units="u1", parts=(), split=None, gang=1, **of_task):
    """A system of one task "a" with one version."""
    owner = replace(version("v", wcet, units, *parts, gang=gang), split=split or Split())
    return model(replace(task("a", period, owner), **of_task), units="u1 u2", resources="r")


def serving(system, *interrupts):
    """The units serve an interrupt each, of a distance and a time in nanoseconds."""
    pairs = zip(system.units, interrupts, strict=False)
    served = [
        replace(u, interrupts=(Interrupt(name="i", distance=Duration(d), wcet=Duration(w)),)) for u, (d, w) in pairs
    ]
    return replace(system, units=(*served, *system.units[len(served) :]))


def near(time):
    return [ms(time) + NS * k for k in (-1, 0, 1)]


def split_of(*points, **rest):
    return Split(points=tuple(map(ms, points)), **rest)


def rule(count=1, cycles=1):
    health = (HealthRule(task="a", action=HealthAction.STOP, count=count, cycles=cycles),)
    return replace(one(), health=health)


def demanding(wcet):
    return model(
        task("a", 20, version("v", 1, "u1", after("d", 0, 40))),
        task("d", None, version("v", wcet, "u2")),
        units="u1 u2",
    )


def chained(reaction=None, age=None):
    tasks = task("a", 20, version("v", 4)), task("b", 20, version("v", 3, "u1", after("a", 0, 40)))
    return model(*tasks, chains=[chain("c", "a b", reaction, age)])


EDGES = {
    "deadline": [one(4, deadline=t) for t in near(4)],
    "deadline of nothing": [one(4, deadline=ms(0))],
    "period": [one(4, t) for t in near(4)],
    "period within a deadline": [one(4, t, deadline=ms(8)) for t in near(4)],
    "let": [one(4, let=t) for t in near(4)],
    "let as long as the deadline": [one(9, let=t, deadline=ms(8)) for t in near(8)],
    "arrivals and period": [one(1, distance=t, slack=Fraction(1)) for t in near(20)],
    "arrivals and a job": [one(4, distance=t, slack=Fraction(1)) for t in near(24)],
    "arrivals and a deadline": [one(4, distance=ms(30), deadline=t, slack=Fraction(1)) for t in near(24)],
    "arrivals without room": [one(4, distance=ms(30), deadline=t, slack=Fraction(1)) for t in near(4)],
    "arrivals with half a slack": [one(t, distance=ms(24), slack=Fraction(1, 2)) for t in near(14)],
    "arrivals with half a slack and a deadline": [
        one(t, distance=ms(24), deadline=ms(22), slack=Fraction(1, 2)) for t in near(12)
    ],
    "slack": [one(slack=Fraction(n, 10)) for n in (-1, 0, 10, 11)],
    "hyperperiod": [demanding(t) for t in near(20)],
    "offset": [one(offset=t) for t in near(0)],
    "units filled": [
        model(task("a", 20, version("v", 12)), task("b", 20, version("v", t)), units="u1") for t in near(8)
    ],
    "units filled beside interrupts": [serving(one(t), (10_000_000, 2_000_000)) for t in near(16)],
    "resource filled": [one(10, 10, parts=[access("r", 0, 5), access("r", 5, t)]) for t in near(10)],
    "phase ends": [one(4, parts=[access("r", 1, t)]) for t in near(4)],
    "phase starts": [one(4, parts=[access("r", t, 2)]) for t in near(2)],
    "phase at the start": [one(4, parts=[access("r", t, 2)]) for t in near(0)],
    "phases meet": [one(4, parts=[access("r", 0, t), access("r", 2, 3)]) for t in near(2)],
    "phases meet the other way": [one(4, parts=[access("r", 2, 3), access("r", 0, t)]) for t in near(2)],
    "phases at one end": [one(4, parts=[access("r", 0, 2), access("r", t, 2)]) for t in near(1)],
    "bounds": [one(4, parts=[access("r", 0, 2, Fraction(n, 10))]) for n in (-1, 0, 1, 10, 11)],
    "bounds that overlap": [
        one(4, parts=[access("r", 0, 2, "1/2"), access("r", 1, 3, Fraction(n, 10))]) for n in (4, 5, 6)
    ],
    "phases met beside interrupts": [
        serving(one(6, parts=[access("r", 0, 1), access("r", t, 5)]), (10_000_000, 1_000_000)) for t in near(2)
    ],
    "interrupt": [serving(one(1), (1000, 1000 + n)) for n in (-1000, -1, 0, 1)],
    "interrupt without a distance": [serving(one(1), (0, 1)), serving(one(1), (-1, 1))],
    "interrupts of a gang": [serving(one(1, units="u1 u2", gang=2), (1000, 500), (1000, 500 + n)) for n in (-1, 0, 1)],
    "interrupts of a gang of one": [
        serving(one(1, units="u1 u2", gang=n), (1000, 600), (1000, 600)) for n in (0, 1, 2)
    ],
    "interrupts of one unit": [serving(one(1, units="u1 u2", gang=2), (1000, 1000)), serving(one(1), (1000, 500))],
    "gang": [one(units=units, gang=n) for units in ("u1", "u1 u2") for n in (-1, 0, 1, 2, 3)],
    "gang without units": [one(units="", gang=n) for n in (0, 1, 2)],
    "split points at the ends": [one(4, split=split_of(t)) for t in near(4) + near(0)],
    "split points in order": [one(4, split=split_of(2, t)) for t in near(2)],
    "split point in a phase": [one(4, parts=[access("r", 1, 3)], split=split_of(t)) for t in near(1) + near(3)],
    "split points in a phase": [one(4, parts=[access("r", 0, 4)], split=split_of(1, 2, 3))],
    "smallest part": [one(4, split=Split(anywhere=True, max_gaps=1, min_part=t)) for t in near(2)],
    "gaps": [one(4, split=Split(anywhere=True, max_gaps=n)) for n in (None, 0, 1)],
    "gaps of a list": [one(4, split=split_of(2, max_gaps=n)) for n in (None, 0, 1)],
    "without effect": [
        one(4, split=Split(resume=ms(1))),
        one(4, split=Split(max_gaps=1, min_part=ms(1))),
        one(4, split=split_of(2, min_part=ms(1))),
    ],
    "health": [rule(n) for n in (-1, 0, 1, 255, 256)] + [rule(1, n) for n in (0, 1, 255, 256)],
    "chains": [chained(t) for t in near(27)] + [chained(None, t) for t in near(7)],
    "window": [
        model(task("a", 20, version("v", 2, "u1", after("b", 2, t))), task("b", 20, version("v", 2))) for t in near(2)
    ],
    "a switch": [
        model(a, b, modes=[mode("m", [a]), mode("n", [b])], transitions=[("m", "n", t)])
        for a, b in [(task("a", 20, version("v", 2)), task("b", 20, version("v", 2)))]
        for t in near(0)
    ],
    "arrivals and the shortest of versions": [
        replace(system, tasks=(replace(system.tasks[0], versions=(*system.tasks[0].versions, version("w", 9))),))
        for system in (one(4, distance=t, slack=Fraction(1)) for t in near(24))
    ],
    "many split points": [
        one(4, split=split_of(5, 6, 7, 8, 9)),
        one(4, split=split_of(3, 2, 2, 1, 1)),
        one(6, parts=[access("r", 0, 6)], split=split_of(1, 2, 3, 4, 5)),
    ],
}


def told(system):
    left_out = {UNUSED_RESOURCE.id, UNUSED_UNIT.id}
    return findings(found for found in validate(system) if found.code not in left_out) or ["nothing"]


def test_findings_at_the_edges_of_the_limits():
    answers = {
        f"{name} {n}": lambda s=system: told(s) for name, all in EDGES.items() for n, system in enumerate(all, 1)
    }
    assert_answers("validate-edges", answers)
