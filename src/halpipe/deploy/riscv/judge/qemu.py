"""Check of a bundle with QEMU: the runs, and the comparison of their records with the schedule."""

from __future__ import annotations

import shutil
import struct
from collections import Counter
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, named, sort_diagnostics
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.deploy.base import Checked, CheckOptions, Target
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.machine import RUBBISH
from halpipe.deploy.riscv.judge import conditions
from halpipe.deploy.riscv.judge.check import CYCLES, simulate, static_findings, tolerance_of
from halpipe.deploy.riscv.judge.comparison import Comparison, Seen
from halpipe.deploy.riscv.judge.records import observations, strangers
from halpipe.deploy.riscv.judge.tables import Tables, tables_of
from halpipe.deploy.riscv.run.cosimulation import MAGIC, PROGRAM, Run, TableSeen, read_images, silent
from halpipe.deploy.riscv.run.drivers import recorded_inputs
from halpipe.deploy.riscv.run.expectation import Expectation, PlannedExecution, PlannedJob
from halpipe.deploy.riscv.run.observation import Execution, Observations, Outcome
from halpipe.deploy.riscv.run.recording import Dump, Flag, Word, read_recording
from halpipe.deploy.riscv.run.recording import Kind as Recorded
from halpipe.deploy.riscv.run.sequence import Played, Request, Tour, played_tables
from halpipe.deploy.riscv.target import Site, read_site

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.deploy.riscv.run.recording import Memory

EMULATOR = "qemu-system-riscv64"
SECONDS = 6
"""How long one run may take; it is ended then, and what it did until then is judged."""

INSTRUCTIONS_PER_SECOND = 10**9
"""Of all cores together, on QEMU's one clock."""

_MODELLED, _BY_SEMIHOSTING = 1, 1
_NEEDS_TREE = "microchip-icicle-kit"
_MACHINE, _MEMORY = "-machine", "-m"
_OTHER = ["-display", "none", "-monitor", "none", "-serial", "null", "-no-reboot", "-icount", "shift=0,sleep=off"]
_HOSTING = ["-semihosting-config", "enable=on,target=native"]


def find_emulator(site: Site) -> str:
    """Return QEMU's program; raise `HalpipeError` if it is not there, or has no machine for the target."""
    if not site.qemu:
        help = "use --engine cosim, or export with a profile that has one: fu540, mpfs or virt"
        raise HalpipeError(codes.ENGINE_UNFIT(f'QEMU has no machine for profile "{site.profile}"', help=help))
    found = shutil.which(EMULATOR)
    if found is None:
        help = "apt-get install qemu-system-misc, or use --engine cosim"
        raise HalpipeError(codes.ENGINE_ABSENT(f"{EMULATOR} is not installed", help=help))
    return found


def play(
    program: bytes,
    site: Site,
    emulator: str,
    first: int,
    request: int,
    tables: int,
    inputs: Mapping[str, Sequence[bytes]],
) -> Run:
    """Run QEMU once, with main memory in a file and the first recorded inputs."""
    words = [MAGIC, tables, _MODELLED, first, 0, _BY_SEMIHOSTING, max(site.timebase // 1000, 1), 0, request]
    with scratch_folder() as folder:
        place = Path(folder)
        place.joinpath(PROGRAM).write_bytes(program)
        place.joinpath("control").write_bytes(struct.pack(f"<{len(words)}Q", *words))
        command = [emulator, *_with_memory(site.qemu, place / "memory"), "-bios", "none", "-kernel"]
        command += [str(place / PROGRAM), *_loader(place / "control", site.control), *_rubbish(place, site)]
        for number, (buffer, contents) in enumerate(inputs.items()):
            place.joinpath(f"input{number}").write_bytes(contents[0])
            command += _loader(place / f"input{number}", site.buffers[buffer].base)
        if _NEEDS_TREE in site.qemu:
            tree = str(place / "tree")
            start([emulator, _MACHINE, f"sifive_u,dumpdtb={tree}", "-smp", "5", "-display", "none"])
            command += ["-dtb", tree]
        said = start([*command, *_OTHER, *_HOSTING])
        return _read(place / "memory", site, said)


def _loader(file: Path, address: int) -> list[str]:
    return ["-device", f"loader,file={file},addr={address:#x},force-raw=on"]


def _rubbish(place: Path, site: Site) -> list[str]:
    found = []
    for unit in site.units:
        file = place / f"rubbish-{unit.dspm.size}"
        file.write_bytes(RUBBISH * unit.dspm.size)
        found += _loader(file, unit.dspm.base)
    return found


def _with_memory(arguments: tuple[str, ...], file: Path) -> list[str]:
    """Return QEMU's arguments with main memory in a file that is there afterwards."""
    found = list(arguments)
    if _MACHINE not in found[:-1] or _MEMORY not in found[:-1]:
        help = f"state {_MACHINE} and {_MEMORY} in the profile's qemu"
        raise HalpipeError(codes.ENGINE_UNFIT("the arguments for QEMU name no machine or memory", help=help))
    size = found[found.index(_MEMORY) + 1]
    found[found.index(_MACHINE) + 1] += ",memory-backend=main"
    return [*found, "-object", f"memory-backend-file,id=main,size={size},mem-path={file},share=on"]


def start(command: list[str]) -> str | None:
    """Run a command; return what it said, None if it had to be ended."""
    try:
        done = run(command, seconds=SECONDS)
    except TimeoutExpired:
        return None
    return done.stderr or done.stdout


def _read(file: Path, site: Site, said: str | None) -> Run:
    try:
        with file.open("rb") as stored:
            memory = Dump(str(file), stored.read(site.main.size), site.main.base)
    except OSError:
        text = " ".join((said or "").split())[-200:]
        help = "use --engine cosim to see more"
        raise HalpipeError(codes.ENGINE_UNFIT(f"QEMU did not start; it said: {text}", help=help)) from None
    return run_of(site, memory, "" if said is not None else f"QEMU was ended after {SECONDS} s")


def run_of(site: Site, memory: Memory, exhausted: str = "") -> Run:
    """Return a run by what it left in memory; one unit of its time is a tick."""
    recording = read_recording(memory, site)
    begun = [r for r in recording.records if r.kind == Recorded.TABLE and not r.flags & Flag.REFUSED]
    named = [site.tables[r.table].name if r.table < len(site.tables) else "?" for r in begun]
    instants = [site.tick * r.begin for r in begun]
    return Run(
        site=site,
        rate=site.timebase,
        tick=1,
        zero=0,
        state=memory.word(site.control + 8 * Word.STATE),
        duration=site.tick * max((r.time for r in recording.records), default=0),
        tables=[TableSeen(instant, name, instant) for name, instant in zip(named, instants, strict=True)],
        recorder=Observations(),
        recording=recording,
        memory=memory,
        protections={},
        uart=b"",
        instructions=0,
        is_modelled=True,
        exhausted=exhausted,
    )


class OneClock(Comparison):
    """Comparison of a run in which every instruction of any core advances the one clock of all.

    So a core may begin late because others compute at that time. Their computing is recorded, too, and excuses exactly
    as much lateness as it covers: `delayed` counts such starts. State of cores and ends of transfers are not recorded.
    """

    def __init__(self, run: Run, jobs: Sequence[PlannedJob], tolerance: Duration) -> None:
        self.delayed = 0
        super().__init__(run, jobs, tolerance)

    def _excused(self, hart: int, begin: int, end: int) -> int:
        others = self._others(hart, begin, end)
        self.delayed += end - begin - others <= self._tolerance
        return others

    def _others(self, hart: int, begin: int, end: int) -> int:
        """Return how many ticks of [begin, end] other cores computed."""
        spans = ((e.begin, e.left + 1) for e in self._run.executions if e.hart != hart)
        covered, front = 0, begin
        for low, high in sorted(spans):
            covered += max(min(high, end) - max(low, front), 0)
            front = max(front, high)
        return covered

    def _judge_end(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        """Report an overrun, unless the job had less of the one clock than it has of its own on the board."""
        ticks = planned.end - planned.begin
        others = self._others(planned.hart, planned.begin, planned.end)
        had = Fraction(INSTRUCTIONS_PER_SECOND, self._run.site.clock) * (ticks - others)
        if execution.outcome is Outcome.RETURNED or had >= ticks or others <= self._tolerance:
            super()._judge_end(seen, planned, execution)
            return
        message = f"overran on {self._unit(planned.hart)} where other cores computed in {self._run.length(others)} of "
        message += f"its {self._run.length(ticks)} on the one clock; whether it would on the board, QEMU cannot tell"
        help = "use --engine cosim, which gives each core a clock of its own"
        self._report(codes.ENGINE_UNFIT, seen.planned, message, help)

    def _judge_call(self, seen: Seen, planned: PlannedExecution, execution: Execution) -> None:
        """Judge nothing: arguments, stack and registers are not recorded."""

    def _judge_phases(self, seen: Seen) -> None:
        """Judge nothing: transfers begin late where others compute."""


def judge(
    run: Run, tables: Tables, expected: Sequence[Played], jobs: Sequence[PlannedJob]
) -> tuple[list[Diagnostic], int]:
    """Compare a run with its plan; return the deviations, and how many starts others delayed."""
    site = run.site
    run.recorder = observations(run.recording, tables)
    findings = [*conditions.is_over(run), *strangers(run, tables), *conditions.plays(run, expected, ZERO)]
    compared = OneClock(run, jobs, tolerance_of(site))
    findings += compared.findings.items
    longest = max((table.length for table in expected), default=ZERO)  # calls are late where others compute
    findings += conditions.calls_drivers(run, jobs, longest)
    return findings, compared.delayed


def check_by_qemu(target: Target, options: CheckOptions) -> Checked:
    """Play every mode and every transition under QEMU and hold what the runtime records against the schedule."""
    site = read_site(target.bundle)
    emulator = find_emulator(site)
    images = read_images(target.bundle, site)
    findings = Findings()
    findings.extend(static_findings(target))
    counts: Counter[str] = Counter()
    for leg in legs(target, options.cycles or CYCLES):
        index = {mode.name: i for i, mode in enumerate(target.schedule.modes)}
        request = index[leg.requests[0].mode] + 1 if leg.requests else 0
        inputs = recorded_inputs(target.bundle, site)
        played = play(silent(target), site, emulator, index[leg.first], request, leg.tables, inputs)
        tables = played_tables(target.schedule, leg.first, leg.requests, leg.tables, site.tick)
        expectation = Expectation(target.bundle, target.model, site, images)
        jobs = expectation.jobs(tables)
        findings.extend(expectation.findings.items)
        deviations, delayed = judge(played, tables_of(target, site), tables, jobs)
        findings.extend(deviations)
        counts += Counter(runs=1, tables=len(tables), jobs=len(jobs), delayed=delayed)
        if played.exhausted:
            break
        if not findings.has_errors:
            differing = [*_data(target, leg, played)]
            findings.extend(differing)
            counts["compared"] += not differing
    lines = [*_lines(target, site, counts)]
    help = "use --engine cosim for execution times and transfers"
    findings.add(
        codes.NOT_JUDGED(
            "execution times are modelled, transfers take no time, and accesses need not be aligned", help=help
        )
    )
    if not findings.has_errors:
        lines.append(f"{target.bundle.path}: every start is as scheduled, no job was abandoned")
    return Checked(diagnostics=tuple(sort_diagnostics(findings.items)), lines=tuple(lines))


def _lines(target: Target, site: Site, counts: Counter[str]) -> Iterator[str]:
    plural = "s" if counts["runs"] > 1 else ""
    played = f"{counts['tables']} tables and {counts['jobs']} jobs in {counts['runs']} run{plural}"
    yield f"QEMU, {target.bundle.path}: {played}"
    yield f"starts may be late by {tolerance_of(site)}, the time that the management core has for its operations"
    if counts["delayed"]:
        yield f"{counts['delayed']} starts were later than that by no more than other cores computed on the one clock"
    if counts["compared"] < counts["runs"]:
        yield f"buffers were compared with those of the co-simulation after {counts['compared']} runs"
    else:
        yield "all buffers hold at the end what they hold in the co-simulation"


def legs(target: Target, cycles: int) -> list[Tour]:
    """Return runs that play every transition, and every mode: requests can be made before the start only."""
    schedule = target.schedule
    found = [Tour(t.source, (Request(ZERO, t.target),), 2 + cycles) for t in schedule.transitions]
    seen = {name for t in schedule.transitions for name in (t.source, t.target)}
    return found + [Tour(mode.name, (), cycles) for mode in schedule.modes if mode.name not in seen]


def _data(target: Target, leg: Tour, played: Run) -> Iterator[Diagnostic]:
    """Hold the buffers against those of the co-simulation, whose emulator, DMA engine and clocks are others."""
    outcome = simulate(target, leg, execution="modelled", samples=1)
    if any(found.is_error for found in outcome.findings):
        message = f'data after mode "{leg.first}" was not compared, for the co-simulation itself finds errors'
        yield codes.NOT_JUDGED(message, help="look at them with --engine cosim")
        return
    for name, area in outcome.run.site.buffers.items():
        other, own = (each.memory.read(area.base, area.size) for each in (outcome.run, played))
        differing = [i for i, (a, b) in enumerate(zip(own, other, strict=True)) if a != b]
        if differing:
            message = f"holds other data than in the co-simulation, in {len(differing)} of {area.size} bytes, "
            message += f'first at {differing[0]}, after mode "{leg.first}"' + "".join(
                f' and "{each.mode}"' for each in leg.requests
            )
            help = "look for a job whose result depends on what it did not read: uninitialised memory, or time"
            yield codes.WRONG_DATA(message, path=named("buffer", name), help=help)
