"""Proofs where jobs may pause or are interrupted (MODEL 8): none that is false, and the split that helps."""

from dataclasses import replace

import pytest

from halpipe.models import Binding, Interrupt, Split
from halpipe.pipeline.explain.explanation import explain
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.parts import has_whole_jobs
from support import access, after, model, ms, task, version


def split(owner, **fields):
    """The task with every version split."""
    return replace(owner, versions=tuple(replace(v, split=Split(**fields)) for v in owner.versions))


def interrupted(system, distance, wcet):
    """The model with an interrupt on every unit."""
    served = (Interrupt(name="i", distance=ms(distance), wcet=ms(wcet)),)
    return replace(system, units=tuple(replace(unit, interrupts=served) for unit in system.units))


def witnesses(system):
    return [w.diagnostic for hopeless in find_witnesses(system) for w in hopeless.witnesses]


def no_gap(system):
    return [w for w in witnesses(system) if w.code == "HAL0431"]


SHORT = task("short", 4, version("v", 1))
LONG = task("long", 12, version("v", 4))


def test_two_tasks_exclude_each_other_until_the_longer_is_split():
    (found,) = no_gap(model(SHORT, LONG))
    assert found.code == "HAL0431"
    assert '"long" cut into pieces of at most 3ms (split)' in found.help
    pieces = split(LONG, points=(ms(1), ms(4) - ms(1)))
    assert not witnesses(model(SHORT, pieces))
    assert not witnesses(model(SHORT, split(LONG, anywhere=True, max_gaps=1)))


def test_a_piece_that_is_too_long_excludes_it_still():
    (found,) = no_gap(model(SHORT, split(LONG, points=(ms("0.5ms"),))))
    assert "needs 3.5ms in one go" in found.message
    assert "500us less in one piece" in found.help


def test_no_gap_allowed_is_no_split():
    (found,) = no_gap(model(SHORT, split(LONG, anywhere=True, max_gaps=0)))
    assert "needs 4ms" in found.message


def test_few_gaps_leave_a_long_part_somewhere():
    assert witnesses(model(SHORT, split(task("long", 24, version("v", 10)), anywhere=True, max_gaps=2)))
    assert not witnesses(model(SHORT, split(task("long", 24, version("v", 10)), anywhere=True, max_gaps=3)))


def test_an_access_phase_is_not_cut():
    long = task("long", 12, version("v", 4, "u1", access("mem", 0, 4)))
    (found,) = no_gap(model(SHORT, long, resources="mem"))
    assert "cut into pieces" not in found.help
    (found,) = no_gap(model(SHORT, split(long, anywhere=True, max_gaps=3), resources="mem"))
    assert "needs 4ms in one go" in found.message


def test_interrupts_make_the_gap_shorter_and_the_piece_longer():
    system = model(SHORT, split(task("long", 12, version("v", 4)), points=(ms(2),)))
    assert not witnesses(system)
    served = interrupted(system, 12, "0.6ms")  # the gap is 4 - 1.6, a piece needs 2.6
    (found,) = no_gap(served)
    assert "needs 2.6ms in one go" in found.message
    assert "leave at most 2.4ms free" in found.message
    assert "cut into pieces of at most 1.8ms" in found.help


@pytest.mark.parametrize("others", [(4, 6), (6, 9)])
def test_tasks_that_pause_need_not_meet(others):
    first = task("a", others[0], version("v", 2))
    second = task("b", others[1], version("v", 2))
    third = split(task("c", 12, version("v", 4)), points=(ms(1), ms(2), ms(3)))
    meeting = [w for w in witnesses(model(first, second, third)) if '"c"' in w.message]
    assert not meeting


def test_a_crowd_of_pausing_tasks_is_none():
    tasks = [task(f"t{n}", 12, version("v", 10, "u1 u2")) for n in range(3)]
    assert witnesses(model(*tasks, units="u1 u2"))
    pausing = [split(t, anywhere=True, max_gaps=5) for t in tasks]
    assert not witnesses(model(*pausing, units="u1 u2"))


def test_phases_of_pausing_tasks_need_not_meet():
    def system(change):
        first = task("a", 4, version("v", 2, "u1", access("mem", 0, 2)))
        second = task("b", 6, version("v", 4, "u2", access("mem", 2, 4)))
        return model(first, change(second), units="u1 u2", resources="mem")

    assert [w.code for w in witnesses(system(lambda t: t))] == ["HAL0432"]
    assert not witnesses(system(lambda t: split(t, points=(ms(1), ms(2)))))


def test_a_window_after_the_end_knows_that_gaps_make_jobs_last_longer():
    def system(change):
        first = change(task("a", 12, version("v", 4), offset=0))
        return model(first, task("b", 12, version("v", 1, "u2", after("a", 0, 1, "end")), offset=7), units="u1 u2")

    assert [w.code for w in witnesses(system(lambda t: t))] == ["HAL0434"]
    assert not witnesses(system(lambda t: split(t, points=(ms(2),))))


def test_a_window_after_the_end_counts_interrupts():
    first = task("a", 12, version("v", 4), offset=0)
    system = model(first, task("b", 12, version("v", 1, "u2", after("a", 0, 1, "end")), offset=6), units="u1 u2")
    assert [w.code for w in witnesses(system)] == ["HAL0434"]
    assert not witnesses(interrupted(system, 12, 1))


def test_the_exact_engine_is_asked_about_whole_jobs_alone():
    system = model(SHORT, LONG)
    assert has_whole_jobs(system)
    assert not has_whole_jobs(interrupted(system, 12, 1))
    assert not has_whole_jobs(model(SHORT, split(LONG, points=(ms(1),))))
    assert not has_whole_jobs(model(SHORT, replace(LONG, binding=Binding.SYSTEM)))
    assert not has_whole_jobs(model(SHORT, replace(LONG, distance=ms(20))))


def test_the_split_that_was_found_sufficient_is_named():
    """Of 4 ms, pieces of 2 ms fit where jobs of 1 ms come every 4 ms."""
    system = model(task("short", 4, version("v", 1)), task("long", 12, version("v", 4), slack=1))
    found = explain(system, budget=50)
    remedies = [d.message for d in found.diagnostics if d.code == "HAL0436"]
    assert any(text.startswith('"long" cut into pieces of at most 2ms (split) (found suff') for text in remedies), (
        remedies
    )


def test_a_split_list_gets_the_points_that_it_lacks():
    long = split(task("long", 12, version("v", 5), slack=1), points=(ms("0.5ms"),))
    found = explain(model(task("short", 4, version("v", 1)), long), budget=50)
    assert [d.code for d in found.diagnostics if d.is_error] == ["HAL0431"]
    remedies = [d.message for d in found.diagnostics if d.code == "HAL0436"]
    assert any(text.startswith('"long" cut into pieces of at most 2.5ms (split)') for text in remedies), remedies
