"""Execution on models of devices: a bundle is loaded, and grants are compared with the schedule.

Each model is written from the device's documentation and knows nothing of the exporter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Code, Diagnostic
    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.facts import Facts
    from halpipe.deploy.regulator.reading import Tables


AGAIN = "export the bundle again; what is loaded was changed, or the exporter is wrong: report it"


@dataclass(slots=True)
class Case:
    """What a device is loaded with, and what it must then grant; `findings` are collected, `steps` counted."""

    bundle: Bundle
    tables: Tables
    facts: Facts
    planned: Sequence[Planned]
    findings: list[Diagnostic] = field(default_factory=list)
    steps: int = 0
    caveat: str = ""
    """What a grant of this device depends on, for the line of the verdict; empty: nothing beside the tables."""

    @property
    def folder(self) -> str:
        """The folder of the bundle that is loaded."""
        return self.tables.backend

    def note(self, code: Code, name: str, text: str, *, line: int = 0, path: str = "", help: str = AGAIN) -> None:
        """Add a finding about a file of the folder."""
        at = self.bundle.at(f"{self.folder}/{name}", line) if line else self.bundle.at(f"{self.folder}/{name}")
        self.findings.append(code(text, at=at, path=path, help=help))


class Device(Protocol):
    """A model of a device: executes what is loaded and notes what is wrong in the case."""

    def __call__(self, case: Case) -> None:
        """Execute everything that the folder of the back-end has."""
        ...


def device(backend: str) -> Device | None:
    """Return the model of what a back-end writes for, None if its Verilog is simulated instead."""
    from halpipe.devices import DEVICES

    if backend not in DEVICES or find_spec(f"{__package__}.{DEVICES[backend].folder}") is None:
        return None
    return cast("Device", import_module(f"{__package__}.{DEVICES[backend].folder}.model").execute)
