"""The management core is never later than the export computed from its profile, with either compiler."""

import json
import shutil

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from halpipe.core.durations import Duration
from halpipe.core.files import write_directory
from halpipe.deploy.riscv.judge.figures import due_of
from halpipe.deploy.riscv.judge.tables import tables_of
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.deploy.riscv.run.recording import Kind
from halpipe.exporters.riscv import RiscvOptions
from halpipe.exporters.riscv.profile import FOLDER, read_profile
from halpipe.flow.formats import export, open_target
from halpipe.models import ModeSchedule, Schedule, Status
from riscv_models import deployed, moving, on_disk, several
from support import job, ms, task

CORES = 8


def crowded():
    """A system in which everything happens at the same instants: four cores with a resource each, twice in a row."""
    tasks = []
    for core in range(CORES):
        resource = f"r{core % 4}"
        phases = (
            moving(resource, "0us", "300us", "load"),
            moving(resource, "300us", "600us", "read", (f"in{core}", "numbers", 64)),
            moving(resource, "900us", "1200us", "write", (f"out{core}", "scaled", 64)),
        )
        tasks.append(task(f"t{core}", "5ms", deployed(units=f"u{core}", wcet="1200us", phases=phases)))
    units = " ".join(f"u{core}" for core in range(CORES))
    system = several(tasks, [("all", tasks)], units=units, resources="r0 r1 r2 r3")
    jobs = tuple(job(system, f"t{c}", 0, f"{c // 4 * 1200}us", f"u{c}") for c in range(CORES))
    mode = ModeSchedule(name="all", hyperperiod=ms(5), status=Status.VALID, jobs=jobs)
    return system, Schedule(model=system.name, model_sha256="", modes=(mode,))


def lateness(target, run):
    """How much later than planned each operation began, in ticks; not of transfers that wait for the one before."""
    tables = tables_of(target, run.site)
    starts = {r.cycle: r.begin for r in run.recording.records if r.kind == Kind.TABLE}
    for record in run.recording.records:
        if record.kind != Kind.TABLE:
            program = tables.operations(record.program)
            if record.kind != Kind.COPY or program[record.operation - 1].kind != Kind.COPY:
                yield record.time - due_of(tables, record, starts)[0]


@pytest.mark.parametrize("toolchain", ["zig", pytest.param("gcc", marks=pytest.mark.slow)])  # zig is as strict
def test_no_operation_is_later_than_computed(tmp_path, toolchain):
    """With a timer as fine as two instructions, on the target with the most cores.

    What is reserved for jobs that fail, and for slower cores, is left away.
    """
    if toolchain == "gcc" and shutil.which("riscv64-unknown-elf-gcc") is None:
        pytest.skip("riscv64-unknown-elf-gcc is not installed")
    text = FOLDER.joinpath("vcu118x8.yaml").read_text()
    tmp_path.joinpath("fine.yaml").write_text(
        text.replace("timebase: 1000000", "timebase: 50000000").replace("service: 6500ns", "service: 1600ns")
    )
    model, tables = on_disk(tmp_path, *crowded())
    options = RiscvOptions(profile=str(tmp_path / "fine.yaml"), toolchain=toolchain)
    bundle = export("riscv", model, tables, options)
    write_directory(str(tmp_path / "bundle"), bundle)
    target = open_target(str(tmp_path / "bundle"))
    run = CoSimulation(target, cycles=3).run()
    [described] = json.loads(bundle["target.json"])["tables"]
    bound = Duration.parse(described["lateness"])
    tick = read_profile(str(tmp_path / "fine.yaml")).tick
    found = [tick * late for late in lateness(target, run)]
    assert len(found) > 100
    assert max(found) <= bound
    assert max(found) > bound / 2  # the bound is not out of all proportion
