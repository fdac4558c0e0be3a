"""Jobs with gaps (MODEL 8): a function for each piece, others in the gaps, and what is refused."""

import shutil
from dataclasses import replace

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.codes import LEFTOVER
from halpipe.deploy.riscv.judge.qemu import EMULATOR
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.exporters.common.codes import NEEDS_HOLD
from halpipe.exporters.riscv import codes
from halpipe.exporters.riscv.cores import check_splits
from halpipe.exporters.riscv.phases import executions, spans
from halpipe.flow.formats import open_target
from halpipe.models import Binding, Interrupt, ModeSchedule, Part, Schedule, Split, Status
from halpipe.pipeline.verify import verify
from riscv_models import deployed, moving, several
from support import job, ms, task

LONG = """#include <stdint.h>
uint32_t numbers[16], scaled[16];
static uint32_t kept[16];
void first(void) { for (int i = 0; i < 16; i++) kept[i] = numbers[i] + 5; }
void second(void) { for (int i = 0; i < 16; i++) kept[i] *= 2; }
void third(void) { for (int i = 0; i < 16; i++) scaled[i] = kept[i] + numbers[i]; }
"""
SHORT = """#include <stdint.h>
uint32_t numbers[16], scaled[16];
static uint32_t other[600];
void scale(void) { for (int i = 0; i < 600; i++) other[i] = 0xffff; for (int i = 0; i < 16; i++) scaled[i] = other[i]; }
"""
PHASES = (
    moving("memory", "0ms", "0.1ms", "load"),
    moving("memory", "0.1ms", "0.2ms", "read", ("input", "numbers", 64)),
    moving("memory", "3.9ms", "4ms", "write", ("long", "scaled", 64)),
)
SMALL = (
    moving("memory", "0ms", "0.1ms", "load"),
    moving("memory", "0.9ms", "1ms", "write", ("short", "scaled", 64)),
)


def system_of(split, entry="first second third", wcet="4ms"):
    version = deployed(units="u1", wcet=wcet, phases=PHASES, files="long.c", entry=entry)
    long = task("long", "10ms", replace(version, split=split))
    short = task("short", "5ms", deployed(units="u1", wcet="1ms", phases=SMALL, files="short.c"))
    return several([long, short], [("all", [long, short])], units="u1")


def part(start, end, executed_from, executed_to):
    times = (ms(time) for time in (start, end, executed_from, executed_to))
    return Part(**dict(zip(("start", "end", "executed_from", "executed_to"), times, strict=True)))


def tables_of(system, *parts):
    """A hyperperiod of 10 ms: short at 1.5 and 6.5 ms, long from 0.5 ms on with these parts."""
    long = job(system, "long", 0, "0.5ms", "u1")
    long = replace(long, end=parts[-1].end if parts else ms("4.5ms"), parts=parts)
    jobs = [long, job(system, "short", 0, "1.5ms", "u1"), job(system, "short", 1, "6.5ms", "u1")]
    mode = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=tuple(jobs))
    return Schedule(model=system.name, model_sha256="", modes=(mode,))


POINTS = Split(points=(ms(1), ms(3)), resume=ms("0.01ms"))
PARTS = (part("0.5ms", "1.5ms", "0ms", "1ms"), part("3ms", "5.01ms", "1ms", "3ms"), part("8ms", "9.01ms", "3ms", "4ms"))


@pytest.fixture
def bundle(build, tmp_path):
    def make(system, tables, profile="vcu118"):
        write_directory(str(tmp_path / "b"), build(system, tables, profile=profile, long_c=LONG, short_c=SHORT))
        return open_target(str(tmp_path / "b"))

    return make


@pytest.mark.slow
def test_a_job_goes_on_after_others_ran_in_its_gaps(bundle):
    """Short fills its memory with other things; what long keeps in .bss is still there for its next piece."""
    system = system_of(POINTS)
    target = bundle(system, tables_of(system, *PARTS))
    checked = DEPLOYMENT.check(target, CheckOptions(inject="all"))
    assert checked.diagnostics == ()
    simulation = CoSimulation(target, cycles=2)
    simulation.write("input", b"".join(n.to_bytes(4, "little") for n in range(16)))
    run = simulation.run()
    found = run.memory.read(run.site.buffers["long"].base, 64)
    assert [int.from_bytes(found[i : i + 4], "little") for i in range(0, 64, 4)] == [2 * (n + 5) + n for n in range(16)]
    entered = [run.since(e.begin) for e in run.executions if e.image.site.task == "long"][:3]
    for seen, due in zip(entered, ("0.7ms", "3.01ms", "8.01ms"), strict=True):
        assert ms(due) <= seen <= ms(due) + ms("0.01ms")  # never before its instant


@pytest.mark.slow
@pytest.mark.skipif(shutil.which(EMULATOR) is None, reason="apt-get install qemu-system-misc")
@pytest.mark.parametrize("engine", ["cosim", "qemu"])
def test_a_bound_and_split_system_runs(bundle, engine):
    """All its tasks are bound, as those of a preemptive OS are; its jobs have gaps in which others run."""
    system = system_of(POINTS)
    system = replace(system, tasks=tuple(replace(t, binding=Binding.SYSTEM) for t in system.tasks))
    tables = tables_of(system, *PARTS)
    assert [d for d in verify(system, tables) if d.is_error] == []
    checked = DEPLOYMENT.check(bundle(system, tables, "fu540"), CheckOptions(engine=engine))
    assert [d for d in checked.diagnostics if d.is_error] == []
    assert "as scheduled" in checked.lines[-1]


def test_a_version_may_name_one_function_where_no_job_has_gaps(bundle):
    system = system_of(POINTS, entry="first")
    jobs = (
        job(system, "long", 0, "0.5ms", "u1"),
        job(system, "short", 0, "4.5ms", "u1"),
        job(system, "short", 1, "9.5ms", "u1"),
    )
    mode = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    target = bundle(system, Schedule(model=system.name, model_sha256="", modes=(mode,)))
    found = DEPLOYMENT.check(target, CheckOptions(inject="none")).diagnostics
    assert {d.code for d in found} == {LEFTOVER.id}  # what the other functions would have written


def test_pieces_lie_between_phases_and_split_points():
    version = system_of(POINTS).tasks[0].versions[0]
    assert executions(version, 1) == [(ms("0.2ms"), ms("3.9ms"))]
    pieces = [(ms("0.2ms"), ms(1)), (ms(1), ms(3)), (ms(3), ms("3.9ms"))]
    assert executions(version, 3) == spans(version, cut=True) == pieces
    assert executions(version, 2) == []


@pytest.mark.parametrize(
    ("split", "entry", "code", "said"),
    [
        (replace(POINTS, points=(), anywhere=True, max_gaps=3), "first", NEEDS_HOLD, "held where one of its functions"),
        (POINTS, "first second", codes.PHASE_ORDER, "has 3 pieces; its entry names 2 functions"),
    ],
)
def test_jobs_that_cannot_be_held(build, split, entry, code, said):
    system = system_of(split, entry)
    with pytest.raises(HalpipeError) as refused:
        build(system, tables_of(system, *PARTS), long_c=LONG, short_c=SHORT)
    assert any(found.code == code.id and said in found.message for found in refused.value.diagnostics)
    assert not any("<split" in found.help for found in refused.value.diagnostics)  # models have no such element


def test_units_that_serve_interrupts():
    system = system_of(POINTS)
    unit = replace(system.units[0], interrupts=(Interrupt(name="bus", distance=ms(1), wcet=ms("0.01ms")),))
    system = replace(system, units=(unit, *system.units[1:]))
    findings = Findings()
    check_splits(system, tables_of(system, *PARTS), findings)
    assert [(d.code, d.path) for d in findings.items] == [(NEEDS_HOLD.id, 'unit "u1"')]


def test_jobs_that_are_open_together_must_fit_together(refusal):
    system = system_of(POINTS)
    big = f"uint8_t big[{150 * 1024}];\n"
    use = "*(volatile uint8_t *)big = 1; for"
    long = LONG.replace("static uint32_t", big + "static uint32_t").replace("first(void) { for", "first(void) { " + use)
    short = SHORT.replace("static uint32_t", big + "static uint32_t").replace(
        "scale(void) { for", "scale(void) { " + use
    )
    found = refusal(system, tables_of(system, *PARTS), long_c=long, short_c=short)
    assert found.code == codes.IMAGE_TOO_LARGE.id
    assert "beside the jobs with gaps that are open on u1" in found.message
