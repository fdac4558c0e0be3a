"""Records: frozen dataclasses with slots that cost a third of the time to define.

The standard decorator writes and compiles six functions for each class, which was a third of what a short command did.
Here one is compiled, ``__init__``; the others are closures over the fields of a class.
``fields``, ``replace``, ``asdict``, ``match`` and ``pickle`` take records for what they are, dataclasses.
"""

from __future__ import annotations

import dataclasses
from dataclasses import MISSING, FrozenInstanceError, fields
from functools import partial
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, TypeVar, cast, dataclass_transform, overload

if TYPE_CHECKING:
    from collections.abc import Callable

    def field(
        *, default: Any = ..., init: bool = True, repr: bool = True, compare: bool = True, metadata: Any = None
    ) -> Any:
        """Return a field of a record; its default may have any type that the record coerces."""

else:
    field = dataclasses.field

__all__ = ["field", "record", "unchecked"]

T = TypeVar("T")
FACTORY = object()
"""Stands where the factory of a field makes its value."""


@overload
def record(cls: type[T], /) -> type[T]: ...


@overload
def record(*, kw_only: bool = False, eq: bool = True) -> Callable[[type[T]], type[T]]: ...


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, field))
def record(cls: type[T] | None = None, /, *, kw_only: bool = False, eq: bool = True) -> Any:
    """Make a class a dataclass with ``frozen=True`` and ``slots=True``; without `eq`, records are equal to themselves.

    Methods that the class states itself stay. Records may be derived from records, and from nothing else with fields.
    """
    return partial(_record, kw_only=kw_only, eq=eq) if cls is None else _record(cls, kw_only, eq)


def _record(cls: Any, kw_only: bool, eq: bool) -> Any:
    stated = set(vars(cls))
    cls.__doc__ = cls.__doc__ or cls.__name__  # else the standard library spends time on writing one
    made: Any = dataclasses.dataclass(init=False, repr=False, eq=False, slots=True, kw_only=kw_only)(cls)
    methods = {
        "__init__": _initializer(made),
        "__repr__": _text(tuple(field.name for field in fields(made) if field.repr)),
        "__setattr__": _refuse_to_set,
        "__delattr__": _refuse_to_delete,
        "__getstate__": _state,
        "__setstate__": _restore,
    }
    if eq:
        values = _values(tuple(field.name for field in fields(made) if field.compare))
        methods |= {"__eq__": _equality(values), "__hash__": _digest(values)}
    for name in methods.keys() - stated:
        setattr(made, name, methods[name])
    return made


def _initializer(cls: Any) -> Callable[..., None]:
    """Write and compile ``__init__``."""
    last = ["self.__post_init__()"] if hasattr(cls, "__post_init__") else []
    initializer: Any = _compiled(cls, "__init__", ["self"], [], last)
    initializer.__annotations__ = {field.name: field.type for field in fields(cls) if field.init}
    initializer.__qualname__ = f"{cls.__qualname__}.__init__"
    return cast("Callable[..., None]", initializer)


def unchecked(cls: type[T]) -> Callable[..., T]:
    """Return a function that makes records of a class without ``__post_init__``: of fields known to be right."""
    return cast("Callable[..., T]", _compiled(cls, "unchecked", [], ["self = new(cls)"], ["return self"]))


def _compiled(cls: Any, name: str, positional: list[str], first: list[str], last: list[str]) -> Any:
    """Compile a function of the fields: each value goes to its slot past ``__setattr__``, which refuses."""
    known: dict[str, Any] = {"FACTORY": FACTORY, "cls": cls, "new": object.__new__}
    by_keyword, lines = ["*"], [*first]
    for field in fields(cls):
        at = field.name
        known |= {f"set_{at}": getattr(cls, at).__set__, f"default_{at}": field.default}
        known[f"make_{at}"] = field.default_factory
        if field.default is not MISSING:
            default, absent, value = f"=default_{at}", f"default_{at}", at
        elif field.default_factory is not MISSING:
            default, absent, value = "=FACTORY", f"make_{at}()", f"make_{at}() if {at} is FACTORY else {at}"
        else:
            default, absent, value = "", "", at
        if field.init:
            (by_keyword if field.kw_only else positional).append(at + default)
        if field.init or absent:
            lines.append(f"set_{at}(self, {value if field.init else absent})")
    parameters = ", ".join(positional + by_keyword * (len(by_keyword) > 1))
    body = "\n ".join([*lines, *last]) or "pass"
    exec(f"def {name}({parameters}):\n {body}", known)
    return known[name]


def _values(names: tuple[str, ...]) -> Callable[[Any], Any]:
    """Return a function in C that reads these attributes."""
    return attrgetter(*names) if names else type


def _equality(values: Callable[[Any], Any]) -> Callable[[Any, object], bool]:
    def equal(self: Any, other: object) -> bool:
        return self is other or (values(self) == values(other) if type(other) is type(self) else NotImplemented)

    return equal


def _digest(values: Callable[[Any], Any]) -> Callable[[Any], int]:
    def digest(self: Any) -> int:
        return hash(values(self))

    return digest


def _text(names: tuple[str, ...]) -> Callable[[Any], str]:
    @recursive_repr()
    def text(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    return text


def _refuse_to_set(_self: object, name: str, _value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}; dataclasses.replace makes a changed copy")


def _refuse_to_delete(_self: object, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _state(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in fields(self)]


def _restore(self: Any, state: list[Any]) -> None:
    for field, value in zip(fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)
