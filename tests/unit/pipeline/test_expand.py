"""Jobs of a mode: hyperperiods, periodic jobs and demands (paper, section III)."""

from dataclasses import replace

from split_helpers import interrupts, split

from halpipe.core.durations import ZERO, Duration, milliseconds
from halpipe.models import Anchor, Match, ResourceKind, Split
from halpipe.pipeline.jobs import Demand, common_sets, demand_ranges, expand, natural_tick
from support import access, after, chain, mode, model, ms, task, version


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


def test_locks_and_interrupts_are_those_of_the_whole_model():
    system = interrupts(model(task("a", 10, version()), units="u1 u2", resources="spin mem"), "u2", (5, 1), (7, 2))
    locks = tuple(replace(r, kind=ResourceKind.LOCK) if r.name == "spin" else r for r in system.resources)
    expansion = expand(replace(system, resources=locks), system.modes[0])
    assert expansion.locks == {"spin"}
    assert [(each.distance, each.wcet) for each in expansion.interrupts] == [(ms(5), ms(1)), (ms(7), ms(2))]


def released_system():
    """b counts from the release of a, d belongs to the cycle of c, e has a LET, and a chain counts from that of f."""
    tasks = [
        task("a", 10, version()),
        task("b", 10, version("v", 1, "u1", after("a", 0, 5, "release"))),
        task("c", 10, version()),
        task("d", 10, version("v", 1, "u1", replace(after("c", 0, 5), match=Match.CYCLE))),
        replace(task("e", 10, version()), let=ms(10)),
        task("f", 10, version(), offset=3),
        task("g", None, version()),
    ]
    rows = [replace(chain("k", "f a"), anchor=Anchor.RELEASE), replace(chain("l", "b c"), anchor=Anchor.START)]
    return model(*tasks, chains=[*rows, chain("m", "d f")])


def test_the_releases_of_some_tasks_count_and_the_phases_of_some_lie_in_their_first_periods():
    system = released_system()
    expansion = expand(system, system.modes[0])
    assert expansion.released == {"a", "e", "f"}
    assert expansion.in_first == {"c", "d", "e"}
    assert [a.name for a in expansion.tasks if expansion.is_released_at_start(a)] == ["a", "e"]


def test_demands_are_counted_over_the_versions_at_least_and_at_most():
    two, one = version("v", 1, "u1", after("h", 0, 5), after("h", 3, 9)), version("w", 1, "u1", after("h", 0, 5))
    assert demand_ranges((two, one)) == {"h": (1, 2)}
    assert demand_ranges((two, version("w"))) == {"h": (0, 2)}
    assert demand_ranges((version("w"),)) == {}


def test_common_units_of_all_modes_are_enough_for_the_gang():
    def sets(*modes, gang=1):
        return common_sets(([version("v", 1, units, gang=gang) for units in mode] for mode in modes), gang)

    assert sets(["u1 u2"], ["u2 u3"]) == {frozenset({"u2"})}
    assert sets(["u1"], ["u2"]) == set()
    assert sets(["u1 u2", "u3"], ["u2 u3"]) == {frozenset({"u2"}), frozenset({"u3"})}
    assert sets(["u1 u2 u3"], ["u2 u3"], gang=2) == {frozenset({"u2", "u3"})}
    assert sets(["u1 u2"], ["u2 u3"], gang=2) == set()
    assert common_sets([[version("v", 1, "u1 u2")]], 2) == set()
    assert common_sets([], 1) == set()


def test_every_duration_that_decides_a_start_or_an_end_is_a_multiple_of_the_tick():
    """Each of them alone makes the tick of 10 ms as small as itself."""
    plain = task("a", 10, version("v", 10), offset=0)
    cut = Split(points=(ms(5),))
    for changed in (
        replace(plain, offset=ms(5)),
        replace(plain, let=ms(5)),
        replace(plain, versions=(version("v", 5),)),
        replace(plain, versions=(version("v", 10, "u1", access("r", 0, 5)),)),
        replace(plain, versions=(version("v", 10, "u1", access("r", 5, 10)),)),
        replace(plain, versions=(version("v", 10, "u1", after("b", 5, 10)),)),
        replace(plain, versions=(version("v", 10, "u1", after("b", 0, 5)),)),
        replace(plain, versions=(version("v", 10, "u1", replace(after("b", 0, 10, "point"), point=ms(5))),)),
        replace(plain, versions=(split(version("v", 10), cut),)),
        replace(plain, versions=(split(version("v", 10), replace(cut, points=(), resume=ms(5))),)),
        replace(plain, versions=(split(version("v", 10), Split(anywhere=True, min_part=ms(5))),)),
    ):
        system = model(changed, task("b", 10, version("v", 10)), resources="r")
        assert natural_tick(expand(system, system.modes[0])) == ms(5)
    system = model(plain, task("b", 10, version("v", 10)))
    assert natural_tick(expand(system, system.modes[0])) == ms(10)
    assert natural_tick(expand(interrupts(system, "u1", (5, 5)), system.modes[0])) == ms(5)
