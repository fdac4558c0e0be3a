"""Regulators in the bundle of the cores: the same tables in a folder of it, driven by the runtime of the cores."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.bundles import MODEL, SCHEDULE
from halpipe.core.files import MANIFEST
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.exporters.regulator.platform import Platform, read_platform

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

FOLDER = "regulator/"


def embedded(model: TaskModel, schedule: Schedule, path: str) -> tuple[dict[str, bytes], Platform | None]:
    """Return the files of the regulators of a platform, by name in the bundle of the cores; none without a path."""
    if not path:
        return {}, None
    files = RegulatorExporter().write(model, schedule, RegulatorOptions(platform=path))
    own = (MANIFEST, MODEL, SCHEDULE)
    return {f"{FOLDER}{name}": data for name, data in files.items() if name not in own}, read_platform(path)
