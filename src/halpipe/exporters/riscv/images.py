"""Task images: compiled once for each version, linked for each core, measured and checked."""

from __future__ import annotations

import posixpath
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Diagnostic, Findings, HalpipeError, Location, Path, version_of
from halpipe.core.durations import ZERO
from halpipe.core.quantities import format_size
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import (
    COMPILE_FAILED,
    INITIALISED,
    LINK_FAILED,
    MAIN_MEMORY_FULL,
    MISSING_ENTRY,
    MISSING_SYMBOL,
    NAME_CLASH,
    NO_RESERVATIONS,
    OVERWRITTEN,
    SYMBOL_TOO_SMALL,
)
from halpipe.exporters.riscv.cores import LINE, Core, aligned, sizes_of, too_large
from halpipe.exporters.riscv.phases import functions_of, phases_of
from halpipe.exporters.riscv.toolchain import Compile, Elf, Failure, Link, Workshop, compiler_errors, read_elf
from halpipe.models import AccessKind, Transfer, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.exporters.riscv.profile import Profile
    from halpipe.exporters.riscv.render import Renderer
    from halpipe.exporters.riscv.sources import SourceTree

MINIMAL = Compile("runtime/minimal.c", "build/runtime/minimal.o")


@record
class Part:
    """A version that is deployed: `cores` are those that it is linked for, `sources` its files to compile."""

    task: str
    version: Version
    cores: tuple[Core, ...]
    sources: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The version's name in diagnostics."""
        return version_of(self.task, self.version.name)

    @property
    def symbols(self) -> tuple[str, ...]:
        """The variables that its transfers name."""
        return tuple(sorted({t.symbol for access in self.version.accesses for t in access.transfers}))

    @property
    def defines(self) -> tuple[str, ...]:
        """The definitions for the preprocessor."""
        return self.version.source.defines if self.version.source else ()


@record
class Image:
    """A version as it is executed on one core."""

    part: Part
    core: Core
    file: str
    elf: Elf

    @property
    def entries(self) -> tuple[int, ...]:
        """The addresses of its functions, one for each stretch of execution."""
        return tuple(self.elf.address(name) for name in functions_of(self.part.version))

    @property
    def bss(self) -> tuple[int, int]:
        """Area that the monitor clears: first address, and number of bytes."""
        begin = self.elf.address("hp_bss_begin")
        return begin, self.elf.address("hp_bss_end") - begin


def compile_parts(shop: Workshop, parts: Iterable[Part], tree: SourceTree) -> dict[Part, tuple[str, ...]]:
    """Compile every source once for each set of definitions; return the objects of every part.

    Raise `HalpipeError` with everything that the compiler refuses.
    """
    objects: dict[tuple[str, tuple[str, ...]], tuple[str, Part]] = {}
    needs = {}
    for part in parts:
        for source in part.sources:
            objects.setdefault((source, part.defines), (f"build/obj/{len(objects)}.o", part))
        needs[part] = (*(objects[source, part.defines][0] for source in part.sources), MINIMAL.target)
    steps = [Compile(source, target, defines) for (source, defines), (target, _) in objects.items()]
    findings = Findings()
    compile_sources(shop, steps, [part.path for _, part in objects.values()], tree, findings)
    findings.stop_on_errors()
    compile_runtime(shop, [MINIMAL])
    return needs


def compile_runtime(shop: Workshop, steps: list[Compile]) -> None:
    """Compile files of the runtime; raise `HalpipeError` with what the compiler refuses."""
    help = "the toolchain cannot compile halpipe's own runtime: try the other one, or another version"
    refused = [COMPILE_FAILED(f"{steps[f.position].source}: {f.said[-500:]}", help=help) for f in shop.compile(steps)]
    if refused:
        raise HalpipeError(*refused)


def compile_sources(
    shop: Workshop,
    steps: list[Compile],
    owners: Sequence[str],
    tree: SourceTree,
    findings: Findings,
) -> None:
    """Compile the user's sources, and collect the compiler's errors; `owners` name the sources in messages."""
    for failure in shop.compile(steps):
        findings.extend(_refused(failure, steps[failure.position], owners[failure.position], tree))


def _refused(failure: Failure, step: Compile, path: str, tree: SourceTree) -> Iterable[Diagnostic]:
    """Yield what a compiler said, at lines of files that were taken: `#line` may name any other, to have it quoted."""
    found = compiler_errors(failure.said)
    help = "correct the source; it is compiled freestanding as C11, without a C library"
    source = Location(str(tree.folder / step.source.removeprefix("src/")))
    for file, line, text in found:
        staged = posixpath.normpath(file)
        if staged in tree.files:
            at = Location(str(tree.folder / staged.removeprefix("src/")), line)
            yield COMPILE_FAILED(text, at=at, path=path, help=help)
        else:
            yield COMPILE_FAILED(f"{text} ({file} line {line})", at=source, path=path, help=help)
    if not found:
        said = [line for line in failure.said.splitlines() if not line.startswith(" ")]  # without lines of sources
        yield COMPILE_FAILED("\n".join(said)[-400:], at=source, path=path, help=help)


def measure(shop: Workshop, needs: dict[Part, tuple[str, ...]], profile: Profile, render: Renderer) -> dict[Part, Elf]:
    """Link every part for the first of its cores to know its size, which is the same on each; check what it defines."""
    steps = []
    for i, part in enumerate(needs):
        script = f"link/measure{i}.ld"
        shop.write(script, render.image_script(part, part.cores[0], 0))
        steps.append(Link(script, f"build/measure/{i}.elf", needs[part]))
    findings = Findings()
    failures = {failure.position: failure for failure in shop.link(steps, is_final=False)}
    measured = {}
    for i, part in enumerate(needs):
        if i in failures:
            findings.extend(_unlinkable(failures[i], part))
            continue
        measured[part] = read_elf(shop.read(steps[i].target))
        findings.extend(_faults(part, measured[part], profile))
    findings.stop_on_errors()
    return measured


def _unlinkable(failure: Failure, part: Part) -> Iterable[Diagnostic]:
    source = part.version.source
    assert source is not None
    errors = [line for line in failure.said.splitlines() if "warning:" not in line and not line.startswith(">>>")]
    text = " ".join(" ".join(errors).split())[:400]
    if "duplicate symbol" in text or "multiple definition" in text:
        yield NAME_CLASH(text, at=source.at, path=part.path, help="rename one of them, or make it static")
    else:
        help = "define it in a source of the version; there is no C library and no floating point"
        yield LINK_FAILED(text, at=source.at, path=part.path, help=help)


def _faults(part: Part, elf: Elf, profile: Profile) -> Iterable[Diagnostic]:
    source = part.version.source
    assert source is not None
    for name in functions_of(part.version):
        if name not in elf.symbols:
            help = "define it in one of the files " + ", ".join(source.files)
            yield MISSING_ENTRY(f'no source defines the function "{name}"', at=source.at, path=part.path, help=help)
    for transfer in (t for access in part.version.accesses for t in access.transfers):
        fault = _fault_of(transfer, elf)
        if fault is not None:
            code, message, help = fault
            yield code(message, at=transfer.at, path=part.path, help=help)
    if elf.reserving and not profile.dspm.has_reservations:
        message = f"its code has {len(elf.reserving)} lr or sc, the first at {elf.reserving[0]:#x}"
        help = "use atomic types of 32 or 64 bits, add, and, or, xor, swap, min or max only, or no atomic operations"
        yield NO_RESERVATIONS(message, at=source.at, path=part.path, help=help)
    yield from _overwritten(part, elf)
    yield from too_large(part, part.cores[0], sizes_of(elf, part, profile), profile)


def _fault_of(transfer: Transfer, elf: Elf) -> tuple[Code, str, str] | None:
    """Return code, message and help for a variable that a transfer cannot use; None if there is nothing wrong."""
    name, size = transfer.symbol, transfer.size
    symbol = elf.symbols.get(name)
    if symbol is None:
        return MISSING_SYMBOL, f'no source defines the variable "{name}"', f"define it: uint8_t {name}[{size}];"
    if not symbol.is_unique:
        return NAME_CLASH, f'several variables are called "{name}"', "rename one of them"
    if symbol.size < size:
        return SYMBOL_TOO_SMALL, f'moves {size} bytes, but "{name}" has {symbol.size}', "make the sizes agree"
    if any(s.target <= symbol.address < s.target + s.size for s in elf.segments):
        help = f"define it without one (uint8_t {name}[{size}];), and set it in the function"
        return INITIALISED, f'"{name}" has an initial value', help
    if elf.address("hp_bss_begin") <= symbol.address < elf.address("hp_bss_end"):
        message = f'"{name}" shares a section with other variables, and would be cleared with them'
        return MISSING_SYMBOL, message, "define it as a plain global variable, without attributes"
    return None


def _overwritten(part: Part, elf: Elf) -> Iterable[Diagnostic]:
    """Yield transfers that fill what another one has filled, with no execution between them."""
    filled: list[tuple[int, int, str]] = []
    front = ZERO
    for access in phases_of(part.version):
        if access.start > front:
            filled.clear()  # a function runs
        front = max(front, access.end)
        for transfer in access.transfers if access.kind is not AccessKind.WRITE else ():
            symbol = elf.symbols.get(transfer.symbol)
            if symbol is None:
                continue
            low, high = symbol.address, symbol.address + transfer.size
            for begin, end, buffer in filled:
                if low < end and begin < high:
                    message = f'"{transfer.buffer}" is read into "{transfer.symbol}" over what "{buffer}" brought there'
                    help = "give each buffer a variable of its own"
                    yield OVERWRITTEN(message, at=transfer.at, path=part.path, help=help)
            filled.append((low, high, transfer.buffer))


def link_images(
    shop: Workshop,
    needs: dict[Part, tuple[str, ...]],
    measured: dict[Part, Elf],
    room: tuple[int, int],
    places: dict[tuple[Part, Core], tuple[int, int]],
    render: Renderer,
) -> list[Image]:
    """Link every part for each of its cores, packed one after the other into `room` (first address, end).

    `places` are those in the scratchpads: how far behind other images code and data lie.
    """
    at, end = room
    placed: list[tuple[Part, Core, Link]] = []
    for part in needs:
        for core in part.cores:
            number = len(placed)
            script, target = f"link/{number}.ld", f"build/images/{number}.elf"
            shop.write(script, render.image_script(part, core, at, places[part, core]))
            placed.append((part, core, Link(script, target, needs[part])))
            at = aligned(at + measured[part].stored, LINE)
    findings = Findings()
    if at > end:
        help = "use fewer or smaller versions, or make main memory in the profile larger"
        findings.add(
            MAIN_MEMORY_FULL(f"{len(placed)} images need {format_size(at - end)} more than there is", help=help)
        )
    findings.stop_on_errors()
    for failure in shop.link([step for _, _, step in placed]):
        findings.extend(_unlinkable(failure, placed[failure.position][0]))
    findings.stop_on_errors()
    images = []
    for part, core, step in placed:
        elf = read_elf(shop.read(step.target))
        assert elf.stored == measured[part].stored, "an image has the same size on every core"
        images.append(Image(part, core, step.target.removeprefix("build/"), elf))
    return images
