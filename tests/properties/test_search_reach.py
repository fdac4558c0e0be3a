"""What short searches reach: schedules that are known to exist, with few moves, and better ones where that is asked.

The figures are those of the search as it is, with some room: a change may find others, but should not find less.
"""

import random
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import pytest
import refined_systems
import split_systems
import verify_systems

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.measure.objectives import NEVER, Objective
from halpipe.pipeline.solve.codes import NO_OPTION, TICK_DOES_NOT_DIVIDE
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify

FAMILIES = {"whole": verify_systems, "preemptive": split_systems}


def searched(system, **options):
    """Return the result of a search, whose valid schedules verify."""
    found = schedule_model(system, SearchOptions(**options), lambda *_: True)
    if found.is_complete:
        assert not [d for d in verify(system, found.schedule) if d.is_error]
    return found


def drawn(family, is_refined, seed):
    rng = random.Random(seed)
    system, plan = FAMILIES[family].valid_system(rng)
    return refined_systems.refined(rng, system, plan) if is_refined else system


@pytest.mark.parametrize(
    ("family", "is_refined", "found", "moves"),
    [
        ("whole", False, 30, 1914),
        ("whole", True, 24, 5743),
        ("preemptive", False, 29, 1510),
        ("preemptive", True, 20, 4025),
    ],
)
def test_schedules_that_exist_are_found_with_few_moves(family, is_refined, found, moves):
    seen = Counter()
    for seed in range(30):
        system = drawn(family, is_refined, seed)
        if not any(d.is_error for d in validate(system)):
            result = searched(system, budget=300, optimise=())
            seen["found"] += result.is_complete
            seen["moves"] += result.moves
    assert seen["found"] >= found - 1
    assert seen["moves"] <= moves * 3 // 2


@pytest.mark.parametrize(
    ("objective", "wins"),
    [
        (Objective.CHAINS, 10_000_000),
        (Objective.JITTER, 1_000_000),
        (Objective.MARGIN, 3),
        (Objective.COST, Fraction(1, 2)),
    ],
)
def test_what_is_asked_for_gets_better(objective, wins):
    won = Fraction(0)
    for seed in range(8):
        for family in FAMILIES:
            for row in searched(drawn(family, False, seed), budget=100, optimise=(objective,)).reached:
                assert row.value <= row.first
                assert row.bound is None or row.bound <= row.value
                won += row.first - row.value if row.first < NEVER else 0
    assert won >= wins * Fraction(9, 10)


@pytest.mark.parametrize(
    ("changes", "moves"),
    [
        ({}, 321),
        ({"precedence": Fraction(1, 2), "multi_version": Fraction(1, 4)}, 1826),
        ({"gang": Fraction(1, 4), "slack": Fraction(1, 10)}, 375),
        ({"fractional": True, "resource_fill": Fraction(1, 2)}, 19356),
        ({"unlike_units": True, "utilisation": Fraction(4, 5)}, 47852),
    ],
)
def test_generated_sets_are_scheduled_with_few_moves(changes, moves):
    base = SetParameters(tasks=24, units=4, utilisation=Fraction(7, 10))
    made = 0
    for seed in range(4):
        result = searched(generate(replace(base, **changes), seed), optimise=())
        assert result.is_complete
        made += result.moves
    assert made <= moves * 3 // 2


@pytest.mark.parametrize(("family", "found"), [("whole", 11), ("preemptive", 15)])
def test_schedules_on_a_coarse_grid_are_some_of_the_model(family, found):
    """Pieces are longer there, so that phases in one part begin before the instants of the grid."""
    seen, codes = 0, set()
    for seed in range(100, 130):
        try:
            seen += searched(drawn(family, False, seed), budget=300, optimise=(), tick=milliseconds(2)).is_complete
        except HalpipeError as refused:
            codes.add(refused.diagnostics[0].code)
    assert codes <= {TICK_DOES_NOT_DIVIDE.id, NO_OPTION.id}
    assert seen >= found
