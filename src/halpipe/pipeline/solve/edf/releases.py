"""Release instants of the jobs of each task in a hyperperiod, by a plan."""

from __future__ import annotations

from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.pipeline.solve.edf.jobs import Plan
    from halpipe.pipeline.solve.edf.works import Mode

Releases = dict[int, int]
"""Release instants by the index of the job."""


def releases_of(mode: Mode, plan: Plan) -> list[list[tuple[int, int]]]:
    """Return the releases of every task within one hyperperiod of its first, ascending, each with the job's index."""
    demanders = {task: {demand[0] for demand in work.demands} for task, work in enumerate(mode.works)}
    found: dict[int, Releases] = {}
    for task in TopologicalSorter(demanders).static_order():
        found[task] = _releases(mode, plan, task, found)
    return [sorted((time, index) for index, time in found[task].items()) for task in range(len(mode.works))]


def _releases(mode: Mode, plan: Plan, task: int, known: dict[int, Releases]) -> Releases:
    """Return those of one task; those of its demanders are known."""
    work = mode.works[task]
    if task in mode.fixed.tasks:
        return {}
    if work.is_cyclic:
        first = plan.phases[task] + plan.holds[task]
        return {index: first + index * work.period for index in range(work.jobs)}
    found: Releases = {}
    for index, (demander, number, slot) in enumerate(work.demands):
        if demander in mode.fixed.tasks:
            wanted = _wanted_by_fixed(mode, demander, number, task)
            if slot < len(wanted):
                found[index] = wanted[slot]
            continue
        asked = sum(1 for window in plan.ways[demander].windows if window.task == task)
        if slot < asked and number in known[demander]:
            found[index] = known[demander][number] + plan.holds[task]
    first = min(found.values(), default=0)
    # Demanders may be phased further apart than a hyperperiod; releases out of order would start jobs in the past.
    return {index: first + (time - first) % mode.hyperperiod for index, time in found.items()}


def _wanted_by_fixed(mode: Mode, demander: int, number: int, task: int) -> list[int]:
    """Return for each demand of a job that stays the earliest instant that serves it: a start of `task`, or an end."""
    [job] = [each for each in mode.fixed.jobs if each.task == demander and each.job.index == number]
    windows = [window for window in job.way.windows if window.task == task]
    shortest = min(way.length for way in mode.works[task].ways)
    return [(job.start - w.most - (shortest if w.from_end else 0)) % mode.hyperperiod for w in windows]
