"""Units and resources as hardware elements."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, named, origin_of, package, ref, sd, special
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
        _element(elements, layout, layout.units[unit.name], "unit", "ProcessingUnit", data, unit.origin)
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
) -> None:
    element = named(elements, "HW-ELEMENT", short_name)
    group = special(element, kind)
    for key, value in data.items():
        sd(group, key, value)
    origin_of(group, origin)
    path = layout.path("Platform", category)
    ref(add(element, "HW-CATEGORY-REFS"), "HW-CATEGORY-REF", "HW-CATEGORY", path)
