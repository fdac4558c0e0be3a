"""Starts QEMU with a bundle, and reads the main memory that it leaves behind: buffers, control block, trace."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.core.records import record
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.machine import RUBBISH
from halpipe.deploy.riscv.run.cosimulation import MAGIC, PROGRAM, Word
from halpipe.deploy.riscv.run.recording import Recording, read_recording

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.target import Site

EMULATOR = "qemu-system-riscv64"
SECONDS = 6
"""How long one run may take; it is ended then, and what it did until then is judged."""

_MODELLED, _BY_SEMIHOSTING = 1, 1
_NEEDS_TREE = "microchip-icicle-kit"
_MACHINE, _MEMORY = "-machine", "-m"
_OTHER = ["-display", "none", "-monitor", "none", "-serial", "null", "-no-reboot", "-icount", "shift=0,sleep=off"]
_HOSTING = ["-semihosting-config", "enable=on,target=native"]
_WORDS = 18

_STATES = {
    0: "the management core did not come to the first table",
    1: "it was still playing",
    3: "an application core did not answer when it was started",
    4: "the management core trapped",
}
FINISHED = 2


@record
class Played:
    """What a run left: the runtime's record, the words of its control block, and the contents of the buffers."""

    recording: Recording
    words: tuple[int, ...]
    buffers: dict[str, bytes]
    is_over: bool = True

    @property
    def state(self) -> int:
        """The state that the runtime was in."""
        return self.words[Word.STATE]


def find_emulator(site: Site) -> str:
    """Return QEMU's program; raise `HalpipeError` if it is not there, or has no machine for the target."""
    if not site.qemu:
        help = "use --engine cosim, or export with a profile that has one: fu540, mpfs or virt"
        raise HalpipeError(codes.ENGINE_UNFIT(f'QEMU has no machine for profile "{site.profile}"', help=help))
    found = shutil.which(EMULATOR)
    if found is None:
        help = "apt-get install qemu-system-misc, or use --engine cosim"
        raise HalpipeError(codes.ENGINE_ABSENT(f"{EMULATOR} is not installed", help=help))
    return found


def play(
    program: bytes, site: Site, emulator: str, first: int, request: int, tables: int, *, health: bool = True
) -> Played:
    """Run QEMU once, with main memory in a file; without `health` no rule follows from jobs that fail."""
    words = [MAGIC, tables, _MODELLED, first, 0, _BY_SEMIHOSTING, max(site.timebase // 1000, 1), not health, request]
    with scratch_folder() as folder:
        place = Path(folder)
        place.joinpath(PROGRAM).write_bytes(program)
        place.joinpath("control").write_bytes(struct.pack(f"<{len(words)}Q", *words))
        command = [emulator, *_with_memory(site.qemu, place / "memory"), "-bios", "none", "-kernel"]
        command += [str(place / PROGRAM), *_loader(place / "control", site.control), *_rubbish(place, site)]
        if _NEEDS_TREE in site.qemu:
            tree = str(place / "tree")
            start([emulator, _MACHINE, f"sifive_u,dumpdtb={tree}", "-smp", "5", "-display", "none"])
            command += ["-dtb", tree]
        said = start([*command, *_OTHER, *_HOSTING])
        return _read(place / "memory", site, said)


def _loader(file: Path, address: int) -> list[str]:
    return ["-device", f"loader,file={file},addr={address:#x},force-raw=on"]


def _rubbish(place: Path, site: Site) -> list[str]:
    """Return what fills the data scratchpads with what may stand there when the power comes."""
    found = []
    for unit in site.units:
        file = place / f"rubbish-{unit.dspm.size}"
        file.write_bytes(RUBBISH * unit.dspm.size)
        found += _loader(file, unit.dspm.base)
    return found


def _with_memory(arguments: tuple[str, ...], file: Path) -> list[str]:
    """Return QEMU's arguments with main memory in a file that is there afterwards."""
    found = list(arguments)
    if _MACHINE not in found[:-1] or _MEMORY not in found[:-1]:
        help = f"state {_MACHINE} and {_MEMORY} in the profile's qemu"
        raise HalpipeError(codes.ENGINE_UNFIT("the arguments for QEMU name no machine or memory", help=help))
    size = found[found.index(_MEMORY) + 1]
    found[found.index(_MACHINE) + 1] += ",memory-backend=main"
    return [*found, "-object", f"memory-backend-file,id=main,size={size},mem-path={file},share=on"]


def start(command: list[str]) -> str | None:
    """Run a command; return what it said, None if it had to be ended."""
    try:
        done = run(command, seconds=SECONDS)
    except TimeoutExpired:
        return None
    return done.stderr or done.stdout


def _read(file: Path, site: Site, said: str | None) -> Played:
    try:
        memory = file.open("rb")
    except OSError:
        text = " ".join((said or "").split())[-200:]
        help = "use --engine cosim to see more"
        raise HalpipeError(codes.ENGINE_UNFIT(f"QEMU did not start; it said: {text}", help=help)) from None
    with memory:

        def read(address: int, size: int) -> bytes:
            memory.seek(address - site.main.base)
            return memory.read(size).ljust(size, b"\0")

        words = struct.unpack(f"<{_WORDS}Q", read(site.control, 8 * _WORDS))
        traced, faults = (min(words[n], 1 << 32) for n in (Word.TRACED, Word.FAULTS))
        recording = read_recording(read, site.trace, traced, site.faults, faults)
        buffers = {name: read(area.base, area.size) for name, area in site.buffers.items()}
    return Played(recording, words, buffers, said is not None)


def is_over(played: Played) -> Iterator[Diagnostic]:
    """Yield what kept a run from its end."""
    if played.state == FINISHED:
        return
    message = _STATES.get(played.state, f"the runtime is in state {played.state}") + " at the end"
    if not played.is_over:
        message += "; the emulator was ended, for it would not have come to one"
    yield codes.NOT_FINISHED(message, help="play the bundle with --engine cosim to see more")
