"""Access phases and transfers."""

from dataclasses import replace

import pytest
from validate_cases import alone, codes_of, found, the

from halpipe.core.diagnostics import Location
from halpipe.models import Interrupt, Split, Transfer
from halpipe.pipeline.validate import codes, validate
from support import access, model, ms, task, version


def phases(*accesses, wcet="10ms"):
    return alone(wcet, *accesses, resources="bus mem")


def used(*accesses):
    """Both resources are used, so that nothing else is found."""
    return phases(*accesses, access("mem", 0, 1))


@pytest.mark.parametrize(("start", "end"), [(2, 2), (3, 2)])
def test_empty_phase(start, end):
    assert the(used(access("bus", start, end)), codes.EMPTY_PHASE).path == 'task "a" version "v" access to "bus"'


def test_phase_beyond_wcet():
    assert validate(used(access("bus", 9, 10))) == ()
    late = replace(access("bus", 9, "10000001ns"), at=Location("m.xml", 5))
    finding = the(used(late), codes.PHASE_BEYOND_WCET)
    assert finding.at == Location("m.xml", 5)
    assert finding.message == "ends at 10.000001ms, the WCET is 10ms"


def test_phase_without_a_wcet_to_compare_with():
    assert found(phases(access("bus", 9, 10), wcet=None), codes.PHASE_BEYOND_WCET) == []


@pytest.mark.parametrize("bound", ["0", "-1/2", "1001/1000"])
def test_bad_bound(bound):
    assert len(found(used(access("bus", 0, 1, bound)), codes.BAD_BOUND)) == 1


@pytest.mark.parametrize("bound", ["1/1000", "1"])
def test_good_bound(bound):
    assert validate(used(access("bus", 0, 1, bound))) == ()


def test_overlapping_phases_may_share_the_whole_resource():
    thirds = [access("bus", 0, 2, "1/3"), access("bus", 1, 3, "1/3"), access("bus", 1, 2, "1/3")]
    assert validate(used(*thirds)) == ()


def test_overlapping_phases_beyond_the_resource():
    finding = the(
        used(access("bus", 0, 2, "2/3"), access("bus", 1, 3, "1/3"), access("bus", "1.5", 2, "1/3")), OVERLOAD
    )
    assert finding.message == "3 phases are in force together at 1.5ms, with bounds that sum to 4/3"


OVERLOAD = codes.PHASES_OVERLOAD


def stretched(second_at=1, split=None, served="u1", bound="2/3", units="u1"):
    """A phase until 1 ms, which interrupts stretch by 1 ms, and another one behind it."""
    accesses = access("mem", 0, 1, "2/3"), access("mem", second_at, 6, bound)
    owner = task("a", 20, replace(version("v", 6, units, *accesses), split=split or Split()), slack=1)
    system = model(owner, units="u1 u2", resources="mem")
    interrupt = Interrupt(name="i", distance=ms(10), wcet=ms(1))
    serving = (replace(u, interrupts=(interrupt,) if u.name in served.split() else ()) for u in system.units)
    return replace(system, units=tuple(serving))


@pytest.mark.parametrize(
    "case",
    [
        {},
        {"split": Split(points=(ms(6) / 2,), max_gaps=0), "second_at": 1},
        {"split": Split(anywhere=True, max_gaps=0)},
        {"served": "u1 u2", "units": "u1 u2"},
        {"second_at": "1.9ms"},
    ],
)
def test_interrupts_stretch_a_phase_over_the_next_one(case):
    """It is in force until all of them have come, the next one as soon as none does; no placement can help."""
    found = the(stretched(**case), codes.PHASES_OVERLOAD)
    assert found.message.endswith("beside interrupts, with bounds that sum to 4/3")


@pytest.mark.parametrize(
    "case",
    [
        {"second_at": 2},  # the limit itself
        {"bound": "1/3"},
        {"split": Split(points=(ms(1),))},  # a gap may lie between them
        {"split": Split(anywhere=True, max_gaps=1)},
        {"units": "u1 u2"},  # u2 serves none
        {"served": "u2"},
    ],
)
def test_phases_that_can_be_kept_apart_beside_interrupts(case):
    assert not found(stretched(**case), codes.PHASES_OVERLOAD)


def test_phases_of_a_later_piece_are_stretched_least_after_a_gap():
    """Interrupts of 1 ms in 3: from 5 ms on, a phase of 1 ms takes 2; with 2 ms to resume, or none, 4."""
    phases = access("mem", 5, 6, 1), access("mem", 7, 8, 1)
    split = Split(points=(ms(5),))

    def system(split, *phases):
        built = model(task("a", 90, replace(version("v", 9, "u1", *phases), split=split), slack=1), resources="mem")
        interrupt = Interrupt(name="i", distance=ms(3), wcet=ms(1))
        return replace(built, units=(replace(built.units[0], interrupts=(interrupt,)),))

    assert not found(system(split, *phases), codes.PHASES_OVERLOAD)
    assert found(system(replace(split, resume=ms(2)), *phases), codes.PHASES_OVERLOAD)
    assert found(system(Split(), *phases), codes.PHASES_OVERLOAD)


def test_every_overload_is_reported():
    pairs = [access("bus", 0, 1), access("bus", 0, 1), access("bus", 4, 5), access("bus", 4, 5)]
    assert [d.message[:40] for d in found(used(*pairs), OVERLOAD)] == [
        "2 phases are in force together at 0ms, w",
        "2 phases are in force together at 4ms, w",
    ]


def test_phases_that_follow_each_other_or_use_different_resources_do_not_add_up():
    assert validate(phases(access("bus", 1, 2), access("bus", 0, 1), access("mem", 0, 2))) == ()


@pytest.mark.parametrize("size", [0, -1])
def test_empty_transfer(size):
    phase = replace(access("bus", 0, 1), transfers=(Transfer(buffer="scan", symbol="s", size=size),))
    assert '"scan"' in the(used(phase), codes.EMPTY_TRANSFER).message


def test_transfer_of_one_byte():
    phase = replace(access("bus", 0, 1), transfers=(Transfer(buffer="scan", symbol="s", size=1),))
    assert validate(used(phase)) == ()


def test_a_phase_without_length_claims_nothing():
    system = alone(5, access("r", 0, 4), access("r", 2, 2), resources="r")
    assert codes.PHASES_OVERLOAD.id not in codes_of(system)
    assert codes.PHASES_OVERLOAD.id in codes_of(alone(5, access("r", 0, 4), access("r", 2, 3), resources="r"))
