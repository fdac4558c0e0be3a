"""``halpipe export regulator`` and ``halpipe schedule --quantise``: what a user types and sees."""

import json

import pytest

from halpipe.cli import invoke

PLATFORM = """\
halpipe-regulator: 1
clock: 1MHz
bus: 64bit
burst: 64B
window: 250
guaranteed: 6MB/s
capacity: 6.4MB/s
units:
  c1: {manager: 0}
  c2: {manager: 1}
"""


@pytest.fixture
def place(folder, monkeypatch):
    (folder / "platform.yaml").write_text(PLATFORM)
    monkeypatch.chdir(folder)
    return folder


def test_from_a_model_to_tables(place, capsys):
    assert invoke(["schedule", "model.xml", "--quantise", "platform.yaml", "-o", "s.xml", "-q"]) == 0
    assert invoke(["verify", "model.xml", "s.xml", "-q"]) == 0
    capsys.readouterr()
    assert invoke(["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg"]) == 0
    shown = capsys.readouterr()
    assert shown.err == "cfg: written\n"
    assert shown.out == (place / "cfg" / "report.txt").read_text()
    (table,) = json.loads((place / "cfg" / "tables.json").read_text())["tables"]
    assert (table["rounding"], table["windows"]) == ("whole", 40)


def test_counters_beyond_their_budget_are_the_result(place, capsys):
    assert invoke(["schedule", "model.xml", "--quantise", "platform.yaml", "-o", "s.xml", "-q"]) == 0
    command = ["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg", "-q"]
    assert invoke(command) == 0
    (table,) = json.loads((place / "cfg" / "tables.json").read_text())["tables"]
    (place / "c.csv").write_text(f"table,unit,direction,window,bytes\n{table['name']},c1,read,0,1000000\n")
    capsys.readouterr()
    assert invoke(["compare", "cfg", "c.csv"]) == 1
    shown = capsys.readouterr()
    assert "error[" in shown.out
    assert shown.err == ""


def test_quiet_prints_nothing(place, capsys):
    assert invoke(["schedule", "model.xml", "-o", "s.xml", "-q"]) == 0
    assert invoke(["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg", "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_warnings_point_into_the_file_that_was_named(place, capsys):
    (place / "sub").mkdir()
    (place / "sub" / "p.yaml").write_text(PLATFORM + "  c3: {manager: 2}\n")
    assert invoke(["schedule", "model.xml", "-o", "s.xml", "-q"]) == 0
    assert invoke(["export", "regulator", "model.xml", "s.xml", "--platform", "sub/p.yaml", "-o", "cfg"]) == 0
    assert 'sub/p.yaml:11: warning[HAL0831] unit "c3"' in capsys.readouterr().err


def test_an_error_leaves_what_was_there(place, capsys):
    assert invoke(["schedule", "model.xml", "-o", "s.xml", "-q"]) == 0
    command = ["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg"]
    assert invoke(command) == 0
    before = (place / "cfg" / "tables.json").read_bytes()
    (place / "platform.yaml").write_text(PLATFORM.replace("250", "300"))
    capsys.readouterr()
    assert invoke(command) == 1
    shown = capsys.readouterr()
    assert "error[HAL0822]" in shown.err
    assert "250 cycles (250us)" in shown.err
    assert (place / "cfg" / "tables.json").read_bytes() == before


def test_wrong_options_are_usage_errors_or_name_the_choices(place, capsys):
    assert invoke(["schedule", "model.xml", "-o", "s.xml", "-q"]) == 0
    common = ["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg"]
    assert invoke([*common, "--rounding", "up"]) == 2
    assert "auto, whole, controlled" in capsys.readouterr().err
    assert invoke([*common, "--backend", "tabel"]) == 2
    assert 'did you mean "table"?' in capsys.readouterr().err


def test_a_model_that_does_not_fit_the_grid_is_refused_with_the_nearest_windows(place, capsys):
    (place / "platform.yaml").write_text(PLATFORM.replace("250", "300"))
    assert invoke(["schedule", "model.xml", "--quantise", "platform.yaml", "-o", "s.xml"]) == 1
    shown = capsys.readouterr().err
    assert "period 10ms is not a multiple of the window 300us" in shown
    assert "250 cycles (250us) or 400 cycles (400us)" in shown
    assert not (place / "s.xml").exists()


def test_a_pipeline_can_do_both(place, capsys):
    (place / "pipeline.yaml").write_text(
        "halpipe-pipeline: 1\nmodel: model.xml\nschedule: {output: s.xml, quantise: platform.yaml}\n"
        "exports:\n  - {format: regulator, output: cfg, platform: platform.yaml, backend: table}\n"
    )
    assert invoke(["run", "pipeline.yaml"]) == 0
    assert (place / "cfg" / "manifest.json").exists()
