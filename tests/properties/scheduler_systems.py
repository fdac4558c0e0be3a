"""Random models with every feature the scheduler knows, schedulable or not, and what their arrays must keep to."""

from __future__ import annotations

import random
from fractions import Fraction
from itertools import pairwise

from hypothesis import assume

from halpipe.core.durations import Duration, milliseconds
from halpipe.models import Precedence, Resource, Task, TaskModel, Unit
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.problem import build_problem
from support import access, after, chain, mode, task, version

UNITS = ("a", "b", "c")
RESOURCES = ("r", "s")
BOUNDS = ("1/3", "1/2", "2/3", "1", "1/4", "3/8")
PERIODS = {6: (6, 3, 2), 12: (12, 6, 4, 3), 24: (24, 12, 8, 6)}


def random_model(seed: int, grain: int = 1) -> TaskModel:
    """Make a model of up to six tasks; with `grain` above 1, WCETs, phases and windows lie between whole milliseconds.

    Later tasks may need earlier ones; tasks without a period come first, so that later ones demand them.
    """
    rng = random.Random(seed)
    total = rng.choice(list(PERIODS))
    helpers = [f"h{n}" for n in range(rng.choice((0, 0, 1, 2)))]
    names = helpers + [f"t{n}" for n in range(rng.randint(1, 4))]
    tasks: list[Task] = []
    for name in names:
        period = None if name in helpers else rng.choice(PERIODS[total])
        tasks.append(_task(rng, name, period, [t.name for t in tasks], total, grain))
    if tasks[-1].period != milliseconds(total):
        tasks.append(task("whole", total, version("v", 1, " ".join(UNITS))))
    return TaskModel(
        name="random",
        units=tuple(Unit(name=name) for name in UNITS),
        resources=tuple(Resource(name=name) for name in RESOURCES),
        tasks=tuple(tasks),
        chains=tuple(_chains(rng, tasks, total)),
        modes=(mode("one", tasks),),
    ).read_from("0" * 64)


def _fine(rng: random.Random, whole: int, grain: int) -> Duration:
    """Return `whole` milliseconds, less a part of one if the grain is fine; always more than zero."""
    part = Fraction(rng.randrange(grain), grain) if whole and rng.random() < 0.7 else Fraction(0)
    return milliseconds(whole - part)


def _task(rng, name, period, earlier, total, grain):
    versions = [_version(rng, f"v{n}", period or 4, earlier, total, grain) for n in range(rng.choice((1, 1, 2, 3)))]
    if period is None:
        return task(name, None, *versions)
    return task(
        name,
        period,
        *versions,
        slack=rng.choice((0, 0, Fraction(1, 4), Fraction(1, 3), Fraction(1, 2), 1)),
        offset=rng.choice((None, None, rng.randrange(2 * period))),
        deadline=rng.choice((None, None, rng.randint(1, 2 * period))),
    )


def _version(rng, name, period, earlier, total, grain):
    wcet = _fine(rng, rng.randint(1, max(1, period * 2 // 3)), grain)
    gang = rng.choice((1, 1, 1, 2, 3))
    units = rng.sample(UNITS, rng.randint(gang, len(UNITS)))
    phases = []
    for _ in range(rng.choice((0, 1, 1, 2))):
        cuts = sorted(rng.sample(range(9), 2))
        start, end = (wcet * Fraction(cut, 8) for cut in cuts)
        if grain == 1:
            start, end = milliseconds(start // milliseconds(1)), milliseconds(-(-end // milliseconds(1)))
        phases.append(access(rng.choice(RESOURCES), start, end, rng.choice(BOUNDS)))
    windows = [_window(rng, rng.choice(earlier), total, grain) for _ in range(rng.choice((0, 0, 1, 1, 2))) if earlier]
    return version(name, wcet, " ".join(units), *phases, *windows, gang=gang)


def _window(rng, other, total, grain):
    low = rng.choice((0, 0, rng.randrange(total)))
    high = low + rng.choice((0, rng.randrange(total), 2 * total))
    window = after(other, low, high, rng.choice(("start", "end")))
    if grain == 1:
        return window
    return Precedence(
        task=other, min=_fine(rng, low, grain), max=window.max + milliseconds(Fraction(1, grain)), anchor=window.anchor
    )


def _chains(rng, tasks, total):
    for number in range(rng.choice((0, 0, 1, 2))):
        steps = rng.sample([t.name for t in tasks], rng.randint(1, min(3, len(tasks))))
        limits = [rng.choice((None, rng.randint(1, 4 * total))) for _ in range(2)]
        yield chain(f"c{number}", " ".join(steps), *limits)


def random_problem(seed: int, *, grouped: bool, grain: int = 1, tick: Duration | None = None):
    """Return a random model and its arrays; discard it where a task has no option to run at all."""
    system = random_model(seed, grain)
    expansion = expand(system, system.modes[0])
    problem = build_problem(expansion, system.units, RESOURCES, system.chains, tick=tick, grouped=grouped)
    first = problem.arrays.task_option
    jobs = problem.arrays.task_job
    assume(all(a < b or c == d for (a, b), (c, d) in zip(pairwise(first), pairwise(jobs), strict=True)))
    return system, problem
