"""Component instances: what the root compositions unfold into, and what the Rte configuration names."""

from __future__ import annotations

from collections import Counter
from itertools import islice
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, named
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.system.compositions import COMPOSITION
from halpipe.importers.arxml.system.values import Component, Composition, Instance, RteInstance

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.files.tree import Tree

_MAX_DEPTH = 32
MAX_INSTANCES = 20_000
_PROTOTYPE = "SW-COMPONENT-PROTOTYPE"
Context = tuple[str, ...]
"""A root composition and the prototypes down to a component (paths)."""


@record
class Instances:
    """The component instances, the compositions (paths) taken for copies of others, and what the Rte means by names.

    `configured` has the context of the instance that each prototype (path) of the Rte configuration stands for.
    """

    items: tuple[Instance, ...]
    copies: tuple[str, ...]
    configured: dict[str, Context]


def find_instances(
    tree: Tree,
    components: Sequence[Component],
    compositions: Sequence[Composition],
    mapped: Sequence[RteInstance],
    findings: Findings,
) -> Instances:
    """Unfold the root compositions into component instances.

    Roots are the compositions that a SYSTEM names, or else those that no other composition uses, and those whose
    prototypes the Rte configuration names. Roots of which it names no instance are copies. Component types that no
    composition uses stand for themselves, as BSW modules always do, or for the instances that only the Rte names.
    """
    by_path = {composition.place.path: composition for composition in compositions}
    types = {component.place.path: component for component in components}
    roots = _roots(tree, compositions, mapped)
    unfolded = {root: _bounded(_unfold(by_path[root], (root,), by_path, types), by_path[root]) for root in roots}
    everything = [instance for root in roots for instance in unfolded[root]]
    configured, alone = _Configured(tree, everything, components).resolve(mapped)
    copies = _copies(unfolded, {*configured.values(), *(item.prototype for item in mapped)})
    for root in copies:
        findings.add(
            codes.COPY(
                "none of its component prototypes is in the Rte configuration",
                at=by_path[root].place.at,
                path=named("composition", root),
                help="nothing to do if it is the system that the ECU extract was made of",
            )
        )
    kept = [instance for root in roots if root not in copies for instance in unfolded[root]]
    _report_shared_types(kept, by_path, findings)
    used = {instance.component.place.path for instance in (*kept, *alone)}
    rest = [component for component in components if component.place.path not in used]
    if kept:
        _report_unused([component for component in rest if not component.is_module], findings)
        rest = [component for component in rest if component.is_module]
    single = [Instance(_label(component), (component.place.path,), component) for component in rest]
    return Instances((*kept, *alone, *single), copies, configured)


class _Configured:
    """Finds the instances that the Rte configuration names, which is mostly made for the flattened ECU extract.

    A prototype that no file defines is looked up in the flat maps; else it is the only instance of its name, or the
    only one left, that has its events; else, where no composition has its type, it is an instance of its own.
    """

    def __init__(self, tree: Tree, instances: Sequence[Instance], components: Sequence[Component]) -> None:
        self._tree = tree
        self._instances = instances
        self._by_prototype: dict[str, list[Instance]] = {}
        for instance in instances:
            self._by_prototype.setdefault(instance.prototype, []).append(instance)
        self._owner = {event.place.path: component for component in components for event in component.events}
        self._upstream = dict(upstream(tree))

    def resolve(self, mapped: Sequence[RteInstance]) -> tuple[dict[str, Context], list[Instance]]:
        """Return the context that each named prototype stands for, and the instances that only the Rte knows."""
        found: dict[str, Context] = {}
        open_: list[RteInstance] = []
        for item in mapped:
            context = self._defined(item) or self._by_flat_map(item)
            if context:
                found[item.prototype] = context
            elif not self._is_defined(item.prototype) and not self._tree.is_absent(item.prototype):
                open_.append(item)
        for choose in (self._by_name, self._by_type):
            for item in [item for item in open_ if item.prototype not in found]:
                context = choose(item, set(found.values()))
                if context:
                    found[item.prototype] = context
        used = {instance.component.place.path for instance in self._instances}
        alone: dict[str, Instance] = {}
        for item in [item for item in open_ if item.prototype not in found]:
            types = self._types(item)
            if len(types) == 1 and types[0].place.path not in used:
                context = (item.prototype.rpartition("/")[0], item.prototype)
                found[item.prototype] = context
                alone[item.prototype] = Instance(item.prototype.rpartition("/")[2], context, types[0])
            elif types or not item.events:
                self._report(item, types)
        return found, list(alone.values())

    def _is_defined(self, prototype: str) -> bool:
        return self._tree.has(prototype, _PROTOTYPE)

    def _defined(self, item: RteInstance) -> Context | None:
        return next((instance.context for instance in self._by_prototype.get(item.prototype, ())), None)

    def _by_flat_map(self, item: RteInstance) -> Context | None:
        steps = self._upstream.get(item.prototype)
        if steps is None:
            return None
        candidates = [i.context for i in self._by_prototype.get(steps[-1], ())]
        exact = [context for context in candidates if context[1:] == steps]
        return next(iter(exact or (candidates if len(candidates) == 1 else [])), None)

    def _by_name(self, item: RteInstance, taken: set[Context]) -> Context | None:
        """Return the only instance whose name, and whose type if events tell it, is that of the prototype."""
        types = {component.place.path for component in self._types(item)}
        name = item.prototype.rpartition("/")[2]
        fitting = [
            i.context
            for i in self._instances
            if i.prototype.rpartition("/")[2] == name
            and i.context not in taken
            and (not types or i.component.place.path in types)
        ]
        return fitting[0] if len(fitting) == 1 else None

    def _by_type(self, item: RteInstance, taken: set[Context]) -> Context | None:
        types = {component.place.path for component in self._types(item)}
        fitting = [i.context for i in self._instances if i.component.place.path in types and i.context not in taken]
        return fitting[0] if len(fitting) == 1 else None

    def _types(self, item: RteInstance) -> list[Component]:
        """Return the component types that own the mapped events: one, unless the configuration is wrong."""
        found = {self._owner[path].place.path: self._owner[path] for path in item.events if path in self._owner}
        return list(found.values())

    def _report(self, item: RteInstance, types: Sequence[Component]) -> None:
        count = Counter(i.component.place.path for i in self._instances)
        several = sum(count[component.place.path] for component in types)
        why = f"; {several} instances could be meant" if several > 1 else ""
        self._tree.findings.add(
            codes.DANGLING(
                f"RteSoftwareComponentInstanceRef refers to {item.prototype}, which no file defines{why}, so that its "
                f"{len(item.events)} event mappings are lost",
                at=item.at,
                path=named(item.place.kind, item.place.path),
                help="add the ECU extract with the flat composition, or its FLAT-MAP, to the import",
            )
        )


def upstream(tree: Tree) -> Iterator[tuple[str, Context]]:
    """Yield every prototype of a flat ECU extract, and the prototypes down to the one that it was made of."""
    for node in tree.tagged("FLAT-INSTANCE-DESCRIPTOR"):
        flat = tree.ref(node, "ECU-EXTRACT-REFERENCE-IREF/TARGET-REF")
        origin = tree.ref(node, "UPSTREAM-REFERENCE-IREF/TARGET-REF")
        if flat is not None and origin is not None and origin.dest in ("", _PROTOTYPE):
            refs = tree.refs(node, "UPSTREAM-REFERENCE-IREF/CONTEXT-ELEMENT-REF")
            inner = [ref.path for ref in refs if ref.dest == _PROTOTYPE and ref.path != origin.path]
            yield flat.path, (*inner, origin.path)


def _label(component: Component) -> str:
    """Name a module apart from the service component of the same name, which most modules have."""
    return f"BSW/{component.place.name}" if component.is_module else component.place.name


def _report_unused(components: Sequence[Component], findings: Findings) -> None:
    for component in components:
        if any(event.is_timing for event in component.events):
            findings.add(
                codes.NOT_INSTANTIATED(
                    "is used in no composition of the system, so that its runnables are no tasks",
                    at=component.place.at,
                    path=named(component.place.kind, component.place.path),
                    help="add it to the composition, or import its file on its own",
                )
            )


def _roots(tree: Tree, compositions: Sequence[Composition], named: Sequence[RteInstance]) -> list[str]:
    chosen = []
    for node in tree.tagged("ROOT-SW-COMPOSITION-PROTOTYPE"):
        ref = tree.ref(node, "SOFTWARE-COMPOSITION-TREF")
        target = tree.find(ref, f'root composition "{node.path}"', (COMPOSITION,)) if ref else None
        if target is not None:
            chosen.append(target.path)
    used = {prototype.type for composition in compositions for prototype in composition.prototypes}
    unused = [composition.place.path for composition in compositions if composition.place.path not in used]
    holders = {item.prototype.rpartition("/")[0] for item in named}
    configured = [composition.place.path for composition in compositions if composition.place.path in holders]
    return list(dict.fromkeys((*(chosen or unused), *(path for path in configured if path not in used))))


def _unfold(
    composition: Composition,
    context: tuple[str, ...],
    compositions: dict[str, Composition],
    types: dict[str, Component],
) -> Iterator[Instance]:
    """Yield the instances inside one use of a composition; a composition inside itself is not entered again."""
    if len(context) > _MAX_DEPTH:
        return
    for prototype in composition.prototypes:
        inner = (*context, prototype.place.path)
        if prototype.type in compositions and prototype.place.path not in context:
            yield from _unfold(compositions[prototype.type], inner, compositions, types)
        elif prototype.type in types:
            label = "/".join(path.rpartition("/")[2] for path in inner[1:])
            yield Instance(label, inner, types[prototype.type])


def _bounded(instances: Iterator[Instance], root: Composition) -> list[Instance]:
    """Collect instances; compositions that multiply beyond all reason are refused."""
    found = list(islice(instances, MAX_INSTANCES + 1))
    if len(found) > MAX_INSTANCES:
        raise HalpipeError(
            codes.TOO_MANY(
                f"makes more than {MAX_INSTANCES} component instances",
                at=root.place.at,
                path=named("composition", root.place.path),
                help="import one part of the system at a time",
            )
        )
    return found


def _copies(unfolded: dict[str, list[Instance]], configured: set[Context | str]) -> tuple[str, ...]:
    """Return the roots without any of the contexts and prototypes of the Rte configuration, if others have some."""

    def is_configured(root: str) -> bool:
        return any(not configured.isdisjoint((i.context, *i.context)) for i in unfolded[root])

    if not any(is_configured(root) for root in unfolded):
        return ()
    return tuple(root for root in unfolded if not is_configured(root))


def _report_shared_types(instances: Sequence[Instance], by_path: dict[str, Composition], findings: Findings) -> None:
    roots: dict[str, list[str]] = {}
    for instance in instances:
        known = roots.setdefault(instance.component.place.path, [])
        if instance.context[0] not in known:
            known.append(instance.context[0])
    for pair in dict.fromkeys(tuple(found) for found in roots.values() if len(found) > 1):
        shared = next(path for path, found in roots.items() if tuple(found) == pair)
        findings.add(
            codes.SEVERAL_ROOTS(
                f"{shared} and others are used in each of {', '.join(pair)}",
                at=by_path[pair[0]].place.at,
                path=named("composition", pair[0]),
                help="import the files of one system only, or add the ECU configuration of the Rte",
            )
        )
