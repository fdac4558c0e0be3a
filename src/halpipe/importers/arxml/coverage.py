"""The account of every element: each identifiable element is mapped or ignored, once, with a reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.compositions import COMPOSITION
from halpipe.importers.arxml.constraints import IGNORED
from halpipe.importers.base import Coverage

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.arxml.activation import Activation
    from halpipe.importers.arxml.dataflow import DataFlow
    from halpipe.importers.arxml.grouping import Draft
    from halpipe.importers.arxml.system import Place, System
    from halpipe.importers.arxml.tree import Node, Tree

_NO_INFLUENCE = "no influence on timing"
_UNUSED = {
    "OsTask": "runs no task of the model",
    "OsAlarm": "gives no task its period",
    "OsScheduleTable": "gives no task its period",
    "OsScheduleTableExpiryPoint": "gives no task its period",
    "OsCounter": "its ticks are not needed",
    "OsApplication": "runs no task of the model",
    "RteEventToTaskMapping": "its event makes no task, or runs in no OsTask",
    "RteBswEventToTaskMapping": "its event makes no task, or runs in no OsTask",
    "RUNNABLE-ENTITY": "no event starts it",
    "BSW-SCHEDULABLE-ENTITY": "no event starts it",
    "ASSEMBLY-SW-CONNECTOR": "carries no data between runnables",
    "DELEGATION-SW-CONNECTOR": "carries no data between runnables",
    "SW-COMPONENT-PROTOTYPE": "its component has no task",
    "MODE-DECLARATION-GROUP": "switches no task off",
    "MODE-DECLARATION": "switches no task off",
    "MODE-TRANSITION": "switches no task off",
    "EXECUTION-ORDER-CONSTRAINT": "orders no tasks",
    COMPOSITION: "none of its components has a task",
}


class Ledger:
    """Notes what became of elements, known by path and kind; the first word on an element counts."""

    def __init__(self) -> None:
        self._mapped: set[tuple[str, str]] = set()
        self._reasons: dict[tuple[str, str], str] = {}

    def mapped(self, *places: Place) -> None:
        """Note elements that shaped the model."""
        self._mapped.update((place.path, place.kind) for place in places)

    def ignored(self, place: Place, reason: str) -> None:
        """Note why an element did not; this yields to being mapped elsewhere."""
        self._reasons.setdefault((place.path, place.kind), reason)

    def close(self, tree: Tree, kinds: dict[str, str]) -> Coverage:
        """Account for every node of the tree; `kinds` gives the kinds of configuration containers by path."""
        coverage = Coverage()
        nodes = [
            (node, kinds.get(node.path, node.tag) if node.tag == "ECUC-CONTAINER-VALUE" else node.tag)
            for node in tree.nodes()
        ]
        mapped = _with_holders(node for node, kind in nodes if (node.path, kind) in self._mapped)
        for node, kind in nodes:
            if node in mapped:
                coverage.mapped(kind)
            else:
                reason = self._reasons.get((node.path, kind)) or _default(kind)
                coverage.ignored(kind, node.path, reason, node.at)
        return coverage


def _with_holders(nodes: Iterable[Node]) -> set[Node]:
    """Return the nodes and everything that holds them: packages, behaviours, module configurations."""
    found: set[Node] = set()
    for start in nodes:
        node: Node | None = start
        while node is not None and node not in found:
            found.add(node)
            node = node.parent
    return found


def _default(kind: str) -> str:
    if kind.endswith("-EVENT"):
        return "starts no runnable that is known"
    if kind in IGNORED:
        return "timing constraint that is not imported"
    return _UNUSED.get(kind, _NO_INFLUENCE)


def note_activations(ledger: Ledger, activations: Iterable[Activation], drafts: Iterable[Draft]) -> None:
    """Note events, runnables, OS tasks and mappings, by whether a task came of them."""
    for draft in drafts:
        for member in draft.members:
            ledger.mapped(member.place, *member.used)
            if member.event is not None:
                ledger.mapped(member.event.place)
            if member.mapping is not None and member.os_task is not None:
                ledger.mapped(member.mapping.place)
            if member.os_task is not None:
                ledger.mapped(member.os_task.place)
    for activation in activations:
        reason = activation.reason or "left out by the overlay"
        ledger.ignored(activation.event.place if activation.event else activation.place, reason)
        if activation.runnable is not None:
            ledger.ignored(activation.runnable.place, f"started by {activation.kind} only: {reason}")


def note_structure(ledger: Ledger, system: System, drafts: Sequence[Draft], dataflow: DataFlow) -> None:
    """Note what gives tasks their place: components, prototypes, compositions, connectors, applications, cores."""
    used = {path for draft in drafts for member in draft.members for path in member.context}
    instantiated = {instance.component.place.path for instance in system.instances}
    for component in system.components:
        if component.place.path not in instantiated:
            inner = [*(e.place for e in component.events), *(r.place for r in component.runnables)]
            for place in inner:
                ledger.ignored(place, "its component type is no part of the system")
        for place in (component.place, *component.behaviors):
            ledger.ignored(place, "has no periodic runnable")
    type_paths = {p.place.path: p.type for c in system.compositions for p in c.prototypes}
    used |= {type_paths[path] or "" for path in used if path in type_paths}
    for composition in system.compositions:
        if composition.place.path in used:
            ledger.mapped(composition.place)
        if composition.place.path in system.copies:
            ledger.ignored(composition.place, "copy of a composition that the Rte configuration names")
        ledger.mapped(*(p.place for p in composition.prototypes if p.place.path in used))
        ledger.mapped(*(c.place for c in composition.connectors if c.place.path in dataflow.connectors))
    os_tasks = {m.os_task.place.path for draft in drafts for m in draft.members if m.os_task}
    for application in system.configuration.applications:
        if any(path in os_tasks for path in application.tasks):
            ledger.mapped(application.place)
    ledger.mapped(*(core.place for core in system.configuration.cores if core.place))
    for ecu in system.ecus:
        if not system.configuration.cores and used & set(ecu.prototypes):
            ledger.mapped(ecu.place, *ecu.mappings)
