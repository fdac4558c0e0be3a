"""Findings in full for systems one nanosecond, or one unit, below each limit, at it and above it."""

from dataclasses import replace
from fractions import Fraction

import pytest
from validate_cases import found

from golden_answers import assert_answers, findings
from halpipe.core.durations import Duration
from halpipe.models import Anchor, HealthAction, HealthRule, Interrupt, Match, Split
from halpipe.pipeline.validate import codes, load, validate
from halpipe.pipeline.validate.codes import UNUSED_RESOURCE, UNUSED_UNIT
from halpipe.pipeline.validate.hyperperiod import MAX_JOBS
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


def same_cycle(low, high, *others, slack=0, anchor=Anchor.START, periods=(20, 20), offsets=(5, 2)):
    """A task "a" in a window after the job of "b" of the same cycle, 3 ms after its release, or as periods differ."""
    rows = [replace(after("b", *pair), match=Match.CYCLE, anchor=anchor) for pair in ((low, high), *others)]
    first = task("a", periods[0], version("v", 1, "u1", *rows), offset=offsets[0], slack=slack)
    return model(first, task("b", periods[1], version("v", 1), offset=offsets[1], slack=slack))


def asking(anchor, **changes):
    row = replace(after("b", 0, 60), anchor=anchor, **changes)
    return model(task("a", 20, version("v", 1, "u1", row)), task("b", 20, version("v", 4), version("w", 5)))


def timed(limit, let=None, tasks="a b", **of_chain):
    """A limit of latency over tasks of 4 ms and 3 ms."""
    first = replace(task("a", 20, version("v", 4)), let=ms(let))
    second = task("b", 20, version("v", 3))
    return model(first, second, chains=[replace(chain("c", tasks), max_latency=limit, **of_chain)])


def ring(count, times=1):
    """Some rings of tasks, of which each needs the one before it."""
    names = [[f"t{turn}x{n}" for n in range(count)] for turn in range(times)]
    rings = [(name, turn[n - 1]) for turn in names for n, name in enumerate(turn)]
    return model(*(task(name, 20, version("v", "1us", "u1", after(needed, 0, 60))) for name, needed in rings))


def shared(bounds, end):
    """A task whose versions need different shares of 20 ms, and another one that needs the rest."""
    versions = [version(f"v{n}", 15, "u1", access("r", 0, length, "1/2")) for n, length in enumerate(bounds)]
    other = task("b", 20, version("v", 20, "u2", access("r", 0, end)))
    return model(task("a", 20, *versions), other, units="u1 u2", resources="r")


def multiplied(times):
    """1001 jobs of which each asks for so many of another task: 16 are allowed."""
    rows = [after("d", 0, n) for n in range(times)]
    tasks = [task(name, period, version("v", "1ns", "u1", *rows)) for name, period in (("a", "1us"), ("b", "1ms"))]
    return model(*tasks, task("d", None, version("v", "1ns")))


def in_parts(*millions):
    """Tasks that may each have so many million parts."""
    splits = [Split(anywhere=True, max_gaps=n * 10**6 - 1) for n in millions]
    return model(*(task(f"t{n}", 20, replace(version("v", 1), split=split)) for n, split in enumerate(splits)))


def renamed(name):
    system = one()
    return replace(system, tasks=(replace(system.tasks[0], name=name),), modes=())


def switching(*allowed):
    """A rule of a task of two modes that leads to mode "n", in which its task runs as well."""
    tasks = task("a", 20, version("v", 2)), task("b", 20, version("v", 2))
    modes = [mode("m", tasks), mode("n", tasks), mode("o", tasks)]
    system = model(*tasks, modes=modes, transitions=[(*pair, None) for pair in allowed])
    return replace(system, health=(HealthRule(task="a", action=HealthAction.SWITCH, mode="n"),))


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
    "units filled by some tasks": [
        model(*(task(f"t{n}", 20, version("v", wcet)) for n, wcet in enumerate(wcets)))
        for wcets in ((20, 1), (6, 7, 8), (8, 7, 6, 5), (20, 0, None), (21, 0, None))
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
    "phases that overlap beside interrupts as well": [
        serving(one(6, parts=[access("r", 0, 2), access("r", 1, 3)]), (10_000_000, 1_000_000))
    ],
    "phases met beside unlike interrupts": [
        serving(one(6, units="u1 u2", parts=[access("r", 0, 1), access("r", t, 5)]), *served)
        for served in (((10_000_000, 1_000_000), (10_000_000, 1000)), ((10_000_000, 1000), (10_000_000, 1_000_000)))
        for t in near("1.001ms") + near(2)
    ],
    "bounds out of range that overlap": [
        one(4, parts=[access("r", 0, 2, Fraction(n, 10)), access("r", 1, 3, "1/2")]) for n in (-1, 0, 11)
    ],
    "empty phases that overlap": [one(4, parts=[access("r", 1, t), access("r", 0, 3)]) for t in near(1)],
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
    "shares of versions": [shared(bounds, t) for bounds in ((10, 15), (15, 10)) for t in near(15)],
    "shares of versions one after the other": [
        shared(bounds, t) for bounds in ((10, 10), (4, 2, 6)) for t in near(15) + near(19)
    ],
    "shares of unlike bounds": [
        model(
            task("a", 20, version("v", 8, "u1", access("r", 0, 3, "1/3"), access("r", 3, 8, "2/5"))),
            task("b", 20, version("v", 20, "u2", access("r", 0, t))),
            units="u1 u2",
            resources="r",
        )
        for t in near(17)
    ],
    "full beside interrupts": [serving(one(t, 20), (10_000_000, 1_000_000)) for t in near(20) + near(18)],
    "least of the window of a cycle": [same_cycle(t, 40) for t in near(3)],
    "most of the window of a cycle": [same_cycle(0, t) for t in near(3)],
    "window of a cycle and slack": [same_cycle(t, 40, slack="1/10") for t in near(5)]
    + [same_cycle(0, t, slack="1/10") for t in near(1)],
    "window of a cycle from the release": [same_cycle(0, t, slack="1/10", anchor=Anchor.RELEASE) for t in near(3)],
    "window of a cycle and offsets beyond the period": [same_cycle(0, t, offsets=(25, 42)) for t in near(3)],
    "window of a cycle and unlike periods": [same_cycle(0, t, periods=(20, 30)) for t in near(23)]
    + [same_cycle(0, t, periods=(30, 20)) for t in near(13)]
    + [same_cycle(t, 40, periods=(20, 30)) for t in near(3)],
    "windows of a cycle": [same_cycle(0, 3, (t, 40)) for t in near(3)] + [same_cycle(3, 40, (0, t)) for t in near(3)],
    "point": [asking(Anchor.POINT, point=t) for t in near(4) + near(5)],
    "instants": [
        asking(Anchor.POINT),
        asking(Anchor.START, point=ms(1)),
        *(asking(Anchor.START, to=to) for to in (Anchor.END, Anchor.RELEASE, Anchor.POINT)),
    ],
    "latency": [timed(t) for t in near(7)],
    "latency with a LET": [timed(t, let=9) for t in near(12)],
    "latency from the end": [timed(t, anchor=Anchor.END) for t in near(3)],
    "latency to a start": [timed(t, to=Anchor.START) for t in near(4)],
    "latency from the start with a LET": [timed(t, let=9, anchor=Anchor.START) for t in near(7)],
    "latency to the end with a LET": [timed(t, let=9, tasks="b a", to=Anchor.END) for t in near(7)],
    "latency of one task": [timed(ms(9), tasks="a", anchor=Anchor.END, to=to) for to in (Anchor.START, Anchor.END)],
    "latency from a point or to one": [
        timed(ms(9), anchor=Anchor.POINT),
        timed(ms(9), to=Anchor.POINT),
        timed(ms(9), to=Anchor.RELEASE),
    ],
    "demands": [multiplied(n) for n in (15, 16, 17)],
    "gaps and parts": [one(10, split=Split(anywhere=True, max_gaps=MAX_JOBS + n)) for n in (-2, -1, 0)],
    "least parts": [one(t, split=Split(anywhere=True, max_gaps=10**9, min_part=NS)) for t in near(10)],
    "parts of some tasks": [in_parts(7, 9, 8, 7, 9), in_parts(1), in_parts(9, 1, 1)],
    "long names": [renamed(sign * n) for sign in "x!" for n in (0, 1, 60, 61, 1000, 1001)],
    "health switches": [switching(*switches) for switches in ((), ("mn",), ("nm",), ("mn", "on"), ("mn", "nm", "on"))],
    "ring": [ring(n) for n in (2, 11, 12, 13)],
    "many split points": [
        one(4, split=split_of(5, 6, 7, 8, 9)),
        one(4, split=split_of(3, 2, 2, 1, 1)),
        one(6, parts=[access("r", 0, 6)], split=split_of(1, 2, 3, 4, 5)),
    ],
}


def told(system):
    left_out = {UNUSED_RESOURCE.id, UNUSED_UNIT.id}
    return findings(each for each in validate(system) if each.code not in left_out) or ["nothing"]


@pytest.mark.parametrize(("rings", "most"), [(19, 19), (20, 20), (21, 20)])
def test_of_the_rings_of_a_mode_twenty_are_reported(rings, most):
    assert len(found(ring(2, rings), codes.PRECEDENCE_CYCLE)) == most


@pytest.mark.parametrize(("last", "count"), [(15, 0), (16, 1)])
def test_all_units_are_added_up_however_many_sets_of_units_there_are(monkeypatch, last, count):
    monkeypatch.setattr(load, "_MAX_CLASSES", 2)
    wcets = {"u1 u2": 15, "u2 u3": 15, "u3 u1": 14, "u1": 1, "u3": last}
    system = model(*(task(f"t{n}", 20, version("v", t, units)) for n, (units, t) in enumerate(wcets.items())))
    system = replace(system, units=model(units="u1 u2 u3").units)
    assert len(found(system, codes.UNITS_OVERLOADED)) == count


def test_findings_at_the_edges_of_the_limits():
    answers = {
        f"{name} {n}": lambda s=system: told(s) for name, all in EDGES.items() for n, system in enumerate(all, 1)
    }
    assert_answers("validate-edges", answers)
