"""Programs and tables of regulators in one bundle: checked together, and wrong tables are found."""

from dataclasses import replace

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator.codes import FORMS_DIFFER, USED_ABOVE_BUDGET
from halpipe.deploy.riscv import DEPLOYMENT

PLATFORM = """halpipe-regulator: 1
resource: memory
clock: 100MHz
bus: 64bit
burst: 64B
window: 5000
guaranteed: 400MB/s
capacity: 440MB/s
units:
  left: {manager: 0}
  right: {manager: 1}
"""


@pytest.fixture(scope="module")
def regulated(export):
    return export(platform=PLATFORM)


def test_programs_and_tables_are_checked_together(regulated):
    assert regulated.bundle.facts["regulator"] == "table"
    checked = DEPLOYMENT.check(regulated, CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    assert any(line.startswith("regulators: arithmetic: exact; 3 tables of 2 units") for line in checked.lines)
    assert any("every start, end and transfer is as scheduled" in line for line in checked.lines)


def test_transfers_are_held_against_the_budgets(regulated, play):
    """As played they are within them; in a window without a budget they are above it."""
    from halpipe.deploy.riscv.regulated import hold_transfers

    outcomes = play(regulated)
    findings, lines = hold_transfers(regulated, outcomes)
    assert findings == []
    assert any(line.startswith("regulators: full, right, read: ") for line in lines)
    moved = next(t for job in outcomes[0].jobs for t in job.transfers if t)
    late = outcomes[0].run.rate // 1000  # a millisecond: beyond its phase, where nothing is promised
    moved.begin, moved.end = moved.begin + late, moved.end + late
    findings, _ = hold_transfers(regulated, outcomes)
    assert {found.code for found in findings} == {USED_ABOVE_BUDGET.id}


def test_tables_that_are_wrong_are_found(regulated):
    name = "regulator/table/unit0.tab.memh"
    image = regulated.bundle.files[name]
    files = {**regulated.bundle.files, name: image.replace(image[:8], b"00000001", 1)}
    wrong = replace(regulated, bundle=replace(regulated.bundle, files=files))
    (found,) = DEPLOYMENT.check(wrong, CheckOptions(inject="none")).diagnostics
    assert (found.code, found.at.file) == (FORMS_DIFFER.id, f"{wrong.bundle.path}/{name}")


def test_a_bundle_without_regulators_says_nothing_of_them(sound):
    assert not any("regulators:" in line for line in DEPLOYMENT.check(sound, CheckOptions(inject="none")).lines)
