"""Each task on its own: what it does with good messages, with none, and with damaged ones."""

import math
import shutil
import struct
import subprocess

import numpy as np
import pytest
from host import FLAGS
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from roboracer_case import EXAMPLE, FIXTURES
from track import ONE
from world import COMMAND, POSE, TURN, Opponent, World

from profiles import examples

FEW = examples(60, HealthCheck.function_scoped_fixture)
OPPONENT = struct.Struct("<2I4i")
POINT = struct.Struct("<4i")
POINTS, FULL = 28, 340  # of a path; cm/s, as the overlay states


def versions(model):
    return [(task, version) for task in model.tasks for version in task.versions]


def symbols(version, kind):
    return {t.symbol: t.size for a in version.accesses if a.kind == kind for t in a.transfers}


class Task:
    """One version of a task; messages by the last part of their symbol, all zero where none is given."""

    def __init__(self, model, programs, task, version):
        self.version = model.task(task).version(version)
        self.program = programs[task, version]

    def __call__(self, **messages):
        sizes = symbols(self.version, "read")
        inputs = {s: messages.get(s.split("_", 1)[1], b"").ljust(size, b"\0") for s, size in sizes.items()}
        outputs = self.program.run(inputs, symbols(self.version, "write"))
        return {symbol.split("_", 1)[1]: content for symbol, content in outputs.items()}


@pytest.fixture
def task(model, programs):
    return lambda name, version: Task(model, programs, name, version)


def pose(x, y, heading, speed=0.0, stamp=1):
    return POSE.pack(stamp, 1, round(x * ONE), round(y * ONE), round(heading * TURN) % 2**32, round(speed * ONE), 0, 0)


def opponents(*those, stamp=1):
    """Opponents by (s, d, speed)."""
    known = b"".join(OPPONENT.pack(9, 0, *(round(v * ONE) for v in (s, d, speed)), 0) for s, d, speed in those)
    return struct.pack("<2I", stamp, len(those)) + known


def path_of(message):
    """The points of a path: x, y, speed, offset."""
    return np.array([POINT.unpack_from(message, 16 + POINT.size * i) for i in range(POINTS)]) / ONE


def path(points, station=0, stamp=1):
    packed = b"".join(POINT.pack(*(round(float(v) * ONE) for v in p)) for p in points)
    return struct.pack("<4I", stamp, 1, station, 0) + packed


def is_valid(message):
    return struct.unpack_from("<I", message, 4)[0] == 1


# ------------------------------------------------------------------------------------------------ every task


def test_every_transfer_is_as_large_as_its_symbol(model, programs):
    from elftools.elf.elffile import ELFFile

    for task, version in versions(model):
        program = programs[task.name, version.name]
        with open(program.loaded._name, "rb") as stream:
            sizes = {s.name: s["st_size"] for s in ELFFile(stream).get_section_by_name(".dynsym").iter_symbols()}
        for access in version.accesses:
            for t in access.transfers:
                assert (t.symbol, t.size) == (t.symbol, sizes[t.symbol])
                assert t.size % 8 == 0


def test_a_buffer_has_one_size_for_all_who_use_it(model):
    sizes = {}
    for _, version in versions(model):
        for t in (t for a in version.accesses for t in a.transfers):
            assert sizes.setdefault(t.buffer, t.size) == t.size


def test_nothing_comes_of_nothing(task, model):
    """At power-up all buffers are zero: no task may tell others that it knows something."""
    for owner, version in versions(model):
        results = task(owner.name, version.name)()
        for name in ("pose", "path"):
            assert name not in results or not is_valid(results[name])
        assert "opponents" not in results or results["opponents"][4:] == bytes(100)
        assert "command" not in results or COMMAND.unpack(results["command"]) == (0, 1, 0, 0)


def test_a_run_begins_like_one_just_loaded(task):
    """Nothing may survive from job to job but what is transferred."""
    planner = task("/local_planner", "full")
    first = planner(pose=pose(7, 1.4, 0, 3.0), opponents=opponents((4.0, 0.0, 1.0)))
    planner(pose=pose(9, 6.2, 3.1, 2.0), opponents=opponents((15.0, 0.3, 2.0)))
    assert planner(pose=pose(7, 1.4, 0, 3.0), opponents=opponents((4.0, 0.0, 1.0))) == first


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs cc with sanitizers")
def test_damaged_messages_lead_nowhere_outside(model, tmp_path):
    """Thousands of messages of nonsense, watched by sanitizers: no array is left, no number overflows."""
    for owner, version in versions(model):
        inputs = symbols(version, "read")
        declared = "".join(f"extern unsigned char {name}[];" for name in inputs)
        filled = "".join(f"fill({name}, {size});" for name, size in inputs.items())
        defines = {"ENTRY": version.source.entry, "SEED": "88172645463325252ull", "ALL_DECLARATIONS": declared}
        flags = [*(f"-D{k}={v}" for k, v in (defines | {"ALL_FILLS": filled}).items())]
        flags += [f"-D{d}" for d in version.source.defines]
        watched = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
        files = [str(FIXTURES / "damage.c"), *(str(EXAMPLE / name) for name in version.source.files)]
        program = tmp_path / f"{owner.name[1:]}-{version.name}"
        built = ["cc", "-std=c11", "-O1", *watched, *flags, "-o", str(program), *files]
        subprocess.run(built, check=True, timeout=300)
        done = subprocess.run([str(program)], capture_output=True, text=True, timeout=60, check=False)
        assert (done.stdout, done.stderr) == ("survived\n", "")


def test_the_tasks_are_compiled_strictly():
    assert {"-std=c11", "-Wall", "-Wextra", "-Werror"} <= set(FLAGS)
    for source in (EXAMPLE / "tasks").glob("*.[ch]"):
        text = source.read_text()
        assert [word for word in ("float ", "double ", "malloc", "<stdlib", "<string", "<math") if word in text] == []


# ------------------------------------------------------------------------------------------------ localisation


def localise(task, track, places, version="full", state=b"", begin=None):
    """Give scans and odometry from each place in turn; return the estimated poses and the state.

    `begin` is the place where a `state` was left; odometry goes on from there.
    """
    world = World(track, seed=7)
    if begin is not None:
        _, _, distance, heading = struct.unpack_from("<2IiI", state)
        world.car.x, world.car.y, world.car.heading = begin
        world.car.distance, world.gyroscope = distance / ONE, heading / TURN - begin[2]
    found = []
    for x, y, heading in places:
        world.car.distance += math.hypot(x - world.car.x, y - world.car.y)
        world.car.x, world.car.y, world.car.heading = x, y, heading
        result = task("/particle_filter", version)(scan=world._scan(), odometry=world._odometry(), state=state)
        state = result["state"]
        _, valid, px, py, turn, *_ = POSE.unpack(result["pose"])
        assert valid == 1
        found.append((px / ONE, py / ONE, turn / TURN))
    return found, state


def errors(found, places):
    return [math.hypot(a[0] - b[0], a[1] - b[1]) for a, b in zip(found, places, strict=True)]


@pytest.mark.parametrize(("version", "limit"), [("full", 0.06), ("reduced", 0.10)])
def test_the_filter_follows_the_car(task, track, version, limit):
    places = [track.at(0.08 * i) for i in range(120)]
    found, _ = localise(task, track, places, version)
    assert max(errors(found, places)[10:]) < limit
    turns = [(a[2] - b[2] + math.pi) % (2 * math.pi) - math.pi for a, b in zip(found, places, strict=True)]
    assert max(map(abs, turns[10:])) < math.radians(2)


def test_the_filter_starts_within_a_hand_of_the_line(task, track):
    places = [track.at(0.12 + 0.05 * i, 0.1) for i in range(60)]
    found, _ = localise(task, track, places)
    assert max(errors(found, places)[40:]) < 0.06


@pytest.mark.parametrize(("before", "after"), [("full", "reduced"), ("reduced", "full")])
def test_a_version_goes_on_from_the_particles_of_the_other(task, track, before, after):
    places = [track.at(0.08 * i) for i in range(60)]
    _, state = localise(task, track, places[:30], before)
    found, _ = localise(task, track, places[30:], after, state, begin=places[29])
    assert max(errors(found, places[30:])) < 0.12


def test_the_filter_hands_on_the_scan_that_it_used(task, track):
    world = World(track, seed=3)
    scan = world._scan()
    assert task("/particle_filter", "full")(scan=scan, odometry=world._odometry())["scan"] == scan


def test_the_same_messages_give_the_same_particles(task, track):
    places = [track.at(0.1 * i) for i in range(5)]
    assert localise(task, track, places) == localise(task, track, places)


def test_without_odometry_there_is_no_pose(task, track):
    scan = World(track)._scan()
    assert not is_valid(task("/particle_filter", "full")(scan=scan)["pose"])


# ------------------------------------------------------------------------------------------------ detection


def detect(task, track, places, opponent, step, seed=5):
    """Scans from each place with an opponent that moves on by `step`; the opponents told at the end."""
    world, state = World(track, seed=seed, opponent=opponent), b""
    for i, (x, y, heading) in enumerate(places):
        world.car.x, world.car.y, world.car.heading = x, y, heading
        message = pose(x, y, heading, stamp=i)
        result = task("/opponent_detection", "full")(pose=message, scan=world._scan(), state=state)
        state = result["state"]
        if opponent is not None:
            opponent.s += step
    count = struct.unpack_from("<I", result["opponents"], 4)[0]
    return [tuple(OPPONENT.unpack_from(result["opponents"], 8 + OPPONENT.size * i)) for i in range(count)]


@pytest.mark.parametrize("gap", [1.2, 2.0, 3.0])
@pytest.mark.parametrize("s", [0.0, 6.0, 17.0])
def test_an_opponent_is_found_where_it_drives_and_as_fast(task, track, s, gap):
    steps = 80
    opponent = Opponent(track, s=s + gap)
    places = [track.at(s + 0.04 * i) for i in range(steps)]
    found = detect(task, track, places, opponent, 0.04)
    assert len(found) == 1
    seen, missed, along, aside, speed, _ = found[0]
    x, y, _ = opponent.place()
    true_s, true_d = track.locate(x, y)
    assert seen > steps // 2
    assert missed < 5
    assert abs((along / ONE - (true_s - 0.04) + 2) % track.length - 2) < 0.3
    assert aside / ONE == pytest.approx(true_d, abs=0.2)
    assert speed / ONE == pytest.approx(0.04 / 0.025, abs=0.5)


def test_walls_are_no_opponents(task, track):
    places = [track.at(0.1 * i) for i in range(280)]
    assert detect(task, track, places, None, 0) == []


def test_an_opponent_that_left_is_forgotten(task, track):
    world = World(track, seed=5, opponent=Opponent(track, s=2.0))
    message, state, told = pose(*track.at(0.0)), b"", []
    for scans in range(60):
        if scans == 20:
            world.opponent = None
        result = task("/opponent_detection", "full")(pose=message, scan=world._scan(), state=state)
        state = result["state"]
        told.append(result["opponents"][4])
    assert told[10:20] == [1] * 10
    assert told[50:] == [0] * 10


# ------------------------------------------------------------------------------------------------ planning


def plan(task, track, s, d=0.0, speed=3.0, those=(), version="full", rounds=12):
    """Plan again and again from the same place, as the path settles; returns the last one."""
    x, y, heading = track.at(s, d)
    state = b""
    for _ in range(rounds):
        result = task("/local_planner", version)(
            pose=pose(x, y, heading, speed), opponents=opponents(*those), path=state, state=state
        )
        state = result["state"]
    assert is_valid(result["path"])
    return path_of(result["path"])


@given(st.floats(0, 27.7), st.floats(-0.7, 0.7), st.sampled_from(["full", "race-line"]))
@FEW
def test_a_path_stays_on_the_track_and_below_the_limit(task, track, s, d, version):
    points = plan(task, track, s, d, version=version, rounds=3)
    assert track.wall_distance(points[:, :2]).min() > 0.15
    assert points[:, 2].max() <= (FULL if version == "full" else 500) / 100 + 1e-4
    assert points[:, 2].min() > 0.5
    ways = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert ways.min() > 0.1
    assert ways.max() < 0.45


@given(st.floats(0, 27.7), st.floats(-0.5, 0.5))
@FEW
def test_the_speed_of_a_path_can_be_braked_to(task, track, s, d):
    points = plan(task, track, s, d, version="race-line", rounds=2)
    spacing = track.length / 128
    for before, after in zip(points[:-1, 2], points[1:, 2], strict=True):
        assert before**2 <= after**2 + 2 * 3.0 * spacing + 0.01


def test_a_settled_path_lies_on_the_race_line(task, track, race):
    _, line = race
    points = plan(task, track, 3.0, line[14], version="race-line", rounds=40)
    first = int(3.0 * 128 / track.length)
    wanted = np.roll(line, -first)[:POINTS]
    assert np.abs(points[8:24, 3] - wanted[8:24]).max() < 0.15


@given(st.floats(0, 27.7), st.floats(1.5, 3.0), st.floats(-0.3, 0.3), st.floats(0, 1.5))
@FEW
def test_an_opponent_is_passed_at_a_distance_or_followed(task, track, s, gap, aside, speed):
    """Where the car would meet the opponent, the path is well beside it, or so slow that it never meets it."""
    there = (s + gap) % track.length
    points = plan(task, track, s, those=[(there, aside, speed)])
    spacing = track.length / 128
    first = int(s * 128 / track.length) * spacing - s
    beside, slow = True, True
    for i, (_, _, allowed, offset) in enumerate(points):
        reached = first + i * spacing
        if abs(gap + speed * i * spacing / 3.4 - i * spacing) < 0.3:
            beside = beside and abs(offset - aside) >= 0.4
        free = max(gap - 0.9 - reached + spacing, 0)
        slow = slow and allowed <= math.sqrt(speed**2 + 2 * 3.0 * free) + 0.05
    assert beside or slow


def test_what_was_seen_long_ago_does_not_count(task, track):
    x, y, heading = track.at(1.0)
    blocked = opponents((3.0, 0.0, 0.0), stamp=1)
    planner = task("/local_planner", "full")
    old = planner(pose=pose(x, y, heading, 3.0, stamp=100), opponents=blocked)["path"]
    alone = planner(pose=pose(x, y, heading, 3.0, stamp=100))["path"]
    fresh = planner(pose=pose(x, y, heading, 3.0, stamp=2), opponents=blocked)["path"]
    assert path_of(old).tolist() == path_of(alone).tolist()
    assert path_of(fresh).tolist() != path_of(alone).tolist()


# ------------------------------------------------------------------------------------------------ control


def straight(speed=2.0, d=0.0):
    return path([(1 + 0.2 * i, 4 + d, speed, 0) for i in range(POINTS)])


def steered(task, version="track", **messages):
    _, valid, speed, steering = COMMAND.unpack(task("/pure_pursuit", version)(**messages)["command"])
    assert valid == 1
    return speed / ONE, steering / TURN


def test_on_a_straight_path_it_goes_straight(task):
    speed, steering = steered(task, pose=pose(2.0, 4.0, 0.0, 2.0), path=straight())
    assert speed == pytest.approx(2.0, abs=1e-4)
    assert abs(steering) < 1e-3


@pytest.mark.parametrize("aside", [0.1, 0.3, -0.1, -0.3])
def test_it_steers_towards_the_path(task, aside):
    _, steering = steered(task, pose=pose(2.0, 4.0, 0.0, 2.0), path=straight(d=aside))
    assert math.copysign(1, steering) == math.copysign(1, aside)


@given(st.floats(0.9, 4.0), st.booleans(), st.floats(0.5, 3.0))
@FEW
def test_on_a_circle_it_holds_the_steering_of_that_circle(task, radius, left, speed):
    """The arc through the point ahead is the circle itself: its steering angle is atan(wheelbase / radius)."""
    side = 1 if left else -1
    angles = [0.2 * i / radius for i in range(-6, POINTS - 6)]
    points = [(7 + radius * math.sin(a), 4 + side * radius * (1 - math.cos(a)), speed, 0) for a in angles]
    expected = side * math.atan(0.33 / radius)
    held = struct.pack("<2I2i", 0, 1, round(speed * ONE), round(expected * TURN))
    _, steering = steered(task, pose=pose(7, 4, 0, speed), path=path(points), state=held)
    assert steering == pytest.approx(expected, abs=0.03)


def test_steering_never_exceeds_its_limit(task):
    _, steering = steered(task, pose=pose(2.0, 4.0, 2.0, 1.0), path=straight())
    assert abs(steering) == pytest.approx(math.radians(24), abs=1e-4)


def test_without_a_path_it_brakes(task):
    state = COMMAND.pack(0, 1, 2 * ONE, 0)
    speed, _ = steered(task, pose=pose(2.0, 4.0, 0.0, 2.0), state=state)
    assert speed == pytest.approx(2.0 - 3 * 0.025, abs=1e-3)


def test_a_safe_stop_brakes_to_nothing_along_the_path(task):
    state, speeds = COMMAND.pack(0, 1, 5 * ONE, 0), []
    stop = task("/pure_pursuit", "stop")
    while not speeds or speeds[-1] > 0:
        now = COMMAND.unpack(state)[2] / ONE
        result = stop(pose=pose(2.0, 4.0, 0.0, now), path=straight(speed=5.0), state=state)
        state = result["state"]
        speeds.append(COMMAND.unpack(result["command"])[2] / ONE)
        assert len(speeds) < 100
    changes = -np.diff([5.0, *speeds])
    assert changes[:-1] == pytest.approx(3 * 0.025, abs=1e-3)
    assert len(speeds) == math.ceil(5 / (3 * 0.025))
