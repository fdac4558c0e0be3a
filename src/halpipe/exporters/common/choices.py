"""What may be chosen of a format, stated once: the command line and pipeline files are made from it.

A format states each choice beside its default, as a field of its options:

    @record(kw_only=True)
    class BtfOptions(ExportOptions):
        cycles: int = choice(2, "Hyperperiods of a mode before the next switch.", whole(1, 1000), metavar="N")
"""

from __future__ import annotations

from dataclasses import field, fields
from enum import Enum
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.durations import Duration
from halpipe.core.quantities import quoted, whole
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.settings import Fields
    from halpipe.exporters.common.base import ExportOptions

    Reader = Callable[[str], Any]

O = TypeVar("O", bound="ExportOptions")  # noqa: E741

_CHOICE = "choice"


class Form(Enum):
    """How a choice is stated: a text; a switch; or names with a text each, as ``a=1,b=2`` or as a mapping."""

    TEXT = "text"
    SWITCH = "switch"
    NAMES = "names"


@record(kw_only=True)
class Choice:
    """One option: `name` is its key in a pipeline file, and ``--name`` on the command line.

    `read` turns a text into the value and raises ``ValueError("what is wrong; what to do")``. `is_path` tells of a
    text whether it names a file or folder: those of a pipeline file are relative to it.
    """

    attribute: str
    default: Any
    read: Reader
    help: str
    metavar: str
    form: Form
    is_path: Callable[[str], bool]
    required: bool

    @property
    def name(self) -> str:
        """The name that users write."""
        return self.attribute.replace("_", "-")

    def value_of(self, text: str) -> Any:
        """Read the text of the command line; an empty one is the default unless a value is required."""
        if not text and not self.required:
            return self.default
        return _names(text, self.read) if self.form is Form.NAMES else self.read(text)


def choice(
    default: Any,
    help: str,
    read: Reader = str,
    *,
    metavar: str = "",
    form: Form = Form.TEXT,
    is_path: Callable[[str], bool] | bool = False,
    required: bool = False,
) -> Any:
    """Return a field of options that users may choose; see `Choice`."""
    tells = is_path if callable(is_path) else lambda text: bool(text) and bool(is_path)
    stated = {"read": read, "help": help, "metavar": metavar, "form": form, "is_path": tells, "required": required}
    return field(default=default, metadata={_CHOICE: stated})


def choices(kind: type[ExportOptions]) -> Iterator[Choice]:
    """Yield what may be chosen in options of a `kind`, in the order of its fields."""
    for one in fields(kind):
        if _CHOICE in one.metadata:
            yield Choice(attribute=one.name, default=one.default, **one.metadata[_CHOICE])


def keys_of(kind: type[ExportOptions]) -> tuple[str, ...]:
    """Return the keys that a pipeline file may have for a format, besides those of every format."""
    return tuple(each.name for each in choices(kind))


def options_of(kind: type[O], common: ExportOptions, stated: Fields, base: str) -> O:
    """Return the options that a pipeline file states; paths in it are relative to the folder `base`."""
    stated.require(*(each.name for each in choices(kind) if each.required))
    values = {each.attribute: _stated(each, stated, base) for each in choices(kind)}
    return kind(title=common.title, mode=common.mode, **values)


def _stated(each: Choice, stated: Fields, base: str) -> Any:
    if each.form is Form.SWITCH:
        switch = stated.flag(each.name)
        return each.default if switch is None else switch.value
    if each.form is Form.NAMES:
        section = stated.section(each.name, (), f"{stated.path} {each.name}")
        if section is None:
            return each.default
        found = {name: section.get(name, each.read) for name in section}
        return {name: value.value for name, value in found.items() if value is not None}

    def read(text: str) -> Any:
        return each.read(str(PurePath(base, text)) if each.is_path(text) else text)

    return stated.value(each.name, read, each.default)


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


# -------------------------------------------------------------------------------- what several formats offer

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


def positive_duration(text: str) -> Duration:
    """Read a duration above zero."""
    found = Duration.parse(text)
    if not found:
        raise ValueError(f"{quoted(text)} must be longer than 0; write a duration above zero, or leave it out")
    return found
