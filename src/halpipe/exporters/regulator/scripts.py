"""Register scripts: writes and checked reads, one macro call a line, for the loader and for inclusion in C."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.exporters.regulator.writing import comment

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.exporters.regulator.tables import Tables

START = -1
ALL = 0xFFFFFFFF


@record
class Write:
    """A register write; `at` is the window or the nanosecond of it, `START` before the table begins."""

    at: int
    offset: int
    value: int

    def __str__(self) -> str:
        return f"WRITE({self.at}, {self.offset:#05x}, {self.value:#010x})"


@record
class Check:
    """A register that is read: its bits in `mask` are from `least` to `most`."""

    offset: int
    mask: int
    least: int
    most: int

    def __str__(self) -> str:
        return f"READ({self.offset:#05x}, {self.mask:#010x}, {self.least:#010x}, {self.most:#010x})"


def script(tables: Tables, digest: str, title: str, meaning: str, steps: Iterable[Write | Check]) -> bytes:
    """Return a script; its comments state what it is for."""
    origin = f"model {comment(tables.model)}, platform {comment(tables.platform.name)}; schedule {digest}"
    return "\n".join([f"// {comment(title)}, {origin}", f"// {meaning}", *map(str, steps), ""]).encode()
