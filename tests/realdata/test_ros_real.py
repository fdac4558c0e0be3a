"""ROS graphs of real systems: Autoware as CARET exports it, rqt_graph files, recordings, and files that are neither."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, least_common_multiple
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.dataflow import components
from halpipe.importers.ros.options import RosImportOptions
from halpipe.importers.traces import read_traces
from halpipe.models import Status, Unit

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "ros"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real ROS graphs are not part of the project")


def read(*files):
    return FORMAT.read([str(DATA / file) for file in files], RosImportOptions())


def is_design(path):
    return path.suffix == ".yaml" and (path.name.startswith("asd_") or path.parent.name == "asd_examples")


@pytest.fixture(scope="module")
def autoware():
    return read("caret_autoware_architecture.yaml")


def test_every_element_of_autoware_is_accounted_for(autoware):
    totals = {kind: total for kind, total, _, _ in autoware.coverage.rows()}
    assert totals == {
        "callback_group": 104,
        "executor": 277,
        "file": 1,
        "message_context": 914,
        "node": 106,
        "publisher": 301,
        "subscription": 183,
        "subscription_callback": 183,
        "timer_callback": 40,
        "variable_passing": 46,
    }
    assert all(total == mapped + ignored for _, total, mapped, ignored in autoware.coverage.rows())


def test_every_timer_of_autoware_is_a_task(autoware):
    counts = {kind: mapped for kind, _, mapped, _ in autoware.coverage.rows()}
    assert counts["timer_callback"] == 40
    assert len(autoware.model.tasks) == counts["timer_callback"] + counts["subscription_callback"]
    assert len({task.name for task in autoware.model.tasks}) == len(autoware.model.tasks)


def test_the_hyperperiod_of_autoware_stays_small(autoware):
    assert least_common_multiple(task.period for task in autoware.model.tasks) == Duration.parse("3s")
    assert sum(d.code == codes.SNAPPED.id for d in autoware.diagnostics) == 4


def test_the_four_loops_of_autoware_are_reported_with_all_their_nodes(autoware):
    loops = [d.message for d in autoware.diagnostics if d.code == codes.FEEDBACK.id]
    assert sorted(int(message.split()[0]) for message in loops) == [2, 3, 4, 5]
    assert all("; cut " in message and " -> " in message for message in loops)


def test_the_precedence_of_autoware_is_acyclic_and_its_windows_hold_at_every_phase(autoware):
    tasks = {task.name: task for task in autoware.model.tasks}
    after = {name: [p.task for p in task.versions[0].precedences] for name, task in tasks.items()}
    assert sum(map(len, after.values())) > 100
    assert components(after) == []
    for task in tasks.values():
        for constraint in task.versions[0].precedences:
            assert constraint.max >= tasks[constraint.task].period


def test_single_callback_nodes_of_autoware_give_short_names(autoware):
    names = {task.name for task in autoware.model.tasks}
    assert "/perception/object_recognition/tracking/multi_object_tracker" in names
    assert "/control/vehicle_cmd_gate/callback_01" in names


@pytest.mark.parametrize("path", sorted(DATA.glob("caret_sample*.yaml")), ids=lambda path: path.stem)
def test_caret_samples_import_with_their_paths(path):
    imported = read(path)
    assert imported.model.chains
    assert Counter(str(d.severity) for d in imported.diagnostics)["error"] == 0
    assert {kind: ignored for kind, _, _, ignored in imported.coverage.rows()}["node"] == 0


def test_a_navigation_stack_gets_its_periods_from_a_recording():
    imported = read("dot_exomy_nav.dot", "rosbag2_chibi25_b_metadata.yaml")
    periods = {task.name: str(task.period) for task in imported.model.tasks}
    assert periods["/depthimage_to_laserscan_node"] == "25ms"
    assert periods["/visual_odometry"] == "100ms"
    after = {t.name: [p.task for p in t.versions[0].precedences] for t in imported.model.tasks}
    assert components(after) == []


@pytest.mark.parametrize(
    "path",
    sorted(p for p in DATA.rglob("*") if p.is_file() and "caret_" not in str(p.relative_to(DATA)) and not is_design(p)),
    ids=lambda p: p.name,
)
def test_any_other_file_alone_is_refused_with_a_reason(path):
    with pytest.raises(HalpipeError) as caught:
        read(path)
    assert any(diagnostic.is_error for diagnostic in caught.value.diagnostics)
    assert all(diagnostic.message for diagnostic in caught.value.diagnostics)


@pytest.mark.parametrize("path", sorted(filter(is_design, DATA.rglob("*"))), ids=lambda p: p.name)
def test_a_design_file_alone_gives_tasks_or_the_reason_why_not(path):
    stated = sum("periodic:" in line for line in path.read_text().splitlines())
    try:
        imported = read(path)
    except HalpipeError as refused:
        assert not stated
        assert {codes.NO_TASKS.id} == {d.code for d in refused.diagnostics if d.is_error}  # noqa: PT017
    else:
        assert len(imported.model.tasks) >= stated > 0
        assert not any(d.is_error for d in imported.diagnostics)


def test_the_examples_of_autoware_system_design():
    """Four lidars at 10 Hz, one of two detectors in simulation, a localizer of 100 Hz; nothing is left over."""
    imported = read("asd_examples")
    model = imported.model
    assert [mode.name for mode in model.modes] == ["default", "simulation"]
    assert [unit.name for unit in model.units] == ["main_ecu", "dummy_ecu_1", "dummy_ecu_2"]
    lidars = [task for task in model.tasks if task.name.startswith("/sensing/lidar/lidar_")]
    assert {str(task.period) for task in lidars} == {"100ms"}
    assert str(model.task("/localization/slam").period) == "10ms"
    tracker = model.task("/perception/object_recognition/node_tracker/update")
    assert [(v.name, len(v.precedences)) for v in tracker.versions] == [("default", 2), ("simulation", 1)]
    detector = "/perception/object_recognition/detector_a2/node_detector"
    assert {run.task for run in model.mode("default").runs} - {run.task for run in model.mode("simulation").runs} == {
        detector,
        detector.replace("node_detector", "node_filter"),
    }
    codes_found = {d.code for d in imported.diagnostics}
    assert codes.LOOSE_CONNECTION.id not in codes_found
    assert codes.MISSING_ENTITY.id not in codes_found


@pytest.mark.slow
def test_autoware_can_be_scheduled_once_wcets_and_units_are_given(autoware):
    from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
    from halpipe.pipeline.verify import verify

    units = tuple(Unit(name=f"core{number}") for number in range(4))
    tasks = []
    for task in autoware.model.tasks:
        (version,) = task.versions
        stated = replace(version, wcet=Duration.parse("0.2ms"), units=tuple(unit.name for unit in units))
        tasks.append(replace(task, versions=(stated,)))
    model = replace(autoware.model, units=units, tasks=tuple(tasks))
    found = schedule_model(model, SearchOptions(), lambda *_: True)
    assert found.schedule.modes[0].status is Status.VALID
    assert not [d for d in verify(model, found.schedule) if d.is_error]


def test_a_real_trace_is_a_model_and_can_be_compared():
    """Counted by hand from the events that babeltrace prints: 8 callbacks, 5 publishers, the longest job of each."""
    imported = read("caret_demos_trace")
    assert {task.name: task.versions[0].wcet.ns for task in imported.model.tasks} == {
        "/actuator_dummy_node": 80136029,
        "/drive_node": 50196382,
        "/filter_node": 75196642,
        "/message_driven_node/callback_0": 45146583,
        "/message_driven_node/callback_1": 45184896,
        "/sensor_dummy_node": 50160774,
        "/timer_driven_node/callback_0": 45203701,
        "/timer_driven_node/callback_1": 45134118,
    }
    after = {task.name: [p.task for p in task.versions[0].precedences] for task in imported.model.tasks}
    assert after["/timer_driven_node/callback_1"] == ["/message_driven_node/callback_1"]
    assert sum(map(len, after.values())) == 5
    assert [resource.name for resource in imported.model.resources] == [
        "/message_driven_node/callback_group_0",
        "/timer_driven_node/callback_group_0",
    ]
    (line,) = read_traces(str(DATA / "caret_demos_trace")).traces
    assert {e.task for e in line.executions} == {task.name for task in imported.model.tasks}
    assert len(line.executions) == 381
