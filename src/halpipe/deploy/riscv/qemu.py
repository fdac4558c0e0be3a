"""The check of a RISC-V bundle by QEMU: the same program, on a machine with physical memory protection and a PDMA.

QEMU judges starts, isolation, and the order of everything by what the runtime records and prints at the end. It gives
all cores one clock, which every instruction of any core advances, so that execution times have to be modelled; and its
transfers take no time. See docs/explanation/co-simulation.md.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.deploy.base import Checked
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.check import CYCLES, refuse_disagreement, tolerance_of
from halpipe.deploy.riscv.comparison import CAUSES, FROM_EXPORT
from halpipe.deploy.riscv.cosimulation import MAGIC, PROGRAM, read_images
from halpipe.deploy.riscv.expectation import Expectation
from halpipe.deploy.riscv.recording import Flag, Kind, Recording, parse_recording
from halpipe.deploy.riscv.sequence import Request, played_tables
from halpipe.deploy.riscv.target import read_site
from halpipe.diagnostics import Findings, HalpipeError, sort_diagnostics
from halpipe.durations import ZERO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.base import CheckOptions, Target
    from halpipe.deploy.riscv.expectation import PlannedExecution, PlannedJob
    from halpipe.deploy.riscv.recording import Record
    from halpipe.deploy.riscv.sequence import Played
    from halpipe.deploy.riscv.target import Site
    from halpipe.diagnostics import Diagnostic

EMULATOR = "qemu-system-riscv64"
SECONDS = 120
"""How long one run may take."""

_MODELLED, _REPORT, _BY_SEMIHOSTING = 1, 1, 1
_NEEDS_TREE = "microchip-icicle-kit"
_OTHER = ["-display", "none", "-monitor", "none", "-serial", "stdio", "-no-reboot", "-icount", "shift=0,sleep=off"]
_HOSTING = ["-semihosting-config", "enable=on,target=native"]


@dataclass(frozen=True, slots=True)
class Leg:
    """One run: a mode for a hyperperiod, and where it may be left, the transition and the mode that it leads to."""

    first: str
    to: str
    tables: int


def check_by_qemu(target: Target, options: CheckOptions) -> Checked:
    """Play every mode and every transition under QEMU and hold what the runtime records against the schedule."""
    site = read_site(target.bundle)
    refuse_disagreement(target, site)
    emulator = _emulator(site)
    images = read_images(target.bundle, site)
    findings = Findings()
    counts: dict[str, int] = defaultdict(int)
    for leg in legs(target, options.cycles or CYCLES):
        index = {mode.name: i for i, mode in enumerate(target.schedule.modes)}
        request = index[leg.to] + 1 if leg.to else 0
        recording, state = _play(target, site, emulator, index[leg.first], request, leg.tables)
        requests = [Request(ZERO, leg.to)] if leg.to else []
        tables = played_tables(target.schedule, leg.first, requests, leg.tables, site.tick)
        expectation = Expectation(target.bundle, target.model, site, images)
        jobs = expectation.jobs(tables)
        findings.extend(expectation.findings.items)
        if state != 2:
            message = f"the runtime is in state {state} at the end"
            findings.add(codes.NOT_FINISHED(message, help="play the bundle with --engine cosim to see more"))
        findings.extend(_overrun(recording) or hold(site, recording, tables, jobs))
        counts["runs"] += 1
        counts["tables"] += len(tables)
        counts["jobs"] += len(jobs)
    help = "use --engine cosim for execution times and transfers"
    findings.add(codes.NOT_JUDGED("execution times are modelled, and transfers take no time", help=help))
    plural = "s" if counts["runs"] > 1 else ""
    played = f"{counts['tables']} tables and {counts['jobs']} jobs in {counts['runs']} run{plural}"
    lines = [
        f"QEMU, {target.bundle.path}: {played}",
        f"starts may be late by {tolerance_of(site)}, the time that the management core has for its operations",
    ]
    if not findings.has_errors:
        lines.append(f"{target.bundle.path}: every start is as scheduled, no job left its scratchpads")
    return Checked(diagnostics=tuple(sort_diagnostics(findings.items)), lines=tuple(lines))


def legs(target: Target, cycles: int) -> list[Leg]:
    """Return runs that play every transition, and every mode: requests can be made before the start only."""
    schedule = target.schedule
    found = [Leg(t.source, t.target, 2 + cycles) for t in schedule.transitions]
    seen = {name for leg in found for name in (leg.first, leg.to)}
    return found + [Leg(mode.name, "", cycles) for mode in schedule.modes if mode.name not in seen]


# ------------------------------------------------------------------------------------------------ playing


def _emulator(site: Site) -> str:
    if not site.qemu:
        help = "use --engine cosim, or export with a profile that has one: fu540, mpfs or virt"
        raise HalpipeError(codes.ENGINE_UNFIT(f'QEMU has no machine for profile "{site.profile}"', help=help))
    found = shutil.which(EMULATOR)
    if found is None:
        help = "apt-get install qemu-system-misc, or use --engine cosim"
        raise HalpipeError(codes.ENGINE_ABSENT(f"{EMULATOR} is not installed", help=help))
    return found


def _play(target: Target, site: Site, emulator: str, first: int, request: int, tables: int) -> tuple[Recording, int]:
    """Run QEMU once, and return what the runtime recorded and the state that it ended in."""
    words = [MAGIC, tables, _MODELLED, first, _REPORT, _BY_SEMIHOSTING, max(site.timebase // 1000, 1), 0, request]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        place.joinpath(PROGRAM).write_bytes(target.bundle.files[PROGRAM])
        place.joinpath("control").write_bytes(struct.pack(f"<{len(words)}Q", *words))
        control = f"loader,file={place / 'control'},addr={site.control:#x},force-raw=on"
        command = [emulator, *site.qemu, "-bios", "none", "-kernel", str(place / PROGRAM), "-device", control]
        if _NEEDS_TREE in site.qemu:
            tree = str(place / "tree")
            _start([emulator, "-machine", f"sifive_u,dumpdtb={tree}", "-smp", "5", "-display", "none"])
            command += ["-dtb", tree]
        printed = _start([*command, *_OTHER, *_HOSTING])
    return parse_recording(printed.decode("ascii", "replace"), _fault(printed))


def _start(command: list[str]) -> bytes:
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        help = "use --engine cosim to see why it does not come to an end"
        raise HalpipeError(codes.ENGINE_UNFIT(f"QEMU did not end within {SECONDS} s", help=help)) from None
    except OSError as failure:
        help = "apt-get install qemu-system-misc, or use --engine cosim"
        raise HalpipeError(codes.ENGINE_ABSENT(f"{command[0]} cannot be run: {failure.strerror}", help=help)) from None
    return done.stdout or done.stderr


def _fault(printed: bytes) -> HalpipeError:
    text = " ".join(printed.decode("ascii", "replace").split())[-200:]
    help = "use --engine cosim to see more"
    return HalpipeError(codes.ENGINE_UNFIT(f"QEMU gave no whole report; the last that it printed: {text}", help=help))


# ------------------------------------------------------------------------------------------------ comparing


def _overrun(recording: Recording) -> list[Diagnostic]:
    """Return that QEMU cannot tell, if jobs overran: there the instructions of all cores take time on one clock."""
    overrun = sum(bool(record.flags & Flag.OVERRUN) for record in recording.records if record.kind == Kind.STOP)
    if not overrun:
        return []
    message = (
        f"{overrun} executions overran in a run, where the instructions of all cores add up on one clock; whether they "
        "would on the board, and all that followed, QEMU cannot tell"
    )
    return [codes.ENGINE_UNFIT(message, help="use --engine cosim, which gives each core a clock of its own")]


def hold(site: Site, recording: Recording, tables: Sequence[Played], jobs: Sequence[PlannedJob]) -> list[Diagnostic]:
    """Hold what the runtime recorded against the plan, and return every deviation."""
    findings = Findings()
    begun = [r for r in recording.records if r.kind == Kind.TABLE and not r.flags & Flag.REFUSED]
    names = [site.tables[r.table].name if r.table < len(site.tables) else "?" for r in begun]
    if names != [table.name for table in tables]:
        message = f"plays {', '.join(names)}; it has to be {', '.join(table.name for table in tables)}"
        findings.add(codes.WRONG_TABLE(message, help=FROM_EXPORT))
    stops: dict[int, list[Record]] = defaultdict(list)
    copies: dict[int, list[Record]] = defaultdict(list)
    for record in recording.records:
        if record.kind == Kind.STOP:
            stops[record.cycle].append(record)
        elif record.kind in (Kind.COPY, Kind.DONE):
            copies[record.cycle].append(record)
    planned: dict[int, list[tuple[PlannedExecution, PlannedJob]]] = defaultdict(list)
    transfers: dict[int, int] = defaultdict(int)
    for job in jobs:
        planned[job.table.cycle] += [(execution, job) for execution in job.executions]
        transfers[job.table.cycle] += len(job.transfers)
    for table in tables:
        expected = sorted(planned[table.cycle], key=lambda entry: (entry[0].end, entry[0].begin))
        found = sorted(stops[table.cycle], key=lambda record: (record.time, record.begin))
        findings.extend(_stops(site, recording, expected, found))
        findings.extend(_copies(table, transfers[table.cycle], copies[table.cycle]))
    return findings.items


def _stops(
    site: Site, recording: Recording, expected: list[tuple[PlannedExecution, PlannedJob]], found: list[Record]
) -> list[Diagnostic]:
    """Compare the executions of one table, in the order of the instants at which they have to be over."""
    result = []
    for (_, job), _ in zip(expected[len(found) :], expected[len(found) :], strict=True):
        result.append(
            codes.MISSING_JOB("its execution was not recorded", at=job.job.at, path=job.path, help=FROM_EXPORT)
        )
    tolerance = tolerance_of(site) / site.tick
    for (execution, job), record in zip(expected, found, strict=False):
        unit = site.unit_of(execution.hart).name
        if record.flags & Flag.FAULT:
            message = f"{_cause(recording, record)} on {unit}"
            help = "correct the function: it may use its own variables and its stack only"
            result.append(codes.FAULT(message, at=job.job.at, path=job.path, help=help))
        elif record.flags:
            message = "was abandoned before its execution"
            result.append(codes.MISSING_JOB(message, at=job.job.at, path=job.path, help=FROM_EXPORT))
        elif not execution.begin <= record.begin <= execution.begin + tolerance:
            seen, due = (site.tick * tick for tick in (record.begin, execution.begin))
            message = f"begins on {unit} at {seen}, scheduled is {due}"
            result.append(codes.WRONG_INSTANT(message, at=job.job.at, path=job.path, help=FROM_EXPORT))
    return result


def _cause(recording: Recording, record: Record) -> str:
    same = (
        a for a in recording.abandoned if (a.cycle, a.table, a.release) == (record.cycle, record.table, record.release)
    )
    abandoned = next(same, None)
    if abandoned is None:
        return "the job trapped"
    what = CAUSES.get(abandoned.cause, f"exception {abandoned.cause}")
    return f"{what} ({abandoned.tval:#x}), pc {abandoned.epc:#x}"


def _copies(table: Played, expected: int, records: list[Record]) -> list[Diagnostic]:
    """Compare the transfers of one table: all of them, each in time."""
    result = []
    started = sum(record.kind == Kind.COPY and not record.flags for record in records)
    path = f'cycle {table.cycle} ("{table.name}")'
    if started != expected:
        message = f"{started} transfers were started, {expected} are planned"
        result.append(codes.MISSING_TRANSFER(message, path=path, help=FROM_EXPORT))
    late = sum(bool(record.flags & Flag.LATE) for record in records)
    if late:
        message = f"{late} transfers were not complete in time"
        result.append(codes.TRANSFER_OUTSIDE_PHASE(message, path=path, help=FROM_EXPORT))
    return result
