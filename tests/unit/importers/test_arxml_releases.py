"""One small project in each release: imported, scheduled, exported, read again, and put onto itself and played."""

import re

import pytest
from arxml_case import FIXTURES, container
from test_arxml_onto import model_of, project

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.exporters.arxml import FORMAT, RELEASES, ArxmlOptions
from halpipe.flow.formats import check_bundle, import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions


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
