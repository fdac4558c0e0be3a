from dataclasses import replace
from itertools import pairwise

import pytest
from exporter_samples import roboracer, thirds, two_modes
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import ZERO
from halpipe.exporters.common.timeline import Window, links, resource_steps, shows_context, unroll, unroll_switch
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
