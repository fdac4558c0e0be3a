"""Check of an export onto a project: the merged OS is played, and whatever differs from the schedule is an error."""

import json

import pytest

from command_line import run_here
from halpipe.core.bundles import CHANGED_FILE, NOT_A_BUNDLE
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import sha256, write_directory
from halpipe.deploy.arxml.check import OTHERWISE
from halpipe.deploy.base import CheckOptions
from halpipe.flow.formats import check_bundle, import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions

NAMESPACE = "http://autosar.org/schema/r4.0"


def container(kind, name, *inside, values=None, refs=()):
    """A configuration container of the Os by the path of its definition."""
    parameters = "".join(
        f"<ECUC-NUMERICAL-PARAM-VALUE><DEFINITION-REF>/D/{kind}/{key}</DEFINITION-REF><VALUE>{value}</VALUE>"
        "</ECUC-NUMERICAL-PARAM-VALUE>"
        for key, value in (values or {}).items()
    )
    references = "".join(
        f"<ECUC-REFERENCE-VALUE><DEFINITION-REF>/D/{kind}/{key}</DEFINITION-REF><VALUE-REF>{path}</VALUE-REF>"
        "</ECUC-REFERENCE-VALUE>"
        for key, path in refs
    )
    return (
        f"<ECUC-CONTAINER-VALUE><SHORT-NAME>{name}</SHORT-NAME><DEFINITION-REF>/D/{kind}</DEFINITION-REF>"
        f"<PARAMETER-VALUES>{parameters}</PARAMETER-VALUES><REFERENCE-VALUES>{references}</REFERENCE-VALUES>"
        f"<SUB-CONTAINERS>{''.join(inside)}</SUB-CONTAINERS></ECUC-CONTAINER-VALUE>"
    )


def alarm(name, task, cycle, event="", mode="OSDEFAULTAPPMODE"):
    """An alarm that starts with the OS, and activates an OsTask or sets an event."""
    kind = "Os/OsAlarm/OsAlarmAction"
    ref = ("OsAlarmSetEventRef", f"/E/Os/{event}") if event else ("OsAlarmActivateTaskRef", f"/E/Os/{task}")
    start = container(
        "Os/OsAlarm/OsAlarmAutostart",
        "Begin",
        values={"OsAlarmCycleTime": cycle, "OsAlarmAlarmTime": 0},
        refs=[("OsAlarmAppModeRef", f"/E/Os/{mode}")],
    )
    action = container(kind, "Act", container(f"{kind}/Do", "Do", refs=[ref]))
    return container("Os/OsAlarm", name, start, action, refs=[("OsAlarmCounterRef", "/E/Os/Ticks")])


def project(folder, *more):
    """Two OsTasks, activated every 10 and woken every 20 ms."""
    os = [
        container("Os/OsAppMode", "OSDEFAULTAPPMODE"),
        container("Os/OsCounter", "Ticks", values={"OsSecondsPerTick": "0.001"}),
        container("Os/OsEvent", "Wake"),
        container("Os/OsTask", "Fast", values={"OsTaskPriority": 2}),
        container("Os/OsTask", "Slow", values={"OsTaskPriority": 1}, refs=[("OsTaskEventRef", "/E/Os/Wake")]),
        alarm("Every10", "Fast", 10),
        alarm("Every20", "Slow", 20, "Wake"),
        *more,
    ]
    module = (
        "<ECUC-MODULE-CONFIGURATION-VALUES><SHORT-NAME>Os</SHORT-NAME><DEFINITION-REF>/D/Os</DEFINITION-REF>"
        f"<CONTAINERS>{''.join(os)}</CONTAINERS></ECUC-MODULE-CONFIGURATION-VALUES>"
    )
    package = f"<AR-PACKAGE><SHORT-NAME>E</SHORT-NAME><ELEMENTS>{module}</ELEMENTS></AR-PACKAGE>"
    folder.mkdir(exist_ok=True)
    path = folder / "os config.arxml"
    path.write_text(f'<AUTOSAR xmlns="{NAMESPACE}"><AR-PACKAGES>{package}</AR-PACKAGES></AUTOSAR>')
    return path


def exported(tmp_path, *more):
    """A schedule put onto the project: the file of the project, and the folder of the export."""
    path = project(tmp_path / "project", *more)
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n')
    model = import_model("arxml", [str(path.parent)], ArxmlImportOptions(overlays=(str(overlay),))).model
    schedule = schedule_model(model, SearchOptions(seed=1), lambda *_: True).schedule
    onto = export_onto(model, schedule, str(path.parent), ArxmlImportOptions())
    write_directory(str(tmp_path / "out"), onto.files)
    return path, tmp_path / "out"


def edited(out, name, old, new):
    """Change a file of the export, and its hash in the manifest."""
    path, manifest = out / name, json.loads((out / "manifest.json").read_text())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    manifest["files"][name] = sha256(path.read_bytes())
    (out / "manifest.json").write_text(json.dumps(manifest))


def messages(out):
    checked = check_bundle(str(out), CheckOptions())
    assert {found.code for found in checked.diagnostics} <= {OTHERWISE.id}
    return [f"{found.path} {found.message}" for found in checked.diagnostics], checked.lines


def test_a_merged_project_does_what_the_schedule_says(tmp_path):
    found, lines = messages(exported(tmp_path)[1])
    assert found == []
    assert lines[0] == "3 actions on 2 OsTasks in 20ms"
    assert [line.partition(" by ")[0] for line in sorted(lines[1:])] == [
        "/E/Os/Fast: activated 2 times",
        "/E/Os/Slow: /E/Os/Wake set once",
    ]


def test_what_is_started_in_another_application_mode_is_not_played_and_left_as_it_is(tmp_path):
    other = container("Os/OsAppMode", "Limp"), alarm("Limping", "Fast", 5, mode="Limp")
    path, out = exported(tmp_path, *other)
    assert messages(out)[0] == []
    assert "Limping" not in json.dumps(json.loads((out / "changes.json").read_text()))
    assert "Limping" in path.read_text()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("OsScheduleTblExpPointOffset</DEFINITION-REF>", "Nothing</DEFINITION-REF>", "where no job of it starts"),
        ("OsScheduleTableActivateTaskRef</DEFINITION-REF>", "Nothing</DEFINITION-REF>", "is not started at"),
        ("<VALUE>true</VALUE>", "<VALUE>false</VALUE>", "is not started at"),
        ("OsScheduleTableAutostartType", "Nothing", ""),
    ],
)
def test_a_delta_that_starts_something_else_is_found(tmp_path, old, new, why):
    """The last change is without meaning for the player: the type of an autostart decides nothing here."""
    _, out = exported(tmp_path)
    edited(out, "delta.arxml", old, new)
    found, _ = messages(out)
    assert any(why in message for message in found) if why else not found


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("project", [], '"project" is a list'),
        ("project", {"a": {"sha256": "0", "changed": "changed/none"}}, "is no file of the bundle"),
        ("project", {"a": {"sha256": "0", "change": ""}}, 'unknown key "change"'),
        ("tables", {}, '"tables" is a mapping'),
        ("code", [[]], '"code" is a list'),
        ("tasks", {"Fast": ["/E/Os/Fast"]}, '"Fast" is a list'),
        ("tasks", None, '"tasks" is empty'),
    ],
)
def test_a_manifest_whose_facts_cannot_be_read_is_refused(tmp_path, key, value, message):
    manifest = exported(tmp_path)[1] / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {key: value}))
    with pytest.raises(HalpipeError) as refused:
        check_bundle(str(manifest.parent), CheckOptions())
    assert {d.code for d in refused.value.diagnostics} <= {NOT_A_BUNDLE.id, "HAL0001"}
    assert any(message in d.message for d in refused.value.diagnostics)


def test_an_alarm_that_still_starts_a_task_is_found(tmp_path):
    _, out = exported(tmp_path)
    edited(out, "changed/os config.arxml", "<CONTAINERS>", f"<CONTAINERS>{alarm('Again', 'Fast', 10)}")
    found, lines = messages(out)
    assert all(message.startswith('OsTask "/E/Os/Fast" is activated') for message in found)
    assert found
    assert lines[0] == "5 actions on 2 OsTasks in 20ms"


def test_an_extended_task_that_is_activated_is_found(tmp_path):
    _, out = exported(tmp_path)
    edited(out, "delta.arxml", "OsScheduleTableSetEventRef</DEFINITION-REF>", "OsAlarmActivateTaskRef</DEFINITION-REF>")
    text = (out / "delta.arxml").read_text()
    edited(out, "delta.arxml", ">/E/Os/Wake<", ">/E/Os/Slow<")
    assert text != (out / "delta.arxml").read_text()
    assert 'OsTask "/E/Os/Slow" waits for events, but is activated' in messages(out)[0]


def test_a_project_that_changed_since_the_export_is_refused(tmp_path):
    path, out = exported(tmp_path)
    rte = path.with_name("rte.arxml")
    manifest = json.loads((out / "manifest.json").read_text())
    manifest["project"][str(rte)] = {"sha256": "0" * 64, "changed": ""}
    (out / "manifest.json").write_text(json.dumps(manifest))
    rte.write_text(path.read_text())
    with pytest.raises(HalpipeError) as failure:
        check_bundle(str(out), CheckOptions())
    assert [(found.code, found.at.file) for found in failure.value.diagnostics] == [(CHANGED_FILE.id, str(rte))]


def test_the_command_tells_what_the_ecu_does(tmp_path):
    _, out = exported(tmp_path)
    done = run_here(tmp_path, "deploy", "check", str(out))
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, "3 actions on 2 OsTasks in 20ms")
