"""Manifests of the Adaptive Platform: processes as tasks, function-group states as modes, allowed cores."""

import pytest
from arxml_case import component, el, every, found, mode_group, named, package, periods, read, ref, refusal, write

from halpipe.importers.arxml import codes

STATES = mode_group("States", "Off Driving Parking", "Off Driving", "Driving Off", "Driving Parking")
GROUPS = named(
    "FUNCTION-GROUP-SET",
    "Set",
    el("FUNCTION-GROUPS", named("MODE-DECLARATION-GROUP-PROTOTYPE", "Fg", ref("TYPE-TREF", "/T/States"))),
)


def machine(name="Computer", cores="Core0 Core1 Core2"):
    inside = [named("PROCESSOR-CORE", core, el("CORE-ID", core[-1])) for core in cores.split()]
    return named("MACHINE", name, el("PROCESSORS", named("PROCESSOR", "Cpu", el("CORES", *inside))) if inside else "")


def process(name, *states, client="", group="Set/Fg", config="STATE-DEPENDENT-STARTUP-CONFIG"):
    """A process that runs in these states of a function group."""
    irefs = [
        el(
            "FUNCTION-GROUP-STATE-IREF",
            ref("CONTEXT-MODE-DECLARATION-GROUP-PROTOTYPE-REF", f"/T/{group}"),
            ref("TARGET-MODE-DECLARATION-REF", f"/T/States/{state}"),
        )
        for state in states
    ]
    startup = el(f"{config}S", el(config, el("FUNCTION-GROUP-STATE-IREFS", *irefs))) if states else ""
    return named("PROCESS", name, ref("DETERMINISTIC-CLIENT-REF", f"/T/{client}") if client else "", startup)


def client(name, cycle, workers=1):
    return named("DETERMINISTIC-CLIENT", name, el("CYCLE-TIME-VALUE", cycle), el("NUMBER-OF-WORKERS", str(workers)))


def mapping(name, process_name, on="", off="", machine_name="Computer"):
    """A process on a machine, on or off cores of its only processor."""
    wanted, banned = (
        [ref(tag, f"/T/{machine_name}/Cpu/{core}") for core in cores.split()]
        for tag, cores in (("SHALL-RUN-ON-REF", on), ("SHALL-NOT-RUN-ON-REF", off))
    )
    return named(
        "PROCESS-TO-MACHINE-MAPPING",
        name,
        ref("PROCESS-REF", f"/T/{process_name}"),
        ref("MACHINE-REF", f"/T/{machine_name}"),
        el("SHALL-RUN-ON-REFS", *wanted),
        el("SHALL-NOT-RUN-ON-REFS", *banned),
    )


def mapped(*mappings):
    return named("PROCESS-TO-MACHINE-MAPPING-SET", "Maps", el("PROCESS-TO-MACHINE-MAPPINGS", *mappings))


def model_of(tmp_path, *elements, **options):
    return read(write(tmp_path, package("T", *elements)), **options)


def units(imported):
    return {task.name: task.versions[0].units for task in imported.model.tasks}


def test_processes_are_tasks_on_the_cores_of_the_machine(tmp_path):
    imported = model_of(tmp_path, machine(), process("Camera"), process("Planner"))
    assert [unit.name for unit in imported.model.units] == ["Core0", "Core1", "Core2"]
    assert units(imported) == {"Camera": ("Core0", "Core1", "Core2"), "Planner": ("Core0", "Core1", "Core2")}
    assert imported.model.name == "Computer"


def test_only_allowed_cores_are_valid_units(tmp_path):
    maps = mapped(
        mapping("a", "A", on="Core2 Core1"), mapping("b", "B", off="Core0"), mapping("c", "C", "Core1", "Core1")
    )
    imported = model_of(tmp_path, machine(), process("A"), process("B"), process("C"), maps)
    assert units(imported) == {
        "A": ("Core1", "Core2"),
        "B": ("Core1", "Core2"),
        "C": ("Core0", "Core1", "Core2"),  # contradicts itself: no core would be left
    }
    assert [warning.path for warning in found(imported, codes.NO_CORE)] == ['PROCESS-TO-MACHINE-MAPPING "/T/Maps/c"']
    assert ("PROCESS-TO-MACHINE-MAPPING", 3, 3, 0) in imported.coverage.rows()


def test_machines_keep_their_processes_apart(tmp_path):
    maps = mapped(mapping("a", "A", machine_name="One"), mapping("b", "B", machine_name="Two"))
    imported = model_of(tmp_path, machine("One", "Core0"), machine("Two", ""), process("A"), process("B"), maps)
    assert units(imported) == {"A": ("One/Core0",), "B": ("Two/core0",)}
    assert "Two/core0" in found(imported, codes.DEFAULT_UNIT)[0].message


def test_states_of_a_function_group_are_modes_with_their_processes(tmp_path):
    imported = model_of(
        tmp_path, STATES, GROUPS, machine(), process("A", "Driving"), process("B", "Driving", "Parking"), process("C")
    )
    runs = {mode.name: {run.task for run in mode.runs} for mode in imported.model.modes}
    assert runs == {"Parking": {"B", "C"}, "Off": {"C"}, "Driving": {"A", "B", "C"}}
    moves = {(t.source, t.target) for t in imported.model.transitions}
    assert moves == {("Off", "Driving"), ("Driving", "Off"), ("Driving", "Parking")}


def test_a_state_in_which_nothing_runs_is_no_mode(tmp_path):
    imported = model_of(tmp_path, STATES, GROUPS, machine(), process("A", "Driving"), process("B", "Parking"))
    assert [mode.name for mode in imported.model.modes] == ["Parking", "Driving"]
    assert [(t.source, t.target) for t in imported.model.transitions] == [("Driving", "Parking")]
    assert found(imported, codes.EMPTY_MODE)


def test_the_startup_configurations_of_older_releases_are_read(tmp_path):
    old = process("A", "Driving", config="MODE-DEPENDENT-STARTUP-CONFIG")
    imported = model_of(tmp_path, STATES, GROUPS, machine(), old, process("B", "Parking"))
    assert {mode.name for mode in imported.model.modes} == {"Driving", "Parking"}


def test_a_process_without_period_is_on_demand_and_said_so(tmp_path):
    imported = model_of(tmp_path, machine(), process("A"), process("B", client="C"), client("C", "0.02"))
    assert periods(imported) == {"A": "None", "B": "20ms"}
    (warning,) = found(imported, codes.PROCESS_WITHOUT_PERIOD)
    assert warning.message == "without a period, 1 of the processes: A"


def test_the_overlay_gives_periods_to_processes(tmp_path):
    imported = model_of(tmp_path, machine(), process("A"), sources={"A": "10ms"})
    assert periods(imported) == {"A": "10ms"}
    assert not found(imported, codes.PROCESS_WITHOUT_PERIOD)


def test_workers_run_side_by_side(tmp_path):
    imported = model_of(tmp_path, machine(), process("A", client="C"), client("C", "0.02", workers=3))
    assert imported.model.tasks[0].versions[0].gang == 3


@pytest.mark.parametrize("cycle", ["0", "-1", "often"])
def test_a_cycle_that_is_no_time_is_reported(tmp_path, cycle):
    imported = model_of(tmp_path, machine(), process("A", client="C"), client("C", cycle))
    assert periods(imported) == {"A": "None"}
    assert found(imported, codes.BAD_PERIOD)


def test_classic_and_adaptive_parts_share_a_model_but_no_cores(tmp_path):
    pump = component("Pump", every("0.01", "E", "Pump/Step"), runnables="Step")
    imported = model_of(tmp_path, machine(), process("A"), pump)
    assert units(imported) == {
        "Pump/Step": ("core0",),
        "A": ("Computer/Core0", "Computer/Core1", "Computer/Core2"),
    }


def test_manifests_without_processes_are_refused(tmp_path):
    failure = refusal(write(tmp_path, package("T", machine(), STATES, GROUPS)))
    assert [d.code for d in failure.diagnostics] == [codes.ADAPTIVE_ONLY.id]
