"""Figures of many small schedules in full, as they are drawn and with some jobs moved."""

import random
from dataclasses import replace

import pytest
import split_systems
import verify_systems

from golden_answers import assert_answers, mode_lines
from halpipe.core.durations import Duration
from halpipe.models import Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.measure.objectives import MEASURES
from halpipe.pipeline.measure.placement import Placement, grid_of
from halpipe.pipeline.measure.splitting import splitting_cost

FAMILIES = {
    "whole": verify_systems.valid_system,
    "wild": verify_systems.wild_system,
    "split": split_systems.valid_system,
    "crowded": split_systems.crowded_system,
}


def moved(rng, job, step):
    """Return a job that starts some steps later, with its parts; sometimes on another unit."""
    by = step * rng.choice((1, 1, 2, 5))
    parts = tuple(replace(part, start=part.start + by, end=part.end + by) for part in job.parts)
    if len(parts) > 1 and rng.random() < 0.5:  # only the last one
        parts = (*job.parts[:-1], parts[-1])
        return replace(job, end=job.end + by, parts=parts)
    return replace(job, start=job.start + by, end=job.end + by, parts=parts)


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
            other = shaken(rng, jobs, step)
            answers[f"{seed} moved by {step}"] = lambda system=system, other=other: figures(system, other)
    assert_answers(f"measure-{family}", answers)
