"""Transition tables: found shortest, accepted by verify, explained where there is none (MODEL 5)."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest

from growth import growth, half_way
from halpipe.core.durations import Duration, milliseconds
from halpipe.models import Edge, Split, Transition
from halpipe.pipeline.checked import KEPT_FOR_SWITCHES, _is_sound_switch, schedule_model, verify_schedule
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.transitions import search
from halpipe.pipeline.transitions import tables as tables_module
from halpipe.pipeline.transitions.change import Change
from halpipe.pipeline.transitions.line import Layer, Line, LineJob, Phase, Shape
from halpipe.pipeline.transitions.search import Blocked, Table
from halpipe.pipeline.transitions.tables import MAY_BE_LONG, NO_IMPLIED_TABLE, NO_TABLE, on_common_grid, switch_tables
from support import access, after, chain, job, mode, model, schedule, task, version


def shape(wcet, units="u1 u2", gang=1, phases=(), name="t"):
    return Shape(name, "v", wcet, tuple(units.split()), gang, tuple(phases))


def line_of(*jobs):
    line = Line(5)
    for start, form, units in jobs:
        line.enter(LineJob(start, form.task, 0, form, tuple(units.split())))
    return line


def test_the_first_fit_waits_for_a_unit_and_a_resource():
    read = Phase("mem", 0, 2, 3)
    line = line_of((0, shape(10, phases=[read], name="a"), "u1"), (0, shape(4, name="b"), "u2"))
    assert line.first_fit(shape(3, name="c"), 0, 50) == (4, ("u2",))
    assert line.first_fit(shape(3, units="u1 u2", gang=2, name="c"), 0, 50) == (10, ("u1", "u2"))
    assert line.first_fit(shape(3, units="u3", phases=[read], name="c"), 1, 50) == (2, ("u3",))
    assert line.first_fit(shape(3, units="u3", phases=[replace(read, bound=2)], name="c"), 1, 50) == (
        1,
        ("u3",),
    )
    assert line.first_fit(shape(3, name="c"), 0, 3) is None


def test_a_task_does_not_run_against_itself_on_another_unit():
    line = line_of((5, shape(10, name="a"), "u1"))
    assert line.first_fit(shape(10, units="u2", name="a"), 0, 50) == (15, ("u2",))


def two_modes(slack=0, phase_before=0, phase_after=0, limit=None):
    """One task of 4 ms every 10 ms in both modes, and its schedule with the given phases."""
    work = task("work", 10, version("v", 4, "u1 u2"), slack=slack)
    system = model(work, units="u1 u2", modes=[mode("a", [work]), mode("b", [work])], transitions=[("a", "b", limit)])
    tables = [
        schedule(system, 10, job(system, "work", 0, phase, "u1"), mode_name=name).modes[0]
        for name, phase in (("a", phase_before), ("b", phase_after))
    ]
    return system, replace(schedule(system, 10), modes=tuple(tables))


def tables_of(system, plan):
    def check(_model, _schedule, table):
        one = replace(plan, transitions=(table,))
        return not any(d.is_error for d in verify_schedule(system, one))

    return switch_tables(system, plan, check)


@pytest.mark.parametrize(
    ("slack", "before", "after_", "length", "starts"),
    [
        (0, 0, 0, 0, []),  # the same phase goes on
        (0, 6, 2, 0, []),  # an earlier phase is a shorter gap, 6 ms >= 4 ms
        (0, 8, 0, 2, []),  # back to back only: the job before runs until 2 ms after the switch
        (0, 0, 3, 1, [0]),  # a later phase needs a job in between: from -10 to 0, and it ends when the next starts
        (Fraction(1, 2), 0, 3, 0, []),  # 13 ms are within (1 + 1/2) periods
    ],
)
def test_the_shortest_table_of_one_task(slack, before, after_, length, starts):
    system, plan = two_modes(slack, before, after_)
    switched = tables_of(system, plan)
    assert switched.diagnostics == ()
    (table,) = switched.tables
    assert table.length == milliseconds(length)
    assert [j.start for j in table.jobs] == [milliseconds(start) for start in starts]
    assert table.worst_latency == milliseconds(10 + length)


def test_jobs_of_a_table_before_a_closed_edge_end_before_the_mode():
    """The job in between starts with the table, ten milliseconds after the last one, and takes 4."""
    system, plan = two_modes(0, 0, 3)
    system = replace(system, modes=(system.modes[0], replace(system.modes[1], edge=Edge.CLOSED)))
    (table,) = tables_of(system, plan).tables
    assert table.length == milliseconds(4)
    assert [(j.start, j.end) for j in table.jobs] == [(milliseconds(0), milliseconds(4))]


def test_a_limit_that_is_too_short_is_a_finding_that_names_task_and_rule():
    system, plan = two_modes(0, 0, 3, limit="0ms")
    switched = tables_of(system, plan)
    assert switched.tables == ()
    (found,) = switched.diagnostics
    assert found.code == NO_TABLE.id
    assert '"work"' in found.message
    assert "start often enough" in found.message


def test_pairs_that_the_model_does_not_list_only_warn():
    system, plan = two_modes(0, 0, 3)
    system = replace(system, transitions=())
    never = switch_tables(system, plan, lambda *_: False)
    assert {d.code for d in never.diagnostics} == {NO_IMPLIED_TABLE.id}


@pytest.mark.parametrize("anchor", ["start", "end"])
def test_an_entering_task_starts_early_where_a_constraint_needs_it(anchor):
    sense = task("sense", 10, version("v", 2, "u1"))
    act = task("act", 10, version("v", 2, "u2", after("sense", 8 - 2 * (anchor == "end"), 9, anchor)))
    system = model(sense, act, units="u1 u2", modes=[mode("idle", [sense]), mode("busy", [sense, act])])
    entering = replace(system, modes=(mode("other", [task("x", 10, version("v", 1, "u1"))]), system.modes[1]))
    entering = replace(entering, tasks=(*system.tasks, task("x", 10, version("v", 1, "u1"))))
    busy = schedule(system, 10, job(system, "sense", 0, 4, "u1"), job(system, "act", 0, 2, "u2"), mode_name="busy")
    other = schedule(entering, 10, job(entering, "x", 0, 0, "u1"), mode_name="other")
    plan = replace(busy, modes=(other.modes[0], busy.modes[0]))
    entering = replace(entering, transitions=(next(t for t in entering.allowed_transitions() if t.target == "busy"),))
    (table,) = tables_of(entering, plan).tables
    [early] = table.jobs
    earliest = milliseconds(-9 if anchor == "end" else -7)
    assert early.task == "sense"
    assert earliest <= early.start - table.length <= milliseconds(-6)
    assert verify_schedule(entering, replace(plan, transitions=(table,))) == []


def test_predecessors_are_put_before_as_many_cycles_as_need_them():
    """Each of the first three cycles of the mode after looks for its own, 35 ms back."""
    other = task("other", 30, version("v", 1, "u2"))
    first, then = (
        task("first", 10, version("v", 1, "u1")),
        task("then", 10, version("v", 1, "u1", after("first", 35, 36))),
    )
    system = model(
        other,
        first,
        then,
        units="u1 u2",
        modes=[mode("a", [other]), mode("b", [first, then])],
        transitions=[("a", "b", 60)],
    )
    before = schedule(system, 30, job(system, "other", 0, 0, "u2"), mode_name="a")
    later = schedule(system, 10, job(system, "first", 0, 3, "u1"), job(system, "then", 0, 9, "u1"), mode_name="b")
    switched = tables_of(system, replace(before, modes=(*before.modes, *later.modes)))
    assert switched.diagnostics == ()
    (table,) = switched.tables
    assert {j.task for j in table.jobs} == {"first"}
    ages = [table.length + milliseconds(9 + 10 * n) - j.start for n, j in enumerate(table.jobs)]
    assert len(ages) == 3
    assert all(milliseconds(35) <= age <= milliseconds(36) for age in ages)


def test_what_blocks_a_length_is_named():
    system, plan = two_modes(0, 8, 0)
    change = Change(*on_common_grid(system, *plan.modes))
    assert Table(change, 0).fill() == Blocked("work", "unit or resource is still in use by the mode before")


def drive_model():
    """A sense-plan-act stack in two modes with a resource and a chain; switches must exist in both directions."""
    sense = task("sense", 20, version("v", 6, "u1 u2 u3", access("mem", 0, 2)), slack=Fraction(1, 10))
    plan = task("plan", 20, version("v", 9, "u1 u2 u3", access("mem", 0, 2), after("sense", 0, 10, "end")))
    quick = task("quick", 10, version("v", 2, "u1 u2 u3", access("mem", 0, 1)), slack=Fraction(1, 5))
    act = task("act", 20, version("v", 3, "u1 u2 u3", after("sense", 0, 20, "end")), slack=Fraction(1, 10))
    return model(
        sense,
        plan,
        quick,
        act,
        units="u1 u2 u3",
        resources="mem",
        chains=[chain("c", "sense act", reaction="80ms")],
        modes=[mode("full", [sense, plan, quick, act]), mode("slow", [sense, act])],
    )


@pytest.mark.parametrize("seed", range(1, 6))
def test_every_pair_of_a_scheduled_system_has_a_verified_table(seed):
    system = drive_model()
    scheduled = schedule_model(system, SearchOptions(seed=seed), lambda *progress: True)
    assert scheduled.is_complete
    pairs = [(t.source, t.target) for t in scheduled.schedule.transitions]
    assert pairs == [("full", "slow"), ("slow", "full")]
    assert [d.message for d in verify_schedule(system, scheduled.schedule) if d.severity != "note"] == []


def test_later_modes_keep_the_phases_of_earlier_ones_where_they_can():
    system = drive_model()
    scheduled = schedule_model(system, SearchOptions(seed=1), lambda *progress: True)
    first, second = scheduled.schedule.modes
    earlier = {j.task: j for j in first.jobs if j.index == 0}
    assert {j.task: j.start for j in second.jobs} == {name: earlier[name].start for name in ("sense", "act")}
    assert any(
        j.units == earlier[j.task].units for j in second.jobs
    )  # if dealt one unit, both cannot be where they were
    assert all(table.length == Duration(0) for table in scheduled.schedule.transitions)


# ------------------------------------------------------------------------------------------------ large modes


def large_modes(count, units=4):
    """`count` tasks on each of the units in one mode, and most of them in the others, with other phases there."""
    names = " ".join(f"u{n}" for n in range(units))
    tasks = [task(f"t{n}", (20, 40)[n % 2], version("v", 1 + n % 3, names)) for n in range(count)]
    modes = [mode("all", tasks), mode("odd", [t for n, t in enumerate(tasks) if n % 4]), mode("few", tasks[::3])]
    return model(*tasks, units=names, modes=modes)


def switched(system, seeds=(1, 2, 3), **options):
    """Place each mode by itself, so that phases differ, and look for the switches."""
    parts = [
        schedule_model(system, SearchOptions(seed=seed, modes=(each.name,)), lambda *_: True).schedule
        for seed, each in zip(seeds, system.modes, strict=True)
    ]
    plan = replace(parts[0], modes=tuple(part.modes[0] for part in parts))
    return plan, switch_tables(system, plan, _is_sound_switch, **options)


def test_modes_of_many_tasks_with_other_phases_are_switched():
    system = large_modes(24)
    plan, found = switched(system)
    assert found.diagnostics == ()
    assert len(found.tables) == 6
    assert max(len(table.jobs) for table in found.tables) > 10
    whole = replace(plan, transitions=found.tables)
    assert [d.message for d in verify_schedule(system, whole) if d.is_error] == []


@pytest.mark.slow
def test_processes_find_the_same_tables(monkeypatch):
    monkeypatch.setattr(tables_module, "SPREAD", 1)
    system = large_modes(12)
    assert switched(system, workers=Workers(2)) == switched(system)


def test_pairs_that_are_handed_over_have_the_tables_that_are_found_here(monkeypatch):
    handed = []

    def spread(_, function, pairs, _go_on):
        handed.extend(pairs)
        return map(function, pairs)

    system = large_modes(6)
    expected = switched(system)
    monkeypatch.setattr(tables_module, "SPREAD", 1)
    monkeypatch.setattr(Workers, "spread", spread)
    assert switched(system, workers=Workers(1)) == expected
    assert handed == []
    assert switched(system, workers=Workers(2)) == expected
    assert len(handed) == 6


def test_two_pairs_stay_in_this_process(monkeypatch):
    system, plan = two_modes(0, 0, 3)
    system = replace(system, transitions=())
    expected = switch_tables(system, plan, _is_sound_switch)
    assert len(expected.tables) == 2
    monkeypatch.setattr(tables_module, "SPREAD", 1)
    monkeypatch.setattr(Workers, "spread", None)
    assert switch_tables(system, plan, _is_sound_switch, workers=Workers(2)) == expected


def later_in_mode_b(*rows):
    """Return tasks (name, units, unit, phase, WCET) with a period of 100 ms, and a schedule: in mode b 3 ms later."""
    tasks = [task(name, 100, version("v", wcet, units)) for name, units, _, _, wcet in rows]
    system = model(*tasks, units="u0 u1 u2", modes=[mode("a", tasks), mode("b", tasks)], transitions=[("a", "b", None)])
    modes = [
        schedule(system, 100, *(job(system, n, 0, phase + late, unit) for n, _, unit, phase, _ in rows), mode_name=name)
        for name, late in (("a", 0), ("b", 3))
    ]
    return system, replace(modes[0], modes=tuple(each.modes[0] for each in modes))


def test_the_search_for_a_shorter_table_ends_with_the_work_of_a_pair(monkeypatch):
    system, plan = later_in_mode_b(*((f"t{n}", "u0", "u0", n, 1) for n in range(20)))
    shortest = tables_of(system, plan)
    assert shortest.diagnostics == ()
    monkeypatch.setattr(tables_module, "MOST_WORK", 0)
    found = tables_of(system, plan)
    (table,), (note,) = found.tables, found.diagnostics
    assert table.length > shortest.tables[0].length
    assert note.code == MAY_BE_LONG.id
    assert str(table.length) in note.message


@pytest.mark.parametrize("count", [17, 20])
def test_a_search_that_ends_before_the_shortest_table_says_so(monkeypatch, count):
    system, plan = later_in_mode_b(*((f"t{n}", "u0", "u0", n, 1) for n in range(count)))
    (shortest,) = tables_of(system, plan).tables
    for limit in range(0, 200, 10):
        monkeypatch.setattr(tables_module, "MOST_WORK", limit)
        found = tables_of(system, plan)
        assert found.diagnostics or found.tables[0].length == shortest.length


@pytest.mark.parametrize("count", [3, 8, 15, 20])
def test_the_table_found_by_halves_is_as_short_as_the_first_of_all_lengths(monkeypatch, count):
    system, plan = later_in_mode_b(*((f"t{n}", "u0", "u0", 3 * n, 1 + n % 3) for n in range(count)))
    (by_halves,) = tables_of(system, plan).tables
    monkeypatch.setattr(tables_module, "FEW", 10**6)
    (one_by_one,) = tables_of(system, plan).tables
    assert by_halves.length == one_by_one.length


def test_only_the_jobs_of_a_group_that_does_not_fit_are_placed_anew():
    crowd = [(f"t{n}", "u0 u1", f"u{n % 2}", n // 2 * 4, 4) for n in range(4)]
    system, plan = later_in_mode_b(*crowd, ("alone", "u2", "u2", 0, 1))
    table = Table(Change(*on_common_grid(system, *plan.modes)), 1)
    assert isinstance(table.fill(), Blocked)
    assert table.change.group["t0"] == ["t0", "t1", "t2", "t3"]
    assert (table.work - 1) % 4 == 0
    assert table.work > 5


def test_a_length_is_given_up_later_where_tasks_are_many(monkeypatch):
    """One order more for so many tasks, of which there are five."""
    crowd = [(f"t{n}", "u0 u1", f"u{n % 2}", n // 2 * 4, 4) for n in range(4)]
    system, plan = later_in_mode_b(*crowd, ("alone", "u2", "u2", 0, 1))
    orders = []
    for share in (300, 6, 5, 2, 1):
        monkeypatch.setattr(search, "MORE_PATIENCE", share)
        table = Table(Change(*on_common_grid(system, *plan.modes)), 1)
        assert isinstance(table.fill(), Blocked)
        orders.append((table.work - 1) // 4)
    assert [each - orders[0] for each in orders] == [0, 0, 1, 2, 5]


@pytest.mark.parametrize(("latest", "is_crowded"), [(13, True), (14, False)])
def test_starts_of_one_unit_are_as_far_apart_as_all_jobs_but_the_longest_last(latest, is_crowded):
    """Jobs of 1, 2, 4 and 5 ms that start from 7 ms on: the last of them at 14 ms; those with a choice do not count."""
    rows = [(f"t{n}", "u0", "u0", 10 * n, wcet) for n, wcet in enumerate((1, 2, 4, 5))]
    system, plan = later_in_mode_b(*rows, ("free", "u0 u1", "u1", 0, 9))
    tasks = [replace(each, versions=(*each.versions, version("long", 9, "u0"))) for each in system.tasks]
    system = replace(system, tasks=tuple(tasks), modes=(mode("a", tasks), mode("b", tasks)))
    table = Table(Change(*on_common_grid(system, *plan.modes)), 30)
    table._want(*(search._Wanted(f"t{n}", 7 + n % 2, latest - n % 2, "rule") for n in range(4)))
    table._want(search._Wanted("free", 7, latest, "rule"))
    assert (table._crowded() is not None) == is_crowded


@pytest.mark.parametrize(("length", "rounds"), [(3, 0), (4, 1)])
def test_a_unit_without_room_for_all_its_jobs_is_seen_before_they_are_placed(length, rounds):
    system, plan = later_in_mode_b(*((f"t{n}", "u0", "u0", n, 1) for n in range(4)))
    table = Table(Change(*on_common_grid(system, *plan.modes)), length)
    table.fill()
    assert table.work // 4 >= rounds
    assert (table.work == 0) == (rounds == 0)


def test_paces_of_tasks_that_serve_arrivals_are_linear_in_them():
    def prepare(count):
        free = [task(f"t{n}", 1000, version("v", 1, f"u{n}")) for n in range(count)]
        tasks = [replace(each, distance=milliseconds(2000)) for each in free]
        units = " ".join(f"u{n}" for n in range(count))
        system = model(*tasks, units=units, modes=[mode("a", tasks), mode("b", tasks)])
        jobs = [job(model(each), each.name, 0, 0, f"u{n}") for n, each in enumerate(tasks)]
        plan = schedule(system, 1000, *jobs, mode_name="a").modes[0]
        grids = on_common_grid(system, plan, replace(plan, name="b"))

        def work():
            assert len(Change(*grids).paces) == count

        return work

    assert growth(prepare, 200, 3_200) < half_way(16)


def test_a_stopped_search_says_so_and_keeps_what_it_found():
    system = large_modes(12)
    _, found = switched(system, go_on=lambda done, total: done < 2)
    assert found.stopped
    assert len(found.tables) == 2
    assert not switched(system)[1].stopped


def test_a_search_that_is_stopped_within_a_pair_has_no_table_of_it():
    system, plan = two_modes(0, 0, 3)
    asked = []
    found = switch_tables(system, plan, lambda *_: True, lambda *_: asked.append(0) or len(asked) < 2)
    assert (found.tables, found.diagnostics, found.stopped) == ((), (), True)


@pytest.mark.parametrize("least", [1, 2, 5])
def test_a_length_whose_table_is_rejected_is_not_the_last_that_is_tried(least):
    system, plan = two_modes("1/2", 0, 3)

    def check(_model, _schedule, table):
        return table.length >= milliseconds(least) and _is_sound_switch(_model, _schedule, table)

    (table,) = switch_tables(system, plan, check).tables
    assert table.length == milliseconds(least)


def test_jobs_of_a_table_are_numbered_by_task():
    system = large_modes(24)
    tables = switched(system)[1].tables
    for table in tables:
        numbers = {}
        for each in table.jobs:
            numbers.setdefault(each.task, []).append(each.index)
        assert all(own == [*range(len(own))] for own in numbers.values())
    assert max(j.index for table in tables for j in table.jobs) > 0


def test_doubtful_pairs_come_first_and_all_or_none_are_found():
    system, plan = two_modes(0, 0, 3, limit="0ms")
    system = replace(system, transitions=(*system.transitions, Transition(source="b", target="a")))
    assert [table.source for table in tables_of(system, plan).tables] == ["b"]
    tried = []

    def never(_model, _schedule, table):
        tried.append((table.source, table.target))
        return True

    found = switch_tables(system, plan, never, doubtful=(("a", "b"),))
    assert found.tables == ()
    assert found.failed == (("a", "b"),)
    assert tried == [], "the doubtful pair has ended the search"


def test_the_effort_for_one_pair_is_bounded(monkeypatch):
    """However many lengths there are: a few are tried if each of them is much work."""
    tried = []

    def never(self):
        tried.append(self.length)
        self.work = 10**6
        return Blocked("t", "r", progress=1)

    monkeypatch.setattr(tables_module.Table, "fill", never)
    system, plan = two_modes(0, 0, 3)
    assert tables_of(system, plan).tables == ()
    assert len(tried) == tables_module.LEAST_TRIES


@pytest.mark.parametrize(
    ("lengths", "jobs", "step"),
    [
        (64, 10**9, 1),  # few lengths are all tried
        (65, 0, 16),
        (800, 1000, 54),  # 15 lengths, in each of which a thousand jobs are placed four times
        (800, 10**6, 100),  # eight are tried however large the modes are
        (240_000, 1, 16),
        (240_001, 1, 17),
    ],
)
def test_of_many_lengths_as_many_are_tried_as_can_be_afforded(lengths, jobs, step):
    assert tables_module._step(lengths, jobs) == step


@pytest.mark.parametrize(
    ("count", "works", "tried", "between"),
    [
        (64, {50}, [*range(51)], None),
        (100, {0}, [0], (0, 0)),
        (100, {*range(40, 100)}, [0, 16, 32, 48], (32, 48)),
        (100, {5, 60}, [*range(0, 97, 16), 1, 2, 3, 4, 5], (0, 5)),
        (100, {}, [*range(0, 97, 16), *(n for n in range(100) if n % 16)], None),
    ],
)
def test_lengths_are_tried_from_short_to_long_then_those_below_the_first_that_works(
    monkeypatch, count, works, tried, between
):
    seen, halved = [], []

    class Search:
        table, is_stopped, blocked = None, False, "blocked"

        def possible(self):
            return [*range(count)]

        def tries(self, length):
            seen.append(length)
            self.table = f"table of {length}" if length in works else None
            return self.table is not None

        def shorten(self, lengths):
            halved.append((lengths[0], lengths[-1]))
            return True

    monkeypatch.setattr(tables_module, "_Search", lambda *_: Search())
    found = tables_module._shortest(SimpleNamespace(jobs=1))
    assert found == (f"table of {seen[-1]}" if works else "blocked")
    assert seen == tried
    assert halved == ([between] if between else [])


def test_a_layer_finds_what_is_near_an_instant():
    read = Phase("mem", 1, 3, 2)
    jobs = [LineJob(n * 10, "t", n, shape(4, phases=[read]), ("u1",)) for n in range(5)]
    layer = Layer(reversed(jobs))
    assert [layer.free_from("u1", start, 6) for start in (0, 3, 4, 5, 44)] == [4, 4, 4, 14, 44]
    assert layer.free_from("u2", 0, 6) == 0
    assert list(layer.phases_within("mem", 12, 31)) == [(11, 13, 2), (21, 23, 2)]
    assert list(layer.phases_within("mem", 13, 21)) == []


def test_a_line_adds_up_what_its_layers_hold_each_moved():
    read = Phase("mem", 0, 4, 3)
    base = Layer([LineJob(0, "a", 0, shape(4, phases=[read], name="a"), ("u1",))])
    line = Line(5, (base, 0), (base, 10))
    line.enter(LineJob(6, "b", 0, shape(3, name="b"), ("u1",)))
    assert line.first_fit(shape(2, units="u1", name="c"), 0, 50) == (4, ("u1",))
    assert line.first_fit(shape(3, units="u1", name="c"), 0, 50) == (14, ("u1",))
    assert line.first_fit(shape(4, units="u2", phases=[read], name="c"), 1, 50) == (4, ("u2",))
    assert line.first_fit(shape(9, units="u2", phases=[replace(read, end=9)], name="c"), 1, 50) == (14, ("u2",))


def test_the_least_length_lets_units_become_free():
    """The job before runs until 2 ms after the switch, the first one after starts at 0."""
    system, plan = two_modes(0, 8, 0)
    change = Change(*on_common_grid(system, *plan.modes))
    needed, name = change.least
    assert (change.after.tick * needed, name) == (milliseconds(2), "work")
    assert change.clash(needed - 1) == "work"
    assert change.clash(needed) is None


def test_an_improvement_keeps_the_switches():
    """Switches without any time between the modes, whose wider margins leave some job no place across the switch."""
    preemptive = replace(version("v", 3, "u1 u2"), split=Split(points=(milliseconds(1), milliseconds(2))))
    tasks = [
        task("a", 24, version("v", 3, "u1 u2"), slack=Fraction(1, 2)),
        task("b", 24, preemptive, slack=1),
        task("c", 12, version("v", 3, "u1 u2"), slack=1),
    ]
    switches = [("m", "n", 0), ("n", "m", 0)]
    system = model(*tasks, units="u1 u2", modes=[mode("m", tasks), mode("n", tasks)], transitions=switches)
    plain = schedule_model(system, SearchOptions(budget=100), lambda *_: True)
    better = schedule_model(system, SearchOptions(budget=100, optimise=(Objective.MARGIN,)), lambda *_: True)
    assert len(plain.schedule.transitions) == len(better.schedule.transitions) == 2
    assert sorted(row.value == row.first for row in better.reached) == [False, True]  # one mode is improved
    assert [found.code for found in better.diagnostics] == [KEPT_FOR_SWITCHES.id]
    assert not [found for found in verify_schedule(system, better.schedule) if found.is_error]
