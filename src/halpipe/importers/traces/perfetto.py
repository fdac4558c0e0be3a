"""Perfetto's protobuf traces: slices of track events, and switches of threads from ftrace.

The wire format is read here, in 40 lines, since generated classes of Perfetto's 200 messages would be more code than
that, and their package fetches a program from the network. Numbers of fields are those of Perfetto's ``trace_packet``,
``track_event``, ``track_descriptor``, ``ftrace_event_bundle`` and ``sched`` definitions.
"""

from __future__ import annotations

import io
import zlib
from array import array
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import MAX_INPUT_BYTES, refuse_more_than
from halpipe.importers.common.inputs import reason
from halpipe.importers.traces import codes
from halpipe.importers.traces.ftrace import Switches, is_runnable
from halpipe.importers.traces.jobs import Marks, Oddities, line_of, report_unfinished, report_unused, unfinished
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.diagnostics import Findings

Fields = dict[int, list[Any]]
"""The values of a message by the number of their field: integers, and bytes of texts and messages."""

_BEGIN, _END = 1, 2
_UNKNOWN = -1
_CHUNK = 2**20  # bytes that are read, and switches that are followed, at once
_LONGEST_HEAD = 20
_MALFORMED = (ValueError, IndexError, TypeError, AttributeError, OverflowError, zlib.error)
_BOOTTIME = 6
_NANOSECOND_CLOCKS = (0, 1, 2, 3, 4, 5, 6)
_PLAIN = frozenset((8, 10, 11, 58))
"""Fields of packets that change nothing for those after them."""
_CACHED = 10_000
MOST_TRACKS = 500_000
"""Tracks with slices, each of which takes as long as many slices of one."""


def read(stream: BinaryIO, file: str, findings: Findings) -> list[Trace]:
    """Return a line of time for each process with slices, and one for the threads of the kernel."""
    reader, count, at = _Reader(file, findings), 0, 0
    try:
        for end, packet in _packets(stream):
            reader.take(packet)
            count, at = count + 1, end
    except _MALFORMED as failure:
        message = f"packet {count + 1}, from byte {at} on, cannot be read: {reason(failure)}"
        if count and (traces := reader.traces()):
            message += f"; what comes after packet {count} is not used"
            findings.add(codes.CUT_OFF(message, at=Location(file), help="stop the session before copying the trace"))
            return traces
        message = f"this trace of Perfetto in protobuf cannot be read: {message}"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help="record it again")) from None
    return reader.traces()


def _varint(data: bytes, at: int) -> tuple[int, int]:
    if (value := data[at]) < 0x80:  # as most are
        return value, at + 1
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & (2**64 - 1), at
        shift += 7
        if shift > 63:
            raise ValueError("a number has more than 64 bits")


def fields_of(data: bytes) -> Fields:
    """Return the fields of a message."""
    found: Fields = {}
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind = key & 7
        value: Any
        if kind in (1, 5):
            size = 8 if kind == 1 else 4
            value, at = int.from_bytes(data[at : at + size], "little"), at + size
        elif kind in (0, 2):
            value, at = _varint(data, at)
            if kind == 2:
                value, at = data[at : at + value], at + value
        else:
            raise ValueError(f"a field has the wire type {kind}")
        if at > len(data):
            raise ValueError("a field is longer than its message")
        found.setdefault(key >> 3, []).append(value)
    return found


def _packets(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield the packets of a trace, field 1 of it over and over, each with the byte at which it ends."""
    data, at, before = b"", 0, 0
    while True:
        if len(data) - at < _LONGEST_HEAD:
            data, at, before = data[at:] + stream.read(_CHUNK), 0, before + at
        if not data:
            return
        key, begin, size = data[at], at + 2, data[at + 1] if len(data) > at + 1 else 0x80
        if key != (1 << 3 | 2) or size > 0x7F:  # most are shorter
            key, begin = _varint(data, at)
            size, begin = _varint(data, begin)
        if key != (1 << 3 | 2) or size > MAX_INPUT_BYTES:
            raise ValueError("it is no list of packets")
        if begin + size > len(data):
            data, begin, before = data[begin:] + stream.read(max(size, _CHUNK)), 0, before + begin
        if size > len(data) - begin:
            raise ValueError(f"it is cut off, with {len(data) - begin} of {size} bytes")
        at = begin + size
        yield before + at, data[begin:at]


def _one(fields: Fields, number: int, default: int) -> int:
    value = fields[number][-1] if number in fields else default
    if not isinstance(value, int):
        raise ValueError(f"field {number} holds no number")
    return value


def _text(fields: Fields, number: int) -> str:
    value = fields[number][-1] if number in fields else b""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else ""


def _messages(fields: Fields, number: int) -> Iterator[Fields]:
    return (fields_of(value) for value in fields.get(number, ()) if isinstance(value, bytes))


@dataclass(slots=True)
class _Clock:
    """A clock of a writer's own: its stamps count `unit_ns` from `zero`, or from the stamp before.

    The tracing SDK of Perfetto stamps the events of programs by such a clock.
    """

    zero: int
    unit_ns: int
    last: int
    is_incremental: bool

    def time(self, stamp: int) -> int:
        """Return the instant of the next packet."""
        self.last = stamp + (self.last if self.is_incremental else 0)
        return self.zero + self.last * self.unit_ns


class _Sequence:
    """State of one writer's packets: names by number, clocks, and defaults."""

    def __init__(self, offsets: dict[int, int]) -> None:
        self.offsets = offsets
        self.names: dict[int, str] = {}
        self.clocks: dict[int, _Clock] = {}
        self.clock = _BOOTTIME
        self.track = 0

    def time(self, packet: Fields) -> int | None:
        """Return the instant of a packet; None where it has none on a clock that is known."""
        clock, stamp = _one(packet, 58, self.clock), _one(packet, 8, -1)
        if stamp < 0 or clock in _NANOSECOND_CLOCKS:
            return None if stamp < 0 else stamp + self.offsets.get(clock, 0)
        return self.clocks[clock].time(stamp) if clock in self.clocks else None


class _Reader:
    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.sequences: dict[int, _Sequence] = {}
        self.offsets: dict[int, int] = {}
        """Nanoseconds from each builtin clock to the time since boot; the monotonic clock stops during suspend."""
        self.tracks: dict[int, tuple[int, int, str]] = {}
        """Process, parent and name of each track."""
        self.processes: dict[int, str] = {}
        self.threads: dict[int, str] = {}
        self.marks: dict[int, Marks] = {}
        """Begins and ends of slices by their track; ends have the name 0."""
        self.names = {"": 0}
        self.switches = array("Q"), array("q"), array("q"), array("b"), array("q"), array("i")
        """Time, CPU, thread that leaves, whether it still wants to run, thread that enters and number of its name."""
        self.others: Counter[str] = Counter()
        self.has_lost = False
        self.known: dict[bytes, tuple[Any, ...]] = {}
        """Where packets with one begin or end go, by their bytes behind the instant."""
        self.taken: dict[int, Callable[[Fields, _Sequence], None]] = {
            6: self._snapshot,
            12: self._interned,
            59: self._defaults,
            60: self._descriptor,
            2: self._tree,
            1: self._bundle,
        }
        """What is done with the messages of a packet before its events, by the number of their field, in this order."""

    def take(self, packet: bytes, *, is_packed: bool = False) -> None:
        """Take one packet; most begin with their instant, and differ from one before in nothing else."""
        stamp, rest = -1, b""
        if packet.startswith(b"\x40"):
            stamp, at = _varint(packet, 1)
            rest = packet[at:]
            if (known := self.known.get(rest)) is not None:
                known[0].add(stamp, *known[1:])
                return
        fields = fields_of(packet)
        if is_plain := _PLAIN.issuperset(fields):
            sequence = self._sequence(fields)
        else:
            self.known.clear()  # names, defaults or clocks may be others now
            sequence = self._state(fields)
        now = sequence.time(fields)
        found = [each for event in _messages(fields, 11) if (each := self._event(event, sequence, now)) is not None]
        for marks, *mark in found:
            marks.add(*mark)
        if is_plain:
            if rest and len(found) == 1 and found[0][1] == stamp and len(self.known) < _CACHED:
                marks, _, *others = found[0]
                self.known[rest] = (marks, *others)
            return
        for packed in fields.get(50, ()):
            if is_packed:
                raise ValueError("packets are compressed twice")
            self._unpack(packed)

    def _sequence(self, fields: Fields) -> _Sequence:
        """Return the writer of a packet."""
        number = _one(fields, 10, 0)
        return self.sequences.get(number) or self.sequences.setdefault(number, _Sequence(self.offsets))

    def _state(self, fields: Fields) -> _Sequence:
        """Take what a packet states beside its events; return its writer."""
        if _one(fields, 13, 0) & 1 or 41 in fields:
            self.sequences.pop(_one(fields, 10, 0), None)
        sequence = self._sequence(fields)
        self.has_lost = self.has_lost or 42 in fields
        for number in () if self.taken.keys().isdisjoint(fields) else self.taken:
            for value in fields.get(number, ()):
                self.taken[number](fields_of(value), sequence)
        return sequence

    def _unpack(self, packed: bytes) -> None:
        """Take the packets that one holds compressed."""
        inner = zlib.decompressobj()
        data = inner.decompress(packed, MAX_INPUT_BYTES)
        if not inner.eof:
            raise ValueError("compressed packets are cut off, or too large")
        for _, packet in _packets(io.BytesIO(data)):
            self.take(packet, is_packed=True)

    def _snapshot(self, snapshot: Fields, sequence: _Sequence) -> None:
        """Take the clocks of a writer by the nanoseconds of the first builtin clock beside them."""
        clocks = {_one(clock, 1, 0): clock for clock in _messages(snapshot, 1)}
        builtin = [clocks[known] for known in (_BOOTTIME, *_NANOSECOND_CLOCKS) if known in clocks]
        for known in _NANOSECOND_CLOCKS if _BOOTTIME in clocks else ():
            if known in clocks:
                self.offsets[known] = _one(clocks[_BOOTTIME], 2, 0) - _one(clocks[known], 2, 0)
        for number, clock in clocks.items() if builtin else ():
            if number > 63:  # a clock of the writer
                stamp, unit = _one(clock, 2, 0), _one(clock, 4, 1)
                zero = _one(builtin[0], 2, 0) - stamp * unit
                sequence.clocks[number] = _Clock(zero, unit, stamp, bool(_one(clock, 3, 0)))

    def _interned(self, interned: Fields, sequence: _Sequence) -> None:
        sequence.names.update({_one(name, 1, 0): _text(name, 2) for name in _messages(interned, 2)})

    def _defaults(self, defaults: Fields, sequence: _Sequence) -> None:
        sequence.clock = _one(defaults, 58, sequence.clock)
        for track in _messages(defaults, 11):
            sequence.track = _one(track, 11, sequence.track)

    def _tree(self, tree: Fields, _: _Sequence) -> None:
        for thread in _messages(tree, 2):
            self.threads[_one(thread, 1, 0)] = _text(thread, 2)

    def _descriptor(self, fields: Fields, _: _Sequence) -> None:
        process = name = None
        for found in _messages(fields, 3):
            process, name = _one(found, 1, 0), _text(found, 6)
            self.processes[process] = name or str(process)
        for found in _messages(fields, 4):
            process, name = _one(found, 1, 0), _text(found, 5) or str(_one(found, 2, 0))
        stated = _text(fields, 2) or _text(fields, 10)
        self.tracks[_one(fields, 1, 0)] = (process or 0, _one(fields, 5, 0), stated or name or "")

    def _event(self, event: Fields, sequence: _Sequence, at: int | None) -> tuple[Any, ...] | None:
        """Return the marks of an event, and what it adds to them; None if it is of no use."""
        if at is None:
            self.others["events without an instant, or on a clock that no snapshot explains"] += 1
            return None
        kind = _one(event, 9, 0)
        if kind not in (_BEGIN, _END):
            self.others[f"events of type {kind}"] += 1
            return None
        stated = _text(event, 23) or sequence.names.get(_one(event, 10, 0), "") or "(no name)"
        name = stated if kind == _BEGIN else ""
        track = _one(event, 11, sequence.track)
        if (marks := self.marks.get(track)) is None:
            marks = self.marks[track] = Marks()
            refuse_more_than(MOST_TRACKS, len(self.marks), "or more tracks of slices", Location(self.file))
        return marks, at, kind == _BEGIN, self.names.setdefault(name, len(self.names))

    def _bundle(self, bundle: Fields, _: _Sequence) -> None:
        cpu = _one(bundle, 1, 0)
        self.has_lost = self.has_lost or bool(_one(bundle, 3, 0))
        for event in _messages(bundle, 2):
            if 4 not in event:
                self.others["other kinds of ftrace"] += 1
            for switch in _messages(event, 4):
                goes_on = is_runnable(_one(switch, 4, 0))
                left, entered = _one(switch, 2, 0), _one(switch, 6, 0)
                self._switched(_text(switch, 5), _one(event, 1, 0), cpu, left, goes_on, entered)
        for compact in _messages(bundle, 4):
            self._compact(cpu, compact)

    def _compact(self, cpu: int, fields: Fields) -> None:
        """Take switches in columns; each leaves the thread that the one before it entered."""
        names = [value.decode("utf-8", "replace") for value in fields.get(5, ())]
        columns = [list(_packed(fields, number)) for number in (1, 2, 3, 6)]
        if len(counts := {*map(len, columns)}) > 1:
            raise ValueError(f"columns of switches have unlike lengths, {min(counts)} to {max(counts)}")
        at, left = 0, _UNKNOWN
        for delta, state, entered, name in zip(*columns, strict=True):
            at += delta
            self._switched(names[name], at, cpu, left, is_runnable(state), entered)
            left = entered

    def _switched(self, name: str, *values: int) -> None:
        for numbers, value in zip(self.switches, (*values, self.names.setdefault(name, len(self.names))), strict=True):
            numbers.append(value)

    def _kernel(self) -> Trace:
        """Return the line of the switches by time; an unknown thread that leaves is the one that entered before."""
        at, cpu, left, _, entered, _ = columns = [np.asarray(each) for each in self.switches]
        order = np.lexsort((at, cpu))
        before = np.where(np.diff(cpu[order], prepend=-1), 0, np.roll(entered[order], 1))
        left[order] = np.where(left[order] == _UNKNOWN, before, left[order])
        del before
        order = order[np.argsort(at[order], kind="stable")]
        switches, names = Switches(self.file, self.findings), [*self.names]
        for part in np.array_split(order, len(order) // _CHUNK + 1):
            for now, on, leaves, goes_on, enters, name in zip(*(each[part].data for each in columns), strict=True):
                called = names[name] or self.threads.get(enters, str(enters))
                switches.switch(on, now, leaves, bool(goes_on), enters, called)
        return switches.trace()

    def _process_of(self, track: int) -> int:
        seen: set[int] = set()
        while track in self.tracks and track not in seen:
            seen.add(track)
            process, parent, _ = self.tracks[track]
            if process or not parent:
                return process
            track = parent
        return 0

    def _slices(self) -> list[Trace]:
        lines: dict[int, Executions] = {}
        self.known.clear()  # it would keep the marks of each track
        names, odd, left = [*self.names], Oddities(), 0
        for track in [*self.marks]:
            marks = self.marks.pop(track)
            found = line_of(self._process_of(track), lines, self.file)
            unit = (self.tracks[track][2] if track in self.tracks else "") or str(track)
            begins, ends = marks.slices(names, odd)
            marks.is_busy = True
            marks.put(found, begins, ends, names, [(unit,)])
            left += unfinished(ends)
        odd.report(self.file, self.findings)
        report_unfinished(left, "slice", self.file, self.findings)
        for found in lines.values():
            found.sort()
        return [
            Trace(name=self.processes.get(process, str(process)), executions=each) for process, each in lines.items()
        ]

    def traces(self) -> list[Trace]:
        """Return the lines of all processes with slices, and of the kernel."""
        found = self._slices()
        if self.switches[0]:
            found.append(self._kernel())
        if self.has_lost:
            help = "record again with larger buffers"
            text = "packets or events were discarded while tracing, so jobs may be missing or joined"
            self.findings.add(codes.LOST_EVENTS(text, at=Location(self.file), help=help))
        report_unused(self.others, self.file, self.findings)
        return found


def _packed(fields: Fields, number: int) -> Iterator[int]:
    for value in fields.get(number, ()):
        if isinstance(value, int):
            yield value
            continue
        at = 0
        while at < len(value):
            single, at = _varint(value, at)
            yield single
