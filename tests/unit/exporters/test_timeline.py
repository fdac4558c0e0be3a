from dataclasses import replace
from itertools import pairwise

import pytest
from exporter_samples import roboracer, thirds, two_modes
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import ZERO
from halpipe.exporters.common.timeline import (
    Window,
    cycles_after,
    delays_of,
    links,
    releases_of,
    resource_steps,
    shows_context,
    unroll,
    unroll_switch,
)
from halpipe.models import Part, Status, TransitionTable
from support import access, after, job, model, ms, schedule, task, version


def test_a_wrapping_job_occurs_again_from_before_zero():
    _, planned = roboracer()
    found = [(p.job.task, str(p.start), str(p.end), p.cycle) for p in unroll(planned.modes[0])]
    assert found == [
        ("path_planner", "-13ms", "11ms", -1),
        ("opponent_detection", "-1ms", "12ms", -1),
        ("particle_filter", "0ms", "24ms", 0),
        ("pure_pursuit", "11ms", "13ms", 0),
        ("path_planner", "12ms", "36ms", 0),
        ("opponent_detection", "24ms", "37ms", 0),
    ]


def test_a_job_that_ends_with_the_cycle_does_not_wrap():
    system = model(task("a", 10, version("v", "4ms")))
    planned = schedule(system, 10, job(system, "a", 0, 6, "u1"))
    assert [str(p.start) for p in unroll(planned.modes[0], 2)] == ["6ms", "16ms"]


def test_the_steps_sum_bounds_exactly_and_wrap():
    system = model(
        task("a", 10, version("v", "4ms", "u1", access("r", 0, 4, "1/3"))),
        task("b", 10, version("v", "4ms", "u2", access("r", 0, 4, "2/3"))),
        units="u1 u2",
        resources="r",
    )
    planned = schedule(system, 10, job(system, "a", 0, 8, "u1"), job(system, "b", 0, 0, "u2"))
    steps = resource_steps(system, unroll(planned.modes[0]), Window(ZERO, ms(10)))
    assert [(str(at), str(total)) for at, total in steps["r"]] == [
        ("0ms", "1"),
        ("2ms", "2/3"),
        ("4ms", "0"),
        ("8ms", "1/3"),
    ]


def test_links_name_the_newest_predecessor_and_how_far_back_it_is():
    system = model(
        task("a", 5, version("v", "1ms", "u1")),
        task("b", 10, version("v", "1ms", "u1", after("a", 3, 9))),
    )
    planned = schedule(
        system,
        10,
        job(system, "a", 0, 1, "u1"),
        job(system, "a", 1, 6, "u1"),
        job(system, "b", 0, 3, "u1"),
    )
    (link,) = links(system, planned.modes[0])
    # a#0 started 2 ms before, too late to count; a#1 of the cycle before started 7 ms before.
    assert (link.predecessor.index, link.cycles, str(link.distance)) == (1, 1, "7ms")


def test_a_constraint_that_is_broken_has_no_link():
    system = model(task("a", 10, version()), task("b", 10, version("v", "1ms", "u1", after("a", 0, 2))))
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"))
    assert links(system, planned.modes[0]) == []


@given(
    st.lists(st.integers(0, 19), min_size=1, max_size=5, unique=True),
    st.integers(0, 19),
    st.integers(0, 50),
    st.integers(0, 30),
    st.sampled_from(["start", "end"]),
)
def test_links_are_those_of_the_rule(starts, start, low, width, anchor):
    system = model(
        task("a", 20, version("v", "3ms")),
        task("b", 20, version("v", "1ms", "u1", after("a", low, low + width, anchor))),
    )
    jobs = [job(system, "a", i, s, "u1") for i, s in enumerate(starts)]
    planned = schedule(system, 20, *jobs, job(system, "b", 0, start, "u1"))
    # The rule of the model, word for word: some job k, some m >= 0.
    anchors = [s + (3 if anchor == "end" else 0) for s in starts]
    inside = [start + 20 * m - x for x in anchors for m in range(10) if low <= start + 20 * m - x <= low + width]
    found = links(system, planned.modes[0])
    assert [link.distance for link in found] == ([ms(min(inside))] if inside else [])
    for link in found:
        begin = link.predecessor.start if anchor == "start" else link.predecessor.end
        assert link.job.start + ms(20) * link.cycles - begin == link.distance


def test_a_switch_is_drawn_within_the_modes_around_it():
    _, planned = two_modes()
    table = planned.transitions[0]
    window, found = unroll_switch(table, planned.mode("race"), planned.mode("safe-stop"), context=True)
    assert (window.start, window.end) == (ms(25) * -1, ms(25))
    runs_over = [p.job.task for p in found if p.start < ZERO < p.end]
    assert runs_over == ["path_planner", "opponent_detection"]
    assert [p.part for p in found if p.start >= ZERO] == ["safe-stop"] * 3


def test_without_context_only_what_touches_the_table_is_left():
    _, planned = two_modes()
    table = planned.transitions[1]
    window, found = unroll_switch(table, planned.mode("safe-stop"), planned.mode("race"), context=False)
    assert (window.start, window.end) == (ZERO, ms(37))
    assert {p.part for p in found} == {""}
    longer = replace(planned.transitions[0], length=ms(20))
    window, found = unroll_switch(longer, planned.mode("race"), planned.mode("safe-stop"), context=False)
    assert (window.start, window.end) == (ZERO, ms(20))
    assert [(p.job.task, str(p.end)) for p in found] == [("path_planner", "11ms"), ("opponent_detection", "12ms")]


def test_the_new_mode_begins_after_the_table():
    _, planned = two_modes()
    table = planned.transitions[1]
    window, found = unroll_switch(table, planned.mode("safe-stop"), planned.mode("race"), context=True)
    assert window.end == ms(50)
    starts = {p.job.task: str(p.start) for p in found if p.part == "race"}
    assert starts["particle_filter"] == "25ms"
    assert starts["opponent_detection"] == "49ms"


def test_context_is_dropped_when_it_would_be_large(monkeypatch):
    _, planned = two_modes()
    assert shows_context(planned)
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 13)
    assert not shows_context(planned)  # twice 4 + 3 jobs
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 14)
    assert shows_context(planned)


@pytest.mark.parametrize("sample", [roboracer, thirds])
def test_steps_start_with_the_window_and_never_repeat_a_value(sample):
    system, planned = sample()
    table = planned.modes[0]
    for steps in resource_steps(system, unroll(table), Window(ZERO, table.hyperperiod)).values():
        assert steps[0][0] == ZERO
        assert all(a[0] < b[0] and a[1] != b[1] for a, b in pairwise(steps))


@pytest.mark.parametrize(
    ("start", "length", "cycles", "starts"),
    [
        (6, 4, 1, [6]),
        (6, 5, 1, [-4, 6]),
        (6, 14, 1, [-4, 6]),
        (6, 15, 2, [-14, -4, 6, 16]),
        (0, 10, 2, [0, 10]),
        (0, 31, 1, [-30, -20, -10, 0]),
    ],
)
def test_a_job_occurs_in_every_cycle_into_which_it_lasts(start, length, cycles, starts):
    system = model(task("a", 10, version("v", length)))
    table = schedule(system, 10, job(system, "a", 0, start, "u1")).modes[0]
    found = unroll(table, cycles)
    assert [p.start for p in found] == [ms(at) if at >= 0 else ms(-at) * -1 for at in starts]
    assert [p.cycle for p in found] == list(range(cycles - len(starts), cycles))
    assert {(p.end - p.start, p.part) for p in found} == {(ms(length), "all")}


@pytest.mark.parametrize(
    ("start", "end", "meets"),
    [(0, 5, False), (0, 6, True), (5, 5, True), (4, 5, False), (9, 20, True), (10, 11, False), (9, 9, True)],
)
def test_a_window_is_half_open(start, end, meets):
    assert Window(ms(5), ms(10)).meets(ms(start), ms(end)) == meets
    assert Window(ms(5), ms(10)).length == ms(5)


def test_steps_of_a_part_of_the_line_are_what_is_in_force_there():
    system = model(
        task("a", 20, version("v", 9, "u1", access("r", 0, 4, "1/2"), access("r", 4, 9, "1/4"))), resources="r"
    )
    table = schedule(system, 20, job(system, "a", 0, 2, "u1")).modes[0]

    def steps(low, high):
        found = resource_steps(system, unroll(table), Window(ms(low), ms(high)))["r"]
        return [(str(at), str(total)) for at, total in found]

    assert steps(0, 20) == [("0ms", "0"), ("2ms", "1/2"), ("6ms", "1/4"), ("11ms", "0")]
    assert steps(3, 11) == [("3ms", "1/2"), ("6ms", "1/4")]
    assert steps(6, 12) == [("6ms", "1/4"), ("11ms", "0")]
    assert steps(11, 12) == [("11ms", "0")]


@pytest.mark.parametrize(("offset", "delays"), [(None, [0, 1, 2]), (2, [1, 2, 3]), (13, [0, 1, 2]), (0, [3, 4, 5])])
def test_delays_count_from_the_offset_or_the_phase_that_delays_least(offset, delays):
    owner = task("a", 10, version("v", 1), offset=offset, slack=1)
    system = model(owner)
    jobs = [job(system, "a", n, 10 * n + 3 + n, "u1") for n in range(3)]
    assert delays_of(owner, ms(10), jobs, ms(30)) == [ms(delay) for delay in delays]


@pytest.mark.parametrize(
    ("before", "inside", "length", "cycles"),
    [
        (10, 0, 0, 1),
        (20, 0, 0, 1),
        (21, 0, 0, 2),
        (21, 0, 1, 1),
        (30, 0, 0, 2),
        (31, 0, 0, 3),
        (10, 12, 2, 1),
        (10, 13, 2, 2),
    ],
)
def test_a_switch_is_drawn_until_the_jobs_with_gaps_are_over(before, inside, length, cycles):
    """Jobs of the mode before and of the table last until `before` and `inside`; a cycle of each mode is 10 ms."""
    system = model(task("a", 10, version("v", 1)))

    def gapped(end):
        parts = [Part(start=ms(at), end=ms(at), executed_from=ms(0), executed_to=ms(0)) for at in (0, end)]
        return replace(job(system, "a", 0, 0, "u1"), end=ms(end), parts=tuple(parts))

    source = schedule(system, 10, gapped(before)).modes[0]
    jobs = (gapped(inside),) if inside else ()
    table = TransitionTable(
        source="all", target="all", length=ms(length), worst_latency=ms(10), status=Status.VALID, jobs=jobs
    )
    assert cycles_after(table, source, source) == cycles


def test_releases_are_the_offset_or_the_phase_that_delays_least():
    tasks = {name: task(name, 10, version("v", 1), offset=offset, slack=1) for name, offset in (("a", 12), ("b", None))}
    system = model(*tasks.values(), task("c", 10, version("v", 1)))
    jobs = [job(system, name, n, 10 * n + at, "u1") for name, at in (("a", 3), ("b", 4), ("c", 6)) for n in (0, 1)]
    found = releases_of(schedule(system, 20, *jobs).modes[0], tasks)
    assert [(j.task, j.index, release) for j, release in found] == [
        ("a", 0, ms(2)), ("a", 1, ms(12)), ("b", 0, ms(4)), ("b", 1, ms(14))
    ]  # fmt: skip


@pytest.mark.parametrize(("start", "is_shown"), [(6, False), (7, True)])
def test_a_job_that_is_over_at_a_switch_does_not_touch_it(start, is_shown):
    system = model(task("a", 10, version("v", 4)))
    mode = schedule(system, 10, job(system, "a", 0, start, "u1")).modes[0]
    table = TransitionTable(
        source="all", target="all", length=ms(2), worst_latency=ms(12), status=Status.VALID, jobs=()
    )
    _, found = unroll_switch(table, mode, mode, context=False)
    assert [p.end for p in found] == [ms(start - 6)] * is_shown
