"""Work on several processes."""

import os

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.pipeline.solve.workers import map_tasks


def square(number):
    return number * number


def die(number):
    os._exit(number)


def codes(caught):
    return [finding.code for finding in caught.value.diagnostics]


def test_one_job_works_here_and_in_order():
    assert list(map_tasks(lambda number: number**2, [3, 1, 2], jobs=1)) == [(0, 9), (1, 1), (2, 4)]


def test_several_processes_give_the_same_results_by_position():
    assert sorted(map_tasks(square, [3, 1, 2], jobs=2)) == [(0, 9), (1, 1), (2, 4)]


def test_a_worker_that_dies_is_reported():
    with pytest.raises(HalpipeError) as caught:
        list(map_tasks(die, [1, 1], jobs=2))
    assert codes(caught) == ["HAL0933"]
    assert "--workers" in caught.value.diagnostics[0].help
