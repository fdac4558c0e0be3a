"""Trace and summary of a run on a board, from the runtime's records, the schedule and the tables in the program."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.deploy.riscv.judge.figures import Row, csv_of
from halpipe.deploy.riscv.judge.tables import Tables, tables_of
from halpipe.deploy.riscv.run.cosimulation import plan
from halpipe.deploy.riscv.run.recording import Abandoned, Flag, Kind, Record, Recording, meaning, no_recording
from halpipe.deploy.riscv.run.sequence import tables_named
from halpipe.deploy.riscv.target import Site, read_site

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.deploy.base import Target
    from halpipe.models import Job


def board_trace(target: Target, recording: Recording, file: str) -> tuple[bytes, list[str]]:
    """Return the jobs of a recording as CSV, in exact nanoseconds from the run's beginning, and a summary for people.

    Raise `HalpipeError` where a record names what the bundle does not have.
    """
    site, tables = read_site(target.bundle), tables_of(target, read_site(target.bundle))
    entries: Sequence[Record | Abandoned] = (*recording.records, *recording.abandoned)
    if any(e.table >= len(site.tables) or (e.kind != Kind.TABLE and not tables.has(e)) for e in entries):
        raise no_recording(file, "a record names a table, a job or a program that the bundle does not have")
    released = [_released(target, site, table.name) for table in site.tables]
    return csv_of(_rows(recording, tables, site, released)), [*_summary(recording, site, released)]


def _released(target: Target, site: Site, name: str) -> list[Job]:
    """Return the jobs of a table by row: in the order of their releases, cores and tasks."""
    planned = plan(target, site, tables_named(target.schedule, [name]))
    harts = {unit.name: unit.hart for unit in site.units}
    planned.sort(key=lambda p: (p.begin, [harts[unit] for unit in p.job.units], p.job.task, p.job.index))
    return [each.job for each in planned]


def _rows(recording: Recording, tables: Tables, site: Site, released: Sequence[Sequence[Job]]) -> Iterator[Row]:
    """Yield each job with its transfers, as far as these took place, but without the copies of a LET."""
    found: dict[tuple[int, int, int], list[Record]] = defaultdict(list)
    for entry in recording.records:
        if entry.kind in (Kind.COPY, Kind.DONE, Kind.RUN, Kind.STOP) and not entry.flags & Flag.SKIPPED:
            moves = entry.kind in (Kind.COPY, Kind.DONE) and bool(site.turns)
            if not moves or tables.operations(entry.program)[entry.operation].channel != site.copying:
                found[entry.cycle, entry.table, entry.release].append(entry)
    for (cycle, table, release), records in found.items():
        last, job = records[-1], released[table][release]
        end = last.end if last.kind == Kind.STOP and last.end else last.time
        start = site.tick * min(entry.time for entry in records)
        yield start, site.tick * end, cycle, site.tables[table].name, job.task, job.index, job.units


def _summary(recording: Recording, site: Site, released: Sequence[Sequence[Job]]) -> Iterator[str]:
    """Yield how much there is, which jobs failed, and which health rules fired."""
    cycles = {entry.cycle for entry in recording.records}
    yield f"{len(recording.records)} records of {len(cycles)} tables; {recording.lost} older ones were overwritten"
    for abandoned in recording.abandoned:
        task = released[abandoned.table][abandoned.release].task
        where = f"cycle {abandoned.cycle}: a job of {task} on hart {abandoned.hart} was abandoned at "
        yield where + f"{site.tick * abandoned.time}: {meaning(abandoned.flags)}"
    for entry in recording.records:
        if entry.kind == Kind.HEALTH:
            task = released[entry.table][entry.release].task
            yield f"cycle {entry.cycle}: health rule {entry.begin} fired for {task} at {site.tick * entry.time}"
