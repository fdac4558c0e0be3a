"""A schedule with two modes, and recordings of it, for the tests of compare."""

from dataclasses import replace

from halpipe.core.durations import ZERO, Duration
from halpipe.models import Job, ModeSchedule, Schedule, Status, TransitionTable
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from support import ms


def job(task, index, start, end, units="c1", version="v"):
    return Job(task=task, index=index, start=ms(start), end=ms(end), version=version, units=tuple(units.split()))


def table(name, hyperperiod, *jobs):
    return ModeSchedule(name=name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)


def switch(source, target, length, *jobs):
    return TransitionTable(
        source=source, target=target, length=ms(length), worst_latency=ms(length), status=Status.VALID, jobs=jobs
    )


RACE = table("race", 20, job("a", 0, 0, 3), job("a", 1, 10, 13), job("b", 0, 4, 6), job("c", 0, 18, 22, "c2 c3"))
SLOW = table("slow", 10, job("b", 0, 5, 7))
PLAN = Schedule(
    model="m",
    model_sha256="",
    modes=(RACE, SLOW),
    transitions=(switch("race", "slow", 5, job("b", 0, 2, 4)), switch("slow", "race", 0)),
)
PIECES = [("race", RACE), ("race", RACE), ("race->slow", PLAN.transitions[0]), ("slow", SLOW), ("slow", SLOW)]


def play(pieces=PIECES, origin=ZERO, *, stated=True):
    """The trace of a run that keeps the schedule; a table of length zero takes a number, too."""
    seen, now = [], origin
    for cycle, (name, played) in enumerate(pieces):
        for planned in played.jobs:
            label = {"table": name, "cycle": cycle, "job": planned.index} if stated else {}
            start, end = now + planned.start, now + planned.end
            seen.append(Execution(task=planned.task, units=planned.units, start=start, end=end, **label))
        now += played.length if isinstance(played, TransitionTable) else played.hyperperiod
    return seen


def compared(seen, **options):
    seen = sorted(seen, key=lambda execution: execution.start.ns)
    if all(each.table and each.cycle is not None for each in seen):
        options.pop("mode", None)  # it is refused beside a trace that names its tables
    return compare(PLAN, Trace(name="", executions=tuple(seen)), CompareOptions(**options))


def moved(seen, position, *, start=0, end=0, **changes):
    e = seen[position]
    changed = replace(e, start=e.start + Duration(start), end=e.end + Duration(end), **changes)
    return [*seen[:position], changed, *seen[position + 1 :]]
