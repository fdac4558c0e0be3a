"""Arrays and tables of integers."""

import pytest

from halpipe.pipeline.solve.integers import Draws, Table, filled, ints


def test_rows_lie_one_after_the_other():
    table = Table.of([(1, 2, 3), (4, 5, 6)], 3)
    assert table.flat.tolist() == [1, 2, 3, 4, 5, 6]
    assert (len(table), table[1, 0], table.column(2).tolist()) == (2, 4, [3, 6])
    assert list(table) == [(1, 2, 3), (4, 5, 6)]
    assert list(table.rows(1, 2)) == [(4, 5, 6)]


def test_a_copy_is_its_own():
    table = Table.of([(1, 2)], 2)
    copied = table.copy()
    copied[0, 1] = 7
    assert (list(table), list(copied)) == ([(1, 2)], [(1, 7)])


def test_a_table_without_rows_has_none():
    assert (len(Table.of([], 4)), list(Table.of([], 4))) == (0, [])


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1])
def test_what_needs_more_bits_is_refused(value):
    assert ints([value - 1 if value > 0 else value + 1])
    with pytest.raises(OverflowError):
        ints([value])


def test_filled():
    assert filled(3).tolist() == [0, 0, 0]
    assert filled(2, -1).tolist() == [-1, -1]
    assert filled(0).tolist() == []


def test_draws_are_those_of_splitmix64_by_the_last_bits_of_the_seed():
    for seed in (0, 2**64, -(2**64)):
        draws = Draws(seed)
        assert draws.state == 0
        assert [draws.below(2**64) for _ in range(2)] == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4]
        assert draws.state == 2 * 0x9E3779B97F4A7C15 % 2**64
