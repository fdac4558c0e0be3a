"""Systems of real tools: everything counted by an independent reader is found, and no file ever breaks the import."""

import csv
import json
from collections import Counter
from pathlib import Path

import pytest

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.exporters.native import format_model
from halpipe.importers.arxml import FORMAT, codes
from halpipe.importers.arxml.files.words import parse_seconds
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.arxml.system.reading import read_system, read_tree
from halpipe.importers.arxml.tasks.dataflow import find_dataflow
from halpipe.importers.native import parse_model

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "arxml"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real ARXML files are not part of the project")

SYSTEMS = ["sys_vector_tc275_3core", "sys_arccore_helloworld"]
INPUTS = sorted([*DATA.glob("*/*.arxml"), *(path for path in DATA.glob("*") if path.is_dir())])
DATA_DEPENDENCIES = {"sys_vector_tc275_3core": 7, "sys_arccore_helloworld": 4}


def read(*paths, **options):
    return FORMAT.read([str(path) for path in paths], ArxmlImportOptions(**options))


def attempt(path, granularity):
    """Return the import, None if it fails, and its findings."""
    try:
        imported = read(path, granularity=granularity)
    except HalpipeError as failure:
        return None, failure.diagnostics
    return imported, imported.diagnostics


def observed(name):
    return json.loads((DATA / name / "_observed_summary.json").read_text())


def system_of(name):
    return read_system(read_tree([str(DATA / name)], Findings()))


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_an_independent_reader_counted_is_found(name):
    expected, system = observed(name), system_of(name)
    assert Counter(event.place.kind for event in system.events) == expected["events"]
    assert sum(event.runnable is not None for event in system.events) == expected["event_runnable_resolved"]
    assert sum(len(c.runnables) for c in system.components if not c.is_module) == expected["runnables"]
    assert len(system.configuration.tasks) == expected["os_tasks"]
    assert len(system.configuration.applications) == expected["os_apps"]
    assert len(system.configuration.cores) == expected["cores"]
    assert len(system.configuration.mappings) == expected["mappings"]
    mappings = [m for m in system.configuration.mappings if m.task is not None and m.event is not None]
    assert len(mappings) == expected["mapped_event_found"] == expected["mapped_with_task"]
    connectors = [c for c in (c for type in system.compositions for c in type.connectors) if c.source and c.target]
    assert sum(c.place.kind.startswith("ASSEMBLY") for c in connectors) == expected["connectors_resolved"]


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_os_task_hosts_the_events_and_periods_counted(name):
    system = system_of(name)
    events = {event.place.path: event for event in system.events}
    application = {path: app for app in system.configuration.applications for path in app.tasks}
    for task in system.configuration.tasks:
        expected = observed(name)["tasks"][task.place.name]
        mappings = [m for m in system.configuration.mappings if m.event is not None]
        mapped = [events[m.event] for m in mappings if m.task == task.place.path]
        periods = {str(parse_seconds(event.period.text).ns) for event in mapped if event.period}
        assert len(mapped) == expected["n_events"]
        assert periods == set(expected["periods"])
        assert application[task.place.path].place.name == expected["app"]
        assert (task.core or "") == expected["core"]


@pytest.mark.parametrize("name", SYSTEMS)
def test_data_dependencies_are_those_counted(name):
    assert len(find_dataflow(system_of(name)).dependencies) == DATA_DEPENDENCIES[name]


def test_the_three_core_system_becomes_a_model():
    model = read(DATA / "sys_vector_tc275_3core").model
    assert [unit.name for unit in model.units] == [f"EcucCoreDefinition_Core{number}" for number in range(3)]
    assert Counter(str(task.period) for task in model.tasks) == {"5ms": 17, "10ms": 9, "20ms": 1}
    bound = Counter(task.versions[0].units for task in model.tasks if len(task.versions[0].units) == 1)
    assert sum(bound.values()) == 27


@pytest.mark.parametrize("granularity", ["runnable", "event", "ostask"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_systems_are_complete_at_every_granularity(name, granularity):
    imported = read(DATA / name, granularity=granularity)
    assert imported.model.tasks
    assert all(task.period for task in imported.model.tasks)
    assert parse_model(format_model(imported.model), "model.xml") == imported.model
    assert all(read == mapped + ignored for _, read, mapped, ignored in imported.coverage.rows())


def test_the_constraint_of_a_large_export_orders_its_runnables():
    imported = read(DATA / "simulink_r2021a" / "large_scale_autosar_swc_expfcns.arxml")
    assert len(imported.model.tasks) == 108
    assert sum(len(task.versions[0].precedences) for task in imported.model.tasks) == 107


@pytest.mark.parametrize(
    "granularity",
    ["runnable", *(pytest.param(other, marks=pytest.mark.slow) for other in ("event", "ostask"))],  # as above, on all
)
@pytest.mark.parametrize("path", INPUTS, ids=lambda path: str(path.relative_to(DATA)))
def test_every_input_gives_a_model_or_findings(path, granularity):
    imported, findings = attempt(path, granularity)
    assert all(diagnostic.at.file.startswith(str(path)) for diagnostic in findings)
    if imported is None:
        assert any(diagnostic.is_error for diagnostic in findings)
    else:
        assert imported.model.tasks
        assert parse_model(format_model(imported.model), "model.xml") == imported.model


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("ap_isoft_r2011/machine.arxml", codes.ADAPTIVE_ONLY),
        ("ap_open_r2511/machine_manifest.arxml", codes.ADAPTIVE_ONLY),
        ("negative_cantools/system-bad-root-tag-4.2.arxml", codes.NOT_ARXML),
        ("negative_cantools/system-illegal-namespace-4.2.arxml", codes.NOT_ARXML),
        ("negative_cantools/system-illegal-root-4.2.arxml", codes.NOT_ARXML),
        ("negative_cantools/system-illegal-version-4.2.2.1.0.arxml", codes.NOT_ARXML),
    ],
)
def test_foreign_inputs_are_refused_by_name(file, code):
    with pytest.raises(HalpipeError) as failure:
        read(DATA / file)
    assert code.id in {diagnostic.code for diagnostic in failure.value.diagnostics}


COUNTS = list(csv.DictReader((Path(__file__).parent / "arxml_counts.tsv").open(), delimiter="\t"))


def counts(path):
    """Return what an import gives, as a row of the table of counts."""
    try:
        imported = read(path)
    except HalpipeError as failure:
        errors = sorted({diagnostic.code for diagnostic in failure.diagnostics if diagnostic.is_error})
        return {"result": " ".join(errors)}
    model, rows = imported.model, imported.coverage.rows()
    orders = sum(len(version.precedences) for task in model.tasks for version in task.versions)
    found = [len(model.units), len(model.tasks), orders, len(model.modes)]
    found += [sum(row[column] for row in rows) for column in (1, 2, 3)]
    names = ("units", "tasks", "orders", "modes", "read", "mapped", "ignored")
    return {"result": "model", **{name: str(count) for name, count in zip(names, found, strict=True)}}


@pytest.mark.parametrize("row", COUNTS, ids=lambda row: row["input"])
def test_every_input_gives_what_the_table_of_counts_says(row):
    expected = {key: value for key, value in row.items() if key != "input" and value}
    assert counts(DATA / row["input"]) == expected


def test_the_table_of_counts_has_every_input():
    assert [row["input"] for row in COUNTS] == [str(path.relative_to(DATA)) for path in INPUTS]


def test_processes_of_real_manifests_run_in_the_states_of_their_function_groups():
    model = read(DATA / "ap_isoft_r2011").model
    assert {task.name for task in model.tasks} == {"phmd_process1", "tsync_daemon_proc1", "dlt_daemon_proc"}
    runs = {mode.name: {run.task for run in mode.runs} for mode in model.modes}
    assert runs["Fallback"] == {"phmd_process1"}
    assert runs["Startup"] == runs["Verify"] == runs["Restart"] == {task.name for task in model.tasks}


def test_references_in_another_case_reach_the_functions_of_a_driver():
    _, findings = attempt(DATA / "nxp_mcal_bswmd", "runnable")
    assert Counter(diagnostic.code for diagnostic in findings)[codes.WRONG_CASE.id] == 31


def test_release_3_is_told_apart_by_name():
    _, findings = attempt(DATA / "negative_cantools" / "system-3.2.3.arxml", "runnable")
    assert "3.2.3" in next(d.message for d in findings if d.code == codes.OLD_RELEASE.id)


@pytest.mark.parametrize("name", [path.name for path in DATA.glob("*") if path.is_dir()])
def test_a_large_input_gives_the_same_model_without_what_cannot_matter(name, monkeypatch):
    whole, findings = attempt(DATA / name, "runnable")
    monkeypatch.setattr("halpipe.importers.arxml.files.sniff.LARGE_INPUT", 0)
    slim, told = attempt(DATA / name, "runnable")
    assert [d for d in told if d.is_error] == [d for d in findings if d.is_error]
    if whole is None:
        assert slim is None
        return
    assert slim.model == whole.model
    # an element that several files have parts of counts once, if it is dropped as often as it stands there
    assert sum(row[1] for row in slim.coverage.rows()) >= sum(row[1] for row in whole.coverage.rows())
    assert slim.coverage.mapped_counts == whole.coverage.mapped_counts
