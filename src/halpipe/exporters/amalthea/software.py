"""The software model: tasks, a runnable for each version, labels, modes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.exporters.amalthea.document import Unique, Written, add, add_property, named, ref
from halpipe.exporters.amalthea.stimuli import MODE_LABEL, Stimulus, equals, kind_of, version_label
from halpipe.models import Access, AccessKind, ResourceKind, Task, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml import etree


_MODES = "SystemMode"


class Software:
    """Writes the software model; `runnables` gives the name of the runnable of each version of each task."""

    def __init__(self, model: TaskModel, release: str, definitions: Mapping[str, str], written: Written) -> None:
        self._written = written
        self._model = model
        self._switch = "ModeSwitch" if release == "1.2.0" else "Switch"
        self._definitions = definitions  # of the type of each unit
        self._locks = {resource.name for resource in model.resources if resource.kind is ResourceKind.LOCK}
        unique = Unique()
        self.runnables = {
            (task.name, version.name): unique(f"{task.name}/{version.name}")
            for task in model.tasks
            for version in task.versions
        }

    def write(self, parent: etree._Element, stimuli: Mapping[str, Sequence[Stimulus]]) -> None:
        """Append tasks, runnables, labels and modes."""
        for task in self._model.tasks:
            self._task(parent, task, stimuli[task.name])
            self._written.children(parent)
        for task in self._model.tasks:
            for version in task.versions:
                self._runnable(parent, task, version)
                self._written.children(parent)
        for name, size in self._labels().items():
            add(named(parent, "labels", "Label", name), "size", value=size, unit="B")
            self._written.children(parent)
        self._modes(parent, stimuli)

    def _task(self, parent: etree._Element, task: Task, stimuli: Sequence[Stimulus]) -> None:
        element = named(parent, "tasks", "Task", task.name)
        if stimuli:
            element.set("stimuli", " ".join(ref(kind_of(stimulus), stimulus.name) for stimulus in stimuli))
        element.set("preemption", _preemption(task))
        graph = add(element, "activityGraph")
        if len(task.versions) == 1:
            self._call(graph, task, task.versions[0])
        elif task.versions:
            switch = add(graph, "items", self._switch)
            for version in task.versions:
                entry = add(switch, "entries", name=version.name)
                self._call(entry, task, version)
                equals(add(entry, "condition"), version_label(task.name), version.name)

    def _call(self, parent: etree._Element, task: Task, version: Version) -> None:
        name = self.runnables[task.name, version.name]
        add(parent, "items", "RunnableCall", runnable=ref("Runnable", name))

    def _runnable(self, parent: etree._Element, task: Task, version: Version) -> None:
        element = named(parent, "runnables", "Runnable", self.runnables[task.name, version.name])
        graph = add(element, "activityGraph")
        is_timed = task.let is not None
        _label_accesses(graph, version.accesses, "read", is_timed=is_timed)
        if is_timed and not any(access.transfers for access in version.accesses):
            _label_access(graph, _let_label(task), "read", is_timed=True)
        self._work(graph, version)
        _label_accesses(graph, version.accesses, "write", is_timed=is_timed)

    def _work(self, parent: etree._Element, version: Version) -> None:
        """Append the WCET in ticks of 1 ns, parted where locks are requested and released."""
        if version.wcet is None:
            return
        held = [access for access in version.accesses if access.resource in self._locks]
        at = ZERO
        for instant in sorted({*(a.start for a in held), *(a.end for a in held), version.wcet}):
            self._ticks(parent, version, math.ceil(instant.ns) - math.ceil(at.ns))
            at = instant
            for access in held:
                if access.end == instant:
                    _semaphore_access(parent, access, "release")
            for access in held:
                if access.start == instant:
                    _semaphore_access(parent, access, "request")

    def _ticks(self, parent: etree._Element, version: Version, ticks: int) -> None:
        """Append ticks for every kind of unit that may run the version."""
        if not ticks:
            return
        element = add(parent, "items", "Ticks")
        definitions = dict.fromkeys(self._definitions[unit] for unit in version.units)
        for definition in definitions:
            entry = add(element, "extended", key=ref("ProcessingUnitDefinition", definition))
            add(entry, "value", "DiscreteValueConstant", value=ticks)
        if not definitions:
            add(element, "default", "DiscreteValueConstant", value=ticks)

    def _labels(self) -> dict[str, int]:
        """Return every buffer that is transferred, with the size of its largest transfer."""
        sizes: dict[str, int] = {}
        for task in self._model.tasks:
            versions = [v for v in task.versions if not any(access.transfers for access in v.accesses)]
            if task.let is not None and versions:
                sizes[_let_label(task)] = 1
            for access in (access for version in task.versions for access in version.accesses):
                for transfer in access.transfers:
                    sizes[transfer.buffer] = max(transfer.size, sizes.get(transfer.buffer, 0))
        return sizes

    def _modes(self, parent: etree._Element, stimuli: Mapping[str, Sequence[Stimulus]]) -> None:
        model = self._model
        several = [task for task in model.tasks if len(task.versions) > 1]
        if model.modes:
            modes = named(parent, "modes", "EnumMode", _MODES, typed=True)
            for mode in model.modes:
                add(modes, "literals", name=mode.name)
        for task in several:
            modes = named(parent, "modes", "EnumMode", version_label(task.name), typed=True)
            for version in task.versions:
                add(modes, "literals", name=version.name)
            self._written.children(parent)
        if model.modes:
            _label(parent, MODE_LABEL, _MODES, model.modes[0].name, "mode")
        for task in several:
            chosen = next((s.version for s in stimuli[task.name] if s.version), task.versions[0].name)
            _label(parent, version_label(task.name), version_label(task.name), chosen, "version")
            self._written.children(parent)


def _label(parent: etree._Element, name: str, mode: str, initial: str, role: str) -> None:
    element = named(parent, "modeLabels", "ModeLabel", name)
    element.set("mode", ref("EnumMode", mode))
    element.set("initialValue", initial)
    add_property(element, "role", role)


def _label_accesses(parent: etree._Element, accesses: Sequence[Access], access: str, *, is_timed: bool) -> None:
    """Append the transfers of a direction; what is not written is read."""
    for phase in accesses:
        if (phase.kind is AccessKind.WRITE) is (access == "write"):
            for transfer in phase.transfers:
                _label_access(parent, transfer.buffer, access, is_timed=is_timed)


def _label_access(parent: etree._Element, label: str, access: str, *, is_timed: bool) -> None:
    element = add(parent, "items", "LabelAccess", data=ref("Label", label), access=access)
    if is_timed:
        element.set("implementation", "timed")


def _let_label(task: Task) -> str:
    """Return the name of a label for the timed access of a task that transfers no other."""
    return f"{task.name}/let"


def _semaphore_access(parent: etree._Element, held: Access, access: str) -> None:
    add(parent, "items", "SemaphoreAccess", semaphore=ref("Semaphore", held.resource), access=access)


def _preemption(task: Task) -> str:
    """Return how far AMALTHEA can say where a task may be interrupted."""
    if any(version.split.anywhere for version in task.versions):
        return "preemptive"
    return "cooperative" if any(version.split.points for version in task.versions) else "non_preemptive"
