"""Files to `System`: the part of the import that looks at XML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.sniff import load
from halpipe.importers.arxml.files.tree import Tree
from halpipe.importers.arxml.system.adaptive import ADAPTIVE, read_function_groups, read_machines, read_processes
from halpipe.importers.arxml.system.compositions import read_compositions, read_ecus, read_hardware
from halpipe.importers.arxml.system.constraints import read_orders
from halpipe.importers.arxml.system.ecuc import read_configuration
from halpipe.importers.arxml.system.execution_times import read_execution_times
from halpipe.importers.arxml.system.instances import find_instances
from halpipe.importers.arxml.system.modes import read_mode_groups
from halpipe.importers.arxml.system.selection import keep_own, report_absent, select_ecu
from halpipe.importers.arxml.system.swc import is_component_type, place_of, read_components, read_twins
from halpipe.importers.arxml.system.timing import read_timing, report_not_read
from halpipe.importers.arxml.system.values import System

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.importers.arxml.files.variants import Choice
    from halpipe.importers.arxml.system.values import Place

_CLASSIC = ("COMPOSITION-SW-COMPONENT-TYPE", "ECUC-MODULE-CONFIGURATION-VALUES", "ECU-INSTANCE")


def read_tree(
    paths: Sequence[str],
    findings: Findings,
    choice: Choice | None = None,
    *,
    marks: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> Tree:
    """Parse and merge all files, of one variant if one is chosen, with the `marks` of tools if those are wanted.

    Raise `HalpipeError` if nothing in them could be a task.
    """
    tree = Tree(load(paths, findings, marks=marks, on_progress=on_progress), findings, choice)
    _check_platform(tree)
    return tree


def read_system(tree: Tree, ecu: str = "") -> System:
    """Read everything that influences timing out of the merged elements, for one ECU if there are several.

    Raise `HalpipeError` if there are several, and `ecu` names none of them.
    """
    components = read_components(tree)
    compositions = read_compositions(tree)
    ecus = read_ecus(tree)
    selection = select_ecu(tree, ecus, ecu)
    configuration = read_configuration(tree, selection.modules)
    instances = find_instances(tree, components, compositions, configuration.instances, tree.findings)
    machines, groups = read_machines(tree), read_function_groups(tree)
    report_not_read(tree)
    report_absent(tree)
    system = System(
        place=_place(tree),
        components=components,
        compositions=compositions,
        instances=instances.items,
        copies=instances.copies,
        configured=instances.configured,
        configuration=configuration,
        mode_groups=(*read_mode_groups(tree), *groups),
        orders=read_orders(tree),
        twins=read_twins(tree),
        execution_times=read_execution_times(tree),
        ecus=() if selection.is_whole else ecus,
        hardware=read_hardware(tree),
        timing=read_timing(tree),
        machines=machines,
        processes=read_processes(tree, machines, groups),
    )
    return system if selection.ecu is None else keep_own(tree, system, selection.ecu)


def _check_platform(tree: Tree) -> None:
    """Raise `HalpipeError` if the files are of the Adaptive Platform only and have no process that could be a task."""
    first = next((node for tag in ADAPTIVE for node in tree.tagged(tag)), None)
    if first is None or tree.tagged("PROCESS"):
        return
    if any(node.tag in _CLASSIC or _is_classic_type(node.tag) for node in tree.nodes()):
        return
    counts = ", ".join(f"{len(found)} {tag}" for tag in ADAPTIVE if (found := tree.tagged(tag)))
    tree.findings.add(
        codes.ADAPTIVE_ONLY(
            f"holds only Adaptive elements, and no PROCESS: {counts}",
            at=first.at,
            help="add the execution manifest that has the processes",
        )
    )
    raise HalpipeError(*tree.findings.items)


def _is_classic_type(tag: str) -> bool:
    return is_component_type(tag) and not tag.startswith("ADAPTIVE-")


def _place(tree: Tree) -> Place | None:
    """Return what the system is named after: its only ECU, root composition, SYSTEM, composition or machine."""
    for tag in (
        "ECU-INSTANCE",
        "ROOT-SW-COMPOSITION-PROTOTYPE",
        "SYSTEM",
        "COMPOSITION-SW-COMPONENT-TYPE",
        "MACHINE",
    ):
        found = tree.tagged(tag)
        if len(found) == 1:
            return place_of(found[0])
    return None
