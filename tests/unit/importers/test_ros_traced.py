"""A trace as a source of a model, alone and beside the architecture file that it confirms or contradicts."""

import pytest
from ros_case import Overlay, found, periods, predecessors, rows

from ctf_writer import MS, ROS, Trace, ros_trace
from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.options import RosImportOptions
from halpipe.importers.ros.traced import callbacks_of
from halpipe.importers.traces.codes import RESTARTED, UNDESCRIBED

GRAPH = """\
named_paths:
- path_name: through
  node_chain:
  - {node_name: /source, publish_topic_name: /a, subscribe_topic_name: UNDEFINED}
  - {node_name: /sink, publish_topic_name: /b, subscribe_topic_name: /a}
executors: []
nodes:
- node_name: /source
  callbacks:
  - {callback_name: /source/tick, callback_type: timer_callback, period_ns: 10000100, symbol: A}
  publishes:
  - {topic_name: /a, callback_names: [/source/tick]}
- node_name: /sink
  callbacks:
  - {callback_name: /sink/keep, callback_type: subscription_callback, topic_name: /a, symbol: B}
  - {callback_name: /sink/send, callback_type: timer_callback, period_ns: 20000000, symbol: C}
  publishes:
  - {topic_name: /b, callback_names: [UNDEFINED]}
"""


def read(*paths, calibrate=(), **options):
    return FORMAT.read([str(path) for path in paths], RosImportOptions(calibrate=tuple(map(str, calibrate)), **options))


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    return ros_trace(switches=True).write(tmp_path_factory.mktemp("trace") / "session")


@pytest.fixture
def graph(tmp_path):
    def write(text=GRAPH):
        (tmp_path / "a.yaml").write_text(text)
        return tmp_path / "a.yaml"

    return write


def wcets(imported):
    return {task.name: str(task.versions[0].wcet) for task in imported.model.tasks}


@pytest.mark.parametrize(("rounds", "sends", "is_one_shot"), [(20, 1, True), (20, 2, False), (5, 1, False)])
def test_a_timer_that_ran_once_is_no_periodic_task(tmp_path, rounds, sends, is_one_shot):
    """With five rounds, the trace ends before the timer of 20 ms could have run twice more."""
    imported = read(ros_trace(rounds, sends=sends).write(tmp_path / "session"))
    assert bool(found(imported.diagnostics, codes.ONE_SHOT)) == is_one_shot
    assert ("/sink/callback_0" in periods(imported)) != is_one_shot


def timers(folder, runs, *, thread=None, node="beat"):
    """A node with a timer of 10 ms in a process for each of `runs`: pid, milliseconds of its starts; jobs last 2 ms."""
    trace = Trace()
    for name, fields in ROS.items():
        trace.declare(name, **fields)
    for pid, starts in runs:
        t = starts[0] * MS - 1000
        trace.add("ros2:rcl_node_init", t, pid=pid, node_handle=1, rmw_handle=0, node_name=node, namespace="/")
        trace.add("ros2:rcl_timer_init", t + 1, pid=pid, timer_handle=11, period=10 * MS)
        trace.add("ros2:rclcpp_timer_callback_added", t + 2, pid=pid, timer_handle=11, callback=100)
        trace.add("ros2:rclcpp_timer_link_node", t + 3, pid=pid, timer_handle=11, node_handle=1)
        trace.add("ros2_caret:construct_executor", t + 4, pid=pid, executor_addr=50, executor_type_name="single")
        group = {"executor_addr": 50, "callback_group_addr": 60, "group_type_name": "mutually_exclusive"}
        trace.add("ros2_caret:add_callback_group", t + 5, pid=pid, **group)
        trace.add("ros2_caret:callback_group_add_timer", t + 6, pid=pid, callback_group_addr=60, timer_handle=11)
        for start in starts:
            at = start * MS
            if thread is not None:
                trace.add("sched_switch", at - 1, tid=0, prev_tid=0, next_tid=thread)
                trace.add("sched_switch", at + MS, tid=thread, prev_tid=thread, next_tid=0)
                trace.add("sched_switch", at + 2 * MS - 500, tid=0, prev_tid=0, next_tid=thread)
            trace.add("ros2:callback_start", at, pid=pid, callback=100, is_intra_process=0)
            trace.add("ros2:callback_end", at + 2 * MS, pid=pid, callback=100)
    return trace.write(folder / "session")


EVERY = tuple(range(10, 210, 10))


def test_a_node_that_started_again_is_one_node(tmp_path):
    imported = read(timers(tmp_path, [(7, EVERY), (9, [1000 + start for start in EVERY])]))
    assert wcets(imported) == {"/beat": "2ms"}
    assert [d.message for d in found(imported.diagnostics, RESTARTED)] == ["1 node ended and started again: /beat"]
    assert not found(imported.diagnostics, codes.MISSED_PERIODS)
    assert "of 40 samples" in found(imported.diagnostics, codes.CALIBRATED)[0].message


def test_nodes_of_one_name_that_run_at_once_are_two(tmp_path):
    imported = read(timers(tmp_path, [(7, EVERY), (9, [5 + start for start in EVERY])]))
    assert set(wcets(imported)) == {"/beat/callback_0", "/beat/callback_1"}
    assert not found(imported.diagnostics, RESTARTED)


@pytest.mark.parametrize(("thread", "gross", "wcet"), [(8, False, "1.0005ms"), (4711, True, "2ms")])
def test_threads_that_no_switch_names_have_gross_durations(tmp_path, thread, gross, wcet):
    """Containers number their threads anew: the 8 of the callbacks is the 4711 of the kernel."""
    imported = read(timers(tmp_path, [(7, EVERY)], thread=thread))
    assert wcets(imported) == {"/beat": wcet}
    notes = found(imported.diagnostics, codes.WALL_TIME)
    assert bool(notes) == gross
    assert all("20 jobs" in note.message for note in notes)


LATE = (10, 20, 36, 40, 50, 66, 70, 80)
"""Some starts are late by more than half a period, but none is missing."""


@pytest.mark.parametrize(
    ("starts", "missed"), [(EVERY, 0), (LATE, 0), (EVERY[::2], 9), ((10, 20, 40, 50), 1), ((10, 20, 30, 46, 60), 1)]
)
def test_periods_without_a_job_are_counted(tmp_path, starts, missed):
    messages = [d.message for d in found(read(timers(tmp_path, [(7, starts)])).diagnostics, codes.MISSED_PERIODS)]
    lack = "1 period" if missed == 1 else f"{missed} periods"
    assert messages == ([f"its timer of 10ms fired {len(starts)} times and missed {lack}"] if missed else [])


@pytest.mark.parametrize(("sends", "stopped"), [(5, True), (6, True), (7, False), (10, False)])
def test_a_timer_that_stops_before_its_node_is_reported(tmp_path, sends, stopped):
    """The timer of 20 ms stops, and the subscription of its node runs on, for four periods or less."""
    imported = read(ros_trace(sends=sends).write(tmp_path / "session"))
    messages = [d.message for d in found(imported.diagnostics, codes.MISSED_PERIODS)]
    assert [("lives on" in message) for message in messages] == ([True] if stopped else [])


def test_a_trace_alone_is_a_model_with_wcets(trace):
    imported = read(trace)
    assert imported.model.name == "session"
    assert periods(imported) == {"/source": "10ms", "/sink/callback_0": "20ms", "/sink/callback_1": "10ms"}
    assert wcets(imported) == {"/source": "1.019ms", "/sink/callback_0": "2ms", "/sink/callback_1": "700us"}
    assert predecessors(imported)["/sink/callback_1"] == ["/source"]
    assert [resource.name for resource in imported.model.resources] == ["/sink/callback_group_0"]
    assert not found(imported.diagnostics, codes.UNKNOWN_PUBLISHER)
    assert not found(imported.diagnostics, codes.WALL_TIME)
    assert rows(imported)["publisher"][0] == 2


def test_a_quantile_and_a_margin_of_the_trace(trace):
    from fractions import Fraction

    assert wcets(read(trace, quantile=Fraction(1, 2)))["/source"] == "1.009ms"
    assert wcets(read(trace, margin=Fraction(1, 2)))["/sink/callback_1"] == "1.05ms"


def test_without_switches_of_the_kernel_durations_are_wall_times(tmp_path):
    imported = read(ros_trace().write(tmp_path))
    assert wcets(imported)["/sink/callback_0"] == "3ms"
    assert len(found(imported.diagnostics, codes.WALL_TIME)) == 1


def test_a_trace_tells_an_architecture_who_publishes(trace, graph):
    imported = read(graph(), trace)
    assert not found(imported.diagnostics, codes.UNKNOWN_PUBLISHER)
    assert found(imported.diagnostics, codes.CONFIRMED)
    assert wcets(imported) == {"/source": "1.019ms", "/sink/send": "2ms", "/sink/keep": "700us"}
    (chain,) = imported.model.chains
    assert chain.tasks == ("/source", "/sink/keep", "/sink/send")


def test_what_a_trace_contradicts_is_told_and_what_was_seen_is_taken(trace, graph):
    wrong = graph(GRAPH.replace("callback_names: [UNDEFINED]", "callback_names: [/sink/keep]"))
    imported = read(wrong, trace)
    (warning,) = found(imported.diagnostics, codes.CONTRADICTED)
    assert '"/sink/send"' in warning.message
    assert imported.model.chains[0].tasks[-1] == "/sink/send"


def test_callbacks_that_only_one_of_them_has_are_told(trace, graph):
    other = graph(GRAPH.replace("topic_name: /a, symbol: B", "topic_name: /c, symbol: B"))
    said = [d.message for d in found(read(other, trace).diagnostics, codes.CONTRADICTED)]
    assert any("/sink/keep" in text for text in said)
    assert any("subscription of /a" in text for text in said)


def test_a_trace_of_another_system_is_refused(trace, graph):
    with pytest.raises(HalpipeError) as caught:
        read(graph(GRAPH.replace("/source", "/other").replace("/sink", "/nothing")), trace)
    assert [d.code for d in caught.value.diagnostics if d.is_error] == [codes.OTHER_GRAPH.id]


def test_a_trace_calibrates_a_graph(trace, graph):
    imported = read(graph(), calibrate=[trace])
    assert wcets(imported)["/sink/send"] == "2ms"
    assert found(imported.diagnostics, codes.CALIBRATED)


def test_the_rate_of_a_topic_from_outside_is_measured(tmp_path):
    trace = ros_trace()
    trace.add("ros2:rcl_subscription_init", 15, subscription_handle=40, node_handle=2, topic_name="/scan")
    trace.add("ros2:rclcpp_subscription_init", 16, subscription_handle=40, subscription=41)
    trace.add("ros2:rclcpp_subscription_callback_added", 17, subscription=41, callback=400)
    for k in range(9):
        trace.add("ros2:callback_start", (1000 + 25 * k) * 1_000_000 + 17 * k, callback=400, is_intra_process=0)
        trace.add("ros2:callback_end", (1001 + 25 * k) * 1_000_000 + 17 * k, callback=400)
    assert periods(read(trace.write(tmp_path)))["/sink/callback_2"] == "25ms"


def test_two_traces_are_one_too_many(trace, tmp_path):
    with pytest.raises(HalpipeError) as caught:
        read(trace, ros_trace(2).write(tmp_path / "two"))
    assert {d.code for d in caught.value.diagnostics} == {codes.TWO_GRAPHS.id}


def test_a_trace_beside_an_architecture_has_the_longest_job_of_each_callback(trace, graph):
    """The timer of the sink has the processor for 2 of its 3 ms."""
    longest = {name: bound.longest for name, bound in callbacks_of([str(graph()), str(trace)]).items()}
    assert longest == {"/source": 1_019_000, "/sink/keep": 700_000, "/sink/send": 2_000_000}
    assert not any(bound.longest for bound in callbacks_of([str(graph())]).values())


def test_an_overlay_may_drop_callbacks_of_a_trace(trace):
    imported = FORMAT.read([str(trace)], RosImportOptions(overlay=Overlay(drop=["/sink/callback_1"])))
    assert {task.name for task in imported.model.tasks} == {"/source", "/sink/callback_0"}


@pytest.mark.parametrize("lost", ["ros2:rclcpp_subscription_init", "ros2:rclcpp_timer_link_node", ""])
def test_jobs_of_callbacks_that_no_event_describes_are_reported(tmp_path, monkeypatch, lost):
    """Tracing began after a node had created them, or the events of the creation were lost."""
    plain = Trace.add
    monkeypatch.setattr(Trace, "add", lambda self, name, *a, **k: None if name == lost else plain(self, name, *a, **k))
    path = str(ros_trace(20).write(tmp_path / "session"))
    try:
        diagnostics = FORMAT.read([path], RosImportOptions()).diagnostics
    except HalpipeError as failure:
        diagnostics = failure.diagnostics
    jobs = {"ros2:rclcpp_subscription_init": "20 jobs of 1 callback,", "ros2:rclcpp_timer_link_node": "30 jobs of 2"}
    reported = [d.message for d in found(diagnostics, UNDESCRIBED)]
    assert [message.startswith(f"left out: {jobs.get(lost)}") for message in reported] == ([True] if lost else [])
