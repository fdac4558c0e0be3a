"""The track: what the car knows of it is what the world is made of."""

import ctypes
import math

import numpy as np
import pytest
import track as module
from roboracer_case import EXAMPLE
from track import ONE


def test_the_tables_of_the_tasks_are_made_from_this_track(track):
    assert (EXAMPLE / "tasks" / "tables.c").read_text(encoding="ascii") == module.tables(track)


def test_points_have_equal_distances_and_close_the_circuit(track):
    steps = np.hypot(*(np.roll(track.points, -1, 0) - track.points).T)
    assert steps.max() / steps.min() < 1.01
    assert 27 < track.length < 28.5


@pytest.mark.parametrize(("s", "d"), [(0, 0), (3.3, 0.5), (10, -0.7), (27.7, 0.1), (14.2, 0.9)])
def test_locating_is_the_reverse_of_placing(track, s, d):
    x, y, _ = track.at(s, d)
    back_s, back_d = track.locate(x, y)
    assert abs((back_s - s + 1) % track.length - 1) < 0.03
    assert back_d == pytest.approx(d, abs=0.01)


def test_walls_stand_on_both_sides_and_apart(track):
    for side in (1, -1):
        assert np.abs(track.wall_distance(track.wall(side))).max() < 0.02
    assert track.wall_distance(track.points) == pytest.approx(track.half_width, abs=0.03)
    assert track.wall_distance(np.array([[0.0, 0.0], [7.0, 3.2]])).max() < 0


def test_the_race_line_bends_less_than_the_centre_line_and_keeps_off_the_walls(track, race):
    coarse, offset = race
    line = coarse.points + offset[:, None] * coarse.normals

    def sharpest(points):
        to, back = np.roll(points, -1, 0) - points, points - np.roll(points, 1, 0)
        turn = np.arctan2(back[:, 0] * to[:, 1] - back[:, 1] * to[:, 0], (back * to).sum(axis=1))
        return np.abs(turn / np.hypot(*to.T)).max()

    assert np.abs(offset).max() <= track.half_width - 0.35
    assert sharpest(line) < 0.8 * sharpest(coarse.points)


def test_a_tighter_bend_costs_more_than_the_race_line(track, race):
    """No single offset can be moved by 2 cm to make the line bend less: it is a minimum."""
    coarse, offset = race
    limit = track.half_width - 0.35
    least = (module._bending(coarse, offset) ** 2).sum()
    for i in range(0, len(offset), 5):
        for change in (-0.02, 0.02):
            moved = offset.copy()
            moved[i] = np.clip(moved[i] + change, -limit, limit)
            assert (module._bending(coarse, moved) ** 2).sum() >= least - 1e-3


def test_the_tasks_find_places_as_the_world_does(track, probe):
    for s in np.arange(0.05, track.length, 1.37):
        for d in (-0.6, 0.0, 0.6):
            x, y, _ = track.at(s, d)
            found_s, found_d = ctypes.c_int32(), ctypes.c_int32()
            place = (round(x * ONE), round(y * ONE))
            probe.probe_locate(*place, ctypes.byref(found_s), ctypes.byref(found_d))
            assert abs((found_s.value / ONE - s + 1) % track.length - 1) < 0.12
            assert found_d.value / ONE == pytest.approx(d, abs=0.03)
            wall = probe.probe_wall(*place) / 32
            assert wall == pytest.approx(track.wall_distance(np.array([[x, y]]))[0], abs=0.12)


def test_outside_of_the_map_is_outside_of_the_track(probe):
    for x, y in [(-1, 100), (100, -1), (15 * ONE, ONE), (ONE, 9 * ONE), (-(2**31), 2**31 - 1)]:
        assert probe.probe_wall(x, y) == -32


@pytest.mark.parametrize(("start", "end", "way"), [(1, 2, 1), (2, 1, -1), (27.5, 0.5, None), (0.5, 27.5, None)])
def test_the_way_along_the_track_is_the_shorter_one(track, probe, start, end, way):
    found = probe.probe_ahead(round(start * ONE), round(end * ONE)) / ONE
    expected = way if way is not None else math.copysign(track.length - 27, end - start) * -1
    assert found == pytest.approx(expected, abs=1e-3)
