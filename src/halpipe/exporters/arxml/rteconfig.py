"""The ECU configuration of the Rte: which OsTask runs which event, and the expiry point that activates it first.

A mapping names one expiry point at most, though a task may start at several; its OsTask is activated by all of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import is_from
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
    elements: etree._Element, model: TaskModel, plan: Plan, layout: Layout, names: OsNames, prefix: str, release: str
) -> None:
    """Append the configuration of the Rte for every periodic task; those on demand have no event to map."""
    points: dict[str, str] = {}
    for table in plan.tables:
        for point in table.points:
            for name in point.tasks:
                points.setdefault(name, names.point(table, point.offset))
    os_tasks: dict[str, list[str]] = {}
    for name, work in plan.tasks.items():
        os_tasks.setdefault(work.task, []).append(name)
    module = Module(elements, "Rte", prefix, layout.path(PACKAGE))
    _write_general(module, release)
    for task in model.tasks:
        if task.period is None or task.name not in os_tasks:
            continue
        instance = module.container("RteSwComponentInstance", layout.tasks[task.name])
        instance.define()
        instance.refer_outside("RteSoftwareComponentInstanceRef", layout.prototype(task.name), "SW-COMPONENT-PROTOTYPE")
        for name in os_tasks[task.name]:
            _mapping(instance, task, name, points[name], layout, names)


def _mapping(instance: Container, task: Task, name: str, point: str, layout: Layout, names: OsNames) -> None:
    mapping = instance.inside("RteEventToTaskMapping", name)
    mapping.integer("RtePositionInTask", 1)
    mapping.flag("RteImmediateRestart", value=False)
    mapping.refer_outside("RteEventRef", layout.event(task.name), "TIMING-EVENT")
    mapping.refer("RteMappedToTaskRef", names.path(name))
    mapping.refer("RteUsedOsSchTblExpiryPointRef", point)


def _write_general(module: Module, release: str) -> None:
    """Append what every configuration of the Rte has to state, and nothing here depends on."""
    general = module.container("RteBswGeneral", "RteBswGeneral")
    general.define()
    for name in ("RteSchMVersionInfoApi", "RteUseComShadowSignalApi"):
        general.flag(name, value=False)
    generation = module.container("RteGeneration", "RteGeneration")
    generation.define()
    generation.choice("RteCalibrationSupport", "NONE")
    generation.integer("RteCodeVendorId", 0)
    for name in ("DevErrorDetect", "DevErrorDetectUninit", "MeasurementSupport", "ValueRangeCheckEnabled"):
        generation.flag(f"Rte{name}", value=False)
    generation.flag("RteVfbTraceEnabled", value=False)
    generation.choice("RteGenerationMode", "COMPATIBILITY_MODE")
    generation.choice("RteOptimizationMode", "RUNTIME")
    if is_from(release, "4.2.2"):
        generation.choice("RteIocInteractionReturnValue", "RTE_IOC")
    start = module.container("RteInitializationBehavior", "RteInitializationBehavior")
    start.define()
    start.choice("RteInitializationStrategy", "RTE_INITIALIZATION_STRATEGY_AT_DATA_DECLARATION")
    start.text("RteSectionInitializationPolicy", "INIT")
    module.container("RteOsInteraction", "RteOsInteraction").define()
