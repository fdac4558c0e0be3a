"""Access phases and transfers."""

from dataclasses import replace

import pytest
from validate_cases import alone, found, the

from halpipe.diagnostics import Location
from halpipe.models import Transfer
from halpipe.pipeline.validate import codes, validate
from support import access


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
