"""Units and resources as hardware elements."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, named, package, ref

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.models import TaskModel


def write_platform(packages: etree._Element, model: TaskModel, layout: Layout) -> None:
    """Append the package of the hardware."""
    elements = package(packages, "Platform")
    for category in ("ProcessingUnit", "Memory"):
        named(elements, "HW-CATEGORY", category)
    for unit in model.units:
        _element(elements, layout, layout.units[unit.name], "ProcessingUnit")
    for resource in model.resources:
        _element(elements, layout, layout.resources[resource.name], "Memory")


def _element(elements: etree._Element, layout: Layout, short_name: str, category: str) -> None:
    element = named(elements, "HW-ELEMENT", short_name)
    path = layout.path("Platform", category)
    ref(add(element, "HW-CATEGORY-REFS"), "HW-CATEGORY-REF", "HW-CATEGORY", path)
