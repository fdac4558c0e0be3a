"""Contradictions of splits, bindings, interrupts and arrivals (MODEL 8.1), and their limits."""

from dataclasses import replace
from fractions import Fraction

import pytest
from validate_cases import alone, codes_of, found, the

from halpipe.core.durations import Duration
from halpipe.models import Binding, Interrupt, Split
from halpipe.pipeline.explain.witnesses import proves_infeasible
from halpipe.pipeline.validate import codes, validate
from support import access, mode, model, ms, task, version


def split(system, **fields):
    owner = system.tasks[0]
    versions = tuple(replace(v, split=Split(**fields)) for v in owner.versions)
    return replace(system, tasks=(replace(owner, versions=versions), *system.tasks[1:]))


def points(*instants):
    return tuple(map(ms, instants))


def served(system, *rows, unit="u1"):
    """The model with the interrupts (distance, wcet) on a unit."""
    interrupts = tuple(Interrupt(name=f"i{n}", distance=ms(d), wcet=ms(c)) for n, (d, c) in enumerate(rows))
    units = tuple(replace(u, interrupts=interrupts) if u.name == unit else u for u in system.units)
    return replace(system, units=units)


def test_good_splits_are_fine():
    assert not validate(split(alone(), points=points(1, 2, 4), resume=ms("1us"), max_gaps=2))
    phases = (access("r", 1, 2), access("r", 2, 3))
    assert not validate(split(alone("5ms", *phases, resources="r"), points=points(1, 2, 3)))
    assert not validate(split(alone(), anywhere=True, max_gaps=1, min_part=ms("2.5ms")))


@pytest.mark.parametrize(("point", "is_outside"), [("0ms", True), ("1ns", False), ("4.999999ms", False), ("5ms", True)])
def test_split_points_lie_inside_the_execution(point, is_outside):
    assert bool(found(split(alone(), points=points(point)), codes.SPLIT_OUTSIDE)) == is_outside


def test_the_help_for_unsorted_points_sorts_them():
    finding = the(split(alone(), points=points(3, 1, 1)), codes.SPLIT_NOT_ASCENDING)
    assert finding.message == "has split points that do not ascend, at 1ms, 1ms"
    assert finding.help == 'write split="1ms 3ms"'


def test_all_faults_of_a_split_are_found_at_once():
    system = split(alone("5ms", access("r", 1, 3), resources="r"), points=points(7, 2, 2), min_part=ms(1))
    expected = {codes.SPLIT_OUTSIDE, codes.SPLIT_NOT_ASCENDING, codes.SPLIT_IN_PHASE, codes.SPLIT_WITHOUT_EFFECT}
    assert codes_of(system) >= {code.id for code in expected}


def test_anywhere_needs_a_limit():
    assert "max-gaps" in the(split(alone(), anywhere=True), codes.NO_MAX_GAPS).help


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"resume": ms(1), "min_part": ms(1)}, "states resume and min-part, but is not split"),
        ({"points": points(1), "min_part": ms(1)}, "states min-part for a list"),
        ({"anywhere": True, "max_gaps": 1, "min_part": ms("2.6ms")}, "more than half of its WCET 5ms"),
        ({"points": points(1), "max_gaps": 0}, "allows no gap"),
    ],
)
def test_settings_without_effect(fields, words):
    finding = the(split(alone(), **fields), codes.SPLIT_WITHOUT_EFFECT)
    assert words in finding.message
    assert not finding.is_error


# ------------------------------------------------------------------------------------------------ binding


def bound(*modes):
    """A task bound in the system, with modes that each allow versions (units, gang)."""
    names = [[f"v{m}{n}" for n in range(len(allowed))] for m, allowed in enumerate(modes)]
    versions = [
        version(name, 1, units, gang=gang)
        for row, allowed in zip(names, modes, strict=True)
        for name, (units, gang) in zip(row, allowed, strict=True)
    ]
    owner = replace(task("a", 10, *versions), binding=Binding.SYSTEM)
    tables = []
    for number, row in enumerate(names):
        listed = mode(f"m{number}", [owner])
        tables.append(replace(listed, runs=(replace(listed.runs[0], versions=tuple(row)),)))
    return model(owner, units="u1 u2 u3 u4", modes=tables)


@pytest.mark.parametrize(
    ("modes", "is_possible"),
    [
        (([("u1 u2", 1)], [("u2 u3", 1)]), True),
        (([("u1", 1)], [("u2", 1)]), False),
        (([("u1", 1), ("u2", 1)], [("u2", 1)]), True),
        (([("u1 u2", 1)], [("u1 u2", 2)]), False),
        (([("u1 u2", 1), ("u1 u2", 2)], [("u1 u2", 2)]), True),
        (([("u1 u2 u3", 2)], [("u2 u3 u4", 2)]), True),
        (([("u1 u2", 2)], [("u2 u3", 2)]), False),
        (([("u1 u2", 1)], [("u2 u3", 1)], [("u1 u3", 1)]), False),
    ],
)
def test_a_task_bound_in_the_system_has_common_units(modes, is_possible):
    assert bool(found(bound(*modes), codes.NOTHING_TO_BIND_TO)) != is_possible
    in_modes = replace(bound(*modes), tasks=(replace(bound(*modes).tasks[0], binding=Binding.MODE),))
    assert not found(in_modes, codes.NOTHING_TO_BIND_TO)


def test_the_modes_in_conflict_are_named():
    finding = the(bound([("u1", 1)], [("u1 u2", 1)], [("u2 u3", 2)]), codes.NOTHING_TO_BIND_TO)
    assert 'mode "m0" allows "u1" and mode "m2" allows 2 of "u2", "u3"' in finding.message
    first = the(bound([("u1", 1)], [("u2", 1)], [("u1 u2", 1)]), codes.NOTHING_TO_BIND_TO)
    assert 'mode "m0" allows "u1" and mode "m1" allows "u2"' in first.message


# ------------------------------------------------------------------------------------------------ interrupts


def test_interrupts_leave_time():
    assert not found(served(alone(), (2, 1), (10, "4.99ms")), codes.INTERRUPTS_FILL)
    assert "take 1 of its time" in the(served(alone(), (2, 1), (10, 5)), codes.INTERRUPTS_FILL).message


def test_gangs_wait_for_the_interrupts_of_all_their_units():
    def system(share):
        pair = served(served(alone(units="u1 u2 u3", gang=2), (10, 5)), (10, share), unit="u2")
        return served(pair, (10, 9), unit="u3")

    assert not found(system("4.99ms"), codes.INTERRUPTS_FILL)
    assert "whose interrupts together take 1 of the time" in the(system(5), codes.INTERRUPTS_FILL).message
    busy = served(served(alone(units="u1 u2 quiet", gang=2), (10, 6)), (10, 6), unit="u2")
    assert not found(busy, codes.INTERRUPTS_FILL)


def test_an_interrupt_is_within_its_distance():
    assert not found(served(alone(), (10, "9.99ms")), codes.INTERRUPT_TOO_LONG)
    assert found(served(alone(), (1, 2)), codes.INTERRUPT_TOO_LONG)


def test_names_of_interrupts_are_unique_on_a_unit():
    system = served(alone(), (10, 1), (10, 1))
    twice = replace(system.units[0], interrupts=(system.units[0].interrupts[0],) * 2)
    assert found(replace(system, units=(twice,)), codes.DUPLICATE_NAME)


def test_deadlines_hold_what_is_reserved():
    """T = 10, c = 2: L(8) = 10."""
    fits = served(alone(8, period=40, deadline=10), (10, 2))
    assert not validate(fits)
    late = served(alone(8, period=40, deadline="9.999999ms"), (10, 2))
    assert "needs 10ms" in the(late, codes.WCET_BEYOND_DEADLINE).message
    assert proves_infeasible(late, [d for d in validate(late) if d.is_error])
    elsewhere = served(alone(8, period=40, deadline="9ms", units="u1 u2"), (10, 2))
    assert not found(elsewhere, codes.WCET_BEYOND_DEADLINE)


def test_a_unit_has_what_its_interrupts_leave():
    """Work of 8 in 10 beside interrupts of 2 in 10 is just enough."""
    owners = [task(f"t{n}", 10, version("v", wcet), slack=1) for n, wcet in enumerate((5, 3))]
    assert not found(served(model(*owners), (5, 1)), codes.UNITS_OVERLOADED)
    finding = the(served(model(*owners), (5, "1.1ms")), codes.UNITS_OVERLOADED)
    assert "need 8ms, 200us more than the 7.8ms there are beside 2.2ms of interrupts" in finding.message


def test_a_job_with_its_interrupts_fits_the_hyperperiod():
    system = served(alone(9, period=10, deadline=30, units="u1"), (10, 1))
    assert not found(system, codes.WCET_BEYOND_HYPERPERIOD)
    system = served(alone(9, period=10, deadline=30, units="u1"), (10, "1.5ms"))
    assert "needs 12ms" in the(system, codes.WCET_BEYOND_HYPERPERIOD).message


# ------------------------------------------------------------------------------------------------ arrivals


def polling(period, distance, wcet="1ms", **fields):
    system = alone(wcet, period=period, **fields)
    return replace(system, tasks=(replace(system.tasks[0], distance=ms(distance)),))


def test_arrivals_are_polled_often_enough():
    assert not validate(polling(10, 11))
    assert found(polling(10, "9.999999ms"), codes.POLLED_TOO_RARELY)
    finding = the(polling(10, "10.999999ms"), codes.ARRIVAL_TOO_LATE)
    assert "an arrival may wait for 11ms; its deadline is 10.999999ms (its distance)" in finding.message
    assert finding.help == "poll every 9.999999ms at most, or raise the deadline"
    assert not validate(polling(10, 10, deadline=11))


def test_a_polled_task_has_no_deadline_from_its_release():
    assert not validate(polling(10, 30, wcet=9, slack=Fraction(1)))


def test_a_version_too_long_even_right_after_the_job_before():
    system = polling(10, 20, wcet=11, slack=Fraction(1, 2), deadline=15)
    assert (
        "its deadline is 10ms, less the least time since the job before"
        in the(system, codes.WCET_BEYOND_DEADLINE).message
    )
    assert proves_infeasible(system, [d for d in validate(system) if d.is_error])


def test_arrivals_need_a_poll():
    assert "distance 20ms but no period" in the(polling(None, 20), codes.NEEDS_PERIOD).message


def test_negative_times_of_splits_and_interrupts():
    below = ms(0) - ms(1)
    system = split(alone(), points=points(1), resume=below)
    assert found(system, codes.NEGATIVE_TIME)
    assert found(served(alone(), (10, below)), codes.NEGATIVE_TIME)


def test_parts_beyond_the_limit_are_pointed_out():
    system = split(alone(wcet="10ms", period="25ms"), anywhere=True, max_gaps=9_999_999)
    assert not found(system, codes.MANY_PARTS)
    finding = the(split(alone(wcet="10ms", period="25ms"), anywhere=True, max_gaps=10_000_000), codes.MANY_PARTS)
    assert "up to 10000001 parts" in finding.message
    bounded = split(alone(wcet="10ms"), anywhere=True, max_gaps=10_000_000, min_part=ms(1))
    assert not found(bounded, codes.MANY_PARTS)
    for wcet, is_found in (("10ms", False), ("10.000001ms", True)):
        least = split(alone(wcet=wcet), anywhere=True, max_gaps=10**9, min_part=Duration(1))
        assert bool(found(least, codes.MANY_PARTS)) == is_found


def test_a_poll_without_a_period_is_not_late_as_well():
    system = polling(10, 12)
    endless = replace(system, tasks=(replace(system.tasks[0], period=ms(0), deadline=ms("0.5ms")),))
    assert not found(endless, codes.ARRIVAL_TOO_LATE)
