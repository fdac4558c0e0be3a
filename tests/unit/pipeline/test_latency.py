"""Reaction time and data age of chains, by hand; against verify they are in properties."""

import pytest
from placed_cases import place, roborace, roborace_jobs

from halpipe.pipeline.measure.latency import chain_latencies
from support import chain, job, model, ms, task, version


def latencies(system, *jobs):
    """Return reaction and age of every chain that the mode runs."""
    return [(found.reaction, found.age) for found in chain_latencies(place(system, *jobs), system.chains)]


def test_the_papers_stack_is_followed_over_three_hyperperiods():
    system = roborace()
    reaction, age = 25 + 63, 63
    assert latencies(system, *roborace_jobs(system)) == [(ms(reaction), ms(age))]


def test_a_reader_takes_what_was_finished_when_it_started():
    system = model(
        task("a", 10, version("v", 2)), task("b", 20, version("v", 3, "u2")), units="u1 u2", chains=[chain("c", "a b")]
    )
    a = [job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u1")]
    assert latencies(system, *a, job(system, "b", 0, 12, "u2")) == [(ms(25), ms(5))]  # reads a@10 as it ends
    assert latencies(system, *a, job(system, "b", 0, 11, "u2")) == [(ms(34), ms(14))]  # too early: reads a@0


def test_a_chain_of_one_task_waits_a_period():
    system = model(task("a", 10, version("v", 2)), chains=[chain("c", "a")])
    assert latencies(system, job(system, "a", 0, 9, "u1")) == [(ms(12), ms(2))]


@pytest.mark.parametrize(("long", "short"), [(2, 5), (11, 2), (11, 14)])
def test_of_jobs_that_end_together_the_one_started_later_is_newer(long, short):
    """The long job of a takes 4 ms and the short one 1; both end at once, and b reads then; also round the edge."""
    system = model(
        task("a", 6, version("long", 4, "u1 u2"), version("short", 1, "u1 u2"), slack=1, deadline=12),
        task("b", 12, version("v", 1)),
        units="u1 u2",
        chains=[chain("c", "a b")],
    )
    jobs = [
        job(system, "a", 0, long, "u1", "long"),
        job(system, "a", 1, short, "u2", "short"),
        job(system, "b", 0, (long + 4) % 12, "u1"),
    ]
    for listed in (jobs, jobs[::-1]):
        assert latencies(system, *listed)[0][1] == ms(2)


def test_nothing_gets_through_a_task_without_jobs():
    system = model(task("a", 10, version()), task("h", None, version()), chains=[chain("c", "a h"), chain("d", "h a")])
    assert latencies(system, job(system, "a", 0, 0, "u1")) == [(None, None), (None, None)]


def test_chains_with_tasks_of_other_modes_are_left_out():
    system = model(task("a", 10, version()), chains=[chain("c", "a b"), chain("d", "a")])
    assert [found.name for found in chain_latencies(place(system, job(system, "a", 0, 0, "u1")), system.chains)] == [
        "d"
    ]


def test_latencies_are_exact_between_the_ticks():
    system = model(task("a", "1/30s", version("v", "1/3ms")), chains=[chain("c", "a")])
    assert latencies(system, job(system, "a", 0, "1/7ms", "u1")) == [(ms("101/3ms"), ms("1/3ms"))]
