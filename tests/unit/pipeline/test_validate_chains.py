"""Cause-effect chains and transitions."""

from dataclasses import replace

import pytest
from validate_cases import codes_of, found, the

from halpipe.core.diagnostics import Severity
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.verify import verify
from halpipe.pipeline.verify.codes import CHAIN_LIMIT
from support import after, chain, mode, model, schedule, task, version
from support import job as place_job

A = task("a", 25, version("v", 5), version("short", 3))
B = task("b", 25, version("v", 7, "u1", after("a", 0, 25)))


def chained(*chains, tasks=(A, B), **more):
    return model(*tasks, chains=chains, **more)


def test_sound_chain():
    assert validate(chained(chain("c", "a b", 50, 40))) == ()


def test_chain_without_tasks():
    assert the(chained(chain("c", "")), codes.EMPTY_CHAIN).path == 'chain "c"'


def test_chain_that_passes_a_task_twice():
    back = replace(A, versions=(version("v", 5, "u1"),))
    assert the(chained(chain("c", "a b a"), tasks=(back, B)), codes.REPEATED_IN_CHAIN).severity is Severity.WARNING


def test_chain_in_some_modes_only():
    modes = [mode("m", [A, B]), mode("n", [A])]
    finding = the(chained(chain("c", "a b"), modes=modes), codes.CHAIN_NOT_IN_MODE)
    assert finding.message == 'is not checked in mode "n", where "b" does not run'
    assert found(chained(chain("c", "a b")), codes.CHAIN_NOT_IN_MODE) == []


def test_chain_in_no_mode():
    free = task("b", 25, version("v", 7))
    system = chained(chain("c", "a b"), tasks=(A, free), modes=[mode("m", [A]), mode("n", [free])])
    assert the(system, codes.CHAIN_NEVER_RUNS).severity is Severity.WARNING
    assert found(system, codes.CHAIN_NOT_IN_MODE) == []


@pytest.mark.parametrize(("reaction", "age"), [("35ms", None), (None, "10ms")])
def test_limits_that_can_just_be_kept(reaction, age):
    assert validate(chained(chain("c", "a b", reaction, age))) == ()


@pytest.mark.parametrize(("reaction", "age"), [("34999999ns", None), (None, "9999999ns"), ("0ms", None), (None, "0ms")])
def test_limits_that_cannot_be_kept(reaction, age):
    assert the(chained(chain("c", "a b", reaction, age)), codes.CHAIN_LIMIT_TOO_LOW).is_error


@pytest.mark.parametrize(("slack", "second"), [(0, 25), (1, 25), (1, 30), (1, 48)])
def test_reaction_bound_is_what_verify_finds_at_best(slack, second):
    """However the second job of the first task is delayed, verify never sees a reaction below the bound."""
    first = task("a", 25, version("v", 2), slack=slack)
    system = model(first, task("b", 50, version("v", 1, "u2")), units="u1 u2", chains=[chain("c", "a b", 1000)])
    at_bound = replace(system, chains=(chain("c", "a b", "27999999ns"),))
    assert found(at_bound, codes.CHAIN_LIMIT_TOO_LOW)
    jobs = [
        place_job(system, "a", 0, 0, "u1"),
        place_job(system, "a", 1, second, "u1"),
        place_job(system, "b", 0, 2, "u2"),
    ]
    table = schedule(system, 50, *jobs)
    assert CHAIN_LIMIT.id in {d.code for d in verify(at_bound, table)}


def test_first_task_on_demand_adds_no_period():
    server = task("a", None, version("v", 3))
    assert validate(chained(chain("c", "a b", 10), tasks=(server, B))) == ()


TWO = [mode("m", [A, B]), mode("n", [A, B])]


def test_transitions():
    assert validate(model(A, B, modes=TWO, transitions=[("m", "n", "0ms"), ("n", "m", None)])) == ()


def test_transition_to_itself():
    assert codes_of(model(A, B, modes=TWO, transitions=[("m", "m", None)])) == {codes.SELF_TRANSITION.id}


def test_transition_listed_twice():
    system = model(A, B, modes=TWO, transitions=[("m", "n", "1ms"), ("m", "n", "2ms")])
    assert codes_of(system) == {codes.DUPLICATE_TRANSITION.id}
