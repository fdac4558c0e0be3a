"""The ECU configuration of the Rte: which OsTask runs which event, activated by which expiry points."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.ecuc import Module
from halpipe.exporters.arxml.osconfig import PACKAGE

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.ecuc import Container
    from halpipe.exporters.arxml.layout import Layout
    from halpipe.exporters.arxml.osconfig import OsNames
    from halpipe.exporters.arxml.tables import Plan
    from halpipe.models import Task, TaskModel


def write_rte(
    elements: etree._Element, model: TaskModel, plan: Plan, layout: Layout, names: OsNames, prefix: str
) -> None:
    """Append the configuration of the Rte for every periodic task; those on demand have no event to map."""
    points: dict[str, list[str]] = {}
    for table in plan.tables:
        for point in table.points:
            for name in point.tasks:
                points.setdefault(name, []).append(names.point(table, point.offset))
    os_tasks: dict[str, list[str]] = {}
    for name, work in plan.tasks.items():
        os_tasks.setdefault(work.task, []).append(name)
    module = Module(elements, "Rte", prefix, layout.path(PACKAGE))
    for task in model.tasks:
        if task.period is None or task.name not in os_tasks:
            continue
        instance = module.container("RteSwComponentInstance", layout.tasks[task.name])
        instance.define()
        instance.refer_outside("RteSoftwareComponentInstanceRef", layout.prototype(task.name), "SW-COMPONENT-PROTOTYPE")
        for name in os_tasks[task.name]:
            _mapping(instance, task, name, points[name], layout, names)


def _mapping(instance: Container, task: Task, name: str, points: list[str], layout: Layout, names: OsNames) -> None:
    mapping = instance.inside("RteEventToTaskMapping", name)
    mapping.integer("RtePositionInTask", 1)
    mapping.refer_outside("RteEventRef", layout.event(task.name), "TIMING-EVENT")
    mapping.refer("RteMappedToTaskRef", names.path(name))
    for point in points:
        mapping.refer("RteUsedOsSchTblExpiryPointRef", point)
