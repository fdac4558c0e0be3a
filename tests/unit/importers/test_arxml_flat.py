"""Instances of the Rte configuration: in flat compositions of a file, explained by a flat map, or known to nobody."""

import pytest
from arxml_case import (
    component,
    composition,
    configuration,
    container,
    el,
    every,
    found,
    mapped,
    named,
    os_task,
    package,
    read,
    ref,
    write,
)

from halpipe.importers.arxml import codes

PUMP = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")


def ecu(*prototypes):
    """Instances of the Rte (paths), each with the event of the pump mapped to an OsTask of its own."""
    instances = [
        container(
            "Rte/RteSwComponentInstance",
            f"I{index}",
            mapped("Pump/B/Tick", f"Main{index}", "1"),
            refs=[("RteSoftwareComponentInstanceRef", prototype)],
        )
        for index, prototype in enumerate(prototypes)
    ]
    tasks = [os_task(f"Main{index}") for index in range(len(prototypes))]
    return package("E", configuration("Os", *tasks), configuration("Rte", *instances))


def descriptor(name, flat, *steps):
    root = ref("CONTEXT-ELEMENT-REF", "/T/Sys/Root", dest="ROOT-SW-COMPOSITION-PROTOTYPE")
    inner = [ref("CONTEXT-ELEMENT-REF", step, dest="SW-COMPONENT-PROTOTYPE") for step in steps[:-1]]
    upstream = ref("TARGET-REF", steps[-1], dest="SW-COMPONENT-PROTOTYPE")
    return named(
        "FLAT-INSTANCE-DESCRIPTOR",
        name,
        el("UPSTREAM-REFERENCE-IREF", root, *inner, upstream),
        el("ECU-EXTRACT-REFERENCE-IREF", ref("TARGET-REF", flat, dest="SW-COMPONENT-PROTOTYPE")),
    )


def hosts(path):
    """Instance label to the OsTask that runs it, from the ostask granularity."""
    model = read(path, granularity="ostask").model
    return {task.name: task.origin.path.partition(": ")[2] for task in model.tasks}


def test_equal_names_and_types_are_the_same_instance(tmp_path):
    car = composition("Car", "a:Pump b:Pump")
    path = write(tmp_path, package("T", PUMP, car), ecu("/Flat/Root/b", "/Flat/Root/a"))
    assert hosts(path) == {"Main0": "b/Step", "Main1": "a/Step"}
    assert not found(read(path), codes.DANGLING)


def test_the_flat_map_tells_nested_instances_apart(tmp_path):
    inner, car = composition("Inner", "p:Pump"), composition("Car", "x:Inner y:Inner")
    flat_map = named(
        "FLAT-MAP",
        "Map",
        el(
            "INSTANCES",
            descriptor("p_1", "/Flat/Root/p_1", "/T/Car/y", "/T/Inner/p"),
            descriptor("p_2", "/Flat/Root/p_2", "/T/Car/x", "/T/Inner/p"),
        ),
    )
    path = write(tmp_path, package("T", PUMP, inner, car, flat_map), ecu("/Flat/Root/p_1", "/Flat/Root/p_2"))
    assert hosts(path) == {"Main0": "y/p/Step", "Main1": "x/p/Step"}


def test_the_only_instance_of_a_type_needs_no_name(tmp_path):
    path = write(tmp_path, package("T", PUMP, composition("Car", "a:Pump")), ecu("/Flat/Root/other"))
    assert hosts(path) == {"Main0": "a/Step"}


def test_without_any_composition_the_rte_names_the_instances(tmp_path):
    path = write(tmp_path, package("T", PUMP), ecu("/Flat/Root/left", "/Flat/Root/right"))
    assert hosts(path) == {"Main0": "left/Step", "Main1": "right/Step"}
    assert {task.name for task in read(path).model.tasks} == {"left/Step", "right/Step"}


def test_a_flat_composition_that_no_system_names_is_a_root(tmp_path):
    car, flat = composition("Car", "a:Pump"), composition("Flat", "a_flat:Pump")
    root = named("ROOT-SW-COMPOSITION-PROTOTYPE", "Root", ref("SOFTWARE-COMPOSITION-TREF", "/T/Car"))
    system = named("SYSTEM", "Sys", el("ROOT-SOFTWARE-COMPOSITIONS", root))
    path = write(tmp_path, package("T", PUMP, car, flat, system), ecu("/T/Flat/a_flat"))
    assert hosts(path) == {"Main0": "a_flat/Step"}


@pytest.mark.parametrize("prototypes", ["a:Pump b:Pump", "a:Pump b:Pump c:Pump"])
def test_what_could_be_several_instances_is_reported_not_guessed(tmp_path, prototypes):
    path = write(tmp_path, package("T", PUMP, composition("Car", prototypes)), ecu("/Flat/Root/unknown"))
    imported = read(path)
    (told,) = found(imported, codes.DANGLING)
    assert "RteSoftwareComponentInstanceRef" in told.message
    assert "/Flat/Root/unknown" in told.message
    assert "1 event mappings are lost" in told.message
    reasons = {e.kind: e.reason for e in imported.coverage.ignored_elements}
    assert reasons["RteEventToTaskMapping"] == "its component instance is in no file"
