"""One ECU of a vehicle: its instances, cores and configuration; what it shares; what belongs to nobody."""

import pytest
from arxml_case import (
    assembly,
    component,
    composition,
    configuration,
    container,
    core,
    el,
    event,
    every,
    found,
    in_port,
    mapped,
    module,
    named,
    os_task,
    out_port,
    package,
    read,
    ref,
    refusal,
    rte,
    runnable,
    write,
)

from halpipe.importers.arxml import codes

PUMP = component(
    "Pump",
    every("0.01", "Tick", "Pump/Step"),
    runnables=[runnable("Step", writes=["Pump/out"])],
    ports=[out_port("out")],
)
VALVE = component(
    "Valve",
    every("0.02", "Tick", "Valve/Turn"),
    runnables=[runnable("Turn", reads=["Valve/in"])],
    ports=[in_port("in")],
)
FRONT, REAR = named("ECU-INSTANCE", "Front"), named("ECU-INSTANCE", "Rear")


def on(name, ecu, *steps):
    """An SWC-TO-ECU-MAPPING of the prototype at the end of the steps."""
    outer = [ref("CONTEXT-COMPONENT-REF", f"/T/{step}") for step in steps[:-1]]
    target = ref("TARGET-COMPONENT-REF", f"/T/{steps[-1]}")
    inside = el("COMPONENT-IREFS", el("COMPONENT-IREF", *outer, target))
    return named("SWC-TO-ECU-MAPPING", name, inside, ref("ECU-INSTANCE-REF", f"/T/{ecu}"))


def mappings(*entries, name="M"):
    return named("SYSTEM-MAPPING", name, el("SW-MAPPINGS", *entries))


CAR = composition("Car", "p:Pump v:Valve", assembly("c", "Car/p Pump/out", "Car/v Valve/in"))
SPLIT = mappings(on("a", "Front", "Car/p"), on("b", "Rear", "Car/v"))
VEHICLE = package("T", PUMP, VALVE, CAR, FRONT, REAR, SPLIT)


def ecuc(name, prototype, event_path, *cores, system="", instances=True):
    """The configuration of an ECU in a package of its own, with its collection."""
    prefix = f"/{name}"
    refs = [("OsAppTaskRef", f"{prefix}/Os/Main"), ("OsApplicationCoreRef", f"{prefix}/EcuC/{cores[0]}")]
    os = configuration("Os", os_task("Main"), os_task("Free"), container("Os/OsApplication", "App", refs=refs))
    map_ = mapped(event_path, "Main", "1").replace("/E/Os", f"{prefix}/Os")
    parts = configuration("Rte", rte(map_, prototype=prototype if instances else ""))
    hardware = configuration("EcuC", *(core(each, str(index)) for index, each in enumerate(cores)))
    entries = [
        el(
            "ECUC-MODULE-CONFIGURATION-VALUES-REF-CONDITIONAL",
            ref("ECUC-MODULE-CONFIGURATION-VALUES-REF", f"{prefix}/{m}"),
        )
        for m in ("Os", "Rte", "EcuC")
    ]
    extract = [ref("ECU-EXTRACT-REF", system)] if system else []
    collection = named("ECUC-VALUE-COLLECTION", "All", *extract, el("ECUC-VALUES", *entries))
    return package(name, os, parts, hardware, collection)


BOTH = (ecuc("E1", "Car/p", "Pump/B/Tick", "A0", "A1"), ecuc("E2", "Car/v", "Valve/B/Tick", "B0", "B1"))


def units(imported):
    return {task.name: task.versions[0].units for task in imported.model.tasks}


def test_several_ecus_are_listed_and_none_is_chosen_for_the_user(tmp_path):
    path = write(tmp_path, VEHICLE)
    (told,) = [d for d in refusal(path).diagnostics if d.code == codes.SEVERAL_ECUS.id]
    assert f"Front ({path}:" in told.message
    assert f"Rear ({path}:" in told.message
    assert "--ecu Front" in told.help


@pytest.mark.parametrize("name", ["Front", "/T/Front"])
def test_an_ecu_has_its_instances(tmp_path, name):
    imported = read(write(tmp_path, VEHICLE), ecu=name)
    assert (imported.model.name, set(units(imported))) == ("Front", {"p/Step"})


def test_an_unknown_ecu_suggests_one(tmp_path):
    (told,) = [d for d in refusal(write(tmp_path, VEHICLE), ecu="Frnt").diagnostics if d.code == codes.UNKNOWN_ECU.id]
    assert "Front" in told.help


@pytest.mark.parametrize(("ecu", "expected"), [("Front", {"p/Step": ("A0",)}), ("Rear", {"v/Turn": ("B0",)})])
def test_an_ecu_has_its_cores_and_configuration(tmp_path, ecu, expected):
    imported = read(write(tmp_path, VEHICLE, *BOTH), ecu=ecu)
    assert units(imported) == expected
    names = {"Front": ["A0", "A1"], "Rear": ["B0", "B1"]}[ecu]
    assert [unit.name for unit in imported.model.units] == names


def test_a_task_without_os_task_runs_on_the_cores_of_its_ecu_only(tmp_path):
    more = component("Fan", every("0.05", "Tick", "Fan/Blow"), runnables="Blow")
    car = composition("Car", "p:Pump v:Valve f:Fan")
    split = mappings(on("a", "Front", "Car/p"), on("b", "Rear", "Car/v"), on("d", "Rear", "Car/f"))
    path = write(tmp_path, package("T", PUMP, VALVE, more, car, FRONT, REAR, split), *BOTH)
    assert units(read(path, ecu="Rear", sources={"f/Blow": "50ms"}))["f/Blow"] == ("B0", "B1")


@pytest.mark.parametrize("way", ["system", "name"])
def test_ways_from_a_configuration_to_its_ecu(tmp_path, way):
    system = named("SYSTEM", "Extract", el("MAPPINGS", mappings(on("x", "Front", "Car/p"), name="X")))
    parts = [PUMP, VALVE, CAR, FRONT, REAR, SPLIT, *([system] if way == "system" else [])]
    names = ("One", "Two") if way == "system" else ("Config_Front", "Rear")
    first = ecuc(names[0], "", "Pump/B/Tick", "A0", system="/T/Extract" if way == "system" else "", instances=False)
    second = ecuc(names[1], "Car/v", "Valve/B/Tick", "B0")
    path = write(tmp_path, package("T", *parts), first, second)
    assert [unit.name for unit in read(path, ecu="Front").model.units] == ["A0"]


def test_a_configuration_of_nobody_is_named_and_left_out(tmp_path):
    lost = ecuc("Lost", "", "Pump/B/None", "Z0", instances=False)
    imported = read(write(tmp_path, VEHICLE, *BOTH, lost), ecu="Front")
    assert "Z0" not in {unit.name for unit in imported.model.units}
    (told,) = found(imported, codes.UNLINKED)
    assert told.path == 'ECU configuration "/Lost/All"'


def test_an_instance_inherits_the_ecu_of_the_composition_that_holds_it(tmp_path):
    inner = composition("Inner", "p:Pump q:Pump")
    car = composition("Car", "x:Inner y:Inner")
    split = mappings(on("a", "Front", "Car/x"), on("b", "Rear", "Car/y"), on("c", "Rear", "Car/x", "Inner/q"))
    path = write(tmp_path, package("T", PUMP, inner, car, FRONT, REAR, split))
    assert set(units(read(path, ecu="Front"))) == {"x/p/Step"}
    assert set(units(read(path, ecu="Rear"))) == {"x/q/Step", "y/p/Step", "y/q/Step"}


def test_an_instance_on_no_ecu_is_an_error(tmp_path):
    split = mappings(on("a", "Front", "Car/p"), on("b", "Rear", "Car/q"))
    path = write(tmp_path, package("T", PUMP, composition("Car", "p:Pump q:Pump r:Pump"), FRONT, REAR, split))
    (told,) = [d for d in refusal(path, ecu="Front").diagnostics if d.code == codes.UNMAPPED_COMPONENT.id]
    assert "r" in told.message


def test_a_module_of_the_basic_software_is_on_the_ecus_that_configure_it(tmp_path):
    com = module("Com", event("BSW-TIMING-EVENT", "T", "Com/Main", el("PERIOD", "0.005")), entities="Main")
    own = container("Rte/RteBswModuleInstance", "Com", mapped("Com/B/T", "Main", "2", bsw=True).replace("/E/", "/E1/"))
    first = BOTH[0]
    start = first.index("<CONTAINERS>", first.index("<SHORT-NAME>Rte</SHORT-NAME>")) + len("<CONTAINERS>")
    first = first[:start] + own + first[start:]
    path = write(tmp_path, package("T", PUMP, VALVE, CAR, com, FRONT, REAR, SPLIT), first, BOTH[1])
    assert set(units(read(path, ecu="Front"))) == {"p/Step", "BSW/Com/Main"}
    assert set(units(read(path, ecu="Rear"))) == {"v/Turn"}


@pytest.mark.parametrize("ecus", [(), (FRONT, REAR)], ids=["none", "without software"])
def test_two_configurations_of_an_os_are_two_ecus(tmp_path, ecus):
    path = write(tmp_path, package("T", PUMP, VALVE, CAR, *ecus), *BOTH)
    (told,) = [d for d in refusal(path).diagnostics if d.code == codes.SEVERAL_ECUS.id]
    assert told.message.startswith(f"2 ECUs have an Os: /E1/All ({path}:")
    assert told.help == "choose one: --ecu /E1/All"
    assert units(read(path, ecu="/E1/All")) == {"p/Step": ("A0",)}
    assert units(read(path, ecu="/E2/All")) == {"v/Turn": ("B0",)}


def test_the_only_ecu_with_software_is_chosen_where_another_has_an_os(tmp_path):
    one = package("T", PUMP, composition("Car", "p:Pump"), FRONT, REAR, mappings(on("a", "Front", "Car/p")))
    path = write(tmp_path, one, BOTH[0], ecuc("Rear", "", "Pump/B/Tick", "B0", "B1", instances=False))
    (told,) = [d for d in refusal(path).diagnostics if d.code == codes.SEVERAL_ECUS.id]
    assert told.help == "choose one: --ecu Front"
    imported = read(path, ecu="Front")
    assert units(imported) == {"p/Step": ("A0",)}
    assert [unit.name for unit in imported.model.units] == ["A0", "A1"]


def test_a_configuration_that_a_vendor_proposes_is_no_ecu(tmp_path):
    proposed = package("Proposed", configuration("Os", container("Os/OsOS", "Os")))
    path = write(tmp_path, package("T", PUMP, VALVE, CAR), BOTH[0], proposed)
    assert "p/Step" in units(read(path))


def test_a_component_on_two_ecus_is_a_contradiction(tmp_path):
    split = mappings(on("a", "Front", "Car/p"), on("b", "Rear", "Car/v"), on("c", "Rear", "Car/p"))
    path = write(tmp_path, package("T", PUMP, VALVE, CAR, FRONT, REAR, split))
    for ecu in ("Front", "Rear"):
        (told,) = {d for d in refusal(path, ecu=ecu).diagnostics if d.code == codes.CONFLICT.id}
        assert told.message.startswith('the ECU of /T/Car/p is "/T/Rear" here, but "/T/Front" at')


def test_flat_extracts_of_two_ecus_are_not_one_system_without_a_word(tmp_path):
    def extract(name, composed, ecu=""):
        root = named("ROOT-SW-COMPOSITION-PROTOTYPE", "R", ref("SOFTWARE-COMPOSITION-TREF", f"/T/{composed}"))
        on_it = [el("MAPPINGS", mappings(on("a", ecu, f"{composed}/x")))] if ecu else []
        return named("SYSTEM", name, *on_it, el("ROOT-SOFTWARE-COMPOSITIONS", root))

    flats = [composition("Flat1", "x:Pump"), composition("Flat2", "x:Valve")]
    parts = [PUMP, VALVE, FRONT, REAR, *flats]
    path = write(tmp_path, package("T", *parts, extract("S1", "Flat1"), extract("S2", "Flat2")))
    (told,) = found(read(path), codes.SEVERAL_ROOTS)
    assert told.message == "is the root of a system, but so is /T/Flat2: they are imported as one"
    path = write(tmp_path, package("T", *parts, extract("S1", "Flat1", "Front"), extract("S2", "Flat2", "Rear")))
    imported = read(path, ecu="Rear")
    assert set(units(imported)) == {"x/Turn"}
    assert not found(imported, codes.SEVERAL_ROOTS)
