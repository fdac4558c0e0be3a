"""Which callbacks of a node publish a topic, when the file may not say so.

CARET leaves two thirds of the publications of a real system without a callback. In order: what is stated; the only
callback of the node; the last callback of a chain that a message context states; else an assumption, which is reported:
readers of the messages that a context carries on, the fastest timer, any callback.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.importers.ros.graph import Certainty, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.ros.graph import Callback

_CARRYING = ("callback_chain", "inherit_unique_stamp", "tilde")
"""Contexts in which a message that comes in makes one go out; the latest message may be published by any callback."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """A message context: how a node relates what it publishes to what it subscribes."""

    kind: str
    subscribed: str
    published: str
    callbacks: tuple[str, ...] = ()


def publishers_of(
    topic: str, stated: tuple[str, ...], callbacks: Sequence[Callback], contexts: Sequence[Context]
) -> tuple[tuple[str, ...], Certainty]:
    """Return the callbacks that may publish `topic`, none if it is published outside of callbacks.

    Several that are assumed are candidates, of which `activation.settled` takes one.
    """
    if stated:
        return stated, Certainty.STATED
    able = [callback for callback in callbacks if callback.kind is not Kind.SERVICE]
    if len(able) <= 1:
        return tuple(callback.name for callback in able), Certainty.INFERRED
    about = [context for context in contexts if context.published == topic]
    ends = dict.fromkeys(context.callbacks[-1] for context in about if context.callbacks)
    if ends:
        return tuple(ends), Certainty.INFERRED if len(ends) == 1 else Certainty.ASSUMED
    kept = [context.subscribed for context in about if context.kind in _CARRYING]
    carrying = [callback.name for callback in able if any(read in kept for read in callback.inputs)]
    if carrying:
        return tuple(carrying), Certainty.ASSUMED
    timers = [(callback.period, position) for position, callback in enumerate(able) if callback.period is not None]
    if timers:
        _, fastest = min(timers)
        return (able[fastest].name,), Certainty.ASSUMED
    return tuple(callback.name for callback in able), Certainty.ASSUMED
