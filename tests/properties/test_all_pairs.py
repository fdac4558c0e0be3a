"""Rules that sort and compare neighbours find what a comparison of all pairs finds."""

from dataclasses import replace

import split_oracle
import verify_oracle as oracle
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import milliseconds
from halpipe.models import ModeSchedule, Part, Schedule, Split, Status, TransitionTable
from halpipe.pipeline.verify import codes, verify
from profiles import examples
from support import job, mode, model, ms, task, version

ANYWHERE = Split(anywhere=True, max_gaps=2)
RANDOMS = st.randoms(use_true_random=False)


def crowd(rng):
    """Two modes of one task whose jobs last longer than their periods, on many units, and a switch between them."""
    lengths = rng.sample(range(1, 40), 3)
    units = " ".join(f"u{k}" for k in range(12))
    owner = task("t", 10, *(version(f"v{k}", wcet, units) for k, wcet in enumerate(lengths)), slack=1, deadline=60)
    rest = task("s", 40, version("v", 1, units))
    modes = [mode(name, (owner, rest)) for name in ("one", "two")]
    system = model(owner, rest, units=units, modes=modes, transitions=(("one", "two", 60),))
    plans = []
    for name in ("one", "two"):
        jobs = [placed(rng, system, k, rng.randrange(40)) for k in range(4)]
        plans.append((name, jobs))
    length = rng.choice((0, 5, 20))
    between = [placed(rng, system, k, rng.randrange(length)) for k in range(rng.randint(0, 2))] if length else []
    return system, plans, length, between


def placed(rng, system, index, start):
    chosen = rng.choice(system.task("t").versions).name
    return replace(job(system, "t", 0, start, f"u{rng.randrange(12)}", chosen), index=index)


@examples(300)
@given(RANDOMS)
def test_a_task_against_itself_is_found_as_by_all_pairs(rng):
    system, plans, length, between = crowd(rng)
    tables = [oracle_table(system, name, [*jobs, job(system, "s", 0, 0, "u0")]) for name, jobs in plans]
    gap = TransitionTable(
        source="one",
        target="two",
        length=milliseconds(length),
        worst_latency=milliseconds(40 + length),
        status=Status.VALID,
        jobs=tuple(between),
    )
    plan = Schedule(model=system.name, modes=tuple(tables), transitions=(gap,))
    found = {d.code for d in verify(system, plan)}
    line = [("n", start(j) - 40, end(j) - 40) for j in plans[0][1]] + [
        ("n", start(j) - 80, end(j) - 80) for j in plans[0][1]
    ]
    line += [("table", start(j), end(j)) for j in between]
    line += [("m", start(j) + length + 40 * q, end(j) + length + 40 * q) for q in range(2) for j in plans[1][1]]
    meet = any(
        (one[0] != two[0] or one[0] == "table") and one[1] <= two[1] < one[2]
        for k, one in enumerate(line)
        for two in line[:k] + line[k + 1 :]
    )
    assert (codes.AGAINST_ITSELF.id in found) == meet


def start(job):
    return int(job.start.in_unit("ms"))


def end(job):
    return int(job.end.in_unit("ms"))


def oracle_table(system, name, jobs):
    return ModeSchedule(name=name, hyperperiod=milliseconds(40), status=Status.VALID, jobs=tuple(jobs))


@examples(400)
@given(RANDOMS)
def test_jobs_that_cross_are_found_as_by_all_pairs(rng):
    tasks = [task(f"t{k}", 60, version("v", 12, "u1"), slack=1) for k in range(rng.randint(2, 5))]
    tasks = [replace(t, versions=(replace(t.versions[0], split=ANYWHERE),)) for t in tasks]
    system = model(*tasks, units="u1")
    jobs = [split_job(rng, t) for t in tasks]
    plan = Schedule(
        model=system.name, modes=(replace(oracle_table(system, "all", jobs), hyperperiod=milliseconds(60)),)
    )
    found = {d.code for d in verify(system, plan)}
    active = oracle.tasks_of(system, "all")
    at = [oracle.placed_at(system, active, j, "") for j in jobs]
    assert (codes.NOT_NESTED.id in found) == split_oracle.crossing(at, 60)


def split_job(rng, owner):
    """A job of 12 ms in up to three parts, anywhere."""
    cuts = sorted(rng.sample(range(1, 12), rng.randint(0, 2)))
    parts, clock = [], rng.randrange(60)
    begin = clock
    for a, b in zip([0, *cuts], [*cuts, 12], strict=True):
        parts.append((clock, clock + b - a, a, b))
        clock += b - a + rng.choice((1, 3, 8, 13, 20))
    made = tuple(Part(start=ms(s), end=ms(t), executed_from=ms(a), executed_to=ms(b)) for s, t, a, b in parts)
    whole = job(model(owner, units="u1"), owner.name, 0, begin, "u1")
    return replace(whole, end=made[-1].end, parts=made if len(made) > 1 else ())
