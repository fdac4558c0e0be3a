"""The whole file: the system, and the ECU configuration that plays its schedule."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, about, version_of
from halpipe.core.embedding import package_hash, pieces
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.arxml.codes import BAD_PREFIX, DANGLING_NAME
from halpipe.exporters.arxml.document import NAMESPACE, add, document, named, package, sd, special
from halpipe.exporters.arxml.options import RELEASES
from halpipe.exporters.arxml.osconfig import PACKAGE, OsNames, write_collection, write_cores, write_os, write_rte
from halpipe.exporters.arxml.software import Layout, disabled_modes, write_modes, write_platform, write_software
from halpipe.exporters.arxml.tables import make_plan
from halpipe.exporters.arxml.ticks import Holds, choose_counter
from halpipe.exporters.arxml.timing import write_demands, write_guarantees
from halpipe.exporters.common.codes import NEEDS_SCHEDULE
from halpipe.exporters.common.frozen import serialise
from halpipe.exporters.common.selection import select
from halpipe.exporters.native import format_model
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from lxml import etree

    from halpipe.exporters.arxml.options import ArxmlOptions
    from halpipe.models import Schedule, TaskModel

_PREFIX = re.compile(r"(/[A-Za-z][A-Za-z0-9_]{0,127})+")


def format_arxml(model: TaskModel, schedule: Schedule | None, options: ArxmlOptions) -> bytes:
    """Return the file; raise `HalpipeError` for impossible options, dangling names, and rules of the OS not kept."""
    _check_options(options, has_schedule=schedule is not None)
    if options.mode:
        require_mode(options.mode, model.modes)
        model = model.alone(options.mode)
    _refuse_dangling(model)
    chosen = None if schedule is None else select(model, schedule, options.mode, "arxml")
    layout = Layout(model)
    root = document(f"{NAMESPACE} {RELEASES[options.release]}")
    top = named(add(root, "AR-PACKAGES"), "AR-PACKAGE", layout.root)
    inner = add(top, "AR-PACKAGES")
    if options.part != "ecuc":
        _write_system(inner, model, chosen, layout, options.release)
    if options.part != "system" and chosen is not None:
        _write_ecuc(inner, model, chosen, layout, options)
    if options.part != "ecuc":
        _embed(top, model)
    return serialise(root, layout.texts)


def _embed(top: etree._Element, model: TaskModel) -> None:
    """Append the native model, with the hash of the standard elements, which stand in `top` already."""
    data = special(top, "model")
    sd(data, "hash", package_hash(top))
    for text in pieces(format_model(model)):
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
    names = OsNames(plan, layout)
    elements = package(packages, PACKAGE)
    write_cores(elements, plan, layout, options.ecuc_prefix)
    write_os(elements, plan, names, options.ecuc_prefix, options.release)
    write_rte(elements, model, plan, layout, names, options.ecuc_prefix, options.release)
    write_collection(elements, layout)


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


def _refuse_dangling(model: TaskModel) -> None:
    """Raise `HalpipeError` with every name that the model does not define."""
    findings = Findings()

    def check(kind: str, names: Iterable[str], known: Collection[str], path: str) -> None:
        for name in names:
            if name not in known:
                help = did_you_mean(name, sorted(known), "define it, or remove what names it")
                findings.report(DANGLING_NAME, f'there is no {kind} "{name}"', path=path, help=help)

    units = {unit.name for unit in model.units}
    resources = {resource.name for resource in model.resources}
    versions = {task.name: {version.name for version in task.versions} for task in model.tasks}
    modes = {mode.name for mode in model.modes}
    for task in model.tasks:
        for version in task.versions:
            path = version_of(task.name, version.name)
            check("unit", version.units, units, path)
            check("resource", (access.resource for access in version.accesses), resources, path)
            check("task", (precedence.task for precedence in version.precedences), versions, path)
    for chain in model.chains:
        check("task", chain.tasks, versions, about(chain=chain.name))
    for mode in model.modes:
        for run in mode.runs:
            path = about(mode=mode.name)
            check("task", [run.task], versions, path)
            check("version", run.versions, versions.get(run.task, run.versions), f'{path}, task "{run.task}"')
    for transition in model.transitions:
        path = about(transition_from=(transition.source, transition.target))
        check("mode", (transition.source, transition.target), modes, path)
    for rule in model.health:
        check("task", [rule.task], versions, "health rule")
        check("mode", [rule.mode] if rule.mode else [], modes, "health rule")
    if findings.has_errors:
        raise HalpipeError(*findings.items)
