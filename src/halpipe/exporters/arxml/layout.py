"""Short names and paths: where every element of a model stands in the ARXML file, so that others can refer to it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import TaskModel

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
    """The short names of the elements of a model, and the paths that follow from them."""

    def __init__(self, model: TaskModel) -> None:
        self.root = short(model.name)
        platform = ShortNames("ProcessingUnit", "Memory")
        self.units = _each((unit.name for unit in model.units), platform)
        self.resources = _each((resource.name for resource in model.resources), platform)
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

    def resource(self, name: str) -> str:
        """Return the path of the HW-ELEMENT of a resource."""
        return self.path("Platform", self.resources[name])

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
