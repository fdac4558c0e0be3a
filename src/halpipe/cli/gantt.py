"""A Gantt chart for terminals: one line for each unit, one letter for each task, as wide as there is room."""

from __future__ import annotations

from string import ascii_letters, digits
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import printable

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, TransitionTable

LETTERS = ascii_letters[26:] + ascii_letters[:26] + digits
IDLE, SEVERAL = "·", "#"
LEAST_WIDTH = 20


def gantt(jobs: tuple[Job, ...], length: Duration, letters: dict[str, str], width: int, *, wraps: bool) -> list[str]:
    """Return a scale over [0, length) and a line for each unit that has jobs; `wraps`: the line is a circle."""
    rows: dict[str, list[str]] = {}
    names = sorted({unit for job in jobs for unit in job.units})
    shown = {name: printable(name) for name in names}
    margin = max(map(len, shown.values()), default=0) + 2
    columns = max(LEAST_WIDTH, width - margin)
    for name in names:
        rows[name] = [IDLE] * columns
    for job in jobs:
        for column in _columns(job, length, columns, wraps=wraps):
            for unit in job.units:
                known = rows[unit][column]
                letter = letters[job.task]
                rows[unit][column] = letter if known in (IDLE, letter) else SEVERAL
    end = str(length)
    scale = "0" + end.rjust(columns - 1)
    return [" " * margin + scale, *(shown[name].ljust(margin) + "".join(cells) for name, cells in rows.items())]


def _columns(job: Job, length: Duration, columns: int, *, wraps: bool) -> list[int]:
    """Return the columns that a job touches; in an unverified schedule it may be longer than the chart."""
    found: list[int] = []
    if not length:
        return found
    for start, end in job.occupations():
        first = int(start.fraction * columns / length.fraction)
        last = int(-(-end.fraction * columns // length.fraction))
        inside = range(first, min(max(first + 1, last), first + columns))
        found += [column % columns for column in inside if wraps or column < columns]
    return found


def letters_of(modes: tuple[ModeSchedule, ...], switches: tuple[TransitionTable, ...]) -> dict[str, str]:
    """Return a letter for each task, the same in every chart; they start again where there are more tasks."""
    tasks = dict.fromkeys(job.task for mode in modes for job in mode.jobs)
    tasks |= dict.fromkeys(job.task for switch in switches for job in switch.jobs)
    return {task: LETTERS[number % len(LETTERS)] for number, task in enumerate(tasks)}
