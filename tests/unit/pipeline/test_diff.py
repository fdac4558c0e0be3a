"""What two schedules, or two models, do not have in common; and that nothing else is reported."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import parted

from halpipe.models import WHOLE, Binding, Interrupt, Origin, Split, TransitionTable, Unit
from halpipe.models.schedule import Status, UnitLoad
from halpipe.pipeline.diff import Change, JobChange, diff_models, diff_schedules
from support import access, after, chain, job, mode, model, ms, schedule, task, version

SYSTEM = model(
    task("a", 10, version("v", 2, "u1 u2"), version("w", 3, "u1")),
    task("b", 20, version("v", 1, "u1 u2", access("mem", 0, 1), after("a", 0, 5))),
    units="u1 u2",
    resources="mem",
    chains=[chain("c", "a b", age=20)],
)


def plan(*jobs):
    return schedule(SYSTEM, 20, *(jobs or default_jobs()))


def default_jobs():
    return job(SYSTEM, "a", 0, 0, "u1"), job(SYSTEM, "a", 1, 10, "u1"), job(SYSTEM, "b", 0, 4, "u2")


def summary(found):
    return {s.task: (dict(s.counts), s.shift) for s in found.tasks}


# ------------------------------------------------------------------------------------------------ schedules


def test_a_schedule_is_the_same_as_itself_whatever_the_order_of_jobs_and_units():
    found = diff_schedules(plan(), plan(*reversed(default_jobs())))
    assert found.is_same
    assert found.tasks == ()
    gang = [schedule(SYSTEM, 20, job(SYSTEM, "a", 0, 0, units)) for units in ("u1 u2", "u2 u1")]
    assert diff_schedules(*gang).is_same


def test_who_made_a_schedule_is_told_but_is_no_difference():
    found = diff_schedules(plan(), replace(plan(), seed=7, solver="other", tick=ms(1)))
    assert found.is_same
    assert [(c.what, c.before, c.after) for c in found.about] == [
        ("solver", "", "other"),
        ("seed", "none", "7"),
        ("tick", "none", "1ms"),
    ]


def test_another_model_is_a_difference():
    found = diff_schedules(plan(), replace(plan(), model_sha256="f" * 64))
    assert [c.what for c in found.values] == ["model-sha256"]


@pytest.mark.parametrize(
    ("changed", "kinds"),
    [
        (job(SYSTEM, "a", 0, 1, "u1"), ("moved",)),
        (job(SYSTEM, "a", 0, 0, "u2"), ("units",)),
        (job(SYSTEM, "a", 0, 0, "u1", "w"), ("version",)),
        (job(SYSTEM, "a", 0, 1, "u2", "w"), ("moved", "version", "units")),
        (replace(job(SYSTEM, "a", 0, 0, "u1"), end=ms(3)), ("changed",)),
    ],
)
def test_what_happened_to_a_job(changed, kinds):
    found = diff_schedules(plan(), plan(changed, *default_jobs()[1:]))
    assert [c.kinds for c in found.jobs] == [kinds]
    assert summary(found) == {"a": (dict.fromkeys(kinds, 1), None)}
    assert not found.is_same


def test_jobs_that_only_one_has():
    fewer = plan(*default_jobs()[:2])
    assert summary(diff_schedules(plan(), fewer)) == {"b": ({"removed": 1}, None)}
    assert summary(diff_schedules(fewer, plan())) == {"b": ({"added": 1}, None)}


@pytest.mark.parametrize(("starts", "shift"), [((3, 13), ms(3)), ((18, 8), -ms(2)), ((3, 12), None)])
def test_a_task_that_moved_as_a_whole(starts, shift):
    moved = [job(SYSTEM, "a", n, start, "u1") for n, start in enumerate(starts)]
    found = diff_schedules(plan(), plan(*moved, default_jobs()[2]))
    assert summary(found) == {"a": ({"moved": 2}, shift)}
    back = diff_schedules(plan(*moved, default_jobs()[2]), plan())
    assert summary(back) == {"a": ({"moved": 2}, shift and -shift)}


def test_figures_of_the_report():
    table = plan().modes[0]
    load = UnitLoad(unit="u1", busy=ms(4), share=Fraction(1, 5))
    one = replace(plan(), modes=(replace(table, unit_loads=(load,)),))
    other = replace(plan(), modes=(replace(table, unit_loads=(replace(load, busy=ms(5), share=Fraction(1, 4)),)),))
    assert diff_schedules(one, other).values == (
        Change('mode "all" unit-load "u1"', "busy", "4ms", "5ms"),
        Change('mode "all" unit-load "u1"', "share", "0.2", "0.25"),
    )


def test_modes_and_switches_that_only_one_has():
    table = TransitionTable(
        source="all", target="x", length=ms(1), worst_latency=ms(21), status=Status.VALID, jobs=default_jobs()[:1]
    )
    other = replace(plan(), transitions=(table,))
    found = diff_schedules(plan(), other)
    assert found.values == (Change('transition "all" to "x"', "added"),)
    assert [(c.table, c.kinds) for c in found.jobs] == [('transition "all" to "x"', ("added",))]
    longer = replace(plan(), transitions=(replace(table, length=ms(2)),))
    assert diff_schedules(other, longer).values == (Change('transition "all" to "x"', "length", "1ms", "2ms"),)


# ------------------------------------------------------------------------------------------------ models


def with_version(**changes):
    b = SYSTEM.task("b")
    return replace(SYSTEM, tasks=(SYSTEM.task("a"), replace(b, versions=(replace(b.versions[0], **changes),))))


B = 'task "b" version "v"'


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (SYSTEM, []),
        (replace(SYSTEM, origin=Origin("x.arxml", 3)), []),
        (with_version(wcet=ms(2)), [Change(B, "wcet", "1ms", "2ms")]),
        (with_version(units=("u1",)), [Change(B, "units", "u1, u2", "u1")]),
        (with_version(accesses=()), [Change(B, "accesses", "mem [0ms, 1ms) 1", "")]),
        (
            with_version(precedences=(after("a", 1, 5, "end"),)),
            [Change(B, "precedences", "a start [0ms, 5ms]", "a end [1ms, 5ms]")],
        ),
        (replace(SYSTEM, units=SYSTEM.units[:1]), [Change('unit "u2"', "removed")]),
        (replace(SYSTEM, units=(*SYSTEM.units, Unit(name="u3"))), [Change('unit "u3"', "added")]),
        (replace(SYSTEM, tasks=SYSTEM.tasks[::-1]), [Change("model", "order of tasks", '"a" "b"', '"b" "a"')]),
        (replace(SYSTEM, chains=(chain("c", "a b", age=25),)), [Change('chain "c"', "max-age", "20ms", "25ms")]),
        (
            replace(SYSTEM, modes=(*SYSTEM.modes, mode("more", SYSTEM.tasks))),
            [Change('mode "more"', "added")],
        ),
        (
            replace(SYSTEM, modes=(mode("all", SYSTEM.tasks[:1]),)),
            [Change('mode "all" run "b"', "removed")],
        ),
    ],
)
def test_what_differs_in_a_model(changed, expected):
    assert list(diff_models(SYSTEM, changed)) == expected


def test_no_field_of_a_model_is_overlooked():
    """Models are the same to diff only if they are equal, but for their origins."""
    for changed in (
        replace(SYSTEM, name="other"),
        replace(SYSTEM, resources=()),
        with_version(name="x"),
        with_version(gang=2),
        replace(SYSTEM, tasks=(SYSTEM.task("a"), replace(SYSTEM.task("b"), slack=Fraction(1, 2)))),
        replace(SYSTEM, tasks=(SYSTEM.task("a"), replace(SYSTEM.task("b"), offset=ms(1)))),
    ):
        assert diff_models(SYSTEM, changed)
        assert diff_models(changed, SYSTEM)


# ------------------------------------------------------------------------------------------------ MODEL 8


def split_by(how):
    owner = SYSTEM.task("a")
    versions = (replace(owner.versions[0], split=how), *owner.versions[1:])
    return replace(SYSTEM, tasks=(replace(owner, versions=versions), *SYSTEM.tasks[1:]))


POINTS = Split(points=(ms("0.5ms"), ms(1)), resume=ms("1us"), max_gaps=2)
ANYWHERE = Split(anywhere=True, max_gaps=3, min_part=ms("0.1ms"))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (
            WHOLE,
            POINTS,
            [("split", "none", "500us 1ms"), ("resume", "0ms", "1us"), ("max-gaps", "none", "2")],
        ),
        (
            POINTS,
            ANYWHERE,
            [
                ("split", "500us 1ms", "anywhere"),
                ("resume", "1us", "0ms"),
                ("max-gaps", "2", "3"),
                ("min-part", "none", "100us"),
            ],
        ),
        (POINTS, replace(POINTS, points=(ms(1),)), [("split", "500us 1ms", "1ms")]),
    ],
)
def test_splits_are_told_in_the_words_of_the_model(one, other, expected):
    element = 'task "a" version "v"'
    found = diff_models(split_by(one), split_by(other))
    assert found == tuple(Change(element, *change) for change in expected)


def test_bindings_distances_and_interrupts():
    owner = replace(SYSTEM.task("a"), binding=Binding.SYSTEM, distance=ms(12))
    served = Unit(name="u1", interrupts=(Interrupt(name="can", distance=ms(5), wcet=ms("1us")),))
    changed = replace(SYSTEM, tasks=(owner, *SYSTEM.tasks[1:]), units=(served, *SYSTEM.units[1:]))
    assert set(diff_models(SYSTEM, changed)) == {
        Change('task "a"', "binding", "job", "system"),
        Change('task "a"', "distance", "none", "12ms"),
        Change('unit "u1" interrupt "can"', "added"),
    }
    rarer = replace(served, interrupts=(replace(served.interrupts[0], distance=ms(6)),))
    (change,) = diff_models(changed, replace(changed, units=(rarer, *SYSTEM.units[1:])))
    assert change == Change('unit "u1" interrupt "can"', "distance", "5ms", "6ms")


def test_a_job_in_parts_that_has_moved_as_a_whole_is_cut_alike():
    before = parted("a", 0, "u1", (0, 2, 0, 2), (5, 7, 2, 4))
    after = parted("a", 0, "u1", (3, 5, 0, 2), (8, 10, 2, 4))
    other = parted("a", 0, "u1", (3, 5, 0, 2), (9, 11, 2, 4))
    assert JobChange("t", before, after).kinds == ("moved",)
    assert JobChange("t", before, other).kinds == ("moved", "parts")
