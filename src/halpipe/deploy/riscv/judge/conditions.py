"""Conditions of a whole run: it ended, cores were confined, tables came in order, the runtime told the truth."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Path, about
from halpipe.core.grouping import grouped
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.registers import TOP, Level, Protection, Right
from halpipe.deploy.riscv.run.recording import Flag, Word
from halpipe.deploy.riscv.target import DECISION, Site, UnitSite

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.drivers import PlannedCall
    from halpipe.deploy.riscv.run.expectation import PlannedJob
    from halpipe.deploy.riscv.run.sequence import Played

_STATES = {
    0: "the management core did not come to the first table",
    1: "the last table was not over in time: the management core sleeps or works on",
    2: "it went on to the end, though a health rule has it stop",
    3: "an application core did not answer when it was started",
    5: "a health rule stopped it",
}
VERBS = {Right.READ: "read", Right.WRITE: "write", Right.EXECUTE: "execute"}
FINISHED, TRAPPED, STOPPED = 2, 4, 5
_CLINT_SIZE = 0x10000
_STEPS = 150
"""Instructions between an event and the runtime's look at the clock that it records for it."""

REPORT = "export the bundle again; if it stays, report it as a bug"


def is_over(run: Run, *, stops: bool = False) -> Iterator[Diagnostic]:
    """Yield what kept the run from its end, which is that of a health rule if it `stops`."""
    if run.exhausted:
        help = "look at the job or the part of the runtime at that address: it never comes to its end"
        yield codes.SPENT(f"{run.exhausted} ({run.duration} after the beginning)", help=help)
        return
    if run.state == (STOPPED if stops else FINISHED):
        return
    message = _STATES.get(run.state, f"the runtime is in state {run.state}")
    if run.state == TRAPPED:
        message = f"the management core trapped: mcause {run.word(Word.CAUSE):#x}, mepc {run.word(Word.EPC):#x}"
    dog, kicks = run.site.watchdog, run.recorder.kicks
    message += f"; the watchdog resets the board at {run.since(kicks[-1]) + dog.timeout}" if dog and kicks else ""
    text = run.uart.decode("ascii", "replace").strip()
    message += f"; it printed: {text[:200]}" if text else ""
    yield codes.NOT_FINISHED(f"{message} ({run.duration} after the beginning)", help=REPORT)


def is_confined(run: Run) -> Iterator[Diagnostic]:
    """Yield what the protection of every core leaves open beyond its own scratchpads, timer and interrupt."""
    for unit in run.site.units:
        protection = run.protections[unit.hart]
        help = "the monitor of the core has to lock its protection before the first job; export the bundle again"
        if not protection.is_locked:
            message = "never armed its physical memory protection"
            yield codes.OPEN_CORE(message, path=about(unit=unit.name), help=help)
            continue
        for level, who in ((Level.MACHINE, "its monitor"), (Level.USER, "a job")):
            for low, high, right in _open(run.site, unit, protection, level):
                verbs = " and ".join(verb for each, verb in VERBS.items() if right & each)
                message = f"{who} may {verbs} at {low:#x} to {high:#x}"
                yield codes.OPEN_CORE(message, path=about(unit=unit.name), help=help)
    for hart in sorted({e.hart for e in run.executions if e.level is not Level.USER}):
        message = "executes jobs in machine mode, in which they may change its interrupts and its protection"
        help = "the monitor has to enter jobs in user mode; export the bundle again"
        yield codes.OPEN_CORE(message, path=about(unit=run.site.unit_of(hart).name), help=help)


def _open(site: Site, unit: UnitSite, protection: Protection, level: Level) -> Iterator[tuple[int, int, Right]]:
    own = [
        (unit.ispm.base, unit.ispm.end, Right.READ | Right.EXECUTE),
        (unit.dspm.base, unit.reserved, Right.READ | Right.WRITE),
    ]
    if level is Level.MACHINE:
        own += [(unit.reserved, unit.dspm.end, Right.ALL), (site.clint, site.clint + _CLINT_SIZE, Right.ALL)]
    edges = sorted({0, TOP, *(edge for low, high, _ in own for edge in (low, high))})
    for low, high in pairwise(edges):
        allowed = next((right for start, end, right in own if start <= low < end), Right.NONE)
        for start, end, right in protection.pieces(low, high, level):
            if right & ~allowed:
                yield start, end, right & ~allowed


def plays(run: Run, expected: Sequence[Played], tolerance: Duration) -> Iterator[Diagnostic]:
    """Yield where the sequence of tables leaves what has to follow from the requests, or begins at another instant."""
    for i, (seen, table) in enumerate(zip_longest(run.tables, expected)):
        if seen is None or table is None or seen.name != table.name:
            was = f'"{seen.name}"' if seen else "nothing"
            should = f'"{table.name}"' if table else "nothing"
            message = f"plays {was}, after the requests that were made it has to be {should}"
            yield codes.WRONG_TABLE(message, path=f"cycle {i}", help=REPORT)
            return
        is_early = i > 0 and seen.seen < table.start  # the first one begins with the boot
        if is_early or seen.seen > table.start + tolerance:
            message = f'"{table.name}" begins at {seen.seen}, it has to be at {table.start}'
            yield codes.WRONG_TABLE(message, path=f"cycle {i}", help=REPORT)


def decides(run: Run, played: Sequence[Played], tolerance: Duration) -> Iterator[Diagnostic]:
    """Yield the first table at whose end requests were taken at another instant than the interface promises."""
    modes = [table for table in played if not table.is_transition]
    for table, (now, woken) in zip(modes, run.recorder.decisions, strict=False):
        due, seen = table.start + table.length - run.site.tick * DECISION, run.since(now)
        if not due <= seen <= due + tolerance or run.since(woken) >= due + run.site.tick:
            message = f'at the end of "{table.name}" requests are taken at {seen}, it has to be at {due}'
            yield codes.WRONG_TABLE(message, path=f"cycle {table.cycle}", help=REPORT)
            return


def refuses(run: Run, expected: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield that not so many requests were refused as have to be: those without a table, or against a health rule."""
    records = sum(bool(entry.flags & Flag.REFUSED) for entry in run.recording.records)
    counted, number = run.word(Word.REFUSED), sum(table.refused for table in expected)
    if counted != number or (records != number and not run.recording.lost):
        message = f"{counted} requests for modes are counted as refused and {records} recorded, {number} have to be"
        yield codes.TRACE_DISAGREES(message, path="refused", help=REPORT)


def feeds(run: Run) -> Iterator[Diagnostic]:
    """Yield where the watchdog is not written when each table begins, or resets the board between two of them."""
    dog, kicks = run.site.watchdog, run.recorder.kicks
    late = [pair for pair in pairwise(kicks) if dog and run.length(pair[1] - pair[0]) > dog.timeout]
    if dog and (late or len(kicks) != len(run.tables)):
        message = f"is written {len(kicks)} times in {len(run.tables)} tables"
        message += f", and resets the board at {run.since(late[0][0]) + dog.timeout}" if late else ""
        yield codes.WATCHDOG_RESETS(message, path="watchdog", help=REPORT)


def starts_afresh(run: Run) -> Iterator[Diagnostic]:
    """Yield where fences are missing: of monitors before their first instruction, of what cores store for others."""
    for hart in sorted(run.recorder.unfenced):
        message = "begins its monitor without a fence.i since it was put there"
        yield codes.WRONG_CALL(message, path=about(unit=run.site.unit_of(hart).name), help=REPORT)
    for hart, what in sorted(run.recorder.unordered):
        path = about(unit=run.site.unit_of(hart).name) if hart else "the management core"
        message = f"{what} without a fence between what it stored or saw for that, and this"
        yield codes.WRONG_CALL(message, path=path, help=REPORT)


def calls_drivers(run: Run, jobs: Sequence[PlannedJob], tolerance: Duration) -> Iterator[Diagnostic]:
    """Yield where drivers were not called as planned, or otherwise; the same of other cycles is only counted."""
    late = int(tolerance / run.site.tick)
    left = grouped(((call.function, call.data, call.size), tick_of(run, call.now)) for call in run.recorder.calls)
    lacking: dict[tuple[Path, str], list[PlannedCall]] = defaultdict(list)
    for job in jobs:
        for planned in job.calls:
            seen = left.get((planned.driver.function, planned.data, planned.size), [])
            tick = next((tick for tick in seen if planned.begin <= tick <= planned.begin + late), None)
            if tick is not None:
                seen.remove(tick)
            else:
                lacking[job.path, planned.what].append(planned)
    for (path, what), calls in lacking.items():
        more = f", and likewise {len(calls) - 1} times" if calls[1:] else ""
        message = f"{what} was not called at {run.site.tick * calls[0].begin}{more}"
        yield codes.WRONG_DRIVER(message, path=path, help=REPORT)
    for (function, data, size), ticks in left.items():
        if ticks:
            message = f"driver {function} was called {len(ticks)} times when it is not planned, first at "
            message += f"{run.site.tick * ticks[0]}, with {size} bytes at {data:#x}"
            yield codes.WRONG_DRIVER(message, help=REPORT)


def tick_of(run: Run, instant: int) -> int:
    """Return the tick of the run in which an instant of the machine lies."""
    return (instant - (run.zero or 0)) // run.tick
