"""Cost and chains against the oracle for requirements that refer to instants, cycles and edges (MODEL 10)."""

import random
from collections import Counter

import pytest
import refined_systems
import split_systems
import verify_mutants
import verify_oracle as oracle
import verify_systems
from test_cost_verify import NOT_COVERED, OPERATORS
from test_cost_verify_split import MALFORMED
from test_refined import with_chains

from halpipe.core.durations import milliseconds
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import cost_terms, with_latencies
from halpipe.pipeline.measure.placement import Placement


def system_and_plan(rng):
    """Return a system with a schedule, which may have a fault or miss one of its requirements."""
    system, plan = rng.choice((verify_systems, split_systems)).valid_system(rng)
    system = refined_systems.refined(rng, system, plan)
    mutant = verify_mutants.OPERATORS[rng.choice(OPERATORS)](rng, system, plan) if rng.random() < 0.3 else None
    return mutant or (system, plan)


@pytest.mark.parametrize("block", range(4))
def test_what_misses_a_requirement_costs(block):
    seen = Counter()
    for seed in range(block * 50, block * 50 + 50):
        system, plan = system_and_plan(random.Random(seed))
        broken = {rule for rule, _ in oracle.broken(system, plan)}
        if not broken & (MALFORMED | NOT_COVERED):
            placement = Placement.of(expand(system, system.modes[0]), plan.modes[0].jobs, system.units)
            assert (cost_terms(system, placement).total > 0) == bool(broken), (seed, broken)
            seen[bool(broken)] += 1
    assert min(seen[True], seen[False]) > 5


def test_all_three_figures_of_chains_are_those_of_the_oracle():
    seen = 0
    for seed in range(20):
        rng = random.Random(seed)
        system, plan = rng.choice((verify_systems, split_systems)).valid_system(rng)
        for change in (refined_systems.with_offset, refined_systems.with_let):
            system = change(rng, system, plan) if rng.random() < 0.5 else system
        system = with_chains(rng, system)
        if oracle.broken(system, plan):
            continue
        tasks = oracle.tasks_of(system, plan.modes[0].name)
        total = oracle.hyperperiod(tasks)
        placed = [oracle.placed_at(system, tasks, job, "") for job in plan.modes[0].jobs]
        placed = oracle.refined_oracle.released(system, tasks, total, placed)
        figures = {found.name: found for found in with_latencies(system, plan).modes[0].chains}
        for chain in system.chains:
            found = figures[chain.name]
            wanted = [None if t is None else milliseconds(t) for t in oracle.chain_latency(chain, placed, total)]
            assert [found.latency, found.reaction, found.age] == wanted, (seed, chain)
            seen += 1
    assert seen > 15
