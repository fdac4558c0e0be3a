"""Boundary of the chosen ECU: data that crosses between component instances, and signals of the network."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.arxml import selection_codes as codes
from halpipe.importers.arxml.files.numbers import parse_seconds
from halpipe.importers.arxml.tasks.dataflow import find_dataflow

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml import etree

    from halpipe.importers.arxml.files.tree import Node, Ref, Tree
    from halpipe.importers.arxml.system.values import Instance, System

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
        tree.findings.add(
            codes.BOUNDARY(
                f"{here} {'sends data to' if is_out else 'receives data of'} {there} on another ECU"
                + (f" every {every}" if every else ", at no period that is known"),
                at=places[inner[1]].at,
                path=named("output" if is_out else "input", here),
            )
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
        tree.findings.add(
            codes.BOUNDARY(
                f"{component.name}/{port.name} {'sends' if is_out else 'receives'} the signal {signal.path}"
                + (f" every {', '.join(every)}" if every else ", at no period that is known"),
                at=at,
                path=named("output" if is_out else "input", signal.name),
            )
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
