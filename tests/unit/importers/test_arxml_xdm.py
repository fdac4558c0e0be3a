"""Project data of EB tresos: lists and choices, what is not set, and modules that are not read."""

import pytest
from arxml_case import component, composition, every, found, named, orders, package, periods, read, refusal, write
from test_arxml_ecus import mappings, on

from halpipe.core.diagnostics import HalpipeError
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from support import job, schedule

HEAD = """<?xml version='1.0'?>
<datamodel version="7.0" xmlns="http://www.tresos.de/_projects/DataModel2/16/root.xsd"
    xmlns:a="http://www.tresos.de/_projects/DataModel2/16/attribute.xsd"
    xmlns:d="http://www.tresos.de/_projects/DataModel2/06/data.xsd">
 <d:ctr type="AUTOSAR" factory="autosar"><d:lst type="TOP-LEVEL-PACKAGES">
 <d:ctr name="{name}" type="AR-PACKAGE"><d:lst type="ELEMENTS">
 <d:chc name="{name}" type="AR-ELEMENT" value="MODULE-CONFIGURATION"><d:ctr type="MODULE-CONFIGURATION">
 <a:a name="DEF" value="ASPath:/TS_T40D37M6I1R0/{name}"/>
"""
TAIL = "\n</d:ctr></d:chc></d:lst></d:ctr></d:lst></d:ctr></datamodel>\n"


def xdm(folder, name, *content):
    path = folder / f"{name}.xdm"
    path.write_text(HEAD.format(name=name) + "\n".join(content) + TAIL)
    return path


def enable(value):
    return f'<a:a name="ENABLE" value="{value}"/>' if value is not None else ""


def var(name, value, kind="INTEGER", enabled=None):
    return f'<d:var name="{name}" type="{kind}" value="{value}">{enable(enabled)}</d:var>'


def ref(name, value="", enabled=None):
    stated = f' value="ASPath:{value}"' if value else ""
    return f'<d:ref name="{name}" type="REFERENCE"{stated}>{enable(enabled)}</d:ref>'


def ctr(name, *content, enabled=None):
    return f'<d:ctr name="{name}" type="IDENTIFIABLE">{enable(enabled)}' + "\n".join(content) + "</d:ctr>"


def many(name, *content):
    return f'<d:lst name="{name}" type="MAP">' + "\n".join(content) + "</d:lst>"


def alarm(chosen="OsAlarmActivateTask", *, unit="TICKS", cycle="10", autostart=True):
    action = "\n".join(
        [
            ctr("OsAlarmActivateTask", ref("OsAlarmActivateTaskRef", "/Os/Os/Main")),
            ctr(
                "OsAlarmSetEvent", ref("OsAlarmSetEventRef", "/Os/Os/Go"), ref("OsAlarmSetEventTaskRef", "/Os/Os/Other")
            ),
        ]
    )
    start = ctr(
        "OsAlarmAutostart",
        var("OsTimeUnit", unit, "ENUMERATION", "true"),
        var("OsAlarmAlarmTime", "0"),
        var("OsAlarmCycleTime", cycle),
        enabled=autostart if autostart is True else "false",
    )
    return many(
        "OsAlarm",
        ctr(
            "Al",
            ref("OsAlarmCounterRef", "/Os/Os/Ticks"),
            f'<d:chc name="OsAlarmAction" type="IDENTIFIABLE" value="{chosen}">{action}</d:chc>',
            start,
        ),
    )


COUNTER = many("OsCounter", ctr("Ticks", var("OsSecondsPerTick", "0.001", "FLOAT", "true")))
TASKS = many("OsTask", ctr("Main"), ctr("Other"))


def test_alarms_activate_the_chosen_task(tmp_path):
    assert periods(read(xdm(tmp_path, "Os", COUNTER, TASKS, alarm()))) == {"Main": "10ms"}
    assert periods(read(xdm(tmp_path, "Os", COUNTER, TASKS, alarm("OsAlarmSetEvent")))) == {"Other": "10ms"}


def test_times_may_be_nanoseconds(tmp_path):
    path = xdm(tmp_path, "Os", COUNTER, TASKS, alarm(unit="NANOSECONDS", cycle="2500000"))
    assert periods(read(path)) == {"Main": "2.5ms"}


def test_what_is_not_enabled_is_not_set(tmp_path):
    path = xdm(tmp_path, "Os", COUNTER, TASKS, alarm(autostart=False))
    assert codes.NO_TASKS.id in {d.code for d in refusal(path).diagnostics}
    off = many("OsCounter", ctr("Ticks", var("OsSecondsPerTick", "0.001", "FLOAT", "FALSE")))
    path = xdm(tmp_path, "Os", off, TASKS, alarm())
    assert codes.NO_TICK.id in {d.code for d in refusal(path).diagnostics}


def test_a_list_or_a_module_that_is_not_enabled_is_empty(tmp_path):
    lists = TASKS.replace('type="MAP">', f'type="MAP">{enable("false")}')
    assert codes.NO_TASKS.id in {d.code for d in refusal(xdm(tmp_path, "Os", COUNTER, lists, alarm())).diagnostics}
    path = xdm(tmp_path, "Os", enable("false"), COUNTER, TASKS, alarm())
    assert codes.NO_TASKS.id in {d.code for d in refusal(path).diagnostics}


def mapping(name, event, position, *, offset_enabled="false"):
    return ctr(
        name,
        ref("RteEventRef", event),
        ref("RteMappedToTaskRef", "/Os/Os/Main", "TRUE"),
        ref("RteUsedOsSchTblExpiryPointRef", "", "false"),
        var("RtePositionInTask", position, enabled="true"),
        var("RteActivationOffset", "0.002", "FLOAT", offset_enabled),
    )


def project(folder, **options):
    pump = component("Pump", every("0.01", "A", "Pump/A"), every("0.01", "B", "Pump/B"), runnables="A B")
    write(folder, package("T", pump, composition("Car", "p:Pump")))
    xdm(folder, "Os", COUNTER, TASKS)
    maps = many(
        "RteEventToTaskMapping",
        mapping("a", "/T/Pump/B/A", "2", **options),
        mapping("b", "/T/Pump/B/B", "1", **options),
    )
    instance = ctr("p", ref("RteSoftwareComponentInstanceRef", "/T/Car/p"), maps)
    xdm(folder, "Rte", many("RteSwComponentInstance", instance))
    cores = many("EcucCoreDefinition", ctr("Core0", var("EcucCoreId", "0")))
    xdm(folder, "EcuC", many("EcucHardware", ctr("Hw", cores)))
    return folder


@pytest.mark.parametrize(("enabled", "offset"), [("false", "None"), ("true", "2ms")])
def test_a_project_is_its_configuration_with_the_components_beside_it(tmp_path, enabled, offset):
    imported = read(project(tmp_path, offset_enabled=enabled))
    assert orders(imported) == {"p/B > p/A"}
    assert {str(task.offset) for task in imported.model.tasks} == {offset}
    assert [unit.name for unit in imported.model.units] == ["Core0"]
    assert all(read == mapped + ignored for _, read, mapped, ignored in imported.coverage.rows())


def test_every_element_keeps_its_line(tmp_path):
    imported = read(project(tmp_path))
    lines = (tmp_path / "EcuC.xdm").read_text().splitlines()
    origin = imported.model.units[0].origin
    assert (origin.path, "Core0" in lines[origin.line - 1]) == ("/EcuC/EcuC/Hw/Core0", True)


def test_a_list_of_references_is_several(tmp_path):
    refs = "".join(f'<d:ref type="REFERENCE" value="ASPath:/Os/Os/{name}"/>' for name in ("Main", "Other"))
    application = many(
        "OsApplication",
        ctr("App", f'<d:lst name="OsAppTaskRef">{refs}</d:lst>', var("OsApplicationCoreAssignment", "3")),
    )
    tasks = many("OsTask", *(ctr(name, var("OsTaskPeriod", "0.01", "FLOAT")) for name in ("Main", "Other")))
    imported = read(xdm(tmp_path, "Os", tasks, application))
    assert {task.versions[0].units for task in imported.model.tasks} == {("core3",)}


def test_another_module_is_refused_by_name_and_skipped_in_a_folder(tmp_path):
    path = xdm(tmp_path, "Can", many("CanGeneral"))
    (told,) = [d for d in refusal(path).diagnostics if d.code == codes.EB_XDM.id]
    assert "configures Can" in told.message
    project(tmp_path)
    (skipped,) = found(read(tmp_path), codes.SKIPPED_FILE)
    assert "configures Can" in skipped.message


def test_a_project_is_one_ecu_whatever_its_system_describes(tmp_path):
    """The system of a vehicle maps components to two ECUs; a workspace of the tool configures one of them."""
    project(tmp_path)
    parts = named("ECU-INSTANCE", "Front"), named("ECU-INSTANCE", "Rear")
    other = component("Fan", every("0.02", "C", "Fan/C"), runnables="C"), composition("Box", "f:Fan")
    split = mappings(on("a", "Front", "Car/p"), on("b", "Rear", "Box/f"))
    write(tmp_path, package("T", *parts, *other, split), name="vehicle.arxml")
    imported = read(tmp_path)
    assert {task.name for task in imported.model.tasks} == {"p/A", "p/B"}
    assert [unit.name for unit in imported.model.units] == ["Core0"]
    (tmp_path / "EcuC.xdm").unlink()
    assert [unit.name for unit in read(tmp_path).model.units] == ["core0"]


# --------------------------------------------------------------------------------------- schedules put onto projects


def model_of(folder):
    overlay = folder.parent / "wcet.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n')
    options = ArxmlImportOptions(granularity="ostask", overlays=(str(overlay),))
    return import_model("arxml", [str(folder)], options).model


def put(folder, model):
    jobs = [job(model, "Main", 0, "2ms", "Core0")]
    lone = [job(model, task.name, 0, "6ms", "Core0") for task in model.tasks if task.name == "Other"]
    return export_onto(model, schedule(model, 10, *jobs, *lone, mode_name="default"), str(folder), ArxmlImportOptions())


def whole(folder):
    """A project with an OsApplication, an empty list of schedule tables, and an OsTask that an alarm activates."""
    project(folder)
    application = ctr(
        "App",
        '<d:lst name="OsAppTaskRef"><d:ref type="REFERENCE" value="ASPath:/Os/Os/Main"/>'
        '<d:ref type="REFERENCE" value="ASPath:/Os/Os/Other"/></d:lst>',
        '<d:lst name="OsAppScheduleTableRef"/>',
        var("OsApplicationCoreAssignment", "0", enabled="true"),
    )
    other = alarm().replace("/Os/Os/Main", "/Os/Os/Other")
    modes = many("OsAppMode", ctr("OSDEFAULTAPPMODE"))
    empty = '<d:lst name="OsScheduleTable" type="MAP"/>'
    xdm(folder, "Os", COUNTER, TASKS, other, many("OsApplication", application), modes, empty)
    return folder


def test_a_schedule_goes_into_the_files_of_the_project(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(whole(folder))
    onto = put(folder, model)
    sealed = ["changes.json", "manifest.json", "model.xml", "schedule.xml"]
    assert sorted(onto.files) == ["changed/Os.xdm", "changed/Rte.xdm", *sealed]
    os, rte = (onto.files[f"changed/{name}.xdm"].decode() for name in ("Os", "Rte"))
    assert '<d:lst name="OsScheduleTable" type="MAP"><d:ctr name="Halpipe_default_Core0"' in os
    assert '<d:lst name="OsAppScheduleTableRef"><d:ref type="REFERENCE"' in os
    assert (
        '<d:ref name="RteUsedOsSchTblExpiryPointRef" type="REFERENCE" '
        'value="ASPath:/Os/Os/Halpipe_default_Core0/At_2"><a:a name="ENABLE" value="true"/></d:ref>'
    ) in rte
    assert {change.file for change in onto.changes} == {"Os.xdm", "Rte.xdm"}
    stopped = os[os.index('name="OsAlarmAutostart"') :]
    assert stopped.index('name="ENABLE" value="false"') < stopped.index("OsTimeUnit")
    original = (folder / "Rte.xdm").read_text()
    assert original.splitlines()[:8] == rte.splitlines()[:8]
    assert len(original.splitlines()) == len(rte.splitlines())


def test_the_changed_project_is_the_same_model(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(whole(folder))
    onto = put(folder, model)
    for name in ("Os.xdm", "Rte.xdm"):
        (folder / name).write_bytes(onto.files[f"changed/{name}"])
    again = model_of(folder)

    def facts(system):
        return [
            (t.name, t.period, t.offset, t.versions[0].units, [p.task for p in t.versions[0].precedences])
            for t in system.tasks
        ]

    assert facts(again) == facts(model)
    with pytest.raises(HalpipeError) as refused:
        put(folder, model)
    assert {d.code for d in refused.value.diagnostics if d.is_error} == {"HAL0884"}
