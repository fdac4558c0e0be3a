"""The search for split jobs finds tables for small systems that have one, with windows, polls and narrow slack."""

import random
from unittest import mock

import pytest
import verify_oracle as oracle
from hypothesis import assume, given
from hypothesis import strategies as st
from split_systems import crowded_system, valid_system

from halpipe.pipeline.checked import schedule_model, validate_model, verify_schedule
from halpipe.pipeline.solve import schedule as search
from halpipe.pipeline.solve.edf import simulate
from halpipe.pipeline.solve.schedule import SearchOptions
from profiles import examples

OPEN = {1, 175, 195}
"""Seeds whose tables need gaps, or instants of single jobs, that earliest deadline first does not make."""


@pytest.mark.slow  # single windows and polls: unit/pipeline/test_edf.py
def test_systems_that_have_a_table_get_one():
    missing = set()
    for seed in range(200):
        owner, _ = valid_system(random.Random(seed))
        if any(v.split.is_allowed for t in owner.tasks for v in t.versions):
            found = schedule_model(owner, SearchOptions(budget=1000), lambda *_: True)
            missing |= set() if found.is_complete else {seed}
    assert missing <= OPEN


class _Watched(simulate._Simulation):
    """A simulation of which no event lies in the past."""

    now = 0

    def _at(self, time, kind, job, number):
        assert time >= self.now, "an event in the past"
        super()._at(time, kind, job, number)

    def _run_until(self, end):
        while self.events and self.events[0][0] < end:
            self.now = self.events[0][0]
            super()._run_until(self.now + 1)


@examples(60)
@given(st.integers(0, 2**32))
def test_what_is_called_valid_is(seed):
    """Deadlines are longer than periods, and several jobs of one task are on one unit."""
    owner, plan = crowded_system(random.Random(seed))
    assert oracle.broken(owner, plan) == set()
    assume(not any(d.is_error for d in validate_model(owner)))
    with mock.patch.object(simulate, "_Simulation", _Watched):
        found = search.schedule_model(owner, SearchOptions(budget=100), lambda *_: True)
    if found.is_complete:
        assert [d.message for d in verify_schedule(owner, found.schedule) if d.is_error] == []
        assert oracle.broken(owner, found.schedule) == set()
        assert all(table.cost.total <= 0 for table in found.schedule.modes)
