"""Worst-case execution times of runnables, for each hardware element that one is stated for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.numbers import parse_cse
from halpipe.importers.arxml.system.swc import RUNNABLES, place_of
from halpipe.importers.arxml.system.values import ExecutionTime

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Code
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.files.tree import Node, Tree

# Where a worst-case time stands in each kind of execution time, the most trustworthy kind first.
KINDS = {
    "ANALYZED-EXECUTION-TIME": "WORST-CASE-EXECUTION-TIME",
    "MEASURED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "SIMULATED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "ROUGH-ESTIMATE-OF-EXECUTION-TIME": "ESTIMATED-EXECUTION-TIME",
    "EXECUTION-TIME-CONSTRAINT": "MAXIMUM",
}
ANALYSED = "ANALYZED-EXECUTION-TIME"
CSE_HELP = "write it with a CSE-CODE that counts time (0: microseconds, 26: nanoseconds), or state it in the overlay"


def read_execution_times(tree: Tree) -> tuple[ExecutionTime, ...]:
    """Read execution times: for each runnable and hardware element the largest of the most trustworthy kind."""
    best: dict[tuple[str, str | None], ExecutionTime] = {}
    for tag in KINDS:
        for node in tree.tagged(tag):
            found = _execution_time(tree, node)
            if found is None:
                continue
            key = found.runnable, found.hardware
            known = best.get(key)
            if known is None or (known.place.kind == tag and known.time < found.time):
                best[key] = found
    return tuple(best.values())


def _execution_time(tree: Tree, node: Node) -> ExecutionTime | None:
    what = f'{node.tag} "{node.path}"'
    ref = tree.ref(node, "EXECUTABLE-ENTITY-REF") or tree.ref(node, "EXECUTABLE-REF")
    runnable = tree.find(ref, what, RUNNABLES) if ref else None
    hardware = tree.ref(node, "HW-ELEMENT-REF")
    if hardware is not None:
        tree.find(hardware, what, ("HW-ELEMENT",))
    if runnable is None:
        return None
    time = cse_time(tree, node, KINDS[node.tag], codes.BAD_EXECUTION_TIME)
    if not time:
        return None
    return ExecutionTime(place_of(node), runnable.path, time, hardware.path if hardware else None)


def cse_time(tree: Tree, node: Node, child: str, code: Code) -> Duration | None:
    """Return the MULTIDIMENSIONAL-TIME in a child element; report with `code` one that is there but is no time."""
    unit = tree.text(node, f"{child}/CSE-CODE")
    factor = tree.text(node, f"{child}/CSE-CODE-FACTOR")
    if unit is None or factor is None:
        return None
    time = parse_cse(unit.value, factor.value)
    if time is None or (not time and code is codes.BAD_EXECUTION_TIME):
        tree.findings.add(
            code(
                f'{child} with CSE-CODE "{unit.value}" and factor "{factor.value}" is not read',
                at=unit.at,
                path=named(node.tag, node.path),
                help=CSE_HELP,
            )
        )
    return time
