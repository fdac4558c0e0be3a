"""The exact engine and every schedule there is, for small systems with requirements of MODEL 8 and 10."""

import random
from collections import Counter
from fractions import Fraction
from itertools import product

import pytest
import split_systems

from halpipe.core.durations import milliseconds as ms
from halpipe.models import (
    Access,
    Anchor,
    Binding,
    Chain,
    Edge,
    Job,
    Match,
    Mode,
    ModeSchedule,
    Precedence,
    Resource,
    ResourceKind,
    Run,
    Schedule,
    Status,
    Task,
    TaskModel,
    Unit,
    Version,
)
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.exact import Answer, Effort, solve_exact, unknown_to_exact
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify

pytest.importorskip("ortools")

ANCHORS = (Anchor.START, Anchor.END, Anchor.RELEASE, Anchor.POINT)
LOCK = "spin"


def whole(time):
    return int(time.in_unit("ms"))


def drawn_task(rng, name, units, before, longest):
    period = rng.choice((longest, longest // 2))
    wcet = rng.choice((1, 1, 2))
    deadline = rng.randint(wcet, period) if rng.random() < 0.3 else None
    distance = rng.randint(period, period + 2) if rng.random() < 0.2 else None
    rows = (drawn_window(rng, rng.choice(before)),) if before and rng.random() < 0.6 else ()
    held = (Access(resource=LOCK, start=ms(0), end=ms(rng.randint(1, wcet))),) if rng.random() < 0.3 else ()
    chosen = tuple(units) if rng.random() < 0.5 else (rng.choice(units),)
    return Task(
        name=name,
        period=ms(period),
        slack=min(Fraction(1), Fraction(rng.choice((0, 1, 2, period)), period)),
        offset=ms(rng.randrange(period)) if rng.random() < 0.35 else None,
        deadline=ms(deadline) if deadline and not distance else None,
        distance=ms(distance) if distance else None,
        let=ms(rng.randint(wcet, deadline or period)) if rng.random() < 0.35 else None,
        binding=rng.choice(tuple(Binding)),
        versions=(Version(name="v", wcet=ms(wcet), units=chosen, accesses=held, precedences=rows),),
    )


def drawn_window(rng, before):
    anchor, low = rng.choice(ANCHORS), rng.choice((0, 0, 1, 2))
    return Precedence(
        task=before.name,
        anchor=anchor,
        point=ms(rng.randint(0, whole(before.versions[0].wcet))) if anchor is Anchor.POINT else None,
        to=rng.choice((Anchor.START, Anchor.END)),
        match=rng.choice(tuple(Match)),
        min=ms(low),
        max=ms(low + rng.choice((0, 1, 2, 3))),
    )


def drawn_chain(rng, names, longest):
    figure = rng.choice(("max_latency", "max_reaction", "max_age"))
    anchor, to = rng.choice((None, *ANCHORS[:3])), rng.choice((None, Anchor.START, Anchor.END))
    if anchor is Anchor.END:
        to = Anchor.END
    tasks = tuple(rng.sample(names, rng.choice((1, 2, 2))))
    return Chain(name="c", tasks=tasks, anchor=anchor, to=to, **{figure: ms(rng.randint(1, 2 * longest))})


def drawn(rng):
    """A system of two or three tasks, four jobs at most, on one or two units."""
    units, names = rng.choice((["u"], ["u", "v"])), rng.choice(("ab", "ab", "abc"))
    longest = rng.choice((4, 6))
    tasks = []
    for name in names:
        tasks.append(drawn_task(rng, name, units, tasks, longest))
    return TaskModel(
        name="m",
        units=tuple(Unit(name=name) for name in units),
        resources=(Resource(name=LOCK, kind=ResourceKind.LOCK),),
        tasks=tuple(tasks),
        chains=(drawn_chain(rng, names, longest),) if rng.random() < 0.6 else (),
        modes=(Mode(name="n", runs=tuple(Run(task=n, versions=("v",)) for n in names), edge=rng.choice(tuple(Edge))),),
    )


def jobs_of(active, index, total):
    [version] = active.versions
    for start in range(total):
        for unit in version.units:
            end = ms(start) + version.wcet
            yield Job(task=active.name, index=index, start=ms(start), end=end, version="v", units=(unit,))


def meet(jobs, total):
    taken = [(job.units, at % total) for job in jobs for at in range(whole(job.start), whole(job.end))]
    return len(taken) != len(set(taken))


def has_schedule(system):
    """Try all starts on the grid of the model and all units, and let verify decide."""
    expansion = expand(system, system.modes[0])
    total = whole(expansion.hyperperiod)
    every = [jobs_of(active, index, total) for active in expansion.tasks for index in range(active.jobs)]
    for jobs in product(*map(tuple, every)):
        if meet(jobs, total):
            continue
        table = ModeSchedule(name="n", hyperperiod=expansion.hyperperiod, status=Status.VALID, jobs=jobs)
        schedule = Schedule(model="m", model_sha256=system.digest, modes=(table,))
        if not any(found.is_error for found in verify(system, schedule)):
            return True
    return False


def compare(seed, count):
    rng, verdicts = random.Random(seed), Counter()
    while sum(verdicts.values()) < count:
        system = drawn(rng)
        if sum(active.jobs for active in expand(system, system.modes[0]).tasks) > 4:
            continue
        if any(found.is_error for found in validate(system)):
            assert not has_schedule(system), system
            verdicts["refused"] += 1
            continue
        answer = solve_exact(system, system.modes[0], Effort(work=20)).status
        assert answer is Answer.FEASIBLE or not has_schedule(system), system
        assert answer is not Answer.UNKNOWN
        verdicts[str(answer)] += 1
    return verdicts


def test_the_exact_engine_is_right_about_every_small_system():
    verdicts = compare(1, 24)
    assert verdicts["feasible"] > 5
    assert verdicts["infeasible"] > 2


def test_the_exact_engine_denies_no_schedule_of_systems_with_interrupts_and_preemptive_jobs():
    found = Counter()
    for seed in range(60):
        system, _ = split_systems.valid_system(random.Random(seed))
        if any(unknown_to_exact(system, expand(system, system.modes[0]))):
            continue
        answer = solve_exact(system, system.modes[0], Effort(work=5)).status
        assert answer is not Answer.INFEASIBLE, system
        found[str(answer)] += 1
    assert found["feasible"] > 20


@pytest.mark.slow  # the first test has the same subject
def test_the_exact_engine_is_right_about_many_small_systems():
    compare(2, 150)
