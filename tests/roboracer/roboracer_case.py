"""The RoboRacer example as tests need it: where it is, and a schedule found by hand."""

from pathlib import Path

from halpipe.models import Job, ModeSchedule, Schedule, Status, TransitionTable
from halpipe.pipeline.health import with_reactions
from support import ms

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "roboracer"
FIXTURES = ROOT / "tests" / "fixtures" / "roboracer"

# As in tests/unit/importers/test_overlay_roboracer.py: phases of the tasks in the period of 25 ms, and their units.
BY_HAND = {
    "/particle_filter": ("0ms", "core1"),
    "/opponent_detection": ("1ms", "core2"),
    "/local_planner": ("14.5ms", "core3"),
    "/pure_pursuit": ("16ms", "core4"),
}
STOPPING = {**BY_HAND, "/pure_pursuit": ("9ms", "core4")}


def by_hand(model):
    """A valid schedule of all modes, in which every switch is immediate."""
    modes = tuple(_table(model, mode) for mode in model.modes)
    switches = tuple(
        TransitionTable(source=t.source, target=t.target, length=ms(0), worst_latency=ms(25), status=Status.VALID)
        for t in model.allowed_transitions()
    )
    found = Schedule(model=model.name, model_sha256=model.digest, modes=modes, transitions=switches)
    return with_reactions(model, found)


def _table(model, mode):
    places = STOPPING if mode.name == "safe-stop" else BY_HAND
    jobs = []
    for run in mode.runs:
        (start, unit), version = places[run.task], run.versions[0]
        end = ms(start) + model.task(run.task).version(version).wcet
        jobs.append(Job(task=run.task, index=0, start=ms(start), end=end, version=version, units=(unit,)))
    return ModeSchedule(name=mode.name, hyperperiod=ms(25), status=Status.VALID, jobs=tuple(jobs))
