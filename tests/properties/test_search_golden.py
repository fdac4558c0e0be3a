"""Searches of small systems in full: which of several schedules of equal worth is found, and with how much work."""

import random
from dataclasses import replace
from fractions import Fraction
from functools import partial
from importlib import metadata
from itertools import count
from unittest.mock import patch

import pytest
import refined_systems
import scheduler_systems
import split_systems
import verify_systems

import every_verb
from golden_answers import assert_answers, programs, searched, sign, solved, switched
from golden_file import GOLDEN
from halpipe.core.diagnostics import Exit
from halpipe.models import WHOLE, Edge, Mode, Schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import one_mode, schedule
from halpipe.pipeline.solve.checkpoint import Checkpoint
from halpipe.pipeline.solve.quantise import BurstGrid
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate

BUDGET = 300


def first(model, **options):
    """Return the schedule of a quick search."""
    chosen = SearchOptions(budget=BUDGET, optimise=(), **options)
    return schedule_model(model, chosen, lambda *_: True).schedule


def longer(model, count=1):
    """Return the model with WCETs of its last tasks that are an eighth longer, in one piece and without phases."""

    def grown(v):
        return replace(v, wcet=v.wcet * Fraction(9, 8), accesses=(), split=WHOLE)

    tasks = (replace(task, versions=tuple(map(grown, task.versions))) for task in model.tasks[-count:])
    return replace(model, tasks=(*model.tasks[:-count], *tasks))


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


def short_turns(model, **options):
    """Let annealer and exact engine take turns of few moves each."""
    with patch.multiple(schedule, LEAST_MOVES=512, DEFAULT_BUDGET=1):
        return solved(model, **options)


class InMemory(Checkpoint):
    """A checkpoint that is always due, and stays in memory."""

    def __init__(self):
        super().__init__("", "", count(step=10**6).__next__)

    def _write(self):
        self.is_written = True


def resumed(model):
    """Stop a search at its sixth report, and go on from what was kept of it."""
    keeper, options = InMemory(), {"budget": 100, "optimise": (Objective.MARGIN, Objective.COST)}
    begun = searched(model, stop=6, keeper=keeper, **options)
    kept = {}
    for name, values in sorted(keeper.arrays.items()):
        kept.setdefault(name.rpartition("/")[0], []).append(values.tolist())
    stages = [f"kept {stage}: {len(arrays)} arrays, all {sign(arrays)}" for stage, arrays in kept.items()]
    return [begun[0], *stages, *searched(model, keeper=keeper, **options)]


def held(model):
    """Stay near a schedule, of which the jobs of the first task have shipped."""
    plan = first(model)
    shipped = replace(plan, modes=tuple(replace(m, jobs=m.by_task()[model.tasks[0].name]) for m in plan.modes[:1]))
    return solved(longer(model), near=first(model, seed=2), shipped=shipped)


def settled(model):
    """Find the last mode and its switches alone, beside what is settled."""
    plan = first(model)
    kept = plan.alone(plan.modes[:-1], plan.transitions[:1])
    return searched(model, budget=BUDGET, optimise=(), seed=3, settled=kept)


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
    "resumed": resumed,
    "settled": settled,
    "switches": switches,
    "open": lambda model: searched(model, spare=2000, effort=0),
    "open chains": lambda model: searched(model, optimise=(Objective.CHAINS,), effort=0),
}

EXACT_VERBS = {
    "near": lambda model: solved(longer(model), budget=BUDGET, near=first(model)),
    "near open": lambda model: solved(longer(model), near=first(model)),
    "near, large seed": lambda model: solved(longer(model), near=first(model), seed=2**31 + 5),
    "near, all longer": lambda model: solved(longer(model, 99), near=first(model)),
    "near, held": held,
    "exact, freeze": lambda model: solved(model, engine="exact", shipped=first(model)),
    "exact jitter": lambda model: solved(
        model, engine="exact", budget=100, optimise=(Objective.JITTER, Objective.CHAINS)
    ),
    "exact": lambda model: solved(model, engine="exact", optimise=()),
    "exact chains": lambda model: solved(model, engine="exact", budget=100, optimise=(Objective.CHAINS,)),
    "turns": lambda model: solved(model, optimise=()),
    "turns chains": lambda model: solved(model, optimise=(Objective.CHAINS,)),
    "large seed": lambda model: solved(model, engine="exact", seed=2**31 + 5, optimise=(Objective.CHAINS,)),
    "short turns": lambda model: short_turns(model, optimise=()),
    "short turns, large seed": lambda model: short_turns(model, seed=2**64 + 2**33 + 5, optimise=(Objective.CHAINS,)),
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
    "modes": lambda seed: in_modes(generate(replace(MODES, slack=Fraction(seed % 3, 5)), seed), seed),
    "full": lambda seed: generate(SetParameters(tasks=6 + seed % 4, units=2, utilisation=Fraction(1)), seed),
    "gangs": lambda seed: generate(GANGS, seed),
}
"""Systems of a seed."""

MODES = SetParameters(
    tasks=8, units=3, utilisation=Fraction(1, 2), multi_version=Fraction(1, 3), precedence=Fraction(1, 2)
)

GANGS = SetParameters(
    tasks=10, units=4, gang=Fraction(1, 4), multi_version=Fraction(1, 2), precedence=Fraction(1, 2), fractional=True
)

SEARCHES = {
    "margin": "every 77 159 198 225 274, many 37 40, switching 27, switching-split 21 25 58, random 0, modes 11",
    "first": "every 142, modes 1 4 5 6 8",
    "seed 7": "many 23 59",
    "optimise cost": "whole 5, switching 38, switching-split 5",
    "optimise jitter": "many 1 20 31, whole 28, split 13, crowded 1, switching-split 2, random 24, set 4, modes 5",
    "optimise chains": (
        "every 126, many 32, whole 0, split 39, crowded 16, "
        "refined 15 43, refined-split 38, switching-split 14 26, random 0"
    ),
    "optimise preemptions": "many 17, whole 39, refined 18, refined-split 33, switching-split 4, random 38",
    "optimise margin": (
        "every 141 149, many 0, whole 35 37, crowded 1 33, refined 12, refined-split 38, switching 6, modes 2"
    ),
    "target": "whole 23 59, refined 30 47, switching 10, switching-split 20 21",
    "freeze": (
        "every 223 241, whole 14 36, split 19 33, crowded 0, refined 20, "
        "switching 21, switching-split 19, set 13 20, modes 2"
    ),
    "freeze all": "many 17 40, split 24, switching-split 13, modes 10",
    "tick": "many 50, crowded 3, refined 5, switching 38, modes 2",
    "groups": "many 49, refined 0 7, switching-split 20, modes 7",
    "grid": (
        "many 32, whole 12 24 26, crowded 16, refined 10, refined-split 0 23, "
        "switching 10 13 27 39, random 5 11, set 11 22 35 36, gangs 2 3 9"
    ),
    "stopped": (
        "every 165, many 17 35, whole 10, crowded 2, refined-split 6 39, "
        "switching 3 6 25, switching-split 1 24 29 56, random 2, modes 6"
    ),
    "resumed": (
        "every 11 67 170 262, many 1 6 30, whole 1 2, split 0 11, crowded 1 10, refined 23 38, switching 3, random 2 22"
    ),
    "settled": "many 12 37, refined-split 6, switching-split 4, random 34, modes 4",
    "switches": (
        "every 157 164, many 1 6 10 28 38 41 59, whole 15, split 15, crowded 35, "
        "refined-split 43 51, switching 11 13 45 58 117, switching-split 173, "
        "random 46, modes 0 1 2 3 4 5 6 7 8 10 12 21 27 28 30 162"
    ),
    "open": (
        "every 81 119 262 270, many 30, whole 26, split 13, refined-split 2 33, switching-split 20 33, random 9 18"
    ),
    "open chains": "whole 4 32, split 49, refined 9 14, random 13",
    "near": (
        "many 38, whole 19, split 3 41, crowded 0 17 22 30 32, refined 21, refined-split 34, "
        "switching 59, switching-split 19, random 21 39, set 32 37, modes 3, gangs 26"
    ),
    "near open": (
        "every 36 172, many 1, split 19 20 30 34, refined 16 21, refined-split 15 16 24, "
        "switching 38, set 31, modes 8, gangs 8"
    ),
    "near, large seed": "set 2 7 32, modes 8",
    "near, all longer": "split 3, set 2 5, modes 1 4, full 1",
    "near, held": "every 58 211 242, many 24, refined 6, switching 14 20 30, switching-split 19, gangs 0",
    "exact, freeze": "whole 3",
    "exact jitter": "every 46 177, many 48, random 0 8 24",
    "exact": (
        "every 31 178 245 262, many 51, whole 2 25, refined 8 11 27, "
        "refined-split 9 18 22 25 27, random 5, modes 2, gangs 1 19"
    ),
    "exact chains": (
        "every 177 178 228 232, many 48 53, whole 2 16 23, crowded 10 24, refined 2 11 13 19 29, "
        "refined-split 2 36, switching 26, switching-split 10 25, random 7, gangs 5"
    ),
    "turns": "many 23, refined-split 33, switching-split 56",
    "turns chains": "many 42, whole 4 5 35, refined 8 9, random 8",
    "large seed": "every 178, random 7 8",
    "short turns": "random 5 7 8 9 11, full 0 2 3 5 6 11",
    "short turns, large seed": "random 8 9 10, full 2 3",
    "programs": "split 59, refined 47, refined-split 43",
}
"""Systems by verb: names of families, and seeds."""


def refined(family, seed):
    """Return a system with a schedule, and requirements of MODEL 10."""
    rng = random.Random(seed)
    return refined_systems.refined(rng, *family.valid_system(rng))


def in_modes(model, seed):
    """Return a generated set with two modes that share all but a few tasks, and switches both ways."""
    rng = random.Random(seed)
    named = {row.task for task in model.tasks for version in task.versions for row in version.precedences}
    others = [run for run in model.modes[0].runs if run.task in named or rng.random() < 0.7]
    edge = rng.choice((Edge.OPEN, Edge.CLOSED))
    return replace(model, modes=(*model.modes, Mode(name="less", edge=edge, runs=tuple(others))))


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


AT_ONCE = 5
"""Systems of a test, so that none takes long."""

CASES = [
    (verb, family, seeds[at : at + AT_ONCE], f" {at // AT_ONCE + 1}" if at else "")
    for verb, families in SEARCHES.items()
    for family, *seeds in map(str.split, families.split(", "))
    for at in range(0, len(seeds), AT_ONCE)
]


def test_no_answer_is_an_internal_error():
    """A golden file keeps whatever is found: this answer is never right."""
    files = sorted((GOLDEN / "searches").glob("*.txt"))
    assert len(files) > 100
    assert [path.name for path in files if f"exit {Exit.INTERNAL:d}\n" in path.read_text("utf-8")] == []


@pytest.mark.parametrize("case", CASES, ids=[f"{verb} {family}{part}" for verb, family, _, part in CASES])
def test_searches_find_what_they_found_before(case):
    """Jobs, figures, tables of switches and the count of the work, to the tick."""
    verb, family, seeds, part = case
    if verb in EXACT_VERBS and metadata.version("ortools") != OR_TOOLS:
        pytest.skip(f"the answers of CP-SAT are made and tested by OR-Tools {OR_TOOLS}")
    verbs = VERBS | EXACT_VERBS
    answers = {f"{verb}: {family} {seed}": partial(verbs[verb], FAMILIES[family](int(seed))) for seed in seeds}
    assert_answers(f"{verb} {family}{part}".replace(",", "").replace(" ", "-"), answers)
