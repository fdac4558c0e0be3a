"""What an exported configuration does on an OS: no part is late and no access early, whatever ends early (MODEL 8.2).

The OS of `arxml_os` plays the file; jobs take a random share of their time, and interrupts come at random.
"""

import random
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from arxml_os import Core

from arxml_reading import containers, parameters, q, seconds_per_tick, write
from halpipe.importers.native import read_model, read_schedule
from halpipe.models import ModeSchedule, Schedule, Split, Status
from halpipe.pipeline.parts import job_of, parts_of, phase_instants, service_of
from support import job, model, ms, task, version

FOLDER = Path(__file__).parents[1] / "fixtures" / "split"


def example():
    return read_model(str(FOLDER / "model.xml")), read_schedule(str(FOLDER / "schedule.xml"))


def planned(system, hyperperiod, *jobs):
    table = ModeSchedule(name="all", hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)
    return system, Schedule(model="m", model_sha256="", modes=(table,))


def parted(system, name, *spans):
    spans = [tuple(map(ms, span)) for span in spans]
    return job_of(name, 0, system.task(name).versions[0], ("u1",), spans, ())


def held():
    """The counter-example of MODEL 8: a's first piece may end early, and b comes at its end."""
    a = task("a", 20, replace(version("v", 10), split=Split(points=(ms(5),))))
    system = model(a, task("b", 20, version("v", 1)))
    return planned(system, 20, parted(system, "a", (0, 0, 5), (6, 5, 10)), job(system, "b", 0, 5, "u1"))


def nested():
    anywhere = Split(anywhere=True, max_gaps=9)
    tasks = [task(name, 40, replace(version("v", 6), split=anywhere)) for name in "ijk"] + [
        task("n", 40, version("v", 2))
    ]
    system = model(*tasks)
    jobs = (
        parted(system, "k", (0, 0, 3), (23, 3, 6)),
        parted(system, "i", (3, 0, 2), (12, 2, 6)),
        parted(system, "j", (5, 0, 6)),
        job(system, "n", 0, 30, "u1"),
    )
    return planned(system, 40, *jobs)


class Trial:
    """One core of one mode of a schedule, played with one seed."""

    def __init__(self, system, plan, unit, seed, change=lambda root: None):
        self.rng = random.Random(seed)
        self.model, self.unit, self.table = system, unit, plan.modes[0]
        self.root = write(system, plan)
        change(self.root)
        self.service = service_of({u.name: u for u in system.units}, [unit])
        self.tick = int(seconds_per_tick(self.root) * 10**9)
        self.jobs = {(j.task, j.start.ns): j for j in self.table.jobs if unit in j.units}

    def job(self, name, at):
        return self.jobs[name, at % self.table.hyperperiod.ns]

    def faults(self, cycles=3):
        """Every part that is over late, and every access phase that begins early."""
        core = Core(self.root, f"Mode_{self.table.name}_{self.unit}", self.tick, self._program)
        for run in core.play(cycles, self._arrivals(cycles)):
            yield from self._faults(run)

    def _program(self, name, at):
        """Return the stretches of a job between the positions that matter; each takes a random share of its time."""
        planned = self.job(name, at)
        chosen = self.model.task(name).version(planned.version)
        ends = {part.executed_to.ns for part in parts_of(planned, chosen)} | {chosen.wcet.ns}
        ends |= {access.start.ns for access in chosen.accesses} | {point.ns for point in chosen.split.points}
        bounds = sorted(ends | {0})
        found = []
        for begin, end in pairwise(bounds):
            time = self.rng.choice([end - begin, self.rng.randint(0, end - begin), 0])
            if begin and chosen.split.points and begin in {part.executed_from.ns for part in planned.parts}:
                time += self.rng.choice([0, chosen.split.resume.ns])
            found.append([time, end])
        return found

    def _arrivals(self, cycles):
        for distance, time in self.service:
            at = self.rng.randrange(distance.ns)
            while at < (cycles + 1) * self.table.hyperperiod.ns:
                yield at, self.rng.choice([time.ns, self.rng.randint(0, time.ns)])
                at += distance.ns + self.rng.choice([0, 0, self.rng.randrange(distance.ns)])

    def _faults(self, run):
        planned = self.job(run.task, run.start)
        chosen = self.model.task(run.task).version(planned.version)
        by = run.start - planned.start.ns
        parts = parts_of(planned, chosen)
        for part in parts:
            due, reached = part.end.ns + by, run.reached[part.executed_to.ns]
            if reached > due:
                yield f"{run.task} is at {part.executed_to} at {reached}, due {due}"
        for access in chosen.accesses:
            begin, _ = phase_instants(access, parts, chosen.split.resume, self.service)
            early = begin.ns + by - run.left[access.start.ns]
            within_resumption = chosen.split.resume.ns if access.start in chosen.split.points else 0
            if early > within_resumption:
                yield f"{run.task} begins its access {early} early"


@pytest.mark.parametrize(
    ("case", "unit"), [(example, "core1"), (example, "core2"), (example, "gpu"), (held, "u1"), (nested, "u1")]
)
def test_no_part_is_late_and_no_access_early(case, unit):
    system, plan = case()
    assert [fault for seed in range(40) for fault in Trial(system, plan, unit, seed).faults()] == []


def without_holds(root):
    """Let OsTasks wait for nothing."""
    for container in containers(root, "OsTask").values():
        for data in container.iterfind(q("ADMIN-DATA/SDGS/SDG")):
            for inner in [e for e in data if e.get("GID") == "halpipe:hold"]:
                data.remove(inner)


def upside_down(root):
    """Turn the priorities round."""
    tasks = containers(root, "OsTask").values()
    most = max(int(parameters(container)["OsTaskPriority"]) for container in tasks)
    for container in tasks:
        for value in container.iterfind(q("PARAMETER-VALUES/*")):
            if value.findtext(q("DEFINITION-REF")).endswith("OsTaskPriority"):
                found = value.find(q("VALUE"))
                found.text = str(most + 1 - int(found.text))


@pytest.mark.parametrize(
    ("case", "unit", "change"),
    [(held, "u1", without_holds), (example, "core1", without_holds), (nested, "u1", upside_down)],
)
def test_without_holds_or_with_other_priorities_parts_are_late(case, unit, change):
    system, plan = case()
    assert any(list(Trial(system, plan, unit, seed, change).faults()) for seed in range(40))
