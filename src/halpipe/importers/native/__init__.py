"""Readers of halpipe's own XML: the task model and the schedule. They mirror halpipe.exporters.native."""

from halpipe.importers.native.model import parse_model, read_model, read_what_is_well_formed
from halpipe.importers.native.schedule import parse_schedule, read_schedule

__all__ = ["parse_model", "parse_schedule", "read_model", "read_schedule", "read_what_is_well_formed"]
