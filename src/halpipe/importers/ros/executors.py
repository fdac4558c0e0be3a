"""Reader of executor configurations as halpipe writes them: the native model in one is what was exported.

Executors, callback groups and timers repeat what the schedule says, so they are accounted for as ignored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.embedding import joined
from halpipe.importers.native import parse_model
from halpipe.importers.ros import codes
from halpipe.importers.ros.yaml_reader import Reader

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Findings
    from halpipe.core.files import YamlMap
    from halpipe.importers.common.base import Coverage
    from halpipe.models import TaskModel

KEY = "halpipe-executors"
VERSION = "2"
_MODEL = "model-xml"
_TOP = (KEY, "model", "model-sha256", "scheduling", "modes", "not-realised", _MODEL)


def read_executors(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> TaskModel:
    """Return the model of a recognised document; raise `HalpipeError` for another version, and what is no model."""
    help = "export the schedule again"
    reader = Reader(file, findings, help)
    reader.check_keys(document, "file", _TOP)
    text = document.get(_MODEL)
    if document.get(KEY) != VERSION or not isinstance(text, str):
        key, what = (_MODEL, "holds no native model") if document.get(KEY) == VERSION else (KEY, "")
        what = what or f'version "{document.get(KEY)}" of the format is not {VERSION}, which this halpipe reads'
        raise HalpipeError(codes.MALFORMED(what, at=Location(file, document.line_of(key)), path="file", help=help))
    model = parse_model(joined([text], document.line_of(_MODEL) + 1), file)
    for kind in ("unit", "resource", "task", "chain", "mode", "transition"):
        coverage.mapped(kind, len(getattr(model, f"{kind}s")))
    for mode in reader.entries(document, "modes", "file"):
        for executor in reader.entries(mode, "executors", "mode"):
            name = f"{mode.get('name')} {executor.get('name')}"
            coverage.ignored("executor", name, "is what the schedule says, not the model", reader.at(executor))
    return model
