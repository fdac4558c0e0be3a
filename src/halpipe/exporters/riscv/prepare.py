"""Prepare a model for a target: load phases as long as the images need, memory phases as long as their transfers.

A model that is prepared already stays as it is.
"""

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
from halpipe.exporters.riscv.growth import grow
from halpipe.exporters.riscv.images import Part, compile_parts, measure
from halpipe.exporters.riscv.phases import clock_of, load_of, moves_data
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Renderer
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.toolchain import find_toolchain
from halpipe.exporters.riscv.workshop import Workshop
from halpipe.models import Anchor, Resource

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.exporters.riscv.drivers import Drivers
    from halpipe.exporters.riscv.elf import Elf
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.models import TaskModel, Version

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
            files[FILE] = render.dummy(most).encode()
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
    sizes = [segment.size for segment in elf.segments]
    clock = clock_of(model, profile)
    # Each other core may have a driver called at the same instant.
    patience = profile.patience + clock.up(drivers.longest * (len(model.units) - 1))
    new = grow(old, sizes, resource, clock, patience, partial(drivers.time, part.task))
    if new != old:
        before, after = load.end if load else ZERO, new.accesses[0].end
        message = f"the image has {sum(sizes)} bytes: load phase {before} -> {after}, WCET {old.wcet} -> {new.wcet}"
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
