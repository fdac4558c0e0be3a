import json
from collections import defaultdict
from fractions import Fraction
from itertools import pairwise

import pytest
from exporter_samples import hostile, many, roboracer, thirds, two_modes

from golden_file import assert_golden
from halpipe.exporters.common.base import TitledOptions
from halpipe.exporters.trace import FORMAT
from support import after, job, model, schedule, task, version

SAMPLES = [roboracer, two_modes, thirds, hostile]


def write(sample, **options):
    files = FORMAT.write(*sample(), TitledOptions(**options))
    assert list(files) == [""]
    return files[""].decode()


def load(sample, **options):
    """Read numbers as exact fractions, so that the comparisons below are."""
    return json.loads(write(sample, **options), parse_float=Fraction, parse_int=Fraction)


def of_phase(trace, *phases):
    return [event for event in trace["traceEvents"] if event["ph"] in phases]


def test_the_trace_of_the_paper_is_the_golden_one():
    assert_golden("roboracer.json", write(roboracer))


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_same_schedule_gives_the_same_bytes(sample):
    assert write(sample) == write(sample)


@pytest.mark.parametrize("sample", SAMPLES)
def test_every_event_has_what_the_format_demands(sample):
    needed = {"M": {"args"}, "X": {"dur", "ts"}, "s": {"id", "ts"}, "f": {"id", "ts", "bp"}, "C": {"ts"}, "i": {"ts"}}
    events = load(sample)["traceEvents"]
    for event in events:
        assert {"name", "pid"} | needed[event["ph"]] <= set(event)
        assert event.get("ts", 0) >= 0
        assert event.get("dur", 0) >= 0
    assert {event["ph"] for event in events} >= {"M", "X", "C", "i"}


@pytest.mark.parametrize("sample", [*SAMPLES, lambda: many(6, 12)])
def test_slices_of_a_unit_do_not_overlap_even_when_rounded(sample):
    lanes = defaultdict(list)
    for event in of_phase(load(sample), "X"):
        lanes[event["pid"], event["tid"]].append((event["ts"], event["ts"] + event["dur"]))
    for lane, slices in lanes.items():
        if sample is two_modes and lane[0] == 4:
            continue  # the attempt, which is not valid
        slices.sort()
        assert all(a[1] <= b[0] for a, b in pairwise(slices))


def test_every_precedence_edge_is_a_flow_from_slice_to_slice():
    trace = load(roboracer)
    starts = {(event["tid"], event["ts"]): event["name"] for event in of_phase(trace, "X")}
    ends = defaultdict(dict)
    for event in of_phase(trace, "s", "f"):
        ends[event["id"]][event["ph"]] = starts[event["tid"], event["ts"]]
    pairs = {(flow["s"], flow["f"]) for flow in ends.values()}
    assert pairs == {
        ("particle_filter", "opponent_detection"),
        ("opponent_detection", "path_planner"),
        ("path_planner", "pure_pursuit"),
    }


def test_as_many_cycles_are_shown_as_constraints_reach_back():
    trace = load(roboracer)
    assert [event["name"] for event in of_phase(trace, "i")] == ["cycle 0", "cycle 1"]


def test_flows_that_reach_back_too_far_are_counted_not_drawn():
    def far():
        system = model(
            task("a", 10, version("v", "1ms")), task("b", 10, version("v", "1ms", "u1", after("a", 500, 510)))
        )
        return system, schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 2, "u1"))

    trace = load(far)
    assert trace["otherData"]["flows-left-out"] == 1
    assert of_phase(trace, "s", "f") == []


def test_times_that_terminate_are_exact_and_others_are_rounded_and_counted():
    assert load(roboracer)["otherData"]["rounded-to-1ns"] == 0
    trace = load(thirds)
    assert trace["otherData"]["rounded-to-1ns"] > 0
    (stereo, twin) = [event for event in of_phase(trace, "X") if event["name"] == "stereo"]
    assert stereo["ts"] == 10_000
    assert stereo["dur"] == round(Fraction(100_000_000, 7)) / Fraction(1000)
    assert stereo["args"]["end"] == "170/7ms"
    assert stereo["tid"] != twin["tid"]


def test_counters_give_the_sum_of_bounds_and_end_at_zero():
    counters = [(e["ts"], e["args"]["sum of bounds"]) for e in of_phase(load(roboracer), "C")]
    assert counters[:3] == [(0, 1), (1000, Fraction(1, 2)), (1500, 0)]
    assert counters[-1] == (50_000, 0)


def test_no_number_is_printed_as_a_binary_float():
    assert "e-" not in write(thirds)
    longest = max(len(str(value)) for value in _numbers(json.loads(write(thirds), parse_float=str)))
    assert longest <= len("24285.714")


def _numbers(trace):
    return [event[key] for event in trace["traceEvents"] for key in ("ts", "dur") if key in event]


def test_each_mode_and_each_switch_is_a_process_and_each_unit_a_thread():
    trace = load(two_modes)
    names = [e["args"]["name"] for e in of_phase(trace, "M") if e["name"] == "process_name"]
    assert names == ["mode race", "mode safe-stop", "switch race to safe-stop", "switch safe-stop to race"]
    threads = [e["args"]["name"] for e in of_phase(trace, "M") if e["name"] == "thread_name" and e["pid"] == 1]
    assert threads == ["core1", "core2", "core3", "core4"]


def test_one_mode_can_be_chosen_and_the_title_set():
    trace = load(two_modes, mode="safe-stop", title="my title")
    assert {event["pid"] for event in trace["traceEvents"]} == {1}
    assert trace["otherData"]["title"] == "my title"


def test_hostile_names_come_through_unchanged():
    system, _ = hostile()
    assert {event["name"] for event in of_phase(load(hostile), "X")} == {task.name for task in system.tasks}
