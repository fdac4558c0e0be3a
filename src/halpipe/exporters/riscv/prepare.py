"""Prepare a model for a target: load phases, memory phases as long as their transfers, dummies for missing sources."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, version_of
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.exporters.riscv.bundle import stage
from halpipe.exporters.riscv.codes import GREW, IDLE_PHASE, WINDOW_FROM_START
from halpipe.exporters.riscv.copies import patience_of, turns_of
from halpipe.exporters.riscv.cores import Core
from halpipe.exporters.riscv.drivers import Drivers, read_drivers
from halpipe.exporters.riscv.images import Part, compile_parts, measure
from halpipe.exporters.riscv.phases import Clock, clock_of, functions_of, load_of, memory_of, moves_data, shares, spans
from halpipe.exporters.riscv.profile import Profile, read_profile
from halpipe.exporters.riscv.render import Renderer
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.toolchain import Elf, Workshop, find_toolchain
from halpipe.models import Access, AccessKind, Anchor, Resource, Source, Task, TaskModel, Transfer, Version

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.exporters.riscv import RiscvOptions

FILE = "halpipe_dummy.c"
SYMBOL = "dummy_words"

SHARE = Fraction(9, 10)
"""How much of the time that an execution surely has is spent with counting."""

START = Duration.parse("5us")
"""What a core needs besides counting; it also may start late, since the management core has other things to do."""

INSTRUCTIONS = 2
"""Instructions of one count, see templates/dummy.c."""


_LEAST, _MOST = 64, 8192
"""Bytes that a memory phase moves; whole DMA transactions."""


def with_dummies(model: TaskModel, profile: Profile, clock: Clock) -> tuple[TaskModel, int]:
    """Give every version without sources dummy ones; return the model and the most functions that one needs."""
    most = 0
    tasks = []
    for task in model.tasks:
        versions = []
        for version in task.versions:
            if version.source is None and version.wcet is not None:
                version = _dummy(task, version, profile, clock)
            if version.source is not None and FILE in version.source.files:
                most = max(most, len(functions_of(version)))
            versions.append(version)
        tasks.append(replace(task, versions=tuple(versions)))
    return replace(model, tasks=tuple(tasks)), most


def _dummy(task: Task, version: Version, profile: Profile, clock: Clock) -> Version:
    assert version.wcet is not None, "models without WCET have no dummies"
    lost = clock.tick * profile.patience + START
    phases = _without_scraps(_on_grid(version, version.wcet, clock), version.wcet, lost * 2)
    phases = _with_directions(phases, version.wcet, clock)
    size = min([_MOST, *(_fitting(access, clock) for access in phases if _is_window(access))]) // _LEAST * _LEAST
    buffer = f"{task.name}/{version.name}/dummy"
    transfer = Transfer(buffer=buffer, symbol=SYMBOL, size=max(size, _LEAST))
    moving = tuple(replace(a, transfers=(transfer,)) if _is_window(a) and not a.transfers else a for a in phases)
    version = replace(version, accesses=moving)
    pieces = ((clock.up(begin), clock.down(end)) for begin, end in spans(version, cut=True))
    executions = [end - begin for begin, end in pieces if end > begin]
    rate = SHARE * profile.clock / profile.cpi / INSTRUCTIONS
    most = [max(int((clock.tick * ticks - lost).in_unit("s") * rate), 1) for ticks in executions]
    counts = [f"COUNT_{n}={count}" for n, count in enumerate(most)]
    entry = " ".join(f"dummy_{n}" for n in range(len(executions)))
    source = Source(files=(FILE,), entry=entry or "dummy_0", defines=(f"WORDS={transfer.size // 8}", *counts))
    return replace(version, source=source)


def _is_window(access: Access) -> bool:
    return access.kind in (AccessKind.READ, AccessKind.WRITE)


def _on_grid(version: Version, wcet: Duration, clock: Clock) -> list[Access]:
    """Return the phases by their start, widened to ticks, so that later shifts by ticks change no execution."""
    widened = (
        replace(a, start=clock.tick * clock.down(a.start), end=min(clock.tick * clock.up(a.end), wcet))
        for a in version.accesses
    )
    return sorted(widened, key=lambda access: (access.start, access.end))


def _without_scraps(phases: list[Access], wcet: Duration, least: Duration) -> list[Access]:
    """Widen windows over executions that would be shorter than `least`: too short to be begun and ended."""
    found: list[Access] = []
    front = ZERO
    for access in phases:
        if access.kind is None and ZERO < access.start - front < least:
            access = replace(access, start=front)
        front = max(front, access.end)
        found.append(access)
    if found and found[-1].kind is None and found[-1].end == front and ZERO < wcet - front < least:
        found[-1] = replace(found[-1], end=wcet)
    return found


def _with_directions(phases: list[Access], wcet: Duration, clock: Clock) -> list[Access]:
    """Say of each window whether data goes (after an execution), comes (before one), or first goes and then comes.

    Windows that share their resource with others stay as they are: nothing can be moved in them.
    """
    found = []
    front = ZERO
    for access, following in zip(phases, [*(a.start for a in phases), wcet][1:], strict=True):
        goes = access.start > front
        front = max(front, access.end)
        comes = following > front
        if access.kind is not None or access.bound != 1 or not (goes or comes):
            found.append(access)
        elif goes and comes:
            middle = clock.tick * clock.up((access.start + access.end) / 2)
            found.append(replace(access, end=middle, kind=AccessKind.WRITE))
            found.append(replace(access, start=middle, kind=AccessKind.READ))
        else:
            found.append(replace(access, kind=AccessKind.WRITE if goes else AccessKind.READ))
    return [access for access in found if access.start < access.end]


def _fitting(access: Access, clock: Clock) -> int:
    time = clock.tick * (clock.down(access.end) - clock.up(access.start)) - clock.setup
    return int(time.in_unit("s") * clock.bandwidths[access.resource])


def grow(
    version: Version,
    sizes: Sequence[tuple[int, str]],
    resource: str,
    clock: Clock,
    patience: int,
    driving: Callable[[Access], Duration],
    copying: int,
) -> Version:
    """Return a version whose phases hold its transfers, each `patience` ticks more than they take.

    `sizes` are those of the parts of its image, with their memories; a load phase that it lacks is made on `resource`.
    `driving` tells how long drivers take in a phase before its transfers begin; inputs are there after `copying` ticks.
    """
    assert version.wcet is not None, "models without WCET do not validate"
    load = load_of(version)
    first = load or Access(resource=resource, start=ZERO, end=ZERO, kind=AccessKind.LOAD)
    loading = patience + version.gang * sum(clock.transfer(first.resource, *size) for size in sizes)
    loading = max(loading, copying)
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


def prepare(model: TaskModel, options: RiscvOptions, *, dummy: bool) -> Prepared:
    """Return the model with the phases that its images need; raise `HalpipeError` if these cannot be made."""
    profile = read_profile(options.profile)
    render = Renderer(profile)
    if not model.resources:
        model = replace(model, resources=(Resource(name=MAIN_MEMORY, bandwidth=profile.dma.bandwidth),))
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
        stage(shop, tree)
        measured = measure(shop, compile_parts(shop, parts, tree), profile, render)
    drivers = read_drivers(options.drivers)
    turns = turns_of(
        model, [(part.task, part.version) for part in measured], clock_of(model, profile), patience_of(model, profile)
    )
    copying = {turn.task: turn.after + turn.length for turn in turns if turn.kind is AccessKind.READ}
    grown = {
        (part.task, part.version.name): _grow(part, elf, model, profile, drivers, findings, copying.get(part.task, 0))
        for part, elf in measured.items()
    }
    versions = {t.name: tuple(grown.get((t.name, v.name), v) for v in t.versions) for t in model.tasks}
    model = replace(model, tasks=tuple(replace(t, versions=versions[t.name]) for t in model.tasks))
    findings.extend(_windows_from_start(model, parts, grown))
    findings.extend(_idle_phases(parts))
    return Prepared(model, files, tuple(findings.items))


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


def _grow(
    part: Part, elf: Elf, model: TaskModel, profile: Profile, drivers: Drivers, findings: Findings, copying: int
) -> Version:
    """Return a version whose phases hold its image and transfers; say what was added."""
    old = part.version
    load = load_of(old)
    used = [load.resource] if load else [access.resource for access in old.accesses]
    resource = next((r.name for r in model.resources if r.name in used), model.resources[0].name)
    sizes = [(segment.size, part.cores[0].memory_at(segment.target)) for segment in elf.segments]
    clock = clock_of(model, profile)
    # Each other core may have a driver called at the same instant.
    patience = profile.patience + clock.up(drivers.longest * (len(model.units) - 1))
    new = grow(old, sizes, resource, clock, patience, partial(drivers.time, part.task), copying)
    if new != old:
        before, after = load.end if load else ZERO, new.accesses[0].end
        total = sum(size for size, _ in sizes)
        message = f"the image has {total} bytes: load phase {before} -> {after}, WCET {old.wcet} -> {new.wcet}"
        findings.add(GREW(message, at=old.at, path=part.path))
    return new


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
