"""From names to arrays: lanes, options, quanta, rounding to a tick, and what is refused."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.models import Anchor, Binding, Match
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve import codes, lanes, limits
from halpipe.pipeline.solve.problem import END, NO_TICK, POINT, RELEASE, START, build_problem
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from support import access, after, chain, model, ms, task, version


def build(system, **options):
    tick = ms(options.pop("tick", None))
    names = [resource.name for resource in system.resources]
    return build_problem(expand(system, system.modes[0]), system.units, names, system.chains, tick=tick, **options)


def options_of(built, number=0):
    first, last = built.arrays.task_option[number : number + 2].tolist()
    return [(o.version and o.version.name, o.groups) for o in built.options[first:last]]


def column(built, table, number=0):
    """Return the rows of a table that option `number` owns."""
    first, last = getattr(built.arrays, f"{table}_first")[number : number + 2].tolist()
    return list(getattr(built.arrays, table).rows(first, last))


def after_point(name, low, high, point):
    return replace(after(name, low, high), anchor=Anchor.POINT, point=ms(point))


def refusal(system, **options):
    """Return the one diagnostic with which scheduling refuses a model."""
    with pytest.raises(HalpipeError) as caught:
        schedule_model(system, SearchOptions(**options), lambda *_: True)
    (found,) = caught.value.diagnostics
    return found


# ------------------------------------------------------------------------------------------------ lanes


def test_units_that_all_versions_treat_alike_share_a_lane():
    system = model(
        task("a", 10, version("v", 1, "u1 u2 u3")), task("b", 10, version("v", 1, "u2 u4")), units="u1 u2 u3 u4 idle"
    )
    built = build(system)
    assert built.groups == (("u1", "u3"), ("u2",), ("u4",))
    assert built.arrays.lane_capacity.tolist() == [2, 1, 1]
    assert options_of(built, 0) == [("v", ((0, 1),)), ("v", ((1, 1),))]
    assert build(system, grouped=False).groups == (("u1",), ("u2",), ("u3",), ("u4",))


def test_a_gang_has_an_option_for_every_split_over_the_groups():
    system = model(
        task("a", 10, version("v", 1, "u1 u2 u3", gang=2)), task("b", 10, version("v", 1, "u3")), units="u1 u2 u3"
    )
    assert options_of(build(system)) == [("v", ((0, 2),)), ("v", ((0, 1), (1, 1)))]
    wide = model(
        task("a", 10, version("v", 1, "u1 u2 u3", gang=3)), task("b", 10, version("v", 1, "u3")), units="u1 u2 u3"
    )
    assert options_of(build(wide)) == [("v", ((0, 2), (1, 1)))]  # no group has three, nor the second one two
    alone = options_of(build(system, grouped=False))
    assert alone == [("v", ((a, 1), (b, 1))) for a, b in ((0, 1), (0, 2), (1, 2))]


@pytest.mark.parametrize(
    ("versions", "has_choice"),
    [
        ([version("v", 1, "u1")], False),
        ([version("v", 1, "u1 u2", gang=2)], False),
        ([version("v", 1, "u1"), version("w", 2, "u1")], False),
        ([version("v", 1, "u1 u2")], True),
        ([version("v", 1, "u1"), version("w", 2, "u2")], True),
        ([version("v", 1, "u1 u2"), version("w", 2, "u1 u2", gang=2)], True),
    ],
)
def test_jobs_are_bound_to_one_set_of_units_where_there_are_several(versions, has_choice):
    for binding in Binding:
        owner = model(replace(task("a", 10, *versions), binding=binding), units="u1 u2")
        [active] = expand(owner, owner.modes[0]).tasks
        assert lanes.is_bound(active) is (has_choice and binding is not Binding.JOB)


def test_a_gang_over_many_unlike_units_is_cut_and_says_so(monkeypatch):
    monkeypatch.setattr(lanes, "MAX_OPTIONS_PER_VERSION", 2)
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MAX_OPTIONS_PER_VERSION", 2)
    lone = [task(f"t{n}", 10, version("v", 1, f"u{n}")) for n in (1, 2, 3)]
    system = model(task("a", 10, version("v", 1, "u1 u2 u3", gang=2)), *lone, units="u1 u2 u3")
    assert len(options_of(build(system))) == 2
    found = schedule_model(system, SearchOptions(), lambda *_: True).diagnostics
    assert [d.code for d in found] == [codes.OPTIONS_CUT.id]
    assert 'task "a"' in found[0].path
    assert "only 2 of" in found[0].message


def test_a_resource_has_the_common_denominator_of_its_bounds():
    system = model(
        task("a", 10, version("v", 4, "u1", access("r", 0, 1, "1/3"), access("r", 1, 2, "3/4"), access("s", 0, 1, 1))),
        resources="r s t",
    )
    arrays = build(system).arrays
    assert arrays.lane_capacity.tolist() == [1, 12, 1, 1]
    assert arrays.lane_weight.tolist() == [12, *(lanes.RESOURCE_WEIGHT * weight for weight in (1, 12, 12))]
    assert column(build(system), "rect") == [(0, 0, 4, 1), (1, 0, 1, 4), (1, 1, 1, 9), (2, 0, 1, 1)]


def test_without_resources_a_tick_of_overlap_costs_one():
    assert build(model(task("a", 10, version()))).arrays.lane_weight.tolist() == [1]


def test_bounds_beyond_the_grid_are_rounded_up():
    system = model(task("a", 10, version("v", 1, "u1", access("r", 0, 1, "1/3000017"))), resources="r")
    built = build(system)
    assert built.arrays.lane_capacity.tolist()[1] == lanes.MAX_QUANTA
    assert column(built, "rect")[1] == (1, 0, 1, 1)


def test_phases_that_overlap_in_a_job_are_summed():
    system = model(
        task("a", 10, version("v", 6, "u1", access("r", 0, 4, "1/2"), access("r", 2, 6, "1/4"))), resources="r"
    )
    assert column(build(system, tick=1), "rect") == [(0, 0, 6, 1), (1, 0, 2, 2), (1, 2, 2, 3), (1, 4, 2, 1)]


def test_phases_made_to_overlap_by_a_coarse_tick_count_once():
    """They follow each other within a tick, so at no instant of it do both hold."""
    system = model(
        task("a", 10, version("v", "3ms", "u1", access("r", 0, "1.5ms", "2/3"), access("r", "1.5ms", 3, "1/2"))),
        resources="r",
    )
    assert column(build(system, tick=1), "rect")[1:] == [(1, 0, 1, 4), (1, 1, 1, 4), (1, 2, 1, 3)]


# ------------------------------------------------------------------------------------------------ time


def test_the_tick_divides_all_durations():
    system = model(
        task("a", 10, version("v", "1.5ms", "u1", access("r", 0, "0.75ms"), after("b", 0, "2.5ms")), offset="4ms"),
        task("b", 20, version("v", 2)),
        resources="r",
    )
    built = build(system)
    assert natural_tick(built.expansion) == built.tick == ms("250us")
    assert built.arrays.hyperperiod == 80
    assert built.arrays.entry_offset.tolist() == [16, NO_TICK]


def test_a_coarse_tick_rounds_outward_and_inward():
    """WCETs and phases grow, windows shrink; the end of a predecessor that grew is really up to a tick earlier."""
    system = model(
        task("a", 10, version("v", "1.5ms", "u1", access("r", "0.4ms", "0.6ms"), access("r", "1.1ms", "1.2ms"))),
        task("b", 10, version("v", 2, "u1", after("a", "1.5ms", "4.5ms"), after("a", "1.5ms", "4.5ms", "end"))),
        task("c", 10, version("v", 2, "u1", after("b", "1.5ms", "4.5ms", "end"))),
        resources="r",
    )
    built = build(system, tick=1)
    assert built.arrays.option_wcet.tolist() == [2, 2, 2]
    assert column(built, "rect") == [(0, 0, 2, 1), (1, 0, 1, 1), (1, 1, 1, 1)]
    assert column(built, "row", 1) == [(0, 2, 2, 0, 0, 0, 0), (0, 2, 1, 1, 0, 0, 0)]
    assert column(built, "row", 2) == [(1, 2, 2, 1, 0, 0, 0)]


@pytest.mark.parametrize(
    ("slack", "deadline", "late"),
    [
        (0, None, 0),
        ("1/2", None, 5),
        ("1/4", None, 2),  # 2.5 ms, in whole ticks
        (1, None, 8),  # the deadline, by default the period, leaves as much
        ("1/2", 6, 4),
        ("1/2", 2, 0),
        (1, 20, 9),  # never a whole period
    ],
)
def test_the_delay_of_a_job_is_limited_by_slack_and_deadline(slack, deadline, late):
    system = model(task("a", 10, version("v", 2), slack=slack, deadline=deadline), task("b", 20, version("v", 1)))
    assert build(system).arrays.option_late[0] == late


@pytest.mark.parametrize(
    ("distance", "deadline", "late"), [(13, 30, 3), (25, 30, 9), (13, None, 1), (17, 16, 4), (25, 18, 6)]
)
def test_a_poll_is_late_by_what_keeps_arrivals_apart_and_its_deadline(distance, deadline, late):
    """Of 10 ms of slack and 2 ms of work, with the job before it at its release."""
    polls = replace(task("a", 10, version("v", 2), slack=1, deadline=deadline), distance=ms(distance))
    assert build(model(polls, task("b", 20, version("v", 1)))).arrays.option_late[0] == late


def test_a_job_on_demand_is_never_late():
    system = model(task("h", None, version("v", 1)), task("a", 10, version("v", 1, "u1", after("h", 0, 5))))
    assert build(system).arrays.option_late.tolist() == [0, 0]


@pytest.mark.parametrize(("let", "late"), [(5, 3), (6, 4), (7, 4)])
def test_a_job_ends_within_its_logical_execution_time_and_its_deadline(let, late):
    computes = replace(task("a", 10, version("v", 2), offset=0, slack=1, deadline=6), let=ms(let))
    assert build(model(computes, task("b", 20, version("v", 1)))).arrays.option_late[0] == late


def test_an_offset_beyond_the_period_is_taken_modulo():
    system = model(task("a", 10, version(), offset=23), task("b", 10, version(), offset=0), task("c", 10, version()))
    assert build(system).arrays.entry_offset.tolist() == [3, 0, NO_TICK]


def test_a_window_as_wide_as_the_hyperperiod_is_met_anywhere():
    system = model(task("a", 10, version()), task("b", 10, version("v", 1, "u1", after("a", 3, 70))))
    assert column(build(system), "row", 1) == [(0, 3, 9, 0, 0, 0, 0)]


# ------------------------------------------------------------------------------------------------ options


def test_versions_that_cannot_be_met_are_dropped():
    system = model(
        task("a", 10, version("long", 8), version("short", 2), version("needs", 1, "u1", after("b", 0, 5)), deadline=4),
        task("b", None, version()),
    )
    assert options_of(build(system)) == [("short", ((0, 1),)), ("needs", ((0, 1),))]
    narrow = model(
        task("a", 10, version("v", 1)),
        task("b", 10, version("never", 1, "u1", after("a", "1.2ms", "1.8ms")), version("w", 1)),
    )
    assert options_of(build(narrow, tick=1), 1) == [("w", ((0, 1),))]


def test_a_job_on_demand_may_be_absent_only_if_its_demand_may_be():
    always = version("x", 1, "u1", after("h", 0, 5))
    system = model(task("a", 10, always, version("y", 2, "u1", after("h", 0, 9))), task("h", None, version()))
    assert options_of(build(system), 1) == [("v", ((0, 1),))]
    system = model(
        task("a", 10, always, version("z")),
        task("h", None, version("v", 1, "u1", after("g", 0, 5))),
        task("g", None, version()),
    )
    assert [name for name, _ in options_of(build(system), 1)] == ["v", None]
    assert [name for name, _ in options_of(build(system), 2)] == ["v", None]
    assert build(system).arrays.demand_job.tolist() == [-1, 0, 1]


def test_chains_count_where_they_have_a_limit_and_all_tasks():
    system = model(
        task("a", 10, version()),
        task("b", 10, version()),
        chains=[
            chain("free", "a b"),
            chain("zero", "a", reaction=0),
            chain("both", "a b", 5, 7),
            chain("gone", "a x", 5),
        ],
    )
    built = build(system)
    assert built.arrays.chain_limit.flat.tolist() == [0, NO_TICK, 5, 7]
    assert built.arrays.chain_task.tolist() == [0, 0, 1]


# ------------------------------------------------------------------------------------------------ refusals


def test_a_tick_must_divide_periods_and_offsets():
    system = model(task("a", 9, version()), task("b", 10, version(), offset=3), task("c", 10, version("v", "0.3ms")))
    with pytest.raises(HalpipeError) as caught:
        schedule_model(system, SearchOptions(tick=milliseconds(2)), lambda *_: True)
    found = caught.value.diagnostics
    assert {d.code for d in found} == {codes.TICK_DOES_NOT_DIVIDE.id}
    assert [(d.path, d.message) for d in found] == [
        ('task "a"', "period 9ms is not a multiple of the tick 2ms"),
        ('task "b"', "offset 3ms is not a multiple of the tick 2ms"),
    ]


def test_a_task_without_any_option_is_named():
    system = model(task("a", 10, version("v", 8), version("w", 9), deadline=7), task("b", 10, version()))
    found = refusal(system)
    assert (found.code, found.path) == (codes.NO_OPTION.id, 'task "a"')
    assert 'mode "all"' in found.message
    assert found.help


@pytest.mark.parametrize(
    ("system", "tick"),
    [
        # the cost: overlaps of a thousand jobs, in ticks of a millionth of a nanosecond, do not add up in 64 bits
        (model(task("a", "1s", version()), task("b", "1ms", version())), "1/1000000ns"),
        # the ticks of the hyperperiod, of a window, of a limit
        (model(task("a", "1s", version())), "1/10000000000000ns"),
        (
            model(
                task("a", 1, version()), task("b", 1, version("v", 1, "u1", after("a", "9000000000s", "9000000001s")))
            ),
            "1ns",
        ),
        (model(task("a", 1, version()), chains=[chain("c", "a", "9000000000s")]), "1ns"),
        (model(task("a", "10000000000s", version("v", "1ns"))), None),
    ],
)
def test_numbers_that_could_overflow_are_refused(system, tick):
    found = refusal(system, tick=ms(tick))
    assert (found.code, found.path) == (codes.TOO_LARGE.id, 'mode "all"')
    assert f"ticks of {ms(tick or '1ns')} and" in found.message
    assert "--tick" in found.help


def test_a_polling_task_may_run_for_longer_than_arrivals_are_apart():
    polled = replace(task("a", 4, version("v", 5, "u1 u2")), slack=Fraction(1), distance=ms(4), deadline=ms(12))
    other = task("b", 8, version("v", 1, "u1"))
    system = model(polled, other, units="u1 u2")
    assert options_of(build(system))
    assert schedule_model(system, SearchOptions(budget=100), lambda *_: True).is_complete
    assert not options_of(build(model(replace(polled, deadline=ms(8)), other, units="u1 u2")))


def test_phases_lie_in_the_first_period_of_tasks_with_several_jobs_that_a_cycle_names():
    cycle = replace(after("a", 0, 9), match=Match.CYCLE), replace(after("b", 0, 9), match=Match.CYCLE)
    system = model(
        task("a", 10, version()),
        task("b", 20, version()),
        task("c", 10, version("v", 1, "u1", *cycle)),
        task("d", 10, version("v", 1, "u1", after("a", 0, 9))),
    )
    assert build(system).arrays.task_first.tolist() == [1, 0, 1, 0]


def test_lanes_have_room_for_what_may_land_there_and_stretches_up_to_the_last_tick():
    """Of 65 ticks, with 13 jobs and 5: three breakpoints each, in stretches of 16 ticks; two phases of each of 13."""
    twice = version("v", 2, "u1", access("r", 0, 1, "1/2"), access("r", 1, 2))
    system = model(
        task("a", 5, twice, version("w", 1, "u1", access("r", 0, 1))), task("b", 13, version("v", 1)), resources="r"
    )
    arrays = build(system).arrays
    assert (arrays.hyperperiod, arrays.owner_first.tolist()) == (65, [0, 13 + 5, 18 + 2 * 13])
    assert arrays.lane_first.tolist() == [0, 3 * 18 + 4, 58 + 3 * 26 + 4]
    assert (arrays.guide_shift.tolist(), arrays.guide_first.tolist()) == ([4, 4], [0, 5, 10])
    other = build(model(task("a", 9, version()), task("b", 21, version()))).arrays
    assert (other.hyperperiod, other.guide_shift.tolist(), other.guide_first.tolist()) == (63, [4], [0, 4])
    few = build(model(task("a", 13, version()), task("b", 13, version()))).arrays
    assert (few.guide_shift.tolist(), few.guide_first.tolist()) == ([4], [0, 1])
    many = build(model(*(task(f"t{n}", 1, version("v", 1, "u1 u2")) for n in range(20)), units="u1 u2")).arrays
    assert (many.hyperperiod, many.guide_shift.tolist(), many.guide_first.tolist()) == (1, [0], [0, 1])


# ------------------------------------------------------------------------------------------------ windows


def windows_of(row, tick):
    """Return the one row of `b` as the kernel has it, after `a` of 1.5 ms or `c` of 2 ms."""
    system = model(
        task("a", 10, version("v", "1.5ms")),
        task("b", 20, version("v", 2, "u1", row)),
        task("c", 20, version("v", 2)),
    )
    return column(build(system, tick=tick), "row", 1)


@pytest.mark.parametrize(
    ("row", "coarse", "exact"),
    [
        (after("a", 2, 5), (0, 2, 3, START, 0, 0, 0), (0, 4, 6, START, 0, 0, 0)),
        (after("a", 2, 5, "end"), (0, 2, 2, END, 0, 0, 0), (0, 4, 6, END, 0, 0, 0)),
        (after("c", 2, 5, "end"), (2, 2, 3, END, 0, 0, 0), (2, 4, 6, END, 0, 0, 0)),
        (replace(after("c", 2, 5), to=Anchor.END), (2, 3, 2, START, 1, 0, 0), (2, 4, 6, START, 1, 0, 0)),
        (replace(after("a", 2, 5), anchor=Anchor.RELEASE), (0, 2, 3, RELEASE, 0, 0, 0), (0, 4, 6, RELEASE, 0, 0, 0)),
        (after_point("c", 2, 5, "1ms"), (2, 2, 3, POINT, 0, 0, 0), (2, 4, 6, POINT, 0, 0, 0)),
        (after_point("c", 2, 5, "0.5ms"), (2, 2, 2, POINT, 0, 0, 0), (2, 4, 6, POINT, 0, 0, 0)),
        (replace(after("a", 2, 70), match=Match.CYCLE), (0, 2, 68, START, 0, 1, 0), (0, 4, 136, START, 0, 1, 0)),
        (after("a", 2, 70), (0, 2, 19, START, 0, 0, 0), (0, 4, 39, START, 0, 0, 0)),
    ],
)
def test_windows_are_narrower_by_what_ends_and_points_lack_of_the_grid(row, coarse, exact):
    """Ends that are rounded come up to a tick earlier, and points between ticks do; what is exact is as stated."""
    assert windows_of(row, 1) == [coarse]
    assert windows_of(row, None) == [exact]


def test_windows_are_narrower_where_interrupts_last_no_whole_tick():
    """A job of 2 ms ends after 2.5 ms, on the grid after 3 ms; a point at 1 ms lies at 1.5 ms."""
    rows = after("a", 2, 5, "end"), after_point("a", 2, 5, "1ms"), after("a", 2, 5)
    system = model(task("a", 10, version("v", 2, "u1")), task("b", 10, version("v", 1, "u2", *rows)), units="u1 u2")
    served = interrupts(system, "u1", (10, "0.5ms"))
    assert [row[1:3] for row in column(build(served, tick=1), "row", 1)] == [(2, 2), (2, 2), (2, 3)]
    assert [row[1:3] for row in column(build(system, tick=1), "row", 1)] == [(2, 3)] * 3


def test_a_gang_takes_no_units_whose_interrupts_together_leave_no_time():
    system = model(task("a", 12, version("v", 2, "u1 u2 u3", gang=2)), units="u1 u2 u3")
    half = interrupts(interrupts(system, "u1", (4, 2)), "u2", (4, 2))
    assert len(options_of(build(system, grouped=False))) == 3
    assert options_of(build(half, grouped=False)) == [("v", ((0, 1), (2, 1))), ("v", ((1, 1), (2, 1)))]


def test_points_lie_where_each_option_of_their_task_has_them():
    """Interrupts of 1 ms each 2 ms make a point at 2 ms one at 4 ms; a task of two units has two options and room."""
    rows = after_point("a", 0, 9, "2ms"), after_point("a", 0, 9, "1ms"), after_point("c", 0, 9, "1ms")
    system = model(
        task("a", 10, version("v", 3, "u1 u2")),
        task("b", 20, version("v", 1, "u2", *rows)),
        task("c", 20, version("v", 2, "u2")),
        units="u1 u2",
    )
    built = build(interrupts(system, "u2", (2, 1)), tick=1)
    assert [row[-1] for row in column(built, "row", 2)] == [0, 3, 6]
    assert built.arrays.event_at.tolist() == [2, 4, 0, 1, 2, 0, 2, 0]


def test_places_to_aim_at_are_windows_seen_from_both_sides_and_steps_of_chains():
    """From their ends by what the job takes, from points by where they lie; what is closed has no width."""
    narrow = after("a", "1.2ms", "1.8ms")
    rows = after("a", 3, 7), after("a", 2, 2, "end"), after_point("a", 2, 5, "1ms")
    system = model(
        task("a", 64, version("v", 2)),
        task("b", 64, version("v", 2, "u1", *rows), version("w", 1, "u1", narrow)),
        task("c", 128, version("v", 4, "u1", replace(after("b", 5, 300), to=Anchor.END))),
        chains=[chain("x", "a c c", 500)],
    )
    built = build(system, tick=1)
    assert column(built, "partner", 0) == [
        (1, 3, 4, -1, 0),
        (1, 2, 0, -1, 1),
        (1, 3, 3, -1, 0),
        (1, 2, 0, -1, 0),
        (2, 0, 2, -1, 1),
    ]
    assert [(other, sign) for other, _, _, sign, _ in column(built, "partner", 1)] == [(0, 1)] * 4 + [(2, -1)]
    assert column(built, "partner", 2) == [(1, 1, 127, 1, 0), (0, 0, 2, 1, 1)]
    assert built.arrays.consumer.tolist() == [1, 2]


# ------------------------------------------------------------------------------------------------ the range of numbers


def ranged(period, wcet, low=1):
    """Two tasks on a unit and a resource, a window between them, and a chain with a limit."""
    row = after("a", low, low + 5)
    system = model(
        task("a", period, version("v", wcet, "u1", access("r", 0, 1, "1/2"))),
        task("b", period, version("v", wcet, "u1", row)),
        resources="r",
        chains=[chain("c", "a b", 50)],
    )
    return build(system, tick=1)


@pytest.mark.parametrize(
    ("built", "largest"),
    [
        # overlaps: rectangles of 4 at most, 3 for each of 2 jobs; misses: 24 a tick for 1 row, 1 limit, 1 more; 2 jobs
        (ranged(10**6, 1), 10**6 * 4 * 2 * 3 + 10**6 * 24 * 2 * (1 + 1 + 1)),
        (ranged(1000, 3), 512 * 10_000 * 3 * 24),  # what the temperature multiplies
        (ranged(1000, 1, low=10**12), 10**12),  # a window
    ],
)
def test_the_largest_number_of_a_mode_stays_below_the_limit(monkeypatch, built, largest):
    monkeypatch.setattr(limits, "LARGEST", largest + 1)
    limits.check_range(built)
    monkeypatch.setattr(limits, "LARGEST", largest)
    with pytest.raises(HalpipeError) as caught:
        limits.check_range(built)
    assert [found.code for found in caught.value.diagnostics] == [codes.TOO_LARGE.id]
