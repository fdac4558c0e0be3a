"""Cycles of the fixed execution order (FEO) of Eclipse S-CORE: activities, workers, and what each activity follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.durations import ZERO
from halpipe.core.extent import Extent
from halpipe.core.grouping import grouped
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel

AGENT = 1_000_000
WORKERS = 100_000


class CycleExporter(Exporter):
    """Writes one cycle: what ends before a job starts in the table ends before it in the cycle.

    FEO starts an activity as soon as its dependencies are over. All pairs that the table has in sequence stay so, thus
    jobs that end early move no job beyond its place in the table, and no two jobs overlap that do not overlap there.
    """

    name = "feo"
    summary = "cycle of the fixed execution order of Eclipse S-CORE (JSON): the order of the jobs of one mode"
    help = "Write the order of one mode's jobs as a cycle of the fixed execution order (FEO) of Eclipse S-CORE."
    extent = Extent(
        {
            "units": "workers of one agent",
            "tasks": "activities; `halpipe` names them, their workers and the cycle time",
            "modes": "a cycle for each, chosen with --mode",
            "schedule": "`activity_deps`: the order of the table",
        },
        (
            "FEO has an order and no instants: jobs start as early as it allows, not at their instants.",
            "Switches and health rules have no element.",
        ),
    )
    suffix = ".json"

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the configuration; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import refuse_gaps, refuse_let, select
        from halpipe.exporters.orchestrator import json_bytes, only_mode

        chosen = only_mode(select(model, schedule, options.mode, self.name), "a cycle")
        refuse_let(model, chosen, "FEO")
        refuse_gaps(model, chosen, "FEO holds no activity", "set split to none", "remove the split points")
        mode = chosen.modes[0]
        _check(mode)
        return {"": json_bytes(_cycle(mode))}

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return the requirements on instants that an order cannot keep, and the health rules."""
        from halpipe.exporters.orchestrator import NOT_CARRIED

        assert schedule is not None, "write needs a schedule"
        jobs = {(j.task, j.version) for m in schedule.modes if options.mode in ("", m.name) for j in m.jobs}
        found = []
        for task in model.tasks:
            versions = [version for version in task.versions if (task.name, version.name) in jobs]
            texts = [f"offset {task.offset} is not kept: jobs start early"] if versions and task.offset else []
            rows = [row for version in versions for row in version.precedences]
            texts += [f"window {row.min} to {row.max} {row.words} is kept as an order at most" for row in rows]
            found += [NOT_CARRIED(t, at=task.at, path=about(task=task.name), help="add other means") for t in texts]
        for rule in model.health:
            text = "health rule has no element"
            found.append(NOT_CARRIED(text, at=rule.at, path=about(task=rule.task), help="add other means"))
        return found


FORMAT = CycleExporter()


def _check(mode: ModeSchedule) -> None:
    """Raise `HalpipeError` with each job that a cycle cannot have."""
    from halpipe.exporters.orchestrator import UNPLAYABLE

    findings = Findings()
    for job in mode.jobs:
        path = about(mode=mode.name, task=job.task, job=job.index)
        if job.index == 1:
            text = f"runs more than once in {mode.hyperperiod}; FEO runs each activity once in a cycle"
            findings.add(UNPLAYABLE(text, path=path, help="give all tasks of the mode one period"))
        if job.end > mode.hyperperiod:
            text = f"ends at {job.end}, after the cycle of {mode.hyperperiod}"
            findings.add(UNPLAYABLE(text, path=path, help='set the edge of the mode to "closed"'))
        if len(job.units) > 1:
            text = f"takes {len(job.units)} units together"
            findings.add(UNPLAYABLE(text, path=path, help="give the version a gang size of 1"))
    findings.stop_on_errors()


def _cycle(mode: ModeSchedule) -> dict[str, Any]:
    """Return the cycle of a mode; activities are numbered by their starts."""
    jobs = sorted(mode.jobs, key=lambda job: (job.start, job.end, job.task))
    number = {job.task: index for index, job in enumerate(jobs, start=1)}
    on_unit = grouped((job.units[0], number[job.task]) for job in jobs)
    workers = {WORKERS + index: unit for index, unit in enumerate(sorted(on_unit), start=1)}
    return {
        "signalling": "DirectMpsc",
        "primary_agent": AGENT,
        "agent_assignments": {str(AGENT): list(workers)},
        "worker_assignments": {str(worker): on_unit[unit] for worker, unit in workers.items()},
        "optimize_composite_activities": False,
        "activity_deps": {str(index): before for index, before in enumerate(_before(jobs), start=1)},
        "halpipe": {
            "mode": mode.name,
            "cycle": str(mode.hyperperiod),
            "activities": {str(index): task for task, index in number.items()},
            "workers": {str(worker): unit for worker, unit in workers.items()},
        },
    }


def _before(jobs: list[Job]) -> Iterator[list[int]]:
    """Yield for each of the jobs in order which end before it starts, without those that another of them follows.

    They are numbered from 1.
    """
    waiting = sorted(enumerate(jobs, start=1), key=lambda pair: pair[1].end, reverse=True)
    latest, over = ZERO, waiting[:0]
    for job in jobs:
        while waiting and waiting[-1][1].end <= job.start:
            over.append(waiting.pop())
            latest = max(latest, over[-1][1].start)
        over = [each for each in over if each[1].end > latest]
        yield sorted(index for index, _ in over)
