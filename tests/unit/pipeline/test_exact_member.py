"""Where a search finds nothing in a small mode, the exact engine is asked, and what it finds is said to be its own."""

from itertools import islice

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.models import Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import codes, one_mode, relay, schedule
from halpipe.pipeline.solve.exact import Answer, ExactResult
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.verify import verify
from support import mode, model, task, version

pytest.importorskip("ortools", reason="halpipe[exact] is not installed")

LENGTHS = (17, 23, 29, 31, 37, 41, 22)
UNITS = "u1 u2"


def perfect_fit(modes=None):
    """Seven tasks fill two units to the last millisecond: 41 + 37 + 22 and the rest."""
    tasks = [task(f"t{number}", 100, version("v", wcet, UNITS)) for number, wcet in enumerate(LENGTHS)]
    return model(*tasks, units=UNITS, modes=modes and modes(tasks))


def fuller():
    """A perfect fit for which the annealer needs more than its first turn."""
    lengths = (61, 59, 53, 47, 43, 41, 37, 35, 33, 31, 29, 27, 23, 21, 60)
    units = "u1 u2 u3 u4 u5 u6"
    return model(*(task(f"t{n}", 100, version("v", wcet, units)) for n, wcet in enumerate(lengths)), units=units)


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
    assert found.schedule.solver == "exact"
    assert [d.code for d in found.diagnostics] == [codes.OTHER_ANSWERED.id]
    assert not [d for d in verify(perfect_fit(), found.schedule) if d.is_error]
    assert schedule_model(perfect_fit(), SearchOptions(), go_on).schedule == found.schedule


def test_only_the_modes_that_need_it_are_its_own(few_moves):
    system = perfect_fit(lambda tasks: [mode("easy", tasks[:1]), mode("full", tasks)])
    found = schedule_model(system, SearchOptions(), go_on)
    assert [each.status for each in found.schedule.modes] == [Status.VALID, Status.VALID]
    assert found.schedule.solver == "anneal, exact"
    assert schedule_model(system, SearchOptions(modes=("easy",)), go_on).schedule.solver == "anneal"


def test_a_budget_that_is_stated_is_all_there_is(few_moves, monkeypatch):
    monkeypatch.setattr(relay, "solve_after", lambda *arguments: pytest.fail("is asked"))
    assert not schedule_model(perfect_fit(), SearchOptions(budget=1), go_on).is_complete


@pytest.mark.parametrize("workers", [2, 8])
def test_any_number_of_workers_gives_the_same(few_moves, workers):
    one = schedule_model(perfect_fit(), SearchOptions(), go_on).schedule
    assert schedule_model(perfect_fit(), SearchOptions(workers=Workers(workers)), go_on).schedule == one


def test_turns_grow_to_the_budget():
    turns = [(turn.number, turn.moves, turn.work) for turn in relay.turns(1600, 5000, 50)]
    assert turns == [(0, 25, 0), (1, 100, 1), (2, 400, 4), (3, 1600, 16), (4, 5000, 64)]
    assert [turn.moves for turn in relay.turns(1600, 1600, 50)] == [25, 100, 400, 1600]
    assert [turn.moves for turn in relay.turns(8, 8, 50)] == [1, 4, 8]


def test_a_search_in_turns_is_that_in_one_go(monkeypatch):
    """The annealer goes on where its last turn ended, as if nobody had been asked in between."""
    monkeypatch.setattr(schedule, "LEAST_MOVES", 16_000)
    monkeypatch.setattr(schedule, "DEFAULT_BUDGET", 1)
    monkeypatch.setattr(relay, "solve_exact", lambda *_: ExactResult(Answer.UNKNOWN))
    in_turns = schedule_model(fuller(), SearchOptions(), go_on)
    monkeypatch.setattr("halpipe.pipeline.solve.exact.is_installed", lambda: False)
    at_once = schedule_model(fuller(), SearchOptions(), go_on)
    assert in_turns.schedule == at_once.schedule
    assert in_turns.moves == at_once.moves > 1000, "the second turn is needed"


@pytest.mark.parametrize("reason", ["not installed", "no answer", "too large"])
def test_without_its_answer_the_search_is_what_it_was(few_moves, monkeypatch, reason):
    if reason == "not installed":
        monkeypatch.setattr("halpipe.pipeline.solve.exact.is_installed", lambda: False)
    elif reason == "no answer":
        monkeypatch.setattr(relay, "FIRST_WORK", 0)
    else:
        monkeypatch.setattr("halpipe.pipeline.solve.exactmodel.MAX_PARTS", 1)
    found = schedule_model(perfect_fit(), SearchOptions(), go_on)
    assert (found.is_complete, found.schedule.solver) == (False, "anneal")
    said = {d.code for d in found.diagnostics}
    assert (codes.EXACT_ABSENT.id in said) == (reason == "not installed")


def test_what_has_no_schedule_is_not_called_infeasible_on_its_word(few_moves):
    """Three tasks of 6 and 7 ms on two units of 10 ms."""
    tasks = [task(name, 10, version("v", wcet, UNITS)) for name, wcet in (("a", 7), ("b", 7), ("c", 6))]
    system = model(*tasks, units=UNITS)
    found = schedule_model(system, SearchOptions(), go_on)
    assert [each.status for each in found.schedule.modes] == [Status.NOT_FOUND]


def test_with_the_clock_as_the_limit_both_go_on(few_moves, monkeypatch):
    asked = []
    monkeypatch.setattr(relay, "solve_after", lambda *arguments: asked.append(arguments[2].work))
    monkeypatch.setattr(schedule, "UNBOUNDED", 10)
    found = schedule_model(perfect_fit(), SearchOptions(budget=10), go_on)
    assert found.is_complete or found.moves == 10 * len(LENGTHS)
    assert asked == [0, *(4**turn for turn in range(len(asked) - 1))]
    assert len(asked) > 2


def test_the_exact_engine_gets_less_of_many_jobs():
    """A deterministic second takes longer there: of 160 jobs, 17 seconds, and the annealer waits."""
    few, many = (list(islice(relay.turns(1_600_000, 10**12, jobs), 4)) for jobs in (50, 160))
    assert [turn.work for turn in few] == [0, 1, 4, 16]
    assert [turn.moves for turn in few] == [turn.moves for turn in many] == [25_000, 100_000, 400_000, 1_600_000]
    assert [turn.work for turn in many] == [work * 50**5 / 160**5 for work in (0, 1, 4, 16)]


def refuse_to_state(monkeypatch, code):
    """Let the annealer's problem be refused from its second statement on, which is that of an improvement."""
    stated, plain = [], one_mode.stated_problem

    def refused(*given, **form):
        stated.append(form)
        if form.get("every_chain"):
            raise HalpipeError(code("cannot be held"))
        return plain(*given, **form)

    monkeypatch.setattr(one_mode, "stated_problem", refused)


def test_an_answer_that_the_annealer_cannot_hold_is_not_improved_by_it(monkeypatch, few_moves):
    """It lies on a grid of its own, which may be too fine; what else is refused is refused."""
    options = SearchOptions(optimise=(Objective.COST,))
    refuse_to_state(monkeypatch, codes.TOO_LARGE)
    found = schedule_model(perfect_fit(), options, go_on)
    assert (found.is_complete, found.schedule.solver) == (True, "exact")
    refuse_to_state(monkeypatch, codes.NO_OPTION)
    with pytest.raises(HalpipeError) as refused:
        schedule_model(perfect_fit(), options, go_on)
    assert [each.code for each in refused.value.diagnostics] == [codes.NO_OPTION.id]


def test_a_fault_of_the_exact_engine_is_not_taken_for_no_answer(monkeypatch, few_moves):
    """That a mode is too large for it, is."""
    for code, is_raised in ((codes.EXACT_TOO_LARGE, False), (codes.EXACT_WRONG, True)):

        def refuse(*_given, code=code):
            raise HalpipeError(code("says the test"))

        monkeypatch.setattr(relay, "solve_exact", refuse)
        if is_raised:
            with pytest.raises(HalpipeError):
                schedule_model(perfect_fit(), SearchOptions(), go_on)
        else:
            assert not schedule_model(perfect_fit(), SearchOptions(), go_on).is_complete
