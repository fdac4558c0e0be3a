"""The registers of a DMA channel, and transfers that the management core makes itself."""

from halpipe.deploy.riscv.board.devices import (
    BYTES,
    CLAIM,
    CONTROL,
    DONE,
    ERROR,
    RUN,
    SOURCE,
    TARGET,
    UNKNOWN,
    Channel,
    CopyWatcher,
)
from halpipe.deploy.riscv.board.memory import Memory, Region


def described(channel, source=0x80000000, target=0x1820000, size=64):
    """Describe a transfer as drivers do, in halves of registers."""
    for register, value in ((SOURCE, source), (TARGET, target), (BYTES, size)):
        channel.write(register, 4, value & 0xFFFFFFFF)
        channel.write(register + 4, 4, value >> 32)


def test_a_transfer_is_described_started_and_finished():
    channel = Channel(2)
    assert not channel.write(CONTROL, 4, CLAIM)
    described(channel, source=0x1_80000040)
    assert channel.write(CONTROL, 4, CLAIM | RUN)
    assert channel.next() == (0x1_80000040, 0x1820000, 64)
    assert channel.read(CONTROL, 4) == CLAIM | RUN
    channel.finish()
    assert channel.read(CONTROL, 4) == CLAIM | DONE
    assert not channel.write(CONTROL, 4, 0)
    assert channel.read(CONTROL, 4) == 0


def test_a_channel_that_was_not_claimed_does_not_start():
    channel = Channel(0)
    described(channel)
    assert not channel.write(CONTROL, 4, CLAIM | RUN)
    assert channel.read(CONTROL, 4) == CLAIM


def test_claiming_resets_the_description():
    channel = Channel(0)
    channel.write(CONTROL, 4, CLAIM)
    described(channel)
    channel.write(CONTROL, 4, 0)
    channel.write(CONTROL, 4, CLAIM)
    assert channel.next() == (0, 0, 0)


def test_a_transfer_that_is_under_way_is_not_started_again():
    channel = Channel(0)
    channel.write(CONTROL, 4, CLAIM)
    described(channel)
    assert channel.write(CONTROL, 4, CLAIM | RUN)
    assert not channel.write(CONTROL, 4, CLAIM | RUN)


def test_an_error_is_shown():
    channel = Channel(0)
    channel.write(CONTROL, 4, CLAIM)
    channel.finish(error=True)
    assert channel.read(CONTROL, 4) & ERROR


class Log:
    def __init__(self):
        self.begun, self.ended = [], []


def watcher():
    memory = Memory(
        [Region("main", 0x80000000, 4096), Region("data", 0x1040000, 4096, 1), Region("d2", 0x1080000, 4096, 2)], 1
    )
    memory.write(0x1040000, bytes(range(64)))
    log = Log()
    return CopyWatcher(memory, log.begun.append, log.ended.append), log


def copy(copies, source, target, size, now):
    for at in range(0, size, 8):
        copies.loads(source + at, 8, now + at)
        copies.stores(target + at, 8, now + at + 1)


def test_adjacent_loads_and_stores_are_one_transfer():
    copies, log = watcher()
    copy(copies, 0x80000000, 0x1040000, 64, 100)
    copies.finish(200)
    (transfer,) = log.ended
    assert log.begun == [transfer]
    assert (transfer.source, transfer.target, transfer.size) == (0x80000000, 0x1040000, 64)
    assert (transfer.begin, transfer.end, transfer.channel) == (100, 200, UNKNOWN)
    assert transfer.data == bytes(range(64))


def test_a_copy_that_is_interrupted_by_another_one_stays_one():
    copies, log = watcher()
    copy(copies, 0x80000000, 0x1040000, 32, 0)
    copy(copies, 0x80000100, 0x1080000, 16, 40)
    copy(copies, 0x80000020, 0x1040020, 32, 60)
    copies.finish(100)
    assert [(t.source, t.target, t.size) for t in log.ended] == [
        (0x80000000, 0x1040000, 64),
        (0x80000100, 0x1080000, 16),
    ]


def test_a_copy_is_over_when_its_core_is_started():
    copies, log = watcher()
    copy(copies, 0x80000000, 0x1040000, 8, 0)
    copy(copies, 0x80000100, 0x1080000, 8, 20)
    copies.finish(40, 1)
    assert [t.target for t in log.ended] == [0x1040000]
    copies.finish(50)
    assert [t.target for t in log.ended] == [0x1040000, 0x1080000]


def test_stores_of_something_else_are_no_copies():
    copies, log = watcher()
    copies.stores(0x1040000, 8, 0)
    copies.loads(0x80000000, 8, 1)
    copies.stores(0x1040000, 4, 2)
    copies.finish(3)
    assert log.ended == []
