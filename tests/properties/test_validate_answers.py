"""Findings of validate in full, for small systems of all features with a fault or two in them."""

import random
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from fractions import Fraction

import pytest

import every_verb
from golden_answers import assert_seeds, findings
from halpipe.core.durations import ZERO, Duration
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.codes import UNUSED_RESOURCE

LEFT_ALONE = {"at", "origin", "source", "digest", "health", "transfers", "bandwidth", "weight", "kind", "name"}


def faulty(rng, value, name=""):
    """Return a value with one change somewhere inside."""
    if isinstance(value, tuple):
        return in_list(rng, value, name)
    if is_dataclass(value):
        held = [each.name for each in fields(value) if each.init and each.name not in LEFT_ALONE]
        stated = [name for name in held if getattr(value, name) not in (None, ())]
        if not stated:
            return value
        chosen = rng.choice(stated)
        return replace(value, **{chosen: faulty(rng, getattr(value, chosen), chosen)})
    if isinstance(value, Duration):
        return rng.choice((ZERO, value * 2, value / 2, value * 10, value / 3, value + Duration(1)))
    if isinstance(value, Enum):
        return rng.choice(list(type(value)))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice((value + 1, value * 3, 0))
    if isinstance(value, Fraction):
        return rng.choice((Fraction(0), value * 2, value / 2, Fraction(3, 2)))
    return rng.choice(("t0", "t1", "u0", "u1", "v", "w", "r", "l", "m", "gone"))


def in_list(rng, values, name):
    """Return a list with one element changed, or one too few or too many."""
    place = rng.randrange(len(values)) if values else 0
    if not values:
        return values
    kind = rng.randrange(8)
    if kind == 0:
        return values[:place] + values[place + 1 :]
    if kind == 1:
        return (*values, values[place])
    return (*values[:place], faulty(rng, values[place], name), *values[place + 1 :])


def system(seed):
    rng = random.Random(seed)
    drawn = every_verb.system(seed)[0]
    part = rng.choice(("tasks", "tasks", "tasks", "modes", "chains", "units", "resources", "transitions", "tasks"))
    for _ in range(rng.choice((1, 1, 2))):
        drawn = replace(drawn, **{part: in_list(rng, getattr(drawn, part), part)})
    return drawn


@pytest.mark.parametrize("begin", range(0, 600, 150))
def test_findings_are_what_they_were_before(begin):
    """Words, numbers and order; the systems without a finding are named as well."""
    found = ((seed, validate(system(seed))) for seed in range(begin, begin + 150))
    told = ((seed, [each for each in all_found if each.code != UNUSED_RESOURCE.id]) for seed, all_found in found)
    assert_seeds(f"validate-{begin}", ((seed, findings(each)) for seed, each in told), "no finding")
