"""Margins that are tried one after the other, as they are granted or not, and the searches of each round."""

from fractions import Fraction

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel.search import NOT_BEGUN, Outcome
from halpipe.pipeline.solve.kernel.widen import FINEST, Wider, following, halves, margins, reserved, widened
from halpipe.pipeline.solve.problem import build_problem
from support import access, model, task, version

EIGHTH = Fraction(1, 8)


def asked(steps, most):
    """Return what is asked for where all up to `most` is granted."""
    found, granted = [], None
    while (margin := following(steps, granted)) is not None:
        found.append(margin)
        granted = margin <= most
    return found


@pytest.mark.parametrize(
    ("found", "largest", "granted", "expected"),
    [
        (0, 10, Fraction(3, 8), [1, 3, 7, 5, 4, Fraction(7, 2), Fraction(13, 4), Fraction(25, 8)]),
        (0, 10, 0, [1, Fraction(1, 2), Fraction(1, 4), Fraction(1, 8)]),
        (0, Fraction(1, 16), 1, [Fraction(1, 2)]),  # never more than the largest
        (0, EIGHTH, 1, [1]),
        (EIGHTH, 10, EIGHTH, [2, Fraction(3, 2), Fraction(5, 4), Fraction(9, 8)]),
        (1, 1, 1, []),
    ],
)
def test_margins_grow_by_twice_the_step_while_they_are_granted_and_then_by_halves(found, largest, granted, expected):
    """In eighths."""
    assert asked(margins(Fraction(found), Fraction(largest)), granted) == [each * EIGHTH for each in expected]


def test_the_last_step_is_a_sixty_fourth():
    steps = asked(margins(Fraction(0), Fraction(10)), 0)
    assert steps == [Fraction(1, part) for part in (8, 16, 32, 64)]


def test_halves_lie_between_what_was_granted_and_what_was_not_up_to_a_part_of_the_most():
    steps = asked(halves(Fraction(0), Fraction(1)), Fraction(1, 3))
    assert steps[:4] == [Fraction(1, 2), Fraction(1, 4), Fraction(3, 8), Fraction(5, 16)]
    assert len(steps) == FINEST.bit_length() - 1
    assert asked(halves(Fraction(1), Fraction(1)), 0) == []


class Kept:
    """What earlier runs left, by stage."""

    def __init__(self, notes, key=""):
        self.notes, self.key = notes, key

    def stage(self, name):
        return Kept(self.notes, f"{self.key}/{name}")

    def note(self, facts):
        self.notes[self.key] = facts

    def noted(self):
        return self.notes.get(self.key)


def searched(most, *, moves=1000, wanted=(0, 10), rounds=(30,), kept=None, unit=2, costs=10, stop_at=None):
    """Raise margins where those up to `most` are found, each in ten moves; return what came of it, and the searches."""
    begun, told = [], []

    def begin(margin, number, stage):
        def run(budget, tell):
            begun.append((margin, number, budget))
            tell(3, 99)
            stopped = stop_at is not None and len(begun) == stop_at
            return Outcome((f"jobs of {margin}",), int(margin > most), min(costs, budget), stopped=stopped)

        return run

    tell = lambda made, best: told.append((made, best))  # noqa: E731
    found = widened(begin, unit, tuple(map(Fraction, wanted)), moves, tell, kept, rounds)
    return found, begun, told


def test_the_largest_margin_that_is_found_is_returned_with_all_moves():
    found, begun, told = searched(Fraction(1, 4))
    assert [margin for margin, *_ in begun] == [
        each * EIGHTH for each in (1, 3, 2, Fraction(5, 2), Fraction(9, 4), Fraction(17, 8))
    ]
    assert found == Wider(("jobs of 1/4",), Fraction(1, 4), 60, stopped=False)
    assert {(number, budget) for _, number, budget in begun} == {(0, 60)}
    assert told == [(10 * number + 3, 0) for number in range(6)]


def test_without_a_wider_schedule_there_are_no_jobs():
    assert searched(Fraction(0))[0] == Wider(None, Fraction(0), 40, stopped=False)


def test_no_more_moves_are_made_than_are_allowed():
    found, begun, _ = searched(Fraction(0), moves=25)
    assert [budget for *_, budget in begun] == [25, 15, 5]
    assert found.moves == 25
    assert searched(Fraction(0), moves=0)[1] == []


def test_later_rounds_have_their_own_moves_and_halve():
    found, begun, _ = searched(Fraction(1, 4), rounds=(30, 300, 3000), moves=10**6, wanted=(0, 1))
    rounds = {number: [margin for margin, each, _ in begun if each == number] for number in (0, 1, 2)}
    assert {(number, budget) for _, number, budget in begun} == {(0, 60), (1, 600), (2, 6000)}
    assert rounds[1] == [each * EIGHTH for each in (3, Fraction(5, 2), Fraction(9, 4), Fraction(17, 8))]
    assert rounds[2][0] == Fraction(5, 8)
    assert found.margin == Fraction(1, 4)


def test_a_search_that_cannot_begin_has_found_nothing_in_no_moves():
    def begin(margin, _number, _stage):
        return lambda budget, tell: Outcome(("jobs",), 0, 9, stopped=False) if margin <= EIGHTH else NOT_BEGUN

    found = widened(begin, 2, (Fraction(0), Fraction(1)), 1000, lambda *_: True, None, (30,))
    assert found == Wider(("jobs",), EIGHTH, 9, stopped=False)


def test_a_stop_ends_all_with_what_was_found_before():
    found, begun, _ = searched(Fraction(1), stop_at=2)
    assert found == Wider(("jobs of 1/8",), EIGHTH, 20, stopped=True)
    assert len(begun) == 2


def test_margins_that_failed_in_an_earlier_run_are_not_searched_again():
    notes = {}
    first, begun, _ = searched(Fraction(1, 4), kept=Kept(notes))
    assert {key: facts["moves"].tolist() for key, facts in notes.items()} == {
        f"/margin{number}/groups": [10] for number in (1, 3, 4, 5)
    }
    again, repeated, _ = searched(Fraction(1, 4), kept=Kept(notes))
    assert again == first
    assert [margin for margin, *_ in repeated] == [begun[number][0] for number in (0, 2)]


def test_jobs_reserve_their_units_for_longer_but_not_for_more_than_a_hyperperiod_and_no_resources():
    system = model(
        task("a", 10, version("v", 3, "u1", access("r", 0, 2))), task("b", 10, version("v", 9, "u2")),
        units="u1 u2", resources="r",
    )  # fmt: skip
    expansion = expand(system, system.modes[0])
    problem = build_problem(expansion, system.units, ["r"])
    wide = reserved(problem, Fraction(1, 4), problem.arrays)
    assert [*wide.arrays.rect] == [(0, 0, 3 + 1, 1), (2, 0, 2, 1), (1, 0, 10, 1)]
    assert [*problem.arrays.rect] == [(0, 0, 3, 1), (2, 0, 2, 1), (1, 0, 9, 1)]
    again = reserved(wide, Fraction(1, 3), problem.arrays)
    assert next(iter(again.arrays.rect)) == (0, 0, 4, 1)
