"""Dummy tasks: where data moves, and how far executions count."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.riscv.cores import Core
from halpipe.exporters.riscv.drivers import Driver, Drivers
from halpipe.exporters.riscv.images import Part
from halpipe.exporters.riscv.phases import Clock
from halpipe.exporters.riscv.prepare import FILE, _grow, grow, with_dummies
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Renderer
from halpipe.exporters.riscv.toolchain import Elf, Segment
from halpipe.models import AccessKind, Split
from riscv_models import deployed, moving
from support import model, task, version

US = Duration.parse("1us")
PROFILE = replace(read_profile("vcu118"), service=Duration.parse("1500ns"))
CLOCK = Clock(US, US * 2, {"memory": 400_000_000})


def window(start, end, bound=1):
    return moving("memory", start, end, None, bound=bound)


def dummy(*phases, wcet="1ms", profile=PROFILE):
    made, _ = with_dummies(
        model(task("a", "5ms", version("v", wcet, "u1", *phases)), resources="memory"), profile, CLOCK
    )
    return made.tasks[0].versions[0]


def shape(found):
    return [(str(a.start), str(a.end), str(a.kind) if a.kind else "", len(a.transfers)) for a in found.accesses]


def test_without_windows_it_only_counts():
    found = dummy()
    assert found.source.files == (FILE,)
    assert found.source.entry == "dummy_0"
    # Of 1 ms, 24 us may be lost by starting late (four operations for each of four cores), and 5 us are for the start:
    # 97 100 cycles at 100 MHz, of which 90 % count, two a count.
    assert "COUNT_0=43695" in found.source.defines


def test_it_counts_once_at_least():
    assert "COUNT_0=1" in dummy(wcet="20us").source.defines


def test_where_instructions_take_longer_it_counts_less():
    slow = dummy(profile=replace(PROFILE, cpi=Fraction(7, 4)))
    assert f"COUNT_0={97_100 * 9 // 10 * 4 // (7 * 2)}" in slow.source.defines


def test_a_window_in_the_middle_moves_data_out_and_in():
    found = dummy(window("0.4ms", "0.6ms"))
    assert shape(found) == [("400us", "500us", "write", 1), ("500us", "600us", "read", 1)]
    assert found.source.entry == "dummy_0 dummy_1"
    assert {"COUNT_0=16695", "COUNT_1=16695"} <= set(found.source.defines)


def test_a_window_of_one_tick_is_not_divided():
    assert shape(dummy(window("0.4ms", "0.401ms"))) == [("400us", "401us", "write", 1)]


def test_windows_at_the_ends_have_one_direction():
    found = dummy(window("0ms", "0.1ms"), window("0.8ms", "1ms"))
    assert shape(found) == [("0ms", "100us", "read", 1), ("800us", "1ms", "write", 1)]
    assert found.source.entry == "dummy_0"


def test_windows_that_touch_are_not_both_ways():
    found = dummy(window("0.2ms", "0.3ms"), window("0.3ms", "0.4ms"))
    assert [kind for _, _, kind, _ in shape(found)] == ["write", "read"]


def test_shared_windows_move_nothing():
    assert shape(dummy(window("0.4ms", "0.6ms", bound="1/2"))) == [("400us", "600us", "", 0)]


def test_all_transfers_of_a_version_have_the_size_that_the_shortest_has_time_for():
    found = dummy(window("0.1ms", "0.106ms"), window("0.4ms", "0.6ms"))
    assert PROFILE.patience == 24
    # Of the first window, 3 us are for each direction: 2 us set-up, and 400 bytes in the third.
    assert {t.size for a in found.accesses for t in a.transfers} == {384}
    assert "WORDS=48" in found.source.defines


def test_boundaries_are_widened_to_ticks():
    found = dummy(window("0.1005ms", "0.2005ms"))
    assert shape(found)[0][0] == "100us"
    assert shape(found)[-1][1] == "201us"


def test_executions_too_short_to_begin_become_a_part_of_windows():
    """Twice what may be lost is 58 us."""
    found = dummy(window("0.057ms", "0.2ms"), window("0.258ms", "0.4ms"), window("0.5ms", "0.943ms"))
    assert shape(found)[0] == ("0ms", "200us", "read", 1)
    assert shape(found)[1][:2] == ("258us", "329us")
    assert shape(found)[-1] == ("500us", "1ms", "write", 1)
    assert found.source.entry == "dummy_0 dummy_1"


def test_windows_grow_over_short_executions_between_them():
    """30 us between two windows, and 58 between the next two, which are enough."""
    found = dummy(window("0.1ms", "0.2ms"), window("0.23ms", "0.4ms"), window("0.458ms", "0.6ms"))
    assert [shape[:3] for shape in shape(found)] == [
        ("100us", "200us", "write"),
        ("200us", "400us", "read"),
        ("458us", "529us", "write"),
        ("529us", "600us", "read"),
    ]
    assert found.source.entry == "dummy_0 dummy_1 dummy_2"


def test_a_phase_that_moves_nothing_stays_as_short_as_it_is():
    idle = version("v", "1ms", "u1", moving("memory", "0.5ms", "0.5005ms", None))
    grown = grow(idle, [(400, "ispm")], "memory", CLOCK, 24, lambda access: ZERO, 0)
    assert [(str(a.start), str(a.end)) for a in grown.accesses] == [("0ms", "27us"), ("527us", "527.5us")]
    assert str(grown.wcet) == "1.027ms"


@pytest.mark.parametrize(("units", "end"), [("u1", "27us"), ("u1 u2", "127us"), ("u1 u2 u3", "227us")])
def test_a_load_outlasts_a_driver_of_every_other_core(units, end):
    """Operations of four cores take 24 us, 400 bytes 3 us, and a driver 100 us."""
    core = Core("u1", 0, PROFILE.ispm.of(0), PROFILE.dspm.of(0))
    drivers = Drivers((Driver("out", "put", US * 100, AccessKind.WRITE, "", Location("d")),))
    owner = version("v", "1ms", "u1")
    system = model(task("a", "5ms", owner), units=units, resources="memory")
    elf = Elf((Segment(0, 0, PROFILE.ispm.base, 400),), {})
    grown = _grow(Part("a", owner, (core,), ()), elf, system, PROFILE, drivers, Findings(), 0)
    assert str(grown.accesses[0].end) == end


def test_what_lies_at_an_instant_is_later_by_what_grew_before_it():
    phases = [moving("memory", "0ms", "10us", "load"), moving("memory", "10us", "20us", "read", ("in", "a", 400))]
    split = Split(points=(US * 20, US * 500))
    owner = replace(version("v", "1ms", "u1", *phases), split=split)
    grown = grow(owner, [(400, "ispm"), (800, "dspm")], "memory", CLOCK, 24, lambda access: US * 5, copying=40)
    assert [(str(a.start), str(a.end)) for a in grown.accesses] == [("0ms", "40us"), ("40us", "72us")]  # 24, 5 and 3
    assert [str(point) for point in grown.split.points] == ["72us", "552us"]
    assert grow(owner, [(400, "ispm")], "memory", CLOCK, 3, lambda access: US * 4, 0) == owner  # 6 and 10 of ten


def test_versions_with_sources_stay():
    system = model(task("a", "5ms", deployed()), resources="memory")
    assert with_dummies(system, PROFILE, CLOCK) == (system, 0)


@pytest.mark.parametrize("most", [1, 2])
def test_what_has_dummies_has_them_again(most):
    phases = [window("0.4ms", "0.6ms")] if most == 2 else []
    once = with_dummies(model(task("a", "5ms", version("v", "1ms", "u1", *phases)), resources="memory"), PROFILE, CLOCK)
    assert once[1] == most
    assert with_dummies(once[0], PROFILE, CLOCK) == once


RENDER = Renderer(PROFILE)


@pytest.mark.parametrize(("end", "size"), [("0.402ms", 64), ("0.6ms", 8192), ("0.8ms", 8192)])
def test_dummies_move_from_64_to_8192_bytes(end, size):
    """For a tick there is time for nothing, for 100 us for 39 200 bytes."""
    found = dummy(window("0.4ms", end))
    assert {t.size for a in found.accesses for t in a.transfers} == {size}
    assert f"WORDS={size // 8}" in found.source.defines


def test_executions_are_cut_at_preemption_points():
    """Of each half 29 us may be lost; 47 100 cycles, of which 90 % count, two a count."""
    split = replace(version("v", "1ms", "u1"), split=Split(points=(US * 500,)))
    made, most = with_dummies(model(task("a", "5ms", split), resources="memory"), PROFILE, CLOCK)
    source = made.tasks[0].versions[0].source
    assert (most, source.entry) == (2, "dummy_0 dummy_1")
    assert {"COUNT_0=21195", "COUNT_1=21195"} <= {*source.defines}
