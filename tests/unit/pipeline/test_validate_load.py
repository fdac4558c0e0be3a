"""Units and resources that no schedule could satisfy, and jobs longer than the hyperperiod."""

from dataclasses import replace
from fractions import Fraction

import pytest
from validate_cases import alone, codes_of, found, the

from halpipe.core.diagnostics import Severity
from halpipe.core.durations import Duration
from halpipe.models import Interrupt, Mode, Run, Unit
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.validate.load import Need, _access, _largest
from support import access, after, mode, model, ms, task, version


def busy(name, wcet, units="u1", period=20, *parts, gang=1):
    return task(name, period, version("v", wcet, units, *parts, gang=gang))


def test_unit_filled_exactly_is_not_overloaded():
    assert validate(model(busy("a", 12), busy("b", 8))) == ()


def test_unit_overloaded_by_a_nanosecond():
    finding = the(model(busy("a", 12), busy("b", "8000001ns")), codes.UNITS_OVERLOADED)
    assert finding.path == 'mode "all"'
    assert '"u1" need 20.000001ms, 1ns more than the 20ms there are; the largest: "a" 12ms' in finding.message


def test_periods_of_different_length_add_up_over_the_hyperperiod():
    assert validate(model(busy("a", 6, period=12), busy("b", 9, period=18))) == ()
    assert codes_of(model(busy("a", 6, period=12), busy("b", 10, period=18))) == {codes.UNITS_OVERLOADED.id}


def test_tasks_confined_to_part_of_the_units():
    system = model(busy("a", 15), busy("b", 15, "u1 u2"), busy("c", 15, "u1 u2"), units="u1 u2 u3")
    finding = the(system, codes.UNITS_OVERLOADED)
    assert 'only on "u1", "u2" need 45ms' in finding.message


def test_all_units_together():
    tasks = [busy("a", 15, "u1 u2"), busy("b", 15, "u2 u3"), busy("c", 15, "u1 u3"), busy("d", 16, "u1 u2")]
    assert '"u1", "u2", "u3" need 61ms' in the(model(*tasks, units="u1 u2 u3"), codes.UNITS_OVERLOADED).message


def test_only_the_smallest_overloaded_set_is_named():
    system = model(busy("a", 15), busy("b", 15), busy("c", 20, "u2"), units="u1 u2")
    assert 'only on "u1" need' in the(system, codes.UNITS_OVERLOADED).message


def test_gang_counts_every_unit_it_takes():
    assert validate(model(busy("a", 10, "u1 u2", gang=2), busy("b", 10, "u1 u2", gang=2), units="u1 u2")) == ()
    overloaded = model(busy("a", 11, "u1 u2", gang=2), busy("b", 10, "u1 u2", gang=2), units="u1 u2")
    assert codes_of(overloaded) == {codes.UNITS_OVERLOADED.id}


def test_the_shortest_available_version_counts():
    a = task("a", 20, version("long", 15), version("short", 5))
    only_long = [Mode(name="m", runs=(Run(task="a", versions=("long",)), Run(task="b", versions=("v",))))]
    b = busy("b", 12)
    assert validate(model(a, b)) == ()
    assert codes_of(model(a, b, modes=[mode("n", [a, b]), *only_long])) == {codes.UNITS_OVERLOADED.id}


def test_a_version_for_other_units_lets_the_task_leave():
    a = task("a", 20, version("cpu", 15), version("gpu", 15, "u2"))
    assert validate(model(a, busy("b", 12), units="u1 u2")) == ()


def test_jobs_on_demand_count_as_often_as_they_must_be_demanded():
    server = task("d", None, version("v", 7))
    once = task(
        "a", 20, version("v", 1, "u1", after("d", 0, 20)), version("w", 1, "u1", after("d", 0, 20), after("d", 0, 9))
    )
    assert validate(model(once, server)) == ()
    twice = task("b", 10, version("v", 1, "u1", after("d", 0, 20)))
    assert '"d" 21ms' in the(model(once, twice, server), codes.UNITS_OVERLOADED).message


def test_demand_that_a_version_avoids_does_not_count():
    server = task("d", None, version("v", 7))
    a = task("a", 5, version("asks", 1, "u1", after("d", 0, 20)), version("does-without", 1))
    assert found(model(a, server), codes.UNITS_OVERLOADED) == []


def phased(name, length, bound, *more, period=20):
    return busy(name, 20, f"u{name}", period, access("bus", 0, length, bound), *more)


def test_resource_filled_exactly_and_overloaded():
    parts = [phased("1", 10, "1/2"), phased("2", 15, "2/3"), phased("3", 20, "1/4")]
    assert validate(model(*parts, units="u1 u2 u3", resources="bus")) == ()
    parts[2] = phased("3", 20, "251/1000")
    finding = the(model(*parts, units="u1 u2 u3", resources="bus"), codes.RESOURCE_OVERLOADED)
    assert 'resource "bus" for 20.02ms' in finding.message
    assert '"2" 10ms' in finding.message


def test_the_least_demanding_version_counts_resource_by_resource():
    heavy, light = version("x", 20, "u1", access("bus", 0, 20)), version("y", 20, "u1", access("bus", 0, 1, "1/2"))
    none = version("z", 20, "u1")
    other = phased("2", 19, 1)
    for versions, overloaded in (
        ((heavy,), True),
        ((heavy, light), False),
        ((light, heavy), False),
        ((heavy, none), False),
    ):
        system = model(task("a", 20, *versions), other, units="u1 u2", resources="bus")
        assert (codes.RESOURCE_OVERLOADED.id in codes_of(system)) is overloaded


def test_several_phases_with_unlike_bounds_add_up():
    a = phased("1", 3, "1/3", access("bus", 5, 8, "1/2"), access("bus", 8, 10, "1/2"))
    assert "for 3.5ms" not in str(found(model(a, units="u1", resources="bus"), codes.RESOURCE_OVERLOADED))
    short = replace(a, period=None)
    asks = [task(f"t{i}", 7, version("v", "1ns", "u1", after("1", 0, 20))) for i in range(3)]
    finding = the(model(short, *asks, units="u1", resources="bus"), codes.RESOURCE_OVERLOADED)
    assert "for 10.5ms" in finding.message


def test_job_longer_than_the_hyperperiod():
    server = task("d", None, version("v", 21, "u2"))
    asks = busy("a", 1, "u1", 20, after("d", 0, 40))
    finding = the(model(asks, server, units="u1 u2"), codes.WCET_BEYOND_HYPERPERIOD)
    assert (finding.path, finding.is_error) == ('mode "all" task "d"', True)
    assert found(model(busy("b", 1, "u1", 40), asks, server, units="u1 u2"), codes.WCET_BEYOND_HYPERPERIOD) == []


def test_job_longer_than_the_hyperperiod_in_one_version_only():
    server = task("d", None, version("v", 21, "u2"), version("w", 20, "u2"))
    asks = busy("a", 1, "u1", 20, after("d", 0, 40))
    finding = the(model(asks, server, units="u1 u2"), codes.WCET_BEYOND_HYPERPERIOD)
    assert finding.severity is Severity.WARNING


@pytest.mark.parametrize("changes", [{}, {"let": ms(20)}, {"distance": ms(25)}])
def test_wcet_beyond_deadline_is_not_reported_a_second_time(changes):
    """Also where interrupts make it longer; a version within the hyperperiod has other findings."""
    system = alone("26ms")
    task = replace(system.tasks[0], **changes)
    assert codes_of(replace(system, tasks=(task,))) >= {codes.WCET_BEYOND_DEADLINE.id}
    assert codes.WCET_BEYOND_HYPERPERIOD.id not in codes_of(replace(system, tasks=(task,)))
    busy = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(2)),))
    short = replace(task, versions=tuple(replace(v, wcet=ms(21)) for v in task.versions))
    stretched = replace(system, tasks=(short,), units=(busy,))
    assert "needs 27ms" in the(stretched, codes.WCET_BEYOND_DEADLINE).message
    assert codes.WCET_BEYOND_HYPERPERIOD.id not in codes_of(stretched)


@pytest.mark.parametrize(("shorter", "is_error"), [("20.000001ms", True), ("20ms", False)])
def test_a_task_is_beyond_the_hyperperiod_where_all_its_versions_are_in_some_way(shorter, is_error):
    """Of 30 ms the deadline excludes one, of 20 ms the hyperperiod the other."""
    both = task("a", 20, version("v", 31, "u1 u2"), version("w", shorter, "u1 u2"), deadline=30)
    findings = found(model(both, units="u1 u2"), codes.WCET_BEYOND_HYPERPERIOD)
    assert [("w" in finding.message, finding.is_error) for finding in findings] == [(True, True)] * is_error


@pytest.mark.parametrize("excess", [0, 1])
def test_a_version_is_late_where_it_is_longer_than_its_deadline(excess):
    """Of two versions, one as long as the deadline: the other is never tried, and that is a warning."""
    versions = version("v", "20ms"), version("w", 22)
    exact = replace(versions[0], wcet=versions[0].wcet + Duration(excess))
    findings = found(model(task("a", 40, exact, versions[1], deadline=20)), codes.WCET_BEYOND_DEADLINE)
    assert [finding.is_error for finding in findings] == [True, True] * excess + [False] * (1 - excess)


@pytest.mark.parametrize(
    ("gang", "wcets", "is_full"),
    [
        (1, (4, 9), False),
        (2, (4, 5), False),
        (2, (4, 6), True),
        (2, (5, 6), True),
        (2, (4, 6, 5), False),
        (3, (2, 3, 5), True),
        (2, (None, 4, 6), False),
        (2, (None, 9), False),
        (2, (3, 10), False),
    ],
)
def test_members_of_a_gang_need_a_share_beside_the_interrupts_of_all_its_units(gang, wcets, is_full):
    """The least loaded units count, interrupts come every 10 ms; a unit that they fill has a finding of its own."""
    units = tuple(
        Unit(name=f"u{n}", interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(wcet)),) if wcet else ())
        for n, wcet in enumerate(wcets)
    )
    names = " ".join(unit.name for unit in units)
    system = replace(model(task("a", 1000, version("v", "1us", names, gang=gang)), units=names), units=units)
    assert ["occupies" in finding.message for finding in found(system, codes.INTERRUPTS_FILL)] == (
        [True] if is_full else [False] * (10 in wcets)
    )


def test_phases_of_a_nanosecond_are_needs_and_phases_of_none_are_not():
    phases = access("bus", 0, "1ns"), access("bus", "1ns", "2ns", "1/2"), access("ram", 1, 1), access("cpu", 0, 1, 0)
    assert _access(version("v", 2, "u1", *phases)) == {"bus": (3, 2)}


def test_the_largest_needs_are_three_and_none_is_zero():
    needs = [Need(name, amount, 1) for name, amount in (("a", 0), ("b", 1), ("d", 5), ("c", 5), ("e", 7))]
    assert _largest(needs) == '"e" 7ns, "c" 5ns, "d" 5ns'
    assert _largest(needs[:2]) == '"b" 1ns'


@pytest.mark.parametrize(("wcet", "is_found"), [(12, False), (15, True)])
def test_a_polling_task_longer_than_the_hyperperiod_is_found_though_arrivals_may_wait(wcet, is_found):
    polled = replace(task("a", 12, version("v", wcet, "u1 u2")), slack=Fraction(1), distance=ms(36))
    system = model(polled, units="u1 u2")
    assert bool(found(system, codes.WCET_BEYOND_HYPERPERIOD)) == is_found


@pytest.mark.parametrize(
    ("wcets", "deadline", "room"),
    [(("2ms",), None, None), (("2.000001ms",), None, "9.999999ms"), (("3ms", "2ms"), None, None), (("3ms",), 13, None)],
)
def test_an_arrival_is_served_in_time_by_the_shortest_version(wcets, deadline, room):
    """It waits for a period of 10 ms and for the whole job, and arrivals are 12 ms apart."""
    versions = [version(f"v{n}", wcet) for n, wcet in enumerate(wcets)]
    polled = replace(task("a", 10, *versions, slack=1, deadline=deadline), distance=ms(12))
    findings = found(model(polled), codes.ARRIVAL_TOO_LATE)
    assert [f"poll every {room} at most" in finding.help for finding in findings] == ([True] if room else [])
    late = replace(polled, deadline=ms(2), versions=(version("v", "2ms"),))
    [finding] = found(model(late), codes.ARRIVAL_TOO_LATE)
    assert finding.help == "shorten the WCET, or raise the deadline"


def test_a_set_of_units_is_overloaded_by_all_that_runs_within_it():
    """Two tasks of one unit each, and two of both: 41 of 40 ms on two units."""
    system = model(
        busy("a", 9, "u1"),
        busy("b", 9, "u2"),
        busy("c", 12, "u1 u2"),
        busy("e", 11, "u1 u2"),
        busy("d", 1, "u3"),
        units="u1 u2 u3",
    )
    [over] = found(system, codes.UNITS_OVERLOADED)
    assert "need 41ms" in over.message
