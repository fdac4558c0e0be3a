"""Component instances, execution units, and the account of every element."""

import pytest
from arxml_case import (
    component,
    composition,
    configuration,
    container,
    core,
    el,
    event,
    every,
    found,
    mapped,
    module,
    named,
    os_task,
    package,
    periods,
    read,
    ref,
    refusal,
    rte,
    write,
)
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import Findings
from halpipe.exporters.native import format_model
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.system.reading import read_tree
from halpipe.importers.native import parse_model

PUMP = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")


# ------------------------------------------------------------------------------------------------- instances


def test_every_use_of_a_type_is_an_instance(tmp_path):
    inner = composition("Inner", "a:Pump b:Pump")
    car = composition("Car", "x:Inner y:Inner p:Pump")
    imported = read(write(tmp_path, package("T", PUMP, inner, car)))
    assert set(periods(imported)) == {"x/a/Step", "x/b/Step", "y/a/Step", "y/b/Step", "p/Step"}
    assert ("SW-COMPONENT-PROTOTYPE", 5, 5, 0) in imported.coverage.rows()


def test_the_root_composition_of_the_system_counts(tmp_path):
    root = named("ROOT-SW-COMPOSITION-PROTOTYPE", "Top", ref("SOFTWARE-COMPOSITION-TREF", "/T/Car"))
    system = named("SYSTEM", "S", el("ROOT-SOFTWARE-COMPOSITIONS", root))
    parts = [PUMP, composition("Car", "p:Pump"), composition("Other", "q:Pump"), system]
    imported = read(write(tmp_path, package("T", *parts)))
    assert set(periods(imported)) == {"p/Step"}
    assert imported.model.name == "Top"
    assert imported.model.origin.path == "/T/S/Top"


def test_a_composition_inside_itself_is_refused(tmp_path):
    car = composition("Car", "p:Pump self:Car")
    root = named("ROOT-SW-COMPOSITION-PROTOTYPE", "Top", ref("SOFTWARE-COMPOSITION-TREF", "/T/Car"))
    (error,) = found(refusal(write(tmp_path, package("T", PUMP, car, root))), codes.TOO_MANY)
    assert (error.message, error.path) == ("is a part of itself", 'composition "/T/Car"')


@pytest.mark.parametrize("levels", [32, 33])
def test_compositions_nest_up_to_a_limit_and_are_refused_beyond(tmp_path, levels):
    """None is left out: the component of the innermost is a task, or the import ends."""
    inner = [composition(f"C{n}", f"c:C{n + 1}" if n < levels else "p:Pump") for n in range(1, levels + 1)]
    path = write(tmp_path, package("T", PUMP, *inner))
    if levels == 32:
        assert list(periods(read(path))) == ["c/" * 31 + "p/Step"]
    else:
        (error,) = found(refusal(path), codes.TOO_MANY)
        assert (error.message, error.path) == ("is nested in more than 31 compositions", 'composition "/T/C33"')


def test_instances_of_the_same_name_are_told_apart(tmp_path):
    left, right = composition("Left", "p:Pump"), composition("Right", "p:Pump")
    imported = read(write(tmp_path, package("T", PUMP, left, right)))
    assert set(periods(imported)) == {"T/Left/p/Step", "T/Right/p/Step"}
    assert len(found(imported, codes.RENAMED)) == 2


def test_an_event_is_mapped_per_instance(tmp_path):
    os = configuration(
        "Os",
        os_task("One"),
        os_task("Two"),
        container(
            "Os/OsApplication",
            "A",
            params={"OsApplicationCoreAssignment": "0"},
            refs=[("OsAppTaskRef", "/E/Os/One")],
        ),
        container(
            "Os/OsApplication",
            "B",
            params={"OsApplicationCoreAssignment": "1"},
            refs=[("OsAppTaskRef", "/E/Os/Two")],
        ),
    )
    mappings = configuration(
        "Rte",
        rte(mapped("Pump/B/Tick", "One"), prototype="Car/l"),
        rte(mapped("Pump/B/Tick", "Two"), prototype="Car/r"),
    )
    car = composition("Car", "l:Pump r:Pump")
    imported = read(write(tmp_path, package("T", PUMP, car), package("E", os, mappings)))
    assert {task.name: task.versions[0].units for task in imported.model.tasks} == {
        "l/Step": ("core0",),
        "r/Step": ("core1",),
    }


# ----------------------------------------------------------------------------------------------------- units

HARDWARE = configuration("EcuC", core("Second", "1"), core("First", "0"))


@pytest.mark.parametrize("prefix", ["/AUTOSAR/EcucDefs", "/MICROSAR", "/MICROSAR/CANoeOsekEmu", "/ArcCore/Os/Generic"])
def test_definitions_are_known_by_what_follows_the_module_name(tmp_path, prefix):
    os = [
        container("Os/OsTask", "Main", prefix=prefix),
        container(
            "Os/OsApplication",
            "App",
            prefix=prefix,
            refs=[("OsAppTaskRef", "/E/Os/Main"), ("OsApplicationCoreRef", "/E/EcuC/Second")],
        ),
    ]
    parts = [
        configuration("Os", *os, prefix=prefix),
        HARDWARE,
        configuration("Rte", rte(mapped("Pump/B/Tick", "Main"))),
    ]
    imported = read(write(tmp_path, package("T", PUMP), package("E", *parts)))
    assert [unit.name for unit in imported.model.units] == ["First", "Second"]
    assert imported.model.tasks[0].versions[0].units == ("Second",)
    assert {("OsTask", 1, 1, 0), ("OsApplication", 1, 1, 0)} <= set(imported.coverage.rows())


@pytest.mark.parametrize(
    "way",
    [
        [("OsApplicationCoreRef", "/E/EcuC/Second")],
        [("OsApplicationCoreRef", "/E/Os/Core")],
        [("OsAppEcucPartitionRef", "/E/EcuC/Part")],
    ],
    ids=["core", "OsCore", "partition"],
)
def test_ways_from_an_application_to_its_core(tmp_path, way):
    os = configuration(
        "Os",
        os_task("Main"),
        container("Os/OsCore", "Core", refs=[("OsCoreEcucCoreRef", "/E/EcuC/Second")]),
        container("Os/OsApplication", "App", refs=[("OsAppTaskRef", "/E/Os/Main"), *way]),
    )
    partition = container("EcuC/EcucPartition", "Part", refs=[("EcucPartitionCoreRef", "/E/EcuC/Second")])
    ecuc = configuration("EcuC", core("Second", "1"), core("First", "0"), partition)
    mappings = configuration("Rte", rte(mapped("Pump/B/Tick", "Main")))
    imported = read(write(tmp_path, package("T", PUMP), package("E", os, ecuc, mappings)))
    assert imported.model.tasks[0].versions[0].units == ("Second",)


def test_unmapped_tasks_may_run_on_every_core(tmp_path):
    imported = read(write(tmp_path, package("T", PUMP), package("E", HARDWARE)))
    assert imported.model.tasks[0].versions[0].units == ("First", "Second")
    assert [d.what for d in imported.coverage.defaulted_values] == ["units"]


def test_one_ecu_names_the_model_and_its_core(tmp_path):
    target = el("COMPONENT-IREFS", el("COMPONENT-IREF", ref("TARGET-COMPONENT-REF", "/T/Car/p")))
    mapping = named("SWC-TO-ECU-MAPPING", "M", target, ref("ECU-INSTANCE-REF", "/T/Front"))
    parts = [PUMP, composition("Car", "p:Pump"), named("ECU-INSTANCE", "Front"), mapping]
    imported = read(write(tmp_path, package("T", *parts)))
    assert (imported.model.name, [unit.name for unit in imported.model.units]) == ("Front", ["core0"])


def test_the_user_may_name_the_model(tmp_path):
    path = write(tmp_path, package("T", PUMP))
    assert read(path).model.name == "arxml"
    assert read(path, name="my car").model.name == "my_car"


# ------------------------------------------------------------------------------------------------- the account


def test_every_element_is_accounted_for_once(tmp_path):
    server = event("OPERATION-INVOKED-EVENT", "Call", "Pump/Serve")
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), server, runnables="Step Serve Never")
    com = module("Com", entities="Main")
    unrelated = named("CLIENT-SERVER-INTERFACE", "If", named("CLIENT-SERVER-OPERATION", "Op"))
    path = write(tmp_path, package("T", pump, com, unrelated), package("E", HARDWARE))
    imported = read(path)
    nodes = list(read_tree([str(path)], Findings()).nodes())
    rows = imported.coverage.rows()
    assert sum(read for _, read, _, _ in rows) == len(nodes)
    assert all(read == mapped + ignored for _, read, mapped, ignored in rows)
    reasons = {element.name: element.reason for element in imported.coverage.ignored_elements}
    assert {("AR-PACKAGE", 2, 2, 0), ("SWC-INTERNAL-BEHAVIOR", 1, 1, 0)} <= set(rows)
    assert reasons["/T/If/Op"] == "no influence on timing"
    assert reasons["/T/Pump/B/Call"] == "server call: runs within its client"
    assert reasons["/T/Pump/B/Never"] == "no event starts it"
    assert reasons["/T/Com"] == "has no periodic runnable"
    assert all(element.at.file == str(path) and element.at.line for element in imported.coverage.ignored_elements)


def test_every_task_unit_and_mode_has_an_origin(tmp_path):
    imported = read(write(tmp_path, package("T", PUMP), package("E", HARDWARE)))
    for element in (*imported.model.units, *imported.model.tasks):
        assert element.origin.line
        assert element.origin.path.startswith("/")


@given(order=st.permutations(range(4)))
def test_the_order_of_files_changes_neither_tasks_nor_account(tmp_path_factory, order):
    directory = tmp_path_factory.mktemp("split")
    parts = [
        package("T", PUMP),
        package("T", composition("Car", "p:Pump")),
        package("E", HARDWARE),
        package("E", configuration("Os", os_task("Main")), configuration("Rte", rte(mapped("Pump/B/Tick", "Main")))),
    ]
    paths = [write(directory, part, name=f"{index}.arxml") for index, part in enumerate(parts)]
    first, second = read(*paths), read(*[paths[index] for index in order])
    assert first.model == second.model
    assert first.coverage.rows() == second.coverage.rows()


def test_an_imported_model_survives_being_written_and_read(tmp_path):
    imported = read(write(tmp_path, package("T", PUMP), package("E", HARDWARE)))
    assert parse_model(format_model(imported.model), "model.xml") == imported.model
