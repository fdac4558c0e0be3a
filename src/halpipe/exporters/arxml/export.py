"""The whole file: the system, and the ECU configuration that plays its schedule."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.embedding import package_hash, pieces
from halpipe.exporters.arxml.codes import BAD_PREFIX, TOO_LARGE_TO_WRITE
from halpipe.exporters.arxml.definitions import read_definitions
from halpipe.exporters.arxml.document import NAMESPACE, add, document, named, package, sd, special
from halpipe.exporters.arxml.options import RELEASES, ArxmlOptions
from halpipe.exporters.arxml.osconfig import PACKAGE, OsNames, write_collection, write_cores, write_os, write_rte
from halpipe.exporters.arxml.software import Layout, disabled_modes, write_modes, write_platform, write_software
from halpipe.exporters.arxml.tables import make_plan
from halpipe.exporters.arxml.ticks import Holds, choose_counter
from halpipe.exporters.arxml.timing import write_demands, write_guarantees
from halpipe.exporters.common.codes import NEEDS_SCHEDULE
from halpipe.exporters.common.frozen import serialise
from halpipe.exporters.common.names import refuse_dangling
from halpipe.exporters.common.selection import select
from halpipe.exporters.native import format_model
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.models import Schedule, TaskModel

MOST_WRITTEN = 25_000
"""Tasks, and jobs of a schedule: ARXML of more takes beyond 1 GiB or 10 s to write, as each stands in ten places."""

_PREFIX = re.compile(r"(/[A-Za-z][A-Za-z0-9_]{0,127})+")


def format_arxml(model: TaskModel, schedule: Schedule | None, options: ArxmlOptions) -> bytes:
    """Return the file; raise `HalpipeError` for impossible options, dangling names, and rules of the OS not kept."""
    _check_options(options, has_schedule=schedule is not None)
    if options.mode:
        require_mode(options.mode, model.modes)
        model = model.alone(options.mode)
    refuse_dangling(model)
    chosen = None if schedule is None else select(model, schedule, options.mode, "arxml")
    _refuse_too_large(model, chosen)
    native = [] if options.part == "ecuc" else list(pieces(format_model(model)))  # first, while memory is free
    layout = Layout(model)
    root = document(f"{NAMESPACE} {RELEASES[options.release]}")
    top = named(add(root, "AR-PACKAGES"), "AR-PACKAGE", layout.root)
    inner = add(top, "AR-PACKAGES")
    if options.part != "ecuc":
        _write_system(inner, model, chosen, layout, options.release)
    if options.part != "system" and chosen is not None:
        _write_ecuc(inner, model, chosen, layout, options)
    if options.part != "ecuc":
        _embed(top, native)
    return serialise(root, layout.texts)


def _refuse_too_large(model: TaskModel, schedule: Schedule | None) -> None:
    modes, switches = (schedule.modes, schedule.transitions) if schedule else ((), ())
    jobs = sum(len(mode.jobs) for mode in modes) + sum(len(table.jobs) for table in switches)
    if len(model.tasks) + jobs > MOST_WRITTEN:
        text = f"{len(model.tasks)} tasks and {jobs} jobs; together at most {MOST_WRITTEN} are written"
        help = "export a mode alone with --mode, or the model without its schedule" if jobs else "divide the model"
        raise HalpipeError(TOO_LARGE_TO_WRITE(text, at=model.at, path="model", help=help))


def _embed(top: etree._Element, native: list[str]) -> None:
    """Append the native model in pieces, with the hash of the standard elements, which stand in `top` already."""
    data = special(top, "model")
    sd(data, "hash", package_hash(top))
    for text in native:
        sd(data, "xml", text)
    top.insert(1, data.getparent().getparent())  # behind the short name


def _write_system(
    packages: etree._Element, model: TaskModel, schedule: Schedule | None, layout: Layout, release: str
) -> None:
    write_platform(packages, model, layout)
    write_modes(packages, model, layout, release)
    write_software(packages, model, layout, release, disabled_modes(model))
    elements, known = write_demands(packages, model, layout)
    if schedule is not None:
        write_guarantees(elements, model, schedule, known)


def _write_ecuc(
    packages: etree._Element, model: TaskModel, schedule: Schedule, layout: Layout, options: ArxmlOptions
) -> None:
    holds = Holds(model, schedule)
    plan = make_plan(model, schedule, layout, holds, choose_counter(schedule, options, holds), options.max_points)
    definitions = read_definitions(options.ecuc_definitions)
    findings = Findings()
    names = OsNames(plan, layout, options.ecuc_prefix, definitions, findings)
    elements = package(packages, PACKAGE)
    write_cores(elements, plan, names)
    write_os(elements, plan, names, options.release)
    write_rte(elements, model, plan, names, options.release)
    write_collection(elements, layout)
    findings.stop_on_errors()


# ------------------------------------------------------------------------------------------------------ checks


def _check_options(options: ArxmlOptions, *, has_schedule: bool) -> None:
    findings = Findings()
    if not _PREFIX.fullmatch(options.ecuc_prefix):
        help = "write a path of short names, such as /AUTOSAR/EcucDefs"
        findings.report(BAD_PREFIX, f'"{options.ecuc_prefix}" is no path of a package', help=help)
    if options.part == "ecuc" and not has_schedule:
        help = "run `halpipe schedule` and give its output with the model"
        findings.report(NEEDS_SCHEDULE, 'part "ecuc" of format "arxml" needs a schedule', help=help)
    findings.stop_on_errors()
