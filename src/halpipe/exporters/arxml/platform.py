"""Units and resources as hardware elements."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, group, named, origin_of, package, ref, sd_attributes, special

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.models import Resource, TaskModel, Unit


def write_platform(packages: etree._Element, model: TaskModel, layout: Layout) -> None:
    """Append the package of the hardware."""
    elements = package(packages, "Platform")
    for category in ("ProcessingUnit", "Memory"):
        named(elements, "HW-CATEGORY", category)
    for unit in model.units:
        group_of = _element(elements, layout, layout.units[unit.name], "unit", "ProcessingUnit", unit)
        for interrupt in unit.interrupts:
            inner = group(group_of, "interrupt")
            sd_attributes(inner, interrupt)
            origin_of(inner, interrupt.origin)
    for resource in model.resources:
        _element(elements, layout, layout.resources[resource.name], "resource", "Memory", resource)


def _element(
    elements: etree._Element,
    layout: Layout,
    short_name: str,
    kind: str,
    category: str,
    stated: Unit | Resource,
) -> etree._Element:
    element = named(elements, "HW-ELEMENT", short_name)
    found = special(element, kind)
    sd_attributes(found, stated)
    origin_of(found, stated.origin)
    path = layout.path("Platform", category)
    ref(add(element, "HW-CATEGORY-REFS"), "HW-CATEGORY-REF", "HW-CATEGORY", path)
    return found
