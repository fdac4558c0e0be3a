"""The simulated world: car, lidar, opponent and referee, by what geometry says."""

import math

import numpy as np
import pytest
from track import ONE
from world import COMMAND, ODOMETRY, POSE, SCAN, TURN, WHEELBASE, Car, Opponent, World, _cast, _gap, _sides

SQUARE = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


def silent(world, time, command=b"\0" * 16, pose=b"\0" * 32):
    """Let the world move on, with what lies in main memory; return what it writes there."""
    written = {}
    world.exchange(time, {"command": command, "pose": pose}.__getitem__, written.__setitem__)
    return written


def command(speed, steering=0.0):
    return COMMAND.pack(0, 1, round(speed * ONE), round(steering * TURN))


def test_a_steered_car_drives_the_circle_of_its_steering_angle():
    car = Car(0.0, 0.0, 0.0, speed=1.0, steering=0.3, wanted_speed=1.0, wanted_steering=0.3)
    radius = WHEELBASE / math.tan(0.3)
    for _ in range(400):
        car.move(0.0025)
        assert math.hypot(car.x, car.y - radius) == pytest.approx(radius, abs=1e-3)
    assert car.distance == pytest.approx(1.0)
    assert car.heading == pytest.approx(1.0 / radius)


def test_speed_and_steering_follow_no_faster_than_they_can():
    car = Car(0.0, 0.0, 0.0, wanted_speed=3.0, wanted_steering=0.4)
    car.move(0.1)
    assert car.speed == pytest.approx(0.4)
    assert car.steering == pytest.approx(0.35)
    car.wanted_speed = 0.0
    car.move(0.01)
    assert car.speed == pytest.approx(0.34)


def test_rays_end_at_the_wall():
    angles = np.radians([0, 45, 90, 180, 270])
    ranges = _cast(0.25, 0.0, np.cos(angles), np.sin(angles), _sides(SQUARE))
    assert ranges == pytest.approx([0.75, 0.75 * math.sqrt(2), 1.0, 1.25, 1.0])


def test_a_ray_that_meets_nothing_is_infinite():
    wall = np.array([(1.0, -1.0, 1.0, 1.0)])
    assert _cast(0.0, 0.0, np.array([-1.0]), np.array([0.0]), wall)[0] == math.inf


@pytest.mark.parametrize(("shift", "gap"), [((3.0, 0.0), 1.0), ((0.0, -2.5), 0.5), ((1.5, 1.5), -0.5), ((0, 0), -2)])
def test_the_gap_between_two_bodies(shift, gap):
    assert _gap(SQUARE, SQUARE + np.array(shift)) == pytest.approx(gap)
    assert _gap(SQUARE + np.array(shift), SQUARE) == pytest.approx(gap)


def test_a_scan_sees_the_walls_at_the_distance_of_the_track(track):
    world = World(track, noise=0.0)
    _, valid, *ranges = SCAN.unpack(silent(world, 0.0)["scan"])
    assert valid == 1
    right, left = ranges[30], ranges[150]  # at -90 and 90 degrees
    for measured in (right, left):
        assert measured == 0 or measured / 1000 == pytest.approx(track.half_width, abs=0.03)
    assert sum(r == 0 for r in ranges[:181]) < 10


def test_an_opponent_hides_what_is_behind_it(track):
    alone = SCAN.unpack(silent(World(track, noise=0.0), 0.0)["scan"])[2:]
    behind = World(track, noise=0.0, opponent=Opponent(track, s=2.0))
    both = SCAN.unpack(silent(behind, 0.0)["scan"])[2:]
    nearer = [i for i in range(181) if both[i] and alone[i] and both[i] < alone[i] - 100]
    assert nearer
    assert all(80 <= i <= 100 for i in nearer)  # straight ahead
    assert min(both[i] for i in nearer) / 1000 == pytest.approx(2.0 - 0.25, abs=0.06)


def test_a_command_is_in_force_from_the_moment_it_is_taken(track):
    world = World(track)
    silent(world, 0.0, command(2.0))
    assert world.car.speed == 0
    silent(world, 0.025)
    assert world.car.speed == pytest.approx(0.1)
    silent(world, 0.05)  # no valid command: the last one holds
    assert world.car.speed == pytest.approx(0.2)


def test_odometry_counts_from_power_up(track):
    world = World(track)
    before = ODOMETRY.unpack(silent(world, 0.0, command(2.0))["odometry"])
    after = ODOMETRY.unpack(silent(world, 1.0)["odometry"])
    assert (before[0], after[0]) == (0, 1)
    assert after[2] / ONE == pytest.approx(world.car.distance, rel=0.05)
    assert after[3] / ONE == pytest.approx(world.car.speed, abs=1e-3)


def test_a_lap_ends_on_the_line(track):
    world, time = World(track), 0.0
    world.car.wanted_speed = 3.0
    while not world.laps:
        s, _ = track.locate(world.car.x, world.car.y)
        x, y, heading = track.at(s)
        world.car.x, world.car.y, world.car.heading = x, y, heading  # on rails
        time += 0.025
        silent(world, time)
    assert world.laps[0].time == pytest.approx(track.length / 3.0 + 3.0 / 4 / 2, rel=0.02)
    assert world.laps[0].end <= world.time


def test_driving_back_over_the_line_is_no_lap(track):
    world = World(track)
    for i in range(1, 200):
        world.car.speed = world.car.wanted_speed = -2.0
        silent(world, 0.025 * i)
        world.car.wanted_speed = -2.0
    assert world.laps == []
    assert world.progress < 0


def test_touching_a_wall_or_the_opponent_is_seen(track):
    world = World(track, opponent=Opponent(track, s=10.0))
    silent(world, 0.0)
    assert world.moments[-1].clearance > 0.5
    assert world.moments[-1].gap > 1
    world.car.x, world.car.y, world.car.heading = track.at(0.0, 0.95)
    silent(world, 0.025)
    assert world.moments[-1].clearance < 0
    world.car.x, world.car.y, world.car.heading = world.opponent.place()
    silent(world, 0.05)
    assert world.moments[-1].gap < 0


def test_overtaking_is_counted_once(track):
    world = World(track, opponent=Opponent(track, s=1.0, speed=0.0))
    for i in range(80):
        world.car.x, world.car.y, world.car.heading = track.at(0.05 * i, -0.5)
        silent(world, 0.025 * i)
    assert len(world.overtakes) == 1
    assert world.moments[world.overtakes[0]].time == pytest.approx(0.025 * 20, abs=0.06)


def test_a_pose_is_held_against_the_place_of_its_scan(track):
    world = World(track)
    silent(world, 0.0, command(3.0))
    x, y, heading = world.scanned[0]
    place = (round((x + 0.03) * ONE), round((y - 0.04) * ONE), round((heading + 0.01) * TURN) % 2**32)
    message = POSE.pack(0, 1, *place, 0, 0, 0)
    silent(world, 0.5, pose=message)
    away, turn = world.moments[-1].error
    assert away == pytest.approx(0.05, abs=1e-4)
    assert turn == pytest.approx(0.01, abs=1e-5)
    silent(world, 0.525, pose=message)
    assert world.moments[-1].error is None  # counted once


def test_the_same_seed_gives_the_same_measurements(track):
    def measured(seed):
        world = World(track, seed=seed)
        return [silent(world, 0.025 * i, command(2.0)) for i in range(5)]

    assert measured(1) == measured(1)
    assert measured(1) != measured(2)
