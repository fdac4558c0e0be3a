# ruff: noqa: E402, E501 - the bundle of the tests is found by the path; texts of C stay on one line
"""Jobs that misbehave, one at a time, on both engines: ``python benchmarks/attacks.py``.

Each attack stands in place of the function of one task of the tests' bundle. It is contained if every finding is of that
task, and reported if there is one. Prints what each engine finds and how long it takes; the last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

TESTS = Path(__file__).parents[1] / "tests"
sys.path.insert(0, str(TESTS))
sys.path.insert(0, str(TESTS / "riscv" / "cosim"))

import conftest as case
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.exporters.native import paired
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow import formats
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.health import with_reactions

if TYPE_CHECKING:
    from halpipe.deploy.base import Target

VICTIM = "act"
PROFILE = "fu540"
ASM = '__asm__ volatile("{}" ::: "memory")'
HEAD = "#include <stdint.h>\n#define AT(a) (*(volatile uint64_t *)(uintptr_t)(a))\nuint64_t smooth[8], command;\n"

ATTACKS = {
    "spins": "for (;;) command++;",
    "spins with interrupts off": ASM.format("csrci mstatus, 8") + "; for (;;) command++;",
    "spins in a jump to itself": ASM.format("1: j 1b") + ";",
    "sleeps in a loop": "for (;;) " + ASM.format("wfi") + ";",
    "calls its monitor": ASM.format("ecall") + ";",
    "calls its monitor in a loop": "for (;;) " + ASM.format("ecall") + ";",
    "breaks": ASM.format("ebreak") + ";",
    "has an illegal instruction": ASM.format(".word 0xffffffff") + ";",
    "returns from a trap": ASM.format("mret") + ";",
    "returns to supervisor mode": ASM.format("sret") + ";",
    "fences for ever": "for (;;) " + ASM.format("fence.i") + ";",
    "reserves for ever": "for (;;) " + '__asm__ volatile("lr.d t0, (%0)\\n sc.d t0, t0, (%0)" ::"r"(&command) : "t0", "memory")' + ";",
    "opens its protection": ASM.format("csrw pmpcfg0, zero") + ";",
    "moves its protection": ASM.format("csrw pmpaddr1, zero") + ";",
    "clears its trap vector": ASM.format("csrw mtvec, zero") + "; for (;;) command++;",
    "disables its timer": ASM.format("csrw mie, zero") + "; for (;;) command++;",
    "delegates traps": ASM.format("csrw medeleg, zero") + ";",
    "reads who it is": ASM.format("csrr t0, mhartid") + ";",
    "puts its deadline off": "AT({clint} + 0x4000u + 8u * 2u) = ~0ull; for (;;) command++;",
    "wakes another core": "*(volatile uint32_t *)(uintptr_t)({clint} + 4u) = 1u;",
    "wakes the management core": "*(volatile uint32_t *)(uintptr_t){clint} = 1u;",
    "starts a transfer": "*(volatile uint32_t *)(uintptr_t){dma} = 3u;",
    "prints": "*(volatile uint32_t *)(uintptr_t){uart} = 65u;",
    "writes main memory": "AT({main}) = 7u;",
    "writes the control block": "AT({control}) = 7u;",
    "writes a buffer": "AT({buffer}) = 7u;",
    "writes another core's data": "AT({other}) = 7u;",
    "writes its own code": "AT({code}) = 7u;",
    "writes its mailbox": "AT({mailbox}) = 7u;",
    "jumps into main memory": "((void (*)(void))(uintptr_t){main})();",
    "jumps into its monitor": "((void (*)(void))(uintptr_t){monitor})();",
    "loads from address 0": "command = AT(0);",
    "stores at an odd address": '__asm__ volatile("sd zero, 4(%0)" ::"r"(smooth));',
    "overflows its stack": "volatile uint8_t big[9000]; for (unsigned i = 0; i < sizeof big; i++) big[i] = 1; command = big[5];",
}  # fmt: skip


def export(folder: Path, body: str = "") -> Target:
    """Export the bundle of the tests, with a body in place of one task's function."""
    folder.mkdir()
    for name in case.SOURCES:
        shutil.copy(case.HERE / name, folder / name)
    if body:
        (folder / f"{VICTIM}.c").write_text(f"{HEAD}void {VICTIM}(void) {{ {body} }}\n")
    system = parse_model(case.HERE.joinpath("model.xml").read_bytes(), str(folder / "model.xml"))
    pair = paired(system, with_reactions(system, case.tables_of(system)))
    model = parse_model(pair["model.xml"], str(folder / "model.xml"))
    schedule = parse_schedule(pair["schedule.xml"], str(folder / "schedule.xml"))
    options = RiscvOptions(profile=PROFILE, toolchain="zig", sources=str(folder))
    write_directory(str(folder / "out"), formats.export("riscv", model, schedule, options))
    return formats.open_target(str(folder / "out"))


def places(target: Target) -> dict[str, str]:
    """Return the addresses that attacks name; the victim runs on the second unit."""
    from halpipe.deploy.riscv.target import read_site

    site = read_site(target.bundle)
    own, other = site.units[1], site.units[0]
    found = {
        "clint": site.clint,
        "dma": site.dma.base,
        "uart": site.uart,
        "main": site.main.base,
        "control": site.control,
        "buffer": next(iter(site.buffers.values())).base,
        "other": other.dspm.base,
        "code": own.ispm.base + 4096,
        "mailbox": own.mailbox,
        "monitor": own.ispm.base,
    }
    return {name: f"{address:#x}ull" for name, address in found.items()}


def attacked(target: Target, engine: str) -> tuple[list[str], list[str], float]:
    """Return the codes that are found of the victim, what is found of others, and the seconds that it takes."""
    begin = time.monotonic()
    try:
        found = DEPLOYMENT.check(target, CheckOptions(engine=engine)).diagnostics
    except HalpipeError as failure:
        found = failure.diagnostics
    errors = [d for d in found if d.is_error]
    own = sorted({d.code for d in errors if f'task "{VICTIM}"' in d.path})
    others = [f"{d.code} {d.path}: {d.message}" for d in errors if f'task "{VICTIM}"' not in d.path]
    return own, others, time.monotonic() - begin


def main() -> int:
    """Try every attack; return 1 if one is not contained, or not reported."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engines", nargs="+", default=["cosim", "qemu"])
    chosen = parser.parse_args()
    contained = dict.fromkeys(chosen.engines, 0)
    longest = 0.0
    with tempfile.TemporaryDirectory() as name:
        addresses = places(export(Path(name) / "sound"))
        for number, (title, body) in enumerate(ATTACKS.items()):
            for key, value in addresses.items():
                body = body.replace(f"{{{key}}}", value)
            target = export(Path(name) / str(number), body)
            for engine in chosen.engines:
                own, others, seconds = attacked(target, engine)
                contained[engine] += bool(own) and not others
                longest = max(longest, seconds)
                said = " ".join(own) or "not reported"
                print(title, engine, said, *others[:2], f"{seconds:.1f} s", sep="; ", flush=True)
    print(json.dumps({"attacks": len(ATTACKS), **contained, "longest": round(longest, 1)}))
    return int(min(contained.values()) < len(ATTACKS))


if __name__ == "__main__":
    sys.exit(main())
