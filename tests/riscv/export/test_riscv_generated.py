"""The sets of Table III, smaller: from generated set over dummies and schedule to a bundle that does what it should."""

from dataclasses import replace
from fractions import Fraction

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from halpipe.core.files import write_directory
from halpipe.deploy.riscv.judge.check import CYCLES, simulate
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.exporters.native import format_model, paired
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import export, open_target, prepare_model
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate_with_witness
from halpipe.pipeline.solve.schedule import SearchOptions

OPTIONS = RiscvOptions(profile="vcu118x8", toolchain="zig")
EXPERIMENTS = {
    "tasks": SetParameters(tasks=24, units=6, unit_types=3, resources=2),
    "versions": SetParameters(tasks=18, units=6, resources=2, access_windows=9, multi_version=Fraction(1, 2)),
    "precedence": SetParameters(tasks=18, units=6, resources=2, access_windows=9, precedence=Fraction(3, 5)),
    "resources": SetParameters(tasks=32, units=8, unit_types=1, resources=4, access_windows=20),
    "gangs": SetParameters(tasks=16, units=4, unit_types=1, resources=1, gang=Fraction(1, 4)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_generated_sets_are_deployed(name, tmp_path):
    made, _ = generate_with_witness(EXPERIMENTS[name], 1)
    file = str(tmp_path / "model.xml")
    prepared = prepare_model(parse_model(format_model(made), file), OPTIONS, dummy=True)
    for beside, content in prepared.files.items():
        (tmp_path / beside).write_bytes(content)
    model = parse_model(format_model(prepared.model), file)
    scheduled = schedule_model(model, SearchOptions(), lambda *_: True)
    files = paired(model, replace(scheduled.schedule, model_sha256=model.digest))
    schedule = parse_schedule(files["schedule.xml"], "schedule.xml")
    write_directory(str(tmp_path / "bundle"), export("riscv", parse_model(files["model.xml"], file), schedule, OPTIONS))
    target = open_target(str(tmp_path / "bundle"))
    outcomes = [simulate(target, tour) for tour in tours(target.schedule, CYCLES)]
    assert [found.message for outcome in outcomes for found in outcome.findings if found.is_error] == []
