"""Trace files of trace-cmd (``trace.dat``, version 6): switches of threads in the ring buffers of all CPUs.

The file has the formats of its events in it, so that fields are found whatever the kernel. Judge: `trace-cmd report`,
whose text of the same file gives the same jobs.
"""

from __future__ import annotations

import heapq
import io
import re
import struct
from typing import TYPE_CHECKING, BinaryIO

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.importers.traces import codes
from halpipe.importers.traces.ftrace import Switches
from halpipe.importers.traces.jobs import report_unused

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Findings
    from halpipe.models.trace import Trace

_CONVERT = "write it in version 6 with `trace-cmd convert --file-version 6`, or as text with `trace-cmd report`"
_FIELD = re.compile(r"field:.*?(\w+)(?:\[\w*\])?;\s*offset:(\d+);\s*size:(\d+);")
_MALFORMED = (struct.error, IndexError, ValueError, KeyError, UnicodeDecodeError)
_WAITING = 0xFF
_PADDING, _EXTEND, _STAMP = 29, 30, 31
_LARGEST_PART = 2**28
_COMMIT = 0xFFFFF
_MISSED = 1 << 31
_LONGEST_NAME = 1000
_LONGEST_FIELD = 300
_LEAST_PAGE = 256
_MOST_CPUS = 8192
_LONGEST_CLOCK = 4096


def read(stream: BinaryIO, file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time of the file."""
    switches = Switches(file, findings)
    try:
        trace = _Reader(stream, file)
        cpus = [trace.switches(cpu, offset, size) for cpu, (offset, size) in enumerate(trace.buffers)]
        for at, cpu, left, goes_on, entered, name in heapq.merge(*cpus):
            switches.switch(cpu, at, left, goes_on, entered, name, 0)
    except _MALFORMED as failure:
        message = f"this trace.dat cannot be read: {failure}"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=_CONVERT)) from None
    report_unused({"other kinds": trace.others} if trace.others else {}, file, findings)
    if trace.is_cut:
        message = "pages of its buffers are not in the file, so their events are not used"
        findings.add(codes.CUT_OFF(message, at=Location(file), help="copy the file again"))
    return [switches.trace(trace.lost)]


class _Reader:
    """Reads the header, and the pages of each buffer as they are needed."""

    def __init__(self, stream: BinaryIO, file: str) -> None:
        self.stream = stream
        self.lost = self.others = 0
        self.is_cut = False
        self.size = stream.seek(0, io.SEEK_END)
        stream.seek(10)
        version = self._string()
        if version != "6":
            message = f"this is a trace.dat of version {version}; version 6 is read"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=_CONVERT))
        self.order = "<" if self._bytes(1) == b"\0" else ">"
        self._bytes(1)  # the size of a long in programs, which no field here has
        self.page = self._number(4)
        if self.page < _LEAST_PAGE:
            raise ValueError(f"its pages have {self.page} bytes")
        page = self._sized("header_page")
        self._sized("header_event")
        fields = _fields(page)
        self.commit, self.data = fields["commit"], fields["data"][0]
        self.switch = self._event()
        self.buffers = self._buffers(file)

    def _bytes(self, size: int) -> bytes:
        if not 0 <= size <= _LARGEST_PART:
            raise ValueError("a part of it has a wrong size")
        data = self.stream.read(size)
        if len(data) < size:
            raise ValueError("it is cut off")
        return data

    def _number(self, size: int) -> int:
        return int.from_bytes(self._bytes(size), "little" if self.order == "<" else "big")

    def _string(self) -> str:
        found = b""
        while (byte := self._bytes(1)) != b"\0":
            found += byte
            if len(found) > _LONGEST_NAME:
                raise ValueError("a name has no end")
        return found.decode("ascii")

    def _sized(self, name: str) -> str:
        if self._string() != name:
            raise ValueError(f"{name} is not where it should be")
        return self._bytes(self._number(8)).decode("utf-8", "replace")

    def _event(self) -> _Switch:
        """Read the formats of all events, and return that of the switch."""
        for _ in range(self._number(4)):
            self._bytes(self._number(8))
        found = None
        for _ in range(self._number(4)):
            system = self._string()
            for _ in range(self._number(4)):
                text = self._bytes(self._number(8)).decode("utf-8", "replace")
                if system == "sched" and text.startswith("name: sched_switch\n"):
                    found = _Switch(text, self.order)
        if found is None:
            raise ValueError("it has no events sched:sched_switch")
        return found

    def _buffers(self, file: str) -> list[tuple[int, int]]:
        """Read up to the buffers, and return where that of each CPU stands."""
        for size in (4, 4, 8):  # symbols of the kernel, formats of printk, names of processes
            self._bytes(self._number(size))
        cpus = self._number(4)
        kind = self._bytes(10)
        if kind == b"options  \0":
            while self._number(2):
                self._bytes(self._number(4))
            kind = self._bytes(10)
        if kind != b"flyrecord\0":
            raise ValueError("it has no buffers of CPUs")
        if cpus > _MOST_CPUS:
            raise ValueError(f"it has {cpus} CPUs")
        found = [(self._number(8), self._number(8)) for _ in range(cpus)]
        if sum(size for _, size in found) > self.size or any(offset > self.size for offset, _ in found):
            raise ValueError("its buffers are larger than the file, or lie behind its end")
        clock = self.stream.read(8)
        text = self.stream.read(int.from_bytes(clock, "little" if self.order == "<" else "big") % _LONGEST_CLOCK)
        selected = re.search(rb"\[(counter|uptime|x86-tsc|perf)\]", text)
        if selected:
            message = f"its clock {selected[1].decode()} does not count nanoseconds"
            help = "record with the clock local, global or mono (trace-cmd record -C mono)"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=help))
        return found

    def switches(self, cpu: int, offset: int, size: int) -> Iterator[tuple[int, int, int, bool, int, str]]:
        """Yield the switches of a CPU."""
        for begin in range(offset, offset + size, self.page):
            self.stream.seek(begin)
            page = self.stream.read(self.page)
            commit = _unsigned(page, *self.commit, self.order)
            self.is_cut = self.is_cut or len(page) < self.data + (commit & _COMMIT)
            self.lost += bool(commit & _MISSED)
            for at, place in _records(page[: self.data + (commit & _COMMIT)], self.data, self.order):
                if _unsigned(page, place, 2, self.order) == self.switch.id:
                    yield (at, cpu, *self.switch.of(page, place))
                else:
                    self.others += 1


class _Switch:
    """Places of the fields of a switch."""

    def __init__(self, text: str, order: str) -> None:
        self.order = order
        self.id = int(re.findall(r"^ID: (\d+)$", text, re.MULTILINE)[0])
        fields = _fields(text)
        self.left, self.state, self.entered = (fields[name] for name in ("prev_pid", "prev_state", "next_pid"))
        self.name = fields["next_comm"]

    def of(self, page: bytes, at: int) -> tuple[int, bool, int, str]:
        """Return the thread that left, whether it still wants to run, and the thread that entered, with its name."""
        left, state, entered = (
            _unsigned(page, at + offset, size, self.order) for offset, size in (self.left, self.state, self.entered)
        )
        name = page[at + self.name[0] : at + sum(self.name)].split(b"\0")[0].decode("utf-8", "replace")
        return left, not state & _WAITING, entered, name


def _fields(text: str) -> dict[str, tuple[int, int]]:
    """Return offset and size of each field of a format."""
    lines = (line.strip() for line in text.split("\n") if len(line) <= _LONGEST_FIELD)
    found = (match.groups() for line in lines if (match := _FIELD.match(line)))
    return {name: (int(offset), int(size)) for name, offset, size in found}


def _unsigned(data: bytes, at: int, size: int, order: str) -> int:
    return int.from_bytes(data[at : at + size], "little" if order == "<" else "big")


def _records(page: bytes, at: int, order: str) -> Iterator[tuple[int, int]]:
    """Yield the time and the place of the data of each event of a page."""
    now = _unsigned(page, 0, 8, order)
    while at + 4 <= len(page):
        head = _unsigned(page, at, 4, order)
        kind, delta = (head & 31, head >> 5) if order == "<" else (head >> 27, head & 0x7FFFFFF)
        more = _unsigned(page, at + 4, 4, order) if kind in (0, _PADDING, _EXTEND, _STAMP) else 0
        if kind == _PADDING:
            if not delta:
                return  # nothing more on the page
            at += 4 + more
            now += delta
        elif kind == _EXTEND:
            now += delta + (more << 27)
            at += 8
        elif kind == _STAMP:
            now = (now & ~(2**59 - 1)) | (delta + (more << 27))
            at += 8
        else:
            now += delta
            size = more if kind == 0 else 4 * kind
            yield now, at + (4 if kind else 8)
            at += 4 + max(4, -(-size // 4) * 4)
