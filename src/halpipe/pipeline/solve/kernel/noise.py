"""The kernel's noise: quantiles of the Gumbel distribution as integers, the same on every machine."""

from __future__ import annotations

import struct
from array import array
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.pipeline.solve.integers import Ints

SIZE = 4096


@cache
def gumbel_table() -> Ints:
    """Return round(1024 * -ln(-ln((i + 1/2) / 4096))) for i in 0..4095.

    The table is a file and not computed here, because logarithms differ in the last digit between maths
    libraries; a test recomputes it with decimal arithmetic.
    """
    data = Path(__file__).with_name("gumbel.i16").read_bytes()
    return array("q", struct.unpack(f"<{SIZE}h", data))
