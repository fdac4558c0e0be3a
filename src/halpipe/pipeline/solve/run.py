"""Executors of independent pieces of work: several processes, or a cluster.

The seam is ``concurrent.futures.Executor``: process pools have it, and so has a dask.distributed client. What a
function returns must not depend on where it runs, so all of them give the same results. Threads are in `workers.py`.
"""

from __future__ import annotations

import logging
from concurrent.futures import BrokenExecutor, CancelledError, as_completed, wait
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import Exit, HalpipeError, error

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence
    from concurrent.futures import Executor

    from distributed import Client

CLUSTER_MISSING = error(
    "HAL0931",
    "dask.distributed is not installed",
    "Work is sent to a cluster by dask.distributed, which is an extra: pip install distributed.",
)
CLUSTER_UNREACHABLE = error(
    "HAL0932",
    "Cluster cannot be reached",
    "No dask scheduler answers at the address, or it speaks another version of the protocol.",
)
WORKER_LOST = error(
    "HAL0933",
    "Worker process ended unexpectedly",
    "A worker was killed, most often for want of memory. Finished work of a search is saved: continue with --resume.",
)
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

CONNECT_SECONDS = 10

LOUD = ("distributed", "distributed.client", "tornado.application")
"""Loggers that write to stderr, with tracebacks, what diagnostics report here in words."""

GO_ON = "start workers, or omit --cluster, and"
"""Advice where a cluster was lost on which one model was searched."""

ASK_SECONDS = 0.1
"""Interval at which `go_on` is called while waiting for a cluster."""

LOST_ASKS = 100
"""After so many unanswered questions whether to go on, it is looked whether the cluster still has workers."""


def map_tasks(
    function: Callable[[_Item], _Result], items: Sequence[_Item], *, jobs: int = 1, cluster: str = ""
) -> Generator[tuple[int, _Result], None, None]:
    """Yield (position, result) for every item as it is finished.

    With a `cluster`, the address of a dask scheduler, the work goes there; else to `jobs` processes, or with one job it
    is done here, in order. Raise `HalpipeError` if there is no cluster or a worker is lost.
    """
    if jobs <= 1 and not cluster:
        yield from ((number, function(item)) for number, item in enumerate(items))
        return
    with _telling_of_losses("use fewer --jobs if memory is short, then"), _executor(jobs, cluster) as executor:
        waiting = {executor.submit(function, item): number for number, item in enumerate(items)}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            for future in waiting:
                future.cancel()


@contextmanager
def _telling_of_losses(advice: str) -> Iterator[None]:
    try:
        yield
    except (BrokenExecutor, CancelledError) as failure:
        text, help = str(failure) or "the cluster was lost", f"{advice} go on with --resume"
        raise HalpipeError(WORKER_LOST(text, help=help), exit=Exit.INTERNAL) from None


@contextmanager
def _executor(jobs: int, cluster: str) -> Iterator[Executor]:
    if not cluster:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        # Spawned, not forked: a fork would copy the threads' locks of whatever runs here.
        with ProcessPoolExecutor(
            jobs, mp_context=get_context("spawn"), initializer=_leave_interrupts_to_parent
        ) as pool:
            yield pool
        return
    with _client(cluster) as client, client.get_executor() as executor, _killed_as_broken():
        yield executor


@contextmanager
def _client(cluster: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError:
        help = "install it: pip install distributed"
        raise HalpipeError(CLUSTER_MISSING("--cluster needs dask.distributed", help=help)) from None
    for name in LOUD:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(cluster, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as failure:
        help = "start one with `dask scheduler`, and give its address, such as tcp://10.0.0.1:8786"
        raise HalpipeError(CLUSTER_UNREACHABLE(str(failure), path=cluster, help=help)) from None
    with client:
        yield client


@contextmanager
def _killed_as_broken() -> Iterator[None]:
    """Take work that was given up because its workers were killed for that of a broken executor."""
    from distributed import KilledWorker

    try:
        yield
    except KilledWorker as failure:
        raise BrokenExecutor(str(failure)) from None


class Cluster:
    """A cluster as one piece of work after the other sees it, each of which waits for what it asks."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._executor = client.get_executor()
        self._had_workers = self._has_workers()

    def hold(self, value: object) -> Any:
        """Send a value that many functions need, to be given to them in place of what this returns.

        The scheduler keeps it, so that a worker has it from there if others that had it are lost.
        """
        with _telling_of_losses(GO_ON):
            self._refuse_if_lost()
            return self._client.submit(_itself, value, pure=False)

    def ask(self, function: Callable[..., _Result], *arguments: object, go_on: Callable[[], bool]) -> _Result | None:
        """Return what a function returns there; None once `go_on`, which is asked meanwhile, says no.

        What is not waited for any longer is dropped when the command leaves the cluster.
        """
        with _telling_of_losses(GO_ON), _killed_as_broken():
            self._refuse_if_lost()
            future = self._executor.submit(function, *arguments)
            asked = 0
            while not wait([future], ASK_SECONDS).done:
                if not go_on():
                    return None
                asked += 1
                if asked % LOST_ASKS == 0 and self._had_workers and not self._has_workers():
                    raise BrokenExecutor("the cluster has no workers left")
            result: _Result = future.result()
            return result

    def _refuse_if_lost(self) -> None:
        if self._client.status == "closed":  # by itself, since the scheduler was not to be found again
            raise BrokenExecutor("the cluster was lost")

    def _has_workers(self) -> bool:
        """Return whether there are workers; a scheduler that does not answer has none."""
        try:
            return bool(self._client.nthreads())
        except OSError:
            return False


def _itself(value: _Result) -> _Result:
    return value


@contextmanager
def on_cluster(address: str) -> Iterator[Cluster]:
    """Yield the cluster at an address; raise `HalpipeError` if there is none."""
    with _client(address) as client:
        yield Cluster(client)


def _leave_interrupts_to_parent() -> None:
    """Let Ctrl-C reach the command alone, which then stops its workers."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
