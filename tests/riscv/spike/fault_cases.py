"""Programs of one fault each, as assembly for user mode: what a job may do wrong, and what it may do."""

MAIN, INSTRUCTIONS, DATA, TIMER = 0x80000000, 0x1820000, 0x1040000, 0x2004000
DATA_SIZE, RESERVED = 0x40000, 0x3F000  # of the data scratchpad; from RESERVED on it belongs to the monitor
EDGE = DATA + RESERVED


def at(address, instruction):
    return f"li t1, {address:#x}\n {instruction}"


ACCESSES = {
    **{
        f"l{kind} {place}": (address, f"l{kind} t0, (t1)")
        for kind in ("b", "hu", "w", "d")
        for place, address in (("main", MAIN), ("timer", TIMER), ("nothing", 0x4000_0000), ("monitor", EDGE))
    },
    **{
        f"s{kind} {place}": (address, f"s{kind} t0, (t1)")
        for kind in ("b", "h", "w", "d")
        for place, address in (
            ("main", MAIN),
            ("code", INSTRUCTIONS + 0x800),
            ("nothing", 0x4000_0000),
            ("monitor", EDGE),
        )
    },
    "lw misaligned": (DATA + 2, "lw t0, (t1)"),
    "ld misaligned main": (MAIN + 2, "ld t0, (t1)"),
    "lh misaligned nothing": (0x4000_0001, "lh t0, (t1)"),
    "lw misaligned timer": (TIMER + 2, "lw t0, (t1)"),
    "ld over the edge": (EDGE - 4, "ld t0, (t1)"),
    "ld over two pages": (DATA + 0xFFC, "ld t0, (t1)"),
    "sw misaligned": (DATA + 1, "sw t0, (t1)"),
    "sd misaligned main": (MAIN + 4, "sd t0, (t1)"),
    "sw misaligned timer": (TIMER + 2, "sw t0, (t1)"),
    "lbu code": (INSTRUCTIONS + 0x800, "lbu t0, (t1)"),
    "lwu last": (EDGE - 4, "lwu t0, (t1)"),
    "sd over the edge": (EDGE - 4, "sd t0, (t1)"),
    "amoadd.w main": (MAIN, "amoadd.w t0, t0, (t1)"),
    "amomax.d timer": (TIMER, "amomax.d t0, t0, (t1)"),
    "amoswap.w code": (INSTRUCTIONS + 0x800, "amoswap.w t0, t0, (t1)"),
    "amoadd.w misaligned": (DATA + 2, "amoadd.w t0, t0, (t1)"),
    "amoadd.d misaligned main": (MAIN + 4, "amoadd.d t0, t0, (t1)"),
    "amoand.d over the edge": (EDGE - 4, "amoand.d t0, t0, (t1)"),
    "lr.w main": (MAIN, "lr.w t0, (t1)"),
    "lr.w misaligned": (DATA + 2, "lr.w t0, (t1)"),
    "c.ld main": (MAIN, "mv a0, t1\n c.ld a1, (a0)"),
    "c.sd misaligned": (DATA + 4, "mv a0, t1\n c.sd a1, (a0)"),
}

CASES = {
    **{name: at(address, instruction) for name, (address, instruction) in ACCESSES.items()},
    "sd own": at(DATA + 8, "sd t0, (t1)"),
    "lr, sc own": at(DATA + 8, "lr.d t0, (t1)\n sc.d t0, t0, (t1)"),
    "amoor.w own": at(DATA + 8, "amoor.w t0, t0, (t1)"),
    "fences": "fence\n fence rw, w\n .4byte 0x8330000f\n .4byte 0x0100000f\n fence.i",
    "amoadd.b": ".4byte 0x0062832f",
    "amoadd.h": ".4byte 0x0062932f",
    "jump main": at(MAIN, "jr t1"),
    "jump data": at(DATA, "jr t1"),
    "ecall": "ecall",
    "ebreak": "ebreak",
    "c.ebreak": "c.ebreak",
    "c.illegal": ".2byte 0",
    "all ones": ".4byte 0xffffffff",
    "mret": "mret",
    "sret": "sret",
    "sfence.vma": ".4byte 0x12000073",
    "csrw mscratch": "csrw mscratch, t0",
    "csrr mstatus": "csrr t0, mstatus",
    "csrr mhartid": "csrr t0, mhartid",
    "csrw pmpcfg0": "csrw pmpcfg0, zero",
    "rdcycle": "rdcycle t0",
    "rdtime": "rdtime t0",
    "rdinstret": "rdinstret t0",
    "unknown csr": "csrr t0, 0x5c0",
    "fadd.s": ".4byte 0x00007053",
    "flw": ".4byte 0x00032007",
}
"""`wfi` is not among them: Rocket traps it in user mode, Spike does not."""
