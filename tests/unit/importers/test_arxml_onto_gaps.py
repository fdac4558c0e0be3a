"""Jobs with gaps on a project: priorities interrupt them, or the export says why they do not."""

from dataclasses import replace

import pytest
from arxml_case import (
    component,
    configuration,
    container,
    core,
    counter,
    every,
    execution_time,
    implementation,
    mapped,
    package,
    rte,
    write,
)

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml import codes
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.models import Part
from halpipe.pipeline.verify import verify
from support import job, ms, schedule


def project(folder, *, kind="FULL", events=(), low="1", high="2"):
    """Main runs One (1 ms) and Two (2 ms) every 20 ms, Quick its runnable of 1 ms every 10 ms, on one core."""
    pump = component("Pump", every("0.02", "A", "Pump/One"), every("0.02", "B", "Pump/Two"), runnables="One Two")
    fast = component("Fast", every("0.01", "C", "Fast/Run"), runnables="Run")
    times = [
        execution_time("ANALYZED", f"{path.replace('/', '')}Time", path, "WORST-CASE-EXECUTION-TIME", length)
        for path, length in (("Pump/One", 1000), ("Pump/Two", 2000), ("Fast/Run", 1000))
    ]
    used = [[("RteUsedOsEventRef", f"/E/Os/{event}")] if event else [] for event in (*events, "", "")]
    waits = [("OsTaskEventRef", f"/E/Os/{event}") for event in dict.fromkeys(events)]
    main, quick = ({"OsTaskPriority": number} if number else {} for number in (low, high))
    os = configuration(
        "Os",
        _task("Main", kind, main, waits),
        _task("Quick", "NON", quick),
        counter("0.001"),
        *(container("Os/OsEvent", event) for event in dict.fromkeys(events)),
        container(
            "Os/OsApplication",
            "App",
            refs=[
                ("OsAppTaskRef", "/E/Os/Main"),
                ("OsAppTaskRef", "/E/Os/Quick"),
                ("OsAppCounterRef", "/E/Os/Ticks"),
                ("OsApplicationCoreRef", "/E/EcuC/First"),
            ],
        ),
    )
    mappings = [
        mapped("Pump/B/A", "Main", "1", more=used[0]),
        mapped("Pump/B/B", "Main", "2", more=used[1]),
        mapped("Fast/B/C", "Quick", "1"),
    ]
    system = package("T", pump, fast, implementation(*times))
    return write(
        folder,
        system,
        package("E", os, configuration("Rte", rte(*mappings)), configuration("EcuC", core("First", "0"))),
    )


def _task(name, kind, params, refs=()):
    return container("Os/OsTask", name, params={"OsTaskSchedule": kind, **params}, refs=refs)


def put(path):
    """Main runs One at 0, is interrupted by Quick at 1 ms, and goes on with Two at 2 ms."""
    options = ArxmlImportOptions(granularity="ostask")
    model = import_model("arxml", [str(path)], options).model
    main = model.task("Main").version("default")
    if not main.split.is_allowed:  # an OsTask that is not preemptive has no split points unless the user states them
        versions = tuple(replace(v, split=replace(v.split, points=(ms(1),), max_gaps=1)) for v in (main,))
        model = replace(
            model, tasks=tuple(replace(t, versions=versions) if t.name == "Main" else t for t in model.tasks)
        )
    parts = tuple(
        Part(start=ms(a), end=ms(b), executed_from=ms(c), executed_to=ms(d))
        for a, b, c, d in ((0, 1, 0, 1), (2, 4, 1, 3))
    )
    split = replace(job(model, "Main", 0, 0, model.units[0].name), parts=parts, end=ms(4))
    quick = [job(model, "Quick", k, 1 + 10 * k, model.units[0].name) for k in range(2)]
    plan = schedule(model, 20, split, *quick, mode_name="default")
    assert [d.message for d in verify(model, plan) if d.is_error] == []
    return export_onto(model, plan, str(path.parent), ArxmlImportOptions())


def refused(path):
    with pytest.raises(HalpipeError) as failure:
        put(path)
    return [d for d in failure.value.diagnostics if d.is_error]


def points(onto):
    """What the expiry points of the table start, by their names."""
    table = "/E/Os/Halpipe_default_First/"
    found = {}
    for change in onto.changes:
        if change.path.startswith(table) and change.name in (
            "OsScheduleTableSetEventRef",
            "OsScheduleTableActivateTaskRef",
        ):
            found.setdefault(change.path.removeprefix(table).split("/")[0], []).append(change.new)
    return found


def test_a_preemptive_os_task_is_interrupted_by_those_above_it(tmp_path):
    onto = put(project(tmp_path))
    assert points(onto) == {"At_0": ["/E/Os/Main"], "At_1": ["/E/Os/Quick"], "At_11": ["/E/Os/Quick"]}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"kind": "NON"}, "/E/Os/Main is not preemptive"),
        ({"kind": "NON", "events": ("Same", "Same")}, "/E/Os/Main is not preemptive"),
        ({"low": "2"}, "/E/Os/Main has the priority 2, and /E/Os/Quick ("),
        ({"low": "3"}, "which starts in its gap, 2"),
        ({"high": ""}, "which starts in its gap, None"),
    ],
)
def test_gaps_that_nothing_plays_are_refused_with_both_places(tmp_path, wrong, said):
    (found,) = refused(project(tmp_path, **wrong))
    assert (found.code, found.path) == (codes.SPLIT_JOB.id, 'task "Main"')
    assert "job 0 has 2 parts" in found.message
    assert said in found.message
    assert found.at.line
