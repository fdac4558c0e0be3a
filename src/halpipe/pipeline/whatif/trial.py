"""One number in question: from where on it is proven possible, and from where on a schedule is found.

Numbers are counted in steps from the hardest (0). Nothing relies on schedules being found for everything easier than
what one was found for: the answer is what was found, together with what was tried without success.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.records import record
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.explain import codes as explain_codes
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.validate import codes as validate_codes
from halpipe.pipeline.validate import validate

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions
    from halpipe.pipeline.whatif.changed import Changed

LOADS = frozenset(
    code.id
    for code in (
        validate_codes.UNITS_OVERLOADED,
        validate_codes.RESOURCE_OVERLOADED,
        validate_codes.WCET_BEYOND_HYPERPERIOD,
        validate_codes.WCET_BEYOND_DEADLINE,
        validate_codes.BAD_GANG,
        validate_codes.CHAIN_LIMIT_TOO_LOW,
    )
)
"""Findings of validate that depend on the size of the system: they prove that no schedule exists."""

WINDOWS = frozenset((explain_codes.WINDOW_TOO_NARROW.id, explain_codes.WINDOWS_CONTRADICT.id))
"""Witnesses that a shorter WCET may bring about, as windows may count from the end of a job."""


@record
class Search:
    """How schedules are looked for; with `switches`, tables between the modes must be found as well."""

    options: SearchOptions
    on_progress: OnProgress
    switches: bool = False

    def finds(self, changed: Changed) -> bool:
        """Return whether a schedule is found and verified for every mode.

        Raise `KeyboardInterrupt` if `on_progress` ends the search: half an answer is none.
        """
        if changed.lost:
            return False
        names = tuple(mode.name for mode in changed.model.modes)
        groups = (names,) if self.switches else tuple((name,) for name in names)
        return all(self._finds(changed.model, group) for group in groups)

    def _finds(self, model: TaskModel, modes: tuple[str, ...]) -> bool:
        try:
            scheduled = schedule_model(model, replace(self.options, modes=modes), self.on_progress)
        except HalpipeError as failure:
            errors = {d.code for d in failure.diagnostics if d.is_error}
            if failure.exit is Exit.INFEASIBLE or (errors and errors <= LOADS):
                return False
            raise
        if scheduled.stopped:
            raise KeyboardInterrupt
        return scheduled.is_complete and not any(d.is_error for d in scheduled.diagnostics)


def proofs(changed: Changed, ignored: frozenset[str] = frozenset()) -> tuple[Diagnostic, ...]:
    """Return the necessary conditions that a changed model breaks: each proves that it has no schedule."""
    if changed.lost:
        return changed.lost
    loads = tuple(d for d in validate(changed.model) if d.is_error and d.code in LOADS)
    if loads:
        return loads
    witnesses = (w.diagnostic for hopeless in find_witnesses(changed.model) for w in hopeless.witnesses)
    return tuple(d for d in witnesses if d.code not in ignored)


def check_otherwise(model: TaskModel) -> None:
    """Raise `HalpipeError` with the errors of a model that no size removes."""
    wrong = [d for d in validate(model) if d.is_error and d.code not in LOADS]
    if wrong:
        raise HalpipeError(*wrong)


@record
class Bracket:
    """What became of a question, in steps from the hardest number.

    `possible` is the first that is not proven impossible (None: all are), `witness` the proof against the one before;
    `found` the first with a schedule; `failed` was tried without success.
    """

    possible: int | None
    witness: tuple[Diagnostic, ...] = ()
    found: int | None = None
    failed: tuple[int, ...] = ()


def bracket(
    last: int,
    prove: Callable[[int], tuple[Diagnostic, ...]],
    finds: Callable[[int], bool],
    known: int | None = None,
) -> Bracket:
    """Look for the first of the numbers 0 to `last` that works; of `known` it is known."""
    witnesses: dict[int, tuple[Diagnostic, ...]] = {}

    def is_possible(number: int) -> bool:
        witnesses[number] = prove(number)
        return not witnesses[number]

    possible = first_that(0, last, is_possible)
    if possible is None:
        return Bracket(None, witnesses[last])
    failed: list[int] = []

    def works(number: int) -> bool:
        if number == known or finds(number):
            return True
        failed.append(number)
        return False

    found = first_that(possible, last if known is None else max(possible, known), works)
    return Bracket(possible, witnesses.get(possible - 1, ()), found, tuple(sorted(failed)))


def first_that(first: int, last: int, holds: Callable[[int], bool]) -> int | None:
    """Return a number of [first, last] that holds while the one before does not, or is `first`; None if `last` fails.

    Steps double until one holds, then halve, so that few tries are far from the answer.
    """
    below, at, width = first - 1, first, 1
    while not holds(at):
        if at >= last:
            return None
        below, at, width = at, min(last, at + width), 2 * width
    while at - below > 1:
        middle = (below + at) // 2
        if holds(middle):
            at = middle
        else:
            below = middle
    return at
