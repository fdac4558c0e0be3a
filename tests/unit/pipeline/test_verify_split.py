"""What verify says of split jobs, bound tasks, interrupts and polled arrivals (MODEL 8)."""

from dataclasses import replace
from pathlib import Path

import pytest
from split_helpers import interrupts, parted, points, split
from verify_helpers import codes_found, errors, messages, only, plan_of, table

from halpipe.core.durations import Duration
from halpipe.importers.native import read_model, read_schedule
from halpipe.models import Job, Split, UnitLoad
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.verify.ticks import Effort, Service
from support import access, job, mode, model, ms, schedule, task, version

FOLDER = Path(__file__).parents[2] / "fixtures" / "split"
MODEL, SCHEDULE = FOLDER / "model.xml", FOLDER / "schedule.xml"


# ------------------------------------------------------------------------------------------------ the example


def test_the_example_is_valid():
    [told] = verify(read_model(MODEL), read_schedule(SCHEDULE))
    assert (told.code, told.path, told.message) == (codes.PRIORITIES.id, 'unit "core2"', '"knock" above "logger"')


MUTANTS = {
    "part one tick longer": ("HAL0333", 'start="2.5ms" end="7ms"', 'start="2.5ms" end="7.000001ms"'),
    "one interrupt too short": (
        "HAL0333",
        '<part start="22.5ms" end="29.6ms"',
        '<part start="22.5ms" end="29.1ms"',
        'end="29.6ms" version',
        'end="29.1ms" version',
    ),
    "gap at a forbidden point": ("HAL0332", 'from="0ms" to="4ms"', 'from="0ms" to="5ms"'),
    "ends of job and parts differ": ("HAL0331", 'end="29.6ms" version', 'end="29.7ms" version'),
    "parts swapped": (
        "HAL0331",
        'from="0ms" to="7ms"',
        'from="5ms" to="12ms"',
        'from="7ms" to="12ms"',
        'from="0ms" to="5ms"',
    ),
    "no gap": ("HAL0331", 'start="9ms" end="14ms" from', 'start="8ms" end="13ms" from', 'end="14ms" v', 'end="13ms" v'),
    "an end one interrupt too short": ("HAL0313", 'start="0ms" end="2.5ms"', 'start="0ms" end="2ms"'),
    "nesting broken": ("HAL0334", 'start="8ms" end="9ms"', 'start="13ms" end="14ms"'),
    "arrivals 17 ms apart": ("HAL0336", 'start="8ms" end="9ms"', 'start="3ms" end="4ms"'),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_of_the_example_are_found(name, tmp_path):
    code, *changes = MUTANTS[name]
    text = SCHEDULE.read_text()
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / "s.xml").write_text(text)
    found = [d for d in verify(read_model(MODEL), read_schedule(tmp_path / "s.xml")) if d.is_error]
    assert code in {d.code for d in found}
    assert all(d.help and d.path and d.at.line for d in found)


# ------------------------------------------------------------------------------------------------ rule parts


def long_and_short(how):
    """A job of 6 ms with room for a job of 2 ms in the middle, on one unit; the hyperperiod is 20 ms."""
    long = task("long", 20, split(version("v", 6), how))
    return model(long, task("short", 20, version("v", 2)))


def cut(system, *parts):
    return schedule(system, 20, parted("long", 0, "u1", *parts), job(system, "short", 0, 3, "u1"))


def test_a_job_with_a_gap_at_a_split_point():
    system = long_and_short(points(3, 5))
    assert not errors(system, cut(system, (0, 3, 0, 3), (5, 8, 3, 6)))


@pytest.mark.parametrize("at", ["1.999999ms", "2.000001ms"])
def test_a_gap_beside_a_split_point(at):
    system = long_and_short(points(2, 5))
    left = ms(6) - ms(at)
    found = only(system, cut(system, (0, ms(at), 0, at), (6, ms(6) + left, at, 6)), codes.WRONG_GAP)
    assert f"after {ms(at)}, which is no split point" in found


def test_a_job_that_is_not_split_has_no_gaps():
    system = long_and_short(Split())
    assert 'has 1 gaps, but version "v" is not split' in only(
        system, cut(system, (0, 3, 0, 3), (5, 8, 3, 6)), codes.WRONG_GAP
    )


def test_too_many_gaps():
    system = long_and_short(points(1, 2, 3, max_gaps=2))
    fine = cut(system, (0, 1, 0, 1), (2, 3, 1, 2), (5, 9, 2, 6))
    assert not errors(system, fine)
    more = cut(system, (0, 1, 0, 1), ("1.5ms", "2.5ms", 1, 2), (5, 6, 2, 3), (7, 10, 3, 6))
    assert "has 3 gaps, at most 2" in only(system, more, codes.WRONG_GAP)


def test_the_least_part_may_be_nothing_and_no_less():
    for least, expected in ((Duration(0), 0), (Duration(-1), 1)):
        system = long_and_short(Split(anywhere=True, max_gaps=1, min_part=least))
        found = [d for d in errors(system, cut(system, (0, 3, 0, 3), (5, 8, 3, 6))) if "negative" in d]
        assert len(found) == expected


def anywhere(**more):
    phases = (access("r", 1, 2, "1/2"),)
    long = task("long", 20, split(version("v", 6, "u1", *phases), Split(anywhere=True, max_gaps=2, **more)))
    return model(long, task("short", 20, version("v", 2)), resources="r")


@pytest.mark.parametrize("at", [1, "1.5ms", 2])
def test_anywhere_is_not_inside_an_access_phase(at):
    system = anywhere()
    found = cut(system, (0, at, 0, at), (6, ms(12) - ms(at), at, 6))
    if at == "1.5ms":
        assert "in its access" in only(system, found, codes.WRONG_GAP)
    else:
        assert not errors(system, found)


def test_parts_that_are_too_short():
    system = anywhere(min_part=ms(1))
    assert not errors(system, cut(system, (2, 3, 0, 1), (6, 11, 1, 6)))
    short = cut(system, (1, 3, 0, 2), (6, "9.5ms", 2, "5.5ms"), (10, "10.5ms", "5.5ms", 6))
    assert "part of 500us, at least 1ms" in only(system, short, codes.WRONG_GAP)


def test_resuming_costs_time_after_every_gap():
    system = long_and_short(points(3, resume=ms("0.5ms")))
    assert not errors(system, cut(system, (0, 3, 0, 3), (5, "8.5ms", 3, 6)))
    found = only(system, cut(system, (0, 3, 0, 3), (5, 8, 3, 6)), codes.WRONG_LENGTH)
    assert "lasts 3ms in part 2, 3ms of execution + 500us to resume make 3.5ms" in found


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([(0, 3, 0, 3), (5, 7, 3, 5)], "executes 5ms in all, its WCET is 6ms"),
        ([(0, 3, 0, 3), (5, 6, 5, 6)], "executes 5ms to 6ms in part 2, after 3ms"),
        ([(0, 3, 0, 3), (3, 6, 3, 6)], "no gap between part 1"),
        ([(5, 8, 3, 6), (0, 3, 0, 3)], "in part 1, after"),
    ],
)
def test_parts_that_do_not_make_up_the_job(parts, words):
    system = long_and_short(points(3, 5))
    assert any(words in text for text in messages(system, cut(system, *parts), codes.PARTS_DIFFER))


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        (((0, 3, 0, 3), (5, 8, 3, 6), (8, 9, 6, 7)), "has no gap between part 2, until 8ms, and part 3, from 8ms"),
        (((0, 3, 0, 3), (5, 8, 3, 6)), "lasts from 1ms to 9ms, its parts from 0ms to 8ms"),
    ],
)
def test_messages_name_the_parts_that_differ(parts, text):
    system = long_and_short(points(3, 5))
    plan = cut(system, *parts)
    long, short = plan.modes[0].jobs
    if "lasts" in text:
        long = replace(long, start=ms(1), end=ms(9))
    found = messages(system, schedule(system, 20, long, short), codes.PARTS_DIFFER)
    assert f'mode "all" task "long" job 0: {text}' in found


def test_parts_of_a_version_with_a_wcet_below_zero_are_the_models_fault():
    system = long_and_short(points(3, 5))
    long, short = system.tasks
    system = replace(system, tasks=(replace(long, versions=(replace(long.versions[0], wcet=Duration(-1)),)), short))
    found = codes_found(system, cut(system, (0, 3, 0, 3), (5, 8, 3, 6)))
    assert codes.MODEL_FAULT.id in found
    assert codes.PARTS_DIFFER.id not in found


def test_one_part_alone_is_a_job_in_one_piece():
    system = long_and_short(Split())
    assert not errors(system, cut(system, (5, 11, 0, 6)))


# ------------------------------------------------------------------------------------------------ reserved lengths


@pytest.mark.parametrize(("work", "length"), [(8, 10), (10, 14), (16, 20), (17, 23)])
def test_the_reserved_length_counts_the_arrivals_before_its_end(work, length):
    """T = 10, c = 2: an arrival at the end of a part belongs to what comes next."""
    system = interrupts(model(task("a", 40, version("v", work))), "u1", (10, 2))
    whole = job(system, "a", 0, 0, "u1")
    assert not errors(system, schedule(system, 40, replace(whole, end=ms(length))))
    found = only(system, schedule(system, 40, replace(whole, end=ms(length - 2))), codes.WRONG_END)
    assert f"and the interrupts make {length}ms" in found
    assert "reserved length" in verify(system, schedule(system, 40, whole))[0].help


def test_a_gang_waits_for_the_interrupts_of_all_its_units():
    """T = 10, c = 2 and T = 20, c = 3 on two units: L(4) = 9, not the larger 7."""
    system = model(task("a", 40, version("v", 4, "u1 u2", gang=2)), units="u1 u2")
    system = interrupts(interrupts(system, "u1", (10, 2)), "u2", (20, 3))
    whole = job(system, "a", 0, 0, "u1 u2")
    assert not errors(system, schedule(system, 40, replace(whole, end=ms(9))))
    only(system, schedule(system, 40, replace(whole, end=ms(7))), codes.WRONG_END)


def test_no_length_is_enough_where_interrupts_fill_the_units():
    """Either unit has room for the job, both together have none."""
    system = model(task("a", 40, version("v", 4, "u1 u2", gang=2)), units="u1 u2")
    system = interrupts(interrupts(system, "u1", (10, 5)), "u2", (10, 5))
    found = only(system, schedule(system, 40, job(system, "a", 0, 0, "u1 u2")), codes.NO_LENGTH)
    assert '"u1", "u2", where interrupts take all of the time' in found


def test_where_no_length_is_enough_the_one_that_is_given_counts():
    """From 10 to 14: nothing is late, and nothing overlaps."""
    system = interrupts(model(task("a", 20, version("v", 4), slack=1)), "u1", (10, 10))
    only(system, schedule(system, 20, job(system, "a", 0, 10, "u1")), codes.NO_LENGTH)
    both = interrupts(model(*system.tasks, task("b", 20, version("v", 4), slack=1)), "u1", (10, 10))
    instant = replace(job(both, "b", 0, 12, "u1"), end=ms(12))
    found = codes_found(both, schedule(both, 20, job(both, "a", 0, 10, "u1"), instant))
    assert set(found) == {codes.NO_LENGTH.id}, "what has no length holds nothing"


SLIVER = [("1000000007ns", "500000002ns"), ("1000000009ns", "500000003ns")]


def test_interrupts_that_leave_a_sliver_are_given_up_soon():
    system = interrupts(model(task("a", 40, version("v", 4))), "u1", *SLIVER)
    assert codes.NO_LENGTH.id in codes_found(system, schedule(system, 40, job(system, "a", 0, 0, "u1")))


def test_no_file_keeps_the_check_busy_with_slivers():
    """Each of these takes more than 100 000 steps; when the effort is spent, they are given up much earlier."""
    effort = Effort()
    effort.left = 150_000
    for _ in range(3):
        near = ((1_000_000_007, 500_000_002), (1_000_000_009, 500_000_003))
        assert Service(near, effort).length(4_000_000) is None
    assert effort.left == 150_000 - 100_000 - 50_000 - 1_000
    assert Service(((1_000_000, 900_000), (2_000_000, 180_000)), effort).length(5) is not None


def test_no_work_and_less_takes_no_time():
    served = Service(((10, 2),))
    assert [served.length(work) for work in (-30, 0, 1)] == [-30, 0, 3]


def test_a_unit_is_busy_for_what_is_reserved():
    system = interrupts(model(task("a", 40, version("v", 8))), "u1", (10, 2))
    plan = schedule(system, 40, replace(job(system, "a", 0, 0, "u1"), end=ms(10)))
    reported = replace(plan.modes[0], unit_loads=(UnitLoad(unit="u1", busy=ms(10), share=ms(10) / ms(40)),))
    assert not errors(system, replace(plan, modes=(reported,)))
    wrong = replace(plan.modes[0], unit_loads=(UnitLoad(unit="u1", busy=ms(8), share=ms(8) / ms(40)),))
    only(system, replace(plan, modes=(wrong,)), codes.WRONG_FIGURE)


def test_deadlines_count_to_the_end_of_the_last_part():
    system = long_and_short(points(3))
    plan = cut(system, (0, 3, 0, 3), (17, 20, 3, 6))
    assert not errors(system, plan)
    tight = replace(system, tasks=(replace(system.tasks[0], deadline=ms(19)), system.tasks[1]))
    assert "1ms late" in only(tight, plan, codes.LATE)


# ------------------------------------------------------------------------------------------------ access


def sharing(start):
    """A phase [3, 5) of a job with a gap after 3 ms, and a phase of another unit's job at `start`."""
    long = task("long", 20, split(version("v", 6, "u1", access("r", 3, 5)), points(3, resume=ms(1))))
    system = model(long, task("other", 20, version("v", 1, "u2", access("r", 0, 1))), units="u1 u2", resources="r")
    system = interrupts(system, "u1", (10, 1))
    plan = schedule(
        system, 20, parted("long", 0, "u1", (0, 4, 0, 3), (6, 11, 3, 6)), job(system, "other", 0, start, "u2")
    )
    return system, plan


@pytest.mark.parametrize(("start", "meets"), [(6, False), (7, True), (9, True), (10, False)])
def test_a_phase_follows_its_part(start, meets):
    """In force from 6 + 1 to 6 + L(1 + 2) = 10: the resumption before it, the interrupt in it."""
    assert (codes.OVERLOAD.id in codes_found(*sharing(start))) == meets


# ------------------------------------------------------------------------------------------------ nested


def nesting(*jobs):
    """Tasks a and b, split wherever they like, and c in one piece, all on one unit."""
    how = Split(anywhere=True, max_gaps=3)
    tasks = [task(n, 30, split(version("v", 4), how), slack=1) for n in "ab"]
    system = model(*tasks, task("c", 30, version("v", 2), slack=1))
    return system, schedule(system, 30, *jobs)


C = Job(task="c", index=0, start=ms(20), end=ms(22), version="v", units=("u1",))


def at(index, start):
    return replace(C, index=index, start=ms(start), end=ms(start) + ms(2))


def test_a_job_fits_into_one_gap():
    inner = parted("b", 0, "u1", (2, 4, 0, 2), (5, 7, 2, 4))
    outer = parted("a", 0, "u1", (0, 2, 0, 2), (7, 9, 2, 4))
    assert not errors(*nesting(outer, inner, C))


def test_a_job_lies_across_a_part_of_another():
    inner = parted("b", 0, "u1", (2, 4, 0, 2), (10, 12, 2, 4))
    outer = parted("a", 0, "u1", (0, 2, 0, 2), (5, 7, 2, 4))
    found = only(*nesting(outer, inner, C), codes.NOT_NESTED)
    assert '"b" job 0 lasts from 2ms to 12ms and "a" job 0 from 0ms to 7ms; neither' in found


def test_nesting_holds_round_the_end():
    outer = parted("a", 0, "u1", (28, 30, 0, 2), (36, 38, 2, 4))
    assert not errors(*nesting(outer, parted("b", 0, "u1", (2, 4, 0, 2), (14, 16, 2, 4)), at(0, 0)))[1:]
    fits = parted("b", 0, "u1", (0, 2, 0, 2), (3, 5, 2, 4))
    assert not errors(*nesting(outer, fits, C))
    crosses = parted("b", 0, "u1", (0, 2, 0, 2), (9, 11, 2, 4))
    only(*nesting(outer, crosses, C), codes.NOT_NESTED)


def test_a_job_longer_than_the_hyperperiod_lies_across_itself():
    outer = parted("a", 0, "u1", (0, 2, 0, 2), (32, 34, 2, 4))
    (found,) = messages(*nesting(outer, parted("b", 0, "u1", (10, 14, 0, 4)), C), codes.NOT_NESTED)
    assert '"a" job 0 lasts 34ms, longer than the hyperperiod' in found


def test_jobs_of_one_task_do_not_interrupt_each_other():
    owner = task("a", 10, split(version("v", 4), Split(anywhere=True, max_gaps=3)), slack=1, deadline=20)
    system = model(owner)
    apart = [parted("a", k, "u1", (10 * k, 10 * k + 2, 0, 2), (10 * k + 7, 10 * k + 9, 2, 4)) for k in (0, 1)]
    assert not errors(system, schedule(system, 10, apart[0]))
    system = replace(
        system, tasks=(owner, task("b", 20, version("v", 1, "u2"))), units=model(owner, units="u1 u2").units
    )
    system = replace(system, modes=(mode("all", system.tasks),))
    other = job(system, "b", 0, 0, "u2")
    assert not errors(system, schedule(system, 20, *apart, other))
    within = [
        parted("a", 0, "u1", (0, 2, 0, 2), (18, 20, 2, 4)),
        parted("a", 1, "u1", (10, 12, 0, 2), (13, 15, 2, 4)),
    ]
    assert "jobs of one task" in only(system, schedule(system, 20, *within, other), codes.NOT_NESTED)


def test_of_jobs_of_one_task_that_end_together_the_first_is_named():
    first = parted("a", 0, "u1", (0, 2, 0, 2), (12, 14, 2, 4))
    second = parted("a", 1, "u1", (3, 5, 0, 2), (12, 14, 2, 4))
    third = parted("a", 2, "u1", (6, 10, 0, 4))
    told = messages(*nesting(first, second, third, C), codes.NOT_NESTED)
    assert [text.partition(": ")[2].partition(";")[0] for text in told] == [
        '"a" job 1 lasts from 3ms to 14ms and "a" job 0 from 0ms to 14ms',
        '"a" job 2 lasts from 6ms to 10ms and "a" job 0 from 0ms to 14ms',
    ]


def test_of_jobs_in_one_piece_that_end_together_the_first_is_named():
    whole = parted("a", 0, "u1", (0, 4, 0, 4)), replace(C, start=ms(2), end=ms(4))
    (found,) = messages(*nesting(*whole, parted("b", 0, "u1", (3, 5, 0, 2), (6, 8, 2, 4))), codes.NOT_NESTED)
    assert '"b" job 0 lasts from 3ms to 8ms and "a" job 0 from 0ms to 4ms' in found


# ------------------------------------------------------------------------------------------------ polling


def polled(period, distance, starts, deadline=None, slack=1):
    owner = replace(task("a", period, version("v", 1), slack=slack, deadline=deadline), distance=ms(distance))
    filler = task("b", len(starts) * period, version("v", 1, "u2"))
    system = model(owner, filler, units="u1 u2")
    jobs = [job(system, "a", k, start, "u1") for k, start in enumerate(starts)]
    return system, schedule(system, len(starts) * period, *jobs, job(system, "b", 0, 0, "u2"))


def test_the_worst_arrival_waits_for_the_longest_way_from_start_to_end():
    """Starts 0 and 60 of a 50 us poll: 60 + span, not 50 + span."""
    assert not errors(*polled(50, 61, [0, 60]))
    found = only(*polled(50, "60.999999ms", [0, 60]), codes.ARRIVAL_LATE)
    assert 'ends 61ms after the start of "a" job 0' in found


def test_every_phase_of_a_poll_is_as_good():
    assert not errors(*polled(50, 51, [0, 50]))
    assert not errors(*polled(50, 51, [30, 80]))


def test_the_poll_starts_before_a_second_arrival():
    found = only(*polled(50, 59, [0, 60], deadline=70), codes.ARRIVAL_LATE)
    assert "starts 60ms after the start" in found


def test_messages_count_from_the_start_of_the_job_before():
    found = messages(*polled(50, 59, [10, 70], deadline=60), codes.ARRIVAL_LATE)
    assert [text.partition(": ")[2] for text in found] == [
        'ends 61ms after the start of "a" job 0; an arrival just after that start allows 60ms: 1ms too late',
        'starts 60ms after the start of "a" job 0; an arrival just after that start allows 59ms: 1ms too late',
    ]


def test_a_poll_has_its_slack_but_no_deadline_from_its_release():
    assert not errors(*polled(50, 81, [0, 80], deadline=100))


# ------------------------------------------------------------------------------------------------ the model


@pytest.mark.parametrize(
    "how",
    [
        points(3, 2),
        points(3, 3),
        points(6),
        Split(points=(ms(0),)),
        Split(anywhere=True),
        points(3, resume=ms(0) - ms(1)),
        points(3, max_gaps=-1),
        points(3, min_part=ms(0) - ms(1)),
    ],
)
def test_splits_without_a_meaning(how):
    system = long_and_short(how)
    assert codes.MODEL_FAULT.id in codes_found(system, cut(system, (5, 11, 0, 6)))


def test_a_split_point_in_an_access_phase_is_the_models_fault():
    owner = task("a", 10, split(version("v", 4, "u1", access("r", 1, 3)), points(2)))
    system = model(owner, resources="r")
    assert codes.MODEL_FAULT.id in codes_found(system, schedule(system, 10, job(system, "a", 0, 0, "u1")))


@pytest.mark.parametrize("period", [None, 30])
def test_arrivals_are_polled_at_least_as_often_as_they_come(period):
    owner = replace(task("a", period, version("v", 1)), distance=ms(20))
    system = model(owner, task("b", 30, version("v", 1, "u2")), units="u1 u2")
    assert codes.MODEL_FAULT.id in codes_found(system, schedule(system, 30, job(system, "b", 0, 0, "u2")))


def test_interrupts_without_a_meaning():
    system = interrupts(model(task("a", 10, version("v", 1))), "u1", (0, 1))
    assert codes.MODEL_FAULT.id in codes_found(system, schedule(system, 10, job(system, "a", 0, 0, "u1")))


# ------------------------------------------------------------------------------------------------ run time


def freely(name, period, wcet):
    return task(name, period, split(version("v", wcet), Split(anywhere=True, max_gaps=4)), slack=1)


def priorities(system, plan):
    return [(d.code, d.message) for d in verify(system, plan) if d.code in ("HAL0338", "HAL0339")]


def test_tasks_that_start_in_gaps_are_told_with_those_they_stand_above():
    system = model(freely("slow", 20, 10), task("fast", 10, version("v", 2), slack=1))
    slow = parted("slow", 0, "u1", (2, 10, 0, 8), (12, 14, 8, 10))
    jobs = [job(system, "fast", 0, 0, "u1"), job(system, "fast", 1, 10, "u1"), slow]
    assert priorities(system, plan_of(system, table("all", 20, *jobs))) == [("HAL0338", '"fast" above "slow"')]


def test_a_task_that_starts_before_the_gap_is_not_told():
    tasks = [task(name, 20, version("v", 2), slack=1) for name in ("early", "fast")]
    system = model(freely("slow", 20, 6), *tasks)
    slow = parted("slow", 0, "u1", (10, 13, 0, 3), (15, 18, 3, 6))
    plan = schedule(system, 20, slow, job(system, "early", 0, 8, "u1"), job(system, "fast", 0, 13, "u1"))
    assert messages(system, plan, codes.PRIORITIES) == ['unit "u1": "fast" above "slow"']


def test_a_gap_round_the_end_of_the_hyperperiod_counts():
    system = model(freely("slow", 20, 10), task("fast", 20, version("v", 2), slack=1))
    slow = parted("slow", 0, "u1", (12, 20, 0, 8), (22, 24, 8, 10))
    jobs = [job(system, "fast", 0, 0, "u1"), slow]
    assert priorities(system, plan_of(system, table("all", 20, *jobs))) == [("HAL0338", '"fast" above "slow"')]


def test_split_points_need_no_priorities():
    listed = task("slow", 20, split(version("v", 10), points(8)), slack=1)
    system = model(listed, task("fast", 10, version("v", 2), slack=1))
    slow = parted("slow", 0, "u1", (2, 10, 0, 8), (12, 14, 8, 10))
    jobs = [job(system, "fast", 0, 0, "u1"), job(system, "fast", 1, 10, "u1"), slow]
    assert priorities(system, plan_of(system, table("all", 20, *jobs))) == []


def test_a_circle_of_priorities_is_a_warning_that_names_it():
    other = task("c", 40, version("v", 6), slack=1)
    system = model(freely("a", 20, 6), freely("b", 20, 4), other)
    jobs = [
        parted("a", 0, "u1", (0, 3, 0, 3), (7, 10, 3, 6)),
        job(system, "b", 0, 3, "u1"),
        parted("b", 1, "u1", (20, 22, 0, 2), (28, 30, 2, 4)),
        job(system, "a", 1, 22, "u1"),
        job(system, "c", 0, 30, "u1"),
    ]
    found = priorities(system, plan_of(system, table("all", 40, *jobs)))
    assert [code for code, _ in found] == ["HAL0338", "HAL0339"]
    assert '"a" above "b" above "a"' in found[1][1] or '"b" above "a" above "b"' in found[1][1]


def test_an_interrupt_may_take_no_time():
    system = interrupts(model(task("a", 10, version("v", 4))), "u1", (10, "0ms"))
    assert not errors(system, schedule(system, 10, job(system, "a", 0, 0, "u1")))
