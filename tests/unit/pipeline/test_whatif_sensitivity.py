"""What stops a WCET from growing, rule by rule; the exactness itself is a property (test_growth_verify)."""

from bisect import bisect_left
from dataclasses import replace
from fractions import Fraction
from random import Random
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.models import Anchor, Interrupt, Part, Split
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.verify import verify
from halpipe.pipeline.whatif import sensitivity
from halpipe.pipeline.whatif.excerpt import _ahead
from halpipe.pipeline.whatif.sensitivity import searched, sensitivities
from halpipe.pipeline.whatif.trial import Search, proofs
from support import after, chain, job, mode, model, ms, schedule, task, version


def rows(system, plan, *tasks):
    return {(row.task, row.version): row for row in sensitivities(system, plan, frozenset(tasks))}


def growth(system, plan, name="a", own="v"):
    row = rows(system, plan)[name, own]
    return row.growth, row.reason


def test_the_next_job_on_the_unit_round_the_hyperperiod():
    system = model(task("a", 10, version("v", 3), deadline=30), task("b", 10, version("v", 2)))
    plan = schedule(system, 10, job(system, "a", 0, 8, "u1"), job(system, "b", 0, 4, "u1"))
    assert growth(system, plan) == (ms(3), 'unit "u1": "b" job 0 starts at 4ms')
    assert growth(system, plan, "b")[0] == ms(2)


def test_the_unit_of_a_gang_that_is_taken_first():
    both = version("v", 3, "u1 u2", gang=2)
    system = model(task("a", 10, both), task("b", 10, version("v", 2, "u2")), units="u1 u2")
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1 u2"), job(system, "b", 0, 5, "u2"))
    assert growth(system, plan) == (ms(2), 'unit "u2": "b" job 0 starts at 5ms')


def test_the_deadline_after_a_delay_at_the_phase_that_leaves_most():
    late = task("a", 10, version("v", 2), slack="0.5", deadline=8)
    whole = task("b", 20, version("v", 1, "u2"))
    system = model(late, whole, units="u1 u2")
    plan = schedule(
        system, 20, job(system, "a", 0, 0, "u1"), job(system, "a", 1, 13, "u1"), job(system, "b", 0, 0, "u2")
    )
    assert growth(system, plan) == (ms(3), "deadline 8ms of job 1")


@pytest.mark.parametrize(("starts", "job_"), [((0, 13, 20), 1), ((0, 10, 23), 2), ((3, 10, 20), 0)])
def test_the_job_that_starts_latest_after_its_release_has_the_least_room(starts, job_):
    late, whole = task("a", 10, version("v", 2), slack="0.5", deadline=8), task("b", 30, version("v", 1, "u2"))
    system = model(late, whole, units="u1 u2")
    jobs = [job(system, "a", n, start, "u1") for n, start in enumerate(starts)]
    plan = schedule(system, 30, *jobs, job(system, "b", 0, 0, "u2"))
    assert growth(system, plan) == (ms(3), f"deadline 8ms of job {job_}")


def test_a_window_from_the_end():
    system = model(
        task("a", 10, version("v", 2)), task("b", 10, version("v", 1, "u2", after("a", 1, 4, "end"))), units="u1 u2"
    )
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"))
    assert growth(system, plan) == (ms(2), 'window of "b" job 0: [1ms, 4ms] from the end')


def test_a_window_from_the_start_says_nothing():
    system = model(
        task("a", 10, version("v", 2)), task("b", 10, version("v", 1, "u2", after("a", 1, 6))), units="u1 u2"
    )
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"))
    assert growth(system, plan)[0] == ms(8)


def test_a_window_as_wide_as_the_hyperperiod_says_nothing():
    """When the end has passed the start of b, the end a hyperperiod before is just old enough."""
    follower = task("b", 10, version("v", 1, "u2", after("a", 0, 10, "end")))
    system = model(task("a", 10, version("v", 2)), follower, units="u1 u2")
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"))
    assert growth(system, plan)[0] == ms(8)


def test_a_window_that_a_job_of_another_version_keeps():
    """b may follow either job of a, and the one that does not grow ends in its window."""
    either = task("a", 10, version("v", 2), version("w", 2, "u2"))
    follower = task("b", 20, version("v", 1, "u3", after("a", 1, 15, "end")))
    system = model(either, follower, units="u1 u2 u3")
    jobs = job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u2", "w"), job(system, "b", 0, 14, "u3")
    assert growth(system, schedule(system, 20, *jobs)) == (ms(8), "deadline 10ms of job 0")
    assert growth(system, schedule(system, 20, *jobs), own="w") == (ms(8), "deadline 10ms of job 1")


def test_a_chain_limit():
    system = model(
        task("a", 10, version("v", 2)), task("b", 10, version("v", 1, "u2")), units="u1 u2",
        chains=[chain("c", "a b", age=6)],
    )  # fmt: skip
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"))
    assert growth(system, plan) == (ms(3), 'chain "c": data age 6ms')


def test_a_version_without_jobs_and_tasks_by_name():
    system = model(task("a", 10, version("v", 2), version("w", 3)), task("b", 10, version("v", 1)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"))
    found = rows(system, plan, "a")
    assert list(found) == [("a", "v"), ("a", "w")]
    assert found["a", "w"].growth is None


def test_the_mode_that_leaves_least_counts_and_is_named():
    a, b = task("a", 10, version("v", 2)), task("b", 10, version("v", 1))
    system = model(a, b, modes=[mode("one", [a, b]), mode("two", [a])])
    one = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"), mode_name="one")
    two = schedule(system, 10, job(system, "a", 0, 0, "u1"), mode_name="two")
    for modes in ((one, two), (two, one)):
        plan = replace(one, modes=tuple(each for part in modes for each in part.modes))
        assert growth(system, plan) == (ms(3), 'mode "one": unit "u1": "b" job 0 starts at 5ms')


@pytest.mark.parametrize("is_whole", [True, False])
def test_of_modes_that_leave_as_much_the_first_is_named(is_whole):
    grown = version("v", 2)
    a, b = task("a", 10, grown if is_whole else replace(grown, split=Split(points=(ms(1),)))), task("b", 10, grown)
    system = model(a, b, modes=[mode("one", [a, b]), mode("two", [a, b])])
    jobs = job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1")
    one, two = (schedule(system, 10, *jobs, mode_name=name) for name in ("one", "two"))
    for first, second in ((one, two), (two, one)):
        grows, reason = growth(system, replace(one, modes=(*first.modes, *second.modes)))
        assert (grows, reason.partition(" ")[0]) == (ms(3), "mode")
        assert f'mode "{first.modes[0].name}"' in reason


def test_a_chain_bounds_nothing_in_a_mode_without_all_of_its_tasks():
    a, b = task("a", 10, version("v", 2)), task("b", 10, version("v", 1, "u2"))
    chains = [chain("c", "a b", age=6), chain("d", "b", age=2)]
    system = model(a, b, units="u1 u2", chains=chains, modes=[mode("one", [a, b]), mode("two", [a])])
    one = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"), mode_name="one")
    two = schedule(system, 10, job(system, "a", 0, 0, "u1"), mode_name="two")
    both = replace(one, modes=(*one.modes, *two.modes))
    assert growth(system, both) == (ms(3), 'mode "one": chain "c": data age 6ms')


def test_a_window_from_a_while_after_the_end():
    """Neither job of the other version ends in the window, which is as wide as its limits are apart."""
    either = task("a", 10, version("v", 2), version("w", 2, "u2"))
    follower = task("b", 20, version("v", 1, "u3", after("a", 3, 9, "end")))
    system = model(either, follower, units="u1 u2 u3")
    jobs = job(system, "a", 0, 0, "u1"), job(system, "a", 1, 13, "u2", "w"), job(system, "b", 0, 8, "u3")
    assert growth(system, schedule(system, 20, *jobs)) == (ms(3), 'window of "b" job 0: [3ms, 9ms] from the end')


# ------------------------------------------------------------------------------------------------ search


def look(system, plan, name, own="v", step=Fraction(1, 10), budget=200):
    row = rows(system, plan)[name, own]
    return row, searched(system, row, Search(SearchOptions(budget=budget), lambda *_: True, lambda: True), step)


def test_search_moves_what_stands_in_the_way():
    """At its start a has 1 ms; with b moved it has all that b leaves: 9 ms of 10."""
    system = model(task("a", 10, version("v", 2)), task("b", 10, version("v", 1)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 3, "u1"))
    row, found = look(system, plan, "a")
    assert row.growth == ms(1)
    assert (found.found, found.bound) == (ms(9), ms(9))


def test_search_starts_from_what_the_schedule_shows():
    """Where nothing more is found than the schedule at hand allows, that is the answer, to the grid."""
    system = model(task("a", 4, version("v", 1)), task("b", 12, version("v", 2)))
    plan = schedule(system, 12, *(job(system, "a", n, 4 * n, "u1") for n in range(3)), job(system, "b", 0, 1, "u1"))
    row, found = look(system, plan, "b")
    assert row.growth == ms(1)
    assert (found.found, found.bound) == (ms(3), ms(3))


@pytest.mark.parametrize(("at", "longest"), [(3, 3), (5, 5), (2, 2)])
def test_a_search_without_success_leaves_what_the_schedule_shows(at, longest):
    system = model(task("a", 10, version("v", 2)), task("b", 10, version("v", 1)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, at, "u1"))
    blind = SimpleNamespace(finds=lambda changed: False, proves=proofs)
    result = searched(system, rows(system, plan)["a", "v"], blind, Fraction(1, 10))
    assert (result.found, result.bound) == (ms(longest), ms(9))
    assert result.failed[0] == ms(9)
    assert result.failed[-1] == ms(longest) + ms("0.2")  # a step more


def test_a_version_that_is_not_used_has_no_limit():
    system = model(task("a", 10, version("v", 2), version("w", 3)), task("b", 10, version("v", 1)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"))
    row, found = look(system, plan, "a", "w")
    assert row.growth is None
    assert (found.found, found.bound) == (None, None)


def test_no_limit_where_another_version_takes_over():
    system = model(task("a", 10, version("v", 2), version("w", 3)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    _, found = look(system, plan, "a")
    assert (found.found, found.bound, found.failed) == (None, None, ())


def test_a_task_on_demand_grows_as_far_as_the_longest_hyperperiod_allows():
    """In a mode with a hyperperiod of 10 ms it has another version."""
    called = task("called", None, version("long", 2, "u2"), version("short", 1, "u2"))
    slow, fast = (
        task(name, n, version("v", 1, "u1", after("called", 0, n))) for name, n in (("slow", 40), ("fast", 10))
    )
    modes = [mode("a", [slow, called]), mode("b", [fast, called])]
    runs = [
        replace(run, versions=("long",) if place == 0 else ("short",))
        for place, run in enumerate((modes[0].runs[1], modes[1].runs[1]))
    ]
    modes = [replace(each, runs=(each.runs[0], run)) for each, run in zip(modes, runs, strict=True)]
    system = model(slow, fast, called, units="u1 u2", modes=modes)
    plan = schedule_model(system, SearchOptions(budget=50, optimise=()), lambda *_: True).schedule
    _, found = look(system, plan, "called", "long")
    assert (found.found, found.bound) == (ms(40), ms(40))


def test_a_grid_that_does_not_meet_the_growth():
    system = model(task("a", 10, version("v", 3)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    row, found = look(system, plan, "a", step=Fraction(1, 2))
    assert row.growth == ms(7)
    assert found.found == found.bound == Duration(9_000_000)


# ------------------------------------------------------------------------------------------------ MODEL 8


def split_case():
    """A job of 4 ms with a gap from 2 to 5 ms, where another one of 2 ms starts at 3, and a third one at 9 ms."""
    long = replace(version("v", 4), split=Split(points=(ms(2),)))
    system = model(task("a", 20, long), task("b", 20, version("v", 2)), task("c", 20, version("v", 1)))
    parts = (
        Part(start=ms(0), end=ms(2), executed_from=ms(0), executed_to=ms(2)),
        Part(start=ms(5), end=ms(7), executed_from=ms(2), executed_to=ms(4)),
    )
    whole = job(system, "a", 0, 0, "u1")
    cut = replace(whole, end=ms(7), parts=parts)
    return system, schedule(system, 20, cut, job(system, "b", 0, 3, "u1"), job(system, "c", 0, 9, "u1"))


def test_the_last_part_of_a_split_job_grows():
    system, plan = split_case()
    grows, reason = growth(system, plan)
    assert grows == ms(2)
    assert "is held by" in reason


def test_a_job_in_a_gap_grows_until_the_other_goes_on():
    assert growth(*split_case(), "b")[0] == ms(0)
    assert growth(*split_case(), "c")[0] == ms(10)


def test_interrupts_count_while_a_wcet_grows():
    """T = 10, c = 1: from 9 ms of work on there are two interrupts in a job, and 18 ms is where the third one comes."""
    system = model(task("a", 20, version("v", 5)))
    served = (Interrupt(name="i", distance=ms(10), wcet=ms(1)),)
    system = replace(system, units=(replace(system.units[0], interrupts=served),))
    plan = schedule(system, 20, replace(job(system, "a", 0, 0, "u1"), end=ms(6)))
    assert growth(system, plan)[0] == ms(13)


def test_a_task_that_polls_grows_until_its_arrivals_wait_too_long():
    owner = replace(task("a", 10, version("v", 1), slack=1), distance=ms(14))
    system = model(owner)
    assert growth(system, schedule(system, 10, job(system, "a", 0, 0, "u1")))[0] == ms(3)


def verified(monkeypatch, system, plan, *names):
    """Return the least limit of jobs to verify within which the growth of the versions is found."""

    def fits(most):
        monkeypatch.setattr(sensitivity, "MOST_VERIFIED", most)
        try:
            return len(rows(system, plan, *names)) > 0
        except HalpipeError:
            return False

    return bisect_left(range(10_000), True, key=fits)


def test_versions_that_take_too_many_jobs_to_verify_are_to_be_named(monkeypatch):
    """Of each: that it can grow up to the next job on the unit, and why it cannot by more; a job comes after each."""
    one = 2 * (sensitivity.BESIDE + 2)
    assert verified(monkeypatch, *split_case(), "a") == one
    assert verified(monkeypatch, *split_case(), "b") == one + 2  # "c" keeps the length of the hyperperiod
    monkeypatch.setattr(sensitivity, "MOST_VERIFIED", one - 1)
    with pytest.raises(HalpipeError, match=r"HAL0444(?s:.)*--task"):
        rows(*split_case(), "a")


@pytest.mark.parametrize("count", [10, 20])
def test_a_version_costs_the_same_in_a_larger_system(monkeypatch, count):
    """One task keeps the length of the hyperperiod; two versions meet it anyway, itself and the one before."""
    jagged = replace(version("v", 1), split=Split(points=(ms(1) / 2,)))
    system = model(*(task(f"t{n:02}", 100, jagged) for n in range(count)))
    plan = schedule(system, 100, *(job(system, f"t{n:02}", 0, 3 * n, "u1") for n in range(count)))
    assert verified(monkeypatch, system, plan) == count * 2 * (sensitivity.BESIDE + 3) - 2 * 2


def test_growth_ends_where_a_window_is_lost_that_more_would_find_again():
    """The end of "a" may lie up to 2 ms after one of "p", which are at 1 and 5 ms; it lies at 2 ms."""
    row = replace(after("p", 0, 2, "end"), to=Anchor.END)
    system = model(task("p", 4, version("v", 1, "u2")), task("a", 8, version("v", 2, "u1", row)), units="u1 u2")
    plan = schedule(system, 8, job(system, "p", 0, 0, "u2"), job(system, "p", 1, 4, "u2"), job(system, "a", 0, 0, "u1"))
    amount, reason = growth(system, plan)
    assert amount == ms(1)
    assert "the window is [0ms, 2ms]" in reason


def test_growth_with_interrupts_ends_where_a_window_is_lost_that_more_would_find_again():
    """An interrupt takes a millisecond of every two, so that growth by 1 ms moves its end from 2 to 4 ms."""
    row = replace(after("p", 0, 1, "end"), to=Anchor.END)
    system = model(task("p", 4, version("v", 1, "u2")), task("a", 16, version("v", 1, "u1", row)), units="u1 u2")
    first = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(2), wcet=ms(1)),))
    system = replace(system, units=(first, *system.units[1:]))
    slower = replace(job(system, "a", 0, 0, "u1"), end=ms(2))
    plan = schedule(system, 16, *(job(system, "p", n, 4 * n, "u2") for n in range(4)), slower)
    assert not [found for found in verify(system, plan) if found.is_error]
    assert growth(system, plan)[0] == ms(0)


@pytest.mark.parametrize("every", [0, 1, 4, 5, 9])
@pytest.mark.parametrize("most", [0, 1, 7, 20])
def test_edges_ahead_are_all_that_a_growing_end_meets(every, most):
    edges, end = [3, 11, 16], 9
    turns = range(-20, 20) if every else (0,)
    met = {edge + turn * every - end for edge in edges for turn in turns}
    assert list(_ahead(edges, end, every, most)) == sorted(met & set(range(most)))


@pytest.mark.parametrize("seed", range(40))
def test_ends_may_move_until_for_a_moment_none_lies_in_the_window(seed):
    """Against every half tick of two rounds; each end moves, and comes round again."""
    draw, circle = Random(seed), 12
    top, width = draw.randrange(circle), draw.randrange(4)
    ends = sorted(draw.sample(range(circle), draw.randint(1, 5)))

    def is_met(halves):
        return any((2 * (top - end) - halves) % (2 * circle) <= 2 * width for end in ends)

    distances = sorted((top - end) % circle for end in ends)
    halves = next((n for n in range(4 * circle) if not is_met(n)), 4 * circle)
    expected = distances[0] + circle if halves == 4 * circle else max(0, halves - 1) // 2
    fixed = sensitivity.FixedStarts(SimpleNamespace(hyperperiod=circle), {})
    assert [*fixed._before(ends, top)] == distances
    assert fixed._reach(ends, top, width) == expected
