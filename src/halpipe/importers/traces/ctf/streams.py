"""Reads the packets of CTF streams into events, in the order of time.

A packet that is cut off ends its stream: what comes before it counts, and the damage is reported. So does a counter of
events that the tracer discarded.
"""

from __future__ import annotations

import heapq
import os
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.files import folders_with, mapped, plain_files, read_bytes
from halpipe.importers.traces.ctf.decoding import Decoder, decoder
from halpipe.importers.traces.ctf.metadata import MAGIC as METADATA_MAGIC
from halpipe.importers.traces.ctf.metadata import Metadata, parse, text_of
from halpipe.importers.traces.ctf.types import CtfError, Enum, Struct, Variant, alignment

if TYPE_CHECKING:
    from collections.abc import Iterator
    from mmap import mmap

MAGIC = 0xC1FC1FC1
_MAGICS = (METADATA_MAGIC.to_bytes(4, "little"), METADATA_MAGIC.to_bytes(4, "big"))
METADATA = "metadata"
_LARGEST_HEAD = 4096
_MALFORMED = (CtfError, struct.error, ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError)
"""What comes of declarations, and of packets, that contradict themselves."""


class Event(NamedTuple):
    """An event: nanoseconds on the clock of the trace, name, CPU, contexts such as vpid and vtid, and its fields."""

    time: int
    name: str
    cpu: int
    context: dict[str, Any]
    fields: dict[str, Any]


@dataclass(slots=True)
class Damage:
    """What a trace lacks: events that the tracer discarded, and streams that are cut off or cannot be read on."""

    discarded: int = 0
    broken: list[str] = field(default_factory=list)


def folders(root: str) -> list[str]:
    """Return the folders in and below `root` that hold a trace: a file called metadata that begins like one of CTF."""
    return [folder for folder in folders_with(root, METADATA) if _begins(os.path.join(folder, METADATA))]


def _begins(path: str) -> bool:
    try:
        with mapped(path) as data:
            return data[:6] == b"/* CTF" or data[:2] == b"\x1e{" or data[:4] in _MAGICS
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def events(folders: list[str], damage: Damage) -> Iterator[Event]:
    """Yield the events of all streams of all traces by time; note in `damage` what they lack."""
    streams = [stream for folder in folders for stream in _Trace(folder, damage).streams()]
    yield from heapq.merge(*streams, key=lambda event: event.time)


class _Stream:
    """What metadata says of one kind of streams: how to read headers, contexts and each class of events."""

    def __init__(self, meta: Metadata, number: int) -> None:
        stated = meta.streams[number]
        self.context = decoder(_struct(stated, "packet.context"))
        self._event_context = stated.get("event.context")
        self._classes = {int(e.get("id", 0)): e for e in meta.events if int(e.get("stream_id", 0)) == number}
        self._decoders: dict[int, tuple[str, Decoder | None, Decoder | None, Decoder | None]] = {}
        self._head(_struct(stated, "event.header"))

    def _head(self, header: Struct) -> None:
        """Take what differs between the headers that LTTng knows: compact (5 bits and 27) and large (16 and 32)."""
        fields = dict(header.fields)
        id, choice = fields.get("id"), fields.get("v")
        if not isinstance(id, Enum) or not isinstance(choice, Variant):
            raise CtfError("the header of its events is neither LTTng's compact nor its large one")
        self.is_compact = id.base.size == 5
        self.last = 31 if self.is_compact else 65535
        if id.base.size not in (5, 16) or not any(low <= self.last <= high for low, high, _ in id.ranges):
            raise CtfError("the header of its events is neither LTTng's compact nor its large one")
        choices = dict(choice.choices)
        self.align = max(8, alignment(header)) // 8
        self.align_short = max(8, alignment(choices["compact"])) // 8
        self.align_long = max(8, alignment(choices["extended"])) // 8

    def of(self, id: int) -> tuple[str, Decoder | None, Decoder | None, Decoder | None]:
        """Return name and decoders of a class of events, made when the first one occurs: most never do."""
        if id not in self._decoders:
            if id not in self._classes:
                raise CtfError(f"an event has the id {id}, which is not declared")
            stated = self._classes[id]
            types = (self._event_context, stated.get("context"), stated.get("fields"))
            first, second, third = (None if type is None else decoder(type) for type in types)
            self._decoders[id] = (str(stated["name"]), first, second, third)
        return self._decoders[id]


def _struct(stated: dict[str, Any], key: str) -> Struct:
    found = stated.get(key)
    if not isinstance(found, Struct):
        raise CtfError(f"the metadata does not declare {key}")
    return found


class _Trace:
    def __init__(self, folder: str, damage: Damage) -> None:
        self._folder = folder
        self._damage = damage
        meta = parse(text_of(read_bytes(os.path.join(folder, METADATA))))
        try:
            self._take(meta)
        except CtfError:
            raise
        except _MALFORMED:
            raise CtfError("what the metadata declares cannot be read: a number, a size or a name is none") from None

    def _take(self, meta: Metadata) -> None:
        clock = meta.clocks[0] if meta.clocks else {}
        self._frequency = int(clock.get("freq", 10**9)) or 10**9
        self._offset = int(clock.get("offset_s", 0)) * 10**9
        self._offset += int(clock.get("offset", 0)) * 10**9 // self._frequency
        self._order = meta.order
        self._header = decoder(_struct(meta.trace, "packet.header"))
        self._streams = {number: _Stream(meta, number) for number in meta.streams}

    def streams(self) -> list[Iterator[Event]]:
        """Return the events of each file."""
        return [self._file(path) for path in plain_files(self._folder) if os.path.basename(path) != METADATA]

    def _file(self, path: str) -> Iterator[Event]:
        with mapped(path) as data:
            at = discarded = 0
            while at < len(data):
                try:
                    stream, context, start, end, size = self._packet(data, at)
                    packet = data[at : at + size]
                    yield from self._events(stream, context, packet, start, end)
                    lost = int(context.get("events_discarded", 0))
                except _MALFORMED as failure:
                    known = str(failure) if isinstance(failure, CtfError) else "a packet is malformed"
                    self._damage.broken.append(f"{os.path.basename(path)} from byte {at} on: {known}")
                    return
                self._damage.discarded += max(0, lost - discarded)
                discarded = max(lost, discarded)
                at += size

    def _packet(self, data: mmap, at: int) -> tuple[_Stream, dict[str, Any], int, int, int]:
        """Return the kind of stream, the context, first and last byte of the events, and the size of a packet."""
        head = data[at : at + _LARGEST_HEAD]
        header, position = self._header(head, 0, {})
        if header.get("magic") != MAGIC:
            raise CtfError("no packet begins there")
        number = int(header.get("stream_id", 0))
        if number not in self._streams:
            raise CtfError(f"stream {number} is not declared")
        stream = self._streams[number]
        context, position = stream.context(head, position, {})
        size, end = int(context["packet_size"]) // 8, int(context["content_size"]) // 8
        if not position <= end <= size:
            raise CtfError("a packet has sizes that contradict each other")
        if at + size > len(data):
            raise CtfError("the packet is cut off")
        return stream, context, position, end, size

    def _events(self, stream: _Stream, packet: dict[str, Any], data: bytes, at: int, end: int) -> Iterator[Event]:
        short = struct.Struct(self._order + ("I" if stream.is_compact else "H")).unpack_from
        u32, u64 = (struct.Struct(self._order + code).unpack_from for code in "IQ")
        now, cpu = int(packet.get("timestamp_begin", 0)), int(packet.get("cpu_id", -1))
        little = self._order == "<"
        data = data[:end]
        while at < end:
            at = -(-at // stream.align) * stream.align
            if at >= end:
                break
            if stream.is_compact:
                width = 27
                first = data[at] & 31 if little else data[at] >> 3
                if first != stream.last:
                    (word,) = short(data, at)
                    id, low = (word & 31, word >> 5) if little else (word >> 27, word & 0x7FFFFFF)
                    at += 4
                else:
                    id, at = first, at + 1
            else:
                width = 32
                (id,) = short(data, at)
                at += 2
                if id != stream.last:
                    at = -(-at // stream.align_short) * stream.align_short
                    (low,) = u32(data, at)
                    at += 4
            if id == stream.last:
                at = -(-at // stream.align_long) * stream.align_long
                (id,) = u32(data, at)
                at = -(-(at + 4) // stream.align_long) * stream.align_long
                (now,) = u64(data, at)
                at += 8
            else:
                now += (low - now) & ((1 << width) - 1)
            name, common, own, fields = stream.of(id)
            context: dict[str, Any] = {}
            if common is not None:
                context, at = common(data, at, {})
            if own is not None:
                more, at = own(data, at, {})
                context = {**context, **more}
            values: dict[str, Any] = {}
            if fields is not None:
                values, at = fields(data, at, {})
            yield Event(self._ns(now), name, cpu, context, values)

    def _ns(self, cycles: int) -> int:
        return self._offset + (cycles if self._frequency == 10**9 else cycles * 10**9 // self._frequency)
