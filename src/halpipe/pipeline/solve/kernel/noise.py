"""The kernel's noise: quantiles of the Gumbel distribution as integers, the same on every machine."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIZE = 4096


def gumbel_table() -> NDArray[np.int64]:
    """Return round(1024 * -ln(-ln((i + 1/2) / 4096))) for i in 0..4095.

    The table is a file and not computed here, because logarithms differ in the last digit between maths
    libraries; a test recomputes it with decimal arithmetic.
    """
    data = resources.files(__package__).joinpath("gumbel.i16").read_bytes()
    return np.frombuffer(data, dtype="<i2").astype(np.int64)
