"""Which callbacks of a node publish a topic, when the file may not say so.

CARET leaves two thirds of the publications of a real system without a callback. In order: what is stated; the only
callback of the node; what the message contexts say; else an assumption, which is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.importers.ros.graph import Certainty, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.ros.graph import Callback

_TRIGGERED_BY_MESSAGE = ("callback_chain", "inherit_unique_stamp", "tilde")
_LATEST = "use_latest_message"


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
    """Return the callbacks that (may) publish `topic`, none if it is published outside of callbacks."""
    if stated:
        return stated, Certainty.STATED
    able = [callback for callback in callbacks if callback.kind is not Kind.SERVICE]
    if len(able) <= 1:
        return tuple(callback.name for callback in able), Certainty.INFERRED
    found = _by_contexts([context for context in contexts if context.published == topic], able)
    if found:
        return found, Certainty.INFERRED
    timers = [(callback.period, position) for position, callback in enumerate(able) if callback.period is not None]
    if timers:
        _, fastest = min(timers)
        return (able[fastest].name,), Certainty.ASSUMED
    return tuple(callback.name for callback in able), Certainty.ASSUMED


def _by_contexts(contexts: Sequence[Context], callbacks: Sequence[Callback]) -> tuple[str, ...]:
    """Return the publishers that contexts imply; the latest message may be published by any timer, so not there."""
    has_timers = any(callback.kind is Kind.TIMER for callback in callbacks)
    found: list[str] = []
    for context in contexts:
        if context.callbacks:
            found.append(context.callbacks[-1])
        elif context.kind in _TRIGGERED_BY_MESSAGE or (context.kind == _LATEST and not has_timers):
            found.extend(callback.name for callback in callbacks if context.subscribed in callback.inputs)
    return tuple(dict.fromkeys(found))
