"""Single values of the export's options, as the command line and pipeline files state them."""

from __future__ import annotations

from halpipe.quantities import quoted

HIGHEST_PRIORITY = 98
"""The conductor has a priority above those of the tasks, and 99 is the highest (sched(7))."""


def _whole(text: str, low: int, high: int, what: str) -> int:
    if not (text.strip().isascii() and text.strip().isdigit() and low <= int(text.strip()[:9]) <= high):
        raise ValueError(f"{quoted(text)} is no {what}; write a number from {low} to {high}")
    return int(text)


def priority(text: str) -> int:
    """Read a priority of SCHED_FIFO."""
    return _whole(text, 1, HIGHEST_PRIORITY, "priority")


def busy_share(text: str) -> int:
    """Read the percentage of its WCET that a made-up program takes."""
    return _whole(text, 0, 100, "percentage")
