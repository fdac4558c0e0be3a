"""Tables between modes whose jobs have gaps, are bound to units or interrupted (MODEL 8.2, transitions)."""

from dataclasses import replace
from itertools import combinations, pairwise

import pytest

from halpipe.models import Binding, Interrupt, ModeSchedule, Schedule, Split, Status
from halpipe.pipeline.measure.placement import PlacedPart
from halpipe.pipeline.parts import job_of
from halpipe.pipeline.transitions.line import Line, LineJob, Shape
from halpipe.pipeline.transitions.tables import switch_tables
from support import job, mode, model, ms, task, version


def shape(name, *busy, units="u1"):
    """A shape of parts [start, end); one alone is a job in one piece."""
    parts = tuple(PlacedPart(start, end, start, end) for start, end in busy) if len(busy) > 1 else ()
    return Shape(name, "v", busy[-1][1], tuple(units.split()), 1, (), parts)


def test_a_job_in_one_piece_fits_into_a_gap():
    line = Line(1)
    line.enter(LineJob(0, "a", 0, shape("a", (0, 4), (10, 14)), ("u1",)))
    assert line.first_fit(shape("b", (0, 6)), 0, 50) == (4, ("u1",))
    assert line.first_fit(shape("b", (0, 7)), 0, 50) == (14, ("u1",))


def test_jobs_with_gaps_nest_or_stay_apart():
    line = Line(1)
    line.enter(LineJob(20, "a", 0, shape("a", (0, 4), (10, 14)), ("u1",)))
    assert line.first_fit(shape("b", (0, 2), (4, 6)), 20, 50) == (24, ("u1",))
    assert line.first_fit(shape("b", (0, 2), (10, 12)), 20, 50) == (34, ("u1",))  # free from 24 on, but it would cross
    assert line.first_fit(shape("b", (0, 2), (14, 16)), 6, 50) == (34, ("u1",))  # free from 10 on
    assert line.first_fit(shape("b", (0, 2), (16, 18)), 18, 50) == (18, ("u1",))  # a lies in the gap of b


def test_a_job_clashes_where_it_crosses():
    line = Line(1)
    line.enter(LineJob(0, "a", 0, shape("a", (0, 4), (10, 14)), ("u1",)))
    crossing = shape("b", (0, 2), (10, 12))
    assert line.clashes(LineJob(4, "b", 0, crossing, ("u1",)))
    assert not line.clashes(LineJob(4, "b", 0, crossing, ("u2",)))
    assert not line.clashes(LineJob(14, "b", 0, crossing, ("u1",)))


def long_and_short(slack=1):
    """A long job, cut by those of a short task of which it may not take the place, in both of two modes."""
    split = Split(points=tuple(ms(n) for n in range(2, 12, 2)))
    tasks = [
        task("short", 4, version("v", 1), slack=slack),
        task("long", 24, replace(version("v", 12), split=split), slack=slack),
        task("other", 24, version("v", 1)),
    ]
    return model(*tasks, modes=[mode("before", tasks[:2]), mode("after", tasks)])


def table_of(system, name, shift, *others):
    """Short jobs every 4 ms, at the phase `shift`; between them the long one, two milliseconds at a time."""
    shorts = [job(system, "short", n, (shift + 4 * n) % 24, "u1") for n in range(6)]
    begin = (shift + 1 + 8) % 24
    spans = [(ms(begin + 4 * n), ms(2 * n), ms(2 * n + 2)) for n in range(6)]
    long = job_of("long", 0, system.task("long").versions[0], ("u1",), spans, ())
    return ModeSchedule(name=name, hyperperiod=ms(24), status=Status.VALID, jobs=(*shorts, long, *others))


def line_of(plan, table):
    """Every job on the line around a switch as task and parts, in nanoseconds."""
    before, after = plan.modes
    for cycle in (-2, -1):
        yield from ((j, shifted(j, before.hyperperiod.ns * cycle)) for j in before.jobs)
    yield from ((j, shifted(j, 0)) for j in table.jobs)
    for cycle in (0, 1):
        yield from ((j, shifted(j, table.length.ns + after.hyperperiod.ns * cycle)) for j in after.jobs)


def shifted(found, by):
    return [(begin.ns + by, end.ns + by) for begin, end in found.occupations()]


def is_sound(_model, plan, table):
    """Decide exclusive, nested, and that no task starves or meets itself: by comparing all with all."""
    line = list(line_of(plan, table))
    for (one, first), (two, second) in combinations(line, 2):
        if set(one.units) & set(two.units):
            assert all(a[1] <= b[0] or b[1] <= a[0] for a in first for b in second)
            assert is_apart(first, second) or is_inside(first, second) or is_inside(second, first)
        if one.task == two.task:
            assert is_apart(first, second)
    for name, most in (("short", 8), ("long", 48)):
        starts = sorted(parts[0][0] for j, parts in line if j.task == name)
        assert all(later - earlier <= ms(most).ns for earlier, later in pairwise(starts))
    return True


def is_apart(first, second):
    return first[-1][1] <= second[0][0] or second[-1][1] <= first[0][0]


def is_inside(inner, outer):
    return any(a[1] <= inner[0][0] and inner[-1][1] <= b[0] for a, b in pairwise(outer))


@pytest.mark.parametrize("shift", [0, 1, 2, 3])
def test_jobs_in_progress_keep_their_parts_across_the_switch(shift):
    system = long_and_short()
    other = job(system, "other", 0, shift + 3, "u1")
    plan = Schedule(
        model="m",
        model_sha256="",
        modes=(table_of(system, "before", 2), table_of(system, "after", shift, other)),
    )
    assert plan.modes[0].jobs[-1].end > ms(24)  # still in progress when the mode is switched
    found = switch_tables(replace(system, transitions=()), plan, is_sound)
    assert ("before", "after") in {(t.source, t.target) for t in found.tables}, found.diagnostics


def test_a_bound_task_stays_on_its_unit_in_tables():
    work = replace(task("work", 10, version("v", 6, "u1 u2"), slack=0), binding=Binding.MODE)
    other = task("other", 10, version("v", 6, "u1"))
    modes = [mode("before", [work, other]), mode("after", [work])]
    system = model(work, other, units="u1 u2", modes=modes, transitions=[("before", "after", 40)])

    def plan(binding):
        bound = replace(system, tasks=(replace(work, binding=binding), other))
        jobs = job(bound, "work", 0, 2, "u2"), job(bound, "other", 0, 6, "u1")
        before = ModeSchedule(name="before", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
        start = job(bound, "work", 0, 8, "u1")
        after = ModeSchedule(name="after", hyperperiod=ms(10), status=Status.VALID, jobs=(start,))
        return bound, Schedule(model="m", model_sha256="", modes=(before, after))

    for binding, units in ((Binding.JOB, {"u1", "u2"}), (Binding.MODE, {"u1"})):
        used = set()
        bound, tables = plan(binding)

        def keep(_model, _plan, table, used=used):
            used.update(unit for j in table.jobs for unit in j.units)
            return False  # so that every length is tried

        switch_tables(bound, tables, keep)
        assert used <= units


def test_tables_reserve_time_for_interrupts():
    system = model(task("work", 20, version("v", 8), slack=1), modes=None)
    two = replace(system, modes=(replace(system.modes[0], name="a"), replace(system.modes[0], name="b")))
    unit = replace(two.units[0], interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(2)),))
    interrupted = replace(two, units=(unit,))
    spans = [(ms(0), ms(0), ms(8))]
    first = job_of("work", 0, interrupted.tasks[0].versions[0], ("u1",), spans, ((ms(10), ms(2)),))
    assert first.end == ms(10)
    last = replace(first, start=ms(15), end=ms(25))
    before, after = (
        ModeSchedule(name=name, hyperperiod=ms(20), status=Status.VALID, jobs=(placed,))
        for name, placed in (("a", last), ("b", first))
    )
    tables = switch_tables(interrupted, Schedule(model="m", model_sha256="", modes=(before, after)), lambda *_: True)
    assert [(t.source, t.target, t.length) for t in tables.tables][:1] == [("a", "b", ms(5))]
    plan = Schedule(model="m", model_sha256="", modes=(replace(before, jobs=(first,)), replace(after, jobs=(last,))))
    assert all(
        j.end == j.start + ms(10) for t in switch_tables(interrupted, plan, lambda *_: True).tables for j in t.jobs
    )


def test_arrivals_are_served_across_the_switch():
    """A poll 4 ms before the switch, the next 6 ms after the mode begins: 10 ms apart suits the slack, not arrivals."""

    def length(distance):
        poll = replace(task("poll", 8, version("v", 1), slack=1), distance=ms(distance) if distance else None)
        system = model(poll)
        system = replace(system, modes=tuple(replace(system.modes[0], name=name) for name in "ab"))
        before, after = (
            ModeSchedule(name=n, hyperperiod=ms(8), status=Status.VALID, jobs=(job(system, "poll", 0, start, "u1"),))
            for n, start in (("a", 4), ("b", 6))
        )
        plan = Schedule(model="m", model_sha256="", modes=(before, after))
        found = switch_tables(system, plan, lambda *_: True)
        return {(t.source, t.target): (t.length, len(t.jobs)) for t in found.tables}.get(("a", "b"))

    assert length(None) == (ms(0), 0)
    assert length(11) == (ms(0), 0)  # 10 from start to start, and 1 to the end
    assert length("10.9ms") != (ms(0), 0)


def test_a_table_has_jobs_with_gaps_where_no_whole_one_fits():
    """`brief` leaves 2 ms in every 5, and begins 2 ms later in the other mode: a table of 8 ms."""
    long = replace(version("v", 4), split=Split(points=(ms(2),)))
    tasks = [task("long", 20, long), task("brief", 5, version("v", 3))]
    system = model(*tasks, modes=[mode("one", tasks), mode("two", tasks)], transitions=[("one", "two", None)])
    spans = {"one": ((3, 0, 2), (8, 2, 4)), "two": ((5, 0, 2), (10, 2, 4))}
    modes = [
        ModeSchedule(
            name=name,
            hyperperiod=ms(20),
            status=Status.VALID,
            jobs=(
                job_of("long", 0, long, ("u1",), [tuple(map(ms, span)) for span in spans[name]], ()),
                *(job(system, "brief", n, first + 5 * n, "u1") for n in range(4)),
            ),
        )
        for name, first in (("one", 0), ("two", 2))
    ]
    plan = Schedule(model=system.name, model_sha256="", modes=tuple(modes))
    [table] = switch_tables(system, plan, lambda *_: True).tables
    assert table.length == ms(8)
    placed = {each.task: each for each in table.jobs if each.task == "long"}
    assert [(part.start, part.end) for part in placed["long"].parts] == [(ms(3), ms(5)), (ms(8), ms(10))]
    assert [each.start for each in table.jobs if each.task == "brief"] == [ms(0), ms(5)]
