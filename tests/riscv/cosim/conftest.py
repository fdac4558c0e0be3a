"""A small bundle for the co-simulation: three tasks on two cores, three modes, jobs that wrap round the hyperperiod."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.riscv import bundle
from halpipe.importers.native import parse_model
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from one_fault import with_fault
from support import job, ms

HERE = Path(__file__).parent
SOURCES = ("sense.c", "filter.c", "act.c")


def _mode(system, name, hyperperiod, *jobs):
    return ModeSchedule(
        name=name,
        hyperperiod=ms(hyperperiod),
        status=Status.VALID,
        jobs=tuple(job(system, task, i, start, unit, version) for task, i, start, unit, version in jobs),
    )


def tables_of(system):
    """A schedule made by hand; act starts half a millisecond before the end, and goes on in the next hyperperiod."""
    always = [
        ("sense", 0, "0.6ms", "right", "v"),
        ("sense", 1, "5.6ms", "right", "v"),
        ("act", 0, "4.5ms", "right", "v"),
        ("act", 1, "9.5ms", "right", "v"),
    ]
    modes = (
        _mode(system, "full", "10ms", ("filter", 0, "0ms", "left", "full"), *always),
        _mode(system, "calm", "10ms", ("filter", 0, "0ms", "left", "brief"), *always),
        _mode(system, "halt", "5ms", ("act", 0, "4.5ms", "right", "v")),
    )
    transitions = tuple(
        TransitionTable(source=a, target=b, length=ms(0), worst_latency=ms(10), status=Status.VALID)
        for a, b in ((t.source, t.target) for t in system.transitions)
    )
    return Schedule(model=system.name, model_sha256=system.digest, modes=modes, transitions=transitions)


@pytest.fixture(scope="session")
def export(tmp_path_factory):
    """Export the bundle; sources may be replaced by their names, the profile and the model's text changed."""
    pytest.importorskip("unicorn", reason="pip install unicorn")
    pytest.importorskip("ziglang", reason="pip install ziglang")
    from halpipe.core.files import write_directory
    from halpipe.exporters.native import paired
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.flow import formats
    from halpipe.importers.native import parse_schedule
    from halpipe.pipeline.health import with_reactions

    def make(
        sources=None, profile="vcu118", change=lambda text: text, platform="", drivers="", inputs=None, calibrate=False
    ):
        folder = tmp_path_factory.mktemp("bundle")
        for name in SOURCES:
            folder.joinpath(name).write_text((sources or {}).get(name) or HERE.joinpath(name).read_text())
        text = change(HERE.joinpath("model.xml").read_text())
        system = parse_model(text.encode(), str(folder / "model.xml"))
        pair = paired(system, with_reactions(system, tables_of(system)))
        model = parse_model(pair["model.xml"], str(folder / "model.xml"))
        schedule = parse_schedule(pair["schedule.xml"], str(folder / "schedule.xml"))
        options = RiscvOptions(profile=profile, toolchain="zig", sources=str(folder), calibrate=calibrate)
        if platform:
            folder.joinpath("platform.yaml").write_text(platform)
            options = replace(options, regulator=str(folder / "platform.yaml"))
        if drivers:
            folder.joinpath("drivers.yaml").write_text(drivers)
            folder.joinpath("board.c").write_text((sources or {})["board.c"])
            options = replace(options, drivers=str(folder / "drivers.yaml"))
        for name, data in (inputs or {}).items():
            folder.joinpath("recorded").mkdir(exist_ok=True)
            folder.joinpath("recorded", name).write_bytes(data)
            options = replace(options, inputs=str(folder / "recorded"))
        path = folder / "out"
        write_directory(str(path), formats.export("riscv", model, schedule, options))
        return formats.open_target(str(path))

    return make


@pytest.fixture(scope="session")
def sound(export):
    """The bundle as it should be."""
    return export()


@pytest.fixture
def mutant(export, monkeypatch, tmp_path):
    """Export with a runtime in which one thing is another."""

    def make(file, what, instead, **options):
        shutil.copytree(bundle.RUNTIME, tmp_path / "runtime")
        path = tmp_path / "runtime" / file
        path.write_text(with_fault(path.read_text(), what, instead))
        monkeypatch.setattr(bundle, "RUNTIME", tmp_path / "runtime")
        return export(**options)

    return make


@pytest.fixture
def play():
    """Play all tours of a bundle, and return the outcomes."""
    from halpipe.deploy.riscv.judge.check import CYCLES, simulate
    from halpipe.deploy.riscv.run.sequence import tours

    def run(target, **options):
        return [simulate(target, tour, **options) for tour in tours(target.schedule, CYCLES)]

    return run


def codes_in(outcomes):
    """The codes of all errors, as a set."""
    return {found.code for outcome in outcomes for found in outcome.findings if found.is_error}


@pytest.fixture
def codes():
    return codes_in


@pytest.fixture
def refused():
    """Return the diagnostics that a call is refused with."""

    def catch(function, *args, **options):
        with pytest.raises(HalpipeError) as failure:
            function(*args, **options)
        return failure.value.diagnostics

    return catch
