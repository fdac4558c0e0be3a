"""Expected executions: the tables of a schedule in sequence on a line of time."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.pipeline.compare.codes import UNKNOWN_TABLE, WRONG_SEQUENCE

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule
    from halpipe.models.trace import Execution


@record
class Table:
    """A mode or a transition table: what is played as one piece; `jobs` by task, by start."""

    name: str
    length: Duration
    jobs: dict[str, tuple[Job, ...]]
    successors: frozenset[str]


@record
class Played:
    """A table that was played: the `cycle`-th, from `start` after the origin."""

    table: Table
    cycle: int
    start: Duration


def tables_of(schedule: Schedule) -> dict[str, Table]:
    """Return the tables of a schedule by name."""
    switches = {t.name: t for t in schedule.transitions}
    found = {}
    for mode in schedule.modes:
        after = {name for name, table in switches.items() if table.source == mode.name}
        direct = {table.target for table in switches.values() if table.source == mode.name and not table.length}
        found[mode.name] = Table(
            mode.name, mode.hyperperiod, _by_task(mode.jobs), frozenset({mode.name} | after | direct)
        )
    for name, switch in switches.items():
        found[name] = Table(name, switch.length, _by_task(switch.jobs), frozenset({switch.target}))
    return found


def _by_task(jobs: Iterable[Job]) -> dict[str, tuple[Job, ...]]:
    grouped: dict[str, list[Job]] = defaultdict(list)
    for job in sorted(jobs, key=lambda job: (job.start.ns, job.index)):
        grouped[job.task].append(job)
    return {task: tuple(found) for task, found in grouped.items()}


def played_tables(executions: Sequence[Execution], tables: dict[str, Table], findings: Findings) -> list[Played]:
    """Return the tables that the labels of `executions` tell of, in order; report those that cannot follow each other.

    A table without jobs leaves no trace: where the count of cycles steps over one, a table without jobs that fits
    between its neighbours is put in.
    """
    stated: dict[int, str] = {}
    for execution in executions:
        if execution.cycle is None or execution.table not in tables:
            continue
        former = stated.setdefault(execution.cycle, execution.table)
        if former != execution.table:
            message = f'cycle {execution.cycle} is both "{former}" and "{execution.table}"'
            findings.add(WRONG_SEQUENCE(message, at=execution.at, help="check how the recorder counts cycles"))
    played: list[Played] = []
    now = ZERO
    for cycle in sorted(stated):
        table = tables[stated[cycle]]
        for between in _between(played, cycle, table, tables, findings):
            now += between.length
        played.append(Played(table, cycle, now))
        now += table.length
    return played


def _between(
    played: list[Played], cycle: int, table: Table, tables: dict[str, Table], findings: Findings
) -> list[Table]:
    """Return the tables without jobs that were played between the last of `played` and `table`."""
    if not played:
        return []
    last, steps = played[-1].table, cycle - played[-1].cycle
    if steps == 1 and table.name in last.successors:
        return []
    silent = [tables[name] for name in sorted(last.successors) if table.name in tables[name].successors]
    fitting = [between for between in silent if steps == 2 and not between.jobs]
    if fitting:
        return fitting[:1]
    message = f'cycle {cycle} is "{table.name}", {steps} after "{last.name}" in cycle {played[-1].cycle}'
    allowed = ", ".join(sorted(last.successors))
    findings.add(WRONG_SEQUENCE(message, path=about(table=last.name), help=f"after it may come: {allowed}"))
    return []


def unknown_tables(executions: Iterable[Execution], tables: dict[str, Table], findings: Findings) -> None:
    """Report, once each, the tables that a trace names and the schedule does not have."""
    seen: set[str] = set()
    for execution in executions:
        name = execution.table
        if name and name not in tables and name not in seen:
            seen.add(name)
            help = did_you_mean(name, sorted(tables), "compare with the schedule that was loaded")
            findings.add(UNKNOWN_TABLE(f'the schedule has no table "{name}"', at=execution.at, help=help))
