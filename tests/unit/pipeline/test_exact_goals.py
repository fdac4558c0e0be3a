"""The exact engine with an objective: how its bounds are put together, and what ends it before it has an answer."""

from dataclasses import replace
from fractions import Fraction
from math import inf
from types import SimpleNamespace

import pytest

from halpipe.core.durations import milliseconds
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import NEVER
from halpipe.pipeline.solve import exact, exact_goals, exactmodel
from halpipe.pipeline.solve.exact import Effort
from halpipe.pipeline.solve.exact_goals import Fewest, Shortest, fewest_moved, is_same, shortest_chains
from halpipe.pipeline.solve.exactchains import TooLarge
from halpipe.pipeline.solve.solver import solver_library
from support import after, chain, job, model, ms, task, version

pytest.importorskip("ortools")


def chained(*weights):
    """Three tasks of one unit, and a chain for each weight, each with a task in common with the next."""
    tasks = [task(name, 20, version("v", wcet)) for name, wcet in (("a", 3), ("b", 4), ("c", 2))]
    through = ("a b", "b c", "c", "a b c")
    chains = [replace(chain(f"c{n}", through[n]), weight=Fraction(w)) for n, w in enumerate(weights)]
    return model(*tasks, chains=chains)


def asked(monkeypatch, answers, *weights, now=10**9, go_on=lambda: True, least=5):
    """Return what comes of `answers` of the programs, and the names of the chains of each that was asked."""
    owner, names, stated = chained(*weights), [], []

    def solve(model, expansion, chains, jobs, now, effort, floors=None):
        stated.append(floors)
        names.append(" ".join(chain.name for chain in chains))
        return answers[len(names) - 1]

    monkeypatch.setattr(exact_goals, "_solve", solve)
    known = dict.fromkeys(owner.chains, Fraction(least))
    effort = Effort(go_on=go_on)
    found = shortest_chains(owner, expand(owner, owner.modes[0]), (), Fraction(now), known, effort)
    for floors in filter(None, stated):
        names.append({" ".join(chain.name for chain in group): floor for group, floor in floors.items()})
    return found, names


def bounds(*values):
    return [Shortest(Fraction(value)) for value in values]


def test_the_bound_is_that_of_chains_then_of_pairs_then_of_all(monkeypatch):
    """Weights of 2 and 1: alone 2 * 6 and 5, together 19, and all of them 23."""
    found, names = asked(monkeypatch, bounds(12, 4, 19, 23), 2, 1)
    assert found == Shortest(Fraction(23))
    assert names == ["c0", "c1", "c0 c1", "c0 c1", {"c0": 12, "c1": 5, "c0 c1": 19}]
    assert asked(monkeypatch, bounds(12, 4, 19, 18), 2, 1)[0].bound == 19
    assert asked(monkeypatch, bounds(12, 4, 16, 0), 2, 1)[0].bound == 2 * 6 + 5


def test_a_chain_that_weighs_nothing_bounds_nothing(monkeypatch):
    assert asked(monkeypatch, bounds(0, 7, 8, 0), 0, 1)[0].bound == 8


def test_pairs_without_a_task_in_common_are_not_asked_for_and_those_with_most_come_first(monkeypatch):
    _, names = asked(monkeypatch, bounds(*range(20)), 1, 1, 1, 1)
    assert names[:-1] == ["c0", "c1", "c2", "c3", "c0 c3", "c1 c3", "c0 c1", "c1 c2", "c2 c3", "c0 c1 c2 c3"]


def test_pairs_that_gain_most_come_first_and_leave_no_chain_for_others():
    one, two, three = least = dict.fromkeys((chain(name, "a b") for name in "pqr"), Fraction(10))
    assert exact_goals._best_gain({(one, two): Fraction(25), (two, three): Fraction(29)}, least) == 9


def test_what_meets_its_bound_already_is_not_searched(monkeypatch):
    found, names = asked(monkeypatch, bounds(12, 4), 2, 1, now=17)
    assert (found, names) == (Shortest(Fraction(17)), ["c0", "c1"])
    found, names = asked(monkeypatch, bounds(12, 4, 17, 17), 2, 1, now=Fraction(35, 2))
    assert (found.bound, len(names)) == (17, 4 + 1)


def test_chains_without_data_are_not_searched(monkeypatch):
    found, names = asked(monkeypatch, [], 2, 1, now=NEVER)
    assert (found, names) == (Shortest(Fraction(15)), [])


@pytest.mark.parametrize(
    ("answers", "calls", "names", "bound"),
    [
        (bounds(12, 4, 19, 23), 0, ["c0"], 17),
        (bounds(12, 4, 19, 23), 1, ["c0", "c1"], 17),
        (bounds(12, 4, 19, 23), 2, ["c0", "c1", "c0 c1"], 19),
        ([Shortest(Fraction(12), stopped=True)], 99, ["c0"], 17),
    ],
)
def test_what_is_stopped_keeps_the_bound_that_it_has(monkeypatch, answers, calls, names, bound):
    left = iter(range(calls))
    found = asked(monkeypatch, answers, 2, 1, go_on=lambda: next(left, None) is not None)
    assert found == (Shortest(Fraction(bound), stopped=True), names)


def test_a_pair_that_is_stopped_is_the_last(monkeypatch):
    answers = [*bounds(6, 6, 6), Shortest(Fraction(99), stopped=True), Shortest(Fraction(20), stopped=True)]
    found, names = asked(monkeypatch, answers, 1, 1, 1)
    assert names == ["c0", "c1", "c2", "c0 c1", "c0 c1 c2", {"c0": 6, "c1": 6, "c2": 6}]
    assert found == Shortest(Fraction(20), stopped=True)


def test_a_part_has_the_tasks_named_and_windows_between_them():
    rows = after("a", 0, 9), after("c", 1, 8)
    owner = model(task("a", 20, version()), task("b", 20, version("v", 1, "u1", *rows)), task("c", 20, version()))
    part = exact_goals._part(expand(owner, owner.modes[0]), {"a", "b"})
    assert [active.name for active in part.tasks] == ["a", "b"]
    assert [[row.task for row in active.versions[0].precedences] for active in part.tasks] == [[], ["a"]]


# ------------------------------------------------------------------------------------------------ one program


def solved(owner, jobs=(), now=None, chains=None):
    expansion = expand(owner, owner.modes[0])
    now = None if now is None else Fraction(milliseconds(now).ns)
    found = exact_goals._solve(owner, expansion, list(chains or owner.chains), tuple(jobs), now, Effort(work=1))
    return found.bound / milliseconds(1).ns, found.jobs


def two_in_a_row():
    """On one unit, b after a: the data of a pass in 3 + 2 ms, and in up to 20 ms more where b comes just before a."""
    return model(task("a", 20, version("v", 3)), task("b", 20, version("v", 2)), chains=[chain("c", "a b")])


def test_a_schedule_is_returned_only_where_it_is_better_than_the_known_one():
    """Reaction time 25 ms and data age 5 ms at best."""
    owner = two_in_a_row()
    far = [job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, 10, "u1")]
    best, better = solved(owner, far, now=45)
    assert (best, {each.task for each in better}) == (30, {"a", "b"})
    near = [job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, 3, "u1")]
    assert solved(owner, near, now=30) == (30, ())
    assert solved(owner, chains=owner.chains) == (30, ())


def test_jobs_on_demand_alone_bound_nothing():
    owner = model(
        task("a", 20, version("v", 3, "u1", after("h", 1, 5))),
        task("h", None, version("v", 1)),
        chains=[chain("c", "h a")],
    )
    assert solved(owner) == (0, ())
    jobs = [job(owner, "h", 0, 0, "u1"), job(owner, "a", 0, 2, "u1")]
    assert solved(owner, jobs, now=100)[0] > 0


def test_programs_that_are_too_large_bound_nothing(monkeypatch):
    owner = two_in_a_row()

    def minimise(*_):
        raise TooLarge

    with monkeypatch.context() as patch:
        patch.setattr(exactmodel.Program, "minimise", minimise)
        assert solved(owner) == (0, ())
    monkeypatch.setattr(exactmodel, "MAX_PARTS", 2)
    assert solved(owner) == (0, ())


def test_a_program_without_an_answer_bounds_nothing(monkeypatch):
    monkeypatch.setattr(exact_goals, "run", lambda *_: (None, "INFEASIBLE", False))
    assert solved(two_in_a_row()) == (0, ())


@pytest.mark.parametrize(("stated", "bound"), [(-3.0, 0), (0.0, 0), (4.9, 4)])
def test_a_bound_is_a_whole_number_of_ticks_and_none_is_below_zero(monkeypatch, stated, bound):
    solver = SimpleNamespace(best_objective_bound=stated)
    monkeypatch.setattr(exact_goals, "run", lambda *_: (solver, "UNKNOWN", True))
    assert solved(two_in_a_row()) == (bound, ())


@pytest.mark.parametrize(("seed", "given"), [(7, 7), (2**31, 0), (2**31 + 5, 5), (2**64 + 3, 3), (-1, 2**31 - 1)])
def test_seeds_are_those_of_the_library_whatever_their_size(monkeypatch, seed, given):
    seeds = []
    monkeypatch.setattr(exact, "watched", lambda solve, go_on, stop: (seeds.append(stop.__self__), False))
    monkeypatch.setattr(solver_library().CpSolver, "status_name", lambda *_: "UNKNOWN")
    exact.run(None, Effort(seed=seed))
    assert [solver.parameters.random_seed for solver in seeds] == [given]


# ------------------------------------------------------------------------------------------------ fewest moves


def moving():
    """Three jobs of 4 ms that were apart on one unit; a new one of 5 ms needs one of them to move, of 10 ms."""
    names = "abc"
    tasks = [task(name, 20, version("v", 4, "u1 u2")) for name in names]
    owner = model(*tasks, task("new", 20, version("v", 5, "u1")), units="u1 u2")
    earlier = {(name, 0): job(owner, name, 0, start, "u1") for name, start in zip(names, (0, 6, 13), strict=True)}
    return owner, expand(owner, owner.modes[0]), earlier


def known(owner, earlier, moved):
    """A schedule in which the jobs named have moved to the other unit."""
    jobs = [replace(each, units=("u2",)) if each.task in moved else each for each in earlier.values()]
    return (*jobs, job(owner, "new", 0, 8 if "b" in moved else 16, "u1"))


def test_fewest_moves_are_found_and_proven():
    owner, expansion, earlier = moving()
    found = fewest_moved(owner, expansion, earlier, {}, known(owner, earlier, "abc"), 0, Effort(work=5))
    assert found.bound == 2
    assert sum(not is_same(each, earlier) for each in found.jobs) == 2
    again = fewest_moved(owner, expansion, earlier, {}, found.jobs, 2, Effort(work=5))
    assert again == Fewest(2)
    assert fewest_moved(owner, expansion, earlier, {}, known(owner, earlier, "abc"), 0, Effort(work=0)) == Fewest()
    assert fewest_moved(owner, expansion, earlier, {}, known(owner, earlier, "abc"), 0, Effort(work=None)).bound == 2


@pytest.mark.parametrize("moves", ["a", "b", "c"])
def test_held_jobs_stay_where_they_are(moves):
    """Each of the three would make room, whichever is not held."""
    owner, expansion, earlier = moving()
    held = {key: each for key, each in earlier.items() if key[0] != moves}
    found = fewest_moved(owner, expansion, earlier, held, known(owner, earlier, "abc"), 0, Effort(work=5))
    assert {each.task for each in found.jobs if not is_same(each, earlier)} == {moves, "new"}


def test_what_the_exact_engine_cannot_hold_has_no_answer(monkeypatch):
    owner, expansion, earlier = moving()
    before = known(owner, earlier, "abc")
    ask = lambda earlier=earlier, jobs=before: fewest_moved(owner, expansion, earlier, {}, jobs, 1, Effort(work=5))  # noqa: E731
    late = {**earlier, ("a", 0): replace(earlier["a", 0], start=ms(21), end=ms(25))}
    assert ask(earlier=late).bound == 2  # a whole hyperperiod later it is the same job
    assert ask().bound == 2
    with monkeypatch.context() as patch:
        patch.setattr(exact_goals, "is_installed", lambda: False)
        assert (ask().bound, ask().jobs) == (0, ())
    with monkeypatch.context() as patch:
        patch.setattr(exactmodel, "MAX_PARTS", 3)
        assert ask() == Fewest(1)


def test_jobs_of_other_numbers_than_the_program_gives_them_are_not_asked_for():
    """Of a period of 10 ms, job 0 starts in the first 10 ms, or as much later as its slack allows."""
    owner = model(task("a", 10, version("v", 1), slack="1/2"), task("b", 20, version("v", 1)))
    expansion = expand(owner, owner.modes[0])
    numbered = [exact_goals._is_numbered(expansion, job(owner, "a", 1, start, "u1")) for start in (9, 10, 19, 24, 25)]
    assert numbered == [False, True, True, True, False]
    assert exact_goals._is_numbered(expansion, job(owner, "b", 0, 19, "u1"))
    assert exact_goals._is_numbered(expansion, replace(job(owner, "b", 0, 99, "u1"), task="gone"))
    swapped = job(owner, "a", 0, 16, "u1"), job(owner, "a", 1, 6, "u1")
    found = fewest_moved(owner, expansion, {}, {}, (*swapped, job(owner, "b", 0, 0, "u1")), 1, Effort(work=1))
    assert found == Fewest()


def test_a_job_with_another_version_or_units_than_there_are_has_moved():
    owner, expansion, earlier = moving()
    gone = {
        **earlier,
        ("a", 0): replace(earlier["a", 0], version="w"),
        ("b", 0): replace(earlier["b", 0], units=("x",)),
    }
    found = fewest_moved(owner, expansion, gone, {}, known(owner, earlier, "abc"), 0, Effort(work=5))
    assert found.bound == 3
    assert {each.task for each in found.jobs if is_same(each, gone)} <= {"c"}


def test_a_search_for_fewer_moves_ends_where_it_is_stopped(monkeypatch):
    owner, expansion, earlier = moving()
    efforts, plain = [], exact_goals.run

    def run(program, effort):
        efforts.append(effort.work)
        return (*plain(program, effort)[:2], True)

    monkeypatch.setattr(exact_goals, "run", run)
    found = fewest_moved(owner, expansion, earlier, {}, known(owner, earlier, "abc"), 0, Effort(work=5))
    assert (efforts, found.bound) == ([5], 0)
    assert sum(not is_same(each, earlier) for each in found.jobs) <= 3


def test_a_gang_with_a_unit_that_is_gone_has_moved():
    owner = model(task("a", 20, version("v", 4, "u1 u2", gang=2)), task("b", 20, version("v", 4, "u1")), units="u1 u2")
    earlier = {("a", 0): job(owner, "a", 0, 5, "u1 u2"), ("b", 0): job(owner, "b", 0, 0, "u1")}
    gone = earlier | {("a", 0): replace(earlier["a", 0], units=("u1", "x"))}
    jobs = [replace(each, start=each.start + ms(9), end=each.end + ms(9)) for each in earlier.values()]
    expansion = expand(owner, owner.modes[0])
    assert fewest_moved(owner, expansion, gone, {}, tuple(jobs), 0, Effort(work=5)).bound == 1
    assert fewest_moved(owner, expansion, earlier, {}, tuple(jobs), 0, Effort(work=5)).jobs != ()


class Limited:
    """Programs with a limit, whose answers are chosen before: how many jobs move, or what CP-SAT says instead."""

    def __init__(self, monkeypatch, *answers):
        self.answers, self.asked = list(answers), []
        monkeypatch.setattr(exact_goals, "_limited", self.limited)
        monkeypatch.setattr(exact_goals, "run", self.run)

    def limited(self, model, expansion, earlier, held, limit, hint):
        self.asked.append([limit, len(hint)])
        return SimpleNamespace(jobs=lambda solver: strangers(solver.moved))

    def run(self, program, effort):
        answer = self.answers.pop(0)
        self.asked[-1].append(effort.work)
        solver = SimpleNamespace(moved=answer, response_proto=SimpleNamespace(deterministic_time=1))
        return solver, answer if isinstance(answer, str) else "FEASIBLE", False


def strangers(count):
    owner = model(task("a", 20, version()))
    return tuple(replace(job(owner, "a", 0, 0, "u1"), task=f"t{number}") for number in range(count))


def fewest(monkeypatch, known, least, work, *answers):
    owner, expansion, earlier = moving()
    limited = Limited(monkeypatch, *answers)
    found = fewest_moved(owner, expansion, earlier, {}, strangers(known), least, Effort(work=work))
    assert not limited.answers
    return found.bound, len(found.jobs), limited.asked


def test_limits_prove_from_below_then_halve_what_is_left_and_begin_above_where_few_are(monkeypatch):
    """Half of the work that is left is for each but the greatest limit, where few are in question."""
    assert fewest(monkeypatch, 20, 0, 64, "INFEASIBLE", "UNKNOWN", 9, "UNKNOWN", "INFEASIBLE") == (
        1,
        9,
        [[0, 20, 32], [1, 20, 31.5], [11, 20, 31], [5, 9, 30.5], [8, 9, 60]],
    )
    assert fewest(monkeypatch, 4, 0, 10, 2, "INFEASIBLE") == (2, 2, [[3, 4, 10], [1, 2, 9]])
    assert fewest(monkeypatch, 5, 0, 10, "UNKNOWN", "UNKNOWN") == (0, 0, [[0, 5, 5], [4, 5, 9]])


def test_limits_end_where_the_known_moves_are_the_fewest_or_the_effort_is_spent(monkeypatch):
    assert fewest(monkeypatch, 3, 3, 10) == (3, 0, [])
    assert fewest(monkeypatch, 20, 0, 2, "UNKNOWN", "UNKNOWN") == (0, 0, [[0, 20, 1], [10, 20, 0.5]])
    asked = [[0, 20, inf], [10, 20, inf], [1, 2, inf]]
    assert fewest(monkeypatch, 20, 0, None, "UNKNOWN", 2, "UNKNOWN") == (0, 2, asked)
