"""The check of a RISC-V bundle by QEMU: the same program, on a machine with physical memory protection and a PDMA.

QEMU judges starts, containment, data and the order of everything by what the runtime records and what main memory
holds at the end. It gives all cores one clock, which every instruction of any core advances, so that execution times
have to be modelled; and its transfers take no time. See docs/explanation/co-simulation.md.
"""

from __future__ import annotations

from collections import Counter
from importlib.util import find_spec
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named, sort_diagnostics
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.deploy.base import Checked
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.check import CYCLES, simulate, static_findings, tolerance_of
from halpipe.deploy.riscv.judge.records import hold
from halpipe.deploy.riscv.run.cosimulation import read_images, silent
from halpipe.deploy.riscv.run.emulator import EMULATOR, find_emulator, is_over, play
from halpipe.deploy.riscv.run.expectation import Expectation
from halpipe.deploy.riscv.run.sequence import Request, Tour, played_tables
from halpipe.deploy.riscv.target import read_site

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import CheckOptions, Target
    from halpipe.deploy.riscv.run.emulator import Played
    from halpipe.deploy.riscv.target import Site

__all__ = ["EMULATOR", "Leg", "check_by_qemu", "legs"]


@record
class Leg:
    """One run: a mode for a hyperperiod, and where it may be left, the transition and the mode that it leads to."""

    first: str
    to: str
    tables: int

    @property
    def requests(self) -> tuple[Request, ...]:
        """What is requested: before the start only."""
        return (Request(ZERO, self.to),) if self.to else ()


def check_by_qemu(target: Target, options: CheckOptions) -> Checked:
    """Play every mode and every transition under QEMU and hold what the runtime records against the schedule."""
    from halpipe.deploy.riscv.run.qemu_injection import inject

    site = read_site(target.bundle)
    emulator = find_emulator(site)
    images = read_images(target.bundle, site)
    findings = Findings()
    findings.extend(static_findings(target))
    counts: Counter[str] = Counter()
    is_compared = find_spec("unicorn") is not None
    for leg in legs(target, options.cycles or CYCLES):
        index = {mode.name: i for i, mode in enumerate(target.schedule.modes)}
        request = index[leg.to] + 1 if leg.to else 0
        played = play(silent(target), site, emulator, index[leg.first], request, leg.tables)
        tables = played_tables(target.schedule, leg.first, leg.requests, leg.tables, site.tick)
        expectation = Expectation(target.bundle, target.model, site, images)
        jobs = expectation.jobs(tables)
        findings.extend(expectation.findings.items)
        findings.extend(is_over(played))
        if not played.is_over:
            break
        held = hold(site, played.recording, tables, jobs)
        findings.extend(held.findings)
        counts += Counter(runs=1, tables=len(tables), jobs=len(jobs), delayed=held.delayed)
        if is_compared and not findings.has_errors:
            differing = [*_data(target, leg, played)]
            findings.extend(differing)
            counts["compared"] += not differing
    lines = [*_lines(target, site, counts, is_compared=is_compared)]
    if not findings.has_errors and options.inject != "none":
        injected = inject(target, site, emulator, everything=options.inject == "all")
        findings.extend(injected.findings)
        lines += injected.lines()
    help = "use --engine cosim for execution times and transfers"
    findings.add(
        codes.NOT_JUDGED(
            "execution times are modelled, transfers take no time, and accesses need not be aligned", help=help
        )
    )
    if not findings.has_errors:
        lines.append(f"{target.bundle.path}: every start is as scheduled, no job was abandoned")
    return Checked(diagnostics=tuple(sort_diagnostics(findings.items)), lines=tuple(lines))


def _lines(target: Target, site: Site, counts: Counter[str], *, is_compared: bool) -> Iterator[str]:
    plural = "s" if counts["runs"] > 1 else ""
    played = f"{counts['tables']} tables and {counts['jobs']} jobs in {counts['runs']} run{plural}"
    yield f"QEMU, {target.bundle.path}: {played}"
    yield f"starts may be late by {tolerance_of(site)}, the time that the management core has for its operations"
    if counts["delayed"]:
        yield f"{counts['delayed']} starts were later than that by no more than other cores computed on the one clock"
    if is_compared and counts["compared"] < counts["runs"]:
        yield f"buffers were compared with those of the co-simulation after {counts['compared']} runs"
    elif is_compared:
        yield "all buffers hold at the end what they hold in the co-simulation"
    else:
        yield "data was not checked: the package unicorn, which would compute it, is not installed"


def legs(target: Target, cycles: int) -> list[Leg]:
    """Return runs that play every transition, and every mode: requests can be made before the start only."""
    schedule = target.schedule
    found = [Leg(t.source, t.target, 2 + cycles) for t in schedule.transitions]
    seen = {name for leg in found for name in (leg.first, leg.to)}
    return found + [Leg(mode.name, "", cycles) for mode in schedule.modes if mode.name not in seen]


def _data(target: Target, leg: Leg, played: Played) -> Iterator[Diagnostic]:
    """Hold the buffers against those of the co-simulation, whose emulator, DMA engine and clocks are others."""
    outcome = simulate(target, Tour(leg.first, leg.requests, leg.tables), execution="modelled")
    if any(found.is_error for found in outcome.findings):
        message = f'data after mode "{leg.first}" was not compared, for the co-simulation itself finds errors'
        yield codes.NOT_JUDGED(message, help="look at them with --engine cosim")
        return
    for name, area in outcome.run.site.buffers.items():
        other, own = outcome.run.memory.read(area.base, area.size), played.buffers[name]
        differing = [i for i, (a, b) in enumerate(zip(own, other, strict=True)) if a != b]
        if differing:
            message = f"holds other data than in the co-simulation, in {len(differing)} of {area.size} bytes, "
            message += f'first at {differing[0]}, after mode "{leg.first}"' + (f' and "{leg.to}"' if leg.to else "")
            help = "look for a job whose result depends on what it did not read: uninitialised memory, or time"
            yield codes.WRONG_DATA(message, path=named("buffer", name), help=help)
