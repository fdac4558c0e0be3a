"""Searches that have their moves made elsewhere: the same winner, the same state, whatever becomes of a piece."""

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve import away as module
from halpipe.pipeline.solve.away import Away
from halpipe.pipeline.solve.checkpoint import SAVED
from halpipe.pipeline.solve.kernel import portfolio
from halpipe.pipeline.solve.kernel.kernel import BEST, FROZEN, MOVES, new_state, total_cost
from halpipe.pipeline.solve.kernel.portfolio import Kept, here, race
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.workers import Workers
from support import access, model, task, version

UNITS = "u1 u2 u3"
ALONE = 2
"""Moves per task of the first search before the others begin."""


@pytest.fixture
def problem():
    """Three units without a gap, filled by tasks of six lengths: takes a search some hundred moves."""
    tasks = [
        task(f"t{n}", 40, version("v", wcet, UNITS, *([access("mem", 0, 1)] if n % 2 == 0 else [])))
        for n, wcet in enumerate([3, 4, 5, 6, 7, 7, 8] * 3)
    ]
    system = model(*tasks, units=UNITS, resources="mem")
    return build_problem(expand(system, system.modes[0]), system.units, ["mem"], [])


@pytest.fixture(autouse=True)
def short_turns(monkeypatch):
    monkeypatch.setattr(portfolio, "LEAD", ALONE)
    monkeypatch.setattr(portfolio, "TURN", 1)
    monkeypatch.setattr(portfolio, "SLICE_WORK", 200)


class Local:
    """A cluster in this thread; every piece is done so many times, as it is where workers are lost."""

    def __init__(self, times=1, gives_up=None):
        self.times, self.gives_up = times, gives_up
        self.held, self.bounds = [], []

    def hold(self, value):
        self.held.append(value)
        return value

    def ask(self, function, arrays, state, bound, go_on):
        if len(self.bounds) == self.gives_up:
            assert not go_on()
            return None
        self.bounds.append(bound)
        before = saved(state)
        *_, last = [function(arrays, state, bound) for _ in range(self.times)]
        assert saved(state) == before, "a piece that is done again begins where it began before"
        return last


def run(problem, seed, workers, advancing=here, members=3, budget=40_000, on_slice=lambda *_: True):
    def begin(member):
        return new_state(problem.arrays, 1000 * seed + member, problem.mean_wcet)

    return race(problem, begin, budget, members, workers, on_slice, None, advancing)


def saved(state):
    return {name: getattr(state, name).tolist() for name in SAVED}


def same(one, other):
    return (one.moves, one.stopped, saved(one.state)) == (other.moves, other.stopped, saved(other.state))


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    from halpipe.pipeline.solve.run import on_cluster

    settings = {"n_workers": 2, "threads_per_worker": 2, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as there, on_cluster(there.scheduler_address) as found:
        yield found


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_cluster_comes_to_the_same_as_threads(problem, cluster, seed):
    first = run(problem, seed, Workers(1))
    assert first.moves > ALONE * len(problem.expansion.tasks), "a seed for which several searches take turns"
    there = Away(cluster)
    assert same(run(problem, seed, there.workers, there.advancing), first)


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("piece", [1, 64])
def test_neither_the_size_of_the_pieces_nor_doing_them_twice_matters(problem, monkeypatch, piece, times):
    monkeypatch.setattr(module, "PIECE", piece)
    cluster = Local(times)
    assert same(run(problem, 2, Workers(1), Away(cluster).advancing), run(problem, 2, Workers(1)))
    assert len(cluster.held) == 1, "the arrays of a problem are sent once"


def test_a_long_search_goes_in_pieces_of_so_many_slices(problem, monkeypatch):
    monkeypatch.setattr(module, "PIECE", 3)
    cluster = Local()
    run(problem, 3, Workers(1), Away(cluster).advancing, members=1)
    step = 3 * portfolio.slice_of(problem.arrays)
    assert cluster.bounds == [step * number for number in range(1, len(cluster.bounds) + 1)]
    assert len(cluster.bounds) > 2


def test_a_search_stopped_while_it_is_away_is_where_it_was_before(problem, monkeypatch):
    """So is what is saved of it: the moves of the piece are made again when it is gone on with."""
    monkeypatch.setattr(module, "PIECE", 1)
    cluster = Local(gives_up=2)
    stopped = run(
        problem, 3, Workers(1), Away(cluster).advancing, members=1, on_slice=lambda *_: len(cluster.bounds) < 2
    )
    assert stopped.stopped
    assert stopped.moves == cluster.bounds[-1]


def test_a_search_stopped_between_its_pieces_keeps_what_came_back(problem, monkeypatch):
    monkeypatch.setattr(module, "PIECE", 1)
    cluster = Local()
    told = []

    def stop(moves, best):
        told.append((moves, best))
        return len(told) < 2

    stopped = run(problem, 3, Workers(1), Away(cluster).advancing, members=1, on_slice=stop)
    assert stopped.stopped
    assert [moves for moves, _ in told] == cluster.bounds
    assert stopped.moves == cluster.bounds[-1]


def test_what_came_back_is_saved_piece_by_piece(problem, monkeypatch):
    monkeypatch.setattr(module, "PIECE", 1)
    cluster, moves = Local(), []

    class Keeper:
        def keep(self, key, state, *, now):
            moves.append((key, state.register[MOVES], now))

    state = new_state(problem.arrays, 3000, problem.mean_wcet)
    bound = 4 * portfolio.slice_of(problem.arrays)
    assert not Away(cluster).advancing(problem)(state, bound, lambda *_: True, Kept(Keeper(), "k"))
    assert moves == [("k", made, False) for made in cluster.bounds]
    assert len(moves) == 4


def test_a_problem_of_which_nothing_may_move_is_only_reckoned(problem):
    """As it is where all jobs have shipped: there are no moves to wait for, also where it is not valid."""
    state = run(problem, 1, Workers(1), members=1, budget=2 * len(problem.expansion.tasks)).state
    cost, before = total_cost(problem.arrays, state), state.register[MOVES]
    assert cost > 0
    state.register[FROZEN] = len(problem.arrays.entry_offset)
    cluster = Local()
    assert not Away(cluster).advancing(problem)(state, before + 1000, lambda *_: False, None)
    assert (state.register[BEST], state.register[MOVES], len(cluster.bounds)) == (cost, before, 1)
