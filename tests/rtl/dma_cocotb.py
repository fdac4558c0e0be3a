"""The DMA engine between the memory and the manager of cocotbext-axi; run by `test_dma_rtl.py`."""

import itertools
import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiRam

SPACE = 1 << 14


@cocotb.test()
async def copies_arrive(dut):
    """Every byte of many transfers arrives, with pauses on all channels of AXI."""
    rng = random.Random(3)
    cocotb.start_soon(Clock(dut.clk, 2, "step").start())
    dut.rst_n.value = 0
    registers = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "l"), dut.clk, dut.rst_n, reset_active_level=False)
    memory = AxiRam(AxiBus.from_prefix(dut, "m"), dut.clk, dut.rst_n, reset_active_level=False, size=SPACE)
    await ClockCycles(dut.clk, 5)
    dut.rst_n.value = 1
    for channel in (
        memory.write_if.aw_channel, memory.write_if.w_channel, memory.write_if.b_channel,
        memory.read_if.ar_channel, memory.read_if.r_channel,
    ):  # fmt: skip
        channel.set_pause_generator(itertools.cycle(rng.choices([0, 0, 0, 1], k=97)))
    for _ in range(20):
        before = bytearray(rng.randbytes(SPACE))
        memory.write(0, bytes(before))
        for number in range(4):
            size, base = rng.choice([1, 8, 64, rng.randrange(900)]), number * 0x1000
            source, target = base + rng.randrange(0x400), base + 0x800 + rng.randrange(0x400)
            before[target : target + size] = before[source : source + size]
            await registers.write_dword(base, 1)
            for offset, value in ((0x08, size), (0x10, target), (0x18, source)):
                await registers.write_qword(base + offset, value)
            await registers.write_dword(base + 4, 0x66000000)
            await registers.write_dword(base, 3)
        for number in range(4):
            while not await registers.read_dword(number * 0x1000) >> 30:
                pass
            assert await registers.read_dword(number * 0x1000) == 1 << 30 | 1
            await registers.write_dword(number * 0x1000, 0)
        assert memory.read(0, SPACE) == bytes(before)
