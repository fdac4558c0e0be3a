"""Trouble: bad files, full devices, closed pipes, Ctrl-C, bugs. Never a traceback, never a damaged output."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import halpipe.cli

BAD_MODELS = {
    "broken": "<task-model xmlns='urn:halpipe:task-model:1' name='m'><platform>",
    "empty": "",
    "binary": "\x00\x01\x02",
    "doctype": '<!DOCTYPE x [<!ENTITY a "b">]><task-model xmlns="urn:halpipe:task-model:1" name="m"/>',
    "namespace": "<task-model xmlns='urn:other' name='m'/>",
    "root": "<schedule xmlns='urn:halpipe:schedule:1' model='m'/>",
    "no-unit": "<task-model xmlns='urn:halpipe:task-model:1' name='m'><platform/><tasks><task name='a' period='25'/>"
    "</tasks><modes/></task-model>",
}


@pytest.mark.parametrize("kind", BAD_MODELS)
@pytest.mark.parametrize("verb", ["validate", "schedule", "verify", "export"])
def test_a_bad_model_is_a_diagnostic_with_its_place(halpipe, folder, kind, verb):
    (folder / "bad.xml").write_text(BAD_MODELS[kind])
    (folder / "out.xml").write_text("precious")
    arguments = {
        "validate": ["validate", "bad.xml"],
        "schedule": ["schedule", "bad.xml", "-o", "out.xml"],
        "verify": ["verify", "bad.xml", "bad.xml"],
        "export": ["export", "graph", "bad.xml", "-o", "out.xml"],
    }[verb]
    failed = halpipe(*arguments)
    said = failed.stdout + failed.stderr
    assert failed.returncode == 1
    assert "bad.xml" in said
    assert "error[HAL" in said
    assert "Traceback" not in said
    assert (folder / "out.xml").read_text() == "precious"


def test_a_full_output_device(halpipe, folder):
    failed = halpipe("schedule", "model.xml", "-o", "/dev/full")
    assert failed.returncode == 1
    assert "HAL0003" in failed.stderr
    full = subprocess.run(
        [sys.executable, "-m", "halpipe", "schedule", "model.xml", "-o", "-"],
        cwd=folder,
        stdout=open("/dev/full", "wb"),  # noqa: SIM115
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert full.returncode == 1
    assert "Traceback" not in full.stderr


def test_an_output_folder_that_is_a_file(halpipe, folder):
    failed = halpipe("schedule", "model.xml", "-o", "model.xml/schedule.xml")
    assert failed.returncode == 1
    assert "HAL0003" in failed.stderr


def test_a_closed_pipe_is_no_error(halpipe, folder):
    command = f"{sys.executable} -m halpipe schedule model.xml -q -o - | head -c 1 >/dev/null; exit ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, check=False)
    assert ended.stderr == ""


def is_searching(process, folder):
    """Tell whether the search is on, by the library it has loaded; where the system does not say, by a checkpoint."""
    try:
        return "/native/kernel" in Path(f"/proc/{process.pid}/maps").read_text()
    except OSError:
        return (folder / "s.resume").exists()


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_saves_the_best_so_far(folder, wait_until, signum):
    kept = signal.signal(signum, signal.SIG_DFL)  # a process inherits what nohup or a shell ignores
    search = subprocess.Popen(
        [sys.executable, "-m", "halpipe", "schedule", "hopeless.xml", "--budget", "1000000000", "-o", "s.xml"],
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    signal.signal(signum, kept)
    wait_until(lambda: search.poll() is not None or is_searching(search, folder))
    search.send_signal(signum)
    _, said = search.communicate(timeout=300)
    assert search.returncode == 130
    assert "Traceback" not in said
    assert "HAL0402" in said
    assert (folder / "s.best.xml").exists()
    assert (folder / "s.resume").exists()
    assert not (folder / "s.xml").exists()


def test_a_bug_is_reported_in_a_file_and_not_as_a_traceback(monkeypatch, capsys, tmp_path):
    import halpipe.importers.native as native

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(native, "read_what_is_well_formed", lambda path: 1 // 0)
    assert halpipe.cli.invoke(["validate", "model.xml"]) == 70
    said = capsys.readouterr().err
    assert "internal error: ZeroDivisionError" in said
    assert "Traceback" not in said
    (report,) = tmp_path.glob("halpipe-bug-*.txt")
    assert "ZeroDivisionError" in report.read_text()


def test_no_colour_without_a_terminal(halpipe, folder):
    (folder / "bad.xml").write_text("<x/>")
    assert "\x1b" not in halpipe("validate", "bad.xml").stdout


def test_help_is_quick_and_loads_nothing_heavy():
    """The goal is 0.2 s; what makes it slow is one heavy import, so that is what is tested, and no clock."""
    heavy = ("lxml", "yaml", "xmlschema", "numpy", "jinja2", "graphviz", "rich.console")
    program = (
        "import sys, halpipe.cli; code = halpipe.cli.invoke(['--help']); "
        f"print(code, [m for m in {heavy} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "0 []"
