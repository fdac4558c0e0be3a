"""validate against schedules that exist: what has a valid schedule is never called impossible; and it never raises."""

from fractions import Fraction

import verify_systems as systems
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import render_text
from halpipe.core.durations import Duration
from halpipe.models import (
    Access,
    Chain,
    Mode,
    Precedence,
    Resource,
    Run,
    Task,
    TaskModel,
    Transfer,
    Transition,
    Unit,
    Version,
)
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.verify import verify
from profiles import examples

RANDOMS = st.randoms(use_true_random=False)
FAST = examples(100)

# A version that no job can use is an error even where another version saves the schedule.
ABOUT_ONE_VERSION = {codes.WCET_BEYOND_DEADLINE.id}


def impossible(system):
    return [d for d in validate(system) if d.is_error and d.code not in ABOUT_ONE_VERSION]


@FAST
@given(RANDOMS)
def test_what_has_a_valid_schedule_is_not_called_impossible(rng):
    system, _ = systems.valid_system(rng)
    assert not impossible(system), "\n".join(render_text(d) for d in impossible(system))


@FAST
@given(RANDOMS)
def test_what_has_valid_switches_is_not_called_impossible(rng):
    system, _ = systems.switching_system(rng)
    assert not impossible(system), "\n".join(render_text(d) for d in impossible(system))


@FAST
@given(RANDOMS)
def test_what_is_called_impossible_is_never_verified(rng):
    system, plan = systems.wild_system(rng)
    if impossible(system):
        assert any(d.is_error for d in verify(system, plan))


# ------------------------------------------------------------------------------------------------ wild models

NAMES = st.sampled_from(["a", "b", "c", "d", "", "two words", "ab"])
LISTS = st.lists(NAMES, max_size=3).map(tuple)
TIMES = st.one_of(
    st.integers(-2, 60).map(Duration),
    st.builds(lambda n, d: Duration(Fraction(n, d)), st.integers(1, 10**30), st.integers(1, 10**30)),
)
MAYBE = st.none() | TIMES
SHARES = st.fractions(min_value=-1, max_value=2, max_denominator=7)
SMALL = st.integers(-1, 4)
TRANSFERS = st.builds(Transfer, buffer=NAMES, symbol=NAMES, size=SMALL)
ACCESSES = st.builds(Access, resource=NAMES, start=TIMES, end=TIMES, bound=SHARES, transfers=st.tuples(TRANSFERS))
WINDOWS = st.builds(Precedence, task=NAMES, min=TIMES, max=TIMES)


def some(strategy, most=3):
    return st.lists(strategy, max_size=most).map(tuple)


VERSIONS = st.builds(
    Version, name=NAMES, wcet=MAYBE, units=LISTS, gang=SMALL, accesses=some(ACCESSES), precedences=some(WINDOWS)
)
TASKS = st.builds(
    Task, name=NAMES, period=MAYBE, slack=SHARES, offset=MAYBE, deadline=MAYBE, versions=some(VERSIONS, 2)
)
MODELS = st.builds(
    TaskModel,
    name=NAMES,
    units=some(st.builds(Unit, name=NAMES)),
    resources=some(st.builds(Resource, name=NAMES)),
    tasks=some(TASKS, 4),
    chains=some(st.builds(Chain, name=NAMES, tasks=LISTS, max_reaction=MAYBE, max_age=MAYBE)),
    modes=some(st.builds(Mode, name=NAMES, runs=some(st.builds(Run, task=NAMES, versions=LISTS), 5))),
    transitions=some(st.builds(Transition, source=NAMES, target=NAMES, max_length=MAYBE)),
)


@examples(120)
@given(MODELS)
def test_any_model_is_judged_the_same_twice_without_raising(system):
    findings = validate(system)
    assert validate(system) == findings
    for finding in findings:
        assert render_text(finding)
        assert finding.path
        assert finding.help
