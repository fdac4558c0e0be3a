"""The registry of formats, and what is done with them: import, export, and bundles that are checked.

    sources --import--> model --schedule--> schedule --export--> files

The one place where formats and pipeline meet. Nothing is exported that does not verify.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Exit, Findings, HalpipeError, Location, Severity, about, error, warning
from halpipe.core.files import beginning_of
from halpipe.core.options import options_of, refuse_unused, specific
from halpipe.core.records import record
from halpipe.core.suggest import counted, did_you_mean
from halpipe.pipeline.checked import refuse_invalid, validate_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.base import Checked, CheckOptions, Deployment, Target
    from halpipe.exporters.common.base import Exporter, ExportOptions
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.exporters.riscv.prepare import Prepared
    from halpipe.importers.common.base import Imported, Importer, ImportOptions
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.solve.quantise import BurstGrid

UNKNOWN_FORMAT = error(
    "HAL0901", "Unknown format", "No importer or exporter, or no check of bundles, of that name is installed."
)
OWN_SOURCE = error(
    "HAL1471",
    "Source of an import is a file of halpipe",
    "The file is a task model or a schedule already, so there is nothing to import. Importers read the files of other "
    "tools.",
)
LOST_UNDER_STRICT = error(
    "HAL0902",
    "Loss under --strict",
    "With --strict, whatever an importer would only warn about stops the import.",
)
UNSCHEDULABLE_YET = warning(
    "HAL0905",
    "Imported model cannot be scheduled yet",
    "The model was written, but validation finds errors in it; most often WCETs are missing, which no source "
    "format states. Correct the source, or give them in an overlay.",
)
IMPORTERS = "halpipe.importers"
_HEAD = 4096
_OWN = re.compile(rb"xmlns=[\"']urn:halpipe:(task-model|schedule):")
EXPORTERS = "halpipe.exporters"
DEPLOYMENTS = "halpipe.deployments"


def formats(group: str) -> list[str]:
    """Return the names of the installed importers, exporters or kinds of bundles, in order."""
    return sorted(_installed(group))


@cache
def _installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, which takes reading what each installed package says of itself."""
    return {point.name: point for point in entry_points(group=group)}


def registered(group: str, name: str) -> object:
    """Return what is installed under a name in a group of entry points; raise `HalpipeError` if nothing is."""
    points = _installed(group)
    if name not in points:
        known = sorted(points)
        installed = "installed: " + ", ".join(known)
        help = (
            f"the format comes before the files; {installed}" if "." in name else did_you_mean(name, known, installed)
        )
        text = f'no {group.removeprefix("halpipe.")[:-1]} "{name}"'
        raise HalpipeError(UNKNOWN_FORMAT(text, help=help), exit=Exit.USAGE)
    return points[name].load()


def importer(name: str) -> Importer:
    """Return the importer called `name`."""
    return registered(IMPORTERS, name)  # type: ignore[return-value]


def exporter(name: str) -> Exporter:
    """Return the exporter called `name`."""
    return registered(EXPORTERS, name)  # type: ignore[return-value]


def deployment(name: str) -> Deployment:
    """Return the check of the kind of bundles called `name`."""
    return registered(DEPLOYMENTS, name)  # type: ignore[return-value]


def import_model(format: str, paths: Sequence[str], options: ImportOptions) -> Imported:
    """Read sources, apply the overlays, and report what keeps the model from being scheduled."""
    from halpipe.importers.overlay import OverlayUse, read_overlays

    reader = importer(format)
    refuse_unused(options, f"import {format}")
    _refuse_own(paths)
    overlay = OverlayUse(read_overlays(options.overlays))
    imported = reader.read(paths, replace(options, overlay=overlay))
    model, changes = overlay.apply(imported.model, imported.coverage)
    imported = replace(imported, model=model, diagnostics=(*imported.diagnostics, *changes)).completed()
    model, findings = imported.model, Findings(list(imported.diagnostics))
    if options.strict:
        _refuse_losses(findings)
    findings.stop_on_errors()
    findings.extend(_readiness(model))
    return replace(imported, diagnostics=tuple(findings.items))


def _refuse_own(paths: Sequence[str]) -> None:
    for path in paths:
        if path.endswith(".xml") and (found := _OWN.search(beginning_of(path)[:_HEAD])):
            kind = found[1].decode().replace("-", " ")
            verb = "schedule" if kind == "task model" else "verify"
            help = f"give it to `halpipe {verb}`; `halpipe export` writes it in other formats"
            raise HalpipeError(OWN_SOURCE(f"is a {kind} of halpipe", at=Location(path, 1), help=help))


def _refuse_losses(findings: Findings) -> None:
    lost = [d for d in findings.items if d.severity is not Severity.NOTE]
    if lost:
        strict = LOST_UNDER_STRICT(f"errors under --strict: {counted(len(lost), 'finding')}")
        raise HalpipeError(*findings.items, strict, exit=Exit.UNSUPPORTED)


def _readiness(model: TaskModel) -> list[Diagnostic]:
    errors = [d for d in validate_model(model) if d.is_error]
    if not errors:
        return []
    ((most, count),) = Counter(found.code for found in errors).most_common(1)
    first = next(found.message for found in errors if found.code == most)
    others = f", and {counted(len(errors) - count, 'other finding')}" if len(errors) > count else ""
    return [
        UNSCHEDULABLE_YET(
            f"it cannot be scheduled yet: {counted(count, 'time')}: {first}{others}",
            path=about(model=model.name),
            help="correct the source, or complete it with --overlay; `halpipe validate` lists every finding",
        )
    ]


def burst_grid(platform_file: str) -> BurstGrid:
    """Return the grid of a regulator platform, for `SearchOptions`."""
    from halpipe.exporters.regulator.platform import WRITE, read_platform
    from halpipe.exporters.regulator.tables import reserve_of
    from halpipe.exporters.regulator.writing import backend
    from halpipe.pipeline.solve.quantise import BurstGrid

    platform = read_platform(platform_file)
    writer = backend(platform.backend)
    return BurstGrid(
        name=platform.name,
        window=platform.window,
        cycle=platform.cycle,
        resource=platform.resource,
        promise=platform.promise,
        capacity=platform.window_capacity,
        burst=platform.burst,
        reserve=reserve_of(platform, writer),
        reserves=writer.device.reserves,
        regulated=tuple(sorted(platform.units)),
        carries=writer.device.carries,
        writes=platform.unspecified == WRITE,
    )


def export(format: str, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
    """Verify, then write; return the contents by relative file name, the main output as ``""``."""
    return export_with_remarks(format, model, schedule, options).contents


@record
class Exported:
    """The contents by relative file name, the main output as ``""``, and what the user should know of them.

    `changes` names the file that lists what is changed in files of a project (empty: none), `summary` has it in words.
    """

    contents: dict[str, bytes]
    remarks: tuple[Diagnostic, ...]
    changes: str = ""
    summary: tuple[str, ...] = ()


def export_with_remarks(format: str, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> Exported:
    """Verify, then write; see `halpipe.exporters.common.base.Exporter`."""
    writer = exporter(format)
    options = specific(writer.options, options)
    refuse_unused(options, f"export {format}")
    if schedule is not None:
        refuse_invalid(model, schedule)
    if getattr(options, "onto", ""):
        return _put_onto(model, schedule, options)
    if schedule is not None and getattr(options, "wait", None):
        _refuse_late_starts(model, schedule, options)
    if getattr(options, "graphs", ()):
        from halpipe.importers.ros.traced import callbacks_of

        options = replace(options, bindings=callbacks_of(options.graphs))  # type: ignore[call-arg, attr-defined]
    seen: tuple[Diagnostic, ...] = ()
    if schedule is not None and any(getattr(options, name, None) for name in ("trace", "against")):
        from halpipe.flow.beside import with_beside

        options, seen = with_beside(model, schedule, options)  # type: ignore[arg-type]
    contents = writer.write(model, schedule, options)
    return Exported(contents, (*seen, *writer.remarks(model, schedule, options, contents)))


ALSO = {".dot": (".gv", ".svg"), ".html": (".htm",), ".yaml": (".yml",), ".arxml": (".xml",), ".amxmi": (".xml",)}
"""Further endings of what a format writes; DOT is drawn where SVG is asked for."""


def endings_of(format: str, options: ExportOptions) -> tuple[str, ...]:
    """Return how the name of an export may end; nothing for a folder."""
    suffix = exporter(format).suffix
    if not suffix or any(getattr(options, folder, None) for folder in ("onto", "package")):
        return ()
    return (suffix, *ALSO.get(suffix, ()))


def _put_onto(model: TaskModel, schedule: Schedule | None, options: Any) -> Exported:
    """Put a schedule onto the project that its model was imported from."""
    from halpipe.exporters.arxml.onto import CHANGES
    from halpipe.exporters.common.codes import NEEDS_SCHEDULE
    from halpipe.flow.onto import export_onto
    from halpipe.importers.arxml.options import ArxmlImportOptions

    if schedule is None:
        help = "name the file of the schedule after the model"
        raise HalpipeError(NEEDS_SCHEDULE("a project gets a schedule, and none is given", help=help), exit=Exit.USAGE)
    source = ArxmlImportOptions(ecu=options.ecu, variant=options.variant, conditions=options.conditions)
    onto = export_onto(model, schedule, options.onto, source, options.ecuc_definitions)
    lines = []
    for change in onto.summary:
        name = f" {change.name}" if change.name else ""
        value = f"{change.old} -> {change.new or '(nothing)'}" if change.old else f"+ {change.new}"
        lines.append(f"{change.file}: {change.path}{name}: {value}")
    return Exported(onto.files, onto.findings, CHANGES, tuple(lines))


def _refuse_late_starts(model: TaskModel, schedule: Schedule, options: Any) -> None:
    """Stop unless the schedule verifies wherever within its wait each job of a ROS package begins."""
    from halpipe.exporters.common.selection import select
    from halpipe.exporters.ros.codes import LATE_START
    from halpipe.exporters.ros.waits import with_late_starts
    from halpipe.pipeline.verify import verify
    from halpipe.pipeline.verify.codes import WRONG_FIGURE

    late = with_late_starts(model.alone(options.mode) if options.mode else model, options.wait)
    findings = Findings()
    for found in verify(late, select(model, schedule, options.mode, "ros")):
        if found.is_error and found.code != WRONG_FIGURE.id:
            help = "widen the windows and schedule again, or wait shorter"
            findings.add(LATE_START(f"with late starts: {found.message}", at=found.at, path=found.path, help=help))
    findings.stop_on_errors()


def open_target(path: str) -> Target:
    """Open a bundle with the model and the schedule that it carries, which must verify."""
    from halpipe.core.bundles import MODEL, SCHEDULE, open_bundle
    from halpipe.deploy.base import Target
    from halpipe.importers.native import parse_model, parse_schedule

    bundle, findings = open_bundle(path), Findings()
    bundle.fields(findings, deployment(bundle.kind).facts)
    findings.stop_on_errors()
    model = parse_model(bundle.files[MODEL], bundle.at(MODEL).file)
    schedule = parse_schedule(bundle.files[SCHEDULE], bundle.at(SCHEDULE).file)
    refuse_invalid(model, schedule)
    return Target(bundle=bundle, model=model, schedule=schedule)


def prepare_model(model: TaskModel, options: RiscvOptions, *, dummy: bool) -> Prepared:
    """Give a model the memory phases that it needs on a target; it must validate before and after."""
    from halpipe.exporters.riscv.prepare import prepare

    Findings(validate_model(model)).stop_on_errors()
    prepared = prepare(model, options, dummy=dummy)
    findings = Findings([*prepared.diagnostics])
    findings.extend(found for found in validate_model(prepared.model) if found.is_error)
    findings.stop_on_errors()
    return prepared


def check_bundle(path: str, options: CheckOptions) -> Checked:
    """Open a bundle, verify the schedule it carries, play it and compare the run with the schedule."""
    target = open_target(path)
    checker = deployment(target.bundle.kind)
    idle = [each.attribute for each in options_of(type(options)) if each.attribute not in checker.takes]
    refuse_unused(options, f"deploy check of a {target.bundle.kind} bundle", (*idle, *options.unused()))
    if options.seconds and not options.cycles:
        options = replace(options, cycles=_cycles(target.schedule, options.seconds))
    return checker.check(target, options)


def _cycles(schedule: Schedule, seconds: int) -> int:
    """Return how often all modes can be played once in some seconds, at least once."""
    once = sum((mode.hyperperiod.in_unit("s") for mode in schedule.modes), Fraction(0))
    return max(1, int(seconds / once))
