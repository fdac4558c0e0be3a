"""Data flow between runnables: along connectors, within a component, and across the boundary of the chosen ECU."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import parse_seconds

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lxml import etree

    from halpipe.importers.arxml.files.tree import Node, Ref, Tree
    from halpipe.importers.arxml.system.values import Composition, Connector, DataItem, Instance, System

# A port of one component instance: the instance's context and the path of the port.
Port = tuple[tuple[str, ...], str]
# A runnable of one component instance: the instance's context and the path of the runnable.
Actor = tuple[tuple[str, ...], str]
# A data element at a port: elements of two interfaces correspond by their short name.
Item = tuple[Port, str]


@record
class DataFlow:
    """The senders of every data element that reaches a port, the writer-reader pairs, the connectors in between."""

    senders: dict[Item, tuple[Actor, ...]]
    dependencies: tuple[tuple[Actor, Actor], ...]
    connectors: frozenset[str]


def item_at(context: tuple[str, ...], data: DataItem) -> Item:
    """Return a data element as seen by one component instance."""
    return (context, data.port), data.element.rpartition("/")[2]


def find_dataflow(system: System) -> DataFlow:
    """Follow what every runnable writes to where it arrives."""
    graph = _port_graph(system)
    readers = _readers(system)
    senders: dict[Item, dict[Actor, None]] = {}
    dependencies: dict[tuple[Actor, Actor], None] = {}
    used: set[str] = set()
    reach: dict[Port, dict[Port, tuple[str, ...]]] = {}
    for writer, (port, name) in _writes(system):
        if port not in reach:
            reach[port] = _reachable(graph, port)
        for target, connectors in reach[port].items():
            arrival = (target, name)
            senders.setdefault(arrival, {})[writer] = None
            for reader in readers.get(arrival, ()):
                dependencies[writer, reader] = None
            if arrival in readers:
                used.update(connectors)
    return DataFlow({item: tuple(actors) for item, actors in senders.items()}, tuple(dependencies), frozenset(used))


def _writes(system: System) -> Iterator[tuple[Actor, Item]]:
    for instance in system.instances:
        for runnable in instance.component.runnables:
            for data in runnable.writes:
                yield (instance.context, runnable.place.path), item_at(instance.context, data)


def _readers(system: System) -> dict[Item, list[Actor]]:
    readers: dict[Item, list[Actor]] = {}
    for instance in system.instances:
        for runnable in instance.component.runnables:
            for data in runnable.reads:
                actor = (instance.context, runnable.place.path)
                readers.setdefault(item_at(instance.context, data), []).append(actor)
        for event in instance.component.events:
            if event.data is not None and event.runnable is not None:
                known = readers.setdefault(item_at(instance.context, event.data), [])
                if (instance.context, event.runnable) not in known:
                    known.append((instance.context, event.runnable))
    return readers


def _port_graph(system: System) -> dict[Port, list[tuple[Port, str]]]:
    """Return, for every port of every instance, the ports its data goes to next and by which connector."""
    graph: dict[Port, list[tuple[Port, str]]] = {}
    for context, composition in _uses(system):
        for connector in composition.connectors:
            ends = _ends(context, connector)
            if ends is not None:
                graph.setdefault(ends[0], []).append((ends[1], connector.place.path))
    return graph


def _uses(system: System) -> Iterator[tuple[tuple[str, ...], Composition]]:
    """Yield every use of a composition with its context."""
    by_path = {composition.place.path: composition for composition in system.compositions}
    type_of = {p.place.path: p.type for composition in system.compositions for p in composition.prototypes}
    contexts = {i.context[:length]: None for i in system.instances for length in range(1, len(i.context))}
    for context in contexts:
        path = context[0] if len(context) == 1 else type_of.get(context[-1])
        if path in by_path:
            yield context, by_path[path]


def _ends(context: tuple[str, ...], connector: Connector) -> tuple[Port, Port] | None:
    if connector.source is None or connector.target is None:
        return None
    source, target = (
        ((*context, end.prototype) if end.prototype else context, end.port)
        for end in (connector.source, connector.target)
    )
    return source, target


def _reachable(graph: dict[Port, list[tuple[Port, str]]], start: Port) -> dict[Port, tuple[str, ...]]:
    """Return every port that data of `start` arrives at, itself included, with the connectors on the way."""
    found: dict[Port, tuple[str, ...]] = {start: ()}
    todo = [start]
    while todo:
        port = todo.pop()
        for following, connector in graph.get(port, ()):
            if following not in found:
                found[following] = (*found[port], connector)
                todo.append(following)
    return found


_SIGNALS = "DATA-MAPPINGS/SENDER-RECEIVER-TO-SIGNAL-MAPPING"
_TIMING = "I-PDU-TIMING-SPECIFICATIONS/I-PDU-TIMING/TRANSMISSION-MODE-DECLARATION/TRANSMISSION-MODE-{}-TIMING"
_CYCLES = [f"{_TIMING.format(when)}/CYCLIC-TIMING/TIME-PERIOD/VALUE" for when in ("TRUE", "FALSE")]
_REFS = ("CONTEXT-COMPONENT-REF", "CONTEXT-PORT-REF", "SYSTEM-SIGNAL-REF")


def report_boundary(tree: Tree, system: System) -> None:
    """Report inputs and outputs of the ECU with their periods, if another ECU is in the input, too."""
    if not system.others:
        return
    everything = (*system.instances, *system.others)
    own = {instance.context for instance in system.instances}
    labels = {instance.context: instance.label for instance in everything}
    periods = {
        (instance.context, event.runnable): str(period)
        for instance in everything
        for event in instance.component.events
        if event.period is not None and (period := parse_seconds(event.period.text))
    }
    places = {r.place.path: r.place for c in system.components for r in c.runnables}
    for writer, reader in find_dataflow(replace(system, instances=everything)).dependencies:
        if (writer[0] in own) == (reader[0] in own):
            continue
        is_out = writer[0] in own
        inner, outer = (writer, reader) if is_out else (reader, writer)
        here, there = (f"{labels[context]}/{path.rpartition('/')[2]}" for context, path in (inner, outer))
        every = periods.get(writer)
        tree.findings.report(
            codes.BOUNDARY,
            f"{here} {'sends data to' if is_out else 'receives data of'} {there} on another ECU"
            + (f" every {every}" if every else ", at no period that is known"),
            at=places[inner[1]].at,
            path=named("output" if is_out else "input", here),
        )
    own_prototypes = {path for context in own for path in context[1:]}
    _report_signals(tree, own_prototypes, _senders(everything, periods))


Periods = dict[tuple[str, str], tuple[str, ...]]
"""The periods at which a port of a component prototype is written."""


def _senders(instances: Sequence[Instance], periods: Mapping[tuple[tuple[str, ...], str | None], str]) -> Periods:
    found: Periods = {}
    for instance in instances:
        for runnable in instance.component.runnables:
            period = periods.get((instance.context, runnable.place.path))
            for item in runnable.writes if period else ():
                key = instance.prototype, item.port
                found[key] = tuple(dict.fromkeys((*found.get(key, ()), period or "")))
    return found


def _report_signals(tree: Tree, prototypes: set[str], senders: Periods) -> None:
    """Report the signals of the network that the instances of the ECU send and receive, with the period of the sender.

    That is the period at which a component writes the signal, or at which the network repeats its PDU.
    """
    mapped = [
        (_refs_of(tree, node, element, file), tree.at(element, file))
        for node in tree.tagged("SYSTEM-MAPPING")
        for element, file in tree.elements(node, _SIGNALS)
    ]
    written: dict[str, tuple[str, ...]] = {}
    for refs, _ in mapped:
        if refs is not None:
            component, port, signal = refs
            every = senders.get((component.path, port.path), ())
            written[signal.path] = tuple(dict.fromkeys((*written.get(signal.path, ()), *every)))
    repeated = _repeated(tree)
    for refs, at in mapped:
        if refs is None or refs[0].path not in prototypes:
            continue
        component, port, signal = refs
        is_out = port.dest != "R-PORT-PROTOTYPE"
        every = written.get(signal.path) or repeated.get(signal.path, ())
        tree.findings.report(
            codes.BOUNDARY,
            f"{component.name}/{port.name} {'sends' if is_out else 'receives'} the signal {signal.path}"
            + (f" every {', '.join(every)}" if every else ", at no period that is known"),
            at=at,
            path=named("output" if is_out else "input", signal.name),
        )


def _refs_of(tree: Tree, node: Node, element: etree._Element, file: str) -> tuple[Ref, Ref, Ref] | None:
    """Return the component, the port and the signal of a data mapping, None if one is missing."""
    found = {
        child.tag.rpartition("}")[2]: tree.reference(node, child, file)
        for child in element.iter(*(f"{{*}}{tag}" for tag in _REFS))
    }
    component, port, signal = (found.get(tag) for tag in _REFS)
    return None if component is None or port is None or signal is None else (component, port, signal)


def _repeated(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return the periods at which the network repeats the PDUs of system signals; a large input keeps no PDUs."""
    signals: dict[str, str] = {}
    for node in tree.tagged("I-SIGNAL"):
        ref = tree.ref(node, "SYSTEM-SIGNAL-REF")
        if ref is not None:
            signals[node.path] = ref.path
    found: dict[str, tuple[str, ...]] = {}
    for node in tree.tagged("I-SIGNAL-I-PDU"):
        stated = [period for path in _CYCLES for e, _ in tree.elements(node, path) if (period := _period(e.text))]
        for inside in node.inside("I-SIGNAL-TO-I-PDU-MAPPING") if stated else ():
            for ref in tree.refs(inside, "I-SIGNAL-REF"):
                path = signals.get(ref.path, "")
                found[path] = tuple(dict.fromkeys((*found.get(path, ()), *stated)))
    return found


def _period(text: str | None) -> str:
    period = parse_seconds((text or "").strip())
    return str(period) if period else ""
