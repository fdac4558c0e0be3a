"""Figures of many small schedules in full, as they are drawn and with some jobs moved."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
import split_systems
import verify_systems
from test_search_golden import FAMILIES as SEARCHED

from golden_answers import assert_answers, mode_lines
from halpipe.core.durations import Duration
from halpipe.models import Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.measure.margins import largest_margin
from halpipe.pipeline.measure.objectives import MEASURES
from halpipe.pipeline.measure.placement import Placement, grid_of
from halpipe.pipeline.measure.splitting import splitting_cost
from halpipe.pipeline.validate import validate

FAMILIES = {
    "whole": verify_systems.valid_system,
    "wild": verify_systems.wild_system,
    "split": split_systems.valid_system,
    "crowded": split_systems.crowded_system,
}


def moved(rng, job, step):
    """Return a job that starts some steps later, as a whole, or with its last part alone, or that pauses elsewhere."""
    by = step * rng.choice((1, 1, 2, 5))
    kind = rng.randrange(3) if len(job.parts) > 1 else 0
    *before, last = job.parts or (None,)
    if kind == 1:
        last = replace(last, start=last.start + by, end=last.end + by)
        return replace(job, end=job.end + by, parts=(*before, last))
    if kind == 2:
        longer = replace(before[-1], end=before[-1].end + by, executed_to=before[-1].executed_to + by)
        last = replace(last, start=last.start + by, executed_from=last.executed_from + by)
        return replace(job, parts=(*before[:-1], longer, last))
    parts = tuple(replace(part, start=part.start + by, end=part.end + by) for part in job.parts)
    return replace(job, start=job.start + by, end=job.end + by, parts=parts)


def tighter(rng, system):
    """Return the system with other deadlines and slacks."""

    def changed(task):
        if task.period is None or rng.random() < 0.4:
            return task
        deadline = task.period * Fraction(rng.randint(3, 10), 8) if rng.random() < 0.7 else None
        return replace(task, deadline=deadline, slack=Fraction(rng.randint(0, 4), 6))

    return replace(system, tasks=tuple(map(changed, system.tasks)))


def shaken(rng, jobs, step):
    return tuple(moved(rng, job, step) if rng.random() < 0.4 else job for job in jobs)


def figures(system, jobs):
    """Return what is measured of a mode."""
    expansion = expand(system, system.modes[0])
    report = mode_report(system, expansion, jobs, Status.VALID)
    placement = Placement.of(expansion, jobs, system.units, grid_of(expansion, jobs))
    busy = [f"{load.unit} {load.busy}" for load in report.unit_loads]
    claimed = [f"{load.resource} {load.peak} {load.mean}" for load in report.resource_loads]
    worths = [f"{name} {measure(system, placement)}" for name, measure in MEASURES.items()]
    lines = [*mode_lines(replace(report, jobs=())), f"  {', '.join([*busy, *claimed, *worths])}"]
    return [*lines, f"  splitting {splitting_cost(placement)}, tick {placement.tick}"]


@pytest.mark.parametrize("family", FAMILIES)
def test_figures_are_what_they_were_before(family):
    answers = {}
    for seed in range(30):
        rng = random.Random(seed)
        system, plan = FAMILIES[family](rng)[:2]
        jobs = plan.modes[0].jobs
        answers[f"{seed} as it is"] = lambda system=system, jobs=jobs: figures(system, jobs)
        for step in (Duration(10**6), Duration(10**6) / 3):
            other = tighter(rng, system), shaken(rng, jobs, step)
            answers[f"{seed} moved by {step}"] = lambda other=other: figures(*other)
    assert_answers(f"measure-{family}", answers)


@pytest.mark.parametrize("family", ["every", "random"])
def test_bounds_of_margins_are_what_they_were_before(family):
    lines = []
    for seed in range(120):
        system = SEARCHED[family](seed)
        if not any(found.is_error for found in validate(system)):
            bounds = (largest_margin(expand(system, mode), system) for mode in system.modes)
            lines.append(f"{seed}: {', '.join(map(str, bounds))}")
    assert_answers(f"measure-bounds-{family}", {"bounds": lambda: lines})
