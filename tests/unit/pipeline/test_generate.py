"""The generator of task sets: the paper's shares, exact figures, refusals, and the same bytes for ever."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import pytest
from benchmarks.table_iii import TABLE_III

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, milliseconds
from halpipe.core.files import sha256
from halpipe.exporters.native import format_model, format_schedule
from halpipe.pipeline.generate import SetParameters, achieved, generate, generate_with_witness, tiling
from halpipe.pipeline.generate.tiling import Profile
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


SMALL = replace(RICH, tasks=12, units=4)
GOLDEN = {
    "rich": (SMALL, 1, "579bcafff2eeb6b4ec5bacae0fa99fa5e18e685c8cb4e56bd5571a4956386369"),
    "one unit": (
        SetParameters(tasks=5, units=1, unit_types=1, access_windows=12),
        2,
        "f8d5dec4bec148bb30489fea82f1ab94d60b79395c8b27d38748bcdd86371b96",
    ),
    "few tasks": (
        SetParameters(tasks=3, units=5, access_windows=2, multi_version=Fraction(1, 2)),
        3,
        "8c32740cb8ad7f0fbd21811448d74be1906d9abc10cd2f6aa178f2b12e0f4f1a",
    ),
    "gang": (
        SetParameters(tasks=31, units=6, gang=Fraction(1, 2), precedence=Fraction(1)),
        4,
        "866adeae701526727cd8ed871902cab70b099ad04a41fb743c9c7b7ea9a27a5f",
    ),
    "gang on three units": (
        SetParameters(tasks=24, units=3, unit_types=1, gang=Fraction(1, 4)),
        5,
        "d560b30d8c746d7c26d04cff4afdd8df5af2497916f12db7bc3ab705cf94badf",
    ),
    "full resources": (
        SetParameters(tasks=24, resources=3, resource_fill=Fraction(9, 10)),
        6,
        "4c73639c98c89aaa47cfdf0337f1b79264a1c7856d89b05e6bb7fd7530a33119",
    ),
    "full resources in shares": (
        replace(SMALL, tasks=16, gang=Fraction(0), resource_fill=Fraction(4, 5)),
        7,
        "8359853b24eedd1da68a1a2a9ff54b89bd4ea6b5bf1c9ff92cfee9bccc4f3a18",
    ),
    "many windows": (
        SetParameters(tasks=8, units=2, resources=1, access_windows=60, fractional=True),
        8,
        "2d4c59eead164cb87f2612ebf5c80fba45f2f1484a1df0215a392e652ef36936",
    ),
    "unlike units": (
        SetParameters(tasks=24, units=7, unit_types=2, unlike_units=True, gang=TENTH),
        9,
        "9926358d803f7db0bd21f8521b10e9a53e39405ff8ffb6f8a853adf070ae311d",
    ),
    "periods": (
        SetParameters(units=2, periods=tuple(map(milliseconds, (5, 10, 33, 400, 10, 20)))),
        10,
        "6386c539c6b665a269a635000c23c3eda48eb37604cffe82c6410d55683cb7cf",
    ),
    "many periods": (
        SetParameters(units=4, periods=tuple(map(milliseconds, (5, 10, 20, 40, 60) * 8))),
        12,
        "031bf558284b3ec60d3a888c1418100daf7cbbfaf258d5e9964767ce3f675be9",
    ),
    "short": (
        SetParameters(tasks=4, units=1, unit_types=1, hyperperiod=Duration(60_000), access_windows=12),
        13,
        "54ce39c372711ec9e29fd0ecfca9db43e83504e57fe476bb3d2290f4bb743deb",
    ),
    "many tasks": (
        SetParameters(tasks=900, units=60, access_windows=0),
        14,
        "10196dddddedd9bb375e9389e3d69ae17939f29e0543164f857b90f083cb832e",
    ),
    "table iii": (TABLE_III[3].cells[-1], 11, "7d322d0061867ca41c43451bcfc1c2d3f388e253ea2e974c648e8c9279d0e0ce"),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_the_bytes_of_a_set_never_change(name):
    """Measurements are quoted with parameters and seed alone; if this fails, they are about other sets."""
    parameters, seed, digest = GOLDEN[name]
    assert sha256(format_model(generate(parameters, seed))) == digest


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


@pytest.mark.parametrize(("tasks", "length"), [(60, 6), (8, 12), (8, 24)])
def test_a_hyperperiod_too_short_for_its_tasks_is_refused(tasks, length):
    """Also where only some of them would be shorter than a microsecond."""
    with pytest.raises(HalpipeError) as caught:
        generate(SetParameters(tasks=tasks, units=1, unit_types=1, hyperperiod=Duration(1000 * length)), 1)
    assert [finding.code for finding in caught.value.diagnostics] == ["HAL0922"]


LIMITS = {
    "tasks": (1, 100_000),
    "units": (1, 10_000),
    "unit_types": (1, 10_000),
    "resources": (0, 10_000),
    "access_windows": (0, 1_000_000),
}
WIDE = SetParameters(units=10_000, access_windows=0)


@pytest.mark.parametrize("name", LIMITS)
def test_counts_may_be_as_small_and_as_large_as_their_limits(name):
    wide = replace(WIDE, units=10_000 if name != "units" else 2, unit_types=1)
    for limit, beyond in zip(LIMITS[name], (-1, 1), strict=True):
        replace(wide, **{name: limit}).check()
        with pytest.raises(HalpipeError) as caught:
            replace(wide, **{name: limit + beyond}).check()
        found = next(finding for finding in caught.value.diagnostics if finding.path == name)
        assert found.help == "give a number from {} to {}".format(*LIMITS[name])


@pytest.mark.parametrize("name", ["multi_version", "precedence", "utilisation", "slack", "resource_fill"])
def test_shares_may_be_one(name):
    SetParameters(**{name: Fraction(1)}).check()


def test_half_of_the_tasks_may_be_gangs_on_two_units_of_each_type():
    half = SetParameters(gang=Fraction(1, 2), units=4)
    half.check()
    with pytest.raises(HalpipeError):
        replace(half, units=3).check()


def test_resources_may_be_left_out_where_nothing_uses_them():
    none = SetParameters(resources=0, access_windows=0)
    assert achieved(generate(none, 1)).resource_fill == 0
    for changes in ({"access_windows": 1}, {"resource_fill": TENTH}):
        with pytest.raises(HalpipeError):
            replace(none, **changes).check()


def test_a_fill_of_nothing_is_no_window():
    assert achieved(generate(SetParameters(resource_fill=Fraction(0)), 1)).windows == 0


def test_the_fill_of_one_resource_is_the_share_of_its_time():
    wanted = SetParameters(resources=1, resource_fill=Fraction(1, 2))
    assert abs(achieved(generate(wanted, 5)).resource_fill - Fraction(1, 2)) < Fraction(1, 1000)


@pytest.mark.parametrize(
    ("changes", "unused"),
    [
        ({}, ("fractional",)),
        ({"access_windows": 1}, ()),
        ({"resource_fill": TENTH}, ("access_windows",)),
        ({"resource_fill": Fraction(0), "access_windows": 1}, ("access_windows", "fractional")),
        ({"periods": (milliseconds(5),)}, ("tasks", "hyperperiod", "fractional")),
    ],
)
def test_parameters_without_effect_beside_the_others_are_named(changes, unused):
    assert replace(SetParameters(access_windows=0), **changes).unused() == unused


def test_the_experiments_of_table_iii_take_what_the_paper_reports():
    assert [row.number for row in TABLE_III] == [1, 2, 3, 4]
    assert [row.paper_seconds for row in TABLE_III] == [(460, 6816), (500, 700), (470, 630), (240, 400)]
    platforms = {(types, Fraction(share, 10)) for types in (2, 3) for share in (6, 7)}
    assert [{(cell.unit_types, cell.utilisation) for cell in row.cells} for row in TABLE_III] == [
        *[platforms] * 3,
        {(1, Fraction(7, 10))},
    ]
    assert [{cell.multi_version for cell in row.cells} for row in TABLE_III[::3]] == [{TENTH}, {0}]
    steps = [sorted({getattr(cell, row.varies) for cell in row.cells}) for row in TABLE_III[1:3]]
    assert [[int(100 * share) for share in shares] for shares in steps] == [[0, 10, 25, 50], [0, 20, 40, 60]]
    assert not any(cell.fractional or cell.unlike_units for row in TABLE_III for cell in row.cells)


def test_stated_periods_may_have_as_many_jobs_as_the_limit():
    SetParameters(periods=(Duration(1000), Duration(999_999_000))).check()
    with pytest.raises(HalpipeError, match="give 1000001 jobs"):
        SetParameters(periods=(Duration(1000), Duration(1_000_000_000))).check()


@pytest.mark.parametrize("tasks", [1, 2])
def test_a_microsecond_for_each_sextant_is_enough_for_few_tasks(tasks):
    short = SetParameters(tasks=tasks, units=1, unit_types=1, hyperperiod=Duration(6000), access_windows=0)
    model, schedule = generate_with_witness(short, 1)
    assert errors(model, schedule) == []


def test_a_profile_is_blocked_where_its_load_leaves_no_room_round_the_hyperperiod():
    """Of 60, 40 are taken from 8 to 2, and 20 more from 1 to 5."""
    profile = Profile(10)
    assert list(profile.blocked(3, 10, 60)) == []
    profile.add(8, 4, 40)
    profile.add(1, 4, 20)
    assert profile.area == 4 * 40 + 4 * 20
    assert list(profile.blocked(0, 10, 20)) == [(1, 2)]
    assert list(profile.blocked(0, 10, 21)) == [(0, 1), (1, 2), (8, 10)]
    assert list(profile.blocked(7, 10, 41)) == [(1, 3), (3, 4), (4, 5), (5, 8)]  # relative to 7
    assert list(profile.blocked(9, 1, 21)) == [(0, 1)]
    assert list(profile.blocked(2, 3, 40)) == []
    assert list(profile.blocked(4, 3, 41)) == [(0, 1)]


@pytest.mark.parametrize(
    ("total", "weights", "shares"),
    [
        (10, [1, 3], [2, 8]),
        (3, [1, 1, 1], [1, 1, 1]),
        (2, [0, 5, 0], [0, 2, 0]),
        (5, [2, 2], [2, 3]),
        (0, [0, 0], [0, 0]),
    ],
)
def test_what_is_shared_out_in_proportion_comes_to_the_total(total, weights, shares):
    assert tiling._spread(total, weights) == shares
