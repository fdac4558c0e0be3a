"""Which files are read as what, recordings, directories, strictness, and the example of the documentation."""

import shutil
from pathlib import Path

import pytest
from ros_case import FIXTURES, found, periods, places, predecessors, read, reasons, refusal, rows, write

from halpipe.core.diagnostics import Exit, HalpipeError, render_text
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.sniff import FileKind, recognise

EXAMPLE = Path(__file__).parents[3] / "examples" / "roboracer" / "graph" / "architecture.yaml"


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("stack.yaml", FileKind.CARET),
        ("old_form.yaml", FileKind.CARET),
        ("tasks.dot", FileKind.DOT),
        ("rqt_topics.dot", FileKind.DOT),
        ("bag/metadata.yaml", FileKind.BAG),
        ("design/nodes.yaml", FileKind.DESIGN),
    ],
)
def test_content_decides(file, kind):
    assert recognise("any.name", (FIXTURES / file).read_bytes()).kind is kind


def test_a_graph_named_yaml_and_a_key_named_graph_are_told_apart():
    assert recognise("x.yaml", b"\xef\xbb\xbf/* c */ digraph {}").kind is FileKind.DOT
    assert refusal_of(b"graph: 3\nnodes: []\n").startswith("x.yaml:1: error[HAL0601]")


def refusal_of(data, name="x.yaml"):
    with pytest.raises(HalpipeError) as caught:
        recognise(name, data)
    (diagnostic,) = caught.value.diagnostics
    return render_text(diagnostic)


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (b"<html/>", "is XML"),
        (b'<?xml version="1.0"?>\n<launch><node pkg="a" exec="b"/></launch>', "is a launch file"),
        (b"launch:\n- node: {pkg: a, exec: b}\n", "is a launch file"),
        (b"/**:\n  ros__parameters: {rate: 10}\n", "parameter file"),
        (b"car:\n  planner:\n    ros__parameters: {rate: 10}\n", "parameter file"),
        (b"", "is empty"),
        (b"- 1\n- 2\n", "is not a mapping"),
        (b"ros__parameters: {}\n", "ROS parameter file"),
        (b"rosbag2_bagfile_information: 3\n", "not the architecture.yaml of CARET"),
    ],
)
def test_other_formats_are_named(data, part):
    assert part in refusal_of(data)


def test_a_launch_file_in_python_has_no_graph():
    refusal = refusal_of(b"from launch import LaunchDescription\n", "car.launch.py")
    assert refusal.startswith("car.launch.py:1: error[")
    assert "a launch file starts nodes" in refusal


def test_an_unrelated_architecture_file_is_recognised():
    (diagnostic,) = refusal("unrelated_architecture.yaml").diagnostics
    assert diagnostic.code == codes.UNRECOGNISED.id
    assert "has no nodes, executors, named_paths" in diagnostic.message


def test_a_dot_file_that_is_not_dot():
    (diagnostic,) = refusal("not_a_graph.dot").diagnostics
    assert (diagnostic.code, diagnostic.at.line) == (codes.NOT_DOT.id, 1)
    assert 'begins with "NETWORK"' in diagnostic.message


def test_no_graph_and_two_graphs():
    assert found(refusal("bag/metadata.yaml").diagnostics, codes.NO_GRAPH)
    assert found(refusal().diagnostics, codes.NO_GRAPH)
    assert len(found(refusal("stack.yaml", "tasks.dot").diagnostics, codes.TWO_GRAPHS)) == 2


def test_an_empty_directory_has_no_graph(tmp_path):
    assert found(refusal(tmp_path).diagnostics, codes.NO_GRAPH)


def test_a_missing_file_is_reported():
    assert [d.code for d in refusal("nowhere.yaml").diagnostics] == ["HAL0001"]


def test_directories_are_searched_and_strangers_skipped(tmp_path):
    shutil.copy(FIXTURES / "rqt_topics.dot", tmp_path)
    shutil.copytree(FIXTURES / "bag", tmp_path / "bag")
    shutil.copy(FIXTURES / "unrelated_architecture.yaml", tmp_path)
    shutil.copy(FIXTURES / "broken_syntax.yaml", tmp_path)
    imported = read(tmp_path)
    skipped = found(imported.diagnostics, codes.SKIPPED_FILE)
    assert [(Path(d.at.file).name, str(d.severity)) for d in skipped] == [
        ("broken_syntax.yaml", "warning"),
        ("unrelated_architecture.yaml", "note"),
    ]
    assert rows(imported)["file"] == [4, 2, 2]


def test_recordings_give_periods_to_sources(tmp_path):
    text = (FIXTURES / "rqt_topics.dot").read_text().replace("25000000 ns", "30000000 ns")
    imported = read(write(tmp_path, text), "bag/metadata.yaml")
    assert periods(imported) == {"/driver": "25ms", "/filter": "25ms", "/planner": "25ms"}
    assert places(imported.diagnostics, codes.SNAPPED) == [(10, 'topic "/lidar/scan"')]
    assert reasons(imported, "bag_topic") == {
        "/map": "1 messages in 525.154215868s make no rate",
        "/goal": "its period is known without it",
        "/elsewhere": "no node of the graph uses it",
    }


def test_recordings_that_disagree(tmp_path):
    text = (FIXTURES / "bag" / "metadata.yaml").read_text().replace("21052", "10526")
    imported = read("rqt_topics.dot", "bag/metadata.yaml", write(tmp_path, text, "metadata.yaml"))
    (warning,) = found(imported.diagnostics, codes.BAG_CONFLICT)
    assert warning.path == 'topic "/lidar/scan"'
    assert warning.message.startswith("period 50ms here, 25ms in ")
    assert periods(imported)["/driver"] == "25ms"


def test_a_malformed_recording():
    failure = refusal("rqt_topics.dot", "bad_bag.yaml")
    assert sorted(places(failure.diagnostics, codes.BAD_PERIOD)) == [(3, "bag"), (7, 'topic "/scan"')]
    assert {line for line, _ in places(failure.diagnostics, codes.MALFORMED)} == {5}


def test_strict_turns_losses_into_errors():
    failure = refusal("stack.yaml", strict=True)
    assert failure.exit is Exit.UNSUPPORTED
    raised = {d.code for d in failure.diagnostics if d.is_error}
    assert {codes.UNKNOWN_PUBLISHER.id, codes.NO_PERIOD.id} <= raised
    assert codes.SNAPPED.id not in raised


def test_the_model_is_named_by_option_or_file():
    assert read("stack.yaml").model.name == "stack"
    assert read("stack.yaml", name="car").model.name == "car"


def test_the_import_is_deterministic():
    assert read("stack.yaml") == read("stack.yaml")


@pytest.mark.parametrize(
    "file", ["stack.yaml", "contexts.yaml", "old_form.yaml", "rqt_topics.dot", "rqt_nodes_only.dot"]
)
def test_models_can_be_stored(file):
    model = read(file).model
    assert parse_model(format_model(model), "model.xml") == model


def test_names_with_control_characters_can_be_stored(tmp_path):
    path = write(tmp_path, 'digraph { "a\u0001b" -> "line\nbreak" [label="/t\u0002\\n10 Hz"] }')
    model = read(path).model
    assert [task.name for task in model.tasks] == ["a_b", "line_break"]
    assert parse_model(format_model(model), "model.xml") == model


def test_the_format_presents_itself():
    assert FORMAT.name == "ros"
    assert "CARET" in FORMAT.summary


def test_the_roboracer_example_gives_the_precedence_of_the_paper():
    imported = read(EXAMPLE, sources={"/scan": "25ms"})
    assert periods(imported) == dict.fromkeys(
        ("/particle_filter", "/opponent_detection", "/local_planner", "/pure_pursuit"), "25ms"
    )
    assert predecessors(imported) == {  # paper, Table II
        "/particle_filter": [],
        "/opponent_detection": ["/particle_filter"],
        "/local_planner": ["/particle_filter", "/opponent_detection"],
        "/pure_pursuit": ["/particle_filter", "/local_planner"],
    }
    (chain,) = imported.model.chains
    assert (chain.name, chain.tasks) == ("lidar-to-steering", tuple(periods(imported)))
    assert {str(d.severity) for d in imported.diagnostics} == {"note"}


def test_a_task_period_of_the_overlay_makes_an_event_driven_node_a_task():
    without = refusal("not_timed.dot")
    assert [d.code for d in without.diagnostics if d.is_error] == [codes.NO_TASKS.id]
    imported = read("not_timed.dot", periods={"/driver": "25ms"})
    assert {task.name: str(task.period) for task in imported.model.tasks} == {"/driver": "25ms", "/filter": "25ms"}
