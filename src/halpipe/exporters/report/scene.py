"""Scene of the viewer as plain values: milliseconds as floats for drawing, exact text for reading."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.common.palette import FILLS, RESOURCES, tone
from halpipe.exporters.common.timeline import (
    PhaseTimes,
    Placement,
    Window,
    delays_of,
    links,
    resource_steps,
    shows_context,
    unroll,
    unroll_switch,
)
from halpipe.exporters.report.beside import MARKS, Beside, Strip
from halpipe.models import Anchor, Job, ModeSchedule, Schedule, Task, TaskModel, TransitionTable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Jobs = Mapping[str, Sequence[Job]]

Plain = dict[str, Any]
Drawn = dict[str, tuple[Any, Plain]]
"""What was made of each task, by its name, and of what: most tasks and jobs are after an edit what they were."""


def scene(
    model: TaskModel,
    schedule: Schedule | None,
    *,
    is_valid: bool = True,
    drawn: Drawn | None = None,
    beside: Beside | None = None,
) -> Plain:
    """Return a model and its schedule, as the viewer takes them; resources only of a schedule that is valid.

    What is `drawn` already is not made again; it is kept up to date. Under the jobs lies what `beside` has.
    """
    drawn = {} if drawn is None else drawn
    modes = [(mode.by_task(), mode.hyperperiod) for mode in schedule.modes] if schedule else []
    tables = _Tables(model, beside, is_valid=is_valid)
    context = schedule is not None and shows_context(schedule)
    return {
        "model": model.name,
        "units": [unit.name for unit in model.units],
        "resources": [
            {"name": each.name, "colour": RESOURCES[number % len(RESOURCES)]}
            for number, each in enumerate(model.resources)
        ],
        "tasks": [_task(task, tone(number), modes, drawn) for number, task in enumerate(model.tasks)],
        "chains": [
            {"name": chain.name, "tasks": [tables.order[name] for name in chain.tasks if name in tables.order]}
            for chain in model.chains
        ],
        "modes": [tables.mode(mode) for mode in schedule.modes] if schedule else [],
        "switches": [tables.switch(schedule, each, context=context) for each in schedule.transitions]
        if schedule
        else [],
    }


def _task(task: Task, colour: int, modes: Sequence[tuple[Jobs, Duration]], drawn: Drawn) -> Plain:
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
        "deadline": _text(task.deadline),
        "let": _let(task),
        "versions": [
            {"name": version.name, "wcet": _text(version.wcet), "units": " ".join(version.units)}
            for version in task.versions
        ],
        "figures": [figures(task, jobs, length) for jobs, length in modes],
    }


def _let(task: Task) -> list[float]:
    """Return phase, period and logical execution time of a task, in milliseconds; nothing for one without."""
    if task.let is None or task.period is None or task.offset is None:
        return []
    return [_ms(task.offset % task.period), _ms(task.period), _ms(task.let)]


def figures(task: Task, jobs: Sequence[Job], length: Duration) -> Plain:
    """Return what a task's jobs come to in a mode; nothing where it has none.

    That is the worst response time, from the release or, of a task that polls, from the arrival; what is left of the
    deadline then, the margin; start jitter; and gaps.
    """
    if not jobs:
        return {}
    plain: Plain = {"jobs": len(jobs), "gaps": sum(len(job.parts[1:]) for job in jobs)}
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


class _Tables:
    """Maker of the tables of a scene, modes and switches, each over its stretch of the line."""

    def __init__(self, model: TaskModel, beside: Beside | None, *, is_valid: bool) -> None:
        self.model, self.beside, self.is_valid = model, beside, is_valid
        self.order = {task.name: number for number, task in enumerate(model.tasks)}
        self.lanes = {unit.name: number for number, unit in enumerate(model.units)}
        self.resources = {resource.name: number for number, resource in enumerate(model.resources)}
        self.times = PhaseTimes(model)

    def mode(self, mode: ModeSchedule) -> Plain:
        jobs, window = [Placement(job, job.start) for job in mode.jobs], Window(ZERO, mode.hyperperiod)
        own = {"name": mode.name, "cycle": True, "length": _ms(mode.hyperperiod), "regions": []}
        return own | self._line(mode.name, window, jobs, unroll(mode))

    def switch(self, schedule: Schedule, table: TransitionTable, *, context: bool) -> Plain:
        source, target = schedule.mode(table.source), schedule.mode(table.target)
        window, placements = unroll_switch(table, source, target, context=context)
        regions = [_region(ZERO, table.length, "transition table", "table")] if table.length else []
        if context:
            cycles = (window.end - table.length) // target.hyperperiod
            first = f"first {cycles} cycles" if cycles > 1 else "first cycle"
            regions.insert(0, _region(window.start, ZERO, f"last cycle of {table.source}", "mode"))
            regions.append(_region(table.length, window.end, f"{first} of {table.target}", "mode"))
        shown = [placement for placement in placements if window.shows(placement)]
        own = {"name": table.name, "cycle": False, "length": _ms(table.length), "regions": regions}
        return own | self._line(table.name, window, shown, placements)

    def _line(self, name: str, window: Window, jobs: Sequence[Placement], every: Sequence[Placement]) -> Plain:
        """Return what is drawn of a table over a window; `every` has also what wraps in from the cycle before."""
        strip = self.beside.strip(name) if self.beside else None
        known = [placement for placement in jobs if placement.job.task in self.order]
        steps = resource_steps(self.model, every, window) if self.is_valid and self.resources else {}
        return {
            "begin": _ms(window.start),
            "end": _ms(window.end),
            "jobs": [self._job(placement) for placement in known],
            "meters": [
                {"name": name, "steps": [[_ms(instant), float(level)] for instant, level in found]}
                for name, found in steps.items()
                if any(level for _, level in found)
            ],
            "strip": None if strip is None else {"caption": strip.caption, "boxes": self._boxes(strip)},
        }

    def _job(self, placement: Placement) -> list[Any]:
        """Return task, number, version, lanes, start, end, both as text, parts of a job with gaps, and accesses."""
        job, start, end = placement.job, placement.start, placement.end
        parts = [[_ms(low), _ms(high)] for low, high in placement.stretches()] if job.parts else []
        times = [_ms(start), _ms(end), str(start), str(end)]
        phases = [
            [self.resources[access.resource], _ms(start + begin), _ms(start + until)]
            for access, begin, until in (self.times.of(job) if self.is_valid else ())
            if access.resource in self.resources
        ]
        return [self.order[job.task], job.index, job.version, self._on(job.units), *times, parts, phases]

    def _boxes(self, strip: Strip) -> list[list[Any]]:
        """Return lanes, start, end, task, mark and title of each box; what is marked comes last, over the others."""
        boxes = sorted(strip.boxes, key=lambda box: MARKS.index(box.mark))
        return [
            [self._on(box.units), _ms(box.start), _ms(box.end), self.order[box.task], box.mark, box.title]
            for box in boxes
        ]

    def _on(self, units: Sequence[str]) -> list[int]:
        return [self.lanes[unit] for unit in units if unit in self.lanes]


def _region(begin: Duration, end: Duration, text: str, kind: str) -> Plain:
    return {"begin": _ms(begin), "end": _ms(end), "text": text, "kind": kind}


def waits(model: TaskModel, mode: ModeSchedule) -> list[str]:
    """Return for each job of a mode the predecessors that its plain windows refer to."""
    found: dict[tuple[str, int], list[str]] = {}
    for link in links(model, mode):
        event = "started" if link.precedence.anchor is Anchor.START else "ended"
        text = f"{link.predecessor.task} #{link.predecessor.index} {event} {link.distance} before"
        found.setdefault((link.job.task, link.job.index), []).append(text)
    return ["; ".join(found.get((job.task, job.index), ())) for job in mode.jobs]


def _text(value: Duration | None) -> str:
    return "" if value is None else str(value)


def _ms(value: Duration) -> float:
    return float(value.ns / 10**6)


def embedded(plain: Plain) -> str:
    """Return values as JSON that may stand in a page, whatever names they hold."""
    text = json.dumps(plain, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
