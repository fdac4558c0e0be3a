"""Dummy tasks: where data moves, and how far executions count."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.durations import Duration
from halpipe.exporters.riscv.phases import Clock
from halpipe.exporters.riscv.prepare import FILE, with_dummies
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Renderer
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


def test_where_instructions_take_longer_it_counts_less():
    slow = dummy(profile=replace(PROFILE, cpi=Fraction(7, 4)))
    assert f"COUNT_0={97_100 * 9 // 10 * 4 // (7 * 2)}" in slow.source.defines


def test_a_window_in_the_middle_moves_data_out_and_in():
    found = dummy(window("0.4ms", "0.6ms"))
    assert shape(found) == [("400us", "500us", "write", 1), ("500us", "600us", "read", 1)]
    assert found.source.entry == "dummy_0 dummy_1"
    assert {"COUNT_0=16695", "COUNT_1=16695"} <= set(found.source.defines)


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
