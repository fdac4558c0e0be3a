"""The AXI4 top with one unit between the manager and the memory of cocotbext-axi; run by `test_regulator_rtl.py`."""

import itertools
import random

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, with_timeout
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiMaster, AxiRam, AxiResp

LONGEST, SPACE = 128, 1 << 14


@cocotb.test()
async def short_bursts_arrive_and_long_ones_are_refused(dut):
    """Of every size; a refused write changes nothing, and later bursts of the same ID go on."""
    rng = random.Random(5)
    cocotb.start_soon(Clock(dut.clk, 2, "step").start())
    dut.rst_n.value = 0
    for name in ("now", "link_valid_i", "link_table_i", "link_barred_i"):
        getattr(dut, name).value = 0
    registers = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "l"), dut.clk, dut.rst_n, reset_active_level=False)
    manager = AxiMaster(AxiBus.from_prefix(dut, "s"), dut.clk, dut.rst_n, reset_active_level=False, max_burst_len=256)
    memory = AxiRam(AxiBus.from_prefix(dut, "m"), dut.clk, dut.rst_n, reset_active_level=False, size=SPACE)
    await ClockCycles(dut.clk, 5)
    dut.rst_n.value = 1
    reads, writes = memory.read_if, memory.write_if
    ours = (manager.write_if.aw_channel, manager.write_if.w_channel, manager.write_if.b_channel)
    ours += (manager.read_if.ar_channel, manager.read_if.r_channel)
    for channel in (*ours, writes.aw_channel, writes.w_channel, writes.b_channel, reads.ar_channel, reads.r_channel):
        channel.set_pause_generator(itertools.cycle(rng.choices([0, 0, 0, 1], k=97)))
    for address, value in ((0x28, LONGEST), (0x100014, 4096), (0x100018, 4096)):
        await registers.write_dword(address, value)
    expected, seen = bytearray(SPACE), {True: 0, False: 0}
    for _ in range(120):
        size, length = rng.randrange(4), rng.randrange(1, rng.choice([17, 17, 257]))
        address, name = rng.randrange(0x1000) // 8 * 8, rng.randrange(16)
        data = rng.randbytes(min(length << size, 0x1000 - address % 0x1000))
        is_long = 8 * -(-len(data) // (1 << size)) > LONGEST
        seen[is_long] += 1
        if rng.randrange(2):
            done = await with_timeout(manager.write(address, data, awid=name, size=size), 200_000, "step")
            if not is_long:
                expected[address : address + len(data)] = data
        else:
            done = await with_timeout(manager.read(address, len(data), arid=name, size=size), 200_000, "step")
            assert is_long or done.data == bytes(expected[address : address + len(data)])
        assert done.resp == (AxiResp.SLVERR if is_long else AxiResp.OKAY)
    assert memory.read(0, SPACE) == bytes(expected)
    assert min(seen.values()) > 30
