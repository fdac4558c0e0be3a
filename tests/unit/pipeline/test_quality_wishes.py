"""Wishes of an improvement: what is asked of chains is less in sum, and of delays and units in the order stated."""

import random
from types import SimpleNamespace

import pytest

from halpipe.pipeline.solve.integers import Table, ints
from halpipe.pipeline.solve.kernel import quality
from halpipe.pipeline.solve.kernel.kernel import NEVER
from halpipe.pipeline.solve.problem import NO_TICK


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
