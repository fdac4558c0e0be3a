"""Compiled code sees the fields of a NamedTuple as they are, and cannot write to those that are fixed."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import types
from numba.core.errors import TypingError

from halpipe.pipeline.solve.kernel.compiler import Table, View, kind_of
from halpipe.pipeline.solve.kernel.jit import _layout, addresses, entry_point
from halpipe.pipeline.solve.kernel.profile import move_within
from halpipe.pipeline.solve.kernel.registry import as_table, compiled


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
    return Box(7, np.arange(5), np.arange(12).reshape(4, 3), np.array([2**63 + 4], np.uint64))


@entry_point
def field(box, number, row, column):
    if number == 0:
        return box.number
    if number == 1:
        return len(box.line)
    if number == 2:
        return len(box.grid)
    if number == 3:
        return box.line[row]
    if number == 4:
        return box.grid[row, column]
    return np.int64(box.word[0] >> np.uint64(1))


@entry_point
def write(box, row, column):
    box.line[row] = 100
    box.grid[row, column] += 1000
    box.word[0] >>= np.uint64(1)


@entry_point
def move_in_line(box, begin, end, steps):
    move_within(box.line, begin, end, steps)


@entry_point
def of_twin(twin):
    return twin.line[0] + twin.number


@entry_point
def of_array(line, index):
    return line[index] + len(line)


@compiled
def last(line, length):
    return line[length - 1]


@entry_point
def last_of_box(box):
    return last(box.line, len(box.line)) + of_array(box.line, 1)


@entry_point
def divided(number, by):
    return number // by


def test_every_field_is_read_where_it_is():
    made = box()
    for row in range(4):
        for column in range(3):
            found = [field(made, number, row, column) for number in range(6)]
            assert found == [7, 5, 4, row, 3 * row + column, 2**62 + 2]


def test_writing_changes_that_element_alone():
    made = box()
    assert write(made, 2, 1) == 0
    assert made.line.tolist() == [0, 1, 100, 3, 4]
    assert np.flatnonzero(made.grid.ravel() != np.arange(12)).tolist() == [7]
    assert (made.grid[2, 1], made.word[0]) == (1007, 2**62 + 2)


def test_two_classes_are_not_confused():
    assert of_twin(Twin(np.array([30]), 12)) == 42
    assert field(box(), 0, 0, 0) == 7


def test_arrays_are_passed_as_they_are():
    assert of_array(np.arange(10, 20), 3) == 23


def test_the_layout_tells_kinds_names_and_order_apart():
    values = [7, np.arange(5), np.arange(12).reshape(4, 3), np.zeros(2, np.uint64), box(), Twin(np.arange(1), 2)]
    values += [Fixed(np.arange(1)), (box(), 1), (1, box())]
    assert len({_layout(value) for value in values}) == len(values)
    assert _layout(box()) == _layout(box())


def test_what_is_registered_later_can_be_called_too():
    @compiled
    def doubled(number):
        return 2 * number

    @entry_point
    def quadrupled(number):
        return doubled(doubled(number))

    assert quadrupled(3) == 12


def test_views_travel_between_functions_and_entry_points():
    assert last_of_box(box()) == 4 + 1 + 5


def test_a_failure_of_compiled_code_is_an_error_in_python():
    assert divided(-7, 2) == -4
    with pytest.raises(ArithmeticError, match="divided"):
        divided(1, 0)


def test_what_is_fixed_cannot_be_written():
    @entry_point
    def fill(fixed):
        fixed.line[0] = 1

    with pytest.raises(TypingError):
        fill(Fixed(np.zeros(1, np.int64)))


def test_a_view_takes_as_many_indices_as_it_has_dimensions():
    @entry_point
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


def test_equal_types_are_one_type_and_others_are_not():
    assert View(1, types.int64, fixed=True) == View(1, types.int64, fixed=True) != View(1, types.int64, fixed=False)
    assert kind_of(box()) == kind_of(box()) != kind_of(Twin(np.arange(1), 2))
    line = View(1, types.int64, fixed=False)
    assert Table("a", (("x", types.int64),)) != Table("a", (("x", line),)) != Table("a", (("y", line),))


@pytest.mark.parametrize(("begin", "end", "steps"), [(1, 4, 1), (1, 5, -1), (0, 3, 2), (2, 2, 1)])
def test_compiled_code_moves_elements_as_python_does(begin, end, steps):
    moved, expected = box(), np.arange(5)
    move_in_line(moved, begin, end, steps)
    move_within(expected, begin, end, steps)
    assert moved.line.tolist() == expected.tolist()


def test_nothing_moves_in_fixed_arrays():
    @entry_point
    def move_fixed(fixed):
        move_within(fixed.line, 0, 1, 1)

    with pytest.raises(TypingError):
        move_fixed(Fixed(np.arange(3)))
