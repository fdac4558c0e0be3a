"""The bound of margins against schedules that are valid by construction: none has more."""

from __future__ import annotations

import random

import pytest
import split_systems
import verify_systems

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.margins import largest_margin, least_margin
from halpipe.pipeline.measure.placement import Placement


@pytest.mark.parametrize("kind", [split_systems, verify_systems])
def test_no_valid_schedule_has_more_than_the_bound(kind):
    met = 0
    for seed in range(9000, 9300):
        system, plan = kind.valid_system(random.Random(seed))
        expansion = expand(system, system.modes[0])
        margin = least_margin(Placement.of(expansion, plan.modes[0].jobs, system.units))
        bound = largest_margin(expansion, system)
        assert margin <= bound, seed
        met += margin == bound
    assert met > 20
