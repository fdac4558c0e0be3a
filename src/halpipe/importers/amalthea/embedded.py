"""The native model inside an exported AMALTHEA file: it counts while the standard elements are unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.embedding import joined, properties_hash
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.names import legal
from halpipe.importers.amalthea.properties import text_of
from halpipe.importers.amalthea.xmi import Forest
from halpipe.importers.native import parse_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.amalthea.sniff import Document
    from halpipe.importers.amalthea.xmi import Item
    from halpipe.importers.common.base import Coverage, ImportOptions
    from halpipe.models import TaskModel


def read_embedded(
    documents: Sequence[Document], options: ImportOptions, findings: Findings, coverage: Coverage
) -> TaskModel | None:
    """Return the native model of an export; None without one, and, with a warning, where files were changed."""
    roots = Forest(documents, Findings()).roots
    root = next((root for root in roots if text_of(root, "hash") is not None), None)
    if root is None:
        return None
    trouble, model = _read(root, is_alone=len(roots) == 1)
    if model is None:
        help = "nothing to do if the change was meant; otherwise export the model again"
        message = f"{trouble}; the standard elements are imported"
        findings.add(codes.EDITED(message, at=root.at, help=help))
        return None
    coverage.mapped("file")
    for item in root.walk():
        if item.name and item is not root:
            coverage.mapped(item.kind)
    return replace(model, name=legal(options.name)) if options.name else model


def _read(root: Item, *, is_alone: bool) -> tuple[str, TaskModel | None]:
    """Return why the native model does not count, or the model."""
    if not is_alone:
        return "other files stand beside an export of halpipe", None
    if text_of(root, "hash") != properties_hash(root.element):
        return "standard elements were changed after the export", None
    texts: list[str] = []
    while (text := text_of(root, f"model.{len(texts)}")) is not None:
        texts.append(text.replace("\n", " "))  # the whole value stands in one line of the file
    try:
        return "", parse_model(joined(texts, root.at.line), root.file)
    except HalpipeError as failure:
        return f"the native model cannot be read: {failure.diagnostics[0].message}", None
