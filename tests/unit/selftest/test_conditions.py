"""Conditions of verify, switched off one at a time: the edges of the self-test notice (`make conditions`, in small)."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[3] / "benchmarks" / "conditions.py"


def unnoticed(*words):
    """Run the program; return the faults that went unnoticed, and how many there were."""
    command = [sys.executable, str(PROGRAM), "verify", "--mutants", "1", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert "faults in" in lines[-1], done.stderr
    missed = [line for line in lines if line.startswith("unnoticed")]
    assert (done.returncode == 1) == bool(missed)
    return missed, int(lines[-1].partition(" ")[0])


@pytest.mark.slow
def test_the_edges_show_a_sample_of_the_conditions_of_verify():
    assert unnoticed("--sample", "6") == ([], 6)


@pytest.mark.slow  # the test above has the same subject; the program tries all files
def test_the_edges_show_all_conditions_of_the_rules_of_jobs():
    missed, count = unnoticed("--only", "jobs.py")
    assert missed == []
    assert count > 60
