"""Valid schedules of imported AMALTHEA models keep the requirements of their source, by a simulator of its own.

Schedules are drawn at random, and those that verify calls valid are played in `amalthea_simulation`; so are those that
the search finds.
"""

import random

import pytest

from amalthea_simulation import broken, document, random_system
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import least_common_multiple
from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions
from halpipe.models import Job, ModeSchedule, Schedule, Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify
from profiles import volume
from support import ms

TRIES = 60


def imported(folder, system):
    path = folder / "model.amxmi"
    path.write_text(document(system), encoding="utf-8")
    return FORMAT.read([str(path)], AmaltheaImportOptions()).completed().model


def millis(duration):
    return int(duration.fraction / 1_000_000)


def draw(rng, model, hyperperiod):
    """Starts of all jobs: at a release plus something, those that follow others soon after these."""
    starts = {}
    for task in model.tasks:
        [version] = task.versions
        period = millis(task.period)
        before = next((p.task for p in version.precedences if p.task in starts), None)
        phase = rng.randrange(period) if task.offset is None else millis(task.offset) % period
        spread = rng.choice([0, 0, 2, 6, period])
        if before is not None and task.offset is None:
            phase = (starts[before][0] + millis(model.task(before).versions[0].wcet) + rng.randint(0, 3)) % period
            spread = rng.choice([0, 0, 2])
        jobs = [
            phase + index * period + rng.randint(0, min(spread, int(task.slack * period)))
            for index in range(hyperperiod // period)
        ]
        starts[task.name] = [start % hyperperiod for start in jobs]
    return starts


def table(model, starts, hyperperiod):
    jobs = []
    for task in model.tasks:
        [version] = task.versions
        for index, start in enumerate(starts[task.name]):
            begin = ms(start)
            jobs.append(
                Job(
                    task=task.name,
                    index=index,
                    start=begin,
                    end=begin + version.wcet,
                    version=version.name,
                    units=version.units,
                )
            )
    [mode] = model.modes
    only = ModeSchedule(name=mode.name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=tuple(jobs))
    return Schedule(model=model.name, model_sha256=model.digest, modes=(only,))


def played(rng, folder):
    """Draw a system and schedules of it; return how many were valid, and what those break."""
    system = random_system(rng)
    model = imported(folder, system)
    hyperperiod = millis(least_common_multiple(task.period for task in model.tasks))
    valid, found = 0, []
    for _ in range(TRIES):
        starts = draw(rng, model, hyperperiod)
        if any(d.is_error for d in verify(model, table(model, starts, hyperperiod))):
            continue
        valid += 1
        together = {p.name: [] for p in system.processes}
        for name, begins in starts.items():
            together[name.partition("@")[0]] += begins
        found += [(document(system), starts, text) for text in broken(system, together, hyperperiod)]
        if found:
            break
    return valid, found


def simulate(count, first, folder):
    with_schedule = 0
    for seed in range(first, first + count):
        valid, found = played(random.Random(seed), folder)
        assert found == [], f"seed {seed}"
        with_schedule += bool(valid)
    return with_schedule


@pytest.mark.slow
def test_valid_schedules_of_imported_models_keep_their_requirements(tmp_path):
    assert simulate(20, 0, tmp_path) > 5


@pytest.mark.slow  # the same with many more; above, a few tens
def test_valid_schedules_of_many_imported_models_keep_their_requirements(tmp_path):
    count = volume(250)
    assert simulate(count, 1000, tmp_path) > count // 4


def searched(count, first, folder):
    """Return how many systems the search found a schedule for, all of which keep their requirements."""
    found = 0
    for seed in range(first, first + count):
        system = random_system(random.Random(seed))
        model = imported(folder, system)
        if any(d.is_error for d in validate(model)):
            continue
        try:
            made = schedule_model(model, SearchOptions(budget=500, optimise=()), lambda *_: True)
        except HalpipeError as refusal:
            if refusal.exit is Exit.INFEASIBLE:
                continue
            raise
        if not made.is_complete:
            continue
        [mode] = made.schedule.modes
        together = {p.name: [] for p in system.processes}
        for job in mode.jobs:
            assert job.start.fraction % 1_000_000 == 0
            together[job.task.partition("@")[0]].append(millis(job.start))
        assert broken(system, together, millis(mode.hyperperiod)) == [], f"seed {seed}"
        found += 1
    return found


def test_schedules_that_the_search_finds_keep_the_requirements(tmp_path):
    assert searched(6, 0, tmp_path) > 2


@pytest.mark.slow  # the same with many more; above, a few
def test_schedules_of_many_systems_that_the_search_finds_keep_the_requirements(tmp_path):
    count = volume(75)
    assert searched(count, 5000, tmp_path) > count // 2
