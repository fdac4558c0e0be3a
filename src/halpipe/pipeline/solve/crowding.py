"""Ticks too coarse for the jobs of a mode: one job can start at each tick of a unit, and counting proves it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.models import WHOLE
from halpipe.pipeline.solve.codes import TOO_MANY_STARTS
from halpipe.pipeline.validate.context import Context, place, quoted
from halpipe.pipeline.validate.load import overloads

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.validate.load import Overload

_FINEST = 101
"""One more than the parts of a tick that are tried when a coarser one is too long."""


def check_starts(model: TaskModel, tick: Duration) -> Iterator[Diagnostic]:
    """The jobs of a set of units find enough ticks to start at: each takes as many as its WCET reaches into.

    A job starts at a multiple of the tick, and the next one of its unit at the first multiple at or after its end, so
    that the load of WCETs rounded up to ticks is a lower bound.
    """
    for over in overloads(Context(_rounded(model, tick))):
        fitting = next((tick / n for n in range(2, _FINEST) if _fits(model, over, tick / n)), None)
        finer = f"use a tick of {fitting} or a fraction of it" if fitting else "omit --tick"
        room = over.hyperperiod * len(over.units)
        jobs = sum(need.jobs for need in over.needs)
        text = (
            f"one job can start at each tick of {tick} on a unit: the {jobs} jobs of the tasks that can run only on "
            f"{quoted(sorted(over.units))} take {over.total} of the {room} in each hyperperiod of {over.hyperperiod}"
        )
        help = f"{finer}, or make one task of those that run one after the other (ARXML: --granularity ostask)"
        yield TOO_MANY_STARTS(text, at=place(over.mode.mode), path=over.mode.path, help=help)


def _rounded(model: TaskModel, tick: Duration) -> TaskModel:
    """Return the model with WCETs that are whole ticks, and without interrupts, which the rest of a tick may serve."""
    return replace(
        model,
        units=tuple(replace(unit, interrupts=()) for unit in model.units),
        tasks=tuple(
            replace(
                task,
                versions=tuple(
                    replace(v, wcet=v.wcet and tick * -(-v.wcet // tick), accesses=(), split=WHOLE)
                    for v in task.versions
                ),
            )
            for task in model.tasks
        ),
    )


def _fits(model: TaskModel, over: Overload, tick: Duration) -> bool:
    """Whether the jobs of an overload find room at a finer tick."""
    again = (found for found in overloads(Context(_rounded(model, tick))) if found.mode.path == over.mode.path)
    return all(found.units != over.units for found in again)
