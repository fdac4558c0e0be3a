"""Compiled code sees the fields of a NamedTuple as they are, and cannot write to those that are fixed."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, types
from numba.core.errors import TypingError

from halpipe.pipeline.anneal.memory import Table, View, addresses, as_table


@as_table
class Box(NamedTuple):
    number: int
    line: np.ndarray
    grid: np.ndarray
    word: np.ndarray


@as_table
class Twin(NamedTuple):
    line: np.ndarray
    number: int


class Fixed(NamedTuple):
    line: np.ndarray


as_table(Fixed, fixed=True)


def box():
    return Box(7, np.arange(5), np.arange(12).reshape(4, 3), np.array([2**64 - 1], np.uint64))


@njit
def summed(box, row, column):
    return box.number, len(box.line), len(box.grid), box.line[row], box.grid[row, column], box.word[0]


@njit
def written(box, row, column):
    box.line[row] = 100
    box.grid[row, column] += 1000
    box.word[0] >>= np.uint64(1)


def test_every_field_is_read_where_it_is():
    made = box()
    for row in range(4):
        for column in range(3):
            assert summed(made, row, column) == (7, 5, 4, row, 3 * row + column, 2**64 - 1)


def test_writing_changes_that_element_alone():
    made = box()
    written(made, 2, 1)
    assert made.line.tolist() == [0, 1, 100, 3, 4]
    assert np.flatnonzero(made.grid.ravel() != np.arange(12)).tolist() == [7]
    assert (made.grid[2, 1], made.word[0]) == (1007, 2**63 - 1)


def test_two_classes_are_not_confused():
    @njit
    def first(twin):
        return twin.line[0] + twin.number

    assert first(Twin(np.array([30]), 12)) == 42
    assert first(box()) == 7


def test_views_travel_between_functions():
    @njit
    def last(line, length):
        return line[length - 1]

    @njit
    def of_box(box):
        return last(box.line, len(box.line))

    assert of_box(box()) == 4


def test_what_is_fixed_cannot_be_written():
    @njit
    def fill(fixed):
        fixed.line[0] = 1

    with pytest.raises(TypingError):
        fill(Fixed(np.zeros(1, np.int64)))


def test_a_view_takes_as_many_indices_as_it_has_dimensions():
    @njit
    def flat(box):
        return box.grid[1]

    with pytest.raises(TypingError):
        flat(box())


def test_the_table_holds_addresses_shapes_and_integers():
    made = box()
    table = addresses(made)
    assert table[0].tolist() == [7, 0, 0]
    assert table[1].tolist() == [made.line.ctypes.data, 5, 0]
    assert table[2].tolist() == [made.grid.ctypes.data, 4, 3]


def test_equal_types_are_one_type():
    """Else machine code that was kept would never be found again."""
    assert View(1, types.int64, fixed=True) == View(1, types.int64, fixed=True) != View(1, types.int64, fixed=False)
    assert Table("a", (("x", types.int64),)) == Table("a", (("x", types.int64),))
