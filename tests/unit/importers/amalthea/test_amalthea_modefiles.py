"""One file for each mode: a list of them, the limits of switches, and one model of all."""

import pytest
from amalthea_case import HARDWARE, PLAIN_STIMULI, document, files, found, refusal, stimulus, task, ticks, write

from halpipe.importers.amalthea import codes

FIVE = stimulus("p5", "PeriodicStimulus", '<recurrence value="5" unit="ms"/>')


def system(folder, *, lines="0.0;Drive;/far/away/drive.amxmi\n0.1;Park;park.amxmi\n0.2;end;\n", limits="", **tasks):
    """Write two models, the list that names them and the limits; return what to name on the command line."""
    for name, sw in tasks.items():
        write(folder, document(sw=sw, hw=HARDWARE, stimuli=PLAIN_STIMULI + FIVE), f"{name}.amxmi")
    paths = [write(folder, lines, "car.modes")]
    return [*paths, write(folder, limits, "limits.csv")] if limits else paths


def runs(imported):
    return {mode.name: {run.task: run.versions for run in mode.runs} for mode in imported.model.modes}


def test_tasks_that_agree_are_one_with_a_version_for_each_difference(tmp_path):
    both = task("T", ticks(5)) + task("U", ticks(3))
    imported = files(*system(tmp_path, drive=both, park=both.replace(ticks(3), ticks(9))))
    assert imported.model.name == "car"
    assert {t.name: {v.name: str(v.wcet) for v in t.versions} for t in imported.model.tasks} == {
        "T": {"A": "50ns", "B": "25ns"},
        "U": {"A": "30ns", "B": "15ns", "A:Park": "90ns", "B:Park": "45ns"},
    }
    assert runs(imported) == {
        "Drive": {"T": ("A", "B"), "U": ("A", "B")},
        "Park": {"T": ("A", "B"), "U": ("A:Park", "B:Park")},
    }
    assert [unit.name for unit in imported.model.units] == ["a0", "a1", "b0"]


def test_tasks_of_another_period_are_others(tmp_path):
    go = stimulus("go", "InterProcessStimulus")
    trigger = '<items xsi:type="am:InterProcessTrigger" stimulus="go?type=InterProcessStimulus"/>'
    after = task("U", ticks(1), stimuli="go?type=InterProcessStimulus")
    drive = task("T", ticks(5), trigger) + after
    paths = system(tmp_path, drive=drive, park=drive.replace("p10", "p5"))
    for name in ("drive", "park"):
        path = tmp_path / f"{name}.amxmi"
        path.write_text(path.read_text().replace("</stimuliModel>", go + "</stimuliModel>"))
    imported = files(*paths)
    assert {t.name: str(t.period) for t in imported.model.tasks} == {
        "T@Drive": "10ms",
        "U@Drive": "10ms",
        "T@Park": "5ms",
        "U@Park": "5ms",
    }
    assert [p.task for p in imported.model.task("U@Park").versions[0].precedences] == ["T@Park"]
    assert len(found(imported.diagnostics, codes.MODES_DIFFER)) == 1


def test_limits_of_switches_are_transitions(tmp_path):
    both = task("T", ticks(5))
    imported = files(*system(tmp_path, drive=both, park=both, limits="Drive,Park,100ms\nPark,Drive,0.2s\n"))
    assert [(t.source, t.target, str(t.max_length)) for t in imported.model.transitions] == [
        ("Drive", "Park", "100ms"),
        ("Park", "Drive", "200ms"),
    ]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"lines": ""}, 0),
        ({"lines": "0.0;Drive\n"}, 1),
        ({"lines": "0.0;Drive;drive.amxmi\n0.1;Drive;park.amxmi\n"}, 2),
        ({"limits": "Drive,Park\n"}, 1),
        ({"limits": "Drive,Park,soon\n"}, 1),
        ({"limits": "Drive,Parc,1ms\n"}, 1),
    ],
)
def test_lists_and_limits_of_a_wrong_form_name_their_line(tmp_path, change, line):
    both = task("T", ticks(5))
    failure = refusal(files, *system(tmp_path, drive=both, park=both, **change))
    assert line in [d.at.line for d in found(failure.diagnostics, codes.BAD_MODE_LIST)]


def test_models_do_not_go_beside_a_list(tmp_path):
    both = task("T", ticks(5))
    paths = system(tmp_path, drive=both, park=both)
    failure = refusal(files, *paths, tmp_path / "drive.amxmi")
    assert len(found(failure.diagnostics, codes.BAD_MODE_LIST)) == 1


def test_a_missing_model_of_a_mode_is_an_error(tmp_path):
    failure = refusal(files, *system(tmp_path, drive=task("T", ticks(5))))
    assert [d.at.file for d in failure.diagnostics if d.is_error] == [str(tmp_path / "park.amxmi")]
