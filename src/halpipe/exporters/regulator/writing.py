"""Writing for a device: protocol of writers, names in C and in file names, order of writes, and templates."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from halpipe.core.diagnostics import printable
from halpipe.exporters.regulator.frames import MODE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import jinja2

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.devices import Device
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

K = TypeVar("K")


class Backend(Protocol):
    """Writer for a kind of regulator. It decides nothing about budgets: it checks, reports and writes."""

    device: Device
    summary: str

    @property
    def name(self) -> str:
        """The name of the device."""
        ...

    def overshoot(self, platform: Platform) -> int:
        """Return the bytes that may pass above a budget, per window and direction."""
        ...

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return everything about `tables` that this kind of regulator cannot do, or not well."""
        ...

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return what the report says of this back-end, as JSON values."""
        ...

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return the files by name, which go into a folder of the back-end; `digest` is the schedule's hash."""
        ...


def predecessors(tables: Tables, table: Table) -> list[Table]:
    """Return the tables after whose end `table` may begin: itself if it repeats, and those that lead to it."""
    modes = {t.frame.source: t.index for t in tables.tables if t.frame.kind == MODE}
    asking = {modes[switch.source] for switch in tables.switches if switch.request == table.index}
    return [t for t in tables.tables if t.successor == table.index or t.index in asking]


def falls_first(before: Sequence[Mapping[K, int]], new: Mapping[K, int]) -> list[tuple[K, int]]:
    """Return the values to write, in an order that is safe whichever of the settings `before` was in force.

    First everything falls to what is in all of them, then it rises: at no instant is the sum above both settings.
    """
    known = {key: [setting[key] for setting in before] for key in new}
    floors = {key: min([value, *known[key]]) for key, value in new.items()}
    falls = [(key, low) for key, low in floors.items() if low == new[key] or any(low < now for now in known[key])]
    return [*falls, *((key, value) for key, value in new.items() if value != floors[key])]


def identifiers(names: Iterable[str]) -> list[str]:
    """Return an identifier in capital letters for each name, unique: ``a->b`` is ``A_TO_B``."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9]", "_", name.replace("->", "_to_")).upper()
        candidate, number = plain, 2
        while candidate in found:
            candidate, number = f"{plain}_{number}", number + 1
        found.append(candidate)
    return found


def file_names(names: Iterable[str]) -> list[str]:
    """Return a file name without suffix for each name, unique, with its number: ``2-race-to-stop``."""
    plain = (re.sub(r"[^A-Za-z0-9_.-]", "_", name.replace("->", "-to-"))[:80] for name in names)
    return [f"{number}-{name}" for number, name in enumerate(plain)]


def comment(text: str) -> str:
    """Return a name as it may stand in a comment of C or of a script."""
    return printable(text).replace("*/", "*_/").replace("/*", "/_*")


def render(template: str, **values: Any) -> bytes:
    """Fill a template, named with the folder of its device."""
    return _environment().get_template(template).render(**values).encode()


@cache
def _environment() -> jinja2.Environment:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_source),
        autoescape=False,  # C and shell; names are checked by the schema and by `comment`
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"comment": comment, "hex": lambda value: f"{value:#010x}"}
    return environment


def _source(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text("utf-8")
