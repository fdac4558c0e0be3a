"""Synthetic sets of many parameters in full: tasks, versions, windows and accesses, and what the set achieves."""

import random
from fractions import Fraction

import pytest

from golden_answers import assert_answers, job_lines
from halpipe.core.durations import milliseconds
from halpipe.core.quantities import format_rational
from halpipe.pipeline.generate import SetParameters, achieved, generate_with_witness


def parameters(rng):
    """Draw small values of all parameters."""
    units = rng.randint(1, 6)
    types = rng.randint(1, units)
    gang = Fraction(rng.randint(0, 6), 10) if units >= 2 * types else Fraction(0)
    periods = [rng.choice((5, 8, 10, 12, 30, 40)) for _ in range(rng.randint(3, 8))] if not gang else []
    return SetParameters(
        tasks=rng.randint(1, 12),
        units=units,
        unit_types=types,
        resources=rng.randint(1, 3),
        access_windows=rng.choice((None, 0, rng.randint(1, 15))),
        multi_version=Fraction(rng.randint(0, 4), 4),
        precedence=Fraction(rng.randint(0, 4), 4),
        utilisation=Fraction(rng.randint(1, 20), 20),
        slack=Fraction(rng.randint(0, 3), 12),
        fractional=rng.random() < 0.5,
        resource_fill=rng.choice((None, None, Fraction(rng.randint(0, 10), 20))),
        gang=gang,
        unlike_units=rng.random() < 0.3,
        periods=tuple(map(milliseconds, periods)) if rng.random() < 0.3 else (),
    )


def lines(seed):
    model, plan = generate_with_witness(parameters(random.Random(seed)), seed)
    yield f"{', '.join(f'{unit.name} {unit.type}' for unit in model.units)}; {achieved(model)}"
    for task in model.tasks:
        yield f"{task.name}: {task.period}, slack {format_rational(task.slack)}"
        for v in task.versions:
            yield f"  {v.name} {v.wcet} on {v.gang} of {' '.join(v.units)}"
            yield from (f"    {row.task} {row.anchor} {row.min} {row.max}" for row in v.precedences)
            yield from (f"    {a.resource} {a.start} {a.end} {format_rational(a.bound)}" for a in v.accesses)
    yield from job_lines(plan.modes[0].jobs)


@pytest.mark.parametrize("begin", [0, 20])
def test_sets_are_what_they_were_before(begin):
    """Same parameters and seed: same set, and the same schedule from which it was cut."""
    answers = {f"seed {seed}": lambda seed=seed: lines(seed) for seed in range(begin, begin + 20)}
    assert_answers(f"generate-{begin}", answers)
