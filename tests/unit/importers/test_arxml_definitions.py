"""Exported ECU configurations held against definitions of modules, as a vendor's configurator does."""

import pytest
from arxml_case import (
    component,
    configuration,
    container,
    core,
    counter,
    el,
    every,
    mapped,
    named,
    os_task,
    package,
    ref,
    rte,
    write,
)

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml import FORMAT, ArxmlOptions
from halpipe.exporters.arxml.definitions import (
    AGAINST_DEFINITION,
    CONTRADICTION,
    NO_DEFINITIONS,
    NO_VALUE,
    check,
    read_definitions,
)
from halpipe.exporters.arxml.document import Box
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from support import job, model, schedule, task, version

HEAD = '<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES><AR-PACKAGE><SHORT-NAME>V</SHORT-NAME><ELEMENTS>'
COUNTER = "/AUTOSAR/EcucDefs/Os/OsCounter"
TAIL = "</ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>"


def definition(kind, name, *inside, lower=1, upper=1, more=""):
    """A definition of a container, parameter or reference."""
    groups = {}
    for text in inside:
        tag = text[1 : text.index(">")]
        group = "SUB-CONTAINERS" if "CONTAINER" in tag else "REFERENCES" if "REFERENCE" in tag else "PARAMETERS"
        groups[group] = groups.get(group, "") + text
    most = "<UPPER-MULTIPLICITY-INFINITE>true</UPPER-MULTIPLICITY-INFINITE>" if upper is None else ""
    most = most or f"<UPPER-MULTIPLICITY>{upper}</UPPER-MULTIPLICITY>"
    content = "".join(f"<{group}>{text}</{group}>" for group, text in groups.items())
    return (
        f"<ECUC-{kind}-DEF><SHORT-NAME>{name}</SHORT-NAME><LOWER-MULTIPLICITY>{lower}</LOWER-MULTIPLICITY>"
        f"{most}{more}{content}</ECUC-{kind}-DEF>"
    )


def box(name, *inside, **counts):
    return definition("PARAM-CONF-CONTAINER", name, *inside, **counts)


def define(folder, module, *containers):
    """A module that refines the standard one of its name."""
    refined = f"<REFINED-MODULE-DEF-REF>/AUTOSAR/EcucDefs/{module}</REFINED-MODULE-DEF-REF>"
    text = f"<ECUC-MODULE-DEF><SHORT-NAME>{module}</SHORT-NAME>{refined}<CONTAINERS>{''.join(containers)}</CONTAINERS>"
    path = folder / f"{module}_def.arxml"
    path.write_text(f"{HEAD}{text}</ECUC-MODULE-DEF>{TAIL}")
    return str(path)


def configured(tmp_path, *, priority="5", word="FULL", tasks=1, target="/E/Os/Ticks"):
    """A configuration of an Os with OsTasks that refer to a counter."""
    kind = "/Vendor/X/Os/OsTask"
    words = el("ECUC-TEXTUAL-PARAM-VALUE", ref("DEFINITION-REF", f"{kind}/OsTaskSchedule"), el("VALUE", word))
    number = el("ECUC-NUMERICAL-PARAM-VALUE", ref("DEFINITION-REF", f"{kind}/OsTaskPriority"), el("VALUE", priority))
    refs = el("ECUC-REFERENCE-VALUE", ref("DEFINITION-REF", f"{kind}/OsTaskCounter"), ref("VALUE-REF", target))
    found = [
        named(
            "ECUC-CONTAINER-VALUE",
            f"T{i}",
            ref("DEFINITION-REF", kind),
            el("PARAMETER-VALUES", number, words),
            el("REFERENCE-VALUES", refs),
        )
        for i in range(tasks)
    ]
    other = container("Os/OsAlarm", "Al")
    text = package("E", configuration("Os", container("Os/OsCounter", "Ticks"), *found, other))
    return write(tmp_path, text).read_bytes()


def os_definition(tmp_path):
    task = box(
        "OsTask",
        definition("INTEGER-PARAM", "OsTaskPriority", more="<MAX>9</MAX><MIN>1</MIN>"),
        definition(
            "ENUMERATION-PARAM",
            "OsTaskSchedule",
            more="<LITERALS><ECUC-ENUMERATION-LITERAL-DEF><SHORT-NAME>FULL</SHORT-NAME>"
            "</ECUC-ENUMERATION-LITERAL-DEF></LITERALS>",
        ),
        definition(
            "REFERENCE", "OsTaskCounter", more="<DESTINATION-REF>/AUTOSAR/EcucDefs/Os/OsCounter</DESTINATION-REF>"
        ),
        lower=0,
        upper=2,
    )
    return define(tmp_path, "Os", task, box("OsCounter", lower=0, upper=None), box("OsAlarm", lower=0, upper=None))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""),
        ({"priority": "10"}, "OsTaskPriority is 10, outside of 1 to 9"),
        ({"priority": "0"}, "OsTaskPriority is 0, outside of 1 to 9"),
        ({"priority": "9"}, ""),
        ({"priority": "1"}, ""),
        ({"word": "HALF"}, 'OsTaskSchedule is "HALF", not one of FULL'),
        ({"tasks": 2}, ""),
        ({"tasks": 3}, "has 3 OsTask, of which there may be 2"),
        ({"target": "/E/Os/Al"}, "OsTaskCounter leads to /E/Os/Al, which is no OsCounter"),
    ],
)
def test_values_have_to_fit_their_definitions(tmp_path, change, said):
    found = check(configured(tmp_path, **change), read_definitions([os_definition(tmp_path)]))
    assert {diagnostic.message for diagnostic in found} == ({said} if said else set())


def test_what_is_missing_or_unknown_is_named(tmp_path):
    path = define(tmp_path, "Os", box("OsTask", lower=0, upper=None), box("OsCounter"), box("OsOS"))
    told = {d.message for d in check(configured(tmp_path), read_definitions([path]))}
    unknown = {f"OsTask has no OsTask{name}" for name in ("Priority", "Schedule", "Counter")}
    assert told == {"has 0 OsOS, of which there must be 1", "Os has no OsAlarm", *unknown}


def test_of_a_module_that_nothing_defines_nothing_is_known(tmp_path):
    path = define(tmp_path, "Rte", box("RteGeneration"))
    (told,) = check(configured(tmp_path), read_definitions([path]))
    assert (told.code, "no definition of /Vendor/X/Os" in told.message) == (AGAINST_DEFINITION.id, True)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "a.arxml").write_text(HEAD + TAIL)
    with pytest.raises(HalpipeError) as failure:
        read_definitions([str(tmp_path / "empty")])
    assert failure.value.diagnostics[0].code == NO_DEFINITIONS.id


def flag(name):
    return definition("BOOLEAN-PARAM", name)


RTE = (
    box(
        "RteBswGeneral",
        *(definition("BOOLEAN-PARAM", f"Rte{n}") for n in ("SchMVersionInfoApi", "UseComShadowSignalApi")),
    ),
    box("RteGeneration", *map(flag, ("RteVfbTraceEnabled", "RteDevErrorDetect"))),
    box("RteInitializationBehavior", definition("STRING-PARAM", "RteSectionInitializationPolicy", upper=None)),
    box("RteOsInteraction"),
    box(
        "RteSwComponentInstance",
        definition("FOREIGN-REFERENCE", "RteSoftwareComponentInstanceRef", lower=0),
        box(
            "RteEventToTaskMapping",
            flag("RteImmediateRestart"),
            definition("INTEGER-PARAM", "RtePositionInTask", lower=0),
            definition("FOREIGN-REFERENCE", "RteEventRef"),
            definition("REFERENCE", "RteMappedToTaskRef", lower=0),
            definition("REFERENCE", "RteUsedOsSchTblExpiryPointRef", lower=0),
            lower=0,
            upper=None,
        ),
        lower=0,
        upper=None,
    ),
)


def test_the_own_configuration_of_the_rte_keeps_the_counts_of_the_standard(tmp_path):
    system = model(task("fast", 10, version("v", 1, "u")), task("slow", 20, version("v", 1, "u")), units="u")
    jobs = [job(system, "fast", 0, 0, "u"), job(system, "fast", 1, 10, "u"), job(system, "slow", 0, 5, "u")]
    plan = schedule(system, 20, *jobs)
    options = ArxmlOptions(ecuc_definitions=(define(tmp_path, "Rte", *RTE),))
    found = FORMAT.remarks(system, plan, options, FORMAT.write(system, plan, options))
    told = [d.message for d in found if "Rte" in d.path or "Rte" in d.message]
    known = {"RteCalibrationSupport", "RteCodeVendorId", "RteDevErrorDetectUninit", "RteMeasurementSupport"}
    known |= {"RteValueRangeCheckEnabled", "RteGenerationMode", "RteOptimizationMode"}
    assert set(told) == {f"RteGeneration has no {n}" for n in known} | {
        "RteInitializationBehavior has no RteInitializationStrategy"
    }


def vendor(tmp_path):
    """Definitions with a number for each core, a stack for each OsTask, and parts that only a controller decides."""
    values = definition("INTEGER-PARAM", "Stack", more="<DEFAULT-VALUE>512</DEFAULT-VALUE>")
    word = definition("ENUMERATION-PARAM", "Class", more="<DEFAULT-VALUE>SC1</DEFAULT-VALUE>")
    published = "<IMPLEMENTATION-CONFIG-CLASSES><X><CONFIG-CLASS>PUBLISHED-INFORMATION</CONFIG-CLASS></X>"
    release = definition("STRING-PARAM", "Release", more=f"{published}</IMPLEMENTATION-CONFIG-CLASSES>")
    define(
        tmp_path,
        "Os",
        box("OsTask", values, lower=0, upper=None),
        box("OsApplication", definition("INTEGER-PARAM", "OsApplicationCoreAssignment"), lower=0, upper=None),
        box("Debug", word, box("Inner", word)),
        box("Silicon", word, definition("STRING-PARAM", "Name"), box("Pin", flag("On"), upper=None), upper=None),
        box("OsOS", definition("REFERENCE", "First", more="<DESTINATION-REF>/V/Os/Silicon/Pin</DESTINATION-REF>")),
        box("Published", release),
    )
    define(tmp_path, "EcuC", box("General", word, lower=0))
    define(tmp_path, "Rte", *RTE, box("RtePostBuildVariantConfiguration", flag("RtePostBuildUsedPredefinedVariant")))
    (tmp_path / "Os_def.arxml").rename(tmp_path / "Os.bmd")
    system = model(task("fast", 10, version("v", 1, "u")), units="u")
    return system, schedule(system, 10, job(system, "fast", 0, 0, "u"))


def test_the_own_configuration_has_what_the_vendor_proposes_and_no_core_in_two_ways(tmp_path):
    system, plan = vendor(tmp_path)
    state(tmp_path, "a.arxml", silicon())
    data = FORMAT.write(system, plan, ArxmlOptions(ecuc_definitions=(str(tmp_path),), ecuc_prefix="/Other"))
    text = data[""].decode()
    assert [text.count(f">{value}</VALUE>") for value in ("512", "SC1")] == [1, 3]
    assert [text.count(f">/{prefix}/Os<") for prefix in ("V", "Other")] == [1, 0]
    assert [f"/{name}<" in text for name in ("OsApplicationCoreAssignment", "OsApplicationCoreRef")] == [True, False]
    assert "EcucHardware" not in text
    assert text.index("<PREDEFINED-VARIANT>") < text.index(
        'DEST="PREDEFINED-VARIANT">/M/Ecu/Only<'.replace("/M", f"/{system.name}")
    )


def silicon(*, name="TC0", on="1", target="/Pre/Os_Pre/Chip/A"):
    """Containers of a configuration: those that the vendor demands, and one that nothing demands."""
    text = el("ECUC-TEXTUAL-PARAM-VALUE", ref("DEFINITION-REF", "/V/Os/Silicon/Name"), el("VALUE", name))
    on = el("ECUC-NUMERICAL-PARAM-VALUE", ref("DEFINITION-REF", "/V/Os/Silicon/Pin/On"), el("VALUE", on))
    first = el("ECUC-REFERENCE-VALUE", ref("DEFINITION-REF", "/V/Os/OsOS/First"), ref("VALUE-REF", target))
    inner = bare("Os/Silicon/Pin", "A", el("PARAMETER-VALUES", on))
    return (
        bare("Os/Silicon", "Chip", el("PARAMETER-VALUES", text), el("SUB-CONTAINERS", inner)),
        bare("Os/OsOS", "Kernel", el("REFERENCE-VALUES", first)),
        bare("Os/OsTask", "Idle"),
    )


def bare(kind, name, *inside):
    return named("ECUC-CONTAINER-VALUE", name, ref("DEFINITION-REF", f"/V/{kind}"), *inside)


def state(folder, file, containers):
    """A configuration of the Os beside the definitions."""
    values = named(
        "ECUC-MODULE-CONFIGURATION-VALUES", "Os_Pre", ref("DEFINITION-REF", "/V/Os"), el("CONTAINERS", *containers)
    )
    write(folder, package("Pre", values), name=file)


def told_of(system, plan, tmp_path):
    with pytest.raises(HalpipeError) as failure:
        FORMAT.write(system, plan, ArxmlOptions(ecuc_definitions=(str(tmp_path),)))
    return {(d.code, d.message) for d in failure.value.diagnostics}


def test_what_no_definition_proposes_is_refused_unless_a_configuration_states_it(tmp_path):
    system, plan = vendor(tmp_path)
    parts = ("Silicon/Name", "Silicon/Pin/On", "OsOS/First")
    assert told_of(system, plan, tmp_path) == {(NO_VALUE.id, f"nothing states /V/Os/{part}") for part in parts}
    state(tmp_path, "a.arxml", silicon())
    state(tmp_path, "b.arxml", silicon(on="true"))  # the same
    options = ArxmlOptions(ecuc_definitions=(str(tmp_path),))
    data = FORMAT.write(system, plan, options)
    text = data[""].decode()
    assert f">/{system.name}/Ecu/Os/Chip/A</VALUE-REF>" in text
    assert ">TC0</VALUE>" in text
    assert ("Os_Pre" in text, "<SHORT-NAME>Idle</SHORT-NAME>" in text) == (False, False)
    about_silicon = [d.message for d in FORMAT.remarks(system, plan, options, data) if "Silicon" in d.message + d.path]
    assert about_silicon == []


def test_what_is_added_takes_no_name_of_another_container(tmp_path):
    vendor(tmp_path)
    state(tmp_path, "a.arxml", silicon())
    systems = {name: model(task(name, 10, version("v", 1, "u")), units="u") for name in ("Debug", "Chip")}
    plans = {name: schedule(system, 10, job(system, name, 0, 0, "u")) for name, system in systems.items()}
    options = ArxmlOptions(ecuc_definitions=(str(tmp_path),))
    text = FORMAT.write(systems["Debug"], plans["Debug"], options)[""].decode()
    assert [text.count(f"/V/Os/{kind}</DEFINITION-REF>") for kind in ("OsTask", "Debug")] == [1, 1]
    assert "<SHORT-NAME>Debug_2</SHORT-NAME>" in text
    ((code, message),) = told_of(systems["Chip"], plans["Chip"], tmp_path)
    assert (code, message) == (
        NO_VALUE.id,
        'nothing states /V/Os/Silicon under a name that is free, unlike "Chip"',
    )


def test_configurations_that_contradict_each_other_are_refused(tmp_path):
    system, plan = vendor(tmp_path)
    state(tmp_path, "a.arxml", silicon())
    state(tmp_path, "b.arxml", silicon(name="TC1"))
    ((code, message),) = told_of(system, plan, tmp_path)
    assert (code, '"TC0"' in message, '"TC1"' in message, "b.arxml:" in message) == (CONTRADICTION.id, True, True, True)


def test_a_stated_reference_to_what_is_not_written_is_named(tmp_path):
    system, plan = vendor(tmp_path)
    state(tmp_path, "a.arxml", silicon(target="/Pre/Os_Pre/Gone"))
    options = ArxmlOptions(ecuc_definitions=(str(tmp_path),))
    told = [d.message for d in FORMAT.remarks(system, plan, options, FORMAT.write(system, plan, options))]
    assert f"First leads to /{system.name}/Ecu/Os/Gone, which is not in the configuration" in told


def test_a_vendor_whose_os_has_no_schedule_tables_is_named(tmp_path):
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    os = configuration("Os", counter(), os_task("Main"))
    maps = configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1")))
    write(tmp_path, package("T", pump), package("E", os, maps, configuration("EcuC", core("First", "0"))))
    define(tmp_path, "Os", box("OsTask", lower=0, upper=None), box("OsCounter", lower=0, upper=None))
    overlay = tmp_path.parent / "wcet.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n')
    found = import_model("arxml", [str(tmp_path)], ArxmlImportOptions(overlays=(str(overlay),))).model
    plan = schedule(found, 10, job(found, "Pump/Step", 0, "0ms", "First"), mode_name="default")
    told = {d.message for d in export_onto(found, plan, str(tmp_path), ArxmlImportOptions()).findings}
    assert "Os has no OsScheduleTable" in told


def test_a_document_with_a_long_text_is_held_against_definitions(tmp_path):
    """Exports hold the native model as one text; parsers refuse ten million characters unless they are told."""
    definitions = read_definitions([os_definition(tmp_path)])
    remark = b"<DESC><L-2 L='EN'>" + b"x" * 10_000_001 + b"</L-2></DESC>"
    document = configured(tmp_path).replace(b"</SHORT-NAME>", b"</SHORT-NAME>" + remark, 1)
    assert check(document, definitions) == []


def sole(kind, name, *inside):
    """A definition that states no multiplicities: there is just one."""
    return definition(kind, name, *inside, lower="X", upper="Y").replace(
        "<LOWER-MULTIPLICITY>X</LOWER-MULTIPLICITY><UPPER-MULTIPLICITY>Y</UPPER-MULTIPLICITY>", ""
    )


@pytest.mark.parametrize(
    ("count", "said"),
    [(0, "has 0 OsTask, of which there must be 1"), (1, ""), (2, "has 2 OsTask, of which there may be 1")],
)
def test_of_what_states_no_multiplicity_there_is_one(tmp_path, count, said):
    inner = [
        definition(kind, f"OsTask{name}", lower=0)
        for kind, name in (("INTEGER-PARAM", "Priority"), ("STRING-PARAM", "Schedule"), ("REFERENCE", "Counter"))
    ]
    task, others = (
        sole("PARAM-CONF-CONTAINER", "OsTask", *inner),
        [box(name, lower=0) for name in ("OsCounter", "OsAlarm")],
    )
    definitions = read_definitions([define(tmp_path, "Os", task, *others)])
    assert [d.message for d in check(configured(tmp_path, tasks=count), definitions)] == [said] * bool(said)


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ((), False),
        (("tool",), False),
        (("halpipe:delta",), True),
        (("tool", "halpipe:delta"), True),
        (("halpipe:delta", "tool"), True),
    ],
)
def test_of_a_part_the_containers_that_it_adds_are_complete(tmp_path, groups, said):
    path = define(tmp_path, "Os", box("OsTask", definition("INTEGER-PARAM", "OsTaskPriority")))
    data = "".join(f'<SDG GID="{group}"/>' for group in groups)
    marked = el("ADMIN-DATA", el("SDGS", data)) if groups else ""
    lone = named("ECUC-CONTAINER-VALUE", "T", marked, ref("DEFINITION-REF", "/Vendor/X/Os/OsTask"))
    document = write(tmp_path, package("E", configuration("Os", lone))).read_bytes()
    found = check(document, read_definitions([path]), is_part=True)
    assert [d.message for d in found] == ["has 0 OsTaskPriority, of which there must be 1"] * said
    assert len(check(document, read_definitions([path]))) == 1


def test_a_container_refers_to_another_once():
    held = Box("/E/Os/T", "/X/Os/OsTask", repeated={"OsTaskEventRef": ["/E/Os/Known"]})
    for name, path in (
        ("OsTaskEventRef", "/E/Os/New"),
        ("OsTaskEventRef", "/E/Os/Known"),
        ("OtherRef", "/E/Os/Known"),
    ) * 2:
        held.refer(name, path)
    assert [(found.name, found.path) for found in held.refs] == [
        ("OsTaskEventRef", "/E/Os/New"),
        ("OtherRef", "/E/Os/Known"),
    ]


def test_a_number_without_a_least_one_is_shown_from_0(tmp_path):
    inner = definition("INTEGER-PARAM", "OsTaskPriority", more="<MAX>9</MAX>")
    others = [
        definition(kind, f"OsTask{name}") for kind, name in (("STRING-PARAM", "Schedule"), ("REFERENCE", "Counter"))
    ]
    path = define(tmp_path, "Os", box("OsTask", inner, *others), box("OsCounter"), box("OsAlarm"))
    found = check(configured(tmp_path, priority="10"), read_definitions([path]))
    assert [d.message for d in found] == ["OsTaskPriority is 10, outside of 0 to 9"]
