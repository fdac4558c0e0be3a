"""Files to `System`: the part of the import that looks at XML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.diagnostics import Findings, HalpipeError
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.compositions import find_instances, read_compositions, read_ecus
from halpipe.importers.arxml.constraints import read_execution_times, read_orders, report_ignored
from halpipe.importers.arxml.ecuc import read_configuration
from halpipe.importers.arxml.modes import read_mode_groups
from halpipe.importers.arxml.sniff import load
from halpipe.importers.arxml.swc import is_component_type, place_of, read_components, read_twins
from halpipe.importers.arxml.system import System
from halpipe.importers.arxml.tree import Tree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.arxml.system import Place

_ADAPTIVE = (
    "ADAPTIVE-APPLICATION-SW-COMPONENT-TYPE",
    "EXECUTABLE",
    "FUNCTION-GROUP-SET",
    "MACHINE",
    "MACHINE-DESIGN",
    "PROCESS",
    "PROCESS-TO-MACHINE-MAPPING-SET",
    "SOFTWARE-CLUSTER",
    "STARTUP-CONFIG",
    "STARTUP-CONFIG-SET",
)
_CLASSIC = ("COMPOSITION-SW-COMPONENT-TYPE", "ECUC-MODULE-CONFIGURATION-VALUES", "ECU-INSTANCE")


def read_tree(paths: Sequence[str], findings: Findings) -> Tree:
    """Parse and merge all files; raise `HalpipeError` if there is nothing of AUTOSAR Classic R4 in them."""
    tree = Tree(load(paths, findings), findings)
    _check_platform(tree)
    return tree


def read_system(tree: Tree) -> System:
    """Read everything that influences timing out of the merged elements."""
    components = read_components(tree)
    compositions = read_compositions(tree)
    configuration = read_configuration(tree)
    instances = find_instances(tree, components, compositions, configuration.instances, tree.findings)
    report_ignored(tree)
    return System(
        place=_place(tree),
        components=components,
        compositions=compositions,
        instances=instances.items,
        copies=instances.copies,
        configuration=configuration,
        mode_groups=read_mode_groups(tree),
        orders=read_orders(tree),
        twins=read_twins(tree),
        execution_times=read_execution_times(tree),
        ecus=read_ecus(tree),
    )


def _check_platform(tree: Tree) -> None:
    first = next((node for node in tree.nodes() if node.tag in _ADAPTIVE), None)
    if first is None:
        return
    counts = ", ".join(f"{len(found)} {tag}" for tag in _ADAPTIVE if (found := tree.tagged(tag)))
    classic = any(node.tag in _CLASSIC or _is_classic_type(node.tag) for node in tree.nodes())
    if classic:
        tree.findings.add(
            codes.ADAPTIVE_PART(
                f"Adaptive elements are not imported: {counts}",
                at=first.at,
                help="describe what they run in the overlay",
            )
        )
        return
    tree.findings.add(
        codes.ADAPTIVE_ONLY(
            f"holds only Adaptive elements: {counts}",
            at=first.at,
            help="write a task model by hand, or import the ARXML of the Classic side",
        )
    )
    raise HalpipeError(*tree.findings.items)


def _is_classic_type(tag: str) -> bool:
    return is_component_type(tag) and not tag.startswith("ADAPTIVE-")


def _place(tree: Tree) -> Place | None:
    """Return what the system is named after: its only ECU, root composition, SYSTEM or composition."""
    for tag in ("ECU-INSTANCE", "ROOT-SW-COMPOSITION-PROTOTYPE", "SYSTEM", "COMPOSITION-SW-COMPONENT-TYPE"):
        found = tree.tagged(tag)
        if len(found) == 1:
            return place_of(found[0])
    return None
