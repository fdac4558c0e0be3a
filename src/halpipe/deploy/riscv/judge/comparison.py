"""Comparison of a run with its plan: every deviation with job, instant, expected and observed value."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Findings, about, named
from halpipe.core.grouping import grouped
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.devices import TRANSACTION, UNKNOWN, Transfer
from halpipe.deploy.riscv.run.observation import Execution, Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer

FROM_EXPORT = "export the bundle again; if it stays, the exporter or the runtime is at fault: report it"
_MORE_TIME = "give the phase more time: `halpipe deploy prepare` with the profile that tells how fast the DMA engine is"
_MORE_BANDWIDTH = (
    "its regulator, or other channels, took the time: give the phase more time or its unit a larger share, "
    "or let the platform guarantee what the DMA engine moves"
)
CAUSES = {
    0: "instruction address misaligned",
    1: "fetch from memory that is not its own",
    2: "illegal instruction",
    3: "breakpoint",
    4: "misaligned load",
    5: "load from memory that is not its own",
    6: "misaligned store",
    7: "store to memory that is not its own",
    8: "system call",
    11: "system call",
}


@dataclass(slots=True)
class Seen:
    """A planned job, and what was seen of it, by position; None for what did not happen."""

    planned: PlannedJob
    transfers: list[Transfer | None] = field(default_factory=list)
    executions: list[Execution | None] = field(default_factory=list)

    @property
    def _moved(self) -> list[Transfer]:
        """Its transfers, but for the copies of a LET, which are not made in its time."""
        return [t for p, t in zip(self.planned.transfers, self.transfers, strict=True) if t and not p.is_copy]

    @property
    def begin(self) -> int | None:
        """Begin of the first part, in units."""
        begins = [t.begin for t in self._moved] + [e.begin for e in self.executions if e]
        return min(begins, default=None)

    @property
    def end(self) -> int | None:
        """End of the last part, in units."""
        ends = [t.end for t in self._moved] + [e.left for e in self.executions if e]
        return max(ends, default=None)


class Comparison:
    """Matches a run with its plan and collects the deviations; `tolerance` is the lateness that is allowed."""

    def __init__(self, run: Run, jobs: Sequence[PlannedJob], tolerance: Duration) -> None:
        self.findings = Findings()
        self.jobs = [Seen(job, [None] * len(job.transfers), [None] * len(job.executions)) for job in jobs]
        self._run = run
        self._tolerance = int(tolerance.in_unit("s") * run.rate)
        self._zero = run.zero or 0
        self._deviations: dict[tuple[Code, str, int, str], list[tuple[PlannedJob, str]]] = defaultdict(list)
        self._match_executions()
        self._match_transfers()
        self._owners = {id(e): seen.planned for seen in self.jobs for e in seen.executions if e is not None}
        for seen in self.jobs:
            self._judge(seen)
        self._exclusion()
        self._data()
        self._faults()
        self._summarise()

    # ------------------------------------------------------------------------------------------ matching

    def _match_executions(self) -> None:
        """Give every execution to the planned one of its core that begins nearest."""
        planned: dict[int, list[tuple[int, Seen, int]]] = defaultdict(list)
        for seen in self.jobs:
            for i, plan in enumerate(seen.planned.executions):
                planned[plan.hart].append((self._at(plan.begin), seen, i))
        for expected in planned.values():
            expected.sort(key=lambda entry: entry[0])
        for execution in self._run.executions:
            nearest = _nearest(planned[execution.hart], execution.due or execution.begin)
            if nearest is None or not self._take(execution, nearest[1], nearest[2]):
                self._foreign(execution, nearest)

    def _take(self, execution: Execution, seen: Seen, position: int) -> bool:
        image, job = execution.image, seen.planned.job
        fits = seen.planned.executions[position].function == execution.function
        if image is not None:
            fits = fits and (image.site.task, image.site.version) == (job.task, job.version)
        if not fits or seen.executions[position] is not None:
            return False
        seen.executions[position] = execution
        return True

    def _foreign(self, execution: Execution, nearest: tuple[int, Seen, int] | None) -> None:
        name = self._unit(execution.hart)
        what = f'task "{execution.image.site.task}"' if execution.image else f"a function at {execution.function:#x}"
        message = f"{name} executes {what} at {self._run.since(execution.begin)}"
        if nearest is not None:
            message += f"; the next that is planned there is {nearest[1].planned.path} at {self._run.since(nearest[0])}"
        self.findings.add(codes.FOREIGN_JOB(message, path=about(unit=name), help=FROM_EXPORT))

    def _match_transfers(self) -> None:
        planned: dict[tuple[int, int, int], list[tuple[int, Seen, int]]] = defaultdict(list)
        for seen in self.jobs:
            for i, plan in enumerate(seen.planned.transfers):
                planned[plan.source, plan.target, plan.size].append((self._at(plan.begin), seen, i))
        for expected in planned.values():
            expected.sort(key=lambda entry: entry[0])
        for transfer in self._run.recorder.transfers:
            if transfer.begin < self._zero:
                continue
            nearest = _nearest(planned[transfer.source, transfer.target, transfer.size], transfer.begin)
            if nearest is None or nearest[1].transfers[nearest[2]] is not None:
                source, target = self._place(transfer.source), self._place(transfer.target)
                message = f"{transfer.size} bytes from {source} to {target} at {self._run.since(transfer.begin)}"
                path = self._channel(transfer.channel)
                self.findings.add(codes.FOREIGN_TRANSFER(message, path=path, help=FROM_EXPORT))
            else:
                nearest[1].transfers[nearest[2]] = transfer

    # ------------------------------------------------------------------------------------------ one job

    def _judge(self, seen: Seen) -> None:
        absent: list[tuple[int, str, bool]] = []
        for planned, transfer in zip(seen.planned.transfers, seen.transfers, strict=True):
            if transfer is None:
                absent.append((planned.begin, f"the {planned.kind} of {planned.what}", True))
            else:
                self._judge_transfer(seen, planned, transfer)
        for plan, execution in zip(seen.planned.executions, seen.executions, strict=True):
            if execution is None:
                absent.append((plan.begin, "its execution", False))
            else:
                self._judge_execution(seen, plan, execution)
        self._judge_phases(seen)
        if absent:
            self._absent(seen, sorted(absent, key=lambda entry: entry[0]))

    def _absent(self, seen: Seen, absent: list[tuple[int, str, bool]]) -> None:
        """Report what did not happen; what follows from it in the same job is only counted."""
        begin, what, is_transfer = absent[0]
        message = f"{what} at {self._run.since(self._at(begin))} did not happen"
        if len(absent) > 1:
            message += f", nor {len(absent) - 1} more of the job"
        reason = self._run.reason(seen.planned)
        ended = [e.outcome for e in seen.executions if e is not None and e.outcome is not Outcome.RETURNED]
        if reason:
            message += f"; the runtime recorded: {reason}"
        elif ended:  # the ring of records is finite
            reason = f"its execution ended by {ended[0]}"
            message += f"; {reason}"
        code = codes.MISSING_TRANSFER if is_transfer else codes.MISSING_JOB
        self._report(code, seen.planned, message, _remedy(reason))

    def _judge_transfer(self, seen: Seen, planned: PlannedTransfer, transfer: Transfer) -> None:
        begin, end = self._at(planned.begin), self._at(planned.end)
        same = transfer.channel in (planned.channel, UNKNOWN)
        if begin <= transfer.begin and transfer.end <= end and same and transfer.transaction == TRANSACTION:
            return
        ran = f"{self._run.since(transfer.begin)} to {self._run.since(transfer.end)}"
        phase = f"{self._run.since(begin)} to {self._run.since(end)}"
        where = "" if same else f" on {self._channel(transfer.channel)}"
        what = f"the {planned.kind} of {planned.what} ({planned.size} bytes)"
        held = f"; it was held back for {self._run.length(transfer.held)}" if transfer.held else ""
        if transfer.transaction != TRANSACTION:
            held += f"; it moves {transfer.transaction} bytes at a time, the bandwidth is that of {TRANSACTION}"
        message = f"{what} ran from {ran}{where}, its phase is {phase}{held}"
        help = _MORE_BANDWIDTH if transfer.held else _MORE_TIME
        self._report(codes.TRANSFER_OUTSIDE_PHASE, seen.planned, message, help)

    def _judge_phases(self, seen: Seen) -> None:
        """Hold the first transfer of every phase to the phase's beginning; the others follow as they can."""
        pairs = zip(seen.planned.transfers, seen.transfers, strict=True)
        begins = grouped(((planned.begin, planned.kind), moved.begin) for planned, moved in pairs if moved is not None)
        for (tick, kind), found in begins.items():
            first, begin = min(found), self._at(tick)
            if first > begin + self._tolerance:
                message = f"its {kind} phase begins at {self._run.since(first)}, scheduled is {self._run.since(begin)}"
                self._report(codes.WRONG_INSTANT, seen.planned, message, FROM_EXPORT)

    def _judge_execution(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        begin, unit = self._at(planned.begin), self._unit(planned.hart)
        late = execution.begin - begin
        if late > self._tolerance:
            late -= self._excused(planned.hart, begin, execution.begin)
        if execution.begin < begin or late > self._tolerance:
            message = f"begins on {unit} at {self._run.since(execution.begin)}, scheduled is {self._run.since(begin)}"
            self._report(codes.WRONG_INSTANT, seen.planned, message, FROM_EXPORT)
        self._judge_call(seen, planned, execution)
        if Outcome.RETURNED not in planned.ends:
            self._judge_failure(seen, planned, execution)
        elif execution.outcome is not Outcome.FAULT:  # that is reported with its cause
            self._judge_end(seen, planned, execution)

    def _excused(self, hart: int, begin: int, end: int) -> int:
        """Return how much of a late start is no fault of the runtime."""
        return 0

    def _judge_end(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        unit, end = self._unit(planned.hart), self._at(planned.end)
        budget = self._run.length(end - self._at(planned.begin))
        if execution.outcome is not Outcome.RETURNED:
            stopped = (
                f"and was stopped at {self._run.since(execution.left)}" if execution.left else "when the run ended"
            )
            message = f"had not returned on {unit} after {budget}, its time in the schedule, {stopped}"
        elif execution.left > end:
            message = (
                f"returned on {unit} at {self._run.since(execution.left)}, its time was over at {self._run.since(end)}"
            )
        else:
            return
        help = "raise the WCET of the version, or make its function do less"
        self._report(codes.OVERRUN, seen.planned, message, help)

    def _judge_failure(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        """Hold a function that was made to fail against what has to become of it."""
        unit, end = self._unit(planned.hart), self._at(planned.end)
        in_time = execution.left <= end + self._tolerance
        if execution.outcome is Outcome.OVERRUN:
            in_time = in_time and execution.left >= end  # until then its time is its own
        if execution.outcome in planned.ends and in_time:
            return
        stopped = f"it {execution.outcome} on {unit} at {self._run.since(execution.left)}"
        if execution.outcome is Outcome.OPEN:
            stopped = f"it was never stopped on {unit}"
        message = f"was made to fail; {stopped}, its time was over at {self._run.since(end)}"
        help = "look at the monitor and its timer: on the board this job would not be contained"
        self._report(codes.NOT_CONTAINED, seen.planned, message, help)

    def _judge_call(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        """Hold what a function finds when it begins against what it is promised: its arguments and its stack."""
        unit = self._run.site.unit_of(planned.hart)
        wrong = []
        if (execution.rank, execution.ranks) != (planned.rank, planned.ranks):
            wrong.append(f"rank {execution.rank} of {execution.ranks} members, it is {planned.rank} of {planned.ranks}")
        if execution.stack != unit.dspm.base + self._run.site.stack:
            stack = unit.dspm.base + self._run.site.stack
            wrong.append(f"a stack from {execution.stack:#x} down, it has to be from {stack:#x}")
        if execution.deadline != self._at(planned.end) // self._run.tick:
            late = execution.deadline - self._at(planned.end) // self._run.tick
            wrong.append(f"a timer that ends it {late} ticks after its time" if late < 1 << 62 else "no timer")
        wrong += execution.unclean
        for what in wrong:
            self._report(codes.WRONG_CALL, seen.planned, f"gets {what} on {unit.name}", FROM_EXPORT)

    # ------------------------------------------------------------------------------------------ everything together

    def _exclusion(self) -> None:
        recorder = self._run.recorder
        by_channel = grouped((transfer.channel, transfer) for transfer in recorder.transfers)
        for channel, transfers in sorted(by_channel.items()):
            ordered = sorted(transfers, key=lambda t: (t.begin, t.end))
            for earlier, later in pairwise(ordered):
                if later.begin < earlier.end:
                    message = (
                        f"the transfer of {later.size} bytes at {self._run.since(later.begin)} begins before that of "
                        f"{earlier.size} bytes is over at {self._run.since(earlier.end)}"
                    )
                    path = self._channel(channel)
                    self.findings.add(codes.TRANSFERS_TOGETHER(message, path=path, help=FROM_EXPORT))
        for transfer, execution in recorder.disturbances:
            message = (
                f"a transfer of {transfer.size} bytes from {self._place(transfer.source)} to "
                f"{self._place(transfer.target)} at {self._run.since(transfer.begin)} touches it while it executes"
            )
            path = about(unit=self._unit(execution.hart))
            self.findings.add(codes.TRANSFERS_TOGETHER(message, path=path, help=FROM_EXPORT))

    def _data(self) -> None:
        for execution in self._run.executions:
            for address, size in execution.wrong:
                planned = self._owners.get(id(execution))
                message = (
                    f"{size} bytes at {self._place(address)} are not those that were loaded, read or cleared for it "
                    f"when it begins at {self._run.since(execution.entered)}"
                )
                help = "look for what else writes there: another transfer, or a core that is not confined"
                self._report(codes.WRONG_DATA, planned, message, help, self._unit(execution.hart))
        for transfer, buffer in self._run.recorder.stale:
            message = f"was changed outside of any write phase before it is read at {self._run.since(transfer.begin)}"
            help = (
                "look for what writes to main memory: a core that is not confined, or another buffer that is too small"
            )
            self.findings.add(codes.WRONG_DATA(message, path=named("buffer", buffer), help=help))

    def _faults(self) -> None:
        meant = {
            id(execution)
            for seen in self.jobs
            for plan, execution in zip(seen.planned.executions, seen.executions, strict=True)
            if Outcome.FAULT in plan.ends
        }
        for trap in self._run.faults:
            if id(trap.execution) in meant or trap.now < self._zero:  # a calibrating runtime ends its loops so
                continue
            planned = self._owners.get(id(trap.execution))
            what = CAUSES.get(trap.cause, f"exception {trap.cause}")
            where = f" ({self._place(trap.value)})" if trap.cause in (1, 5, 7) else ""
            name = self._unit(trap.hart)
            message = f"{what}{where} at {self._run.since(trap.now)} on {name}, pc {trap.pc:#x}"
            help = "correct the function: it may use its own variables and its stack only"
            self._report(codes.FAULT, planned, message, help, name)

    # ------------------------------------------------------------------------------------------ reporting

    def _report(self, code: Code, job: PlannedJob | None, message: str, help: str, unit: str = "") -> None:
        """Collect a deviation of a job; the same one in other cycles of the table is only counted."""
        if job is None:
            self.findings.add(code(message, path=about(unit=unit), help=help))
            return
        self._deviations[code, job.table.name, job.row, help].append((job, message))

    def _summarise(self) -> None:
        for (code, _, _, help), found in self._deviations.items():
            job, message = found[0]
            others = len({other.table.cycle for other, _ in found} - {job.table.cycle})
            more = f"; likewise in {others} more cycle{'s' if others > 1 else ''}" if others else ""
            self.findings.add(
                code(f"cycle {job.table.cycle}: {message}{more}", at=job.job.at, path=job.path, help=help)
            )

    # ------------------------------------------------------------------------------------------ names

    def _at(self, tick: int) -> int:
        return self._zero + tick * self._run.tick

    def _unit(self, hart: int) -> str:
        return self._run.site.unit_of(hart).name if hart else "the management core"

    def _channel(self, channel: int) -> str:
        names = [name for name, number in self._run.site.channels.items() if number == channel]
        return f'resource "{names[0]}"' if names else f"channel {channel}"

    def _place(self, address: int) -> str:
        for name, area in self._run.site.buffers.items():
            if area.base <= address < area.end:
                return f'buffer "{name}"' + (f" + {address - area.base}" if address > area.base else "")
        for unit in self._run.site.units:
            for kind, area in (("code", unit.ispm), ("data", unit.dspm)):
                if area.base <= address < area.end:
                    return f"{kind} of {unit.name} ({address:#x})"
        return f"{address:#x}"


def _nearest(planned: Sequence[tuple[int, Seen, int]], instant: int) -> tuple[int, Seen, int] | None:
    """Return the entry whose instant is nearest, the earlier one of two."""
    position = bisect_left(planned, instant, key=lambda entry: entry[0])
    around = planned[max(position - 1, 0) : position + 1]
    return min(around, key=lambda entry: abs(entry[0] - instant), default=None)


def _remedy(reason: str) -> str:
    if reason.startswith("transfer"):
        return _MORE_TIME
    return FROM_EXPORT if not reason else "see what is reported of the job, or of the one before it on the unit"
