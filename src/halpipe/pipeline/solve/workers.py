"""Threads and processes of one command: the kernel and CP-SAT leave the interpreter alone, so threads are enough.

What comes out never depends on the number of threads, nor on which of them is first: results are taken in the order
of the items. Processes are for work that does not leave the interpreter.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.options import option
from halpipe.core.quantities import whole
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

WORKER_LOST = error(
    "HAL0933",
    "Worker process ended unexpectedly",
    "A worker was killed, most often for want of memory. Finished work is kept: run the same command again.",
)

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

ASK_SECONDS = 0.1
"""Interval at which `go_on` is called."""


@record(kw_only=True)
class WorkerOptions:
    """Number of threads, as Python callers state it."""

    count: int = option(1, "The result is the same for any number.", whole(1, what="number of threads"), name="workers")


def once(function: Callable[[], _Result]) -> Callable[[], _Result]:
    """Return a function that computes a value when it is first asked for, in one thread while others wait."""
    lock, found = threading.Lock(), list[_Result]()

    def ask() -> _Result:
        with lock:
            if not found:
                found.append(function())
            return found[0]

    return ask


class Workers:
    """`count` threads that share work, the caller's among them.

    Work may itself hand out work: it gets the threads that are idle just then, and there are never more than `count`.
    """

    def __init__(self, count: int = 1) -> None:
        self.count = count
        self._idle = count - 1
        self._lock = threading.Lock()

    def each(
        self,
        function: Callable[[_Item], _Result],
        items: Sequence[_Item],
        is_enough: Callable[[_Result], bool] = lambda _: False,
    ) -> list[_Result]:
        """Return the results in the order of the items, up to the first that is enough; later items may be left out.

        Raise what the function raised, if an item before raised nothing and was not enough.
        """
        results: dict[int, _Result] = {}
        failures: dict[int, BaseException] = {}
        waiting, lock, is_over = enumerate(items), threading.Lock(), threading.Event()

        def work() -> None:
            while not is_over.is_set():
                with lock:
                    taken = next(waiting, None)
                if taken is None:
                    break
                try:
                    results[taken[0]] = function(taken[1])
                except BaseException as failure:  # noqa: BLE001 - raised again below, in the thread that asked
                    failures[taken[0]] = failure
                if taken[0] in failures or is_enough(results[taken[0]]):
                    is_over.set()

        helpers = [threading.Thread(target=work, daemon=True) for _ in range(self._take(len(items) - 1))]
        try:
            for helper in helpers:
                helper.start()
            work()
        finally:
            is_over.set()
            for helper in helpers:
                if helper.ident is not None:
                    helper.join()
            self._give(len(helpers))
        collected: list[_Result] = []
        for number in range(len(items)):  # as if the items had been taken one after the other
            if number in failures:
                raise failures[number]
            collected.append(results[number])
            if is_enough(collected[-1]):
                break
        return collected

    def spread(
        self, function: Callable[[_Item], _Result], items: Sequence[_Item], go_on: Callable[[int], bool]
    ) -> Iterator[_Result | None]:
        """Yield the results in the order of the items, from processes: for work that does not leave the interpreter.

        `go_on` gets the number of finished items; once it says no, the next one that is not comes as None, the last.
        """
        results: dict[int, _Result] = {}
        finished = map_tasks(function, items, jobs=min(self.count, len(items)))
        try:
            for place in range(len(items)):
                while place not in results:
                    if not go_on(len(results)):
                        yield None
                        return
                    number, result = next(finished)
                    results[number] = result
                yield results[place]
        finally:
            finished.close()

    def _take(self, wanted: int) -> int:
        with self._lock:
            taken = max(0, min(wanted, self._idle))
            self._idle -= taken
        return taken

    def _give(self, count: int) -> None:
        with self._lock:
            self._idle += count


def watched(work: Callable[[], _Result], go_on: Callable[[], bool], stop: Callable[[], None]) -> tuple[_Result, bool]:
    """Do `work` on a thread, and ask `go_on` meanwhile; once it says no, call `stop`, which ends the work early.

    Return what the work returned, and whether it was stopped.
    """
    is_stopped = False
    from concurrent.futures import ThreadPoolExecutor, wait  # it takes longer to load than a short search

    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(work)
        try:
            while not wait([future], ASK_SECONDS).done:
                is_stopped = is_stopped or not go_on()
                if is_stopped:
                    stop()
        finally:
            while not future.done():  # an exception, such as that of Ctrl-C, passes through
                stop()
                wait([future], ASK_SECONDS)
    return future.result(), is_stopped


def map_tasks(
    function: Callable[[_Item], _Result], items: Sequence[_Item], *, jobs: int
) -> Generator[tuple[int, _Result], None, None]:
    """Yield (position, result) for every item as it is finished.

    The work goes to `jobs` processes; with one job it is done here, in order. Raise `HalpipeError` if a worker is lost.
    """
    if jobs <= 1:
        yield from ((number, function(item)) for number, item in enumerate(items))
        return
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed  # threads do without
    from multiprocessing import get_context

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
