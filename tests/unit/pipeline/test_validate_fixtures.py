"""One small file for every code that a model file can cause: it says itself, in comments, what is found in which line.

Codes without a fixture are about models that the schema refuses; see the last test.
"""

import re
from pathlib import Path

import pytest

from golden_file import assert_golden
from halpipe.core.diagnostics import REGISTER, render_text
from halpipe.importers.native.model import read_model
from halpipe.pipeline.validate import CHECKS, codes, validate

FOLDER = Path(__file__).parents[2] / "fixtures" / "validate"
FIXTURES = sorted(FOLDER.glob("*.xml"))

NOT_IN_FILES = {
    codes.BAD_NAME.id,
    codes.RUN_SELECTS_NOTHING.id,
    codes.NEGATIVE_TIME.id,
    codes.EMPTY_CHAIN.id,
}
"""What the schema refuses already; only models that were never XML can have these faults."""


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_fixture_has_exactly_the_findings_it_names(path):
    lines = path.read_text().splitlines()
    expected = {(n, code) for n, line in enumerate(lines, 1) for code in re.findall(r"<!-- (HAL\d{4}) -->", line)}
    findings = validate(read_model(str(path)))
    assert {(d.at.line, d.code) for d in findings} == expected
    assert path.name[:7] in {d.code for d in findings}


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_every_finding_names_file_element_and_remedy(path):
    for finding in validate(read_model(str(path))):
        assert finding.at.file == str(path)
        assert finding.path
        assert finding.subjects
        assert finding.help


def test_the_findings_read_as_in_the_golden_file(monkeypatch):
    """Numbers, plurals and what is listed of them are decided in the checks, too."""
    monkeypatch.chdir(FOLDER)
    texts = [render_text(finding) for path in FIXTURES for finding in validate(read_model(path.name))]
    assert_golden("validate.txt", "\n".join(texts) + "\n", "pipeline")


def test_every_code_has_a_fixture_and_a_check_that_reports_it():
    declared = {code for code in REGISTER if code.startswith("HAL02")}
    assert {path.name[:7] for path in FIXTURES} | NOT_IN_FILES == declared
    assert {code.id for check in CHECKS for code in check.codes} == declared


def test_checks_have_distinct_names_and_one_sentence_each():
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    for check in CHECKS:
        assert check.sentence.endswith(".")
        assert "\n" not in check.sentence


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_a_check_reports_only_its_own_codes(path):
    from halpipe.pipeline.validate.context import Context

    context = Context(read_model(str(path)))
    for check in CHECKS:
        assert {d.code for d in check.run(context)} <= {code.id for code in check.codes}
