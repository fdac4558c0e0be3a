"""Plants in a closed loop with the computer: their inputs and their actions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from halpipe.core.durations import Duration


class Board(Protocol):
    """What a plant reaches of the target: the buffers in main memory, and the request for another mode."""

    def read(self, buffer: str) -> bytes:
        """Return what a buffer holds."""
        ...

    def write(self, buffer: str, data: bytes) -> None:
        """Put `data` at the beginning of a buffer, as a sensor's driver does."""
        ...

    def request(self, mode: str) -> None:
        """Ask for another mode; the runtime takes it at the end of the hyperperiod."""
        ...

    def stop(self) -> None:
        """End the run now."""
        ...


class Plant:
    """The world that stands still; real ones override what they need. Instants count from the beginning of the run."""

    def start(self, board: Board) -> None:
        """Prepare the inputs; nothing has been executed yet."""

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """The `cycle`-th table begins: a mode, or ``a->b``; nothing of it has happened yet."""

    def reads(self, board: Board, now: Duration, buffer: str) -> None:
        """A read phase is about to move `buffer` into a scratchpad; what is written now is what the job sees."""

    def written(self, board: Board, now: Duration, buffer: str) -> None:
        """A write phase has put new bytes into `buffer`."""
