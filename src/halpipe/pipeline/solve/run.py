"""Executors of independent pieces of work: the present process, or several.

What a function returns must not depend on where it runs, so both give the same results. Threads are in `workers.py`.
"""

from __future__ import annotations

from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Exit, HalpipeError, error

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

WORKER_LOST = error(
    "HAL0933",
    "Worker process ended unexpectedly",
    "A worker was killed, most often for want of memory. Finished work is kept: run the same command again.",
)
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def map_tasks(
    function: Callable[[_Item], _Result], items: Sequence[_Item], *, jobs: int = 1
) -> Generator[tuple[int, _Result], None, None]:
    """Yield (position, result) for every item as it is finished.

    The work goes to `jobs` processes; with one job it is done here, in order. Raise `HalpipeError` if a worker is lost.
    """
    if jobs <= 1:
        yield from ((number, function(item)) for number, item in enumerate(items))
        return
    try:
        # Spawned, not forked: a fork would copy the threads' locks of whatever runs here.
        with ProcessPoolExecutor(
            jobs, mp_context=get_context("spawn"), initializer=_leave_interrupts_to_parent
        ) as executor:
            waiting = {executor.submit(function, item): number for number, item in enumerate(items)}
            try:
                for future in as_completed(waiting):
                    yield waiting[future], future.result()
            finally:
                for future in waiting:
                    future.cancel()
    except BrokenExecutor as failure:
        help = "use fewer --workers if memory is short, then run the same command again"
        raise HalpipeError(WORKER_LOST(str(failure), help=help), exit=Exit.INTERNAL) from None


def _leave_interrupts_to_parent() -> None:
    """Let Ctrl-C reach the command alone, which then stops its workers."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
