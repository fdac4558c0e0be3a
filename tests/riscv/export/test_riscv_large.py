"""Sixteen cores, a thousand jobs in a hyperperiod, and the preparation of four hundred tasks."""

import re

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")
pytest.importorskip("ziglang", reason="pip install ziglang pyelftools unicorn")

from halpipe.core.files import write_directory
from halpipe.deploy.riscv.judge.check import simulate
from halpipe.deploy.riscv.run.sequence import Tour
from halpipe.exporters.riscv import RiscvOptions
from halpipe.exporters.riscv.profile import FOLDER
from halpipe.flow.formats import export, open_target
from halpipe.models import ModeSchedule, Schedule, Status
from riscv_models import deployed, moving, on_disk, several
from support import job, ms, task

pytestmark = pytest.mark.slow

REPEATS = {8: 143, 16: 67}
"""Hyperperiods of all tasks but the last, which has one job in that time."""


def large(cores):
    """Jobs in four shifts of 1.2 ms in a period of 5 ms, as many resources as there are channels."""
    tasks, jobs = [], []
    for core in range(cores):
        resource, repeats = f"r{core % 4}", 1 if core == cores - 1 else REPEATS[cores]
        phases = (
            moving(resource, "0us", "300us", "load"),
            moving(resource, "300us", "600us", "read", (f"in{core}", "numbers", 64)),
            moving(resource, "900us", "1200us", "write", (f"out{core}", "scaled", 64)),
        )
        period = ms(5 * REPEATS[cores] // repeats)
        tasks.append(task(f"t{core}", period, deployed(units=f"u{core}", wcet="1200us", phases=phases)))
    units = " ".join(f"u{core}" for core in range(cores))
    system = several(tasks, [("all", tasks)], units=units, resources="r0 r1 r2 r3")
    for core, owner in enumerate(tasks):
        for i in range(int(ms(5 * REPEATS[cores]) / owner.period)):
            jobs.append(job(system, owner.name, i, ms(5) * i + ms("1.2ms") * (core // 4), f"u{core}"))
    mode = ModeSchedule(name="all", hyperperiod=ms(5 * REPEATS[cores]), status=Status.VALID, jobs=tuple(jobs))
    return system, Schedule(model=system.name, model_sha256="", modes=(mode,))


@pytest.mark.parametrize("cores", [8, 16])
def test_a_thousand_jobs_in_a_hyperperiod(tmp_path, cores):
    text = FOLDER.joinpath("vcu118.yaml").read_text()
    tmp_path.joinpath("many.yaml").write_text(text.replace("cores: 4", f"cores: {cores}"))
    model, tables = on_disk(tmp_path, *large(cores))
    assert len(tables.modes[0].jobs) >= 1000
    options = RiscvOptions(profile=str(tmp_path / "many.yaml"), toolchain="zig")
    write_directory(str(tmp_path / "bundle"), export("riscv", model, tables, options))
    outcome = simulate(open_target(str(tmp_path / "bundle")), Tour("all", (), 1))
    assert [found for found in outcome.findings if found.is_error] == []
    assert len(outcome.run.executions) == len(tables.modes[0].jobs)
    assert outcome.dispatch.worst <= outcome.dispatch.reserved


def test_four_hundred_tasks_are_prepared_in_little_memory(tmp_path):
    """In a process of its own, whose peak is measured."""
    import subprocess
    import sys

    tasks = [task(f"t{i}", "1s", deployed(units="u0", wcet="1ms", phases=())) for i in range(400)]
    system = several(tasks, [("all", tasks)], units="u0", resources="m")
    on_disk(tmp_path, system, Schedule(model=system.name, model_sha256=""))
    program = f"""
import resource
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import prepare_model
from halpipe.importers.native import read_model
prepared = prepare_model(read_model({str(tmp_path / "model.xml")!r}), RiscvOptions(toolchain="zig"), dummy=False)
own = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))  # ru_maxrss knows the parent's, too
compilers = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(len(prepared.model.tasks), int(own.split()[1]) // 1024, compilers // 1024)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-1000:]
    tasks_prepared, own, compiler = map(int, re.findall(r"\d+", done.stdout))
    assert tasks_prepared == 400
    assert own < 150  # MiB
    assert compiler < 300  # of one of at most as many as there are processors
