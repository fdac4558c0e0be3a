"""Margins of WCETs, and bounds that no schedule passes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.models import Anchor, Binding, Interrupt, Split
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.margins import LARGEST_MARGIN, least_margin, least_wcet
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.kernel.widen import FINEST, following, halves
from halpipe.pipeline.solve.optimise import lower_bound
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.verify import verify
from support import after, chain, job, model, ms, task, version


def margin(system, jobs):
    return least_margin(Placement.of(expand(system, system.modes[0]), jobs))


def test_the_bound_knows_that_jobs_meet():
    """a and b meet beyond gcd(10, 15) = 5 ms in sum, long before the unit is full."""
    system = model(task("a", 10, version("v", 2)), task("b", 15, version("v", 1)), units="u1 u2")
    assert lower_bound(Objective.MARGIN, system, expand(system, system.modes[0])) == -Fraction(2, 3)


def test_the_bound_knows_the_unit_that_is_full():
    slack = task("a", 10, version("v", 8), slack=1)
    system = model(slack, task("b", 10, version("v", 1, "u2")), units="u1 u2")
    assert lower_bound(Objective.MARGIN, system, expand(system, system.modes[0])) == -Fraction(1, 4)


def bound(system):
    return -lower_bound(Objective.MARGIN, system, expand(system, system.modes[0]))


def test_the_bound_knows_the_interrupts():
    """A job of 3 ms stays for 4, beside another one of 2 ms that stays for 3."""
    system = model(task("a", 14, version("v", 3), slack=1), task("b", 14, version("v", 2), slack=1))
    often = Interrupt(name="i", distance=ms(5), wcet=ms(1))
    interrupted = replace(system, units=(replace(system.units[0], interrupts=(often,)),))
    assert (bound(system), bound(interrupted)) == (Fraction(9, 5), Fraction(1))


@pytest.mark.parametrize(
    ("units", "window", "most"),
    [
        ("u1", after("a", 0, 1, "end"), Fraction(1, 4)),
        ("u1", after("a", 0, 5), Fraction(1, 4)),
        ("u1", replace(after("a", 0, 4, "end"), to=Anchor.END), Fraction(1, 4)),
        ("u1", replace(after("a", 1, 8), to=Anchor.END), Fraction(1, 4)),
        ("u1", replace(after("a", 0, 3), to=Anchor.END), 0),  # b ends where a starts
        ("u1", after("a", 0, 1, "release"), Fraction(13, 7)),
        ("u1 u2", after("a", 0, 1, "end"), Fraction(4)),
    ],
)
def test_the_bound_knows_that_a_job_follows_soon(units, window, most):
    """b stays for 3 ms on a unit that a has left after 4, at most so long after it."""
    system = model(task("a", 20, version("v", 4)), task("b", 20, version("v", 3, units, window)), units="u1 u2")
    assert bound(system) == most


@pytest.mark.parametrize(("units", "most"), [("u1", Fraction(1, 7)), ("u1 u2", 3)])
def test_the_bound_knows_how_many_jobs_follow_soon(units, most):
    """Two jobs of b of 3 ms start within 4 ms after the end of one of a, so one of them lies between."""
    soon = version("v", 3, units, after("a", 0, 4, "end"))
    system = model(task("a", 20, version("v", 4), slack=1), task("b", 10, soon, slack=1), units="u1 u2")
    assert bound(system) == most


@pytest.mark.parametrize(
    ("narrow", "most"), [((), Fraction(1, 7)), ((version("w", 3, "u1 u2", after("a", 0, 4, "end")),), 1)]
)
def test_the_bound_knows_that_jobs_of_one_version_of_two_may_run_at_once(narrow, most):
    """As above with a gang of both units; in the other version, the two jobs of b run beside each other."""
    wide = version("v", 3, "u1 u2", after("a", 0, 4, "end"), gang=2)
    first = task("a", 20, version("v", 4, "u1 u2", gang=2), slack=1)
    assert bound(model(first, task("b", 10, wide, *narrow, slack=1), units="u1 u2")) == most


@pytest.mark.parametrize(("wcets", "least"), [((5, 3, 4), 3), ((None, 4), 4), ((None,), 0)])
def test_the_least_wcet_is_that_of_the_versions_that_state_one(wcets, least):
    versions = (version(f"v{n}", wcet) for n, wcet in enumerate(wcets))
    system = model(task("a", 20, *versions), task("b", 20, version("v", 1)))
    assert least_wcet(expand(system, system.modes[0]).by_name["a"]) == ms(least)


def test_the_bound_knows_nothing_of_jobs_that_may_be_cut():
    late = version("v", 3, "u1", after("a", 0, 1, "end"))
    cut = replace(version("v", 4), split=Split(points=(ms(2),)))
    assert bound(model(task("a", 20, cut), task("b", 20, late))) == Fraction(13, 7)
    assert bound(model(task("a", 20, cut, version("w", 4)), task("b", 20, late))) == Fraction(13, 7)
    at_once = replace(late, precedences=(after("a", 0, 0, "end"),))
    assert bound(model(task("a", 20, cut), task("b", 20, at_once))) == 0


def test_the_bound_needs_the_window_in_every_version():
    late, other = version("v", 3, "u1", after("a", 0, 0, "end")), version("w", 3)
    assert bound(model(task("a", 20, version("v", 4)), task("b", 20, late, other))) == Fraction(13, 7)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_optimise_margin_reaches_what_is_proven(seed):
    tasks = (("t0", 5, "1ms"), ("t1", 10, "1.5ms"), ("t2", 20, "1.5ms"), ("t3", 20, "2ms"))
    system = model(*(task(name, period, version("v", wcet)) for name, period, wcet in tasks))
    result = schedule_model(system, SearchOptions(optimise=(Objective.MARGIN,), seed=seed), lambda *_: True)
    [reached] = result.reached
    assert (reached.value, reached.bound) == (-Fraction(2, 3), -Fraction(2, 3))
    assert [d for d in verify(system, result.schedule) if d.is_error] == []


@pytest.mark.parametrize("limit", [Fraction(n, 24) for n in range(25)])
def test_halves_close_in_on_the_largest_margin_that_is_granted(limit):
    """Of margins up to 5/8, those up to a limit are granted; a quarter is known."""
    most, best, granted = Fraction(5, 8), Fraction(1, 4), None
    asked = halves(best, most)
    while (margin := following(asked, granted)) is not None:
        assert best < margin < most
        granted = margin <= limit
        best = margin if granted else best
    assert best <= max(limit, Fraction(1, 4))
    assert min(limit, most) - best <= most / FINEST


@pytest.mark.slow
def test_a_margin_that_is_asked_for_comes_close_to_its_bound():
    """Without the later rounds, such sets end at 0.81 to 0.94 of it."""
    system = generate(SetParameters(tasks=20, units=2, unit_types=1, utilisation=Fraction(8, 10)), 9801)
    result = schedule_model(system, SearchOptions(optimise=(Objective.MARGIN,)), lambda *_: True)
    [reached] = result.reached
    assert reached.bound < 0
    assert reached.value / reached.bound >= Fraction(97, 100)
    assert [d for d in verify(system, result.schedule) if d.is_error] == []


def test_the_least_margin_of_a_schedule_is_that_of_the_tightest_stay():
    """On u1 2 ms are followed by 3 free ones, round the edge 4 ms by 1; on u2 one job of 2 ms has 8 to grow by."""
    system = model(
        *(task(n, 10, version("v", c, u)) for n, c, u in (("a", 2, "u1"), ("b", 4, "u1"), ("c", 2, "u2"))),
        units="u1 u2",
    )
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"), job(system, "c", 0, 9, "u2")]
    assert margin(system, jobs) == Fraction(1, 4)
    assert margin(system, jobs[::2]) == 4
    assert margin(system, []) == LARGEST_MARGIN


@pytest.mark.parametrize(("slack", "most"), [("0", 0), ("1/2", Fraction(1, 2)), ("1", Fraction(3, 4))])
def test_the_bound_knows_how_far_two_jobs_may_be_apart(slack, most):
    """A job of 6 ms lies between two of 1 ms, which start up to 7 ms and the jitter apart."""
    often = task("often", 7, version("v", 1), slack=Fraction(slack))
    assert bound(model(often, task("rare", 14, version("v", 6), slack=1))) == most


def test_the_bound_knows_how_long_a_late_input_waits():
    """An input after the start of a waits for the next job of b, 20 ms later, and its path takes 5 ms."""
    rare = task("b", 20, version("v", 3), slack=1)
    system = model(task("a", 10, version("v", 2), slack=1), rare, chains=[chain("c", "a b", reaction=25)])
    assert bound(system) == 0


def test_no_bound_passes_the_largest_margin():
    assert bound(model(task("a", 1000, version("v", 1)))) == LARGEST_MARGIN == 100


@pytest.mark.parametrize("limit", [{"reaction": 26}, {"age": 6}, {"max_latency": ms(6)}])
@pytest.mark.parametrize(
    ("changes", "most"),
    [({}, Fraction(1, 2)), ({"anchor": Anchor.END}, Fraction(13, 7)), ({"to": Anchor.START}, Fraction(13, 7))],
)
def test_the_bound_knows_the_time_that_a_chain_leaves(limit, changes, most):
    """Both tasks take 5 ms, so that a millisecond is left between a and b, which use one unit."""
    tasks = [task("a", 10, version("v", 2), slack=1), task("b", 20, version("v", 3), slack=1)]
    stated = {name: limit[name] for name in ("reaction", "age") if name in limit}
    row = replace(chain("c", "a b", **stated), max_latency=limit.get("max_latency"), **changes)
    assert bound(model(*tasks, chains=[row])) == most
    read_at_release = replace(tasks[0], let=ms(10))
    assert bound(model(read_at_release, tasks[1], chains=[row])) == Fraction(13, 7)


@pytest.mark.parametrize(("other", "most"), [((), Fraction(9, 11)), ((version("w", 5, "u1 u2"),), Fraction(1))])
def test_the_bound_knows_the_least_work_of_all_versions_on_all_their_units(other, most):
    """Of 20 ms on two units, 5 ms and twice 3 ms are in use, or 5 ms and 5 ms."""
    both = task("a", 10, version("v", 3, "u1 u2", gang=2), *other)
    assert bound(model(both, task("b", 10, version("v", 5, "u1 u2")), units="u1 u2")) == most


@pytest.mark.parametrize(
    ("binding", "most"),
    [(Binding.JOB, Fraction(27, 13)), (Binding.MODE, Fraction(2, 3)), (Binding.SYSTEM, Fraction(2, 3))],
)
def test_the_bound_knows_that_jobs_of_a_bound_task_share_a_unit(binding, most):
    bound_task = replace(task("a", 10, version("v", 6, "u1 u2")), binding=binding)
    assert bound(model(bound_task, task("b", 20, version("v", 1, "u1 u2")), units="u1 u2")) == most


@pytest.mark.parametrize(("gang", "most"), [(2, 2), (1, 3)])
def test_the_bound_knows_the_interrupts_of_a_gang_and_of_the_quietest_unit(gang, most):
    """With the interrupts of u1, 3 ms of 12 take 4; without, 3."""
    system = model(task("a", 12, version("v", 3, "u1 u2", gang=gang)), units="u1 u2")
    often = Interrupt(name="i", distance=ms(5), wcet=ms(1))
    interrupted = replace(system.units[0], interrupts=(often,))
    assert bound(replace(system, units=(interrupted, system.units[1]))) == most


@pytest.mark.parametrize(("gangs", "most"), [((1, 1), Fraction(3)), ((1, 2), 0), ((2, 1), 0)])
def test_the_bound_knows_that_gangs_have_a_unit_in_common(gangs, most):
    """b starts at the end of a, on one of its units or on the other one."""
    first, second = (version("v", c, "u1 u2", gang=gang) for c, gang in zip((2, 5), gangs, strict=True))
    late = replace(second, precedences=(after("a", 0, 0, "end"),))
    assert bound(model(task("a", 20, first), task("b", 20, late), units="u1 u2")) == most


def test_the_bound_knows_that_the_longest_of_a_period_meets_others():
    """d and c meet beyond gcd(10, 15) = 5 ms in sum, and a and b are shorter than d."""
    rows = (("a", 10, 1), ("b", 10, 1), ("c", 15, 1), ("d", 10, 2))
    assert bound(model(*(task(name, period, version("v", wcet)) for name, period, wcet in rows))) == Fraction(2, 3)
