"""Split jobs that have shipped stay with all their parts, and the others are placed around them."""

import random
from dataclasses import replace

from split_systems import valid_system

from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.solve.schedule import SearchOptions


def frozen(owner, shipped):
    found = schedule_model(owner, SearchOptions(budget=300, shipped=shipped), lambda *_: True)
    assert not found.is_complete or not [d for d in verify_schedule(owner, found.schedule) if d.is_error]
    return found


def jobs_of(schedule):
    return {(job.task, job.index): job for job in schedule.modes[0].jobs}


def test_systems_stay_whole_or_but_for_one_task_as_they_were():
    """Witnesses of random systems: all stays as it is; without one task, what stays does not move."""
    whole = fewer = 0
    for seed in range(24):
        rng = random.Random(seed)
        owner, witness = valid_system(rng)
        if not any(v.split.is_allowed for t in owner.tasks for v in t.versions):
            continue
        found = frozen(owner, witness)
        assert found.is_complete
        assert jobs_of(found.schedule) == jobs_of(witness)
        whole += 1
        left = rng.choice(witness.modes[0].jobs).task
        kept = tuple(job for job in witness.modes[0].jobs if job.task != left)
        found = frozen(owner, replace(witness, modes=(replace(witness.modes[0], jobs=kept),)))
        assert {(j.task, j.index): j for j in kept}.items() <= jobs_of(found.schedule).items()
        fewer += found.is_complete
    assert whole > 15
    assert fewer > whole * 3 // 4
