"""Rule chain: reaction time and data age."""

from dataclasses import replace

import pytest
from verify_helpers import errors, messages, only

from halpipe.pipeline.verify import codes
from support import chain, job, model, schedule, task, version


def relay(reaction=None, age=None, tasks="a b", **more):
    """A producer every 10 ms and a consumer every 20 ms."""
    return model(
        task("a", 10, version("v", 2), **more),
        task("b", 20, version("v", 3, "u2")),
        task("never", None, version("v", 1, "u2")),
        units="u1 u2",
        chains=[chain("c", tasks, reaction, age)],
    )


def at(system, start):
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u1")]
    return schedule(system, 20, *jobs, job(system, "b", 0, start, "u2"))


@pytest.mark.parametrize(
    ("start", "reaction", "age"),
    [
        (12, 25, 5),  # after a@0: a@10 ends at 12, b@12 ends at 15; after a@10: a@20, b@32 ends at 35
        (11, 34, 14),  # a@10 ends too late for b@11, which reads a@0; after a@0 nothing gets out before b@31 ends
        (2, 25, 5),  # after a@0: a@10, b@22 ends at 25
        (1, 34, 14),  # b@1 reads a@-10; after a@10: a@20 ends at 22, b@41 ends at 44
        (19, 32, 12),  # b@19 reads a@10; after a@10: a@20, b@39 ends at 42
    ],
)
def test_worst_reaction_time_and_data_age(start, reaction, age):
    exact = relay(reaction, age)
    assert not errors(exact, at(exact, start))
    tight = relay(reaction - 1, None)
    text = only(tight, at(tight, start), codes.CHAIN_LIMIT)
    assert f"reaction time {reaction}ms" in text
    assert "1ms too long" in text
    old = relay(None, age - 1)
    assert f"data age {age}ms" in only(old, at(old, start), codes.CHAIN_LIMIT)


def test_a_chain_of_one_task():
    """Just missed, it is seen a period later: period + WCET; its data are as old as its job is long."""
    exact = relay(12, 2, "a")
    assert not errors(exact, at(exact, 12))
    assert len(messages(relay(11, 1, "a"), at(relay(11, 1, "a"), 12), codes.CHAIN_LIMIT)) == 2


def test_a_task_may_occur_twice():
    exact = relay(45, 25, "a b a")  # after a@10: a@20, b@32 to 35, a@40 to 42; after a@0: a@10, b@12, a@20 to 22
    plan = at(exact, 12)
    assert messages(exact, plan, codes.CHAIN_LIMIT) == []
    text = " ".join(messages(relay(31, 11, "a b a"), plan, codes.CHAIN_LIMIT))
    assert "reaction time 32ms" in text
    assert "data age 22ms" in text


def test_a_limit_on_a_chain_through_which_nothing_gets():
    system = relay(100, 100, "a never")
    text = messages(system, at(system, 12), codes.CHAIN_LIMIT)
    assert len(text) == 2
    assert all("no data ever arrives" in line for line in text)
    free = relay(None, None, "a never")
    assert not errors(free, at(free, 12))


def test_a_chain_says_nothing_about_a_mode_without_one_of_its_tasks():
    system = relay(1, 1, "a b")
    alone = model(system.tasks[0], chains=(*system.chains, chain("d", "a never", 1, 1)))
    both = replace(alone, tasks=system.tasks, units=system.units)
    plan = schedule(both, 10, job(both, "a", 0, 0, "u1"))
    assert messages(both, plan, codes.CHAIN_LIMIT) == []


def test_the_newest_data_are_those_that_ended_last():
    """Two jobs of one task side by side: the one that started first ends last, and its data are read."""
    producer = task("a", 10, version("long", 14, "u1 u3"), version("short", 2, "u1 u3"), deadline=14)
    system = model(producer, task("b", 20, version("v", 1, "u2")), units="u1 u2 u3", chains=[chain("c", "a b", age=16)])
    jobs = [job(system, "a", 0, 0, "u1", "long"), job(system, "a", 1, 10, "u3", "short")]
    plan = schedule(system, 20, *jobs, job(system, "b", 0, 15, "u2"))
    assert not errors(system, plan)
    tight = model(*system.tasks, units="u1 u2 u3", chains=[chain("c", "a b", age=15)])
    assert "data age 16ms" in only(tight, plan, codes.CHAIN_LIMIT)


def test_of_jobs_a_nanosecond_apart_the_second_is_the_next():
    """After the first of them, the stimulus is seen by the second: at 10 ms, out at 18."""
    system = relay(28, None, slack=1, deadline=30)
    jobs = [job(system, "a", 0, "9999999ns", "u1"), job(system, "a", 1, 10, "u3")]
    system = replace(system, units=model(units="u1 u2 u3").units, tasks=(_anywhere(system.tasks[0]), *system.tasks[1:]))
    plan = schedule(system, 20, *jobs, job(system, "b", 0, 15, "u2"))
    assert messages(system, plan, codes.CHAIN_LIMIT) == []
    tight = replace(system, chains=(chain("c", "a b", "27999999ns"),))
    assert 'reaction time 28ms for "a" job 1 at 10ms' in only(tight, plan, codes.CHAIN_LIMIT)


def _anywhere(own):
    return replace(own, versions=tuple(replace(v, units=("u1", "u3")) for v in own.versions))


@pytest.mark.parametrize(("limit", "is_kept"), [(2, True), ("1999999ns", False)])
def test_a_job_without_length_ends_where_it_starts(limit, is_kept):
    """b takes no time at 2 ms, and reads what a did from 0 to 2."""
    system = relay(None, limit)
    system = replace(system, tasks=(system.tasks[0], task("b", 20, version("v", "0ms", "u2")), system.tasks[2]))
    assert (not messages(system, at(system, 2), codes.CHAIN_LIMIT)) == is_kept
