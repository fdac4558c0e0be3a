"""DOT graphs: rqt_graph's views, statistics and deadlines, and graphs drawn by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_case import found, periods, places, predecessors, read, reasons, refusal, rows, write

from halpipe.core.diagnostics import Findings, Severity
from halpipe.importers.ros import codes
from halpipe.importers.ros.activation import Wiring, activate
from halpipe.importers.ros.dataflow import components, order_by_data
from halpipe.importers.ros.dot import read_dot

FRAMES = r"""digraph G {
"world" -> "cart"[label=" Broadcaster: /tf_node\nAverage rate: 50.0\nBuffer length: 4.9\nMost recent transform: 7.5\n"];
}
"""


def test_coordinate_frames_are_no_nodes(tmp_path):
    """What view_frames of tf2 draws; an edge of nodes may well have a rate."""
    (refused,) = refusal(write(tmp_path, FRAMES)).diagnostics
    assert (refused.code, refused.at.line) == (codes.UNRECOGNISED.id, 2)
    assert "view_frames" in refused.message
    assert periods(read(write(tmp_path, FRAMES.replace(" Broadcaster: /tf_node\\nAverage rate: 50.0\\n", "50.0 Hz, "))))


def test_topics_view_with_a_deadline_as_period():
    imported = read("rqt_topics.dot")
    assert periods(imported) == {"/driver": "25ms", "/filter": "25ms", "/planner": "25ms"}
    assert predecessors(imported) == {"/driver": [], "/filter": ["/driver"], "/planner": ["/filter"]}
    assert imported.model.task("/driver").origin.line == 11


def test_a_loop_of_nodes_loses_the_edge_against_the_flow():
    (warning,) = found(read("rqt_topics.dot").diagnostics, codes.FEEDBACK)
    assert warning.severity is Severity.WARNING
    assert "2 nodes feed each other: /filter, /planner" in warning.message
    assert 'where "/filter" reads "/goal" (/filter -> /planner -> /filter)' in warning.message


def test_a_loop_that_no_cut_shows_names_the_cuts_within_its_nodes(tmp_path):
    """Two nodes that publish and read one topic: each edge that is cut also closes a loop of its node alone."""
    edges = "; ".join(f'"/{a}" -> "/{b}" [label="/x\\n10 Hz"]' for a in "ab" for b in "ab")
    (warning,) = found(read(write(tmp_path, f"digraph {{ {edges} }}")).diagnostics, codes.FEEDBACK)
    assert "2 nodes feed each other: /a, /b; cut where " in warning.message


def test_a_group_of_topics_need_not_have_a_full_name(tmp_path):
    """Of several topics of an action, rqt_graph draws one box, at times without the leading slash; its link tells."""
    text = """digraph {
    "/a" -> g -> "/b"; "/b" -> s -> "/a" [label="10 Hz"];
    g [label="go/action_topics", shape=box3d, URL=topic_3Ago_action_topics]; s [label="/s", shape=box];
}"""
    assert list(periods(read(write(tmp_path, text)))) == ["/a", "/b"]


def test_topics_view_is_accounted_for():
    imported = read("rqt_topics.dot")
    assert rows(imported) == {
        "file": [1, 1, 0],
        "node": [4, 3, 1],
        "publisher": [4, 2, 2],
        "subscription": [5, 3, 2],
        "topic": [4, 2, 2],
    }
    assert reasons(imported, "topic") == {
        "/goal": "orders no two tasks",
        "/tf": "is plumbing of ROS, not application data",
    }


def test_nodes_only_view_with_statistics():
    imported = read("rqt_nodes_only.dot")
    assert periods(imported) == {"/driver": "25ms", "/filter": "25ms", "/planner": "25ms"}
    assert predecessors(imported)["/planner"] == ["/driver", "/filter"]
    (note,) = found(imported.diagnostics, codes.SNAPPED)
    assert (note.at.line, note.path) == (6, 'topic "/scan"')
    assert "25.062657ms of the topic statistics rounded to 25ms" in note.message


@pytest.mark.parametrize("rate", ["1,5 Hz", "-5 Hz", "+5 Hz", "2.5.5 Hz", "1e2 Hz", "10 kHz", "0 Hz"])
def test_what_is_no_plain_rate_is_none(tmp_path, rate):
    graph = write(tmp_path, f'digraph {{ a -> b [label="{rate}"] }}')
    assert {d.code for d in refusal(graph).diagnostics if d.is_error} == {codes.NO_TASKS.id}


def test_a_task_graph_drawn_by_hand():
    imported = read("tasks.dot", sources={"Lidar Driver": "25ms", "Front Camera": "1/30s"})
    assert periods(imported) == {
        "Lidar_Driver": "25ms",
        "Front_Camera": "100/3ms",
        "Sensor_Fusion": "25ms",
        "_b_Control_/b_": "25ms",
    }
    assert predecessors(imported)["Sensor_Fusion"] == ["Lidar_Driver", "Front_Camera"]
    assert len(found(imported.diagnostics, codes.RENAMED)) == 4
    (warning,) = found(imported.diagnostics, codes.SEVERAL_PERIODS)
    assert warning.path == 'node "Sensor Fusion"'
    (slower,) = [p for p in imported.model.task("Sensor_Fusion").versions[0].precedences if p.task == "Front_Camera"]
    assert str(slower.max) == "100/3ms"


@st.composite
def rated_graphs(draw):
    """A task graph with arbitrary edges, some of which state a rate."""
    node = st.sampled_from("abcdefg")
    rates = st.sampled_from(["", ' [label="10 Hz"]', ' [label="40 Hz"]'])
    edges = draw(st.lists(st.tuples(node, node, rates), min_size=1, max_size=20))
    return "digraph {" + " ".join(f"{a} -> {b}{rate};" for a, b, rate in edges) + ' x -> a [label="20 Hz"] }'


@given(rated_graphs())
def test_precedence_of_any_graph_is_acyclic_with_wide_enough_windows(text):
    findings = Findings()
    wiring = Wiring(read_dot(text, "g.dot", findings))
    activations = activate(wiring, wiring.graph.rates, None, {}, findings)
    flow = order_by_data(wiring, activations, findings)
    after = {name: [edge.reader for edge in flow.edges if edge.publisher == name] for name in wiring.callbacks}
    assert components(after) == []
    assert all({edge.publisher, edge.reader} <= set(activations.of) for edge in flow.edges)
    for edge in flow.lost:
        assert components(after | {edge.publisher: [*after[edge.publisher], edge.reader]})


def test_duplicate_nodes_are_errors(tmp_path):
    path = write(tmp_path, 'digraph {\n a [label="/x"];\n b [label="/x"];\n a -> c [label="10 Hz"]\n}')
    assert places(refusal(path).diagnostics, codes.DUPLICATE) == [(3, 'node "/x"')]


def test_names_that_fall_together_stay_apart(tmp_path):
    path = write(tmp_path, 'digraph { "a b" -> "a_b" [label="10 Hz"]; "a_b" -> "a*b" }')
    assert list(periods(read(path))) == ["a_b", "a_b_2", "a_b_3"]


def test_a_node_that_reads_its_own_topic_does_not_precede_itself(tmp_path):
    imported = read(write(tmp_path, 'digraph { a -> a [label="10 Hz"] }'))
    assert predecessors(imported) == {"a": []}
    (note,) = found(imported.diagnostics, codes.FEEDBACK)
    assert note.message.startswith("a node feeds itself: a;")


def test_tools_and_plumbing_are_left_out(tmp_path):
    tools = ("/rqt_gui_py_node_7", "/rviz", "/c/rviz2", "/launch_ros_99", "/a/transform_listener_impl_0f3", "/rosout")
    tools += ("/caret_trace_0f3_4a",)
    text = 'digraph { "/a" -> "/b" [label="/x\\n10 Hz"];' + "".join(f'"/a" -> "{tool}" [label="/x"];' for tool in tools)
    topics = ("/rosout", "/parameter_events", "/tf_static", "/clock", "/go/_action/status", "/robot1/tf", "/m/bond")
    text += "".join(f'"/b" -> "/a" [label="{topic}"];' for topic in topics) + "}"
    imported = read(write(tmp_path, text))
    assert list(periods(imported)) == ["/a", "/b"]
    assert set(reasons(imported, "node")) == set(tools)
    assert not found(imported.diagnostics, codes.FEEDBACK)
