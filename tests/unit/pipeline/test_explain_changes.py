"""Changes of models that remedies try: each touches what it names, and by how much."""

from dataclasses import replace
from fractions import Fraction

from split_helpers import points, split

from halpipe.models import Split
from halpipe.pipeline.explain import changes
from support import access, after, chain, model, ms, task, version

CUT = split(version("v", 12, "u1", access("r", 2, 5), access("r", 8, 10)), points(2, 8, resume=ms(1), max_gaps=1))
FREE = split(version("v", 8), Split(anywhere=True, max_gaps=2, min_part=ms(2)))
SYSTEM = model(
    task("a", 20, CUT, version("w", 6), slack="1/4", deadline=18),
    task("b", 20, FREE, slack="1/2", offset=3),
    task("c", None, version("v", None, "u1", after("a", 1, 4), after("b", 2, 5))),
    resources="r",
    chains=[chain("k", "a b", 50, 40), chain("l", "b a", 60)],
)


def own(system, name):
    return system.task(name).versions[0]


def others_are_the_same(system, *names):
    return all(task == SYSTEM.task(task.name) for task in system.tasks if task.name not in names)


def test_slack_is_raised_and_never_lowered():
    found = changes.with_slack(SYSTEM, ["a", "b", "c"], Fraction(1, 3))
    assert [task.slack for task in found.tasks] == [Fraction(1, 3), Fraction(1, 2), 0]
    assert others_are_the_same(changes.with_slack(SYSTEM, ["a"], Fraction(1)), "a")


def test_a_shorter_wcet_shortens_phases_and_pieces_with_it():
    found = changes.with_wcet(SYSTEM, ["a", "c"], Fraction(1, 2))
    assert [each.wcet for each in found.task("a").versions] == [ms(6), ms(3)]
    assert [(a.start, a.end) for a in own(found, "a").accesses] == [(ms(1), ms("2.5ms")), (ms(4), ms(5))]
    assert own(found, "a").split.points == (ms(1), ms(4))
    assert others_are_the_same(found, "a")
    least = changes.with_wcet(SYSTEM, ["b"], Fraction(3, 4))
    assert (own(least, "b").wcet, own(least, "b").split.min_part) == (ms(6), ms("1.5ms"))


def test_a_shorter_wcet_is_a_multiple_of_the_grid_or_less_than_one():
    found = changes.with_wcet(SYSTEM, ["a"], Fraction(3, 4), ms(2))
    assert [each.wcet for each in found.task("a").versions] == [ms(8), ms(4)]
    assert own(found, "a").accesses[0].end == ms(5) * Fraction(8, 12)
    exactly = changes.with_wcet(SYSTEM, ["a"], Fraction(1, 2), ms(6))
    assert [each.wcet for each in exactly.task("a").versions] == [ms(6), ms(3)]


def test_pieces_are_equal_beside_phases_and_the_points_that_there_are():
    found = changes.with_pieces(SYSTEM, ["a", "b", "c"], 4)
    assert own(found, "a").split.points == (ms(2), ms(6), ms(8))  # 3 and 9 ms lie within phases
    assert found.task("a").versions[1].split.points == (ms("1.5ms"), ms(3), ms("4.5ms"))
    assert own(found, "a").split.max_gaps is None
    assert others_are_the_same(found, "a")


def test_preemptions_windows_limits_and_fields_change_where_they_are_named():
    more = changes.with_more_gaps(SYSTEM, "b", 3)
    assert own(more, "b").split.max_gaps == 5
    assert others_are_the_same(more, "b")
    unlimited = replace(SYSTEM, tasks=(replace(SYSTEM.tasks[0], versions=(version("v", 2),)), *SYSTEM.tasks[1:]))
    assert changes.with_more_gaps(unlimited, "a", 1) == unlimited
    wide = changes.with_window(SYSTEM, "c", "a", lambda row: replace(row, max=ms(9)))
    assert [(row.task, row.max) for row in own(wide, "c").precedences] == [("a", ms(9)), ("b", ms(5))]
    late = changes.with_limits(SYSTEM, "k", {"max_age": ms(45)})
    assert [(c.max_reaction, c.max_age) for c in late.chains] == [(ms(50), ms(45)), (ms(60), None)]
    moved = changes.with_task(SYSTEM, ["b"], offset=None)
    assert moved.task("b").offset is None
    assert others_are_the_same(moved, "b")


def test_more_units_are_like_the_one_that_is_named():
    found = changes.more_units(SYSTEM, "u1", 2)
    assert [unit.name for unit in found.units] == ["u1", "u1+1", "u1+2"]
    assert all(each.units == ("u1", "u1+1", "u1+2") for task in found.tasks for each in task.versions)
    assert [unit.name for unit in changes.more_units(found, "u1+1", 1).units][3:] == ["u1+1+1"]


def test_pieces_begin_and_end_with_access_phases_and_cut_none():
    """Cut into four, a job of 8 ms has pieces of 2 ms, but for where a phase from 2 to 4 or from 5 to 7 ms is cut."""
    phases = access("r", 2, 4), access("r", 5, 7)
    system = model(task("a", 20, version("v", 8, "u1", *phases)), resources="r")
    split = changes.with_pieces(system, ["a"], 4).tasks[0].versions[0].split
    assert split.points == (ms(2), ms(4))
