# ruff: noqa: E501 - texts of C stay on one line
"""Jobs that misbehave on purpose: bodies of functions in C, for the co-simulation, QEMU, Spike and the RTL of cores."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.deploy.riscv.target import read_site

if TYPE_CHECKING:
    from halpipe.deploy.base import Target

DECLARED = "#define AT(a) (*(volatile uint64_t *)(uintptr_t)(a))\nuint64_t smooth[8], command;"
"""Before the function of an attack, after the types of C."""
ASM = '__asm__ volatile("{}" ::: "memory")'

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
    "puts its deadline off": "AT({clint} + 0x4000u + 8u * {hart}) = ~0ull; for (;;) command++;",
    "wakes another core": "*(volatile uint32_t *)(uintptr_t)({clint} + 4u * {next}) = 1u;",
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

ENDLESS = ("spins", "spins in a jump to itself", "fences for ever", "reserves for ever")
"""Those that trap nowhere: their timer ends them."""

DMA = 0x3000000
"""Where an attack looks for a DMA engine if the target has none: at no device that a job may use."""


def bodies(target: Target, position: int) -> dict[str, str]:
    """Return the attacks with the addresses of a target, as a job on the unit of this `position` has them."""
    site = read_site(target.bundle)
    own, other = site.units[position], site.units[position - 1]
    found = {
        "clint": site.clint,
        "dma": site.dma.base or DMA,
        "uart": site.uart,
        "main": site.main.base,
        "control": site.control,
        "buffer": next(iter(site.buffers.values())).base,
        "other": other.dspm.base,
        "code": own.ispm.base + 4096,
        "mailbox": own.mailbox,
        "monitor": own.ispm.base,
        "hart": own.hart,
        "next": other.hart,
    }
    texts = dict(ATTACKS)
    for name, address in found.items():
        texts = {title: body.replace(f"{{{name}}}", f"{address:#x}ull") for title, body in texts.items()}
    return texts
