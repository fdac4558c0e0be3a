"""Searches of small systems in full: which of several schedules of equal worth is found, and with how much work."""

import random
from dataclasses import replace
from fractions import Fraction
from functools import partial

import pytest
import refined_systems
import scheduler_systems
import split_systems
import verify_systems

import every_verb
from golden_answers import assert_answers, searched
from halpipe.models import WHOLE
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.schedule import SearchOptions

BUDGET = 300


def first(model, **options):
    """Return the schedule of a quick search."""
    chosen = SearchOptions(budget=BUDGET, optimise=(), **options)
    return schedule_model(model, chosen, lambda *_: True).schedule


def longer(model):
    """Return the model with a WCET of its last task that is an eighth longer, in one piece and without phases."""
    *rest, last = model.tasks
    versions = tuple(replace(v, wcet=v.wcet * Fraction(9, 8), accesses=(), split=WHOLE) for v in last.versions)
    return replace(model, tasks=(*rest, replace(last, versions=versions)))


def finer(model):
    """Return a fifth of the first period that is stated."""
    return next(task.period for task in model.tasks if task.period is not None) / 120


VERBS = {
    "margin": lambda model: searched(model, budget=BUDGET),
    "first": lambda model: searched(model, budget=BUDGET, optimise=()),
    "seed 7": lambda model: searched(model, budget=BUDGET, optimise=(), seed=7),
    "optimise cost": lambda model: searched(model, budget=100, optimise=(Objective.COST,)),
    "optimise jitter": lambda model: searched(model, budget=100, optimise=(Objective.JITTER, Objective.MARGIN)),
    "optimise chains": lambda model: searched(model, budget=100, optimise=(Objective.CHAINS, Objective.COST)),
    "optimise preemptions": lambda model: searched(model, budget=100, optimise=(Objective.PREEMPTIONS,)),
    "optimise margin": lambda model: searched(model, budget=60, optimise=(Objective.MARGIN, Objective.JITTER)),
    "near": lambda model: searched(longer(model), budget=BUDGET, near=first(model)),
    "freeze": lambda model: searched(longer(model), budget=BUDGET, shipped=first(model)),
    "freeze all": lambda model: searched(model, budget=BUDGET, optimise=(), shipped=first(model)),
    "tick": lambda model: searched(model, budget=BUDGET, optimise=(), tick=finer(model)),
    "turns": lambda model: searched(model, effort=0, spare=2000, optimise=()),
}


FAMILIES = {
    "every": lambda seed: every_verb.system(seed)[0],
    "whole": lambda seed: verify_systems.valid_system(random.Random(seed))[0],
    "split": lambda seed: split_systems.valid_system(random.Random(seed))[0],
    "crowded": lambda seed: split_systems.crowded_system(random.Random(seed))[0],
    "refined": lambda seed: refined(verify_systems, seed),
    "refined-split": lambda seed: refined(split_systems, seed),
    "switching": lambda seed: verify_systems.switching_system(random.Random(seed))[0],
    "switching-split": lambda seed: split_systems.switching_system(random.Random(seed))[0],
    "random": scheduler_systems.random_model,
    "set": lambda seed: generate(SetParameters(tasks=8 + seed % 5, units=4, utilisation=Fraction(4, 5)), seed),
    "gangs": lambda seed: generate(GANGS, seed),
}
"""Systems of a seed."""

GANGS = SetParameters(
    tasks=10, units=4, gang=Fraction(1, 4), multi_version=Fraction(1, 2), precedence=Fraction(1, 2), fractional=True
)

SEARCHES = {
    "margin": "every 2, every 21, whole 3, split 4, refined 5, switching 3, random 8, set 1, gangs 2",
    "first": "every 10, every 134, whole 13, split 14, crowded 15, switching-split 3, random 18, set 11, gangs 12",
    "seed 7": "every 0, every 11, whole 3, split 14, crowded 15, random 28, set 11, gangs 12",
    "near": "every 64, every 10, whole 1, split 2, refined 3, refined-split 4, switching 7, random 38, gangs 2",
}
"""Systems by verb: names of families, and seeds."""


def refined(family, seed):
    """Return a system with a schedule, and requirements of MODEL 10."""
    rng = random.Random(seed)
    return refined_systems.refined(rng, *family.valid_system(rng))


@pytest.mark.parametrize("verb", SEARCHES)
def test_searches_find_what_they_found_before(verb):
    """Jobs, figures, tables of switches and the count of the work, to the tick."""
    answers = {}
    for name in SEARCHES[verb].split(", "):
        family, seed = name.split()
        answers[name] = partial(VERBS[verb], FAMILIES[family](int(seed)))
    assert_answers(f"search-{verb.replace(' ', '-')}", answers)
