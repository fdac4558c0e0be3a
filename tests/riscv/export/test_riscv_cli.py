"""Bundles from the command line and from pipeline files, as users make them."""

import json
from dataclasses import replace

import pytest

from command_line import run_here
from halpipe.core.bundles import open_bundle
from halpipe.exporters.riscv.prepare import FILE
from halpipe.models import Status, TransitionTable
from riscv_models import deployed, on_disk, several, single
from support import model, ms, task, version


@pytest.fixture
def halpipe(tmp_path):
    def run(*arguments, code=0):
        done = run_here(tmp_path, *arguments)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        return done.stderr

    return run


def test_export_writes_a_bundle(halpipe, tmp_path):
    on_disk(tmp_path, *single())
    assert "bundle: written" in halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle")
    assert open_bundle(str(tmp_path / "bundle")).kind == "riscv"


@pytest.mark.slow
def test_a_failed_export_leaves_the_former_bundle(halpipe, tmp_path):
    on_disk(tmp_path, *single())
    halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle")
    before = {p: p.read_bytes() for p in (tmp_path / "bundle").rglob("*") if p.is_file()}
    tmp_path.joinpath("scale.c").write_text("nonsense")
    said = halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle", code=1)
    assert "scale.c:1: error[HAL0846]" in said
    assert {p: p.read_bytes() for p in (tmp_path / "bundle").rglob("*") if p.is_file()} == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bundle", "model.xml", "scale.c", "schedule.xml"]


@pytest.mark.slow
def test_sources_may_lie_elsewhere(halpipe, tmp_path):
    on_disk(tmp_path, *single())
    (tmp_path / "code").mkdir()
    (tmp_path / "scale.c").rename(tmp_path / "code" / "scale.c")
    assert "HAL0844" in halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle", code=1)
    halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle", "--sources", "code")


@pytest.mark.slow
def test_one_mode_is_a_system_of_its_own(halpipe, tmp_path):
    owner = task("scale", "5ms", deployed())
    system = several([owner], [("one", [owner]), ("two", [owner])], units="u1")
    _, tables = single()
    modes = tuple(replace(tables.modes[0], name=mode.name) for mode in system.modes)
    switches = tuple(
        TransitionTable(source=a, target=b, length=ms(0), worst_latency=ms(5), status=Status.VALID)
        for a, b in (("one", "two"), ("two", "one"))
    )
    on_disk(tmp_path, system, replace(tables, modes=modes, transitions=switches))
    halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle", "--mode", "two")
    [table] = json.loads((tmp_path / "bundle" / "target.json").read_text())["tables"]
    assert table["name"] == "two"
    halpipe("verify", "bundle/model.xml", "bundle/schedule.xml")


@pytest.mark.slow
def test_prepare_schedule_export_of_a_set_without_sources(halpipe, tmp_path):
    _, tables = single()
    system = model(task("a", "5ms", version("v", "1ms", "u1")), units="u1")
    on_disk(tmp_path, system, tables)
    assert "longer phases now: 1 version" in halpipe("deploy", "prepare", "model.xml", "-o", "ready.xml", "--dummy")
    assert (tmp_path / FILE).is_file()
    assert "name a file" in halpipe("deploy", "prepare", "model.xml", "-o", "-", "--dummy", code=2)
    assert "long enough" in halpipe("deploy", "prepare", "ready.xml", "-o", "again.xml")
    assert (tmp_path / "again.xml").read_bytes() == (tmp_path / "ready.xml").read_bytes()
    halpipe("schedule", "ready.xml", "-o", "made.xml", "-q")
    halpipe("export", "riscv", "ready.xml", "made.xml", "-o", "bundle")


def test_unknown_profile(halpipe, tmp_path):
    on_disk(tmp_path, *single())
    said = halpipe("export", "riscv", "model.xml", "schedule.xml", "-o", "bundle", "--profile", "vcu18", code=1)
    assert "HAL0840" in said
    assert 'did you mean "vcu118"' in said
    assert not (tmp_path / "bundle").exists()


@pytest.mark.slow
def test_pipeline_files_state_profile_and_sources(halpipe, tmp_path):
    on_disk(tmp_path, *single())
    (tmp_path / "code").mkdir()
    (tmp_path / "scale.c").rename(tmp_path / "code" / "scale.c")
    tmp_path.joinpath("pipeline.yaml").write_text(
        "halpipe-pipeline: 1\nmodel: model.xml\nschedule: {output: made.xml}\nexports:\n"
        "  - {format: riscv, output: bundle, profile: virt, toolchain: zig, sources: code}\n"
    )
    halpipe("run", "pipeline.yaml")
    assert open_bundle(str(tmp_path / "bundle")).facts["profile"] == "virt"
