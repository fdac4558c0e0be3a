"""Wishes of an improvement: what is asked of chains is less in sum, and of delays and units in the order stated."""

import random
from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.integers import Table, ints
from halpipe.pipeline.solve.kernel import quality
from halpipe.pipeline.solve.kernel.kernel import FROZEN_HINT, NEVER, new_state
from halpipe.pipeline.solve.optimise import DELAYS, UNITS
from halpipe.pipeline.solve.problem import NO_TICK, build_problem
from support import after, model, ms, task, version


@pytest.fixture
def latencies(monkeypatch):
    """Let the best placement have given latencies."""

    def of(rows):
        monkeypatch.setattr(quality, "_latencies", lambda _: [list(pair) for pair in rows])
        return rows

    return of


def drawn(rng):
    """Latencies, weights, the least that can be, and limits above which nothing may go."""
    count = rng.randint(1, 4)
    rows = [[rng.randint(20, 400) for _ in range(2)] for _ in range(count)]
    least = [[time - rng.choice((0, 1, 5, 200)) for time in pair] for pair in rows]
    most = [[rng.choice((NO_TICK, time, time + 3, time + 500)) for time in pair] for pair in rows]
    return rows, tuple(rng.randint(1, 5) for _ in range(count)), least, most


@pytest.mark.parametrize("seed", range(30))
def test_what_one_latency_wins_less_one_the_others_may_grow_by(seed, latencies):
    rng = random.Random(seed)
    rows, weights, least, most = drawn(rng)
    latencies(rows)
    ceiling = SimpleNamespace(chain_limit=Table.of(most, 2))
    chain, kind, parts = rng.randrange(len(rows)), rng.randrange(2), rng.choice((8, 64))
    found = quality._traded(None, ceiling, weights, least, (chain, kind), parts)
    win = min(max(1, rows[chain][kind] // parts), rows[chain][kind] - least[chain][kind])
    if win <= 0:
        assert found is None
        return
    asked = [list(row) for row in found]
    assert asked[chain][kind] == rows[chain][kind] - win
    growth = slack = 0
    for number, pair in enumerate(rows):
        for place, time in enumerate(pair):
            if (number, place) == (chain, kind):
                continue
            grown = asked[number][place] - time
            assert grown >= 0
            assert most[number][place] == NO_TICK or asked[number][place] <= most[number][place]
            growth += weights[number] * grown
            is_limited = asked[number][place] == most[number][place]
            slack += weights[number] * (grown + 1) if not is_limited else weights[chain] * win
    assert growth < weights[chain] * win or growth == 0
    assert slack >= weights[chain] * win - 1 or slack == 0


@pytest.mark.parametrize("parts", [8, 64])
@pytest.mark.parametrize("seed", range(10))
def test_all_latencies_are_asked_to_shrink_by_a_part_but_not_below_the_least(seed, parts, latencies):
    rows, _, least, _ = drawn(random.Random(seed))
    latencies(rows)
    found = quality._all_shorter(None, least, parts)
    asked = [[max(low, time - max(1, time // parts)) for time, low in zip(*pairs, strict=True)]
             for pairs in zip(rows, least, strict=True)]  # fmt: skip
    assert found is None if asked == rows else [list(row) for row in found] == asked


def test_chains_without_data_have_no_limit_and_are_not_traded(latencies):
    rows = latencies([[NEVER, 30], [40, 50]])
    assert [list(row) for row in quality._limits(rows)] == [[NO_TICK, 30], [40, 50]]


def test_rounds_of_wishes_go_on_while_they_win_more_than_a_thousandth_of_all(latencies, monkeypatch):
    """3 of 3000 are no more than that, 3 of 2997 are; in a round the chain that weighs most comes first."""
    rows, wins, rounds = latencies([[1000, 800], [400, NEVER]]), iter((3, 3, 0)), []

    def granted(_best, limits, _asked):
        if limits.func is quality._all_shorter:
            rounds.append([limits.args[-1]])
            rows[0][0] -= next(wins)
        else:
            rounds[-1].append(limits.args[-2])
        return iter(())

    monkeypatch.setattr(quality, "_while_granted", granted)
    assert list(quality._shorter_chains(None, None, (1, 3), [[0, 0], [0, 0]])) == []
    assert rounds == [[parts, (1, 0), (0, 0), (0, 1)] for parts in (8, 64, 64)]


def test_shorter_chains_are_asked_for_while_they_are_granted_and_nothing_twice():
    limits = [[9, 9], [8, 8], [7, 7], [6, 6]]
    best, asked = SimpleNamespace(arrays=arrays(chain_limit=None)), {(5, 5)}

    def wished(*rows):
        wanted = iter([*(Table.of([row], 2) for row in rows), None])
        found = Granting(quality._while_granted(best, lambda: next(wanted), asked), lambda w: w.chain_limit[0, 0] > 7)
        return [[*wish.chain_limit.flat] for wish in found.asked]

    assert wished(*limits) == limits[:3]
    assert wished([5, 5], [10, 10]) == []
    assert wished([10, 10], [9, 9], [11, 11]) == [[10, 10]]
    assert wished() == []


class Granting:
    """Answers the wishes of a generator, and notes them."""

    def __init__(self, wishes, is_granted):
        self.asked, answer = [], None
        try:
            while True:
                wish = wishes.send(answer)
                self.asked.append(wish)
                answer = is_granted(wish)
        except StopIteration:
            pass


def arrays(**columns):
    """Arrays that `replace` can change."""
    from dataclasses import make_dataclass

    return make_dataclass("Arrays", columns)(**columns)


@pytest.mark.parametrize(("granted", "asked"), [(4, [0]), (2, [0, 1, 2]), (0, [0, 1, 2, 3])])
def test_less_slack_is_asked_for_by_quarters_from_none_on(granted, asked):
    best = SimpleNamespace(arrays=arrays(option_late=ints([8, 0, 4])))
    wishes = Granting(quality._less_slack(best), lambda wish: wish.option_late[0] // 2 >= 4 - granted)
    assert [list(wish.option_late) for wish in wishes.asked] == [[2 * n, 0, n] for n in asked]
    none = SimpleNamespace(arrays=arrays(option_late=ints([0, 0])))
    assert Granting(quality._less_slack(none), lambda _: False).asked == []


def test_units_of_a_group_are_taken_away_until_that_is_refused():
    best = SimpleNamespace(problem=SimpleNamespace(groups=[0, 1]), arrays=arrays(lane_capacity=ints([3, 2, 9])))

    def grant(wish):
        if wish.lane_capacity[0] < 2 or wish.lane_capacity[1] < 1:
            return False
        best.arrays = wish
        return True

    asked = Granting(quality._fewer_units(best), grant).asked
    assert [list(wish.lane_capacity) for wish in asked] == [[2, 2, 9], [1, 2, 9], [2, 1, 9], [2, 0, 9]]


def jittery(monkeypatch, delays):
    """Let the jobs of tasks have delays."""
    monkeypatch.setattr(quality, "_delays", lambda _: list(delays))
    monkeypatch.setattr(quality, "_lateness", lambda _, asked: ints(asked))
    return SimpleNamespace(arrays=arrays(option_late=ints()))


QUARTERS = [[0, 0, 0], [2, 0, 1], [4, 0, 2], [6, 0, 3]]


@pytest.mark.parametrize(
    ("granted", "asked"),
    [
        ([], [*QUARTERS, [0, 0, 4], [4, 0, 4], [8, 0, 0], [8, 0, 2]]),
        ([[4, 0, 2], [8, 0, 0]], [*QUARTERS[:3], [0, 0, 4], [4, 0, 4], [8, 0, 0]]),
        ([[0, 0, 0], [0, 0, 4]], [QUARTERS[0], [0, 0, 4], [8, 0, 0], [8, 0, 2]]),
    ],
)
def test_less_jitter_is_asked_for_by_quarters_of_all_then_of_each_task_from_none_on(monkeypatch, granted, asked):
    """The task with the largest delay comes first."""
    wishes = Granting(
        quality._less_jitter(jittery(monkeypatch, [8, 0, 4])), lambda wish: [*wish.option_late] in granted
    )
    assert [[*wish.option_late] for wish in wishes.asked] == asked
    assert Granting(quality._less_jitter(jittery(monkeypatch, [0, 0])), lambda _: True).asked == []


def test_the_jitter_of_the_tasks_with_the_most_is_asked_for_one_by_one(monkeypatch):
    monkeypatch.setattr(quality, "JITTERY", 1)
    wishes = Granting(quality._less_jitter(jittery(monkeypatch, [4, 8])), lambda _: False)
    assert [[*wish.option_late] for wish in wishes.asked[4:]] == [[4, 0], [4, 4]]


# ------------------------------------------------------------------------------------------------ placements


def placement():
    """Tasks with two jobs, of a free phase, from an offset of 0, and one that is frozen; and one on demand."""
    tasks = [
        task("free", 10, version("v", 1, "u1"), slack=1),
        task("fixed", 10, version("v", 1, "u2"), slack=1, offset=0),
        task("frozen", 10, version("v", 1, "u3"), slack=1),
        task("asks", 20, version("v", 1, "u4", after("h", 0, 9)), slack=1),
        task("h", None, version("v", 1, "u4")),
    ]
    system = model(*tasks, units="u1 u2 u3 u4")
    problem = build_problem(expand(system, system.modes[0]), system.units, [], tick=ms(1))
    state = new_state(problem.arrays, 1, 1)
    state.phase[:] = ints([15, 18, 1, 6, 2, 9, 4, 3])
    state.start[:] = ints([15, 8, 1, 16, 2, 19, 4, 3])
    state.option[:] = ints([0, 0, 1, 1, 2, 2, 3, 4])
    state.hint[2] = FROZEN_HINT
    return problem, state


def test_jobs_that_are_later_than_a_smaller_slack_allows_come_where_it_ends():
    """From the first of them, or the offset; what is frozen stays."""
    problem, state = placement()
    late = ints([2, 4, 2, 0, 0])
    quality._fit_slack(replace(problem.arrays, option_late=late), state)
    assert state.phase.tolist() == [15, 17, 1, 4, 2, 9, 4, 3]
    assert state.start.tolist() == [15, 7, 1, 14, 2, 19, 4, 3]


def test_delays_count_from_the_offset_or_the_first_job():
    problem, state = placement()
    best = SimpleNamespace(arrays=problem.arrays, state=state)
    assert quality._delays(best) == [3, 6, 7, 0, 0]
    assert problem.arrays.option_late.tolist()[:3] == [9, 9, 9]
    assert quality._lateness(best, [3, 10, 0, 5, 0]).tolist()[:4] == [3, 9, 0, 5]


CHAINS, JITTER, MARGIN = Objective.CHAINS, Objective.JITTER, Objective.MARGIN


@pytest.mark.parametrize(
    ("objectives", "stage", "held"),
    [
        ((CHAINS, JITTER, MARGIN), CHAINS, ["option_late", "margin 3"]),
        ((CHAINS, JITTER, MARGIN), JITTER, ["chain_limit", "margin 3"]),
        ((CHAINS, JITTER, MARGIN), MARGIN, ["chain_limit", "option_late"]),
        ((CHAINS, JITTER, MARGIN), UNITS, ["chain_limit", "option_late", "margin 3"]),
        ((MARGIN, CHAINS), CHAINS, ["margin 1"]),
        ((Objective.COST,), DELAYS, []),
    ],
)
def test_what_other_objectives_have_reached_is_held_while_more_of_one_is_asked_for(
    monkeypatch, objectives, stage, held
):
    found = []
    monkeypatch.setattr(quality, "reserved", lambda problem, margin, _: found.append(f"margin {margin}") or problem)
    for name in ("_latencies", "_delays", "_limits"):
        monkeypatch.setattr(quality, name, lambda _: None)
    monkeypatch.setattr(quality, "_lateness", lambda *_: None)
    for name in ("_fewer_units", "_less_slack", "_less_jitter", "_shorter_chains", "_more_margin"):
        monkeypatch.setattr(quality, name, lambda *_: iter(()))
    monkeypatch.setattr(quality, "chain_bounds", lambda *_: [])
    worth = SimpleNamespace(values=(-1, -2, -3))
    best = SimpleNamespace(problem=None, worth=worth, tighten=lambda **columns: found.extend(columns))
    judge = SimpleNamespace(objectives=objectives, chain_weights=(), model=None, expansion=None)
    assert list(quality._wishes(best, None, stage, SimpleNamespace(judge=judge))) == []
    assert found == held


# ------------------------------------------------------------------------------------------------ the whole


class Steps(quality.Improvement):
    """An improvement whose searches have been made before: what each found, its moves, and whether it was stopped."""

    def __init__(self, steps, is_enough=lambda _: False, worse=()):
        self.steps, self.kept_as, self.told = list(steps), [], []
        judge = SimpleNamespace(
            objectives=(JITTER, MARGIN),
            worth=lambda jobs: SimpleNamespace(values=jobs),
            keeps=lambda _, worth: worth.values not in worse,
        )
        polish = SimpleNamespace(
            judge=judge, is_enough=is_enough, on_better=lambda worth: self.told.append(worth.values)
        )
        best = quality._Best(arrays(arrays=None), None, {}, (5, 5), SimpleNamespace(values=(5, 5)))
        super().__init__(best, polish, None, lambda problem, state, units: state)

    def _recalled(self, asked, kept):
        self.kept_as.append(kept)

    def _searched(self, asked, kept):
        return self.steps.pop(0)


def step(found, moves, stopped=False):
    return quality._Step(None if found is None else (found, {}), moves, stopped)


@pytest.fixture
def two_wishes(monkeypatch):
    """Let there be two wishes of each objective; what became of the first is noted."""
    answers = []

    def wishes(*_):
        answers.append((yield "one"))
        answers.append((yield "two"))

    monkeypatch.setattr(quality, "_wishes", wishes)
    return answers


def test_what_a_wish_leads_to_is_kept_unless_it_is_worse_in_what_counts_by_now(two_wishes):
    """While the jitter is improved, the margin may get worse; then neither may. Nothing may be worse than at first."""
    found = Steps([step((4, 6), 10), step((3, 9), 1), step(None, 2), step((4, 7), 5)], worse=[(3, 9)])
    kept = SimpleNamespace(stage=lambda name: name)
    assert not found.run(kept)
    assert two_wishes == [True, False, False, False]
    assert (found.best.jobs, found.moves, found.told) == ((4, 6), 18, [(4, 6)])
    assert found.kept_as == ["step0", "step1", "step2", "step3"]
    assert Steps([step((5, 4), 1), step((5, 3), 1), step((5, 2), 1), step((5, 1), 1)]).run(None) is False


def test_an_improvement_ends_once_it_is_enough_or_stopped(two_wishes):
    enough = Steps([step((4, 4), 10), step((3, 3), 1)], is_enough=lambda jobs: jobs == (4, 4))
    assert (enough.run(None), enough.moves) == (False, 10)
    stopped = Steps([step((4, 4), 10), step(None, 7, stopped=True)])
    assert (stopped.run(None), stopped.moves, stopped.best.jobs) == (True, 17, (4, 4))
