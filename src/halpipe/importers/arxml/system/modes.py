"""Mode declaration groups: their modes, the initial one first, and the transitions between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.system.swc import place_of
from halpipe.importers.arxml.system.values import ModeGroup, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.files.tree import Node, Tree


def read_mode_groups(tree: Tree) -> tuple[ModeGroup, ...]:
    """Read every MODE-DECLARATION-GROUP."""
    return tuple(_group(tree, node) for node in tree.tagged("MODE-DECLARATION-GROUP"))


def _group(tree: Tree, node: Node) -> ModeGroup:
    modes = [place_of(child) for child in node.inside("MODE-DECLARATION")]
    initial = tree.ref(node, "INITIAL-MODE-REF")
    modes.sort(key=lambda mode: initial is None or mode.path != initial.path)
    return ModeGroup(place=place_of(node), modes=tuple(modes), transitions=tuple(_transitions(tree, node)))


def _transitions(tree: Tree, group: Node) -> Iterator[tuple[Place, str, str]]:
    for node in group.inside("MODE-TRANSITION"):
        what = f'MODE-TRANSITION "{node.path}"'
        refs = (tree.ref(node, "EXITED-MODE-REF"), tree.ref(node, "ENTERED-MODE-REF"))
        ends = [tree.find(ref, what, ("MODE-DECLARATION",)) if ref else None for ref in refs]
        if ends[0] is not None and ends[1] is not None:
            yield place_of(node), ends[0].path, ends[1].path
