"""Requirements with the functions that test them, and what the JUnit XML of a run says about each."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.pipeline import verify
from halpipe.selftest import requirements
from halpipe.selftest.requirements import NO_RESULTS, NO_RUN, read_results

BINDING = "tests/unit/pipeline/test_verify_split_switches.py::test_a_bound_task_keeps_to_its_unit"
CASE = '<testcase classname="tests.unit.pipeline.test_verify_split_switches" name="{}">{}</testcase>'


@pytest.fixture
def junit(tmp_path):
    def write(*marks, name="test_a_bound_task_keeps_to_its_unit"):
        cases = "".join(CASE.format(f"{name}[{number}]", mark) for number, mark in enumerate(marks))
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.xml"
        path.write_text(f"<testsuites><testsuite>{cases}</testsuite></testsuites>", encoding="utf-8")
        return str(path)

    return write


def rows(results=NO_RUN):
    return {row["id"]: row for row in requirements.requirements(results)}


@pytest.mark.slow
def test_each_requirement_is_tested_by_functions_that_exist():
    for row in rows().values():
        assert row["result"] == "not run"
        assert row["codes"], row["id"]
        assert row["tests"], row["id"]
        for run in row["tests"]:
            path, _, name = run["test"].partition("::")
            assert f"def {name.rpartition('::')[2]}(" in (requirements.ROOT / path).read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_rule_has_the_codes_of_its_own_function():
    by_id = rows()
    assert by_id["verify/version"]["codes"] == ["HAL0323"]
    assert by_id["verify/unit"]["codes"] == ["HAL0324"]
    assert {f"verify/{rule.name}" for rule in verify.RULES} <= by_id.keys()


@pytest.mark.slow
def test_what_a_test_uses_of_its_file_counts_and_a_fixture_is_known_by_its_folder():
    source = """
TABLE = ["HAL0201"]
def helper(): return TABLE
@mark(codes.NEVER)
def test_far(): helper()
def test_near(): pass
class TestAll:
    def test_inside(self): "HAL0202"
"""
    closures = requirements._closures(source)
    assert closures.keys() == {"helper", "test_far", "test_near", "TestAll::test_inside"}
    assert {"HAL0201", "NEVER"} <= closures["test_far"]
    assert "HAL0201" not in closures["test_near"]
    assert "HAL0202" in closures["TestAll::test_inside"]
    tests = [run["test"] for run in rows()["validate/lets"]["tests"]]
    assert not any("test_explain" in test for test in tests)
    assert "tests/unit/pipeline/test_validate_fixtures.py::test_fixture_has_exactly_the_findings_it_names" in tests


@pytest.mark.slow
@pytest.mark.parametrize(
    ("marks", "result"),
    [
        (["", ""], "passed"),
        (["", "<skipped/>"], "passed"),
        (["<skipped/>"], "skipped"),
        (["", "<failure/>", "<skipped/>"], "failed"),
        (["<error/>"], "failed"),
    ],
)
def test_one_failure_decides(junit, marks, result):
    results = read_results([junit(*marks)])
    row = rows(results)["verify/binding"]
    assert row["result"] == result
    (run,) = (run for run in row["tests"] if run["test"] == BINDING)
    assert sum(run.get(verdict, 0) for verdict in requirements.VERDICTS) == len(marks)
    assert rows(results)["verify/deadline"]["result"] == "not run"


@pytest.mark.slow
def test_several_runs_count_together(junit):
    results = read_results([junit(""), junit("", "<failure/>")])
    assert results.counts(BINDING, []) == {"passed": 2, "failed": 1}
    assert [(file["passed"], file["failed"]) for file in results.files] == [(1, 0), (1, 1)]


@pytest.mark.slow
def test_a_case_that_names_a_code_counts_for_that_code_only(tmp_path):
    module, name = "tests.unit.pipeline.test_validate_fixtures", "test_fixture_has_exactly_the_findings_it_names"
    cases = (("HAL0218-a", "<failure/>"), ("HAL0245-b", ""))
    text = "".join(f'<testcase classname="{module}" name="{name}[{id}]">{mark}</testcase>' for id, mark in cases)
    (tmp_path / "r.xml").write_text(f"<testsuite>{text}</testsuite>", encoding="utf-8")
    found = rows(read_results([str(tmp_path / "r.xml")]))
    results = [found[f"validate/{check}"]["result"] for check in ("lets", "locks", "health")]
    assert results == ["failed", "passed", "not run"]


@pytest.mark.slow
def test_a_file_without_a_known_test_is_refused(junit):
    with pytest.raises(HalpipeError) as refused:
        read_results([junit("", name="test_of_another_project")])
    (finding,) = refused.value.diagnostics
    assert finding.code == NO_RESULTS.id
    assert "1 cases" in finding.message
