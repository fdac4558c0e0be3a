"""verify against the brute-force oracle where jobs are split, interrupted, bound or polled (MODEL 8)."""

import os
import random
from collections import Counter

import pytest
import split_mutants
import split_oracle
import split_systems as systems
import verify_mutants
import verify_oracle as oracle
from hypothesis import assume, given
from hypothesis import strategies as st
from test_verify_mutations import RULE_OF as OF_WHOLE_JOBS

from halpipe.core.diagnostics import render_text
from halpipe.core.durations import milliseconds
from halpipe.models import Binding
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.parts import reserved_length
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.verify.ticks import Service
from profiles import examples, volume

RANDOMS = st.randoms(use_true_random=False)
OPERATORS = {**split_mutants.OPERATORS, **verify_mutants.OPERATORS}
MUTANTS = int(os.environ.get("HALPIPE_MUTANTS", "1000"))
"""Mutants of the long test; the command in docs/explanation/verify.md asks for many more."""


def errors(system, plan):
    return [d for d in verify(system, plan) if d.is_error]


def told(found):
    return "\n".join(render_text(d) for d in found)


@examples(80)
@given(RANDOMS)
def test_schedules_valid_by_construction_are_accepted(rng):
    system, plan = systems.valid_system(rng)
    assert oracle.broken(system, plan) == set()
    assert not errors(system, plan), told(errors(system, plan))


@examples(60)
@given(RANDOMS)
def test_switches_valid_by_construction_are_accepted(rng):
    system, plan = systems.switching_system(rng)
    assert oracle.broken(system, plan) == set()
    assert not errors(system, plan), told(errors(system, plan))


@examples(60)
@given(RANDOMS)
def test_no_witness_against_what_has_a_schedule(rng):
    system, _ = systems.switching_system(rng)
    found = [d for hopeless in find_witnesses(system) for d in hopeless.diagnostics]
    found += [d for d in validate(system) if d.is_error]
    assert not found, told(found)


@pytest.mark.slow
@examples(60)
@given(RANDOMS)
def test_jobs_of_a_task_with_a_late_deadline_may_follow_closely_but_not_meet(rng):
    system, plan = systems.crowded_system(rng)
    assert oracle.broken(system, plan) == set()
    assert not errors(system, plan), told(errors(system, plan))
    late = [t.name for t in system.tasks if t.deadline is not None and t.deadline > t.period]
    jobs = [j for j in plan.modes[0].jobs if j.task in late]
    assume(len({j.task for j in jobs}) < len(jobs))
    moved = split_mutants.job_onto_the_one_before(rng, system, plan)
    assume(moved is not None)
    agrees(moved, "onto the job before")


def test_the_systems_have_all_that_there_is():
    """Gaps, gangs with gaps, gaps in gaps, interrupts, bound and polled tasks, phases behind a gap."""
    seen = Counter()
    for seed in range(100):
        system, plan = systems.valid_system(random.Random(seed))
        jobs = [j for j in plan.modes[0].jobs if j.parts]
        seen["gap"] += bool(jobs)
        seen["gang"] += any(len(j.units) > 1 for j in jobs)
        seen["interrupt"] += any(u.interrupts for u in system.units for j in jobs if u.name in j.units)
        seen["bound"] += any(t.binding is Binding.SYSTEM for t in system.tasks)
        seen["polled"] += any(t.distance is not None for t in system.tasks)
        seen["nested"] += any(
            one.start < other.start and other.end < one.end and set(one.units) & set(other.units)
            for one in jobs
            for other in plan.modes[0].jobs
        )
        seen["phase"] += any(v.accesses and v.split.is_allowed for t in system.tasks for v in t.versions)
    assert len(seen) == 7
    assert min(seen.values()) >= 5, seen


def mutant_of(name, rng):
    makes = systems.valid_system, systems.crowded_system, systems.switching_system
    make = systems.switching_system if "switch" in name else rng.choices(makes, (5, 2, 3))[0]
    return OPERATORS[name](rng, *make(rng))


def agrees(mutant, what):
    """Whether the mutant is broken; verify must say what the oracle says."""
    expected = oracle.broken(*mutant)
    assert bool(errors(*mutant)) == bool(expected), f"{what}: oracle: {expected}\n{told(errors(*mutant))}"
    return bool(expected)


@examples(6)
@given(rng=RANDOMS)
@pytest.mark.parametrize("name", split_mutants.OPERATORS)
def test_every_broken_mutant_is_found_and_every_equivalent_one_accepted(name, rng):
    mutant = mutant_of(name, rng)
    assume(mutant is not None)
    agrees(mutant, name)


@pytest.mark.parametrize("name", split_mutants.OPERATORS)
def test_every_operator_breaks_schedules(name):
    for seed in range(120):
        mutant = mutant_of(name, random.Random(f"{seed} {name}"))
        if mutant is not None and agrees(mutant, f"{name} {seed}"):
            return
    pytest.fail("no mutant of it is broken")


@pytest.mark.slow  # the same in small: the two tests above
def test_mutants_at_length():
    names, found, seed = sorted(OPERATORS), Counter(), 0
    while found.total() < MUTANTS:
        name = names[seed % len(names)]
        mutant = mutant_of(name, random.Random(f"{seed} {name}"))
        if mutant is not None:
            found[agrees(mutant, f"{name} {seed}")] += 1
        seed += 1
    assert found[True] > MUTANTS // 4
    assert found[False] > MUTANTS // 50


RULE_OF = {
    **OF_WHOLE_JOBS,
    codes.PARTS_DIFFER.id: "parts",
    codes.WRONG_GAP.id: "parts",
    codes.WRONG_LENGTH.id: "parts",
    codes.NO_LENGTH.id: "parts",
    codes.NOT_NESTED.id: "nested",
    codes.NOT_BOUND.id: "binding",
    codes.ARRIVAL_LATE.id: "deadline",
}


def same_rules(mutant, what):
    """Whether anything is broken; verify must name the rules that the oracle names."""
    expected = {rule for rule, where in oracle.broken(*mutant) if not isinstance(where, tuple)}
    if expected & {"file", "parts", "version"}:  # then the other rules have nothing certain to look at
        return agrees(mutant, what)
    found = [d for d in errors(*mutant) if not d.path.startswith("transition")]
    rules = {RULE_OF.get(d.code, "file") for d in found}
    loose = {"deadline"} if "periodic" in expected else set()  # without a phase deadlines have no single meaning
    assert rules - loose == expected - loose, f"{what}\n{told(found)}"
    return bool(expected)


@pytest.mark.parametrize("seeds", [4, pytest.param(volume(20), marks=pytest.mark.slow)])
def test_the_same_rules_are_broken(seeds):
    found = Counter()
    for name in OPERATORS:
        for seed in range(seeds):
            rng = random.Random(f"{name} {seed}")
            mutant = OPERATORS[name](rng, *systems.valid_system(rng))
            if mutant is not None:
                found[same_rules(mutant, f"{name} {seed}")] += 1
    assert found[True] > found[False] > 0


@given(st.integers(1, 20), st.lists(st.tuples(st.integers(2, 12), st.integers(1, 6)), max_size=3).map(tuple))
def test_reserved_lengths_are_those_of_the_worst_case_served_tick_by_tick(work, rows):
    expected = split_oracle.finish(work, rows)
    assert Service(rows).length(work) == expected
    times = tuple((milliseconds(distance), milliseconds(c)) for distance, c in rows)
    if expected is None:
        for service in (rows, times):
            with pytest.raises(ValueError, match="interrupts fill"):
                reserved_length(work if service is rows else milliseconds(work), service)
    else:
        assert reserved_length(work, rows) == expected
        assert reserved_length(milliseconds(work), times) == milliseconds(expected)
