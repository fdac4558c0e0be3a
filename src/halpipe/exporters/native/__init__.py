"""Writers of halpipe's own XML: the task model and the schedule. They mirror halpipe.importers.native."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.exporters.native.model import format_model
from halpipe.exporters.native.schedule import format_schedule

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

__all__ = ["format_model", "format_schedule", "paired"]


def paired(model: TaskModel, schedule: Schedule) -> dict[str, bytes]:
    """Return ``model.xml`` and ``schedule.xml``, tied to each other by hash, for a folder that stands alone."""
    from halpipe.core.files import sha256

    written = format_model(model)
    return {
        "model.xml": written,
        "schedule.xml": format_schedule(replace(schedule, model_sha256=sha256(written))),
    }
