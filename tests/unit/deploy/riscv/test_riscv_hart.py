"""One emulated core: its clock, its sleep, its interrupts and traps, and the memory that its protection leaves it."""

import pytest

pytest.importorskip("unicorn", reason="pip install unicorn")

from halpipe.deploy.riscv.board.devices import Clint
from halpipe.deploy.riscv.board.hart import NEVER, Hart
from halpipe.deploy.riscv.board.memory import Memory, Region

CODE, DATA, OTHER, CLINT = 0x1820000, 0x1040000, 0x80000000, 0x2000000
CYCLE, TICK = 10, 1000  # units

NOP, WFI, MRET, EBREAK, C_NOP = 0x00000013, 0x10500073, 0x30200073, 0x00100073, 0x0001
MSTATUS, MIE, MTVEC, MEPC, MCAUSE, MTVAL, MIP, MHARTID, MCYCLE = (
    *(0x300, 0x304, 0x305, 0x341, 0x342, 0x343, 0x344),
    *(0xF14, 0xB00),
)
ZERO, RA, T0, T1, A0, A1, A2 = 0, 1, 5, 6, 10, 11, 12


def lui(rd, value):
    return (value & 0xFFFFF000) | rd << 7 | 0x37


def addi(rd, rs, value):
    return (value & 0xFFF) << 20 | rs << 15 | rd << 7 | 0x13


def csrw(csr, rs):
    return csr << 20 | rs << 15 | 1 << 12 | 0x73


def csrr(rd, csr):
    return csr << 20 | 2 << 12 | rd << 7 | 0x73


def csrsi(csr, value):
    return csr << 20 | value << 15 | 6 << 12 | 0x73


def sd(rs, base, offset=0):
    return (offset >> 5 & 0x7F) << 25 | rs << 20 | base << 15 | 3 << 12 | (offset & 31) << 7 | 0x23


def ld(rd, base, offset=0):
    return (offset & 0xFFF) << 20 | base << 15 | 3 << 12 | rd << 7 | 0x03


LR = 2


def amo(function, rd, base):
    return function << 27 | base << 15 | 2 << 12 | rd << 7 | 0x2F


def srli(rd, bits):
    return bits << 20 | rd << 15 | 5 << 12 | rd << 7 | 0x13


def constant(rd, value):
    low = (value & 0xFFF) - ((value & 0x800) << 1)
    return lui(rd, value - low), addi(rd, rd, low)


def bnez(rs, offset):
    o = offset & 0x1FFF
    return (
        (o >> 12) << 31 | (o >> 5 & 0x3F) << 25 | rs << 15 | 1 << 12 | (o >> 1 & 0xF) << 8 | (o >> 11 & 1) << 7 | 0x63
    )


def jalr(rd, rs):
    return rs << 15 | rd << 7 | 0x67


JUMP_HERE = 0x0000006F


class World:
    """A machine that takes down what its only core tells it."""

    def __init__(self):
        self.traps, self.reached_at, self.slept = [], [], []

    def reached(self, hart, address):
        self.reached_at.append((address, hart.now))

    def trapped(self, hart, cause, pc, value):
        self.traps.append((cause, pc, value))
        return False

    def sleeps(self, hart, enabled):
        self.slept.append((hart.now, enabled))

    def spent(self, hart):
        self.slept.append((hart.now, "spent"))

    def called(self):
        return True


@pytest.fixture
def core():
    """Make a core with a program at the beginning of its code, interrupts handled by a sleep at CODE + 0x800."""

    def make(*words, number=1):
        regions = (Region("code", CODE, 0x2000, 1), Region("data", DATA, 0x2000, 1), Region("main", OTHER, 0x1000))
        memory = Memory(regions, 2)
        clint = Clint(CLINT, TICK, lambda hart, n, value: setattr(hart, "software", bool(value)))
        hart = Hart(number, memory, [clint], CYCLE, TICK)
        clint.harts = [hart, hart]
        hart.world = World()
        write(memory, CODE, *words)
        write(memory, CODE + 0x800, WFI, JUMP_HERE)
        hart.hook_registers(memory.read(CODE, 0x1000), CODE)
        hart.pc = CODE
        return hart, memory

    return make


def write(memory, address, *words):
    for word in words:
        size = 4 if word & 3 == 3 else 2
        memory.write(address, word.to_bytes(size, "little"))
        address += size


def handler():
    """Set mtvec to CODE + 0x800."""
    return lui(T0, CODE + 0x1000), addi(T0, T0, -0x800), csrw(MTVEC, T0)


def test_every_instruction_takes_a_cycle(core):
    hart, _ = core(C_NOP, NOP, C_NOP, NOP, WFI)
    hart.run(NEVER)
    assert (hart.count, hart.now) == (5, 50)
    assert hart.asleep


def test_a_loop_is_counted_to_the_last_instruction(core):
    hart, _ = core(addi(A0, ZERO, 1000), addi(A0, A0, -1), bnez(A0, -4), WFI)
    hart.run(NEVER)
    assert hart.count == 1 + 2 * 1000 + 1


def test_a_core_stops_at_the_first_block_after_its_time_and_goes_on_there(core):
    hart, _ = core(addi(A0, ZERO, 1000), addi(A0, A0, -1), bnez(A0, -4), WFI)
    hart.run(5000)
    assert 5000 <= hart.now <= 5000 + 2 * CYCLE
    left = hart.x(A0)
    assert 0 < left < 1000
    hart.run(NEVER)
    assert hart.count == 1 + 2 * 1000 + 1


def test_an_instruction_waits_for_what_it_uses_and_for_the_unit_that_multiplies(core):
    mul, divuw = (1 << 25 | A0 << 20 | A0 << 15 | f3 << 12 | A0 << 7 | op for f3, op in ((0, 0x33), (5, 0x3B)))
    add, other = (a << 20 | a << 15 | a << 7 | 0x33 for a in (A0, A1))
    load, byte, c_add = ld(A0, A2), ld(A0, A2) & ~0x7000, 0x952A  # c.add a0, a0
    for words, cycles in (
        ((add,), 2),
        ((mul,), 11),
        ((mul, other), 11),
        ((mul, add), 13),
        ((mul, add, divuw), 12 + 20),
        ((mul, mul, other), 22),
        ((load, add), 4),
        ((load, c_add), 4),
        ((load, other, add), 4),
        ((byte, add), 6),
        ((byte, other, add), 6),
    ):
        hart, _ = core(lui(A2, DATA), *words, WFI)
        hart.weigh(**{"multiply": 11, "divide": 20, "load": 2, "load-byte": 4})
        hart.run(NEVER)
        assert hart.now == (cycles + 1) * CYCLE, words


def test_a_branch_waits_where_it_is_taken_or_another_way_than_the_last_time(core):
    for times, cycles in (({"taken": 4}, 9 * 3), ({"mispredicted": 4}, 2 * 3)):
        hart, _ = core(addi(A0, ZERO, 10), addi(A0, A0, -1), bnez(A0, -4), WFI)
        hart.weigh(**times)
        hart.run(NEVER)
        assert hart.now == (1 + 2 * 10 + 1 + cycles) * CYCLE


def test_what_a_trap_cuts_off_is_not_counted(core):
    mul = 1 << 25 | A0 << 20 | A0 << 15 | A0 << 7 | 0x33
    hart, _ = core(*handler(), lui(A0, 0x50000000), ld(A1, A0), mul, mul, WFI)
    hart.weigh(multiply=11)
    hart.run(NEVER)
    assert hart.now == (len(handler()) + 1 + 1 + 1) * CYCLE


def test_changed_code_is_counted_anew(core):
    hart, memory = core(NOP, NOP, WFI)
    hart.run(NEVER)
    write(memory, CODE, C_NOP, C_NOP, C_NOP, C_NOP, WFI)
    hart.take_code(CODE, memory.read(CODE, 16))
    hart.pc, hart.asleep = CODE, False
    hart.run(NEVER)
    assert hart.count == 3 + 5


def test_a_sleeping_core_wakes_by_its_timer(core):
    hart, _ = core(addi(A0, ZERO, 0x80), csrw(MIE, A0), WFI, addi(A1, ZERO, 7), WFI)
    hart.compare = 25
    hart.run(26 * TICK)
    assert hart.world.slept[0] == (3 * CYCLE, 0x80)
    assert hart.woken >= 25 * TICK
    assert hart.x(A1) == 7


def test_a_sleeping_core_wakes_by_its_software_interrupt_and_not_before(core):
    hart, _ = core(addi(A0, ZERO, 8), csrw(MIE, A0), WFI, csrr(A1, MIP), WFI)
    hart.run(10_000)
    assert hart.asleep
    assert hart.wake() == NEVER
    hart.software, hart.software_at = True, 20_000
    hart.run(20_000)
    assert hart.asleep
    hart.run(20_001)
    assert hart.woken == 20_000
    assert hart.x(A1) & 8


def test_an_enabled_timer_interrupts_what_the_core_does(core):
    hart, _ = core(*handler(), addi(A0, ZERO, 0x80), csrw(MIE, A0), csrsi(MSTATUS, 8), JUMP_HERE)
    hart.compare = 30
    hart.run(40_000)
    ((cause, pc, _),) = hart.world.traps
    assert cause == 1 << 63 | 7
    assert pc == CODE + 6 * 4
    assert hart.world.slept[0][0] == pytest.approx(30_000, abs=3 * CYCLE)


def test_a_timer_that_is_not_enabled_interrupts_nothing(core):
    hart, _ = core(*handler(), addi(A0, ZERO, 0x80), csrw(MIE, A0), JUMP_HERE)
    hart.compare = 30
    hart.run(40_000)
    assert hart.world.traps == []


def test_the_handler_returns_to_where_the_core_was(core):
    hart, memory = core(*handler(), addi(A0, ZERO, 0x80), csrw(MIE, A0), csrsi(MSTATUS, 8), JUMP_HERE)
    # The handler puts the timer off and returns.
    write(
        memory,
        CODE + 0x800,
        lui(T1, CLINT + 0x4000),
        addi(A2, A2, 1),
        sd(ZERO, T1, 8),
        addi(A1, ZERO, -1),
        sd(A1, T1, 8),
        MRET,
    )
    hart.hook_registers(memory.read(CODE + 0x800, 64), CODE + 0x800)
    hart.compare = 30
    hart.run(60_000)
    assert hart.x(A2) == 1
    assert hart.pc == CODE + 6 * 4


@pytest.mark.parametrize(
    ("instructions", "cause", "value"),
    [
        ((lui(A0, 0x50000000), ld(A1, A0)), 5, 0x50000000),
        ((lui(A0, 0x50000000), sd(A1, A0, 8)), 7, 0x50000008),
        ((lui(A0, 0x50000000), jalr(RA, A0)), 1, 0x50000000),
        ((NOP, 0xFFFFFFFF), 2, 0xFFFFFFFF),
        ((NOP, EBREAK), 3, None),
        ((NOP, 0x12000073), 2, 0x12000073),  # sfence.vma in user mode
        ((NOP, 0x0000), 2, 0),  # c.illegal
        ((NOP, csrr(A1, 0x180)), 2, csrr(A1, 0x180)),
        ((NOP, csrw(0x3A0, ZERO)), 2, csrw(0x3A0, ZERO)),
        ((lui(A0, 0x40000000), amo(1, A1, A0)), 7, 0x40000000),
        ((lui(A0, 0x40000000), amo(LR, A1, A0)), 5, 0x40000000),
        ((lui(A0, CODE), amo(1, A1, A0)), 7, CODE),
        ((addi(A0, RA, 2), amo(1, A1, A0)), 6, DATA + 2),
        ((addi(A0, RA, 2), amo(1, A0, A0)), 6, DATA + 2),
        ((addi(A0, RA, 2), amo(LR, A1, A0)), 4, DATA + 2),
        ((addi(A0, RA, 4), sd(A1, A0)), 6, DATA + 4),
        ((lui(A0, DATA + 0x2000), sd(A1, A0, -4)), 6, DATA + 0x1FFC),  # across the end of what it may use
        ((lui(A0, DATA + 0x2000), ld(A1, A0, -4)), 4, DATA + 0x1FFC),
        ((lui(A0, 0x50000000), ld(A1, A0, 2)), 4, 0x50000002),
        ((lui(A0, CLINT), ld(A1, A0, 2)), 4, CLINT + 2),
        ((lui(A0, CLINT), sd(A1, A0)), 7, CLINT),
        ((lui(A0, CLINT), ld(A1, A0)), 5, CLINT),
    ],
)
@pytest.mark.parametrize("behind", [(), (NOP, NOP)])  # the last instruction of its block, or one inside
def test_traps_of_user_mode_as_spike_and_rocket_take_them(core, instructions, cause, value, behind):
    """An atomic operation counts as a store, alignment goes before rights, and the value is the instruction."""
    tor, site = 1 << 3, CODE + 0x400
    enter = [*handler(), addi(A0, ZERO, -1)]
    for number, bound in ((0x3B0, CODE), (0x3B1, CODE + 0x2000), (0x3B2, DATA), (0x3B3, DATA + 0x2000)):
        enter += [lui(A1, bound), srli(A1, 2), csrw(number, A1)]
    enter += [*constant(A1, (tor | 3) << 24 | (tor | 5) << 8), csrw(0x3A0, A1), lui(A1, CODE), addi(A1, A1, 0x400)]
    hart, memory = core(*enter, csrw(MEPC, A1), lui(RA, DATA), MRET)
    write(memory, site, *instructions, *behind, JUMP_HERE)
    write(memory, CODE + 0x800, csrr(A0, MCAUSE), csrr(A1, MEPC), csrr(A2, MTVAL), WFI)
    hart.hook_registers(memory.read(CODE, 0x1000), CODE)
    hart.run(NEVER)
    where = 0x50000000 if cause == 1 else site + 4
    assert (hart.x(A0), hart.x(A1)) == (cause, where)
    assert value is None or hart.x(A2) == value


def test_instructions_after_a_fault_take_no_time(core):
    hart, _ = core(*handler(), lui(A0, 0x50000000), ld(A1, A0), NOP, NOP, NOP, NOP, JUMP_HERE)
    hart.run(NEVER)
    assert hart.count == 4 + 1 + 1  # up to the load, the trap itself, and the handler's WFI


def test_a_core_that_only_traps_gets_on(core):
    hart, _ = core(lui(A0, 0x50000000), csrw(MTVEC, A0), ld(A1, A0))
    hart.run(10_000)
    assert 10_000 <= hart.now < 10_100
    assert len(hart.world.traps) > 900


def test_registers_that_the_emulator_cannot_have(core):
    hart, _ = core(csrr(A0, MHARTID), NOP, csrr(A1, MCYCLE), WFI, number=1)
    hart.run(NEVER)
    assert hart.x(A0) == 1
    assert hart.x(A1) == 3  # the block is begun, so its own instructions are counted
    assert hart.count == 4


def test_a_locked_core_keeps_only_what_the_entries_allow(core):
    tor, napot, locked = 1 << 3, 3 << 3, 0x80
    everything = (1 << 54) - 1
    registers = {
        0x3B0: CODE >> 2,
        0x3B1: (CODE + 0x2000) >> 2,
        0x3B2: DATA >> 2,
        0x3B3: (DATA + 0x2000) >> 2,
        0x3B4: everything,
    }
    words = [lui(A0, DATA), *handler()]
    for i, csr in enumerate(registers):
        words += [ld(A1, A0, 8 * i), csrw(csr, A1)]
    words += [ld(A1, A0, 64), csrw(0x3A0, A1), sd(A1, A0, 72), lui(A2, CODE), sd(A1, A2, 0x400), JUMP_HERE]
    hart, memory = core(*words)
    for i, value in enumerate(registers.values()):
        memory.put_word(DATA + 8 * i, value)
    config = (tor | 5 | locked) << 8 | (tor | 3 | locked) << 24 | (napot | locked) << 32
    memory.put_word(DATA + 64, config)
    hart.run(NEVER)
    assert memory.word(DATA + 72) == config  # its data can be written,
    assert hart.world.traps == [(7, CODE + 4 * (len(words) - 2), CODE + 0x400)]  # its code cannot
    hart.pc, hart.asleep = OTHER, False
    hart.run(NEVER)
    assert hart.world.traps[-1] == (1, OTHER, OTHER)  # and there is nothing else


def test_watched_addresses_are_reported_once_for_every_time_they_are_reached(core):
    hart, _ = core(addi(A0, ZERO, 3), addi(A0, A0, -1), bnez(A0, -4), WFI)
    hart.watch([CODE + 4])
    hart.run(NEVER)
    # The first time is in the middle of the first block; jumps to it begin a block.
    assert [address for address, _ in hart.world.reached_at] == [CODE + 4] * 2
    hart.watch([])
    hart.pc, hart.asleep = CODE, False
    hart.run(NEVER)
    assert len(hart.world.reached_at) == 2
