"""Switches while jobs with gaps are in progress, and tables that have such jobs, on the board (MODEL 8)."""

import shutil
from dataclasses import replace

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from test_riscv_split import LONG, SHORT

import split_switches
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.judge.qemu import EMULATOR
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.exporters.native import paired
from halpipe.exporters.riscv import RiscvOptions
from halpipe.exporters.riscv.prepare import FILE
from halpipe.flow.formats import export, open_target, prepare_model
from halpipe.importers.native import parse_model
from halpipe.models import Schedule, Split
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify
from riscv_models import deployed, moving, on_disk
from support import mode, model, ms, task, version

LOAD = moving("mem", "0ms", "0.1ms", "load")
KEPT = (LOAD, moving("mem", "0.1ms", "0.2ms", "read", ("input", "numbers", 64)))
KEPT += (moving("mem", "3.9ms", "4ms", "write", ("long", "scaled", 64)),)
BRIEF = (LOAD, moving("mem", "0.9ms", "1ms", "write", ("short", "scaled", 64)))
FUNCTIONS = ("first", "second", "third")


@pytest.fixture
def bundle(build, tmp_path):
    def make(profile="vcu118"):
        kept = deployed(wcet="4ms", phases=KEPT, files="long.c", entry=" ".join(FUNCTIONS))
        system = split_switches.system(kept, deployed(wcet="1ms", phases=BRIEF, files="short.c"))
        plan = split_switches.plan(system)
        assert [d for d in verify(system, plan) if d.is_error] == []
        write_directory(str(tmp_path / "b"), build(system, plan, profile=profile, long_c=LONG, short_c=SHORT))
        return open_target(str(tmp_path / "b"))

    return make


def entered(run):
    """When the functions of `kept` begin, with their numbers in the job."""
    return [
        (run.since(e.begin), e.image.site.entries.index(e.function))
        for e in run.executions
        if e.image.site.task == "kept"
    ]


@pytest.mark.slow
def test_both_switches_are_played_with_all_pieces(bundle):
    checked = DEPLOYMENT.check(bundle(), CheckOptions(inject="all"))
    assert checked.diagnostics == ()
    for name in ("one->two", "two->one"):
        assert any(line.startswith(name) for line in checked.lines)


def test_jobs_with_gaps_go_on_at_their_instants_and_keep_their_memory(bundle):
    """A job of "one" goes on 2 and 12 ms after its end, at 20 ms; one of the table back, from 45 to 55 ms, at 56 ms."""
    simulation = CoSimulation(bundle(), cycles=6, requests=[(ms(5), "two"), (ms(30), "one")])
    simulation.write("input", b"".join(n.to_bytes(4, "little") for n in range(16)))
    run = simulation.run()
    assert [table.name for table in run.tables][:5] == ["one", "one->two", "two", "two->one", "one"]
    # the first piece begins when the input is read, after 0.2 ms, each other one when the job has resumed
    due = [("17.2ms", "22.1ms", "32.1ms"), ("36.2ms", "38.1ms", "42.1ms"), ("46.2ms", "48.1ms", "56.1ms")]
    planned = [(ms(instant), piece) for pieces in due for piece, instant in enumerate(pieces)]
    seen = entered(run)[: len(planned)]
    assert [piece for _, piece in seen] == [piece for _, piece in planned]
    assert all(at <= begin <= at + ms("0.01ms") for (begin, _), (at, _) in zip(seen, planned, strict=True))
    found = run.memory.read(run.site.buffers["long"].base, 64)
    assert [int.from_bytes(found[i : i + 4], "little") for i in range(0, 64, 4)] == [2 * (n + 5) + n for n in range(16)]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which(EMULATOR) is None, reason="apt-get install qemu-system-misc")
def test_both_switches_are_played_by_qemu(bundle):
    checked = DEPLOYMENT.check(bundle("fu540"), CheckOptions(engine="qemu"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    assert "as scheduled" in checked.lines[-1]


@pytest.mark.slow
def test_dummies_have_a_function_for_each_piece(tmp_path):
    """A model without sources becomes a bundle with gaps, of tables that the search finds, and plays its switches."""
    tasks = [
        task("kept", 20, replace(version("v", 8), split=Split(points=(ms(2), ms(4), ms(6))))),
        task("brief", 5, version("v", 1)),
    ]
    modes = [mode("one", tasks), mode("two", tasks[1:])]
    ends = [("one", "two", 40), ("two", "one", 40)]
    system = model(*tasks, resources="mem", modes=modes, transitions=ends)
    files = paired(system, Schedule(model="m", model_sha256=""))
    prepared = prepare_model(parse_model(files["model.xml"], str(tmp_path / "m.xml")), RiscvOptions(), dummy=True)
    tmp_path.joinpath(FILE).write_bytes(prepared.files[FILE])
    owner = prepared.model
    assert owner.task("kept").versions[0].source.entry == "dummy_0 dummy_1 dummy_2 dummy_3"
    found = schedule_model(owner, SearchOptions(tick=ms("1us")), lambda *_: True).schedule
    assert any(job.parts for job in found.modes[0].jobs)
    read, plan = on_disk(tmp_path, owner, found)
    write_directory(str(tmp_path / "b"), export("riscv", read, plan, RiscvOptions(sources=str(tmp_path))))
    checked = DEPLOYMENT.check(open_target(str(tmp_path / "b")), CheckOptions())
    assert checked.diagnostics == ()
    assert checked.lines[-1].endswith("as scheduled")
