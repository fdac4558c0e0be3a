"""What all importers share: names, files among those that were named, cuts, values as people state them, coverage."""

import json
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Exit, Findings, HalpipeError, Location, Severity
from halpipe.core.durations import Duration
from halpipe.core.files.yaml import parse_yaml
from halpipe.core.settings import Fields
from halpipe.importers.amalthea import codes
from halpipe.importers.common.base import Coverage, Imported, ImportOptions, format_account, imported
from halpipe.importers.common.inputs import read_inputs
from halpipe.importers.common.names import Names, legal, unique_name
from halpipe.importers.common.pieces import cuts
from halpipe.importers.common.stated import (
    bound,
    complete_attributes,
    keys_of,
    name,
    number,
    reader,
    share,
    stated_attributes,
    word,
)
from halpipe.models import AccessKind, Interrupt, Task, Version
from halpipe.models.attributes import GANG, TIMES
from halpipe.models.attributes import word as word_of
from support import model, ms, task

RENAMED, LOSS = codes.RENAMED, codes.FEEDBACK
AT = Location("a.x", 7)


# ------------------------------------------------------------------------------------------------ names


@pytest.mark.parametrize(
    ("given", "made"), [("a b", "a_b"), ("", "_"), ("a.b/c:d~e+f@g$h%i-j_9", "a.b/c:d~e+f@g$h%i-j_9")]
)
def test_names_are_made_legal(given, made):
    assert legal(given) == made


def test_a_name_that_is_taken_gets_the_first_free_number():
    taken = {"a": 1, "a~3": 1}
    assert [unique_name("a", taken) for _ in range(3)] == ["a~2", "a~4", "a~5"]
    assert unique_name("b", taken, "#") == "b"
    assert unique_name("b", taken, "#") == "b#2"


def test_a_long_name_has_room_for_its_number():
    long = "x" * 1000
    taken = {long: 1}
    assert unique_name(long, taken) == "x" * 998 + "~2"
    taken[long] = 9
    assert unique_name(long, taken) == "x" * 997 + "~10"


def test_a_name_that_differs_from_that_of_the_source_is_reported():
    findings = Findings()
    names = Names(findings, RENAMED, ["t"])
    assert [
        names.unique("a", "task", AT),
        names.unique("t", "task", AT),
        names.unique("b c", "task", AT, of="/p/b c"),
    ] == [
        "a",
        "t~2",
        "b_c",
    ]
    assert [(d.code, d.at, d.path, d.message, d.help) for d in findings.items] == [
        (RENAMED.id, AT, 'task "t"', 'is called "t~2" in the model', 'use "t~2" in the overlay'),
        (RENAMED.id, AT, 'task "/p/b c"', 'is called "b_c" in the model', 'use "b_c" in the overlay'),
    ]


# ------------------------------------------------------------------------------------------------ files


def test_files_of_folders_are_skipped_where_files_that_were_named_are_wrong(tmp_path):
    for file, text in (("a.x", "good"), ("b.x", "bad"), ("c.y", "good"), ("d.z", "good")):
        (tmp_path / file).write_text(text)

    def read(path):
        with open(path) as file:
            if file.read() == "bad":
                raise HalpipeError(LOSS("is of another kind", at=Location(path), help="convert it"))
        return path

    def reading(*paths, on_progress=None):
        findings = Findings()
        found = read_inputs([str(path) for path in paths], (".x", ".y"), read, RENAMED, LOSS, findings, on_progress)
        said = [(d.code, d.message, d.at.file.rpartition("/")[2], d.help) for d in findings.items]
        return [path.rpartition("/")[2] for path in found], said

    skipped = (RENAMED.id, "skipped: is of another kind", "b.x", "convert it")
    told = (LOSS.id, "is of another kind", "b.x", "convert it")
    assert reading(tmp_path) == (["a.x", "c.y"], [skipped])
    assert reading(tmp_path / "b.x", tmp_path) == (["a.x", "c.y"], [told])
    assert reading(tmp_path / "d.z", tmp_path / "d.z") == (["d.z"], [])
    seen = []
    reading(tmp_path, on_progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 11), (4, 11), (7, 11)]


def test_where_no_file_is_left_the_usual_ending_is_named(tmp_path):
    (tmp_path / "d.z").write_text("")
    help = "name .x files, or directories that hold them"
    for paths, message in (([str(tmp_path)], "holds no usable .x file"), ([], "no input was named")):
        findings = Findings()
        assert read_inputs(paths, (".x", ".y"), str, RENAMED, LOSS, findings) == []
        (found,) = findings.items
        assert (found.message, found.help, found.at.file) == (message, help, paths[0] if paths else "")


def test_no_file_is_left_goes_without_saying_where_an_error_says_why(tmp_path):
    (tmp_path / "a.x").write_text("")
    findings = Findings()

    def read(path):
        raise HalpipeError(LOSS("cannot be read", severity=Severity.ERROR))

    assert read_inputs([str(tmp_path / "a.x")], (".x",), read, RENAMED, LOSS, findings) == []
    assert [d.message for d in findings.items] == ["cannot be read"]


# ------------------------------------------------------------------------------------------------ pieces


@pytest.mark.parametrize(
    ("longest", "begin", "end", "at"),
    [(5, 2, 12, [7]), (5, 2, 13, [7, 12]), (5, 2, 7, []), (0, 2, 12, []), (5, 2, 2, []), (5, 12, 2, [])],
)
def test_cuts_lie_between_begin_and_end(longest, begin, end, at):
    assert cuts(ms(longest), ms(begin), ms(end), "t", AT) == [ms(instant) for instant in at]


def test_more_cuts_than_a_job_may_have_parts_are_refused():
    assert len(cuts(Duration(1), Duration(0), Duration(20_000), "t", AT)) == 19_999
    with pytest.raises(HalpipeError) as refused:
        cuts(Duration(1), Duration(0), Duration(20_001), "t", AT)
    (found,) = refused.value.diagnostics
    assert found.message == "would be cut into 20001 pieces of 1ns; at most 20000 are made"
    assert (found.at, found.path) == (AT, 'task "t"')


# ------------------------------------------------------------------------------------------------ stated values


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (name, "a.b", "a.b"),
        (name, "a b", "is not a name; use A to Z"),
        (name, "a*", "is not a name; globs are not possible here"),
        (name, "x" * 1001, f"'{'x' * 80}' is not a name"),
        (word, "main.c", "main.c"),
        (word, "", "'' is not a single word"),
        (word, " a", "' a' is not a single word"),
        (word, "a b", "'a b' is not a single word"),
        (word, f"{'x' * 90} y", f"'{'x' * 80}' is not a single word"),
        (share, "1", Fraction(1)),
        (share, "0", Fraction(0)),
        (share, "1.01", "1.01 is above 1; write a share between 0 and 1"),
        (bound, "1", Fraction(1)),
        (bound, "1/3", Fraction(1, 3)),
        (bound, "0", "0 is not above 0; write a share above 0, up to 1"),
        (number, "0", 0),
        (number, "1000000", 1_000_000),
        (number, "1000001", "too large"),
        (number, "-1", "too small"),
        (reader(GANG), "1", 1),
        (reader(GANG), "0", "too small"),
        (reader(TIMES), "1", 1),
        (reader(TIMES), "255", 255),
        (reader(TIMES), "256", "too large"),
        (reader(TIMES), "0", "too small"),
        (reader(word_of(AccessKind)), "write", AccessKind.WRITE),
        (reader(word_of(AccessKind)), "writes", 'did you mean "write"'),
    ],
)
def test_values_are_taken_where_they_make_sense(read, text, value):
    if not isinstance(value, str) or value == text:
        assert read(text) == value
        return
    with pytest.raises(ValueError) as refused:  # noqa: PT011 its text is looked at
        read(text)
    assert value in str(refused.value)


def mapping(text, findings):
    return Fields("o.yaml", findings, parse_yaml(text.encode(), "o.yaml"), "it")


def test_what_a_mapping_states_of_a_class_is_read_by_field():
    findings = Findings()
    f = mapping("period: 5ms\nslack: 0.5\nrest: 3\n", findings)
    found = stated_attributes(f, Task, "slack")
    assert {field: stated.value for field, stated in found.items()} == {"period": ms(5)}
    assert found["period"].at.line == 1
    other = stated_attributes(mapping("every: 5ms\nperiod: 7ms\n", findings), Task, keys={"period": "every"})
    assert other["period"].value == ms(5)
    read = stated_attributes(mapping("period: often\n", findings), Task, period=len)
    assert read["period"].value == len("often")
    assert findings.items == []


def test_units_are_a_key_of_their_own_and_those_left_out_are_none():
    keys = keys_of(Version, "name")
    assert "units" in keys
    assert "name" not in keys
    assert "name" in keys_of(Version)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("{name: i, distance: 5ms, wcet: 1ms}", {"name": "i", "distance": ms(5), "wcet": ms(1)}),
        ("{name: i, distance: 5ms}", 'lacks the key "wcet"'),
        ("{name: i, distance: 5ms, wcet: long}", "'long'"),
    ],
)
def test_an_element_is_complete_or_none(text, value):
    findings = Findings()
    found = complete_attributes(mapping(text, findings), Interrupt)
    if isinstance(value, dict):
        assert (found, findings.items) == (value, [])
        return
    assert found is None
    (said,) = findings.items
    assert value in said.message


# ------------------------------------------------------------------------------------------------ result


def result(*diagnostics, completion=None):
    return Imported(model=model(task("a", 10)), diagnostics=diagnostics, coverage=Coverage(), completion=completion)


def test_what_was_read_is_what_was_mapped_and_what_was_ignored():
    coverage = Coverage()
    coverage.mapped("task")
    coverage.mapped("task", 2)
    coverage.ignored("task", "t", "is empty", AT)
    coverage.ignored("label", "l", "is unused")
    coverage.dropped("event", 5)
    coverage.defaulted("task t", "period", "1ms", AT)
    assert coverage.rows() == [("event", 5, 0, 5), ("label", 1, 0, 1), ("task", 4, 3, 1)]
    report = format_account(Imported(model=model(task("a", 10)), diagnostics=(), coverage=coverage))
    assert report.isascii()
    assert report.endswith(b"}\n")
    assert json.loads(report) == {
        "halpipe-import-report": 1,
        "model": "m",
        "elements": [
            {"kind": "event", "read": 5, "mapped": 0, "ignored": 5},
            {"kind": "label", "read": 1, "mapped": 0, "ignored": 1},
            {"kind": "task", "read": 4, "mapped": 3, "ignored": 1},
        ],
        "ignored": [
            {"kind": "task", "name": "t", "reason": "is empty", "file": "a.x", "line": 7},
            {"kind": "label", "name": "l", "reason": "is unused", "file": "", "line": 0},
        ],
        "dropped": [{"kind": "event", "count": 5}],
        "defaults": [{"element": "task t", "what": "period", "value": "1ms", "file": "a.x", "line": 7}],
    }


def test_a_name_of_any_script_is_ascii_in_the_report():
    coverage = Coverage()
    coverage.ignored("label", "größe", "is unused")
    assert format_account(Imported(model=model(task("a", 10)), diagnostics=(), coverage=coverage)).isascii()


def test_the_completion_of_a_model_is_done_once_and_without_an_overlay_at_once():
    def completion(system):
        return system, (RENAMED("late"),)

    done = result(RENAMED("early"), completion=completion).completed()
    assert ([d.message for d in done.diagnostics], done.completion) == (["early", "late"], None)
    assert done.completed() is done
    assert [d.message for d in imported(lambda _: result(completion=completion), ImportOptions()).diagnostics] == [
        "late"
    ]
    kept = imported(lambda _: result(completion=completion), ImportOptions(overlay=object()))
    assert (kept.diagnostics, kept.completion) == ((), completion)


def test_a_loss_is_an_error_under_strict_and_a_note_is_none():
    def read(_):
        return result(LOSS("is lost"), RENAMED("is renamed"))

    assert len(imported(read, ImportOptions()).diagnostics) == 2
    with pytest.raises(HalpipeError) as refused:
        imported(read, ImportOptions(strict=True))
    assert refused.value.exit is Exit.UNSUPPORTED
    assert {(d.message, d.severity) for d in refused.value.diagnostics} == {
        ("is lost", Severity.ERROR),
        ("is renamed", Severity.NOTE),
    }
    kept = imported(lambda _: result(RENAMED("is renamed")), ImportOptions(strict=True))
    assert [d.message for d in kept.diagnostics] == ["is renamed"]


@pytest.mark.parametrize(("strict", "severity"), [(False, Severity.WARNING), (True, Severity.ERROR)])
def test_an_error_comes_with_all_that_was_found_before_it(strict, severity):
    def read(findings):
        findings.add(LOSS("is lost"))
        raise HalpipeError(LOSS("is wrong", severity=Severity.ERROR), exit=Exit.USAGE)

    with pytest.raises(HalpipeError) as refused:
        imported(read, ImportOptions(strict=strict))
    assert refused.value.exit is Exit.USAGE
    assert [(d.message, d.severity) for d in refused.value.diagnostics] == [
        ("is lost", severity),
        ("is wrong", Severity.ERROR),
    ]
