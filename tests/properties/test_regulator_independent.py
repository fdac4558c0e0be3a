"""Exporter and check of regulator tables share no code, so they check each other: on random systems with full loads."""

import random

import pytest

import regulator_bundles as bundles
import regulator_systems as systems
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes
from halpipe.deploy.regulator.reading import read_tables

SYSTEMS = 40


def bundle(folder, seed):
    rng = random.Random(seed)
    shape = systems.random_shape(rng)
    return systems.export(folder, *systems.random_system(rng, shape), shape)


def found(files):
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="arithmetic"))
    return {finding.code for finding in checked.diagnostics}


@pytest.mark.slow
def test_what_the_exporter_makes_of_random_systems_passes(tmp_path):
    cycles, loads = set(), set()
    for seed in range(SYSTEMS):
        files = bundle(tmp_path, seed)
        assert found(files) == set(), f"seed {seed}"
        tables = read_tables(bundles.target(files).bundle)
        cycles |= {table.cycles for table in tables.tables if table.is_transition}
        loads |= {max(_sums(tables, table)) >= tables.platform.promise_bytes for table in tables.tables}
    assert cycles >= {0, 1}  # switches that end at once, and such that reach into the new mode
    assert loads == {True, False}  # windows that grant all that is guaranteed


def _sums(tables, table):
    rows = [table.budgets(unit.name, direction) for unit, direction in tables.rows()]
    return map(sum, zip(*rows, strict=True))


@pytest.mark.parametrize("seed", range(8))
def test_two_bursts_that_come_much_later_are_found(tmp_path, seed):
    """The rule leaves room for less than one burst: a row that lacks two is behind."""
    files = bundle(tmp_path, seed)

    def move(data):
        values = max((bundles.budgets(data, 0, f"u{n}") for n in range(4)), key=lambda v: sum(read for read, _ in v))
        unit = next(f"u{n}" for n in range(4) if bundles.budgets(data, 0, f"u{n}") == values)
        granted = [window for window, (read, _) in enumerate(values) for _ in range(read)]
        assert granted[-1] > granted[1]
        for window in granted[:2]:
            values[window][0] -= 1
        values[granted[-1]][0] += 2
        bundles.set_budgets(data, 0, unit, values)

    assert codes.NOT_KEPT_UP.id in found(bundles.changed(files, move))
