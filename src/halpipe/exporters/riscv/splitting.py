"""Jobs with gaps: where an instant of execution lies on the wall, which slot a job is in, and where its image stays.

Between the parts of a job others run on its unit. Its functions are called one after the other, each at its instant;
what it knows stays in its image, which therefore shares no byte of the scratchpads with any other image of the unit.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about, version_of
from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.quantities import format_size
from halpipe.core.records import record
from halpipe.exporters.common.codes import NEEDS_HOLD
from halpipe.exporters.riscv.codes import IMAGE_TOO_LARGE, PHASE_ORDER
from halpipe.exporters.riscv.cores import LINE, aligned, jobs_of
from halpipe.exporters.riscv.phases import functions_of, spans
from halpipe.exporters.riscv.profile import MONITOR

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic, Findings
    from halpipe.exporters.riscv.cores import Core
    from halpipe.exporters.riscv.images import Part
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.exporters.riscv.toolchain import Elf
    from halpipe.models import Job, Schedule, TaskModel, Version

Name = tuple[str, str]
"""A version: its task, and its name."""


@record
class Shape:
    """The parts of a job: when each begins to execute, from the job's start, and the execution [from, to) in it."""

    parts: tuple[tuple[Duration, Duration, Duration], ...]

    def begin(self, instant: Duration) -> Duration:
        """Return when what begins at an instant of execution begins."""
        wall, start, _ = next((p for p in self.parts if p[1] <= instant < p[2]), self.parts[-1])
        return wall + (instant - start)

    def end(self, instant: Duration) -> Duration:
        """Return when what ends at an instant of execution ends."""
        wall, start, _ = next((p for p in self.parts if p[1] < instant <= p[2]), self.parts[0])
        return wall + (instant - start)


def shape_of(job: Job, version: Version) -> Shape:
    """Return the shape of a job; after a gap it begins to execute when it has resumed."""
    if not job.parts:
        return Shape(((ZERO, ZERO, job.end - job.start),))
    lost = [ZERO, *[version.split.resume] * (len(job.parts) - 1)]
    return Shape(
        tuple(
            (part.start - job.start + late, part.executed_from, part.executed_to)
            for part, late in zip(job.parts, lost, strict=True)
        )
    )


def gapped_versions(schedule: Schedule) -> set[Name]:
    """Return the versions of which a job has gaps."""
    return {(job.task, job.version) for job in jobs_of(schedule) if job.parts}


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
    that leads them (`kept`), for others are in progress meanwhile.
    """

    units: int
    kept: tuple[tuple[str, int], ...] = ()

    @property
    def count(self) -> int:
        """How many there are."""
        return self.units + len(self.kept)

    def of(self, task: str, unit: int) -> int:
        """Return the slot of a job of a task whose first unit is `unit`."""
        return self.units + self.kept.index((task, unit)) if (task, unit) in self.kept else unit


PER_SLOT = 5
"""Cycles of the management core to look at one slot more."""


def slower(profile: Profile, slots: Slots) -> Profile:
    """Return a profile whose management core looks at all slots before each operation."""
    looking = Fraction(PER_SLOT * len(slots.kept)) * profile.management_cpi / profile.clock
    return replace(profile, service=profile.service + seconds(looking))


def slots_of(schedule: Schedule, cores: Mapping[str, Core]) -> Slots:
    """Return the slots that the jobs of a schedule need."""
    tasks = {task for task, _ in gapped_versions(schedule)}
    kept = {(job.task, cores[job.units[0]].index) for job in jobs_of(schedule) if job.task in tasks}
    return Slots(len(cores), tuple(sorted(kept)))


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
            ends = tuple(at + size for at, size in zip(place, _sizes(measured[part], part, profile), strict=True))
            findings += _too_large(part, core, place, ends, profile)
            if (part.task, part.version.name) in gapped:
                kept[core] = (aligned(ends[0], LINE), aligned(ends[1], LINE))
    return found, findings


def _sizes(elf: Elf, part: Part, profile: Profile) -> tuple[int, int]:
    """Return the bytes of code and of data, as measured on the part's first core."""
    core = part.cores[0]
    code = elf.address("hp_code_end") - core.ispm.base - MONITOR
    return code, elf.address("hp_data_end") - core.dspm.base - profile.stack


def _too_large(
    part: Part, core: Core, place: tuple[int, int], ends: Sequence[int], profile: Profile
) -> Iterator[Diagnostic]:
    """Yield what does not fit beside jobs that are open; what is too large by itself has been reported."""
    for what, before, end, room in zip(
        ("code", "data"), place, ends, (profile.code_room, profile.data_room), strict=True
    ):
        if before and end > room:
            message = f"{what} ends at {format_size(end)} beside the jobs with gaps that are open on {core.unit}; "
            message += f"there is room for {format_size(room)}"
            help = "all jobs open together on a unit must fit its scratchpads: make them smaller, or use another unit"
            yield IMAGE_TOO_LARGE(message, at=part.version.at, path=part.path, help=help)
