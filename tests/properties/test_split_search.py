"""The search for split jobs finds tables for small systems that have one, with windows, polls and narrow slack."""

import random
from dataclasses import replace
from fractions import Fraction
from unittest import mock

import pytest
import verify_oracle as oracle
from split_systems import crowded_system, valid_system

from edf_reference import Compared
from halpipe.models import Split
from halpipe.pipeline.checked import schedule_model, validate_model, verify_schedule
from halpipe.pipeline.solve import schedule as search
from halpipe.pipeline.solve.edf import trials
from halpipe.pipeline.solve.schedule import SearchOptions
from profiles import volume
from support import access, model, ms, task, version

OPEN = {1, 175, 195}
"""Seeds whose tables need gaps, or instants of single jobs, that earliest deadline first does not make."""


@pytest.mark.slow  # single windows and polls: unit/pipeline/test_edf.py
def test_systems_that_have_a_table_get_one():
    missing = set()
    for seed in range(min(200, volume(60))):
        owner, _ = valid_system(random.Random(seed))
        if any(v.split.is_allowed for t in owner.tasks for v in t.versions):
            found = schedule_model(owner, SearchOptions(budget=1000), lambda *_: True)
            missing |= set() if found.is_complete else {seed}
    assert missing <= OPEN


def test_a_job_that_had_to_begin_may_be_interrupted_by_another_that_has_to():
    """The first job starts at 0 and is cut at 1 ms, where the other task must start; both are strictly periodic."""
    often = task("often", 4, replace(version("v", 3, "a"), split=Split(points=(ms(1), ms(2)))), offset=0, deadline=7)
    owner = model(often, task("rare", 6, version("v", 1, "a")), units="a")
    assert schedule_model(owner, SearchOptions(budget=1000), lambda *_: True).is_complete


def test_a_job_waits_for_one_on_another_unit_that_needs_the_same_resource():
    early = task("early", 4, version("v", 3, "b", access("r", 0, 1, "2/3")), slack=Fraction(1, 4), offset=0)
    late = task("late", 4, version("v", 2, "a", access("r", 0, 2, "1/2")), slack=1, deadline=6)
    split = replace(late, versions=(replace(late.versions[0], split=Split(anywhere=True, max_gaps=2)),))
    owner = model(split, early, units="a b", resources="r")
    assert schedule_model(owner, SearchOptions(budget=1000), lambda *_: True).is_complete


@pytest.mark.slow
def test_what_is_called_valid_is():
    """Deadlines are longer than periods, tasks have several jobs on a unit; every table is the reference's."""
    searched = [seed for seed in range(60) if is_searched(seed)]
    assert len(searched) > 30


def is_searched(seed):
    """Search a system, if it validates; a table that is called valid is one by verify, the oracle and the cost."""
    owner, plan = crowded_system(random.Random(seed))
    assert oracle.broken(owner, plan) == set()
    if any(d.is_error for d in validate_model(owner)):
        return False
    with mock.patch.object(trials, "Simulator", Compared):
        found = search.schedule_model(owner, SearchOptions(budget=100, optimise=()), lambda *_: True)
    if found.is_complete:
        assert [d.message for d in verify_schedule(owner, found.schedule) if d.is_error] == []
        assert oracle.broken(owner, found.schedule) == set()
        assert all(table.cost.total <= 0 for table in found.schedule.modes)
    return True
