"""Prepare a model for a target: load phases as long as images need, memory phases as long as their transfers."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, version_of
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.exporters.riscv.bundle import stage_runtime
from halpipe.exporters.riscv.codes import GREW, IDLE_PHASE, WINDOW_FROM_START
from halpipe.exporters.riscv.cores import Core
from halpipe.exporters.riscv.drivers import read_drivers
from halpipe.exporters.riscv.dummy import FILE, with_dummies
from halpipe.exporters.riscv.images import Part, compile_parts, measure
from halpipe.exporters.riscv.phases import clock_of, load_of, memory_of, moves_data, shares
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Renderer
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.toolchain import Workshop, find_toolchain
from halpipe.models import Access, AccessKind, Anchor, Resource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.exporters.riscv.drivers import Drivers
    from halpipe.exporters.riscv.phases import Clock
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.exporters.riscv.toolchain import Elf
    from halpipe.models import TaskModel, Version


def grow(
    version: Version,
    sizes: Sequence[tuple[int, str]],
    resource: str,
    clock: Clock,
    patience: int,
    driving: Callable[[Access], Duration] = lambda access: ZERO,
) -> Version:
    """Return a version whose phases hold its transfers, each `patience` ticks more than they take.

    `sizes` are those of the parts of its image, with their memories; a load phase that it lacks is made on `resource`.
    `driving` tells how long drivers take in a phase before its transfers begin.
    """
    assert version.wcet is not None, "models without WCET do not validate"
    load = load_of(version)
    first = load or Access(resource=resource, start=ZERO, end=ZERO, kind=AccessKind.LOAD)
    loading = patience + version.gang * sum(clock.transfer(first.resource, *size) for size in sizes)
    loaded = _with_end(first, first.start, first.end, loading, clock)
    # From an instant on, everything is later by a growth.
    growths = [(first.end, loaded.end - first.end)]
    others = []
    for access in sorted((a for a in version.accesses if a is not load), key=lambda a: (a.start, a.end)):
        start, end = _later(access.start, growths), _later(access.end, growths)
        waiting = patience + clock.up(driving(access))
        moved = _with_end(access, start, end, _needs(access, version.gang, clock, waiting), clock)
        growths.append((access.end, moved.end - end))
        others.append(moved)
    if not any(growth for _, growth in growths):
        return version
    points = tuple(_later(point, growths) for point in version.split.points)
    split = replace(version.split, points=points)
    return replace(version, wcet=_later(version.wcet, growths), accesses=(loaded, *others), split=split)


def _later(instant: Duration, growths: Iterable[tuple[Duration, Duration]]) -> Duration:
    return sum((growth for at, growth in growths if instant >= at), instant)


def _needs(access: Access, gang: int, clock: Clock, patience: int) -> int:
    """Return the ticks that the transfers of a phase take, with those of every member of a gang."""
    if not access.transfers:
        return 0
    sizes = [size for transfer in access.transfers for _, _, size in shares(access, transfer.size, gang)]
    return patience + sum(clock.transfer(access.resource, size, memory_of(access)) for size in sizes)


def _with_end(access: Access, start: Duration, end: Duration, needed: int, clock: Clock) -> Access:
    """Return the phase at its new place, at least `needed` ticks long when rounded inwards."""
    if clock.down(end) - clock.up(start) < needed:
        end = clock.tick * (clock.up(start) + needed)
    return replace(access, start=start, end=end)


MAIN_MEMORY = "main-memory"
"""The resource that loads use where the model has none."""


@record
class Prepared:
    """The model for the target, files that belong beside it, and what was changed."""

    model: TaskModel
    files: dict[str, bytes]
    diagnostics: tuple[Diagnostic, ...]


def prepare(model: TaskModel, options: RiscvOptions, *, dummy: bool = False) -> Prepared:
    """Return the model with the phases that its images need; raise `HalpipeError` if these cannot be made."""
    profile = read_profile(options.profile)
    render = Renderer(profile)
    model = _with_resource(model, profile)
    clock = clock_of(model, profile)
    findings = Findings()
    tree = SourceTree(Path(options.sources or Path(model.at.file).parent), findings)
    files = {}
    if dummy:
        model, most = with_dummies(model, profile, clock)
        if most:
            files[FILE] = render.fill("dummy.c", most=most).encode()
            tree.files[f"src/{FILE}"] = files[FILE]
    parts = _parts(model, profile, tree)
    findings.stop_on_errors()
    toolchain = find_toolchain(options.toolchain)
    with scratch_folder() as folder:
        shop = Workshop(Path(folder), toolchain)
        for name, content in tree.files.items():
            shop.write(name, content)
        stage_runtime(shop)
        measured = measure(shop, compile_parts(shop, parts, tree, render), profile, render)
    drivers = read_drivers(options.drivers)
    grown = {
        (part.task, part.version.name): _grow(part, elf, model, profile, drivers, findings)
        for part, elf in measured.items()
    }
    model = _replaced(model, grown)
    findings.extend(_windows_from_start(model, parts, grown))
    findings.extend(_idle_phases(parts))
    return Prepared(model, files, tuple(findings.items))


def _with_resource(model: TaskModel, profile: Profile) -> TaskModel:
    if model.resources:
        return model
    return replace(model, resources=(Resource(name=MAIN_MEMORY, bandwidth=profile.dma.bandwidth),))


def _parts(model: TaskModel, profile: Profile, tree: SourceTree) -> list[Part]:
    """Return the versions that run in some mode; sizes are the same on every core, so all are measured on the first."""
    core = Core("", 0, profile.ispm.of(0), profile.dspm.of(0))
    used = {(run.task, version) for mode in model.modes for run in mode.runs for version in run.versions}
    found = []
    for task in model.tasks:
        for version in task.versions:
            if (task.name, version.name) in used:
                path = version_of(task.name, version.name)
                found.append(Part(task.name, version, (core,), tuple(tree.add(version, path))))
    return found


def _grow(part: Part, elf: Elf, model: TaskModel, profile: Profile, drivers: Drivers, findings: Findings) -> Version:
    """Return a version whose phases hold its image and transfers; say what was added."""
    old = part.version
    load = load_of(old)
    resource = load.resource if load else _resource_of(old, model)
    sizes = [(segment.size, part.cores[0].memory_at(segment.target)) for segment in elf.segments]
    clock = clock_of(model, profile)
    # Each other core may have a driver called at the same instant.
    patience = profile.patience + clock.up(drivers.longest * (len(model.units) - 1))
    new = grow(old, sizes, resource, clock, patience, partial(drivers.time, part.task))
    if new != old:
        before, after = load.end if load else ZERO, new.accesses[0].end
        total = sum(size for size, _ in sizes)
        message = f"the image has {total} bytes: load phase {before} -> {after}, WCET {old.wcet} -> {new.wcet}"
        findings.add(GREW(message, at=old.at, path=part.path))
    return new


def _resource_of(version: Version, model: TaskModel) -> str:
    """Return the resource over which a version without a load phase is loaded: that of its other phases, if any."""
    used = {access.resource for access in version.accesses}
    return next((r.name for r in model.resources if r.name in used), model.resources[0].name)


def _replaced(model: TaskModel, grown: dict[tuple[str, str], Version]) -> TaskModel:
    tasks = tuple(
        replace(task, versions=tuple(grown.get((task.name, v.name), v) for v in task.versions)) for task in model.tasks
    )
    return replace(model, tasks=tasks)


def _idle_phases(parts: Iterable[Part]) -> Iterable[Diagnostic]:
    for part in parts:
        for access in part.version.accesses:
            if not moves_data(access):
                message = f"the phase {access.start} - {access.end} moves nothing"
                help = "give it transfers; a deployed job reaches main memory in no other way"
                yield IDLE_PHASE(message, at=access.at, path=part.path, help=help)


def _windows_from_start(
    model: TaskModel, parts: Iterable[Part], grown: dict[tuple[str, str], Version]
) -> Iterable[Diagnostic]:
    """Yield the constraints that count from the start of a version that is longer now."""
    growth: dict[str, Duration] = {}
    for part in parts:
        after, before = grown[part.task, part.version.name].wcet, part.version.wcet
        if after and before and after > before:
            growth[part.task] = max(growth.get(part.task, ZERO), after - before)
    for task in model.tasks:
        for version in task.versions:
            for window in version.precedences:
                if window.anchor is Anchor.START and window.task in growth:
                    message = f'the window {window.min} - {window.max} counts from the start of "{window.task}", '
                    message += f"which is up to {growth[window.task]} longer now"
                    help = 'shift the window, or count it from the end: from="end"'
                    path = version_of(task.name, version.name)
                    yield WINDOW_FROM_START(message, at=window.at, path=path, help=help)
