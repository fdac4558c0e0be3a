"""Workloads of Eclipse TIMPANI: tasks with release times, of which its orchestrator gives each node its own."""

from __future__ import annotations

from fractions import Fraction
from itertools import chain
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.extent import Extent
from halpipe.core.grouping import grouped
from halpipe.core.options import CPUS, Form, cpu_number, option, specific
from halpipe.core.records import record
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel

MOST_LOAD = Fraction(9, 10)
"""The orchestrator adds the loads of a CPU as floats and moves the task that exceeds this one to another CPU."""
LONGEST = 3_600_000_000
"""Hyperperiods above an hour, in microseconds, are refused by the orchestrator."""
MOST_CPUS = 64
NAME_LENGTH = 15
PRIORITY = 50
"""All jobs have one priority of SCHED_FIFO: on its CPU, each runs to its end in the order of the release times."""


@record(kw_only=True)
class TimpaniOptions(ExportOptions):
    """`node` is the key of the node's configuration; `cpus` are the Linux CPUs of its units."""

    node: str = option("node01", "Node that the units are CPUs of.", metavar="NAME")
    cpus: Mapping[str, int] | None = option(None, CPUS, cpu_number, metavar="UNIT=CPU,...", form=Form.NAMES)


class TimpaniExporter(Exporter):
    """Writes a task for each periodic start; a task whose jobs are not equidistant on one unit becomes one for each."""

    name = "timpani"
    summary = "workload of Eclipse TIMPANI (YAML): release times, CPUs and budgets of one mode"
    help = "Write one mode as a workload of the orchestrator Eclipse TIMPANI."
    extent = Extent(
        {
            "units": "CPUs of one node: `cpu_affinity`",
            "versions": "`runtime`: the WCET of the scheduled version",
            "modes": "a workload for each, chosen with --mode",
            "schedule": "`release_time` and `period` of equidistant jobs, else a task for each job",
        },
        (
            "`deadline` is the reserved length of the job: a job that is late in the table is a deadline miss.",
            "Access bounds, chains, switches and health rules have no element.",
        ),
    )
    suffix = ".yaml"
    options = TimpaniOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the workload; see `halpipe.exporters.common.base.Exporter`."""
        import yaml

        from halpipe.exporters.common.cpus import placed
        from halpipe.exporters.common.selection import refuse_gaps, refuse_let, select
        from halpipe.exporters.orchestrator import only_mode

        chosen = only_mode(select(model, schedule, options.mode, self.name), "a workload")
        stated = specific(TimpaniOptions, options)
        refuse_let(model, chosen, "TIMPANI")
        refuse_gaps(model, chosen, "TIMPANI starts jobs and holds none", "set split to none", "remove the split points")
        tasks = _tasks(model, chosen.modes[0], placed(model, stated.cpus), stated.node)
        return {"": yaml.safe_dump({"workload_id": model.name, "tasks": tasks}, sort_keys=False).encode()}

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return the names that nodes cut, the health rules and the resources whose bounds none enforces."""
        from halpipe.exporters.orchestrator import NOT_CARRIED

        assert schedule is not None, "write needs a schedule"
        mode = next(mode for mode in schedule.modes if options.mode in ("", mode.name))
        named = {task: [name for name, *_ in _entries(jobs, mode.hyperperiod)] for task, jobs in _by_task(mode).items()}
        long = [name for names in named.values() for name in names if len(name) > NAME_LENGTH]
        texts = [f'name "{name}" is longer than the {NAME_LENGTH} characters that a node keeps' for name in long]
        apart = sorted(task for task, names in named.items() if names != [task])
        texts += [f'jobs of task "{name}" are not equidistant on one unit: each is a task of its own' for name in apart]
        texts += [f'health rule of task "{rule.task}" has no element' for rule in model.health]
        return [NOT_CARRIED(text, help="rename or bind the task, or add other means") for text in texts]


FORMAT = TimpaniExporter()


def _tasks(model: TaskModel, mode: ModeSchedule, cpus: Mapping[str, int], node: str) -> list[dict[str, Any]]:
    """Return the tasks of the workload; raise `HalpipeError` with everything that the orchestrator would change."""
    from halpipe.exporters.orchestrator import UNPLAYABLE

    findings = Findings()

    def refuse(message: str, path: str, help: str) -> None:
        findings.add(UNPLAYABLE(message, path=path, help=help))

    microseconds = "schedule with --tick 1us, and state periods in whole microseconds"
    length = mode.hyperperiod.in_unit("us")
    if length.denominator != 1 or length > LONGEST:
        text = f"hyperperiod {mode.hyperperiod} is no whole number of us up to 1 h"
        refuse(text, about(mode=mode.name), microseconds)
    by_task = _by_task(mode)
    for job in chain.from_iterable(by_task.values()):
        path = about(task=job.task, job=job.index)
        if job.start.in_unit("us").denominator != 1:
            refuse(f"start {job.start} is no whole number of us", path, microseconds)
        if len(job.units) > 1:
            refuse(f"takes {len(job.units)} units together", path, "give the version a gang size of 1")
    for unit in sorted({job.units[0] for job in mode.jobs}):
        if cpus.get(unit, MOST_CPUS) >= MOST_CPUS:
            refuse(f"has no CPU from 0 to {MOST_CPUS - 1}", about(unit=unit), "state it with --cpus")
    findings.stop_on_errors()
    rows: list[dict[str, Any]] = []
    loads = dict.fromkeys(cpus, Fraction())
    for jobs in by_task.values():
        for name, job, period in _entries(jobs, mode.hyperperiod):
            wcet = model.task(job.task).version(job.version).wcet
            assert wcet is not None, "a schedule has jobs of versions with a WCET only"
            runtime, period_us = ceil(wcet.in_unit("us")), int(period.in_unit("us"))
            loads[job.units[0]] += Fraction(runtime, period_us)
            row = {"name": name, "node_id": node, "priority": PRIORITY, "policy": 1}  # SCHED_FIFO
            row |= {"cpu_affinity": 1 << cpus[job.units[0]], "period": period_us, "runtime": runtime}
            row |= {"deadline": ceil((job.end - job.start).in_unit("us"))}
            rows.append(row | {"release_time": int(job.start.in_unit("us")), "max_dmiss": 0})
    for unit, load in loads.items():
        if load >= MOST_LOAD:
            refuse(f"load is {load * 100} %, not below 90 %", about(unit=unit), "move a task to another unit")
    findings.stop_on_errors()
    return rows


def _by_task(mode: ModeSchedule) -> dict[str, list[Job]]:
    """Return the jobs of each task in the order of their starts."""
    jobs = sorted(mode.jobs, key=lambda job: (job.start, job.task))
    return grouped((job.task, job) for job in jobs)


def _entries(jobs: list[Job], hyperperiod: Duration) -> list[tuple[str, Job, Duration]]:
    """Return name, first job and period of what starts periodically: all jobs of a task, or each of them."""
    first, period = jobs[0], hyperperiod / len(jobs)
    alike = all((job.units, job.version) == (first.units, first.version) for job in jobs)
    exact = period.in_unit("us").denominator == 1
    if alike and exact and all(job.start == first.start + period * number for number, job in enumerate(jobs)):
        return [(first.task, first, period)]
    return [(f"{job.task}.{job.index}", job, hyperperiod) for job in jobs]
