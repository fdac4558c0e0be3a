"""Measure one instance: generate a set, then take it from file to verified file with a watch in hand."""

from __future__ import annotations

import math
import sys
from contextlib import contextmanager
from fractions import Fraction
from functools import cache
from importlib import import_module
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import sha256, write_output
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import read_model
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, achieved, generate
from halpipe.pipeline.measure.placement import Instants
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from search_benchmark import jobshop

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.models import ModeSchedule, Schedule, TaskModel
    from halpipe.pipeline.measure.objectives import Objective
    from search_benchmark.suites import Cell

_SECOND = 10**9
_KERNEL = "halpipe.pipeline.solve.kernel.kernel"

VALID, NOT_FOUND, STOPPED, FAULT = "valid", "not-found", "stopped", "fault"
"""Outcomes. Only `STOPPED`, by the time limit, depends on the machine."""


@record(kw_only=True)
class Instance:
    """One set to measure: `budget` counts moves per task, `limit` and `exact_seconds` seconds (0: none, no CP-SAT).

    Without a budget the limit ends the search, as `schedule --time-limit` does, and without both the search itself.
    """

    key: str
    parameters: Cell
    seed: int
    budget: int | None
    limit: int
    exact_seconds: int
    exact_workers: int
    optimise: tuple[Objective, ...] = ()
    workers: int = 1


def measure(instance: Instance) -> dict[str, Any]:
    """Return the record of one instance: its key, the ``result``, which is reproducible, and the ``timing``."""
    _warm_up()
    model = _draw(instance.parameters, instance.seed)
    document = format_model(model)
    made = achieved(model)
    result: dict[str, Any] = {
        "model_sha256": sha256(document),
        "jobs": made.jobs,
        "utilisation": str(made.utilisation),
        "resource_fill": str(made.resource_fill),
        "windows": made.windows,
    }
    timing: dict[str, Any] = {}
    with scratch_folder() as folder:
        source = str(Path(folder, "model.xml"))
        write_output(source, document)
        _schedule(instance, source, str(Path(folder, "schedule.xml")), result, timing)
    if instance.exact_seconds:
        timing["exact"] = _exact(model, instance)
        timing["pyjobshop"] = jobshop.solve(model, instance.exact_seconds, instance.exact_workers)
    return {"key": instance.key, "seed": instance.seed, "result": result, "timing": timing}


def _draw(cell: Cell, seed: int) -> TaskModel:
    return generate(cell, seed) if isinstance(cell, SetParameters) else cell.draw(seed)


def _schedule(instance: Instance, source: str, target: str, result: dict[str, Any], timing: dict[str, Any]) -> None:
    """Do what ``halpipe schedule`` does, and note what came of it."""
    begin = perf_counter_ns()
    deadline = begin + instance.limit * _SECOND
    options = SearchOptions(
        seed=instance.seed, budget=instance.budget, optimise=instance.optimise, workers=Workers(instance.workers)
    )
    if instance.limit:
        options = options.by_the_clock()
    with _kernel_watch() as kernel:
        try:
            model = read_model(source)
            found = schedule_model(model, options, lambda *_: not instance.limit or perf_counter_ns() < deadline)
        except HalpipeError as failure:
            result["outcome"] = FAULT
            result["fault"] = "; ".join(f"{d.code} {d.path}: {d.message}" for d in failure.diagnostics if d.is_error)
            return
    if found.is_complete:
        text = format_schedule(found.schedule)
        write_output(target, text)
        result["schedule_sha256"] = sha256(text)
        result["solver"] = found.schedule.solver
        result |= _of_parts(model, found.schedule)
    timing["whole_ns"] = perf_counter_ns() - begin
    timing["kernel_ns"] = kernel[0]
    result["outcome"] = VALID if found.is_complete else STOPPED if found.stopped else NOT_FOUND
    if found.stopped:
        timing["moves"] = found.moves  # how far it came within the limit is the machine's
    else:
        result["moves"] = found.moves


def _of_parts(model: TaskModel, schedule: Schedule) -> dict[str, Any]:
    """Return of a schedule with gaps how many there are in a second, and of each chain its latencies.

    Reaction time, data age, and forward latency: from the start of a job to the end of what its data reach first.
    """
    gaps = sum(len(job.parts) - 1 for mode in schedule.modes for job in mode.jobs if job.parts)
    if not gaps:
        return {}
    length = sum(mode.hyperperiod.fraction for mode in schedule.modes)
    tasks = {chain.name: chain.tasks for chain in model.chains}
    chains = {
        chain.name: [str(chain.reaction), str(chain.age), str(_forward(mode, tasks[chain.name]))]
        for mode in schedule.modes
        for chain in mode.chains
    }
    return {"gaps_per_second": round(gaps * _SECOND / length), "chains": chains}


def _forward(mode: ModeSchedule, tasks: Sequence[str]) -> Duration:
    jobs = [[job for job in mode.jobs if job.task == task] for task in tasks]
    scale = mode.hyperperiod.fraction.denominator
    scale = math.lcm(scale, *(t.fraction.denominator for each in jobs for job in each for t in (job.start, job.end)))
    ticks = [[(int(job.start.fraction * scale), int(job.end.fraction * scale)) for job in each] for each in jobs]
    cycle = int(mode.hyperperiod.fraction * scale)
    starts = [Instants.of(((start, n) for n, (start, _) in enumerate(each)), cycle) for each in ticks]
    worst = 0
    for start, end in ticks[0]:
        for each, instants in zip(ticks[1:], starts[1:], strict=True):
            begin, number = instants.at_or_after(end)
            end = begin + each[number][1] - each[number][0]
        worst = max(worst, end - start)
    return Duration(Fraction(worst, scale))


@contextmanager
def _kernel_watch() -> Iterator[list[int]]:
    """Add up the nanoseconds spent in the kernel.

    The search itself must not look at a clock, so the watch is put around the kernel's entry from outside, in every
    module that has it.
    """
    source: Any = import_module(_KERNEL)
    kernel, spent = source.anneal, [0]
    users = [
        module
        for name, module in sorted(sys.modules.items())
        if name.startswith("halpipe.") and name != _KERNEL and vars(module).get("anneal") is kernel
    ]

    def watched(*arguments: Any) -> Any:
        begin = perf_counter_ns()
        try:
            return kernel(*arguments)
        finally:
            spent[0] += perf_counter_ns() - begin

    try:
        for module in users:
            vars(module)["anneal"] = watched
        yield spent
    finally:
        for module in users:
            vars(module)["anneal"] = kernel


@cache
def _warm_up() -> None:
    """Load the kernel and all that a search imports, once in each process: that is not what is measured."""
    model = generate(SetParameters(tasks=4, units=2), 1)
    schedule_model(model, SearchOptions(budget=10), lambda *_: True)


def _exact(model: TaskModel, instance: Instance) -> dict[str, Any]:
    """Give the same set to CP-SAT; return its answer and time, which depend on the machine, or why there is none."""
    from halpipe.pipeline.solve.exact import Effort, solve_exact

    begin = perf_counter_ns()
    deadline = begin + instance.exact_seconds * _SECOND
    wants_more = lambda: perf_counter_ns() < deadline  # noqa: E731
    effort = Effort(work=None, workers=instance.exact_workers, seed=instance.seed, go_on=wants_more)
    try:
        answer = solve_exact(model, model.modes[0], effort)
    except HalpipeError as failure:
        return {"answer": "none", "reason": "; ".join(d.message for d in failure.diagnostics)}
    return {"answer": str(answer.status), "ns": perf_counter_ns() - begin}
