"""Mapping of units to cores, and layout of main memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.quantities import format_size
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import MAIN_MEMORY_FULL, OUTSIDE_BUFFER, TOO_MANY_RESOURCES, TOO_MANY_UNITS
from halpipe.exporters.riscv.phases import moves_data
from halpipe.exporters.riscv.profile import MAILBOX, RESERVED, Region
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Diagnostic, Findings
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.models import Job, Schedule, TaskModel, Transfer, Version

PROGRAM = 2 * 2**20
"""Bytes at the beginning of main memory for the runtime and its tables; the last page of them is the control block."""

PAGE = 4096
TRACE_RECORDS = 65536
TRACE_RECORD = 48
FAULT_RECORDS = 256
FAULT_RECORD = 64
LINE = 64
"""Alignment of images and buffers: the size of a DMA transaction."""


def aligned(value: int, to: int) -> int:
    """Return the first multiple of `to` that is not below `value`."""
    return -(-value // to) * to


@record
class Core:
    """Application core `index`, counted from 0; its hart is one more, since hart 0 manages."""

    unit: str
    index: int
    ispm: Region
    dspm: Region

    @property
    def hart(self) -> int:
        """The hart id of the core."""
        return self.index + 1

    def memory_at(self, address: int) -> str:
        """Return which of its scratchpads holds an address."""
        return "ispm" if self.ispm.base <= address < self.ispm.end else "dspm"

    @property
    def job_end(self) -> int:
        """The first address of the data scratchpad that jobs must not touch."""
        return self.dspm.end - RESERVED

    @property
    def mailbox(self) -> int:
        """The address of the core's mailbox."""
        return self.dspm.end - MAILBOX


def jobs_of(schedule: Schedule) -> Iterable[Job]:
    """Yield the jobs of all tables, modes first."""
    for mode in schedule.modes:
        yield from mode.jobs
    for table in schedule.transitions:
        yield from table.jobs


def cores_of(model: TaskModel, used: set[str], profile: Profile, findings: Findings) -> dict[str, Core]:
    """Return the core of every unit: in the model's order, all units if there are cores enough, else those used."""
    units = [unit.name for unit in model.units]
    if len(units) > profile.cores:
        units = [name for name in units if name in used]
    if len(units) > profile.cores:
        message = f'the schedule uses {len(units)} units, profile "{profile.name}" has {profile.cores} cores'
        help = "use a profile with more cores, or schedule for fewer units (`halpipe size` finds how few do)"
        findings.add(TOO_MANY_UNITS(message, at=model.at, path=about(model=model.name), help=help))
        units = units[: profile.cores]
    return {name: Core(name, i, profile.ispm.of(i), profile.dspm.of(i)) for i, name in enumerate(units)}


def channels_of(model: TaskModel, versions: Iterable[Version], profile: Profile, findings: Findings) -> dict[str, int]:
    """Return the DMA channel of every resource whose phases move data."""
    used = {access.resource for version in versions for access in version.accesses if moves_data(access)}
    names = [resource.name for resource in model.resources if resource.name in used]
    if len(names) > profile.dma.channels:
        message = (
            f"{len(names)} resources move data ({', '.join(names)}), there are {profile.dma.channels} DMA channels"
        )
        help = "use fewer resources, or a profile with more channels"
        findings.add(TOO_MANY_RESOURCES(message, at=model.at, path=about(model=model.name), help=help))
    return {name: channel for channel, name in enumerate(names)}


def buffer_sizes(versions: Iterable[tuple[str, Version]], findings: Findings) -> dict[str, int]:
    """Return the reserved size of every buffer, by name in order; collect transfers that go beyond.

    `versions` come with their path for diagnostics.
    """
    found = [
        (path, access.kind, t) for path, version in versions for access in version.accesses for t in access.transfers
    ]
    written: dict[str, int] = {}
    read: dict[str, int] = {}
    for _, kind, transfer in found:
        sizes = written if kind is AccessKind.WRITE else read
        sizes[transfer.buffer] = max(sizes.get(transfer.buffer, 0), transfer.size)
    reserved = read | written
    for path, _, transfer in found:
        if transfer.size > reserved[transfer.buffer]:
            findings.add(_outside(transfer, reserved[transfer.buffer], path))
    return dict(sorted(reserved.items()))


def _outside(transfer: Transfer, reserved: int, path: str) -> Diagnostic:
    message = (
        f'reads {format_size(transfer.size)} of buffer "{transfer.buffer}", into which at most '
        f"{format_size(reserved)} are ever written"
    )
    help = "make the sizes of the transfers agree"
    return OUTSIDE_BUFFER(message, at=transfer.at, path=path, help=help)


@record
class MainMemory:
    """Where things lie: [runtime | control | images ... | buffers | trace | faults]."""

    base: int
    control: int
    images: int
    buffers: dict[str, Region]
    buffers_base: int
    buffers_end: int
    trace: int
    faults: int


def main_memory(profile: Profile, sizes: dict[str, int], findings: Findings) -> MainMemory:
    """Reserve main memory; images grow upwards from their place, all else is fixed at the upper end."""
    faults = profile.main.end - aligned(FAULT_RECORDS * FAULT_RECORD, PAGE)
    trace = faults - aligned(TRACE_RECORDS * TRACE_RECORD, PAGE)
    total = sum(aligned(size, LINE) for size in sizes.values())
    base = trace - aligned(total, PAGE)
    buffers = {}
    at = base
    for name, size in sizes.items():
        buffers[name] = Region(at, size)
        at += aligned(size, LINE)
    images = profile.main.base + PROGRAM
    if base < images:
        what = f"trace and buffers ({format_size(total)}) leave no room for the images"
        findings.add(MAIN_MEMORY_FULL(what, help="make buffers smaller, or main memory in the profile larger"))
    return MainMemory(
        profile.main.base, images - PAGE, images, buffers, base, base + aligned(total, LINE), trace, faults
    )
