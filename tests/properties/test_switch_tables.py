"""Tables that the search finds between modes for which others are known: valid, no longer, and seldom missed."""

import random
from collections import Counter
from dataclasses import replace

import pytest
import refined_systems
import split_systems
import verify_systems

from halpipe.core.durations import milliseconds
from halpipe.pipeline.checked import _is_sound_switch
from halpipe.pipeline.transitions.tables import switch_tables
from halpipe.pipeline.verify import verify

KINDS = {
    "whole": (verify_systems, False),
    "preemptive": (split_systems, False),
    "whole, refined": (verify_systems, True),
    "preemptive, refined": (split_systems, True),
}
REACHED = {
    "whole": (89, 48, 218),
    "preemptive": (89, 64, 265),
    "whole, refined": (41, 14, 70),
    "preemptive, refined": (46, 30, 124),
}
"""How many known switches are found at least; how many tables are invalid, and how many ms they take, at most."""


def searched(kind, seeds):
    """Return how many known switches are found, how many invalid tables are tried, and the sum of all lengths."""
    family, is_refined = KINDS[kind]
    seen = Counter()

    def check(*switch):
        is_sound = _is_sound_switch(*switch)
        seen["invalid"] += not is_sound
        return is_sound

    for seed in seeds:
        rng = random.Random(seed)
        system, plan = family.switching_system(rng)
        system = refined_systems.refined(rng, system, plan) if is_refined else system
        if any(d.is_error for d in verify(system, plan)):
            continue
        found = switch_tables(system, replace(plan, transitions=()), check)
        lengths = {(table.source, table.target): table.length for table in found.tables}
        for known in plan.transitions:
            length = lengths.get((known.source, known.target))
            if length is not None:
                seen["found"] += 1
                assert length <= known.length, (seed, known.source, known.target)
                seen["length"] += int(length / milliseconds(1))
    return seen["found"], seen["invalid"], seen["length"]


@pytest.mark.parametrize("kind", KINDS)
def test_known_switches_are_found_with_tables_no_longer(kind):
    found, invalid, length = searched(kind, range(100))
    least, most_invalid, most_length = REACHED[kind]
    assert found >= least
    assert invalid <= most_invalid
    assert length <= most_length + 20 * (found - least)
