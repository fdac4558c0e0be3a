"""``halpipe new``: what it makes can be scheduled as it stands, and nothing of anybody's is overwritten."""

import pytest

from command_line import run_here
from halpipe.importers.native import read_model
from halpipe.pipeline.checked import validate_model
from halpipe.starters import EXAMPLES


def test_the_first_model_validates_schedules_and_exports(tmp_path):
    assert run_here(tmp_path, "new", "first").returncode == 0
    assert [d for d in validate_model(read_model(str(tmp_path / "first" / "model.xml"))) if d.is_error] == []
    done = run_here(tmp_path, "run", "first/pipeline.yaml")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "first" / "out" / "report.html").exists()


def test_the_graph_with_its_overlay_is_a_model(tmp_path):
    run_here(tmp_path, "new", "first")
    source = "import: {format: ros, inputs: [first/graph.dot], overlay: first/overlay.yaml}"
    (tmp_path / "p.yaml").write_text(f"halpipe-pipeline: 1\n{source}\nmodel: m.xml\nschedule: {{output: s.xml}}\n")
    done = run_here(tmp_path, "run", "p.yaml")
    assert done.returncode == 0, done.stderr
    assert "--coverage lists them" in done.stderr  # a pipeline lists none itself
    model, imported = (read_model(str(tmp_path / name)) for name in ("first/model.xml", "m.xml"))
    (of_model,), (of_graph,) = model.chains, imported.chains
    assert of_graph.max_reaction == of_model.max_reaction
    assert [name.strip("/") for name in of_graph.tasks] == list(of_model.tasks)
    for name in of_model.tasks:  # the tutorial and the files say so
        (stated, *_), (read,) = model.task(name).versions, imported.task(f"/{name}").versions
        assert (read.wcet, read.units) == (stated.wcet, stated.units)
        assert timing(imported.task(f"/{name}")) == timing(model.task(name))


def timing(task):
    return task.period, task.slack, task.offset, task.deadline


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_comes_whole(tmp_path, name):
    assert run_here(tmp_path, "new", "race", "--example", name).returncode == 0
    done = run_here(tmp_path / "race" / name, "run", "pipeline.yaml")
    assert done.returncode == 0, done.stderr


def test_what_is_there_stays(tmp_path):
    (tmp_path / "mine").mkdir()
    assert run_here(tmp_path, "new", "mine").returncode == 0  # empty
    (tmp_path / "mine" / "model.xml").write_text("changed")
    again = run_here(tmp_path, "new", "mine")
    assert (again.returncode, (tmp_path / "mine" / "model.xml").read_text()) == (1, "changed")
    assert "HAL0004" in again.stderr
    (tmp_path / "file").write_text("x")
    assert run_here(tmp_path, "new", "file").returncode == 1
    assert (tmp_path / "file").read_text() == "x"


def test_an_unknown_example_is_a_usage_error(tmp_path):
    unknown = run_here(tmp_path, "new", "race", "--example", "roboraser")
    assert unknown.returncode == 2
    assert 'did you mean "roboracer"' in unknown.stderr
    assert not (tmp_path / "race").exists()
