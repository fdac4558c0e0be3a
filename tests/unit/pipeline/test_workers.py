"""Threads: results in order and the same for any number of them, never more threads than asked for."""

import threading
import time

import pytest

from halpipe.pipeline.solve import workers as module
from halpipe.pipeline.solve.workers import Workers, once, watched


def square(number):
    return number * number


@pytest.mark.parametrize("count", [1, 2, 5])
def test_results_come_in_the_order_of_the_items(count):
    def slow_first(number):
        time.sleep(0.01 * (3 - number))
        return square(number)

    assert Workers(count).each(slow_first, [0, 1, 2]) == [0, 1, 4]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_first_that_is_enough_is_the_last_result_whoever_is_quicker(count):
    def last_is_quick(number):
        time.sleep(0.02 if number == 1 else 0)
        return number

    assert Workers(count).each(last_is_quick, range(9), lambda number: number in (1, 3)) == [0, 1]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_the_failure_of_the_first_item_that_fails_is_raised(count):
    def fail(number):
        if number == 2:
            time.sleep(0.02)
        if number >= 2:
            raise ValueError(str(number))
        return number

    with pytest.raises(ValueError, match="2"):
        Workers(count).each(fail, range(6))


def test_a_failure_after_one_that_was_enough_does_not_count():
    both = threading.Barrier(2, timeout=300)

    def work(number):
        both.wait()
        if number == 1:
            raise ValueError
        return number

    assert Workers(2).each(work, [0, 1], lambda number: number == 0) == [0]


def test_one_worker_begins_nothing_after_what_was_enough():
    begun = []
    Workers(1).each(begun.append, range(5), lambda _: len(begun) == 2)
    assert begun == [0, 1]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_work_within_work_shares_the_same_threads(count):
    workers, lock, running, most = Workers(count), threading.Lock(), [0], [0]

    def inner(number):
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        time.sleep(0.005)
        with lock:
            running[0] -= 1
        return number

    def outer(number):
        return sum(workers.each(inner, range(3 * number, 3 * number + 3)))

    assert workers.each(outer, range(4)) == [3, 12, 21, 30]
    assert most[0] <= count
    assert workers.each(square, [3]) == [9]
    assert workers._idle == count - 1, "all threads were given back"


def test_processes_give_results_in_order_and_stop_when_told():
    workers = Workers(2)
    assert list(workers.spread(square, [3, 1, 2], lambda _: True)) == [9, 1, 4]
    assert list(workers.spread(square, [3, 1, 2], lambda done: False)) == [None]


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(module, "ASK_SECONDS", 0.01)


def test_watched_work_ends_by_itself(impatient):
    assert watched(lambda: 7, lambda: True, pytest.fail) == (7, False)


def test_watched_work_is_stopped_once_nobody_wants_more(impatient):
    over = threading.Event()
    assert watched(lambda: over.wait(300), lambda: False, over.set) == (True, True)


def test_an_interrupt_stops_watched_work_and_passes_on(impatient):
    over = threading.Event()

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        watched(lambda: over.wait(300), interrupt, over.set)
    assert over.is_set()


def test_a_value_is_computed_once_whichever_thread_asks():
    asked = []

    def value():
        time.sleep(0.02)
        asked.append(7)
        return len(asked)

    ask = once(value)
    assert asked == []
    assert Workers(4).each(lambda _: ask(), range(8)) == [1] * 8
    assert asked == [7]
