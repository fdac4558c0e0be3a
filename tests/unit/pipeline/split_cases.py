"""What the tests of split jobs share: the example of MODEL 8 with its schedule, and changes to it."""

from dataclasses import replace
from pathlib import Path

from halpipe.importers.native import read_model, read_schedule
from support import ms

FOLDER = Path(__file__).parents[2] / "fixtures" / "split"
MODEL, SCHEDULE = FOLDER / "model.xml", FOLDER / "schedule.xml"


def split_example():
    """Return the model of the example and the jobs of its schedule."""
    return read_model(str(MODEL)), read_schedule(str(SCHEDULE)).modes[0].jobs


def with_job(jobs, task, **changes):
    """Return the jobs with changes to the first one of a task."""
    number = next(n for n, job in enumerate(jobs) if job.task == task)
    return (*jobs[:number], replace(jobs[number], **changes), *jobs[number + 1 :])


def with_part(jobs, task, number, **changes):
    """Return the jobs with changes, in milliseconds, to a part of the first job of a task."""
    parts = next(job for job in jobs if job.task == task).parts
    changed = replace(parts[number], **{name: ms(value) for name, value in changes.items()})
    return with_job(jobs, task, parts=(*parts[:number], changed, *parts[number + 1 :]))
