"""Rules that sort and compare neighbours find what a comparison of all pairs finds."""

from dataclasses import replace
from fractions import Fraction

import split_oracle
import verify_oracle as oracle
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import milliseconds
from halpipe.models import ModeSchedule, Part, Schedule, Split, Status, TransitionTable
from halpipe.pipeline.verify import codes, verify
from profiles import examples
from support import access, job, mode, model, ms, task, version

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


def switch(length, between, span):
    """Return the table of the switch between the two modes of `span`."""
    return TransitionTable(
        source="one",
        target="two",
        length=milliseconds(length),
        worst_latency=milliseconds(span + length),
        status=Status.VALID,
        jobs=tuple(between),
    )


def placed(rng, system, index, start):
    chosen = rng.choice(system.task("t").versions).name
    return replace(job(system, "t", 0, start, f"u{rng.randrange(12)}", chosen), index=index)


@examples(300)
@given(RANDOMS)
def test_a_task_against_itself_is_found_as_by_all_pairs(rng):
    system, plans, length, between = crowd(rng)
    tables = [oracle_table(system, name, [*jobs, job(system, "s", 0, 0, "u0")]) for name, jobs in plans]
    gap = switch(length, between, 40)
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


def crossing(rng):
    """Two modes of 20 ms with jobs of 1 to 50 ms on two units, each with a phase, and a switch between them."""
    tasks = []
    for number in range(4):
        wcet = rng.choice((1, 2, 3, 5, 8, 50))
        begin = rng.randrange(wcet)
        phase = access("r", begin, rng.randint(begin + 1, wcet), rng.choice(("1", "1/2", "1/3", "2/3")))
        tasks.append(task(f"t{number}", 20, version("v", wcet, "u0 u1", phase), slack=1, deadline=90))
    system = model(
        *tasks,
        units="u0 u1",
        resources="r",
        modes=[mode(name, tasks) for name in ("one", "two")],
        transitions=(("one", "two", 60),),
    )
    length = rng.choice((0, 5, 12))
    plans = [[anywhere(rng, system, t.name, rng.randrange(20)) for t in rng.sample(tasks, 2)] for _ in range(2)]
    between = [anywhere(rng, system, tasks[0].name, rng.randrange(length))] if length and rng.random() < 0.5 else []
    return system, plans, length, between


def anywhere(rng, system, name, start):
    return job(system, name, 0, start, f"u{rng.randrange(2)}")


def on_the_circle(jobs):
    """Jobs with their unrolled starts, in enough cycles for the longest of them to meet the last one."""
    return [(j, start(j) + 20 * turn) for turn in range(-3, 1) for j in jobs]


def on_the_line(plans, length, between):
    before, after = plans
    line = [(j, start(j) - 20 * turn) for turn in range(1, 4) for j in before]
    return [
        *line,
        *((j, start(j)) for j in between),
        *((j, start(j) + length + 20 * turn) for turn in range(4) for j in after),
    ]


def is_twice(placed):
    """Whether any two executions meet on a unit."""
    return any(
        set(one.units) & set(two.units) and max(a, b) < min(a + end(one) - start(one), b + end(two) - start(two))
        for k, (one, a) in enumerate(placed)
        for two, b in placed[k + 1 :]
    )


def is_over(system, placed):
    """Whether the bounds of all phases in force where one of them begins are more than one together."""
    phases = [(at + whole(row.start), at + whole(row.end), row.bound) for j, at in placed for row in rows(system, j)]
    return any(sum(bound for a, b, bound in phases if a <= begin < b) > 1 for begin, _, _ in phases)


def rows(system, one):
    return system.task(one.task).versions[0].accesses


def whole(duration):
    return int(duration.in_unit("ms"))


@examples(100)
@given(RANDOMS)
def test_what_meets_on_units_and_resources_is_found_as_by_all_pairs(rng):
    """In each mode and on the line of the switch; what meets in a mode meets in the first cycles of the line, too."""
    system, plans, length, between = crossing(rng)
    tables = tuple(
        replace(oracle_table(system, name, jobs), hyperperiod=milliseconds(20))
        for name, jobs in zip(("one", "two"), plans, strict=True)
    )
    gap = switch(length, between, 20)
    found = {d.code for d in verify(system, Schedule(model=system.name, modes=tables, transitions=(gap,)))}
    lines = [on_the_circle(plans[0]), on_the_circle(plans[1]), on_the_line(plans, length, between)]
    assert (codes.OVERLAP.id in found) == any(map(is_twice, lines))
    if all(end(j) - start(j) <= 20 for jobs in plans for j in jobs):  # longer ones overlap themselves in their mode
        assert (codes.OVERLOAD.id in found) == any(is_over(system, line) for line in lines)


def polled(rng):
    """Two modes of 40 ms with four jobs each of a task that serves arrivals, and a switch between them."""
    slack = Fraction(rng.choice((0, 1, 2)), 2)
    distance, deadline = rng.choice((10, 15, 25)), rng.choice((None, 12, 25, 40))
    owner = task("t", 10, *(version(f"v{k}", k, "u0 u1") for k in (1, 4)), slack=slack, deadline=deadline)
    owner, rest = replace(owner, distance=ms(distance)), task("s", 40, version("v", 1, "u2"), slack=1)
    modes = [mode(name, (owner, rest)) for name in ("one", "two")]
    system = model(owner, rest, units="u0 u1 u2", modes=modes, transitions=(("one", "two", 60),))
    length = rng.choice((0, 5, 20))
    near = [[10 * k + rng.randint(0, 9) for k in range(4)] for _ in range(2)]
    plans = [[serving(rng, system, k, at) for k, at in enumerate(starts)] for starts in near]
    between = [serving(rng, system, k, rng.randrange(length)) for k in range(rng.randint(0, 2))] if length else []
    return system, plans, length, between


def serving(rng, system, index, at):
    return replace(job(system, "t", 0, at, f"u{rng.randrange(2)}", rng.choice(("v1", "v4"))), index=index)


def successors(line):
    """All pairs of which no other job starts between the two; jobs that start together follow by their numbers."""
    rank = {id(row): (row[1], row[0].index) for row in line}
    return [
        (one, two)
        for one in line
        for two in line
        if rank[id(one)] < rank[id(two)] and not any(rank[id(one)] < rank[id(row)] < rank[id(two)] for row in line)
    ]


def is_late(owner, pairs):
    limit = whole(owner.distance if owner.deadline is None else owner.deadline)
    return any(
        b - a > whole(owner.distance) or b + end(two) - start(two) - a > limit for (_, a, *_), (two, b, *_) in pairs
    )


@examples(100)
@given(RANDOMS)
def test_starved_tasks_and_late_arrivals_are_found_as_by_all_pairs(rng):
    system, plans, length, between = polled(rng)
    rest = job(system, "s", 0, 0, "u2")
    tables = tuple(oracle_table(system, name, [*jobs, rest]) for name, jobs in zip(("one", "two"), plans, strict=True))
    gap = switch(length, between, 40)
    found = {d.code for d in verify(system, Schedule(model=system.name, modes=tables, transitions=(gap,)))}
    owner = system.task("t")
    circles = [[(j, start(j) + 40 * turn, turn) for turn in range(-1, 1) for j in jobs] for jobs in plans]
    line = [(j, start(j) - 40 * turn, "n") for turn in (1, 2) for j in plans[0]]
    line += [(j, start(j), "table") for j in between]
    line += [(j, start(j) + length + 40 * turn, "m") for turn in (0, 1) for j in plans[1]]
    across = [(one, two) for one, two in successors(line) if one[2] != two[2] or one[2] == "table"]
    late = [pair for circle in circles for pair in successors(circle)] + across
    assert (codes.ARRIVAL_LATE.id in found) == is_late(owner, late)
    assert (codes.STARVED.id in found) == any(b[1] - a[1] > 10 * (1 + owner.slack) for a, b in across)
