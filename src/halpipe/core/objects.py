"""Typed access to JSON objects: every reader of a JSON form asks for members by name and type.

What is wrong goes to `complain`, with the path of the object, and a harmless value is returned in its place. A reader
that stops at the first fault complains by raising.
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import parse_rational

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Complain = Callable[[str, str], None]

_MOST = 1 << 62
_ADDRESSES = 1 << 56


def parse_json(content: bytes, complain: Complain) -> JsonObject:
    """Return the object of a JSON text; numbers with a point stay texts, so that they are read exactly."""
    try:
        data = json.loads(content, parse_float=str, parse_constant=str)
    except (ValueError, RecursionError) as failure:
        complain("", f"is no JSON: {failure}")
        data = {}
    return JsonObject(data, "", complain)


class JsonObject:
    """An object of a JSON document, with its path in it."""

    def __init__(self, data: Any, path: str, complain: Complain) -> None:
        self.path, self._complain = path, complain
        if not isinstance(data, dict):
            self.fault("is no object")
            data = {}
        self._data: Mapping[str, Any] = data

    def fault(self, message: str) -> None:
        """Complain about this object."""
        self._complain(self.path.strip(), message)

    def has(self, key: str) -> bool:
        """Return whether a member is there."""
        return key in self._data

    def names(self) -> list[str]:
        """Return the names of all members."""
        return list(self._data)

    def is_object(self, key: str) -> bool:
        """Return whether a member is there and an object."""
        return isinstance(self._data.get(key), dict)

    def number(self, key: str, low: int = 0, high: int = _MOST) -> int:
        """Return a whole number in a range, its least value where there is none."""
        value = self._get(key)
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
            return value
        self._wrong(key, f"no whole number from {low} to {high}")
        return low

    def rational(self, key: str, low: Fraction | int | None = None, high: Fraction | int | None = None) -> Fraction:
        """Return a number such as 12, "0.5" or "1/3", exact."""
        value, least = self._get(key), Fraction(low or 0)
        try:
            number = parse_rational(value if isinstance(value, str) else str(int(value)))
        except (ValueError, TypeError):
            self._wrong(key, 'no number such as 12, "0.5" or "1/3"')
            return least
        if (low is not None and number < low) or (high is not None and number > high):
            self._wrong(key, f"no number from {low} to {high}")
            return least
        return number

    def address(self, key: str) -> int:
        """Return an address, which is a text in hexadecimal digits."""
        return self._address(key, self._get(key))

    def addresses(self, key: str) -> tuple[int, ...]:
        """Return a list of addresses."""
        return tuple(self._address(key, value) for value in self._list(key))

    def _address(self, key: str, value: Any) -> int:
        try:
            number = int(value, 16) if isinstance(value, str) else -1
        except ValueError:
            number = -1
        if 0 <= number < _ADDRESSES:
            return number
        self._wrong(key, "no address", value)
        return 0

    def text(self, key: str) -> str:
        """Return a text."""
        value = self._get(key)
        if isinstance(value, str):
            return value
        self._wrong(key, "no text")
        return ""

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts."""
        return tuple(value for value in self._list(key) if isinstance(value, str))

    def duration(self, key: str) -> Duration:
        """Return a duration, which is a text with its unit."""
        text = self.text(key)
        try:
            return Duration.parse(text) if text else ZERO
        except ValueError as failure:
            self.fault(f'"{key}": {failure}')
            return ZERO

    def object(self, key: str) -> JsonObject:
        """Return a member that is an object."""
        return JsonObject(self._get(key) if self.has(key) else {}, f"{self.path}{key} ", self._complain)

    def objects(self, key: str) -> list[JsonObject]:
        """Return the objects of a list."""
        return [JsonObject(each, f"{self.path}{key}[{n}] ", self._complain) for n, each in enumerate(self._list(key))]

    def named(self, key: str) -> Iterator[tuple[str, JsonObject]]:
        """Yield the members of an object that are objects, with their names."""
        value = self._get(key)
        for name in value if isinstance(value, dict) else ():
            yield name, JsonObject(value[name], f'{self.path}{key} "{name}" ', self._complain)

    def _list(self, key: str) -> list[Any]:
        value = self._get(key)
        if isinstance(value, list):
            return value
        self._wrong(key, "no list")
        return []

    def _get(self, key: str) -> Any:
        if key not in self._data:
            self.fault(f'lacks "{key}"')
        return self._data.get(key)

    def _wrong(self, key: str, what: str, value: Any = None) -> None:
        """Complain about a value; a member that is not there has been reported."""
        if key in self._data:
            shown = repr(self._data[key] if value is None else value)
            self.fault(f'"{key}" is {shown[:40]}, {what}')
