"""How the help stands in a terminal."""

import re

import pytest

from halpipe.cli.app import GROUPS, VERBS


def test_options_of_one_format_stand_in_a_section(halpipe):
    said = halpipe("import", "--help").stdout
    titles = re.findall(r"^(\S.*):$", said, re.MULTILINE)
    assert titles == [
        "Arguments", "Options", "Options for AMALTHEA", "Options for AMALTHEA and ARXML", "Options for ARXML",
        "Options for ROS",
    ]  # fmt: skip
    general, _, others = said.partition("Options for AMALTHEA:")
    assert "--overlay" in general
    assert "--ecu" not in general
    assert "--ecu" in others
    assert "ARXML: " not in said


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb not in GROUPS])
def test_every_option_has_a_line_within_80_columns(halpipe, verb, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    said = halpipe(verb, "--help").stdout
    assert re.search(r"^  -h, --help ", said, re.MULTILINE)
    assert max(map(len, said.splitlines())) <= 80
