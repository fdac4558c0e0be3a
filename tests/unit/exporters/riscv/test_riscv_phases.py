"""What happens within a job: how long transfers take, and when the job executes."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.core.durations import Duration
from halpipe.exporters.riscv.codes import (
    FIRST_ALONE,
    KINDLESS_PHASE,
    NO_LOAD_PHASE,
    PHASE_ORDER,
    SHARED_PHASE,
    UNDIVIDED,
)
from halpipe.exporters.riscv.phases import (
    Clock,
    _share,
    check_phases,
    clock_of,
    disorder,
    executions,
    spans,
    written_alone,
)
from halpipe.exporters.riscv.profile import FOLDER, read_profile
from halpipe.models import Resource, Split, Task, TaskModel, Version
from riscv_models import PHASES, deployed, moving, single

US = Duration.parse("1us")
CLOCK = Clock(US, US * 2, {"memory": 400_000_000})


@pytest.mark.parametrize(
    ("size", "ticks"),
    [(1, 3), (400, 3), (401, 4), (800, 4), (4_000_000, 10_002)],  # 400 bytes are exactly one microsecond
)
def test_a_transfer_takes_setup_and_bandwidth_rounded_up(size, ticks):
    assert CLOCK.transfer("memory", size) == ticks


def test_the_slower_of_engine_and_resource_counts():
    system, _ = single()
    [resource] = system.resources
    slow = clock_of(
        type(system)(name="m", resources=(type(resource)(name="memory", bandwidth=1000),)), read_profile("vcu118")
    )
    assert slow.bandwidths == {"memory": 1000}
    assert clock_of(system, read_profile("vcu118")).bandwidths == {"memory": 400_000_000}


@pytest.mark.parametrize(
    ("own", "sure"),
    [
        ([400, 400], [400, 400]),  # 800 MB/s for all: two channels have no need to share
        ([400, 400, 400], [266_666_666, 266_666_666, 266_666_666]),
        ([400, 100, 400], [350, 100, 350]),  # what the slow one leaves
        ([400, 50, 0], [400, 50, 400]),  # nothing is moved on the third
    ],
)
def test_channels_are_sure_of_their_share_of_the_bus_when_all_move(own, sure):
    """400 MB/s at most for each channel; 0: a resource without transfers and without a bandwidth of its own."""
    megabytes = 1_000_000
    resources = [Resource(name=f"r{n}", bandwidth=rate * megabytes or None) for n, rate in enumerate(own)]
    phases = tuple(
        moving(r.name, f"{n}ms", f"{n + 1}ms", "read", ("input", "numbers", 64))
        for n, r in enumerate(resources)
        if r.bandwidth
    )
    version = Version(name="v", wcet=US * 10_000, units=("u",), accesses=phases)
    system = TaskModel(name="m", resources=tuple(resources), tasks=(Task(name="t", versions=(version,)),))
    found = clock_of(system, read_profile("vcu118")).bandwidths
    assert list(found.values()) == [rate if rate > 1000 else rate * megabytes for rate in sure]


def test_a_transfer_takes_as_long_as_its_direction_does():
    text = FOLDER.joinpath("rocket-rtl.yaml").read_text()
    assert "{ispm: 55MB/s, dspm: 100MB/s, main: 150MB/s}, bus: 150MB/s" in text
    resources = (Resource(name="x"), Resource(name="slow", bandwidth=90_000_000))
    clock = clock_of(TaskModel(name="m", resources=resources), read_profile("rocket-rtl"))
    into = {memory: clock.transfer("x", 11_000, memory) for memory in ("ispm", "dspm", "main")}
    assert into == {"ispm": 18 + 200, "dspm": 18 + 110, "main": 18 + 74}
    assert clock.transfer("slow", 9_000, "main") == 18 + 100
    assert clock.transfer("x", 11_000) == 18 + 200  # where the memory is not known, the slowest counts


def test_boundaries_round_inwards():
    assert CLOCK.up(US * Fraction(5, 2)) == 3
    assert CLOCK.down(US * Fraction(5, 2)) == 2
    assert CLOCK.up(US * 2) == CLOCK.down(US * 2) == 2


def stretches(version, functions):
    """Return the stretches in ticks, none where there is a reason against them, and the reason."""
    why = disorder(version, functions, CLOCK)
    found = [(CLOCK.up(begin), CLOCK.down(end)) for begin, end in executions(version, functions)]
    return [] if why else found, why


def test_a_job_executes_between_its_last_read_and_its_first_write():
    found, why = stretches(deployed(), 1)
    assert (found, why) == ([(200, 900)], "")


def test_gaps_before_a_read_are_idle():
    phases = (PHASES[0], moving("memory", "0.4ms", "0.5ms", "read", ("input", "numbers", 64)), PHASES[2])
    assert stretches(deployed(phases=phases), 1)[0] == [(500, 900)]


def test_without_phases_behind_it_the_job_executes_to_its_end():
    assert stretches(deployed(phases=PHASES[:1]), 1)[0] == [(100, 1000)]


def test_one_function_for_each_gap():
    phases = (
        PHASES[0],
        moving("memory", "0.4ms", "0.5ms", "write", ("output", "scaled", 64)),
        moving("memory", "0.5ms", "0.6ms", "read", ("input", "numbers", 64)),
    )
    assert stretches(deployed(phases=phases), 2)[0] == [(100, 400), (600, 1000)]
    assert stretches(deployed(phases=phases), 1)[0] == []
    found, why = stretches(deployed(phases=phases), 3)
    assert not found
    assert "2 stretches of time for 3 functions" in why


def test_no_time_left_is_no_stretch():
    phases = (moving("memory", "0ms", "0.9ms", "load"), PHASES[2])
    assert stretches(deployed(phases=phases), 1)[0] == []


@pytest.mark.parametrize(
    ("phases", "code"),
    [
        (PHASES[1:], NO_LOAD_PHASE),
        ((moving("memory", "0.1ms", "0.2ms", "load"),), NO_LOAD_PHASE),
        ((PHASES[0], moving("memory", "0.5ms", "0.6ms", "load")), PHASE_ORDER),
        ((moving("memory", "0ms", "0.1ms", "load", bound="1/2"),), SHARED_PHASE),
        ((PHASES[0], moving("memory", "0.1ms", "0.2ms", None, ("input", "numbers", 64))), KINDLESS_PHASE),
    ],
)
def test_phases_that_cannot_be_played(phases, code):
    findings = Findings()
    assert not check_phases(deployed(phases=phases), "here", findings)
    assert code.id in {found.code for found in findings.items}
    assert all(found.path == "here" and found.help for found in findings.items)


def test_phases_that_move_nothing_are_left_alone():
    findings = Findings()
    phases = (*PHASES, moving("memory", "0.5ms", "0.6ms", None, bound="1/2"))
    assert check_phases(deployed(phases=phases), "here", findings)


@pytest.mark.parametrize(
    ("size", "gang", "is_divided"),
    [(64, 2, True), (16, 2, True), (8, 2, True), (24, 2, False), (72, 3, True), (64, 3, False), (9, 1, True)],
)
def test_members_of_a_gang_write_whole_words(size, gang, is_divided):
    phases = (*PHASES[:2], moving("memory", "0.9ms", "1ms", "write", ("output", "scaled", size)))
    findings = Findings()
    assert check_phases(deployed(phases=phases, units="u1 u2 u3", gang=gang), "here", findings) is is_divided
    assert [found.code for found in findings.items] == [UNDIVIDED.id] * (not is_divided)


def test_scalars_of_gangs_are_told():
    def version_with(size, gang):
        phases = (*PHASES[:2], moving("memory", "0.9ms", "1ms", "write", ("output", "scaled", size)))
        return deployed(phases=phases, units="u1 u2", gang=gang)

    def told(size, gang):
        return [(d.code, d.path) for d in written_alone([("here", version_with(size, gang))])]

    assert told(8, 2) == [(FIRST_ALONE.id, "here")]
    assert told(16, 2) == told(8, 1) == []


def test_functions_are_those_between_phases_before_those_between_preemption_points():
    """Two executions with a phase between them are two functions, although the first could be preempted."""
    ms = US * 1000
    loads = tuple(moving("memory", f"{start}ms", f"{start + 1}ms", "load") for start in (0, 5))
    divided = Version(name="v", wcet=ms * 10, units=("u",), accesses=loads, split=Split(points=(ms * 3,)))
    assert executions(divided, 2) == [(ms, ms * 5), (ms * 6, ms * 10)]
    assert executions(divided, 3) == [(ms, ms * 3), (ms * 3, ms * 5), (ms * 6, ms * 10)]
    assert executions(divided, 4) == []


@pytest.mark.parametrize(("point", "pieces"), [("0.2ms", 1), ("0.2001ms", 2), ("0.8999ms", 2), ("0.9ms", 1)])
def test_a_preemption_point_where_a_phase_begins_or_ends_cuts_nothing(point, pieces):
    """Execution is from 0.2 to 0.9 ms."""
    version = replace(deployed(), split=Split(points=(Duration.parse(point),)))
    found = spans(version, cut=True)
    assert len(found) == pieces
    assert all(begin < end for begin, end in found)


@pytest.mark.parametrize(
    ("rates", "bus", "least"),
    [
        ([40, 1, 10], 31, 20),
        ([40, 1, 10], 51, 40),
        ([40, 1, 10], 52, 52),
        ([40, 1, 10], 50, 39),
        ([10, 10, 10], 20, 6),
        ([5, 5], 1, 1),
    ],
)
def test_what_slower_channels_leave_of_the_bus_is_shared_by_the_others(rates, bus, least):
    assert _share(rates, bus) == least
