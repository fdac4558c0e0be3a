"""The system of a model: short names and paths, hardware, modes, components with versions, and the composition."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, add_time, freeze, is_from, named, package, ref, seconds_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lxml import etree

    from halpipe.models import Task, TaskModel, Transition, Version

_OTHER = re.compile(r"[^A-Za-z0-9]+")
EVENT = "Every"
"""What the event of every periodic task is called, beside its runnable."""

_LONGEST = 100  # of the 128 that AUTOSAR allows, so that numbers and suffixes fit


class ShortNames:
    """Hands out identifiers of AUTOSAR, unique without regard to case among those of one namespace."""

    def __init__(self, *reserved: str) -> None:
        self._taken = {name.lower() for name in reserved}
        self._next: dict[str, int] = {}

    def __call__(self, *names: str) -> str:
        """Return the short name that comes next to the names, joined."""
        base = short(*names)
        chosen, key = base, base.lower()
        while chosen.lower() in self._taken:
            self._next[key] = self._next.get(key, 1) + 1
            chosen = f"{base}_{self._next[key]}"
        self._taken.add(chosen.lower())
        return chosen


def short(*names: str) -> str:
    """Return the names as one identifier: a letter, then letters and digits with single ``_`` between them."""
    text = _OTHER.sub("_", "_".join(names)).strip("_")
    text = text if text[:1].isalpha() else f"x_{text}".rstrip("_")
    return text[:_LONGEST].rstrip("_")


class Layout:
    """The short names of the elements of a model, the paths that follow from them, and the texts written so far."""

    def __init__(self, model: TaskModel) -> None:
        self.root = short(model.name)
        self.texts: list[bytes] = []
        platform = ShortNames("ProcessingUnit", "Memory")
        self.units = _each((unit.name for unit in model.units), platform)
        self.resources = _each((resource.name for resource in model.resources), platform)
        self.groups = {units: platform(_name_of(units, model)) for units in _groups(model)}
        self.tasks = _each((task.name for task in model.tasks), ShortNames(EVENT))
        self.modes = _each((mode.name for mode in model.modes), ShortNames())
        names = ShortNames()
        self.versions = {
            (task.name, version.name): names(self.tasks[task.name], version.name)
            for task in model.tasks
            for version in task.versions
        }

    def path(self, *steps: str) -> str:
        """Return the path of what stands in a package of the model."""
        return "/".join(("", self.root, *steps))

    def unit(self, name: str) -> str:
        """Return the path of the HW-ELEMENT of a unit."""
        return self.path("Platform", self.units[name])

    def hardware(self, units: Iterable[str]) -> str:
        """Return the short name of the HW-ELEMENT of one unit, or of several; empty for all of them."""
        chosen = frozenset(units)
        own = self.units[next(iter(chosen))] if len(chosen) == 1 else self.groups.get(chosen, "")
        return own if len(chosen) < len(self.units) else ""

    def component(self, task: str) -> str:
        """Return the path of the component type of a task."""
        return self.path("Components", self.tasks[task])

    def behavior(self, task: str) -> str:
        """Return the path of the internal behaviour of a task."""
        return f"{self.component(task)}/Behavior"

    def runnable(self, task: str) -> str:
        """Return the path of the runnable of a task."""
        return f"{self.behavior(task)}/{self.tasks[task]}"

    def event(self, task: str) -> str:
        """Return the path of the TIMING-EVENT of a periodic task."""
        return f"{self.behavior(task)}/{EVENT}"

    def implementation(self, task: str, version: str) -> str:
        """Return the path of the implementation of a version."""
        return self.path("Implementations", self.versions[task, version])

    def prototype(self, task: str) -> str:
        """Return the path of the component prototype of a task."""
        return self.path("System", "Composition", self.tasks[task])

    def mode(self, name: str) -> str:
        """Return the path of the mode declaration of a mode."""
        return self.path("Modes", "Mode", self.modes[name])


def _each(names: Iterable[str], unique: ShortNames) -> dict[str, str]:
    return {name: unique(name) for name in names}


def _groups(model: TaskModel) -> Iterator[frozenset[str]]:
    """Yield the sets of several units, but not all, for which a WCET is stated."""
    sets = dict.fromkeys(frozenset(v.units) for task in model.tasks for v in task.versions if v.wcet is not None)
    return (units for units in sets if 1 < len(units) < len(model.units))


def _name_of(units: frozenset[str], model: TaskModel) -> str:
    """Return the type of the units, if they have the same."""
    types = {unit.type for unit in model.units if unit.name in units}
    return types.pop() or "Units" if len(types) == 1 else "Units"


def write_platform(packages: etree._Element, model: TaskModel, layout: Layout) -> None:
    """Append the package of the hardware."""
    elements = package(packages, "Platform")
    for category in ("ProcessingUnit", "Memory"):
        named(elements, "HW-CATEGORY", category)
    for unit in model.units:
        _element(elements, layout, layout.units[unit.name], "ProcessingUnit")
    for resource in model.resources:
        _element(elements, layout, layout.resources[resource.name], "Memory")
    for units, name in layout.groups.items():
        nested = add(named(elements, "HW-ELEMENT", name), "NESTED-ELEMENTS")
        for inner in (unit.name for unit in model.units if unit.name in units):
            ref(add(nested, "HW-ELEMENT-REF-CONDITIONAL"), "HW-ELEMENT-REF", "HW-ELEMENT", layout.unit(inner))


def _element(elements: etree._Element, layout: Layout, short_name: str, category: str) -> None:
    element = named(elements, "HW-ELEMENT", short_name)
    path = layout.path("Platform", category)
    ref(add(element, "HW-CATEGORY-REFS"), "HW-CATEGORY-REF", "HW-CATEGORY", path)


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
        if task.offset is not None and is_from(release, "4.4.0"):
            add(event, "OFFSET", seconds_text(task.offset)[0])
        add(event, "PERIOD", seconds_text(task.period)[0])
    runnable = named(add(behavior, "RUNNABLES"), "RUNNABLE-ENTITY", layout.tasks[task.name])
    add(runnable, "SYMBOL", layout.tasks[task.name])
    freeze(component, layout.texts)


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
        hardware = layout.hardware(version.units)
        time = named(times, "ANALYZED-EXECUTION-TIME", hardware or "Wcet")
        ref(time, "EXECUTABLE-ENTITY-REF", "RUNNABLE-ENTITY", layout.runnable(task.name))
        if hardware:  # a time without it is of all units
            ref(time, "HW-ELEMENT-REF", "HW-ELEMENT", layout.path("Platform", hardware))
        add_time(time, "WORST-CASE-EXECUTION-TIME", version.wcet, up=True)
    ref(element, "BEHAVIOR-REF", "SWC-INTERNAL-BEHAVIOR", layout.behavior(task.name))
    freeze(element, layout.texts)


# ------------------------------------------------------------------------------------------------------ system


def _system(elements: etree._Element, model: TaskModel, layout: Layout) -> None:
    composition = named(elements, "COMPOSITION-SW-COMPONENT-TYPE", "Composition")
    if model.tasks:
        prototypes = add(composition, "COMPONENTS")
        for task in model.tasks:
            prototype = named(prototypes, "SW-COMPONENT-PROTOTYPE", layout.tasks[task.name])
            ref(prototype, "TYPE-TREF", "APPLICATION-SW-COMPONENT-TYPE", layout.component(task.name))
            freeze(prototype, layout.texts)
    system = named(elements, "SYSTEM", "System")
    root = named(add(system, "ROOT-SOFTWARE-COMPOSITIONS"), "ROOT-SW-COMPOSITION-PROTOTYPE", layout.root)
    ref(root, "SOFTWARE-COMPOSITION-TREF", "COMPOSITION-SW-COMPONENT-TYPE", layout.path("System", "Composition"))
