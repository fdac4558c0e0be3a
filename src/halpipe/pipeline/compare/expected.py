"""Expected executions: the tables of a schedule in sequence on a line of time."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.pipeline.compare.codes import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule
    from halpipe.models.trace import Execution
    from halpipe.pipeline.compare.judging import Judge


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


MOST_SILENT = 100_000
"""Jobs of cycles in which nothing ran that are counted as missing, one by one."""


def played_tables(
    executions: Sequence[Execution], tables: Mapping[str, Table], judge: Judge, first: str = ""
) -> tuple[list[Played], list[tuple[int, int]]]:
    """Return the tables that the labels of `executions` name, in order, and pauses as in `Matching`.

    Cycles in which nothing ran are filled in, from cycle 0 on where the `first` table is known. Report tables that
    cannot follow each other.
    """
    stated: dict[int, str] = {}
    for execution in executions:
        if execution.cycle is None or execution.table not in tables:
            continue
        former = stated.setdefault(execution.cycle, execution.table)
        if former != execution.table:
            message = f'cycle {execution.cycle} is both "{former}" and "{execution.table}"'
            path, help = about(task=execution.task), "check how the recorder counts cycles"
            judge.add(Kind.SEQUENCE, path, ZERO, message, execution.at, help)
    played: list[Played] = []
    pauses: list[tuple[int, int]] = []
    now, left = ZERO, MOST_SILENT
    last, before = (tables[first], -1) if first else (None, 0)
    for cycle in sorted(stated):
        table = tables[stated[cycle]]
        silent = _between(last, cycle - before, table, tables) if last else []
        if silent is None and last:
            message = f'cycle {cycle} is "{table.name}", {cycle - before} after "{last.name}" in cycle {before}'
            help = f"after it may come: {', '.join(sorted(last.successors))}"
            judge.add(Kind.SEQUENCE, about(table=last.name), ZERO, message, NOWHERE, help)
        for between, times in silent or ():
            jobs = times * sum(map(len, between.jobs.values()))
            left -= jobs
            if jobs and left < 0:
                pauses.append((before, cycle))
            else:
                number = played[-1].cycle + 1 if played else 0
                starts = (now + between.length * i for i in range(times))
                played += [Played(between, number + i, start) for i, start in enumerate(starts)]
            now += between.length * times
        played.append(Played(table, cycle, now))
        now += table.length
        last, before = table, cycle
    return played, pauses


def _between(last: Table, steps: int, table: Table, tables: Mapping[str, Table]) -> list[tuple[Table, int]] | None:
    """Return the tables, and how often each, of the silent cycles before `table`, `steps` after `last`.

    A mode is kept as long as possible, then comes the switch; None: the schedule has no such sequence.
    """
    found: list[tuple[Table, int]] = []
    if last.name not in last.successors and steps > 1:  # a switch, after which comes its target
        last, steps = tables[min(last.successors)], steps - 1
        found.append((last, 1))
    switches = (name for name in sorted(last.successors) if name not in (last.name, table.name))
    switch = next((name for name in switches if table.name in tables[name].successors), None)
    if switch is not None and switch not in tables[switch].successors and steps > 1 and table.name != last.name:
        return [*found, (last, steps - 2), (tables[switch], 1)]
    return [*found, (last, steps - 1)] if table.name in last.successors else None


def unknown_tables(executions: Iterable[Execution], tables: Mapping[str, Table], judge: Judge) -> None:
    """Report, once each, the tables that a trace names and the schedule does not have."""
    unknown = {e.table: e for e in reversed(list(executions)) if e.table and e.table not in tables}
    for name, execution in unknown.items():
        help = did_you_mean(name, sorted(tables), "compare with the schedule that was loaded")
        judge.add(Kind.UNKNOWN_TABLE, "", ZERO, f'the schedule has no table "{name[:60]}"', execution.at, help)
