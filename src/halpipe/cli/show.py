"""``halpipe show``."""

from __future__ import annotations

import shutil
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output, streams
from halpipe.cli.completing import modes
from halpipe.cli.parameters import Quiet, ScheduleFile, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Schedule

MOST_JOBS = 200


class Form(StrEnum):
    """The forms of a schedule that is shown; diagnostics are JSON where it is."""

    TEXT = "text"
    JSON = "json"
    CSV = "csv"


def show(
    schedule: ScheduleFile,
    mode: Annotated[
        str, typer.Option(help="This mode only; otherwise all, and the switches.", autocompletion=modes)
    ] = "",
    jobs: Annotated[bool, typer.Option(help=f"List every job, also where there are more than {MOST_JOBS}.")] = False,
    format: Annotated[
        Form, typer.Option(help="text; json: jobs, loads, latencies, switches; csv: a row for each part of a job.")
    ] = Form.TEXT,
    model: Annotated[
        str, typer.Option(metavar="FILE", help="Task model of the schedule: latencies of all chains, as well.")
    ] = "",
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Show a schedule in the terminal: a Gantt chart, jobs, loads and chain latencies of every mode, and switches."""
    from halpipe.cli.answers import check_name
    from halpipe.cli.gantt import letters_of
    from halpipe.importers.native import read_schedule

    output.choose(output.Format.JSON if format is Form.JSON else None, quiet=quiet, verbose=verbose)
    tables = read_schedule(schedule)
    if model:
        from halpipe.importers.native import read_model
        from halpipe.pipeline.checked import refuse_invalid
        from halpipe.pipeline.measure.metrics import with_latencies

        system = read_model(model)
        refuse_invalid(system, tables)
        tables = with_latencies(system, tables)
    if mode:
        check_name(mode, {m.name for m in tables.modes}, "mode", "--mode")
        tables = tables.alone((tables.mode(mode),))
    if format is not Form.TEXT:
        from halpipe.exporters.common.rows import as_csv, as_json

        output.text((as_json if format is Form.JSON else as_csv)(tables))
        return Exit.OK
    letters = letters_of(tables.modes, tables.transitions)
    for table in tables.modes:
        _show_mode(table, letters, every=jobs)
    if tables.transitions:
        _show_switches(tables, letters)
    return Exit.OK


def _width() -> int:
    return shutil.get_terminal_size((100, 24)).columns


def _show_chart(jobs: tuple[Job, ...], length: Duration, letters: dict[str, str], *, wraps: bool) -> None:
    """Print a Gantt chart; under an ASCII terminal with full stops where nothing runs."""
    from halpipe.cli.gantt import IDLE, gantt

    idle = IDLE if streams.can_print(IDLE) else "."
    for line in gantt(jobs, length, letters, _width() - 2, wraps=wraps):
        output.result(f"  {line.replace(IDLE, idle)}")


def _show_mode(mode: ModeSchedule, letters: dict[str, str], *, every: bool) -> None:
    output.result(f"mode {mode.name}: {len(mode.jobs)} jobs in {mode.hyperperiod}, claimed {mode.status}")
    _show_chart(mode.jobs, mode.hyperperiod, letters, wraps=True)
    if every or len(mode.jobs) <= MOST_JOBS:
        _show_jobs(mode.jobs, letters)
    else:
        output.result(f"  {len(mode.jobs)} jobs; --jobs lists them")
    for unit in mode.unit_loads:
        output.result(f"  {unit.unit}: busy {unit.busy}, {_percent(unit.share)}")
    for load in mode.resource_loads:
        if load.peak is not None and load.mean is not None:
            output.result(f"  {load.resource}: peak {_percent(load.peak)}, mean {_percent(load.mean)}")
    for chain in mode.chains:
        latency = "" if chain.latency is None else f"latency {chain.latency}, "
        reaction, age = chain.reaction or "never", chain.age or "never"
        output.result(f"  chain {chain.name}: {latency}reaction {reaction}, age {age}")
    output.result()


def _show_jobs(jobs: tuple[Job, ...], letters: dict[str, str]) -> None:
    rows = []
    for job in sorted(jobs, key=lambda job: (job.start.ns, job.units)):
        where = " ".join(job.units)
        rows.append((letters[job.task], str(job.start), str(job.end), job.task, str(job.index), job.version, where))
        for part in job.parts:
            executed = f"executes {part.executed_from} to {part.executed_to}"
            rows.append(("", str(part.start), str(part.end), "", "", executed, ""))
    output.table(("", "start", "end", "task", "job", "version", "units"), rows, right=(1, 2))


def _show_switches(tables: Schedule, letters: dict[str, str]) -> None:
    rows = []
    for switch in tables.transitions:
        facts = (str(switch.length), str(switch.worst_latency), str(len(switch.jobs)), str(switch.status))
        rows.append((switch.source, switch.target, *facts))
    output.table(("switch", "to", "table", "at worst", "jobs", "claimed"), rows)
    for switch in tables.transitions:
        if switch.length:
            output.result()
            output.result(f"{switch.source} to {switch.target}")
            _show_chart(switch.jobs, switch.length, letters, wraps=False)


def _percent(share: Fraction) -> str:
    """Return a share in per cent with one decimal, rounded half to even, without a float."""
    tenths = round(share * 1000)
    return f"{tenths // 10}.{tenths % 10} %"
