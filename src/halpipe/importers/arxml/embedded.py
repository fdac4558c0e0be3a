"""The native model inside a package that halpipe exported: it counts as long as the standard elements are unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, named
from halpipe.core.embedding import joined, package_hash
from halpipe.core.files import STDIO
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.coverage import Ledger
from halpipe.importers.arxml.files.sniff import read_whole
from halpipe.importers.arxml.files.tree import Node, Tree, qualified
from halpipe.importers.arxml.files.words import NS, listed
from halpipe.importers.arxml.system.containers import Containers, Data, data_of
from halpipe.importers.arxml.system.values import Place
from halpipe.importers.common.names import legal
from halpipe.importers.native import parse_model

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.importers.common.base import Coverage, ImportOptions
    from halpipe.models import TaskModel


def find_embedded(tree: Tree) -> Data | None:
    """Return the special data with a model that halpipe exported, None if there are none; reject a second model."""
    found = [data for node in tree.tagged("AR-PACKAGE") if (data := data_of(tree, node, "model")) is not None]
    for other in found[1:]:
        message = f"holds a model of halpipe, but so does {found[0].node.at}"
        other.node.report(tree.findings, codes.SECOND_MODEL, message, help="import one of the two")
    tree.findings.stop_on_errors()
    return found[0] if found else None


def read_embedded(tree: Tree, data: Data, options: ImportOptions) -> tuple[TaskModel, Coverage] | None:
    """Return the native model and the coverage of every element; None, with a warning, where the file was edited."""
    if (data.text("hash") or "").strip() != _hash_of(data):
        _report(data, "standard elements were changed after the export")
        return None
    texts = data.element.findall(qualified("SD") + "[@GID='xml']")
    document = joined([text.text or "" for text in texts], texts[0].sourceline or 1) if texts else b""
    try:
        model = parse_model(document, data.file)
    except HalpipeError as failure:
        _report(data, f"the native model cannot be read: {failure.diagnostics[0].message}")
        return None
    if options.name:
        model = replace(model, name=legal(options.name))
    return model, _account(tree, data.node)


def _report(data: Data, message: str) -> None:
    help = "nothing to do if the change was meant; otherwise export the model again"
    path = named(data.node.tag, data.node.path)
    text = f"{message}; the standard elements are imported"
    data.tree.findings.report(codes.EDITED, text, at=data.at, path=path, help=help)


def _hash_of(data: Data) -> str:
    """Return the hash of the package in the file as it stands, of which the tree may hold less."""
    package = data.element.getparent().getparent().getparent()
    if data.file != STDIO:
        packages = read_whole(data.file).root.iter(NS + "AR-PACKAGE")
        package = next((found for found in packages if _is_marked(found)), package)
    return package_hash(package)


def _is_marked(package: etree._Element) -> bool:
    groups = package.iterfind(qualified("ADMIN-DATA/SDGS/SDG"))
    return any(group.get("GID") == "halpipe:model" for group in groups)


def _account(tree: Tree, package: Node) -> Coverage:
    """Account for every element: those of the package are in the native model, others are left out."""
    ledger, kinds = Ledger(), Containers(tree).kinds
    strangers = []
    for node in tree.nodes():
        own = node.path == package.path or node.path.startswith(package.path + "/")
        is_container = node.tag == "ECUC-CONTAINER-VALUE"
        place = Place(node.path, kinds.get(node.path, node.tag) if is_container else node.tag, node.at)
        if own and not node.tag.startswith("ECUC-"):
            ledger.mapped(place)
        else:
            ledger.ignored(place, "follows from the schedule" if own else "beside a model that halpipe wrote")
        if not own and node.tag.endswith("-SW-COMPONENT-TYPE"):
            strangers.append(node)
    if strangers:
        message = f"{len(strangers)} component types are not imported: {listed([node.path for node in strangers])}"
        help = "import them on their own, or add their tasks to the model by hand"
        tree.findings.report(codes.BESIDE_MODEL, message, at=strangers[0].at, help=help)
    return ledger.close(tree, kinds)
