"""From a verified schedule and C sources to the files of a bundle (paper, section V)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from halpipe import __version__
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Findings, HalpipeError, version_of
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.exporters.native import paired
from halpipe.exporters.regulator.embedded import FOLDER, embedded
from halpipe.exporters.riscv.codes import LINK_FAILED
from halpipe.exporters.riscv.copies import Copies, copies_of
from halpipe.exporters.riscv.cores import (
    LINE,
    aligned,
    buffer_sizes,
    channels_of,
    check_splits,
    cores_of,
    gapped_versions,
    main_memory,
    places_of,
    slots_of,
    slower,
)
from halpipe.exporters.riscv.drivers import FILE as DRIVERS
from halpipe.exporters.riscv.drivers import check_drivers, compile_drivers, read_drivers, read_inputs
from halpipe.exporters.riscv.images import MINIMAL, Image, Part, compile_parts, compile_runtime, link_images, measure
from halpipe.exporters.riscv.operations import (
    Backlog,
    Operations,
    check_grid,
    check_version,
    find_backlog,
    resets,
    too_short,
)
from halpipe.exporters.riscv.phases import Clock, check_phases, clock_of
from halpipe.exporters.riscv.profile import MONITOR as MONITOR_ROOM
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Health, Renderer, health_of
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.target import target_json
from halpipe.exporters.riscv.toolchain import Compile, Elf, Link, Workshop, find_toolchain, read_elf

if TYPE_CHECKING:
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.exporters.riscv.cores import Core, MainMemory
    from halpipe.exporters.riscv.drivers import Drivers
    from halpipe.exporters.riscv.operations import Program, Table
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.models import Schedule, TaskModel

RUNTIME = Path(__file__).with_name("runtime")
MANAGEMENT = ("start.S", "runtime.c", "dma.c", "health.c", "console.c")
CALIBRATION = ("calibrate.c", "loops.S")
MONITOR = ("monitor.S", "monitor.c")


@record
class Site:
    """Facts known before anything is compiled."""

    profile: Profile
    cores: dict[str, Core]
    channels: dict[str, int]
    memory: MainMemory
    clock: Clock
    parts: tuple[Part, ...]
    health: Health
    drivers: Drivers
    driver_sources: tuple[str, ...]
    inputs: dict[str, bytes]
    calibrates: bool
    copies: Copies
    regulators: dict[str, bytes]
    platform: Platform | None


@record
class Plan:
    """Plan of the management core, and its images."""

    programs: list[Program]
    tables: list[Table]
    backlog: Backlog
    images: list[Image]


def build(model: TaskModel, schedule: Schedule, options: RiscvOptions) -> dict[str, bytes]:
    """Return the files of the bundle, sealed; raise `HalpipeError` with everything that prevents it."""
    profile = read_profile(options.profile)
    findings = Findings()
    tree = SourceTree(Path(options.sources or Path(model.at.file).parent), findings)
    site = _survey(model, schedule, profile, tree, options)
    findings.stop_on_errors()
    toolchain = find_toolchain(options.toolchain)
    render = Renderer(profile)
    with scratch_folder() as folder:
        shop = Workshop(Path(folder), toolchain)
        stage(shop, tree)
        if site.platform is not None and site.platform.base:
            for name in ("table/bw_tables.h", "table/linux/bw_unit.h"):
                shop.write(f"runtime/{Path(name).name}", site.regulators[f"{FOLDER}{name}"])
        slots = slots_of(schedule, site.cores, site.copies.tasks)
        shop.write("runtime/platform.h", render.platform(site, slots.count, len(schedule.modes)))
        needs = compile_parts(shop, site.parts, tree)
        measured = measure(shop, needs, profile, render)
        drivers = compile_drivers(shop, site.drivers, site.driver_sources, tree)
        monitors = _monitors(shop, render, site)
        at = site.memory.images + sum(aligned(elf.stored, LINE) for elf in monitors)
        places, crowded = places_of(measured, gapped_versions(schedule), profile)
        findings.extend(crowded)
        findings.stop_on_errors()
        images = link_images(shop, needs, measured, (at, site.memory.buffers_base), places, render)
        by_name = {(i.part.task, i.part.version.name, i.core.unit): i for i in images}
        operations = Operations(site.clock, site.channels, site.memory, by_name, slots, site.drivers, site.copies)
        tables = operations.tables(schedule)
        backlog = find_backlog(tables, operations.programs, slower(profile, slots))
        findings.extend(too_short(operations.programs, backlog, site.parts, profile))
        findings.extend(resets(tables, backlog, profile))
        findings.extend(site.copies.conflicts(tables, operations.programs, site.memory, model, site.clock))
        findings.stop_on_errors()
        plan = Plan(operations.programs, tables, backlog, images)
        elf = _program(shop, render, site, model.name, plan, monitors, drivers)
        files = paired(model, schedule) | _descriptions(shop, render, site, model, plan) | _built(shop)
        files |= ({DRIVERS: site.drivers.text} if site.drivers else {}) | site.inputs
    files |= {"bundle.elf": elf, "bundle.bin": _flat(elf, site.memory.base)}
    files |= site.regulators
    facts = {
        "model": model.name,
        "profile": profile.name,
        "toolchain": toolchain.title,
        "generator": f"halpipe {__version__}",
    }
    return seal("riscv", files, facts | ({"regulator": site.platform.backend} if site.platform else {}))


def _survey(model: TaskModel, schedule: Schedule, profile: Profile, tree: SourceTree, options: RiscvOptions) -> Site:
    """Collect what is used and where it will be; findings go where those of the sources go."""
    findings, drivers = tree.findings, read_drivers(options.drivers)
    used: dict[tuple[str, str], set[str]] = {}
    for job in schedule.all_jobs():
        used.setdefault((job.task, job.version), set()).update(job.units)
    cores = cores_of(model, {unit for units in used.values() for unit in units}, profile, findings)
    findings.stop_on_errors()
    clock = clock_of(model, profile)
    parts: list[Part] = []
    for task in model.tasks:
        for version in task.versions:
            if (task.name, version.name) in used:
                linked = tuple(cores[name] for name in cores if name in used[task.name, version.name])
                path = version_of(task.name, version.name)
                part = Part(task.name, version, linked, tuple(tree.add(version, path)))
                if check_phases(version, path, findings) and version.source is not None:
                    check_version(part, clock, findings)
                parts.append(part)
    versions = [part.version for part in parts]
    copies = copies_of(model, schedule, [(part.task, part.version) for part in parts], clock, profile, findings)
    channels = channels_of(model, versions, profile, findings, copies=bool(copies.turns))
    sizes = buffer_sizes([(part.path, part.version) for part in parts], findings)
    memory = main_memory(profile, sizes, findings, copies.shadows)
    check_drivers(drivers, parts, sizes, findings)
    inputs = read_inputs(options.inputs, parts, sizes, findings)
    sources = tuple(tree.take(drivers.sources, "drivers"))
    check_grid(schedule, clock, findings)
    check_splits(model, schedule, findings)
    health = health_of(model, schedule)
    regulators, platform = embedded(model, schedule, options.regulator)
    return Site(
        profile, cores, channels, memory, clock, tuple(parts), health, drivers, sources, inputs, options.calibrate,
        copies, regulators, platform,
    )  # fmt: skip


def stage(shop: Workshop, tree: SourceTree) -> None:
    """Put all sources into the folder, but for what is made for the target."""
    for name, content in tree.files.items():
        shop.write(name, content)
    for file in sorted(RUNTIME.iterdir()):
        if file.suffix in (".c", ".h", ".S"):
            shop.write(f"runtime/{file.name}", file.read_bytes())


def _compile_runtime(shop: Workshop, names: tuple[str, ...]) -> tuple[str, ...]:
    """Compile files of the runtime; return their objects."""
    stems = [name.removesuffix(".c").replace(".S", "_S") for name in names]
    steps = [Compile(f"runtime/{n}", f"build/runtime/{stem}.o") for n, stem in zip(names, stems, strict=True)]
    compile_runtime(shop, steps)
    return tuple(step.target for step in steps)


def _link_runtime(shop: Workshop, steps: list[Link]) -> None:
    help = "the tables may be too many for the space that the runtime has: deploy fewer modes at once; or drivers need "
    help += "what none of their sources defines, or define what the runtime does"
    failures = [LINK_FAILED(f"{steps[f.position].target}: {f.said[-500:]}", help=help) for f in shop.link(steps)]
    if failures:
        raise HalpipeError(*failures)


def _monitors(shop: Workshop, render: Renderer, site: Site) -> list[Elf]:
    objects = (*_compile_runtime(shop, MONITOR), MINIMAL.target)
    steps = []
    for core in site.cores.values():
        script = f"link/monitor{core.hart}.ld"
        shop.write(script, render.fill("monitor.ld", core=core, stack=site.profile.stack, room=MONITOR_ROOM))
        steps.append(Link(script, f"build/images/monitor{core.hart}.elf", objects))
    _link_runtime(shop, steps)
    return [read_elf(shop.read(step.target)) for step in steps]


def _program(
    shop: Workshop, render: Renderer, site: Site, name: str, plan: Plan, monitors: list[Elf], drivers: tuple[str, ...]
) -> bytes:
    """Link runtime, tables and images to the one program that is loaded."""
    pieces, places = [], []
    at = front = site.memory.images
    for core, elf in zip(site.cores.values(), monitors, strict=True):
        segment = elf.segments[0]
        pieces.append((f"images/monitor{core.hart}.elf", segment.offset, segment.size, at - front))
        places.append((core, (at, segment.size)))
        front = at + segment.size
        at = aligned(front, LINE)
    for image in plan.images:
        for segment in image.elf.segments:
            pieces.append((image.file, segment.offset, segment.size, segment.source - front))
            front = segment.source + segment.size
    shop.write("runtime/images.S", render.fill("images.S", pieces=pieces))
    shop.write("runtime/tables.c", render.tables(name, site, plan, places))
    shop.write("link/bundle.ld", render.fill("bundle.ld", memory=site.memory))
    names = (*MANAGEMENT, *(CALIBRATION if site.calibrates else ()), "tables.c", "images.S")
    names += ("regulator.c",) if site.platform is not None and site.platform.base else ()
    objects = _compile_runtime(shop, names)
    _link_runtime(shop, [Link("link/bundle.ld", "build/bundle.elf", (*objects, *drivers, MINIMAL.target))])
    return shop.read("build/bundle.elf")


def _descriptions(shop: Workshop, render: Renderer, site: Site, model: TaskModel, plan: Plan) -> dict[str, bytes]:
    cores, memory, title = list(site.cores.values()), site.memory, shop.toolchain.title
    readme = render.fill(
        "README.md",
        model=model,
        generator=f"halpipe {__version__}",
        toolchain=title,
        cores=cores,
        memory=memory,
        tables=plan.tables,
        buffers=memory.buffers,
    )
    return {
        "target.json": target_json(site, title, plan),
        "profile.yaml": site.profile.text,
        "README.md": readme.encode(),
        "Makefile": render.makefile(shop).encode(),
        **{name: text.encode() for name, text in render.board(memory).items()},
    }


def _built(shop: Workshop) -> dict[str, bytes]:
    """Return what the program was made of: sources, scripts and images."""
    kept = {step.source for step in shop.compiles} | {step.script for step in shop.links}
    own = [*(shop.folder / "runtime").glob("*.h"), *(shop.folder / "src").rglob("*")]
    kept |= {path.relative_to(shop.folder).as_posix() for path in own if path.is_file()}
    files = {name: shop.read(name) for name in sorted(kept)}
    return files | {step.target.removeprefix("build/"): shop.read(step.target) for step in shop.links[:-1]}


def _flat(elf: bytes, base: int) -> bytes:
    """Return the program as it lies in main memory from `base` on."""
    content = bytearray()
    for segment in read_elf(elf).segments:
        content += bytes(segment.source - base - len(content))
        content += elf[segment.offset : segment.offset + segment.size]
    return bytes(content)
