"""Modes of preemptive jobs in ticks: deadlines, options, phases and windows, each rounded to the safe side."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, points, split

from halpipe.models import Anchor, Mode, Run, Split
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.edf.works import Phase, Window, load_of, works_of
from support import access, after, model, ms, task, version

ONE = Fraction(1)


def works(owner, tick=1, growth=ONE):
    return works_of(owner, expand(owner, owner.modes[0]), ms(tick), growth).works


def work(made, tick=1, **more):
    return works(model(made, task("other", 20, version(), **more)), tick)[0]


def facts(found):
    return found.phase, found.latest, found.deadline, found.slip, found.arrivals


# ------------------------------------------------------------------------------------------------ releases


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, (None, 0, 10, 0, None)),
        ({"slack": Fraction(1, 2)}, (None, 5, 10, 5, None)),
        ({"slack": Fraction(1)}, (None, 9, 10, 9, None)),  # never a whole period
        ({"slack": Fraction(1, 3)}, (None, 3, 10, 3, None)),
        ({"deadline": ms("6.5ms")}, (None, 0, 6, 0, None)),
        ({"offset": ms(13)}, (3, 0, 10, 0, None)),
        ({"let": ms(4)}, (None, 0, 4, 0, None)),
        ({"let": ms(4), "deadline": ms(3)}, (None, 0, 3, 0, None)),
        ({"distance": ms(12), "slack": Fraction(1, 2)}, (None, 2, 2, 5, (12, 12))),
        ({"distance": ms(18), "slack": Fraction(1, 2), "deadline": ms(25)}, (None, 5, 15, 5, (18, 25))),
    ],
)
def test_a_job_is_late_after_its_slack_its_deadline_or_what_its_arrivals_leave(changes, expected):
    assert facts(work(replace(task("a", 10, version("v", 2)), **changes))) == expected


def test_a_lone_job_from_whose_release_another_counts_starts_there():
    row = replace(after("a", 0, 30), anchor=Anchor.RELEASE)
    owner = model(task("a", 20, version(), slack=1), task("b", 20, version("v", 1, "u1", row), slack=1))
    assert [facts(each)[1:4:2] for each in works(owner)] == [(0, 0), (19, 19)]


def test_a_coarse_tick_rounds_deadlines_down():
    found = work(task("a", 8, version("v", "2.5ms"), slack="3/8", deadline=7), tick=2)
    assert (found.period, found.jobs) == (4, 5)
    assert facts(found) == (None, 1, 3, 1, None)
    assert found.ways[0].wcet == 2


def test_a_job_on_demand_has_the_hyperperiod():
    asks = version("v", 1, "u1", after("h", 1, 5), after("h", 2, 6))
    owner = model(task("h", None, version()), task("a", 10, asks), task("b", 20, version()))
    found = works(owner)[0]
    assert (found.period, found.is_cyclic, found.demands) == (20, False, ((1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1)))


# ------------------------------------------------------------------------------------------------ options


def test_a_gang_has_an_option_for_each_set_of_its_units():
    found = works(model(task("a", 10, version("v", 1, "u1 u3 u2", gang=2), version("w", 1, "u2")), units="u1 u2 u3"))
    assert [(way.version.name, way.units) for way in found[0].ways] == [
        ("v", (0, 2)),
        ("v", (0, 1)),
        ("v", (2, 1)),
        ("w", (1,)),
    ]


@pytest.mark.parametrize(
    ("rows", "units"),
    [
        ([], [0, 1]),
        ([(2, 1)], [0, 1]),
        ([("0.9ms", "0.1ms")], [0]),  # more often than every tick
        ([(2, "0.6ms"), (2, "0.6ms")], [0]),  # each is a whole tick, of two
    ],
)
def test_a_unit_whose_interrupts_may_fill_it_in_ticks_is_no_option(rows, units):
    owner = interrupts(model(task("a", 10, version("v", 1, "u1 u2")), units="u1 u2"), "u2", *rows)
    assert [way.units[0] for way in works(owner)[0].ways] == units


def test_interrupts_lengthen_what_is_reserved():
    owner = interrupts(model(task("a", 20, version("v", 3, "u1 u2"))), "u1", (4, 1))
    [way] = works(replace(owner, tasks=(task("a", 20, version("v", 3, "u1")),)))[0].ways
    assert (way.wcet, way.length, way.service) == (3, 4, ((4, 1),))


def test_versions_whose_windows_are_closed_or_whose_predecessors_do_not_run_are_no_options():
    narrow, just = after("b", "1.2ms", "1.8ms"), after("b", 1, 1)
    tasks = (
        task(
            "a", 20, version("v", 1, "u1", narrow), version("w", 1, "u1", just), version("x", 1, "u1", after("c", 0, 9))
        ),
        task("b", 20, version()),
        task("c", 20, version()),
    )
    runs = (Run(task="a", versions=("v", "w", "x")), Run(task="b", versions=("v",)))
    found = works(model(*tasks, modes=[Mode(name="all", runs=runs)]))
    assert [way.version.name for way in found[0].ways] == ["w"]


@pytest.mark.parametrize("anchor", [Anchor.START, Anchor.END, Anchor.RELEASE])
def test_whatever_a_window_counts_from_its_task_has_to_run(anchor):
    row = replace(after("c", 0, 9), anchor=anchor)
    tasks = task("a", 20, version("v", 1, "u1", row), version("w")), task("c", 20, version())
    found = works(model(*tasks, modes=[Mode(name="all", runs=(Run(task="a", versions=("v", "w")),))]))
    assert [way.version.name for way in found[0].ways] == ["w"]


# ------------------------------------------------------------------------------------------------ pieces and phases


def way_of(made, growth=ONE, tick=1, resources="r", **more):
    [found] = works(model(task("a", 40, made, slack=1), resources=resources, **more), tick, growth)[0].ways
    return found


def test_pieces_are_rounded_up_and_resumptions_with_them():
    found = way_of(split(version("v", "6.5ms"), points("2.2ms", 4, resume=ms("0.3ms"), max_gaps=1)))
    assert (found.ends, found.wcet, found.resume, found.max_gaps, found.anywhere) == ((3, 5, 8), 8, 1, 1, False)
    assert [str(bound) for bound in found.bounds] == ["0ms", "2.2ms", "4ms", "6.5ms"]


def test_only_what_may_be_split_has_gaps():
    assert way_of(version("v", 4)).max_gaps == 0
    assert way_of(split(version("v", 4), points(2))).max_gaps >= 10**6


@pytest.mark.parametrize(("shortest", "growth", "expected"), [(None, 1, 1), (2, 1, 2), (2, 2, 5), (None, 2, 3)])
def test_a_part_that_is_shortened_again_stays_as_long_as_it_has_to_be(shortest, growth, expected):
    """A tick more than its share of what grows, for what is rounded down when it is cut."""
    how = Split(anywhere=True, max_gaps=2, min_part=ms(shortest))
    assert way_of(split(version("v", 8), how), Fraction(growth)).min_part == expected


def test_what_grows_anywhere_grows_by_as_much_as_its_rounded_length_has():
    """4.5 ms a third longer are 6 ms, but 6.3 ms at 7/5: in ticks 7, so that a resumption takes 2 ms * 14/9."""
    how = Split(anywhere=True, max_gaps=1, resume=ms("2.1ms"))
    found = way_of(split(version("v", "4.5ms", "u1", access("r", 0, "1.8ms")), how), Fraction(7, 5))
    assert (found.wcet, found.resume) == (7, 4)  # 2.1 ms * 14/9 are 3.27 ms; 7/5 of them would be 2.94
    assert [(phase.begin, phase.end) for phase in found.phases] == [(0, 3)]
    fixed = way_of(split(version("v", "4.5ms"), points(2, resume=ms("2.1ms"))), Fraction(7, 5))
    assert (fixed.wcet, fixed.resume) == (3 + 4, 3)


@pytest.mark.parametrize(
    ("growth", "tick", "expected"),
    [
        (1, 1, [(0, 2, 6, 1), (0, 8, 10, 2)]),
        (Fraction(3, 2), 1, [(0, 3, 9, 1), (0, 12, 15, 2)]),
        (Fraction(4, 3), 1, [(0, 3, 8, 1), (0, 11, 14, 2)]),  # 2.67 to 8, and 8 + (8 - 6) * 4/3 = 10.67 to 13.33
        (1, 4, [(0, 0, 2, 1), (0, 2, 3, 2)]),
    ],
)
def test_phases_count_from_where_their_piece_begins(growth, tick, expected):
    """From 2 to 6 ms and from 8 to 10 ms, of a version that may be split at 6 ms; a half is two quarters."""
    wants = access("r", 2, 6, "1/4"), access("r", 8, 10, "1/2")
    found = way_of(split(version("v", 12, "u1", *wants), points(6)), Fraction(growth), tick)
    assert [*found.phases] == [Phase(*row) for row in expected]


def test_a_phase_that_would_vanish_takes_a_tick():
    """Half as long again, it begins in the last tick of its piece, and would end there."""
    how = Split(points=(ms(5),))
    found = way_of(split(version("v", 8, "u1", access("r", "1.1ms", "1.3ms")), how), Fraction(3, 2))
    assert [(phase.begin, phase.end) for phase in found.phases] == [(2, 3)]


# ------------------------------------------------------------------------------------------------ windows


def window(row, growth=ONE, before=None, tick=1):
    """The window of a task of 2 ms with a task of 3 ms before it, whose slack is 5 ms."""
    before = before or task("p", 20, version("v", 3), slack="1/4")
    owner = model(task("z", 20, version()), before, task("q", 20, version("v", 2, "u1", row), slack=1))
    [found] = works(owner, tick, growth)[2].ways[0].windows
    return found


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (after("p", 2, 6), (1, 2, 6, False, False)),
        (after("p", "1.5ms", "6.5ms"), (1, 2, 6, False, False)),
        (after("p", 2, 6, "end"), (1, 2, 6, True, False)),
        (replace(after("p", 3, 6), to=Anchor.END), (1, 1, 4, False, True)),
        (replace(after("p", 1, 6, "end"), to=Anchor.END), (1, 0, 4, True, True)),
        (replace(after("p", 2, 9), anchor=Anchor.RELEASE), (1, 2, 4, False, True)),
        (replace(after("p", 2, 7), anchor=Anchor.RELEASE), (1, 2, 2, False, True)),
        (replace(after("p", 2, 6), anchor=Anchor.RELEASE), (1, 0, 20, False, True)),  # no start is certain to hold
        (replace(after("p", 2, 6), anchor=Anchor.POINT, point=ms(1)), (1, 3, 7, False, True)),
        (replace(after("p", 2, 6), anchor=Anchor.POINT, point=ms(1), to=Anchor.END), (1, 1, 5, False, True)),
        (replace(after("z", 2, 6), anchor=Anchor.RELEASE), (0, 2, 6, False, True)),
    ],
)
def test_windows_between_starts_and_ends_and_aims_of_others(row, expected):
    assert window(row) == Window(*expected)


def test_an_end_may_come_earlier_than_the_grid_shows():
    """By a tick where a piece or a resumption is rounded, and by all that was added to the longest version."""
    row = after("p", 2, 9, "end")
    rounded = split(version("v", 6), points("2.5ms"))
    assert window(row, before=task("p", 20, version("v", "2.5ms"), version("w", 3))).most == 8
    assert window(row, before=task("p", 20, rounded)).most == 8
    assert window(row, before=task("p", 20, split(version("v", 6), points(2, resume=ms("0.5ms"))))).most == 8
    assert window(row, before=task("p", 20, version("v", 3))).most == 9
    versions = version("v", 3), split(version("w", 4), points(2, resume=ms(2))), version("x", 2)
    assert window(row, Fraction(3, 2), before=task("p", 20, *versions)).most == 9 - 3
    assert window(after("z", 2, 9, "end"), Fraction(3, 2)).most == 9 - 1


def test_the_load_of_a_task_is_what_its_jobs_reserve_of_the_hyperperiod():
    owner = interrupts(model(task("a", 10, version("v", 3)), task("b", 20, version())), "u1", (20, 1))
    found = works(owner)[0]
    assert load_of(found, found.ways[0], 20) == Fraction(2 * 4, 20)
