"""verify against the brute-force oracle: valid schedules are accepted, broken ones found, for the right rule."""

import random
from collections import Counter

import pytest
import verify_mutants as mutants
import verify_oracle as oracle
import verify_systems as systems
from hypothesis import assume, example, given
from hypothesis import strategies as st

from halpipe.core.diagnostics import render_text
from halpipe.pipeline.verify import codes, verify
from profiles import examples, volume

# The rule of the oracle to which each code belongs; what stands for something malformed is "file".
RULE_OF = {
    codes.MISSING_JOB.id: "complete",
    codes.SURPLUS_JOB.id: "complete",
    codes.REPEATED_JOB.id: "complete",
    codes.WRONG_VERSION.id: "version",
    codes.WRONG_UNIT.id: "unit",
    codes.NOT_PERIODIC.id: "periodic",
    codes.LATE.id: "deadline",
    codes.OVERLAP.id: "exclusive",
    codes.OVERLOAD.id: "access",
    codes.OUT_OF_WINDOW.id: "precedence",
    codes.CHAIN_LIMIT.id: "chain",
    codes.TOO_LONG.id: "length",
    codes.WRONG_FIGURE.id: "length",
    codes.STARVED.id: "starved",
    codes.AGAINST_ITSELF.id: "itself",
    codes.STARTED_EARLY.id: "early",
}

RANDOMS = st.randoms(use_true_random=False)
FAST = examples(80)


def errors(system, plan):
    return [d for d in verify(system, plan) if d.is_error]


def told(found):
    return "\n".join(render_text(d) for d in found)


@FAST
@given(RANDOMS)
def test_schedules_valid_by_construction_are_accepted(rng):
    system, plan = systems.valid_system(rng)
    assert oracle.broken(system, plan) == set()
    assert not errors(system, plan), told(errors(system, plan))


@FAST
@given(RANDOMS)
def test_switches_valid_by_construction_are_accepted(rng):
    system, plan = systems.switching_system(rng)
    assert oracle.broken(system, plan) == set()
    assert not errors(system, plan), told(errors(system, plan))


@examples(5)
@given(rng=RANDOMS)
@pytest.mark.parametrize("name", mutants.OPERATORS)
def test_every_broken_mutant_is_found_and_every_equivalent_one_accepted(name, rng):
    make = systems.switching_system if "switch" in name or rng.random() < 0.3 else systems.valid_system
    mutant = mutants.OPERATORS[name](rng, *make(rng))
    assume(mutant is not None)
    expected = oracle.broken(*mutant)
    assert bool(errors(*mutant)) == bool(expected), f"oracle: {expected}\n{told(errors(*mutant))}"


def breaks(name, seed, make):
    """Tell whether the operator, so seeded, breaks a schedule; verify must say the same as the oracle."""
    rng = random.Random(f"{seed} {name}")
    mutant = mutants.OPERATORS[name](rng, *make(rng))
    if mutant is None:
        return False
    expected = oracle.broken(*mutant)
    assert bool(errors(*mutant)) == bool(expected), f"{name} {seed}: {expected}\n{told(errors(*mutant))}"
    return bool(expected)


@pytest.mark.parametrize("name", mutants.OPERATORS)
def test_every_operator_breaks_schedules(name):
    assert any(breaks(name, seed, systems.switching_system) for seed in range(60))


@pytest.mark.slow
@pytest.mark.parametrize("make", [systems.valid_system, systems.switching_system])
def test_mutants_at_length(make):
    found = Counter(breaks(name, seed, make) for seed in range(25) for name in mutants.OPERATORS)
    assert found[True] > 500


def rules_found(system, plan):
    """Return the broken rules by mode; those of switches as a whole."""
    by_mode, on_line = set(), set()
    for finding in errors(system, plan):
        rule = RULE_OF.get(finding.code, "file")
        if finding.path.startswith("transition"):
            on_line.add(rule)
        else:
            by_mode.add((rule, finding.path.split('"')[1]))
    return by_mode, on_line


def compare_rules(system, plan):
    expected = oracle.broken(system, plan)
    modes = {(rule, where) for rule, where in expected if not isinstance(where, tuple)}
    line = {rule for rule, where in expected if isinstance(where, tuple)}
    by_mode, on_line = rules_found(system, plan)
    # where a task has no phase, its deadlines have no single meaning
    loose = {("deadline", where) for rule, where in modes if rule == "periodic"}
    assert by_mode - loose == modes - loose
    in_modes = {rule for rule, _ in modes}
    # what is broken within a mode is broken on the line as well, and verify reports it once
    assert on_line <= line
    assert line - in_modes <= on_line


@examples(250)
@given(RANDOMS)
def test_the_same_rules_are_broken_in_wild_schedules(rng):
    compare_rules(*systems.wild_system(rng))


@examples(150)
@given(RANDOMS)
@example(random.Random(0))
def test_the_same_rules_are_broken_in_wild_switches(rng):
    compare_rules(*systems.wild_switch(rng))


@pytest.mark.slow
@pytest.mark.parametrize("make", [systems.wild_system, systems.wild_switch])
def test_wild_schedules_at_length(make):
    for seed in range(volume(400)):
        compare_rules(*make(random.Random(seed)))
