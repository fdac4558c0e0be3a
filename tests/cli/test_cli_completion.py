"""Completion of command lines, asked for in the way of `halpipe --show-completion`."""

import os
import subprocess
import sys
from unittest import mock

import pytest

from command_line import run_here
from halpipe.cli.app import VERBS
from halpipe.starters import first_model


def asked(line):
    return {"_HALPIPE_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}


def completed(line, folder="."):
    with mock.patch.dict(os.environ, asked(line)):
        done = run_here(folder)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def test_verbs():
    assert completed("halpipe ") == list(VERBS)
    assert completed("halpipe sch") == ["schedule"]


def test_a_process_completes_as_the_command_does():
    environment = os.environ | asked("halpipe sch")
    done = subprocess.run([sys.executable, "-m", "halpipe"], env=environment, capture_output=True, check=True)
    assert (done.stdout.split(), done.stderr) == ([b"schedule"], b"")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("halpipe schedule --optim", ["--optimise"]),
        ("halpipe schedule --engine e", ["exact"]),
        ("halpipe schedule --optimise chains,m", ["chains,margin"]),
        ("halpipe new folder --example r", ["roboracer"]),
        ("halpipe import a", ["amalthea", "arxml"]),
        ("halpipe import arxml --granularity ", ["runnable", "event", "ostask"]),
        ("halpipe export amalthea --release 3.", ["3.0.0", "3.1.0", "3.2.0", "3.3.0"]),
        ("halpipe explain HAL002", ["HAL0020", "HAL0021", "HAL0022", "HAL0023", "HAL0024", "HAL0025"]),
        ("halpipe export re", ["regulator", "report"]),
        ("halpipe export report --ti", ["--title"]),
    ],
)
def test_what_a_verb_takes(line, said):
    assert completed(line) == said


@pytest.mark.parametrize("verb", ["schedule", "explain", "size", "export report", "show"])
def test_modes_of_the_model_on_the_line(verb, tmp_path):
    (tmp_path / "model.xml").write_bytes(first_model()["model.xml"])
    assert completed(f"halpipe {verb} model.xml --mode ", tmp_path) == ["drive", "limp"]
    assert completed(f"halpipe {verb} model.xml --mode l", tmp_path) == ["limp"]


@pytest.mark.parametrize("content", [b"", b"<a", b"<!DOCTYPE a><a/>", b"<a/>"])
def test_a_file_that_is_no_model_completes_nothing_and_says_nothing(content, tmp_path):
    (tmp_path / "model.xml").write_bytes(content)
    assert completed("halpipe schedule model.xml --mode ", tmp_path) == []
    assert completed("halpipe schedule gone.xml --mode ", tmp_path) == []
