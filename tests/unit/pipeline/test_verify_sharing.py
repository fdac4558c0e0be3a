"""Rules exclusive and access: units and resources, round the end of the hyperperiod."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from verify_helpers import codes_found, errors, messages, only

from halpipe.core.diagnostics import Location
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.verify.sharing import excesses_on_circle
from halpipe.pipeline.verify.tables import Placed
from support import access, job, model, schedule, task, version


def pair(first=4, second=4):
    return model(task("a", 10, version("v", first)), task("b", 10, version("v", second, "u1 u2")), units="u1 u2")


def at(system, first, second, unit="u1"):
    return schedule(system, 10, job(system, "a", 0, first, "u1"), job(system, "b", 0, second, unit))


def test_jobs_may_touch_but_not_overlap():
    system = pair()
    assert not errors(system, at(system, 0, 4))
    text = only(system, at(system, 0, "3999999ns"), codes.OVERLAP)
    assert text.startswith('mode "all" unit "u1": is held by "a" job 0 and "b" job 0 from 3.999999ms to 4ms: 1ns')
    assert not errors(system, at(system, 0, "3999999ns", "u2"))


def test_jobs_wrap_round_the_end():
    system = pair()
    assert not errors(system, at(system, 8, 2))
    assert not errors(system, at(system, 8, 4))
    assert "from 0ms to 2ms: 2ms of overlap" in only(system, at(system, 8, 0), codes.OVERLAP)
    # an overlap across the end is one
    assert "from 9ms to 12ms: 3ms" in only(system, at(system, 8, 9), codes.OVERLAP)


def test_a_job_longer_than_the_hyperperiod_overlaps_itself():
    long = model(task("a", 10, version("v", 12), deadline=12))
    text = only(long, schedule(long, 10, job(long, "a", 0, 3, "u1")), codes.OVERLAP)
    assert 'is held twice by "a" job 0' in text
    assert "from 3ms to 5ms" in text
    exact = model(task("a", 10, version("v", 10)))
    assert not errors(exact, schedule(exact, 10, job(exact, "a", 0, 3, "u1")))


def test_every_member_of_a_gang_holds_its_unit():
    system = model(task("a", 10, version("v", 4, "u1 u2", gang=2)), task("b", 10, version("v", 4, "u2")), units="u1 u2")
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1 u2"), job(system, "b", 0, 2, "u2"))
    assert 'unit "u2"' in only(system, plan, codes.OVERLAP)


@pytest.mark.parametrize(("count", "last"), [(12, '"t11" job 0'), (13, "others"), (20, "others")])
def test_many_jobs_in_one_place_are_one_finding(count, last):
    names = [f"t{k:02}" for k in range(count)]
    system = model(*(task(name, 10, version("v", 1)) for name in names))
    text = only(system, schedule(system, 10, *(job(system, name, 0, 0, "u1") for name in names)), codes.OVERLAP)
    assert "t11" in text
    assert "t12" not in text
    assert text.split(" from ")[0].endswith(f"and {last}")


def test_a_finding_points_to_one_of_the_jobs():
    system = pair()
    plan = at(system, 0, 1)
    here = [replace(j, at=Location("plan.xml", 5 + k)) for k, j in enumerate(plan.modes[0].jobs)]
    (found,) = verify(system, schedule(system, 10, *here))
    assert found.at in [j.at for j in here]


# ------------------------------------------------------------------------------------------------ access


def sharing(*bounds, start="0ms", end="2ms"):
    tasks = [task(f"t{k}", 10, version("v", 4, f"u{k}", access("r", start, end, b))) for k, b in enumerate(bounds)]
    return model(*tasks, units=" ".join(f"u{k}" for k in range(len(bounds))), resources="r")


def starts(system, *found):
    return schedule(system, 10, *(job(system, f"t{k}", 0, start, f"u{k}") for k, start in enumerate(found)))


def test_bounds_may_sum_to_one_exactly():
    thirds = sharing("1/3", "1/3", "1/3")
    assert not errors(thirds, starts(thirds, 0, 0, 0))
    more = sharing("1/3", "1/3", Fraction(1, 3) + Fraction(1, 10**9))
    assert "claimed up to 1.000000001 from 0ms to 2ms" in only(more, starts(more, 0, 0, 0), codes.OVERLOAD)


def test_the_maximal_interval_is_reported_with_its_jobs():
    system = sharing("1/2", "2/3", "1/3")
    text = only(system, starts(system, 0, 1, 1), codes.OVERLOAD)
    assert 'claimed up to 1.5 from 1ms to 2ms by "t0" job 0, "t1" job 0 and "t2" job 0: 0.5 too much' in text
    assert not errors(system, starts(system, 0, 2, 2))


def test_phases_wrap_and_begin_after_the_start_of_the_job():
    late = sharing(1, 1, start="2ms", end="4ms")
    assert not errors(late, starts(late, 7, 9))  # [9, 11) and [11, 13)
    assert "from 999us to 1ms" in only(late, starts(late, 7, "8999us"), codes.OVERLOAD)
    assert "from 9.5ms to 10.5ms" in only(late, starts(late, "6500us", "7500us"), codes.OVERLOAD)


@pytest.mark.parametrize("third", [9, 0])
def test_the_peak_round_the_end_is_the_higher_one_of_both_sides(third):
    """Two phases from 9 to 11, and a third for the first or the second half of that."""
    lasting = {"t0": ("2ms", "1/2"), "t1": ("2ms", "2/3"), "t2": ("1ms", "1/3")}
    tasks = [
        task(name, 10, version("v", 4, f"u{n}", access("r", "0ms", end, bound)))
        for n, (name, (end, bound)) in enumerate(lasting.items())
    ]
    system = model(*tasks, units="u0 u1 u2", resources="r")
    text = only(system, starts(system, 9, 9, third), codes.OVERLOAD)
    assert "claimed up to 1.5 from 9ms to 11ms" in text


def test_two_phases_of_one_job_count_together():
    phases = [access("r", "0ms", "2ms", "2/3"), access("r", "1ms", "3ms", "2/3")]
    system = model(task("a", 10, version("v", 4, "u1", *phases)), resources="r")
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    assert 'from 1ms to 2ms by "a" job 0' in only(system, plan, codes.OVERLOAD)


def test_resources_are_independent():
    system = sharing(1, 1)
    other = replace(system.tasks[1].versions[0], accesses=(access("s", "0ms", "2ms"),))
    apart = replace(system, tasks=(system.tasks[0], replace(system.tasks[1], versions=(other,))))
    assert codes_found(system, starts(system, 0, 0)) == [codes.OVERLOAD.id]
    assert not errors(apart, starts(apart, 0, 0))


@pytest.mark.parametrize("gap", ["2ms", "1999999ns"])
def test_separate_overloads_are_separate_findings(gap):
    phases = [access("r", "0ms", "1ms"), access("r", gap, "3ms")]
    tasks = [task(f"t{k}", 10, version("v", 4, f"u{k}", *phases)) for k in range(2)]
    system = model(*tasks, units="u0 u1", resources="r")
    assert len(messages(system, starts(system, 0, 0), codes.OVERLOAD)) == 2


CLAIMS = st.lists(st.tuples(st.integers(0, 9), st.integers(1, 25), st.integers(1, 3)), max_size=6)


@given(CLAIMS, st.integers(1, 4))
def test_the_sweep_finds_exactly_the_ticks_that_counting_finds(claims, limit):
    period = 10
    owner = Placed(None, None, None, None, 0)
    found = excesses_on_circle([(s, s + c, w, owner) for s, c, w in claims], limit, period)
    sums = [sum(w for s, c, w in claims for t in range(s, s + c) if t % period == cell) for cell in range(period)]
    swept = [cell % period for e in found for cell in range(e.start, e.end)]
    assert sorted(swept) == [cell for cell in range(period) if sums[cell] > limit]
    assert max((e.peak for e in found), default=0) == max((s for s in sums if s > limit), default=0)
    edges = sorted((e.start, e.end) for e in found)
    assert all(before[1] < after[0] for before, after in pairwise(edges))
