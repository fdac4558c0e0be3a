"""CARET's architecture.yaml: tasks, periods, data flow, paths, and every way to get it wrong."""

import pytest
from ros_case import FIXTURES, found, periods, places, predecessors, read, reasons, refusal, rows, write

from halpipe.core.diagnostics import Severity
from halpipe.core.durations import Duration
from halpipe.importers.ros import codes
from halpipe.models import Anchor


@pytest.fixture(scope="module")
def stack():
    return read("stack.yaml")


def test_tasks_are_named_after_nodes_with_one_callback(stack):
    assert periods(stack) == {
        "/camera": "100/3ms",
        "/fusion/callback_0": "1s",
        "/fusion/callback_1": "100ms",
        "/fusion/callback_2": "100/3ms",
        "/fusion/callback_3": "100ms",
        "/planner": "100ms",
    }


def test_every_rounded_timer_is_reported(stack):
    assert places(stack.diagnostics, codes.SNAPPED) == [
        (33, 'callback "/camera/tick"'),
        (42, 'callback "/fusion/callback_0"'),
        (43, 'callback "/fusion/callback_1"'),
    ]


def test_publishers_precede_readers_within_the_longer_period(stack):
    assert predecessors(stack) == {
        "/camera": [],
        "/fusion/callback_0": [],
        "/fusion/callback_1": [],
        "/fusion/callback_2": ["/camera"],
        "/fusion/callback_3": ["/planner"],
        "/planner": ["/fusion/callback_1"],
    }
    (window,) = stack.model.task("/planner").versions[0].precedences
    assert (window.anchor, window.min, window.max) == (Anchor.END, Duration(0), Duration.parse("100ms"))
    assert window.origin.path == "/world"
    assert found(stack.diagnostics, codes.DEFAULT_WINDOW)


def test_an_unknown_publisher_is_the_fastest_timer_and_reported(stack):
    (warning,) = found(stack.diagnostics, codes.UNKNOWN_PUBLISHER)
    assert (warning.at.line, warning.path) == (51, 'node "/fusion"')
    assert '"/world"' in warning.message
    assert 'timer "/fusion/callback_1"' in warning.message


def test_a_loop_through_a_timer_costs_nothing(stack):
    (note,) = found(stack.diagnostics, codes.FEEDBACK)
    assert "/fusion -> /planner -> /fusion" in note.message
    assert "no precedence constraint is lost" in note.message


def test_a_loop_of_triggers_is_cut_and_the_loss_reported():
    imported = read("closed_loop.yaml", sources={"/command": "10ms"})
    assert predecessors(imported) == {"/estimator": [], "/controller": ["/estimator"]}
    (warning,) = found(imported.diagnostics, codes.FEEDBACK)
    assert warning.severity is Severity.WARNING
    assert 'where "/estimator" reads "/command" (/estimator -> /controller -> /estimator)' in warning.message
    assert reasons(imported, "publisher") == {"/controller /command": "cut, since data flows in a loop"}


def test_paths_become_chains_once(stack):
    (chain,) = stack.model.chains
    assert chain.name == "camera_to_brake"
    assert chain.tasks == ("/camera", "/fusion/callback_2", "/fusion/callback_1", "/planner")
    assert chain.origin.path == "camera to brake"
    assert set(reasons(stack, "path")) == {"same_again", "driver_only"}
    assert places(stack.diagnostics, codes.PATH_IGNORED) == [(19, 'path "driver_only"')]
    assert places(stack.diagnostics, codes.RENAMED) == [(3, 'path "camera to brake"')]


def test_every_element_is_accounted_for(stack):
    assert rows(stack) == {
        "callback_group": [2, 1, 1],
        "executor": [2, 0, 2],
        "file": [1, 1, 0],
        "message_context": [1, 0, 1],
        "node": [5, 3, 2],
        "path": [3, 1, 2],
        "publisher": [4, 3, 1],
        "service_callback": [1, 0, 1],
        "subscription": [5, 3, 2],
        "subscription_callback": [5, 3, 2],
        "timer_callback": [3, 3, 0],
        "variable_passing": [1, 0, 1],
    }
    assert reasons(stack, "node") == {
        "/gps_driver": "has no callback",
        "/rviz2": "is a tool, not part of the application",
    }


def test_what_has_no_period_is_named_with_the_topic_to_state(stack):
    (warning,) = found(stack.diagnostics, codes.NO_PERIOD)
    assert '"/fusion/callback_4"' in warning.message
    assert '"/gps"' in warning.help
    assert reasons(stack, "subscription_callback")["/fusion/callback_4"] == 'no publisher of topic "/gps" has a period'


def test_a_source_period_of_the_overlay_reaches_all_readers():
    imported = read("stack.yaml", sources={"/gps": "200ms"})
    assert periods(imported)["/fusion/callback_4"] == "200ms"
    assert "/gps_driver" not in reasons(imported, "node")
    (warning,) = found(imported.diagnostics, codes.NO_PERIOD)
    assert '1 without a period are not tasks: "/fusion/reset"' in warning.message


def test_a_source_period_of_the_overlay_beats_the_publisher():
    assert periods(read("stack.yaml", sources={"/world": "50ms"}))["/planner"] == "50ms"


def test_the_overlay_drops_nodes_callbacks_and_topics():
    imported = read("stack.yaml", drop={"/camera", "/fusion/callback_0", "/plan"})
    assert list(periods(imported)) == ["/fusion/callback_1", "/planner"]
    assert reasons(imported, "node")["/camera"] == "dropped by the overlay"
    assert reasons(imported, "timer_callback")["/fusion/callback_0"] == "dropped by the overlay"
    assert reasons(imported, "publisher")["/planner /plan"] == "dropped by the overlay"
    totals = {kind: counts[0] for kind, counts in rows(imported).items()}
    assert totals == {kind: counts[0] for kind, counts in rows(read("stack.yaml")).items()}


def test_what_a_dropped_topic_triggered_is_told_so():
    imported = read("autoware.yaml", sources={"/sensing/imu/imu_data": "10ms"}, drop={"/planning/trajectory"})
    (warning,) = found(imported.diagnostics, codes.NO_PERIOD)
    assert 'the topic that triggers it is left out, "/planning/trajectory"' in warning.message
    assert 'the period of "/planning/trajectory" under sources' in warning.help


def test_groups_hold_on_one_unit_and_executors_are_noted(stack):
    (note,) = found(stack.diagnostics, codes.EXCLUSION)
    assert note.severity is Severity.NOTE
    assert note.message.startswith("not represented: 1 single-threaded executor, whose")


def test_units_versions_and_mode_are_defaults(stack):
    assert [unit.name for unit in stack.model.units] == ["core0"]
    assert found(stack.diagnostics, codes.DEFAULT_UNIT)
    (mode,) = stack.model.modes
    assert [run.task for run in mode.runs] == [task.name for task in stack.model.tasks]
    assert {(v.name, v.wcet, v.units) for t in stack.model.tasks for v in t.versions} == {("default", None, ("core0",))}


def test_origin_points_to_the_callback(stack):
    origin = stack.model.task("/planner").origin
    assert origin.file.endswith("stack.yaml")
    assert (origin.line, origin.path) == (64, "/planner/plan")


def test_older_forms():
    imported = read("old_form.yaml")
    assert periods(imported) == {"/ping": "20ms", "/pong/sub_0": "20ms", "/pong/timer_0": "50ms"}
    assert predecessors(imported)["/pong/sub_0"] == ["/ping"]
    assert rows(imported)["variable_passing"] == [1, 1, 0]


def test_contexts_tell_the_publisher():
    imported = read("contexts.yaml")
    assert predecessors(imported)["/chained_reader"] == ["/mixer/slow"]
    assert predecessors(imported)["/latest_reader"] == ["/mixer/fast"]
    assert (periods(imported)["/chained_reader"], periods(imported)["/latest_reader"]) == ("40ms", "10ms")
    (warning,) = found(imported.diagnostics, codes.UNKNOWN_PUBLISHER)
    assert '"/latest"' in warning.message
    assert warning.message.endswith('assumed: subscription callback "/mixer/fast"')


@pytest.mark.parametrize(
    ("kind", "publisher"),
    [(kind, "slow") for kind in ("callback_chain", "inherit_unique_stamp", "tilde")] + [("use_latest_message", "fast")],
)
def test_a_context_that_carries_a_message_names_the_readers_of_its_topic(tmp_path, kind, publisher):
    text = (FIXTURES / "contexts.yaml").read_text()
    text = text.replace("use_latest_message, subscription_topic_name: /slow", f"{kind}, subscription_topic_name: /slow")
    service = "  - {callback_name: /mixer/help, callback_type: service_callback, service_name: /slow, symbol: g}\n"
    text = text.replace("  - {callback_name: /mixer/slow", service + "  - {callback_name: /mixer/slow")
    assert predecessors(read(write(tmp_path, text, "a.yaml")))["/latest_reader"] == [f"/mixer/{publisher}"]


LATEST = """
named_paths:
- path_name: through
  node_chain:
  - {node_name: /source, publish_topic_name: /slow, subscribe_topic_name: UNDEFINED}
  - {node_name: /mixer, publish_topic_name: /latest, subscribe_topic_name: /slow}
  - {node_name: /latest_reader, publish_topic_name: UNDEFINED, subscribe_topic_name: /latest}
"""


def test_a_path_goes_through_the_callback_that_precedence_takes_for_the_publisher(tmp_path):
    """The reader of the latest message keeps it; another callback of the node sends it on."""
    text = (FIXTURES / "contexts.yaml").read_text().replace("named_paths: []", LATEST.strip())
    imported = read(write(tmp_path, text, "a.yaml"))
    (chain,) = imported.model.chains
    assert chain.tasks == ("/source/slow", "/mixer/slow", "/mixer/fast", "/latest_reader")
    assert predecessors(imported)["/latest_reader"] == ["/mixer/fast"]


def test_two_callbacks_at_the_ends_of_context_chains_are_a_warning(tmp_path):
    text = (FIXTURES / "contexts.yaml").read_text()
    more = "- {context_type: callback_chain, subscription_topic_name: /slow, publisher_topic_name: /chained, "
    text = text.replace("  message_contexts:\n", f"  message_contexts:\n  {more}callbacks: [/mixer/fast]}}\n")
    imported = read(write(tmp_path, text, "a.yaml"))
    (warning,) = found(imported.diagnostics, codes.UNKNOWN_PUBLISHER)
    assert '"/chained"' in warning.message
    assert predecessors(imported)["/chained_reader"] == predecessors(imported)["/latest_reader"] == ["/mixer/fast"]


@pytest.mark.parametrize("kind", ["action_callback", "client_callback", "process"])
def test_a_callback_of_an_unknown_type_is_an_error_wherever_it_is_named(tmp_path, kind):
    text = (
        (FIXTURES / "contexts.yaml")
        .read_text()
        .replace("/mixer/slow, callback_type: subscription_callback", f"/mixer/slow, callback_type: {kind}")
    )
    text += "  subscribes:\n  - {topic_name: /latest, callback_name: /latest_reader/cb}\n"
    text = text.replace(
        "  publishes:\n  - {topic_name: /chained",
        "  subscribes:\n  - {topic_name: /slow, callback_name: /mixer/slow}\n  publishes:\n  - {topic_name: /chained",
    )
    failure = refusal(write(tmp_path, text, "a.yaml"))
    (error,) = found(failure.diagnostics, codes.BAD_CALLBACK_TYPE)
    assert kind in error.message


def test_several_publishers_give_the_shortest_period_and_one_predecessor(tmp_path):
    publisher = """
- node_name: /{0}
  callbacks:
  - {{callback_name: /{0}/t, callback_type: timer_callback, period_ns: {1}}}
  publishes:
  - {{topic_name: /x, callback_names: [/{0}/t]}}"""
    reader = """
- node_name: /r
  callbacks:
  - {callback_name: /r/s, callback_type: subscription_callback, topic_name: /x}
"""
    head = "named_paths: []\nexecutors: []\nnodes:"
    text = head + publisher.format("slow", 50_000_000) + publisher.format("fast", 20_000_000) + reader
    imported = read(write(tmp_path, text, "a.yaml"))
    assert (periods(imported)["/r"], predecessors(imported)["/r"]) == ("20ms", ["/fast"])
    (warning,) = found(imported.diagnostics, codes.SEVERAL_PERIODS)
    assert '"/fast" (20ms)' in warning.message
    assert '"/slow" (50ms)' in warning.message


def test_all_errors_of_a_file_are_collected():
    failure = refusal("bad_values.yaml")
    assert places(failure.diagnostics, codes.BAD_PERIOD) == [
        (14, 'callback "/a/zero"'),
        (15, 'callback "/a/minus"'),
        (16, 'callback "/a/word"'),
        (17, 'callback "/a/none"'),
    ]
    assert places(failure.diagnostics, codes.BAD_CALLBACK_TYPE) == [(18, 'callback "/a/kind"')]
    assert places(failure.diagnostics, codes.DUPLICATE) == [(20, 'callback "/a/sub"'), (28, 'node "/a"')]
    assert sorted(places(failure.diagnostics, codes.DANGLING)) == [
        (4, 'path "ghost"'),
        (8, 'executor "executor_0"'),
        (12, 'callback group "/a/group"'),
        (23, 'node "/a" publishing "/y"'),
    ]
    assert {line for line, _ in places(failure.diagnostics, codes.MALFORMED)} == {21, 24, 25, 27, 29}
    suggestion = found(failure.diagnostics, codes.BAD_CALLBACK_TYPE)[0].help
    assert suggestion.startswith('did you mean "timer_callback"')


def test_malformed_yaml_names_the_line():
    failure = refusal("broken_syntax.yaml")
    assert [(d.code, d.at.line) for d in failure.diagnostics] == [("HAL0020", 9)]


def test_unknown_keys_are_reported(tmp_path):
    text = "named_paths: []\nexecutors: []\nnodes:\n- node_name: /a\n  callbacks:\n"
    text += "  - {callback_name: /a/t, callback_type: timer_callback, period_ns: 1000000, perod_ns: 2}\n"
    (warning,) = found(read(write(tmp_path, text, "a.yaml")).diagnostics, codes.UNKNOWN_KEY)
    assert (warning.at.line, warning.path) == (6, 'callback "/a/t"')
    assert warning.help == 'did you mean "period_ns"?'


def test_a_graph_without_periods_is_refused():
    failure = refusal("closed_loop.yaml")
    assert found(failure.diagnostics, codes.NO_TASKS)
    assert found(failure.diagnostics, codes.NO_PERIOD)


TWICE = """\
named_paths: []
executors:
- {executor_type: single_threaded_executor, executor_name: e1, callback_group_names: [/n/g1]}
- executor_type: single_threaded_executor
  executor_name: e2
  callback_group_names:
  - /n/g1
nodes:
- node_name: /n
  callback_groups:
  - {callback_group_type: reentrant, callback_group_name: /n/g1, callback_names: [/n/a, /n/a]}
  - {callback_group_type: mutually_exclusive, callback_group_name: /n/g2, callback_names: [/n/a]}
  callbacks:
  - {callback_name: /n/a, callback_type: timer_callback, period_ns: 10000000, topic_name: UNDEFINED}
  - callback_name: /n/b
    callback_type: subscription_callback
    topic_name: /t
    period_ns: 20000000
"""


def test_a_callback_of_two_groups_and_a_group_of_two_executors_are_reported(tmp_path):
    imported = read(str(write(tmp_path, TWICE, "architecture.yaml")))
    assert places(imported.diagnostics, codes.TWO_OWNERS) == [(7, 'callback group "/n/g1"'), (12, 'callback "/n/a"')]
    assert all("remove it from the other" in d.help for d in found(imported.diagnostics, codes.TWO_OWNERS))
    assert refusal(str(tmp_path / "architecture.yaml"), strict=True)


def test_a_key_of_another_type_of_callback_is_reported(tmp_path):
    imported = read(str(write(tmp_path, TWICE, "architecture.yaml")))
    (warning,) = found(imported.diagnostics, codes.UNKNOWN_KEY)
    assert (warning.at.line, warning.path) == (18, 'callback "/n/b"')
    assert '"period_ns"' in warning.message
    assert "timer_callback" in warning.help
