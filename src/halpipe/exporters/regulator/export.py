"""The export as a whole: platform, tables, checks, back-end, report and picture, sealed as one bundle."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError, sort_diagnostics
from halpipe.core.files import sha256
from halpipe.exporters.native import paired
from halpipe.exporters.regulator.codes import NOT_A_PLATFORM
from halpipe.exporters.regulator.phases import check_phases
from halpipe.exporters.regulator.picture import draw
from halpipe.exporters.regulator.platform import read_platform
from halpipe.exporters.regulator.report import describe_export, describe_tables, format_json, summarise
from halpipe.exporters.regulator.tables import TableBuilder
from halpipe.exporters.regulator.writers import backend

if TYPE_CHECKING:
    from halpipe.exporters.regulator import RegulatorOptions
    from halpipe.models import Schedule, TaskModel


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
        "bandwidth.svg": draw(tables).encode(),
        **{f"{writer.name}/{name}": content for name, content in written.items()},
    }
    facts = {"backend": writer.name, "platform": platform.name, "model": model.name}
    return seal("regulator", files, facts)
