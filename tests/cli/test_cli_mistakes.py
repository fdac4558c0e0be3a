"""Mistakes that everybody makes once, and what halpipe says of them."""

import re

import pytest

from command_line import run_here
from halpipe.exporters.native import format_model
from halpipe.starters import first_model
from support import model, task, version

AUTOSAR = '<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES/></AUTOSAR>'
AMALTHEA = '<am:Amalthea xmlns:am="http://app4mc.eclipse.org/amalthea/3.0.0"/>'


FAULTY_SPLITS = """<task-model xmlns="urn:halpipe:task-model:1" name="m">
 <platform><unit name="u"><interrupt name="i" distance="1ms" wcet="1ms"/></unit></platform>
 <tasks>
  <task name="a" period="10ms" slack="1">
   <version name="v" wcet="3ms" split="2ms 1ms 5ms" resume="-1ms"><units names="u"/></version>
  </task>
  <task name="b" period="5ms"><version name="v" wcet="3ms" split="anywhere"><units names="u"/></version></task>
  <task name="c" period="10ms" slack="1">
   <version name="v" wcet="3ms" split="anywhere" max-gaps="-1" min-part="-2ms"><units names="u"/></version>
  </task>
 </tasks>
 <modes><mode name="m"><run task="a" versions="v"/><run task="b" versions="v"/></mode></modes>
</task-model>
"""


@pytest.fixture
def folder(tmp_path):
    for name, content in first_model().items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / "extract.arxml").write_text(AUTOSAR)
    (tmp_path / "system.amxmi").write_text(AMALTHEA)
    (tmp_path / "trace.csv").write_text("task;start;end\nplan;0;1\n")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "trace.json").write_text('{"traceEvents": []}')
    (tmp_path / "trace.btf").write_text("#version 2.1.5\n")
    (tmp_path / "source.c").write_text("int main(void) { return 0; }\n")
    (tmp_path / "yaml.xml").write_text("nodes:\n  - name: /a\n")
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "schedule.xml", "-q").returncode == 0
    return tmp_path


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["validate", "extract.arxml"], "halpipe import arxml"),
        (["schedule", "system.amxmi", "-o", "s.xml"], "halpipe import amalthea"),
        (["validate", "overlay.yaml"], "halpipe import"),
        (["schedule", "graph.dot", "-o", "s.xml"], "halpipe import"),
        (["verify", "schedule.xml", "model.xml"], "MODEL first, then SCHEDULE"),
        (["export", "report", "schedule.xml", "model.xml", "-o", "r.html"], "MODEL first, then SCHEDULE"),
        (["show", "model.xml"], "this is a model"),
        (["validate", "overlay.yaml"], "--overlay FILE"),
        (["validate", "pipeline.yaml"], "halpipe run FILE"),
        (["validate", "graph.dot"], "halpipe import ros FILE"),
        (["validate", "source.c"], "`halpipe import` makes a model"),
        (["import", "arxml", "yaml.xml", "-o", "m.xml"], "it has the form of YAML"),
        (["compare", "trace.csv", "schedule.xml"], "halpipe compare SCHEDULE TRACE"),
        (["compare", "trace.json", "schedule.xml"], "halpipe compare SCHEDULE TRACE"),
        (["compare", "trace.btf", "schedule.xml"], "halpipe compare SCHEDULE TRACE"),
        (["compare", "schedule.xml", "schedule.xml"], "halpipe compare SCHEDULE TRACE"),
    ],
)
def test_a_file_of_another_kind(folder, words, remedy):
    refused = run_here(folder, *words)
    assert refused.returncode == 1
    assert remedy in refused.stderr


@pytest.mark.parametrize(
    ("text", "said", "remedy"),
    [
        ("tasks:\n\t/a: {wcet: 1ms}\n", "a tab indents the line", "indent the line with spaces"),
        ("units: [{name: u1}]\n", 'unknown key "units"', "platform: {units: ...}"),
        ("tasks: {/a: {wcet: '6,5ms'}}\n", "is not a duration", "write 6.5ms, with a decimal point"),
        ("tasks: {/a: {slack: '0,5'}}\n", "is not a number", "write 0.5, with a decimal point"),
    ],
)
def test_slips_in_an_overlay(folder, text, said, remedy):
    (folder / "o.yaml").write_text("halpipe-overlay: 1\n" + text)
    refused = run_here(folder, "import", "ros", "graph.dot", "--overlay", "o.yaml", "-o", "m.xml")
    assert refused.returncode == 1
    assert said in refused.stderr
    assert remedy in refused.stderr


def test_a_duration_may_have_a_blank_before_its_unit_but_no_comma(folder):
    text = (folder / "model.xml").read_text()
    (folder / "blank.xml").write_text(re.sub(r'period="(\d+)ms"', r'period="\1 ms"', text))
    assert run_here(folder, "validate", "blank.xml").returncode == 0
    (folder / "comma.xml").write_text(re.sub(r'period="(\d+)ms"', r'period="\1,5ms"', text, count=1))
    refused = run_here(folder, "validate", "comma.xml")
    assert ".5ms, with a decimal point" in refused.stderr


@pytest.mark.parametrize(
    "words",
    [
        "export report model.xml schedule.xml -o r.png",
        "export report model.xml schedule.xml -o r.PDF",
        "export graph model.xml -o g.png",
        "export arxml model.xml -o a.csv",
        "export btf model.xml schedule.xml -o b.json",
        "import ros graph.dot --overlay overlay.yaml -o m.yaml",
        "import ros graph.dot --overlay overlay.yaml -o m.xml --report r.html",
        "schedule model.xml -o s.json",
        "generate -o g.html",
        "run wrong.yaml",
    ],
)
def test_a_name_that_states_another_format(folder, words):
    (folder / "wrong.yaml").write_text(
        "halpipe-pipeline: 1\nmodel: model.xml\nschedule: {output: out.xml}\n"
        "exports: [{format: report, output: r.svg}]\n"
    )
    before = sorted(folder.iterdir())
    refused = run_here(folder, *words.split())
    assert (refused.returncode, "HAL0009" in refused.stderr) == (2, True), refused.stderr
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("words", ["export graph model.xml -o g.gv", "export report model.xml schedule.xml -o r.out"])
def test_a_name_that_states_the_format_or_none(folder, words):
    assert run_here(folder, *words.split()).returncode == 0


@pytest.mark.parametrize("text", ["tasks:\n  *: {wcet: 1ms}\n", "tasks: {a: {units: [*core]}}\n", "drop: *_log\n"])
def test_globs_without_quotes(folder, text):
    (folder / "o.yaml").write_text("halpipe-overlay: 1\n" + text)
    refused = run_here(folder, "import", "ros", "graph.dot", "--overlay", "o.yaml", "-o", "m.xml")
    assert refused.returncode == 1
    assert "quote names that begin with *" in refused.stderr


@pytest.mark.parametrize("verb", ["import", "export"])
def test_a_format_that_is_not_there_is_a_usage_error(folder, verb):
    refused = run_here(folder, verb, "arxmll", "model.xml", "-o", "x")
    assert refused.returncode == 2
    assert 'did you mean "arxml"' in refused.stderr


def test_malformed_restrictions_do_not_hide_what_else_is_wrong(tmp_path):
    """What the schema refuses and what the model means: all at once, by line."""
    (tmp_path / "model.xml").write_text(FAULTY_SPLITS)
    refused = run_here(tmp_path, "validate", "model.xml")
    assert refused.returncode == 1
    found = [line.split(" ")[0:2] for line in refused.stdout.splitlines() if line.startswith("model.xml:")]
    assert [(place.split(":")[1], code[6:13]) for place, code in found] == [
        ("2", "HAL0282"),
        ("5", "HAL0102"),
        ("5", "HAL0225"),
        ("5", "HAL0226"),
        ("7", "HAL0237"),
        ("9", "HAL0102"),
        ("9", "HAL0102"),
        ("12", "HAL0280"),
    ]


def test_other_violations_of_the_schema_are_all_that_is_said(tmp_path):
    (tmp_path / "model.xml").write_text(FAULTY_SPLITS.replace('period="10ms"', 'period="-1ms"'))
    refused = run_here(tmp_path, "validate", "model.xml")
    assert refused.returncode == 1
    assert {line.split("[")[1][:7] for line in refused.stderr.splitlines() if "error[" in line} == {"HAL0102"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["import", "ros", "graph.dot", "-o", "o.xml", "--name", ""], 'the text after "--name" is empty'),
        (["import", "ros", "graph.dot", "-o", "o.xml", "--name="], 'the text after "--name" is empty'),
        (["import", "ros", "graph.dot", "-o", "o.xml", "--name", " "], "the text is empty"),
        (["schedule", "model.xml", "-o", "o.xml", "--optimise", ","], "the text is empty"),
        (["validate", "model.xml", "--tick", ""], 'the text after "--tick" is empty'),
        (["show", "schedule.xml", "--mode", ""], 'the text after "--mode" is empty'),
        (["show", ""], 'the text after "show" is empty'),
        (["explain", "HAL0231", "--mode", "zz"], '"mode" has no effect here'),
        (["explain", "HAL0231", "--freeze", "missing.xml"], '"freeze" has no effect here'),
        (["generate", "-o", "o.xml", "--period", "5ms", "--tasks", "3"], '"tasks" has no effect here'),
        (["generate", "-o", "o.xml", "--seed", "1_000"], "write a number from 0 on"),
        (["generate", "-o", "o.xml", "--seed", "\uff11"], "write a number from 0 on"),
        (["schedule", "model.xml", "-o", "o.xml", "--workers", "0"], "write a number from 1 on"),
        (["size", "model.xml", "--units", "core", "--bandwidth", "memory"], '"bandwidth" has no effect here'),
        (["size", "model.xml", "--units", "cores"], 'did you mean "core"?'),
        (["compare", "schedule.xml", "played.btf", "--mode", "drive"], '"mode" has no effect here'),
        (["deploy", "trace", "bundle", "dump.bin", "-o", "o.csv", "--base", "-5"], "is no address"),
        (["deploy", "calibrate", "bundle", "dump.bin", "-o", "o.yaml", "--base", "1_0"], "is no address"),
        (["export", "btf", "model.xml", "schedule.xml", "-o", "o.btf", "--title", "a\nb"], "has control characters"),
    ],
)
def test_an_option_without_text_or_effect_is_refused(folder, words, text):
    assert run_here(folder, "export", "btf", "model.xml", "schedule.xml", "-o", "played.btf").returncode == 0
    done = run_here(folder, *words)
    assert done.returncode == 2, done.stderr
    assert text in " ".join(done.stderr.split())
    assert not (folder / "o.xml").exists()


MODEL, OVERLAY, PIPELINE = (first_model()[name].decode() for name in ("model.xml", "overlay.yaml", "pipeline.yaml"))
IMPORT = "import ros graph.dot --overlay {} -o o.xml"


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        ("schedule modle.xml -o o.xml", 'did you mean "model.xml"'),
        ("schedule model.xml -o o.xml --freeze ./schedul.xml", 'did you mean "./schedule.xml"'),
        ("schedule model.xml -o o.xml --jobs 4", "--workers"),
        ("schedule model.xml -o o.xml -j 4", "--workers"),
        ("schedule model.xml -o o.xml --timeout 5s", "--time-limit"),
        ("schedul model.xml -o o.xml", 'did you mean "schedule"?'),
        ("solve model.xml -o o.xml", 'did you mean "schedule"?'),
        ("plot schedule.xml", 'did you mean "show"?'),
        ("check model.xml", 'did you mean "validate" or "verify"?'),
        ("convert model.xml", 'did you mean "import" or "export"?'),
        ("build pipeline.yaml", 'did you mean "run"?'),
        ("deploy chek bundle", 'did you mean "check"'),
        ("frobnicate", "`halpipe -h` lists them"),
        ("export model.xml schedule.xml -o r.html", "the format comes before the files"),
        ("export html model.xml schedule.xml -o r.html", 'did you mean "report"?'),
        ("export autosar model.xml -o r.arxml", 'did you mean "arxml"?'),
        ("export perfetto model.xml schedule.xml -o r.json", 'did you mean "trace"?'),
        ("export csv model.xml schedule.xml -o r.csv", 'did you mean "xlsx"?'),
        ("import csv trace.csv -o o.xml", 'did you mean "table"?'),
        ("help schedul", 'did you mean "schedule"?'),
        ("schedule model.xml -o --seed 3", 'option "-o" lacks its value: "--seed" is an option'),
        ("import ros graph.dot --overlay -o o.xml", 'option "--overlay" lacks its value: "-o" is an option'),
        ("import ros overlay.yaml --overlay graph.dot -o o.xml", "name a YAML file after --overlay"),
        ("compare schedule.xml empty.csv", "it is empty"),
        ("validate empty.csv", "the file is empty"),
        ("deploy check model.xml", 'name a folder, or a bundle, in the place of "model.xml"'),
        ("run model.xml", "name a YAML file; a model is read by `halpipe validate`"),
        ("run overlay.yaml", "this is an overlay"),
        (IMPORT.format("pipeline.yaml"), "this is a pipeline: `halpipe run FILE`"),
    ],
)
def test_words_and_files_that_outsiders_try(folder, words, remedy):
    refused = run_here(folder, *words.split())
    assert refused.returncode in (1, 2)
    assert remedy in " ".join(refused.stderr.split())


@pytest.mark.parametrize(
    ("old", "new", "remedy"),
    [
        ('wcet="6ms"', 'WCET="6ms"', 'did you mean "wcet"?'),
        ('wcet="6ms"', 'cost="6ms"', 'did you mean "wcet"?'),
        ("max-reaction=", "max_reaction=", 'did you mean "max-reaction"?'),
        ('names="core1 core2"', 'names="core1,core2"', 'blanks alone separate names: "core1 core2"'),
        ('"camera detection brake"', '"camera -> brake"', "blanks alone separate names"),
        ('wcet="6ms"', 'wcet="6,5ms"', "write 6.5ms, with a decimal point"),
        ('name="first"', 'name="a & b"', 'write "&amp;" for "&"'),
        ('wcet="6ms"', "wcet=6ms", "put the value of every attribute in quotes"),
        ("</tasks>", "</task>", "close each element with the name that opens it"),
        ("<?xml ", "\n<?xml ", "remove what stands before <?xml"),
        ('encoding="UTF-8"', 'encoding="UTF-16"', "declare the encoding that the file has"),
        ("</task-model>", "", "the end of the file is missing"),
        ('task="camera" from', 'task="CAMERA" from', 'did you mean "camera"?'),
    ],
)
def test_slips_in_a_model(folder, old, new, remedy):
    assert old in MODEL
    (folder / "m.xml").write_text(MODEL.replace(old, new, 1))
    refused = run_here(folder, "validate", "m.xml")
    assert refused.returncode == 1
    assert remedy in refused.stdout + refused.stderr


@pytest.mark.parametrize(
    ("words", "text", "old", "new", "remedy"),
    [
        (IMPORT, OVERLAY, "wcet: 6ms", "wcet 6ms", 'write "wcet: 6ms"'),
        (IMPORT, OVERLAY, "[core1, core2]", "core1, core2", "put lists in brackets"),
        (IMPORT, OVERLAY, "  /camera:", " /camera:", "begin the keys of one level in the same column"),
        (IMPORT, OVERLAY, "wcet: 6ms}", "wcet: 6ms", "close the bracket"),
        (IMPORT, OVERLAY, "wcet: 6ms", "wcet: 6ms, wcet: 7ms", "remove one of the two"),
        (IMPORT, OVERLAY, "wcet: 6ms", "cost: 6ms", 'did you mean "wcet"?'),
        ("run {}", PIPELINE, "schedule.xml}", "schedule.xml, optimise: chains jitter}", "write commas between words"),
        ("run {}", PIPELINE, "output: out/report", "file: out/report", 'did you mean "output"?'),
        ("run {}", PIPELINE, "format: report", "format: html", 'did you mean "report"?'),
        ("run {}", PIPELINE, "model: model", "model: modle", 'did you mean "model.xml"'),
    ],
)
def test_slips_in_a_yaml_file(folder, words, text, old, new, remedy):
    assert old in text
    (folder / "f.yaml").write_text(text.replace(old, new, 1))
    refused = run_here(folder, *words.format("f.yaml").split())
    assert refused.returncode == 1
    assert remedy in refused.stderr


@pytest.mark.parametrize(("wcet", "code"), [("2ms", 0), ("3ms", 4), ("-3ms", 1)])
def test_schedule_and_explain_leave_with_the_same_code(tmp_path, wcet, code):
    """An overload proves that there is no schedule; a model that is wrong proves nothing."""
    system = model(task("a", 10, version("v", "8ms", "u")), task("b", 10, version("v", "7ms", "u")), units="u")
    (tmp_path / "model.xml").write_bytes(format_model(system).replace(b'"7ms"', f'"{wcet}"'.encode()))
    for words in (["schedule", "model.xml", "-o", "s.xml"], ["explain", "model.xml"]):
        assert run_here(tmp_path, *words).returncode == code


@pytest.mark.parametrize(
    ("schedule", "export", "line"), [("mode: [lim]", "", 3), ("mode: [all]", "mode: lim,", 5), ("seed: 1", "", None)]
)
def test_an_unknown_mode_in_a_pipeline_is_reported_at_its_section(tmp_path, schedule, export, line):
    (tmp_path / "model.xml").write_bytes(format_model(model(task("a", 10, version("v", 1, "u")), units="u")))
    lines = "halpipe-pipeline: 1", "model: model.xml", f"schedule: {{{schedule}, output: s.xml}}", "exports:"
    (tmp_path / "p.yaml").write_text("\n".join((*lines, f"  - {{format: graph, {export} output: g.dot}}")))
    done = run_here(tmp_path, "run", "p.yaml")
    assert done.returncode == (2 if line else 0)
    assert ("HAL0802" in done.stderr) == (f"p.yaml:{line}: error[HAL0802] there is no mode" in done.stderr)
    assert (line is not None) == ("HAL0802" in done.stderr)


ARXML, AMXMI = (f"`halpipe import {format} FILE" for format in ("arxml", "amalthea"))
DOT, TABLE, OTHER = "`halpipe import ros", "`halpipe import table", "`halpipe import` makes"
ROWS, GRAPH = "name a table with", "the importer reads"
"""What the importers of tables and of graphs say of a file that no other importer reads."""


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        (f'<?xml version="1.0"?><!-- a\nb -->{AUTOSAR}', {"amalthea": ARXML, "ros": ARXML, "table": ARXML}),
        (AMALTHEA, {"arxml": AMXMI, "ros": AMXMI, "table": AMXMI}),
        ('digraph { "/a" -> "/b"; }', {"arxml": DOT, "amalthea": DOT, "table": DOT}),
        ("task,period,wcet\n", {"arxml": TABLE, "amalthea": TABLE, "ros": TABLE, "table": ROWS}),
        ("a,b\n1,2\n", {"arxml": TABLE, "amalthea": TABLE, "ros": TABLE, "table": ROWS}),
        ("# Head\n\nA sentence is no row, and has a comma.\n", {"arxml": OTHER, "amalthea": OTHER, "ros": GRAPH}),
        ("words", {"arxml": OTHER, "amalthea": OTHER, "ros": GRAPH, "table": ROWS}),
    ],
)
def test_the_wrong_importer_names_the_one_that_reads_the_file(tmp_path, text, advice):
    (tmp_path / "file").write_text(text)
    for format, said in advice.items():
        refused = run_here(tmp_path, "import", format, "file", "-o", "o.xml")
        assert refused.returncode == 1
        helps = [line for line in refused.stderr.splitlines() if "help: " in line]
        assert any(said in line for line in helps), (format, helps)
