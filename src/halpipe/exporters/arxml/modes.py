"""Modes as one mode declaration group, and the interface through which components learn of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, is_from, named, package, ref
from halpipe.exporters.arxml.layout import ShortNames

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.models import TaskModel, Transition


def disabled_modes(model: TaskModel) -> dict[str, list[str]]:
    """Return the modes in which each periodic task does not run, which is how AUTOSAR says it."""
    running = {mode.name: {run.task for run in mode.runs} for mode in model.modes}
    return {
        task.name: [mode.name for mode in model.modes if task.name not in running[mode.name]]
        for task in model.tasks
        if task.period is not None
    }


def write_modes(packages: etree._Element, model: TaskModel, layout: Layout, release: str) -> None:
    """Append the package of the modes, if there are any."""
    if not model.modes:
        return
    elements = package(packages, "Modes")
    declared = named(elements, "MODE-DECLARATION-GROUP", "Mode")
    ref(declared, "INITIAL-MODE-REF", "MODE-DECLARATION", layout.mode(model.modes[0].name))
    modes = add(declared, "MODE-DECLARATIONS")
    for mode in model.modes:
        named(modes, "MODE-DECLARATION", layout.modes[mode.name])
    if is_from(release, "4.2.2") and model.transitions:
        transitions, names = add(declared, "MODE-TRANSITIONS"), ShortNames(*layout.modes.values())
        for transition in model.transitions:
            _transition(transitions, transition, layout, names)
    interface = named(elements, "MODE-SWITCH-INTERFACE", "ModeSwitch")
    add(interface, "IS-SERVICE", "false")
    prototype = named(interface, "MODE-GROUP", "Mode")
    ref(prototype, "TYPE-TREF", "MODE-DECLARATION-GROUP", layout.path("Modes", "Mode"))


def _transition(parent: etree._Element, transition: Transition, layout: Layout, names: ShortNames) -> None:
    short_name = names(layout.modes[transition.source], "to", layout.modes[transition.target])
    element = named(parent, "MODE-TRANSITION", short_name)
    ref(element, "ENTERED-MODE-REF", "MODE-DECLARATION", layout.mode(transition.target))
    ref(element, "EXITED-MODE-REF", "MODE-DECLARATION", layout.mode(transition.source))
