"""Models with hand-made schedules that the exporters are tried on."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from halpipe.importers.native import read_model, read_schedule
from halpipe.models import (
    ChainLatency,
    CostTerms,
    Job,
    ModeSchedule,
    ResourceLoad,
    Run,
    Schedule,
    Status,
    TransitionTable,
    UnitLoad,
)
from support import access, after, chain, job, mode, model, ms, schedule, task, version

CORES = "core1 core2 core3 core4"
MEMORY = "main-memory"


def load(end, bound=1):
    return access(MEMORY, 0, end, bound, "load")


PARTICLE_FILTER = task(
    "particle_filter",
    25,
    version(
        "full",
        "24ms",
        CORES,
        load(1),
        access(MEMORY, 1, "1.5ms", "0.5", "read"),
        access(MEMORY, "23.5ms", 24, "0.35", "write"),
    ),
    version("reduced", "9ms", CORES, load(1)),
)
OPPONENT_DETECTION = task(
    "opponent_detection", 25, version("full", "13ms", CORES, load(1), after("particle_filter", 0, 2, "end"))
)
PATH_PLANNER = task(
    "path_planner",
    25,
    version("full", "24ms", CORES, load(1, "1/2"), after("opponent_detection", 0, 2, "end")),
    version("coarse", "6ms", CORES, load("0.5ms", "1/2"), after("particle_filter", 0, 2, "end")),
)
PURE_PURSUIT = task(
    "pure_pursuit", 25, version("full", "2ms", CORES, load("0.25ms"), after("path_planner", 0, 2, "end")), slack="0.1"
)
STACK = (PARTICLE_FILTER, OPPONENT_DETECTION, PATH_PLANNER, PURE_PURSUIT)
CHAIN = chain("lidar-to-steering", "particle_filter opponent_detection path_planner pure_pursuit", 120, 95)


def roboracer():
    """The stack of the paper: 24 + 13 + 24 + 2 = 63 ms of work every 25 ms, pipelined round the hyperperiod."""
    system = model(*STACK, units=CORES, resources=MEMORY, chains=[CHAIN], name="roboracer").read_from("9f2c" * 16)
    planned = schedule(system, 25, *_race_jobs(system), mode_name="all")
    return system, replace(planned, **_provenance(), modes=(_with_metrics(planned.modes[0]),))


def _race_jobs(system):
    return (
        job(system, "particle_filter", 0, 0, "core1"),
        job(system, "opponent_detection", 0, 24, "core2"),
        job(system, "path_planner", 0, 12, "core3"),
        job(system, "pure_pursuit", 0, 11, "core4"),
    )


def _provenance():
    return {"generator": "halpipe 0.1.0", "solver": "anneal", "seed": 1, "tick": ms("250us")}


def _with_metrics(table):
    cost = CostTerms(
        total=Fraction(-13, 12),
        overlap=Fraction(0),
        access=Fraction(0),
        precedence=Fraction(0),
        unit=Fraction(0),
        occupancy=Fraction(1, 3),
        timeliness=Fraction(3, 4),
    )
    busy = {"core1": 24, "core2": 13, "core3": 24, "core4": 2}
    return replace(
        table,
        cost=cost,
        unit_loads=tuple(UnitLoad(unit=u, busy=ms(b), share=Fraction(b, 25)) for u, b in busy.items()),
        resource_loads=(ResourceLoad(resource=MEMORY, peak=Fraction(1), mean=Fraction(127, 1000)),),
        chains=(ChainLatency(name="lidar-to-steering", reaction=ms(88), age=ms(63)),),
    )


def two_modes():
    """The same stack with a safe-stop mode, switched both ways; the way back is only an attempt."""
    race = mode("race", STACK)
    stop = replace(mode("safe-stop", (PARTICLE_FILTER, PURE_PURSUIT)), runs=_stop_runs())
    system = model(
        *STACK,
        task("diagnostics", None, version("v", "1ms", "core4")),
        units=CORES,
        resources=MEMORY,
        chains=[CHAIN],
        modes=[race, stop],
        transitions=[("race", "safe-stop", 100), ("safe-stop", "race", None)],
        name="roboracer",
    )
    racing = _with_metrics(schedule(system, 25, *_race_jobs(system), mode_name="race").modes[0])
    stopping = ModeSchedule(
        name="safe-stop",
        hyperperiod=ms(25),
        status=Status.VALID,
        jobs=(
            job(system, "particle_filter", 0, 0, "core1", "reduced"),
            job(system, "path_planner", 0, 9, "core4", "coarse"),
            job(system, "pure_pursuit", 0, 15, "core1"),
        ),
    )
    switches = (
        TransitionTable(
            source="race", target="safe-stop", length=ms(0), worst_latency=ms(25), status=Status.VALID, jobs=()
        ),
        TransitionTable(
            source="safe-stop",
            target="race",
            length=ms(25),
            worst_latency=ms(50),
            status=Status.NOT_FOUND,
            jobs=(
                job(system, "particle_filter", 0, 0, "core1"),
                job(system, "opponent_detection", 0, 24, "core2"),
                job(system, "path_planner", 0, 12, "core3"),
                job(system, "pure_pursuit", 0, 10, "core4"),
            ),
        ),
    )
    found = Schedule(
        model=system.name, model_sha256="", modes=(racing, stopping), transitions=switches, **_provenance()
    )
    return system, found


def _stop_runs():
    return (
        Run(task="particle_filter", versions=("reduced",)),
        Run(task="path_planner", versions=("coarse",)),
        Run(task="pure_pursuit", versions=("full",)),
    )


def many(units=120, jobs_per_unit=20, tasks_per_unit=2):
    """A wide system: every unit is packed with the jobs of its own tasks, a third of the hyperperiod idle."""
    names = [f"cluster{u // 8}.core{u % 8}" for u in range(units)]
    per_task = jobs_per_unit // tasks_per_unit
    period = ms(1000) / per_task
    wcet = period * Fraction(2, 3) / tasks_per_unit
    tasks, jobs = [], []
    for number, unit in enumerate(names):
        for part in range(tasks_per_unit):
            name = f"node_{number}_{part}"
            phase = wcet * part + period * Fraction(number % 3, 3)
            tasks.append(task(name, period, version("v", wcet, unit, access("ddr", "0ms", wcet / 4, "1/200"))))
            jobs += [_cyclic(name, i, phase + period * i, wcet, unit, ms(1000)) for i in range(per_task)]
    system = model(*tasks, units=" ".join(names), resources="ddr", name="wide")
    return system, schedule(system, ms(1000), *jobs)


def _cyclic(name, index, start, wcet, unit, hyperperiod):
    begin = start % hyperperiod
    return Job(task=name, index=index, start=begin, end=begin + wcet, version="v", units=(unit,))


def thirds():
    """A 30 Hz camera: times that no decimal ends, and a gang of two units."""
    camera = task("camera", "1/30s", version("v", "10ms", "isp"))
    stereo = task(
        "stereo",
        "1/30s",
        version("v", "100/7ms", "gpu0 gpu1", access("bus", 0, 5, "1/3"), after("camera", 0, 1, "end"), gang=2),
    )
    system = model(camera, stereo, units="isp gpu0 gpu1", resources="bus", name="camera")
    begin = ms("10ms")
    stereo_job = Job(
        task="stereo", index=0, start=begin, end=begin + ms("100/7ms"), version="v", units=("gpu0", "gpu1")
    )
    return system, schedule(system, "1/30s", job(system, "camera", 0, 0, "isp"), stereo_job)


def hostile():
    """Names full of what XML, HTML, JavaScript, JSON and DOT treat specially."""
    evil = "</script><b>&\"'\\{x}|%"
    system = model(
        task(evil, 10, version(evil, "4ms", evil, access(evil, 0, 1))),
        task("b", 10, version("v", "1ms", evil, after(evil, 0, 9, "end"))),
        units=evil,
        resources=evil,
        chains=[chain(evil, f"{evil} b", 20)],
        modes=None,
        name=evil,
    )
    return system, schedule(system, 10, job(system, evil, 0, 0, evil), job(system, "b", 0, 4, evil))


SPLIT = Path(__file__).parents[2] / "fixtures" / "split"


def split():
    """The example of MODEL 8: jobs with gaps, an interrupt, bound tasks and polled arrivals."""
    return read_model(str(SPLIT / "model.xml")), read_schedule(str(SPLIT / "schedule.xml"))
