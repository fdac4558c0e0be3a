"""Copies of logical execution times: data are read at the release and written at release + LET (MODEL 10.6).

The program of a job copies between its variables and buffers of its own, when it starts and ends. The dispatcher copies
between these and the buffers of the model, at the instants that this module lists for each table.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about, version_of
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.common.timeline import releases_of
from halpipe.exporters.linux.codes import NO_COPIES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.exporters.linux.bundle import Program
    from halpipe.models import Job, ModeSchedule, Schedule, Task, TaskModel


@record
class Copy:
    """Copy of `size` bytes from one buffer to another, at an instant in ns after the beginning of a table."""

    at: int
    source: int
    target: int
    size: int


def copies_of(
    model: TaskModel,
    schedule: Schedule,
    programs: Sequence[Program],
    numbers: Mapping[tuple[str, str], int],
    findings: Findings,
) -> list[list[Copy]]:
    """Return the copies of each table, in order: at one instant, what is written comes before what is read.

    Report the tasks whose logical execution time the dispatcher cannot keep.
    """
    tasks = {task.name: task for task in model.tasks if task.let is not None}
    _refuse_without_data(tasks, programs, numbers, findings)
    lengths = [mode.hyperperiod for mode in schedule.modes] + [table.length for table in schedule.transitions]
    released = [list(_of_mode(mode, tasks, findings)) for mode in schedule.modes]
    released += [[(job, job.start) for job in t.jobs if job.task in tasks] for t in schedule.transitions]
    _refuse_overlaps(schedule, tasks, lengths, released, findings)
    return [_rows(jobs, tasks, programs, numbers) for jobs in released]


def _rows(
    jobs: Sequence[tuple[Job, Duration]],
    tasks: Mapping[str, Task],
    programs: Sequence[Program],
    numbers: Mapping[tuple[str, str], int],
) -> list[Copy]:
    rows = []
    for job, release in jobs:
        program = programs[numbers[job.task, job.version]]
        for moves, at, order in (
            (program.written, release + (tasks[job.task].let or ZERO), 0),
            (program.read, release, 1),
        ):
            rows += [(at, order, Copy(math.floor(at.fraction), *move)) for move in moves]
    return [row for _, _, row in sorted(rows, key=lambda entry: (entry[0].ns, entry[1]))]


def _of_mode(mode: ModeSchedule, tasks: Mapping[str, Task], findings: Findings) -> Iterator[tuple[Job, Duration]]:
    """Yield the jobs of a mode with a LET, and their releases."""
    for job, release in releases_of(mode, tasks):
        if job.start >= release:
            yield job, release
            continue
        task = tasks[job.task]
        text = f'job {job.index} of mode "{mode.name}" starts at {job.start} of the cycle after its release'
        help = f"state an offset of at most {(task.period or ZERO) - (task.let or ZERO)}, or less slack"
        findings.add(NO_COPIES(text, at=job.at, path=about(task=job.task), help=help))


def _refuse_without_data(
    tasks: Mapping[str, Task],
    programs: Sequence[Program],
    numbers: Mapping[tuple[str, str], int],
    findings: Findings,
) -> None:
    for (name, version), number in numbers.items():
        program = programs[number]
        if name in tasks and not program.is_made_up and not (program.read or program.written):
            text = f"has the LET {tasks[name].let}, and no transfer from or to a buffer that could be copied"
            help = "state the variables of the program: <transfer buffer= symbol= size=> in its accesses"
            at, path = tasks[name].version(version).at, version_of(name, version)
            findings.add(NO_COPIES(text, at=at, path=path, help=help))


def _refuse_overlaps(
    schedule: Schedule,
    tasks: Mapping[str, Task],
    lengths: Sequence[Duration],
    released: Sequence[Sequence[tuple[Job, Duration]]],
    findings: Findings,
) -> None:
    """Report a job that is released before the one before it has written: both would need the same buffer."""
    names = [mode.name for mode in schedule.modes]
    after = [[number] for number in range(len(names))]
    for number, table in enumerate(schedule.transitions, len(names)):
        after[names.index(table.source)].append(number)
        after.append([names.index(table.target)])
    titles = [*names, *(table.name for table in schedule.transitions)]
    for number, jobs in enumerate(released):
        written: dict[str, tuple[Duration, Job]] = {}
        for job, release in jobs:
            let = tasks[job.task].let or ZERO
            written[job.task] = max(
                written.get(job.task, (ZERO, job)), (release + let, job), key=lambda entry: entry[0]
            )
            period = tasks[job.task].period or let
            if let > period:
                text = f"its LET of {let} is longer than its period of {period}"
                findings.add(NO_COPIES(text, at=job.at, path=about(task=job.task), help="shorten the LET"))
        for name, (end, job) in written.items():
            for place, begin in _following(number, end, lengths, after):
                again = min((release for other, release in released[place] if other.task == name), default=None)
                if again is not None and begin + again < end:
                    text = (
                        f'job {job.index} of table "{titles[number]}" writes {end - begin - again} after the release '
                        f'of the next one, in table "{titles[place]}"'
                    )
                    help = "lengthen the transition, or shorten the LET"
                    findings.add(NO_COPIES(text, at=job.at, path=about(task=name), help=help))


def _following(
    table: int, end: Duration, lengths: Sequence[Duration], after: Sequence[Sequence[int]]
) -> Iterator[tuple[int, Duration]]:
    """Yield the tables that may begin before `end`, and when, in time of the table before them."""
    waiting = [(following, lengths[table]) for following in after[table]]
    seen = set()
    while waiting:
        number, begin = waiting.pop()
        if begin < end and (number, begin) not in seen:
            seen.add((number, begin))
            yield number, begin
            waiting += [(following, begin + lengths[number]) for following in after[number]]
