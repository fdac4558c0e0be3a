"""Budgets of switches follow the phases of jobs with gaps through their parts; the check holds tables to that."""

from itertools import pairwise

import pytest
from regulator_samples import PLATFORM, build, platform_file

import regulator_bundles as bundles
import split_switches
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.tables import run_starts

# Windows of 0.1 ms, in which a bound of 1 promises 30 bursts: 15 for a half, 10 for a third.
GRID = {"clock": "10MHz", "guaranteed": "19.2MB/s", "capacity": "40MB/s"}


@pytest.fixture
def switched():
    system = split_switches.system()
    return system, split_switches.plan(system)


def runs_of(values):
    """(first window, behind the last window, bursts) of what is granted."""
    edges = [0, *run_starts(values), len(values)]
    return [(a, b, values[a]) for a, b in pairwise(edges) if values[a]]


def half(*windows):
    return [(at, at + 10, 15) for at in windows]


def third(*windows):
    return [(at, at + 10, 10) for at in windows]


def test_budgets_follow_phases_through_parts_across_switches(tmp_path, switched):
    """Of jobs in progress there is what is left of them; of the mode after what its first cycle has started."""
    tables = build(tmp_path, *switched, **GRID)[0].tables
    found = {table.name: runs_of(table.row(Row("u1", "read"))) for table in tables}
    # "kept" begins to read 1 ms and 3 ms into its execution: 0.1 ms after the start of its second and third part
    assert found["one"] == sorted([*half(0, 21, 50, 100, 150), *third(121)])
    assert found["two"] == sorted([*half(0, 50, 100, 131, 155), *third(171)])
    # after "one", "kept" reads at 2.1 and 12.1 ms, "brief" of the table at 0; "two" begins at 5 ms
    assert found["one->two"] == sorted([*half(0, 21, 50, 100, 150, 181, 205), *third(121, 221)])
    # "kept" of the table reads at 3.1 and 11.1 ms; "one" begins at 10 ms, and its own "kept" reads beyond its end
    assert found["two->one"] == sorted([*half(0, 31, 55, 100, 150, 200, 250), *third(111)])


@pytest.fixture
def files(tmp_path, switched):
    path = platform_file(tmp_path, PLATFORM, **GRID)
    return RegulatorExporter().write(*switched, RegulatorOptions(platform=path, backend="table"))


def said(files):
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="arithmetic"))
    return {finding.code for finding in checked.diagnostics}


def test_the_check_accepts_the_tables(files):
    assert said(files) == set()


@pytest.mark.parametrize(
    ("table", "first", "to"), [("one->two", 121, 26), ("two->one", 111, 36), ("one->two", 121, 131)]
)
def test_the_check_finds_budgets_at_other_instants(files, table, first, to):
    """A part that goes on behind the table; its budget is given in the gap before it, or too late."""

    def move(data):
        number = next(n for n, found in enumerate(data["tables"]) if found["name"] == table)
        values = bundles.budgets(data, number, "u1")
        assert values[first][0] == 10
        for window in range(10):
            values[to + window][0] += values[first + window][0]
            values[first + window][0] = 0
        bundles.set_budgets(data, number, "u1", values)

    assert codes.WRONG_BUDGET.id in said(bundles.changed(files, move))
