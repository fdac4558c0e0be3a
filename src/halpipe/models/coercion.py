"""Conversion of Python values to model fields: ``"5ms"`` to a duration, ``"64KiB"``, lists, names of enums.

Fields that already have their type, as all that readers make do, are only looked at.
"""

from __future__ import annotations

from dataclasses import Field, fields
from enum import Enum
from fractions import Fraction
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_rational
from halpipe.models.attributes import BANDWIDTH, SIZE, codec_of

DurationLike = Duration | str
"""A duration, or a text such as ``"5ms"``."""

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    R = TypeVar("R", covariant=True)
    W = TypeVar("W", contravariant=True)
    T = TypeVar("T")
    E = TypeVar("E", bound=Enum)

    class Coerced(Generic[R, W]):
        """A field as type checkers see it: given as `W`, read as `R`. At runtime it is an ordinary slot."""

        def __get__(self, instance: object, owner: object = None) -> R: ...
        def __set__(self, instance: object, value: W) -> None: ...

    Time = Coerced[Duration, DurationLike]
    OptionalTime = Coerced[Duration | None, DurationLike | None]
    Times = Coerced[tuple[Duration, ...], list[Duration] | list[str] | tuple[DurationLike, ...]]
    Exact = Coerced[Fraction, Fraction | int | str]
    Size = Coerced[int, int | str]
    OptionalSize = Coerced[int | None, int | str | None]
    Names = Coerced[tuple[str, ...], list[str] | tuple[str, ...]]
    Items = Coerced[tuple[T, ...], Iterable[T]]
    Choice = Coerced[E, E | str]
    OptionalChoice = Coerced[E | None, E | str | None]

_READ_AS = {
    "Time": "Duration",
    "OptionalTime": "Duration | None",
    "Times": "tuple[Duration, ...]",
    "Exact": "Fraction",
    "Size": "int",
    "OptionalSize": "int | None",
    "Names": "tuple[str, ...]",
    "Items": "tuple[*, ...]",
    "Choice": "*",
    "OptionalChoice": "* | None",
}
"""Content of a field of these types; the item of the brackets replaces the star."""

_EXAMPLES = {
    "Duration": 'a duration such as "5ms"',
    "Fraction": 'an exact number such as 1, Fraction(1, 3) or "0.35"',
    "int": "a whole number",
    "bool": "True or False",
    "str": "a text",
}


class Coercion:
    """Turns the fields of one dataclass into their types when a value of it is made."""

    def __init__(self, kind: type, namespace: dict[str, Any]) -> None:
        self._name = kind.__name__
        self._readers: list[tuple[str, tuple[type, ...], Callable[[Any], Any], str]] = []
        self._given = attrgetter(*(field.name for field in fields(kind)), "__class__")
        self._right: dict[tuple[type, ...], bool] = {}
        self._items: list[tuple[int, frozenset[type]]] = []
        for field in fields(kind):
            name, _, item = field.type.removesuffix("]").partition("[")
            held = _READ_AS[name].replace("*", item) if name in _READ_AS else field.type
            optional = held.endswith(" | None")
            stated = held.removesuffix(" | None")
            types, read = _reader(stated, namespace)
            if types[0] is tuple:
                self._items.append((len(self._readers), frozenset(_reader(stated[6:-6], namespace)[0])))
            read = _text_reader(field, read)
            self._readers.append((field.name, (*types, type(None)) if optional else types, read, stated))

    def __call__(self, value: object) -> None:
        """Coerce the fields of a new value; raise ``TypeError`` or ``ValueError`` that names the field."""
        given = self._given(value)
        kinds = tuple(map(type, given))
        right = self._right.get(kinds)
        if right is None:  # there are few combinations of types
            right = self._right[kinds] = self._are_right(kinds)
        if right:
            for at, types in self._items:
                if given[at] and not types.issuperset(map(type, given[at])):
                    break
            else:
                return
        self._coerce(value)

    def _are_right(self, kinds: tuple[type, ...]) -> bool:
        """Return whether fields of these types need no more than a look at what lists hold."""
        return all(kind in types for kind, (_, types, _, _) in zip(kinds, self._readers, strict=False))

    def _coerce(self, value: object) -> None:
        for name, types, read, stated in self._readers:
            given = getattr(value, name)
            if type(given) in types and not (types[0] is tuple and given):
                continue
            try:
                made = read(given)
            except TypeError as wrong:
                detail = str(wrong) or f"{given!r} is a {type(given).__name__}"
                raise TypeError(f"{self._name}.{name}: {detail}; give {_wanted(stated)}") from None
            except ValueError as wrong:
                raise ValueError(f"{self._name}.{name}: {wrong}") from None
            if made is not given:
                object.__setattr__(value, name, made)


def _text_reader(field: Field[Any], read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Let a size or bandwidth be given as a text, as in files: ``"64KiB"``."""
    codec = codec_of(field)
    if codec not in (SIZE, BANDWIDTH):
        return read
    return lambda given: codec.parse(given) if isinstance(given, str) else read(given)


def _wanted(stated: str) -> str:
    if stated.startswith("tuple["):
        return f"a list, of which each is {_wanted(stated[6:].removesuffix(', ...]'))}"
    return _EXAMPLES.get(stated, f"a {stated}")


def _reader(stated: str, namespace: dict[str, Any]) -> tuple[tuple[type, ...], Callable[[Any], Any]]:
    """Return the types that a field may have as they are, and what makes its type of other values."""
    if stated.startswith("tuple["):
        types, read = _reader(stated[6:].removesuffix(", ...]"), namespace)
        return (tuple,), lambda given: _tuple(given, types, read)
    plain: dict[str, tuple[type, Callable[[Any], Any]]] = {
        "Duration": (Duration, lambda given: Duration.parse(_same(given, str))),
        "Fraction": (Fraction, _fraction),
        "str": (str, lambda given: _same(given, str)),
        "bool": (bool, lambda given: _same(given, bool)),
        "int": (int, lambda given: _same(given, int)),
    }
    if stated in plain:
        kind, read = plain[stated]
        return (kind,), read
    kind = namespace[stated]
    return (kind,), partial(_word, kind) if issubclass(kind, Enum) else lambda given: _same(given, kind)


def _word(kind: type[Enum], given: Any) -> Enum:
    try:
        return kind(given)
    except ValueError:
        raise ValueError(f"{given!r} is not known; write one of {', '.join(map(str, kind))}") from None


def _tuple(given: Any, types: tuple[type, ...], read: Callable[[Any], Any]) -> tuple[Any, ...]:
    if isinstance(given, str | bytes) or not hasattr(given, "__iter__"):
        raise TypeError
    if type(given) is tuple and all(type(item) in types for item in given):
        return given
    try:
        return tuple(item if type(item) in types else read(item) for item in given)
    except TypeError as wrong:
        raise TypeError(f"in the list, {wrong}") from None


def _same(given: Any, *kinds: type) -> Any:
    """Return a value of one of some types; for Python, True is a number, too."""
    if not isinstance(given, kinds) or (isinstance(given, bool) and bool not in kinds):
        raise TypeError(f"{given!r} is a {type(given).__name__}")
    return given


def _fraction(given: Any) -> Fraction:
    return parse_rational(given) if isinstance(_same(given, int, str), str) else Fraction(given)
