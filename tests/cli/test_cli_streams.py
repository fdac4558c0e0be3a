"""Standard streams that are closed, full or abandoned, signals at any moment, little memory: never a traceback."""

import ast
import errno
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import halpipe.cli
from halpipe.cli import UNLOADABLE, invoke, main, output
from halpipe.cli.failures import OUT_OF_MEMORY
from halpipe.core.diagnostics import HalpipeError

PYTHON = f"{sys.executable} -m halpipe"


@pytest.fixture
def shell(folder, halpipe):
    """Run a line of shell in the folder; `PYTHON` is the command."""
    assert halpipe("schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0

    def run(line):
        return subprocess.run(
            ["bash", "-c", line.replace("halpipe", PYTHON)], cwd=folder, capture_output=True, text=True, check=False
        )

    return run


@pytest.mark.parametrize("fault", ["2>&-", "2>/dev/full", "2> >(head -c 0)"])
def test_no_schedule_is_lost_for_want_of_somebody_to_tell(shell, folder, fault):
    run = shell(f"halpipe schedule model.xml -o new.xml {fault}")
    assert (run.returncode, run.stdout) == (0, "")
    assert (folder / "new.xml").read_bytes() == (folder / "s.xml").read_bytes()


@pytest.mark.parametrize("verb", ["show s.xml", "schedule model.xml -q -o -", "--help"])
def test_a_reader_who_has_enough_is_no_failure(shell, verb):
    run = shell(f"halpipe {verb} | head -c 1 >/dev/null; exit ${{PIPESTATUS[0]}}")
    assert (run.returncode, run.stderr) == (0, "")
    run = shell(f"(sleep 0.2; halpipe {verb}; echo $? >&2) | true")
    assert run.stderr == "0\n"


@pytest.mark.parametrize("fault", [">&-", ">/dev/full"])
@pytest.mark.parametrize("verb", ["show s.xml", "schedule model.xml -q -o -"])
def test_a_result_that_cannot_be_printed_is_an_error(shell, fault, verb):
    run = shell(f"halpipe {verb} {fault}")
    assert run.returncode == 1
    assert "-: error[HAL0003]" in run.stderr
    assert "Traceback" not in run.stderr
    assert "Exception ignored" not in run.stderr


def test_what_the_encoding_lacks_is_escaped(shell):
    run = shell("PYTHONIOENCODING=ascii halpipe show modèle.xml")
    assert run.returncode == 1
    assert r"mod\xe8le.xml" in run.stderr
    copied = "cp hopeless.xml modèle.xml; PYTHONIOENCODING=ascii"
    run = shell(f"{copied} halpipe explain modèle.xml --no-exact --no-remedies")
    assert r"mod\xe8le.xml:" in run.stdout


def test_a_chart_can_be_read_in_an_ascii_terminal(shell):
    """Each moment is one column, also one in which nothing runs."""
    run, plain = shell("PYTHONIOENCODING=utf-8 halpipe show s.xml"), shell("PYTHONIOENCODING=ascii halpipe show s.xml")
    assert (plain.returncode, plain.stderr) == (0, "")
    assert "·" in run.stdout
    assert plain.stdout == run.stdout.replace("·", ".")


@pytest.mark.slow  # test_cli_trouble.py has the quicker one: Ctrl-C during the search
def test_ctrl_c_at_any_moment_is_no_traceback(folder):
    """From the first line of halpipe on; before it, Python itself starts."""
    started = subprocess.Popen([sys.executable, "-c", "pass"])
    begin = time.monotonic()
    started.wait()
    python = time.monotonic() - begin
    for step in range(0, 15, 2):
        run = subprocess.Popen(
            [sys.executable, "-m", "halpipe", "schedule", "hopeless.xml", "-o", f"{step}.xml"],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        time.sleep(2 * python + step * 0.02)
        run.send_signal(signal.SIGTERM if step % 8 == 6 else signal.SIGINT)
        _, said = run.communicate(timeout=300)
        if "halpipe" not in said and ("Traceback" in said or run.returncode < 0):
            continue  # Python itself was still starting
        assert "Traceback" not in said
        assert run.returncode in (130, 3)
        assert not [name for name in os.listdir(folder) if name.endswith("tmp")]


def test_ctrl_c_while_a_class_is_made_is_no_bug(monkeypatch, capsys):
    """Python before 3.12 makes a RuntimeError of what is raised in `__set_name__`."""

    class Interrupted:
        def __set_name__(self, owner, name):
            raise KeyboardInterrupt

    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: lambda **_: type("Made", (), {"x": Interrupted()}))
    assert invoke(["doctor"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_ctrl_c_within_a_command_is_said(monkeypatch, capsys):
    """Some versions of typer end a command on Ctrl-C by themselves, and say nothing."""

    def interrupt(path):
        raise KeyboardInterrupt

    monkeypatch.setattr("halpipe.importers.native.read_what_is_well_formed", interrupt)
    assert invoke(["validate", "model.xml"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_what_fails_while_ctrl_c_is_answered_is_told(monkeypatch, capsys):
    def fail(**_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            raise HalpipeError(OUT_OF_MEMORY("the best placement is not saved"))  # noqa: B904 - as it happens

    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: fail)
    assert invoke(["doctor"]) == 1
    assert "the best placement is not saved" in capsys.readouterr().err


@pytest.mark.parametrize(
    "failure",
    [
        MemoryError(),
        OSError(12, "Cannot allocate memory"),
        BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
        OSError(errno.EMFILE, "Too many open files"),
        RuntimeError("can't start new thread"),
        ImportError("libx.so: failed to map segment from shared object"),
        SystemError("<built-in function compile> returned NULL without setting an exception"),
    ],
)
def test_want_of_memory_is_no_bug(monkeypatch, capsys, failure):
    def fail(**_):
        raise failure

    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: fail)
    assert invoke(["doctor"]) == 1
    said = capsys.readouterr().err
    assert OUT_OF_MEMORY.id in said
    assert "bug" not in said


@pytest.mark.parametrize("failure", UNLOADABLE)
def test_want_of_memory_is_told_where_it_keeps_from_telling(monkeypatch, capfd, failure):
    def fail(*_, **__):
        raise failure

    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: fail)
    monkeypatch.setattr("halpipe.cli.failures.told", fail)
    assert invoke(["doctor"]) == 1
    assert capfd.readouterr().err == "error[HAL0007] the system gives no more memory\n"


@pytest.mark.parametrize("failure", UNLOADABLE)
def test_want_of_memory_before_a_command_begins_is_told(monkeypatch, capfd, failure):
    def fail():
        raise failure

    monkeypatch.setattr("halpipe.cli._run", fail)
    monkeypatch.setattr("halpipe.cli._leave_when_interrupted", lambda code: None)
    monkeypatch.setattr("halpipe.cli._forget_all", lambda: None)
    with pytest.raises(SystemExit) as end:
        main()
    assert (end.value.code, capfd.readouterr().err) == (1, "error[HAL0007] the system gives no more memory\n")


@pytest.mark.slow  # test_want_of_memory_is_no_bug is the quicker one
def test_little_memory_is_told(folder):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (260 * 2**20, 260 * 2**20))

    (folder / "big.xml").write_bytes(b'<task-model name="' + b"x" * 250 * 2**20 + b'"/>')
    run = subprocess.run(
        [sys.executable, "-m", "halpipe", "validate", "big.xml"],
        cwd=folder, preexec_fn=limit, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert OUT_OF_MEMORY.id in run.stderr
    assert "bug" not in run.stderr


def test_a_bug_is_told_where_no_report_can_be_saved(monkeypatch, capsys):
    def fail(**_):
        raise ZeroDivisionError("\x1b]0;owned\x07")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: fail)
    monkeypatch.setattr("tempfile.NamedTemporaryFile", full)
    assert invoke(["doctor"]) == 70
    said = capsys.readouterr().err
    assert "no report could be saved" in said
    assert "\x1b" not in said


# ------------------------------------------------------------------------------------------------ terminals

STEERING = "\x1b]0;owned\x07\u009b31m\u009d\u202e\u2028\r"


def is_harmless(text):
    return all(character.isprintable() or character == "\n" for character in text)


def test_names_from_files_do_not_steer_the_terminal(folder, halpipe):
    """Every verb, on files whose names steer, whose texts do, and whose elements have such names."""
    hostile = f"{STEERING}.xml"
    (folder / hostile).write_bytes((folder / "model.xml").read_bytes())
    lines = [
        ["validate", hostile],
        ["schedule", hostile, "-o", f"s-{hostile}"],
        ["verify", hostile, f"s-{hostile}"],
        ["show", f"s-{hostile}", "--mode", STEERING],
        ["show", f"s-{hostile}"],
        ["diff", hostile, f"s-{hostile}"],
        ["export", "graph", hostile, "-o", f"{STEERING}.dot"],
        ["export", STEERING, hostile, "-o", "x"],
        ["explain", hostile],
        ["explain", STEERING],
        ["size", hostile],
        ["sensitivity", hostile],
        ["compare", f"s-{hostile}", hostile],
        ["deploy", "check", STEERING],
        ["run", STEERING],
        ["generate", "-o", f"g-{hostile}", "--period", STEERING],
        ["generate", "-o", f"g-{hostile}", "--tasks", "3"],
        [STEERING],
        ["doctor", f"--{STEERING}"],
    ]
    for number, line in enumerate(lines):
        for form in ([], ["--format", "json"]) if number % 2 else ([],):
            run = halpipe(*line, *form)
            assert run.returncode != 70, run.stderr
            assert is_harmless(run.stdout), line
            assert is_harmless(run.stderr), line


ARXML = """<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES><AR-PACKAGE><SHORT-NAME>p{s}</SHORT-NAME><ELEMENTS>
<APPLICATION-SW-COMPONENT-TYPE><SHORT-NAME>c{s}</SHORT-NAME></APPLICATION-SW-COMPONENT-TYPE>
</ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>"""
CARET = """named_paths: []
executors: []
nodes:
- node_name: "/n{s}"
  callbacks:
  - {{callback_name: "/n{s}/c", callback_type: timer_callback, period_ns: 10000000}}
  - {{callback_name: "/n{s}/d", callback_type: "odd{s}"}}
  "key{s}": 1
"""


@pytest.mark.parametrize(
    ("format", "name", "text"),
    [("arxml", "a.arxml", ARXML), ("ros", "a.yaml", CARET), ("ros", "a.dot", "digraph {{ {s} }}")],
)
def test_names_in_sources_do_not_steer_the_terminal(folder, halpipe, format, name, text):
    steering = "\u009b31m\u009d\u202e" if format == "arxml" else r"\e]0;owned\a\u202E\u009B"
    (folder / name).write_text(text.format(s=steering))
    for form in ([], ["--coverage", "-v"], ["--format", "json"], ["--format", "sarif"]):
        run = halpipe("import", format, name, "-o", "m.xml", *form)
        assert run.returncode in (0, 1)
        assert is_harmless(run.stdout + run.stderr)


def test_the_seam_escapes_whatever_it_is_given(capsys):
    output.choose(None, quiet=False, verbose=True)
    output.say(f"a{STEERING}\nb")
    output.inform(STEERING)
    output.result(f"a{STEERING}\nb")
    output.text(f"a{STEERING}\nb")
    output.table((STEERING, "b"), [("c", STEERING), ("日本", "x")])
    output.report([OUT_OF_MEMORY(f"a{STEERING}\nb", path=STEERING, help=STEERING)])
    shown = capsys.readouterr()
    assert is_harmless(shown.out)
    assert is_harmless(shown.err)
    assert len(shown.err.splitlines()) == 4


def test_columns_are_aligned_by_what_a_terminal_shows():
    lines = list(output.columns(("name", "n"), [("日本", "1"), ("a", "10")], right=[1]))
    assert lines == ["name   n", "日本   1", "a     10"]


def test_nothing_is_printed_past_the_seam():
    """Names of attributes and functions that print; `searching` draws its progress, of which it escapes the names."""
    found = set()
    for path in Path(halpipe.cli.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                if name.split(".")[-1] in ("print", "echo", "secho", "write", "Console"):
                    found.add((path.name, name))
    assert found == {
        ("__init__.py", "os.write"),  # when there is no memory for more
        ("app.py", "typer.echo"),
        ("failures.py", "stream.write"),
        ("import_.py", "Console"),  # a bar without a name
        ("output.py", "_open(sys.stderr).write"),
        ("output.py", "_open(sys.stdout).write"),
        ("searching.py", "Console"),
        ("searching.py", "checkpoint.write"),
    }
