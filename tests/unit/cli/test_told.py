"""Exit codes of failures, shares as text, and what is kept quiet: each at the edge where the text changes."""

import errno
import io
import os
from fractions import Fraction
from types import SimpleNamespace

import pytest
import typer

from halpipe.cli import compare, export, failures, output, schedule, searching, show, tools, whatif
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.options import WITHOUT_EFFECT
from halpipe.exporters.common.base import ExportOptions
from halpipe.models import Status
from support import job, model, task, version
from support import schedule as table


@pytest.fixture(autouse=True)
def brief():
    output.choose(None, quiet=False, verbose=False)
    yield
    output.choose(None, quiet=False, verbose=False)


class Abort(Exception):  # noqa: N818
    """What click raises for Ctrl-C at a prompt."""


@pytest.mark.parametrize(
    ("failure", "code", "said"),
    [
        (OSError(errno.ENOSPC, "full"), Exit.FINDINGS, "error: standard output: full"),
        (OSError(errno.EBADF, "closed"), Exit.FINDINGS, "error: standard output: closed"),
        (OSError(errno.ENOENT, "gone"), Exit.INTERNAL, "internal error: FileNotFoundError"),
        (ValueError("odd"), Exit.INTERNAL, "internal error: ValueError: odd"),
        (Abort(), Exit.INTERRUPTED, "interrupted"),
        (OSError(errno.EMFILE, "many"), Exit.FINDINGS, "no more open files, processes or threads"),
        (OSError(errno.ENOMEM, "none"), Exit.FINDINGS, "no more memory"),
        (MemoryError(), Exit.FINDINGS, "no more memory"),
        (RuntimeError("can't start new thread"), Exit.FINDINGS, "no more memory"),
        (RuntimeError("other"), Exit.INTERNAL, "internal error: RuntimeError: other"),
        (KeyError("can't start new thread"), Exit.INTERNAL, "internal error: KeyError"),
        (HalpipeError(WITHOUT_EFFECT("it"), exit=Exit.USAGE), Exit.USAGE, "error[HAL0025] it"),
    ],
)
def test_each_failure_has_its_exit_code_and_its_line(failure, code, said, capsys, monkeypatch):
    monkeypatch.setattr(failures, "save_report", lambda _: "report.txt")
    assert failures.told(failure) == code
    assert said in capsys.readouterr().err


def test_a_report_names_version_command_and_traceback():
    name = failures.save_report(ValueError("odd"))
    with open(name, encoding="utf-8") as file:
        text = file.read()
    assert text.startswith("halpipe ")
    assert "\ncommand: [" in text
    assert text.endswith("ValueError: odd\n")


@pytest.mark.parametrize(
    ("share", "floor", "rounded"), [("0", "0.0", "0.0"), ("1.2345", "123.4", "123.4"), ("1/3", "33.3", "33.3")]
)
def test_shares_have_one_decimal(share, floor, rounded):
    assert whatif._percent(Fraction(share)) == f"{floor} %"
    assert show._percent(Fraction(share)) == f"{rounded} %"


def test_growth_is_rounded_down_and_loads_to_the_nearest():
    assert (whatif._percent(Fraction("0.1239")), show._percent(Fraction("0.1239"))) == ("12.3 %", "12.4 %")
    assert tools._percent(Fraction("0.12345")) == "12.34 %"


def table_of(number, status):
    system = model(task("a", 10, version()))
    return table(system, 10, *(job(system, "a", 0, 0, "u1") for _ in range(number)), status=status)


@pytest.mark.parametrize("status", [Status.VALID, Status.NOT_FOUND])
def test_only_an_unfinished_schedule_is_replaced_by_the_next_best_one(tmp_path, status):
    from halpipe.exporters.native import format_schedule

    system = model(task("a", 10, version()))
    path = tmp_path / "s.best.xml"
    path.write_bytes(format_schedule(table_of(1, status)))
    assert searching._is_unfinished(str(path), system) == (status is not Status.VALID)
    place = searching._place_for_best(str(tmp_path / "s.xml"), system)
    assert place == str(tmp_path / ("s.best-2.xml" if status is Status.VALID else "s.best.xml"))


def test_a_search_into_a_stream_or_a_device_is_not_kept(tmp_path):
    from halpipe.pipeline.solve.schedule import SearchOptions

    system = model(task("a", 10, version()))
    kept = [searching._checkpoint(system, SearchOptions(), place) for place in ("-", "/dev/null", str(tmp_path))]
    assert kept == [None] * 3
    (tmp_path / "s.xml").write_text("")
    for name in ("s.xml", "new.xml"):
        found = searching._checkpoint(system, SearchOptions(), str(tmp_path / name))
        assert found._path == str(tmp_path / name.replace(".xml", ".resume"))


@pytest.mark.parametrize("unimproved", [False, True])
def test_a_checkpoint_stays_where_the_schedule_can_be_improved(unimproved, capsys):
    done = []
    kept = SimpleNamespace(remove=lambda: done.append("removed"), write=lambda: done.append("written"))
    searching._finish(kept, unimproved=unimproved)
    assert done == ["written" if unimproved else "removed"]
    assert ("--resume continues" in capsys.readouterr().err) == unimproved


def test_standard_input_is_no_model_of_several():
    with pytest.raises(typer.BadParameter, match="not standard input"):
        schedule._refuse_twins(["a.xml", "-"])
    with pytest.raises(typer.BadParameter, match=r"one name: x/a\.xml, y/a\.xml"):
        schedule._refuse_twins(["x/a.xml", "y/a.xml", "b.xml"])
    schedule._refuse_twins(["a.xml", "b.xml"])


def variants(count):
    return [SimpleNamespace(target=f"{n}", options={"near": None}, source=f"{n}.xml") for n in range(count)]


@pytest.mark.parametrize(("solvable", "shared"), [(0, 2), (1, 1), (3, 0)])
def test_the_others_share_with_the_first_that_has_a_schedule(solvable, shared, monkeypatch):
    """Those before it have none to share; each other one is near to it."""
    run = schedule._Run(None, SimpleNamespace(pressed=False), 3)

    def solve(chosen, processes):
        assert processes == 1
        number = int(chosen[0].target)
        run.solved[chosen[0].target] = SimpleNamespace(content=b"s" if number == solvable else b"")

    run.all = solve
    monkeypatch.setattr("halpipe.flow.fleet.near_to", lambda other, content, name: (other.target, content, name))
    found = run.share(variants(3))
    near = [(str(n), b"s", str(solvable)) for n in range(solvable + 1, 3)]
    assert found[min(solvable, 2) + 1 :] == near
    assert len(near) == shared
    assert len(found) == 3


def test_a_stopped_search_shares_nothing():
    run = schedule._Run(None, SimpleNamespace(pressed=True), 2)
    run.all = lambda chosen, _: run.solved.update({chosen[0].target: SimpleNamespace(content=b"")})
    assert [each.target for each in run.share(variants(2))] == ["0"]


def test_the_count_of_solved_models_is_for_terminals(monkeypatch, capsys):
    from halpipe.flow.fleet import Outcome, Solved

    run = schedule._Run(SimpleNamespace(keep=lambda *_: None), SimpleNamespace(pressed=False), 2)
    solved = Solved(Outcome.VALID, b"s")
    monkeypatch.setattr(output, "is_terminal", lambda _: False)
    run._take(variants(2)[0], solved)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(output, "is_terminal", lambda _: True)
    run._take(variants(2)[1], solved)
    assert capsys.readouterr().err == "\r2 of 2\n"
    output.choose(None, quiet=True, verbose=False)
    run._take(variants(2)[1], solved)
    assert capsys.readouterr().err == ""


def test_models_that_were_not_begun_are_counted(capsys):
    from halpipe.flow.fleet import Outcome, Solved

    run = schedule._Run(None, SimpleNamespace(pressed=False), 2)
    run.solved["0"] = Solved(Outcome.VALID, b"s", 3, 4)
    run.show(variants(2))
    told = capsys.readouterr()
    assert "1 of 2 were not begun" in told.err
    assert told.out.splitlines()[1].split() == ["0.xml", "valid", "3", "4"]


def test_columns_of_histograms_are_right_of_the_names(monkeypatch, capsys):
    from halpipe.pipeline.compare.histograms import BINS

    spread = SimpleNamespace(task="a", figure="start", least="1us", worst="22us", width="3us", counts=(1,) * BINS)
    monkeypatch.setattr("halpipe.pipeline.compare.histograms.histograms", lambda *_: [spread])
    compare._show_histograms([None], None)
    head, row = capsys.readouterr().out.splitlines()
    assert head.index("least") + len("least") == row.index("1us") + len("1us")


def test_an_export_shows_what_it_is_asked_for_unless_it_is_quiet(monkeypatch, capsys):
    monkeypatch.setattr("halpipe.importers.native.read_model", lambda _: None)
    monkeypatch.setattr("halpipe.flow.formats.endings_of", lambda *_: ())
    monkeypatch.setattr(export, "write_export", lambda *_: None)
    from halpipe.flow.formats import Exported

    monkeypatch.setattr("halpipe.flow.formats.export_with_remarks", lambda *_: Exported({"t": b"shown"}, ()))
    for shown, quiet in (("t", False), ("t", True), ("", False)):
        output.choose(None, quiet=quiet, verbose=False)
        exporter = SimpleNamespace(name="x", shown=shown)
        export.export_files(exporter, "m.xml", "", "out", ExportOptions())
        assert ("shown" in capsys.readouterr().out) == (bool(shown) and not quiet)


def test_closed_streams_do_not_take_the_place_of_files(monkeypatch):
    opened, asked = [], []

    def closed(descriptor):
        asked.append(descriptor)
        raise OSError

    calls = SimpleNamespace(fstat=closed, open=lambda *_: opened.append(1), devnull=os.devnull, O_RDWR=0)
    monkeypatch.setattr(output, "os", calls)
    monkeypatch.setattr(output.sys, "stdout", io.StringIO())
    monkeypatch.setattr(output.sys, "stderr", io.StringIO())
    output.prepare()
    assert (asked, len(opened)) == ([0, 1, 2], 3)


@pytest.mark.parametrize(("encoding", "printed"), [("utf-8", True), ("ascii", False), (None, True)])
def test_characters_that_the_terminal_lacks_are_known(encoding, printed, monkeypatch):
    monkeypatch.setattr(output.sys, "stdout", SimpleNamespace(encoding=encoding))
    assert output.can_print("·") is printed


@pytest.mark.parametrize("form", [None, output.Format.JSON])
@pytest.mark.parametrize("changes", ["", "changes.json"])
def test_changes_of_a_project_are_shown_as_lines_or_as_their_file(changes, form, capsys):
    from halpipe.flow.formats import Exported

    output.choose(form, quiet=False, verbose=False)
    export._show_changes(Exported({"changes.json": b"[7]\n"}, (), changes, ("f.arxml: one",)))
    told = capsys.readouterr()
    assert ("[7]" in told.out, "f.arxml: one" in told.err) == (bool(changes) and form is not None, bool(changes))


def test_without_a_terminal_charts_have_a_width_of_their_own(monkeypatch):
    asked = []
    size = SimpleNamespace(columns=77)
    asks = SimpleNamespace(get_terminal_size=lambda otherwise: asked.append(otherwise) or size)
    monkeypatch.setattr(show, "shutil", asks)  # the reports of pytest ask for the size, too
    assert (show._width(), asked[0][0]) == (77, 100)
