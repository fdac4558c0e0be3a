"""Data flow between runnables: along connectors, and within a component."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.system.values import Composition, Connector, DataItem, System

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
        read = [(runnable.place.path, data) for runnable in instance.component.runnables for data in runnable.reads]
        read += [
            (e.runnable, e.data) for e in instance.component.events if e.data is not None and e.runnable is not None
        ]
        for path, data in read:
            known = readers.setdefault(item_at(instance.context, data), [])
            if (instance.context, path) not in known:
                known.append((instance.context, path))
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


def find_providers(system: System) -> dict[Port, Port]:
    """Return, for each port that connectors lead to, the port at which what arrives there is provided."""
    before = {target: source for source, ends in _port_graph(system).items() for target, _ in ends}
    found = {}
    for port in before:
        way = [port]
        while way[-1] in before and before[way[-1]] not in way:
            way.append(before[way[-1]])
        found[port] = way[-1]
    return found


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
