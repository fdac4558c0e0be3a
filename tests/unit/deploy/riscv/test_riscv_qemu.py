"""The QEMU engine without QEMU: what it says when it is absent or hangs, and how the records of a run are judged."""

from dataclasses import replace

import pytest
from riscv_target import bundle, target

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import NOT_STARTED, TimeoutExpired
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge import qemu as emulator
from halpipe.deploy.riscv.judge.conditions import is_over
from halpipe.deploy.riscv.judge.tables import Operation
from halpipe.deploy.riscv.run.cosimulation import TableSeen
from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob
from halpipe.deploy.riscv.run.recording import Abandoned, Dump, Flag, Kind, Record, Recording
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
    place = read_site(bundle(target()))
    (found,) = is_over(emulator.run_of(place, memory(place, 1), "QEMU was ended after 6 s"))
    assert found.code == codes.SPENT.id
    assert "QEMU was ended" in found.message
    (found,) = is_over(emulator.run_of(place, memory(place, 1)))
    assert found.code == codes.NOT_FINISHED.id
    assert "the last table was not over in time" in found.message
    assert list(is_over(emulator.run_of(place, memory(place, 2)))) == []


def memory(place, state):
    """Main memory in which the runtime is in a state."""
    content = bytearray(place.main.size)
    content[place.control - place.main.base + 8 * 9] = state
    return Dump("memory", bytes(content), place.main.base)


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


OPERATION = Operation(500, 0, Kind.COPY, 0x80050000, 0x1821000, 64, 400, 0, 1, 0, 0)
OPERATIONS = [
    replace(OPERATION, at=at, kind=kind, source=source, hart=hart)
    for hart, source in ((1, 0x1821000), (2, 0x1841000))
    for at, kind in ((0, Kind.COPY), (100, Kind.RUN), (900, Kind.STOP))
]


class Program:
    """Operation tables of two programs with three operations each; both are released at tick 2000."""

    def has(self, entry):
        return self.operations(entry.program)[entry.operation].kind == entry.kind

    def releases(self, table):
        return [(2000, 0), (2000, 1)]

    def operations(self, program):
        return OPERATIONS[3 * program : 3 * program + 3]


PLACE = {Kind.COPY: 0, Kind.STOP: 2}


def record(kind, time, begin=0, end=0, flags=0, unit=0):
    return Record(time, begin, end, 0, 0, unit, PLACE.get(kind, 0), kind, Flag(flags), unit, unit + 1)


def judged(records, jobs):
    """Deviations of a record from a plan, and how many starts others delay; each failure is in both rings."""
    place = read_site(bundle(target()))
    failed = [r for r in records if r.flags & ~Flag.SKIPPED]
    abandoned = [
        Abandoned(r.time, 5, 0, 0, 0, 0, r.release, r.program, r.operation, r.kind, 1, r.flags) for r in failed
    ]
    run = replace(
        emulator.run_of(place, memory(place, 2)),
        recording=Recording(tuple(records), tuple(abandoned), 0),
        tables=[TableSeen(ms(0), "all", ms(0)) for r in records if r.kind == Kind.TABLE],
    )
    return emulator.judge(run, Program(), [TABLE], jobs)


def held(*records):
    return {d.code for d in judged([record(Kind.TABLE, 0, 0, 10_000), *records], [PLANNED])[0]}


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
    """What is found of a job on core1 and one on core2, with a record of each."""
    return judged(
        [record(Kind.TABLE, 0, 0, 10_000), record(Kind.STOP, *first), record(Kind.STOP, *second, unit=1)],
        [PLANNED, OTHER],
    )


def test_a_start_is_late_by_no_more_than_others_compute():
    sound = together((2900, 2101, 2150), (2900, 2155, 2898))
    assert sound == ([], 1)
    late = together((2900, 2101, 2150), (2900, 2185, 2898))
    assert [d.code for d in late[0]] == [codes.WRONG_INSTANT.id]


def test_an_overrun_beside_a_core_that_computes_is_nothing_that_qemu_can_tell():
    """Of 800 us, the other core has 790; on the board, at 100 MHz, the job would have had ten times the rest."""
    found, _ = together((2900, 2101, 2890), (2900, 0, 0, 2))
    assert [d.code for d in found] == [codes.ENGINE_UNFIT.id]
    assert "QEMU cannot tell" in found[0].message


def test_an_overrun_with_the_clock_of_the_board_is_one():
    """The other core takes 100 us: what is left of a clock of 1 GHz is more than the board's 100 MHz."""
    found, _ = together((2900, 2101, 2200), (2900, 0, 0, 2))
    assert [d.code for d in found] == [codes.OVERRUN.id]
