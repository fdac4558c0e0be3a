"""What an exported configuration does on an OS: no part is late and no access early, whatever ends early (MODEL 8.2).

The OS of `arxml_os` plays the file; jobs take a random share of their time, and interrupts come at random.
"""

import random
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from arxml_os import Core, read_tasks

import split_switches
from arxml_reading import containers, parameters, q, seconds_per_tick, tables, write
from halpipe.importers.native import read_model, read_schedule
from halpipe.models import ModeSchedule, Schedule, Split, Status
from halpipe.pipeline.parts import job_of, parts_of, phase_instants, service_of
from halpipe.pipeline.verify import verify
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


def trials(system, plan, unit, change=lambda root: None, switch=None, count=40):
    """Yield trials of one export, which `change` changes."""
    root = write(system, plan)
    change(root)
    for seed in range(count):
        yield Trial(system, plan, unit, seed, root, switch)


class Trial:
    """One core of a schedule, played with one seed: the first mode, or a switch with a cycle of the mode before it."""

    def __init__(self, system, plan, unit, seed, root, switch=None):
        self.rng = random.Random(seed)
        self.model, self.unit = system, unit
        self.root = root
        self.service = service_of({u.name: u for u in system.units}, [unit])
        self.tick = int(seconds_per_tick(self.root) * 10**9)
        self.played = self._cycles(plan.modes[0], 3) if switch is None else self._switch(plan, switch)
        self.end = sum(tables(self.root)[name].duration * self.tick for name in self.played)
        self.jobs = {(j.task, at): j for at, j in self.line if unit in j.units}
        self.holds = {name: os_task.holds for name, os_task in read_tasks(self.root).items()}

    def _cycles(self, mode, count):
        self.line = [(n * mode.hyperperiod.ns + j.start.ns, j) for n in range(count) for j in mode.jobs]
        return [f"Mode_{mode.name}_{self.unit}"] * count

    def _switch(self, plan, switch):
        """Two cycles of the mode before, the switch, and two of the mode after, or what the switch leaves of them."""
        source, target = plan.mode(switch.source), plan.mode(switch.target)
        played = self._cycles(source, 2)
        begin = 2 * source.hyperperiod.ns
        self.line += [(begin + j.start.ns, j) for j in switch.jobs]
        name = f"Switch_{source.name}_to_{target.name}_{self.unit}"
        longer = tables(self.root)[name].duration * self.tick - switch.length.ns if name in tables(self.root) else 0
        begin += switch.length.ns
        cycle = target.hyperperiod.ns
        assert longer % cycle == 0
        count = 2 + longer // cycle
        self.line += [(begin + n * cycle + j.start.ns, j) for n in range(count) for j in target.jobs]
        return [*played, *([name] if name in tables(self.root) else []), *[f"Mode_{target.name}_{self.unit}"] * 2]

    def job(self, name, at):
        return self.jobs[name, at]

    def faults(self):
        """Every part that is over late, and every access phase that begins early; all jobs must run."""
        core = Core(self.root, self.played, self.tick, self._program)
        ran = core.play(self._arrivals())
        for run in ran:
            yield from self._faults(run)
        yield from (f"{name} is activated at {at} while it is open" for name, at in core.lost)
        begun = {(run.task, run.start) for run in (*ran, *core.open.values())}
        yield from (f"{name} does not run at {at}" for name, at in sorted(self.jobs.keys() - begun))

    def _program(self, name, at):
        """Return the stretches of a job between the positions that matter; each takes a random share of its time."""
        planned = self.job(name, at)
        chosen = self.model.task(name).version(planned.version)
        ends = {part.executed_to.ns for part in parts_of(planned, chosen)} | {chosen.wcet.ns}
        ends |= {access.start.ns for access in chosen.accesses} | {point.ns for point in chosen.split.points}
        bounds = sorted(ends | {0})
        gaps = {part.executed_from.ns for part in planned.parts[1:]} if chosen.split.points else set()
        found = []
        for begin, end in pairwise(bounds):
            time = self.rng.choice([end - begin, self.rng.randint(0, end - begin), 0])
            resume = self.rng.choice([0, chosen.split.resume.ns]) if begin in gaps else 0
            if len(self.holds[name].get(begin, ())) > 1:  # it goes on, and waits once more
                found.append([resume, begin])
                resume = 0
            found.append([time + resume, end])
        return found

    def _arrivals(self):
        for distance, time in self.service:
            at = self.rng.randrange(distance.ns)
            while at < self.end:
                yield at, self.rng.choice([time.ns, self.rng.randint(0, time.ns)])
                at += distance.ns + self.rng.choice([0, 0, self.rng.randrange(distance.ns)])

    def _faults(self, run):
        planned = self.job(run.task, run.start)
        chosen = self.model.task(run.task).version(planned.version)
        by = run.start - planned.start.ns
        if run.start + (planned.end - planned.start).ns > self.end:
            return  # goes on in a table that is not played
        parts = parts_of(planned, chosen)
        for part in parts:
            due, reached = part.end.ns + by, run.reached[part.executed_to.ns]
            if reached > due:
                yield f"{run.task} is at {part.executed_to} at {reached}, due {due}"
        for access in chosen.accesses:
            begin, _ = phase_instants(access, parts, chosen.split.resume, self.service)
            early = begin.ns + by - run.left[access.start.ns]
            if early > 0:
                yield f"{run.task} begins its access {early} early"


@pytest.mark.parametrize(
    ("case", "unit"), [(example, "core1"), (example, "core2"), (example, "gpu"), (held, "u1"), (nested, "u1")]
)
def test_no_part_is_late_and_no_access_early(case, unit):
    system, plan = case()
    assert [fault for trial in trials(system, plan, unit) for fault in trial.faults()] == []


def switched():
    system = split_switches.system()
    return system, split_switches.plan(system)


def switched_by_priorities():
    """The same; priorities alone suspend and resume it."""
    system = split_switches.system(version("v", 4), split=Split(anywhere=True, max_gaps=2, resume=ms("0.1ms")))
    return system, split_switches.plan(system)


@pytest.mark.slow
@pytest.mark.parametrize("case", [switched, switched_by_priorities])
@pytest.mark.parametrize("way", [0, 1])
def test_no_part_is_late_and_no_access_early_across_a_switch(case, way):
    """One way a job is in progress, the other way one of the table is, when the mode after begins."""
    system, plan = case()
    assert [d for d in verify(system, plan) if d.is_error] == []
    played = trials(system, plan, "u1", switch=plan.transitions[way])
    assert [fault for trial in played for fault in trial.faults()] == []


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


def without_events_of_switches(root):
    """Let the tables of switches set no events."""
    for name, table in containers(root, "OsScheduleTable").items():
        for inner in list(table.iter(q("ECUC-CONTAINER-VALUE"))) if name.startswith("Switch") else ():
            if inner.findtext(q("DEFINITION-REF")).endswith("OsScheduleTableEventSetting"):
                inner.getparent().remove(inner)


@pytest.mark.parametrize("way", [0, 1])
@pytest.mark.parametrize(
    ("case", "change"),
    [(switched, without_holds), (switched, without_events_of_switches), (switched_by_priorities, upside_down)],
)
def test_without_holds_events_or_priorities_parts_are_late_across_a_switch(case, change, way):
    system, plan = case()
    assert any(list(trial.faults()) for trial in trials(system, plan, "u1", change, plan.transitions[way]))


@pytest.mark.parametrize(
    ("case", "unit", "change"),
    [(held, "u1", without_holds), (example, "core1", without_holds), (nested, "u1", upside_down)],
)
def test_without_holds_or_with_other_priorities_parts_are_late(case, unit, change):
    system, plan = case()
    assert any(list(trial.faults()) for trial in trials(system, plan, unit, change))
