"""Search over plans of preemptive jobs: what it tries first, how long it settles, and from which plan it goes on."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.edf import search as module
from halpipe.pipeline.solve.edf.plans import first_plan
from halpipe.pipeline.solve.edf.search import SETTLING, STEPS, TRIES, Search, State
from halpipe.pipeline.solve.edf.trials import Effort, Try
from halpipe.pipeline.solve.edf.works import works_of
from support import model, ms, task, version


class Trials:
    """Tries of which the excess was written down before."""

    def __init__(self, excesses, budget=100, stop_at=None, limited=("chain",)):
        self.excesses, self.plans = list(excesses), []
        self.placed, self.stopped, self.limited = 0, False, limited
        self.effort, self.stop_at = SimpleNamespace(budget=budget), stop_at

    def evaluate(self, plan):
        self.plans.append(plan)
        self.placed += 10
        self.stopped = len(self.plans) == self.stop_at
        return tried(plan, self.excesses.pop(0))


def tried(plan, excess, slow=()):
    return Try(plan, None, (excess, 0), excess, slow)


class Draws:
    """Draws that are 0 each time they are told to be."""

    state = 0

    def __init__(self, zeros=()):
        self.zeros, self.count = set(zeros), 0

    def below(self, limit):
        assert limit == 50
        self.count += 1
        return 0 if self.count in self.zeros else 1


@pytest.fixture
def begun():
    """A search of two tasks, and its first plan; phases and holds tell plans apart."""
    owner = model(task("a", 10, version("v", 1, "u1 u2")), task("b", 10, version("v", 1, "u1 u2")), units="u1 u2")
    mode = works_of(owner, expand(owner, owner.modes[0]), ms(1))
    search = Search(mode, owner, 1, {}, Effort(100, 0, lambda *_: True))
    return search, first_plan(mode, search.allowed)


def numbered(plan, number):
    return replace(plan, phases=(number, 0))


@pytest.mark.parametrize(
    ("excesses", "kept"),
    [
        ([0], 0),
        ([9, 0], 1),
        ([9, 5, 5], 1),
        ([9, 9], 0),
        ([9, 5, 7], 1),
        ([9, 8, 7, 6, 5, 4][: SETTLING + 2], SETTLING),
    ],
)
def test_phases_follow_the_first_starts_while_that_makes_less_late(begun, monkeypatch, excesses, kept):
    search, plan = begun
    search.trials = Trials(excesses)
    monkeypatch.setattr(module, "followed", lambda _mode, plan, _table: (plan.phases[0] + 1, 0))
    found = search._settle(numbered(plan, 0))
    assert (found.plan.phases[0], found.excess) == (kept, excesses[kept])
    assert len(search.trials.plans) == min(len(excesses), SETTLING + 1)


def test_phases_that_follow_already_end_it(begun, monkeypatch):
    search, plan = begun
    search.trials = Trials([9])
    monkeypatch.setattr(module, "followed", lambda _mode, plan, _table: plan.phases)
    assert search._settle(plan).excess == 9


@pytest.mark.parametrize(
    ("excess", "limited", "other", "excesses", "found"),
    [
        (0, ("c",), 1, [], 0),
        (7, (), 1, [], 7),
        (7, ("c",), 0, [], 7),  # all is on one unit already
        (7, ("c",), 1, [5], 5),
        (7, ("c",), 1, [7], 7),
    ],
)
def test_chains_that_are_too_long_are_put_on_one_unit_if_that_helps(
    begun, monkeypatch, excess, limited, other, excesses, found
):
    search, plan = begun
    search.trials = Trials(excesses, limited=limited)
    monkeypatch.setattr(module, "together", lambda *_: numbered(plan, other))
    first = tried(numbered(plan, 0), excess)
    nearer = search._nearer(first)
    assert (nearer.excess, search.trials.excesses) == (found, [])
    assert (nearer is first) == (found == excess)


@pytest.mark.parametrize(
    ("excesses", "is_earlier"),
    [([0], True), ([5, 6], True), ([5, 5], True), ([5, 4], False), ([5, 0], False)],
)
def test_an_earlier_plan_is_the_first_unless_the_usual_one_is_better(begun, monkeypatch, excesses, is_earlier):
    search, plan = begun
    search.before, search.trials = numbered(plan, 77), Trials([])
    left = list(excesses)
    monkeypatch.setattr(Search, "_settle", lambda _, plan: tried(plan, left.pop(0)))
    monkeypatch.setattr(Search, "_nearer", lambda _, found: found)
    found = search._first()
    assert (found.plan.phases[0] == 77, found.excess, left) == (is_earlier, min(excesses), [])


@pytest.mark.parametrize(
    ("excesses", "zeros", "budget", "stop_at", "bases", "best"),
    [
        ([0], (), 100, None, [0], 0),
        ([8, 9, 7, 0], (), 100, None, [0, 1, 1, 3], 0),  # 9 is worse than 8, on from which it goes
        ([9, 9, 7, 0], (), 100, None, [0, 1, 2, 3], 0),  # as good will do
        ([8, 9, 8, 0], (1,), 100, None, [0, 1, 2, 3], 0),  # now and then what is worse, too
        ([8, 9, 9], (1,), 30, None, [0, 1, 2], 8),  # the best one is kept
        ([8, 7], (), 20, None, [0, 1], 7),
        ([8, 7, 6], (), 21, None, [0, 1, 2], 6),
        ([8, 7], (), 100, 2, [0, 1], 7),
    ],
)
def test_plans_are_repaired_from_one_that_is_no_worse(
    begun, monkeypatch, excesses, zeros, budget, stop_at, bases, best
):
    search, plan = begun
    search.trials, search.moves.draws = Trials(excesses, budget, stop_at), Draws(zeros)
    repaired = []

    def repair(_, current):
        repaired.append(current.plan.phases[0])
        return numbered(plan, len(repaired))

    monkeypatch.setattr(Search, "_repaired", repair)
    first = tried(numbered(plan, 0), 9)
    found = search._found(first, first)
    assert (found.excess, repaired, search.trials.excesses) == (best, bases, [])


def test_nothing_is_repaired_where_nothing_may_move(begun):
    search, plan = begun
    search.trials, search.moves.free = Trials([]), []
    assert search._found(tried(plan, 9), tried(plan, 9)).excess == 9


@pytest.mark.parametrize(("differs", "slow", "tries"), [(1, (0,), 1), (3, (0,), 3), (99, (0,), TRIES), (1, (), 0)])
def test_where_chains_are_too_long_plans_vary_until_one_differs_and_fits(begun, monkeypatch, differs, slow, tries):
    """Every second plan that differs does not fit; without any that does, or without such chains, one is repaired."""
    search, plan = begun
    drawn = []

    class Moves:
        def varied(self, plan, given):
            drawn.append(given)
            return numbered(plan, len(drawn) if len(drawn) >= differs else 0)

        def repaired(self, plan, late):
            return numbered(plan, -1)

    search.moves = Moves()
    monkeypatch.setattr(module, "fits", lambda _, plan: plan.phases[0] > 0)
    found = search._repaired(tried(numbered(plan, 0), 9, slow))
    assert (len(drawn), found.phases[0]) == (tries, differs if slow and differs <= TRIES else -1)
    monkeypatch.setattr(module, "fits", lambda _, plan: plan.phases[0] % 2 == 0)
    drawn.clear()
    found = search._repaired(tried(numbered(plan, 0), 9, slow))
    assert found.phases[0] == (differs + differs % 2 if slow and differs <= TRIES else -1)


class Judge:
    """A judge of jobs that are the number of their plan: the larger the better, unless they are worse than at first."""

    chain_weights, is_led_by_chains = (), False

    def __init__(self, worse=()):
        self.worse, self.asked = worse, []

    def worth(self, jobs):
        return jobs

    def keeps(self, first, worth):
        return worth not in self.worse

    def better(self, jobs, first, best):
        self.asked.append((jobs, first, best))
        return jobs if jobs > best else None


def climbed(begun, monkeypatch, moves, *, beside, excess=0, state=None, polish=0, enough=None, worse=()):
    """Climb from the plan 5, beside which lies one of another number; return what is found, and what was told."""
    search, plan = begun
    trials, told = search.trials, []
    search.trials = SimpleNamespace(
        placed=100,
        stopped=False,
        model=trials.model,
        mode=search.mode,
        effort=SimpleNamespace(polish=polish),
        jobs=lambda found: found.plan.phases[0],
        evaluate=lambda plan: tried(plan, excess if plan.phases[0] == beside else 0),
    )
    monkeypatch.setattr(module, "together", lambda _mode, plan, *_: numbered(plan, beside))
    left = list(moves)

    def varied(_, current):
        search.trials.placed += 1
        number = left.pop(0)
        found = current if number == "same" else None if number is None else tried(numbered(plan, number), 0)
        return found if found is None or found is current else replace(found, table=[0])

    monkeypatch.setattr(Search, "_varied", varied)
    judge = Judge(worse)
    wanted = SimpleNamespace(judge=judge, first=[], on_better=told.append, is_enough=lambda jobs: jobs == enough)
    earlier = None if state is None else replace(state, first=(numbered(plan, 3),))
    found = search._climbed(wanted, tried(numbered(plan, 5), 0), earlier)
    return found.plan.phases[0], told, wanted.first, left, judge.asked, search.trials.placed


def test_a_plan_that_puts_chains_on_one_unit_is_the_first_to_be_better(begun, monkeypatch):
    best, told, first, _, asked, _ = climbed(begun, monkeypatch, [], beside=7)
    assert (best, told, first, asked) == (7, [7], [5], [(7, 5, 5)])
    assert climbed(begun, monkeypatch, [], beside=4)[:2] == (5, [])
    assert climbed(begun, monkeypatch, [], beside=7, excess=1)[:2] == (5, [])


def test_a_valid_table_climbs_to_what_is_better_until_the_effort_is_spent(begun, monkeypatch):
    """A table that is judged counts as sixteen of its jobs; one that is no other one is not judged."""
    best, told, _, left, asked, placed = climbed(begun, monkeypatch, [6, None, "same", 4, 9, 1], beside=2, polish=51)
    assert (best, told, left) == (9, [6, 9], [1])
    assert asked == [(2, 5, 5), (6, 5, 5), (4, 5, 6), (9, 5, 6)]
    assert placed == 100 + 1 + 16 + 1 + 1 + 17 + 17
    assert climbed(begun, monkeypatch, [6, 8, 9], beside=2, polish=99, enough=8)[:4] == (8, [6, 8], [5], [9])


def test_what_is_worse_than_at_first_is_no_bar_for_others(begun, monkeypatch):
    """Where the plan beside is kept, nothing may be worse than in it."""
    assert climbed(begun, monkeypatch, [8], beside=7, polish=1)[4][-1] == (8, 7, 7)
    assert climbed(begun, monkeypatch, [8], beside=7, polish=1, worse=(7,))[4][-1] == (8, 5, 7)


def test_a_climb_goes_on_from_where_it_stood(begun, monkeypatch):
    """Its first table was 3; ten of twenty jobs were placed, so that one more is tried."""
    _, plan = begun
    state = State(110, 0, plan, plan, (), began=100)
    best, told, first, left, asked, placed = climbed(begun, monkeypatch, [6, 9], beside=4, state=state, polish=11)
    assert (best, told, first, left) == (6, [4, 6], [3], [9])
    assert asked == [(4, 3, 3), (6, 4, 5)]
    assert placed == 110 + 17


def test_the_sum_of_chains_weighs_both_figures(begun):
    search, plan = begun
    search.trials = SimpleNamespace(latencies=lambda _: [(1, 4), (2, 5)])
    search.polish = SimpleNamespace(judge=SimpleNamespace(chain_weights=(2, 3)))
    assert search._sum(tried(plan, 0)) == 2 * 5 + 3 * 7


@pytest.mark.parametrize(
    ("numbers", "stop_at", "found"),
    [
        ([5] * STEPS, None, 5),
        ([None, 8, 9, 8, 4, 6, 5, *[9] * STEPS], None, 4),  # from 8 on, no longer than before
        ([7, 6, 5], 2, 6),
    ],
)
def test_a_walk_goes_to_tables_whose_chains_are_no_longer(begun, monkeypatch, numbers, stop_at, found):
    search, plan = begun
    search.trials, left = SimpleNamespace(stopped=False), list(numbers)

    def varied(_, current):
        number = left.pop(0)
        search.trials.stopped = len(numbers) - len(left) == stop_at
        return None if number is None else tried(numbered(plan, number), 0)

    monkeypatch.setattr(Search, "_varied", varied)
    monkeypatch.setattr(Search, "_sum", lambda _, found: found.plan.phases[0])
    assert search._walked(tried(numbered(plan, 8), 0)).plan.phases[0] == found
    assert len(numbers) - len(left) == (stop_at or STEPS)


def test_a_plan_beside_another_is_tried_if_it_differs_and_fits(begun, monkeypatch):
    search, plan = begun
    search.trials = Trials([0, 3])
    monkeypatch.setattr(module, "fits", lambda _, plan: plan.phases[0] < 9)
    draws = iter([0, 9, 2, 3])
    search.moves = SimpleNamespace(varied=lambda plan: numbered(plan, next(draws)))
    first = tried(numbered(plan, 0), 0)
    assert (search._varied(first), search._varied(first), search.trials.placed) == (None, None, 2)
    assert search._varied(first).plan.phases[0] == 2
    assert search._varied(first) is None  # a job would be late
    assert [plan.phases[0] for plan in search.trials.plans] == [2, 3]
