"""The types that CTF metadata declares, and how they lie in memory."""

from __future__ import annotations

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
    """Elements of one type; `length` is a number, or the name of the field that holds it."""

    element: Type
    length: int | str


Type = Int | Float | String | Enum | Struct | Variant | Array


def alignment(type: Type) -> int:
    """Return the alignment in bits; a variant has none of its own."""
    if isinstance(type, Struct):
        return max([type.align, *(alignment(field) for _, field in type.fields)])
    if isinstance(type, Enum):
        return type.base.align
    if isinstance(type, Array):
        return alignment(type.element)
    if isinstance(type, String):
        return 8
    return 1 if isinstance(type, Variant) else type.align
