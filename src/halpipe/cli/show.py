"""``halpipe show``."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Exit

if TYPE_CHECKING:
    from fractions import Fraction

    from rich.console import Console

    from halpipe.models import Job, ModeSchedule, Schedule

MOST_JOBS = 200


def show(
    schedule: ScheduleFile,
    mode: Annotated[str, typer.Option(help="This mode only; otherwise all, and the switches.")] = "",
    jobs: Annotated[bool, typer.Option(help=f"List every job, also where there are more than {MOST_JOBS}.")] = False,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Show a schedule in the terminal: a Gantt chart, jobs, loads and chain latencies of every mode, and switches."""
    from halpipe.cli.answers import check_name, console
    from halpipe.cli.gantt import letters_of
    from halpipe.importers.native import read_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    tables = read_schedule(schedule)
    if mode:
        check_name(mode, {m.name for m in tables.modes}, "mode", "--mode")
    screen = console()
    letters = letters_of(tables.modes, tables.transitions)
    for table in tables.modes:
        if mode in ("", table.name):
            _show_mode(screen, table, letters, every=jobs)
    if tables.transitions and not mode:
        _show_switches(screen, tables, letters)
    return Exit.OK


def _width() -> int:
    return shutil.get_terminal_size((100, 24)).columns


def _show_mode(screen: Console, mode: ModeSchedule, letters: dict[str, str], *, every: bool) -> None:
    from halpipe.cli.gantt import gantt

    screen.print(f"mode {mode.name}: {len(mode.jobs)} jobs in {mode.hyperperiod}, claimed {mode.status}")
    for line in gantt(mode.jobs, mode.hyperperiod, letters, _width() - 2, wraps=True):
        screen.print(f"  {line}")
    if every or len(mode.jobs) <= MOST_JOBS:
        _show_jobs(screen, mode.jobs, letters)
    else:
        screen.print(f"  {len(mode.jobs)} jobs; --jobs lists them")
    for unit in mode.unit_loads:
        screen.print(f"  {unit.unit}: busy {unit.busy}, {_percent(unit.share)}")
    for load in mode.resource_loads:
        screen.print(f"  {load.resource}: peak {_percent(load.peak)}, mean {_percent(load.mean)}")
    for chain in mode.chains:
        screen.print(f"  chain {chain.name}: reaction {chain.reaction or 'never'}, age {chain.age or 'never'}")
    screen.print()


def _show_jobs(screen: Console, jobs: tuple[Job, ...], letters: dict[str, str]) -> None:
    from rich.table import Table

    table = Table("", "start", "end", "task", "job", "version", "units", box=None, pad_edge=False)
    for column in table.columns[1:3]:
        column.justify = "right"
    for job in sorted(jobs, key=lambda job: (job.start.ns, job.units)):
        where = " ".join(job.units)
        table.add_row(letters[job.task], str(job.start), str(job.end), job.task, str(job.index), job.version, where)
        for part in job.parts:
            executed = f"executes {part.executed_from} to {part.executed_to}"
            table.add_row("", str(part.start), str(part.end), "", "", executed, "")
    screen.print(table)


def _show_switches(screen: Console, tables: Schedule, letters: dict[str, str]) -> None:
    from rich.table import Table

    from halpipe.cli.gantt import gantt

    shown = Table("switch", "to", "table", "at worst", "jobs", "claimed", box=None, pad_edge=False)
    for switch in tables.transitions:
        facts = (str(switch.length), str(switch.worst_latency), str(len(switch.jobs)), str(switch.status))
        shown.add_row(switch.source, switch.target, *facts)
    screen.print(shown)
    for switch in tables.transitions:
        if switch.length:
            screen.print(f"\n{switch.source} to {switch.target}")
            for line in gantt(switch.jobs, switch.length, letters, _width() - 2, wraps=False):
                screen.print(f"  {line}")


def _percent(share: Fraction) -> str:
    """Return a share in per cent with one decimal, rounded half to even, without a float."""
    tenths = round(share * 1000)
    return f"{tenths // 10}.{tenths % 10} %"
