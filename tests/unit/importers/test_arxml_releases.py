"""One small project in each release: imported, scheduled, exported, read again, and put onto itself and played."""

import re

import pytest
from arxml_case import FIXTURES, container, found, read, refusal
from test_arxml_onto import model_of, project

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.exporters.arxml import FORMAT, RELEASES, ArxmlOptions
from halpipe.flow.formats import check_bundle, import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.arxml.system.reading import read_system, read_tree
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from support import model, task, version


def planned(model):
    return schedule_model(model, SearchOptions(seed=1), lambda *_: True).schedule


def check_own_export(folder, model, plan, release):
    """The export comes back as it was; without the native model in it, its elements give the same tasks."""
    folder.mkdir()
    path = folder / "own.arxml"
    path.write_bytes(FORMAT.write(model, plan, ArxmlOptions(release=release))[""])
    again = import_model("arxml", [str(path)], ArxmlImportOptions())
    assert (again.model, again.diagnostics) == (model, ())
    path.write_bytes(path.read_bytes().replace(b'GID="halpipe:model"', b'GID="other"'))
    tasks = import_model("arxml", [str(path)], ArxmlImportOptions()).model.tasks
    assert {(t.period, t.versions[0].wcet) for t in tasks} == {(t.period, t.versions[0].wcet) for t in model.tasks}


def test_times_of_several_units_come_back_without_the_native_model(tmp_path):
    spans = {"one": "a", "two": "a b", "three": "b c d", "all": "a b c d"}
    tasks = [task(name, "10ms", version("v", f"{n}ms", units)) for n, (name, units) in enumerate(spans.items(), 1)]
    system = model(*tasks, units="a b c d")
    path = tmp_path / "own.arxml"
    path.write_bytes(FORMAT.write(system, None, ArxmlOptions())[""].replace(b'GID="halpipe:model"', b'GID="other"'))
    found = import_model("arxml", [str(path)], ArxmlImportOptions()).model.tasks
    assert {t.name.partition("/")[0]: " ".join(t.versions[0].units) for t in found} == spans


@pytest.mark.parametrize(("release", "schema"), RELEASES.items())
def test_a_project_of_release_4_goes_all_the_way(tmp_path, release, schema):
    source = tmp_path / "in"
    source.mkdir()
    path = project(source, events=["Go"], more=[container("Os/OsAppMode", "OSDEFAULTAPPMODE")])
    header = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="http://autosar.org/schema/r4.0 '
    path.write_text(path.read_text().replace("<AUTOSAR ", f'<AUTOSAR {header}{schema}" ', 1))
    model = model_of(path)
    plan = planned(model)
    check_own_export(tmp_path / "own", model, plan, release)
    onto = export_onto(model, plan, str(source), ArxmlImportOptions())
    assert f" {schema}".encode() in onto.files["delta.arxml"]
    write_directory(str(tmp_path / "out"), onto.files)
    checked = check_bundle(str(tmp_path / "out"), CheckOptions())
    assert (checked.diagnostics, checked.lines[0]) == ((), "3 actions on 2 OsTasks in 20ms")


@pytest.mark.parametrize("release", ["3.1.5", "3.2.3"])
def test_a_project_of_release_3_is_scheduled_and_exported_but_not_extended(tmp_path, release):
    source = tmp_path / "in"
    source.mkdir()
    path = source / "system.arxml"
    header = '<AUTOSAR xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="{0} x.xsd" xmlns="{0}"'
    text = (FIXTURES / "release3.arxml").read_text()
    path.write_text(re.sub('<AUTOSAR xmlns="[^"]*"', header.format(f"http://autosar.org/{release}"), text))
    model = model_of(path)
    plan = planned(model)
    check_own_export(tmp_path / "own", model, plan, "R22-11")
    with pytest.raises(HalpipeError) as refused:
        export_onto(model, plan, str(source), ArxmlImportOptions())
    assert [d.code for d in refused.value.diagnostics if d.is_error] == [codes.NO_CONFIGURATION.id]


# ------------------------------------------------------------------------------------------ configurations of release 3


def old_box(kind, name, *content, tag="CONTAINER"):
    return f"<{tag}><SHORT-NAME>{name}</SHORT-NAME><DEFINITION-REF>/V/{kind}</DEFINITION-REF>{''.join(content)}</{tag}>"


def old_values(kind, **values):
    kinds = {bool: "BOOLEAN", int: "INTEGER", float: "FLOAT", str: "ENUMERATION"}
    entries = [
        f'<{kinds[type(value)]}-VALUE><DEFINITION-REF DEST="{kinds[type(value)]}-PARAM-DEF">/V/{kind}/{name}'
        f"</DEFINITION-REF><VALUE>{str(value).lower() if value is True else value}</VALUE></{kinds[type(value)]}-VALUE>"
        for name, value in values.items()
    ]
    return f"<PARAMETER-VALUES>{''.join(entries)}</PARAMETER-VALUES>"


def old_refs(kind, **refs):
    entries = [
        f"<REFERENCE-VALUE><DEFINITION-REF>/V/{kind}/{name}</DEFINITION-REF>"
        f'<VALUE-REF DEST="CONTAINER">/E/Os/{target}</VALUE-REF></REFERENCE-VALUE>'
        for name, target in refs.items()
    ]
    return f"<REFERENCE-VALUES>{''.join(entries)}</REFERENCE-VALUES>"


def old_project(tmp_path, *more):
    """Release 3: a counter of 1 ms, the OsTask T, and a collection of the modules."""
    counter = old_box("Os/OsCounter", "C", old_values("Os/OsCounter", OsSecondsPerTick=0.001))
    inside = f"<CONTAINERS>{counter}{old_box('Os/OsTask', 'T')}{''.join(more)}</CONTAINERS>"
    modules = "".join(f'<MODULE-REF DEST="MODULE-CONFIGURATION">/E/{name}</MODULE-REF>' for name in ("Os", "Rte"))
    named = f"<ECU-CONFIGURATION><SHORT-NAME>Ecu</SHORT-NAME><MODULE-REFS>{modules}</MODULE-REFS></ECU-CONFIGURATION>"
    os = old_box("Os", "Os", inside, tag="MODULE-CONFIGURATION")
    path = tmp_path / "os.arxml"
    path.write_text(
        '<AUTOSAR xmlns="http://autosar.org/3.1.5"><TOP-LEVEL-PACKAGES><AR-PACKAGE><SHORT-NAME>E</SHORT-NAME>'
        f"<ELEMENTS>{named}{os}</ELEMENTS></AR-PACKAGE></TOP-LEVEL-PACKAGES></AUTOSAR>"
    )
    return path


def old_table(**begin):
    table, point = "Os/OsScheduleTable", "Os/OsScheduleTable/OsScheduleTableExpiryPoint"
    action = f"{point}/OsScheduleTableTaskActivation"
    act = old_box(action, "A", old_refs(action, OsScheduleTableActivateTaskRef="T"))
    at = old_values(point, OsScheduleTblExpPointOffset=3)
    start = old_box(f"{table}/OsScheduleTableAutostart", "S", old_values(f"{table}/OsScheduleTableAutostart", **begin))
    inside = (
        f"<SUB-CONTAINERS>{old_box(point, 'P', at, f'<SUB-CONTAINERS>{act}</SUB-CONTAINERS>')}{start}</SUB-CONTAINERS>"
    )
    values = old_values(table, OsScheduleTableDuration=20, OsScheduleTableRepeating=True)
    return old_box(table, "Table", values, old_refs(table, OsScheduleTableCounterRef="C"), inside)


@pytest.mark.parametrize(
    ("begin", "offset"),
    [
        (
            {"OsScheduleTableAutostartType": "ABSOLUTE", "OsScheduleTableAbsValue": 2, "OsScheduleTableRelOffset": 9},
            "5ms",
        ),
        (
            {"OsScheduleTableAutostartType": "RELATIVE", "OsScheduleTableAbsValue": 2, "OsScheduleTableRelOffset": 9},
            "12ms",
        ),
        ({"OsScheduleTableAutostartType": "ABSOLUTE", "ArcCoreOsScheduleTableOffset": 1}, "4ms"),
    ],
)
def test_a_table_of_release_3_begins_at_its_start_value(tmp_path, begin, offset):
    (task,) = read(old_project(tmp_path, old_table(**begin))).model.tasks
    assert (str(task.period), str(task.offset)) == ("20ms", offset)


def test_a_configuration_of_release_3_names_its_modules(tmp_path):
    (told,) = found(read(old_project(tmp_path, old_table(ArcCoreOsScheduleTableOffset=1))), codes.ABSENT_MODULE)
    assert "names /E/Rte, which no file defines" in told.message


def test_instances_of_release_3_have_two_names(tmp_path):
    text = (FIXTURES / "release3.arxml").read_text()
    path = tmp_path / "system.arxml"
    for name in ("SoftwareComponentPrototypeRef", "SoftwareComponentInstanceRef", "OtherRef"):
        path.write_text(text.replace("SoftwareComponentPrototypeRef", name))
        system = read_system(read_tree([str(path)], Findings()))
        assert bool(system.configured) == (name != "OtherRef"), name


def test_alarms_of_release_2_count_seconds(tmp_path):
    alarm, start = "Os/OsAlarm", "Os/OsAlarm/OsAlarmAutostart"
    action = f"{alarm}/OsAlarmAction/OsAlarmActivateTask"
    act = old_box(action, "Act", old_refs(action, OsAlarmActivateTaskRef="T"))
    for cycle in (10, 10.0):
        begin = old_box(start, "S", old_values(start, OsAlarmAlarmTime=0, OsAlarmCycleTime=cycle))
        inside = f"<SUB-CONTAINERS>{act}{begin}</SUB-CONTAINERS>"
        path = old_project(tmp_path, old_box(alarm, "A", old_refs(alarm, OsAlarmCounterRef="C"), inside))
        if cycle == 10 and isinstance(cycle, int):
            assert [str(task.period) for task in read(path).model.tasks] == ["10ms"]
        else:
            told = {d.code: d for d in refusal(path).diagnostics}
            assert "1 times of its OS configuration are seconds" in told[codes.OLD_TIMES.id].message
