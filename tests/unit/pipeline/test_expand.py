"""Jobs of a mode: hyperperiods, periodic jobs and demands (paper, section III)."""

from halpipe.core.durations import ZERO, Duration, milliseconds
from halpipe.pipeline.jobs import Demand, expand
from support import after, mode, model, ms, task, version


def counts(system, name="all"):
    return {active.name: active.jobs for active in expand(system, system.mode(name)).tasks}


def test_a_periodic_task_has_one_job_per_period_of_the_hyperperiod():
    system = model(task("a", 10, version()), task("b", 4, version()), task("c", 20, version()))
    assert expand(system, system.modes[0]).hyperperiod == ms(20)
    assert counts(system) == {"a": 2, "b": 5, "c": 1}


def test_hyperperiods_are_exact():
    """A camera at 30 Hz and a control task every 25 ms meet every 100 ms."""
    system = model(task("camera", "1/30s", version()), task("control", 25, version()))
    assert expand(system, system.modes[0]).hyperperiod == ms(100)
    assert counts(system) == {"camera": 3, "control": 4}


def test_every_constraint_of_another_job_demands_one_job():
    twice = version("v", 1, "u1", after("h", 0, 5), after("h", 3, 9))
    system = model(
        task("h", None, version()), task("a", 10, twice), task("b", 5, version("v", 1, "u1", after("h", 0, 5)))
    )
    assert counts(system) == {"h": 2 * 1 + 1 * 2, "a": 1, "b": 2}
    demands = expand(system, system.modes[0]).by_name["h"].demands
    assert demands == (Demand("a", 0, 0), Demand("a", 0, 1), Demand("b", 0, 0), Demand("b", 1, 0))


def test_the_version_that_names_a_task_most_counts():
    none = version("none", 1, "u1")
    two = version("two", 1, "u1", after("h", 0, 5), after("h", 0, 5))
    one = version("one", 1, "u1", after("h", 0, 5), after("k", 0, 5))
    system = model(
        task("h", None, version()), task("k", None, version()), task("a", 5, none, two, one), task("b", 10, none)
    )
    assert counts(system) == {"h": 4, "k": 2, "a": 2, "b": 1}


def test_demands_go_through_tasks_without_period():
    h = task("h", None, version("v", 1, "u1", after("g", 0, 5), after("g", 0, 9)))
    g = task("g", None, version("v", 1, "u1", after("f", 0, 5)))
    a = task("a", 5, version("v", 1, "u1", after("h", 0, 5)))
    b = task("b", 10, version("v", 1, "u1", after("g", 0, 5)))
    system = model(a, b, task("f", None, version()), g, h)
    assert counts(system) == {"a": 2, "b": 1, "f": 5, "g": 5, "h": 2}
    demands = expand(system, system.modes[0]).by_name["g"].demands
    assert [(d.task, d.index, d.slot) for d in demands] == [
        ("b", 0, 0),
        ("h", 0, 0),
        ("h", 0, 1),
        ("h", 1, 0),
        ("h", 1, 1),
    ]


def test_constraints_on_periodic_tasks_demand_nothing():
    system = model(task("a", 5, version()), task("b", 10, version("v", 1, "u1", after("a", 0, 5))))
    assert counts(system) == {"a": 2, "b": 1}
    assert all(active.demands == () for active in expand(system, system.modes[0]).tasks)


def test_a_mode_counts_its_own_tasks_and_versions_only():
    more = version("more", 1, "u1", after("h", 0, 5), after("h", 0, 5))
    less = version("less", 1, "u1", after("h", 0, 5))
    h, a, b = task("h", None, version()), task("a", 5, more, less), task("b", 20, version())
    short = mode("short", [task("a", 5, less), h])
    system = model(b, a, h, modes=[mode("all", [h, a, b]), short])
    assert counts(system) == {"b": 1, "a": 4, "h": 8}
    assert counts(system, "short") == {"a": 1, "h": 1}
    expansion = expand(system, system.mode("short"))
    assert expansion.hyperperiod == ms(5)
    assert [version.name for version in expansion.by_name["a"].versions] == ["less"]


def test_tasks_stand_in_the_order_of_the_model():
    c = task("c", 5, version("v", 1, "u1", after("a", 0, 5)))
    a, b = task("a", None, version()), task("b", 5, version())
    system = model(c, a, b, modes=[mode("all", [b, a, c])])
    assert [active.name for active in expand(system, system.modes[0]).tasks] == ["c", "a", "b"]


def test_a_mode_without_periods_has_no_jobs():
    system = model(task("a", None, version()), task("b", None, version("v", 1, "u1", after("a", 0, 5))))
    expansion = expand(system, system.modes[0])
    assert (expansion.hyperperiod, expansion.job_count, expansion.mean_wcet) == (ZERO, 0, ZERO)


def test_the_mean_wcet_is_over_all_jobs():
    system = model(task("a", 5, version("v", 1)), task("b", 10, version("v", 3), version("w", 9)))
    assert expand(system, system.modes[0]).mean_wcet == milliseconds(5) / 3
    assert isinstance(expand(system, system.modes[0]).mean_wcet, Duration)
