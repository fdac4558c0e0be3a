"""Publishing callbacks of a node where the file may not name them.

CARET leaves two thirds of the publications of a real system without a callback. In order: what is stated; the only
callback of the node; the last callback of a chain that a message context states; else an assumption, which is reported:
readers of the messages that a context carries on, the fastest timer, any callback.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.ros.sources.graph import Certainty, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.ros.sources.graph import Callback

_CARRYING = ("callback_chain", "inherit_unique_stamp", "tilde")
"""Contexts in which a message that comes in makes one go out; the latest message may be published by any callback."""


@record(kw_only=True)
class Context:
    """A message context: how a node relates what it publishes to what it subscribes."""

    kind: str
    subscribed: str
    published: str
    callbacks: tuple[str, ...] = ()


class Publishers:
    """The callbacks of one node that may publish, looked through once for all its topics."""

    def __init__(self, callbacks: Sequence[Callback], contexts: Sequence[Context]) -> None:
        self.readers: dict[str, list[str]] = {}
        """By topic, the names of the callbacks that it triggers."""
        able = [callback for callback in callbacks if callback.kind is not Kind.SERVICE]
        timers = [(callback.period, position) for position, callback in enumerate(able) if callback.period is not None]
        self._able = tuple(callback.name for callback in able)
        self._fastest = able[min(timers)[1]].name if timers else None
        self._position = {name: position for position, name in enumerate(self._able)}
        for callback in callbacks:
            for topic in dict.fromkeys(callback.inputs):
                self.readers.setdefault(topic, []).append(callback.name)
        self._about: dict[str, list[Context]] = {}
        for context in contexts:
            self._about.setdefault(context.published, []).append(context)

    def of(self, topic: str, stated: tuple[str, ...]) -> tuple[tuple[str, ...], Certainty]:
        """Return the callbacks that may publish `topic`, none if it is published outside of callbacks.

        Several that are assumed are candidates, of which `activation.settled` takes one.
        """
        if stated:
            return stated, Certainty.STATED
        if len(self._able) <= 1:
            return self._able, Certainty.INFERRED
        about = self._about.get(topic, ())
        ends = dict.fromkeys(context.callbacks[-1] for context in about if context.callbacks)
        if ends:
            return tuple(ends), Certainty.INFERRED if len(ends) == 1 else Certainty.ASSUMED
        kept = dict.fromkeys(context.subscribed for context in about if context.kind in _CARRYING)
        carrying = {name for read in kept for name in self.readers.get(read, ()) if name in self._position}
        if carrying:
            return tuple(sorted(carrying, key=self._position.__getitem__)), Certainty.ASSUMED
        return (self._able if self._fastest is None else (self._fastest,)), Certainty.ASSUMED
