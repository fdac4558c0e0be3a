"""The runtime's record of a run: rings in memory, and what it prints."""

import struct
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.riscv.codes import ENGINE_UNFIT
from halpipe.deploy.riscv.run.recording import Flag, Kind, meaning, parse_recording, read_recording
from halpipe.deploy.riscv.target import Ring

BROKEN = HalpipeError(ENGINE_UNFIT("broken"))


def record(time, kind=Kind.COPY, flags=0):
    return struct.pack("<QQQIIIIIBBBx", time, 1, 2, 3, 4, 5, 7, 6, kind, flags, 1)


def fault(time):
    return struct.pack("<QQQQIIIIIBBHQ", time, 7, 0x1821000, 0x80000000, 1, 2, 3, 4, 5, 4, 4, 2, 0)


CONTROL = 0x8000


class Memory:
    """Memory with a control block that counts records, and chunks by address."""

    def __init__(self, traced, abandoned, *chunks):
        counts = struct.pack("<18Q", *[0] * 13, traced, abandoned, 0, 0, 0)
        self.chunks = [(CONTROL, counts), *chunks]

    def read(self, address, size):
        base, data = next((b, d) for b, d in self.chunks if b <= address < b + len(d))
        return data[address - base : address - base + size]

    def word(self, address):
        return int.from_bytes(self.read(address, 8), "little")


def site(trace, faults):
    """As much of a target as a recording needs."""
    return SimpleNamespace(control=CONTROL, trace=Ring(*trace, 48), faults=Ring(*faults, 64))


def test_records_are_read_in_order():
    rings = Memory(2, 1, (0x100, record(10) + record(11, Kind.STOP, 2) + bytes(96)), (0x1000, fault(11) + bytes(64)))
    recording = read_recording(rings, site((0x100, 4), (0x1000, 2)))
    assert [(r.time, r.kind, r.flags) for r in recording.records] == [(10, Kind.COPY, 0), (11, Kind.STOP, Flag.OVERRUN)]
    (abandoned,) = recording.abandoned
    assert (abandoned.cause, abandoned.epc, abandoned.tval, abandoned.hart) == (7, 0x1821000, 0x80000000, 2)
    assert recording.lost == 0


def test_what_was_overwritten_is_lost():
    ring = record(14) + record(15) + record(12) + record(13)
    recording = read_recording(Memory(6, 0, (0, ring)), site((0, 4), (999, 2)))
    assert [r.time for r in recording.records] == [12, 13, 14, 15]
    assert recording.lost == 2


def printed(*, traced=1, state=2, end="end\n", trace=1):
    words = [0] * 18
    words[9], words[13], words[14] = state, traced, 1

    def line(name, data):
        return " ".join([name, *(f"{w:x}" for w in struct.unpack(f"<{len(data) // 8}Q", data))]) + "\n"

    text = line("control", struct.pack("<18Q", *words)) + line("trace", record(10)) * trace + line("fault", fault(9))
    return text + end


def test_what_is_printed_is_the_same_as_what_lies_in_memory():
    recording, state = parse_recording(printed(), BROKEN)
    assert state == 2
    rings = Memory(1, 1, (0, record(10)), (4096, fault(9)))
    assert recording == read_recording(rings, site((0, 1), (4096, 1)))


def test_what_was_not_printed_any_more_is_lost():
    assert parse_recording(printed(traced=5), BROKEN)[0].lost == 4


@pytest.mark.parametrize(
    "text",
    [
        "",
        printed(end=""),
        printed().replace("control", "kontrol"),
        "control x\nend\n",
        printed().replace("trace ", "trace 1 "),
    ],
)
def test_a_report_that_is_cut_is_refused(text):
    with pytest.raises(HalpipeError):
        parse_recording(text, BROKEN)


def test_flags_are_named():
    assert meaning(Flag.LATE) == "transfer not complete in time"
    assert meaning(Flag.LATE | Flag.FAULT) == "transfer not complete in time, the job trapped"
    assert meaning(Flag(0)) == ""
