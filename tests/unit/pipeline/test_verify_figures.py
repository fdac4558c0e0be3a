"""Rule figures: what the schedule reports about itself."""

from dataclasses import replace
from fractions import Fraction

import pytest
from verify_helpers import errors, messages, only, plan_of, table

from halpipe.models import ChainLatency, CostTerms, ResourceLoad, Split, UnitLoad
from halpipe.pipeline.verify import codes
from support import access, after, chain, job, model, ms, task, version


def system():
    return model(
        task("a", 10, version("v", 4, "u1", access("r", "0ms", "2ms", "1/2"))),
        task("b", 10, version("v", 2, "u2", access("r", "0ms", "1ms", "1/4"), after("a", 1, 1))),
        units="u1 u2 u3 u4",
        resources="r s",
        chains=[chain("c", "a b")],
    )


GOOD = {
    "cost": CostTerms(
        total=Fraction(-1, 2),
        overlap=Fraction(0),
        access=Fraction(0),
        precedence=Fraction(0),
        unit=Fraction(0),
        occupancy=Fraction(1, 2),
        timeliness=Fraction(1),
    ),
    "margin": Fraction(3, 2),
    "margin_bound": Fraction(3, 2),
    "unit_loads": (
        UnitLoad(unit="u1", busy=ms(4), share=Fraction(2, 5)),
        UnitLoad(unit="u3", busy=ms(0), share=Fraction(0)),
    ),
    "resource_loads": (
        ResourceLoad(resource="r", peak=Fraction(3, 4), mean=Fraction(1, 8)),
        ResourceLoad(resource="s", peak=Fraction(0), mean=Fraction(0)),
    ),
    "chains": (ChainLatency(name="c", reaction=ms(23), age=ms(13)),),
}


def plan(**changes):
    jobs = (job(system(), "a", 0, 0, "u1"), job(system(), "b", 0, 1, "u2"))
    return plan_of(system(), table("all", 10, *jobs, **{**GOOD, **changes}))


def unit_load(unit, busy, share):
    return {"unit_loads": (UnitLoad(unit=unit, busy=ms(busy), share=Fraction(share)),)}


def resource_load(resource, peak, mean):
    return {"resource_loads": (ResourceLoad(resource=resource, peak=Fraction(peak), mean=Fraction(mean)),)}


def latency(name, reaction, age):
    return {"chains": (ChainLatency(name=name, reaction=ms(reaction), age=ms(age)),)}


def test_true_figures_are_accepted():
    assert not errors(system(), plan())


@pytest.mark.parametrize(
    ("term", "value", "text"),
    [
        ("total", 1, "the total 1 claims an invalid schedule, but no rule is broken"),
        ("overlap", 1, "overlap 1, but no rule of that kind is broken"),
        ("overlap", -1, "overlap -1 is below zero"),
        ("access", Fraction(1, 3), "access 1/3, but no rule"),
        ("precedence", 1, "precedence 1, but no rule"),
        ("unit", 1, "unit 1, but no rule"),
        ("occupancy", Fraction(1, 4), "occupancy 0.25, the share of empty units is 0.5"),
        ("timeliness", Fraction(-1, 10), "timeliness -0.1 is not between 0 and 1"),
        ("timeliness", Fraction(11, 10), "timeliness 1.1 is not between 0 and 1"),
    ],
)
def test_cost_terms_that_contradict_a_valid_schedule(term, value, text):
    found = plan(cost=replace(GOOD["cost"], **{term: Fraction(value)}))
    assert text in only(system(), found, codes.WRONG_FIGURE)


@pytest.mark.parametrize(("term", "value"), [("total", 0), ("timeliness", 0)])
def test_the_limits_of_cost_terms_belong_to_them(term, value):
    assert not errors(system(), plan(cost=replace(GOOD["cost"], **{term: Fraction(value)})))


def broken_plan(**terms):
    """Both jobs on one unit at one time, one of them not valid there, and out of its window."""
    cost = replace(GOOD["cost"], occupancy=Fraction(3, 4), **{k: Fraction(v) for k, v in terms.items()})
    jobs = (job(system(), "a", 0, 0, "u1"), job(system(), "b", 0, 3, "u1"))
    return plan_of(system(), table("all", 10, *jobs, cost=cost))


def test_cost_terms_that_contradict_an_invalid_schedule():
    honest = broken_plan(total=1, overlap=1, precedence=1, unit=1)
    assert not [line for line in errors(system(), honest) if codes.WRONG_FIGURE.id in line]
    lies = [line for line in errors(system(), broken_plan(total=0)) if codes.WRONG_FIGURE.id in line]
    assert len(lies) == 4
    assert any("claims a valid schedule, but it breaks: exclusive, precedence, unit" in line for line in lies)
    for term in ("overlap", "precedence", "unit"):
        assert any(f"{term} 0, but the schedule breaks" in line for line in lies)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"unit_loads": (UnitLoad(unit="u1", busy=ms(5), share=Fraction(2, 5)),)},
            "busy 5ms, share 0.4; the jobs make 4ms",
        ),
        (
            {"unit_loads": (UnitLoad(unit="u1", busy=ms(4), share=Fraction(1, 2)),)},
            "share 0.5; the jobs make 4ms, share 0.4",
        ),
        (unit_load("u1", 5, "2/5"), "busy 5ms, share 0.4; the jobs make 4ms"),
        (unit_load("u1", 4, "1/2"), "share 0.5; the jobs make 4ms, share 0.4"),
        (unit_load("u9", "0ms", 0), "the unit does not exist"),
        (resource_load("r", 1, "1/8"), "peak 1; the jobs make it 0.75"),
        (resource_load("r", "3/4", 0), "mean 0; the jobs make it 0.125"),
        (resource_load("s", 1, 0), "peak 1; the jobs make it 0"),
        (resource_load("x", 0, 0), "the resource does not exist"),
        (latency("c", 22, 13), "reaction 22ms, the jobs make 23ms"),
        (latency("c", 23, None), "age none, the jobs make 13ms"),
        (latency("x", None, None), "the mode has no such chain"),
        ({"margin": Fraction(1)}, "margin: 1; the jobs make it 1.5"),
        ({"margin": Fraction(3, 2), "margin_bound": Fraction(1)}, "margin: 1.5 is more than its bound 1"),
    ],
)
def test_loads_and_latencies_that_contradict_the_jobs(change, text):
    assert text in only(system(), plan(**change), codes.WRONG_FIGURE)


def test_a_chain_through_which_nothing_gets_has_no_latency():
    own = replace(system(), tasks=(*system().tasks, task("idle", None, version("v"))), chains=(chain("c", "a idle"),))
    own = replace(own, modes=model(*own.tasks).modes)
    found = plan(chains=(ChainLatency(name="c", reaction=None, age=None),))
    assert not errors(own, found)
    lie = plan(chains=(ChainLatency(name="c", reaction=ms(1), age=None),))
    assert "reaction 1ms, the jobs make none" in only(own, lie, codes.WRONG_FIGURE)


def test_the_peak_of_a_whole_resource():
    own = model(task("a", 10, version("v", 4, "u1", access("r", "0ms", "2ms"))), resources="r")
    loads = (ResourceLoad(resource="r", peak=Fraction(1), mean=Fraction(1, 5)),)
    assert not errors(own, plan_of(own, table("all", 10, job(own, "a", 0, 0, "u1"), resource_loads=loads)))


def test_peaks_count_what_wraps_round():
    own = system()
    jobs = (job(own, "a", 0, 9, "u1"), job(own, "b", 0, 0, "u2"))
    loads = (ResourceLoad(resource="r", peak=Fraction(3, 4), mean=Fraction(1, 8)),)
    assert not errors(own, plan_of(own, table("all", 10, *jobs, resource_loads=loads)))


@pytest.mark.parametrize("are_split", [(), (0,), (1,), (0, 1)])
def test_overlap_may_count_as_precedence_where_a_version_may_be_split(are_split):
    """Jobs in one piece that overlap are not nested either: a search may say so in either term."""
    own = model(*(task(name, 10, version("v", 4, "u1")) for name in "ab"))
    split = Split(anywhere=True, max_gaps=1)
    tasks = [
        replace(t, versions=(replace(t.versions[0], split=split),)) if n in are_split else t
        for n, t in enumerate(own.tasks)
    ]
    own = replace(own, tasks=tuple(tasks))
    cost = replace(GOOD["cost"], total=Fraction(1), overlap=Fraction(1), precedence=Fraction(1), occupancy=Fraction(0))
    found = plan_of(own, table("all", 10, job(own, "a", 0, 0, "u1"), job(own, "b", 0, 3, "u1"), cost=cost))
    told = messages(own, found, codes.WRONG_FIGURE)
    assert told == ([] if are_split else ['mode "all" cost: precedence 1, but no rule of that kind is broken'])
