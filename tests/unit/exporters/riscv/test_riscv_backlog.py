"""How late the management core may be, computed by hand for tables of a few operations."""

from dataclasses import replace

import pytest

from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.riscv.codes import PHASE_TOO_SHORT
from halpipe.exporters.riscv.images import Part
from halpipe.exporters.riscv.operations import (
    COPY,
    DONE,
    RUN,
    Operation,
    Program,
    Release,
    Table,
    find_backlog,
    too_short,
)
from halpipe.exporters.riscv.profile import read_profile
from riscv_models import PHASES, deployed, single
from support import job

US = Duration.parse("1us")
PROFILE = replace(read_profile("vcu118"), service=US * 2)
SYSTEM, _ = single()
JOB = job(SYSTEM, "scale", 0, 0, "u1")


def copy(at, limit=100, needs=3):
    return Operation(at=at, kind=COPY, unit=0, limit=limit, needs=needs, access=PHASES[0])


def program(*operations, unit=0):
    return Program("scale", "v", (unit,), operations, 0, 1)


def mode(length, *releases, index=0):
    return Table("m", index, index, length, tuple(Release(tick, p, JOB) for tick, p in releases))


def test_alone_only_the_release_is_in_the_way():
    """The table's end and the release come first at tick 0, each for 2 us; the first table has no end before it."""
    found = find_backlog([mode(100, (0, 0))], [program(copy(0))], PROFILE)
    assert found.operations == {(0, 0): US * 4}
    assert found.tables[0] == US * 4


def test_operations_at_one_tick_wait_for_each_other():
    programs = [program(Operation(at=50, kind=DONE, unit=0), Operation(at=50, kind=RUN, unit=0), copy(50))]
    found = find_backlog([mode(100, (0, 0))], programs, PROFILE)
    assert [found.operations[0, i] for i in range(3)] == [ZERO, US * 2, US * 4]


def test_an_operation_that_comes_soon_after_waits_for_the_rest():
    programs = [program(Operation(at=50, kind=DONE, unit=0), copy(51))]
    found = find_backlog([mode(100, (0, 0))], programs, PROFILE)
    assert found.operations[0, 1] == US


def test_jobs_that_wrap_meet_those_of_the_next_hyperperiod():
    """Program 1 ends at tick 110 of a table of 100 ticks, just when program 0, released at 10, begins."""
    programs = [program(copy(0)), program(Operation(at=20, kind=DONE, unit=1), unit=1)]
    found = find_backlog([mode(100, (10, 0), (90, 1))], programs, PROFILE)
    assert found.operations[0, 0] == US * 4  # after the check that ends program 1, and the release


def test_a_switch_is_played_too():
    """Alone, neither mode has two jobs at one instant; the old mode's last check meets the new mode's first copy."""
    programs = [program(Operation(at=100, kind=DONE, unit=0)), program(copy(0), unit=1)]
    calm = [mode(100, (0, 0)), mode(100, (50, 1), index=1)]
    assert find_backlog(calm, programs, PROFILE).operations[1, 0] == US * 2
    switched = find_backlog([*calm, Table("a->b", 0, 1, 50, (Release(0, 1, JOB),))], programs, PROFILE)
    assert switched.operations[1, 0] == US * 6  # after the check, the end of the table, and the release


@pytest.mark.parametrize(("limit", "is_enough"), [(7, True), (6, False)])
def test_a_phase_must_hold_lateness_and_transfers(limit, is_enough):
    programs = [program(copy(0, limit=limit))]
    tables = [mode(100, (0, 0))]
    part = Part("scale", deployed(), (), ())
    backlog = find_backlog(tables, programs, PROFILE)
    found = list(too_short(programs, backlog, [part], PROFILE))
    assert (found == []) is is_enough
    if found:
        assert found[0].code == PHASE_TOO_SHORT.id
        assert "its transfers need 3us" in found[0].message
        assert "4us late" in found[0].message
