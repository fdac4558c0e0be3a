"""The search for split jobs finds tables for small systems that have one, with windows, polls and narrow slack."""

import random

import pytest
from split_systems import valid_system

from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions

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
