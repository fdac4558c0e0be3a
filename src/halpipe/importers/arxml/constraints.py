"""Timing constraints: execution order, worst-case execution times; what else there is, is reported as left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.durations import Duration
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.numbers import parse_number
from halpipe.importers.arxml.swc import RUNNABLES, place_of
from halpipe.importers.arxml.system import ExecutionTime, Order

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.tree import Node, Tree

_EOC = "EXECUTION-ORDER-CONSTRAINT"
_EOC_ENTITY = "EOC-EXECUTABLE-ENTITY-REF"
_EOC_EVENT = "EOC-EVENT-REF"
_EOC_OTHER = ("EOC-EXECUTABLE-ENTITY-REF-GROUP", "LET-DATA-EXCHANGE-PARADIGM")
IGNORED = (
    "LATENCY-TIMING-CONSTRAINT",
    "OFFSET-TIMING-CONSTRAINT",
    "SYNCHRONIZATION-TIMING-CONSTRAINT",
    "SYNCHRONIZATION-POINT-CONSTRAINT",
    "EXECUTION-TIME-CONSTRAINT",
    "AGE-CONSTRAINT",
    "PERIODIC-EVENT-TRIGGERING",
    "SPORADIC-EVENT-TRIGGERING",
    "BURST-PATTERN-EVENT-TRIGGERING",
    "CONCRETE-PATTERN-EVENT-TRIGGERING",
    "ARBITRARY-EVENT-TRIGGERING",
)
# Where a worst-case time stands in each kind of execution time, the most trustworthy kind first.
_EXECUTION_TIMES = {
    "ANALYZED-EXECUTION-TIME": "WORST-CASE-EXECUTION-TIME",
    "MEASURED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "SIMULATED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "ROUGH-ESTIMATE-OF-EXECUTION-TIME": "ESTIMATED-EXECUTION-TIME",
}
_CSE_MICROSECONDS = 0


def read_orders(tree: Tree) -> tuple[Order, ...]:
    """Read the execution order constraints as pairs of runnables or events."""
    return tuple(order for node in tree.tagged(_EOC) for order in _orders(tree, node))


def _orders(tree: Tree, constraint: Node) -> Iterator[Order]:
    for element in constraint.inside():
        if element.tag in _EOC_OTHER:
            tree.findings.add(
                codes.ORDER_LOST(
                    f"{element.tag} is not imported",
                    at=element.at,
                    path=f'{_EOC} "{constraint.path}"',
                    help="state this order in the overlay (precedence)",
                )
            )
        if element.tag not in (_EOC_ENTITY, _EOC_EVENT):
            continue
        first = _ordered(tree, element)
        for path in ("SUCCESSOR-REFS/SUCCESSOR-REF", "DIRECT-SUCCESSOR-REFS/DIRECT-SUCCESSOR-REF"):
            for ref in tree.refs(element, path):
                successor = tree.find(ref, f'{_EOC} "{constraint.path}"', (_EOC_ENTITY, _EOC_EVENT))
                second = _ordered(tree, successor) if successor is not None else None
                if first is not None and second is not None:
                    yield Order(place_of(constraint), first, second)


def _ordered(tree: Tree, element: Node) -> str | None:
    """Return the path of the runnable or event that an element of an execution order names."""
    ref = tree.ref(element, "EXECUTABLE-REF") or tree.ref(element, "EVENT-REF")
    if ref is None:
        return None
    target = tree.find(ref, f'{element.tag} "{element.path}"')
    return target.path if target is not None else None


def read_execution_times(tree: Tree) -> tuple[ExecutionTime, ...]:
    """Read the worst-case execution times of runnables: the largest of the most trustworthy kind for each."""
    best: dict[str, tuple[int, ExecutionTime]] = {}
    for rank, (tag, value) in enumerate(_EXECUTION_TIMES.items()):
        for node in tree.tagged(tag):
            found = _execution_time(tree, node, value)
            if found is None:
                continue
            known = best.get(found.runnable)
            if known is None or (known[0] == rank and known[1].time < found.time):
                best[found.runnable] = (rank, found)
    return tuple(found for _, found in best.values())


def _execution_time(tree: Tree, node: Node, value: str) -> ExecutionTime | None:
    ref = tree.ref(node, "EXECUTABLE-ENTITY-REF")
    runnable = tree.find(ref, f'{node.tag} "{node.path}"', RUNNABLES) if ref else None
    code = tree.text(node, f"{value}/CSE-CODE")
    factor = tree.text(node, f"{value}/CSE-CODE-FACTOR")
    if runnable is None or code is None or factor is None:
        return None
    number = parse_number(factor.value)
    if parse_number(code.value) == _CSE_MICROSECONDS and number is not None and number > 0:
        return ExecutionTime(place_of(node), runnable.path, Duration(number * 1000))
    tree.findings.add(
        codes.BAD_EXECUTION_TIME(
            f'{value} with CSE-CODE "{code.value}" and factor "{factor.value}" is not read',
            at=code.at,
            path=f'{node.tag} "{node.path}"',
            help="write it with CSE-CODE 0 (microseconds), or give the WCET in the overlay",
        )
    )
    return None


def report_ignored(tree: Tree) -> None:
    """Report the timing constraints that have no effect on the model, one finding for each kind."""
    for tag in IGNORED:
        found = tree.tagged(tag)
        if found:
            tree.findings.add(
                codes.TIMING_IGNORED(
                    f"{len(found)} {tag} elements are not imported",
                    at=found[0].at,
                    path=found[0].path,
                    help="state deadlines and chains in the overlay",
                )
            )
