"""``halpipe selftest``: verdicts of both checkers, reports of disagreement, and evidence with the same bytes."""

import hashlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from halpipe import __version__
from halpipe.flow.formats import EXPORTERS, IMPORTERS, formats
from halpipe.pipeline import verify
from halpipe.selftest import confidence, evidence, run, second
from halpipe.selftest import run as run_package
from halpipe.selftest.edges import edges
from halpipe.selftest.run import Outcome

ROOT = Path(__file__).parents[2]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
def test_the_checkers_agree_and_both_verdicts_occur(halpipe):
    said = halpipe("selftest", "--mutants", "60")
    assert said.returncode == 0, said.stdout
    assert said.stdout.endswith("the checkers disagree on 0\n")
    outcome = run(60, 1)
    assert min(outcome.valid, outcome.broken) >= 10


JUDGED = [rule.name for rule in verify.RULES if rule is not verify.PRIORITY_RULE]


@pytest.mark.parametrize("name", JUDGED)
def test_each_rule_that_is_switched_off_is_noticed(monkeypatch, name):
    """Volume is no sensitivity: a single schedule for each rule is enough, if no other rule refuses it."""
    program = import_module("halpipe.selftest.run")
    own = [case for case in program.cases(0, 1) if name in case.faults]
    monkeypatch.setattr(program, "cases", lambda *_: own)

    def off(rule):
        return replace(rule, check=lambda _: ()) if rule.name == name else rule

    for group in ("MODE_RULES", "SWITCH_RULES"):
        monkeypatch.setattr(verify, group, tuple(map(off, getattr(verify, group))))
    for single in ("FIGURES", "SYSTEM_BINDING", "HEALTH"):
        monkeypatch.setattr(verify, single, off(getattr(verify, single)))
    outcome = run(1, 1)
    assert outcome.differing
    assert name in outcome.unseen


@pytest.mark.slow
def test_each_edge_breaks_its_rule_alone():
    assert run(1, 1).unseen == []
    assert {rule for edge in edges() for rule in edge.rules} == {*JUDGED, "reading"}


@pytest.mark.slow
@pytest.mark.parametrize("verdict", [True, False])
def test_a_checker_that_is_wrong_is_told(halpipe, monkeypatch, verdict):
    monkeypatch.setattr(second, "accepts", lambda *_: verdict)
    said = halpipe("selftest", "--mutants", "60")
    assert said.returncode == 1
    assert f"second {'valid' if verdict else 'not valid'}" in said.stdout
    assert run_package is run


@pytest.mark.slow
def test_evidence_is_made_again_to_the_same_bytes(halpipe, tmp_path):
    words = ["selftest", "--mutants", "20", "--evidence"]
    assert halpipe(*words, str(tmp_path / "one")).returncode == 0
    around = {**os.environ, "PYTHONHASHSEED": "2", "LC_ALL": "C", "TZ": "Asia/Kathmandu", "COLUMNS": "200"}
    subprocess.run([sys.executable, "-m", "halpipe", *words, "two"], cwd=tmp_path, env=around, check=True)
    found = contents(tmp_path / "one")
    assert found == contents(tmp_path / "two")
    assert str(ROOT).encode() not in b"".join(found.values())
    sealed = json.loads(found["manifest.json"])["files"]
    assert sealed == {name: hashlib.sha256(text).hexdigest() for name, text in found.items() if name in sealed}
    assert sealed.keys() == found.keys() - {"manifest.json"}
    bill = json.loads(found["sbom.cdx.json"])
    assert bill["bomFormat"] == "CycloneDX"
    assert "lxml" in {part["name"] for part in bill["components"]}
    requirements = json.loads(found["requirements.json"])["requirements"]
    assert len({entry["id"] for entry in requirements}) == len(requirements)
    untested = [entry["id"] for entry in requirements if entry["codes"] and not entry["tests"]]
    assert untested == []


@pytest.mark.slow
def test_results_reach_the_evidence_and_failures_the_exit_code(halpipe, tmp_path):
    rooms = "tests.unit.pipeline.test_verify_"
    passed = f'<testcase classname="{rooms}split_switches" name="test_a_bound_task_keeps_to_its_unit"/>'
    failed = f'<testcase classname="{rooms}split" name="test_nesting_holds_round_the_end"><failure/></testcase>'
    (tmp_path / "r.xml").write_text(f"<testsuites><testsuite>{passed}{failed}</testsuite></testsuites>")
    words = ["selftest", "--mutants", "1", "--results", str(tmp_path / "r.xml")]
    assert halpipe(*words).returncode == 2
    said = halpipe(*words, "--evidence", str(tmp_path / "e"))
    assert said.returncode == 1
    assert "1 case of the tests failed" in said.stdout
    found = json.loads((tmp_path / "e" / "requirements.json").read_bytes())
    results = {entry["id"]: entry["result"] for entry in found["requirements"]}
    assert (results["verify/binding"], results["verify/nested"]) == ("passed", "failed")
    assert [(result["passed"], result["failed"]) for result in found["results"]] == [(1, 1)]


def test_every_format_has_a_row_of_its_own():
    rows = {use.name for use in confidence.USES}
    assert rows >= {f"import {name}" for name in formats(IMPORTERS)}
    assert rows >= {f"export {name}" for name in formats(EXPORTERS)}
    assert {use.level for use in confidence.USES} <= {"TCL1", "TCL2", "TCL3"}


def rows_of(page):
    lines = (ROOT / "docs" / "safety" / page).read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("| ")][1:]


def test_the_list_of_malfunctions_is_that_of_this_release():
    page = (ROOT / "docs" / "safety" / "known-malfunctions.md").read_text(encoding="utf-8")
    assert page.splitlines()[0].endswith(f" halpipe {__version__}"), "each release has a list of its own"
    rows = rows_of("known-malfunctions.md")
    assert [row[0] for row in rows] == [f"K{number}" for number in range(1, len(rows) + 1)]
    assert all(cell for row in rows for cell in row)
    assert {row[1] for row in rows} <= {use.name for use in confidence.USES} | {"all"}


@pytest.mark.slow
def test_the_walk_names_files_of_the_folder_and_their_results():
    outcome = Outcome(valid=3, broken=4, differing=["x"])
    files = evidence.folder(outcome, 5, 1)
    walk = files[evidence.WALK].decode()
    named = {name for row in rows_of(evidence.WALK) for name in re.findall("`([^`]+)`", row[2])}
    assert named <= files.keys()
    assert named | {evidence.WALK} == files.keys()
    assert f"hashes.json: {len(json.loads(files['hashes.json']))} files" in walk
    assert "7 schedules, 1 disagreements; 0 of 29 rules alone" in walk
    assert json.loads(files["validation.json"])["schedules"] == outcome.valid + outcome.broken
    (row,) = (line for line in walk.splitlines() if line.startswith("| 11.4.4.2 "))
    assert row.endswith(f" {len(rows_of('known-malfunctions.md'))} entries |")
    tables = {line.count("|") for line in walk.splitlines() if line.startswith("|")}
    assert tables == {6}


def test_the_hash_of_the_arguments_stands_in_the_documentation():
    page = (ROOT / "docs" / "safety" / "evidence.md").read_text(encoding="utf-8")
    rows = "".join(
        f"{hashlib.sha256(text).hexdigest()}  {name}\n" for name, text in sorted(evidence.arguments().items())
    )
    expected = hashlib.sha256(rows.encode()).hexdigest()
    assert expected in page, f"write {expected} into docs/safety/evidence.md"
