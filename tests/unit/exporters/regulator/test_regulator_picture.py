"""Pictures of bounds: every table in its place, every row in its colour, and nothing over anything else."""

import re
from dataclasses import replace
from itertools import pairwise

from regulator_samples import one_mode, switching, two_units

from halpipe.exporters.common.palette import FILLS
from halpipe.exporters.regulator.picture import HEIGHT, WIDTH, draw_bounds
from halpipe.models import Resource
from support import access, job, model, task, version

LEGEND = re.compile(r'<rect x="(\d+)" y="(\d+)" width="12" height="12" fill="(#\w+)"/><text[^>]*>([^<]+)<')


def picture_of(system, schedule):
    (found,) = draw_bounds(replace(system, resources=(Resource(name="mem", bandwidth=10**9),)), schedule).values()
    return found


def tops(picture):
    return [int(y) for y in re.findall(r'<g transform="translate\(60 (\d+)\)">', picture)]


def height_of(picture):
    return int(re.search(r'viewBox="0 0 (\d+) (\d+)"', picture)[2])


def many(units):
    names = [f"u{n}" for n in range(units)]
    phases = (access("mem", 0, 1, "0.05", "read"), access("mem", 1, 2, "0.05", "write"))
    tasks = [task(name, 10, version("v", 2, name, *phases)) for name in names]
    system = model(*tasks, units=" ".join(names), resources="mem")
    return system, one_mode(system, 10, *(job(system, name, 0, 0, name) for name in names))


def test_tables_lie_below_each_other_with_room_for_their_texts():
    picture = picture_of(*switching())
    found = tops(picture)
    titles = re.findall(r'font-weight="600">([^<]+)<', picture)
    assert titles == ["mode fast", "mode slow", "transition fast-&gt;slow", "transition slow-&gt;fast"]
    assert [b - a for a, b in pairwise(found)] == [HEIGHT + 70] * 3
    assert height_of(picture) == found[-1] + HEIGHT + 70
    assert f'viewBox="0 0 {WIDTH + 100} ' in picture


def test_a_resource_that_one_mode_alone_uses_has_its_picture():
    system, schedule = switching()
    idle = replace(schedule.modes[1], jobs=())
    assert ">mode slow<" in picture_of(system, replace(schedule, modes=(schedule.modes[0], idle), transitions=()))


def test_the_legend_has_four_rows_to_a_line_above_the_tables():
    for units, lines in ((2, 1), (3, 2), (4, 2), (5, 3)):
        picture = picture_of(*many(units))
        places = [(int(x), int(y)) for x, y, _, _ in LEGEND.findall(picture)]
        assert places == [(60 + 225 * (n % 4), 38 + 18 * (n // 4)) for n in range(2 * units)]
        assert tops(picture) == [62 + 18 * lines]
        assert height_of(picture) == 62 + 18 * lines + HEIGHT + 70


def test_units_have_a_colour_each_and_their_writes_a_darker_one():
    found = {name: fill for _, _, fill, name in LEGEND.findall(picture_of(*many(9)))}
    for n in range(9):  # the ninth begins again
        assert (found[f"u{n} read"], found[f"u{n} write"]) == (FILLS[n % 8], FILLS[16 + n % 8])
    light = picture_of(*two_units())
    assert [name for _, _, _, name in LEGEND.findall(light)] == ["u1 read", "u2 read", "u2 write"]
    areas = re.findall(r'fill="(#\w+)"><title>([^<]+)</title>', light)
    assert areas == [(FILLS[0], "u1 read"), (FILLS[1], "u2 read"), (FILLS[17], "u2 write")]


def test_rows_that_are_used_at_once_are_stacked_in_the_order_of_the_units():
    a = task("a", 10, version("v", 4, "u1", access("mem", 0, 4, "0.25", "read")))
    b = task("b", 10, version("v", 4, "u2", access("mem", 2, 4, "0.5", "write")))
    system = model(a, b, units="u2 u1", resources="mem")
    picture = picture_of(system, one_mode(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 0, "u2")))
    paths = dict(re.findall(r'<path d="([^"]+)" fill="#\w+"><title>([^<]+)<', picture))
    assert paths == {
        "M180 60L360 60L360 120L180 120Z": "u2 write",
        "M0 90L180 90L180 30L360 30L360 60L180 60L180 120L0 120Z": "u1 read",
    }
