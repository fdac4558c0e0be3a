"""Project data of EB tresos: lists and choices, what is not set, and modules that are not read."""

from pathlib import Path

import pytest
from arxml_case import component, composition, every, found, named, orders, package, periods, read, refusal, write
from test_arxml_definitions import box, define
from test_arxml_ecus import mappings, on

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.exporters.arxml.codes import CANNOT_EDIT, DOUBLE_START, PHASE, UNKNOWN_EVENT
from halpipe.exporters.arxml.definitions import AGAINST_DEFINITION
from halpipe.exporters.arxml.onto.edit import Edit, apply_to_xdm
from halpipe.exporters.arxml.onto.plan import Placed, Planner
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.models.project import ProjectCounter
from merged_os import differences
from support import job, ms, schedule

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


# --------------------------------------------------------------------------------------- whole folders of a project


def settings(folder, *files):
    """What the importers of a project read."""
    entries = "".join(f'<d:ctr name="f"><d:var name="FileName" value="{name}"/></d:ctr>' for name in files)
    path = folder / ".prefs" / "pref_imp_exp_System.xdm"
    path.parent.mkdir()
    inputs = f'<d:lst name="InputFiles" type="MAP">{entries}</d:lst>'
    path.write_text(HEAD.split("<d:ctr")[0].split(" <d:")[0] + f'<d:ctr name="General">{inputs}</d:ctr></datamodel>')
    return path


def workspace(tmp_path, period="0.01", copied="0.01"):
    """A project in its folders, with a component in `system` and a copy of it in another folder."""
    root = tmp_path / "Car"
    config = root / "config"
    for folder in (config, root / "system", root / "output" / "generated", root / "old"):
        folder.mkdir(parents=True)
    project(config)
    (config / "system.arxml").unlink()
    for name, stated in (("system", period), ("output/generated", copied)):
        pump = component("Pump", every(stated, "A", "Pump/A"), every("0.01", "B", "Pump/B"), runnables="A B")
        write(root / name, package("T", pump, composition("Car", "p:Pump")))
    return root


def copy_of(root, **values):
    """An ARXML file with the OsTask Main of the project, its values, and another OsTask."""
    stated = [(f"Os{name}", text) for name, text in values.items()]
    parameters = "".join(
        f"<ECUC-NUMERICAL-PARAM-VALUE><DEFINITION-REF>/TS_T40D37M6I1R0/Os/OsTask/{name}</DEFINITION-REF>"
        f"<VALUE>{text}</VALUE></ECUC-NUMERICAL-PARAM-VALUE>"
        for name, text in stated
    )
    definition = "<DEFINITION-REF>/TS_T40D37M6I1R0/Os/OsTask</DEFINITION-REF>"
    tasks = "".join(
        named("ECUC-CONTAINER-VALUE", name, definition, f"<PARAMETER-VALUES>{inner}</PARAMETER-VALUES>")
        for name, inner in (("Main", parameters), ("Other", ""), *([("Gone", "")] if not values else []))
    )
    os = "<DEFINITION-REF>/TS_T40D37M6I1R0/Os</DEFINITION-REF>", f"<CONTAINERS>{tasks}</CONTAINERS>"
    counter = named("ECUC-CONTAINER-VALUE", "Ticks", "<DEFINITION-REF>/TS_T40D37M6I1R0/Os/OsCounter</DEFINITION-REF>")
    os = os[0], os[1].replace("</CONTAINERS>", f"{counter}</CONTAINERS>")
    content = package("Os", named("ECUC-MODULE-CONFIGURATION-VALUES", "Os", *os))
    return write(root / "output" / "generated", content, name="Os.arxml")


def test_another_module_is_accounted_for_and_settings_are_no_model(tmp_path):
    folder = project(tmp_path)
    xdm(folder, "Can", many("CanGeneral", ctr("g", var("CanMainFunctionPeriod", "0.01", "FLOAT"))))
    settings(folder, "system/*.arxml")
    imported = read(folder)
    assert not found(imported, codes.SKIPPED_FILE)
    assert ("ECUC-MODULE-CONFIGURATION-VALUES", 4, 3, 1) in imported.coverage.rows()


def test_equal_copies_are_one_element(tmp_path):
    root = workspace(tmp_path)
    copy_of(root, TaskPriority="0x0")
    text = (root / "config" / "Os.xdm").read_text()
    priority = var("OsTaskPriority", "0")
    (root / "config" / "Os.xdm").write_text(
        text.replace('<d:ctr name="Main" type="IDENTIFIABLE">', f'<d:ctr name="Main" type="IDENTIFIABLE">{priority}')
    )
    imported = read(root)
    assert not found(imported, codes.OTHER_COPY)
    assert periods(imported) == {"p/A": "10ms", "p/B": "10ms"}


def test_the_configuration_counts_and_not_its_copy(tmp_path):
    root = workspace(tmp_path)
    path = copy_of(root)
    (told,) = found(read(root), codes.OTHER_COPY)
    assert (told.at.file, told.path) == (str(path), "/Os/Os/Gone")
    assert f'"present" here, but "absent" at {root / "config" / "Os.xdm"}' in told.message
    copy_of(root, TaskPeriod="7")
    (told,) = found(read(root), codes.OTHER_COPY)
    assert (told.path, told.message.startswith('OsTaskPeriod is "7" here')) == ("/Os/Os/Main", True)


def test_what_the_system_states_counts_and_not_what_was_generated(tmp_path):
    root = workspace(tmp_path, copied="0.02")
    imported = read(root)
    (told,) = found(imported, codes.OTHER_COPY)
    assert "generated" in told.at.file
    assert 'PERIOD is "0.02" here, but "0.01" at ' in told.message
    assert periods(imported)["p/A"] == "10ms"


def test_what_the_importers_of_the_project_read_counts(tmp_path):
    root = workspace(tmp_path)
    (root / "output" / "generated" / "system.arxml").rename(root / "system" / "u.arxml")
    text = (root / "system" / "u.arxml").read_text()
    (root / "system" / "u.arxml").write_text(text.replace("0.01", "0.02"))
    told = {d.code for d in refusal(root).diagnostics if d.is_error}
    assert told == {codes.CONFLICT.id}
    settings(root, "System\\U.arxml", "output\\generated\\*.arxml")
    imported = read(root)
    assert {Path(d.at.file).name for d in found(imported, codes.OTHER_COPY)} == {"system.arxml"}
    assert periods(imported) == {"p/A": "20ms", "p/B": "20ms"}


def test_two_projects_are_not_one(tmp_path):
    root = workspace(tmp_path)
    other = tmp_path / "Other" / "config"
    other.mkdir(parents=True)
    xdm(other, "Os", COUNTER, TASKS.replace("Other", "Third"))
    failures = [d for d in refusal(tmp_path).diagnostics if d.is_error]
    assert {(d.code, d.at.file) for d in failures} == {(codes.CONFLICT.id, str(other / "Os.xdm"))}
    assert str(root / "config" / "Os.xdm") in failures[0].message
    xdm(other, "Os", COUNTER, TASKS)
    assert periods(read(tmp_path)) == {"p/A": "10ms", "p/B": "10ms"}


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


def put(folder, model, definitions=()):
    jobs = [job(model, "Main", 0, "2ms", "Core0")]
    lone = [job(model, task.name, 0, "6ms", "Core0") for task in model.tasks if task.name == "Other"]
    plan = schedule(model, 10, *jobs, *lone, mode_name="default")
    return export_onto(model, plan, str(folder), ArxmlImportOptions(), definitions)


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


def test_what_goes_into_the_files_of_the_project_has_to_fit_its_definitions(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(whole(folder))
    definitions = define(tmp_path, "Os", *(box(f"Os{name}") for name in ("Application", "Counter", "Task")))
    told = {d.message for d in put(folder, model, [definitions]).findings if d.code == AGAINST_DEFINITION.id}
    assert {"Os has no OsScheduleTable", "OsApplication has no OsAppScheduleTableRef"} <= told


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


# ----------------------------------------------------------------------------------- tables that generated code starts


def coded(folder, *, other="Slow"):
    """Main waits for an event every 10 ms and one every 20 ms, and Other runs every 20 ms; code starts two tables."""
    pump = component(
        "Pump",
        *(every(f"0.0{period}", name, f"Pump/{name}") for period, name in (("1", "A"), ("2", "B"), ("2", "C"))),
        runnables="A B C",
    )
    write(folder, package("T", pump, composition("Car", "p:Pump")))
    maps = [mapping(name.lower(), f"/T/Pump/B/{name}", str(at)) for at, name in enumerate("ABC")]
    maps[2] = maps[2].replace("/Os/Os/Main", "/Os/Os/Other")
    instance = ctr("p", ref("RteSoftwareComponentInstanceRef", "/T/Car/p"), many("RteEventToTaskMapping", *maps))
    xdm(folder, "Rte", many("RteSwComponentInstance", instance))
    events = "".join(f'<d:ref type="REFERENCE" value="ASPath:/Os/Os/{name}"/>' for name in ("Fast", "Slow", "Stop"))
    tasks = many("OsTask", ctr("Main", f'<d:lst name="OsTaskEventRef">{events}</d:lst>'), ctr("Other"))
    tables = many(
        "OsScheduleTable",
        coded_table("Schm", "20", {"0": [woken("Fast")], "10": [woken("Fast")], "15": [activated("Other")]}),
        coded_table("Rte", "40", {"0": [woken(other)], "20": [woken(other)]}),
    )
    xdm(folder, "Os", COUNTER, tasks, many("OsEvent", *map(ctr, ("Fast", "Slow", "Stop"))), tables)
    return folder


def coded_table(name, length, points):
    """A table without autostart, marked as calculated by the tool."""
    calculated = '<a:a name="IMPORTER_INFO" value="@CALC(SvcAs,os.scheduleTables,1)"/>'
    inner = [ctr(f"EP_{at}", var("OsScheduleTblExpPointOffset", at), *acts) for at, acts in points.items()]
    return ctr(
        name,
        calculated,
        var("OsScheduleTableDuration", length).replace("</d:var>", f"{calculated}</d:var>"),
        var("OsScheduleTableRepeating", "true", "BOOLEAN"),
        ref("OsScheduleTableCounterRef", "/Os/Os/Ticks"),
        ctr("OsScheduleTableAutostart", var("OsScheduleTableStartValue", "0"), enabled="false"),
        many("OsScheduleTableExpiryPoint", *inner),
    )


def woken(event):
    refs = ref("OsScheduleTableSetEventRef", f"/Os/Os/{event}"), ref("OsScheduleTableSetEventTaskRef", "/Os/Os/Main")
    return many("OsScheduleTableEventSetting", ctr(f"Set_{event}", *refs))


def activated(task):
    return many("OsScheduleTableTaskActivation", ctr("Act", ref("OsScheduleTableActivateTaskRef", f"/Os/Os/{task}")))


def plan_of(model, last=9):
    starts = {"Main@10ms": (3, 13), "Main@20ms": (6,), "Other": (last,)}
    unit = model.units[0].name
    jobs = [job(model, t, i, f"{at}ms", unit) for t, found in starts.items() for i, at in enumerate(found)]
    return schedule(model, 20, *jobs, mode_name="default")


def test_tables_that_code_starts_get_the_expiry_points_of_the_schedule(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(coded(folder))
    planned, original = plan_of(model), (folder / "Os.xdm").read_text()
    onto = export_onto(model, planned, str(folder), ArxmlImportOptions())
    assert [name for name in onto.files if name.startswith(("changed/", "delta"))] == ["changed/Os.xdm"]
    (told,) = [d for d in onto.findings if d.code == PHASE.id]
    assert "/Os/Os/Schm, /Os/Os/Rte" in told.message
    line = 1 + original[: original.index('<d:ctr name="Schm"')].count("\n")
    assert (told.path, Path(told.at.file).name, told.at.line) == ("/Os/Os/Schm", "Os.xdm", line)
    text = onto.files["changed/Os.xdm"].decode()
    (folder / "Os.xdm").write_text(text)
    origins = {task.name: task.origin.path for task in model.tasks}
    assert differences(folder, planned, origins, ("/Os/Os/Schm", "/Os/Os/Rte")) == ([], 4)
    assert [(t.name, t.period) for t in model_of(folder).tasks] == [(t.name, t.period) for t in model.tasks]
    before, after = (each.split('<d:lst name="OsScheduleTable"')[0] for each in (original, text))
    assert (before, "EP_" in text, text.count("At_")) == (after, False, 4)
    assert 'value="20"/>' in text[text.index('"Rte"') :]
    again = export_onto(model, planned, str(folder), ArxmlImportOptions())
    assert again.files["changed/Os.xdm"].decode().count("At_") == 4


def test_an_event_whose_rate_two_tables_make_is_not_known(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(coded(folder, other="Fast"))
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan_of(model), str(folder), ArxmlImportOptions())
    assert {d.code for d in failure.value.diagnostics if d.is_error} == {UNKNOWN_EVENT.id}


def test_a_table_whose_counter_is_too_coarse_is_refused(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(coded(folder))
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan_of(model, 9.5), str(folder), ArxmlImportOptions())
    assert {d.code for d in failure.value.diagnostics if d.is_error} == {DOUBLE_START.id}


def test_an_alarm_of_several_application_modes_loses_one_reference(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    whole(folder)
    text = (folder / "Os.xdm").read_text()
    refs = [f'<d:ref type="REFERENCE" value="ASPath:/Os/Os/{name}"/>' for name in ("OSDEFAULTAPPMODE", "Night")]
    modes = f'<d:lst name="OsAlarmAppModeRef">{"".join(refs)}</d:lst>'
    text = text.replace('<d:var name="OsAlarmAlarmTime"', f'{modes}<d:var name="OsAlarmAlarmTime"')
    text = text.replace('<d:ctr name="OSD', '<d:ctr name="Night" type="IDENTIFIABLE"/><d:ctr name="OSD')
    (folder / "Os.xdm").write_text(text)
    changed = put(folder, model_of(folder)).files["changed/Os.xdm"].decode()
    assert f'<d:lst name="OsAlarmAppModeRef">{refs[1]}</d:lst>' in changed
    assert changed.count('name="ENABLE" value="false"') == text.count('name="ENABLE" value="false"')


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_a_file_in_which_markup_is_not_ascii_is_refused(tmp_path, encoding):
    folder = tmp_path / "p"
    folder.mkdir()
    model = model_of(coded(folder))
    text = (folder / "Os.xdm").read_text().replace("<?xml version='1.0'?>", "<?xml version='1.0' encoding='utf-16'?>")
    (folder / "Os.xdm").write_bytes(text.encode(encoding))
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan_of(model), str(folder), ArxmlImportOptions())
    assert {d.code for d in failure.value.diagnostics if d.is_error} == {CANNOT_EDIT.id}


OFF = enable("false")


@pytest.mark.parametrize(
    ("tag", "content", "changed"),
    [
        ('<d:ctr name="S" type="T">', f'{enable("true")}<d:var name="V"/></d:ctr>', f'{OFF}<d:var name="V"/></d:ctr>'),
        ('<d:ctr name="S">', f"{enable('true')}</d:ctr>", f"{OFF}</d:ctr>"),
        ('<d:ctr name="S">', '<a:a name="X"/></d:ctr>', f'{OFF}<a:a name="X"/></d:ctr>'),
        ('<d:ctr name="S">', '<d:var name="ENABLE"/></d:ctr>', f'{OFF}<d:var name="ENABLE"/></d:ctr>'),
        ('<d:ctr name="S">', "</d:ctr>", f"{OFF}</d:ctr>"),
        ('<d:ctr name="S" type="T"/>', "", f"{OFF}</d:ctr>"),
        ('<d:ctr name="S" />', "", f"{OFF}</d:ctr>"),
    ],
)
def test_a_container_that_is_there_once_is_not_enabled_where_it_is_removed(tmp_path, tag, content, changed):
    stated, changed = tag + content, tag.replace(" />", ">").replace("/>", ">") + changed
    other = ctr("Other", ctr("S", enabled="true"))
    path = xdm(tmp_path, "Os", many("OsAlarm", ctr("Al", stated), other))
    edit = Edit(Location(str(path)), "/Os/Os/Al/S")
    text = path.read_text()
    assert apply_to_xdm(path.read_bytes(), "Os.xdm", None, [edit]).decode() == text.replace(stated, changed)
    whole = Edit(Location(str(path)), "/Os/Os/Other")  # of these there may be any number
    assert apply_to_xdm(path.read_bytes(), "Os.xdm", None, [whole]).decode() == text.replace(other, "")


def test_tables_begin_together_at_a_whole_tick_of_every_counter():
    """Ticks of 1 ms and 1.5 ms meet every 3 ms; 4 times is the first with a lead of 10 ms."""
    counters = [
        ProjectCounter(path=path, unit="u", tick=ms(tick), max_value=99, min_cycle=least, at=Location())
        for path, tick, least in (("/a", 1, 4), ("/b", "1.5ms", 3))
    ]
    for order in (1, -1):
        placed = [Placed(None, counter, {}) for counter in counters[::order]]
        assert [(p.counter.path, p.begin) for p in Planner._together(None, placed)] == [("/a", 12), ("/b", 8)][::order]
    assert list(Planner._together(None, [])) == []


def test_an_empty_element_at_the_end_of_another_is_removed_alone(tmp_path):
    path = xdm(tmp_path, "Os", many("OsAlarm", '<d:ctr name="A"/>', '<d:ctr name="B"/>').replace("\n", ""))
    text = path.read_text()
    edit = Edit(Location(str(path)), "/Os/Os/B")
    found = apply_to_xdm(path.read_bytes(), "Os.xdm", None, [edit]).decode()
    assert found == text.replace('<d:ctr name="B"/>', "")
