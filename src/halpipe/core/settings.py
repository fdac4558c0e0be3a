"""Typed access to the mappings of YAML and JSON files: every value is checked, every problem collected with its place.

Readers of single values turn text into a value and raise ``ValueError("what is wrong; what to do")``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from halpipe.core.diagnostics import Code, Findings, Location, error
from halpipe.core.files import Number, YamlList, YamlMap, parse_json, parse_yaml
from halpipe.core.quantities import quoted, whole
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping


T = TypeVar("T")
D = TypeVar("D")
T_co = TypeVar("T_co", covariant=True)

UNKNOWN_KEY = error(
    "HAL0021",
    "Settings file has an unknown key",
    "A key that is not read would silently have no effect, so it is an error.",
)
WRONG_TYPE = error(
    "HAL0022",
    "Settings file has a value of the wrong type",
    "A mapping, a list or a text stands where another of them is expected, or a key has no value.",
)
BAD_VALUE = error(
    "HAL0023",
    "Settings file has an unusable value",
    "A text does not read as the number, duration, name or word that is expected, or is out of its range.",
)
MISSING_KEY = error("HAL0024", "Settings file lacks a required key", "An element is incomplete without the key.")


MAX_UNKNOWN = 1000
"""Unknown keys of one mapping that are named before the rest is counted."""

MAX_NUMBER = 1 << 62
"""Largest number of a JSON file without a limit of its own."""


@record
class Stated(Generic[T_co]):
    """A value and the place in the overlay that states it."""

    value: T_co
    at: Location


class Words:
    """A reader of one of some `words`, and of what they `mean`."""

    def __init__(self, *words: str, mean: Callable[[str], Any] = str) -> None:
        self.words = words
        self._mean = mean

    def __call__(self, text: str) -> Any:
        """Return what `text` means; raise ``ValueError`` when it is none of the words."""
        if text not in self.words:
            help = did_you_mean(text, self.words, "write " + ", ".join(self.words))
            if text.split() and set(text.split()) <= set(self.words):
                help = "write commas between words, and brackets around them in YAML"
            raise ValueError(f"{quoted(text)} is not known; {help}")
        return self._mean(text)


class Fields:
    """One mapping: `path` names it in messages, `keys` are the keys it may have.

    `written` is for files that people do not edit: the code and the help of all their faults. There, every value that
    is read has to be present; with `unknown`, the code of keys that are not read, a value may be absent or empty.
    """

    addition = 'add "KEY: ..."'

    def __init__(
        self,
        file: str,
        findings: Findings,
        data: YamlMap,
        path: str,
        keys: tuple[str, ...] = (),
        inside: Mapping[str, tuple[str, ...]] | None = None,
        written: tuple[Code, str] | None = None,
        unknown: Code | None = None,
    ) -> None:
        self.path = path
        self._unknown = unknown
        self._file = file
        self._findings = findings
        self._data = data
        self._written = written
        self.allow(keys, inside)

    @classmethod
    def sealed(cls, content: bytes, file: str, findings: Findings, code: Code, help: str) -> Fields:
        """Return the mapping of a JSON or YAML file that people do not edit; an empty one where the text has none."""
        try:
            data = parse_json(content) if file.endswith(".json") else parse_yaml(content, file)
            message = "" if isinstance(data, YamlMap) else "is no mapping"
        except ValueError as failure:
            message = str(failure)
        if message:
            findings.add(code(message, at=Location(file), help=help))
            data = YamlMap(0)
        return cls(file, findings, data, "", written=(code, help))

    @property
    def data(self) -> YamlMap:
        """The mapping as it was parsed."""
        return self._data

    def is_mapping(self, key: str) -> bool:
        """Whether a mapping stands under a key that may also have one value."""
        return isinstance(self._data.get(key), YamlMap)

    def allow(self, keys: tuple[str, ...], inside: Mapping[str, tuple[str, ...]] | None = None) -> None:
        """Report the keys of the mapping that are not among `keys`; none given: whatever it has is allowed.

        Those that belong into a mapping under one of the keys, as `inside` states, are reported with it.
        """
        unknown = [key for key in self._data if key not in keys] if keys else []
        otherwise = "it may have: " + ", ".join(keys)
        owners = {key: owner for owner, own in (inside or {}).items() for key in own}
        for key in unknown[:MAX_UNKNOWN]:
            owner = owners.get(key)
            help = f'move it into "{owner}": {owner}: {{{key}: ...}}' if owner else did_you_mean(key, keys, otherwise)
            word, _, rest = key.partition(" ")
            if self._data[key] is None and not owner:  # what is no key: a colon or brackets are missing
                help = f'write "{word}: {rest}"' if rest and word in keys else "put lists in brackets: [a, b]"
            text = f'has an unknown key "{key}"'
            if self._unknown:
                self._findings.add(self._unknown(text, at=self.at(key), path=self.path, help=help))
            else:
                self.complain(UNKNOWN_KEY, text, key, help=help)
        if len(unknown) > MAX_UNKNOWN:
            self.complain(UNKNOWN_KEY, f"has {len(unknown) - MAX_UNKNOWN} more unknown keys", help=otherwise)

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def __bool__(self) -> bool:
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def at(self, key: str = "") -> Location:
        """Return the place of a key, or of the mapping."""
        return Location(self._file, self._data.line_of(key) if key else self._data.line)

    def complain(self, code: Any, message: str, key: str = "", *, line: int = 0, help: str = "") -> None:
        """Collect a problem of this mapping."""
        at = Location(self._file, line) if line else self.at(key)
        code, help = self._written or (code, help)
        self._findings.add(code(message, at=at, path=self.path, help=help))

    def require(self, *keys: str) -> bool:
        """Return whether all `keys` are there; report those that are not."""
        missing = [key for key in keys if key not in self._data]
        for key in missing:
            self.complain(MISSING_KEY, f'lacks the key "{key}"', help=self.addition.replace("KEY", key))
        return not missing

    def stop_on_errors(self) -> None:
        """Raise `HalpipeError` with everything that was collected, of any mapping, if there are errors."""
        self._findings.stop_on_errors()

    def _lacks(self, key: str) -> bool:
        """Return whether a key is absent; report it where every value has to be present."""
        if self._unknown:
            return self._data.get(key) is None
        return not self.require(key) if self._written else key not in self._data

    def get(self, key: str, read: Callable[[str], T]) -> Stated[T] | None:
        """Return the value of `key` as `read` understands its text; None when absent or wrong."""
        if self._lacks(key):
            return None
        return self._read(self._data[key], key, self._data.line_of(key), read)

    def value(self, key: str, read: Callable[[str], T], default: D) -> T | D:
        """Return the plain value of `key`, `default` when absent or wrong."""
        found = self.get(key, read)
        return default if found is None else found.value

    def required(self, key: str, read: Callable[[str], T]) -> T:
        """Return the value of a key that has to be there; compute nothing from it before `stop_on_errors`."""
        found = self.get(key, read) if self._written or self.require(key) else None
        return cast("T", found and found.value)

    def text(self, key: str) -> str:
        """Return a text as it stands there, an empty one when absent or wrong."""
        return self.value(key, str, "")

    def number(self, key: str, least: int = 0, most: int = MAX_NUMBER) -> int:
        """Return a whole number of a JSON file, which is no text; `least` when absent or wrong."""
        value = self._data.get(key)
        if key in self._data and not isinstance(value, Number):
            bounds = f"a whole number from {least} to {most}"
            self.complain(WRONG_TYPE, f'"{key}" is {_kind(value)}; it must be {bounds}', key, help=f"write {bounds}")
            return least
        return self.value(key, whole(least, most), least)

    def flag(self, key: str) -> Stated[bool] | None:
        """Return a value that is ``true`` or ``false``."""
        if key not in self._data:
            return None
        value = self._data[key]
        if isinstance(value, bool):
            return Stated(value, self.at(key))
        self.complain(
            WRONG_TYPE,
            f'"{key}" is {_kind(value)}; it must be true or false',
            key,
            help="write true or false",
        )
        return None

    def texts(self, key: str, read: Callable[[str], T]) -> tuple[Stated[T], ...]:
        """Return a list of texts; a single text is a list of one."""
        if self._lacks(key):
            return ()
        value = self._data[key]
        if not isinstance(value, YamlList):
            found = self.get(key, read)
            return () if found is None else (found,)
        items = (self._read(item, key, line, read) for item, line in zip(value, value.lines, strict=True))
        return tuple(item for item in items if item is not None)

    def texts_of(self, key: str, read: Callable[[str], T]) -> Stated[tuple[T, ...]] | None:
        """Return a list of at least one text as one value; None when absent or wrong."""
        if key not in self._data:
            return None
        items = self.texts(key, read)
        if not items and self._data[key] == []:
            self.complain(BAD_VALUE, f'"{key}" is an empty list', key, help="list at least one name, or remove the key")
        return Stated(tuple(item.value for item in items), self.at(key)) if items else None

    def section(self, key: str, keys: tuple[str, ...], path: str) -> Fields | None:
        """Return the mapping under `key`; None when absent or wrong."""
        if self._lacks(key):
            return None
        return self._mapping(self._data[key], key, self._data.line_of(key), path, keys)

    def part(self, key: str) -> Fields:
        """Return the mapping under `key` of a JSON file; an empty one when absent or wrong."""
        path = self._path_of(key)
        return self.section(key, (), path) or self._inner(YamlMap(0), path, ())

    def _path_of(self, inner: str) -> str:
        return f"{self.path} {inner}".strip()

    def entries(self, key: str, keys: tuple[str, ...] = (), path: str = "") -> Iterator[tuple[str, Fields, Location]]:
        """Yield (name, mapping, place) for a mapping of mappings; in messages, an entry is called `path` "name"."""
        path = path or self._path_of(key)
        outer = self.section(key, (), self._path_of(key))
        for name in outer or ():
            found = outer.section(name, keys, f'{path} "{name}"') if outer else None
            if outer and found:
                yield name, found, outer.at(name)

    def items(self, key: str, keys: tuple[str, ...] = (), path: str = "") -> Iterator[Fields]:
        """Yield the mappings of a list; without a `path`, they have those of their places in it."""
        if self._lacks(key):
            return
        value = self._data[key]
        if not isinstance(value, YamlList):
            self.complain(WRONG_TYPE, f'"{key}" is {_kind(value)}; it must be a list', key, help="write [...] or - ...")
            return
        for place, (item, line) in enumerate(zip(value, value.lines, strict=True)):
            found = self._mapping(item, key, line, path or self._path_of(f"{key}[{place}]"), keys)
            if found is not None:
                yield found

    def _mapping(self, value: Any, key: str, line: int, path: str, keys: tuple[str, ...]) -> Fields | None:
        if isinstance(value, YamlMap):
            return self._inner(value, path, keys)
        may = f"with the keys {', '.join(keys)}" if keys else "of names"
        self.complain(
            WRONG_TYPE,
            f'"{key}" is {_kind(value)}; it must be a mapping {may}',
            line=line,
            help="write {...}",
        )
        return None

    def _inner(self, data: YamlMap, path: str, keys: tuple[str, ...]) -> Fields:
        return Fields(self._file, self._findings, data, path, keys, written=self._written, unknown=self._unknown)

    def _read(self, value: Any, key: str, line: int, read: Callable[[str], T]) -> Stated[T] | None:
        if not isinstance(value, str):
            help = "write a single value"
            if isinstance(value, bool):
                try:
                    read(word := str(value).lower())
                    help = f'quote it: "{word}"'
                except ValueError as failure:
                    help = str(failure).partition("; ")[2] or help
            self.complain(WRONG_TYPE, f'"{key}" is {_kind(value)}; it must be a text', line=line, help=help)
            return None
        found = self.checked(key, lambda: read(value), None, line=line)
        return None if found is None else Stated(found, Location(self._file, line))

    def checked(self, key: str, read: Callable[[], T], default: D, *, line: int = 0) -> T | D:
        """Return what `read` makes of `key`; report its ``ValueError`` and return the default."""
        try:
            return read()
        except ValueError as failure:
            message, _, help = str(failure).partition("; ")
            message = str(failure) if self._written else message
            self.complain(BAD_VALUE, f'"{key}": {message}', key, line=line, help=help or "correct the value")
            return default


def _kind(value: Any) -> str:
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, YamlMap):
        return "a mapping"
    if isinstance(value, Number):
        return quoted(value)
    return "a list" if isinstance(value, YamlList) else f"the text {quoted(value)}"
