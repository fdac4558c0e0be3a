"""Units and resources as hardware elements."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, group, named, origin_of, package, ref, sd, special
from halpipe.quantities import format_bandwidth

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.models import Origin, TaskModel


def write_platform(packages: etree._Element, model: TaskModel, layout: Layout) -> None:
    """Append the package of the hardware."""
    elements = package(packages, "Platform")
    for category in ("ProcessingUnit", "Memory"):
        named(elements, "HW-CATEGORY", category)
    for unit in model.units:
        data = {"name": unit.name, "type": unit.type or None}
        group_of = _element(elements, layout, layout.units[unit.name], "unit", "ProcessingUnit", data, unit.origin)
        for interrupt in unit.interrupts:
            inner = group(group_of, "interrupt")
            sd(inner, "name", interrupt.name)
            sd(inner, "distance", interrupt.distance)
            sd(inner, "wcet", interrupt.wcet)
            origin_of(inner, interrupt.origin)
    for resource in model.resources:
        bandwidth = None if resource.bandwidth is None else format_bandwidth(resource.bandwidth)
        data = {"name": resource.name, "bandwidth": bandwidth}
        _element(elements, layout, layout.resources[resource.name], "resource", "Memory", data, resource.origin)


def _element(
    elements: etree._Element,
    layout: Layout,
    short_name: str,
    kind: str,
    category: str,
    data: dict[str, str | None],
    origin: Origin | None,
) -> etree._Element:
    element = named(elements, "HW-ELEMENT", short_name)
    found = special(element, kind)
    for key, value in data.items():
        sd(found, key, value)
    origin_of(found, origin)
    path = layout.path("Platform", category)
    ref(add(element, "HW-CATEGORY-REFS"), "HW-CATEGORY-REF", "HW-CATEGORY", path)
    return found
