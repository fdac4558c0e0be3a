"""Declarations of CTF 2: JSON fragments, translated into those of CTF 1.8.

The roles of fields become the names that CTF 1.8 gives them, and the ranges that select a choice become labels of an
enumeration. Optional fields, integers of variable length, texts in UTF-16 and UTF-32 and bits in another order than
their bytes have no counterpart, and are refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from halpipe.core.files import load_json
from halpipe.importers.traces.ctf.decoding import Array, CtfError, Enum, Float, Int, String, Struct, Type, Variant
from halpipe.importers.traces.ctf.metadata import LONGEST_ARRAY, MOST_FIELDS, MOST_LEVELS, Metadata, power_of_two

SEPARATOR = "\x1e"
_BYTE_ORDERS = {"little-endian": "<", "big-endian": ">"}
_BIT_ORDERS = {"<": "first-to-last", ">": "last-to-first"}
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
_WITH_MEANING = {*_NAMES.values(), "timestamp", "timestamp_begin"}
_ROOTS = {
    "packet.header": "packet-header",
    "packet.context": "packet-context",
    "event.header": "event-record-header",
    "event.context": "event-record-common-context",
    "context": "event-record-specific-context",
    "fields": "event-record-payload",
}
"""Origins of the locations of fields, by the structures where they begin."""
_WITH_ROLES = ("packet-header", "packet-context", "event-record-header")
_BYTE = Int(8, 8, False, "<")
_Fields = dict[str, tuple[str, Type]]


def parse_fragments(text: str) -> Metadata:
    """Read the declarations; raise `CtfError` where a fragment cannot be read."""
    found, aliases = Metadata(), dict[str, Any]()
    for number, fragment in enumerate(filter(str.strip, text.split(SEPARATOR)), 1):
        try:
            _take(load_json(fragment), found, _Classes(aliases))
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
        if stated["frequency"] < 1:
            raise CtfError("a clock has no frequency")
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
        self._root = self._clock = ""
        self._open: list[_Fields] = []
        self._names: list[str] = []
        """The structures around a field with their fields so far, from the root on, and the members that lead to it."""

    def put(self, into: dict[str, Any], key: str, stated: Any, clock: str = "") -> None:
        """Declare the type `key` if a class is stated; `clock` names the field that holds the time."""
        self._root, self._clock = _ROOTS[key], clock
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
        if (encoding := stated.get("encoding", "utf-8")) != "utf-8":
            raise CtfError(f'texts in "{str(encoding)[:60]}" are not read')
        if kind.startswith("fixed-length-"):
            size, order = stated["length"], _BYTE_ORDERS[stated["byte-order"]]
            if (bits := stated.get("bit-order", _BIT_ORDERS[order])) != _BIT_ORDERS[order]:
                raise CtfError(f"bits {str(bits)[:60]} in bytes {stated['byte-order']} are not read")
            align = power_of_two(stated.get("alignment", 1))
            if kind == "fixed-length-floating-point-number":
                return Float(size, align, order)
            is_time = "default-clock-timestamp" in stated.get("roles", ())
            return Int(size, align, kind == "fixed-length-signed-integer", order, is_time=is_time)
        if kind == "null-terminated-string":
            return String()
        if kind == "structure":
            self._open.append({})
            for member in stated.get("member-classes", ()):
                self._names.append(member["name"])
                self._member(member["name"], self._resolved(member["field-class"]))
                self._names.pop()
            return Struct(tuple(self._open.pop().values()), power_of_two(stated.get("minimum-alignment", 1)))
        if kind.startswith(("static-length-", "dynamic-length-")):
            if kind.startswith("static"):
                length = stated["length"]
            else:
                around, name = self._located(stated["length-field-location"])
                length = around[name][0]
            if isinstance(length, int) and not 0 <= length <= LONGEST_ARRAY:
                raise CtfError(f"an array has {length} elements")
            if kind.endswith("array"):
                align = power_of_two(stated.get("minimum-alignment", 1))
                return Array(self._type(stated["element-field-class"]), length, align)
            return Array(replace(_BYTE, text=kind.endswith("string")), length)
        raise CtfError(f'fields of the class "{kind[:60]}" are not read')

    def _located(self, stated: dict[str, Any]) -> tuple[_Fields, str]:
        """Return the fields among which a location leads, and the name there; refuse what no nearest name finds."""
        origin = stated.get("origin", self._root)
        path = [] if "origin" in stated else self._names[: len(self._open) - 1]
        for step in stated["path"]:
            if step is None:
                path.pop()
            else:
                path.append(step)
        *structures, name = path
        around = self._open[len(structures) :]
        if origin != self._root or structures != self._names[: len(structures)] or not around or name not in around[0]:
            raise CtfError(f"the field at {path!r:.60} is none of a structure around it")
        if any(name in nearer for nearer in around[1:]):
            raise CtfError(f"the field at {path!r:.60} is hidden by another one of its name")
        return around[0], name

    def _member(self, name: str, stated: Any) -> None:
        fields, has_meaning = self._open[-1], self._root in _WITH_ROLES
        if stated["type"] == "variant":
            self._variant(fields, name, stated)
            return
        inner = stated.get("member-classes", ()) if has_meaning else ()
        if any(self._resolved(member["field-class"]).get("roles") for member in inner):
            raise CtfError(f'"{name[:40]}" has members with roles, which are not read there')
        type = self._type(stated)
        roles = stated.get("roles", ())
        known = next((_NAMES[role] for role in roles if role in _NAMES), None)
        if self._clock and "default-clock-timestamp" in roles:
            known = self._clock
        if known is None and has_meaning and name in _WITH_MEANING:
            known = f"{name} without a role"
        fields[name] = known or name, type

    def _variant(self, fields: _Fields, name: str, stated: dict[str, Any]) -> None:
        """Append a variant, and make its selector the enumeration by which CTF 1.8 selects."""
        around, selecting = self._located(stated["selector-field-location"])
        tag, selector = around[selecting]
        if around is not fields or not isinstance(selector, Int):
            raise CtfError("the selector of a variant is no integer beside it")
        choices, ranges = [], []
        for number, option in enumerate(stated["options"]):
            label = option.get("name") or f"option {number}"
            choices.append((label, self._type(option["field-class"])))
            ranges += [(low, high, label) for low, high in option["selector-field-ranges"]]
        fields[selecting] = tag, Enum(selector, tuple(ranges))
        fields[name] = name, Variant(tag, tuple(choices))
