"""How cost grows with size: a ratio of two times from the same run, so that slow and busy machines do not matter."""

import time

TRIES = 3
"""The best of so many counts, since other programs disturb."""


def growth(prepare, small, large):
    """Return how many times longer the work that `prepare` returns for `large` takes than the one for `small`.

    Counted is processor time. Allow a multiple of the linear ratio that is far below the quadratic one.
    """
    return _seconds(prepare(large)) / _seconds(prepare(small))


def _seconds(work):
    tries = []
    for _ in range(TRIES):
        begin = time.process_time()
        work()
        tries.append(time.process_time() - begin)
    return min(tries)
