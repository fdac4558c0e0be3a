"""How cost grows with size: a ratio of two times from the same run, so that slow and busy machines do not matter."""

import gc
import sys
import time

TRIES = 3
"""The best of so many counts, since other programs disturb. Small and large take turns, and so share what disturbs."""


def growth(prepare, small, large):
    """Return how many times longer the work that `prepare` returns for `large` takes than the one for `small`.

    Counted is processor time. Hold it against `half_way`.
    """
    one, other = prepare(small), prepare(large)
    tries = [(seconds(one), seconds(other)) for _ in range(TRIES)]
    return min(large for _, large in tries) / min(small for small, _ in tries)


def half_way(factor):
    """Return the growth half-way, in factors, between that of linear work and of quadratic work for so many times more.

    What disturbs has to be as far from either: for eight times the size linear work takes 8 times as long, quadratic
    work 64, and the bound is 22.
    """
    return factor**1.5


def seconds(work):
    """Return the processor time of a work in this thread, without looking again at what was left before.

    That stays frozen: after thousands of tests it takes seconds to look through all of it, each time anew.
    """
    gc.collect()
    gc.freeze()
    begin = time.thread_time()
    work()
    return time.thread_time() - begin


def calls(work):
    """Return how many functions a work calls: a measure without a clock, for small sizes."""
    count = 0

    def note(_frame, event, _argument):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count
