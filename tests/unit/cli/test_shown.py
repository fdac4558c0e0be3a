"""What commands show on a terminal: columns, the first of many, counts of the rest, colours."""

import json
import re

import pytest

from command_line import run_here
from halpipe.cli import checks, import_, output, show, tools
from halpipe.core.diagnostics import Location, Severity
from halpipe.core.settings import UNKNOWN_KEY
from halpipe.flow.formats import UNSCHEDULABLE_YET
from halpipe.importers.common.base import Coverage
from halpipe.pipeline.compare.codes import ALIGNED
from halpipe.pipeline.diff import Change, JobChange
from halpipe.starters import first_model
from support import job, model, task, version

CODES = {code.severity: code for code in (UNKNOWN_KEY, UNSCHEDULABLE_YET, ALIGNED)}


@pytest.fixture(autouse=True)
def brief():
    output.choose(None, quiet=False, verbose=False)
    yield
    output.choose(None, quiet=False, verbose=False)


def test_columns_are_as_wide_as_their_widest_cell_on_a_terminal():
    lines = list(output.columns(("a", "n"), [("日本", "7"), ("é", "123"), ("e\u0301", "")], right=(1,)))
    assert lines == ["a       n", "日本    7", "é     123", "e\u0301"]


@pytest.mark.parametrize(("severity", "most"), [(Severity.ERROR, 20), (Severity.WARNING, 4), (Severity.NOTE, 0)])
def test_the_first_of_one_code_are_shown_and_the_rest_is_counted(severity, most, capsys):
    code = CODES[severity]
    output.report([code(f"finding {number}") for number in range(most)], as_result=True)
    assert "--verbose" not in capsys.readouterr().out
    output.report([code(f"finding {number}") for number in range(most + 2)], as_result=True)
    shown = capsys.readouterr().out
    assert shown.count("finding") == most
    assert f"2 {'more ' if most else ''}{severity}s; --verbose shows all" in shown
    output.report([code(f"finding {number}") for number in range(most + 1)], as_result=True)
    assert re.search(rf"^1 (more )?{severity}; --verbose", capsys.readouterr().out, re.MULTILINE)
    output.choose(None, quiet=False, verbose=True)
    output.report([code(f"finding {number}") for number in range(most + 2)], as_result=True)
    assert capsys.readouterr().out.count("finding") == most + 2


@pytest.mark.parametrize(
    ("every", "lines"),
    [
        (
            False,
            [
                "  element  read  mapped  ignored",
                "  task        3       2        1",
                "  and 4 elements of 2 kinds, none mapped",
                "  2 values defaulted; --coverage lists them and every ignored element",
            ],
        ),
        (
            True,
            [
                "  element  read  mapped  ignored",
                "  colour      3       0        3",
                "  note        1       0        1",
                "  task        3       2        1",
                "  ignored task t (f.xml:3): runs in no mode",
                "  ignored note n (f.xml:4): no influence",
                "  default task a: period = 5ms (f.xml:9)",
                "  default platform: units = core0",
            ],
        ),
    ],
)
def test_the_coverage_of_an_import_lists_what_decides_timing_and_counts_the_rest(every, lines):
    found = Coverage()
    found.mapped("task", 2)
    found.dropped("colour", 3)
    found.ignored("task", "t", "runs in no mode", Location("f.xml", 3))
    found.ignored("note", "n", "no influence", Location("f.xml", 4))
    found.defaulted("task a", "period", "5ms", Location("f.xml", 9))
    found.defaulted("platform", "units", "core0")
    assert import_._account(found, every) == lines
    assert import_._account(Coverage(), every) == lines[:1]


@pytest.mark.parametrize("is_there", [True, False])
def test_doctor_says_which_programs_are_found(is_there, tmp_path, monkeypatch):
    monkeypatch.setattr(tools.shutil, "which", lambda name: name if is_there else None)
    assert set(json.loads(run_here(tmp_path, "doctor", "--format", "json").stdout)["programs"].values()) == {is_there}
    assert ("dot: found" in run_here(tmp_path, "doctor").stdout) is is_there


def test_only_the_first_label_has_a_colour():
    found = CODES[Severity.ERROR]("error[X]")
    text = f"error[{found.code}] and error[{found.code}]"
    assert output._coloured(text, found).count("\x1b[31;1m") == 1


@pytest.mark.parametrize(("count", "more"), [(40, ""), (41, "1 more"), (45, "5 more")])
def test_values_that_differ_are_counted_beyond_the_shown(count, more, capsys):
    show._show_values([Change(f"task {number}", "period", "1ms", "2ms") for number in range(count)])
    shown = capsys.readouterr().out
    assert (shown.count("period"), "more" in shown) == (min(count, 40), bool(more))
    assert shown.splitlines()[40:] == ([f"  {more}; --verbose shows all"] if more else [])


@pytest.mark.parametrize(("count", "more"), [(5, ""), (6, "1 more"), (9, "4 more")])
def test_jobs_that_differ_are_counted_beyond_the_shown(count, more, capsys):
    owner = model(task("a", 10, version("v", 3)))
    changes = [
        JobChange("m", job(owner, "a", n, 10 * n, "u1"), job(owner, "a", n, 10 * n + 1, "u1")) for n in range(count)
    ]
    show._show_changed_jobs(changes)
    shown = capsys.readouterr().out
    assert (shown.count(" job "), more in shown, "more" in shown) == (min(count, 5), True, bool(more))


@pytest.mark.parametrize(("columns", "longest"), [("60", 60), ("300", 100)])
def test_the_page_of_a_code_is_as_wide_as_the_terminal_up_to_a_hundred(columns, longest, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    lines = checks._wrapped("word " * 200).splitlines()
    assert longest - 5 < max(map(len, lines)) <= longest


def test_codes_that_are_none_are_refused(tmp_path):
    done = run_here(tmp_path, "explain", f"HAL{9999}")
    assert (done.returncode, "there is no code" in done.stderr) == (2, True)
    for written in ("hal0231", "231"):
        done = run_here(tmp_path, "explain", written)
        assert (done.returncode, done.stdout.startswith("HAL0231 (error): ")) == (0, True)


def test_jobs_are_listed_up_to_two_hundred(capsys):
    owner = model(task("a", 1, version("v", "0.5ms")))
    from support import schedule

    for count, listed in ((200, True), (201, False)):
        table = schedule(owner, count, *(job(owner, "a", n, n, "u1") for n in range(count))).modes[0]
        show._show_mode(table, {"a": "A"}, every=False)
        shown = capsys.readouterr().out
        assert ("--jobs lists them" not in shown) == listed
        assert (shown.count(" a ") >= 200) == listed


def test_a_sensitivity_has_no_sarif_form(tmp_path):
    for name, content in first_model().items():
        if name == "model.xml":
            (tmp_path / name).write_bytes(content)
    done = run_here(tmp_path, "sensitivity", "model.xml", "s.xml", "--format", "sarif")
    assert (done.returncode, "sarif" in done.stderr) == (2, True)


@pytest.mark.parametrize(("total", "is_shown"), [(None, False), (import_._LARGE, False), (import_._LARGE + 1, True)])
def test_a_bar_is_shown_while_a_large_input_is_read(total, is_shown, monkeypatch):
    made = []

    def start(progress):
        made.append(progress)

    monkeypatch.setattr(output, "is_terminal", lambda stream: True)
    monkeypatch.setattr("rich.progress.Progress.start", start)
    with import_._progress() as show:
        if total:
            show(1, total)
        assert [task.visible for task in made[0].tasks] == [is_shown]
