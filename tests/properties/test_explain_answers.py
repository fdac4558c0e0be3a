"""Explanations of small systems in full: verdicts, proofs, what would help, and how often a search asks to go on."""

import random
from dataclasses import replace
from fractions import Fraction
from functools import partial

import pytest
from explain_systems import random_system
from test_search_golden import FAMILIES, finer, first, longer

from golden_answers import assert_answers, explained, findings
from halpipe.pipeline.explain.conflict import describe, find_conflict
from support import model, ms, task, version


def brief(share, family):
    """Return a family with tables for switches of this share of the first period at most."""

    def made(seed):
        system = FAMILIES[family](seed)
        most = next(task.period for task in system.tasks if task.period is not None) * share
        return replace(system, transitions=tuple(replace(each, max_length=most) for each in system.transitions))

    return made


def places(count):
    return " ".join(f"u{n}" for n in range(count))


OWN = {
    "hard": lambda seed: random_system(random.Random(seed)),
    "crowded-long": lambda seed: longer(FAMILIES["crowded"](seed)),
    "pigeons": lambda count: model(
        *(task(f"t{n}", 10, version("v", 6, places(count))) for n in range(count + 1)), units=places(count)
    ),
    "loads": lambda count: model(*(task(f"t{n}", 10, version("v", ms(10) / (count - 1))) for n in range(count))),
    "whole-long": lambda seed: longer(FAMILIES["whole"](seed)),
    "switching-short": brief(Fraction(1, 4), "switching"),
    "switching-split-short": brief(Fraction(1, 4), "switching-split"),
    "every-brief": brief(Fraction(1, 8), "every"),
}

VERBS = {
    "plain": explained,
    "freeze": lambda system: explained(longer(system), shipped=first(system)),
    "near": lambda system: explained(longer(system), near=first(system)),
    "tick": lambda system: explained(system, tick=finer(system) * 5),
    "schedule": lambda system: explained(longer(system), schedule=first(system)),
}

ANSWERS = {
    "plain-hard": "hard 104, hard 113, hard 116, hard 172, hard 185, hard 217, hard 223, hard 286, hard 406, hard 433",
    "plain-refined": (
        "refined 103, refined 104, refined 107, refined 134, refined 161, refined 166, refined 201, refined 221, "
        "refined 225, refined 460"
    ),
    "plain-every": (
        "every 101, every 144, every 150, every 161, every 254, every 296, every-brief 505, every-brief 510, "
        "every-brief 540"
    ),
    "plain-others": (
        "switching-split-short 0, switching-split-short 207, switching-split-short 339, switching-short 478, "
        "whole-long 103, random 108, random 173, random 192, random 426, random 427, crowded-long 261, crowded-long 280"
    ),
    "freeze": (
        "every 400, every 402, every 474, every 484, every 492, refined 406, refined 438, refined 446, refined 455, "
        " refined 497, whole 427, crowded 410, crowded 455"
    ),
    "near": "crowded 409, crowded 422, crowded 455, crowded 478, every 402, every 404, every 478, every 492",
    "tick": (
        "hard 422, hard 433, hard 437, hard 438, hard 446, hard 460, hard 476, hard 483, refined 418, refined 435, "
        "refined 459, refined 460, refined 478, every 403"
    ),
    "schedule": (
        "every 402, every 414, every 440, every 447, every 448, every 469, every 491, every 492, every 494, random 431"
    ),
}
"""Systems by verb that reach each line of the room: names of families, and seeds."""


@pytest.mark.parametrize("chosen", ANSWERS)
def test_explanations_say_what_they_said_before(chosen):
    """Words, numbers, order and the count of the work, to the last one."""
    verb = VERBS[chosen.partition("-")[0]]
    answers = {}
    for name in ANSWERS[chosen].split(", "):
        family, seed = name.split()
        answers[name] = partial(verb, (OWN | FAMILIES)[family](int(seed)))
    assert_answers(f"explain-{chosen}", answers)


def conflict(system, most):
    """Return what the exact engine says of the first mode, with a set that conflicts, and the count of questions."""
    asked = [0]

    def go_on():
        asked[0] += 1
        return asked[0] <= most

    found = find_conflict(system, system.modes[0], go_on)
    named = [] if found.kept is None else findings([describe(system.modes[0], found)])
    return [f"{found.answer}, asked {asked[0]} times", *named]


CONFLICTS = (
    "whole-long 26, whole-long 185, whole-long 379, refined 74, refined 89, refined 117, refined 145, refined 185, "
    "refined 202, refined 275, refined 289, refined 315, refined 446, refined 472, hard 363, random 51, random 117, "
    "random 221, every 114, every 0, every 1, pigeons 5, loads 14"
)


@pytest.mark.parametrize("most", [2, 40])
def test_conflicts_are_what_they_were_before(most):
    """A set from which nothing can be left out does not depend on how the engine comes to its answers."""
    pytest.importorskip("ortools")
    answers = {}
    for name in CONFLICTS.split(", "):
        family, seed = name.split()
        answers[name] = partial(conflict, (OWN | FAMILIES)[family](int(seed)), most)
    assert_answers(f"explain-conflicts-{most}", answers)
