"""Executors files read back: every value, every reference, and what is wrong with either."""

from dataclasses import replace

import pytest
from ros_case import FIXTURES, found, read, reasons, refusal, rows

from halpipe.core.durations import Duration
from halpipe.core.settings import BAD_VALUE, MISSING_KEY, UNKNOWN_KEY
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.options import RosImportOptions
from halpipe.models import Origin, Transition
from support import after, chain, mode, model, ms, task, version

TEXT = (FIXTURES / "executors.yaml").read_text()


def without_origins(tasks):
    return tuple(
        replace(
            t,
            origin=None,
            versions=tuple(
                replace(v, origin=None, precedences=tuple(replace(p, origin=None) for p in v.precedences))
                for v in t.versions
            ),
        )
        for t in tasks
    )


def test_every_value_is_read():
    got = read("executors.yaml").model
    sense = task(
        "/sense",
        "100/3ms",
        version("full", "3ms", "u1 u2", gang=2),
        version("fast", "1ms", "u1"),
        slack="1/8",
        offset="1ms",
        deadline="20ms",
    )
    act = task("/act", None, version("v", "2ms", "u2", after("/sense", "1ms", "9ms", "end")))
    off = mode("halt", [replace(sense, versions=sense.versions[1:])])
    wanted = model(sense, act, units="u1 u2", modes=[mode("go", [sense, act]), off], name="pair")
    assert without_origins(got.tasks) == wanted.tasks
    assert tuple(replace(m, origin=None) for m in got.modes) == wanted.modes
    assert [(u.name, u.type) for u in got.units] == [("u1", "a53"), ("u2", "")]
    assert replace(got.chains[0], origin=None) == chain("c", "/sense /act", "1s", 90)
    assert replace(got.transitions[0], origin=None) == Transition(source="go", target="halt", max_length=ms(50))
    assert got.name == "pair"


def test_elements_know_their_lines():
    got = read("executors.yaml").model
    assert got.task("/act").origin == Origin(str(FIXTURES / "executors.yaml"), 18, "/act")
    assert got.task("/sense").versions[1].origin.line == 17


def test_executors_are_accounted_for_as_the_schedules():
    imported = read("executors.yaml")
    assert reasons(imported, "executor") == {"go u1": "is what the schedule says, not the model"}
    assert rows(imported)["version"] == [3, 3, 0]


def test_recordings_add_nothing():
    imported = read("executors.yaml", "bag/metadata.yaml")
    assert set(reasons(imported, "bag_topic").values()) >= {"the executors file states every period"}
    assert str(imported.model.task("/sense").period) == str(Duration.parse("100/3ms"))


def test_measurements_replace_the_wcet_of_a_task_with_one_version(tmp_path):
    table = tmp_path / "t.csv"
    table.write_text("callback,duration_ms\n" + "/act,5\n/sense,7\n" * 10)
    options = RosImportOptions(calibrate=(str(table),))
    imported = FORMAT.read([str(FIXTURES / "executors.yaml")], options)
    assert str(imported.model.task("/act").versions[0].wcet) == "5ms"
    assert [str(v.wcet) for v in imported.model.task("/sense").versions] == ["3ms", "1ms"]
    (left,) = found(imported.diagnostics, codes.UNMEASURED)
    assert "several versions" in left.message


def broken(tmp_path, old, new):
    assert old in TEXT
    path = tmp_path / "x.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    return [(d.code, d.at.line) for d in refusal(path).diagnostics if d.is_error]


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("executors: 1", "executors: 2", BAD_VALUE, 2),
        ("model: pair\n", "", MISSING_KEY, 2),
        ("period: 100/3ms", "period: 0ms", BAD_VALUE, 11),
        ("period: 100/3ms", "period: 7", BAD_VALUE, 11),
        ("slack: 1/8", "slack: 2", BAD_VALUE, 12),
        ("slack: 1/8", "slak: 1/8", UNKNOWN_KEY, 12),
        ("gang: 2", "gang: 0", BAD_VALUE, 16),
        ("from: end", "from: middle", BAD_VALUE, 24),
        ("name: u2}", "name: 'u 2'}", BAD_VALUE, 8),
        ("name: u2}", "cpu: 3}", MISSING_KEY, 8),
        (", max: 9ms", "", MISSING_KEY, 24),
        ("versions: [v]", "versions: []", BAD_VALUE, 33),
        ("tasks: [/sense, /act], ", "", MISSING_KEY, 26),
        ("name: u2}", "name: u1}", codes.DUPLICATE, 8),
        ("name: fast", "name: full", codes.DUPLICATE, 17),
        ("units: [u2]", "units: [u3]", codes.DANGLING, 20),
        ("task: /sense, from", "task: /sens, from", codes.DANGLING, 24),
        ("[/sense, /act]", "[/sense, /akt]", codes.DANGLING, 26),
        ("to: halt", "to: hal", codes.DANGLING, 28),
        ("task: /act, versions", "task: /actor, versions", codes.DANGLING, 30),
        ("versions: [fast]", "versions: [slow]", codes.DANGLING, 37),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, old, new, code, line):
    found_errors = broken(tmp_path, old, new)
    assert code.id in {id for id, _ in found_errors}
    assert {at for id, at in found_errors if id == code.id} == {line}


def test_all_errors_are_collected(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text(
        TEXT.replace("slack: 1/8", "slack: x").replace("gang: 2", "gang: x").replace("max-age: 90ms", "max-age: x")
    )
    assert len([d for d in refusal(path).diagnostics if d.is_error]) == 3
