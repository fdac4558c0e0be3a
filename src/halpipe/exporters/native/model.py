"""Writer of the task model XML (schema task-model-1.xsd); what it writes reads back to an equal model."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Any

from halpipe.exporters.native.document import Writer, add, attributes_of, document, serialise
from halpipe.models import Task, TaskModel, Version
from halpipe.models.attributes import DURATIONS, attributes, children, texts
from halpipe.schemas import TASK_MODEL

if TYPE_CHECKING:
    from lxml import etree


def format_model(model: TaskModel) -> bytes:
    """Return the canonical XML of a task model."""
    root = document(TASK_MODEL, attributes_of(model))
    writer = _ModelWriter(model.tasks)
    for section, held in groupby(children(TaskModel), key=lambda one: one.section):
        rows = [(one.tag, each) for one in held if not one.is_single for each in getattr(model, one.field)]
        if rows or section in _ALWAYS:
            holder = add(root, section, writer.common if section == "tasks" else {})
            for tag, each in rows:
                writer.element(holder, tag, each)
    if model.origin is not None:
        writer.element(root, "origin", model.origin)
    return serialise(root, TASK_MODEL)


_ALWAYS = ("platform", "tasks", "modes")
"""Sections that stand in each file."""


class _ModelWriter(Writer):
    """Adds what is no plain attribute: where versions may be split; what all tasks have in common is written once."""

    def __init__(self, tasks: tuple[Task, ...]) -> None:
        self.common: dict[str, str] = {}
        common = [stated for stated in attributes(Task) if stated.is_common]
        said_of = [texts(task) for task in tasks] if common else []
        for stated in common:
            said = {stating.get(stated.name) for stating in said_of}
            self.common.update((stated.name, text) for text in said if text is not None and len(said) == 1)

    def attributes(self, value: Any) -> dict[str, str]:
        """Return the attributes of an element."""
        found = attributes_of(value)
        if isinstance(value, Task):
            return {name: text for name, text in found.items() if name not in self.common}
        if isinstance(value, Version):
            where = "anywhere" if value.split.anywhere else DURATIONS.text(value.split.points)
            return {**found, **({"split": where} if where else {}), **attributes_of(value.split)}
        return found

    def element(self, parent: etree._Element, tag: str, value: Any) -> etree._Element:
        """Append an element as a child; the units of a version stand before what else it has."""
        element = super().element(parent, tag, value)
        if isinstance(value, Version) and (units := attributes_of(value, "units")):
            element.insert(0, add(element, "units", units))
        return element
