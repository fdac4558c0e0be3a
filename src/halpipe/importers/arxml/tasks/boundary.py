"""What the chosen ECU shares with others: data that crosses between component instances, and signals of the network."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.diagnostics import named
from halpipe.importers.arxml import selection_codes as codes
from halpipe.importers.arxml.files.numbers import parse_seconds
from halpipe.importers.arxml.tasks.dataflow import find_dataflow

if TYPE_CHECKING:
    from halpipe.importers.arxml.files.tree import Tree
    from halpipe.importers.arxml.system.values import System

_SIGNALS = "DATA-MAPPINGS/SENDER-RECEIVER-TO-SIGNAL-MAPPING"
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
    _report_signals(tree, {path for context in own for path in context[1:]})


def _report_signals(tree: Tree, prototypes: set[str]) -> None:
    """Report the signals of the network that the instances of the ECU send and receive."""
    for node in tree.tagged("SYSTEM-MAPPING"):
        for element, file in tree.elements(node, _SIGNALS):
            found = {
                child.tag.rpartition("}")[2]: tree.reference(node, child, file)
                for child in element.iter(*(f"{{*}}{tag}" for tag in _REFS))
            }
            component, port, signal = (found.get(tag) for tag in _REFS)
            if component is None or port is None or signal is None or component.path not in prototypes:
                continue
            is_out = port.dest != "R-PORT-PROTOTYPE"
            tree.findings.add(
                codes.BOUNDARY(
                    f"{component.name}/{port.name} {'sends' if is_out else 'receives'} the signal {signal.path}",
                    at=tree.at(element, file),
                    path=named("output" if is_out else "input", signal.name),
                )
            )
