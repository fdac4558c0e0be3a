"""The table of the kernel's noise is what its docstring says, to the last digit."""

from decimal import Decimal, localcontext
from itertools import pairwise

from halpipe.pipeline.solve.kernel.kernel import SIZE, gumbel_table


def test_the_table_is_that_of_decimal_arithmetic():
    with localcontext() as context:
        context.prec = 50
        exact = [-(-(((Decimal(i) + Decimal("0.5")) / SIZE).ln())).ln() * 1024 for i in range(SIZE)]
        expected = [int(value.to_integral_value()) for value in exact]
    table = gumbel_table()
    assert table.itemsize == 8
    assert table.tolist() == expected


def test_quantiles_rise_and_are_nearly_centred_on_eulers_constant():
    table = gumbel_table()
    assert all(low <= high for low, high in pairwise(table))
    assert abs(sum(table) - round(0.5772156649 * 1024 * SIZE)) < SIZE
