"""``halpipe serve`` where it cannot begin; see tests/unit/workbench and tests/workbench for the workbench itself."""

import builtins
import socket

import pytest

from command_line import run_here
from halpipe.starters import first_model


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
