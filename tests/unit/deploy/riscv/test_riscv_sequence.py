"""Tables in the order in which they have to be played, and requests that lead through all of them."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import Duration
from halpipe.deploy.riscv.run.sequence import Request, played_tables, tables_named, tours
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from support import ms

TICK = ms("1us")


def schedule_of(modes, transitions):
    return Schedule(
        model="m",
        model_sha256="",
        modes=tuple(ModeSchedule(name=n, hyperperiod=ms(h), status=Status.VALID, jobs=()) for n, h in modes),
        transitions=tuple(
            TransitionTable(source=a, target=b, length=ms(n), worst_latency=ms(0), status=Status.VALID)
            for a, b, n in transitions
        ),
    )


RACE = schedule_of([("race", 25), ("stop", 10)], [("race", "stop", 5), ("stop", "race", 0)])


def names(requests, tables=6, first="race"):
    return [t.name for t in played_tables(RACE, first, requests, tables, TICK)]


def test_without_requests_a_mode_repeats():
    played = played_tables(RACE, "race", [], 3, TICK)
    assert [(t.cycle, t.name, t.start) for t in played] == [
        (0, "race", ms(0)),
        (1, "race", ms(25)),
        (2, "race", ms(50)),
    ]


def test_a_request_leads_through_the_transition_at_the_end_of_the_hyperperiod():
    played = played_tables(RACE, "race", [Request(ms(30), "stop")], 6, TICK)
    assert [(t.name, t.start) for t in played[1:5]] == [
        ("race", ms(25)),
        ("race->stop", ms(50)),
        ("stop", ms(55)),
        ("stop", ms(65)),
    ]


@pytest.mark.parametrize(("instant", "stays"), [("24.998ms", 1), ("24.9981ms", 2)])
def test_a_request_is_taken_up_to_two_ticks_before_the_end(instant, stays):
    assert names([Request(ms(instant), "stop")]).index("race->stop") == stays


def test_the_last_of_several_requests_counts():
    three = schedule_of([("a", 10), ("b", 10), ("c", 10)], [("a", "b", 0), ("a", "c", 0)])
    played = played_tables(three, "a", [Request(ms(1), "b"), Request(ms(2), "c")], 3, TICK)
    assert [t.name for t in played] == ["a", "a->c", "c"]


def test_a_request_without_a_transition_has_no_effect_and_is_forgotten():
    one_way = schedule_of([("a", 10), ("b", 10)], [("b", "a", 0)])
    assert [t.name for t in played_tables(one_way, "a", [Request(ms(1), "b")], 3, TICK)] == ["a"] * 3


def test_requests_during_a_transition_wait_for_the_mode():
    assert names([Request(ms(1), "stop"), Request(ms(27), "race")]) == [
        "race",
        "race->stop",
        "stop",
        "stop->race",
        "race",
        "race",
    ]


def test_tables_by_their_names():
    played = played_tables(RACE, "race", [Request(ms(30), "stop")], 6, TICK)
    assert tables_named(RACE, [t.name for t in played]) == played
    assert [t.cycle for t in tables_named(RACE, ["race", "nonsense", "race"])] == [0, 1]
    assert tables_named(RACE, ["nonsense"]) == []


@st.composite
def graphs(draw):
    modes = [(f"m{i}", draw(st.integers(1, 40))) for i in range(draw(st.integers(1, 5)))]
    pairs = [(a, b) for a, _ in modes for b, _ in modes if a != b]
    chosen = draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
    return schedule_of(modes, [(a, b, draw(st.integers(0, 30))) for a, b in chosen])


@given(graphs(), st.integers(1, 3))
def test_tours_play_everything(schedule, cycles):
    seen = []
    for tour in tours(schedule, cycles):
        played = played_tables(schedule, tour.first, tour.requests, tour.tables, TICK)
        seen += played
        assert len(played) == tour.tables
        # A mode that is left, and the last one, has been played as often as asked for.
        stays, count = [], 0
        for table in played:
            count = 0 if table.is_transition else count + 1
            if table.is_transition:
                continue
            stays.append(count)
        assert count >= cycles
    assert {t.name for t in seen} == {m.name for m in schedule.modes} | {
        f"{t.source}->{t.target}" for t in schedule.transitions
    }


@given(graphs(), st.integers(1, 3))
def test_requests_of_tours_are_far_from_the_instants_of_decision(schedule, cycles):
    for tour in tours(schedule, cycles):
        played = played_tables(schedule, tour.first, tour.requests, tour.tables, TICK)
        ends = [t.start + t.length for t in played]
        for request in tour.requests:
            nearest = min(abs((end - request.instant).fraction) for end in ends)
            assert Duration(Fraction(nearest)) >= ms("0.5ms")
