"""Packets of CTF streams as events, in the order of time.

A packet that is cut off, that belongs to another trace, or whose instants contradict each other ends its stream: the
events before it count, and the damage is reported. So are events and packets that the tracer discarded.
"""

from __future__ import annotations

import heapq
import os
import struct
from dataclasses import dataclass, field
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from halpipe.core.files import folders_with, mapped, plain_files, read_bytes
from halpipe.importers.traces.ctf.decoding import (
    CtfError,
    Decoder,
    Enum,
    Int,
    Struct,
    Type,
    Variant,
    alignment,
    decoder,
    field_name,
)
from halpipe.importers.traces.ctf.fragments import SEPARATOR, parse_fragments
from halpipe.importers.traces.ctf.metadata import MAGIC as METADATA_MAGIC
from halpipe.importers.traces.ctf.metadata import Metadata, parse, text_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from mmap import mmap

MAGIC = 0xC1FC1FC1
_MAGICS = (METADATA_MAGIC.to_bytes(4, "little"), METADATA_MAGIC.to_bytes(4, "big"))
METADATA = "metadata"
_LARGEST_HEAD = 4096
_MALFORMED = (CtfError, struct.error, ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError)
"""What comes of declarations, and of packets, that contradict themselves."""


Head: TypeAlias = "Callable[[bytes, int, int], tuple[int, int, int]]"
"""Reads the header of an event at a byte of a packet, given the time so far: its id, its time, and the next byte."""


class Event(NamedTuple):
    """An event: nanoseconds on the clock of the trace, name, CPU, contexts such as vpid and vtid, and its fields."""

    time: int
    name: str
    cpu: int
    context: dict[str, Any]
    fields: dict[str, Any]


@dataclass(slots=True)
class Damage:
    """Losses of a trace: discarded events and packets, and streams that are cut off or cannot be read further."""

    discarded: int = 0
    packets: int = 0
    broken: list[str] = field(default_factory=list)


def folders(root: str) -> list[str]:
    """Return the folders in and below `root` that hold a trace: a file called metadata that begins like one of CTF."""
    return [folder for folder in folders_with(root, METADATA) if _begins(os.path.join(folder, METADATA))]


def _begins(path: str) -> bool:
    try:
        with mapped(path) as data:
            return data[:10] == b"/* CTF 1.8" or data[:2] == b"\x1e{" or data[:4] in _MAGICS
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def events(folders: list[str], damage: Damage) -> Iterator[Event]:
    """Yield the events of all streams of all traces by time; note in `damage` what they lack."""
    streams = [stream for folder in folders for stream in _Trace(folder, damage).streams()]
    yield from heapq.merge(*streams, key=itemgetter(0))


class _Stream:
    """Decoders of one kind of streams: of headers, contexts and each class of events."""

    def __init__(self, meta: Metadata, number: int) -> None:
        stated = meta.streams[number]
        self.context = decoder(stated.get("packet.context", Struct(())))
        self._event_context = stated.get("event.context")
        self._classes = {int(e.get("id", 0)): e for e in meta.events if int(e.get("stream_id", 0)) == number}
        self.decoders: dict[int, tuple[str, Decoder | None, Decoder | None, Decoder | None]] = {}
        header = stated.get("event.header", Struct(()))
        self.align = max(8, alignment(header)) // 8
        self.head = _lttng(header) or _general(header)

    def of(self, id: int) -> tuple[str, Decoder | None, Decoder | None, Decoder | None]:
        """Return name and decoders of a class of events, made when the first one occurs: most never do."""
        if id not in self.decoders:
            if id not in self._classes:
                raise CtfError(f"an event has the id {id}, which is not declared")
            stated = self._classes[id]
            types = (self._event_context, stated.get("context"), stated.get("fields"))
            first, second, third = (None if type is None else decoder(type) for type in types)
            self.decoders[id] = (str(stated["name"]), first, second, third)
        return self.decoders[id]


def _lttng(header: Struct) -> Head | None:
    """Return what reads LTTng's headers, compact (5 bits and 27) or large (16 and 32); None for any other.

    They have a way of their own since most traces have them, and the compact one has bit fields.
    """
    id, choice = (dict(header.fields).get(name) for name in ("id", "v"))
    if not isinstance(id, Enum) or not isinstance(choice, Variant) or id.base.size not in (5, 16) or choice.tag != "id":
        return None
    is_compact = id.base.size == 5
    last, width = (31, 27) if is_compact else (65535, 32)
    choices = dict(choice.choices)
    if {*choices} != {"compact", "extended"}:
        return None
    if sorted(id.ranges) != [(0, last - 1, "compact"), (last, last, "extended")]:
        return None
    shorter, longer = (max(8, alignment(choices[name])) // 8 for name in ("compact", "extended"))
    u16, u32, u64 = (struct.Struct(id.base.order + code).unpack_from for code in "HIQ")
    little = id.base.order == "<"

    def head(data: bytes, at: int, now: int) -> tuple[int, int, int]:
        if is_compact:
            id = data[at] & 31 if little else data[at] >> 3
            if id != last:
                (word,) = u32(data, at)
                low = word >> 5 if little else word & 0x7FFFFFF
            at += 1 if id == last else 4
        else:
            (id,) = u16(data, at)
            at += 2
            if id != last:
                at = -(-at // shorter) * shorter
                (low,) = u32(data, at)
                at += 4
        if id != last:
            return id, now + ((low - now) & ((1 << width) - 1)), at
        at = -(-at // longer) * longer
        (id,) = u32(data, at)
        at = -(-(at + 4) // longer) * longer
        return id, u64(data, at)[0], at + 8

    return head


def _general(header: Struct) -> Head:
    """Return what reads any header of whole bytes that CTF 1.8 allows, none at all too."""
    read, fields = decoder(header), dict(header.fields)
    clocks = _clocks(header)
    choices = [
        (field_name(name), field_name(field.tag), low, high, _clocks(dict(field.choices).get(label)))
        for name, field in header.fields
        if isinstance(field, Variant) and isinstance(tag := fields[field.tag], Enum)
        for low, high, label in tag.ranges
    ]

    def head(data: bytes, at: int, now: int) -> tuple[int, int, int]:
        found, at = read(data, at, {})
        id = found.get("id", 0)
        chosen = [(found[name], sizes) for name, tag, low, high, sizes in choices if low <= found[tag] <= high]
        for values, sizes in ((found, clocks), *chosen):
            for name, size in sizes:
                now += (values[name] - now) & ((1 << size) - 1)
            id = values.get("id", id) if isinstance(values, dict) else id
        return id, now, at

    return head


def _frequency_and_offset(clock: dict[str, Any]) -> tuple[int, int]:
    """Return the cycles of a clock in a second, and the nanoseconds from its origin to its first cycle."""
    frequency = int(clock.get("freq", 10**9))
    return frequency, int(clock.get("offset_s", 0)) * 10**9 + int(clock.get("offset", 0)) * 10**9 // frequency


def _clocks(type: Type | None) -> list[tuple[str, int]]:
    fields = type.fields if isinstance(type, Struct) else ()
    ints = [(field_name(name), field) for name, field in fields if isinstance(field, Int)]
    return [(name, field.size) for name, field in ints if field.is_time or name == "timestamp"]


class _Trace:
    def __init__(self, folder: str, damage: Damage) -> None:
        self._folder = folder
        self._damage = damage
        text = text_of(read_bytes(os.path.join(folder, METADATA)))
        meta = parse_fragments(text) if text.startswith(SEPARATOR) else parse(text)
        try:
            self._take(meta)
        except CtfError:
            raise
        except _MALFORMED:
            raise CtfError("what the metadata declares cannot be read: a number, a size or a name is none") from None

    def _take(self, meta: Metadata) -> None:
        clocks = {_frequency_and_offset(clock) for clock in meta.clocks or [{}]}
        if len(clocks) > 1:
            raise CtfError("its clocks have unlike frequencies or offsets; only traces with one clock are read")
        [(self._frequency, self._offset)] = clocks
        self._header = decoder(meta.trace.get("packet.header", Struct(())))
        self._uuid = [*bytes.fromhex(str(meta.trace.get("uuid", "")).replace("-", ""))]
        tracer = (meta.env.get("tracer_name"), meta.env.get("tracer_major", 0), meta.env.get("tracer_minor", 0))
        # Before 2.11, LTTng wrote events after the end that their packet states.
        self._ends_late = str(tracer[0]).startswith("lttng") and tracer[1:] < (2, 11)
        self._streams = {number: _Stream(meta, number) for number in meta.streams}

    def streams(self) -> list[Iterator[Event]]:
        """Return the events of each file."""
        return [self._file(path) for path in plain_files(self._folder) if os.path.basename(path) != METADATA]

    def _file(self, path: str) -> Iterator[Event]:
        with mapped(path) as data:
            at = discarded = ended = now = 0
            first: _Stream | None = None
            following: int | None = None
            while at < len(data):
                try:
                    stream, context, start, end, size = self._packet(data, at)
                    if first not in (None, stream):
                        raise CtfError("the packet belongs to another stream")
                    first, (begin, ended) = stream, self._span(context, ended)
                    number = context.get("packet_seq_num")
                    if number is not None:
                        self._damage.packets += max(0, number - (number if following is None else following))
                        following = number + 1
                    now = max(now, begin)
                    for event in self._events(stream, context, data[at : at + end], start):
                        before, now = now, event.time
                        if now < before:
                            raise CtfError("an event precedes its packet, or the event before it")
                        if ended and now > ended and not self._ends_late:
                            raise CtfError("an event follows the end of its packet")
                        yield event
                    ended = max(now, ended)
                    lost = int(context.get("events_discarded", discarded))
                    if lost < discarded:
                        raise CtfError("the count of discarded events decreases")
                except _MALFORMED as failure:
                    known = str(failure) if isinstance(failure, CtfError) else "a packet is malformed"
                    self._damage.broken.append(f"{os.path.basename(path)} from byte {at} on: {known}")
                    return
                self._damage.discarded += lost - discarded
                discarded = lost
                at += size

    def _span(self, context: dict[str, Any], ended: int) -> tuple[int, int]:
        """Return the first and last instant of a packet, 0 where it states none; raise `CtfError` if they disagree."""
        begin, end = (self._ns(context[key]) if context.get(key) else 0 for key in ("timestamp_begin", "timestamp_end"))
        if end and begin > end:
            raise CtfError("the packet ends before it begins")
        if begin and begin < ended:
            raise CtfError("the packet begins before the end of the one before it")
        return begin, end

    def _packet(self, data: mmap, at: int) -> tuple[_Stream, dict[str, Any], int, int, int]:
        """Return the kind of stream, the context, first and last byte of the events, and the size of a packet."""
        head = data[at : at + _LARGEST_HEAD]
        header, position = self._header(head, 0, {})
        if header.get("magic", MAGIC) != MAGIC:
            raise CtfError("no packet begins there")
        if self._uuid and header.get("uuid", self._uuid) != self._uuid:
            raise CtfError("the packet belongs to another trace")
        number = int(header.get("stream_id", next(iter(self._streams), 0)))
        if number not in self._streams:
            raise CtfError(f"stream {number} is not declared")
        stream = self._streams[number]
        context, position = stream.context(head, position, {})
        bits = int(context.get("packet_size", context.get("content_size", 8 * (len(data) - at))))
        filled = int(context.get("content_size", bits))
        size, end = bits // 8, filled // 8
        if not position <= end <= size or not size or bits % 8 or filled % 8:
            raise CtfError("a packet has sizes that contradict each other")
        if at + size > len(data):
            raise CtfError("the packet is cut off")
        return stream, context, position, end, size

    def _events(self, stream: _Stream, packet: dict[str, Any], data: bytes, at: int) -> Iterator[Event]:
        now, cpu = int(packet.get("timestamp_begin", 0)), int(packet.get("cpu_id", -1))
        head, align, known, new = stream.head, stream.align, stream.decoders, tuple.__new__
        plain = self._offset if self._frequency == 10**9 else None
        while (begin := -(-at // align) * align) < len(data):
            id, now, at = head(data, begin, now)
            name, common, own, fields = known.get(id) or stream.of(id)
            context: dict[str, Any] = {}
            if common is not None:
                context, at = common(data, at, {})
            if own is not None:
                more, at = own(data, at, {})
                context = {**context, **more}
            values: dict[str, Any] = {}
            if fields is not None:
                values, at = fields(data, at, {})
            if at == begin:
                raise CtfError("an event has no bytes")
            yield new(Event, (self._ns(now) if plain is None else plain + now, name, cpu, context, values))

    def _ns(self, cycles: int) -> int:
        return self._offset + (cycles if self._frequency == 10**9 else cycles * 10**9 // self._frequency)
