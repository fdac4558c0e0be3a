"""Writers of halpipe's own XML: the task model and the schedule. They mirror halpipe.importers.native."""

from halpipe.exporters.native.model import format_model
from halpipe.exporters.native.schedule import format_schedule

__all__ = ["format_model", "format_schedule"]
