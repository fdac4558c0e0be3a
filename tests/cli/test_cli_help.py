"""How the help stands in a terminal."""

import re

import pytest

from halpipe.cli.app import GROUPS, VERBS


def test_a_format_has_its_own_options_and_no_others(halpipe):
    said = {name: halpipe("import", name, "--help").stdout for name in ("amalthea", "arxml", "ros")}
    assert [name for name, help in said.items() if "--ecu" in help] == ["arxml"]
    assert [name for name, help in said.items() if "--overlay" in help] == ["amalthea", "arxml", "ros"]


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb not in GROUPS])
def test_every_option_has_a_line_within_80_columns(halpipe, verb, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    said = halpipe(verb, "--help").stdout
    assert re.search(r"^  -h, --help ", said, re.MULTILINE)
    assert max(map(len, said.splitlines())) <= 80
