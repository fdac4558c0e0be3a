"""Where a search finds nothing in a small mode, the exact engine is asked, and what it finds is said to be its own."""

import pytest

from halpipe.models import Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve import exact_member, schedule
from halpipe.pipeline.solve.schedule import UNBOUNDED, SearchOptions
from halpipe.pipeline.verify import verify
from support import mode, model, task, version

pytest.importorskip("ortools", reason="halpipe[exact] is not installed")

LENGTHS = (17, 23, 29, 31, 37, 41, 22)
UNITS = "u1 u2"


def perfect_fit(modes=None):
    """Seven tasks fill two units to the last millisecond: 41 + 37 + 22 and the rest."""
    tasks = [task(f"t{number}", 100, version("v", wcet, UNITS)) for number, wcet in enumerate(LENGTHS)]
    return model(*tasks, units=UNITS, modes=modes and modes(tasks))


@pytest.fixture
def few_moves(monkeypatch):
    """Let every search end before it has found anything."""
    monkeypatch.setattr(schedule, "LEAST_MOVES", 8)
    monkeypatch.setattr(schedule, "DEFAULT_BUDGET", 1)


def go_on(*progress):
    return True


def test_the_exact_engine_finds_what_the_search_has_not(few_moves):
    found = schedule_model(perfect_fit(), SearchOptions(), go_on)
    assert found.is_complete
    assert found.schedule.solver == "anneal, exact"
    assert not [d for d in verify(perfect_fit(), found.schedule) if d.is_error]
    assert schedule_model(perfect_fit(), SearchOptions(), go_on).schedule == found.schedule


def test_only_the_modes_that_need_it_are_its_own(few_moves):
    system = perfect_fit(lambda tasks: [mode("easy", tasks[:1]), mode("full", tasks)])
    found = schedule_model(system, SearchOptions(), go_on)
    assert [each.status for each in found.schedule.modes] == [Status.VALID, Status.VALID]
    assert found.schedule.solver == "anneal, exact"
    assert schedule_model(system, SearchOptions(modes=("easy",)), go_on).schedule.solver == "anneal"


def test_a_budget_that_is_stated_is_all_there_is(few_moves, monkeypatch):
    monkeypatch.setattr(exact_member, "solve_after", lambda *arguments: pytest.fail("is asked"))
    assert not schedule_model(perfect_fit(), SearchOptions(budget=1), go_on).is_complete


@pytest.mark.parametrize("reason", ["not installed", "no answer", "too large"])
def test_without_its_answer_the_search_is_what_it_was(few_moves, monkeypatch, reason):
    if reason == "not installed":
        monkeypatch.setattr(exact_member, "is_installed", lambda: False)
    elif reason == "no answer":
        monkeypatch.setattr(exact_member, "WORK", 0)
    else:
        monkeypatch.setattr("halpipe.pipeline.solve.exact.MAX_PARTS", 1)
    found = schedule_model(perfect_fit(), SearchOptions(), go_on)
    assert (found.is_complete, found.schedule.solver) == (False, "anneal")


def test_what_has_no_schedule_is_not_called_infeasible_on_its_word(few_moves):
    """Three tasks of 6 and 7 ms on two units of 10 ms."""
    tasks = [task(name, 10, version("v", wcet, UNITS)) for name, wcet in (("a", 7), ("b", 7), ("c", 6))]
    system = model(*tasks, units=UNITS)
    found = schedule_model(system, SearchOptions(), go_on)
    assert [each.status for each in found.schedule.modes] == [Status.NOT_FOUND]


def test_with_the_clock_as_the_limit_it_is_asked_early_and_the_search_goes_on(few_moves, monkeypatch):
    asked = []
    monkeypatch.setattr(exact_member, "solve_after", lambda *arguments: asked.append(arguments))
    monkeypatch.setattr(schedule, "UNBOUNDED", 10)
    found = schedule_model(perfect_fit(), SearchOptions(budget=10), go_on)
    assert len(asked) == 1
    assert found.is_complete or found.moves == 10 * len(LENGTHS)
    assert UNBOUNDED > 10
