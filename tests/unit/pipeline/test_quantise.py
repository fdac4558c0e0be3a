"""The model on the grid of regulators: what is rounded where, what cannot be, and that schedules of it are exact."""

from dataclasses import replace
from fractions import Fraction
from math import ceil

import pytest

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import Duration, divisors
from halpipe.exporters.regulator.platform import read_platform
from halpipe.exporters.regulator.tables import TableBuilder
from halpipe.exporters.regulator.words import WHOLE
from halpipe.exporters.regulator.writing import backend
from halpipe.flow.formats import burst_grid
from halpipe.flow.plan import read_plan
from halpipe.models import Anchor, HealthAction, HealthEvent, HealthRule, Job, Transition
from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.explain.explanation import ExplainOptions
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import codes
from halpipe.pipeline.solve.quantise import BurstGrid, describe, quantise, restore, with_ends
from halpipe.pipeline.solve.schedule import SearchOptions
from support import access, after, chain, job, mode, model, ms, schedule, task, version

GRID = BurstGrid(
    name="p", window=ms(1), cycle=ms("1us"), resource="mem", promise=Fraction(6400), capacity=6400, burst=64, reserve=0
)
PLATFORM = """\
halpipe-regulator: 1
resource: mem
clock: 1MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 6.2MB/s
capacity: 6.4MB/s
units: {u1: {manager: 0}, u2: {manager: 1}}
"""


def on_grid(*tasks, grid=GRID, **changes):
    return quantise(model(*tasks, units="u1 u2", resources="mem other"), replace(grid, **changes))


def only(system):
    return system.tasks[0].versions[0]


def refusal(*tasks, **changes):
    with pytest.raises(HalpipeError) as refused:
        on_grid(*tasks, **changes)
    return refused.value.diagnostics


def spans(accesses):
    return [(a.start, a.end, a.bound) for a in accesses]


# ------------------------------------------------------------------------------------------------ what is rounded


def test_wcets_go_up_and_what_lies_on_the_grid_stays():
    t = task("t", 10, version("a", "2.1ms", "u1"), version("b", 3, "u1"))
    assert [v.wcet for v in on_grid(t).tasks[0].versions] == [ms(3), ms(3)]


def test_phases_claim_whole_windows_in_whole_bursts():
    t = task("t", 10, version("v", 4, "u1", access("mem", "1.5ms", "3.5ms", "0.333")))
    # 16.65, 33.3 and 16.65 bursts; in the windows at both ends the bound holds for half of the time, but it holds
    assert spans(only(on_grid(t)).accesses) == [
        (ms(1), ms(2), Fraction(333, 1000)),
        (ms(2), ms(3), Fraction(34, 100)),
        (ms(3), ms(4), Fraction(333, 1000)),
    ]


def test_a_phase_on_the_grid_stays_one_phase():
    t = task("t", 10, version("v", 4, "u1", access("mem", 1, 4, "0.25")))
    assert spans(only(on_grid(t)).accesses) == [(ms(1), ms(4), Fraction(1, 4))]


def test_two_phases_in_one_window_do_not_count_twice():
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, "0.5ms"), access("mem", "0.5ms", 1, "0.5")))
    assert spans(only(on_grid(t)).accesses) == [(ms(0), ms(1), Fraction(1))]


def test_reads_and_writes_of_one_window_are_rounded_up_each():
    reads, writes = access("mem", 0, 1, "0.005", "read"), access("mem", 0, 1, "0.005", "write")
    t = task("t", 10, version("v", 2, "u1", reads, writes))
    assert spans(only(on_grid(t)).accesses) == [(ms(0), ms(1), Fraction(2, 100))]
    both = task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.005", "read"), access("mem", 0, 1, "0.005")))
    assert spans(only(on_grid(both)).accesses) == [(ms(0), ms(1), Fraction(1, 100))]
    assert spans(only(on_grid(both, writes=True)).accesses) == [(ms(0), ms(1), Fraction(2, 100))]


def test_a_gang_has_whole_bursts_on_each_unit():
    t = task("t", 10, version("v", 2, "u1 u2", access("mem", 0, 1, "0.01"), gang=2))
    assert spans(only(on_grid(t)).accesses) == [(ms(0), ms(1), Fraction(2, 100))]


def test_the_reserve_is_kept_for_every_unit_and_direction_that_may_use_the_resource():
    t = task("t", 10, version("v", 2, "u1 u2", access("mem", 0, 1, "0.5", "read"), access("mem", 1, 2, "0.1", "write")))
    (first, second) = spans(only(on_grid(t, reserve=160)).accesses)
    assert first == (ms(0), ms(1), Fraction(50, 90))
    assert second == (ms(1), ms(2), Fraction(10, 90))


def test_other_resources_only_grow_to_whole_windows():
    t = task("t", 10, version("v", 2, "u1", access("other", 0, "0.5ms", "1/3"), access("other", "0.5ms", 1, "0.9")))
    assert spans(only(on_grid(t)).accesses) == [(ms(0), ms(1), Fraction(9, 10))]


def test_phases_of_neighbouring_windows_keep_their_own_bounds():
    made = version("v", 2, "u1", access("mem", 0, 1, "1/2"), access("mem", 1, 2))
    assert spans(only(on_grid(task("t", 10, made))).accesses) == [(ms(0), ms(1), Fraction(1, 2)), (ms(1), ms(2), 1)]


@pytest.mark.parametrize(("carries", "wcet", "seams"), [(True, 2, 1), (True, 3, 1), (True, 1, 0), (False, 3, 0)])
def test_a_burst_may_pass_in_the_window_behind_a_phase_that_the_version_has(carries, wcet, seams):
    """Where the version ends with the phase, a burst of its row is kept; other resources have no bursts."""
    made = version("v", wcet, "u1", access("mem", 0, 1, "1/10"), access("other", 0, 1, "1/10"))
    found = only(on_grid(task("t", 10, made), carries=carries)).accesses
    tenth = (ms(0), ms(1), Fraction(1, 10))
    assert spans(found) == [tenth, *[(ms(1), ms(2), Fraction(1, 100))] * seams, tenth]


def test_bursts_that_outlive_a_gang_are_kept_for_each_of_its_units():
    """Of 1.025 bursts, two on each of four units, one is kept: that leaves 4 of 96."""
    wide = task("t", 10, version("v", 1, "u1 u2 u3 u4", access("mem", 0, 1, "41/1000"), gang=4))
    found = quantise(model(wide, units="u1 u2 u3 u4", resources="mem"), replace(GRID, carries=True))
    assert spans(only(found).accesses) == [(ms(0), ms(1), Fraction(4, 96))]


@pytest.mark.parametrize(("reserves", "kept"), [("used", 64), ("units", 2 * 64), ("all", 2 * 2 * 64)])
def test_what_regulators_overshoot_is_kept_for_rows_for_units_or_for_all_that_are_regulated(reserves, kept):
    system = model(task("t", 10, version("v", 1, "u1", access("mem", 0, 1, "1/2"))), units="u1 u2 u3", resources="mem")
    grid = replace(GRID, reserve=64, reserves=reserves, regulated=("u1", "u2", "elsewhere"), promise=Fraction(6200))
    assert f"(6400 bytes less {kept} for overshoot), a bound of 1 is 96.87" in describe(system, grid)


def test_a_job_without_a_version_in_the_model_keeps_its_length():
    system = model(task("t", 10, version("v", "1.5ms")))
    known, unknown = job(system, "t", 0, 3, "u1"), replace(job(system, "t", 0, 3, "u1"), version="w", end=ms(9))
    longer = replace(known, end=ms(5))
    assert with_ends(system, (longer, unknown)) == (known, unknown)


def test_precedence_windows_shrink():
    t = task("t", 10, version("v", 2, "u1"))
    o = task("o", 10, version("v", 2, "u1", after("t", "0.5ms", "4.5ms"), after("t", "0.5ms", "4.5ms", "end")))
    (start, end) = on_grid(t, o).tasks[1].versions[0].precedences
    assert (start.min, start.max, start.anchor) == (ms(1), ms(4), Anchor.START)
    assert (end.min, end.max) == (ms(1), ms(4))  # t ends on the grid


def test_windows_from_an_end_inside_a_window_shrink_by_what_is_rounded_there():
    t = task("t", 10, version("a", "1.25ms", "u1"), version("b", "1.75ms", "u1"))
    rows = [after("t", 0, high, "end") for high in (2, "2.75ms", "2.25ms")]
    (short, longer, between) = on_grid(t, task("o", 10, version("v", 2, "u1", *rows))).tasks[1].versions[0].precedences
    assert (between.min, between.max) == (ms(0), ms(1))  # by the larger of both
    assert (short.min, short.max) == (ms(0), ms(1))
    assert (longer.min, longer.max) == (ms(0), ms(2))


@pytest.mark.parametrize(
    ("deadline", "wcet"), [("5.2ms", "2.7ms"), ("5.7ms", "2.2ms"), ("5ms", "3ms"), ("2.7ms", "2.7ms")]
)
def test_a_start_on_the_grid_keeps_the_deadline_exactly_if_it_keeps_the_original(deadline, wcet):
    t = task("t", 10, version("v", wcet, "u1"), deadline=deadline, slack=1)
    rounded = on_grid(t).tasks[0]
    for delta in range(10):
        keeps = ms(delta) + ms(wcet) <= ms(deadline)
        assert (ms(delta) + rounded.versions[0].wcet <= rounded.deadline) == keeps


def test_the_deadline_is_the_smallest_that_a_version_leaves():
    """5.2 ms less 2.7 ms are two windows, and 3 ms before them; less 2.2 ms they are three."""
    t = task("t", 10, version("a", "2.2ms", "u1"), version("b", "2.7ms", "u1"), version("c", 6, "u1"), deadline="5.2ms")
    assert on_grid(t).tasks[0].deadline == ms(5)
    assert on_grid(replace(t, versions=t.versions[:1])).tasks[0].deadline == ms(6)


# ------------------------------------------------------------------------------------------- what cannot be rounded


def test_periods_and_offsets_off_the_grid_are_answered_with_the_nearest_windows():
    t = task("t", "2.5ms", version("v", 1, "u1"))
    o = task("o", 10, version("v", 1, "u1"), offset="1.5ms")
    found = refusal(t, o)
    assert [(d.code, d.path) for d in found] == [(codes.GRID_PERIOD.id, 'task "t"'), (codes.GRID_PERIOD.id, 'task "o"')]
    assert "period 2.5ms is not a multiple of the window 1ms" in found[0].message
    assert found[0].help.endswith("are 500 cycles (500us)")
    on_grid(t, o, window=ms("0.5ms"))


@pytest.mark.parametrize(
    ("period", "cycle", "window"),
    [("3.5ms", "1ms", "875us"), ("2.5ms", "2ms", "1.25ms"), ("0.4ms", "1ms", "400us")],
)
def test_where_no_whole_cycles_divide_a_period_the_nearest_window_that_does_is_named(period, cycle, window):
    [found] = refusal(task("t", period, version("v", "0.1ms", "u1")), cycle=ms(cycle))
    assert found.help.startswith(f'state "window: {window}", which divides all periods and offsets')


@pytest.mark.parametrize(
    ("period", "cycle", "windows"),
    [("4.5ms", "1.5ms", "1 cycles (1.5ms)"), ("6.3ms", "0.3ms", "3 cycles (900us) or 7 cycles (2.1ms)")],
)
def test_the_nearest_windows_of_whole_cycles_on_both_sides_are_named(period, cycle, windows):
    [found] = refusal(task("t", period, version("v", "0.1ms", "u1")), cycle=ms(cycle))
    assert found.help == f"the nearest windows that divide all periods and offsets are {windows}"


def test_a_precedence_window_without_a_distance_on_the_grid():
    t = task("t", 10, version("v", "1.5ms", "u1"))
    o = task("o", 10, version("v", 1, "u1", after("t", "0.2ms", "0.9ms"), after("t", 0, "0.4ms", "end")))
    found = refusal(t, o)
    assert {d.code for d in found} == {codes.GRID_WINDOW.id}
    assert "widen it to [200us, 1ms]" in found[0].help
    assert "its end being known to 500us only" in found[1].message
    assert "widen it to [0ms, 500us]" in found[1].help
    for row in (after("t", "0.2ms", 1), after("t", 0, "0.5ms", "end")):
        on_grid(t, task("o", 10, version("v", 1, "u1", row)))


def test_a_bound_that_leaves_no_room_for_overshoot():
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, 1)))
    on_grid(t)
    (found,) = refusal(t, reserve=64)
    assert found.code == codes.GRID_BOUND.id
    assert "bound 1 comes to 100 bursts of 64 bytes in a window of 1ms; there is room for 99" in found.message
    assert found.help == "bind it to at most 0.99, or let the platform have a capacity of 6464000B/s"
    on_grid(t, reserve=64, capacity=6464)
    on_grid(task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.99"))), reserve=64)
    rounded_down = refusal(task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.9999"))), reserve=64)
    assert "at most 0.989," in rounded_down[0].help
    for beside in ((1, 2), (0, 1)):  # another window has room
        rows = access("mem", *beside, "0.5"), access("mem", 1 - beside[0], 2 - beside[0])
        assert refusal(task("t", 10, version("v", 2, "u1", *rows)), reserve=64)[0].message == found.message


def test_a_window_that_is_all_overshoot():
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.01")))
    found = refusal(t, reserve=6400)
    assert found[0].code == codes.GRID_ROOM.id
    assert found[0].help == "use a window of at least 1010 cycles"


@pytest.mark.parametrize(("reserve", "is_refused"), [(6336, False), (6337, True)])
def test_one_burst_beside_what_is_kept_is_room_enough(reserve, is_refused):
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "1/200")))
    if is_refused:
        assert [d.code for d in refusal(t, reserve=reserve)] == [codes.GRID_ROOM.id]
    else:
        assert [access.bound for access in only(on_grid(t, reserve=reserve)).accesses] == [1]


def test_a_resource_that_is_not_there():
    for name in ("mme", ""):
        (found,) = refusal(task("t", 10, version("v", 2, "u1")), resource=name)
        assert found.code == codes.GRID_RESOURCE.id
    one = model(task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.335"))), units="u1", resources="mem")
    assert only(quantise(one, replace(GRID, resource=""))).accesses[0].bound == Fraction(34, 100)


def test_divisors_are_multiples_of_the_unit():
    assert divisors(ms(10), ms("2.5ms")) == [ms("2.5ms"), ms(5), ms(10)]
    assert divisors(ms(10), ms(3)) == []
    assert divisors(Duration(0), ms(1)) == []
    assert divisors(Duration(10**12 + 1), Duration(1)) == []


# ------------------------------------------------------------------------------------------------- schedules on it


def stack():
    """Tasks with phases anywhere, a chain, and two modes; the bounds nearly fill the resource."""
    first = task("first", 10, version("v", "3.3ms", "u1 u2", access("mem", "0.2ms", "2.9ms", "0.41", "read")))
    second = task(
        "second",
        10,
        version("v", "2.6ms", "u1 u2", access("mem", 0, "1.3ms", "0.57", "write"), after("first", 0, 4, "end")),
        version("w", "1.1ms", "u1 u2", access("mem", 0, 1, "0.2"), after("first", 0, 4, "end")),
        slack="0.3",
    )
    third = task(
        "third", 5, version("v", "1.4ms", "u1 u2", access("mem", "0.1ms", "0.9ms", "0.33", "read")), slack="0.5"
    )
    modes = (mode("all", [first, second, third]), mode("few", [first, third]))
    limits = [chain("c", "first second", reaction="50ms", age="30ms")]
    return model(first, second, third, units="u1 u2", resources="mem", modes=modes, chains=limits)


def platform(folder, text=PLATFORM):
    path = folder / "platform.yaml"
    path.write_text(text)
    return str(path)


def test_a_schedule_on_the_grid_is_one_of_the_model_and_exports_without_lag(tmp_path):
    system = stack()
    file = platform(tmp_path)
    found = schedule_model(system, SearchOptions(grid=burst_grid(file)), lambda *_: True)
    assert found.is_complete
    assert [d for d in verify_schedule(system, found.schedule) if d.is_error] == []
    tables = (*found.schedule.modes, *found.schedule.transitions)
    assert all(not job.start % ms(1) for table in tables for job in table.jobs)
    assert any(job.end % ms(1) for table in tables for job in table.jobs)  # WCETs are the real ones
    assert all(not table.length % ms(1) for table in found.schedule.transitions)
    used = read_platform(file)
    exported = TableBuilder(system, found.schedule, used, backend("table")).build(WHOLE)
    assert {table.rounding for table in exported.tables} == {WHOLE}
    for table in exported.tables:
        for row, promise in table.promised.items():
            for k, bursts in enumerate(table.row(row)):
                assert bursts == ceil(promise.at(k + 1) - promise.at(k))
        assert max(table.totals) <= 100


def test_one_mode_on_the_grid_needs_no_switch_or_reaction_of_others(tmp_path):
    rule = HealthRule(task="first", event=HealthEvent.OVERRUN, action=HealthAction.RESTART)
    system = replace(stack(), transitions=(Transition(source="all", target="few"),), health=(rule,))
    options = SearchOptions(grid=burst_grid(platform(tmp_path)), modes=("few",))
    assert schedule_model(system, options, lambda *_: True).is_complete


@pytest.mark.parametrize(("start", "stays"), [("2ms", True), ("2.5ms", False)])
def test_a_task_that_has_shipped_beside_the_grid_is_placed_anew(tmp_path, start, stays):
    system = model(task("a", 10, version("v", "1.5ms", "u1 u2"), slack=1), units="u1 u2", resources="mem")
    shipped = schedule(system, 10, job(system, "a", 0, start, "u1"))
    options = SearchOptions(grid=burst_grid(platform(tmp_path)), shipped=shipped)
    found = schedule_model(system, options, lambda *_: True)
    assert any(d.code == codes.CANNOT_STAY.id for d in found.diagnostics) is not stays
    [again] = found.schedule.modes[0].jobs
    assert (again.start == ms(start)) is stays
    assert not again.start % ms(1)
    assert ExplainOptions(grid=options.grid, shipped=shipped).search().tick == (None if stays else ms(1))


@pytest.mark.parametrize("optimise", [None, (Objective.MARGIN,)])
@pytest.mark.parametrize(("slack", "let"), [("1", None), ("1/2", "11.5ms"), ("9/16", None)])
@pytest.mark.parametrize("engine", ["anneal", "exact"])
def test_no_search_for_a_margin_leaves_the_grid(tmp_path, optimise, slack, let, engine):
    """Of the 12 ms there is 1 ms left, and windows last 1 ms: a margin for all jobs lies between them."""
    tasks = [
        replace(task(name, 12, version("v", wcet, "u1"), slack=slack), let=ms(let))
        for name, wcet in (("a", 3), ("b", 3), ("c", 5))
    ]
    system = model(*tasks, units="u1", resources="mem")
    budget = 20 if engine == "anneal" else None
    options = SearchOptions(grid=burst_grid(platform(tmp_path)), optimise=optimise, engine=engine, budget=budget)
    if let and engine == "exact":
        with pytest.raises(HalpipeError):
            schedule_model(system, options, lambda *_: True)
        return
    found = schedule_model(system, options, lambda *_: True).schedule
    assert not any(job.start % ms(1) for job in found.modes[0].jobs)


def test_loads_and_costs_are_those_of_the_model(tmp_path):
    system = stack()
    file = platform(tmp_path)
    found = schedule_model(system, SearchOptions(grid=burst_grid(file)), lambda *_: True).schedule
    again = restore(system, found)
    assert again == found
    busy = sum(load.busy.fraction for load in found.mode("few").unit_loads)
    assert busy == ms("6.1ms").fraction  # 3.3 ms and twice 1.4 ms


def test_the_same_options_give_the_same_schedule(tmp_path):
    options = SearchOptions(grid=burst_grid(platform(tmp_path)))
    runs = [schedule_model(stack(), options, lambda *_: True).schedule for _ in range(2)]
    assert runs[0] == runs[1]


def test_no_schedule_on_the_grid_is_explained_with_the_numbers(tmp_path):
    first = task("first", 10, version("v", 5, "u1", access("mem", 0, 5, "0.55", "read")))
    second = task("second", 10, version("v", 10, "u2", access("mem", 0, 10, "0.45", "read")))
    system = model(first, second, units="u1 u2", resources="mem")
    assert schedule_model(system, SearchOptions(), lambda *_: True).is_complete
    tight = PLATFORM.replace("6.2MB/s", "6.4MB/s") + "overshoot: 64B\n"
    with pytest.raises(HalpipeError) as refused:
        schedule_model(system, SearchOptions(grid=burst_grid(platform(tmp_path, tight))), lambda *_: True)
    found = refused.value.diagnostics
    assert (found[0].code, refused.value.exit) == (codes.GRID_TIGHT.id, Exit.INFEASIBLE)
    assert (
        "room for 96 bursts of 64 bytes (6400 bytes less 256 for overshoot and bursts carried over)" in found[0].message
    )
    assert "a bound of 1 is 100" in found[0].message
    assert len(found) > 1


def test_what_has_no_schedule_at_all_is_not_blamed_on_the_grid(tmp_path):
    t = [task(n, 10, version("v", 6, "u1")) for n in ("a", "b")]
    system = model(*t, units="u1", resources="mem")
    with pytest.raises(HalpipeError) as refused:
        schedule_model(system, SearchOptions(grid=burst_grid(platform(tmp_path))), lambda *_: True)
    assert codes.GRID_TIGHT.id not in {d.code for d in refused.value.diagnostics}


def test_a_tick_besides_must_be_on_the_grid(tmp_path):
    system = stack()
    grid = burst_grid(platform(tmp_path))
    for tick, near in (("1.5ms", 2), ("0.3ms", 1), ("2.9ms", 3)):
        with pytest.raises(HalpipeError) as refused:
            schedule_model(system, SearchOptions(grid=grid, tick=ms(tick)), lambda *_: True)
        (found,) = refused.value.diagnostics
        assert (found.code, found.help) == (codes.GRID_TICK.id, f"omit --tick, or use {near}ms")
    assert schedule_model(system, SearchOptions(grid=grid, tick=ms(1)), lambda *_: True).is_complete


def test_what_breaks_off_the_grid_is_no_schedule(tmp_path, monkeypatch):
    """Should the reasons why the grid is safe not hold, verify has the last word."""
    system = stack()

    def late(model, found):
        first = found.modes[0]
        moved = tuple(
            replace(j, start=j.start + ms("0.5ms"), end=j.end + ms("0.5ms")) if j.task == "first" else j
            for j in first.jobs
        )
        return replace(found, modes=(replace(first, jobs=moved), *found.modes[1:]))

    monkeypatch.setattr("halpipe.pipeline.solve.quantise.restore", late)
    with pytest.raises(HalpipeError) as refused:
        schedule_model(system, SearchOptions(grid=burst_grid(platform(tmp_path))), lambda *_: True)
    assert (refused.value.diagnostics[0].code, refused.value.exit) == (codes.GRID_BREAKS.id, Exit.NOT_FOUND)


def test_restore_gives_jobs_their_real_ends():
    t = task("t", 10, version("v", "2.25ms", "u1"))
    system = model(t, units="u1", resources="mem")
    placed = Job(task="t", index=0, start=ms(9), end=ms(12), version="v", units=("u1",))
    found = restore(system, schedule(system, 10, placed))
    assert found.modes[0].jobs[0].end == ms("11.25ms")
    assert found.modes[0].unit_loads[0].busy == ms("2.25ms")


def test_the_grid_of_a_platform(tmp_path):
    found = burst_grid(platform(tmp_path, PLATFORM + "backend: axi-realm\nunspecified: write\n"))
    assert found == BurstGrid(
        name="platform", window=ms(1), cycle=ms("1us"), resource="mem", promise=Fraction(6200), capacity=6400,
        burst=64, reserve=128, writes=True, reserves="units", regulated=found.regulated,
    )  # fmt: skip
    assert "less 0 for overshoot" in describe(model(units="u1", resources="mem"), found)


def test_pipeline_files_name_the_platform(tmp_path):
    platform(tmp_path)
    file = tmp_path / "p.yaml"
    file.write_text("halpipe-pipeline: 1\nmodel: m.xml\nschedule: {output: s.xml, quantise: platform.yaml}\n")
    assert read_plan(str(file)).search.grid == burst_grid(str(tmp_path / "platform.yaml"))
    platform(tmp_path, PLATFORM.replace("64bit", "65bit"))
    file.write_text("halpipe-pipeline: 1\nmodel: m.xml\nschedule: {output: s.xml, sed: 1, quantise: platform.yaml}\n")
    with pytest.raises(HalpipeError) as refused:
        read_plan(str(file))
    assert sorted(d.code for d in refused.value.diagnostics) == ["HAL0021", "HAL0023"]


@pytest.mark.parametrize(("units", "bounds"), [("u1", [Fraction(3, 10)]), ("u1 u2", [Fraction(1, 3), Fraction(1, 9)])])
def test_a_burst_is_kept_for_a_row_that_outlives_a_version_where_all_units_of_another_have_one(units, bounds):
    """`ends` reads in its last window on u1: of 10 bursts one is kept for that. `reads` needs 2.7 bursts of 9, on units
    of which each has such a burst, or one of three and, a window later, one that waits."""
    grid = BurstGrid(
        name="p", window=ms(1), cycle=ms("0.1ms"), resource="mem", promise=Fraction(9 * 64), capacity=10 * 64,
        burst=64, reserve=0, carries=True,
    )  # fmt: skip
    ends = task("ends", 10, version("v", 1, "u1", access("mem", 0, 1, "1/10", "read")))
    reads = task("reads", 10, version("v", 3, units, access("mem", 0, 1, "3/10", "read")))
    found = quantise(model(ends, reads, units="u1 u2", resources="mem"), grid)
    assert [each.bound for each in found.tasks[1].versions[0].accesses] == bounds
