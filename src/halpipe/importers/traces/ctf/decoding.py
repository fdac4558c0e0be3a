"""Types that CTF metadata declares, and the decoders that are compiled of them.

A decoder reads one value at a byte of a packet and returns it with the byte after it. Fields of fixed size that stand
together are read at once, which is what makes millions of events bearable.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Literal

from halpipe.core.records import record


class CtfError(ValueError):
    """A fault of a trace; its text is for people."""


@record
class Int:
    """An integer of `size` bits; `text`: it is a character; `is_time`: it maps the value of a clock."""

    size: int
    align: int
    signed: bool
    order: str
    text: bool = False
    is_time: bool = False


@record
class Float:
    """A floating-point number of `size` bits."""

    size: int
    align: int
    order: str


@record
class String:
    """Text up to a null byte."""


@record
class Enum:
    """Labels for ranges (low, high, label) of an integer."""

    base: Int
    ranges: tuple[tuple[int, int, str], ...]


@record
class Struct:
    """Fields in order; `align` is the least alignment that is stated."""

    fields: tuple[tuple[str, Type], ...]
    align: int = 1


@record
class Variant:
    """One of several types, by the label of the enumeration in the field `tag`."""

    tag: str
    choices: tuple[tuple[str, Type], ...]


@record
class Array:
    """Elements of one type; `length` is a number, or the name of the field that holds it; `align` is the least."""

    element: Type
    length: int | str
    align: int = 1


Type = Int | Float | String | Enum | Struct | Variant | Array


def alignment(type: Type) -> int:
    """Return the alignment in bits; a variant has none of its own."""
    if isinstance(type, Struct):
        return max([type.align, *(alignment(field) for _, field in type.fields)])
    if isinstance(type, Enum):
        return type.base.align
    if isinstance(type, Array):
        return max(type.align, alignment(type.element))
    if isinstance(type, String):
        return 8
    return 1 if isinstance(type, Variant) else type.align


Scope = dict[str, Any]
Decoder = Callable[[bytes, int, Scope], tuple[Any, int]]

_CODES = {8: "b", 16: "h", 32: "i", 64: "q"}
_FLOATS = {32: "f", 64: "d"}


def decoder(type: Type) -> Decoder:
    """Return what reads `type`; raise `CtfError` for parts of bytes that are no fields in a row of whole bytes."""
    if isinstance(type, Enum):
        return decoder(type.base)
    if isinstance(type, Int | Float):
        return _number(type)
    if isinstance(type, String):
        return _string
    if isinstance(type, Struct):
        return _structure(type)
    if isinstance(type, Array):
        return _array(type)
    raise CtfError(f'a variant by "{type.tag}" stands outside of a structure')


def _code(type: Int | Float) -> str:
    known = _CODES if isinstance(type, Int) else _FLOATS
    if type.size not in known or (type.align % 8 and type.align != 1):
        raise CtfError(f"a field of {type.size} bits cannot be read")
    code = known[type.size]
    return code.upper() if isinstance(type, Int) and not type.signed else code


def _number(type: Int | Float) -> Decoder:
    unpack = struct.Struct(type.order + _code(type)).unpack_from
    size, mask = type.size // 8, max(type.align, 8) // 8 - 1

    def read(data: bytes, at: int, _scope: Scope) -> tuple[Any, int]:
        at = (at + mask) & ~mask
        return unpack(data, at)[0], at + size

    return read


def _string(data: bytes, at: int, _scope: Scope) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode("utf-8", "replace"), end + 1


def field_name(name: str) -> str:
    """Return the name of a field without the underscore that the language adds."""
    return name.removeprefix("_")


def _structure(type: Struct) -> Decoder:
    mask = max(alignment(type), 8) // 8 - 1
    names = tuple(field_name(name) for name, _ in type.fields)
    steps: list[tuple[Any, Any, Any]] = []
    run: list[Int | Float] = []

    def flush(following: int = 1) -> None:
        if run:
            steps.append(_bits(run, following) if any(map(_is_part, run)) else _layout(run))
            run.clear()

    for _, field in type.fields:
        flat = field.base if isinstance(field, Enum) else field
        if not isinstance(flat, Int | Float):
            flush(alignment(flat))
            is_plain = isinstance(field, String)
            if isinstance(field, Array) and isinstance(field.element, Int | Float):
                is_plain = isinstance(field.length, int)
            steps.append((None, _variant(field, type) if isinstance(field, Variant) else decoder(field), is_plain))
            continue
        if run and (run[0].order != flat.order or max(8, flat.align) > max(8, run[0].align)):
            flush(flat.align)
        run.append(flat)
    flush()

    if len(steps) == 1 and steps[0][0] is not None:  # numbers only, as most are
        ((unpack_all, whole, _),) = steps

        def read_numbers(data: bytes, at: int, _scope: Scope) -> tuple[dict[str, Any], int]:
            at = (at + mask) & ~mask
            return dict(zip(names, unpack_all(data, at), strict=True)), at + whole

        return read_numbers

    def read(data: bytes, at: int, scope: Scope) -> tuple[dict[str, Any], int]:
        at = (at + mask) & ~mask
        values: list[Any] = []
        for unpack, more, rest in steps:
            if unpack is not None:
                at = (at + rest) & ~rest
                values += unpack(data, at)
                at += more
            else:  # of text and arrays of numbers, no field before it decides the length
                value, at = more(data, at, scope if rest else {**scope, **dict(zip(names, values, strict=False))})
                values.append(value)
        return dict(zip(names, values, strict=True)), at

    return read


Step = tuple[Callable[[bytes, int], tuple[Any, ...]], int, int]
"""What unpacks fields in a row, their bytes, and the mask of the alignment of the first, which is aligned most."""


def _layout(fields: list[Int | Float]) -> Step:
    layout, size = fields[0].order, 0
    for field in fields:
        pad = -size % (max(8, field.align) // 8)
        layout += "x" * pad + _code(field)
        size += pad + field.size // 8
    return struct.Struct(layout).unpack_from, size, max(8, fields[0].align) // 8 - 1


def _is_part(field: Int | Float) -> bool:
    """Whether a number has, or begins within, parts of bytes."""
    return isinstance(field, Int) and (field.size not in _CODES or field.align in (2, 4))


def _bits(fields: list[Int | Float], following: int) -> Step:
    """Fields with parts of bytes among them: the first bit is the lowest of the first byte, or with ">" the highest."""
    order: Literal["little", "big"] = "little" if fields[0].order == "<" else "big"
    rules, bits = list[tuple[int, int, int, int, int]](), 0
    for field in fields:
        if not isinstance(field, Int):
            raise CtfError("a number with a point among parts of bytes cannot be read")
        bits = -(-bits // field.align) * field.align
        first, skipped = divmod(bits, 8)
        size = -(-(skipped + field.size) // 8)
        shift = skipped if order == "little" else 8 * size - skipped - field.size
        rules.append((first, size, shift, (1 << field.size) - 1, field.signed and 1 << field.size - 1))
        bits += field.size
    if bits % 8 and following < 8:
        raise CtfError(f"fields of {bits} bits, which end within a byte, cannot be read")
    whole = -(-bits // 8)

    def unpack(data: bytes, at: int) -> tuple[int, ...]:
        if at + whole > len(data):
            raise CtfError("a packet ends within a field")
        found = (
            (int.from_bytes(data[at + o : at + o + n], order) >> shift & mask, sign)
            for o, n, shift, mask, sign in rules
        )
        return tuple((value ^ sign) - sign for value, sign in found)

    return unpack, whole, max(8, fields[0].align) // 8 - 1


def _array(type: Array) -> Decoder:
    length, element = type.length, type.element
    plain = field_name(length) if isinstance(length, str) else ""
    mask = max(8, alignment(type)) // 8 - 1

    def count(scope: Scope) -> int:
        if isinstance(length, int):
            return length
        found = scope.get(plain)
        if not isinstance(found, int) or found < 0:
            raise CtfError(f'the length "{plain}" of a sequence is not stated before it')
        return found

    if isinstance(element, Int) and _is_part(element):

        def read_parts(data: bytes, at: int, scope: Scope) -> tuple[list[int], int]:
            number, at = count(scope), (at + mask) & ~mask
            if number * element.size > 8 * (len(data) - at):
                raise CtfError("a sequence is longer than its packet")
            if not number:
                return [], at
            unpack, size, _ = _bits([element] * number, 1)
            return list(unpack(data, at)), at + size

        return read_parts
    if isinstance(element, Int | Float) and element.align <= element.size:  # so that there are no gaps between them
        code, size = _code(element), element.size // 8
        is_text = isinstance(element, Int) and element.text and element.size == 8

        def read(data: bytes, at: int, scope: Scope) -> tuple[Any, int]:
            number = count(scope)
            if number * size > len(data) - at:
                raise CtfError("a sequence is longer than its packet")
            if is_text:
                return data[at : at + number].split(b"\0", 1)[0].decode("utf-8", "replace"), at + number
            at = (at + mask) & ~mask
            return list(struct.unpack_from(f"{element.order}{number}{code}", data, at)), at + number * size

        return read
    inner = decoder(element)

    def read_each(data: bytes, at: int, scope: Scope) -> tuple[list[Any], int]:
        number, found, at = count(scope), [], (at + mask) & ~mask  # that of no elements counts, too
        if number > len(data) - at:
            raise CtfError("a sequence is longer than its packet")
        for _ in range(number):
            value, at = inner(data, at, scope)
            found.append(value)
        return found, at

    return read_each


def _variant(type: Variant, owner: Struct) -> Decoder:
    """Return what reads a variant whose tag is a field of the same structure."""
    tags = [field for name, field in owner.fields if field_name(name) == field_name(type.tag)]
    if not tags or not isinstance(tags[0], Enum):
        raise CtfError(f'a variant has the tag "{type.tag}", which is no enumeration beside it')
    choices = {field_name(label): decoder(choice) for label, choice in type.choices}
    ranges = [(low, high, choices.get(field_name(label))) for low, high, label in tags[0].ranges]
    tag = field_name(type.tag)

    def read(data: bytes, at: int, scope: Scope) -> tuple[Any, int]:
        for low, high, choice in ranges:
            if low <= scope[tag] <= high and choice is not None:
                return choice(data, at, scope)
        raise CtfError(f'no choice of a variant is that of "{tag}" = {scope[tag]}')

    return read
