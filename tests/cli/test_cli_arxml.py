"""``halpipe export arxml``, and the way back: what a user types and sees."""

import pytest

from halpipe.cli import invoke

PIPELINE = """\
halpipe-pipeline: 1
model: model.xml
schedule: {seed: 1, output: schedule.xml}
exports:
  - {format: arxml, release: 4.0.3, part: ecuc, tick: 1us, max-value: 65535, output: ecu.arxml}
"""


@pytest.fixture
def place(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert invoke(["schedule", "model.xml", "-o", "schedule.xml", "-q"]) == 0
    return folder


def test_there_and_back_again(place, capsys):
    assert invoke(["export", "arxml", "model.xml", "schedule.xml", "-o", "m.arxml"]) == 0
    assert capsys.readouterr().err == "m.arxml: written\n"
    assert invoke(["import", "arxml", "m.arxml", "--strict", "-o", "again.xml", "-q"]) == 0
    assert (place / "again.xml").read_bytes() == (place / "model.xml").read_bytes()


def test_a_folder_with_both_parts_is_read_as_one(place, capsys):
    (place / "parts").mkdir()
    for part in ("system", "ecuc"):
        command = ["export", "arxml", "model.xml", "schedule.xml", "--part", part, "-o", f"parts/{part}.arxml", "-q"]
        assert invoke(command) == 0
    assert invoke(["import", "arxml", "parts", "-o", "again.xml", "-q"]) == 0
    assert (place / "again.xml").read_bytes() == (place / "model.xml").read_bytes()
    assert capsys.readouterr().err == ""


def test_what_the_counter_cannot_do_is_refused_and_nothing_written(place, capsys):
    command = ["export", "arxml", "model.xml", "schedule.xml", "--tick", "1us", "--max-value", "99", "-o", "x.arxml"]
    assert invoke(command) == 1
    shown = capsys.readouterr().err
    assert 'error[HAL0876] mode "all"' in shown
    assert "lasts 10ms, 10000 ticks of 1us, but the counter has only 100 values" in shown
    assert "help: set the maximal value to 9999 or more" in shown
    assert not (place / "x.arxml").exists()


@pytest.mark.parametrize("tick", ["soon", "0ms", "1"])
def test_a_tick_that_is_no_time_is_a_usage_error(place, tick, capsys):
    assert invoke(["export", "arxml", "model.xml", "schedule.xml", "--tick", tick, "-o", "x.arxml"]) == 2
    assert "--tick" in capsys.readouterr().err


def test_a_pipeline_writes_it(place):
    (place / "pipeline.yaml").write_text(PIPELINE)
    assert invoke(["run", "pipeline.yaml", "-q"]) == 0
    written = (place / "ecu.arxml").read_text()
    assert "AUTOSAR_4-0-3.xsd" in written
    assert "<VALUE>65535</VALUE>" in written
    assert "halpipe:model" not in written
