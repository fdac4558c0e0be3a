"""AMALTHEA models of others: the WATERS 2019 challenge, one model in nine dialects, and what else there is."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from lxml import etree

from amalthea_metamodel import Metamodel
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.amalthea import FORMAT as OUT
from halpipe.exporters.amalthea import RELEASES, AmaltheaOptions
from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions, codes
from halpipe.importers.native import read_model, read_schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "amalthea"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real AMALTHEA models are not part of the project")
FILES = sorted(path.name for path in DATA.glob("*.amxmi"))
DEMOCARS = (
    "app4mc_democar_0.9.5.amxmi",
    "democar_topic3.amxmi",
    "democar_xver_071in.amxmi",
    "democar_xver_072in.amxmi",
    "democar_xver_072ref.amxmi",
    "democar_xver_080in.amxmi",
    "democar_xver_095in.amxmi",
    "dreamcloud_democar_old.amxmi",
)
WATERS = "waters2019_mobstr_original_1.0.0.amxmi"
# Files that hold parts of models, or tasks that nothing activates.
UNSCHEDULABLE = {
    "app4mc_democar_mapping_hw.amxmi": "no task",
    "app4mc_democar_split_common.amxmi": "no task",
    "app4mc_democar_split_hw.amxmi": "no task",
    "app4mc_democar_split_os.amxmi": "no task",
    "app4mc_democar_split_req.amxmi": "no task",
    "app4mc_democar_split_stimuli.amxmi": "no task",
    "app4mc_democar_split_sw.amxmi": "3 tasks, none of them with a period",
    "app4mc_ee_architecture.amxmi": "no task",
    "app4mc_hierarchical_scheduler.amxmi": "8 tasks, none of them with a period",
    "app4mc_partitioned_fpp.amxmi": "8 tasks, none of them with a period",
    "dreamcloud_hpc2_C.amxmi": "8 tasks, none of them with a period",
    "dreamcloud_vce.amxmi": "2 tasks, none of them with a period",
    "hw_migration_083in.amxmi": "no task",
    "modeconditions_093in.amxmi": "2 tasks, none of them with a period",
}


def read(*files, **options):
    return FORMAT.read([str(DATA / file) for file in files], AmaltheaImportOptions(**options))


# ---------------------------------------------------------------------------------------------- WATERS


@pytest.fixture(scope="module")
def waters():
    return read(WATERS, mapping="free").model


# Ticks over 2 GHz (A57, Denver) and 1.5 GHz (GPU): the upper bounds in the file, worked out by hand; of a task that
# offloads, pre- and post-processing together, as published.
EXECUTION_TIMES = {
    "Lidar_Grabber": {"A57": "13.66ms", "Denver": "10.868ms"},
    "CANbus_polling": {"A57": "0.59968ms", "Denver": "0.599872ms"},
    "EKF": {"A57": "4.75967ms", "Denver": "4.4294795ms"},
    "Planner": {"A57": "13.241911ms", "Denver": "12.4367645ms"},
    "DASM": {"A57": "1.859995ms", "Denver": "1.299998ms"},
    "OS_Overhead": {"A57": "50ms", "Denver": "50ms"},
    "PRE_SFM_gpu_POST": {"A57": "7.903355ms", "Denver": "6.709829ms"},
    "PRE_Localization_gpu_POST": {"A57": "17.6393525ms", "Denver": "14.515741ms"},
    "PRE_Lane_detection_gpu_POST": {"A57": "8.2328005ms", "Denver": "7.6254315ms"},
    "PRE_Detection_gpu_POST": {"A57": "4.71206ms", "Denver": "4.087763ms"},
    "SFM": {"A57": "29.5015ms", "Denver": "27.81169ms", "GPU_def": "7.9ms"},
    "Localization": {"A57": "387.4196775ms", "Denver": "294.807871ms", "GPU_def": "124ms"},
    "Lane_detection": {"A57": "51.04456ms", "Denver": "42.237824ms", "GPU_def": "82/3ms"},
    "Detection": {"GPU_def": "116ms"},
}


@pytest.mark.parametrize("name", EXECUTION_TIMES)
def test_waters_execution_times(waters, name):
    found = Counter()
    for task in waters.tasks:
        if task.name in (name, f"{name}.2"):
            for version in task.versions:
                found[version.name] += version.wcet.fraction
    expected = {kind: Duration.parse(text).fraction for kind, text in EXECUTION_TIMES[name].items()}
    assert found == expected


def test_waters_tasks_that_offload_are_three_in_a_row(waters):
    chains = {chain.name: chain for chain in waters.chains}
    assert chains["PRE_SFM_gpu_POST.response"].tasks == ("PRE_SFM_gpu_POST", "SFM", "PRE_SFM_gpu_POST.2")
    assert {p.task for p in waters.task("SFM").versions[0].precedences} == {"PRE_SFM_gpu_POST"}
    assert {p.task for p in waters.task("PRE_SFM_gpu_POST.2").versions[0].precedences} == {"PRE_SFM_gpu_POST", "SFM"}
    assert len(waters.tasks) == 10 + 4 + 4
    assert waters.task("Detection").period == Duration.parse("200ms")


@pytest.mark.parametrize(
    ("task", "version", "total"),
    [  # bytes over lines of 64 bytes, 40 cycles (A57) or 16 (Denver) each, at 2 GHz
        ("Lidar_Grabber", "A57", "1.09378ms"),
        ("Lidar_Grabber", "Denver", "437.512us"),
        ("Planner", "Denver", "160.312us"),
        ("PRE_Lane_detection_gpu_POST", "A57", "1.25ms"),
        ("PRE_SFM_gpu_POST", "Denver", "500us"),
    ],
)
def test_waters_memory_phases(waters, task, version, total):
    accesses = waters.task(task).version(version).accesses
    assert sum((a.end - a.start).fraction for a in accesses) == Duration.parse(total).fraction


def test_waters_shares_of_the_memory(waters):
    bounds = {v.name: {a.bound for a in v.accesses} for v in waters.task("SFM").versions}
    assert bounds == {"A57": {Fraction(2, 15)}, "Denver": {Fraction(1, 3)}, "GPU_def": {Fraction(5, 6)}}
    assert [(r.name, r.bandwidth) for r in waters.resources] == [("SYSTEM_DRAM", 24 * 10**9)]


def test_waters_mapping_is_followed_where_it_does_not_contradict_itself():
    imported = read(WATERS)
    units = {task.name: {v.name: v.units for v in task.versions} for task in imported.model.tasks}
    assert units["Planner"] == {"A57": ("Core3",)}
    assert units["PRE_SFM_gpu_POST.2"] == {"Denver": ("Core0", "Core1")}
    assert units["Detection"] == {"GPU_def": ("GP10B",)}
    contradicting = {d.path for d in imported.diagnostics if d.code == codes.AFFINITY.id}
    assert contradicting == {'Task "CANbus_polling"', 'Task "OS_Overhead"', 'Task "DASM"'}
    assert units["DASM"] == {"A57": ("Core2", "Core3", "Core4", "Core5")}


def test_waters_accesses_can_be_added_to_the_stated_times():
    task = read(WATERS, mapping="free", memory="added").model.task("Lidar_Grabber")
    assert task.version("A57").wcet == Duration.parse("13.66ms") + Duration.parse("1.09378ms")
    plain = read(WATERS, mapping="free", memory="none").model
    assert plain.resources == ()


# --------------------------------------------------------------------------------------------- dialects


def comparable(model):
    """The model without the names that dialects spell differently, and without places."""
    tasks = tuple(
        replace(t, origin=None, versions=tuple(replace(v, name="v", origin=None) for v in t.versions))
        for t in model.tasks
    )
    modes = tuple(replace(m, runs=tuple(replace(r, versions=("v",)) for r in m.runs)) for m in model.modes)
    units = tuple(replace(u, type="", origin=None) for u in model.units)
    return replace(model, name="democar", origin=None, tasks=tasks, modes=modes, units=units)


@pytest.mark.parametrize("file", DEMOCARS[1:])
def test_every_dialect_gives_the_same_democar(file):
    assert comparable(read(file).model) == comparable(read(DEMOCARS[0]).model)


def test_a_split_democar_is_the_same_too():
    parts = sorted(path.name for path in DATA.glob("app4mc_democar_split_*.amxmi"))
    assert comparable(read(*parts).model) == comparable(read(DEMOCARS[0]).model)


def test_the_democar_is_what_its_file_says():
    model = read(DEMOCARS[0]).model
    task = model.task("Task_20MS")  # one runnable, 88000 ticks at 200 MHz
    assert (task.period, task.offset, task.deadline) == tuple(map(Duration.parse, ("20ms", "0ms", "20ms")))
    assert [v.wcet for v in task.versions] == [Duration.parse("440us")]


# --------------------------------------------------------------------------------------------- all files


@pytest.mark.parametrize("file", FILES)
def test_every_file_gives_a_model_or_says_why_not(file):
    if file in UNSCHEDULABLE:
        with pytest.raises(HalpipeError) as refused:
            read(file)
        assert [d.message for d in refused.value.diagnostics if d.is_error] == [f"the model has {UNSCHEDULABLE[file]}"]
        return
    imported = read(file)
    assert imported.model.tasks
    total = sum(1 for e in etree.parse(DATA / file).iter("{*}*"))
    counted = sum(read for kind, read, _, _ in imported.coverage.rows())
    assert 0 < counted <= total
    assert all(element.reason for element in imported.coverage.ignored_elements)


def test_labels_that_nothing_writes_are_modes_and_others_are_data():
    assert [mode.name for mode in read("app4mc_numericmodes.amxmi").model.modes] == ["ModeA", "ModeB"]
    assert len(read("app4mc_feedback_loop_3.amxmi").model.modes) == 1
    assert len(read("app4mc_state_machine_2.amxmi").model.modes) == 1


def test_timed_accesses_of_toro_are_logical_execution_times():
    tasks = read("toro_example.amxmi").model.tasks
    assert {t.name: str(t.let) for t in tasks if t.let is not None} == {
        "LET_T7": "4ms",
        "LET_T8": "5ms",
        "LET_T9": "8ms",
        "LET_T12": "8ms",
        "LET_T13": "3ms",
    }


def test_chains_and_ages_of_toro():
    chains = {chain.name: chain for chain in read("toro_example.amxmi").model.chains}
    assert chains["chain3_let"].tasks == ("LET_T7", "LET_T8", "LET_T9")
    whole = chains.pop("ProcessChain1")
    assert (str(whole.max_latency), str(whole.anchor)) == ("150ms", "release")
    assert {name: str(chain.max_age) for name, chain in chains.items()} == {
        "chain1_bet": "45ms",
        "chain2_bet": "25ms",
        "chain3_let": "25ms",
        "chain4_mixed": "50ms",
    }


@pytest.mark.slow  # 8349 jobs, seventy tables; what an import keeps of the requirements is tested above
def test_the_requirements_on_offloaded_data_are_met():
    """Units are left free, and the planner has 15 ms: its shortest time is longer than the published 12 ms."""
    owner = read("waters2019_mobstr_mapped_1.0.0.amxmi", mapping="free").model
    tasks = [replace(t, deadline=t.period) if t.name == "Planner" else t for t in owner.tasks]
    owner = replace(owner, tasks=tuple(tasks))
    found = schedule_model(owner, SearchOptions(), lambda *_: True)
    limits = {chain.name: chain.max_age for chain in owner.chains}
    ages = {latency.name: latency.age for latency in found.schedule.modes[0].chains}
    assert found.is_complete
    assert [d for d in verify(owner, found.schedule) if d.is_error] == []
    assert len(limits) == 4
    assert all(ages[name] <= limit for name, limit in limits.items())


# ---------------------------------------------------------------------------------------------- export


def bare(model):
    """The model without places, which an import gives anew."""
    plain = {"origin": None}
    tasks = tuple(
        replace(
            t,
            origin=None,
            versions=tuple(
                replace(v, origin=None, precedences=tuple(replace(p, origin=None) for p in v.precedences))
                for v in t.versions
            ),
        )
        for t in model.tasks
    )
    units, resources, chains, modes = (
        tuple(replace(element, **plain) for element in found)
        for found in (model.units, model.resources, model.chains, model.modes)
    )
    return replace(model, origin=None, tasks=tasks, units=units, resources=resources, chains=chains, modes=modes)


@pytest.mark.parametrize("file", [file for file in FILES if file not in UNSCHEDULABLE])
def test_an_imported_model_is_a_fixed_point_of_export_and_import(file, tmp_path):
    model = read(file).model
    (tmp_path / "again.amxmi").write_bytes(OUT.write(model, None, AmaltheaOptions())[""])
    again = FORMAT.read([str(tmp_path / "again.amxmi")], AmaltheaImportOptions()).model
    assert bare(again) == bare(model)


# The metamodels say what classes have which features; an export is held to them, element by element.


def metamodel(release):
    name = f"amalthea-{release}.ecore"
    path = DATA / name if (DATA / name).exists() else DATA / "ecore" / name
    return Metamodel(path)


def conformity(data, release):
    root = etree.fromstring(data)
    ids = {}
    for element in root.iter("{*}*"):
        id = element.get("{http://www.omg.org/XMI}id")
        if id is not None:
            assert id not in ids
            ids[id] = id.rpartition("=")[2]
    return list(metamodel(release).violations(root, "Amalthea", ids))


@pytest.mark.parametrize("release", RELEASES)
def test_an_export_conforms_to_the_metamodel_of_its_release(release):
    fixtures = Path(__file__).parents[1] / "unit" / "importers" / "native_fixtures"
    model = read_model(str(fixtures / "everything.model.xml"))
    assert conformity(OUT.write(model, None, AmaltheaOptions(release=release))[""], release) == []


@pytest.mark.parametrize("release", ["1.2.0", "3.3.0"])
def test_an_export_with_a_schedule_conforms_too(release):
    example = Path(__file__).parents[2] / "examples" / "roboracer" / "out"
    if not (example / "schedule.xml").exists():
        pytest.skip("the example was not built")
    model, schedule = read_model(str(example / "model.xml")), read_schedule(str(example / "schedule.xml"))
    assert conformity(OUT.write(model, schedule, AmaltheaOptions(release=release))[""], release) == []


def test_the_check_of_conformity_finds_faults():
    fixtures = Path(__file__).parents[1] / "unit" / "importers" / "native_fixtures"
    data = OUT.write(read_model(str(fixtures / "everything.model.xml")), None, AmaltheaOptions())[""]
    for old, new in (
        (b'unit="GHz"', b'unit="THz"'),
        (b"<recurrence", b"<rhythm"),
        (b'type="am:Ticks"', b'type="am:Task"'),
    ):
        assert old in data
        broken = (
            data.replace(old, new).replace(b"</recurrence", b"</rhythm") if b"rhythm" in new else data.replace(old, new)
        )
        assert conformity(broken, RELEASES[-1]) != []
