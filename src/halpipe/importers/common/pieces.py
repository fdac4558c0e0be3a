"""Pieces of a fully preemptive runnable: cuts of one length, as far as they are useful."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, about
from halpipe.core.files import TOO_MUCH

if TYPE_CHECKING:
    from halpipe.core.durations import Duration

MOST_PIECES = 20_000


def cuts(longest: Duration, begin: Duration, end: Duration, task: str, at: Location) -> list[Duration]:
    """Return the instants between `begin` and `end` every `longest` from `begin`; none where that is 0.

    Raise `HalpipeError` where they are more than a job of `task`, stated `at` some place, may have parts.
    """
    count = -(-(end - begin) // longest) - 1 if longest and begin < end else 0
    if count >= MOST_PIECES:
        message = f"would be cut into {count + 1} pieces of {longest}; at most {MOST_PIECES} are made"
        help = "correct its execution time, or choose longer pieces with --pieces; 0ms cuts none"
        raise HalpipeError(TOO_MUCH(message, at=at, path=about(task=task), help=help))
    return [begin + longest * number for number in range(1, count + 1)]
