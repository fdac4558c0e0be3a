"""Rule complete: exactly the jobs that the periods and the demands ask for."""

from dataclasses import replace

import pytest
from verify_helpers import codes_found, errors, messages, only

from halpipe.pipeline.verify import codes
from support import after, job, model, schedule, task, version


def three_jobs():
    return model(task("a", 10, version("v", 1)), task("slow", 30, version("v", 1, "u2")), units="u1 u2")


def jobs(system, *indices):
    found = [job(system, "a", k, 10 * (k % 3), "u1") for k in indices]
    return schedule(system, 30, *found, job(system, "slow", 0, 0, "u2"))


def test_every_period_has_its_job():
    system = three_jobs()
    assert not errors(system, jobs(system, 0, 1, 2))
    assert "has 1 of its 3 jobs; missing: 0, 2" in only(system, jobs(system, 1), codes.MISSING_JOB)
    assert "missing: 0 to 2" in " ".join(messages(system, jobs(system), codes.MISSING_JOB))
    assert only(system, jobs(system, 0, 2), codes.MISSING_JOB).endswith("has 2 of its 3 jobs; missing: 1")
    assert only(system, jobs(system, 0, 1), codes.MISSING_JOB).endswith("missing: 2")


@pytest.mark.parametrize("index", [-1, 3])
def test_indices_end_with_the_hyperperiod(index):
    system = three_jobs()
    found = jobs(system, 0, 1, 2, index)
    assert "3 jobs in the hyperperiod, with the indices 0 to 2" in " ".join(messages(system, found, codes.SURPLUS_JOB))


def test_a_job_behind_the_last_does_not_make_up_for_one():
    system = three_jobs()
    (text,) = messages(system, jobs(system, 0, 1, 3), codes.MISSING_JOB)
    assert text.endswith("has 2 of its 3 jobs; missing: 2")


def test_a_job_given_twice_is_reported_once():
    system = three_jobs()
    found = jobs(system, 0, 1, 2, 2)
    assert len(messages(system, found, codes.REPEATED_JOB)) == 1


def on_demand():
    """Task `both` demands two jobs of `help` in version `two`, one in version `one`; `last` demands a third."""
    many = version("two", 1, "u1", after("help", 0, 10), after("help", 0, 10))
    few = version("one", 1, "u1", after("help", 0, 10))
    none = version("none", 1, "u1")
    return model(
        task("both", 10, many, few, none),
        task("slow", 20, version("v", 1, "u2", after("help", 0, 20))),
        task("help", None, version("v", 1, "u3 u4")),
        units="u1 u2 u3 u4",
    )


def demands(system, first, second, *indices):
    starts = {0: "u3", 1: "u4", 2: "u3", 3: "u4", 4: "u3"}
    helpers = [job(system, "help", k, 1 + 2 * k, starts.get(k, "u3")) for k in indices]
    own = [job(system, "both", 0, 5, "u1", first), job(system, "both", 1, 15, "u1", second)]
    return schedule(system, 20, *own, job(system, "slow", 0, 19, "u2"), *helpers)


@pytest.mark.parametrize(
    ("first", "second", "indices"),
    [
        ("two", "two", [0, 1, 2, 3, 4]),
        ("two", "one", [0, 1, 2, 4]),
        ("one", "two", [0, 2, 3, 4]),
        ("none", "one", [2, 4]),
        ("none", "none", [4]),
    ],
)
def test_one_job_for_each_demand_that_arises(first, second, indices):
    system = on_demand()
    assert not errors(system, demands(system, first, second, *indices))
    missing = only(system, demands(system, first, second, *indices[:-1]), codes.MISSING_JOB) if indices[1:] else ""
    if missing:
        assert f"{len(indices)} demands arise, {len(indices) - 1} are served; missing jobs: 4" in missing
    absent = next((k for k in range(6) if k not in indices), None)
    surplus = demands(system, first, second, *indices, absent)
    assert messages(system, surplus, codes.SURPLUS_JOB) == [
        f'mode "all" task "help" job {absent}: no demand arises for this job under the versions chosen'
    ]


def test_demands_pass_through_tasks_on_demand():
    """root demands mid, mid demands leaf: both once for each job of root."""
    system = model(
        task("root", 10, version("v", 1, "u1", after("mid", 0, 10))),
        task("mid", None, version("v", 1, "u2", after("leaf", 0, 10))),
        task("leaf", None, version("v", 1, "u3")),
        units="u1 u2 u3",
    )
    full = [job(system, "root", 0, 5, "u1"), job(system, "mid", 0, 3, "u2"), job(system, "leaf", 0, 1, "u3")]
    assert not errors(system, schedule(system, 10, *full))
    assert codes.MISSING_JOB.id in codes_found(system, schedule(system, 10, *full[:2]))
    # without its demanding job, the leaf has no reason
    found = messages(system, schedule(system, 10, full[0], full[2]), codes.SURPLUS_JOB)
    assert [line.split(":")[0] for line in found] == ['mode "all" task "leaf" job 0']


def test_a_task_on_demand_that_nobody_demands_has_no_jobs():
    system = model(task("a", 10, version("v", 1)), task("idle", None, version("v", 1, "u2")), units="u1 u2")
    own = job(system, "a", 0, 0, "u1")
    assert not errors(system, schedule(system, 10, own))
    only(system, schedule(system, 10, own, job(system, "idle", 0, 0, "u2")), codes.SURPLUS_JOB)


def test_demands_of_versions_not_available_do_not_count():
    """The stride between demands comes from the versions available in the mode."""
    system = on_demand()
    runs = tuple(replace(r, versions=("one",)) if r.task == "both" else r for r in system.modes[0].runs)
    system = replace(system, modes=(replace(system.modes[0], runs=runs),))
    assert not errors(system, demands(system, "one", "one", 0, 1, 2))


@pytest.mark.parametrize(("served", "more"), [(1, False), (0, True)])
def test_the_first_twelve_missing_jobs_are_named(served, more):
    system = model(
        task("root", 10, version("v", 1, "u1", *(after("help", 0, 10) for _ in range(13)))),
        task("help", None, version("v", 1, "u2")),
        units="u1 u2",
    )
    present = [job(system, "help", 0, 1, "u2")][:served]
    found = schedule(system, 10, job(system, "root", 0, 5, "u1"), *present)
    (text,) = messages(system, found, codes.MISSING_JOB)
    assert text.endswith("11 and more" if more else "10, 11, 12")


def test_a_job_behind_the_last_demands_nothing():
    """Of `both` there are two jobs, so the demands of a third, 4 and 5, do not arise; 4 is that of `slow`."""
    system = on_demand()
    found = demands(system, "two", "two", 0, 1, 2, 3, 4, 5)
    third = replace(job(system, "both", 0, 15, "u1", "two"), index=2)
    found = replace(found, modes=(replace(found.modes[0], jobs=(*found.modes[0].jobs, third)),))
    assert [text.split(":")[0] for text in messages(system, found, codes.SURPLUS_JOB)] == [
        'mode "all" task "both" job 2',
        'mode "all" task "help" job 5',
    ]


def test_a_task_that_nobody_demands_leaves_no_room_for_its_demands():
    """`idle` comes first and demands nothing, as it never runs: the only demand is number 0."""
    system = model(
        task("idle", None, version("v", 1, "u3", after("help", 0, 10))),
        task("a", 10, version("v", 1, "u1", after("help", 0, 10))),
        task("help", None, version("v", 1, "u2")),
        units="u1 u2 u3",
    )
    assert not errors(system, schedule(system, 10, job(system, "a", 0, 5, "u1"), job(system, "help", 0, 1, "u2")))
