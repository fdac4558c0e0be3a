"""Faults put into jobs on purpose, late transfers, and what has to follow from each by the schedule."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from enum import StrEnum
from itertools import pairwise, takewhile
from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.deploy.riscv.run.observation import Execution, Outcome
from halpipe.deploy.riscv.run.recording import Flag
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.deploy.riscv.board.devices import Transfer
    from halpipe.deploy.riscv.board.memory import Memory
    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer
    from halpipe.deploy.riscv.target import Site, UnitSite


class Kind(StrEnum):
    """Kind of an injected fault."""

    SPIN = "a loop without end"
    DEAF_SPIN = "interrupts switched off, then a loop without end"
    TRAP = "an illegal instruction"
    CALL = "a system call"
    WILD_STORE = "a store to main memory"
    NEIGHBOUR = "a store to another core's scratchpad"
    JUMP = "a jump into main memory"
    OVERFLOW = "a stack that grows without end"
    REGISTERS = "the protection opened and the trap vector cleared"
    TIMER = "the deadline put off"
    MAILBOX = "a store to the mailbox"
    LATE_DMA = "a transfer that takes too long"
    DMA_ERROR = "a transfer that fails"
    HELD = "a late transfer of another job on its channel or unit"


CODES = tuple(kind for kind in Kind if kind not in (Kind.LATE_DMA, Kind.DMA_ERROR, Kind.HELD))
"""What the code of a job can do wrong."""

_HERE = 0x0000006F  # j .
_SPIN = (*[0x00000013] * 15, 0xFC5FF06F)  # nops, and back to the first
_CSRCI_MSTATUS, _CSRW_PMPCFG0, _CSRW_MTVEC = 0x30047073, 0x3A001073, 0x30501073
_UNIMPLEMENTED, _ECALL = 0xC0001073, 0x00000073
_T0, _SP, _ZERO = 5, 2, 0


def _constant(value: int) -> tuple[int, ...]:
    """Return instructions that put an unsigned number of 32 bits into t0."""
    low = (value & 0xFFF) - ((value & 0x800) << 1)
    high = (value - low) >> 12 & 0xFFFFF
    lui = high << 12 | _T0 << 7 | 0x37
    addi = (low & 0xFFF) << 20 | _T0 << 15 | _T0 << 7 | 0x1B
    slli, srli = 0x02029293, 0x0202D293  # t0 by 32 places
    return lui, addi, slli, srli


def _store(address: int) -> tuple[int, ...]:
    sd = _T0 << 20 | _T0 << 15 | 3 << 12 | 0x23  # sd t0, 0(t0)
    return (*_constant(address), sd, _HERE)


def code_of(kind: Kind, site: Site, unit: UnitSite) -> bytes:
    """Return the instructions of a fault on a unit; empty if addresses there need more than 32 bits."""
    others = [other for other in site.units if other is not unit]
    clint_timer = site.clint + 0x4000 + 8 * unit.hart
    neighbour = others[0].mailbox if others else site.main.base
    words: tuple[int, ...] = {
        Kind.SPIN: _SPIN,
        Kind.DEAF_SPIN: (_CSRCI_MSTATUS, _HERE),
        Kind.TRAP: (_UNIMPLEMENTED, _HERE),
        Kind.CALL: (_ECALL, _HERE),
        Kind.WILD_STORE: _store(site.control + 8),
        Kind.NEIGHBOUR: _store(neighbour),
        Kind.JUMP: (*_constant(site.main.base), 0x00028067),  # jr t0
        Kind.OVERFLOW: (0xFC010113, 0x00113023, 0xFF9FF06F),  # addi sp, sp, -64; sd ra, 0(sp); again
        Kind.REGISTERS: (_CSRW_PMPCFG0, _CSRW_MTVEC, _HERE),
        Kind.TIMER: (*_constant(clint_timer), 0xFFF00313, 0x0062B023, _HERE),  # li t1, -1; sd t1, 0(t0)
        Kind.MAILBOX: _store(unit.mailbox + 8),
    }[kind]
    if max(site.main.end, clint_timer, neighbour, unit.mailbox) >> 32:
        return b""
    return b"".join(word.to_bytes(4, "little") for word in words)


@record
class Injection:
    """One fault: of a `kind`, into the job of `row` of the `cycle`-th table.

    A late transfer is complete a little more than `late` ticks after its phase, when the check that it is complete has
    certainly been made. It befalls the `victim`, or what of the job is stated.
    """

    kind: Kind
    cycle: int
    row: int
    late: int = 0
    stated: PlannedExecution | PlannedTransfer | None = None

    @property
    def flags(self) -> Flag:
        """Flags of which the runtime has to record one."""
        if self.kind in (Kind.LATE_DMA, Kind.HELD):
            return Flag.LATE
        if self.kind is Kind.DMA_ERROR:
            return Flag.ERROR
        return {Kind.SPIN: Flag.OVERRUN, Kind.DEAF_SPIN: Flag.OVERRUN | Flag.FAULT}.get(self.kind, Flag.FAULT)

    def befalls(self, job: PlannedJob) -> PlannedExecution | PlannedTransfer | None:
        """Return what of its job the fault befalls."""
        return self.stated or victim(self.kind, job)

    @property
    def ends(self) -> frozenset[Outcome]:
        """Permitted ends of the execution."""
        if self.kind is Kind.SPIN:
            return frozenset({Outcome.OVERRUN})
        return frozenset({Outcome.FAULT} | ({Outcome.OVERRUN} if self.kind is Kind.DEAF_SPIN else set()))


def victim(kind: Kind, job: PlannedJob) -> PlannedExecution | PlannedTransfer | None:
    """Return what of a job the fault befalls: its first function, on its last unit; or a transfer that it waits for."""
    if kind in CODES:
        first = [execution for execution in job.executions if execution.stretch == 0]
        return first[-1] if first else None
    phases = [t for t in job.transfers if t.kind is not AccessKind.WRITE]
    spans = sorted({(t.begin, t.end) for t in job.transfers})
    if not phases or any(earlier[1] > later[0] for earlier, later in pairwise(spans)):
        return None  # phases that overlap: which operation notices is no matter of the schedule
    if kind is Kind.LATE_DMA:
        return [t for t in phases if t.begin == phases[0].begin][-1]
    return next(t for t in phases if t.begin == phases[-1].begin)


def consequence(injection: Injection, job: PlannedJob) -> PlannedJob:
    """Return what is left of a job that the fault befalls."""
    found = injection.befalls(job)
    if found is None:
        return job
    if injection.kind is Kind.HELD:
        return _held(job, found)
    calls = tuple(call for call in job.calls if call.begin < found.end)
    if injection.kind in CODES:
        return replace(
            job,
            transfers=tuple(t for t in job.transfers if t.begin < found.end),
            executions=tuple(
                replace(e, ends=injection.ends) if e is found else e for e in job.executions if e.stretch == 0
            ),
            calls=calls,
        )
    return replace(
        job,
        transfers=tuple(_remaining(injection, job, found)),
        executions=tuple(e for e in job.executions if e.begin < found.end),
        calls=calls,
    )


def _held(job: PlannedJob, found: PlannedExecution | PlannedTransfer) -> PlannedJob:
    """Return what is left of a job of which a transfer waits beyond its phase, or an execution does not begin."""
    return replace(
        job,
        transfers=tuple(takewhile(lambda t: t != found, (t for t in job.transfers if t.begin <= found.begin))),
        executions=tuple(takewhile(lambda e: e != found, (e for e in job.executions if e.begin <= found.begin))),
        calls=tuple(call for call in job.calls if call.begin <= found.begin),
    )


def _remaining(
    injection: Injection, job: PlannedJob, found: PlannedExecution | PlannedTransfer
) -> Iterator[PlannedTransfer]:
    """Yield the transfers that still begin: those before, and in the phase of a late one all, for it is the last."""
    for transfer in job.transfers:
        if transfer == found:
            late = injection.kind is Kind.LATE_DMA
            yield replace(transfer, end=transfer.end + injection.late + 1) if late else transfer
            return
        yield transfer


class Saboteur:
    """Does what is planned to go wrong in a run of the co-simulation; see `CoSimulation`, which gives it the memory."""

    memory: Memory

    def __init__(self, site: Site, jobs: Sequence[PlannedJob], injections: Sequence[Injection]) -> None:
        self._site = site
        self.zero, self.tick = 0, 1
        by_place = {(job.table.cycle, job.row): job for job in jobs}
        self._executions: list[tuple[PlannedExecution, Kind]] = []
        self._transfers: list[tuple[PlannedTransfer, Injection]] = []
        for injection in injections:
            found = injection.befalls(by_place[injection.cycle, injection.row])
            if found is None or injection.kind is Kind.HELD:
                continue
            if injection.kind in CODES:
                self._executions.append((found, injection.kind))  # type: ignore[arg-type] # by its kind
            else:
                self._transfers.append((found, injection))  # type: ignore[arg-type]

    def code(self, execution: Execution) -> bytes:
        """Return what a core executes instead of the function that it is about to begin; empty for the function."""
        hart, function = execution.hart, execution.function
        tick = (execution.begin - self.zero) // self.tick
        for entry in self._executions:
            planned, kind = entry
            if (planned.hart, planned.function) == (hart, function) and planned.begin <= tick < planned.end:
                self._executions.remove(entry)
                return code_of(kind, self._site, self._site.unit_of(hart))
        return b""

    def ended(self, execution: Execution) -> None:
        """Look at the end of an execution, which is before anything else happens to its scratchpads."""

    def fate(self, transfer: Transfer) -> tuple[int, bool] | None:
        """Return when a transfer that begins ends, and whether it fails; None if nothing befalls it."""
        tick = (transfer.begin - self.zero) // self.tick
        for entry in self._transfers:
            planned, injection = entry
            same = (planned.source, planned.target, planned.size) == (transfer.source, transfer.target, transfer.size)
            if same and planned.begin <= tick < planned.end:
                self._transfers.remove(entry)
                if injection.kind is Kind.DMA_ERROR:
                    return transfer.end, True
                return self.zero + (planned.end + injection.late) * self.tick + self.tick // 2, False
        return None


def assign(jobs: Sequence[PlannedJob], kinds: Sequence[Kind], site: Site, late: int, turn: int = 0) -> list[Injection]:
    """Return faults for every second job of each cycle, so that two times as many cycles as kinds have every pair.

    There are no more than the runtime can record. A further `turn` begins with other pairs.
    """
    found: list[Injection] = []
    begins = grouped((each.channel, (each.begin, job.table.cycle, job.row)) for job in jobs for each in job.transfers)
    for starts in begins.values():
        starts.sort()
    for job in jobs:
        place = job.table.cycle + turn
        if (job.row + place) % 2 or len(found) == site.faults.capacity:
            continue
        kind = kinds[(job.row // 2 + place // 2) % len(kinds)]
        injection = Injection(kind, job.table.cycle, job.row, late)
        if (kind not in CODES or code_of(kind, site, site.units[0])) and not _disturbs(injection, job, begins):
            found.append(injection)
    return found


def _disturbs(injection: Injection, job: PlannedJob, begins: dict[int, list[tuple[int, int, int]]]) -> bool:
    """Whether there is nothing to befall, or another job needs the channel of a transfer while it is late."""
    found = victim(injection.kind, job)
    if found is None or injection.kind is not Kind.LATE_DMA:
        return found is None
    starts = begins[getattr(found, "channel", 0)]
    first = bisect_left(starts, (found.end, 0, 0))
    after = takewhile(lambda start: start[0] <= found.end + injection.late + 1, starts[first:])
    return any((cycle, row) != (job.table.cycle, job.row) for _, cycle, row in after)


SPACE = 4
"""Tables from one delay to the next: what a delay of one hyperperiod changes is over by then."""


def delays(jobs: Sequence[PlannedJob], length: int, margin: int, turn: int = 0) -> list[Injection]:
    """Return a late transfer in every fourth table, as many ticks late as `length` at most, and what follows from each.

    `jobs` are those of the tables that may be changed; each `turn` takes other transfers and delays.
    """
    found: list[Injection] = []
    last = max((job.table.cycle for job in jobs), default=0)
    for number, cycle in enumerate(range(0, last - 1, SPACE)):
        choices = list(
            _choices([job for job in jobs if cycle - 1 <= job.table.cycle < cycle + SPACE - 1], cycle, length, margin)
        )
        found += choices[(turn * (last // SPACE + 1) + number) % len(choices)] if choices else []
    return found


def _choices(jobs: Sequence[PlannedJob], cycle: int, length: int, margin: int) -> Iterator[list[Injection]]:
    """Yield the late transfers of a table with their consequences: those that hold units first."""
    made = []
    for job in jobs:
        for late in _lasts(job) if job.table.cycle == cycle else ():
            others = [other for other in jobs if other is not job]
            ends = {late.end + length} | {end + margin for other in others for _, end in _spans(other)}
            for end in sorted(end for end in ends if late.end + margin <= end <= late.end + length):
                held = _held_by(others, late, end, margin)
                if held is not None:
                    own = Injection(Kind.LATE_DMA, cycle, job.row, end - late.end, late)
                    made.append([own, *held])
    yield from sorted(made, key=lambda one: (_by_unit(*one), len(one)), reverse=True)


def _by_unit(late: Injection, *held: Injection) -> int:
    """Return how many jobs wait for the unit, and not for the channel."""
    channel = getattr(late.stated, "channel", 0)
    return sum(getattr(one.stated, "channel", -1) != channel for one in held)


def _lasts(job: PlannedJob) -> list[PlannedTransfer]:
    """Return the last transfer of each phase, if none overlaps another."""
    if any(earlier[1] > later[0] for earlier, later in pairwise(_spans(job))):
        return []
    return list({t.begin: t for t in job.transfers}.values())


def _spans(job: PlannedJob) -> list[tuple[int, int]]:
    return sorted({(t.begin, t.end) for t in job.transfers})


def _held_by(jobs: Sequence[PlannedJob], late: PlannedTransfer, end: int, margin: int) -> list[Injection] | None:
    """Return which jobs a transfer holds that is complete after tick `end`; None if that hangs on a few ticks."""
    found = []
    for job in jobs:
        hits: list[PlannedTransfer | PlannedExecution] = [
            t for t in job.transfers if t.end > late.begin and (t.channel == late.channel or t.hart == late.hart)
        ]
        hits += [e for e in job.executions if e.end > late.begin and e.hart == late.hart]
        hits = sorted((hit for hit in hits if late.begin <= hit.begin <= end), key=lambda hit: hit.begin)
        if not hits:
            continue
        first = hits[0]
        decided = first.begin + margin if first in job.executions else first.end + margin
        if decided > end or not _lasts(job):
            return None
        found.append(Injection(Kind.HELD, job.table.cycle, job.row, 0, first))
    return found
