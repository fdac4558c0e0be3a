"""The pipeline file of ``halpipe run``: sources, overlay, stages and exports of one system, in YAML.

Paths in it are relative to the file itself, so that a pipeline means the same from wherever it is run.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Findings, HalpipeError, Location, error, located, sort_diagnostics
from halpipe.core.files import YamlMap, parse_yaml, read_bytes
from halpipe.core.options import file_name, from_fields, names_of, refuse_unused
from halpipe.core.records import record
from halpipe.core.settings import Fields
from halpipe.exporters.arxml.options import OF_PROJECT
from halpipe.exporters.common.base import ExportOptions
from halpipe.flow.formats import UNKNOWN_FORMAT, exporter, importer
from halpipe.flow.searching import search_options
from halpipe.importers.common.base import ImportOptions
from halpipe.pipeline.solve.schedule import SearchOptions

if TYPE_CHECKING:
    from collections.abc import Callable

K = TypeVar("K", ImportOptions, ExportOptions)

NOT_A_PIPELINE = error(
    "HAL0906",
    "File is no pipeline",
    'A pipeline is a YAML mapping with the key "halpipe-pipeline: 1", the version of the format.',
)

VERSION = "1"
_TOP = ("halpipe-pipeline", "import", "model", "schedule", "exports")


@record
class ImportStep:
    """Sources to read; see `halpipe.flow.formats.import_model`."""

    format: str
    inputs: tuple[str, ...]
    options: ImportOptions
    at: Location


@record
class ExportStep:
    """Export of the verified schedule."""

    format: str
    output: str
    options: ExportOptions
    at: Location


@record
class Plan:
    """A pipeline file: without `imports`, the model file is the source."""

    imports: ImportStep | None
    model: str
    search: SearchOptions
    schedule: str
    at: Location
    """Where the search is stated."""
    exports: tuple[ExportStep, ...]


def read_plan(path: str) -> Plan:
    """Read a pipeline file; raise `HalpipeError` with everything wrong in it."""
    document = parse_yaml(read_bytes(path), path)
    if not isinstance(document, YamlMap) or document.get("halpipe-pipeline") != VERSION:
        is_overlay = isinstance(document, YamlMap) and "halpipe-overlay" in document
        help = "this is an overlay; name it under import" if is_overlay else 'begin it with "halpipe-pipeline: 1"'
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
        top.require("schedule")
        imports = top.section("import", (), "import")
        schedule = top.section("schedule", ("output", *names_of(SearchOptions)), "schedule")
        source = None if imports is None else self._import(imports)
        return Plan(
            imports=source,
            model=top.required("model", self._path),
            search=SearchOptions() if schedule is None else self._search(schedule),
            schedule="" if schedule is None else schedule.required("output", self._path),
            at=top.at("schedule"),
            exports=tuple(self._export(f, source) for f in top.items("exports", (), "export")),
        )

    def _path(self, text: str) -> str:
        return str(self._base / file_name(text))

    def _import(self, f: Fields) -> ImportStep:
        f.require("format", "inputs")
        name = self._format(f, importer)
        inputs = tuple(stated.value for stated in f.texts("inputs", self._path))
        kind = importer(name).options if name else ImportOptions
        return ImportStep(name, inputs, self._options(f, kind, ("format", "inputs") if name else ()), f.at())

    def _options(self, f: Fields, kind: type[K], others: tuple[str, ...]) -> K:
        """Read the options of a format, beside other keys (none: of what format is not known, so any may be there)."""
        if others:
            f.allow((*others, *names_of(kind)))
        options = kind(**from_fields(kind, f, str(self._base)))
        try:
            refuse_unused(options, f.path)
        except HalpipeError as failure:
            self._findings.extend(replace(each, at=f.at()) for each in failure.diagnostics)
        return options

    def _format(self, f: Fields, find: Callable[[str], object]) -> str:
        """Read the name of a format that is installed."""
        name = f.text("format")
        try:
            if name:
                find(name)
        except HalpipeError as unknown:
            f.complain(UNKNOWN_FORMAT, unknown.diagnostics[0].message, "format", help=unknown.diagnostics[0].help)
            return ""
        return name

    def _search(self, f: Fields) -> SearchOptions:
        values = from_fields(SearchOptions, f, str(self._base))
        try:
            with located(f.at()):
                return search_options(values)
        except HalpipeError as failure:
            self._findings.extend(failure.diagnostics)
            return SearchOptions()

    def _export(self, f: Fields, source: ImportStep | None) -> ExportStep:
        f.require("format")
        name = self._format(f, exporter)
        kind = exporter(name).options if name else ExportOptions
        options = self._options(f, kind, ("format", "output") if name else ())
        if getattr(options, "onto", "") and source is not None:  # it is the project that was imported
            used = {each: getattr(source.options, each, "") for each in OF_PROJECT if not getattr(options, each)}
            options = replace(options, **used)
        return ExportStep(name, f.required("output", self._path), options, f.at())
