"""Faults under QEMU: functions are replaced in the program itself, so all jobs of an image fail in the same way."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.elf import offset_of
from halpipe.deploy.riscv.judge.containment import FROM_RUNTIME, prefixed
from halpipe.deploy.riscv.judge.records import hold
from halpipe.deploy.riscv.run.cosimulation import read_images, silent
from halpipe.deploy.riscv.run.emulator import is_over, play
from halpipe.deploy.riscv.run.expectation import Expectation
from halpipe.deploy.riscv.run.injection import CODES, Injection, Kind, code_of
from halpipe.deploy.riscv.run.observation import Outcome
from halpipe.deploy.riscv.run.sequence import played_tables
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.run.emulator import Played
    from halpipe.deploy.riscv.run.expectation import Image, PlannedJob
    from halpipe.deploy.riscv.target import Site

CYCLES = 2
MOST = 60
"""Runs at most; each takes a few tenths of a second."""

Key = tuple[str, str, str]
"""An image: task, version and unit."""


@dataclass(slots=True)
class Injected:
    """What was injected: how often each kind, into how many images, and what did not fit."""

    kinds: Counter[Kind] = field(default_factory=Counter)
    images: set[Key] = field(default_factory=set)
    missed: int = 0
    findings: list[Diagnostic] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        """Yield the lines of the summary."""
        if self.kinds:
            yield f"injected: {self.kinds.total()} faults of {len(self.kinds)} kinds into {len(self.images)} images"
            if not any(found.is_error for found in self.findings):
                yield "each was stopped in its time and recorded, and its writes did not happen"


def inject(target: Target, site: Site, emulator: str, *, everything: bool) -> Injected:
    """Let every second image fail, in each way in turn; in the first mode with jobs, or in all modes."""
    found = Injected()
    modes = [i for i, mode in enumerate(target.schedule.modes) if mode.jobs]
    half = [2 * i + i % 2 for i in range(len(CODES))]  # every kind, in the one half of the images or the other
    turns = range(2 * len(CODES)) if everything else half
    runs = [(mode, turn) for turn in turns for mode in (modes if everything else modes[:1])]
    played = runs[:MOST]
    images = read_images(target.bundle, site)
    for mode, turn in played:
        _run(target, site, emulator, images, mode, turn, found)
        if any(each.is_error for each in found.findings):
            return found
    found.missed += len(runs) - len(played)
    if found.missed:
        message = f"{found.missed} faults were not injected: their functions are too short, or there would be more runs"
        found.findings.append(codes.NOT_INJECTED(message, help="--engine cosim injects them"))
    return found


def _run(
    target: Target,
    site: Site,
    emulator: str,
    images: Mapping[Key, Image],
    mode: int,
    turn: int,
    found: Injected,
) -> None:
    name = target.schedule.modes[mode].name
    tables = played_tables(target.schedule, name, (), CYCLES, site.tick)
    jobs = Expectation(target.bundle, target.model, site, images).jobs(tables)
    program = bytearray(silent(target))
    failing: dict[Key, Kind] = {}
    keys = sorted({(job.job.task, job.job.version, job.job.units[-1]) for job in jobs if job.executions})
    for i, key in enumerate(keys):
        kind = CODES[(i // 2 + turn // 2) % len(CODES)]
        if (i + turn) % 2 == 0:
            if _patch(program, site, images[key], kind):
                failing[key] = kind
            else:
                found.missed += 1
    if not failing:
        return
    found.kinds += Counter(failing.values())
    found.images |= set(failing)
    played = play(bytes(program), site, emulator, mode, 0, CYCLES, health=False)
    failed = [_fail(job, failing, site) for job in jobs]
    held = hold(site, played.recording, tables, failed, _starved(failed))
    findings = [*is_over(played), *held.findings]
    findings += _unwritten(site, jobs, failing, played)
    told = {(d.code, d.path) for d in found.findings}
    found.findings += [d for d in prefixed(findings) if (d.code, d.path) not in told]


def _patch(program: bytearray, site: Site, image: Image, kind: Kind) -> bool:
    """Put a fault in the place of a function, where it is stored; return whether it fits there."""
    unit = site.unit_of(image.hart)
    entry = image.site.entries[0]
    segment = next((s for s in image.program.segments if s.target <= entry < s.target + len(s.data)), None)
    code = code_of(kind, site, unit)
    if segment is None or not code:
        return False
    if kind is Kind.SPIN:
        code = code[-8:-4] + (0xFFDFF06F).to_bytes(4, "little")  # a nop, and back to it
    room = segment.target + len(segment.data) - entry
    at = offset_of(bytes(program), segment.source + entry - segment.target, len(code))
    if len(code) > room or at is None:
        return False
    program[at : at + len(code)] = code
    return True


def _fail(job: PlannedJob, failing: Mapping[Key, Kind], site: Site) -> PlannedJob:
    """Return what is left of a job of which a function fails: all that comes before."""
    over = False
    end = job.end + 1
    executions = []
    for execution in sorted(job.executions, key=lambda e: (e.stretch, e.rank)):
        kind = failing.get((job.job.task, job.job.version, site.unit_of(execution.hart).name))
        ends = execution.ends
        if over:
            ends = frozenset({Outcome.SKIPPED})
        elif kind is not None:
            ends = Injection(kind, 0, 0).ends
            over, end = True, execution.end
        executions.append(replace(execution, ends=ends))
    transfers = tuple(t for t in job.transfers if t.begin < end)
    calls = tuple(call for call in job.calls if call.begin < end)
    return replace(job, executions=tuple(executions), transfers=transfers, calls=calls)


def _starved(jobs: Sequence[PlannedJob]) -> set[tuple[int, int]]:
    """Return the jobs beside which another one spins until its time is over: there is one clock, and it takes it."""
    spinning = [(e, job) for job in jobs for e in job.executions if e.ends == frozenset({Outcome.OVERRUN})]
    return {
        (job.table.cycle, job.row)
        for job in jobs
        for execution, other in spinning
        if other is not job and execution.begin <= job.end and job.begin <= execution.end
    }


def _unwritten(
    site: Site, jobs: Sequence[PlannedJob], failing: Mapping[Key, Kind], played: Played
) -> Iterator[Diagnostic]:
    """Yield the buffers that hold something although all jobs that write into them failed."""
    sound: set[str] = set()
    written: set[str] = set()
    for job in jobs:
        names = {t.what for t in job.transfers if t.kind is AccessKind.WRITE}
        failed = _fail(job, failing, site)
        written |= names
        sound |= {t.what for t in failed.transfers if t.kind is AccessKind.WRITE}
    for name in site.buffers:
        what = f'buffer "{name}"'
        if what in written - sound and any(played.buffers[name]):
            message = "holds something, though every job that writes it failed"
            yield codes.NOT_CONTAINED(message, path=what, help=FROM_RUNTIME)
