"""Comparison of the runtime's record of a QEMU run with the plan.

All cores have one clock there, which every instruction of any core advances. So a core may begin late because others
compute at that time. Their computing is recorded, too, and excuses exactly as much lateness as it covers.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.check import tolerance_of
from halpipe.deploy.riscv.judge.comparison import CAUSES, FROM_EXPORT
from halpipe.deploy.riscv.run.observation import Outcome
from halpipe.deploy.riscv.run.recording import Flag, Kind, Recording, meaning
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer
    from halpipe.deploy.riscv.run.recording import Record
    from halpipe.deploy.riscv.run.sequence import Played
    from halpipe.deploy.riscv.target import Site

INSTRUCTIONS_PER_SECOND = 10**9
"""Of all cores together, on QEMU's one clock."""

_FLAGS = {Outcome.FAULT: Flag.FAULT, Outcome.OVERRUN: Flag.OVERRUN, Outcome.SKIPPED: Flag.SKIPPED}


@dataclass(slots=True)
class Held:
    """The deviations, and how many starts were late because others computed."""

    findings: list[Diagnostic] = field(default_factory=list)
    delayed: int = 0


def hold(
    site: Site,
    recording: Recording,
    tables: Sequence[Played],
    jobs: Sequence[PlannedJob],
    starved: Collection[tuple[int, int]] = (),
) -> Held:
    """Hold what the runtime recorded against the plan, and return every deviation.

    The jobs (cycle and row) that are `starved` are not judged, for others take all of the one clock meanwhile.
    """
    return _Judge(site, recording, starved).judge(tables, jobs)


class _Judge:
    """Matches records with the plan: those of each core, and of each channel's kind, are in the order of time."""

    def __init__(self, site: Site, recording: Recording, starved: Collection[tuple[int, int]]) -> None:
        self._site, self._recording, self._starved = site, recording, starved
        self._tolerance = tolerance_of(site) / site.tick
        self._findings = Findings()
        self._held = Held()
        self._computing: dict[int, list[tuple[int, int]]] = defaultdict(list)

    def judge(self, tables: Sequence[Played], jobs: Sequence[PlannedJob]) -> Held:
        self._tables(tables)
        stops: dict[tuple[int, int], list[Record]] = defaultdict(list)
        copies: dict[tuple[int, int], list[Record]] = defaultdict(list)
        for record in self._recording.records:
            if record.kind == Kind.STOP:
                stops[record.cycle, record.hart].append(record)
            elif record.kind == Kind.COPY:
                copies[record.cycle, record.hart].append(record)
        executions: dict[tuple[int, int], list[tuple[PlannedExecution, PlannedJob]]] = defaultdict(list)
        transfers: dict[tuple[int, int], list[tuple[PlannedTransfer, PlannedJob]]] = defaultdict(list)
        for job in jobs:
            for execution in job.executions:
                executions[job.table.cycle, execution.hart].append((execution, job))
            for transfer in job.transfers:
                transfers[job.table.cycle, transfer.hart].append((transfer, job))
        pairs = []
        for key, expected in executions.items():
            expected.sort(key=lambda entry: entry[0].begin)
            pairs += [*zip(expected, self._first(stops[key], expected), strict=True)]
        self._collect(pairs)
        for (execution, job), found in pairs:
            self._execution(execution, job, found)
        for key, moved in transfers.items():
            moved.sort(key=lambda entry: entry[0].begin)
            self._transfers(moved, copies[key])
        for key in copies.keys() - transfers.keys():
            self._transfers([], copies[key])
        self._strangers(stops, executions)
        self._calls(jobs)
        self._held.findings = self._findings.items
        return self._held

    def _tables(self, tables: Sequence[Played]) -> None:
        begun = [r for r in self._recording.records if r.kind == Kind.TABLE and not r.flags & Flag.REFUSED]
        known = self._site.tables
        names = [known[r.table].name if r.table < len(known) else "?" for r in begun]
        if names != [table.name for table in tables]:
            message = f"plays {', '.join(names)}; it has to be {', '.join(table.name for table in tables)}"
            self._findings.add(codes.WRONG_TABLE(message, help=FROM_EXPORT))
        for record, table in zip(begun, tables, strict=False):
            if self._site.tick * record.begin != table.start:
                message = f'"{table.name}" begins at {self._site.tick * record.begin}, it has to be at {table.start}'
                self._findings.add(codes.WRONG_TABLE(message, path=f"cycle {table.cycle}", help=FROM_EXPORT))

    def _calls(self, jobs: Sequence[PlannedJob]) -> None:
        """Hold the calls of drivers to their jobs: each was made, at its instant or later, and no others."""
        made: Counter[tuple[int, int, int]] = Counter()
        for r in self._recording.records:
            if r.kind in (Kind.INPUT, Kind.OUTPUT) and not r.flags:
                made[r.cycle, r.hart, r.kind] += 1
        for job in jobs:
            for call in job.calls:
                kind = Kind.INPUT if call.driver.kind is AccessKind.READ else Kind.OUTPUT
                made[job.table.cycle, call.hart, kind] -= 1
        excused = {
            (job.table.cycle, call.hart)
            for job in jobs
            for call in job.calls
            if (job.table.cycle, job.row) in self._starved
        }
        for (cycle, hart, _), number in sorted(made.items()):
            if number and (cycle, hart) not in excused:
                what = f"{abs(number)} calls of drivers for {self._site.unit_of(hart).name} "
                what += "were recorded that are not planned" if number > 0 else "were not recorded"
                self._findings.add(codes.WRONG_DRIVER(what, path=f"cycle {cycle}", help=FROM_EXPORT))

    def _first(self, records: list[Record], planned: Sequence[object]) -> list[Record | None]:
        """Return as many records as are planned, None for those that lack."""
        lacking = max(len(planned) - len(records), 0)
        return [*records[: len(planned)], *[None] * lacking]

    def _strangers(
        self,
        found: dict[tuple[int, int], list[Record]],
        planned: dict[tuple[int, int], list[tuple[PlannedExecution, PlannedJob]]],
    ) -> None:
        more = sum(max(len(records) - len(planned.get(key, ())), 0) for key, records in found.items())
        if more:
            message = f"{more} executions were recorded that are not planned"
            self._findings.add(codes.FOREIGN_JOB(message, help=FROM_EXPORT))

    def _collect(self, pairs: Iterable[tuple[tuple[PlannedExecution, PlannedJob], Record | None]]) -> None:
        """Note when each core computed; one that was not stopped yet when its time was over computed all the time."""
        for (execution, _), record in pairs:
            if record is not None and not record.flags & Flag.SKIPPED:
                span = (record.begin, record.end) if record.end else (execution.begin, record.time)
                self._computing[execution.hart].append(span)

    def _others(self, hart: int, begin: int, end: int) -> int:
        """Return how many ticks of [begin, end] other cores computed."""
        spans = sorted(
            (max(low, begin), min(high + 1, end))
            for other, found in self._computing.items()
            if other != hart
            for low, high in found
            if low < end and high + 1 > begin
        )
        covered, front = 0, begin
        for low, high in spans:
            covered += max(high - max(low, front), 0)
            front = max(front, high)
        return covered

    # ------------------------------------------------------------------------------------------ one job

    def _execution(self, execution: PlannedExecution, job: PlannedJob, record: Record | None) -> None:
        unit = self._site.unit_of(execution.hart).name
        if record is None:
            self._add(codes.MISSING_JOB("its execution was not recorded", help=FROM_EXPORT), job)
            return
        expected = {_FLAGS.get(end, Flag(0)) for end in execution.ends}
        if record.flags in expected:
            if not record.flags & Flag.SKIPPED and record.end:
                self._start(execution, job, record, unit)
        elif Outcome.RETURNED not in execution.ends:
            said = meaning(record.flags) or "nothing"
            message = f"was made to fail on {unit}; the runtime recorded: {said}"
            self._add(codes.NOT_CONTAINED(message, help=FROM_EXPORT), job)
        elif record.flags & Flag.FAULT:
            message = f"{self._cause(record)} on {unit}"
            help = "correct the function: it may use its own variables and its stack only"
            self._add(codes.FAULT(message, help=help), job)
        elif record.flags & Flag.OVERRUN:
            self._overrun(execution, job, unit)
        else:
            message = f"was abandoned before its execution on {unit}" + self._reason(record)
            self._add(codes.MISSING_JOB(message, help="see what is reported of the job before it"), job)

    def _start(self, execution: PlannedExecution, job: PlannedJob, record: Record, unit: str) -> None:
        late = record.begin - execution.begin
        if late > self._tolerance:
            late -= self._others(execution.hart, execution.begin, record.begin)
            self._held.delayed += late <= self._tolerance
        if not record.begin - execution.begin >= 0 or late > self._tolerance:
            seen, due = (self._site.tick * tick for tick in (record.begin, execution.begin))
            message = f"begins on {unit} at {seen}, scheduled is {due}"
            self._add(codes.WRONG_INSTANT(message, help=FROM_EXPORT), job)

    def _overrun(self, execution: PlannedExecution, job: PlannedJob, unit: str) -> None:
        """Report an overrun, if the job had as much of the one clock as it has of its own on the board."""
        ticks = execution.end - execution.begin
        others = self._others(execution.hart, execution.begin, execution.end)
        had = (ticks - others) * Fraction(INSTRUCTIONS_PER_SECOND, self._site.timebase)
        needs = ticks * Fraction(self._site.clock, self._site.timebase)
        if had >= needs or others <= self._tolerance:
            message = f"had not returned on {unit} after {self._site.tick * ticks}, its time in the schedule"
            help = "raise the WCET of the version, or make its function do less"
            self._add(codes.OVERRUN(message, help=help), job)
            return
        message = (
            f"overran on {unit} where other cores computed in {self._site.tick * others} of its "
            f"{self._site.tick * ticks} on the one clock; whether it would on the board, QEMU cannot tell"
        )
        self._add(codes.ENGINE_UNFIT(message, help="use --engine cosim, which gives each core a clock of its own"), job)

    def _transfers(self, planned: list[tuple[PlannedTransfer, PlannedJob]], records: list[Record]) -> None:
        """Hold the transfers of a core in a table against its plan: each started within its phase, and no others."""
        started = sorted((record for record in records if not record.flags), key=lambda record: record.time)
        for transfer, job in planned:
            record = next((r for r in started if transfer.begin <= r.time <= transfer.end), None)
            if record is not None:
                started.remove(record)
                continue
            message = f"the {transfer.kind} of {transfer.what} at {self._site.tick * transfer.begin} was not started"
            reason = self._reason_of(records, transfer)
            self._add(codes.MISSING_TRANSFER(message + reason, help="see what else is reported of the job"), job)
        for record in started:
            unit = self._site.unit_of(record.hart).name
            message = f"a transfer for {unit} was started at {self._site.tick * record.time}, where none is planned"
            self._findings.add(codes.FOREIGN_TRANSFER(message, help=FROM_EXPORT))

    # ------------------------------------------------------------------------------------------ words

    def _add(self, found: Diagnostic, job: PlannedJob) -> None:
        """Report something of a job; the same of other cycles is left out."""
        placed = found.placed(job.job.at, job.path)
        if (job.table.cycle, job.row) in self._starved:
            return
        if not any((d.code, d.path) == (placed.code, placed.path) for d in self._findings.items):
            self._findings.add(placed)

    def _reason(self, record: Record) -> str:
        same = (record.cycle, record.table, record.release)
        found = (a for a in self._recording.abandoned if (a.cycle, a.table, a.release) == same)
        reason = next((meaning(a.flags) for a in found), "")
        return f"; the runtime recorded: {reason}" if reason else ""

    def _reason_of(self, records: Sequence[Record], transfer: PlannedTransfer) -> str:
        skipped = [r for r in records if r.flags and transfer.begin <= r.time]
        return self._reason(skipped[0]) if skipped else ""

    def _cause(self, record: Record) -> str:
        same = (record.cycle, record.table, record.release)
        found = next((a for a in self._recording.abandoned if (a.cycle, a.table, a.release) == same), None)
        if found is None:
            return "the job trapped"
        what = CAUSES.get(found.cause, f"exception {found.cause}")
        return f"{what} ({found.tval:#x}), pc {found.epc:#x}"
