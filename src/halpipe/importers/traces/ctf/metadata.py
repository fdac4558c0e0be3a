"""Declarations of CTF 1.8: the text in TSDL, in packets or plain.

The grammar is read strictly: an attribute that is stated twice or unknown is a fault, since it may decide sizes or
times; babeltrace2 warns of unknown ones.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from halpipe.importers.traces.ctf.decoding import (
    Array,
    CtfError,
    Enum,
    Float,
    Int,
    String,
    Struct,
    Type,
    Variant,
    field_name,
)

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator

MAGIC = 0x75D11D57
_HEADER = 37
"""Bytes before the text of a packet: magic, UUID, checksum, two sizes in bits, three schemes, version."""
_MOST_BYTES = 64 * 2**20
_MOST_BITS = 64
MOST_LEVELS = 40
LONGEST_ARRAY = 2**24
MOST_FIELDS = 10_000
"""Fields of a type with those of its types, which double with each level where a type has two of another."""
_TOKEN = re.compile(
    r"/\*.*?\*/|//[^\n]*"
    r'|"(?P<text>(?:\\.|[^"\\])*)"'
    r"|(?P<sign>\.\.\.|:=|->|[{}\[\]()<>;:,=.*])"
    r"|(?P<number>[-+]?(?:0[xX][0-9a-fA-F]{1,16}|\d{1,20}))[uUlL]*"
    r"|(?P<word>[A-Za-z_]\w*)|\s+",
    re.DOTALL,
)
_FLAGS = {"true": True, "1": True, "false": False, "0": False}
_ATTRIBUTES = {
    "trace": ("major", "minor", "uuid", "byte_order", "packet.header"),
    "clock": ("name", "uuid", "description", "freq", "precision", "offset_s", "offset", "absolute"),
    "stream": ("id", "event.header", "event.context", "packet.context"),
    "event": ("name", "id", "stream_id", "loglevel", "model.emf.uri", "context", "fields"),
    "integer": ("size", "align", "signed", "byte_order", "base", "encoding", "map"),
    "floating_point": ("exp_dig", "mant_dig", "align", "byte_order"),
    "string": ("encoding",),
}
_HEADERS = {"packet.header": {"magic", "uuid", "stream_id", "stream_instance_id"}, "event.header": {"id", "timestamp"}}
_ORDERS = {"be": ">", "network": ">", "le": "<"}


def text_of(raw: bytes) -> str:
    """Return the text of the metadata, of CTF 2 too; raise `CtfError` if it is none."""
    if len(raw) > _MOST_BYTES:
        raise CtfError(f"the metadata has {len(raw)} bytes, more than {_MOST_BYTES}")
    for order in "<>":
        if len(raw) >= 4 and struct.unpack_from(order + "I", raw)[0] == MAGIC:
            raw = b"".join(_packets(raw, order))
            break
    try:
        return raw.decode()
    except UnicodeDecodeError as failure:
        raise CtfError(f"byte {failure.start} of the metadata is no text") from None


def _packets(raw: bytes, order: str) -> list[bytes]:
    found, at = [], 0
    while at < len(raw):
        if at + _HEADER > len(raw):
            raise CtfError(f"the metadata is cut off at byte {len(raw)}")
        magic, _, _, content, size, compression, encryption = struct.unpack_from(order + "I16sIII2B", raw, at)
        if magic != MAGIC or compression or encryption or not 8 * _HEADER <= content <= size or size % 8:
            raise CtfError(f"no readable packet of metadata at byte {at}")
        if at + content // 8 > len(raw):
            raise CtfError(f"the metadata is cut off at byte {len(raw)}")
        found.append(raw[at + _HEADER : at + content // 8])
        at += size // 8
    return found


@dataclass(slots=True)
class Metadata:
    """Declarations of a trace: byte order, environment, clock, header of packets, streams and classes of events."""

    order: str = "<"
    trace: dict[str, Any] = field(default_factory=dict)
    env: dict[str, Any] = field(default_factory=dict)
    clocks: list[dict[str, Any]] = field(default_factory=list)
    streams: dict[int, dict[str, Any]] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)


def parse(text: str) -> Metadata:
    """Read the declarations; raise `CtfError` where the text does not follow the grammar."""
    parser = _Parser(text)
    try:
        parser.run()
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as failure:
        if isinstance(failure, CtfError):
            raise
        raise CtfError(f"line {parser.line} of the metadata cannot be read") from None
    return parser.found


class _Parser:
    def __init__(self, text: str) -> None:
        self.found = Metadata()
        self._types: dict[str, Type] = {}
        self._tokens: list[tuple[str, str | int, int]] = []
        self._weights: dict[int, int] = {}
        self._weighed: list[Type] = []
        self._mapped: set[str] = set()
        self._declared: set[tuple[str, Hashable]] = set()
        self._at = 0
        self._level = self._depth = 0
        line, position = 1, 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                raise CtfError(f"line {line} of the metadata has {text[position : position + 20]!r}")
            if kind := match.lastgroup:
                shown = match[kind]
                value = int(shown, 16 if "x" in shown.lower() else 10) if kind == "number" else shown
                self._tokens.append((kind, value, line))
            line += match[0].count("\n")
            position = match.end()
        self._tokens.append(("end", "", line))
        self.found.order = self._byte_order()

    @property
    def line(self) -> int:
        """The line of the next token."""
        return self._tokens[self._at][2]

    def _byte_order(self) -> str:
        """Return what the trace states: it also holds for the types before that."""
        depth, inside = 0, False
        for at in range(len(self._tokens)):
            word, following = self._peek(at), self._peek(at + 1)
            depth += (word == "{") - (word == "}")
            if depth == 0:
                inside = (word, following) == ("trace", "{")
            order = str(self._peek(at + 2))
            if inside and depth == 1 and (word, following) == ("byte_order", "=") and order in _ORDERS:
                return _ORDERS[order]
        raise CtfError("the metadata states no byte order")

    def run(self) -> None:
        """Read all declarations."""
        while self._tokens[self._at][0] != "end":
            word = self._peek()
            if word in ("trace", "env", "clock", "stream", "event", "callsite"):
                self._next()
                self._keep(str(word), self._block(str(word)))
                self._want(";")
            else:
                self._declaration()
        if unknown := self._mapped - {str(clock["name"]) for clock in self.found.clocks}:
            raise CtfError(f'the metadata declares no clock "{min(unknown)[:40]}"')
        if self._mapped:
            self.found.clocks = [clock for clock in self.found.clocks if str(clock["name"]) in self._mapped]
        self.found.streams = self.found.streams or {0: {}}

    def _keep(self, kind: str, body: dict[str, Any]) -> None:
        for key, known in _HEADERS.items():  # where a name is damaged, ids or times would be misread
            if unknown := sorted({*_numbers(body.get(key), "")} - known):
                raise CtfError(f'the metadata has the field "{unknown[0][:40]}" in {key}, which has no meaning')
        if kind == "trace":
            self._once(kind, "")
            if (body.get("major"), body.get("minor")) != (1, 8):
                raise CtfError(f"the metadata is of CTF {body.get('major')}.{body.get('minor')}")
            self.found.trace = body
        elif kind == "env":
            self._once(kind, "")
            self.found.env = body
        elif kind == "clock":
            self._once(kind, body["name"])
            if int(body.get("freq", 1)) < 1:
                raise CtfError(f"line {self.line} of the metadata has a clock without a frequency")
            self.found.clocks.append(body)
        elif kind == "stream":
            self._once("stream", number := int(body.get("id", 0)))
            self.found.streams[number] = body
        elif kind == "event":
            self._once("event", (body.get("stream_id", 0), body.get("id", 0)))
            self.found.events.append(body)

    def _once(self, kind: str, name: Hashable) -> None:
        """Refuse a second declaration: it is open which one holds."""
        if (kind, name) in self._declared:
            raise CtfError(f"line {self.line} of the metadata declares a second {kind}")
        self._declared.add((kind, name))

    def _peek(self, ahead: int = 0) -> str | int | None:
        """Return a token, None for quoted text: it is never a sign or a word."""
        kind, value, _ = self._tokens[min(self._at + ahead, len(self._tokens) - 1)]
        return None if kind == "text" else value

    def _next(self) -> str | int:
        kind, value, _ = self._tokens[self._at]
        if kind == "end":
            raise CtfError("the metadata is cut off")
        self._at += 1
        return value

    def _word(self) -> str:
        kind, line = self._tokens[self._at][0], self.line
        word = str(self._next())
        if kind != "word":
            raise CtfError(f"line {line} of the metadata has {word[:40]!r} for a name")
        return word

    def _want(self, sign: str) -> None:
        line, found = self.line, self._next()
        if found != sign:
            raise CtfError(f"line {line} of the metadata has {str(found)[:40]!r} for {sign!r}")

    def _declaration(self) -> None:
        if self._peek() in ("typealias", "typedef"):
            is_alias = self._next() == "typealias"
            type = self._type()
            if is_alias:
                self._want(":=")
            words = [self._word()]
            while self._peek() != ";":
                words.append(self._word())
            if not self._depth:
                self._once("type", " ".join(words))
            self._types[" ".join(words)] = type
        else:
            self._type()
        self._want(";")

    def _block(self, kind: str) -> dict[str, Any]:
        """Read attributes; those that `kind` does not have are refused, since they may decide sizes or times."""
        body: dict[str, Any] = {}
        self._want("{")
        self._depth += 1
        outside = dict(self._types)
        while self._peek() != "}":
            declares = self._peek() in ("struct", "enum", "variant") and self._peek(2) == "{"
            if self._peek() in ("typealias", "typedef") or declares:
                self._declaration()
                continue
            line, key = self.line, self._word()
            while self._peek() == ".":
                self._next()
                key += f".{self._word()}"
            if key in body or key not in _ATTRIBUTES.get(kind, (key,)):
                raise CtfError(f'line {line} of the metadata has the attribute "{key}" of a {kind}, unknown or twice')
            sign = self._next()
            if sign not in ("=", ":="):
                raise CtfError(f"line {line} of the metadata has {str(sign)[:40]!r} for a sign of equality")
            body[key] = self._type() if sign == ":=" else self._value()
            self._want(";")
        self._depth -= 1
        self._types = outside
        self._want("}")
        return body

    def _value(self) -> str | int:
        value = self._next()
        while self._peek() != ";":
            value = f"{value}{self._next()}"
        return value

    def _type(self) -> Type:
        self._level += 1
        if self._level > MOST_LEVELS:
            raise CtfError(f"line {self.line} of the metadata nests deeper than {MOST_LEVELS}")
        try:
            return self._any_type()
        finally:
            self._level -= 1

    def _any_type(self) -> Type:
        word = str(self._next())
        if word == "integer":
            return self._integer()
        if word == "floating_point":
            stated = self._block("floating_point")
            size = int(stated["exp_dig"]) + int(stated["mant_dig"])
            return Float(size, int(stated.get("align", 8)), self._order(stated))
        if word == "string":
            if self._peek() == "{":
                self._block("string")
            return String()
        if word in ("struct", "variant", "enum"):
            return self._compound(word)
        while f"{word} {self._peek()}" in self._types:
            word += f" {self._next()}"
        if word not in self._types:
            raise CtfError(f'line {self.line} of the metadata uses the type "{word[:40]}", which is not declared')
        return self._types[word]

    def _order(self, stated: dict[str, Any]) -> str:
        return _ORDERS.get(str(stated.get("byte_order")), self.found.order)

    def _integer(self) -> Int:
        stated = self._block("integer")
        size, clock = int(stated["size"]), str(stated.get("map", "")).split(".")
        if not 1 <= size <= _MOST_BITS:
            raise CtfError(f"line {self.line} of the metadata has an integer of {size} bits")
        is_time, signed = "map" in stated, str(stated.get("signed", 0)).lower()
        if signed not in _FLAGS:
            raise CtfError(f"line {self.line} of the metadata has {signed[:40]!r} for true or false")
        if is_time and (len(clock) != 3 or clock[0] != "clock" or clock[2] != "value"):
            raise CtfError(f"line {self.line} of the metadata maps an integer to no value of a clock")
        if is_time:
            self._mapped.add(clock[1])
        return Int(
            size,
            power_of_two(int(stated.get("align", 8 if size % 8 == 0 else 1))),
            _FLAGS[signed],
            self._order(stated),
            str(stated.get("encoding", "none")).lower() in ("utf8", "ascii"),
            is_time,
        )

    def _compound(self, word: str) -> Type:
        name = str(self._next()) if self._tokens[self._at][0] == "word" and self._peek() != "align" else None
        tag = self._reference("<", ">") if word == "variant" and self._peek() == "<" else None
        base: Type | None = None
        if word == "enum" and self._peek() == ":":
            self._next()
            base = self._type()
        if self._peek() != "{":
            known = self._types[f"{word} {name}"]
            if tag is not None and isinstance(known, Variant):
                known = Variant(tag, known.choices)
                self._weigh(known, known.choices)
            return known
        type: Type
        if word == "enum":
            type = self._enumeration(base)
        else:
            fields = self._fields()
            align = 1
            if self._peek() == "align":
                self._next()
                self._want("(")
                align = power_of_two(int(self._next()))
                self._want(")")
            type = Struct(fields, align) if word == "struct" else Variant(tag or "", fields)
            self._weigh(type, fields)
        if name:
            if not self._depth:
                self._once(word, name)
            self._types[f"{word} {name}"] = type
        return type

    def _weigh(self, type: Struct | Variant, fields: tuple[tuple[str, Type], ...]) -> None:
        """Refuse types of types that double with each level: all their fields are compiled."""
        weight = 1
        for _, inner in fields:
            while isinstance(inner, Array):
                inner = inner.element
            weight += self._weights.get(id(inner), 1)
        if weight > MOST_FIELDS:
            raise CtfError(f"line {self.line} of the metadata has a type of more than {MOST_FIELDS} fields")
        self._weights[id(type)] = weight
        self._weighed.append(type)  # so that no other type gets its id

    def _reference(self, start: str, end: str) -> str:
        """Return the whole of a reference: one of more than a name, ``<stream.event.header.id>``, is found nowhere."""
        self._want(start)
        name = self._word()
        while self._peek() == ".":
            self._next()
            name += f".{self._word()}"
        self._want(end)
        return name

    def _enumeration(self, base: Type | None) -> Enum:
        if not isinstance(base, Int):
            base = Int(32, 8, False, self.found.order)
        self._want("{")
        ranges, following = [], 0
        while self._peek() != "}":
            label = self._word() if self._peek() is not None else str(self._next())
            low = high = following
            if self._peek() == "=":
                self._next()
                low = high = int(self._next())
                if self._peek() == "...":
                    self._next()
                    high = int(self._next())
            ranges.append((low, high, label))
            following = high + 1
            if self._peek() != "}":
                self._want(",")
        self._want("}")
        return Enum(base, tuple(ranges))

    def _fields(self) -> tuple[tuple[str, Type], ...]:
        found: list[tuple[str, Type]] = []
        self._want("{")
        while self._peek() != "}":
            if self._peek() in ("typealias", "typedef"):
                self._declaration()
                continue
            type = self._type()
            line, name = self.line, self._word()
            if name in self._types:
                raise CtfError(f'line {line} of the metadata has the type "{name[:40]}" for a name')
            while self._peek() == "[":
                if self._tokens[self._at + 1][0] == "number":
                    self._next()
                    length = int(self._next())
                    self._want("]")
                    if not 0 <= length <= LONGEST_ARRAY:
                        raise CtfError(f"line {self.line} of the metadata has an array of {length} elements")
                    type = Array(type, length)
                else:
                    type = Array(type, self._reference("[", "]"))
            self._want(";")
            if any(name == known for known, _ in found):
                raise CtfError(f'line {self.line} of the metadata has the field "{name[:40]}" twice')
            found.append((name, type))
        self._want("}")
        return tuple(found)


def _numbers(type: Type | None, name: str) -> Iterator[str]:
    """Yield the names of all numbers of a type but those that map a clock."""
    if isinstance(type, Struct | Variant):
        for inner, field in type.fields if isinstance(type, Struct) else type.choices:
            yield from _numbers(field, inner)
    elif type is not None and not (isinstance(type, Int) and type.is_time):
        yield field_name(name)


def power_of_two(align: int) -> int:
    """Return an alignment in bits; raise `CtfError` if it is none."""
    if align < 1 or align > 2**16 or align & (align - 1):
        raise CtfError(f"an alignment of {align} bits is none")
    return align
