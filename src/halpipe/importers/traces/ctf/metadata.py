"""Declarations of CTF: the TSDL text of CTF 1.8, in packets or plain, and the JSON fragments of CTF 2.

Fragments become the same declarations: the roles of fields become the names that CTF 1.8 gives them, and the ranges
that select a choice become labels of an enumeration. Optional fields and integers of variable length have no
counterpart, and are refused.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass, field, replace
from typing import Any

from halpipe.importers.traces.ctf.decoding import Array, CtfError, Enum, Float, Int, String, Struct, Type, Variant

MAGIC = 0x75D11D57
_HEADER = 37
"""Bytes before the text of a packet: magic, UUID, checksum, two sizes in bits, three schemes, version."""
_MOST_BYTES = 64 * 2**20
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
    stated = re.search(r"\bbyte_order\s*=\s*(\w+)", text)
    parser = _Parser(text, _ORDERS.get(stated[1], "<") if stated else "<")
    try:
        parser.run()
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as failure:
        if isinstance(failure, CtfError):
            raise
        raise CtfError(f"line {parser.line} of the metadata cannot be read") from None
    return parser.found


class _Parser:
    def __init__(self, text: str, order: str) -> None:
        self.found = Metadata(order)
        self._types: dict[str, Type] = {}
        self._tokens: list[tuple[str, str | int, int]] = []
        self._weights: dict[int, int] = {}
        self._weighed: list[Type] = []
        self._at = 0
        self._level = 0
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

    @property
    def line(self) -> int:
        """The line of the next token."""
        return self._tokens[min(self._at, len(self._tokens) - 1)][2]

    def run(self) -> None:
        """Read all declarations."""
        while self._tokens[self._at][0] != "end":
            word = self._peek()
            if word in ("trace", "env", "clock", "stream", "event", "callsite"):
                self._next()
                self._keep(str(word), self._block())
                self._want(";")
            else:
                self._declaration()

    def _keep(self, kind: str, body: dict[str, Any]) -> None:
        if kind == "trace":
            self.found.trace = body
        elif kind == "env":
            self.found.env = body
        elif kind == "clock":
            self.found.clocks.append(body)
        elif kind == "stream":
            self.found.streams[int(body.get("id", 0))] = body
        elif kind == "event":
            self.found.events.append(body)

    # ------------------------------------------------------------------------------------------- tokens

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

    def _want(self, sign: str) -> None:
        line, found = self.line, self._next()
        if found != sign:
            raise CtfError(f"line {line} of the metadata has {str(found)[:40]!r} for {sign!r}")

    # ------------------------------------------------------------------------------------- declarations

    def _declaration(self) -> None:
        if self._peek() in ("typealias", "typedef"):
            is_alias = self._next() == "typealias"
            type = self._type()
            if is_alias:
                self._want(":=")
            words = []
            while self._peek() != ";":
                words.append(str(self._next()))
            self._types[" ".join(words)] = type
        else:
            self._type()
        self._want(";")

    def _block(self) -> dict[str, Any]:
        body: dict[str, Any] = {}
        self._want("{")
        while self._peek() != "}":
            declares = self._peek() in ("struct", "enum", "variant") and self._peek(2) == "{"
            if self._peek() in ("typealias", "typedef") or declares:
                self._declaration()
                continue
            key = str(self._next())
            while self._peek() not in ("=", ":="):
                key += str(self._next())
            body[key] = self._type() if self._next() == ":=" else self._value()
            self._want(";")
        self._want("}")
        return body

    def _value(self) -> str | int:
        value = self._next()
        while self._peek() != ";":
            value = f"{value}{self._next()}"
        return value

    # -------------------------------------------------------------------------------------------- types

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
            stated = self._block()
            size = int(stated["exp_dig"]) + int(stated["mant_dig"])
            return Float(size, int(stated.get("align", 8)), self._order(stated))
        if word == "string":
            if self._peek() == "{":
                self._block()
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
        stated = self._block()
        size = int(stated["size"])
        return Int(
            size,
            power_of_two(int(stated.get("align", 8 if size % 8 == 0 else 1))),
            str(stated.get("signed", 0)).lower() in ("1", "true"),
            self._order(stated),
            str(stated.get("encoding", "none")).lower() in ("utf8", "ascii"),
            str(stated.get("map", "")).startswith("clock."),
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
        """Return the last name of a reference such as ``<stream.event.header.id>``."""
        self._want(start)
        last = ""
        while self._peek() != end:
            last = str(self._next())
        self._want(end)
        return last

    def _enumeration(self, base: Type | None) -> Enum:
        if not isinstance(base, Int):
            base = Int(32, 8, False, self.found.order)
        self._want("{")
        ranges, following = [], 0
        while self._peek() != "}":
            label = str(self._next())
            low = high = following
            if self._peek() == "=":
                self._next()
                low = high = int(self._next())
                if self._peek() == "...":
                    self._next()
                    high = int(self._next())
            ranges.append((low, high, label))
            following = high + 1
            if self._peek() == ",":
                self._next()
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
            name = str(self._next())
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
            found.append((name, type))
        self._want("}")
        return tuple(found)


def power_of_two(align: int) -> int:
    """Return an alignment in bits; raise `CtfError` if it is none."""
    if align < 1 or align > 2**16 or align & (align - 1):
        raise CtfError(f"an alignment of {align} bits is none")
    return align


SEPARATOR = "\x1e"
_BYTE_ORDERS = {"little-endian": "<", "big-endian": ">"}
_NAMES = {
    "packet-magic-number": "magic",
    "metadata-stream-uuid": "uuid",
    "data-stream-class-id": "stream_id",
    "packet-total-length": "packet_size",
    "packet-content-length": "content_size",
    "packet-end-default-clock-timestamp": "timestamp_end",
    "discarded-event-record-counter-snapshot": "events_discarded",
    "packet-sequence-number": "packet_seq_num",
    "event-record-class-id": "id",
}
"""Names in CTF 1.8 of the fields that have a role."""
_BYTE = Int(8, 8, False, "<")


def parse_fragments(text: str) -> Metadata:
    """Read the declarations; raise `CtfError` where a fragment cannot be read."""
    found, aliases = Metadata(), dict[str, Any]()
    for number, fragment in enumerate(filter(str.strip, text.split(SEPARATOR)), 1):
        try:
            _take(json.loads(fragment), found, _Classes(aliases))
        except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as failure:
            what = str(failure) if isinstance(failure, CtfError) else "it is malformed"
            raise CtfError(f"fragment {number} of the metadata cannot be read: {what}") from None
    return found


def _take(stated: dict[str, Any], found: Metadata, classes: _Classes) -> None:
    kind = stated["type"]
    if kind == "preamble" and stated["version"] != 2:
        raise CtfError(f"it is of version {stated['version']}")
    if kind == "preamble" and "uuid" in stated:
        found.trace["uuid"] = bytes(stated["uuid"]).hex()
    elif kind == "field-class-alias":
        classes.aliases[stated["name"]] = stated["field-class"]
    elif kind == "clock-class":
        offset = stated.get("offset-from-origin", {})
        clock = {"freq": stated["frequency"], "offset_s": offset.get("seconds", 0), "offset": offset.get("cycles", 0)}
        found.clocks.append(clock)
    elif kind == "trace-class":
        found.env = stated.get("environment", {})
        classes.put(found.trace, "packet.header", stated.get("packet-header-field-class"))
    elif kind == "data-stream-class":
        stream = found.streams.setdefault(stated.get("id", 0), {})
        classes.put(stream, "packet.context", stated.get("packet-context-field-class"), "timestamp_begin")
        classes.put(stream, "event.header", stated.get("event-record-header-field-class"))
        classes.put(stream, "event.context", stated.get("event-record-common-context-field-class"))
    elif kind == "event-record-class":
        stream = stated.get("data-stream-class-id", 0)
        event = {"name": stated.get("name", ""), "id": stated.get("id", 0), "stream_id": stream}
        classes.put(event, "context", stated.get("specific-context-field-class"))
        classes.put(event, "fields", stated.get("payload-field-class"))
        found.events.append(event)


class _Classes:
    """Translates field classes, by `aliases` where they have one."""

    def __init__(self, aliases: dict[str, Any]) -> None:
        self.aliases = aliases
        self._level = self._made_so_far = 0
        self._clock = ""

    def put(self, into: dict[str, Any], key: str, stated: Any, clock: str = "") -> None:
        """Declare the type `key` if a class is stated; `clock` names the field that holds the time."""
        self._clock = clock
        if stated is not None:
            into[key] = self._type(stated)

    def _type(self, stated: Any) -> Type:
        self._level += 1
        self._made_so_far += 1
        if self._level > MOST_LEVELS or self._made_so_far > MOST_FIELDS:
            raise CtfError(f"it nests deeper than {MOST_LEVELS}, or has more than {MOST_FIELDS} fields")
        stated = self._resolved(stated)
        type = self._made(stated, stated["type"])
        self._level -= 1
        return type

    def _resolved(self, stated: Any) -> Any:
        """Return a field class itself where an alias is stated."""
        for _ in range(MOST_LEVELS):
            if not isinstance(stated, str):
                return stated
            stated = self.aliases[stated]
        raise CtfError("an alias stands for itself")

    def _made(self, stated: dict[str, Any], kind: str) -> Type:
        if kind.startswith("fixed-length-"):
            size, align, order = (
                stated["length"],
                power_of_two(stated.get("alignment", 1)),
                _BYTE_ORDERS[stated["byte-order"]],
            )
            if kind == "fixed-length-floating-point-number":
                return Float(size, align, order)
            is_time = "default-clock-timestamp" in stated.get("roles", ())
            return Int(size, align, kind == "fixed-length-signed-integer", order, is_time=is_time)
        if kind == "null-terminated-string":
            return String()
        if kind == "structure":
            fields: dict[str, tuple[str, Type]] = {}
            for member in stated.get("member-classes", ()):
                self._member(fields, member["name"], self._resolved(member["field-class"]))
            return Struct(tuple(fields.values()), power_of_two(stated.get("minimum-alignment", 1)))
        if kind.startswith(("static-length-", "dynamic-length-")):
            length = stated["length"] if kind.startswith("static") else stated["length-field-location"]["path"][-1]
            if isinstance(length, int) and not 0 <= length <= LONGEST_ARRAY:
                raise CtfError(f"an array has {length} elements")
            if kind.endswith("array"):
                return Array(self._type(stated["element-field-class"]), length)
            return Array(replace(_BYTE, text=kind.endswith("string")), length)
        raise CtfError(f'fields of the class "{kind[:60]}" are not read')

    def _member(self, fields: dict[str, tuple[str, Type]], name: str, stated: Any) -> None:
        if stated["type"] == "variant":
            self._variant(fields, name, stated)
            return
        type = self._type(stated)
        roles = stated.get("roles", ())
        known = next((_NAMES[role] for role in roles if role in _NAMES), None)
        if self._clock and "default-clock-timestamp" in roles:
            known = self._clock
        fields[name] = known or name, type

    def _variant(self, fields: dict[str, tuple[str, Type]], name: str, stated: dict[str, Any]) -> None:
        """Append a variant, and make its selector the enumeration by which CTF 1.8 selects."""
        selecting = stated["selector-field-location"]["path"][-1]
        tag, selector = fields.get(selecting, ("", None))
        if not isinstance(selector, Int):
            raise CtfError("the selector of a variant is no integer beside it")
        choices, ranges = [], []
        for number, option in enumerate(stated["options"]):
            label = option.get("name") or f"option {number}"
            choices.append((label, self._type(option["field-class"])))
            ranges += [(low, high, label) for low, high in option["selector-field-ranges"]]
        fields[selecting] = tag, Enum(selector, tuple(ranges))
        fields[name] = name, Variant(tag, tuple(choices))
