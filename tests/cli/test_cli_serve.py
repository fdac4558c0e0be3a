"""``halpipe serve`` where it cannot begin; see tests/unit/workbench and tests/workbench for the workbench itself."""

import builtins
import signal
import socket
from dataclasses import replace

import pytest

from command_line import run_here
from halpipe.cli.serve import _end_when_the_terminal_closes
from halpipe.starters import first_model
from halpipe.workbench.edits import Edit
from halpipe.workbench.session import Session


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "model.xml").write_bytes(first_model()["model.xml"])
    return tmp_path


def test_a_port_that_another_program_has(folder):
    pytest.importorskip("uvicorn", reason="the extra [serve]")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        refused = run_here(folder, "serve", "model.xml", "--port", str(taken.getsockname()[1]))
    assert refused.returncode == 1
    assert "HAL0959" in refused.stderr
    assert "--port" in refused.stderr


def test_without_its_library_it_says_how_to_get_it(folder, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name == "uvicorn":
            raise ImportError(name)
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    refused = run_here(folder, "serve", "model.xml")
    assert refused.returncode == 1
    assert "HAL0958" in refused.stderr
    assert "pip install starlette uvicorn" in refused.stderr


def test_a_model_that_cannot_be_read(folder):
    pytest.importorskip("uvicorn", reason="the extra [serve]")
    (folder / "model.xml").write_text("<x>")
    assert run_here(folder, "serve", "model.xml").returncode == 1


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up")
def test_a_terminal_that_closes_is_a_request_to_end():
    """The server handles SIGTERM; an exception out of a signal, within its loop, left it running now and then."""
    ended = []
    kept = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM)}
    try:
        signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
        signal.signal(signal.SIGHUP, signal.default_int_handler)
        _end_when_the_terminal_closes()
        signal.raise_signal(signal.SIGHUP)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as of nohup
        _end_when_the_terminal_closes()
        signal.raise_signal(signal.SIGHUP)
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    assert ended == [signal.SIGTERM]


def test_edits_that_no_journal_keeps_are_named_at_the_end(folder, monkeypatch):
    """As on a full disk: Ctrl-C ends the server, and the edits are lost with an error."""
    uvicorn = pytest.importorskip("uvicorn", reason="the extra [serve]")
    sessions = []

    class Opened(Session):
        def __init__(self, *stated):
            super().__init__(*stated)
            sessions.append(self)

        def begin(self):
            """Find no schedule: none is looked at."""

    def run(_server, sockets):
        sessions[0].journal.path = "model.xml/no-folder"
        sessions[0].shown = replace(sessions[0].shown, model=replace(sessions[0].opened, name="edited"))
        raise KeyboardInterrupt

    monkeypatch.setattr("halpipe.workbench.session.Session", Opened)
    monkeypatch.setattr(uvicorn.Server, "run", run)
    ended = run_here(folder, "serve", "model.xml")
    assert ended.returncode == 1
    assert "error[HAL1541] model.xml/no-folder: the edits since the last journal are lost" in ended.stderr


def test_restored_edits_are_announced_in_the_terminal(folder, monkeypatch):
    uvicorn = pytest.importorskip("uvicorn", reason="the extra [serve]")
    monkeypatch.setattr(Session, "begin", lambda _: None)  # no schedule is looked at
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    announced = "model.xml.edits: edits of an earlier session are restored"
    assert announced not in run_here(folder, "serve", "model.xml").stderr
    Session(str(folder / "model.xml")).edit(Edit("version", "camera", "wcet", "7ms", "full"))
    assert announced in run_here(folder, "serve", "model.xml").stderr
