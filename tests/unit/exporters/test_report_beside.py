"""What a report draws under its jobs: the worst cycle of a trace, or another schedule, each difference marked."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from exporter_samples import roboracer

import halpipe
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.native import format_schedule
from halpipe.exporters.report import ReportOptions
from halpipe.exporters.report.beside import MARKS
from halpipe.flow import beside
from halpipe.flow.formats import export_with_remarks
from halpipe.models.trace import NONE
from support import job as placed
from support import mode, model, ms, task, version

CYCLE = 25_000_000
ZERO = 1000


def sample():
    """A schedule that verifies: the figures of the sample are made up."""
    system, planned = roboracer()
    (table,) = planned.modes
    return system, replace(planned, modes=(replace(table, cost=None),))


@pytest.fixture
def run(tmp_path):
    """Draw a run of four cycles of the sample, of which `change` makes a row other rows."""
    system, planned = sample()

    def draw(change=lambda cycle, task, start, end, unit: [(task, start, end, unit)], **options):
        rows = ["task,start,end,units"]
        for cycle in range(4):
            for job in planned.modes[0].jobs:
                times = [int(at.ns) + cycle * CYCLE + ZERO for at in (job.start, job.end)]
                rows += [",".join(map(str, row)) for row in change(cycle, job.task, *times, *job.units)]
        file = tmp_path / "run.csv"
        file.write_text("\n".join(rows) + "\n")
        options = ReportOptions(**{"trace": str(file), "origin": Duration(ZERO)} | options)
        return drawn(system, planned, options)

    return draw


def drawn(system, planned, options):
    """Return the page, the remarks, and task, mark, start and length in ms of each box of the lower rows."""
    made = export_with_remarks("report", system, planned, options)
    page = made.contents[""].decode()
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])
    boxes = [
        (scene["tasks"][row[3]]["name"], row[4], row[1], row[2] - row[1])
        for table in scene["modes"] + scene["switches"]
        for row in table["strip"]["boxes"]
    ]
    for table in scene["modes"] + scene["switches"]:
        marks = [row[4] for row in table["strip"]["boxes"]]
        assert marks == sorted(marks, key=MARKS.index)
    return page, [d.code for d in made.remarks], boxes


def test_a_faithful_run_lies_under_its_jobs(run):
    page, remarks, boxes = run()
    assert {mark for _, mark, _, _ in boxes} == {""}
    assert remarks == []
    assert ("opponent_detection", "", -1.0, 13.0) in boxes  # of the job that began in the cycle before
    assert ("path_planner", "", 12.0, 24.0) in boxes
    assert "Nothing deviates." in page
    assert "Cycle 1, the one of 4 " in page


def test_the_cycle_with_the_most_deviations_is_drawn_with_marks(run):
    def change(cycle, task, start, end, unit):
        rows = [(task, start, end, unit)]
        if cycle == 2 and task == "particle_filter":
            rows = [
                (task, start + 500_000, end + 500_000, unit),
                (task, start + 10_000_000, start + 11_000_000, "core4"),
            ]
        elif cycle == 2 and task == "pure_pursuit":
            rows = [(task, start, end + 1_000_000, unit)]
        elif cycle == 2 and task == "path_planner":
            rows = []
        elif cycle == 1 and task == "pure_pursuit":
            rows = [(task, start + 1, end + 1, unit)]
        return rows

    page, remarks, boxes = run(change)
    marked = [box for box in boxes if box[1]]
    assert ("particle_filter", "off", 0.5, 24.0) in marked
    assert ("particle_filter", "delay", 0.0, 0.5) in marked
    assert ("pure_pursuit", "off", 11.0, 3.0) in marked
    assert ("pure_pursuit", "over", 13.0, 1.0) in marked
    assert ("path_planner", "missing", 12.0, 24.0) in marked
    assert [box[0] for box in marked if box[1] == "extra"] == ["particle_filter"]
    assert len(marked) == 6
    assert remarks == ["HAL1475"]
    assert "Cycle 2, the one of 4 with the most deviations, from 50.001ms of the trace on" in page
    assert "runs for 3ms, 1ms more than the 2ms" in page


def test_the_tolerance_is_that_of_compare(run):
    def change(cycle, task, start, end, unit):
        return [(task, start + 500, end + 500, unit)]

    assert {box[1] for box in run(change, tolerance=Duration(500))[2]} == {""}
    assert "delay" in {box[1] for box in run(change, tolerance=Duration(499))[2]}


def test_another_schedule_lies_under_this_one(tmp_path):
    system, planned = sample()
    (table,) = planned.modes
    moved = [replace(j, start=ms(13), end=ms(15)) if j.task == "pure_pursuit" else j for j in table.jobs]
    moved = tuple(replace(j, units=("core4",)) if j.task == "particle_filter" else j for j in moved)
    other = replace(planned, modes=(replace(table, jobs=moved),))
    file = tmp_path / "other.xml"
    file.write_bytes(format_schedule(other))
    page, remarks, boxes = drawn(system, planned, ReportOptions(against=str(file)))
    assert [box for box in boxes if box[1]] == [
        ("particle_filter", "off", 0.0, 24.0),
        ("pure_pursuit", "off", 13.0, 2.0),
    ]
    assert "starts 2ms later" in page
    assert "runs on core4 instead of core1" in page
    assert remarks == ["HAL1475"]
    without = replace(table, jobs=tuple(j for j in table.jobs if j.task != "pure_pursuit"))
    file.write_bytes(format_schedule(replace(planned, modes=(without,))))
    assert ("pure_pursuit", "missing", 11.0, 2.0) in drawn(system, planned, ReportOptions(against=str(file)))[2]


def test_what_does_not_match_is_refused(run, tmp_path):
    with pytest.raises(HalpipeError) as refused:
        run(lambda cycle, task, start, end, unit: [("other", start, end, unit)])
    assert [d.code for d in refused.value.diagnostics] == ["HAL1476"]
    system, planned = sample()
    (table,) = planned.modes
    file = tmp_path / "other.xml"
    for other in (
        replace(planned, model="another"),
        replace(planned, modes=(replace(table, name="limp"),)),
        replace(planned, modes=(replace(table, hyperperiod=ms(50)),)),
        replace(planned, modes=(replace(table, jobs=(replace(table.jobs[0], task="ghost"),)),)),
        replace(planned, modes=(replace(table, jobs=(replace(table.jobs[0], units=("ghost",)),)),)),
    ):
        file.write_bytes(format_schedule(other))
        with pytest.raises(HalpipeError) as refused:
            drawn(system, planned, ReportOptions(against=str(file)))
        assert [d.code for d in refused.value.diagnostics] == ["HAL1476"]


@pytest.mark.parametrize(
    "options", [{"against": "other.xml"}, {"trace": "", "tolerance": Duration(1)}, {"trace": ""}], ids=str
)
def test_an_option_without_effect_is_refused(run, options):
    with pytest.raises(HalpipeError) as refused:
        run(**options)
    assert {d.code for d in refused.value.diagnostics} == {"HAL0025"}


def test_a_switch_of_length_zero_has_the_cycles_around_it(tmp_path):
    a, b = task("a", 10, version("v", 2)), task("b", 20, version("v", 3))
    modes = [mode("fast", (a,)), mode("slow", (a, b))]
    system = model(a, b, modes=modes, transitions=[("fast", "slow", None), ("slow", "fast", None)])
    planned = halpipe.schedule(system)
    assert [table.length for table in planned.transitions] == [ms(0), ms(0)]
    rows = ["task,start,end,mode,cycle"]
    now = 0
    for cycle, name in enumerate(("fast", "slow", "slow")):
        table = planned.mode(name)
        for job in table.jobs:
            late = 1_000_000 * (job.task == "b" and cycle == 1)
            rows.append(f"{job.task},{now + late + job.start.ns},{now + late + job.end.ns},{name},{cycle}")
        now += int(table.hyperperiod.ns)
    file = tmp_path / "run.csv"
    file.write_text("\n".join(rows) + "\n")
    page, _, boxes = drawn(system, planned, ReportOptions(trace=str(file), origin=Duration(0)))
    assert len([box for box in boxes if box[1] == "delay"]) == 2  # in the mode, and after the switch to it
    assert "Cycle 1, from 10ms of the trace on" in page
    assert page[: page.index("</main>")].count("The trace has no cycle of this table.") == 1  # the switch back


@pytest.mark.parametrize(
    ("start", "end", "shows"),
    [(0, 9, False), (0, 10, False), (0, 11, True), (10, 10, True), (19, 30, True), (20, 30, False), (5, NONE, True)],
)
def test_what_overlaps_a_window_or_begins_in_it_is_drawn(start, end, shows):
    """The window lies from 10 to 20; a job of no length belongs to the window that it begins."""
    assert beside._Cycle._shows(SimpleNamespace(low=10, high=20), start, end) == shows


def test_titles_name_job_and_span():
    assert beside._title("a", 0, ms(2), ms(5), ["x", "y"]) == "a #0\n2ms – 5ms (3ms)\nx\ny"
    assert beside._title("a", None, ms(0), ms(5), []) == "a\n0ms – 5ms (5ms)"


def test_each_difference_of_a_job_has_its_words():
    system = model(task("a", 10, version("v", 2, "u1 u2"), version("w", 2)), units="u1 u2")
    own = placed(system, "a", 0, 4, "u1", "v")
    assert beside._difference(own, own) == []
    assert beside._difference(None, own) == ["the schedule does not have it"]
    assert beside._difference(own, None) == ["the other schedule does not have it"]
    early = replace(own, start=ms(3), end=ms(5), units=("u2",), version="w")
    words = ["starts 1ms earlier", "runs on u2 instead of u1", "is version w instead of v"]
    assert beside._difference(own, early) == words
    assert beside._difference(early, own)[0] == "starts 1ms later"
    assert beside._difference(own, replace(own, end=ms(7))) == ["runs for another time, or in other parts"]


def test_another_schedule_may_have_one_of_several_modes_and_one_is_chosen():
    a = task("a", 10, version("v", 2))
    system = model(a, modes=[mode("m", (a,)), mode("n", (a,))])
    planned = halpipe.schedule(system)
    fewer = planned.alone((planned.mode("n"),))
    assert list(beside.against(system, planned, fewer, "o.xml").strips) == ["n"]
    more = replace(planned, modes=(*planned.modes, replace(planned.modes[0], name="o")))
    assert list(beside.against(system, planned, more, "o.xml", "m").strips) == ["m"]
    assert set(beside.against(system, planned, more, "o.xml").strips) >= {"m", "n"}
