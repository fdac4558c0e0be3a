"""explain answers on any model, and says the same twice."""

import verify_systems as systems
from explain_systems import random_system
from hypothesis import given
from hypothesis import strategies as st
from test_validate_soundness import MODELS

from halpipe.core.diagnostics import render_text
from halpipe.pipeline.explain.explanation import ExplainOptions, Verdict, explain
from profiles import examples

RANDOMS = st.randoms(use_true_random=False)


def answer(system, plan=None):
    explanation = explain(system, ExplainOptions(schedule=plan, remedies=False), budget=20)
    for diagnostic in explanation.diagnostics:
        assert render_text(diagnostic)
        assert diagnostic.path
        assert diagnostic.help
    return explanation


@examples(100)
@given(MODELS)
def test_wild_models(system):
    assert answer(system) == answer(system)


@examples(40)
@given(RANDOMS)
def test_wild_schedules(rng):
    system, plan = systems.wild_system(rng)
    assert answer(system, plan) == answer(system, plan)


@examples(40)
@given(RANDOMS)
def test_hard_systems(rng):
    system = random_system(rng)
    first = answer(system)
    assert first == answer(system)
    assert {verdict for _, verdict in first.verdicts} <= set(Verdict)
