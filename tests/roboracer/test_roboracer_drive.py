"""The closed loop: the tasks drive the simulated car in the order of the schedule."""

import csv
import io
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import drive as module
import host
import pytest
from roboracer_case import EXAMPLE

from halpipe.exporters.native.schedule import format_schedule
from halpipe.models import AccessKind
from support import ms


def driven(model, schedule, programs, seed=1, race_laps=1, trial_laps=0, most=4000):
    drive = module.a_drive(seed, race_laps, trial_laps)
    played = host.Host(model, schedule, programs)
    played.run(drive, most)
    return drive, played


@pytest.fixture(scope="module")
def short(model, schedule, programs):
    """One lap against the opponent, then a safe stop by way of the time trial."""
    return driven(model, schedule, programs)


@pytest.mark.slow
def test_the_car_drives_a_lap_overtakes_and_stops_without_a_scratch(short):
    drive, _ = short
    assert drive.succeeded
    assert drive.collisions == 0
    assert len(drive.world.overtakes) == 1
    assert len(drive.world.laps) == 1
    assert drive.world.car.speed == 0


def test_modes_are_switched_while_it_drives(short):
    drive, played = short
    order = [table for i, table in enumerate(played.played) if i == 0 or played.played[i - 1] != table]
    assert order == ["race", "race->time-trial", "time-trial", "time-trial->safe-stop", "safe-stop"]
    modes = [table for table in played.played if "->" not in table]
    assert drive.modes[: len(modes)] == modes
    for mode in ("time-trial", "safe-stop"):
        first = drive.modes.index(mode)
        assert drive.world.moments[first].speed > 2  # it drove


def test_the_car_knows_where_it_is(short):
    drive, _ = short
    errors = [m.error[0] for m in drive.world.moments if m.error is not None]
    assert len(errors) > len(drive.world.moments) - 5
    assert sum(errors) / len(errors) < 0.03
    assert max(errors) < 0.10


def test_a_drive_is_the_same_each_time(short, model, schedule, programs):
    again, _ = driven(model, schedule, programs, most=150)
    assert module.course(short[0]).startswith(module.course(again))
    other, _ = driven(model, schedule, programs, seed=2, most=150)
    assert not module.course(short[0]).startswith(module.course(other))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_the_whole_race_goes_well_whatever_the_noise(model, schedule, programs, seed):
    drive, _ = driven(model, schedule, programs, seed, 3, 2)
    assert drive.succeeded
    assert len(drive.world.overtakes) == 2
    race, trial = drive.world.laps[1].time, drive.world.laps[4].time
    assert trial < race


@pytest.mark.slow
@pytest.mark.parametrize(("ahead", "speed"), [(2.0, 1.2), (6.0, 2.3), (12.0, 1.6), (20.0, 0.8)])
def test_other_opponents_are_not_hit_either(model, schedule, programs, ahead, speed):
    drive = module.a_drive(1, 2, 0)
    drive.world.opponent.s, drive.world.opponent.speed = ahead, speed
    host.Host(model, schedule, programs).run(drive, 4000)
    assert drive.succeeded
    assert drive.world.overtakes


# ------------------------------------------------------------------------------------------------ what it rests on


def test_without_localisation_it_does_not_move(model, schedule, programs):
    """The loop is closed: what a task does not write, the next one does not have."""

    class Silent:
        def run(self, inputs, outputs):
            return {symbol: bytes(size) for symbol, size in outputs.items()}

    drive, _ = driven(model, schedule, {**programs, ("/particle_filter", "full"): Silent()}, most=100)
    assert not drive.succeeded
    assert drive.world.car.distance == 0


def test_a_blind_car_hits_the_opponent(model, schedule, programs):
    """Collisions are possible: without detection the car drives into the one ahead."""

    class Blind:
        def run(self, inputs, outputs):
            return {symbol: bytes(size) for symbol, size in outputs.items()}

    drive = module.a_drive(1, 1, 0)
    drive.world.opponent.speed = 0.8
    played = host.Host(model, schedule, {**programs, ("/opponent_detection", "full"): Blind()})
    played.run(drive, 200)
    assert drive.collisions > 0
    assert not drive.succeeded


def test_jobs_take_what_lies_there_when_they_read(model, schedule, programs):
    """A schedule whose control reads before the planner writes gives another drive: order matters, not time alone."""
    race = schedule.modes[0]
    moved = [replace(job, start=ms(12), end=ms(14)) if job.task == "/pure_pursuit" else job for job in race.jobs]
    other = replace(schedule, modes=(replace(race, jobs=tuple(moved)), *schedule.modes[1:]))
    first, _ = driven(model, schedule, programs, most=60)
    second, _ = driven(model, other, programs, most=60)
    assert [m.x for m in first.world.moments] != [m.x for m in second.world.moments]


def test_buffers_are_as_large_as_what_is_written(model):
    sizes = {name: len(content) for name, content in host.buffers(model).items()}
    for task in model.tasks:
        for version in task.versions:
            for access in version.accesses:
                for t in access.transfers:
                    assert sizes[t.buffer] == t.size
                    assert access.kind in (AccessKind.READ, AccessKind.WRITE)


# ------------------------------------------------------------------------------------------------ what comes out


def test_the_lap_table_adds_up(short):
    drive, _ = short
    rows = list(csv.DictReader(io.StringIO(module.lap_table(drive))))
    assert [row["lap"] for row in rows] == ["1"]
    assert rows[0]["mode"] == "race"
    assert float(rows[0]["time"]) == pytest.approx(drive.world.laps[0].end, abs=1e-3)
    assert rows[0]["overtakes"] == "1"


def test_the_course_has_a_row_for_each_cycle(short):
    drive, _ = short
    rows = list(csv.DictReader(io.StringIO(module.course(drive))))
    assert len(rows) == len(drive.modes)
    assert float(rows[1]["time"]) - float(rows[0]["time"]) == pytest.approx(0.025)
    assert {row["mode"] for row in rows} == {"race", "time-trial", "safe-stop"}
    assert {row["opponent"] == "" for row in rows if row["mode"] != "race"} == {True}


def test_the_picture_shows_walls_modes_switches_and_laps(short):
    from picture import COLOURS, picture

    drive, _ = short
    laps = [(drive.mode_of(lap), lap.time) for lap in drive.world.laps]
    root = ET.fromstring(picture(drive.world, drive.modes, laps))
    assert len(root.findall("{*}polygon")) == 2
    lines = [line.get("stroke") for line in root.findall("{*}polyline")]
    assert [colour for colour in lines if colour in COLOURS.values()] == list(COLOURS.values())
    texts = [text.text for text in root.findall("{*}text")]
    assert f"{drive.world.laps[0].time:.3f} s" in texts
    assert any(text.startswith("overtakes at") for text in texts)
    assert sum(text.startswith(("race from", "time-trial from", "safe-stop from")) for text in texts) == 3
    width, height = float(root.get("width")), float(root.get("height"))
    for point in (p for line in root.findall("{*}polyline") for p in line.get("points").split()):
        x, y = map(float, point.split(","))
        assert 0 < x < width
        assert 0 < y < height


def test_the_summary_tells_laps_switches_and_errors(short):
    text = module.summary(short[0])
    assert "race to time-trial at" in text
    assert "time-trial to safe-stop at" in text
    assert "0 collisions" in text
    assert "the car stands at the end" in text


# ------------------------------------------------------------------------------------------------ the command


def command(*arguments):
    run = [sys.executable, str(EXAMPLE / "drive.py"), *map(str, arguments)]
    return subprocess.run(run, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.slow
def test_the_command_writes_table_course_and_picture(model, schedule, tmp_path):
    (tmp_path / "schedule.xml").write_bytes(format_schedule(schedule))
    options = ["--race-laps", 1, "--trial-laps", 1, "-o", tmp_path / "out"]
    done = command(EXAMPLE / "model.xml", tmp_path / "schedule.xml", *options)
    assert (done.returncode, done.stderr) == (0, "")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["drive.csv", "drive.svg", "laps.csv"]


def test_a_missing_file_is_a_message(tmp_path):
    done = command(tmp_path / "none.xml", tmp_path / "none.xml")
    assert done.returncode == 1
    assert "error[HAL" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_bundle_that_is_none_is_a_message(tmp_path):
    done = command(tmp_path)
    assert done.returncode == 1
    assert "manifest.json: error[HAL" in done.stderr
    assert "Traceback" not in done.stderr


def test_three_files_are_a_usage_error(tmp_path):
    done = command(tmp_path, tmp_path, tmp_path)
    assert done.returncode == 2
    assert "give a bundle" in done.stderr
