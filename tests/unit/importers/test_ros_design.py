"""Autoware System Design: instances, connections, processes, inheritance and modes become one model."""

from pathlib import Path

import pytest
from ros_case import found, periods, predecessors, read, reasons, refusal, rows

from halpipe.core.diagnostics import Exit
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.importers.ros import codes


@pytest.fixture(scope="module")
def shuttle():
    return read("design")


HEAD = "autoware_system_design_format: 0.3.0\nname: {}\n"
TALKER = """\
publishers: [{name: out}]
processes: [{name: p, trigger_conditions: [{periodic: 10}], outcomes: [{to_output: out}]}]
"""
LISTENER = "subscribers: [{name: in}]\nprocesses: [{name: q, trigger_conditions: [{on_input: in}], outcomes: []}]\n"
PAIR = """\
components:
  - {name: a, entity: Talker.node}
  - {name: b, entity: Listener.node}
connections:
  - [a.publisher.out, b.subscriber.in]
"""


def design(folder, **entities):
    """Write entities, ``__`` for the dot of their names, and return the folder."""
    for name, text in entities.items():
        full = name.replace("__", ".")
        (folder / f"{full}.yaml").write_text(HEAD.format(full) + text)
    return folder


def pair(folder, system=PAIR, talker=TALKER, listener=LISTENER):
    return design(folder, S__system=system, Talker__node=talker, Listener__node=listener)


# ---------------------------------------------------------------------------------------------------- the whole


def test_processes_are_tasks_with_exact_periods(shuttle):
    assert periods(shuttle) == {
        "/sensing/lidar/left": "5000/83ms",
        "/sensing/lidar/right": "5000/83ms",
        "/sensing/lidar/merge/collect": "5000/83ms",
        "/sensing/lidar/merge/merge": "5000/83ms",
        "/sensing/camera": "100/3ms",
        "/tracker": "100/3ms",
        "/planner/watch": "100/3ms",
        "/planner/plan": "100/3ms",
        "/tracker@Parking": "5000/83ms",
        "/planner/watch@Parking": "5000/83ms",
        "/planner/plan@Parking": "200ms",
    }


def test_connections_are_precedence_through_modules_and_triggers(shuttle):
    assert predecessors(shuttle) == {
        "/sensing/lidar/left": [],
        "/sensing/lidar/right": [],
        "/sensing/lidar/merge/collect": ["/sensing/lidar/left", "/sensing/lidar/right"],
        "/sensing/lidar/merge/merge": ["/sensing/lidar/merge/collect"],
        "/sensing/camera": [],
        "/tracker": ["/sensing/lidar/merge/merge", "/sensing/camera"],
        "/planner/watch": ["/tracker"],
        "/planner/plan": ["/planner/watch"],
        "/tracker@Parking": ["/sensing/lidar/merge/merge"],
        "/planner/watch@Parking": ["/tracker@Parking"],
        "/planner/plan@Parking": [],
    }


def test_modes_have_the_default_first(shuttle):
    assert [mode.name for mode in shuttle.model.modes] == ["Drive", "Parking"]
    parking = {run.task for run in shuttle.model.mode("Parking").runs}
    assert "/sensing/camera" not in parking
    assert {"/tracker@Parking", "/sensing/lidar/left"} <= parking


def test_other_rates_in_other_modes_are_said(shuttle):
    assert {d.path for d in found(shuttle.diagnostics, codes.MODE_PERIOD)} == {
        'task "/tracker"',
        'task "/planner/watch"',
        'task "/planner/plan"',
    }


def test_compute_units_are_units(shuttle):
    units = {task.name: task.versions[0].units for task in shuttle.model.tasks}
    assert [unit.name for unit in shuttle.model.units] == ["sensor_ecu", "main_ecu"]
    assert units["/sensing/lidar/merge/merge"] == ("sensor_ecu",)
    assert units["/planner/plan"] == ("main_ecu",)
    (note,) = found(shuttle.diagnostics, codes.COMPUTE_UNITS)
    assert '"sensor_ecu", "main_ecu"' in note.message


def test_every_element_is_accounted_for(shuttle):
    counted = rows(shuttle)
    assert all(total == mapped + ignored for total, mapped, ignored in counted.values())
    assert counted["node_file"] == [7, 6, 1]
    assert counted["process"] == [15, 15, 0]
    assert counted["mode"] == [2, 2, 0]
    assert reasons(shuttle, "node_file") == {"Spare.node": "no part of the system uses it"}
    assert reasons(shuttle, "publisher")["/tracker debug"] == "no process states it as its output"
    assert reasons(shuttle, "executor") == {
        "lidars": "the schedule assigns the cores, not an executor",
        "main": "no two of its callbacks that exclude each other are tasks",
    }


def test_origins_are_processes_in_their_own_files(shuttle):
    origin = shuttle.model.task("/planner/plan@Parking").origin
    assert (Path(origin.file).name, origin.line, origin.path) == ("ParkingPlanner.node.yaml", 6, "/planner/plan")
    assert Path(shuttle.model.task("/planner/watch@Parking").origin.file).name == "Planner.node.yaml"


def test_the_model_can_be_written_and_read(shuttle):
    assert parse_model(format_model(shuttle.model), "m.xml") == shuttle.model


def test_strict_refuses_what_changes_with_the_mode():
    assert refusal("design", strict=True).exit is Exit.UNSUPPORTED


# ---------------------------------------------------------------------------------------------------- the parts


def test_a_task_that_differs_only_in_its_predecessors_has_a_version_for_each(tmp_path):
    system = """\
modes: [{name: one}, {name: two}]
components:
  - {name: a, entity: Talker.node}
  - {name: b, entity: Listener.node}
  - {name: c, entity: Talker.node}
connections:
  - [a.publisher.out, b.subscriber.in]
two:
  override:
    connections:
      - [c.publisher.out, b.subscriber.in]
"""
    listener = LISTENER.replace("q, trigger_conditions: [", "q, trigger_conditions: [{periodic: 10}, ")
    model = read(pair(tmp_path, system, listener=listener)).model
    assert [(v.name, [p.task for p in v.precedences]) for v in model.task("/b").versions] == [
        ("default", ["/a"]),
        ("two", ["/a", "/c"]),
    ]
    runs = {mode.name: {run.task: run.versions for run in mode.runs} for mode in model.modes}
    assert {name: run["/b"] for name, run in runs.items()} == {"one": ("default",), "two": ("two",)}
    assert runs["two"]["/a"] == ("default",)


def test_a_node_alone_is_a_system(tmp_path):
    imported = read(design(tmp_path, Talker__node=TALKER))
    assert (imported.model.name, periods(imported)) == ("Talker", {"/Talker": "100ms"})
    assert [unit.name for unit in imported.model.units] == ["core0"]


def test_a_port_from_outside_is_a_source(tmp_path):
    folder = design(tmp_path, Listener__node=LISTENER)
    assert found(refusal(folder).diagnostics, codes.NO_TASKS)
    assert periods(read(folder, sources={"/Listener/input/in": "20ms"})) == {"/Listener": "20ms"}


def test_global_ports_meet_by_name(tmp_path):
    system = PAIR.replace("  - [a.publisher.out, b.subscriber.in]", "  []")
    talker = TALKER.replace("{name: out}", "{name: out, global: /all}")
    listener = LISTENER.replace("{name: in}", "{name: in, global: /all}")
    assert predecessors(read(pair(tmp_path, system, talker, listener)))["/b"] == ["/a"]


@pytest.mark.parametrize("wild", ["*", "^", "o^", "*t"])
def test_wildcards_stand_for_the_same_on_both_sides(tmp_path, wild):
    system = PAIR.replace("a.publisher.out, b.subscriber.in", f"a.publisher.{wild}, b.subscriber.{wild}")
    listener = LISTENER.replace("[{name: in}]", "[{name: out}, {name: ot}, {name: in}]").replace(
        "on_input: in", "on_input: out"
    )
    imported = read(pair(tmp_path, system, listener=listener))
    assert predecessors(imported)["/b"] == ["/a"]
    assert not found(imported.diagnostics, codes.LOOSE_CONNECTION)


@pytest.mark.parametrize("wild", ["^", "*", "+"])
def test_wildcards_stand_for_instances_too(tmp_path, wild):
    """Each kind of wildcard stands for one text; where a kind is on one side only, each of its ports is meant."""
    module = (
        "instances: [{name: left, entity: Listener.node}, {name: right, entity: Listener.node}]\n"
        "subscribers: [{name: left/raw}, {name: right/raw}]\npublishers: []\n"
        f"connections: [[subscriber.{wild}/raw, '{wild}.subscriber.in']]\n"
    )
    system = PAIR.replace("b, entity: Listener.node", "b, entity: Both.module").replace(
        "[a.publisher.out, b.subscriber.in]", f"[a.publisher.out, b.subscriber.{wild}ght/raw]"
    )
    folder = design(tmp_path, S__system=system, Talker__node=TALKER, Listener__node=LISTENER, Both__module=module)
    imported = read(folder, sources={"/b/input/left/raw": "50ms"})
    assert periods(imported) == {"/a": "100ms", "/b/left": "50ms", "/b/right": "100ms"}
    assert not found(imported.diagnostics, codes.LOOSE_CONNECTION)


def test_many_wildcards_are_tried_in_one_way_only(tmp_path):
    """A pattern of 40 wildcards and a name of 200 letters that it does not fit: all ways would take for ever."""
    system = PAIR.replace("a.publisher.out", "a.publisher." + "*a" * 40 + "b")
    talker = TALKER.replace("out", "a" * 200)
    assert found(read(pair(tmp_path, system, talker)).diagnostics, codes.LOOSE_CONNECTION)


def test_pairs_may_be_in_any_order_or_mappings(tmp_path):
    system = PAIR.replace("[a.publisher.out, b.subscriber.in]", "{to: b.subscriber.in, from: a.publisher.out}")
    assert predecessors(read(pair(tmp_path, system)))["/b"] == ["/a"]


def test_a_process_with_a_rate_is_not_triggered_by_an_outcome_alone(tmp_path):
    text = (
        "subscribers: [{name: in}]\nprocesses:\n"
        "  - {name: store, trigger_conditions: [{on_input: in}], outcomes: [{to_trigger: run}]}\n"
        "  - {name: run, trigger_conditions: [{periodic: 4}], outcomes: []}\n"
    )
    imported = read(pair(tmp_path, listener=text))
    assert periods(imported) == {"/a": "100ms", "/b/store": "100ms", "/b/run": "250ms"}


# -------------------------------------------------------------------------------------------------- what is wrong


def warned(folder, code):
    return [(d.at.line, d.message) for d in found(read(folder).diagnostics, code)]


def test_a_missing_entity_is_named_once_and_the_rest_is_read(tmp_path):
    folder = pair(tmp_path, PAIR + "  - [c.publisher.out, b.subscriber.in]\n")
    system = folder / "S.system.yaml"
    system.write_text(system.read_text().replace("connections:", "  - {name: c, entity: Talkr.node}\nconnections:"))
    imported = read(folder)
    (missing,) = found(imported.diagnostics, codes.MISSING_ENTITY)
    assert (missing.at.line, "Talker.node" in missing.help) == (6, True)
    assert not found(imported.diagnostics, codes.LOOSE_CONNECTION)
    assert set(periods(imported)) == {"/a", "/b"}


@pytest.mark.parametrize(
    "connection",
    [
        "a.publisher.nothing, b.subscriber.in",
        "x.publisher.out, b.subscriber.in",
        "a.publisher.out, a.publisher.out",
        "a, b",
    ],
)
def test_connections_that_lead_nowhere(tmp_path, connection):
    folder = pair(tmp_path, PAIR + f"  - [{connection}]\n")
    assert {line for line, _ in warned(folder, codes.LOOSE_CONNECTION)} == {8}


@pytest.mark.parametrize("entry", ["on_input: nothing", "on_trigger: nothing", "on_trigger: q2"])
def test_triggers_that_name_nothing(tmp_path, entry):
    listener = LISTENER.replace("{on_input: in}", "{on_input: in}, {" + entry + "}")
    assert warned(pair(tmp_path, listener=listener), codes.LOOSE_CONNECTION)


@pytest.mark.parametrize("outcome", ["to_output: nothing", "to_trigger: nothing"])
def test_outcomes_that_name_nothing(tmp_path, outcome):
    talker = TALKER.replace("to_output: out", f"to_output: out, {outcome}" if "trigger" in outcome else outcome)
    assert warned(pair(tmp_path, talker=talker), codes.LOOSE_CONNECTION)


@pytest.mark.parametrize("rate", ["0", "-5", "fast", "$(var rate)", "1e3", ""])
def test_rates_that_cannot_be_read(tmp_path, rate):
    listener = """\
subscribers: [{name: in}]
processes:
  - {name: q, trigger_conditions: [{on_input: in}], outcomes: []}
  - {name: r, trigger_conditions: [{periodic: 'RATE'}], outcomes: []}
"""
    folder = pair(tmp_path, listener=listener.replace("RATE", rate))
    assert [line for line, _ in warned(folder, codes.NO_RATE)] == [6]


def test_variables_have_the_nearest_value(tmp_path):
    talker = TALKER.replace("periodic: 10", "periodic: '${parameter rate}'")
    system = "variables: [{name: rate, value: 1}]\n" + PAIR
    assert periods(read(pair(tmp_path, system, talker)))["/a"] == "1s"
    own = talker + "param_values: [{name: rate, default: 2}]\n"
    assert periods(read(pair(tmp_path, system, own)))["/a"] == "500ms"


@pytest.mark.parametrize(("version", "warnings"), [("0.4.9", 0), ("0.5.0", 1), ("1.0.0", 1), ("new", 1)])
def test_versions_of_the_format(tmp_path, version, warnings):
    folder = design(tmp_path, Talker__node=TALKER)
    path = folder / "Talker.node.yaml"
    path.write_text(path.read_text().replace("0.3.0", version))
    assert len(warned(folder, codes.DESIGN_VERSION)) == warnings


def test_two_systems_and_a_design_with_a_graph_are_refused(tmp_path):
    folder = design(pair(tmp_path), Other__system=PAIR)
    assert len(found(refusal(folder).diagnostics, codes.TWO_GRAPHS)) == 2
    assert len(found(refusal("design", "stack.yaml").diagnostics, codes.TWO_GRAPHS)) == 2


def test_a_system_may_build_on_another(tmp_path):
    other = "base: S.system\noverride: {components: [{name: a, entity: Slow.node}]}\n"
    slow = "base: Talker.node\noverride: {processes: [{name: p, trigger_conditions: [{periodic: 1}]}]}\n"
    folder = design(pair(tmp_path), Other__system=other, Slow__node=slow)
    assert periods(read(folder))["/a"] == "1s"


def test_what_contains_itself_is_refused(tmp_path):
    loop = "instances: [{name: again, entity: Loop.module}]\n"
    found_errors = refusal(
        design(tmp_path, Loop__module=loop, S__system="components: [{name: l, entity: Loop.module}]\n")
    )
    assert any("contains itself" in d.message for d in found(found_errors.diagnostics, codes.MALFORMED))
    based = refusal(design(tmp_path, S__system="base: S.system\ncomponents: []\n"))
    assert any("its own base" in d.message for d in found(based.diagnostics, codes.MALFORMED))


@pytest.mark.slow
def test_exponential_designs_are_stopped(tmp_path):
    modules = {
        f"M{n}__module": "instances:\n" + "".join(f"  - {{name: i{k}, entity: M{n + 1}.module}}\n" for k in range(30))
        for n in range(4)
    }
    modules["M4__module"] = "instances: [{name: n, entity: Talker.node}]\n"
    errors = refusal(design(tmp_path, Talker__node=TALKER, **modules)).diagnostics
    assert any("more than" in d.message for d in found(errors, codes.MALFORMED))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name: X.engine\n", 2),
        ("name: [1]\n", 2),
        ("name: X.node\nprocesses: 3\n", 3),
        ("name: X.node\nprocesses: [{name: a, trigger_conditions: [3]}]\n", 3),
        ("name: X.module\ninstances: [{name: a}]\n", 3),
        ("name: X.module\ninstances: []\nconnections: 5\n", 4),
        ("name: X.module\ninstances: []\nconnections:\n  - [a]\n", 5),
    ],
)
def test_malformed_files(tmp_path, text, line):
    (tmp_path / "x.yaml").write_text("autoware_system_design_format: 0.3.0\n" + text)
    assert line in {d.at.line for d in found(refusal(tmp_path).diagnostics, codes.MALFORMED)}


def test_names_used_twice(tmp_path):
    text = "processes: [{name: p, trigger_conditions: [{periodic: 1}]}, {name: p}]\n"
    folder = design(tmp_path, X__node=text)
    (folder / "copy.yaml").write_text((folder / "X.node.yaml").read_text())
    paths = {d.path for d in found(refusal(folder).diagnostics, codes.DUPLICATE)}
    assert paths == {'entity "X.node"', 'node "/X" process "p"'}


def test_instances_at_one_place(tmp_path):
    twice = "components:\n  - {name: a, entity: Talker.node, path: /t}\n  - {name: b, entity: Talker.node, path: /t}\n"
    twice += "  - {name: b, entity: Talker.node}\n"
    errors = refusal(design(tmp_path, Talker__node=TALKER, S__system=twice))
    assert {d.path for d in found(errors.diagnostics, codes.DUPLICATE)} == {
        'node "/t"',
        'entity "S.system" instance "b"',
    }
