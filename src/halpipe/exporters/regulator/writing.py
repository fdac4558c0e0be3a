"""Writing for a device: the export, protocol and choice of writers, names, templates, and scripts of registers."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from importlib import import_module, resources
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Diagnostic, HalpipeError, printable, sort_diagnostics
from halpipe.core.files import sha256
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.devices import DEVICES, Device
from halpipe.exporters.common.templates import environment
from halpipe.exporters.native import paired
from halpipe.exporters.regulator.codes import NOT_A_PLATFORM, UNKNOWN_BACKEND
from halpipe.exporters.regulator.frames import MODE
from halpipe.exporters.regulator.platform import Platform, read_platform
from halpipe.exporters.regulator.report import check_phases, describe_export, describe_tables, format_json, summarise
from halpipe.exporters.regulator.tables import Table, TableBuilder, Tables

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import jinja2

    from halpipe.exporters.regulator import RegulatorOptions
    from halpipe.models import Schedule, TaskModel

K = TypeVar("K")


class Backend(Protocol):
    """Writer for a kind of regulator. It decides nothing about budgets: it checks, reports and writes."""

    device: Device

    @property
    def name(self) -> str:
        """The name of the device."""

    def overshoot(self, platform: Platform) -> int:
        """Return the bytes that are known to pass above a budget, per window and direction."""
        return 0

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return everything about `tables` that this kind of regulator cannot do, or not well."""

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return what the report says of this back-end, as JSON values."""

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return the files by name, which go into a folder of the back-end; `digest` is the schedule's hash."""


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
    found = environment(resources.files(__package__))
    found.filters["comment"] = comment
    return found


def backend(name: str) -> Backend:
    """Return the back-end called `name`; raise `HalpipeError` if there is none."""
    if name not in DEVICES:
        help = did_you_mean(name, DEVICES, "the back-ends are " + ", ".join(DEVICES))
        raise HalpipeError(UNKNOWN_BACKEND(f'there is no back-end "{name}"', help=help))
    module = import_module(f"{__package__}.{DEVICES[name].folder}.writer")
    return cast("Backend", module.WRITER)


def export_tables(model: TaskModel, schedule: Schedule, options: RegulatorOptions) -> dict[str, bytes]:
    """Return the bundle; raise `HalpipeError` with every finding if one of them is an error."""
    if not options.platform:
        help = "name its YAML file, with --platform or as platform: in a pipeline"
        raise HalpipeError(NOT_A_PLATFORM("the export needs the platform of the regulators", help=help))
    if options.mode:  # the bundle is about this mode alone
        model = replace(model, modes=(model.mode(options.mode),), transitions=())
    platform = read_platform(options.platform)
    writer = backend(options.backend or platform.backend)
    builder = TableBuilder(model, schedule, platform, writer)
    findings = builder.findings
    tables = builder.build(options.rounding)
    findings.extend(writer.check(tables))
    findings.extend(check_phases(model, tables))
    findings.stop_on_errors()
    found = sort_diagnostics(findings.items)
    pair = paired(model, schedule)
    digest = sha256(pair["schedule.xml"])
    written = writer.write(tables, digest)
    files = {
        **pair,
        "platform.yaml": platform.source,
        "tables.json": format_json(describe_tables(tables, digest, sha256(pair["model.xml"]))),
        "report.json": format_json(describe_export(tables, writer, found, digest)),
        "report.txt": summarise(tables, writer, digest).encode(),
        **{f"{writer.name}/{name}": content for name, content in written.items()},
    }
    facts = {"backend": writer.name, "platform": platform.name, "model": model.name}
    return seal("regulator", files, facts)


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
