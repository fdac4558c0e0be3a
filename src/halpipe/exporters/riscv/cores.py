"""Units on cores, layout of main memory, and jobs with gaps: their shape, slots of the runtime, and places."""

from __future__ import annotations

from dataclasses import field, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about, version_of
from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_size
from halpipe.core.records import record
from halpipe.exporters.common.codes import NEEDS_HOLD
from halpipe.exporters.riscv.codes import (
    IMAGE_TOO_LARGE,
    MAIN_MEMORY_FULL,
    OUTSIDE_BUFFER,
    PHASE_ORDER,
    TOO_MANY_RESOURCES,
    TOO_MANY_UNITS,
)
from halpipe.exporters.riscv.phases import COPIES, functions_of, moves_data, spans
from halpipe.exporters.riscv.profile import MAILBOX, MONITOR, RESERVED, Profile, Region
from halpipe.models import AccessKind, Job, Schedule, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from halpipe.exporters.riscv.images import Part
    from halpipe.exporters.riscv.toolchain import Elf

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


def channels_of(
    model: TaskModel, versions: Iterable[Version], profile: Profile, findings: Findings, *, copies: bool = False
) -> dict[str, int]:
    """Return the DMA channel of every resource whose phases move data, and one for `copies`."""
    used = {access.resource for version in versions for access in version.accesses if moves_data(access)}
    names = [resource.name for resource in model.resources if resource.name in used] + [COPIES] * copies
    if len(names) > profile.dma.channels:
        message = (
            f"{len(names)} resources move data ({', '.join(name or 'copies of LET' for name in names)}), "
            f"there are {profile.dma.channels} DMA channels"
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
    sizes = grouped(((kind is AccessKind.WRITE, transfer.buffer), transfer.size) for _, kind, transfer in found)
    # Those of a buffer that is written come last, and count.
    reserved = {buffer: max(sizes[is_written, buffer]) for is_written, buffer in sorted(sizes)}
    for path, _, transfer in found:
        if transfer.size > reserved[transfer.buffer]:
            most = format_size(reserved[transfer.buffer])
            message = f'reads {format_size(transfer.size)} of buffer "{transfer.buffer}", into which {most} are written'
            help = "make the sizes of the transfers agree"
            findings.add(OUTSIDE_BUFFER(message, at=transfer.at, path=path, help=help))
    return dict(sorted(reserved.items()))


Shadow = tuple[str, AccessKind, str]
"""A task with a LET, whether it reads or writes, and the buffer of which it has a copy."""


@record
class MainMemory:
    """Layout of main memory: [runtime | control | images ... | buffers | trace | faults]."""

    base: int
    control: int
    images: int
    buffers: dict[str, Region]
    buffers_base: int
    buffers_end: int
    trace: int
    faults: int
    shadows: dict[Shadow, Region] = field(default_factory=dict)

    def place(self, task: str, kind: AccessKind, buffer: str) -> Region:
        """Return where a task finds or leaves the contents of a buffer: in a buffer of its own if it has a LET."""
        return self.shadows.get((task, kind, buffer), self.buffers[buffer])


def main_memory(
    profile: Profile, sizes: dict[str, int], findings: Findings, shadows: Mapping[Shadow, int] | None = None
) -> MainMemory:
    """Reserve main memory; images grow upwards from their place, all else is fixed at the upper end."""
    own = dict(shadows or {})
    faults = profile.main.end - aligned(FAULT_RECORDS * FAULT_RECORD, PAGE)
    trace = faults - aligned(TRACE_RECORDS * TRACE_RECORD, PAGE)
    total = sum(aligned(size, LINE) for size in (*sizes.values(), *own.values()))
    base = trace - aligned(total, PAGE)
    regions = []
    at = base
    for size in (*sizes.values(), *own.values()):
        regions.append(Region(at, size))
        at += aligned(size, LINE)
    buffers, copies = dict(zip(sizes, regions, strict=False)), dict(zip(own, regions[len(sizes) :], strict=True))
    images = profile.main.base + PROGRAM
    if base < images:
        what = f"trace and buffers ({format_size(total)}) leave no room for the images"
        findings.add(MAIN_MEMORY_FULL(what, help="make buffers smaller, or main memory in the profile larger"))
    return MainMemory(
        profile.main.base, images - PAGE, images, buffers, base, base + aligned(total, LINE), trace, faults, copies
    )


Name = tuple[str, str]
"""A version: its task, and its name."""


@record
class Shape:
    """The parts of a job: when each begins to execute, from the job's start, and the execution [from, to) in it."""

    parts: tuple[tuple[Duration, Duration, Duration], ...]

    def begin(self, instant: Duration) -> Duration:
        """Return when what begins at an instant of execution begins."""
        wall, start, _ = next((p for p in self.parts if instant < p[2]), self.parts[-1])
        return wall + (instant - start)

    def end(self, instant: Duration) -> Duration:
        """Return when what ends at an instant of execution ends."""
        wall, start, _ = next((p for p in self.parts if instant <= p[2]), self.parts[-1])
        return wall + (instant - start)


def shape_of(job: Job, version: Version, waits: Duration = ZERO) -> Shape:
    """Return the shape of a job that starts so long after its release; after a gap it executes when it has resumed."""
    if not job.parts:
        return Shape(((waits, ZERO, job.end - job.start),))
    lost = [ZERO, *[version.split.resume] * (len(job.parts) - 1)]
    return Shape(
        tuple(
            (waits + part.start - job.start + late, part.executed_from, part.executed_to)
            for part, late in zip(job.parts, lost, strict=True)
        )
    )


def gapped_versions(schedule: Schedule) -> set[Name]:
    """Return the versions of which a job has gaps."""
    return {(job.task, job.version) for job in schedule.all_jobs() if job.parts}


def check_splits(model: TaskModel, schedule: Schedule, findings: Findings) -> None:
    """Collect the jobs with gaps that cannot be held at the end of a part."""
    for task, name in sorted(gapped_versions(schedule)):
        version = model.task(task).version(name)
        path = version_of(task, name)
        if version.split.anywhere:
            help = 'state split points, as in split="1ms 3ms", and name a function for each piece in the entry'
            message = "its jobs have gaps anywhere; a job can be held where one of its functions has returned only"
            findings.add(NEEDS_HOLD(message, at=version.at, path=path, help=help))
            continue
        functions = functions_of(version)
        needed = len(spans(version, cut=True))
        if version.source is not None and len(functions) != needed:
            message = f"its jobs have gaps, so that it has {needed} pieces; its entry names {len(functions)} functions"
            help = "name a function for each piece, between phases and split points: entry=" + '"first second ..."'
            findings.add(PHASE_ORDER(message, at=version.at, path=path, help=help))
    for unit in model.units:
        if unit.interrupts:
            message = "serves interrupts; the cores of a bundle have none"
            help = "leave the interrupts out of the model, or make tasks of them that poll"
            findings.add(NEEDS_HOLD(message, at=unit.at, path=about(unit=unit.name), help=help))


@record
class Slots:
    """The slot of the runtime in which each program is in progress.

    Jobs of a unit follow each other in its own slot. A task whose jobs have gaps has slots to itself, one for each unit
    that leads them (`kept`), for others are in progress meanwhile; one with a LET has two, since a job may be released
    while what the one before wrote is copied.
    """

    units: int
    kept: tuple[tuple[str, int], ...] = ()

    @property
    def count(self) -> int:
        """Number of them."""
        return self.units + len(self.kept)

    def of(self, task: str, unit: int) -> int:
        """Return the slot of a job of a task whose first unit is `unit`."""
        return self.units + self.kept.index((task, unit)) if (task, unit) in self.kept else unit

    def number(self, task: str, unit: int) -> int:
        """Return how many slots these jobs have."""
        return max(self.kept.count((task, unit)), 1)


PER_SLOT = 5
"""Cycles of the management core to look at one slot more."""


def slower(profile: Profile, slots: Slots) -> Profile:
    """Return a profile whose management core looks at all slots before each operation."""
    looking = Fraction(PER_SLOT * len(slots.kept)) * profile.management_cpi / profile.clock
    return replace(profile, service=profile.service + seconds(looking))


def slots_of(schedule: Schedule, cores: Mapping[str, Core], lets: Collection[str] = ()) -> Slots:
    """Return the slots that the jobs of a schedule need; those of `lets` copy at instants of their own."""
    tasks = {task for task, _ in gapped_versions(schedule)} | set(lets)
    kept = {(job.task, cores[job.units[0]].index) for job in schedule.all_jobs() if job.task in tasks}
    return Slots(len(cores), tuple(sorted([*kept, *(own for own in kept if own[0] in lets)])))


def places_of(
    measured: Mapping[Part, Elf], gapped: set[Name], profile: Profile
) -> tuple[dict[tuple[Part, Core], tuple[int, int]], list[Diagnostic]]:
    """Return how far behind the beginning of code and of data each image lies, and what does not fit together.

    Images of jobs with gaps lie one behind the other; those of all others share the place after them.
    """
    kept: dict[Core, tuple[int, int]] = {}
    found = {}
    ordered = sorted(measured, key=lambda part: (part.task, part.version.name) not in gapped)
    findings: list[Diagnostic] = []
    for part in ordered:
        for core in part.cores:
            place = kept.get(core, (0, 0))
            found[part, core] = place
            sizes = sizes_of(measured[part], part, profile)
            findings += too_large(part, core, sizes, profile, place)
            if (part.task, part.version.name) in gapped:
                kept[core] = (aligned(place[0] + sizes[0], LINE), aligned(place[1] + sizes[1], LINE))
    return found, findings


def sizes_of(elf: Elf, part: Part, profile: Profile) -> tuple[int, int]:
    """Return the bytes of code and of data, as measured on the part's first core."""
    core = part.cores[0]
    code = elf.address("hp_code_end") - core.ispm.base - MONITOR
    return code, elf.address("hp_data_end") - core.dspm.base - profile.stack


def too_large(
    part: Part, core: Core, sizes: tuple[int, int], profile: Profile, place: tuple[int, int] = (0, 0)
) -> Iterator[Diagnostic]:
    """Yield what of an image does not fit the scratchpads, at a place behind the images of jobs that are open."""
    rooms = profile.code_room, profile.data_room
    for what, size, before, room in zip(("code", "data"), sizes, place, rooms, strict=True):
        if before + size > room:
            message = f"{what} has {size} bytes"
            message += f" beside the jobs with gaps that are open on {core.unit}, which have {before}" if before else ""
            message += f"; there is room for {room} beside monitor, stack and mailbox"
            help = f"make it {before + size - room} bytes smaller, for instance by work on pieces that are transferred "
            help += "one after the other"
            yield IMAGE_TOO_LARGE(message, at=part.version.at, path=part.path, help=help)
