"""Programs and tables of regulators in one bundle: checked together, and wrong tables are found."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

import halpipe
from command_line import run_here
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator.codes import FORMS_DIFFER, PLAYED_ELSEWHERE, USED_ABOVE_BUDGET
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.codes import TRANSFER_OUTSIDE_PHASE
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.deploy.riscv.run.regulators import RegulatorPort
from halpipe.exporters.riscv import FORMAT, RiscvOptions
from halpipe.exporters.riscv.codes import REGULATORS_LEFT_ALONE
from support import ms

RTL = Path(halpipe.__file__).parent / "exporters" / "regulator" / "table" / "rtl"
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_budgets_that_just_suffice_hold_nobody_back(export):
    """A phase of 50 us is granted 6 bursts for 64 B; each cycle has windows of its own."""
    checked = DEPLOYMENT.check(guaranteeing(export, "8MB/s"), CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    (line,) = [line for line in checked.lines if line.startswith("regulators: halt, right, write: ")]
    assert line == "regulators: halt, right, write: 3 phases, 1200 B promised, 1344 B granted, 24 B used"


@pytest.mark.slow
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


@pytest.mark.slow
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


DRIVEN = PLATFORM + "table: {base: 0x60000000}\n"


@pytest.fixture(scope="module")
def driven(export):
    return export(platform=DRIVEN)


@pytest.mark.slow
def test_the_runtime_starts_and_switches_the_regulators(driven):
    """Their first table begins a cycle after that of the runtime, and so do their switches: HAL1507 compares them."""
    checked = DEPLOYMENT.check(driven, CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    assert "regulators: their tables begin 10ns after those of the runtime" in checked.lines


SLOW = DRIVEN.replace("100MHz", "4MHz").replace("5000", "200").replace("400MB", "16MB").replace("440MB", "17.6MB")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("iverilog") is None, reason="iverilog is not installed")
def test_the_verilog_plays_what_the_runtime_writes(export, tmp_path):
    """Every table begins a cycle after that of the runtime; the timer has a tick in 4 cycles."""
    simulation = CoSimulation(export(platform=SLOW), requests=[(ms(3), "calm"), (ms(13), "halt")], cycles=5)
    run = simulation.run()
    cycles = {at: at * 4 * 10**6 // run.rate for at, _, _ in simulation.port.writes}
    lines = [f"{cycles[at]} {offset:x} {value:x}\n" for at, offset, value in simulation.port.writes]
    (tmp_path / "writes.txt").write_text("".join(lines))
    zero = run.zero * 4 * 10**6 // run.rate
    bench = [Path(__file__).parents[2] / "rtl" / "runtime_bench.v", *sorted(RTL.glob("*.v"))]
    subprocess.run(["iverilog", "-g2005-sv", "-s", "runtime_bench", "-o", "bench", *bench], cwd=tmp_path, check=True)
    end = zero + int(run.tables[-1].start.fraction * 4 // 1000)
    said = subprocess.run(
        ["vvp", "-n", "bench", f"+first={zero - 4000}", f"+last={end + 9}"],
        cwd=tmp_path, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    begun = [[int(word) for word in line.split()] for line in said.splitlines() if "finish" not in line]
    numbers = {"full": 0, "calm": 1, "halt": 2}
    played = [table for table in run.tables if table.name in numbers]  # the others have no length
    assert begun == [[numbers[t.name], zero + 1 + int(t.start.fraction * 4 // 1000)] for t in played]
    assert len({number for number, _ in begun}) == 3


def test_a_switch_that_the_regulators_do_not_make_is_found(driven, monkeypatch):
    """As with a runtime that requests nothing of them."""
    store = RegulatorPort.store
    lost = 0x1C
    monkeypatch.setattr(
        RegulatorPort, "store", lambda port, hart, at, size, n: at == lost or store(port, hart, at, size, n)
    )
    found = {d.code for d in DEPLOYMENT.check(driven, CheckOptions(inject="none")).diagnostics}
    assert PLAYED_ELSEWHERE.id in found


def test_regulators_that_the_runtime_leaves_alone_are_named(regulated, driven):
    for target, expected in ((regulated, {REGULATORS_LEFT_ALONE.id}), (driven, set())):
        remarks = FORMAT.remarks(target.model, target.schedule, RiscvOptions(profile="vcu118"), target.bundle.files)
        assert {d.code for d in remarks} & {REGULATORS_LEFT_ALONE.id} == expected
