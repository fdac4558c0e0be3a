"""The QEMU engine without QEMU: what it says when it is absent or hangs, and how the records of a run are judged."""

from dataclasses import replace

import pytest
from riscv_target import bundle, target

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import NOT_STARTED, TimeoutExpired
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge import qemu as emulator
from halpipe.deploy.riscv.judge.qemu import is_over
from halpipe.deploy.riscv.judge.records import hold
from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob
from halpipe.deploy.riscv.run.recording import Flag, Kind, Record, Recording
from halpipe.deploy.riscv.run.sequence import Played
from halpipe.deploy.riscv.target import read_site
from support import job, model, ms, schedule, task, version

SYSTEM = model(task("a", "10ms", version("v", "1ms", "core1")), units="core1 core2")
JOB = job(SYSTEM, "a", 0, "2ms", "core1")


def site(machine=()):
    described = target()
    described["qemu"] = list(machine)
    return described


def check(machine, engine="qemu"):
    tables = schedule(SYSTEM, "10ms", JOB)
    return DEPLOYMENT.check(
        Target(bundle=bundle(site(machine)), model=SYSTEM, schedule=tables), CheckOptions(engine=engine)
    )


def refused(*args):
    with pytest.raises(HalpipeError) as failure:
        check(*args)
    (found,) = failure.value.diagnostics
    return found


def test_a_profile_without_a_machine():
    found = refused(())
    assert found.code == codes.ENGINE_UNFIT.id
    assert "fu540" in found.help


def test_without_qemu_the_way_to_install_it_is_told(monkeypatch):
    monkeypatch.setattr(emulator.shutil, "which", lambda name: None)
    found = refused(("-machine", "virt"))
    assert found.code == codes.ENGINE_ABSENT.id
    assert "apt-get install qemu-system-misc" in found.help


def test_an_engine_that_there_is_none_of():
    found = refused((), "quemu")
    assert found.code == codes.BAD_REQUEST.id
    assert "qemu" in found.help


def test_a_run_that_does_not_end(monkeypatch):
    def hang(command, *, seconds):
        raise TimeoutExpired(command, seconds)

    monkeypatch.setattr(emulator, "run", hang)
    assert emulator.start(["qemu"]) is None
    words = (0,) * 9 + (1,) + (0,) * 8
    (found,) = is_over(emulator.Played(Recording((), (), 0), words, {}, is_over=False))
    assert found.code == codes.NOT_FINISHED.id
    assert "it was still playing" in found.message
    assert "the emulator was ended" in found.message


def test_a_program_that_cannot_be_run():
    with pytest.raises(HalpipeError) as failure:
        emulator.start(["/nonexistent/qemu"])
    assert failure.value.diagnostics[0].code == NOT_STARTED.id


TABLE = Played(0, "all", ms(0), ms(10), (JOB,))
PLANNED = PlannedJob(
    table=TABLE,
    row=0,
    job=JOB,
    begin=2000,
    end=3000,
    transfers=(),
    executions=(PlannedExecution(hart=1, function=0x1821000, begin=2100, end=2900, stretch=0),),
)


def record(kind, time, begin=0, end=0, flags=0):
    return Record(time, begin, end, 0, 0, 0, 0, kind, Flag(flags), 0, 1)


def held(*records):
    recording = Recording((record(Kind.TABLE, 0, 0, 10_000), *records), (), 0)
    return {d.code for d in hold(read_site(bundle(target())), recording, [TABLE], [PLANNED]).findings}


def test_a_sound_record_is_accepted():
    assert held(record(Kind.STOP, 2900, 2101, 2898)) == set()


@pytest.mark.parametrize(
    ("records", "code"),
    [
        ([], codes.MISSING_JOB),
        ([record(Kind.STOP, 2900, 2099, 2898)], codes.WRONG_INSTANT),
        ([record(Kind.STOP, 2900, 2150, 2898)], codes.WRONG_INSTANT),
        ([record(Kind.STOP, 2900, 2101, 2200, 4)], codes.FAULT),
        ([record(Kind.STOP, 2900, 0, 0, 8)], codes.MISSING_JOB),
        ([record(Kind.STOP, 2900, 2101, 2898), record(Kind.COPY, 5)], codes.FOREIGN_TRANSFER),
        ([record(Kind.STOP, 2900, flags=2)], codes.OVERRUN),
        ([record(Kind.STOP, 2900, 2101, 2898), record(Kind.STOP, 2950, 2901, 2949)], codes.FOREIGN_JOB),
        ([record(Kind.STOP, 2900, 2101, 2898), record(Kind.TABLE, 10_000)], codes.WRONG_TABLE),
    ],
)
def test_every_deviation_of_a_record_is_found(records, code):
    assert code.id in held(*records)


OTHER = replace(
    PLANNED, row=1, executions=(PlannedExecution(hart=2, function=0x1841000, begin=2100, end=2900, stretch=0),)
)


def together(first, second):
    """What is held against a job on core1 and one on core2, with a record of each."""
    records = (record(Kind.TABLE, 0, 0, 10_000), first, replace(second, hart=2))
    return hold(read_site(bundle(target())), Recording(records, (), 0), [TABLE], [PLANNED, OTHER])


def test_a_start_is_late_by_no_more_than_others_compute():
    sound = together(record(Kind.STOP, 2900, 2101, 2150), record(Kind.STOP, 2900, 2155, 2898))
    assert (sound.findings, sound.delayed) == ([], 1)
    late = together(record(Kind.STOP, 2900, 2101, 2150), record(Kind.STOP, 2900, 2185, 2898))
    assert [d.code for d in late.findings] == [codes.WRONG_INSTANT.id]


def test_an_overrun_beside_a_core_that_computes_is_nothing_that_qemu_can_tell():
    """Of 800 us, the other core has 790; on the board, at 100 MHz, the job would have had ten times the rest."""
    held = together(record(Kind.STOP, 2900, 2101, 2890), record(Kind.STOP, 2900, 0, 0, 2))
    assert [d.code for d in held.findings] == [codes.ENGINE_UNFIT.id]
    assert "QEMU cannot tell" in held.findings[0].message


def test_an_overrun_with_the_clock_of_the_board_is_one():
    """The other core takes 100 us: what is left of a clock of 1 GHz is more than the board's 100 MHz."""
    held = together(record(Kind.STOP, 2900, 2101, 2200), record(Kind.STOP, 2900, 0, 0, 2))
    assert [d.code for d in held.findings] == [codes.OVERRUN.id]
