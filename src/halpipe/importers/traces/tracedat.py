"""Trace files of trace-cmd (``trace.dat``, versions 6 and 7): switches of threads in the ring buffers of all CPUs.

The file has the formats of its events in it, so that fields are found whatever the kernel. Version 7 has the parts of
version 6 in sections, which options name, and may compress them. Judge: `trace-cmd report`, whose text of the same file
gives the same jobs.
"""

from __future__ import annotations

import heapq
import io
import re
import struct
import zlib
from typing import TYPE_CHECKING, BinaryIO

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.importers.common.inputs import reason
from halpipe.importers.traces import codes
from halpipe.importers.traces.ftrace import Switches, is_runnable
from halpipe.importers.traces.jobs import report_unused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.models.trace import Trace

_CONVERT = "write it in version 6 with `trace-cmd convert --file-version 6`, or as text with `trace-cmd report`"
_INSTALL = f"pip install 'halpipe[zstd]', or {_CONVERT}"
_FIELD = re.compile(r"field:.*?(\w+)(?:\[\w*\])?;\s*offset:(\d+);\s*size:(\d+);")
_MALFORMED = (struct.error, IndexError, ValueError, KeyError, OverflowError, zlib.error, EOFError)
_DONE, _BUFFER, _HEADER, _FORMATS = 0, 3, 16, 18
"""Options of version 7."""
_PACKED = 1
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
        cpus = [trace.switches(cpu, trace.pages(offset, size)) for cpu, offset, size in trace.buffers]
        for at, cpu, left, goes_on, entered, name in heapq.merge(*cpus):
            switches.switch(cpu, at, left, goes_on, entered, name, 0)
    except _MALFORMED as failure:
        message = f"this trace.dat cannot be read: {reason(failure)}"
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
        if version not in ("6", "7"):
            message = f"this is a trace.dat of version {version}; versions 6 and 7 are read"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=_CONVERT))
        self.order = "<" if self._bytes(1) == b"\0" else ">"
        self._bytes(1)  # the size of a long in programs, which no field here has
        self.page = self._number(4)
        if self.page < _LEAST_PAGE:
            raise ValueError(f"its pages have {self.page} bytes")
        self.is_packed = False
        if version == "7":
            self._sections(file)
        else:
            self._head()
            for _ in range(self._number(4)):  # events of ftrace itself
                self._bytes(self._number(8))
            self._formats()
            self.buffers = self._buffers(file)
        if sum(size for _, _, size in self.buffers) > self.size or any(at > self.size for _, at, _ in self.buffers):
            raise ValueError("its buffers are larger than the file, or lie behind its end")

    def _head(self) -> None:
        fields = _fields(self._sized("header_page"))
        self._sized("header_event")
        self.commit, self.data = fields["commit"], fields["data"][0]

    def _sections(self, file: str) -> None:
        algorithm, _ = self._string(), self._string()
        self.unpack = _unpacker(algorithm, file)
        options: dict[int, bytes] = {}
        at, seen, whole = self._number(8), set[int](), self.stream
        while at and at not in seen:
            seen.add(at)
            self.stream, at = io.BytesIO(self._section(at)[0]), 0
            while (head := self.stream.read(2)) and not at:
                value = self._bytes(self._number(4))
                option = _unsigned(head, 0, 2, self.order)
                is_named = option == _BUFFER and value[8:9] != b"\0"  # an instance beside the buffer of the kernel
                options.setdefault(-1 if is_named else option, value)
                at = _unsigned(value, 0, 8, self.order) if option == _DONE else 0
            self.stream = whole
        for option, read in ((_HEADER, self._head), (_FORMATS, self._formats)):
            self.stream = io.BytesIO(self._section(_unsigned(options[option], 0, 8, self.order))[0])
            read()
            self.stream = whole
        self.stream = io.BytesIO(options[_BUFFER])
        begin, _, clock = self._number(8), self._string(), self._string()
        _refuse_clock(f"[{clock}]".encode(), file)
        self.page, cpus = self._number(4), self._number(4)
        if self.page < _LEAST_PAGE or cpus > _MOST_CPUS:
            raise ValueError(f"its pages have {self.page} bytes, and it has {cpus} CPUs")
        self.buffers = [(self._number(4), self._number(8), self._number(8)) for _ in range(cpus)]
        self.stream = whole
        self.is_packed = self._section(begin, is_whole=False)[1]

    def _section(self, at: int, *, is_whole: bool = True) -> tuple[bytes, bool]:
        self.stream.seek(at)
        head = self._bytes(16)
        is_packed = bool(_unsigned(head, 2, 2, self.order) & _PACKED)
        if not is_whole:
            return b"", is_packed
        return self._chunk() if is_packed else self._bytes(_unsigned(head, 8, 8, self.order)), is_packed

    def _chunk(self) -> bytes:
        packed, size = self._number(4), self._number(4)
        if size > _LARGEST_PART:
            raise ValueError("a part of it has a wrong size")
        data = self.unpack(self._bytes(packed), size)
        if len(data) != size:
            raise ValueError("a part of it has another size than it states")
        return data

    def pages(self, offset: int, size: int) -> Iterator[bytes]:
        """Yield the pages of a buffer; the CPUs share the stream, so the place is sought each time."""
        if not self.is_packed:
            for begin in range(offset, offset + size, self.page):
                self.stream.seek(begin)
                yield self.stream.read(self.page)
            return
        self.stream.seek(offset)
        chunks = self._number(4) if size else 0
        offset += 4
        for _ in range(chunks):
            self.stream.seek(offset)
            data = self._chunk()
            offset = self.stream.tell()
            yield from (data[at : at + self.page] for at in range(0, len(data), self.page))

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

    def _formats(self) -> None:
        """Read the formats of all events, and keep that of the switch."""
        found = None
        for _ in range(self._number(4)):
            system = self._string()
            for _ in range(self._number(4)):
                text = self._bytes(self._number(8)).decode("utf-8", "replace")
                if system == "sched" and text.startswith("name: sched_switch\n"):
                    found = int(re.findall(r"^ID: (\d+)$", text, re.MULTILINE)[0]), _fields(text)
        if found is None:
            raise ValueError("it has no events sched:sched_switch")
        self.id, fields = found
        *self.numbers, self.name = (fields[name] for name in ("prev_pid", "prev_state", "next_pid", "next_comm"))

    def _buffers(self, file: str) -> list[tuple[int, int, int]]:
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
        found = [(cpu, self._number(8), self._number(8)) for cpu in range(cpus)]
        clock = self.stream.read(8)
        _refuse_clock(self.stream.read(_unsigned(clock, 0, 8, self.order) % _LONGEST_CLOCK), file)
        return found

    def switches(self, cpu: int, pages: Iterator[bytes]) -> Iterator[tuple[int, int, int, bool, int, str]]:
        """Yield the switches of a CPU."""
        for page in pages:
            commit = _unsigned(page, *self.commit, self.order)
            self.is_cut = self.is_cut or len(page) < self.data + (commit & _COMMIT)
            self.lost += bool(commit & _MISSED)
            for at, place in _records(page[: self.data + (commit & _COMMIT)], self.data, self.order):
                if _unsigned(page, place, 2, self.order) != self.id:
                    self.others += 1
                    continue
                left, state, entered = (_unsigned(page, place + of, size, self.order) for of, size in self.numbers)
                name = page[place + self.name[0] : place + sum(self.name)].split(b"\0")[0]
                yield at, cpu, left, is_runnable(state), entered, name.decode("utf-8", "replace")


def _refuse_clock(text: bytes, file: str) -> None:
    if selected := re.search(rb"\[(counter|uptime|x86-tsc|perf)\]", text):
        message = f"its clock {selected[1].decode()} does not count nanoseconds"
        help = "record with the clock local, global or mono (trace-cmd record -C mono)"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=help))


def _unpacker(algorithm: str, file: str) -> Callable[[bytes, int], bytes]:
    """Return what decompresses a piece to at most so many bytes; raise `HalpipeError` where it has no library."""
    if algorithm in ("none", "zlib"):
        return lambda data, size: zlib.decompressobj().decompress(data, size + 1)
    try:
        if algorithm != "zstd":
            raise ImportError
        from zstandard import ZstdDecompressor, ZstdError
    except ImportError:
        message = f"this trace.dat is compressed by {algorithm}, for which no library is installed"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=_INSTALL)) from None

    def unpack(data: bytes, size: int) -> bytes:
        try:
            with ZstdDecompressor().stream_reader(data) as stream:
                found: bytes = stream.read(size + 1)
        except ZstdError:
            raise ValueError("what it holds compressed is damaged") from None
        return found

    return unpack


def _fields(text: str) -> dict[str, tuple[int, int]]:
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
