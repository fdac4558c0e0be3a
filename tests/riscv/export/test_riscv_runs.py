"""What bundles do when they run: the runtime's own trace, read from the memory of the simulated board.

That starts, ends and transfers are as scheduled is the business of `halpipe deploy check`; here it is the runtime
itself: jobs that outlast their table, gangs, several functions, and jobs that misbehave.
"""

from dataclasses import replace

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.judge.check import CYCLES, simulate
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.deploy.riscv.run.recording import Flag, Kind
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.flow.formats import open_target
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from riscv_models import PHASES, SCALE, deployed, moving, several, single
from support import job, ms, task


@pytest.fixture
def bundle(build, tmp_path):
    """Export a system and open the bundle."""

    def make(system, tables, **sources):
        folder = str(tmp_path / "bundle")
        write_directory(folder, build(system, tables, **sources))
        return open_target(folder)

    return make


def errors(target):
    """What the check of the bundle finds, in every mode and every switch."""
    outcomes = [simulate(target, tour) for tour in tours(target.schedule, CYCLES)]
    return [found for outcome in outcomes for found in outcome.findings if found.is_error]


def flags(run, kind):
    return [record.flags for record in run.recording.records if record.kind == kind]


def mode_of(system, name, hyperperiod, *jobs):
    return ModeSchedule(name=name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)


def schedule_of(system, modes, *switches):
    found = tuple(
        TransitionTable(source=a, target=b, length=ms(length), worst_latency=ms(latency), status=Status.VALID)
        for a, b, length, latency in switches
    )
    return Schedule(model=system.name, model_sha256="", modes=tuple(modes), transitions=found)


def test_a_simple_bundle_does_what_it_should(bundle):
    assert errors(bundle(*single())) == []


def test_members_of_a_gang_know_their_rank(bundle):
    text = SCALE.replace("(void)", "(unsigned rank, unsigned ranks)").replace("* 3", "+ 10 * rank + ranks")
    phases = (moving("memory", "0ms", "0.1ms", "load"), *PHASES[1:])
    target = bundle(*single(deployed(units="u1 u2", gang=2, phases=phases), units="u1 u2"), scale_c=text)
    assert errors(target) == []
    run = CoSimulation(target, cycles=1).run()
    assert len(flags(run, Kind.RUN)) == 2
    read = lambda place: int.from_bytes(run.memory.read(run.site.buffers["output"].base + place, 4), "little")  # noqa: E731
    assert (read(0), read(28)) == (2, 2)  # the first member's half
    assert (read(32), read(60)) == (12, 12)  # the second one's


SPLIT = """#include <stdint.h>
uint32_t numbers[16], scaled[16];
static uint32_t kept;
void first(void) { kept = 5; scaled[0] = numbers[0] + 1; }
void second(void) { scaled[1] = kept; }
"""


def test_several_functions_share_a_job(bundle):
    """The first one's result is written between them; what it keeps in .bss is there for the second."""
    phases = (
        *PHASES[:2],
        moving("memory", "0.4ms", "0.5ms", "write", ("between", "scaled", 4)),
        PHASES[2],
    )
    target = bundle(*single(deployed(phases=phases, entry="first second")), scale_c=SPLIT)
    assert errors(target) == []
    run = CoSimulation(target, cycles=1).run()
    read = lambda name: run.memory.read(run.site.buffers[name].base, 8)  # noqa: E731
    assert int.from_bytes(read("between")[:4], "little") == 1
    assert int.from_bytes(read("output")[4:], "little") == 5


@pytest.mark.slow
def test_nothing_survives_in_a_scratchpad(bundle):
    text = SCALE.replace("void scale", "static uint32_t zero, one = 1;\nvoid scale").replace(
        "numbers[i] * 3;", "zero++ * 1000 + one++;"
    )
    run = CoSimulation(bundle(*single(), scale_c=text), cycles=3).run()
    assert int.from_bytes(run.memory.read(run.site.buffers["output"].base, 4), "little") == 1


LONG = 8
"""The row of the long job in its table: eight short ones start before."""


def wrapping():
    """A long job in one mode, that still runs when the short hyperperiod of the other has passed several times."""
    long = task(
        "long",
        "20ms",
        deployed(
            units="u1",
            wcet="12ms",
            phases=(PHASES[0], moving("memory", "11.9ms", "12ms", "write", ("output", "scaled", 64))),
        ),
    )
    short = task(
        "short",
        "2ms",
        deployed(units="u2", phases=tuple(replace(p, transfers=()) if p.transfers else p for p in PHASES[:1])),
    )
    system = several([long, short], [("both", [long, short]), ("one", [short])], [("both", "one", None)])
    shorts = [job(system, "short", i, f"{2 * i + 1}ms", "u2") for i in range(10)]
    both = mode_of(system, "both", "20ms", job(system, "long", 0, "15.5ms", "u1"), *shorts)
    one = mode_of(system, "one", "2ms", job(system, "short", 0, "1ms", "u2"))
    return system, schedule_of(system, [both, one], ("both", "one", "0ms", "20ms"))


def test_a_job_outlives_its_mode(bundle):
    system, tables = wrapping()
    target = bundle(system, tables)
    run = CoSimulation(target, cycles=8, requests=[(ms(1), "one")]).run()
    assert [table.name for table in run.tables] == ["both", "both->one", *["one"] * 6]
    late = [r for r in run.recording.records if (r.cycle, r.release) == (0, LONG) and r.time >= 20_000]
    assert [(r.kind, r.flags) for r in late] == [(Kind.STOP, 0), (Kind.COPY, 0), (Kind.DONE, 0)]
    assert [r.time for r in late] == pytest.approx([27_400, 27_400, 27_500], abs=5)
    assert not run.recording.abandoned


def test_parts_of_jobs_that_never_began_are_idle(bundle):
    """In the first cycle, nobody is on the unit where the long job wraps to later."""
    target = bundle(*wrapping())
    run = CoSimulation(target, cycles=2).run()
    long = [(r.cycle, r.time) for r in run.recording.records if r.kind == Kind.STOP and r.release == LONG]
    assert [cycle for cycle, _ in long] == [0, 1]
    assert all(time > 20_000 for _, time in long)
    assert not run.recording.abandoned


def test_a_request_without_a_table_is_refused(bundle):
    system, tables = wrapping()
    target = bundle(system, tables)
    run = CoSimulation(target, cycles=4, first="one", requests=[(ms(1), "both")]).run()
    assert {table.name for table in run.tables} == {"one"}
    assert Flag.REFUSED in flags(run, Kind.TABLE)
    assert run.word(15) == 1


OUTSIDE = SCALE.replace("for (", "*(volatile uint32_t *)0x80000000 = 1;\n for (")
ENDLESS = SCALE.replace("for (", 'for (;;) __asm__ volatile("");\n for (')
OVERFLOW = SCALE.replace(
    "void scale",
    "static uint32_t deep(uint32_t n) { volatile uint32_t kept[64]; kept[n % 64] = n;"
    " return n ? deep(n - 1) + kept[n % 64] : 0; }\nvoid scale",
).replace("* 3", "+ deep(1000)")


@pytest.mark.parametrize(("text", "flag"), [(OUTSIDE, Flag.FAULT), (ENDLESS, Flag.OVERRUN), (OVERFLOW, Flag.FAULT)])
def test_a_job_that_misbehaves_is_abandoned_and_others_go_on(bundle, text, flag):
    bad = task(
        "bad",
        "5ms",
        deployed(
            units="u1",
            files="bad.c",
            phases=(*PHASES[:2], moving("memory", "0.9ms", "1ms", "write", ("bad", "scaled", 64))),
        ),
    )
    good = task("good", "5ms", deployed(units="u2"))
    system = several([bad, good], [("all", [bad, good])])
    tables = schedule_of(
        system, [mode_of(system, "all", "5ms", job(system, "bad", 0, 0, "u1"), job(system, "good", 0, 2, "u2"))]
    )
    target = bundle(system, tables, bad_c=text)
    run = CoSimulation(target, cycles=3).run()
    assert [(a.hart, a.flags) for a in run.recording.abandoned] == [(1, flag)] * 3
    assert run.memory.read(run.site.buffers["bad"].base, 64) == bytes(64)
    ends = [r.flags for r in run.recording.records if r.kind == Kind.STOP]
    assert ends == [flag, 0] * 3
    assert {found.code for found in errors(target)}


def test_the_fault_says_where(bundle):
    run = CoSimulation(bundle(*single(), scale_c=OUTSIDE), cycles=1).run()
    [abandoned] = run.recording.abandoned
    image = run.site.units[0]
    assert abandoned.cause == 7  # store access fault
    assert abandoned.tval == 0x80000000
    assert abandoned.epc in range(image.ispm.base, image.ispm.base + image.ispm.size)


@pytest.mark.slow
def test_faults_in_a_job_whose_image_has_two_parts(bundle):
    """Code and data are loaded one after the other; a late load is that of the last one."""
    text = SCALE.replace("void scale", "static volatile uint32_t three = 3;\nvoid scale").replace("* 3;", "* three;")
    checked = DEPLOYMENT.check(bundle(*single(), scale_c=text), CheckOptions(inject="all"))
    assert checked.diagnostics == ()
    assert "injected: 13 faults of 13 kinds into 1 jobs" in checked.lines
