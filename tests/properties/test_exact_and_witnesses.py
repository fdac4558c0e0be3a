"""The exact engine, the annealer, validate and the witnesses held against each other."""

import pytest
import verify_systems as systems
from explain_systems import random_system
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import render_text
from halpipe.models import Status
from halpipe.pipeline.explain.witnesses import ABOUT_A_MODE, find_witnesses
from halpipe.pipeline.solve.exact import Answer, Effort, solve_exact
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from profiles import examples

pytest.importorskip("ortools")

RANDOMS = st.randoms(use_true_random=False)
MANY = examples(100)
SOME = examples(40)


def exact(system):
    """The answer for the only mode; that a schedule found passes verify is checked inside."""
    return solve_exact(system, system.modes[0], Effort(work=20)).status


def texts(system):
    return "\n".join(render_text(d) for hopeless in find_witnesses(system) for d in hopeless.diagnostics)


@MANY
@given(RANDOMS)
def test_the_exact_engine_schedules_what_has_a_schedule(rng):
    system, _ = systems.valid_system(rng)
    assert exact(system) is Answer.FEASIBLE


@MANY
@given(RANDOMS)
def test_no_witness_against_what_has_a_schedule(rng):
    system, _ = systems.valid_system(rng)
    assert not find_witnesses(system), texts(system)


@MANY
@given(RANDOMS)
def test_no_witness_against_modes_between_which_there_are_switches(rng):
    system, _ = systems.switching_system(rng)
    assert not find_witnesses(system), texts(system)


@MANY
@given(RANDOMS)
def test_what_a_witness_calls_hopeless_the_exact_engine_does_too(rng):
    system = random_system(rng)
    if any(d.is_error for d in validate(system)):
        return
    if find_witnesses(system):
        assert exact(system) is Answer.INFEASIBLE, texts(system)


@MANY
@given(RANDOMS)
def test_what_validate_calls_impossible_the_exact_engine_does_too(rng):
    system = random_system(rng)
    errors = {d.code for d in validate(system) if d.is_error}
    if errors and errors <= ABOUT_A_MODE:
        assert exact(system) is Answer.INFEASIBLE


@SOME
@given(RANDOMS)
def test_the_annealer_finds_nothing_that_the_exact_engine_denies(rng):
    system = random_system(rng)
    if any(d.is_error for d in validate(system)):
        return
    found = schedule_model(system, SearchOptions(budget=200), lambda *_: True).schedule.modes[0].status
    answer = exact(system)
    assert not (found is Status.VALID and answer is Answer.INFEASIBLE)
    assert answer is not Answer.UNKNOWN
