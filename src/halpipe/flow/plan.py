"""The pipeline file of ``halpipe run``: sources, overlay, stages and exports of one system, in YAML.

Paths in it are relative to the file itself, so that a pipeline means the same from wherever it is run.
"""

from __future__ import annotations

from dataclasses import field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, error, sort_diagnostics
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap, parse_yaml, read_bytes
from halpipe.core.quantities import parse_share, whole
from halpipe.core.records import record
from halpipe.core.settings import Fields
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.common.choices import keys_of, options_of
from halpipe.flow.formats import UNKNOWN_FORMAT, burst_grid, exporter, importer
from halpipe.importers.common.base import PIECES, RESOURCES, ImportOptions, group_rule, quantile_of
from halpipe.pipeline.solve.schedule import SearchOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.pipeline.solve.quantise import BurstGrid

NOT_A_PIPELINE = error(
    "HAL0906",
    "File is no pipeline",
    'A pipeline is a YAML mapping with the key "halpipe-pipeline: 1", the version of the format.',
)

VERSION = "1"
_TOP = ("halpipe-pipeline", "import", "model", "schedule", "exports")
_IMPORT = (
    *("format", "inputs", "overlay", "name", "granularity", "ecu", "variant", "conditions"),
    *("wcet", "memory", "mapping", "pieces"),
    *("calibrate", "quantile", "margin", "groups", "strict"),
)
_SCHEDULE = ("output", "seed", "budget", "tick", "quantise")
_EXPORT = ("format", "output", "mode", "title")
BESIDES = {"arxml": ("onto",)}
"""Keys of an export besides the options of its format."""


@record
class ImportStep:
    """What to read; see `halpipe.flow.formats.import_model`."""

    format: str
    inputs: tuple[str, ...]
    overlays: tuple[str, ...]
    options: ImportOptions


@record
class ExportStep:
    """What to write from the verified schedule; with `onto`, onto the project that was imported with `source`."""

    format: str
    output: str
    options: ExportOptions
    onto: str = ""
    source: ImportOptions = field(default_factory=ImportOptions)


@record
class Plan:
    """A pipeline file: without `imports`, the model file is the source."""

    imports: ImportStep | None
    model: str
    search: SearchOptions
    schedule: str
    exports: tuple[ExportStep, ...]


def read_plan(path: str) -> Plan:
    """Read a pipeline file; raise `HalpipeError` with everything wrong in it."""
    document = parse_yaml(read_bytes(path), path)
    if not isinstance(document, YamlMap) or document.get("halpipe-pipeline") != VERSION:
        help = 'begin it with "halpipe-pipeline: 1"'
        raise HalpipeError(NOT_A_PIPELINE("is no pipeline of version 1", at=Location(path, 1), help=help))
    findings = Findings()
    plan = _Reader(Path(path).parent, findings).plan(Fields(path, findings, document, "pipeline", _TOP))
    if findings.has_errors:
        raise HalpipeError(*sort_diagnostics(findings.items))
    return plan


class _Reader:
    """Reads the sections; `base` is the folder that paths are relative to."""

    def __init__(self, base: Path, findings: Findings) -> None:
        self._base = base
        self._findings = findings

    def plan(self, top: Fields) -> Plan:
        top.require("model", "schedule")
        imports = top.section("import", _IMPORT, "import")
        schedule = top.section("schedule", _SCHEDULE, "schedule")
        if schedule is not None:
            schedule.require("output")
        source = None if imports is None else self._import(imports)
        used = ImportOptions() if source is None else source.options
        return Plan(
            imports=source,
            model=top.value("model", self._path, ""),
            search=SearchOptions() if schedule is None else self._search(schedule),
            schedule="" if schedule is None else schedule.value("output", self._path, ""),
            exports=tuple(self._export(f, used) for f in top.items("exports", (), "export")),
        )

    def _path(self, text: str) -> str:
        if not text:
            raise ValueError("the file name is empty; name a file")
        return str(self._base / text)

    def _import(self, f: Fields) -> ImportStep:
        f.require("format", "inputs")
        strict = f.flag("strict")
        options = ImportOptions(
            name=f.value("name", str, ""),
            granularity=f.value("granularity", str, "runnable"),
            ecu=f.value("ecu", str, ""),
            variant=f.value("variant", str, ""),
            conditions=tuple(stated.value for stated in f.texts("conditions", str)),
            wcet=f.value("wcet", str, "upper"),
            memory=f.value("memory", str, "within"),
            mapping=f.value("mapping", str, "stated"),
            pieces=f.value("pieces", Duration.parse, PIECES),
            calibrate=tuple(stated.value for stated in f.texts("calibrate", self._path)),
            quantile=f.value("quantile", quantile_of, Fraction(1)),
            margin=f.value("margin", parse_share, Fraction(0)),
            groups=f.value("groups", group_rule, RESOURCES),
            strict=strict is not None and strict.value,
        )
        inputs = tuple(stated.value for stated in f.texts("inputs", self._path))
        overlays = tuple(stated.value for stated in f.texts("overlay", self._path))
        return ImportStep(self._format(f, importer), inputs, overlays, options)

    def _format(self, f: Fields, find: Callable[[str], object]) -> str:
        """Read the name of a format that is installed."""
        name = f.value("format", str, "")
        try:
            if name:
                find(name)
        except HalpipeError as unknown:
            f.complain(UNKNOWN_FORMAT, unknown.diagnostics[0].message, "format", help=unknown.diagnostics[0].help)
            return ""
        return name

    def _search(self, f: Fields) -> SearchOptions:
        return SearchOptions(
            seed=f.value("seed", whole(0), 1),
            budget=f.value("budget", whole(1), None),
            tick=f.value("tick", _grid, None),
            grid=self._grid(f.value("quantise", self._path, "")),
        )

    def _grid(self, platform: str) -> BurstGrid | None:
        try:
            return burst_grid(platform) if platform else None
        except HalpipeError as failure:
            self._findings.extend(failure.diagnostics)
            return None

    def _export(self, f: Fields, used: ImportOptions) -> ExportStep:
        f.require("format", "output")
        name = self._format(f, exporter)
        options = ExportOptions(mode=f.value("mode", str, ""), title=f.value("title", str, ""))
        if name:
            kind = exporter(name).options
            f.allow((*_EXPORT, *keys_of(kind), *BESIDES.get(name, ())))
            options = options_of(kind, options, f, str(self._base))
        step = ExportStep(name, f.value("output", self._path, ""), options)
        return replace(step, onto=f.value("onto", self._path, ""), source=used) if name in BESIDES else step


def _grid(text: str) -> Duration:
    """Read a duration above zero."""
    tick = Duration.parse(text)
    if not tick:
        raise ValueError(f"{text} is no grid; write a duration above zero, or leave it out")
    return tick
