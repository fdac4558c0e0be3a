"""Random systems of split, bound and interrupted tasks, through all of it: search, check, cost, traces, and an OS.

Slow; `test_arxml_runs.py` and `unit/exporters/test_parts_shown.py` have the same subjects on single examples.
"""

import random
from dataclasses import replace

import pytest
from test_arxml_runs import trials

from halpipe.core.diagnostics import HalpipeError, Severity
from halpipe.core.durations import ZERO
from halpipe.exporters.btf import FORMAT as BTF
from halpipe.exporters.btf import BtfOptions
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.report import ReportOptions
from halpipe.importers.traces.read import parse_traces
from halpipe.models import Binding, Interrupt, Split, Status
from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.compare import CompareOptions, compare
from halpipe.pipeline.solve.schedule import SearchOptions
from support import access, mode, model, ms, task, version

SEEDS = range(24)


def random_split(rng, wcet):
    kind = rng.choice(["whole", "list", "anywhere"]) if wcet > 2 else "whole"
    if kind == "list":
        points = sorted(rng.sample(range(1, wcet), min(wcet - 1, rng.randint(1, 3))))
        return Split(points=tuple(map(ms, points)), resume=ms(rng.choice(["0ms", "0.1ms"])))
    if kind == "anywhere":
        return Split(anywhere=True, max_gaps=rng.randint(1, 4))
    return Split()


def random_system(seed):
    """A long and a short task and some others on two units, in one mode or two."""
    rng = random.Random(seed)
    tasks = []
    for number in range(rng.randint(3, 6)):
        period = (40, 5)[number] if number < 2 else rng.choice([5, 10, 20, 40])
        wcet = max(1, int(period * rng.uniform(0.1, 0.2 if period < 20 else 0.35)))
        phases = [access("mem", 0, 1, "1/2")] if rng.random() < 0.3 else []
        own = replace(version("v", wcet, rng.choice(["u1", "u2"]), *phases), split=random_split(rng, wcet))
        tasks.append(replace(task(f"t{number}", period, own, slack=1), binding=rng.choice(list(Binding))))
    modes = [mode("a", tasks)]
    if rng.random() < 0.5:
        modes.append(mode("b", [t for t in tasks if rng.random() < 0.7] or tasks[:1]))
    system = model(*tasks, units="u1 u2", resources="mem", modes=modes)
    if rng.random() < 0.5:
        served = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(4), wcet=ms("0.2ms")),))
        system = replace(system, units=(served, system.units[1]))
    return system


@pytest.fixture(scope="module")
def scheduled():
    """The systems that have a schedule, with it."""
    found = []
    for seed in SEEDS:
        system = random_system(seed)
        try:
            plan = schedule_model(system, SearchOptions(optimise=()), lambda *_: True).schedule
        except HalpipeError:
            continue  # overloaded, and proven so
        if all(table.status is Status.VALID for table in plan.modes):
            found.append((system, plan))
    return found


pytestmark = pytest.mark.slow


def test_some_have_gaps_and_all_are_valid(scheduled):
    assert sum(bool(job.parts) for _, plan in scheduled for table in plan.modes for job in table.jobs) >= 10
    for system, plan in scheduled:
        assert [d for d in verify_schedule(system, plan) if d.severity is Severity.ERROR] == []
        assert all(table.cost.total <= 0 for table in plan.modes)


def test_a_trace_of_the_schedule_keeps_it(scheduled):
    for system, plan in scheduled:
        assert REPORT.write(system, plan, ReportOptions())
        text = BTF.write(system, plan, BtfOptions())[""]
        (trace,) = parse_traces(text, "t.btf").traces
        said = compare(plan, trace, CompareOptions(origin=ZERO, tolerance=ms("2ns"))).diagnostics
        assert [d for d in said if d.severity is Severity.ERROR] == []


def test_an_os_that_plays_the_export_is_never_late(scheduled):
    for system, plan in scheduled:
        for unit in {unit for job in plan.modes[0].jobs for unit in job.units}:
            assert [fault for trial in trials(system, plan, unit, count=5) for fault in trial.faults()] == []


def test_an_os_that_plays_a_switch_is_never_late(scheduled):
    """Of the switches found, in some a job with gaps is in progress, or one is of the table."""
    parted = 0
    for system, plan in scheduled:
        units = {unit for mode in plan.modes for job in mode.jobs for unit in job.units}
        for table in plan.transitions if all(t.status is Status.VALID for t in plan.transitions) else ():
            source = plan.mode(table.source)
            late = [job for job in source.jobs if job.parts and job.end > source.hyperperiod]
            parted += bool(late or any(job.parts for job in table.jobs))
            played = [trial for unit in units for trial in trials(system, plan, unit, switch=table, count=3)]
            assert [fault for trial in played for fault in trial.faults()] == []
    assert parted >= 2
