"""Stages between formats and pipeline: names, endings, counts and what one step hands to the next."""

from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.flow import fleet, formats
from halpipe.flow.plan import read_plan
from halpipe.models import Schedule
from halpipe.pipeline.solve.schedule import SearchOptions
from support import model, ms, schedule, task, version


@pytest.mark.parametrize("kind", ["importer", "exporter", "deployment"])
def test_an_unknown_name_is_called_what_it_is(kind):
    with pytest.raises(HalpipeError, match=f'no {kind} "zz"\n'):
        getattr(formats, kind)("zz")


@pytest.mark.parametrize(
    ("name", "options", "endings"),
    [
        ("btf", {}, (".btf",)),
        ("arxml", {}, (".arxml", ".xml")),
        ("arxml", {"onto": "p"}, ()),
        ("graph", {}, (".dot", ".gv", ".svg")),
        ("ros", {}, (".yaml", ".yml")),
        ("ros", {"package": True}, ()),
        ("linux", {}, ()),
        ("report", {}, (".html", ".htm")),
    ],
)
def test_endings_of_what_is_written(name, options, endings):
    assert formats.endings_of(name, formats.exporter(name).options(**options)) == endings


@pytest.mark.parametrize(("seconds", "cycles"), [(1, 33), (2, 66), (3, 100)])
def test_seconds_are_cycles_of_all_modes_together(seconds, cycles, monkeypatch):
    system = model(task("a", 10, version("v", 3)))
    planned = schedule(system, 10)
    both = Schedule(**{**{f: getattr(planned, f) for f in ("model", "seed", "tick")}, "modes": planned.modes * 3})
    assert formats._cycles(both, seconds) == cycles
    assert formats._cycles(SimpleNamespace(modes=[SimpleNamespace(hyperperiod=ms(1500))]), 1) == 1


@pytest.mark.parametrize(
    ("stated", "played"), [({}, 0), ({"cycles": 3}, 3), ({"seconds": 1}, 100), ({"seconds": 0, "cycles": 2}, 2)]
)
def test_only_seconds_alone_become_cycles(stated, played, monkeypatch):
    from halpipe.deploy.base import CheckOptions

    planned = schedule(model(task("a", 10, version("v", 3))), 10)
    target = SimpleNamespace(bundle=SimpleNamespace(kind="linux"), schedule=planned)
    seen = []
    monkeypatch.setattr(formats, "open_target", lambda path: target)
    monkeypatch.setattr(type(formats.deployment("linux")), "check", lambda self, target, options: seen.append(options))
    formats.check_bundle("b", CheckOptions(**stated))
    assert [options.cycles for options in seen] == [played]


def test_a_model_that_cannot_be_scheduled_yet_counts_the_other_findings():
    unstated = [task(f"t{number}", 10, version("v", None)) for number in range(3)]
    (found,) = formats._readiness(model(*unstated))
    assert found.message.startswith("it cannot be scheduled yet: 3 times: ")
    assert "other" not in found.message
    (found,) = formats._readiness(model(*unstated, task("u", 0, version("v", 3)), task("w", 10, version("v", 0))))
    assert found.message.endswith(", and 2 other findings")


PLATFORM = """halpipe-regulator: 1
name: p
resource: r
clock: 100MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 400MB/s
capacity: 440MB/s
backend: table
units: {u1: {manager: 0}}
"""


@pytest.mark.parametrize(
    ("line", "writes"), [("", False), ("unspecified: read\n", False), ("unspecified: write\n", True)]
)
def test_a_grid_has_the_direction_of_phases_without_one(tmp_path, line, writes):
    (tmp_path / "p.yaml").write_text(PLATFORM + line)
    assert formats.burst_grid(str(tmp_path / "p.yaml")).writes is writes


def test_an_export_onto_a_project_has_the_choice_of_the_import_where_it_states_none(tmp_path):
    text = (
        "halpipe-pipeline: 1\nimport: {format: arxml, inputs: p, ecu: Body, variant: Small}\nmodel: m.xml\n"
        "schedule: {output: s.xml}\nexports: [{format: arxml, output: o, onto: p, ecu: Chassis}]\n"
    )
    (tmp_path / "p.yaml").write_text(text)
    (step,) = read_plan(str(tmp_path / "p.yaml")).exports
    assert (step.options.ecu, step.options.variant, step.options.conditions) == ("Chassis", "Small", ())


def test_a_fleet_keeps_the_numbers_of_a_finished_schedule(tmp_path):
    ledger = fleet.Ledger(tmp_path)
    variant = fleet.Variant("a.xml", b"<a/>", fleet.plain_options(SearchOptions()))
    assert ledger.kept(variant) is None
    ledger.keep(variant, fleet.Solved(fleet.Outcome.VALID, b"content", 12, 34))
    kept = fleet.Ledger(tmp_path).kept(variant)
    assert (kept.outcome, kept.content, kept.jobs, kept.moves) == (fleet.Outcome.KEPT, b"content", 12, 34)
    assert (fleet.Solved(fleet.Outcome.FAILED).jobs, fleet.Solved(fleet.Outcome.FAILED).moves) == (0, 0)
    path = tmp_path / fleet.LEDGER
    sound = path.read_text()
    for old, new in (('"jobs": 12', '"jobs": "12"'), ('"jobs"', '"jobs": 1, "jobs"'), ('"key"', '"more": 1, "key"')):
        path.write_text(sound.replace(old, new))
        assert fleet.Ledger(tmp_path).kept(variant) is None
    path.write_text(sound)
    other = fleet.Variant("a.xml", b"<b/>", variant.options)
    assert fleet.Ledger(tmp_path).kept(other) is None
    ledger.keep(other, fleet.Solved(fleet.Outcome.INCOMPLETE, b"partial", 1, 1))
    assert fleet.Ledger(tmp_path).kept(other) is None


@pytest.mark.parametrize(
    ("text", "help"),
    [
        ("halpipe-overlay: 1\n", "this is an overlay; name it under import"),
        ("halpipe-pipeline: 2\n", 'begin it with "halpipe-pipeline: 1"'),
        ("- halpipe-overlay\n", 'begin it with "halpipe-pipeline: 1"'),
    ],
)
def test_what_is_no_pipeline_is_told_from_an_overlay(tmp_path, text, help):
    (tmp_path / "p.yaml").write_text(text)
    with pytest.raises(HalpipeError) as refused:
        read_plan(str(tmp_path / "p.yaml"))
    assert [(found.help, found.at.line) for found in refused.value.diagnostics] == [(help, 1)]


def test_a_project_takes_a_schedule_only():
    options = formats.exporter("arxml").options(onto="p")
    with pytest.raises(HalpipeError, match="a project gets a schedule, and none is given") as refused:
        formats.export_with_remarks("arxml", model(task("a", 10, version("v", 3))), None, options)
    assert refused.value.exit == Exit.USAGE


def test_the_changes_of_a_project_are_listed_with_their_values(monkeypatch):
    change = SimpleNamespace(file="f.arxml", path="/E/A", name="", old="", new="1")
    onto = SimpleNamespace(
        files={"x": b""},
        findings=(),
        summary=[change, SimpleNamespace(**vars(change) | {"old": "0", "name": "n", "new": ""})],
    )
    monkeypatch.setattr("halpipe.flow.onto.export_onto", lambda *_: onto)
    system = model(task("a", 10, version("v", 3)))
    found = formats._put_onto(system, schedule(system, 10), formats.exporter("arxml").options(onto="p"))
    assert found.summary == ("f.arxml: /E/A: + 1", "f.arxml: /E/A n: 0 -> (nothing)")
