"""Searches that begin anew: in which order they make their moves, however often they are stopped on the way."""

import pytest

from halpipe.pipeline.solve.kernel.search import FRESH_SHARE, Outcome, Turns

LEAST = 100 * FRESH_SHARE


class Stub:
    """A search that finds a schedule after some of its own moves, if any, and writes down what it makes."""

    def __init__(self, number, made, finds):
        self.number, self.all, self.finds, self.own = number, made, finds, 0

    def run(self, budget, on_slice):
        assert budget >= self.own
        found = self.number == self.finds[0] and budget >= self.finds[1]
        self.all += [self.number] * (budget - self.own)
        self.own = self.finds[1] if found else budget
        is_stopped = not on_slice(self.own, 5) and not found
        return Outcome((), 0 if found else 10 + self.number, self.own, is_stopped)


def turns(made, finds=(None, 0)):
    return Turns(lambda number: Stub(number, made, finds), LEAST)


@pytest.mark.parametrize("steps", [(850,), (LEAST, 500, 850), range(10, 851, 10), (399, 401, 501, 599, 601, 850)])
def test_short_searches_take_turns_with_the_first_after_its_own_moves(steps):
    made = []
    search = turns(made)
    for budget in steps:
        end = search.run(budget, lambda now, best: True)
        assert (end.cost, end.moves, end.stopped) == (10, budget, False)  # what is saved is the first's
    assert made == [0] * LEAST + [1] * 100 + [0] * 100 + [2] * 100 + [0] * 100 + [3] * 50


@pytest.mark.parametrize(("finds", "moves"), [((0, 350), 350), ((1, 60), 460), ((0, 450), 550), ((3, 20), 820)])
def test_the_first_schedule_ends_all(finds, moves):
    end = turns([], finds).run(10**6, lambda now, best: True)
    assert (end.cost, end.moves) == (0, moves)


def test_progress_counts_all_moves_and_a_stop_is_reported():
    seen = []
    end = turns([]).run(10**6, lambda now, best: seen.append(now) or now < 650)
    assert seen == [400, 500, 600, 700]
    assert end.stopped
    assert (end.cost, end.moves) == (10, 700)
