"""The five tables of the demo on every back-end: those that can serve them pass their checks, others say why not."""

from pathlib import Path

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import ARITHMETIC, DEPLOYMENT
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import CYCLES
from halpipe.deploy.regulator.stimuli import TRAFFIC, plan
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.exporters.regulator.codes import RATE_DOES_NOT_FIT
from halpipe.flow.formats import burst_grid
from halpipe.importers.native import read_model
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions

EXAMPLES = Path(__file__).parents[4] / "examples"
DEMO, GRID = EXAMPLES / "roboracer/model.xml", EXAMPLES / "platforms/cores-table.yaml"
PLATFORM = """halpipe-regulator: 1
resource: main-memory
clock: 100MHz
bus: 512bit
burst: 64B
window: {window}
guaranteed: 400MB/s
capacity: {capacity}
units:
  core1: {{manager: 0, port: afifm2, core: 0, group: core1}}
  core2: {{manager: 1, port: afifm3, core: 1, group: core2}}
  core3: {{manager: 2, port: afifm4, core: 2, group: core3}}
  core4: {{manager: 3, port: afifm5, core: 3, group: core4}}
{settings}
"""
SERVING = {
    "table": ("440MB/s", ""),
    "axi-realm": ("600MB/s", "axi-realm: {pending: 1}"),
    "qos400": ("600MB/s", "qos400: {clock: 200MHz, granularity: phase}"),
    "resctrl": ("1600MB/s", "resctrl: {kind: mpam, width: 6}"),
    "memguard": ("6000MB/s", "memguard: {cores: 4, granularity: phase}"),
}
REFUSING = {
    "qos400": ("1600MB/s", "qos400: {clock: 200MHz}", "granularity: phase"),
    "resctrl": ("1600MB/s", "resctrl: {others: 1 2}", "finer steps"),
    "memguard": ("2000MB/s", "memguard: {cores: 4}", "granularity: phase"),
}


@pytest.fixture(scope="module")
def demo():
    model = read_model(str(DEMO))
    found = schedule_model(model, SearchOptions(grid=burst_grid(str(GRID))), lambda *progress: True)
    assert found.schedule is not None
    return model, found.schedule


def exported(demo, folder, backend, capacity, settings):
    path = folder / "platform.yaml"
    window = 100_000 if backend == "memguard" else 1000
    path.write_text(PLATFORM.format(window=window, capacity=capacity, settings=settings))
    return RegulatorExporter().write(*demo, RegulatorOptions(platform=str(path), backend=backend))


@pytest.mark.parametrize("backend", SERVING)
def test_all_five_tables_grant_what_is_promised(demo, tmp_path, backend):
    files = exported(demo, tmp_path, backend, *SERVING[backend])
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine=ARITHMETIC))
    assert [d.message for d in checked.diagnostics if d.is_error] == []
    assert any("5 tables of 4 units" in line for line in checked.lines)
    executed = [line for line in checked.lines if line.startswith(f"device: {backend} grants what is promised")]
    assert len(executed) == (backend != "table")  # its Verilog is simulated


@pytest.mark.parametrize("backend", REFUSING)
def test_one_rate_for_a_mode_of_the_demo_is_too_much_and_refused_with_the_figures(demo, tmp_path, backend):
    capacity, settings, cure = REFUSING[backend]
    with pytest.raises(HalpipeError) as refused:
        exported(demo, tmp_path, backend, capacity, settings)
    errors = [d for d in refused.value.diagnostics if d.is_error]
    assert {d.code for d in errors} == {RATE_DOES_NOT_FIT.id}
    assert all("MB/s, there is room for" in d.message and "core1" in d.message for d in errors)
    assert any(cure in d.help for d in errors)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_greedy_run_plays_all_tables_and_switches_of_the_demo_by_default(demo, tmp_path, seed):
    files = exported(demo, tmp_path, "table", *SERVING["table"])
    tables = read_tables(bundles.target(files).bundle)
    limit = CYCLES["verilator"][0] // len(tables.units) // tables.platform.window_cycles
    run = plan(tables, TRAFFIC[0], seed, windows=limit)
    assert {e.table for e in run.expected if e.window + 1 == tables.tables[e.table].windows} == set(range(5))
    ended = zip(run.expected, run.expected[1:], strict=False)
    seen = {(a.table, b.table) for a, b in ended if a.running and b.running and a.table != b.table}
    modes = {table.mode: table.index for table in tables.tables if not table.is_transition}
    assert seen >= {(modes[switch.source], switch.request) for switch in tables.switches}
    assert len(run.expected) < limit
