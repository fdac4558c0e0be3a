"""The example examples/roboracer: its two forms agree, and a schedule found by hand shows that it can be scheduled."""

from dataclasses import replace
from pathlib import Path

import pytest
from overlay_case import bare

from halpipe.core.files import parse_yaml, read_bytes
from halpipe.importers.native.model import read_model
from halpipe.importers.overlay import OverlayUse, read_overlays
from halpipe.importers.ros import FORMAT
from halpipe.importers.ros.options import RosImportOptions
from halpipe.models import Job, ModeSchedule, Schedule, Status, TransitionTable
from halpipe.pipeline.health import with_reactions
from halpipe.pipeline.verify import verify
from support import ms

EXAMPLE = Path(__file__).parents[3] / "examples" / "roboracer"

# Phases of the tasks in the period of 25 ms, and their units. By hand: detection starts at 26 ms, after the next scan's
# load phase; planning at 39.5 ms; steering at 66 ms, when the plan of 63.5 ms is there and the memory is free.
PHASES = {
    "race": {
        "/particle_filter": ("0ms", "core1"),
        "/opponent_detection": ("1ms", "core2"),
        "/local_planner": ("14.5ms", "core3"),
        "/pure_pursuit": ("16ms", "core4"),
    },
    "time-trial": {
        "/particle_filter": ("0ms", "core1"),
        "/local_planner": ("14.5ms", "core3"),
        "/pure_pursuit": ("16ms", "core4"),
    },
    "safe-stop": {"/particle_filter": ("0ms", "core1"), "/pure_pursuit": ("9ms", "core4")},
}


@pytest.fixture(scope="module")
def written():
    return read_model(str(EXAMPLE / "model.xml"))


def table(system, mode):
    jobs = []
    for run in mode.runs:
        start, unit = PHASES[mode.name][run.task]
        version = system.task(run.task).version(run.versions[0])
        begin = ms(start)
        jobs.append(
            Job(
                task=run.task,
                index=0,
                start=begin,
                end=begin + version.wcet,
                version=version.name,
                units=(unit,),
            )
        )
    return ModeSchedule(name=mode.name, hyperperiod=ms(25), status=Status.VALID, jobs=tuple(jobs))


def by_hand(system):
    switches = (
        TransitionTable(source=t.source, target=t.target, length=ms(0), worst_latency=ms(25), status=Status.VALID)
        for t in system.allowed_transitions()
    )
    modes = tuple(table(system, mode) for mode in system.modes)
    found = Schedule(model=system.name, model_sha256=system.digest, modes=modes, transitions=tuple(switches))
    return with_reactions(system, found)


def errors(system, schedule):
    return [d for d in verify(system, schedule) if d.is_error]


def test_the_graph_with_its_overlay_is_the_model_written_by_hand(written):
    use = OverlayUse(read_overlays([str(EXAMPLE / "overlay.yaml")]))
    graph = FORMAT.read([str(EXAMPLE / "graph" / "architecture.yaml")], RosImportOptions(overlay=use))
    imported, diagnostics = use.apply(graph.model, graph.coverage)
    assert [d for d in diagnostics if d.is_error] == []
    assert bare(imported) == bare(written)


def test_the_schedule_found_by_hand_is_valid_in_every_mode_and_switches_at_once(written):
    assert errors(written, by_hand(written)) == []


def test_the_windows_are_tight_a_detection_before_the_next_scan_does_not_fit(written):
    by = by_hand(written)
    race = by.modes[0]
    jobs = tuple(
        replace(job, start=ms(24), end=ms(37)) if job.task == "/opponent_detection" else job for job in race.jobs
    )
    moved = replace(by, modes=(replace(race, jobs=jobs), *by.modes[1:]))
    assert errors(written, moved) != []


def test_the_tasks_need_more_than_one_period_and_more_than_two_cores(written):
    race = [written.task(run.task).version(run.versions[0]).wcet for run in written.mode("race").runs]
    assert race == [ms(24), ms(13), ms(24), ms(2)]
    assert sum(wcet.ns for wcet in race) > 2 * ms(25).ns


def test_the_pipeline_file_names_files_of_the_example():
    document = parse_yaml(read_bytes(EXAMPLE / "pipeline.yaml"), "pipeline.yaml")
    assert document["halpipe-pipeline"] == "1"
    for name in [*document["import"]["inputs"], *document["import"]["overlay"]]:
        assert (EXAMPLE / name).is_file()
