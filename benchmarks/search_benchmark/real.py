"""Systems like those that are published: drawn by the statistics of engine control, and the WATERS 2019 challenge.

Statistics: S. Kramer, D. Ziegenbein, A. Hamann (Bosch), "Real World Automotive Benchmarks For Free", WATERS 2015: the
share of runnables for each period, their execution times, and by how much the worst case exceeds the average.
Challenge: A. Hamann et al., "WATERS Industrial Challenge 2019" (Bosch and UNIMORE): periods and worst-case execution
times of an autonomous driving system on an NVIDIA Jetson TX2. What is ours (D): execution times within their limits are
drawn from an exponential distribution, tasks are scaled to the load of a row, and to go on after a gap costs 2 us.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import accumulate
from random import Random
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, milliseconds
from halpipe.core.records import record
from halpipe.models import (
    Anchor,
    Binding,
    Chain,
    Interrupt,
    Mode,
    Precedence,
    Run,
    Split,
    Task,
    TaskModel,
    Unit,
    Version,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


@record
class Rate:
    """Runnables of one period: their share in percent, execution times in ns, and factors of the worst case in %."""

    share: int
    least: int
    average: int
    most: int
    factors: tuple[int, int]


RATES: Mapping[int, Rate] = {
    1: Rate(3, 340, 5000, 30110, (130, 2911)),
    2: Rate(2, 320, 4200, 40690, (154, 1904)),
    5: Rate(2, 360, 11040, 83380, (113, 1844)),
    10: Rate(25, 210, 10090, 309870, (106, 3003)),
    20: Rate(25, 250, 8740, 291420, (106, 1561)),
    50: Rate(3, 290, 17560, 92980, (113, 776)),
    100: Rate(20, 210, 10530, 420430, (102, 888)),
    200: Rate(1, 220, 2560, 21950, (103, 490)),
    1000: Rate(4, 370, 430, 460, (184, 475)),
}
"""By period in milliseconds (WATERS 2015, tables III to V)."""

ANGLE = Rate(15, 450, 6520, 88580, (120, 2817))
"""Runnables that follow the crankshaft; a task of them serves arrivals 5 ms apart (6000 rpm, four cylinders)."""

ANGULAR = 4
"""Milliseconds in which arrivals that follow the crankshaft are polled."""

RUNNABLES = 1000
"""On each core: a thousand to fifteen hundred are published for a whole system."""

GRID = 100
"""Nanoseconds to which execution times are rounded."""

RESUME = Duration(2000)


@record(kw_only=True)
class EngineControl:
    """Systems of `cores` cores, each loaded by `load`: on each core a task for each period, split at its runnables."""

    cores: int
    load: Fraction

    def draw(self, seed: int) -> TaskModel:
        """Return the system of a seed."""
        rng = Random(seed)
        names = [f"core{number}" for number in range(self.cores)]
        tasks = [task for name in names for task in _loaded(rng, name, tuple(RATES), self.load)]
        return _model("engine-control", (Unit(name=name, type="core") for name in names), tasks)


@record(kw_only=True)
class Engine:
    """One engine on four cores, in the manner of the FMTV challenge of 2017: each period once, angle task, interrupts.

    Interrupts are the eight routines of the first core, with distances from 0.7 to 6 ms; `load` counts them.
    """

    load: Fraction

    def draw(self, seed: int) -> TaskModel:
        """Return the system of a seed."""
        rng = Random(seed)
        served = tuple(
            Interrupt(name=f"isr{number}", distance=Duration(distance * 1000), wcet=Duration(wcet * 1000))
            for number, (distance, wcet) in enumerate(_ROUTINES, 1)
        )
        units = [Unit(name=name, type="core", interrupts=served if name == "core0" else ()) for name in _CORES]
        tasks = []
        for unit in units:
            left = self.load - sum((i.wcet / i.distance for i in unit.interrupts), Fraction(0))
            tasks += _loaded(rng, unit.name, _CORES[unit.name], left)
        return _model("engine", units, tasks)


_CORES = {"core0": (50, 200), "core1": (1, ANGULAR), "core2": (2, 5, 20, 100, 1000), "core3": (10,)}
"""The periods of the tasks on each core, in milliseconds."""

_ROUTINES = ((700, 8), (1500, 14), (2500, 20), (2800, 20), (3000, 25), (4400, 30), (4700, 30), (6000, 40))
"""Distance and time of interrupts in microseconds."""


def _loaded(rng: Random, core: str, periods: Sequence[int], load: Fraction) -> list[Task]:
    """Return a task for each period, scaled so that together they load a core."""
    drawn = {period: _runnables(rng, RATES.get(period, ANGLE)) for period in periods}
    sum_of_all = sum(Fraction(sum(times), period * 10**6) for period, times in drawn.items())
    tasks = []
    for period, times in drawn.items():
        scaled = [max(GRID, int(time * load / sum_of_all) // GRID * GRID) for time in times]
        tasks.append(_task(core, period, scaled))
    return tasks


def _task(core: str, period: int, times: Sequence[int]) -> Task:
    *points, wcet = (Duration(end) for end in accumulate(times))
    version = Version(name="v", wcet=wcet, units=(core,), split=Split(points=tuple(points), resume=RESUME))
    is_angular = period == ANGULAR
    return Task(
        name=f"{core}_angle" if is_angular else f"{core}_{period}ms",
        period=milliseconds(period),
        slack=Fraction(1),
        distance=milliseconds(5) if is_angular else None,
        deadline=milliseconds(9) if is_angular else None,
        binding=Binding.SYSTEM,
        versions=(version,),
    )


def _runnables(rng: Random, rate: Rate) -> list[int]:
    """Draw the worst-case execution times of the runnables of a rate, in nanoseconds."""
    count = max(1, RUNNABLES * rate.share // 100)
    low, high = rate.factors
    times = []
    for _ in range(count):
        average = min(rate.most, max(rate.least, int(rng.expovariate(1 / rate.average))))
        times.append(average * rng.randint(low, (low + high) // 2) // 100)
    return times


# ------------------------------------------------------------------------------------------------- WATERS 2019

_A57, _DENVER, _GPU = ("core2", "core3", "core4", "core5"), ("core0", "core1"), ("gpu",)
_HOMES = (("a57", _A57), ("denver", _DENVER), ("gpu", _GPU))

_STAGES: Mapping[str, tuple[int, tuple[int | None, ...], str]] = {
    # task: period in ms; WCETs on A57, Denver and GPU in 10 us; the stage before it
    "os_overhead": (100, (5000, 5000), ""),
    "lidar_grabber": (33, (1366, 1087), ""),
    "can_polling": (10, (60, 60), ""),
    "sfm_pre": (33, (374, 319), ""),
    "sfm": (33, (2951, 2782, 790), "sfm_pre"),
    "sfm_post": (33, (418, 354), "sfm"),
    "localization_pre": (400, (895, 822), ""),
    "localization": (400, (38742, 29481, 12400), "localization_pre"),
    "localization_post": (400, (870, 630), "localization"),
    "lane_detection_pre": (66, (398, 353), ""),
    "lane_detection": (66, (5105, 4224, 2734), "lane_detection_pre"),
    "lane_detection_post": (66, (426, 410), "lane_detection"),
    "detection_pre": (200, (370, 318), ""),
    "detection": (200, (None, None, 11600), "detection_pre"),
    "detection_post": (200, (102, 91), "detection"),
    "ekf": (15, (476, 443), ""),
    "planner": (15, (1325, 1244), ""),
    "dasm": (5, (186, 130), ""),
}

_CHAINS = {
    "lidar": "lidar_grabber localization_pre localization localization_post ekf planner dasm",
    "can": "can_polling localization_pre localization localization_post ekf planner dasm",
    "sfm": "sfm_pre sfm sfm_post planner dasm",
    "lane": "lane_detection_pre lane_detection lane_detection_post planner dasm",
    "detection": "detection_pre detection detection_post planner dasm",
}

PUBLISHED: Mapping[str, Duration] = {
    "lidar": milliseconds(875),
    "can": milliseconds(845),
    "sfm": milliseconds(65),
    "lane": milliseconds(98),
    "detection": milliseconds(230),
}
"""Latencies that were published for a solution with logical execution times."""

PIECE = milliseconds(5)
"""No piece of a task is longer: what is offloaded runs in kernels of the GPU, and cores are preempted."""


@record
class Waters2019:
    """The autonomous driving system, cut into pieces of at most 5 ms; its tasks choose their units."""

    def draw(self, seed: int) -> TaskModel:
        """Return the system; there is only one."""
        del seed
        units = (Unit(name=name, type=kind) for kind, names in _HOMES for name in names)
        tasks = [self._task(name, *facts) for name, facts in _STAGES.items()]
        model = _model("waters2019", units, tasks)
        return replace(model, chains=tuple(Chain(name=name, tasks=tuple(t.split())) for name, t in _CHAINS.items()))

    def _task(self, name: str, period: int, times: Sequence[int | None], before: str) -> Task:
        window = Precedence(task=before, min=ZERO, max=milliseconds(period), anchor=Anchor.END)
        versions = [
            Version(
                name=kind,
                wcet=milliseconds(Fraction(time, 100)),
                units=homes,
                precedences=(window,) if before else (),
                split=Split(points=_every(PIECE, milliseconds(Fraction(time, 100)))),
            )
            for time, (kind, homes) in zip(times, _HOMES, strict=False)
            if time is not None and time <= period * 100
        ]
        return Task(
            name=name,
            period=milliseconds(period),
            slack=Fraction(1),
            binding=Binding.SYSTEM,
            versions=tuple(versions),
        )


def _every(piece: Duration, wcet: Duration) -> tuple[Duration, ...]:
    return tuple(piece * number for number in range(1, -(-wcet // piece)))


def _model(name: str, units: Iterable[Unit], tasks: Sequence[Task]) -> TaskModel:
    runs = tuple(Run(task=task.name, versions=tuple(v.name for v in task.versions)) for task in tasks)
    return TaskModel(name=name, units=tuple(units), tasks=tuple(tasks), modes=(Mode(name="run", runs=runs),))
