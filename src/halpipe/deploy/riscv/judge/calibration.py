"""Profiles from measurements: the constants of a target as a calibrating bundle recorded them on a board or simulator.

Each constant covers every measurement: bandwidths are 5 % lower and times 10 % longer than the worst that was seen.
"""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from typing import TYPE_CHECKING

import yaml

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location
from halpipe.core.durations import Duration, seconds
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_bandwidth, format_rational
from halpipe.core.records import record
from halpipe.core.settings import Fields
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.contents import AGAIN, OWN_PROFILE, machine_faults
from halpipe.deploy.riscv.judge.figures import due_of, waits
from halpipe.deploy.riscv.judge.tables import Tables
from halpipe.deploy.riscv.run.cosimulation import Run, load_program
from halpipe.deploy.riscv.run.recording import Flag, Kind, Measured, Recording, measurements, read_calibration
from halpipe.deploy.riscv.target import CLASSES, MEMORIES, Site, read_site

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.deploy.base import Target

SLOWER, LONGER = Fraction(95, 100), Fraction(110, 100)
WIDEST = Fraction(120, 100)
WORST = 330
"""Instructions of the longest operation, which a run may not have: a job that fails, with its health rule."""

_TURN, _PAIRS = 16, 7  # instructions in one turn of a loop of additions; pairs in one of another class
_ADD, *_CLASSES, _TAKEN, _OTHERS, _MANAGEMENT = range(4, 13)  # kinds of measurements; classes as in `CLASSES`


@record
class Constants:
    """Measured constants of a target, with margins; bandwidths in bytes per second, cycles of an instruction."""

    into: dict[str, int]
    setup: Duration
    service: Duration
    cycles: dict[str, Fraction]

    def lines(self) -> list[str]:
        """Return the figures for people."""
        rates = ", ".join(f"{format_bandwidth(rate)} into {name}" for name, rate in self.into.items())
        cycles = ", ".join(f"{name} {format_rational(number)}" for name, number in self.cycles.items())
        return [f"{rates}; setup {self.setup}", f"service {self.service}; cycles of an instruction: {cycles}"]


def calibrate(target: Target, data: bytes, file: str, base: int | None = None) -> tuple[bytes, list[str]]:
    """Return the profile of a bundle with the constants of a recording, and these for people.

    Raise `HalpipeError` where the recording lacks measurements, or one of them failed.
    """
    site = read_site(target.bundle)
    faults = [*machine_faults(target.bundle, site)]
    if faults:
        raise HalpipeError(*faults)
    recording, measured = read_calibration(target.bundle, data, file, base)
    points = _points(measured, file)
    try:
        found = constants_of(target, site, recording, points)
    except (LookupError, ValueError, struct.error):
        message = "a record names a table, a program or an operation that the bundle does not have"
        help = "dump the memory of a run of this very bundle"
        raise HalpipeError(codes.NO_RECORDING(message, at=Location(file), help=help)) from None
    return _profile(target, found, file), found.lines()


def _points(measured: Measured, file: str) -> Mapping[int, Sequence[tuple[int, int]]]:
    """Return amounts and ticks by kind; raise `HalpipeError` where a kind is missing, or one failed."""
    points = grouped((kind, (amount, ticks)) for kind, amount, ticks in measured)
    lacking = [kind for kind in range(1, _MANAGEMENT + 1) if kind not in points]
    failed = [k for k, each in sorted(points.items()) if any(not amount or (k >= _ADD and not t) for amount, t in each)]
    if lacking or failed:
        kinds = ", ".join(map(str, lacking or failed))
        message = f"measurements of kind {kinds} " + ("are missing" if lacking else "failed")
        help = "export with --calibrate, run that bundle, and dump its memory or print its report at the end"
        raise HalpipeError(codes.NO_CALIBRATION(message, at=Location(file), help=help))
    return points


def wrong_measurements(target: Target, run: Run) -> Iterator[Diagnostic]:
    """Yield the constants of a simulated board that its measurements miss by more than -0 to +20 %."""
    site, help = run.site, "the runtime measures wrongly: report it as a bug"
    try:
        points = _points(measurements(run.memory, site), target.bundle.path)
        found = constants_of(target, site, run.recording, points)
    except HalpipeError as failure:
        yield from failure.diagnostics
        return
    second, times = site.timebase, dict[str, tuple[Fraction, Fraction, Fraction]]()
    steps = {name: math.ceil(cycles / site.cpi) * site.cpi for name, cycles in site.classes.items()}
    for name, stated in {"jobs": site.cpi, "management": site.management_cpi, **steps}.items():
        times[f"cycles ({name})"] = stated, found.cycles[name], Fraction(1, 100)
    if site.dma.kind == "pdma":
        limits = [r.bandwidth for r in target.model.resources if site.channels.get(r.name) == 0 and r.bandwidth]
        for number, memory in enumerate(MEMORIES, 1):
            sizes = [size for size, _ in points[number]]
            rate, moved = min(site.dma.bandwidth[memory], *limits), max(sizes) - min(sizes)
            times[f"bandwidth ({memory})"] = (
                Fraction(moved, rate),
                Fraction(moved, found.into[memory]),
                Fraction(2, second),
            )
        own = Fraction(WORST) * site.management_cpi / site.clock
        times["setup"] = site.dma.latency.in_unit("s"), found.setup.in_unit("s"), Fraction(2, second) + own
    for name, (stated, measured, fine) in times.items():
        if not stated <= measured <= (stated + fine) * WIDEST:
            message = f"{name}: it measures {math.floor(100 * measured / (stated or fine))} % of what the board takes"
            yield codes.NO_CALIBRATION(message, at=target.bundle.at("bundle.elf"), help=help)


def constants_of(
    target: Target, site: Site, recording: Recording, points: Mapping[int, Sequence[tuple[int, int]]]
) -> Constants:
    """Return the constants that cover all measurements."""
    second = site.timebase
    into = {memory: _bandwidth(points[number], second) for number, memory in enumerate(MEMORIES, 1)}
    waits = [
        Fraction(ticks + 1, second) - Fraction(size, into[memory])
        for number, memory in enumerate(MEMORIES, 1)
        for size, ticks in points[number]
    ]
    turns = {kind: _cycles(points[kind], site) for kind in range(_ADD, _MANAGEMENT + 1)}  # cycles of a turn
    simple = (15 * turns[_ADD] - turns[_TAKEN]) / (15 * 15 - 1)  # one is taken in a turn of the first, 15 in the second
    taken = turns[_ADD] - 15 * simple
    each = [(turns[kind] - simple - taken) / _PAIRS - simple for kind in _CLASSES]
    other = (turns[_OTHERS] - 2 * simple - taken) / _PAIRS - simple * Fraction(5, 2)
    cycles = {"jobs": simple, "management": turns[_MANAGEMENT] / _TURN}
    cycles |= dict(zip(CLASSES, [*each, taken, other - taken + simple], strict=True))
    return Constants(
        into,
        _rounded(max(Fraction(1, second), *waits) * LONGER),  # no clock tells less than a tick
        _rounded(max(_service(target, site, recording), WORST * cycles["management"] / site.clock) * LONGER),
        {name: max(Fraction(math.ceil(number * 100), 100), Fraction(1)) for name, number in cycles.items()},
    )


def _bandwidth(points: Sequence[tuple[int, int]], second: int) -> int:
    """Return the bytes per second between the smallest and the largest transfer, each at its longest."""
    slowest = {size: max(ticks for other, ticks in points if other == size) for size, _ in points}
    small, large = min(slowest), max(slowest)
    ticks = slowest[large] - slowest[small] + 1  # the clock says no more exactly
    rate = int(Fraction(large - small, max(ticks, 1)) * second * SLOWER)
    return max(rate - rate % 10**5 if rate > 10**6 else rate, 1)


def _cycles(points: Sequence[tuple[int, int]], site: Site) -> Fraction:
    """Return the cycles of one turn of a loop, at its longest."""
    return max(Fraction(ticks, turns) for turns, ticks in points) * Fraction(site.clock, site.timebase)


def _service(target: Target, site: Site, recording: Recording) -> Fraction:
    """Return the longest time of an operation of the management core, in seconds.

    An operation that begins late waits for those before it: for as many as were late in a row, and a release.
    """
    tables = Tables(load_program(target.bundle, site), target.model)
    starts = {entry.cycle: entry.begin for entry in recording.records if entry.kind == Kind.TABLE and not entry.flags}
    worst, row = Fraction(1), 0
    for entry in recording.records:
        if entry.kind in (Kind.TABLE, Kind.HEALTH) or entry.flags & ~Flag.SKIPPED or entry.cycle not in starts:
            continue
        due, _ = due_of(tables, entry, starts)
        late = entry.time - due
        row = row + 1 if late > 0 else 0
        if late > 0 and not waits(tables, entry, due):
            worst = max(worst, Fraction(late + 1, row))
    return worst / site.timebase


def _rounded(time: Fraction) -> Duration:
    return seconds(Fraction(math.ceil(time * 10**7), 10**7))  # to 100 ns


def _profile(target: Target, found: Constants, file: str) -> bytes:
    """Return the bundle's profile with other constants."""
    name = target.bundle.at(OWN_PROFILE).file
    findings = Findings()
    fields = Fields.sealed(target.bundle.files.get(OWN_PROFILE, b""), name, findings, codes.FOREIGN_MACHINE, AGAIN)
    stated, dma = dict(fields.data), {key: value for key, value in fields.part("dma").data.items() if key != "bus"}
    findings.stop_on_errors()
    stated["summary"] = f"{stated.get('summary', 'a target')}, calibrated"
    stated["service"] = str(found.service)
    stated["cpi"] = {kind: format_rational(number) for kind, number in found.cycles.items()}
    stated["dma"] = dma | {
        "bandwidth": {memory: format_bandwidth(rate) for memory, rate in found.into.items()},
        "bus": format_bandwidth(max(found.into.values())),
        "setup": str(found.setup),
    }
    head = (
        f"# Constants measured by `halpipe deploy calibrate` from {file.rpartition('/')[2]}, margins: 5 and 10 %.\n"
        "# The bus was not measured with several channels: together they move no more than the fastest of them alone.\n"
    )
    return head.encode() + yaml.safe_dump(_plain(stated), sort_keys=False, width=120).encode()


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, list) else value
