"""The same drive on a simulated board: bundle, runtime, DMA and all, byte for byte what this computer drives."""

import shutil
from dataclasses import replace

import drive as module
import host
import pytest
from roboracer_case import EXAMPLE, by_hand

import halpipe
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, CoSimulation
from halpipe.exporters.native.schedule import format_schedule
from halpipe.flow.formats import open_target
from support import ms

pytest.importorskip("ziglang", reason="pip install ziglang pyelftools unicorn")
pytest.importorskip("unicorn", reason="pip install ziglang pyelftools unicorn")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    shutil.copytree(EXAMPLE / "tasks", folder / "tasks")
    shutil.copy(EXAMPLE / "model.xml", folder / "model.xml")
    model = halpipe.load(str(folder / "model.xml"))
    (folder / "schedule.xml").write_bytes(format_schedule(by_hand(model)))
    arguments = ["export", "riscv", "model.xml", "schedule.xml", "--profile", "vcu118", "-o", "bundle"]
    arguments += ["--inputs", str(EXAMPLE / "recorded")]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        from halpipe import cli

        assert cli.invoke(arguments) == 0
    return str(folder / "bundle")


@pytest.fixture(scope="module")
def here(model, schedule, programs):
    """The drive on this computer, and how many tables it takes."""
    drive = module.a_drive(1, 1, 0)
    computer = host.Host(model, schedule, programs)
    computer.run(drive, 4000)
    return drive, len(computer.played)


@pytest.fixture(scope="module")
def on_board(bundle, here):
    drive = module.a_drive(1, 1, 0)
    return drive, module.on_a_board(drive, open_target(bundle), here[1], "real")


def test_the_board_drives_as_this_computer_does(on_board, here):
    drive, _ = on_board
    assert drive.succeeded
    assert module.course(drive) == module.course(here[0])


def test_jobs_fit_with_what_the_sensors_saw(bundle):
    checked = DEPLOYMENT.check(open_target(bundle), CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    (line,) = [line for line in checked.lines if line.startswith("with recorded inputs of odometry, scan, ")]
    assert 2 < float(line.split("up to ")[1].split(" cycles")[0]) < 20  # on empty buffers 380


def test_every_job_of_the_drive_is_as_scheduled(on_board):
    _, outcome = on_board
    assert outcome.findings == []
    assert outcome.run.faults == []
    assert len(outcome.jobs) == sum(len(table.jobs) for table in outcome.tables)
    assert len(outcome.jobs) > 1000


def test_the_modes_follow_each_other(on_board):
    names = [table.name for table in on_board[1].run.tables]
    order = [name for i, name in enumerate(names) if i == 0 or names[i - 1] != name]
    assert order == ["race", "race->time-trial", "time-trial", "time-trial->safe-stop", "safe-stop"]


def test_modelled_execution_drives_the_same_way(bundle, here):
    drive = module.a_drive(1, 1, 0)
    module.on_a_board(drive, open_target(bundle), here[1], "modelled")
    assert module.course(drive) == module.course(here[0])


def test_a_slow_memory_spoils_the_drive(bundle):
    """The loop is closed through the DMA engine: when transfers do not arrive in time, jobs compute with nothing."""
    drive = module.a_drive(1, 1, 0)
    target = open_target(bundle)
    slow = tuple(replace(resource, bandwidth=4_000_000) for resource in target.model.resources)
    target = replace(target, model=replace(target.model, resources=slow))
    CoSimulation(target, plant=module.Track(drive), cycles=15).run()
    assert drive.world.car.distance == 0


def test_a_pure_pursuit_that_overruns_ends_in_a_safe_stop_without_a_scratch(bundle, tmp_path, capsys):
    assert module.main([bundle, "--overrun", "5", "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "0 deviations from what has to follow" in said
    assert "race to safe-stop at 5.025 s" in said
    assert "the car stands at the end" in said
    assert "0 collisions" in said


def test_the_switch_takes_no_longer_than_the_schedule_says(bundle):
    target, drive = open_target(bundle), module.a_drive(1, 3, 2)
    outcome = module.with_an_overrun(drive, target, ms(5000), 210)
    took, most = module.reaction(target, outcome)
    assert most == ms(25)  # a hyperperiod, and a table without length
    assert took <= most
    assert [table.name for table in outcome.run.tables if table.name != "race"][:2] == ["race->safe-stop", "safe-stop"]


def test_without_health_rules_the_same_overrun_ends_in_a_wall(bundle):
    drive = module.a_drive(1, 3, 2)
    outcome = module.with_an_overrun(drive, open_target(bundle), ms(5000), 320, health=False)
    assert outcome.findings == []
    assert {table.name for table in outcome.run.tables} == {"race"}
    assert drive.collisions > 50


def test_the_command_drives_a_bundle(bundle, tmp_path, capsys):
    options = ["--race-laps", "0", "--trial-laps", "0", "-o", str(tmp_path)]
    assert module.main([bundle, *options]) == 0
    said = capsys.readouterr().out
    assert "on this computer the tasks drive the same course" in said
    assert "0 deviations from the schedule" in said
    assert (tmp_path / "trace.csv").read_text().startswith("cycle,mode,task,job,units,start,end\n")
