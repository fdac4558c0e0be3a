"""Programs and tables of regulators in one bundle: checked together, and wrong tables are found."""

from dataclasses import replace

import pytest

from command_line import run_here
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator.codes import FORMS_DIFFER, USED_ABOVE_BUDGET
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.codes import TRANSFER_OUTSIDE_PHASE

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
    from halpipe.deploy.riscv.run.regulators import hold_transfers

    outcomes = play(regulated)
    held = hold_transfers(regulated, outcomes)
    assert held.findings == ()
    assert any(line.startswith("regulators: full, right, read: ") for line in held.lines)
    moved = next(t for job in outcomes[0].jobs for t in job.transfers if t)
    late = outcomes[0].run.rate // 1000  # a millisecond: beyond its phase, where nothing is promised
    moved.begin, moved.end = moved.begin + late, moved.end + late
    assert {found.code for found in hold_transfers(regulated, outcomes).findings} == {USED_ABOVE_BUDGET.id}


def guaranteeing(export, rate):
    return export(platform=PLATFORM.replace("guaranteed: 400MB/s", f"guaranteed: {rate}"))


def test_budgets_that_just_suffice_hold_nobody_back(export):
    """A phase of 50 us is granted 6 bursts for 64 B; each cycle has windows of its own."""
    checked = DEPLOYMENT.check(guaranteeing(export, "8MB/s"), CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    (line,) = [line for line in checked.lines if line.startswith("regulators: halt, right, write: ")]
    assert line == "regulators: halt, right, write: 3 phases, 1200 B promised, 1344 B granted, 24 B used"


def test_transfers_pass_the_tables_and_come_late_where_these_grant_too_little(export, play):
    """One burst of 64 B, or two, in a window of 50 us: an image of 312 B needs three windows, its phase has two."""
    bundle = guaranteeing(export, "2MB/s")
    (first, *_) = [d for d in DEPLOYMENT.check(bundle, CheckOptions(inject="none")).diagnostics if "image" in d.message]
    assert first.code == TRANSFER_OUTSIDE_PHASE.id
    assert "ran from 601.7us to 700.14us, its phase is 600us to 700us; it was held back for" in first.message
    assert "larger share" in first.help
    (outcome, *_) = play(bundle)
    free = {t.size: t for job in play(export())[0].jobs for t in job.transfers if t}
    for seen in (t for job in outcome.jobs for t in job.transfers if t):
        assert seen.end - seen.begin == free[seen.size].end - free[seen.size].begin + seen.held


def test_memory_phases_are_written_as_csv(export, tmp_path):
    bundle = guaranteeing(export, "8MB/s")
    file = tmp_path / "phases.csv"
    said = run_here(tmp_path, "deploy", "check", bundle.bundle.path, "--inject", "none", "--bandwidth", file)
    assert said.returncode == 0
    header, first, *_ = file.read_text().splitlines()
    assert header == "cycle,table,task,job,unit,direction,start,end,promised,granted,used,held"
    assert first == "0,full,filter,0,left,read,0,100000,800,896,120,0"


def test_without_regulators_there_are_no_phases_to_write(sound, tmp_path):
    said = run_here(
        tmp_path, "deploy", "check", sound.bundle.path, "--inject", "none", "--bandwidth", tmp_path / "phases.csv"
    )
    assert said.returncode == 2
    assert "export riscv --regulator" in said.stderr
    assert not list(tmp_path.iterdir())


def test_tables_that_are_wrong_are_found(regulated):
    name = "regulator/table/unit0.tab.memh"
    image = regulated.bundle.files[name]
    files = {**regulated.bundle.files, name: image.replace(image[:8], b"00000001", 1)}
    wrong = replace(regulated, bundle=replace(regulated.bundle, files=files))
    (found,) = DEPLOYMENT.check(wrong, CheckOptions(inject="none")).diagnostics
    assert (found.code, found.at.file) == (FORMS_DIFFER.id, f"{wrong.bundle.path}/{name}")


def test_a_bundle_without_regulators_says_nothing_of_them(sound):
    assert not any("regulators:" in line for line in DEPLOYMENT.check(sound, CheckOptions(inject="none")).lines)
