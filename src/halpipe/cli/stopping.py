"""Stop requests for a search: Ctrl-C, a termination signal, a closed terminal, or the time limit."""

from __future__ import annotations

import signal
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from halpipe.cli import output

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.durations import Duration


class Stop:
    """Stop request of the user, named in `words`; a second Ctrl-C ends the command at once.

    A copy in another process, or on a cluster, has the time limit alone.
    """

    def __init__(self, words: str, time_limit: Duration | None = None) -> None:
        self.pressed = False
        self._words = words
        self._limit = float(time_limit.in_unit("s")) if time_limit else 0

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take Ctrl-C, the request to end, and the end of the terminal, unless that is ignored (nohup)."""
        numbers = [signal.SIGINT, signal.SIGTERM]
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        before = [(number, signal.signal(number, self._press)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def _press(self, *_: object) -> None:
        if self.pressed:
            raise KeyboardInterrupt
        self.pressed = True
        output.say(self._words)

    def clock(self) -> Callable[..., bool]:
        """Return what one search asks whether to go on; its time begins now."""
        end = time.monotonic() + self._limit if self._limit else None
        return lambda *_: not self.pressed and (end is None or time.monotonic() < end)
