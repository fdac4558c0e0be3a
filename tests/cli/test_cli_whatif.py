"""size, sensitivity and diff as their users run them."""

import json

import pytest

from halpipe.exporters.native import format_model
from halpipe.pipeline.whatif import codes
from support import model, task, version


@pytest.fixture
def schedule(halpipe, folder):
    text = (folder / "model.xml").read_text().replace('<unit name="c1"/>', '<unit name="c1" type="core"/>')
    (folder / "model.xml").write_text(text.replace('<unit name="c2"/>', '<unit name="c2" type="core"/>'))
    assert halpipe("schedule", "model.xml", "-o", "schedule.xml").returncode == 0
    return folder / "schedule.xml"


def test_size_in_text_and_json(halpipe, schedule):
    shown = halpipe("size", "model.xml", "--units", "core")
    assert shown.returncode == 0
    assert shown.stdout.startswith('units of type "core": found 1 (proven: at least 1); the model has 2\n')
    answer = json.loads(halpipe("size", "model.xml", "--wcet-factor", "--format", "json").stdout)
    assert (answer["found"] <= answer["proven"], answer["proven-is"]) == (True, "at most")
    again = halpipe("size", "model.xml", "--wcet-factor", "--format", "json")
    assert json.loads(again.stdout) == answer
    bandwidth = halpipe("size", "model.xml", "--bandwidth", "mem", "--mode", "all")
    assert bandwidth.stdout.startswith('bandwidth of resource "mem": found 1 (proven: at least 1); the model has 1\n')


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "ask for one of"),
        (("--units", "core", "--wcet-factor"), '"wcet-factor" has no effect here'),
        (("--units", "cores"), 'did you mean "core"'),
        (("--bandwidth", "men"), 'did you mean "mem"'),
        (("--wcet-factor", "--mode", "al"), 'did you mean "all"'),
        (("--wcet-factor", "--step", "0"), "above 0"),
        (("--wcet-factor", "--step", "101%"), "at most 1"),
        (("--wcet-factor", "--step", "x"), "not a number"),
    ],
)
def test_wrong_questions(halpipe, schedule, arguments, said):
    asked = halpipe("size", "model.xml", *arguments)
    assert asked.returncode == 2
    assert said in asked.stderr


def test_the_edges_of_the_options_of_a_search(halpipe, schedule):
    least = ("--step", "1", "--seed", "0", "--budget", "1")
    assert halpipe("size", "model.xml", "--wcet-factor", *least).returncode in (0, 4)
    for option in ("--seed", "--budget"):
        asked = halpipe("size", "model.xml", "--wcet-factor", option, str(int(least[least.index(option) + 1]) - 1))
        assert asked.returncode == 2
        assert "is too small" in asked.stderr


def test_no_size_is_enough(halpipe, folder):
    hopeless = model(task("a", 10, version("v", 6, "d")), task("b", 10, version("v", 6, "d")), units="d", resources="r")
    (folder / "no.xml").write_bytes(format_model(hopeless))
    asked = halpipe("size", "no.xml", "--bandwidth", "r")
    assert asked.returncode == 4
    assert codes.IMPOSSIBLE.id in asked.stderr
    assert "HAL0280" in asked.stderr
    assert "proven" in asked.stdout


def test_sensitivity_in_text_and_json(halpipe, schedule):
    shown = halpipe("sensitivity", "model.xml", "schedule.xml")
    assert shown.returncode == 0
    assert [line.split()[0] for line in shown.stdout.splitlines()] == ["task", "sense", "act"]
    one = halpipe("sensitivity", "model.xml", "schedule.xml", "--task", "act", "--search", "--format", "json")
    (row,) = json.loads(one.stdout)
    assert (row["task"], row["wcet"]) == ("act", "2ms")
    assert row["growth"].endswith("ms")
    assert row["limit"]
    assert set(row["found"]) == {"wcet", "proven-at-most", "failed", "cut-short"}
    assert halpipe("sensitivity", "model.xml", "schedule.xml", "--task", "acts").returncode == 2


def test_sensitivity_refuses_a_schedule_that_does_not_verify(halpipe, schedule, folder):
    (folder / "changed.xml").write_text((folder / "model.xml").read_text().replace('wcet="3ms"', 'wcet="2.5ms"'))
    assert halpipe("sensitivity", "changed.xml", "schedule.xml").returncode == 1


def test_diff_of_schedules(halpipe, schedule, folder):
    same = halpipe("diff", "schedule.xml", "schedule.xml")
    assert (same.returncode, same.stdout) == (0, "same\n")
    text = schedule.read_text()
    first = text[text.index("<job") : text.index("/>", text.index("<job")) + 2]
    (folder / "fewer.xml").write_text(text.replace(first, ""))
    changed = halpipe("diff", "schedule.xml", "fewer.xml")
    assert changed.returncode == 1
    assert "1 removed" in changed.stdout
    answer = json.loads(halpipe("diff", "schedule.xml", "fewer.xml", "--format", "json").stdout)
    assert (answer["kind"], answer["same"], len(answer["jobs"])) == ("schedule", False, 1)
    assert halpipe("diff", "schedule.xml", "-", stdin=text).returncode == 0


def test_diff_of_models(halpipe, schedule, folder):
    (folder / "changed.xml").write_text((folder / "model.xml").read_text().replace('wcet="3ms"', 'wcet="2.5ms"'))
    changed = halpipe("diff", "model.xml", "changed.xml")
    assert (changed.returncode, changed.stdout) == (1, '  task "sense" version "v": wcet: 3ms -> 2.5ms\n')
    answer = json.loads(halpipe("diff", "model.xml", "model.xml", "--format", "json").stdout)
    assert answer == {"kind": "task-model", "same": True, "changes": []}


def test_diff_of_unlike_files(halpipe, schedule, folder):
    (folder / "other.xml").write_text("<what/>")
    mixed = halpipe("diff", "model.xml", "schedule.xml")
    assert mixed.returncode == 1
    assert codes.NOT_COMPARABLE.id in mixed.stderr
    other = halpipe("diff", "model.xml", "other.xml")
    assert other.returncode == 1
    assert "HAL0101" in other.stderr
