"""verify, the second checker and the brute-force oracle agree on the requirements of MODEL 10, valid or not."""

import importlib.util
import random
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import refined_systems
import split_mutants
import split_systems
import verify_mutants
import verify_oracle as oracle
import verify_systems as systems

from halpipe.core.diagnostics import Findings, HalpipeError, render_text
from halpipe.core.durations import milliseconds
from halpipe.exporters.native import format_model, format_schedule
from halpipe.models import Anchor, Chain
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import reading, verify
from halpipe.pipeline.verify.chains import measured
from profiles import volume

PROGRAM = Path(__file__).parents[2] / "docs" / "safety" / "second_checker.py"
BUILDERS = (
    systems.valid_system,
    systems.valid_system,
    systems.switching_system,
    split_systems.valid_system,
    split_systems.switching_system,
)
EVENTS = (Anchor.START, Anchor.END)
MUTANTS = (*verify_mutants.OPERATORS.values(), *split_mutants.OPERATORS.values())


def second_checker():
    spec = importlib.util.spec_from_file_location("second_checker_refined", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CHECKER = second_checker()


def second_opinion(folder, system, plan):
    """The rules that the second checker finds broken; "file" where it cannot read the files."""
    try:
        (folder / "m.xml").write_bytes(format_model(system))
        (folder / "s.xml").write_bytes(format_schedule(replace(plan, model_sha256="")))
    except HalpipeError:
        return None  # not to be written
    try:
        return {finding[0] for finding in CHECKER.judge(str(folder / "m.xml"), str(folder / "s.xml"))}
    except (CHECKER.UnreadableError, ValueError):
        return {"file"}


def cases(seed, count):
    rng = random.Random(seed)
    made = 0
    while made < count:
        system, plan = rng.choice(BUILDERS)(rng)
        refined = refined_systems.refined(rng, system, plan)
        mutant = rng.choice(MUTANTS)(rng, refined, plan) if rng.random() < 0.3 else None
        yield mutant or (refined, plan)
        made += 1


def compare(tmp_path, seed, count):
    verdicts = Counter()
    for system, plan in cases(seed, count):
        wrong = oracle.broken(system, plan)
        found = [d for d in verify(system, plan) if d.is_error]
        words = "\n".join(map(render_text, found))
        assert bool(found) == bool(wrong), (sorted(map(str, wrong)), words, system, plan)
        second = second_opinion(tmp_path, system, plan)
        assert second is None or bool(second) == bool(wrong), (sorted(map(str, wrong)), second, words, system, plan)
        verdicts["invalid" if wrong else "valid"] += 1
        verdicts.update({rule for rule, _ in wrong})
    return verdicts


@pytest.mark.slow
def test_three_checkers_agree(tmp_path):
    verdicts = compare(tmp_path, 1, 300)
    assert verdicts["valid"] > 60
    assert verdicts["invalid"] > 60


@pytest.mark.slow  # the test above has the same subject
def test_three_checkers_agree_on_many(tmp_path):
    compare(tmp_path, 2, volume(2000))


def with_chains(rng, system):
    """Four chains without limits, over any tasks, from and to any events."""
    names, chains = [task.name for task in system.tasks], []
    for number in range(4):
        tasks = tuple(rng.sample(names, rng.randint(1, min(4, len(names)))))
        anchor, to = rng.choice((None, None, *EVENTS, Anchor.RELEASE)), rng.choice((None, None, *EVENTS))
        if len(tasks) == 1 and anchor is Anchor.END:
            to = None
        if anchor is Anchor.RELEASE and system.task(tasks[0]).period is None:
            anchor = None
        chains.append(Chain(name=f"k{number}", tasks=tasks, anchor=anchor, to=to))
    return replace(system, chains=tuple(chains))


def compare_chains(seed, count):
    """Compare the three figures of `count` chains: those that verify measures, and those that the oracle follows."""
    rng, seen = random.Random(seed), Counter()
    while seen.total() < count:
        system, plan = rng.choice(BUILDERS)(rng)
        for change in (refined_systems.with_offset, refined_systems.with_let):
            system = change(rng, system, plan) if rng.random() < 0.5 else system
        system = with_chains(rng, system)
        if oracle.broken(system, plan):
            continue
        clock, found = reading.make_clock(system, plan), Findings()
        modes = reading.active_modes(system, clock, found)
        for name, table in reading.mode_tables(system, plan, modes, clock, found).items():
            tasks = oracle.tasks_of(system, name)
            placed = [oracle.placed_at(system, tasks, j, "") for j in plan.mode(name).jobs if j.task in tasks]
            total = oracle.hyperperiod(tasks)
            placed = oracle.refined_oracle.released(system, tasks, total, placed)
            for chain in system.chains:
                if set(chain.tasks) <= tasks.keys():
                    figures = measured(table, chain)
                    ticks = tuple(None if f is None else f[0] / clock.ticks(milliseconds(1)) for f in figures)
                    assert ticks == oracle.chain_latency(chain, placed, total), (system, plan, chain)
                    seen["let" if any(system.task(task).let for task in chain.tasks) else "implicit"] += 1
    return seen


def test_figures_of_chains_agree():
    seen = compare_chains(5, 120)
    assert min(seen["let"], seen["implicit"]) > 15


@pytest.mark.slow
def test_what_has_a_schedule_is_called_neither_invalid_nor_hopeless():
    """validate and the proofs of explain are sound: the oracle knows a schedule."""
    kept = 0
    for system, plan in cases(3, 250):
        if oracle.broken(system, plan):
            continue
        kept += 1
        assert not [d for d in validate(system) if d.is_error], system
        assert not find_witnesses(system), system
    assert kept > 60


@pytest.mark.slow
def test_what_the_search_calls_valid_verifies_for_preemptive_jobs_and_switches():
    found = Counter()
    for system, _ in cases(4, 60):
        if any(d.is_error for d in validate(system)):
            continue
        found[outcome(system)] += 1
    assert not found["HAL0903"]
    assert found["complete"] > 15


def outcome(system):
    """The first code of a refusal, or whether the search is complete."""
    try:
        scheduled = schedule_model(system, SearchOptions(budget=40), lambda *_: True)
    except HalpipeError as failure:
        return failure.diagnostics[0].code
    return "complete" if scheduled.is_complete else "not found"
