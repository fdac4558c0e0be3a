"""What is scheduled on the grid of regulators is a schedule of the model itself, and every window has room for it."""

from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scheduler_systems import random_model

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.exporters.regulator.frames import Framer, grid_of
from halpipe.exporters.regulator.rounding import charged, promises, totals, whole
from halpipe.pipeline.checked import schedule_model, validate_model
from halpipe.pipeline.solve.codes import GRID_BREAKS
from halpipe.pipeline.solve.quantise import BurstGrid
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify
from profiles import examples

BURST = 64


def scheduled(system, grid):
    """A schedule on the grid, None where there is none; verify must never be what refuses it."""
    try:
        found = schedule_model(system, SearchOptions(budget=500, grid=grid), lambda *_: True)
    except HalpipeError as refused:
        if GRID_BREAKS.id in {diagnostic.code for diagnostic in refused.diagnostics}:
            raise
        return None
    return found if found.is_complete else None


@pytest.mark.slow
@examples(150)
@given(
    st.integers(0, 2**32),
    st.sampled_from((2, 3, 8)),
    st.sampled_from((7, 24, 100)),
    st.sampled_from((0, 10, 64)),
    st.booleans(),
)
def test_schedules_on_the_grid_verify_and_fit_their_windows(seed, grain, bursts, reserve, carries):
    system = random_model(seed, grain)
    assume(not any(found.is_error for found in validate_model(system)))
    promise = Fraction(bursts * BURST)
    grid = BurstGrid(
        name="p", window=milliseconds(1), cycle=milliseconds(Fraction(1, 1000)), resource="r", promise=promise,
        capacity=bursts * BURST + 6 * reserve + 3 * BURST * carries, burst=BURST, reserve=reserve, carries=carries,
    )  # fmt: skip
    found = scheduled(system, grid)
    if found is None:
        return
    assert not any(violation.is_error for violation in verify(system, found.schedule))
    ticks = grid_of(system, found.schedule, grid.window)
    (frame,) = Framer(system, found.schedule, "r", ticks, "read").frames()
    granted = whole(promises(frame, ticks.window, promise / BURST))
    windows = frame.span // ticks.window
    room = (grid.capacity - reserve * len(granted)) // BURST
    last = {row for row, values in granted.items() if values[-1]}
    sums = charged(granted, windows, last) if carries else totals(granted, windows)
    assert max(sums, default=0) <= room
