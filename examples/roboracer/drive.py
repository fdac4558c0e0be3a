"""Drive the RoboRacer stack round a track, in a closed loop with a simulated car: `python drive.py --help`."""

from __future__ import annotations

import argparse
import copy
import sys
import tempfile
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import host
from picture import picture
from report import course, lap_table, summary
from track import circuit
from world import Lap, Opponent, World

import halpipe
from halpipe.core.diagnostics import render_text
from halpipe.core.durations import seconds
from halpipe.deploy.riscv import Board, CoSimulation, Plant
from halpipe.deploy.riscv.judge.check import Outcome, judge, tolerance_of
from halpipe.deploy.riscv.judge.containment import Course, course_of
from halpipe.deploy.riscv.judge.figures import csv_of, rows_of, summary_lines
from halpipe.deploy.riscv.run.cosimulation import read_images
from halpipe.deploy.riscv.run.expectation import Expectation, PlannedJob
from halpipe.deploy.riscv.run.injection import Injection, Kind, Saboteur, code_of
from halpipe.deploy.riscv.run.sequence import Played, played_tables
from halpipe.deploy.riscv.target import read_site
from halpipe.flow.formats import open_target
from halpipe.importers.native import read_model, read_schedule

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.core.durations import Duration
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.run.observation import Execution
    from halpipe.deploy.riscv.target import Site
    from halpipe.models import Schedule, TaskModel

HERE = Path(__file__).parent
MOST = 8000  # cycles: 200 s
FARTHER = 0.3  # of a lap, before the safe stop
STILL = 20  # cycles without motion end the drive
SHOWN = 5  # findings
SAMPLES = 20  # of the drive, that are recorded
AFTERWARDS = 120  # cycles: 3 s
FAILING = "/pure_pursuit"


@dataclass
class Drive:
    """Some laps against an opponent, some alone, then a safe stop. Meets the stack at the beginning of every cycle."""

    world: World
    race_laps: int = 3
    trial_laps: int = 2
    finished: bool = False
    modes: list[str] = field(default_factory=list)  # in force at each moment
    requested: str | None = "race"
    still: int = 0
    inputs: dict[str, list[bytes]] = field(default_factory=lambda: {"scan": [], "odometry": []})

    def cycle(
        self, time: int, read: Callable[[str], bytes], write: Callable[[str, bytes], None], mode: str = ""
    ) -> str | None:
        """Exchange data at `time` in ns; return the mode that is requested now, in force from the next cycle on.

        `mode` is the one in force, where that is known; else it is the one that was requested.
        """
        self.modes.append(mode or self.requested or self.modes[-1])
        if self.modes[-1] == "time-trial":
            self.world.opponent = None  # it leaves the track
        self.world.exchange(time / 10**9, read, write)
        for buffer, contents in self.inputs.items():
            contents.append(read(buffer))
        self.requested = self._request()
        moving = self.modes[-1] != "safe-stop" or self.world.car.speed > 0
        self.still = 0 if moving else self.still + 1
        self.finished = self.still >= STILL
        return self.requested

    def _request(self) -> str | None:
        laps = self.world.progress / self.world.track.length
        if self.modes[-1] == "race" and laps >= self.race_laps:
            return "time-trial"
        if self.modes[-1] == "time-trial" and laps >= self.race_laps + self.trial_laps + FARTHER:
            return "safe-stop"
        return None

    def mode_of(self, lap: Lap) -> str:
        """The mode in which most of a lap was driven."""
        middle = (lap.begin + lap.end) / 2
        return self.modes[next(i for i, m in enumerate(self.world.moments) if m.time >= middle)]

    @property
    def collisions(self) -> int:
        """In how many moments the car touches a wall or the opponent."""
        return sum(m.clearance <= 0 or (m.gap is not None and m.gap <= 0) for m in self.world.moments)

    @property
    def succeeded(self) -> bool:
        """Whether all laps were driven and the car stands, without a scratch."""
        return self.finished and len(self.world.laps) >= self.race_laps + self.trial_laps and not self.collisions


def a_drive(seed: int, race_laps: int, trial_laps: int) -> Drive:
    """Make a drive that begins on the start line, with an opponent some metres ahead."""
    track = circuit()
    opponent = Opponent(track, s=3.0) if race_laps else None
    return Drive(World(track, seed=seed, opponent=opponent), race_laps=race_laps, trial_laps=trial_laps)


def on_this_computer(drive: Drive, model: TaskModel, schedule: Schedule, sources: Path) -> int:
    """Drive with the tasks compiled for this computer, in the order of the schedule; return the tables played."""
    with tempfile.TemporaryDirectory() as folder:
        computer = host.Host(model, schedule, host.programs(model, sources, Path(folder)))
        computer.run(drive, MOST)
    return len(computer.played)


class Track(Plant):
    """The drive as the co-simulation of a bundle sees it: what is outside of the board."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """Exchange data when the table of a mode begins; those of transitions have no length here."""
        if "->" not in table and not self.drive.finished:
            mode = self.drive.cycle(int(now.ns), board.read, board.write, table)
            if mode is not None:
                board.request(mode)


def on_a_board(drive: Drive, target: Target, tables: int, execution: str) -> Outcome:
    """Drive with a bundle on a simulated board, for so many tables; every job is held against the schedule."""
    simulation = CoSimulation(target, plant=Track(drive), cycles=tables, execution=execution)
    run = simulation.run()
    first = target.schedule.modes[0].name
    expected = played_tables(target.schedule, first, run.requests, tables, run.site.tick)
    return judge(target, simulation, run, Course(expected))


class Stuck(Saboteur):
    """Has every job of a version of a task go round in circles, from an instant of the run (`since`, in ticks) on."""

    def __init__(self, site: Site, task: str, version: str, since: int) -> None:
        super().__init__(site, (), ())
        self._of, self._since = (task, version), since

    def code(self, execution: Execution) -> bytes:
        """Return a loop for the functions of the version, once it is time."""
        image = execution.image
        is_own = image is not None and (image.site.task, image.site.version) == self._of
        if not is_own or (execution.begin - self.zero) // self.tick < self._since:
            return b""
        return code_of(Kind.SPIN, self._site, self._site.unit_of(execution.hart))

    def injections(self, jobs: Iterable[PlannedJob]) -> list[Injection]:
        """Return which of the jobs of a run fail."""
        return [
            Injection(Kind.SPIN, job.table.cycle, job.row)
            for job in jobs
            if (job.job.task, job.job.version) == self._of and job.executions[0].begin >= self._since
        ]


def with_an_overrun(drive: Drive, target: Target, at: Duration, tables: int, *, health: bool = True) -> Outcome:
    """Drive with a bundle whose pure pursuit never returns from an instant on, for so many tables.

    Every job is held against what has to follow from that by the health rules of the model, or without them.
    """
    site = read_site(target.bundle)
    images = read_images(target.bundle, site)
    stuck = Stuck(site, FAILING, "track", int(at / site.tick))
    simulation = CoSimulation(target, plant=Track(drive), cycles=tables, saboteur=stuck, health=health)
    run = simulation.run()
    if not health:
        target = replace(target, model=replace(target.model, health=()))

    def plan(played: Sequence[Played]) -> tuple[Sequence[PlannedJob], list[Injection]]:
        jobs = Expectation(target.bundle, target.model, site, images).jobs(played)
        return jobs, stuck.injections(jobs)

    first = target.schedule.modes[0].name
    return judge(target, simulation, run, course_of(target, site, first, run.requests, tables, plan))


def reaction(target: Target, outcome: Outcome) -> tuple[Duration, Duration]:
    """Return how long the switch took from the first overrun, and how long the schedule says that it takes at most."""
    run = outcome.run
    first = min(abandoned.time for abandoned in run.recording.abandoned)
    begin = next(table.start for table in run.tables if table.name == "safe-stop")
    most = next(r.within for r in target.schedule.reactions if r.mode == "race" and r.within is not None)
    return begin - run.site.tick * first, most


def written(drive: Drive) -> dict[str, str]:
    """What is written of a drive, by file name."""
    laps = [(drive.mode_of(lap), lap.time) for lap in drive.world.laps]
    return {
        "laps.csv": lap_table(drive),
        "drive.csv": course(drive),
        "drive.svg": picture(drive.world, drive.modes, laps),
    }


def drive_by_files(chosen: argparse.Namespace, drive: Drive) -> tuple[bool, dict[str, str]]:
    """Drive with a model and its schedule, on this computer."""
    model, schedule = read_model(chosen.inputs[0]), read_schedule(chosen.inputs[1])
    violations = halpipe.verify(model, schedule)
    if violations:
        raise halpipe.HalpipeError(*violations)
    on_this_computer(drive, model, schedule, HERE)
    return drive.succeeded, written(drive)


def drive_by_bundle(chosen: argparse.Namespace, drive: Drive) -> tuple[bool, dict[str, str]]:
    """Drive with a bundle on a simulated board, and with its sources on this computer: both must be the same."""
    target = open_target(chosen.inputs[0])
    here = copy.deepcopy(drive)
    tables = on_this_computer(here, target.model, target.schedule, Path(chosen.inputs[0]) / "src")
    outcome = on_a_board(drive, target, tables, chosen.execution)
    same = course(drive) == course(here)
    found = outcome.findings
    lines = [*map(render_text, found[:SHOWN]), *summary_lines(target, [outcome], tolerance_of(outcome.run.site))]
    lines.append(f"{len(found)} deviations from the schedule")
    lines.append("on this computer the tasks drive " + ("the same course" if same else "ANOTHER course"))
    sys.stdout.write("\n".join(lines) + "\n")
    trace = csv_of(rows_of(outcome)).decode()
    return drive.succeeded and same and not found, {**written(drive), "trace.csv": trace}


def drive_with_an_overrun(chosen: argparse.Namespace, drive: Drive) -> tuple[bool, dict[str, str]]:
    """Drive with a bundle on a simulated board until pure pursuit does not return any more, and on to the stop."""
    target = open_target(chosen.inputs[0])
    at = seconds(Fraction(chosen.overrun))
    tables = int(at / target.schedule.modes[0].hyperperiod) + AFTERWARDS
    outcome = with_an_overrun(drive, target, at, tables, health=not chosen.no_health)
    found = outcome.findings
    lines = [*map(render_text, found[:SHOWN]), f"{len(found)} deviations from what has to follow from the overruns"]
    in_time = chosen.no_health
    if not chosen.no_health:
        took, most = reaction(target, outcome)
        in_time = took <= most
        lines.append(f"pure pursuit overran from {at} on; safe-stop began {took} after that was found, at most {most}")
    sys.stdout.write("\n".join(lines) + "\n")
    succeeded = drive.finished and not drive.collisions and not found and in_time
    return succeeded, {**written(drive), "trace.csv": csv_of(rows_of(outcome)).decode()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive, write what happened, and return 0 if all went well."""
    parser = argparse.ArgumentParser(description=__doc__)
    what = "a bundle, to drive on a simulated board; or a model and its schedule, to drive on this computer"
    parser.add_argument("inputs", nargs="+", metavar="FILE", help=what)
    parser.add_argument("-o", "--output", type=Path, default=HERE / "out" / "drive", help="folder for what is written")
    parser.add_argument("--execution", choices=("real", "modelled"), default="real", help="of a bundle (default real)")
    parser.add_argument("--seed", type=int, default=1, help="of all noise (default 1)")
    parser.add_argument("--race-laps", type=int, default=3, help="against the opponent (default 3)")
    parser.add_argument("--trial-laps", type=int, default=2, help="alone (default 2)")
    overrun = "pure pursuit never returns from here on; what then happens is up to the health rules of the model"
    parser.add_argument("--overrun", metavar="SECONDS", type=Fraction, help=overrun)
    parser.add_argument("--no-health", action="store_true", help="with --overrun: as if there were no health rules")
    record = "write some of what the sensors saw, for export riscv --inputs"
    parser.add_argument("--record", metavar="FOLDER", type=Path, help=record)
    chosen = parser.parse_args(arguments)
    if len(chosen.inputs) > 2:
        parser.error("give a bundle, or a model and its schedule")
    if chosen.overrun is not None and (len(chosen.inputs) > 1 or chosen.overrun < 0):
        parser.error("--overrun takes a bundle, and an instant of the drive")
    drive = a_drive(chosen.seed, chosen.race_laps, chosen.trial_laps)
    try:
        drive_it = drive_by_bundle if len(chosen.inputs) == 1 else drive_by_files
        drive_it = drive_it if chosen.overrun is None else drive_with_an_overrun
        succeeded, files = drive_it(chosen, drive)
    except halpipe.HalpipeError as error:
        sys.stderr.write("\n".join(map(render_text, error.diagnostics)) + "\n")
        return 1
    sys.stdout.write(summary(drive))
    chosen.output.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (chosen.output / name).write_text(text, encoding="utf-8")
        sys.stdout.write(f"{chosen.output / name}: written\n")
    if chosen.record is not None:
        chosen.record.mkdir(parents=True, exist_ok=True)
        for buffer, contents in drive.inputs.items():
            kept = contents[:: max(len(contents) // SAMPLES, 1)][:SAMPLES]
            (chosen.record / f"{buffer}.bin").write_bytes(b"".join(kept))
    return 0 if succeeded else 1


if __name__ == "__main__":
    sys.exit(main())
