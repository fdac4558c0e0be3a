"""Searches between validation and verification: proofs while they run, attempts for switches, and what failed."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.models import Status
from halpipe.pipeline import checked
from halpipe.pipeline.solve.codes import INTERRUPTED, NOT_FOUND, STILL_BROKEN
from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions
from halpipe.pipeline.transitions.tables import Switched
from support import job, mode, model, schedule, small_model, task, version


def failed(owner, *jobs, mode_name="all"):
    """What a search returns that has placed some jobs without a valid schedule."""
    return Scheduled(
        schedule(owner, 10, *jobs, mode_name=mode_name, status=Status.NOT_FOUND), diagnostics=(), moves=1, stopped=False
    )


class Reporting:
    """A search that reports without end until it may not go on; the number of its reports."""

    def __init__(self, answer, moves, cost=1):
        self._answer, self._moves, self._cost = answer, moves, cost
        self.reports = 0

    def __call__(self, _model, _options, on_progress):
        while self.reports < 100:
            self.reports += 1
            if not on_progress("all", self._moves, 10**9, self._cost):
                break
        return self._answer


def reports(monkeypatch, owner, answer, moves, cost=1):
    """Return how many reports a search makes until it is given up, at most 100, and how it ends."""
    search = Reporting(answer, moves, cost)
    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", search)
    try:
        checked.schedule_model(owner, SearchOptions(), lambda *_: True)
    except HalpipeError as proven:
        return search.reports, proven.exit
    return search.reports, None


def test_a_search_without_hope_is_given_up_after_some_reports_and_moves(monkeypatch):
    """17 reports, the last of more than 16 moves for each task; a and b meet beyond gcd(10, 15) = 5 ms in sum."""
    owner = model(task("a", 10, version("v", 2)), task("b", 15, version("v", 4)))
    answer = failed(owner)
    assert reports(monkeypatch, owner, answer, 16 * 2 + 1) == (checked.PATIENCE + 1, Exit.INFEASIBLE)
    assert reports(monkeypatch, owner, answer, 16 * 2) == (100, Exit.INFEASIBLE)
    assert reports(monkeypatch, owner, answer, 16 * 2 + 1, cost=0) == (100, Exit.INFEASIBLE)


def test_a_search_that_may_succeed_goes_on_as_long_as_it_likes(monkeypatch):
    owner = small_model()
    assert reports(monkeypatch, owner, failed(owner), 10**6) == (100, None)


PAIR = model(*(tasks := [task("a", 10, version()), task("b", 10, version())]), modes=[mode(n, tasks) for n in "mn"])
PLAN = schedule(PAIR, 10, job(PAIR, "a", 0, 0, "u1"), job(PAIR, "b", 0, 5, "u1"), mode_name="m")
PLAN = replace(PLAN, modes=(PLAN.modes[0], replace(PLAN.modes[0], name="n")))


DEFAULT = SearchOptions()


def attempts(monkeypatch, options=DEFAULT, moves=0, failing=(("m", "n"),), **answer):
    """Return which placements are tried where some switch never has a table, and the result."""
    tried = []

    def search(_model, options, _on_progress):
        tried.append(options.attempt)
        made = {"moves": moves, "stopped": False, **answer}
        return Scheduled(PLAN, diagnostics=(), **made)

    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", search)
    found = Switched((), (), failing, stopped=False)
    monkeypatch.setattr("halpipe.pipeline.transitions.tables.switch_tables", lambda *_: found)
    return tried, checked.schedule_model(PAIR, options, lambda *_: True)


def test_placements_are_tried_for_switches_as_long_as_they_cost_little(monkeypatch):
    plain = SearchOptions(optimise=())
    tried, found = attempts(monkeypatch, plain, moves=1)
    assert tried == [*range(checked.ATTEMPTS)]
    assert found.moves == checked.ATTEMPTS
    assert attempts(monkeypatch, plain, failing=())[0] == [0]
    assert attempts(monkeypatch, plain, stopped=True)[0] == [0]
    assert attempts(monkeypatch, plain, unimproved=True)[0] == [0]


@pytest.mark.parametrize("is_stopped", [False, True])
def test_a_switch_whose_search_was_stopped_is_not_said_to_have_no_table(monkeypatch, is_stopped):
    """The first placements of the modes might have one: the search of these did not end by itself."""

    def search(_model, options, _on_progress):
        return Scheduled(PLAN, diagnostics=(), moves=0, stopped=is_stopped and options.optimise == ())

    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", search)
    found = Switched((), (), (("m", "n"),), stopped=False)
    monkeypatch.setattr("halpipe.pipeline.transitions.tables.switch_tables", lambda *_: found)
    assert checked.schedule_model(PAIR, DEFAULT, lambda *_: True).is_complete is not is_stopped


def test_placements_for_switches_end_with_the_budget_of_moves(monkeypatch):
    limited = SearchOptions(optimise=(), budget=10)  # for two tasks, 20 moves
    assert attempts(monkeypatch, limited, moves=10)[0] == [0, 1, 2]
    assert attempts(monkeypatch, limited, moves=20)[0] == [0, 1]
    assert attempts(monkeypatch, limited, moves=21)[0] == [0]


def test_large_systems_get_fewer_placements_for_switches(monkeypatch):
    monkeypatch.setattr(checked, "ATTEMPTED_JOBS", 12)  # of four jobs
    assert attempts(monkeypatch, SearchOptions(optimise=()))[0] == [0, 1, 2, 3]


def test_by_default_the_first_placement_is_improved_once_and_the_others_are_tried_without(monkeypatch):
    tried, found = attempts(monkeypatch)
    assert tried == [0, *range(checked.ATTEMPTS)]
    assert found.is_complete


def test_one_mode_is_placed_once(monkeypatch):
    monkeypatch.setattr("halpipe.pipeline.transitions.tables.switch_tables", lambda *_: pytest.fail("is asked"))
    tried, one = [], replace(PLAN, modes=PLAN.modes[:1])

    def search(_model, options, _on_progress):
        tried.append(options.optimise)
        return Scheduled(one, diagnostics=(), moves=1, stopped=False)

    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", search)
    found = checked.schedule_model(PAIR, SearchOptions(modes=("m",)), lambda *_: True)
    assert [table.name for table in found.schedule.modes] == ["m"]
    assert tried == [None]


def codes(findings):
    return [finding.code for finding in findings]


def test_a_failure_names_modes_costs_and_rules_that_are_still_broken():
    owner = model(*tasks, modes=[mode(name, tasks) for name in "mno"])
    jobs = job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, "0.5ms", "u1")
    found = failed(owner, *jobs, mode_name="m")
    table = replace(found.schedule.modes[0], cost=SimpleNamespace(total=7))
    found = replace(found, schedule=replace(found.schedule, modes=(table, PLAN.modes[1])))
    stopped = checked.explain_failure(owner, found, interrupted=True)
    assert codes(stopped)[:2] == [INTERRUPTED.id] * 2
    assert set(codes(stopped)[2:]) == {STILL_BROKEN.id}
    assert stopped[0].message == "no valid schedule yet, best cost 7"
    assert stopped[1].message == "not searched: o"
    ended = checked.explain_failure(owner, found, interrupted=False)
    assert codes(ended) == [NOT_FOUND.id, *codes(stopped)[2:]]


def test_an_interruption_between_the_switches_says_that_the_modes_are_there():
    stopped = Scheduled(PLAN, diagnostics=(), moves=1, stopped=True)
    [finding] = checked.explain_failure(PAIR, stopped, interrupted=True)
    assert "every mode has a valid schedule" in finding.message
    one = replace(stopped, schedule=replace(PLAN, modes=PLAN.modes[:1]))
    [finding] = checked.explain_failure(PAIR, one, interrupted=True)
    assert finding.message == "not searched: n"
    assert checked.explain_failure(PAIR, one, interrupted=False) == []
