"""The standard modules of an ECU configuration: Os, Rte and EcuC are known by the names of their containers.

Vendors put their own names before the module name of a definition (/MICROSAR/Os), and some rename the module (iRte),
but a definition refined from the standard keeps the short names of the standard's containers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MODULES = ("Os", "Rte", "EcuC")
# Containers that stand directly in the module, and in no other.
_CONTAINERS = {
    **dict.fromkeys(("RteSwComponentInstance", "RteBswModuleInstance", "RteOsInteraction"), "Rte"),
    **dict.fromkeys(("EcucHardware", "EcucPartitionCollection"), "EcuC"),
    **dict.fromkeys(
        (
            "OsAlarm",
            "OsAppMode",
            "OsApplication",
            "OsCounter",
            "OsEvent",
            "OsIsr",
            "OsOS",
            "OsResource",
            "OsScheduleTable",
            "OsSpinlock",
            "OsTask",
        ),
        "Os",
    ),
}


def steps_of(definition: str | None) -> list[str]:
    """Return the short names of the path of a definition."""
    return "".join((definition or "").split()).split("/")


def module_of(steps: Sequence[str]) -> str:
    """Return the standard module of a definition, empty for any other."""
    named = next((module for module in MODULES if module in steps), "")
    return named or next((_CONTAINERS[step] for step in steps if step in _CONTAINERS), "")


def module_with(definition: str | None, containers: Iterable[str]) -> str:
    """Return the standard module of a module configuration, by its definition, else by those of its containers."""
    named = module_of(steps_of(definition)[-1:])
    return named or next((_CONTAINERS[name] for name in containers if name in _CONTAINERS), "")
