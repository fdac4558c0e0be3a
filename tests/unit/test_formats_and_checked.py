"""The stages: formats found by name, losses under --strict, nothing invalid written or exported."""

from dataclasses import replace

import pytest

import halpipe.cli
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.common.codes import NEEDS_SCHEDULE
from halpipe.exporters.native import format_model
from halpipe.flow import formats
from halpipe.importers.common.base import Coverage, Imported, ImportOptions
from halpipe.models import Status
from halpipe.pipeline import checked
from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions
from halpipe.pipeline.verify.codes import OVERLAP
from support import access, model, schedule, task, version
from support import job as job_of


def system():
    """Two tasks that fill one unit by turns."""
    return model(task("a", "10ms", version("v", "4ms", "u1")), task("b", "10ms", version("v", "4ms", "u1")))


def tables(owner, second="4ms"):
    return schedule(owner, "10ms", job_of(owner, "a", 0, "0ms", "u1"), job_of(owner, "b", 0, second, "u1"))


# ------------------------------------------------------------------------------------------------ formats


@pytest.mark.parametrize("find", [formats.importer, formats.exporter])
def test_an_unknown_format_is_named_with_those_that_are_installed(find):
    with pytest.raises(HalpipeError) as refused:
        find("nonsense")
    (found,) = refused.value.diagnostics
    assert found.code == formats.UNKNOWN_FORMAT.id
    for name in formats.formats(formats.IMPORTERS if find is formats.importer else formats.EXPORTERS):
        assert name in found.help


@pytest.mark.parametrize(
    ("find", "typed", "meant"), [(formats.importer, "arxlm", "arxml"), (formats.exporter, "raport", "report")]
)
def test_a_misspelt_format_is_put_right(find, typed, meant):
    with pytest.raises(HalpipeError) as refused:
        find(typed)
    assert f'did you mean "{meant}"' in refused.value.diagnostics[0].help


def test_every_installed_format_keeps_to_its_door():
    for name in formats.formats(formats.IMPORTERS):
        assert formats.importer(name).name == name
        assert formats.importer(name).summary
    for name in formats.formats(formats.EXPORTERS):
        assert formats.exporter(name).name == name
        suffix = formats.exporter(name).suffix
        assert suffix == "" or suffix.startswith("."), "a file name's end; none for a folder"


# ------------------------------------------------------------------------------------------------ import


class Plugin:
    """An importer of somebody else: returns what it was made with, and does not look at `strict`."""

    name = "plugin"
    summary = "a model that is already there"

    def __init__(self, owner, *found):
        self._imported = Imported(model=owner, diagnostics=found, coverage=Coverage())

    def read(self, paths, options):
        return self._imported


def run_import(monkeypatch, owner, *found, strict=False):
    monkeypatch.setattr(formats, "importer", lambda name: Plugin(owner, *found))
    return formats.import_model("plugin", [], ImportOptions(strict=strict))


def loss():
    """A finding that an importer would only warn about; its code is any warning there is."""
    return formats.UNSCHEDULABLE_YET("something was left out")


def test_under_strict_every_loss_is_an_error_with_its_exit_code(monkeypatch):
    with pytest.raises(HalpipeError) as refused:
        run_import(monkeypatch, system(), loss(), strict=True)
    assert refused.value.exit is Exit.UNSUPPORTED
    assert [d.code for d in refused.value.diagnostics] == [loss().code, formats.LOST_UNDER_STRICT.id]


def test_without_strict_a_loss_is_passed_on(monkeypatch):
    assert run_import(monkeypatch, system(), loss()).diagnostics == (loss(),)


def test_strict_without_losses_is_no_error(monkeypatch):
    assert run_import(monkeypatch, system(), strict=True).diagnostics == ()


def test_an_import_without_wcets_says_once_that_it_cannot_be_scheduled_yet(monkeypatch):
    owner = model(*(task(name, "10ms", version("v", None, "u1")) for name in "abc"))
    (found,) = run_import(monkeypatch, owner).diagnostics
    assert found.code == formats.UNSCHEDULABLE_YET.id
    assert "3 times" in found.message
    assert not found.is_error


# ------------------------------------------------------------------------------------------------ schedule


@pytest.fixture
def solver(monkeypatch):
    """Let the search answer with given tables, and claim what it likes of them."""

    def answer_with(tables):
        answer = Scheduled(schedule=tables, diagnostics=(), moves=1, stopped=False)
        monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", lambda *_: answer)

    return answer_with


def test_a_search_that_claims_a_broken_schedule_valid_is_a_bug_and_writes_nothing(solver, tmp_path, capsys):
    owner = system()
    (tmp_path / "model.xml").write_bytes(format_model(owner))
    (tmp_path / "schedule.xml").write_text("precious")
    solver(tables(owner, second="3ms"))
    code = halpipe.cli.invoke(["schedule", str(tmp_path / "model.xml"), "-o", str(tmp_path / "schedule.xml")])
    said = capsys.readouterr().err
    assert code == Exit.INTERNAL == 70
    assert checked.INVALID_SOLUTION.id in said
    assert OVERLAP.id in said
    assert (tmp_path / "schedule.xml").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.xml", "schedule.xml"]


def test_a_valid_claim_passes(solver):
    owner = system()
    solver(tables(owner))
    assert checked.schedule_model(owner, SearchOptions(), lambda *_: True).schedule == tables(owner)


def test_a_table_that_is_called_not_found_may_break_rules(solver):
    owner = system()
    broken = tables(owner, second="3ms")
    failed = replace(broken, modes=tuple(replace(mode, status=Status.NOT_FOUND) for mode in broken.modes))
    solver(failed)
    assert checked.schedule_model(owner, SearchOptions(), lambda *_: True).schedule == failed


def test_an_invalid_model_is_not_searched(solver):
    owner = model(task("a", "10ms", version("v", "11ms", "u1")))
    solver(tables(system()))
    with pytest.raises(HalpipeError) as refused:
        checked.schedule_model(owner, SearchOptions(), lambda *_: True)
    assert "HAL0231" in {d.code for d in refused.value.diagnostics}


# ------------------------------------------------------------------------------------------------ export


@pytest.mark.parametrize("name", ["report", "trace"])
def test_formats_that_need_a_schedule_say_so(name):
    with pytest.raises(HalpipeError) as refused:
        formats.export(name, system(), None, ExportOptions())
    assert [d.code for d in refused.value.diagnostics] == [NEEDS_SCHEDULE.id]


@pytest.mark.parametrize("name", ["report", "graph", "trace"])
def test_no_format_takes_a_schedule_that_does_not_verify(name):
    owner = system()
    assert formats.export(name, owner, tables(owner), ExportOptions())[""]
    with pytest.raises(HalpipeError):
        formats.export(name, owner, tables(owner, second="3ms"), ExportOptions())


def test_no_format_takes_a_schedule_of_an_invalid_model():
    owner = system()
    wrong = replace(owner, tasks=(*owner.tasks, task("c", "10ms", version("v", "1ms", "u1", access("mem", 0, 1)))))
    with pytest.raises(HalpipeError) as refused:
        formats.export("report", wrong, tables(owner), ExportOptions())
    assert "HAL0206" in {d.code for d in refused.value.diagnostics}


@pytest.mark.parametrize("format", ["amalthea", "arxml", "ros", "table"])
@pytest.mark.parametrize("kind", ["task-model", "schedule"])
def test_files_of_halpipe_are_no_sources_of_an_import(format, kind, tmp_path):
    source = tmp_path / "m.xml"
    source.write_text(f"<?xml version='1.0'?>\n<{kind} xmlns='urn:halpipe:{kind}:1' name='m'/>\n")
    with pytest.raises(HalpipeError) as refused:
        formats.import_model(format, [str(source)], formats.importer(format).options())
    (found,) = refused.value.diagnostics
    assert found.code == formats.OWN_SOURCE.id
    assert f"`halpipe {'verify' if kind == 'schedule' else 'schedule'}`" in found.help
