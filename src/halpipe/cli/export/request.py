"""What the user asks of an exporter, and how a command takes it."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.exporters.common.base import Exporter, ExportOptions


@record
class Request:
    """What the user asks of an exporter: the files, and the options of the format; `given` are the further ones."""

    exporter: Exporter
    model: str
    schedule: str
    target: str
    options: ExportOptions
    given: Mapping[str, Any]


def parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    """Return a parameter of a command."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
