"""Random schedules that use all of the bandwidth: capacity is never exceeded, and nobody is ever a burst behind."""

from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import milliseconds
from halpipe.exporters.regulator.frames import Framer, grid_of
from halpipe.exporters.regulator.rounding import Overload, controlled, promises, whole
from halpipe.models import ModeSchedule, Schedule, Status
from profiles import examples
from support import access, job, model, ms, task, version

WINDOW = milliseconds(1)
UNITS = ("u1", "u2", "u3", "u4")


@st.composite
def full_loads(draw, aligned=False, quanta=None):
    """Units that share the whole resource at every instant, in other parts after every cut of the hyperperiod.

    Each stretch between two cuts is one access phase per unit, of one job per unit that lasts the hyperperiod and may
    begin anywhere in it. With `aligned`, cuts and starts are whole windows; with `quanta`, bounds are multiples of it.
    """
    windows = draw(st.integers(2, 12))
    scale = 1 if aligned else draw(st.sampled_from((3, 7, 8)))
    total = windows * scale
    cuts = sorted(draw(st.sets(st.integers(1, total - 1), max_size=5)))
    edges = [Fraction(e, scale) for e in (0, *cuts, total)]
    shift = Fraction(draw(st.integers(0, total - 1)), scale)
    accesses = {unit: [] for unit in UNITS}
    for begin, end in pairwise(edges):
        if quanta is None:
            weights = draw(st.lists(st.integers(0, 9), min_size=4, max_size=4).filter(any))
        else:
            marks = sorted(draw(st.lists(st.integers(0, quanta), min_size=3, max_size=3)))
            weights = [b - a for a, b in zip((0, *marks), (*marks, quanta), strict=True)]
        for unit, weight in zip(UNITS, weights, strict=True):
            if weight:
                kind = draw(st.sampled_from(("read", "write")))
                bound = Fraction(weight, sum(weights))
                accesses[unit].append(access("mem", ms(f"{begin}ms"), ms(f"{end}ms"), bound, kind))
    tasks = [task(f"t-{u}", f"{windows}ms", version("v", f"{windows}ms", u, *a)) for u, a in accesses.items()]
    system = model(*tasks, units=" ".join(UNITS), resources="mem")
    jobs = tuple(job(system, t.name, 0, f"{shift}ms", u) for t, u in zip(tasks, UNITS, strict=True))
    table = ModeSchedule(name="all", hyperperiod=ms(f"{windows}ms"), status=Status.VALID, jobs=jobs)
    return system, Schedule(model="m", model_sha256="", modes=(table,))


def promised(system, schedule, bursts):
    grid = grid_of(system, schedule, WINDOW)
    (frame,) = Framer(system, schedule, "mem", grid, "read").frames()
    return frame.span // grid.window, promises(frame, grid.window, Fraction(bursts))


def fluid(system, schedule, row, instant, bursts):
    """Bursts promised to a row up to an instant (in ms): a sum over phases that shares nothing with the exporter."""
    volume = Fraction(0)
    for placed in schedule.modes[0].jobs:
        span = schedule.modes[0].hyperperiod
        for a in system.task(placed.task).versions[0].accesses:
            if placed.units != (row.unit,) or a.kind != row.direction:
                continue
            for turn in (-1, 0):
                begin = (placed.start + a.start + span * turn) / WINDOW
                end = (placed.start + a.end + span * turn) / WINDOW
                volume += a.bound * bursts * max(Fraction(0), min(end, instant) - max(begin, Fraction(0)))
    return volume


@examples(60)
@given(full_loads(), st.integers(1, 40))
def test_controlled_rounding_of_any_full_load_keeps_both_promises(load, room):
    windows, exact = promised(*load, room)
    found = controlled(exact, windows, room)
    assert not isinstance(found, Overload), found
    for k in range(windows):
        assert sum(bursts[k] for bursts in found.values()) <= room
    for row, bursts in found.items():
        for k in range(windows + 1):
            volume = fluid(*load, row, k, room)
            assert floor(volume) <= sum(bursts[:k]) <= ceil(volume)


@examples(40)
@given(full_loads())
def test_promises_are_the_fluid_schedule(load):
    windows, exact = promised(*load, 10)
    for row, promise in exact.items():
        assert [promise.at(k) for k in range(windows + 1)] == [fluid(*load, row, k, 10) for k in range(windows + 1)]


@examples(40)
@given(full_loads(aligned=True, quanta=12))
def test_whole_bursts_on_whole_windows_are_served_exactly_by_both_rules(load):
    windows, exact = promised(*load, 12)
    bursts = whole(exact)
    assert bursts == controlled(exact, windows, 12)
    for row, values in bursts.items():
        assert values == [fluid(*load, row, k + 1, 12) - fluid(*load, row, k, 12) for k in range(windows)]
    assert all(sum(values[k] for values in bursts.values()) == 12 for k in range(windows))


@examples(40)
@given(full_loads(), st.integers(1, 40))
def test_rounding_every_window_up_is_never_behind_and_at_most_a_burst_a_row_above(load, bursts):
    windows, exact = promised(*load, bursts)
    found = whole(exact)
    for row, values in found.items():
        for k in range(windows):
            share = fluid(*load, row, k + 1, bursts) - fluid(*load, row, k, bursts)
            assert share <= values[k] < share + 1


@given(full_loads(aligned=True, quanta=12))
def test_a_full_load_does_not_fit_into_a_slot_less(load):
    windows, exact = promised(*load, 12)
    assert controlled(exact, windows, 11) == Overload(0, 12, 11)
