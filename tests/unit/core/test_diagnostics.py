"""Diagnostics: the register of codes, the order, and the three forms in which they are shown."""

import json
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import pytest

from halpipe.core.diagnostics import (
    MOST_CHARACTERS,
    NOWHERE,
    REGISTER,
    Code,
    Exit,
    Findings,
    Fix,
    HalpipeError,
    Location,
    Severity,
    Subject,
    about,
    error,
    located,
    note,
    printable,
    render_json,
    render_sarif,
    render_text,
    sort_diagnostics,
    tasks_named,
    warning,
)


@pytest.fixture(autouse=True)
def register(monkeypatch):
    """Codes declared by a test do not outlive it."""
    known = dict(REGISTER)
    yield REGISTER
    REGISTER.clear()
    REGISTER.update(known)


@pytest.fixture
def late():
    return error("TST0001", "Task is late", "A paragraph.")


@pytest.fixture
def diagnostic(late):
    return late("needs 9ms", at=Location("model.xml", 42), path='task "fuse"', help="raise the deadline")


def test_exit_codes_are_those_of_the_page():
    page = Path(__file__).parents[3] / "docs" / "reference" / "exit-codes.md"
    rows = [line.split(" | ")[:2] for line in page.read_text().splitlines() if line.startswith("| ")]
    assert {name: int(code[2:]) for code, name in rows[1:]} == {e.name.lower().replace("_", " "): e for e in Exit}


def test_a_code_registers_itself(late):
    assert REGISTER["TST0001"] is late


def test_the_makers_give_the_weights():
    assert error("TST0002", "a").severity is Severity.ERROR
    assert warning("TST0003", "b").severity is Severity.WARNING
    assert note("TST0004", "c").severity is Severity.NOTE


def test_a_code_is_declared_once(late):
    with pytest.raises(ValueError, match="TST0001 is declared twice"):
        error("TST0001", "Something else")
    assert REGISTER["TST0001"] is late


def test_a_module_may_be_loaded_again(late):
    assert Code("TST0001", Severity.ERROR, late.title, late.explanation) == late


def test_a_diagnostic_has_its_code_s_weight_unless_another_is_given(late):
    assert late("x").is_error
    assert late("x").at == NOWHERE
    assert not late("x", severity=Severity.WARNING).is_error


def test_text_has_place_code_element_message_source_and_help(diagnostic):
    assert render_text(diagnostic, '   <task name="fuse"\twcet="9ms"/>  ') == (
        'model.xml:42: error[TST0001] task "fuse": needs 9ms\n'
        '    | <task name="fuse" wcet="9ms"/>\n'
        "    help: raise the deadline"
    )


def test_text_leaves_out_what_there_is_not(late):
    assert render_text(late("is late")) == "error[TST0001] is late"
    assert render_text(late("is late", at=Location("m.xml"))) == "m.xml: error[TST0001] is late"
    assert render_text(late("is late", at=Location("", 7))) == ":7: error[TST0001] is late"


def test_text_cannot_steer_the_terminal(late):
    hostile = late("\x1b[2J\r\x07", at=Location("a\nb\udce9.xml", 1), path="\x9b\u202e", help="\x00")
    text = render_text(hostile, "\x1b]0;title\x07")
    assert all(line.isprintable() for line in text.split("\n"))
    assert text.count("\n") == 2
    assert r"\x1b[2J\r\x07" in text
    assert r"a\nb\udce9.xml:1: " in text


@pytest.mark.parametrize("text", ["", "plain", "über → 30 Hz", "日本語", "a b"])
def test_readable_text_stays_as_it_is(text):
    assert printable(text) == text


def test_json_has_every_field(diagnostic):
    assert json.loads(render_json([diagnostic])) == [
        {
            "code": "TST0001",
            "severity": "error",
            "file": "model.xml",
            "line": 42,
            "path": 'task "fuse"',
            "message": "needs 9ms",
            "help": "raise the deadline",
            "subjects": [],
            "places": [],
        }
    ]
    assert json.loads(render_json([])) == []


def test_a_path_knows_what_it_names():
    mode = about(mode="all")
    assert (str(mode), mode.subjects) == ('mode "all"', (Subject("mode", "all"),))
    job = about(mode, task="fuse", job=3)
    assert (str(job), job.subjects[1:]) == (
        'mode "all" task "fuse" job 3',
        (Subject("task", "fuse"), Subject("job", "3")),
    )
    switch = about(transition=("a", "b"))
    assert (str(switch), switch.subjects) == ('transition "a" to "b"', (Subject("transition", "a->b"),))
    access = about(access_to="dram")
    assert (str(access), access.subjects) == ('access to "dram"', (Subject("resource", "dram"),))


def test_a_diagnostic_has_subjects_places_and_a_fix(late):
    first, second = Location("model.xml", 1), Location("model.xml", 2)
    found = late(
        "overlap",
        at=first,
        path=about(unit="gpu"),
        subjects=[Subject("task", "a"), Subject("unit", "gpu")],
        places=[first, second, second, NOWHERE],
        fix=Fix(first, "gpuu", "gpu"),
    )
    assert found.subjects == (Subject("unit", "gpu"), Subject("task", "a"))
    assert found.places == (second,)
    (data,) = json.loads(render_json([found]))
    assert data["subjects"] == [{"kind": "unit", "name": "gpu"}, {"kind": "task", "name": "a"}]
    assert data["places"] == [{"file": "model.xml", "line": 2}]
    assert data["fix"] == {"file": "model.xml", "line": 1, "old": "gpuu", "new": "gpu"}
    (result,) = json.loads(render_sarif([found], "1"))["runs"][0]["results"]
    assert result["locations"][0]["logicalLocations"] == [
        {"name": "gpu", "kind": "unit"},
        {"name": "a", "kind": "task"},
    ]
    assert result["relatedLocations"][0]["physicalLocation"]["region"] == {"startLine": 2}


def test_a_diagnostic_of_another_code_keeps_what_it_is_about(late):
    other = note("TST0002", "Still late")
    found = other.instead_of(late("is late", path=about(task="fuse"), help="hurry"))
    assert (found.code, found.severity, found.help) == ("TST0002", Severity.NOTE, "hurry")
    assert found.subjects == (Subject("task", "fuse"),)


def test_the_order_does_not_depend_on_that_of_subjects(late):
    same = [
        late("is late", subjects=[Subject("task", name)], fix=fix)
        for name in "ba"
        for fix in (None, Fix(NOWHERE, "x", "y"))
    ]
    assert sort_diagnostics(same) == sort_diagnostics(same[::-1])


def test_json_and_sarif_hold_any_text(diagnostic):
    strange = replace(diagnostic, message='"\x1b\udce9\U0001f600</script>', at=Location("caf\udce9.xml", 1))
    for text in (render_json([strange]), render_sarif([strange], "1")):
        text.encode("utf-8")
        assert "\U0001f600" in text
    assert json.loads(render_json([strange]))[0]["message"] == strange.message


def test_sarif_has_one_rule_for_each_code_and_one_result_for_each_finding(late, diagnostic):
    other = warning("TST0000", "Odd")("is odd", at=Location("b.xml"))
    log = json.loads(render_sarif([diagnostic, late("again"), other], "9.9"))
    (run,) = log["runs"]
    driver = run["tool"]["driver"]
    assert log["version"] == "2.1.0"
    assert (driver["name"], driver["version"]) == ("halpipe", "9.9")
    assert [(r["id"], r["shortDescription"]["text"]) for r in driver["rules"]] == [
        ("TST0000", "Odd"),
        ("TST0001", "Task is late"),
    ]
    first, second, third = run["results"]
    assert (first["ruleId"], first["level"]) == ("TST0001", "error")
    assert first["message"]["text"] == 'task "fuse": needs 9ms\nraise the deadline'
    assert first["locations"] == [
        {"physicalLocation": {"artifactLocation": {"uri": "model.xml"}, "region": {"startLine": 42}}}
    ]
    assert "locations" not in second
    assert third["level"] == "warning"
    assert third["locations"] == [{"physicalLocation": {"artifactLocation": {"uri": "b.xml"}}}]


@pytest.mark.parametrize(
    ("file", "uri"),
    [
        ("a b/ü.xml", "a%20b/%C3%BC.xml"),
        ("c:d.xml", "c%3Ad.xml"),
        ("caf\udce9.xml", "caf%E9.xml"),
        ("/m.xml", "/m.xml"),
    ],
)
def test_sarif_names_files_by_uri(diagnostic, file, uri):
    log = json.loads(render_sarif([replace(diagnostic, at=Location(file))], "1"))
    assert log["runs"][0]["results"][0]["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == uri


def test_order_is_by_place_then_code_whatever_the_order_of_discovery(late, diagnostic):
    odd = warning("TST0000", "Odd")
    expected = [
        odd("x", at=Location("a.xml", 9)),
        odd("x", at=Location("b.xml", 10)),
        late("a", at=Location("b.xml", 10)),
        late("b", at=Location("b.xml", 10)),
        late("b", at=Location("b.xml", 10), severity=Severity.WARNING),
        odd("x", at=Location("b.xml", 11)),
    ]
    for order in permutations(expected):
        assert sort_diagnostics(order) == expected


def test_order_drops_repetitions(diagnostic):
    assert sort_diagnostics([diagnostic, replace(diagnostic)]) == [diagnostic]


def test_findings_stop_only_on_errors(late):
    findings = Findings()
    findings.add(late("odd", severity=Severity.WARNING))
    findings.stop_on_errors()
    findings.extend([late("late")])
    with pytest.raises(HalpipeError) as stop:
        findings.stop_on_errors()
    assert [d.message for d in stop.value.diagnostics] == ["odd", "late"]
    assert str(stop.value) == "warning[TST0001] odd\nerror[TST0001] late"


def test_findings_without_a_place_get_the_one_of_the_work(late):
    stated, work = Location("a.xml", 3), Location("p.yaml", 7)
    with pytest.raises(HalpipeError) as stop, located(work):
        raise HalpipeError(late("one", at=stated), late("two"), exit=Exit.NOT_FOUND)
    assert [(d.message, d.at) for d in stop.value.diagnostics] == [("one", stated), ("two", work)]
    assert stop.value.exit is Exit.NOT_FOUND


def test_a_finding_concerns_further_elements_each_once_and_cuts_long_names(late):
    one, longest, longer = (Subject("task", name) for name in ("a", "x" * MOST_CHARACTERS, "x" * MOST_CHARACTERS + "y"))
    found = late("m", subjects=[one]).concerning([*tasks_named(["a", "b"]), longest, longer])
    assert found.subjects[:3] == (one, Subject("task", "b"), longest)
    assert found.subjects[2] is longest
    half = "x" * (MOST_CHARACTERS // 2)
    assert found.subjects[3].name == f"{half}...{half[1:]}y"
