"""Projects against what their vendor's generated RTE calls: call for call, in order, none doubled, none invented."""

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.arxml.system.reading import read_system, read_tree
from halpipe.importers.arxml.tasks.activation import find_activations, group
from halpipe.importers.arxml.tasks.calls import join_calls
from halpipe.importers.arxml.tasks.dataflow import find_dataflow
from halpipe.importers.arxml.tasks.periods import decide_periods

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
PROJECTS = SHARED / "arxml_projects"
TC275 = SHARED / "arxml" / "sys_vector_tc275_3core"
pytestmark = pytest.mark.skipif(not PROJECTS.is_dir(), reason="real ARXML projects are not part of the project")

INPUTS = {
    "tc275": [TC275],
    "tc275 with its flat map": [TC275, PROJECTS / "tc275_flat"],
    "tc275 by its flat map alone": [*sorted(TC275.glob("[!F]*.arxml")), PROJECTS / "tc275_flat"],
    "tc275 without flat extract": sorted(TC275.glob("[!F]*.arxml")),
    **{name: [PROJECTS / name] for name in ("vtt_S1", "vtt_S2", "vtt_S3")},
}


def oracle(name):
    return json.loads((PROJECTS / "rte_oracles" / f"{name.split()[0]}.json").read_text())["tasks"]


def cycle(call):
    """The cycle of a call in milliseconds, None for one that an API call triggers or that runs once."""
    return (
        next((w["cycle_ms"] for w in call["when"] if w["cycle_ms"]), None) if isinstance(call["when"], list) else None
    )


def drafts_of(name):
    findings = Findings()
    tree = read_tree([str(path) for path in INPUTS[name]], findings)
    system = read_system(tree)
    activations = find_activations(system, findings)
    decided = decide_periods(system, activations, find_dataflow(system), tree, None)
    return group(join_calls(decided, findings), "runnable"), findings


@pytest.mark.parametrize("name", INPUTS)
def test_every_periodic_call_is_a_task_and_every_task_of_an_os_task_is_one(name):
    drafts, _ = drafts_of(name)
    hosted = {}
    for draft in sorted((d for d in drafts if d.os_task), key=lambda d: d.position):
        call = (draft.members[0].runnable.symbol, draft.period.in_unit("ms"))
        hosted.setdefault(draft.os_task.place.name, []).append(call)
    expected = {
        task: [(call["function"], cycle(call)) for call in content["calls"] if cycle(call)]
        for task, content in oracle(name).items()
    }
    assert hosted == {task: calls for task, calls in expected.items() if calls}
    assert len(drafts) == sum(map(len, expected.values()))


@pytest.mark.parametrize("name", INPUTS)
def test_neighbours_in_an_os_task_are_ordered_also_between_cycles(name):
    drafts, _ = drafts_of(name)
    model = FORMAT.read([str(path) for path in INPUTS[name]], ArxmlImportOptions()).model
    orders = {(p.task, task.name) for task in model.tasks for p in task.versions[0].precedences}
    hosted = {}
    for draft in sorted((d for d in drafts if d.os_task), key=lambda d: d.position):
        hosted.setdefault(draft.os_task.place.name, []).append(draft.name)
    for names in hosted.values():
        assert orders.issuperset(pairwise(names))
    position = {name: (task, index) for task, names in hosted.items() for index, name in enumerate(names)}
    assert all(position[first] < position[second] for first, second in orders if {first, second} <= position.keys())


@pytest.mark.parametrize("name", INPUTS)
def test_calls_without_a_cycle_are_accounted_for(name):
    imported = FORMAT.read([str(path) for path in INPUTS[name]], ArxmlImportOptions())
    told = " ".join(d.message for d in imported.diagnostics)
    expected = Counter(
        call["function"] for content in oracle(name).values() for call in content["calls"] if not cycle(call)
    )
    reasons = [e for e in imported.coverage.ignored_elements if e.kind == "RUNNABLE-ENTITY"]
    for function in expected:
        assert any(e.name.endswith(function) and "started by" in e.reason for e in reasons), function
    assert ("DATA-RECEIVED-EVENT make no task" in told) == (not name.startswith("tc275"))


def test_bsw_events_that_no_os_task_calls_are_named():
    found = FORMAT.read([str(TC275)], ArxmlImportOptions()).diagnostics
    (told,) = [diagnostic for diagnostic in found if diagnostic.code == "HAL0571"]
    assert "BSW/Can/Can_MainFunction_BusOff" in told.message
    assert "BSW/Rte/Rte_ComSendSignalProxyPeriodic" in told.message


def test_calls_of_another_generator_are_found_and_the_rest_is_accounted_for():
    hello = SHARED / "arxml" / "sys_arccore_helloworld"
    calls = json.loads((PROJECTS / "rte_oracles" / "arccore_helloworld.json").read_text())["tasks"]["OsRteTask"][
        "calls"
    ]
    imported = FORMAT.read([str(hello)], ArxmlImportOptions())
    periods = {task.name: task.period.in_unit("ms") for task in imported.model.tasks if "/" in task.name}
    assert periods == {f"{c['component']}/{c['function']}": c["cycle_ms"] for c in calls if c["cycle_ms"]}
    told = " ".join(d.message for d in imported.diagnostics if d.code == "HAL0530")
    assert "5 SWC-MODE-SWITCH-EVENT" in told
    assert "1 DATA-RECEIVED-EVENT" in told
    assert sum(not c["cycle_ms"] for c in calls) == 6
    unordered = [d.message for d in imported.diagnostics if d.code == "HAL0574"]
    assert any("SwcReader/SwcReaderRunnable, SwcWriter/SwcWriterRunnable" in message for message in unordered)
