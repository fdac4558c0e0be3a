"""What a browser draws: a session as plain values; times in milliseconds to draw, and exact as text to read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.exporters.palette import FILLS, tone

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.diagnostics import Diagnostic
    from halpipe.durations import Duration
    from halpipe.models import Chain, Job, ModeSchedule, Schedule, Task, TaskModel
    from halpipe.workbench.session import Session

Plain = dict[str, Any]


def picture(session: Session) -> Plain:
    """Return everything that the page shows."""
    state = session.state
    return {
        "revision": session.revision,
        "path": session.path,
        "busy": session.lock.locked(),
        "valid": state.is_valid,
        "what": state.what,
        "can_undo": session.can_undo,
        "can_redo": session.can_redo,
        "changed_on_disk": session.changed_on_disk(),
        "answered": {
            "stayed": session.answered.stayed,
            "jobs": session.answered.jobs,
            "milliseconds": round(session.answered.seconds * 1000),
        },
        "findings": [plain(found) for found in state.findings],
        "variants": list(session.variants),
        "pins": [[pin.mode, pin.task, pin.index] for pin in state.pins],
        **scene(state.model, state.schedule),
    }


def scene(model: TaskModel, schedule: Schedule | None) -> Plain:
    """Return a model and its schedule, as the viewer takes them."""
    order = {task.name: number for number, task in enumerate(model.tasks)}
    return {
        "model": model.name,
        "units": [unit.name for unit in model.units],
        "tasks": [_task(task, tone(number), schedule) for number, task in enumerate(model.tasks)],
        "chains": [_chain(chain, order, schedule) for chain in model.chains],
        "modes": [_mode(model, mode, order) for mode in schedule.modes] if schedule else [],
        "switches": _switches(schedule) if schedule else [],
    }


def plain(found: Diagnostic) -> Plain:
    """Return a diagnostic as values."""
    return {
        "code": found.code,
        "severity": str(found.severity),
        "message": found.message,
        "path": found.path,
        "help": found.help,
    }


def _task(task: Task, colour: int, schedule: Schedule | None) -> Plain:
    return {
        "name": task.name,
        "colour": FILLS[colour],
        "period": _text(task.period),
        "offset": _text(task.offset),
        "deadline": _text(task.deadline),
        "slack": str(task.slack),
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
        "figures": [_figures(task, mode) for mode in schedule.modes] if schedule else [],
    }


def _figures(task: Task, mode: ModeSchedule) -> Plain:
    """Return the worst response time, start jitter and gaps of a task in a mode; nothing where it does not run."""
    jobs = [job for job in mode.jobs if job.task == task.name]
    if not jobs:
        return {}
    gaps = sum(max(0, len(job.parts) - 1) for job in jobs)
    if task.period is None:
        return {"jobs": len(jobs), "gaps": gaps}
    releases = _releases(task, jobs)
    delays = [job.start - release for job, release in releases]
    ends = [job.end - release for job, release in releases]
    return {
        "jobs": len(jobs),
        "gaps": gaps,
        "response": str(max(ends)),
        "response_ms": _ms(max(ends)),
        "jitter": str(max(delays) - min(delays)),
        "jitter_ms": _ms(max(delays) - min(delays)),
    }


def _releases(task: Task, jobs: Iterable[Job]) -> list[tuple[Job, Duration]]:
    """Return the jobs with the latest grid of releases that none of them starts before."""
    period = task.period
    assert period is not None
    listed = list(jobs)
    phase = task.offset if task.offset is not None else min(job.start - period * job.index for job in listed)
    return [(job, phase + period * job.index) for job in listed]


def _chain(chain: Chain, order: dict[str, int], schedule: Schedule | None) -> Plain:
    found = [(mode.name, row) for mode in (schedule.modes if schedule else ()) for row in mode.chains]
    return {
        "name": chain.name,
        "tasks": [order[name] for name in chain.tasks if name in order],
        "max_reaction": _text(chain.max_reaction),
        "max_age": _text(chain.max_age),
        "latencies": [
            {"mode": mode, "reaction": _text(row.reaction), "age": _text(row.age)}
            for mode, row in found
            if row.name == chain.name
        ],
    }


def _mode(model: TaskModel, mode: ModeSchedule, order: dict[str, int]) -> Plain:
    lanes = {unit.name: number for number, unit in enumerate(model.units)}
    return {
        "name": mode.name,
        "length": _ms(mode.hyperperiod),
        "length_text": str(mode.hyperperiod),
        "loads": {load.unit: _percent(load.share) for load in mode.unit_loads},
        "jobs": [_job(job, order, lanes) for job in mode.jobs if job.task in order],
    }


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
    return float(value.in_unit("ms"))


def _percent(share: Any) -> float:
    return float(round(share * 1000)) / 10
