"""halpipe explain as users run it, and what schedule says of hopeless models."""

import json
from pathlib import Path

import pytest

FIXTURES = Path(__file__).parents[1] / "fixtures" / "explain"


def test_a_witness_with_its_sum_and_exit_code_4(halpipe):
    shown = halpipe("explain", FIXTURES / "HAL0430-tasks-meet.xml", "--no-remedies")
    assert shown.returncode == 4
    assert '1.5ms of "camera" + 2ms of "radar" > 3ms = gcd(6ms, 15ms)' in shown.stdout
    assert shown.stdout.splitlines()[-1] == "mode all: infeasible"


def test_what_would_help_is_shown(halpipe):
    shown = halpipe("explain", FIXTURES / "HAL0430-tasks-meet.xml")
    assert "HAL0436" in shown.stdout
    assert "1 more unit" in shown.stdout
    assert "found sufficient" in shown.stdout


def test_schedule_does_not_search_the_hopeless(halpipe, folder):
    refused = halpipe("schedule", FIXTURES / "HAL0431-no-gap.xml", "-o", "s.xml")
    assert refused.returncode == 4
    assert "HAL0431" in refused.stderr
    assert not list(folder.glob("s*.xml"))


def test_the_best_placement_of_a_failed_search(halpipe):
    assert halpipe("schedule", "hopeless.xml", "--budget", "50", "-o", "s.xml").returncode == 3
    shown = halpipe("explain", "hopeless.xml", "--schedule", "s.best.xml", "--no-exact", "--no-remedies")
    assert shown.returncode == 3
    assert "HAL0401" in shown.stdout
    assert "HAL0407" in shown.stdout


def test_a_model_with_a_schedule(halpipe):
    shown = halpipe("explain", "model.xml")
    assert (shown.returncode, shown.stdout.splitlines()[-1]) == (0, "mode all: schedulable")


def test_json_and_nothing_else_on_standard_output(halpipe):
    shown = halpipe("explain", "hopeless.xml", "--no-exact", "--no-remedies", "--format", "json")
    assert {d["code"] for d in json.loads(shown.stdout)} == {"HAL0401", "HAL0407"}


@pytest.mark.parametrize("code", ["HAL0231", "hal0430", "HAL0906"])
def test_the_page_of_a_code(halpipe, code):
    shown = halpipe("explain", code)
    assert shown.returncode == 0
    assert shown.stdout.startswith(code.upper())
    assert len(shown.stdout.splitlines()) >= 3


def test_the_page_of_a_code_fits_the_terminal(halpipe, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    lines = halpipe("explain", "HAL0231").stdout.splitlines()
    assert len(lines) > 3
    assert max(map(len, lines)) <= 60


def test_unknown_codes_and_modes_are_usage_errors(halpipe):
    assert halpipe("explain", f"HAL{9999}").returncode == 2
    refused = halpipe("explain", "model.xml", "--mode", "al")
    assert refused.returncode == 2
    assert "did you mean" in refused.stderr


def test_the_exact_engine_from_the_command_line(halpipe):
    pytest.importorskip("ortools")
    assert halpipe("schedule", "model.xml", "--engine", "exact", "-o", "s.xml").returncode == 0
    assert halpipe("verify", "model.xml", "s.xml").returncode == 0
    refused = halpipe("schedule", "hopeless.xml", "--engine", "exact", "-o", "t.xml")
    assert refused.returncode == 3
    assert "HAL0423" in refused.stderr
