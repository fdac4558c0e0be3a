"""Switches between two modes with drawn jobs, and how long they need a table of their own, millisecond by millisecond.

Instants are whole milliseconds, so that a switch is what is in force in each of them.
"""

import random
from collections import Counter
from fractions import Fraction

from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from support import access, job, mode, model, ms, task, version


def drawn(seed):
    """A model and a schedule of the modes x and y and the switch between them, of jobs that may wrap round the end."""
    rng = random.Random(seed)
    periods = [rng.choice((2, 4, 12)) for _ in "xy"]
    tasks, starts = ([], []), ([], [])
    for number, period in enumerate(periods):
        for name in range(rng.randint(1, 3)):
            length = rng.randint(1, period)
            begin = rng.randint(0, length - 1)
            end, kind = rng.randint(begin + 1, length), rng.choice(("read", "read", "write"))
            phase = access("mem", begin, end, Fraction(rng.randint(1, 2), 8), kind)
            tasks[number].append(task(f"t{number}{name}", period, version("v", length, "u1", phase)))
            starts[number].append(rng.randint(0, period - 1))
    modes = [mode(name, each) for name, each in zip("xy", tasks, strict=True)]
    system = model(*tasks[0], *tasks[1], units="u1", resources="mem", modes=modes, transitions=[("x", "y", None)])
    tables = tuple(
        ModeSchedule(
            name=name,
            hyperperiod=ms(period),
            status=Status.VALID,
            jobs=tuple(job(system, t.name, 0, at, "u1") for t, at in zip(own, begun, strict=True)),
        )
        for name, period, own, begun in zip("xy", periods, tasks, starts, strict=True)
    )
    length = rng.randint(0, 5)
    switch = TransitionTable(
        source="x", target="y", length=ms(length), worst_latency=ms(99), status=Status.VALID, jobs=()
    )
    return system, Schedule(model="m", model_sha256="", modes=tables, transitions=(switch,))


def phases(system, table):
    """The phases of the jobs of a mode, in ms: row, begin, end, bound."""
    for placed in table.jobs:
        for each in system.task(placed.task).version(placed.version).accesses:
            begin, end = (int((placed.start + edge).in_unit("ms")) for edge in (each.start, each.end))
            yield ("u1", str(each.kind)), begin, end, each.bound


def at_work(system, table, instant, *, cycles):
    """The bounds in force at an instant of the line on which the given cycles of a mode begin at 0."""
    period = int(table.hyperperiod.in_unit("ms"))
    found = Counter()
    for row, begin, end, bound in phases(system, table):
        for cycle in cycles:
            if begin + cycle * period <= instant < end + cycle * period:
                found[row] += bound
    return found


def line(system, schedule, instant):
    """The bounds in force at an instant after the end of the mode x, from which on its jobs only run to their ends."""
    (x, y), (switch,) = schedule.modes, schedule.transitions
    length = int(switch.length.in_unit("ms"))
    found = at_work(system, x, instant, cycles=range(-3, 0))
    found.update(at_work(system, y, instant - length, cycles=range(12)))
    return found


def cycles_needed(system, schedule):
    """The cycles of y after which its own table grants whatever is in force."""
    y, length = schedule.modes[1], int(schedule.transitions[0].length.in_unit("ms"))
    period, last = int(y.hyperperiod.in_unit("ms")), 0
    for instant in range(length, length + 13):
        granted = at_work(system, y, (instant - length) % period, cycles=(-1, 0))
        if any(bound > granted[row] for row, bound in line(system, schedule, instant).items()):
            last = instant - length + 1
    return -(-last // period)
