"""``halpipe show``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Exit

if TYPE_CHECKING:
    from rich.console import Console

    from halpipe.models import ModeSchedule


def show(
    schedule: ScheduleFile, format: DiagnosticFormat = None, quiet: Quiet = False, verbose: Verbose = False
) -> int:
    """Show a schedule in the terminal: jobs, loads and chain latencies of every mode."""
    from rich.console import Console

    from halpipe.importers.native import read_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    tables = read_schedule(schedule)
    console = Console(highlight=False, soft_wrap=True)
    for mode in tables.modes:
        _show_mode(console, mode)
    return Exit.OK


def _show_mode(console: Console, mode: ModeSchedule) -> None:
    from rich.table import Table

    console.print(f"mode {mode.name}: {len(mode.jobs)} jobs in {mode.hyperperiod}, claimed {mode.status}")
    jobs = Table("start", "end", "task", "job", "version", "units", box=None, pad_edge=False)
    for job in mode.jobs:
        jobs.add_row(str(job.start), str(job.end), job.task, str(job.index), job.version, " ".join(job.units))
    console.print(jobs)
    for unit in mode.unit_loads:
        console.print(f"  {unit.unit}: busy {unit.busy}, {_percent(unit.share)}")
    for load in mode.resource_loads:
        console.print(f"  {load.resource}: peak {_percent(load.peak)}, mean {_percent(load.mean)}")
    for chain in mode.chains:
        console.print(f"  chain {chain.name}: reaction {chain.reaction or 'never'}, age {chain.age or 'never'}")
    console.print()


def _percent(share: object) -> str:
    from fractions import Fraction

    return f"{float(Fraction(str(share)) * 100):.1f} %"
