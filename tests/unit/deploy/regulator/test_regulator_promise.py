"""What is promised in every window, held against integrals that are taken piece by piece on a fine grid."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from math import ceil

import pytest
from hypothesis import given
from hypothesis import strategies as st

import regulator_bundles as bundles
import regulator_switches
from halpipe.core.durations import Duration
from halpipe.deploy.regulator import promise
from halpipe.deploy.regulator.promise import Phase, Timeline
from halpipe.deploy.regulator.reading import Platform
from halpipe.models import AccessKind, Interrupt, Job, Part, Split, Unit
from profiles import examples
from support import access, job, mode, model, ms, schedule, task, version

ROW = ("u", "read")
PLATFORM = Platform(
    name="p",
    resource="mem",
    clock_hz=10**9,
    bus_bytes=8,
    burst_bytes=8,
    window_cycles=6,
    window_extra=Fraction(0),
    guaranteed=Fraction(8 * 10**9),
    capacity=Fraction(8 * 10**9),
    unspecified="read",
)
"""A window of 6 ns with 6 bursts of 8 B."""

SPAN = 48
GRID = 6  # parts of a nanosecond

phases = st.lists(
    st.tuples(st.integers(0, SPAN * GRID - 1), st.integers(1, SPAN * GRID), st.integers(1, 12)), min_size=1, max_size=5
).map(lambda items: [Phase(ROW, Fraction(a, GRID), Fraction(a + d, GRID), Fraction(s, 12)) for a, d, s in items])


def rate_at(timeline, instant):
    """The sum of the shares in force in the part of a nanosecond that begins at `instant`."""
    turns = (0, 1) if timeline.circular else (0,)
    return sum(
        phase.share for phase in timeline.phases for turn in turns if phase.start <= instant + turn * SPAN < phase.end
    )


@examples(60)
@given(phases, st.booleans())
def test_the_volume_of_every_window_is_the_integral_of_the_rate(items, circular):
    timeline = Timeline(Fraction(SPAN), tuple(items), circular)
    volumes, scale = promise.promised_bursts(timeline, PLATFORM, items, 8)
    total = Fraction(0)
    for window in range(8):
        for part in range(6 * GRID):
            total += rate_at(timeline, window * 6 + Fraction(part, GRID)) * Fraction(1, GRID)
        assert Fraction(volumes[window + 1], scale) == total


@examples(60)
@given(phases, st.booleans())
def test_whole_bursts_are_the_promise_of_each_window_rounded_up(items, circular):
    timeline = Timeline(Fraction(SPAN), tuple(items), circular)
    found = promise.whole_bursts(timeline, PLATFORM, items, 8)
    for window in range(8):
        parts = (rate_at(timeline, window * 6 + Fraction(part, GRID)) for part in range(6 * GRID))
        assert found[window] == ceil(sum(parts) / GRID)


# ------------------------------------------------------------------------------------------------ timelines


def test_the_phases_of_jobs_are_shared_by_the_gang_and_told_apart_by_kind():
    t = task("t", "48ns", version("v", "10ns", "u1 u2", access("mem", "1ns", "3ns", "1/2"), gang=2))
    system = model(t, units="u1 u2", resources="mem other")
    found = list(promise.phases_of(system, PLATFORM, [job(system, "t", 0, "5ns", "u1 u2")]))
    assert found == [Phase((unit, "read"), Fraction(6), Fraction(8), Fraction(1, 4)) for unit in ("u1", "u2")]


def test_the_phases_of_a_job_with_gaps_are_where_it_executes_them():
    """Parts [8, 10) and [25, 28.5): 0.5 to resume, and an interrupt of 1 every 2."""
    split = Split(points=(ms("1ns"),), resume=ms("0.5ns"))
    phases = (access("mem", "0ns", "1ns"), access("mem", "1ns", "2ns", kind=AccessKind.WRITE))
    t = task("t", "20ns", replace(version("v", "2ns", "u1", *phases), split=split))
    served = Unit(name="u1", interrupts=(Interrupt(name="i", distance=ms("2ns"), wcet=ms("1ns")),))
    system = replace(model(t, units="u1", resources="mem"), units=(served,))
    parts = [
        Part(start=ms(a), end=ms(b), executed_from=ms(p), executed_to=ms(q))
        for a, b, p, q in (("8ns", "10ns", "0ns", "1ns"), ("25ns", "28.5ns", "1ns", "2ns"))
    ]
    placed = Job(task="t", index=0, start=ms("8ns"), end=ms("28.5ns"), version="v", units=("u1",), parts=tuple(parts))
    assert list(promise.phases_of(system, PLATFORM, [placed])) == [
        Phase(("u1", "read"), Fraction(8), Fraction(10), Fraction(1)),
        Phase(("u1", "write"), Fraction(51, 2), Fraction(57, 2), Fraction(1)),
    ]


@pytest.mark.parametrize(
    ("work", "interrupts", "needed"),
    [(9, [], 9), (9, [(10, 2)], 13), (8, [(10, 2)], 10), (9, [(10, 2), (5, 1)], 17), (0, [(10, 2)], 0)],
)
def test_work_takes_as_long_as_with_all_interrupts_that_can_come(work, interrupts, needed):
    several = [(Fraction(apart), Fraction(time)) for apart, time in interrupts]
    assert promise._with_interrupts(Fraction(work), several) == needed


def test_other_resources_do_not_count():
    t = task("t", "48ns", version("v", "10ns", "u1", access("other", "1ns", "3ns")))
    system = model(t, units="u1", resources="mem other")
    assert list(promise.phases_of(system, PLATFORM, [job(system, "t", 0, "5ns", "u1")])) == []


def line(length, *, tail="24ns", early=()):
    """The line of a switch from a mode whose last job reads until `tail` after its end."""
    a = task("a", "48ns", version("v", "40ns", "u1", access("mem", "0ns", "40ns", "1/2")))
    b = task("b", "48ns", version("v", "40ns", "u1", access("mem", "0ns", "40ns", "1/4")))
    system = model(a, b, units="u1", resources="mem", modes=[mode("x", (a,)), mode("y", (b,))])
    start = Duration.parse("48ns") + Duration.parse(tail) - Duration.parse("40ns")
    x = schedule(system, "48ns", job(system, "a", 0, start, "u1"), mode_name="x").modes[0]
    y = schedule(system, "48ns", job(system, "b", 0, "4ns", "u1"), mode_name="y").modes[0]
    from halpipe.models import Status, TransitionTable

    table = TransitionTable(
        source="x",
        target="y",
        length=Duration.parse(length),
        worst_latency=Duration.parse("96ns"),
        status=Status.VALID,
        jobs=early,
    )
    return promise.transition_timeline(system, PLATFORM, x, table, y)


@pytest.mark.parametrize(
    ("length", "tail", "cycles", "span"),
    [
        ("24ns", "24ns", 0, 24),  # the tail ends with the switch
        ("18ns", "24ns", 1, 66),  # it reaches into the first cycle, where the new mode's own table lacks it
        ("0ns", "24ns", 1, 48),
        ("0ns", "0ns", 0, 0),  # nothing left over: no table at all
    ],
)
def test_a_switch_covers_what_is_left_over(length, tail, cycles, span):
    timeline, found = line(length, tail=tail)
    assert found == cycles
    assert timeline.span == span


def test_the_line_has_the_tail_and_what_the_new_mode_starts():
    timeline, _ = line("18ns")
    assert sorted(timeline.phases, key=lambda p: p.start) == [
        Phase(("u1", "read"), Fraction(-16), Fraction(24), Fraction(1, 2)),
        Phase(("u1", "read"), Fraction(22), Fraction(62), Fraction(1, 4)),
    ]
    granted = promise.whole_bursts(timeline, PLATFORM, timeline.phases, 11)
    assert granted == [3, 3, 3, 4, 2, 2, 2, 2, 2, 2, 1]  # 3 + 2/6 of 1.5 from 22 ns on; the last from 60 to 62 ns


def test_windows_that_do_not_fit_show_as_a_fraction():
    timeline, _ = line("17ns")
    assert promise.windows_of(timeline, PLATFORM) == Fraction(65, 6)


def test_sample_bundle_by_hand():
    m, s = bundles.system()
    platform = Platform(
        name="p",
        resource="mem",
        clock_hz=10**8,
        bus_bytes=8,
        burst_bytes=64,
        window_cycles=64,
        window_extra=Fraction(0),
        guaranteed=Fraction(8 * 10**8),
        capacity=Fraction(8 * 10**8),
        unspecified="read",
    )
    timeline = promise.mode_timeline(m, platform, s.mode("full"))
    rows = timeline.by_row()
    assert (
        promise.whole_bursts(timeline, platform, rows["u1", "read"], 40)
        == [0] * 20 + [4] * 6 + [0] * 4 + [2] * 3 + [0] * 7
    )
    assert promise.whole_bursts(timeline, platform, rows["u1", "write"], 40) == [0] * 6 + [3] * 4 + [0] * 30


@pytest.mark.parametrize("least", [0, 2])
@pytest.mark.parametrize("seed", range(60))
def test_a_switch_is_followed_until_the_mode_after_grants_what_is_in_force(seed, least):
    system, drawn = regulator_switches.drawn(seed)
    (x, y), (switch,) = drawn.modes, drawn.transitions
    timeline, cycles = promise.transition_timeline(system, PLATFORM, x, switch, y, least)
    assert cycles == max(least, regulator_switches.cycles_needed(system, drawn))
    assert timeline.span == (switch.length + y.hyperperiod * cycles).fraction
    for instant in range(int(timeline.span / 10**6)):
        due = Counter()
        for phase in timeline.phases:
            if phase.start <= instant * 10**6 < phase.end:
                due[phase.row] += phase.share
        assert due == regulator_switches.line(system, drawn, instant)
