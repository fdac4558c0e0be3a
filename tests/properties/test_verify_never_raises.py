"""verify answers on any model and any schedule: wild systems in which values are replaced at random, many at a time."""

import random
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from fractions import Fraction

import pytest
import verify_systems as systems

from halpipe.core.diagnostics import Diagnostic
from halpipe.core.durations import Duration
from halpipe.models import ModeSchedule, Schedule
from halpipe.pipeline.verify import verify
from profiles import volume

NAMES = ("t0", "t1", "t2", "v0", "v1", "a", "b", "r", "one", "two", "c", "nobody", "")
TIMES = (0, 1, -1, 10**6, Fraction(1, 3), Fraction(10**30, 7), 10**40)
OPTIONAL = {"wcet", "period", "offset", "deadline", "max_reaction", "max_age", "max_length"}


def vandalise(rng, value, rate):
    """Return `value` with parts replaced by others of the same type; only what the types admit."""
    if isinstance(value, tuple):
        kept = [vandalise(rng, item, rate) for item in value if rng.random() > rate / 2]
        return tuple(kept + ([rng.choice(kept)] if kept and rng.random() < rate else []))
    if is_dataclass(value) and not isinstance(value, (Duration, Diagnostic)):
        changed = {
            f.name: vandalise(rng, getattr(value, f.name), rate) for f in fields(value) if f.name != "at" and f.init
        }
        changed |= {name: None for name in OPTIONAL & changed.keys() if rng.random() < rate}
        return replace(value, **changed)
    if rng.random() > rate or value is None or isinstance(value, Enum | bool):
        return value
    if isinstance(value, Duration):
        return Duration(rng.choice(TIMES))
    if isinstance(value, str):
        return rng.choice(NAMES)
    return rng.choice((-1, 0, 1, 2, 10**6)) if isinstance(value, int) else rng.choice((Fraction(-1), Fraction(7, 3)))


def check(seeds):
    for seed in seeds:
        rng = random.Random(seed)
        system, plan = rng.choice((systems.wild_switch, systems.switching_system))(rng)
        rate = rng.choice((0.01, 0.05, 0.2))
        found = verify(vandalise(rng, system, rate), vandalise(rng, plan, rate))
        assert all(isinstance(d, Diagnostic) and d.message and d.path for d in found)


def test_any_model_and_schedule_gets_an_answer():
    check(range(400))


@pytest.mark.slow
def test_any_model_and_schedule_gets_an_answer_at_length():
    check(range(1000, 1000 + volume(1500)))


def test_the_answer_is_the_same_each_time():
    system, plan = systems.wild_switch(random.Random(5))
    assert verify(system, plan) == verify(system, plan)


def test_the_order_of_jobs_and_tables_does_not_matter():
    for seed in range(60):
        rng = random.Random(seed)
        system, plan = systems.wild_switch(rng)
        shuffled = Schedule(
            model=plan.model,
            model_sha256=plan.model_sha256,
            modes=tuple(shuffle(rng, mode) for mode in reversed(plan.modes)),
            transitions=plan.transitions,
        )
        assert {d.code for d in verify(system, shuffled)} == {d.code for d in verify(system, plan)}


def shuffle(rng, table: ModeSchedule):
    return replace(table, jobs=tuple(rng.sample(table.jobs, len(table.jobs))))
