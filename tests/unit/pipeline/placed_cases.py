"""What the tests of latencies, loads and costs share: placements of hand-made schedules, and the paper's stack."""

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.placement import Placement
from support import access, after, chain, job, model, task, version

CORES = "core1 core2 core3 core4"


def place(system, *jobs):
    return Placement.of(expand(system, system.modes[0]), jobs)


def roborace(reaction=None, age=None):
    """The paper's stack: 63 ms of work every 25 ms, pipelined over three hyperperiods."""
    load = access("memory", 0, 1)
    return model(
        task("particle_filter", 25, version("v", 24, CORES, load)),
        task("opponent_detection", 25, version("v", 13, CORES, load, after("particle_filter", 0, 2, "end"))),
        task("spliner", 25, version("v", 24, CORES, load, after("opponent_detection", 0, 2, "end"))),
        task("pure_pursuit", 25, version("v", 2, CORES, after("spliner", 0, 2, "end"))),
        units=CORES,
        resources="memory",
        chains=[chain("lidar", "particle_filter opponent_detection spliner pure_pursuit", reaction, age)],
    )


def roborace_jobs(system):
    """Each task starts where its predecessor ends, modulo 25 ms."""
    return [
        job(system, "particle_filter", 0, 0, "core1"),
        job(system, "opponent_detection", 0, 24, "core2"),
        job(system, "spliner", 0, 12, "core3"),  # 24 + 13 - 25
        job(system, "pure_pursuit", 0, 11, "core4"),  # 12 + 24 - 25
    ]
