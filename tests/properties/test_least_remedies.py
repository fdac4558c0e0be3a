"""Remedies of explain are least on the grid of the model: with one step less, the exact engine finds no schedule."""

import random
from dataclasses import replace

import pytest
from explain_systems import random_system

from halpipe.core.durations import milliseconds
from halpipe.pipeline.explain.explanation import ExplainOptions, Verdict, explain
from halpipe.pipeline.explain.remedies import Trials, remedies
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.exact import Answer, Effort, solve_exact
from halpipe.pipeline.validate import validate
from profiles import volume

FINER = 20
"""Ticks of a millisecond, beside which a hundredth of a period is coarse."""


def finer(system, rng):
    """The same system in finer times: every WCET and window is off the grid of milliseconds by some ticks."""
    tick = milliseconds(1) / FINER

    def off(time, least=0):
        return time + tick * rng.randint(least, FINER // 2)

    def version(v):
        rows = tuple(replace(row, max=off(row.max)) for row in v.precedences)
        return replace(v, wcet=off(v.wcet), precedences=rows)

    tasks = tuple(replace(t, versions=tuple(map(version, t.versions))) for t in system.tasks)
    return replace(system, tasks=tasks)


def cases(count, first):
    """Systems without a schedule of which the search or a witness says so."""
    seed = first
    while count:
        rng = random.Random(seed)
        system = random_system(rng)
        system = finer(system, rng) if seed % 2 else system
        seed += 1
        if any(d.is_error for d in validate(system)):
            continue
        if explain(system, ExplainOptions(remedies=False, exact=False), budget=200).verdicts[0][1] in (
            Verdict.INFEASIBLE,
            Verdict.NOT_FOUND,
        ):
            count -= 1
            yield seed - 1, system


def too_large(system):
    """The remedies of a system, and those of them with which one step less would do."""
    mode = system.modes[0]
    expansion = expand(system, mode)
    trials = Trials(mode.name, expansion.job_count, lambda: True, natural_tick(expansion))
    found = [each for each in remedies(system, (), trials) if each.smaller is not None]
    valid = [each for each in found if not any(d.is_error for d in validate(each.smaller))]
    answers = [solve_exact(each.smaller, mode, Effort(work=0.1)).status for each in valid]
    return found, [each.text for each, answer in zip(valid, answers, strict=True) if answer is Answer.FEASIBLE]


def fractions(count, first):
    """How many cases have remedies, and how many of those have one that is not least."""
    pytest.importorskip("ortools")
    judged = {}
    for seed, system in cases(count, first):
        found, large = too_large(system)
        if found:
            judged[seed] = large
    return judged


@pytest.mark.slow
def test_remedies_of_some_systems_are_least():
    judged = fractions(2, 13)
    assert judged
    assert not any(judged.values()), judged


@pytest.mark.slow  # the test above has the same subject
@pytest.mark.endurance
def test_remedies_of_many_systems_are_least():
    count = volume(25)
    judged = fractions(count, 1000)
    assert len(judged) >= count // 2
    assert sum(map(bool, judged.values())) <= len(judged) * 5 // 100, judged
