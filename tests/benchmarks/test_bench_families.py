"""The families that leave nothing idle: what they are made of, and that a schedule of each is found or known."""

from fractions import Fraction

import pytest

from halpipe.core.durations import milliseconds
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate
from search_benchmark import jobshop
from search_benchmark.families import FullSlack, ManyVersions, RigidChains
from support import model, task, version

FAMILIES = (
    ManyVersions(tasks=30, versions=8, units=6),
    FullSlack(units=2, slots=4),
    RigidChains(chains=3, length=9, units=1, load=Fraction(1, 2)),
    RigidChains(chains=2, length=8, units=3, load=Fraction(2, 5), width=3),
)


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_models_are_sound_and_those_of_their_seed(family):
    assert not [found for seed in range(20) for found in validate(family.draw(seed)) if found.is_error]
    assert family.draw(4) == family.draw(4) != family.draw(5)


def work(system):
    """Share of a period, times units, that first versions take."""
    return sum(v.gang * (v.wcet / t.period) for t in system.tasks for v in t.versions[:1])


def test_nothing_is_idle_with_full_slack():
    for seed in range(10):
        system = FAMILIES[1].draw(seed)
        assert work(system) == len(system.units)


def test_rigid_chains_have_the_load_and_the_windows_stated():
    system = FAMILIES[2].draw(3)
    assert work(system) == Fraction(1, 2)
    rows = [row for t in system.tasks for v in t.versions for row in v.precedences]
    assert len(rows) == 3 * 8
    assert all(row.max == row.min for row in rows)
    loose = [row for t in FAMILIES[3].draw(3).tasks for v in t.versions for row in v.precedences]
    assert all(row.max - row.min <= milliseconds(6) for row in loose)


@pytest.mark.parametrize("family", FAMILIES[2:], ids=repr)
@pytest.mark.parametrize("seed", range(3))
def test_rigid_chains_are_found(family, seed):
    assert schedule_model(family.draw(seed), SearchOptions(), lambda *_: True).is_complete


def test_pyjobshop_that_is_missing_is_said(monkeypatch):
    monkeypatch.setattr(jobshop, "find_spec", lambda name: None)
    assert jobshop.solve(FAMILIES[0].draw(1), 1, 1) == {"answer": "none", "reason": jobshop.MISSING}


def test_rules_that_pyjobshop_does_not_know_are_said(monkeypatch):
    monkeypatch.setattr(jobshop, "find_spec", lambda name: True)
    for system in (FAMILIES[1].draw(1), FAMILIES[2].draw(1), generate(SetParameters(tasks=8, units=2), 1)):
        assert jobshop.solve(system, 1, 1) == {"answer": "none", "reason": jobshop.OTHER_RULES}


def test_what_pyjobshop_finds_is_verified(monkeypatch):
    pytest.importorskip("pyjobshop", reason="PyJobShop is not installed")
    small = ManyVersions(tasks=6, versions=3, units=2)
    assert jobshop.solve(small.draw(1), 20, 1)["answer"] == "feasible"
    full = model(*(task(n, 10, version("v", c, "u1")) for n, c in (("a", 7), ("b", 4))), units="u1")
    assert jobshop.solve(full, 5, 1)["answer"] == "unknown"
    pair = model(*(task(n, 10, version("v", 7, "u1 u2")) for n in "ab"), units="u1 u2")
    monkeypatch.setattr(jobshop, "assign_units", lambda *_: None)
    assert jobshop.solve(pair, 20, 1)["answer"] == "invalid"
