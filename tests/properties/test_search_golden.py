"""Searches of small systems in full: which of several schedules of equal worth is found, and with how much work."""

import random
from dataclasses import replace
from fractions import Fraction
from functools import partial
from importlib import metadata
from unittest.mock import patch

import pytest
import refined_systems
import scheduler_systems
import split_systems
import verify_systems

import every_verb
from golden_answers import assert_answers, programs, searched, solved, switched
from halpipe.models import WHOLE, Schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import one_mode
from halpipe.pipeline.solve.quantise import BurstGrid
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate

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


def in_groups(model):
    """Search the independent groups of a mode one by one, as in a mode of many tasks."""
    with patch.object(one_mode, "FEW_TASKS", 1):
        return searched(model, budget=BUDGET, optimise=())


def on_grid(model):
    """Search on the windows of a regulator of the first resource of the model."""
    grid = BurstGrid(
        name="p", window=finer(model) * 10, cycle=finer(model) / 10, resource=model.resources[0].name,
        promise=Fraction(30 * 64), capacity=42 * 64, burst=64, reserve=64, carries=len(model.tasks) % 2 == 0,
    )  # fmt: skip
    return searched(model, budget=BUDGET, optimise=(), grid=grid)


def stopped(model):
    """Stop the search at its third report."""
    return searched(model, budget=BUDGET, stop=3)


def switches(model):
    """Find tables between modes that were searched one by one, so that their jobs lie unlike."""
    modes = [first(model, modes=(mode.name,), seed=seed).modes[0] for seed, mode in enumerate(model.modes)]
    return switched(model, Schedule(model=model.name, modes=tuple(modes)))


VERBS = {
    "margin": lambda model: searched(model, budget=BUDGET),
    "first": lambda model: searched(model, budget=BUDGET, optimise=()),
    "seed 7": lambda model: searched(model, budget=BUDGET, optimise=(), seed=7),
    "optimise cost": lambda model: searched(model, budget=100, optimise=(Objective.COST,)),
    "optimise jitter": lambda model: searched(model, budget=100, optimise=(Objective.JITTER, Objective.MARGIN)),
    "optimise chains": lambda model: searched(model, budget=100, optimise=(Objective.CHAINS, Objective.COST)),
    "optimise preemptions": lambda model: searched(model, budget=100, optimise=(Objective.PREEMPTIONS,)),
    "optimise margin": lambda model: searched(model, budget=60, optimise=(Objective.MARGIN, Objective.JITTER)),
    "target": lambda model: searched(model, budget=100, optimise=(Objective.COST,), target=Fraction(-3, 5)),
    "freeze": lambda model: searched(longer(model), budget=BUDGET, shipped=first(model)),
    "freeze all": lambda model: searched(model, budget=BUDGET, optimise=(), shipped=first(model)),
    "tick": lambda model: searched(model, budget=BUDGET, optimise=(), tick=finer(model)),
    "groups": in_groups,
    "grid": on_grid,
    "stopped": stopped,
    "switches": switches,
    "open": lambda model: searched(model, spare=2000, effort=0),
    "open chains": lambda model: searched(model, optimise=(Objective.CHAINS,), effort=0),
}

EXACT_VERBS = {
    "near": lambda model: solved(longer(model), budget=BUDGET, near=first(model)),
    "exact": lambda model: solved(model, engine="exact", optimise=()),
    "exact chains": lambda model: solved(model, engine="exact", budget=100, optimise=(Objective.CHAINS,)),
    "turns": lambda model: solved(model, optimise=()),
    "turns chains": lambda model: solved(model, optimise=(Objective.CHAINS,)),
    "programs": programs,
}
"""Verbs that ask CP-SAT."""

OR_TOOLS = "9.15.6755"

FAMILIES = {
    "every": lambda seed: every_verb.system(seed)[0],
    "many": lambda seed: with_features(seed, 6),
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
    "margin": "every 77 159 198 225 274, many 37 40, switching 27, switching-split 21 25 38, random 0",
    "first": "every 142",
    "seed 7": "many 23 59",
    "optimise cost": "whole 5, switching 38, switching-split 5",
    "optimise jitter": "many 1 20 31, whole 28, split 13, crowded 1, switching-split 2, random 24, set 4",
    "optimise chains": (
        "every 126, many 32, split 39, crowded 16, refined 15 43, refined-split 38, switching-split 14 26, random 0"
    ),
    "optimise preemptions": "many 17, whole 39, refined 18, refined-split 33, switching-split 4, random 38",
    "optimise margin": "every 141 149, many 0, whole 35 37, crowded 1 33, refined 12, refined-split 38, switching 6",
    "target": "whole 23 59, refined 30 47, switching 10, switching-split 20 21",
    "freeze": (
        "every 223 241, whole 14 36, split 19 33, crowded 0, refined 20, switching 21, switching-split 19, set 13 20"
    ),
    "freeze all": "many 17 40, split 24, switching-split 13",
    "tick": "many 50, crowded 3, refined 5, switching 38",
    "groups": "many 49, refined 0 7, switching-split 20",
    "grid": (
        "many 32, whole 12 24 26, crowded 16, refined 10, "
        "refined-split 0 23, switching 10 13 27 39, set 11 22 35 36, gangs 9"
    ),
    "stopped": (
        "every 165, many 17 35, whole 10, crowded 2, "
        "refined-split 6 39, switching 3 6 25, switching-split 1 24 29 56, random 2"
    ),
    "switches": "every 157 164, many 1 10 28 38 41 59, refined-split 43, switching 11 13 45 58, random 46",
    "open": "every 81 119 262 270, many 30, split 13, refined-split 2 33, switching-split 20 33, random 9 18",
    "open chains": "whole 4 32, refined 9 14, random 13",
    "near": (
        "many 38, whole 19, split 3 41, crowded 0 17 22 30 32, refined 21, refined-split 34, "
        "switching 59, switching-split 19, random 21 39, set 32 37, gangs 26"
    ),
    "exact": (
        "every 31 178 245 262, many 51, whole 2 25, refined 8 11 27, refined-split 9 18 22 25 27, random 5, gangs 1 19"
    ),
    "exact chains": (
        "every 177 178 228 232, many 48 53, whole 2 16 23, crowded 10 24, refined 2 11 13 19 29, "
        "refined-split 2 36, switching-split 10 25, random 7, gangs 5"
    ),
    "turns": "many 23, refined-split 33, switching-split 56",
    "turns chains": "many 42, whole 4 5 35, refined 9, random 8",
    "programs": "split 59, refined 47, refined-split 43",
}
"""Systems by verb: names of families, and seeds."""


def refined(family, seed):
    """Return a system with a schedule, and requirements of MODEL 10."""
    rng = random.Random(seed)
    return refined_systems.refined(rng, *family.valid_system(rng))


def with_features(seed, count):
    """Return a valid system with several modes and more features, so many at most."""
    for again in range(100):
        rng = random.Random(f"many/{seed}/{again}")
        draft = every_verb.Draft(rng)
        chosen = {every_verb.modes, *rng.sample(every_verb.FEATURES, count)}
        for feature in (feature for feature in every_verb.FEATURES if feature in chosen):
            feature(draft)
        model = draft.model()
        if not any(finding.is_error for finding in validate(model)):
            return model
    raise AssertionError("no system is valid")


CASES = [(verb, *each.split()) for verb, families in SEARCHES.items() for each in families.split(", ")]


@pytest.mark.parametrize("case", CASES, ids=[f"{verb} {family}" for verb, family, *_ in CASES])
def test_searches_find_what_they_found_before(case):
    """Jobs, figures, tables of switches and the count of the work, to the tick."""
    verb, family, *seeds = case
    if verb in EXACT_VERBS and metadata.version("ortools") != OR_TOOLS:
        pytest.skip(f"the answers of CP-SAT are made and tested by OR-Tools {OR_TOOLS}")
    verbs = VERBS | EXACT_VERBS
    answers = {f"{verb}: {family} {seed}": partial(verbs[verb], FAMILIES[family](int(seed))) for seed in seeds}
    assert_answers(f"{verb}-{family}".replace(" ", "-"), answers)
