"""Pipeline files: every problem at its line, every key read, paths relative to the file."""

import re
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.flow.plan import NOT_A_PIPELINE, read_plan
from halpipe.pipeline.solve.schedule import SearchOptions
from support import ms

FIXTURES = sorted((Path(__file__).parents[2] / "fixtures" / "pipeline").glob("*.yaml"))
SMALLEST = "halpipe-pipeline: 1\nmodel: m.xml\nschedule: {output: s.xml}\n"


def marks(path):
    """The (line, code) pairs that a fixture announces in comments."""
    found = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        found += [(number, code) for code in re.findall(r"# (HAL\d{4})$", line)]
    return found


def refusal(path):
    with pytest.raises(HalpipeError) as refused:
        read_plan(str(path))
    return refused.value.diagnostics


def written(folder, text):
    path = folder / "pipeline.yaml"
    path.write_text(text)
    return read_plan(str(path))


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_every_problem_is_reported_at_its_line_in_the_order_of_the_file(path):
    assert [(d.at.line, d.code) for d in refusal(path)] == marks(path)


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_every_problem_says_what_to_do(path):
    assert all(d.help and d.message and d.at.file == str(path) for d in refusal(path))


def test_every_code_of_a_pipeline_file_has_a_fixture():
    found = {code for path in FIXTURES for _, code in marks(path)}
    assert found == {"HAL0020", "HAL0021", "HAL0022", "HAL0023", "HAL0024", NOT_A_PIPELINE.id}


@pytest.mark.parametrize("text", ["", "# nothing\n", "pipeline", "[]", "halpipe-pipeline: true\n"])
def test_what_is_no_pipeline(tmp_path, text):
    path = tmp_path / "p.yaml"
    path.write_text(text)
    assert [d.code for d in refusal(path)] == [NOT_A_PIPELINE.id]


def test_a_search_option_without_effect_is_placed(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(SMALLEST.replace("s.xml", "s.xml, target: 0.5"))
    assert [(d.code, d.at.file, d.at.line) for d in refusal(path)] == [("HAL0025", str(path), 3)]


def test_an_absent_file(tmp_path):
    assert [d.code for d in refusal(tmp_path / "absent.yaml")] == ["HAL0001"]


def test_the_smallest_pipeline_has_the_defaults_of_the_command_line(tmp_path):
    plan = written(tmp_path, SMALLEST)
    assert plan.imports is None
    assert plan.exports == ()
    assert plan.search == SearchOptions(seed=1, tick=None)
    assert (plan.model, plan.schedule) == (str(tmp_path / "m.xml"), str(tmp_path / "s.xml"))


def test_every_key_is_read(tmp_path):
    plan = written(
        tmp_path,
        """
halpipe-pipeline: 1
import: {format: arxml, inputs: [a.arxml, in], overlay: [o.yaml], name: n, granularity: event, strict: true}
model: out/m.xml
schedule: {output: out/s.xml, seed: 7, budget: 300, tick: 0.5ms}
exports:
  - {format: graph, output: out/g.dot, mode: race, title: Title, cluster: true}
""",
    )
    source, (export,) = plan.imports, plan.exports
    assert (source.format, source.inputs) == ("arxml", (str(tmp_path / "a.arxml"), str(tmp_path / "in")))
    assert source.options.overlays == (str(tmp_path / "o.yaml"),)
    assert (source.options.name, source.options.granularity, source.options.strict) == ("n", "event", True)
    assert plan.search == SearchOptions(seed=7, budget=300, tick=ms("0.5ms"))
    assert (export.format, export.output) == ("graph", str(tmp_path / "out/g.dot"))
    assert (export.options.mode, export.options.title, export.options.cluster) == ("race", "Title", True)


def test_one_input_needs_no_list_and_an_absolute_path_stays(tmp_path):
    plan = written(tmp_path, SMALLEST + "import: {format: ros, inputs: /data/graph.dot, overlay: o.yaml}\n")
    assert plan.imports.inputs == ("/data/graph.dot",)
    assert plan.imports.options.overlays == (str(tmp_path / "o.yaml"),)


@pytest.mark.parametrize("tick", ["0ms", "-1ms", "5", "one"])
def test_a_tick_that_is_no_grid(tmp_path, tick):
    path = tmp_path / "p.yaml"
    path.write_text(SMALLEST.replace("s.xml", f"s.xml, tick: {tick}"))
    (problem,) = refusal(path)
    assert (problem.code, problem.at.line) == ("HAL0023", 3)


def test_an_export_has_only_the_keys_of_its_format(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(
        "halpipe-pipeline: 1\nmodel: m.xml\nschedule: {output: s.xml}\nexports:\n"
        "  - {format: report, output: r.html, cluster: true}\n  - {format: raport, output: r.html}\n"
    )
    found = refusal(path)
    assert [(d.code, d.at.line) for d in found] == [("HAL0021", 5), ("HAL0901", 6)]
    assert 'did you mean "report"' in found[1].help
