"""The semantic checks of a task model: what its schema cannot say (MODEL 2 and 3).

Each check is a procedure with one sentence that says what it checks; the manual's list is made from the table below.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, sort_diagnostics
from halpipe.pipeline.validate import accesses, chains, hyperperiod, load, precedence, structure, timing
from halpipe.pipeline.validate.context import Check, Context, checks_of

if TYPE_CHECKING:
    from halpipe.models import TaskModel

__all__ = ["CHECKS", "Check", "validate"]

CHECKS = checks_of(structure, timing, accesses, precedence, chains, load, hyperperiod)
"""Every check with its sentence, in the order of checking; the order of findings does not depend on it."""


def validate(model: TaskModel) -> tuple[Diagnostic, ...]:
    """Return every finding about `model`: with an error it cannot be scheduled, warnings and notes do not stop it.

    Never raises on any model. Sound as far as it goes: no model that has a valid schedule is called overloaded or
    contradictory; deeper contradictions between constraints are found when no schedule is.
    """
    context = Context(model)
    return tuple(sort_diagnostics(finding for check in CHECKS for finding in check.run(context)))
