"""Extent of a format: the parts of a model and schedule that it reads, writes and loses.

Every importer and exporter states its extent; the table of formats in the manual is made of these statements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

ASPECTS = {
    "units": "execution units and their types",
    "resources": "shared resources and their bandwidth",
    "tasks": "tasks, with periods or on demand",
    "timing": "offsets, slack and deadlines",
    "versions": "versions: WCET, valid units, gang size",
    "split": "where jobs may be interrupted, and what that costs",
    "binding": "tasks that stay on their units",
    "interrupts": "interrupts of units; sporadic arrivals",
    "accesses": "access phases with their bounds",
    "transfers": "data transfers of access phases",
    "precedence": "precedence constraints with their windows",
    "chains": "cause-effect chains with their limits",
    "modes": "modes, and which tasks run in them",
    "transitions": "allowed switches between modes, with their limits",
    "health": "what the target does after overruns or faults",
    "sources": "program sources of the versions",
    "origins": "where each element was imported from",
    "schedule": "the schedule of every mode",
    "parts": "the parts of jobs with gaps",
    "tables": "the transition tables",
}
"""What models and schedules consist of (MODEL 2, 3, 5 and 8), in the order of the table of formats."""


@record
class Extent:
    """Extent of a format: aspects that it carries, each with its element; and losses, in sentences."""

    carried: Mapping[str, str]
    lost: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = [aspect for aspect in self.carried if aspect not in ASPECTS]
        assert not unknown, f"no aspects of a model: {unknown}"
