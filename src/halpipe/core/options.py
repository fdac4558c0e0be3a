"""Options, each stated once: command line, pipeline key, Python keyword, editor schema and reference derive from it.

A format or verb states each option beside its default, as a field of its options:

    @record(kw_only=True)
    class BtfOptions(ExportOptions):
        cycles: int = option(2, "Hyperperiods of a mode before the next switch.", whole(1, 1000), metavar="N")

A field without `option` is none: callers set it, users cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, fields
from enum import Enum
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_rational, quoted, whole
from halpipe.core.records import record
from halpipe.core.settings import BAD_VALUE, Fields
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    Reader = Callable[[str], Any]

K = TypeVar("K")
Values = dict[str, Any]
"""Values of options by the names of their fields."""

_OPTION = "option"

EMPTY = "the text is empty; give a value, or omit the option"
"""Refusal of a text as a variable of a shell leaves it: the option would count as not stated."""

NONE = "none"
"""The empty list, where that is not the default."""

WITHOUT_EFFECT = error(
    "HAL0025",
    "Option has no effect beside the others",
    "The option is one of the format or verb, but what the other options ask for does not use it. It is refused, "
    "because its value would silently be ignored.",
)


class Form(Enum):
    """Form of a value: a text; a switch; names with a text each (``a=1,b=2``, or a mapping); texts in a list."""

    TEXT = "text"
    SWITCH = "switch"
    NAMES = "names"
    LIST = "list"


@record(kw_only=True)
class Option:
    """One option: `name` is its key in a pipeline file, and ``--name`` on the command line.

    - `read` turns a text into the value and raises ``ValueError("what is wrong; what to do")``; with `words`, these
      are the texts that it takes.
    - `is_path` returns whether a text names a file or folder: those of a pipeline file are relative to it.
    - `takes` are types that Python callers may give instead of a text.
    - `otherwise` describes the default where its value does not; `completes` names what a shell completes.
    - A list that `splits` may be stated as one text with commas, and has nothing twice. Where its default is not the
      empty list, the word `none` is.
    """

    attribute: str
    name: str
    default: Any
    read: Reader
    help: str
    metavar: str
    form: Form
    is_path: Callable[[str], bool]
    required: bool
    takes: tuple[type, ...]
    otherwise: str
    completes: str
    splits: bool

    @property
    def keywords(self) -> tuple[str, ...]:
        """The keywords of Python: the name; of a list the plural, too, which comes first."""
        name = self.name.replace("-", "_")
        return (self.attribute, name) if self.form is Form.LIST and self.attribute != name else (name,)

    @property
    def words(self) -> tuple[str, ...]:
        """The texts that may be given, where these are known."""
        return (*getattr(self.read, "words", ()), *((NONE,) if self.splits and self.default is None else ()))

    @property
    def shown_default(self) -> str:
        """The default as users read it; empty where nothing stands for it."""
        if self.otherwise or self.default is False or self.default in (None, "", ()):
            return self.otherwise
        return "true" if self.default is True else str(self.default)

    def from_text(self, given: Any) -> Any:
        """Read what stands on the command line: a text, a list of texts, or a switch."""
        if self.form is Form.SWITCH:
            return given
        if given is None:
            return self.default
        if isinstance(given, str) and not given.strip():
            raise ValueError(EMPTY)
        if self.form is Form.LIST:
            return self.from_items([given] if isinstance(given, str) else list(given))
        return _names(given, self.read) if self.form is Form.NAMES else self.read(given)

    def from_items(self, texts: Iterable[str]) -> tuple[Any, ...]:
        """Read the items of a list."""
        if not self.splits:
            return tuple(map(self.read, texts))
        items = [item.strip() for text in texts for item in text.split(",")]
        if "" in items:
            raise ValueError(EMPTY)
        if items == [NONE] and self.default is None:
            return ()
        for place, item in enumerate(items):
            if item in items[:place]:
                raise ValueError(f"{quoted(item)} is named twice; name it once")
        return tuple(map(self.read, items))

    def from_value(self, given: Any) -> Any:
        """Read what a Python caller gives: a value of the type, or a text or number that stands for it."""
        if given is None or isinstance(given, self.takes):
            return self.default if given is None else given
        if (
            self.form is Form.TEXT
            and self.is_path("a")
            and not (isinstance(given, str) or hasattr(given, "__fspath__"))
        ):
            raise ValueError(f"{quoted(str(given))} is no file name but a {type(given).__name__}; give a text")
        if self.form is Form.SWITCH:
            if not isinstance(given, bool):
                raise ValueError(f"{given!r} is no switch; give True or False")
            return given
        if self.form is Form.NAMES and isinstance(given, Mapping):
            return {str(name): self.read(_text(value)) for name, value in given.items()}
        if self.form is Form.LIST and isinstance(given, Iterable) and not isinstance(given, str | bytes):
            return self.from_items(map(_text, given))
        return self.from_text(_text(given))


def _text(value: Any) -> str:
    """Return the text that stands for a value; an enumeration, a duration and a number print as they are read."""
    if isinstance(value, bool | bytes | Mapping) or (isinstance(value, Iterable) and not isinstance(value, str)):
        raise ValueError(f"{quoted(str(value))} is a {type(value).__name__}; give a text or a number")
    return str(value.__fspath__() if hasattr(value, "__fspath__") else value)


def option(
    default: Any,
    help: str,
    read: Reader = str,
    *,
    name: str = "",
    metavar: str = "",
    form: Form = Form.TEXT,
    is_path: Callable[[str], bool] | bool = False,
    required: bool = False,
    takes: tuple[type, ...] = (),
    otherwise: str = "",
    completes: str = "",
    splits: bool = False,
    compare: bool = True,
) -> Any:
    """Return a field that users may choose; see `Option`."""
    names_file = is_path if callable(is_path) else lambda text: bool(text) and bool(is_path)
    read = one_line if read is str and is_path is not True else read
    stated: dict[str, Any] = {"read": read, "help": help, "metavar": metavar, "form": form, "is_path": names_file}
    stated |= {"required": required, "takes": takes, "otherwise": otherwise, "completes": completes, "splits": splits}
    return field(default=default, compare=compare, metadata={_OPTION: stated | {"name": name}})


def options_of(kind: type) -> tuple[Option, ...]:
    """Return the options of a type, in the order of its fields."""
    found = []
    for one in fields(kind):
        if _OPTION in one.metadata:
            stated = dict(one.metadata[_OPTION])
            name = stated.pop("name") or one.name.replace("_", "-")
            found.append(Option(attribute=one.name, name=name, default=one.default, **stated))
    return tuple(found)


def names_of(kind: type) -> tuple[str, ...]:
    """Return the names of the options of a type, which are the keys that a pipeline file may have."""
    return tuple(each.name for each in options_of(kind))


def specific(kind: type[K], options: Any) -> K:
    """Return `options` as those of one format, with its defaults where only the common ones are given."""
    if isinstance(options, kind):
        return options
    return kind(**{one.name: getattr(options, one.name) for one in fields(options) if one.init})


def refuse_unused(options: Any, where: str, idle: Iterable[str] | None = None) -> None:
    """Raise `HalpipeError` for options that are stated, but have no effect: those of `idle`, else beside the others."""
    idle = set(options.unused() if idle is None else idle)
    stated = [each.name for each in options_of(type(options)) if each.attribute in idle and _is_stated(each, options)]
    if stated:
        findings = (WITHOUT_EFFECT(f'{where}: "{name}" has no effect here', help="omit it") for name in stated)
        raise HalpipeError(*findings, exit=Exit.USAGE)


def _is_stated(each: Option, options: Any) -> bool:
    return bool(getattr(options, each.attribute) != each.default)


# ------------------------------------------------------------------------------------------------ three doors


class OptionError(ValueError):
    """A text that an option on the command line cannot have."""

    def __init__(self, option: Option, message: str) -> None:
        super().__init__(message)
        self.option = option


def from_command(kind: type, given: Mapping[str, Any]) -> Values:
    """Return the values of options as the command line states them; raise `OptionError`."""
    values = {}
    for each in options_of(kind):
        try:
            values[each.attribute] = each.from_text(given[each.attribute])
        except ValueError as failure:
            raise OptionError(each, str(failure)) from None
    return values


def from_fields(kind: type, stated: Fields, base: str) -> Values:
    """Return the values that a settings file states; paths in it are relative to the folder `base`."""
    stated.require(*(each.name for each in options_of(kind) if each.required))
    return {each.attribute: _from_field(each, stated, base) for each in options_of(kind)}


def _from_field(each: Option, stated: Fields, base: str) -> Any:
    def read(text: str) -> Any:
        return each.read(str(PurePath(base, text)) if each.is_path(text) else text)

    if each.form is Form.SWITCH:
        switch = stated.flag(each.name)
        return each.default if switch is None else switch.value
    if each.form is Form.NAMES:
        section = stated.section(each.name, (), f"{stated.path} {each.name}")
        if section is None:
            return each.default
        found = {name: section.get(name, each.read) for name in section}
        return {name: value.value for name, value in found.items() if value is not None}
    if each.form is Form.LIST:
        texts = stated.texts_of(each.name, str if each.splits else read)
        if texts is None or not each.splits:
            return each.default if texts is None else texts.value
        return stated.checked(each.name, lambda: each.from_items(texts.value), each.default)
    return stated.value(each.name, lambda text: read(text) if text.strip() else each.from_text(text), each.default)


def from_keywords(function: str, kind: type, given: Mapping[str, Any]) -> Values:
    """Return the values that a Python caller gives; raise ``TypeError`` for an unknown one, as Python does."""
    known = {name: each for each in options_of(kind) for name in each.keywords}
    for name in given:
        if name in known and any(other in given for other in known[name].keywords if other != name):
            raise TypeError(f"{function}() got {' and '.join(known[name].keywords)}; give one")
        if name not in known:
            hint = did_you_mean(name, sorted(known), "there are: " + ", ".join(sorted(known)))
            raise TypeError(f"{function}() has no option {name!r}; {hint}")
    for each in options_of(kind):
        if each.required and not any(name in given for name in each.keywords):
            raise TypeError(f"{function}() requires the option {each.keywords[0]!r}")
    values, wrong = {}, []
    for name, value in given.items():
        try:
            values[known[name].attribute] = known[name].from_value(value)
        except ValueError as failure:
            message, _, help = str(failure).partition("; ")
            wrong.append(BAD_VALUE(f"{function}(), {name}: {message}", help=help))
    if wrong:
        raise HalpipeError(*wrong, exit=Exit.USAGE)
    return values


def _names(text: str, read: Reader) -> dict[str, Any]:
    """Read ``core1=2,core2=3``."""
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, sign, value = (word.strip() for word in part.strip().rpartition("="))
        if not sign or not name:
            raise ValueError(f"{quoted(part)} is no name with its value; write core1=2,core2=3")
        if name in found:
            raise ValueError(f"{quoted(name)} is named twice; name it once")
        found[name] = read(value)
    return found


# ------------------------------------------------------------------------------------------- shared statements

SOURCES = "Source files are relative to it; otherwise to the model file."
DRIVERS = "Drivers of sensors and actuators, YAML: called in the phases of their buffers."
CPUS = "Linux CPU of each unit; otherwise in the model's order."

cpu_number = whole(0, 9999, "CPU")
"""Read the number of a CPU, as in /proc/cpuinfo."""


# ------------------------------------------------------------------------------------------- single values


def file_name(text: str) -> str:
    """Read the name of a file or folder."""
    if not text:
        raise ValueError("the file name is empty; name a file")
    return text


def one_line(text: str) -> str:
    """Read a text that is written into files as it is: control characters would be part of their form."""
    if any(ord(sign) < ord(" ") or ord(sign) == 127 for sign in text):
        raise ValueError(f"{quoted(text)} has control characters; write it in one line")
    return text


def positive_duration(text: str) -> Duration:
    """Read a duration above zero."""
    found = Duration.parse(text)
    if not found:
        raise ValueError(f"{quoted(text)} must be longer than 0; write a duration above zero, or omit it")
    return found


def time_limit_of(text: str) -> Duration | None:
    """Read a time after which something ends: a duration, or a number of seconds; 0 is none."""
    try:
        limit = Duration(parse_rational(text) * 10**9)
    except ValueError:
        limit = Duration.parse(text)
    return limit or None
