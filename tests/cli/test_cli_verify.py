"""What `halpipe verify` tells people of a schedule whose model was changed: causes, not every consequence."""

import json
import re

import pytest

from halpipe.starters import first_model


@pytest.fixture
def changed(halpipe, folder):
    """The first model with another WCET, beside the schedule of the model as it was."""
    model = first_model()["model.xml"]
    (folder / "first.xml").write_bytes(model)
    assert halpipe("schedule", "first.xml", "-o", "first.schedule.xml", "--optimise", "none").returncode == 0
    (folder / "first.xml").write_bytes(model.replace(b'name="full" wcet="6ms"', b'name="full" wcet="5ms"'))
    return "first.xml", "first.schedule.xml"


def codes(text):
    return [line.partition("[")[2].partition("]")[0] for line in text.splitlines() if ": error[" in line]


def test_jobs_of_one_task_are_told_together_and_figures_last(halpipe, changed):
    run = halpipe("verify", *changed)
    assert run.returncode == 1
    assert codes(run.stdout) == ["HAL0302", "HAL0313", "HAL0340"]
    assert '2 more like it: mode "drive" task "camera" job 1, mode "limp" task "camera" job 0' in run.stdout
    assert "fix the violations of the jobs first" in run.stdout


def test_a_refused_export_reports_causes_before_effects(halpipe, changed):
    run = halpipe("export", "report", *changed, "-o", "report.html")
    assert run.returncode == 1
    assert codes(run.stderr) == ["HAL0302", "HAL0313", "HAL0340"]
    assert "2 more like it" in run.stderr
    refused = halpipe("export", "report", *changed, "-o", "report.html", "--format", "json")
    found = [each["code"] for each in json.loads(refused.stderr) if each["severity"] == "error"]
    assert found[:2] == ["HAL0302", "HAL0313"]
    assert found.index("HAL0340") == len(found) - found.count("HAL0340")  # figures are last


def test_faults_of_the_model_come_before_those_of_the_schedule(halpipe, folder, changed):
    model, schedule = changed
    text = (folder / model).read_text().replace('wcet="5ms"', 'wcet="0ms"')
    (folder / "zoo.xml").write_text(text)  # its name is behind that of the schedule
    found = json.loads(halpipe("verify", "zoo.xml", schedule, "--format", "json").stdout)
    assert [each["code"] for each in found[:4]] == ["HAL0302", "HAL0303", "HAL0303", "HAL0313"]
    assert found[-1]["code"] == "HAL0340"


def test_everything_is_told_where_that_is_asked_for(halpipe, changed):
    run = halpipe("verify", *changed, "--verbose")
    assert codes(run.stdout).count("HAL0313") == 3
    data = json.loads(halpipe("verify", *changed, "--format", "json").stdout)
    assert len(data) == len(codes(run.stdout)) > 5


def test_figures_alone_are_told_one_by_one(halpipe, folder, changed):
    model, _ = changed
    assert halpipe("schedule", model, "-o", "again.xml").returncode == 0
    text = (folder / "again.xml").read_text()
    (folder / "again.xml").write_text(re.sub(r'busy="(\d)', r'busy="1\1', text))
    found = codes(halpipe("verify", model, "again.xml").stdout)
    assert set(found) == {"HAL0340"}
    assert len(found) > 1
