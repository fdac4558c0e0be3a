"""Pinned jobs: they keep the place that a person gave them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from halpipe.core.durations import Duration


@record
class Pin:
    """A job with its start and, where it was moved to another one, its unit."""

    mode: str
    task: str
    index: int
    start: Duration
    unit: str = ""
