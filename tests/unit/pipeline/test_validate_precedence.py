"""Windows, cycles, absent predecessors, and tasks that nobody demands."""

from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from math import lcm

import pytest
from validate_cases import codes_of, found, the

from halpipe.core.diagnostics import Location, Severity
from halpipe.models import Anchor, Match, Mode, Run
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.validate.precedence import MAX_CYCLES
from support import after, mode, model, ms, task, version


def runs(name, *predecessors, period=25):
    return task(name, period, version("v", 1, "u1", *(after(p, 0, 20) for p in predecessors)))


def test_empty_window():
    assert validate(model(runs("a"), task("b", 25, version("v", 1, "u1", after("a", 5, 5))))) == ()
    finding = the(model(runs("a"), task("b", 25, version("v", 1, "u1", after("a", 5, 4)))), codes.EMPTY_WINDOW)
    assert finding.path == 'task "b" version "v" precedence on "a"'


def same_cycle(period, other, low, high):
    """Task "b", which follows the job of its cycle of task "a" by low to high milliseconds."""
    row = replace(after("a", low, high), match=Match.CYCLE)
    followed = task("a", other, version("v", "1ns", "u1"), offset=0)
    return model(followed, task("b", period, version("v", "1ns", "u1", row), offset=0))


@pytest.mark.parametrize(("period", "other"), [(2, 3), (3, 2), (4, 6), (6, 4), (3, 5), (5, 3), (2, 6), (6, 2), (4, 4)])
def test_a_window_is_compared_with_every_job(period, other):
    distances = [period * job % other for job in range(other)]
    for low, high in combinations(range(6), 2):
        is_met = all(low <= distance <= high for distance in distances)
        assert (codes.CONTRADICTION.id in codes_of(same_cycle(period, other, low, high))) is not is_met


@pytest.mark.parametrize("anchor", [Anchor.START, Anchor.RELEASE])
@pytest.mark.parametrize(("slacks", "offsets"), [((0, "1/2"), (1, 0)), (("1/2", 0), (0, 1)), (("1/3", "1/4"), (3, 1))])
@pytest.mark.parametrize(("period", "other"), [(2, 4), (6, 4), (12, 8), (4, 12)])
def test_a_window_is_compared_with_all_that_slack_allows(period, other, slacks, offsets, anchor):
    """A job that may start at any of these instants contradicts the window if none of them lies in it."""
    hyper, late = lcm(period, other), Fraction(slacks[1]) * other if anchor is Anchor.START else 0
    own, theirs = (offset % cycle for offset, cycle in zip(offsets, (period, other), strict=True))
    jobs = [own + at - theirs - at // other * other for at in range(0, hyper, period)]
    for low, high in combinations(range(9), 2):
        row = replace(after("a", low, high, anchor), match=Match.CYCLE)
        followed = task("a", other, version("v", "1ns", "u1"), slack=slacks[1], offset=theirs)
        system = model(followed, task("b", period, version("v", "1ns", "u1", row), slack=slacks[0], offset=own))
        jitter = Fraction(slacks[0]) * period
        is_met = all(between - late <= high and between + jitter >= low for between in jobs)
        assert (codes.CONTRADICTION.id in codes_of(system)) is not is_met, (low, high)


@pytest.mark.parametrize(("high", "is_met"), [(10**6 + 2, True), (10**6 + 1, False)])
def test_the_job_that_decides_is_computed_where_there_are_a_million(high, is_met):
    system = same_cycle(2, 10**6 + 3, 0, high)
    assert (codes.CONTRADICTION.id in codes_of(system)) is not is_met


def test_task_after_itself():
    assert codes_of(model(runs("a", "a"))) == {codes.SELF_PRECEDENCE.id}


def test_cycle_is_named_from_its_first_task_on():
    a = replace(runs("a", "c"), at=Location("m.xml", 1))
    finding = the(model(a, runs("b", "a"), runs("c", "b"), runs("d", "c")), codes.PRECEDENCE_CYCLE)
    assert finding.path == 'mode "all"'
    steps = '"c" needs "b", "b" needs "a", "a" needs "c"'
    assert sorted(finding.message.split(": ")[1].split(", ")) == sorted(steps.split(", "))
    assert finding.message.startswith("3 tasks")


@pytest.mark.parametrize(("count", "is_cut"), [(11, False), (12, True)])
def test_of_a_long_cycle_the_first_steps_are_named(count, is_cut):
    tasks = [runs(f"t{n}", f"t{(n - 1) % count}") for n in range(count)]
    message = the(model(*tasks), codes.PRECEDENCE_CYCLE).message
    assert message.count(" needs ") == 11
    assert message.endswith(", ...") == is_cut


def test_two_separate_cycles_are_two_findings():
    system = model(runs("a", "b"), runs("b", "a"), runs("c", "d"), runs("d", "c"))
    assert len(found(system, codes.PRECEDENCE_CYCLE)) == 2


def test_cycle_over_versions_that_are_never_available_together():
    a = task("a", 25, version("free", 1), version("bound", 1, "u1", after("b", 0, 20)))
    b = task("b", 25, version("free", 1), version("bound", 1, "u1", after("a", 0, 20)))
    apart = [
        Mode(name="m", runs=(Run(task="a", versions=("free",)), Run(task="b", versions=("bound",)))),
        Mode(name="n", runs=(Run(task="a", versions=("bound",)), Run(task="b", versions=("free",)))),
    ]
    assert validate(model(a, b, modes=apart)) == ()
    assert [d.path for d in found(model(a, b, modes=[*apart, mode("o", [a, b])]), codes.PRECEDENCE_CYCLE)] == [
        'mode "o"'
    ]


def test_cycle_of_a_model_that_has_no_modes_yet():
    assert the(model(runs("a", "b"), runs("b", "a"), modes=[]), codes.PRECEDENCE_CYCLE).path == 'model "m"'


def test_dense_knot_ends():
    names = [f"t{i}" for i in range(30)]
    system = model(*(runs(name, *(n for n in names if n != name)) for name in names))
    assert len(found(system, codes.PRECEDENCE_CYCLE)) == MAX_CYCLES


def test_predecessor_absent_from_a_mode():
    a, b = runs("a"), runs("b", "a")
    system = model(a, b, modes=[mode("m", [a, b]), mode("n", [b])])
    finding = the(system, codes.PREDECESSOR_ABSENT)
    assert finding.path == 'mode "n" task "b" version "v"'
    assert finding.is_error
    assert validate(model(a, b)) == ()


def test_predecessor_absent_but_another_version_does_without():
    a = runs("a")
    b = task("b", 25, version("needy", 1, "u1", after("a", 0, 20)), version("free", 1))
    system = model(a, b, modes=[mode("m", [a, b]), mode("n", [b])])
    finding = the(system, codes.VERSION_UNUSABLE)
    assert (finding.path, finding.severity) == ('mode "n" task "b" version "needy"', Severity.WARNING)
    assert found(system, codes.PREDECESSOR_ABSENT) == []


def test_every_version_with_an_absent_predecessor_is_named_when_none_is_left():
    a, c = runs("a"), runs("c")
    b = task("b", 25, version("x", 1, "u1", after("a", 0, 20)), version("y", 1, "u1", after("c", 0, 20)))
    system = model(a, b, c, modes=[mode("m", [a, b, c]), mode("n", [b])])
    assert len(found(system, codes.PREDECESSOR_ABSENT)) == 2


def test_task_that_nobody_demands():
    a, d = runs("a"), runs("d", period=None)
    finding = the(model(a, d), codes.NEVER_DEMANDED)
    assert (finding.path, finding.severity) == ('mode "all" task "d"', Severity.WARNING)
    assert validate(model(runs("a", "d"), d)) == ()


@pytest.mark.parametrize("asks", [True, False])
def test_demand_counts_per_mode(asks):
    d = runs("d", period=None)
    a, b = runs("a", "d"), runs("b", *(["d"] if asks else []))
    system = model(a, b, d, modes=[mode("m", [a, d]), mode("n", [b, d])])
    assert len(found(system, codes.NEVER_DEMANDED)) == (0 if asks else 1)


def test_an_instant_that_is_not_there_points_at_both_tasks_where_both_are_there():
    row = replace(after("a", 0, 5, "point"), point=ms(3))
    there = Location("m.xml", 7)
    system = model(replace(runs("a"), at=there), task("b", 25, version("v", 1, "u1", row)))
    assert the(system, codes.NO_SUCH_INSTANT).places == (there,)
    cycle = replace(after("h", 0, 5), match=Match.CYCLE)
    system = model(task("h", None, version()), task("b", 25, version("v", 1, "u1", cycle)))
    [lacking] = found(system, codes.CYCLE_WITHOUT_PERIOD)
    assert 'task "h" has no period' in lacking.message
