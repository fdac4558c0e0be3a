"""Scene of the viewer as plain values: milliseconds as floats for drawing, exact text for reading."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO
from halpipe.exporters.common.palette import FILLS, tone
from halpipe.exporters.common.timeline import Window, delays_of, resource_steps, unroll
from halpipe.exporters.report.chains import latency_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, Job, ModeSchedule, Schedule, Task, TaskModel

Plain = dict[str, Any]
Drawn = dict[str, tuple[Any, Plain]]
"""What was made of each task, by its name, and of what: most tasks and jobs are after an edit what they were."""


def scene(model: TaskModel, schedule: Schedule | None, *, is_valid: bool = True, drawn: Drawn | None = None) -> Plain:
    """Return a model and its schedule, as the viewer takes them; what resources bear only of one that is valid.

    What is `drawn` already is not made again; it is kept up to date.
    """
    drawn = {} if drawn is None else drawn
    order = {task.name: number for number, task in enumerate(model.tasks)}
    modes = [(jobs_by_task(mode), mode.hyperperiod) for mode in schedule.modes] if schedule else []
    return {
        "model": model.name,
        "units": [unit.name for unit in model.units],
        "tasks": [_task(task, tone(number), modes, drawn) for number, task in enumerate(model.tasks)],
        "chains": [_chain(model, chain, order, schedule) for chain in model.chains],
        "modes": [_mode(model, mode, order, is_valid=is_valid) for mode in schedule.modes] if schedule else [],
        "switches": _switches(schedule) if schedule else [],
    }


def _task(task: Task, colour: int, modes: Sequence[tuple[dict[str, list[Job]], Duration]], drawn: Drawn) -> Plain:
    own = [(jobs.get(task.name, []), length) for jobs, length in modes]
    known = drawn.get(task.name)
    if known is None or known[0] != (task, colour, own):
        known = drawn[task.name] = (task, colour, own), _facts(task, colour, own)
    return known[1]


def _facts(task: Task, colour: int, modes: Sequence[tuple[Sequence[Job], Duration]]) -> Plain:
    return {
        "name": task.name,
        "colour": FILLS[colour],
        "period": _text(task.period),
        "offset": _text(task.offset),
        "deadline": _text(task.deadline),
        "slack": str(task.slack),
        "let": _let(task),
        "binding": str(task.binding),
        "versions": [
            {
                "name": version.name,
                "wcet": _text(version.wcet),
                "units": " ".join(version.units),
                "windows": [
                    {"after": w.task, "anchor": str(w.anchor), "min": str(w.min), "max": str(w.max)}
                    for w in version.precedences
                ],
            }
            for version in task.versions
        ],
        "figures": [figures(task, jobs, length) for jobs, length in modes],
    }


def _let(task: Task) -> list[float]:
    """Return phase, period and logical execution time of a task, in milliseconds; nothing for one without."""
    if task.let is None or task.period is None or task.offset is None:
        return []
    return [_ms(task.offset % task.period), _ms(task.period), _ms(task.let)]


def jobs_by_task(mode: ModeSchedule) -> dict[str, list[Job]]:
    """Return the jobs of each task that runs in a mode."""
    found: dict[str, list[Job]] = {}
    for job in mode.jobs:
        found.setdefault(job.task, []).append(job)
    return found


def figures(task: Task, jobs: Sequence[Job], length: Duration) -> Plain:
    """Return what a task's jobs come to in a mode; nothing where it has none.

    That is the worst response time, from the release or, of a task that polls, from the arrival; what is left of the
    deadline then, the margin; start jitter; and gaps.
    """
    if not jobs:
        return {}
    plain: Plain = {"jobs": len(jobs), "gaps": sum(max(0, len(job.parts) - 1) for job in jobs)}
    if task.period is None:
        return plain
    delays = delays_of(task, task.period, jobs, length)
    if task.distance is None:
        response = max(delay + (job.end - job.start) for delay, job in zip(delays, jobs, strict=True))
    else:
        response = _response_to_arrivals(jobs, length)
    margin = (task.deadline or task.distance or task.period) - response
    jitter = max(delays) - min(delays)
    return plain | {
        "response": str(response),
        "response_ms": _ms(response),
        "margin": str(margin),
        "margin_ms": _ms(margin),
        "jitter": str(jitter),
        "jitter_ms": _ms(jitter),
    }


def _response_to_arrivals(jobs: Sequence[Job], length: Duration) -> Duration:
    """Return the longest time from the start of a job, which just missed an arrival, to the end of the next."""
    ordered = sorted(jobs, key=lambda job: job.start.ns)
    before = [ordered[-1].start - length, *(job.start for job in ordered[:-1])]
    return max(job.end - start for job, start in zip(ordered, before, strict=True))


def _chain(model: TaskModel, chain: Chain, order: dict[str, int], schedule: Schedule | None) -> Plain:
    found = [(mode, row) for mode in (schedule.modes if schedule else ()) for row in mode.chains]
    return {
        "name": chain.name,
        "tasks": [order[name] for name in chain.tasks if name in order],
        "max_reaction": _text(chain.max_reaction),
        "max_age": _text(chain.max_age),
        "max_latency": _text(chain.max_latency),
        "latencies": [
            {
                "mode": mode.name,
                "reaction": _text(row.reaction),
                "age": _text(row.age),
                "latency": _text(latency_of(model, chain, mode, row)),
            }
            for mode, row in found
            if row.name == chain.name
        ],
    }


def _mode(model: TaskModel, mode: ModeSchedule, order: dict[str, int], *, is_valid: bool) -> Plain:
    lanes = {unit.name: number for number, unit in enumerate(model.units)}
    return {
        "name": mode.name,
        "length": _ms(mode.hyperperiod),
        "length_text": str(mode.hyperperiod),
        "loads": {load.unit: _percent(load.share) for load in mode.unit_loads},
        "jobs": [_job(job, order, lanes) for job in mode.jobs if job.task in order],
        "meters": _meters(model, mode) if is_valid else [],
    }


def _meters(model: TaskModel, mode: ModeSchedule) -> list[Plain]:
    """Return for every resource that is used the sum of the bounds in force, from each instant of a change on."""
    steps = resource_steps(model, unroll(mode), Window(ZERO, mode.hyperperiod)) if model.resources else {}
    return [
        {"name": name, "steps": [[_ms(instant), float(level)] for instant, level in found]}
        for name, found in steps.items()
        if any(level for _, level in found)
    ]


def _job(job: Job, order: dict[str, int], lanes: dict[str, int]) -> list[Any]:
    """Return task, number, version, lanes, start, end, both as text, and the parts of a job with gaps."""
    occupied = job.occupations()
    parts = [[_ms(start), _ms(end)] for start, end in occupied] if job.parts else []
    where = [lanes[unit] for unit in job.units if unit in lanes]
    times = [_ms(job.start), _ms(job.end), str(job.start), str(job.end)]
    return [order[job.task], job.index, job.version, where, *times, parts]


def _switches(schedule: Schedule) -> list[Plain]:
    return [
        {"from": t.source, "to": t.target, "length": str(t.length), "worst": str(t.worst_latency), "jobs": len(t.jobs)}
        for t in schedule.transitions
    ]


def _text(value: Duration | None) -> str:
    return "" if value is None else str(value)


def _ms(value: Duration) -> float:
    return float(value.ns / 10**6)


def _percent(share: Any) -> float:
    return float(round(share * 1000)) / 10


def embedded(plain: Plain) -> str:
    """Return values as JSON that may stand in a page, whatever names they hold."""
    text = json.dumps(plain, separators=(",", ":"), ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
