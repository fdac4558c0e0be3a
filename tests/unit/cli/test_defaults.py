"""Defaults of commands, and details of what they show: each where the smallest change of the code would show."""

import contextlib
import io
import signal
import sys
from fractions import Fraction
from types import SimpleNamespace

import pytest
import typer
from typer.main import get_command

import halpipe.cli
from halpipe.cli import app, checks, compare, deploy, output, schedule, searching, serve, show, tools
from halpipe.core.diagnostics import Exit, HalpipeError, about
from halpipe.models import ModeSchedule, ResourceLoad, Schedule, Status
from halpipe.models.modes import UNKNOWN_MODE
from halpipe.pipeline.verify.codes import OVERLAP
from support import ms


@pytest.fixture(autouse=True)
def brief():
    output.choose(None, quiet=False, verbose=False)
    yield
    output.choose(None, quiet=False, verbose=False)


def commands(group, path=()):
    for name, command in group.commands.items():
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))


NUMBERS = {"serve --port": 0, "selftest --mutants": 300, "selftest --seed": 1, "generate --seed": 1}


def test_a_switch_is_off_and_a_number_what_the_manual_says():
    """The options of formats and verbs are stated with their defaults; those of commands alone are here."""
    found, on = {}, set()
    for path, command in commands(get_command(app.build(app.VERBS))):
        for each in command.params:
            name = f"{' '.join(path)} --{each.name}"
            if getattr(each, "is_flag", False) and each.default is True:
                on.add(name)
            if type(each.default) is int:
                found[name] = each.default
    assert on == {"explain --exact", "explain --remedies"}  # which have a --no-...
    assert found == NUMBERS


def test_the_command_line_is_what_stands_after_the_program(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["halpipe", "--version"])
    monkeypatch.setattr("gc.set_threshold", lambda *_: None)
    monkeypatch.setattr(output, "prepare", lambda: None)
    assert halpipe.cli._run() == 0
    assert capsys.readouterr().out.startswith("halpipe ")


def test_counts_of_several_models_are_aligned_on_the_right(capsys):
    from halpipe.flow.fleet import Outcome, Solved

    run = schedule._Run(None, SimpleNamespace(pressed=False), 2)
    run.solved = {"0": Solved(Outcome.VALID, b"s", 3, 4), "1": Solved(Outcome.VALID, b"s", 10_000, 20_000)}
    run.show([SimpleNamespace(target=f"{n}", source=f"{n}.xml") for n in range(2)])
    head, first, second = capsys.readouterr().out.splitlines()
    assert first == "0.xml  valid        3      4"
    assert [len(line) for line in (head, first)] == [len(second)] * 2


# ------------------------------------------------------------------------------------------------ selftest


def outcome(**members):
    stated = {"valid": 1, "broken": 2, "differing": (), "unseen": (), "alone": {}}
    return SimpleNamespace(**stated | members)


@pytest.mark.parametrize(
    ("members", "code"),
    [({}, Exit.OK), ({"differing": ("a",)}, Exit.FINDINGS), ({"unseen": ("r",), "alone": {"r": 0}}, Exit.FINDINGS)],
)
def test_what_checkers_disagree_on_or_do_not_see_is_a_finding(monkeypatch, capsys, members, code):
    monkeypatch.setattr("halpipe.selftest.run", lambda *_: outcome(**members))
    assert tools.selftest() == code
    assert "the tests failed" not in capsys.readouterr().out


def test_so_many_disagreements_are_listed(monkeypatch, capsys):
    monkeypatch.setattr("halpipe.selftest.run", lambda *_: outcome(differing=[f"case {n}" for n in range(30)]))
    tools.selftest()
    assert capsys.readouterr().out.count("case ") == 20


def test_results_of_tests_are_for_the_evidence(monkeypatch):
    monkeypatch.setattr("halpipe.selftest.run", lambda *_: outcome())
    with pytest.raises(typer.BadParameter, match="add --evidence"):
        tools.selftest(results=["r.xml"])


# ------------------------------------------------------------------------------------------------ searches


@contextlib.contextmanager
def searched(monkeypatch, **members):
    """Let a search find this at once."""
    from halpipe.pipeline import checked

    stated = {"diagnostics": [], "reached": [], "moves": 1, "unimproved": False, "is_complete": True}
    table = SimpleNamespace(modes=[], transitions=[])
    found = SimpleNamespace(schedule=table, **stated | members)
    monkeypatch.setattr(checked, "schedule_model", lambda *_: found)
    monkeypatch.setattr("halpipe.exporters.native.format_schedule", lambda _: b"s")
    monkeypatch.setattr(searching, "write_output", lambda *_: None)
    monkeypatch.setattr(searching, "replace", lambda options, **_: options)
    yield SimpleNamespace(time_limit=None, budget=1)


@pytest.mark.parametrize("is_kept", [False, True])
def test_a_search_that_is_complete_leaves_its_checkpoint_behind(monkeypatch, is_kept):
    done = []
    kept = SimpleNamespace(claim=lambda: done.append("claimed"), remove=lambda: done.append("removed"))
    monkeypatch.setattr(searching, "_checkpoint", lambda *_: kept if is_kept else None)
    with searched(monkeypatch) as options:
        assert searching.find_schedule(None, options, "s.xml") == Exit.OK
    assert done == ["claimed", "removed"] * is_kept


def test_how_many_jobs_stay_is_said_once(monkeypatch, capsys):
    """The note is shown with all diagnostics under --verbose, and by itself otherwise; other notes are not."""
    notes = [SimpleNamespace(code=code, path="mode a", message=code, is_error=False) for code in ("HAL0414", "HAL0802")]
    monkeypatch.setattr(searching, "_checkpoint", lambda *_: None)
    monkeypatch.setattr(output, "report", lambda _: None)
    for verbose in (False, True):
        output.choose(None, quiet=False, verbose=verbose)
        with searched(monkeypatch, diagnostics=notes) as options:
            searching.find_schedule(None, options, "s.xml")
        said = capsys.readouterr().err
        assert ("mode a: HAL0414" in said) != verbose
        assert "HAL0802" not in said


def test_progress_is_that_of_a_mode_or_of_the_switches(monkeypatch):
    from halpipe.pipeline.solve.one_mode import CONSTRUCTING
    from halpipe.pipeline.solve.schedule import SWITCHES, UNBOUNDED

    bars, made = {}, []

    class Bars:
        def __init__(self, *_, **stated):
            made.append(stated["transient"])
            self.start = self.stop = lambda: None

        def add_task(self, what, total, state):
            bars[what] = [total, state]
            return what

        def update(self, what, completed, state):
            bars[what] = [bars[what][0], completed, state]

    monkeypatch.setattr("rich.progress.Progress", Bars)
    monkeypatch.setattr(output, "is_terminal", lambda _: True)
    with searching.Watch() as watch:
        assert watch.on_progress("a", 3, 10, CONSTRUCTING)
        assert watch.on_progress(SWITCHES, 1, 2, 0)
        watch.on_progress("b", 4, UNBOUNDED, 7)
        watch.on_better("c", "margin 5 %")
        watch.on_progress("c", 4, 9, 7)
    assert bars == {
        "mode a": [10, 3, "constructing"],
        SWITCHES: [2, 1, "1 of 2 mode pairs"],
        "mode b": [None, 4, "4 moves, best cost 7"],
        "mode c": [9, 4, "margin 5 %"],
    }
    assert made == [True]  # nothing of it is left on the terminal


# ------------------------------------------------------------------------------------------------ others


@pytest.mark.parametrize(
    ("codes", "text"),
    [(["HAL0864", "HAL0864", "HAL0800"], "longer phases now: 2 versions"), (["HAL0800"], "all phases are long enough")],
)
def test_what_was_prepared_counts_longer_phases(codes, text):
    found = [SimpleNamespace(code=code) for code in codes]
    assert deploy._what(SimpleNamespace(diagnostics=found)) == text


def test_further_traces_of_a_check_stand_beside_the_first():
    files = {"trace": b"1", "trace-2": b"2", "bandwidth": b"3"}
    assert deploy._traces("out/seen.csv", files) == {"out/seen.csv": b"1", "out/seen-2.csv": b"2"}


def test_the_server_searches_beside_the_page(monkeypatch, capsys):
    """The search ends with the server, so that Ctrl-C needs not wait for it."""
    uvicorn = pytest.importorskip("uvicorn", reason="the extra [serve]")
    threads, opened, closed = [], [], []
    session = SimpleNamespace(begin=lambda: None, close=lambda: closed.append(True), past=[])
    monkeypatch.setattr("halpipe.workbench.session.Session", lambda model, workers: session)
    monkeypatch.setattr("halpipe.workbench.server.application", lambda *_: None)
    monkeypatch.setattr("threading.Thread", lambda **stated: threads.append(stated) or SimpleNamespace(start=list))
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    monkeypatch.setattr(serve, "_open", lambda address, folder: opened.append(address))
    monkeypatch.setattr(serve, "_end_when_the_terminal_closes", lambda: None)
    for browser in (False, True):
        assert serve.serve._run("m.xml", 0, browser, 1) == Exit.OK
    assert [each["daemon"] for each in threads] == closed == [True, True]
    assert opened == capsys.readouterr().out.splitlines()[1:]


def test_a_closed_stream_is_no_terminal():
    stream = io.StringIO()
    stream.close()
    assert not output.is_terminal(stream)
    assert not output.is_terminal(None)


@pytest.mark.parametrize(("statuses", "is_unfinished"), [("vv", False), ("vn", True), ("nn", True), ("v", True)])
def test_a_schedule_is_unfinished_where_a_mode_has_none_or_is_not_valid(tmp_path, statuses, is_unfinished):
    from halpipe.exporters.native import format_schedule

    kinds = {"v": Status.VALID, "n": Status.NOT_FOUND}
    modes = tuple(
        ModeSchedule(name=f"m{n}", hyperperiod=ms(10), status=kinds[status], jobs=())
        for n, status in enumerate(statuses)
    )
    path = tmp_path / "s.best.xml"
    path.write_bytes(format_schedule(Schedule(model="m", modes=modes)))
    assert searching._is_unfinished(str(path), SimpleNamespace(modes=[1, 2])) == is_unfinished


def test_what_is_no_schedule_is_never_replaced(tmp_path):
    (tmp_path / "s.best.xml").write_text("notes")
    place = searching._place_for_best(str(tmp_path / "s.xml"), SimpleNamespace(modes=[1]))
    assert place == str(tmp_path / "s.best-2.xml")


@pytest.mark.parametrize(("peak", "mean"), [(None, Fraction(1)), (Fraction(1), None), (None, None)])
def test_figures_that_are_too_long_to_be_written_are_not_shown(capsys, peak, mean):
    loads = (ResourceLoad(resource="r", peak=peak, mean=mean),)
    mode = ModeSchedule(name="m", hyperperiod=ms(10), status=Status.VALID, jobs=(), resource_loads=loads)
    show._show_mode(mode, {}, every=False)
    assert "peak" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("failure", "code", "said"),
    [(KeyboardInterrupt, Exit.INTERRUPTED, "interrupted\n"), (MemoryError, Exit.FINDINGS, "no more memory\n")],
)
def test_what_fails_before_the_command_begins_is_said_without_its_libraries(monkeypatch, failure, code, said):
    written = []

    def fail():
        raise failure

    for name in ("_interrupt_on_termination", "_forget_all"):
        monkeypatch.setattr(halpipe.cli, name, lambda: None)
    monkeypatch.setattr(halpipe.cli, "_leave_when_interrupted", lambda _: None)
    monkeypatch.setattr(halpipe.cli, "_run", fail)
    monkeypatch.setattr("os.write", lambda stream, text: written.append((stream, text.decode())))
    with pytest.raises(SystemExit) as end:
        halpipe.cli.main()
    monkeypatch.undo()
    assert end.value.code == code
    [(stream, text)] = written
    assert (stream, text.endswith(said)) == (2, True)


def test_findings_of_a_task_are_gathered_beside_those_of_other_origin():
    of_task = [OVERLAP(f"job {n}", path=about(mode="m", task="a", job=n)) for n in range(3)]
    other = UNKNOWN_MODE("no such mode")
    [first, second] = checks.gathered([*of_task, other])
    assert first.message == 'job 0; 2 more like it: mode "m" task "a" job 1, mode "m" task "a" job 2'
    assert second == other


@pytest.mark.parametrize(
    ("target", "model", "written"),
    [("o.yaml", None, b"overlay"), ("o.yaml", 1, b"overlay"), ("m.xml", 1, b"model"), ("m.xml", None, None)],
)
def test_a_corrected_model_needs_the_model(monkeypatch, target, model, written):
    learned = SimpleNamespace(overlay=lambda _: b"overlay", corrected=lambda _: "corrected")
    files = {}
    monkeypatch.setattr("halpipe.pipeline.compare.learning.learn", lambda *_: learned)
    monkeypatch.setattr("halpipe.pipeline.compare.learning.described", lambda *_: ())
    monkeypatch.setattr("halpipe.exporters.native.format_model", lambda _: b"model")
    monkeypatch.setattr("halpipe.core.files.write_output", files.__setitem__)
    if written is None:
        with pytest.raises(HalpipeError, match="corrected model"):
            compare._learn([], None, model, "t.csv", target)
    else:
        compare._learn([], None, model, "t.csv", target)
    assert files == ({} if written is None else {target: written})


def test_a_request_to_end_while_python_clears_up_keeps_the_exit_code(monkeypatch):
    ended = []
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    kept = {number: signal.getsignal(number) for number in numbers}
    monkeypatch.setattr("os._exit", ended.append)
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # as of a shell that ignores it for its commands
        halpipe.cli._leave_when_interrupted(7)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.raise_signal(number)
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    assert ended == [7]
