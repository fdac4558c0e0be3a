"""The line around a switch, and the instants and paces on it, against trying every tick."""

import random
from dataclasses import replace
from fractions import Fraction
from itertools import count, product

import pytest

from halpipe.core.durations import milliseconds
from halpipe.models import WHOLE, Anchor, Edge, Match, ModeSchedule, Split, Status, Transition
from halpipe.pipeline.measure.placement import PlacedPart
from halpipe.pipeline.parts import job_of
from halpipe.pipeline.transitions.change import MOST_CYCLES, Change, Pace
from halpipe.pipeline.transitions.line import Layer, Line, LineJob, Phase, Shape, Window, on_common_grid
from halpipe.pipeline.transitions.search import Table, _Wanted
from halpipe.pipeline.transitions.tables import _lengths
from support import access, after, job, mode, model, ms, schedule, task, version

CAPACITY = 5
UNITS = ("u1", "u2", "u3")


def drawn_shape(rng, name):
    """A shape of one to three parts, on one or two of some units, with phases."""
    busy, at = [], 0
    for _ in range(rng.choice((1, 1, 2, 3))):
        length = rng.randint(1, 4)
        busy.append((at, at + length))
        at += length + rng.randint(1, 5)
    parts = tuple(PlacedPart(start, end, start, end) for start, end in busy) if len(busy) > 1 else ()
    units = tuple(rng.sample(UNITS, rng.randint(1, 3)))
    length = busy[-1][1]
    phases = []
    for _ in range(rng.randrange(3)):
        begin = rng.randrange(length)
        phases.append(Phase("mem", begin, rng.randint(begin + 1, length), rng.randint(1, CAPACITY)))
    return Shape(name, "v", length, units, rng.randint(1, len(units)), tuple(phases), parts)


def ticks(spans, start):
    return {start + tick for begin, end in spans for tick in range(begin, end)}


def crosses(one, other):
    """Whether two spans meet, and neither lies in a gap of the other."""

    def in_gap(inner, outer):
        gaps = zip(outer.shape.busy, outer.shape.busy[1:], strict=False)
        return any(outer.start + a[1] <= inner.start and inner.end <= outer.start + b[0] for a, b in gaps)

    meet = one.start < other.end and other.start < one.end
    return meet and not in_gap(one, other) and not in_gap(other, one)


def fits(jobs, new, capacity=CAPACITY):
    """Decide by every tick whether a job fits beside others."""
    for one in jobs:
        if set(one.units) & set(new.units):
            if ticks(one.shape.busy, one.start) & ticks(new.shape.busy, new.start):
                return False
            if one.shape.parts and new.shape.parts and crosses(one, new):
                return False
        if one.task == new.task and one.start < new.end and new.start < one.end:
            return False
    for phase in new.shape.phases:
        for tick in range(new.start + phase.start, new.start + phase.end):
            held = [p for one in jobs for p in one.shape.phases if one.start + p.start <= tick < one.start + p.end]
            if sum(p.bound for p in held) + phase.bound > capacity:
                return False
    return True


def units_of(jobs, shape, start):
    """The first units, as many as the gang, of which each is free for the job."""
    own = ticks(shape.busy, start)
    busy = {unit: set().union(*(ticks(j.shape.busy, j.start) for j in jobs if unit in j.units)) for unit in shape.units}
    free = [unit for unit in shape.units if not busy[unit] & own]
    return tuple(free[: shape.gang]) if len(free) >= shape.gang else None


def crowded_line(rng):
    """A line of two layers, one of them moved, and jobs entered since; with all its jobs in their places."""
    layers, jobs = [[], [], []], []
    names = (f"t{n}" for n in count())
    for _ in range(12):
        shape, layer = drawn_shape(rng, next(names) if rng.random() < 0.8 else "again"), rng.randrange(3)
        shift = (0, 7, 0)[layer]
        start = rng.randrange(-5, 40)
        units = units_of(jobs, shape, start)
        placed = LineJob(start, shape.task, 0, shape, units or ())
        if units and fits(jobs, placed):
            jobs.append(placed)
            layers[layer].append(placed.moved(-shift))
    line = Line(CAPACITY, (Layer(layers[0]), 0), (Layer(layers[1]), 7))
    for placed in layers[2]:
        line.enter(placed)
    return line, jobs


@pytest.mark.parametrize("seed", range(40))
def test_the_first_fit_is_the_first_start_at_which_all_is_free(seed):
    rng = random.Random(seed)
    line, jobs = crowded_line(rng)
    for name in ("new", "again"):
        shape = drawn_shape(rng, name)
        earliest, latest = rng.randrange(20), rng.randrange(20, 50)
        found = line.first_fit(shape, earliest, latest)
        expected = None
        for start in range(earliest, latest + 1):
            units = units_of(jobs, shape, start)
            if units and fits(jobs, LineJob(start, name, 0, shape, units)):
                expected = (start, units)
                break
        assert found == expected


@pytest.mark.parametrize("seed", range(40))
def test_jobs_clash_and_overload_where_they_do_not_fit(seed):
    rng = random.Random(seed)
    line, jobs = crowded_line(rng)
    for start in range(-8, 45):
        shape = drawn_shape(rng, "new")
        placed = LineJob(start, "new", 0, shape, shape.units[: shape.gang])
        assert line.clashes(placed) == (not fits(jobs, replace(placed, shape=replace(shape, phases=()))))
        assert line.overloads(placed) == (not fits(jobs, replace(placed, units=())))


@pytest.mark.parametrize("seed", range(10))
def test_jobs_cross_where_their_spans_meet_outside_gaps(seed):
    rng = random.Random(seed)
    for _ in range(40):
        one, other = (LineJob(rng.randrange(12), n, 0, drawn_shape(rng, n), ()) for n in "ab")
        assert one.crosses(other) == other.crosses(one) == crosses(one, other)


def test_a_point_of_execution_is_reached_after_the_gaps_before_it():
    parts = (PlacedPart(0, 3, 0, 3), PlacedPart(10, 15, 3, 8))
    cut = Shape("a", "v", 15, ("u1",), 1, (), parts)
    assert [cut.reached(point) for point in (0, 2, 3, 4, 8)] == [0, 2, 3, 11, 15]
    assert [replace(cut, parts=(), length=8).reached(point) for point in (0, 3, 8)] == [0, 3, 8]
    assert [Window("a", 0, 0, anchor, 4).lag(cut) for anchor in (Anchor.START, Anchor.END, Anchor.POINT)] == [0, 15, 11]
    late = LineJob(20, "a", 0, cut, ("u1",), 6)
    assert Window("a", 0, 0, Anchor.RELEASE).instant(late) == 14
    assert Window("a", 0, 0, Anchor.POINT, 4).instant(late) == 31


def test_a_window_to_an_end_is_one_to_the_start_that_much_earlier():
    shape = Shape("a", "v", 4, ("u1",), 1, ())
    window = Window("b", 5, 9, to_end=True)
    assert window.of(shape) == Window("b", 1, 5)
    assert Window("b", 5, 9).of(shape) == Window("b", 5, 9)


@pytest.mark.parametrize("most", [3, 5, 8])
@pytest.mark.parametrize("shortest", [1, 2, 3])
def test_a_pace_can_be_kept_where_some_number_of_starts_divides_the_gap(most, shortest):
    for gap in range(1, 30):
        pace = Pace("a", -gap + 2, 0, 0, most, shortest)
        ways = [parts for parts in range(1, gap + 1) if parts * shortest <= gap <= parts * most]
        assert pace.can_be_kept(2) == bool(ways)


# ------------------------------------------------------------------------------------------------ around one switch


def change_of(*tasks, before, later, **more):
    """The switch between two schedules of the same tasks: rows of task, index, start and unit."""
    units = "u1 u2 u3"
    system = model(*tasks, units=units, modes=[mode("m", tasks), mode("n", tasks)], **more)
    length = max(each.period for each in tasks)
    tables = [
        schedule(system, length, *(job(system, *row) for row in rows), mode_name=name).modes[0]
        for name, rows in (("m", before), ("n", later))
    ]
    return Change(*on_common_grid(system, *tables)), system


ROWS = [("a", 0, 8, "u1"), ("a", 1, 18, "u1"), ("b", 0, 5, "u2")]


def plain_change(*rows, slack=0, edge=Edge.OPEN):
    tasks = [task("a", 10, version("v", 4), slack=slack), task("b", 20, version("v", 3, "u2", *rows))]
    found, system = change_of(*tasks, before=ROWS, later=[("a", 0, 1, "u1"), ("a", 1, 11, "u1"), ("b", 0, 16, "u2")])
    if edge is Edge.CLOSED:
        closed = replace(system, modes=tuple(replace(m, edge=edge) for m in system.modes))
        found = Change(*on_common_grid(closed, found.before.schedule, found.after.schedule))
    return found


def test_what_runs_across_the_switch_sets_the_least_length():
    """The last job of a ends 2 ms after the switch; the first one of the mode after starts at 1 ms."""
    assert [(job.task, job.start, job.end) for job in plain_change().tail] == [("a", -2, 2)]
    assert plain_change().least == (1, "a")
    assert plain_change(edge=Edge.CLOSED).least == (2, "a")
    assert [plain_change().clash(length) for length in (0, 1, 2)] == ["a", None, None]
    assert plain_change(edge=Edge.CLOSED).clash(1) == "a"


def test_of_tasks_that_need_the_same_length_the_first_is_named():
    tasks = [task("a", 20, version("v", 4)), task("b", 20, version("v", 3, "u2"))]
    rows = [("a", 0, 18, "u1"), ("b", 0, 19, "u2")]
    change, _ = change_of(*tasks, before=rows, later=[("a", 0, 1, "u1"), ("b", 0, 1, "u2")])
    assert change.least == (1, "a")


def drawn_change(rng):
    """The switch between a mode of 40 ms and one of 10 ms: each task has a unit of its mode, some a gap."""
    tasks, tables = [], []
    for name, period, longest in (("m", 40, 38), ("n", 10, 9)):
        jobs = []
        for unit in rng.sample(UNITS, rng.randint(1, 3)):
            wcet = rng.randint(1, longest)
            point, gap, start = rng.randint(1, wcet), rng.randint(1, 10), rng.randrange(period)
            is_cut = point < wcet and wcet + gap < period and rng.random() < 0.4
            begin = rng.randrange(wcet)
            bus = access("mem", begin, rng.randint(begin + 1, wcet), Fraction(1, rng.choice((3, 5))))
            made = replace(
                version("v", wcet, unit, *[bus][: not is_cut]), split=Split(points=(ms(point),)) if is_cut else WHOLE
            )
            tasks.append(task(f"{name}{unit}", period, made))
            spans = [(start, 0, point), (start + point + gap, point, wcet)] if is_cut else [(start, 0, wcet)]
            jobs.append(job_of(tasks[-1].name, 0, made, (unit,), [tuple(map(ms, span)) for span in spans], ()))
        tables.append(ModeSchedule(name=name, hyperperiod=ms(period), status=Status.VALID, jobs=tuple(jobs)))
    modes = [mode(name, [each for each in tasks if each.name[0] == name]) for name in "mn"]
    return Change(*on_common_grid(model(*tasks, units=" ".join(UNITS), resources="mem", modes=modes), *tables))


@pytest.mark.parametrize("seed", range(40))
def test_a_length_clashes_where_what_still_runs_is_in_the_way(seed):
    change = drawn_change(random.Random(seed))
    ms_, quanta = ms(1) // change.after.tick, change.after.quanta
    tail = [j.moved(-40 * ms_) for j in change.before.jobs if j.end > 40 * ms_]
    for length in range(0, 45 * ms_, ms_):
        line = list(tail)
        for later in (j.moved(length + 10 * ms_ * cycle) for cycle in range(5) for j in change.after.jobs):
            if not fits(line, later, quanta):
                break
            line.append(later)
        is_free = len(line) == len(tail) + 5 * len(change.after.jobs)
        assert (change.clash(length) is None) == is_free
        assert change.least[0] <= length or not is_free


@pytest.mark.parametrize(("slack", "most"), [(0, 10), ("1/4", 12)])
def test_paces_are_those_of_the_last_and_the_first_jobs(slack, most):
    a, b = plain_change(slack=slack).paces
    assert a == Pace("a", -2, 2, 1, most, 4)
    assert b == Pace("b", -15, -12, 16, 20, 3)


@pytest.mark.parametrize("origin", [Anchor.START, Anchor.END])
@pytest.mark.parametrize(("low", "high"), [(0, 4), (-7, 30), (18, 18), (5, 3), (-45, -20), (21, 43)])
def test_instants_of_both_modes_are_those_of_all_their_cycles(origin, low, high):
    change, length = plain_change(), 7
    own = 4 if origin is Anchor.END else 0
    past = [start + 20 * cycle + own for cycle in range(-9, 0) for start in (8, 18)]
    future = [start + 20 * cycle + own for cycle in range(9) for start in (1, 11)]
    window = Window("a", 0, 0, origin)
    assert change.has_past(window, low, high) == any(low <= at <= high for at in past)
    assert change.has_future(window, low, high) == any(low <= at <= high for at in future)
    expected = [at for at in (*past, *(at + length for at in future)) if low <= at <= high]
    assert sorted(change.instants(window, low, high, length)) == expected
    assert change.newest_before(window) == max(past)
    assert change.newest_before(Window("c", 0, 0)) is None
    assert change.instants(Window("c", 0, 0), low, high, length) == []


@pytest.mark.parametrize(
    "row",
    [
        after("a", 0, 5),
        after("a", 5, 5),
        after("a", 30, 36),
        after("a", 21, 23, "end"),
        after("a", 55, 60, "release"),
        replace(after("a", 8, 12), to=Anchor.END),
        replace(after("a", 30, 36, "point"), point=milliseconds(2)),
    ],
)
def test_windows_are_open_in_the_first_cycles_of_the_mode_that_no_job_of_it_meets(row):
    """b starts at 16 of every 20 ms, 3 ms before its end; a at 1 and 11, and is released then."""
    change = plain_change(row)
    shift = {Anchor.START: 0, Anchor.RELEASE: 0, Anchor.END: 4, Anchor.POINT: 2}[row.anchor]
    instants = [start + shift + 20 * cycle for cycle in range(12) for start in (1, 11)]
    reached = 3 if row.to is Anchor.END else 0
    low, high = (int(time / milliseconds(1)) for time in (row.min, row.max))
    expected = [
        start
        for start in range(16, 200, 20)
        if not any(low <= start + reached - instant <= high for instant in instants)
    ]
    assert [found.start for found, _ in change.open_windows] == expected


def test_a_window_of_the_same_cycle_is_open_for_jobs_of_the_cycle_before_only():
    row = replace(after("a", 0, 19), match=Match.CYCLE)
    assert plain_change(row).open_windows == []


@pytest.mark.parametrize(("start", "is_open"), [(12, False), (2, True)])
def test_a_job_of_the_cycle_before_has_its_predecessor_there(start, is_open):
    """b follows a, which starts at 5 of 20 ms; where b starts at 2, it does so in the next cycle."""
    row = replace(after("a", 0, 19), match=Match.CYCLE)
    tasks = [task("a", 20, version("v", 4), slack=1), task("b", 20, version("v", 3, "u2", row), slack=1, offset=3)]
    rows = [("a", 0, 5, "u1"), ("b", 0, start, "u2")]
    change, _ = change_of(*tasks, before=rows, later=rows)
    assert [(job.task, job.start) for job, _ in change.open_windows] == [("b", 2)] * is_open


def test_no_more_cycles_than_a_limit_are_looked_at_for_one_window():
    """The predecessor of b lies 3000 cycles back, so that in 3000 cycles it would be one of the mode before."""
    change = plain_change(after("a", 20 * 3000 + 5, 20 * 3000 + 5))
    assert [job.start for job, _ in change.open_windows] == [16 + 20 * n for n in range(MOST_CYCLES)]


def test_predecessors_lie_deeper():
    assert plain_change(after("a", 0, 9)).depth == {"a": 0, "b": 1}


def test_the_depth_of_a_task_is_that_of_its_longest_chain_of_predecessors():
    rows = {"a": "", "b": "a", "c": "b a", "d": "a"}
    tasks = [task(n, 20, version("v", 1, "u1", *[after(p, 0, 20) for p in rows[n].split()])) for n in rows]
    jobs = [(name, 0, start, "u1") for start, name in enumerate(rows)]
    assert change_of(*tasks, before=jobs, later=jobs)[0].depth == {"a": 0, "b": 1, "c": 2, "d": 1}


@pytest.mark.parametrize(("wcets", "distance", "deadline", "most"), [
    ([1], None, None, 8),  # the period and its slack
    ([1], 6, None, 5),  # the job takes 1 ms of the time between two arrivals
    ([1, 3], 6, None, 3),  # as long as the longest version
    ([1], 6, 4, 3),
    ([1], 6, 20, 6),
    ([1], 12, 20, 8),
    ([1], 2, None, 1),
    ([1, 4], 6, 4, 1),  # a version that is never over in time
])  # fmt: skip
def test_starts_of_a_task_that_serves_arrivals_are_as_far_apart_as_all_are_served_in_time(
    wcets, distance, deadline, most
):
    versions = [version(f"v{n}", wcet) for n, wcet in enumerate(wcets)]
    poll = replace(task("a", 4, *versions, slack=1, deadline=deadline), distance=ms(distance) if distance else None)
    change, _ = change_of(poll, before=[("a", 0, 0, "u1")], later=[("a", 0, 1, "u1")])
    [pace] = change.paces
    assert pace.most == change.most["a"] == most
    assert pace.shortest == min(wcets)


def test_versions_that_end_after_the_logical_execution_time_are_not_used():
    let = replace(task("a", 10, version("v", 4), version("w", 8)), let=ms(6))
    found, _ = change_of(let, before=[("a", 0, 0, "u1")], later=[("a", 0, 2, "u1")])
    assert [shape.version for shape in found.after.shapes["a"]] == ["v"]


def test_a_start_in_pace_is_apart_from_its_neighbours_and_not_too_far():
    """a starts at most 12 ms after the one before, and lasts 4."""
    change = plain_change(slack="1/4")
    table, [shape] = Table(change, 60), change.after.shapes["a"]
    for before, after_ in product((None, 0, 5), (None, 9, 20, 40)):
        pairs = ((number, start) for number, start in ((1, before), (3, after_)) if start is not None)
        table._paced = {("a", number): LineJob(start, "a", 0, shape, ("u1",)) for number, start in pairs}
        low, high = table._in_pace(_Wanted("a", 2, 30, "", number=2), shape)
        expected = [
            start
            for start in range(2, 31)
            if (before is None or before + 4 <= start <= before + 12)
            and (after_ is None or start + 4 <= after_ <= start + 12)
        ]
        assert [*range(low, high + 1)] == expected
        assert table._in_pace(_Wanted("a", 2, 30, ""), shape) == (2, 30)


LAG = {"start": 0, "end": 4, "release": 0}
"""How long after its start a job of a reaches what a window counts from."""


@pytest.mark.parametrize("anchor", LAG)
@pytest.mark.parametrize("least", [6, 9])
def test_a_job_of_a_table_without_a_predecessor_wants_one(anchor, least):
    """b follows a by up to 9 ms; before the switch a starts at 8 and 18 of 20 ms, after it at 1 and 11."""
    change = plain_change(after("a", least, 9, anchor))
    for length, earliest in product((3, 10, 25, 40), range(0, 40, 3)):
        instants = [start + LAG[anchor] for start in (-12, -2, *(length + 1 + 10 * n for n in range(6)))]
        latest = earliest + (0 if least == 9 else 2)
        low, high = earliest - 9, latest - least
        starts = [start for start in range(length) if low <= start + LAG[anchor] <= high]
        is_met = any(low <= instant <= high for instant in instants)
        expected = [] if is_met or not starts else [(starts[0], starts[-1], -2)]
        table, want = Table(change, length), _Wanted("b", earliest, latest, "", -2)
        for _ in range(2):
            table._want_predecessors_of(want)
            assert [(each.earliest, each.latest, each.order) for each in table._wanted.get("a", ())] == expected
        table._wanted["a"] = [_Wanted("a", 0, length, "")]
        table._want_predecessors_of(want)
        assert len(table._wanted["a"]) == 1 + len(expected)


@pytest.mark.parametrize("anchor", LAG)
@pytest.mark.parametrize("to", [Anchor.START, Anchor.END])
def test_a_job_of_a_table_may_start_where_all_its_windows_are_met(anchor, to):
    """b takes 3 ms; its last window counts from the job of a that starts with the table."""
    row = replace(after("a", 1, 5, anchor), to=to)
    change = plain_change(row)
    shape, reached = change.after.shapes["b"][0], 3 if to is Anchor.END else 0
    for length, latest, own in product((3, 25), (2, 20), (0, 6)):
        table = Table(change, length)
        table._placed["a"] = [LineJob(own, "a", 0, change.after.shapes["a"][0], ("u1",))]
        starts = [-12, -2, own, *(length + 1 + 10 * n for n in range(5))]
        expected = [
            start
            for start in range(latest + 1)
            if any(1 <= start + reached - other - LAG[anchor] <= 5 for other in starts)
        ]
        spans = table._allowed(_Wanted("b", 0, latest, ""), shape)
        assert sorted({start for low, high in spans for start in range(low, high + 1)}) == expected
        held = table._allowed(_Wanted("b", 0, latest, "", instants=[(3, 7, Window("c", 0, 0))]), shape)
        assert sorted({s for low, high in held for s in range(low, high + 1)}) == [s for s in expected if 3 <= s <= 7]


def test_lengths_to_try_are_those_at_which_something_changes_and_an_even_grid():
    """b follows a by 30 to 36 ms: the job of a 2 ms before the switch, where the table has 12 to 18 ms."""
    change, least, last = plain_change(after("a", 30, 36)), 1, 4000
    lengths = range(least, last + 1)
    expected = {*range(least, last + 1, 9), 12, 18}  # of the range, a part in 400
    for pace in change.paces:
        expected.update([n for n in lengths if (pace.first + n - pace.last) % pace.most == 0][:2])
        expected.update(n for n in lengths if pace.first + n in (pace.shortest * k for k in (1, 2, 3)))
    assert change.tail[0].end - change.after.jobs[0].start in expected

    def found(limit):
        return _lengths(Transition(source="m", target="n", max_length=limit), change)

    assert found(ms(last)) == sorted(expected)
    assert found(ms(0)) == [0]
    assert found(None) == [*range(1, 20 + 20 + 4 + 1)]
