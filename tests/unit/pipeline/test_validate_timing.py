"""Period, slack, offset, deadline, WCET and gang."""

from dataclasses import replace
from fractions import Fraction

import pytest
from validate_cases import alone, codes_of, found, the

from halpipe.core.diagnostics import Location, Severity, render_text
from halpipe.core.durations import Duration
from halpipe.models import Mode, Origin, Run, Split
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import codes, validate
from support import access, after, chain, mode, model, ms, task, version


def test_zero_period():
    assert the(alone(period="0ms"), codes.ZERO_PERIOD).path == 'task "a"'


@pytest.mark.parametrize("slack", [Fraction(-1, 10), Fraction(11, 10)])
def test_slack_outside_its_range(slack):
    assert the(alone(slack=slack), codes.BAD_SLACK).path == 'task "a"'


@pytest.mark.parametrize("slack", [0, 1, Fraction(1, 3)])
def test_slack_in_its_range(slack):
    assert validate(alone(slack=slack)) == ()


def test_offset_and_deadline_need_a_period():
    asks = task("a", 25, version("v", 1, "u1", after("d", 0, 20)), offset="3ms", deadline="20ms")
    server = task("d", None, version("v", 1))
    assert validate(model(asks, server)) == ()
    texts = [d.message for d in found(model(asks, replace(server, offset=asks.offset)), codes.NEEDS_PERIOD)]
    assert texts == ["has the offset 3ms but no period to count it from"]
    texts = [d.message for d in found(model(asks, replace(server, deadline=asks.deadline)), codes.NEEDS_PERIOD)]
    assert texts == ["has the deadline 20ms but no period to count it from"]


def test_slack_without_a_period_is_a_warning():
    asks = task("a", 25, version("v", 1, "u1", after("d", 0, 20)))
    finding = the(model(asks, task("d", None, version("v", 1), slack="0.1")), codes.SLACK_WITHOUT_PERIOD)
    assert finding.severity is Severity.WARNING


def test_offset_beyond_the_period_counts_modulo_the_period():
    assert validate(alone(offset="30ms")) == ()


def test_a_let_of_zero_bounds_no_version():
    system = alone()
    assert codes_of(replace(system, tasks=(replace(system.tasks[0], let=ms(0)),))) == {codes.LET_BEYOND_DEADLINE.id}


def test_arrivals_as_rare_as_the_polls_leave_no_time_without_slack():
    system = alone(period="10ms")
    polls = replace(system, tasks=(replace(system.tasks[0], distance=ms(10)),))
    assert "less the least time since" in the(polls, codes.WCET_BEYOND_DEADLINE).message


def test_missing_wcet_says_where_to_give_it():
    finding = the(alone(None), codes.MISSING_WCET)
    assert finding.path == 'task "a" version "v"'
    assert "overlay" in finding.help


def test_zero_wcet():
    assert codes_of(alone("0ms")) == {codes.ZERO_WCET.id}


def test_wcet_beyond_deadline_reads_like_the_promise():
    slow = replace(version("npu", "9ms"), at=Location("model.xml", 42))
    system = model(task("lidar_fuse", 25, slow, deadline="8ms"))
    first_line = render_text(the(system, codes.WCET_BEYOND_DEADLINE)).splitlines()[0]
    expected = 'task "lidar_fuse": version "npu" needs 9ms, its deadline is 8ms'
    assert first_line == f"model.xml:42: error[HAL0231] {expected}"


def test_wcet_may_fill_the_deadline_but_not_exceed_it():
    assert validate(alone("25ms")) == ()
    assert "(its period)" in the(alone("25000001ns"), codes.WCET_BEYOND_DEADLINE).message
    assert validate(alone("8ms", deadline="8ms")) == ()


def test_wcet_beyond_the_period_is_allowed_by_the_deadline_but_pointed_out():
    quick = task("b", 50, version("v", 1))
    system = model(task("a", 25, version("v", 40, "u1 u2"), deadline=50), quick, units="u1 u2")
    assert codes_of(system) == {codes.WCET_BEYOND_PERIOD.id, *()}
    assert the(system, codes.WCET_BEYOND_PERIOD).severity is Severity.WARNING


@pytest.mark.parametrize(("gang", "units"), [(0, "u1"), (-1, "u1"), (2, "u1"), (3, "u1 u2")])
def test_gang_that_does_not_fit(gang, units):
    assert the(alone(gang=gang, units=units), codes.BAD_GANG).path == 'task "a" version "v"'


def test_gang_that_fits():
    assert validate(alone(gang=2, units="u1 u2")) == ()


def test_repeated_units_do_not_make_room_for_a_gang():
    assert "only 1 valid unit" in the(alone(gang=2, units="u1 u1"), codes.BAD_GANG).message


def test_negative_times_of_every_kind():
    minus = Duration(-1)
    broken = replace(
        version("v", 5, "u1", replace(access("r", 0, 1), start=minus), replace(after("b", 0, 1), min=minus)), wcet=minus
    )
    first = replace(task("a", 25, broken), offset=minus, deadline=minus)
    second = replace(task("b", 25, version("v", 1)), period=minus)
    one = replace(chain("c", "a b"), max_reaction=minus, max_age=minus)
    modes = [mode("m", [first, second]), mode("n", [second])]
    system = model(first, second, resources="r", chains=[one], modes=modes, transitions=[("m", "n", minus)])
    texts = {d.message for d in found(system, codes.NEGATIVE_TIME)}
    kinds = ("WCET", "access start", "window minimum", "offset", "deadline", "period")
    kinds += ("limit of reaction time", "limit of data age", "maximum length")
    assert texts == {f"has the negative {kind} -1ns" for kind in kinds}


def test_findings_point_to_the_source_where_the_model_was_never_a_file():
    imported = replace(version("v", None), origin=Origin("graph.yaml", 7, "/a"))
    assert the(model(task("a", 25, imported)), codes.MISSING_WCET).at == Location("graph.yaml", 7)


# ------------------------------------------------------------------------------------------------ versions left out


def two_versions(*modes, let=None):
    owner = replace(task("a", 10, version("slow", 12, "u1"), version("fast", 2, "u2")), let=let)
    runs = [Mode(name=f"m{k}", runs=(Run(task="a", versions=names),)) for k, names in enumerate(modes)]
    return model(owner, units="u1 u2", modes=runs)


def test_a_version_that_can_never_end_in_time_is_a_warning_where_another_one_can():
    finding = the(two_versions(("slow", "fast")), codes.WCET_BEYOND_DEADLINE)
    assert (finding.severity, finding.message.endswith("it is never tried")) == (Severity.WARNING, True)


def test_a_mode_without_a_version_that_can_end_in_time_is_an_error():
    assert the(two_versions(("slow", "fast"), ("slow",)), codes.WCET_BEYOND_DEADLINE).is_error


def test_a_logical_execution_time_bounds_a_version_too():
    assert "12ms" in the(two_versions(("slow", "fast")), codes.WCET_BEYOND_DEADLINE).message
    short = two_versions(("fast",), let=ms(1))
    assert "its deadline is 1ms (its LET)" in found(short, codes.WCET_BEYOND_DEADLINE)[-1].message


@pytest.mark.parametrize("split", [Split(), Split(points=(ms(1),))])
def test_a_version_that_never_fits_is_left_out_of_the_search(split):
    system = two_versions(("slow", "fast"))
    fast = replace(system.tasks[0].versions[1], split=split)
    system = replace(system, tasks=(replace(system.tasks[0], versions=(system.tasks[0].versions[0], fast)),))
    found = schedule_model(system, SearchOptions(), lambda *_: True)
    assert [job.version for job in found.schedule.modes[0].jobs] == ["fast"]
    assert [d.code for d in found.diagnostics if d.severity is Severity.WARNING] == ["HAL0231"]
