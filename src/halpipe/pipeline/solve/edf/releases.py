"""Release instants of the jobs of each task in a hyperperiod, by a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.solve.integers import ints

if TYPE_CHECKING:
    from halpipe.pipeline.solve.edf.jobs import Plan
    from halpipe.pipeline.solve.edf.works import Mode
    from halpipe.pipeline.solve.integers import Ints


def release_times(mode: Mode, plan: Plan, task: int) -> tuple[Ints, Ints]:
    """Return when the jobs of a task are released in the first hyperperiod, in ascending order, and their indices."""
    work = mode.works[task]
    if work.is_cyclic and task not in mode.fixed.tasks:
        first = plan.phases[task] + plan.holds[task]
        return ints(range(first, first + work.jobs * work.period, work.period)), ints(range(work.jobs))
    found = releases_of(mode, plan, task)
    return ints(time for time, _ in found), ints(index for _, index in found)


def releases_of(mode: Mode, plan: Plan, task: int) -> list[tuple[int, int]]:
    """Return the same, each with its index."""
    work = mode.works[task]
    if task in mode.fixed.tasks:
        return []
    if work.is_cyclic:
        first = plan.phases[task] + plan.holds[task]
        return [(first + index * work.period, index) for index in range(work.jobs)]
    found = []
    for index, (demander, number, slot) in enumerate(work.demands):
        if demander in mode.fixed.tasks:
            found += [(time, index) for time in _wanted_by_fixed(mode, demander, number, task)[slot : slot + 1]]
            continue
        asked = sum(1 for window in plan.ways[demander].windows if window.task == task)
        times = {place: time for time, place in releases_of(mode, plan, demander)}
        if slot < asked and number in times:
            found.append((times[number] + plan.holds[task], index))
    return sorted(found)


def _wanted_by_fixed(mode: Mode, demander: int, number: int, task: int) -> list[int]:
    """Return for each demand of a job that stays the earliest instant that serves it: a start of `task`, or an end."""
    [job] = [each for each in mode.fixed.jobs if each.task == demander and each.job.index == number]
    windows = [window for window in job.way.windows if window.task == task]
    shortest = min(way.length for way in mode.works[task].ways)
    return [(job.start - w.most - (shortest if w.from_end else 0)) % mode.hyperperiod for w in windows]
