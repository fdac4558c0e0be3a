"""Imports of all fixtures in full: the model, the coverage and every finding, where any source has a period."""

import pytest
from ros_case import FIXTURES, Overlay

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.core.durations import milliseconds
from halpipe.exporters.native import format_model
from halpipe.importers.ros import FORMAT
from halpipe.importers.ros.options import RosImportOptions

CASES = sorted(path.name for path in FIXTURES.iterdir() if path.suffix not in (".csv", ".txt"))


class Everywhere(Overlay):
    """An overlay that states a period of every source."""

    def source_period(self, topic):
        return milliseconds(100)


@pytest.mark.parametrize("case", CASES)
def test_an_import_is_that_of_the_golden_file(case, monkeypatch):
    monkeypatch.chdir(FIXTURES)
    lines = []
    try:
        found = FORMAT.read([case], RosImportOptions(overlay=Everywhere())).completed()
    except HalpipeError as refused:
        lines += map(render_text, refused.diagnostics)
    else:
        lines += map(render_text, found.diagnostics)
        lines += [
            f"{kind}: {read} read, {mapped} mapped, {ignored} ignored"
            for kind, read, mapped, ignored in found.coverage.rows()
        ]
        lines += [
            f"ignored {each.kind} {each.name} ({each.at}): {each.reason}" for each in found.coverage.ignored_elements
        ]
        lines += [
            f"default {each.element}: {each.what} = {each.value} ({each.at})"
            for each in found.coverage.defaulted_values
        ]
        lines.append(format_model(found.model).decode())
    assert_golden(f"{case}.txt", "\n".join(lines) + "\n", "ros")
