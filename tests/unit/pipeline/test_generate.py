"""The generator of task sets: the paper's shares, exact figures, refusals, and the same bytes for ever."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, milliseconds
from halpipe.core.files import sha256
from halpipe.exporters.native import format_model, format_schedule
from halpipe.pipeline.generate import TABLE_III, SetParameters, achieved, generate, generate_with_witness
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify

TENTH = Fraction(1, 10)
RICH = SetParameters(multi_version=TENTH, precedence=Fraction(3, 5), slack=TENTH, gang=TENTH, fractional=True)


def errors(model, schedule):
    return [finding.message for finding in (*validate(model), *verify(model, schedule)) if finding.is_error]


CELLS = [(experiment.number, cell) for experiment in TABLE_III for cell in experiment.cells]


@pytest.mark.parametrize(("number", "parameters"), CELLS[::5], ids=lambda value: str(value)[:1])
def test_sets_of_table_iii_have_what_the_table_says(number, parameters):
    model, schedule = generate_with_witness(parameters, 7)
    made = achieved(model)
    assert errors(model, schedule) == []
    assert len(model.tasks) == parameters.tasks
    assert len({unit.type for unit in model.units}) == parameters.unit_types
    assert abs(made.utilisation - parameters.utilisation) < Fraction(1, 100_000)
    assert made.windows == parameters.window_count
    assert made.multi_version == parameters.multi_version
    assert made.precedence == parameters.precedence


def test_table_iii_is_the_paper_s():
    tasks = [{cell.tasks for cell in experiment.cells} for experiment in TABLE_III]
    assert tasks == [{60, 80, 100, 120}, {60}, {60}, {112}]
    assert [{cell.units for cell in experiment.cells} for experiment in TABLE_III] == [{6}, {6}, {6}, {8}]
    ranges = [{getattr(cell, e.varies) for cell in e.cells} for e in TABLE_III]
    assert [(min(values), max(values)) for values in ranges] == [
        (60, 120),
        (0, Fraction(1, 2)),
        (0, Fraction(3, 5)),
        (1, 4),
    ]
    assert {cell.access_windows for cell in TABLE_III[3].cells} == {2, 18, 34, 50}


def test_half_of_the_tasks_start_twice_and_a_quarter_three_times():
    model = generate(SetParameters(tasks=120), 1)
    assert Counter(int(milliseconds(120) / task.period) for task in model.tasks) == {1: 30, 2: 60, 3: 30}


def test_windows_of_precedence_surround_the_generated_difference():
    """0.25 to 1.75 of the difference: the ends are 7 to 1, up to rounding outward to a microsecond."""
    model, schedule = generate_with_witness(SetParameters(precedence=Fraction(3, 5)), 3)
    first = {job.task: job.start for job in schedule.modes[0].jobs if job.index == 0}
    for task in model.tasks:
        for row in task.versions[0].precedences:
            period = model.task(row.task).period
            difference = (first[task.name] - first[row.task]) % period or period
            assert first[row.task] < first[task.name]
            assert Duration(0) <= difference / 4 - row.min < Duration(1000)
            assert Duration(0) <= row.max - difference * Fraction(7, 4) < Duration(1000)


def test_alternative_versions_take_half_as_long_again_on_another_type():
    model = generate(SetParameters(multi_version=Fraction(1, 2)), 1)
    kinds = {unit.name: unit.type for unit in model.units}
    for task in model.tasks:
        if len(task.versions) == 2:
            base, other = task.versions
            assert base.wcet * Fraction(3, 2) - other.wcet < Duration(1000)
            assert {kinds[name] for name in base.units}.isdisjoint(kinds[name] for name in other.units)
            assert len(base.accesses) == len(other.accesses)


def test_a_fill_of_the_resources_is_reached_with_whole_and_with_fractional_bounds():
    for fractional in (False, True):
        wanted = SetParameters(tasks=240, units=12, resource_fill=Fraction(13, 20), fractional=fractional)
        assert abs(achieved(generate(wanted, 5)).resource_fill - Fraction(13, 20)) < Fraction(1, 10_000)


def test_gang_tasks_take_two_units_of_a_type():
    model, schedule = generate_with_witness(SetParameters(tasks=120, gang=Fraction(3, 20)), 2)
    assert errors(model, schedule) == []
    assert achieved(model).gang == Fraction(3, 20)
    assert abs(achieved(model).utilisation - Fraction(3, 5)) < Fraction(1, 10_000)


def test_no_two_unlike_units_run_the_same_versions():
    model, schedule = generate_with_witness(SetParameters(tasks=240, units=12, unlike_units=True), 2)
    versions = [version for task in model.tasks for version in task.versions]
    memberships = {tuple(unit.name in version.units for version in versions) for unit in model.units}
    assert len(memberships) == 12
    assert errors(model, schedule) == []


def test_stated_periods_give_one_task_each():
    periods = tuple(milliseconds(n) for n in (5, 10, 33, 400))
    model, schedule = generate_with_witness(SetParameters(units=2, periods=periods), 1)
    assert sorted(task.period for task in model.tasks) == sorted(periods)
    assert schedule.modes[0].hyperperiod == milliseconds(13200)
    assert errors(model, schedule) == []


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    def texts(seed):
        model, schedule = generate_with_witness(RICH, seed)
        return format_model(model), format_schedule(schedule)

    assert texts(1) == texts(1)
    assert texts(1)[0] != texts(2)[0]


def test_the_bytes_of_a_set_never_change():
    """Measurements are quoted with parameters and seed alone; if this fails, they are about other sets."""
    small = replace(RICH, tasks=12, units=4, resource_fill=None)
    assert sha256(format_model(generate(small, 1))) == GOLDEN


GOLDEN = "579bcafff2eeb6b4ec5bacae0fa99fa5e18e685c8cb4e56bd5571a4956386369"


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("tasks", SetParameters(tasks=0)),
        ("tasks", SetParameters(tasks=10**9)),
        ("units", SetParameters(units=10**6)),
        ("unit_types", SetParameters(unit_types=7)),
        ("resources", SetParameters(resources=0)),
        ("access_windows", SetParameters(access_windows=-1)),
        ("utilisation", SetParameters(utilisation=Fraction(0))),
        ("utilisation", SetParameters(utilisation=Fraction(11, 10))),
        ("gang", SetParameters(gang=Fraction(3, 5))),
        ("gang", SetParameters(gang=TENTH, units=3)),
        ("gang", SetParameters(gang=TENTH, periods=(milliseconds(5),))),
        ("hyperperiod", SetParameters(hyperperiod=Duration(7000))),
        ("hyperperiod", SetParameters(hyperperiod=Duration(0))),
        ("periods", SetParameters(periods=(Duration(1500),))),
        ("periods", SetParameters(periods=(Duration(1000), Duration(1_000_003_000)))),
    ],
)
def test_parameters_that_no_set_can_have_are_refused(name, parameters):
    with pytest.raises(HalpipeError) as caught:
        generate(parameters, 1)
    assert [(finding.code, finding.path) for finding in caught.value.diagnostics] == [("HAL0921", name)]
    assert all(finding.help for finding in caught.value.diagnostics)


def test_a_hyperperiod_too_short_for_its_tasks_is_refused():
    with pytest.raises(HalpipeError) as caught:
        generate(SetParameters(hyperperiod=Duration(6000)), 1)
    assert [finding.code for finding in caught.value.diagnostics] == ["HAL0922"]
