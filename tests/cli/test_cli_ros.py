"""``halpipe import ros --calibrate`` and ``halpipe export ros``: what a user types and sees."""

import pytest
import yaml

from halpipe.cli import invoke
from halpipe.importers.native import read_model

GRAPH = 'digraph { a [label="/a"]; b [label="/b"]; a -> b [label="/t"] }\n'
OVERLAY = "halpipe-overlay: 1\ntasks:\n  /a: {period: 10ms}\n"


@pytest.fixture
def place(folder, monkeypatch):
    (folder / "graph.dot").write_text(GRAPH)
    (folder / "o.yaml").write_text(OVERLAY)
    (folder / "t.csv").write_text("callback,duration_us\n" + "".join(f"/a,{n}\n/b,7\n" for n in range(1, 101)))
    monkeypatch.chdir(folder)
    return folder


def test_from_measurements_to_executors_and_back(place, capsys):
    calibrated = ["--overlay", "o.yaml", "--calibrate", "t.csv", "--quantile", "0.99", "--margin", "0.5"]
    assert invoke(["import", "ros", "graph.dot", *calibrated, "-o", "m.xml", "-q"]) == 0
    assert [str(task.versions[0].wcet) for task in read_model("m.xml").tasks] == ["148.5us", "10.5us"]
    assert invoke(["schedule", "m.xml", "-o", "s.xml", "-q"]) == 0
    capsys.readouterr()
    assert invoke(["export", "ros", "m.xml", "s.xml", "-o", "e.yaml"]) == 0
    assert "warning[HAL0897]" in capsys.readouterr().err
    assert invoke(["import", "ros", "e.yaml", "-o", "again.xml", "-q"]) == 0
    assert invoke(["diff", "m.xml", "again.xml"]) == 0
    assert "same" in capsys.readouterr().out


def test_a_schedule_is_written_for_the_cpus_named(place, capsys):
    assert invoke(["schedule", "model.xml", "-o", "s.xml", "-q"]) == 0
    capsys.readouterr()
    arguments = ["export", "ros", "model.xml", "s.xml", "--cpus", "c1=2,c2=5", "--priority", "70", "-o", "-"]
    assert invoke(arguments) == 0
    written = yaml.safe_load(capsys.readouterr().out)
    assert [(one["name"], one["cpu"]) for one in written["modes"][0]["executors"]] == [("c1", 2), ("c2", 5)]
    assert written["scheduling"]["priority"] == 70


@pytest.mark.parametrize(
    "arguments",
    [
        ["import", "ros", "graph.dot", "--calibrate", "t.csv", "--quantile", "2", "-o", "m.xml"],
        ["import", "ros", "graph.dot", "--calibrate", "t.csv", "--margin", "lots", "-o", "m.xml"],
        ["import", "arxml", "graph.dot", "--calibrate", "t.csv", "-o", "m.xml"],
        ["export", "ros", "model.xml", "s.xml", "--cpus", "c1", "-o", "e.yaml"],
        ["export", "ros", "model.xml", "s.xml", "--priority", "100", "-o", "e.yaml"],
    ],
)
def test_wrong_options_are_misuse(place, arguments):
    assert invoke(arguments) == 2
    assert not (place / "m.xml").exists()


def test_a_pipeline_calibrates_and_exports(place):
    (place / "p.yaml").write_text(
        "halpipe-pipeline: 1\n"
        "import: {format: ros, inputs: [graph.dot], overlay: [o.yaml], calibrate: [t.csv], quantile: 0.5}\n"
        "model: m.xml\n"
        "schedule: {output: s.xml}\n"
        "exports:\n  - {format: ros, output: e.yaml, cpus: {core0: 3}}\n"
    )
    assert invoke(["run", "p.yaml", "-q"]) == 0
    assert str(read_model("m.xml").task("/a").versions[0].wcet) == "50us"
    [executor] = yaml.safe_load((place / "e.yaml").read_text())["modes"][0]["executors"]
    assert (executor["name"], executor["cpu"]) == ("core0", 3)


def test_wrong_numbers_of_a_pipeline_are_named(place, capsys):
    (place / "p.yaml").write_text(
        "halpipe-pipeline: 1\n"
        "import: {format: ros, inputs: [graph.dot], calibrate: [t.csv], quantile: 2, margin: x}\n"
        "model: m.xml\n"
    )
    assert invoke(["run", "p.yaml"]) == 1
    shown = capsys.readouterr().err
    assert "'2' is no quantile" in shown
    assert "margin" in shown
