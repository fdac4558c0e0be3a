"""Tasks as component types with one runnable each, versions as their implementations, and the composition of all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import (
    add,
    add_time,
    is_from,
    named,
    package,
    ref,
    seconds_text,
)
from halpipe.exporters.arxml.layout import EVENT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml import etree

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.models import Task, TaskModel, Version


def write_software(
    packages: etree._Element, model: TaskModel, layout: Layout, release: str, disabled: Mapping[str, Sequence[str]]
) -> None:
    """Append the packages of components, implementations and the system; `disabled` gives modes by periodic task."""
    components = package(packages, "Components")
    for task in model.tasks:
        _component(components, task, layout, release, disabled.get(task.name, ()))
    implementations = package(packages, "Implementations")
    for task in model.tasks:
        for version in task.versions:
            _implementation(implementations, task, version, layout)
    _system(package(packages, "System"), model, layout)


def _component(elements: etree._Element, task: Task, layout: Layout, release: str, disabled: Sequence[str]) -> None:
    """Append the component type of a task: AUTOSAR binds component instances, not runnables, to cores."""
    component = named(elements, "APPLICATION-SW-COMPONENT-TYPE", layout.tasks[task.name])
    if disabled:
        port = named(add(component, "PORTS"), "R-PORT-PROTOTYPE", "Mode")
        ref(port, "REQUIRED-INTERFACE-TREF", "MODE-SWITCH-INTERFACE", layout.path("Modes", "ModeSwitch"))
    behavior = named(add(component, "INTERNAL-BEHAVIORS"), "SWC-INTERNAL-BEHAVIOR", "Behavior")
    if task.period is not None:
        event = named(add(behavior, "EVENTS"), "TIMING-EVENT", EVENT)
        if disabled:
            _disable(add(event, "DISABLED-MODE-IREFS"), task, layout, disabled)
        ref(event, "START-ON-EVENT-REF", "RUNNABLE-ENTITY", layout.runnable(task.name))
        if task.offset is not None and is_from(release, "R19-11"):
            add(event, "OFFSET", seconds_text(task.offset)[0])
        add(event, "PERIOD", seconds_text(task.period)[0])
    runnable = named(add(behavior, "RUNNABLES"), "RUNNABLE-ENTITY", layout.tasks[task.name])
    add(runnable, "SYMBOL", layout.tasks[task.name])


def _disable(parent: etree._Element, task: Task, layout: Layout, modes: Sequence[str]) -> None:
    for mode in modes:
        iref = add(parent, "DISABLED-MODE-IREF")
        ref(iref, "CONTEXT-PORT-REF", "R-PORT-PROTOTYPE", f"{layout.component(task.name)}/Mode")
        prototype = layout.path("Modes", "ModeSwitch", "Mode")
        ref(
            iref,
            "CONTEXT-MODE-DECLARATION-GROUP-PROTOTYPE-REF",
            "MODE-DECLARATION-GROUP-PROTOTYPE",
            prototype,
        )
        ref(iref, "TARGET-MODE-DECLARATION-REF", "MODE-DECLARATION", layout.mode(mode))


# ---------------------------------------------------------------------------------------------------- versions


def _implementation(elements: etree._Element, task: Task, version: Version, layout: Layout) -> None:
    element = named(elements, "SWC-IMPLEMENTATION", layout.versions[task.name, version.name])
    if version.wcet is not None:
        resources = named(element, "RESOURCE-CONSUMPTION", "Resources")
        times = add(resources, "EXECUTION-TIMES")
        for unit in dict.fromkeys(version.units) or ("",):
            time = named(times, "ANALYZED-EXECUTION-TIME", layout.units[unit] if unit else "Wcet")
            ref(time, "EXECUTABLE-ENTITY-REF", "RUNNABLE-ENTITY", layout.runnable(task.name))
            if unit:
                ref(time, "HW-ELEMENT-REF", "HW-ELEMENT", layout.unit(unit))
            add_time(time, "WORST-CASE-EXECUTION-TIME", version.wcet, up=True)
    ref(element, "BEHAVIOR-REF", "SWC-INTERNAL-BEHAVIOR", layout.behavior(task.name))


# ------------------------------------------------------------------------------------------------------ system


def _system(elements: etree._Element, model: TaskModel, layout: Layout) -> None:
    composition = named(elements, "COMPOSITION-SW-COMPONENT-TYPE", "Composition")
    if model.tasks:
        prototypes = add(composition, "COMPONENTS")
        for task in model.tasks:
            prototype = named(prototypes, "SW-COMPONENT-PROTOTYPE", layout.tasks[task.name])
            ref(prototype, "TYPE-TREF", "APPLICATION-SW-COMPONENT-TYPE", layout.component(task.name))
    system = named(elements, "SYSTEM", "System")
    root = named(add(system, "ROOT-SOFTWARE-COMPOSITIONS"), "ROOT-SW-COMPOSITION-PROTOTYPE", layout.root)
    ref(root, "SOFTWARE-COMPOSITION-TREF", "COMPOSITION-SW-COMPONENT-TYPE", layout.path("System", "Composition"))
