"""Jobs with gaps on a project: its OsTasks wait for an event of each piece, or its priorities interrupt them.

An OsTask that waits for an event of its own before each of its calls is held between them: an expiry point sets the
events of a part when the part begins. Any other must be interrupted by the OS: it is preemptive, and below the OsTasks
of all jobs that start in its gaps (MODEL 8.2, run time). Nothing of that is changed in a project.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location, about
from halpipe.core.durations import ZERO
from halpipe.exporters.arxml.onto.codes import SPLIT_JOB
from halpipe.exporters.common.priorities import relation_of
from halpipe.exporters.common.timeline import versions_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Findings
    from halpipe.models import Job, Schedule, Split, TaskModel
    from halpipe.models.project import Call, Project, ProjectTask


class Gaps:
    """The jobs with gaps: which calls begin with which part."""

    def __init__(self, model: TaskModel, schedule: Schedule, project: Project) -> None:
        self._model = model
        self._schedule = schedule
        self._project = project
        self._splits = {key: version.split for key, version in versions_of(model).items()}
        jobs = [job for mode in schedule.modes for job in mode.jobs]
        jobs += [job for table in schedule.transitions for job in table.jobs]
        self._first = {(job.task, job.version): job for job in reversed(jobs) if job.parts}
        self._held = {key for key in self._first if self._waits(key[0], self._splits[key])}

    def calls(self, job: Job) -> Iterator[tuple[tuple[Call, ...], int]]:
        """Yield the calls of a job in order, as many as begin together, with the number of the part they begin with."""
        calls = self._project.calls.get(job.task, ())
        if not job.parts or (job.task, job.version) not in self._held:
            yield calls, 0
            return
        starts = (ZERO, *self._splits[job.task, job.version].points)
        for number, part in enumerate(job.parts):
            begun = range(len(calls))
            yield (
                tuple(calls[i] for i in begun if part.executed_from <= starts[i] < part.executed_to),
                number,
            )

    def _waits(self, task: str, split: Split) -> bool:
        """Return whether the OsTask of a task waits before each of its calls, which are its pieces."""
        calls = self._project.calls.get(task, ())
        if split.anywhere or len(calls) != len(split.points) + 1 or len({call.os_task for call in calls}) != 1:
            return False
        if not self._project.tasks[calls[0].os_task].is_extended:
            return False
        events = [event for call in calls for event in call.os_events]
        return all(call.os_events for call in calls) and len(set(events)) == len(events)

    # ------------------------------------------------------------------------------------------------ refusal

    def check(self, findings: Findings) -> None:
        """Report every job with a gap in which nothing of the project holds or interrupts it."""
        rest = {key for key in self._first if key not in self._held}
        above = self._above(rest)
        for task, version in sorted(rest):
            job = self._first[task, version]
            for own in self._os_tasks(task):
                if not own.is_preemptive:
                    self._report(
                        findings,
                        job,
                        own,
                        "is not preemptive, and does not wait for an OsEvent of its own before each of its runnables",
                        "set OsTaskSchedule to FULL, or give each runnable of the OsTask an OsEvent",
                    )
                    continue
                for other in sorted(above.get(task, ())):
                    for high in self._os_tasks(other):
                        self._compare(findings, job, own, high)

    def _above(self, keys: set[tuple[str, str]]) -> dict[str, set[str]]:
        """Return the tasks that must be above each, as if the versions given were split anywhere."""
        tasks = tuple(
            replace(
                task,
                versions=tuple(
                    replace(v, split=replace(v.split, anywhere=(task.name, v.name) in keys)) for v in task.versions
                ),
            )
            for task in self._model.tasks
        )
        found: dict[str, set[str]] = {}
        for by_task in relation_of(replace(self._model, tasks=tasks), self._schedule).values():
            for low, highs in by_task.items():
                found.setdefault(low, set()).update(highs)
        return found

    def _os_tasks(self, task: str) -> Iterable[ProjectTask]:
        paths = [call.os_task for call in self._project.calls.get(task, ()) if call.os_task]
        alone = self._project.alone.get(task)
        return [self._project.tasks[path] for path in dict.fromkeys([*paths, *([alone.os_task] if alone else [])])]

    def _compare(self, findings: Findings, job: Job, low: ProjectTask, high: ProjectTask) -> None:
        if low.priority is not None and high.priority is not None and low.priority < high.priority:
            return
        self._report(
            findings,
            job,
            low,
            f"has the priority {low.priority}, and {high.path} ({self._at(high)}), which starts in its gap, "
            f"{high.priority}",
            f"give {high.path} a higher OsTaskPriority in the project, import it again, and schedule again",
        )

    def _at(self, task: ProjectTask) -> Location:
        item = self._project.items.get(task.path)
        return item.at if item else Location()

    def _report(self, findings: Findings, job: Job, own: ProjectTask, message: str, help: str) -> None:
        findings.add(
            SPLIT_JOB(
                f"job {job.index} has {len(job.parts)} parts, but {own.path} {message}",
                at=self._at(own),
                path=about(task=job.task),
                help=help,
            )
        )
