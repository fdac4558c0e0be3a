"""The world around the stack: a car on the track, its sensors and actuators, and an opponent.

The world meets the stack only at the beginning of every cycle: it moves everything on, takes the command that lies in
main memory, and puts a new scan and new odometry there. So a drive depends on which job reads and writes what in which
cycle, which the schedule decides, and not on how quickly it does so within the cycle.

Lengths are in metres, times in seconds, angles in radians; the messages of tasks/messages.h are in fixed point.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from track import ONE, Track

if TYPE_CHECKING:
    from collections.abc import Callable

SCAN = struct.Struct("<2I184H")
ODOMETRY = struct.Struct("<2I2i2I")
POSE = struct.Struct("<2I2iI2iI")
COMMAND = struct.Struct("<2I2i")

BEAMS, BEAM_FIRST, BEAM_STEP = 181, math.radians(-135), math.radians(1.5)
TURN = 2**32 / (2 * math.pi)  # the tasks' angles: a full turn is 2^32
STEP = 0.0025  # of the integration

WHEELBASE, CAR_LENGTH, CAR_WIDTH, REAR = 0.33, 0.5, 0.3, 0.1  # the rear axle is the reference and carries the lidar
STEERING_RATE, STEERING_LIMIT = 3.5, math.radians(24)
ACCELERATION, BRAKING = 4.0, 6.0


@dataclass
class Car:
    """A kinematic bicycle: rear axle at (x, y), with motor and steering that follow commands as fast as they can."""

    x: float
    y: float
    heading: float
    speed: float = 0.0
    steering: float = 0.0
    distance: float = 0.0
    wanted_speed: float = 0.0
    wanted_steering: float = 0.0

    def move(self, time: float) -> None:
        """Go on for `time` seconds, on one arc."""
        change = self.wanted_speed - self.speed
        self.speed += min(max(change, -BRAKING * time), ACCELERATION * time)
        turn = self.wanted_steering - self.steering
        self.steering += min(max(turn, -STEERING_RATE * time), STEERING_RATE * time)
        way = self.speed * time
        turned = way * math.tan(self.steering) / WHEELBASE
        self.x += way * math.cos(self.heading + turned / 2)
        self.y += way * math.sin(self.heading + turned / 2)
        self.heading += turned
        self.distance += way

    def corners(self) -> np.ndarray:
        """Of the body, in order round it."""
        return _rectangle(self.x, self.y, self.heading, -REAR, CAR_LENGTH - REAR)


@dataclass
class Opponent:
    """Drives along the centre line, swaying to both sides, whatever the others do."""

    track: Track
    s: float
    speed: float = 1.9

    def move(self, time: float) -> None:
        """Go on for `time` seconds."""
        self.s += self.speed * time

    def place(self) -> tuple[float, float, float]:
        """The middle (x, y) and the heading."""
        return self.track.at(self.s, 0.25 * math.sin(2 * math.pi * self.s / 9))

    def corners(self) -> np.ndarray:
        """Of the body, in order round it."""
        return _rectangle(*self.place(), -CAR_LENGTH / 2, CAR_LENGTH / 2)


def _rectangle(x: float, y: float, heading: float, back: float, front: float) -> np.ndarray:
    c, s, half = math.cos(heading), math.sin(heading), CAR_WIDTH / 2
    corners = ((front, half), (back, half), (back, -half), (front, -half))
    return np.array([(x + a * c - b * s, y + a * s + b * c) for a, b in corners])


def _gap(a: np.ndarray, b: np.ndarray) -> float:
    """The widest strip along a side of two convex bodies that separates them: 0 or less if they touch."""
    gap = -math.inf
    for body in (a, b):
        for side in np.roll(body, -1, 0) - body:
            normal = np.array([-side[1], side[0]]) / math.hypot(*side)
            gap = max(gap, (b @ normal).min() - (a @ normal).max(), (a @ normal).min() - (b @ normal).max())
    return float(gap)


def _sides(body: np.ndarray) -> np.ndarray:
    """From the corners of a closed line to its segments (x, y, x, y)."""
    return np.hstack([body, np.roll(body, -1, 0)])


@dataclass(frozen=True)
class Moment:
    """What is known of one cycle, at its beginning."""

    time: float
    x: float
    y: float
    heading: float
    speed: float
    clearance: float  # of the body to the nearest wall; negative: it stands in the wall
    opponent: tuple[float, float] | None
    gap: float | None  # of the body to the opponent's
    error: tuple[float, float] | None  # of the newest pose, against where the car was when it was scanned: m, rad


@dataclass(frozen=True)
class Lap:
    """From line to line."""

    begin: float
    end: float

    @property
    def time(self) -> float:
        """Of the lap."""
        return self.end - self.begin


@dataclass
class World:
    """Car, opponent and sensors. What happened is in `moments`, `laps` and `overtakes` (numbers of moments)."""

    track: Track
    seed: int = 1
    opponent: Opponent | None = None
    noise: float = 0.01  # of the lidar, m
    moments: list[Moment] = field(default_factory=list)
    laps: list[Lap] = field(default_factory=list)
    overtakes: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = np.random.Generator(np.random.PCG64(self.seed))
        self.car = Car(*self.track.at(0.0))
        walls = [self.track.wall(side)[::4] for side in (1, -1)]
        self.walls = np.concatenate([_sides(wall) for wall in walls])
        self.time = 0.0
        self.place, self.progress, self.lead = 0.0, 0.0, 0  # along the track; without end; in laps on the opponent
        self.gyroscope, self.encoder = 0.0, 0.0  # what noise has added to them
        self.scanned: list[tuple[float, float, float]] = []  # where the car was at each scan
        self.estimated = -1  # the scan of the newest pose

    def exchange(self, time: float, read: Callable[[str], bytes], write: Callable[[str, bytes], None]) -> None:
        """Move on to `time`, with the commands so far; then take the new command and give new measurements."""
        while self.time < time - STEP / 2:
            self._step()
        self._record(self._error(read("pose")))
        _, valid, speed, steering = COMMAND.unpack(read("command"))
        if valid:
            self.car.wanted_speed = max(speed / ONE, 0.0)
            self.car.wanted_steering = min(max(steering / TURN, -STEERING_LIMIT), STEERING_LIMIT)
        write("scan", self._scan())
        write("odometry", self._odometry())
        self.scanned.append((self.car.x, self.car.y, self.car.heading))

    def _step(self) -> None:
        heading, distance = self.car.heading, self.car.distance
        self.car.move(STEP)
        if self.opponent is not None:
            self.opponent.move(STEP)
        self.time += STEP
        self.gyroscope += 0.02 * abs(self.car.heading - heading) * self.random.standard_normal()
        self.encoder += (self.car.distance - distance) * (0.01 + 0.05 * self.random.standard_normal())
        self._count_laps()

    def _count_laps(self) -> None:
        length = self.track.length
        place, _ = self.track.locate(self.car.x, self.car.y)
        way = (place - self.place + length / 2) % length - length / 2
        self.place, self.progress = place, self.progress + way
        beyond = self.progress - (len(self.laps) + 1) * length
        if way > 0 and beyond >= 0:
            begin = self.laps[-1].end if self.laps else 0.0
            self.laps.append(Lap(begin, self.time - STEP * beyond / way))

    def _error(self, message: bytes) -> tuple[float, float] | None:
        stamp, valid, x, y, heading, *_ = POSE.unpack(message)
        if not valid or stamp == self.estimated or stamp >= len(self.scanned):
            return None
        self.estimated = stamp
        true_x, true_y, true_heading = self.scanned[stamp]
        turn = (heading / TURN - true_heading + math.pi) % (2 * math.pi) - math.pi
        return math.hypot(x / ONE - true_x, y / ONE - true_y), turn

    def _record(self, error: tuple[float, float] | None) -> None:
        car, body, opponent, gap = self.car, self.car.corners(), None, None
        if self.opponent is not None:
            opponent, gap = self.opponent.place()[:2], _gap(body, self.opponent.corners())
            lead = math.floor((self.progress - self.opponent.s) / self.track.length)
            if self.moments and lead > self.lead:
                self.overtakes.append(len(self.moments))
            self.lead = lead
        clearance = float(self.track.wall_distance(body).min())
        self.moments.append(Moment(self.time, car.x, car.y, car.heading, car.speed, clearance, opponent, gap, error))

    def _scan(self) -> bytes:
        walls = self.walls
        if self.opponent is not None:
            walls = np.concatenate([walls, _sides(self.opponent.corners())])
        angles = self.car.heading + BEAM_FIRST + BEAM_STEP * np.arange(BEAMS)
        ranges = _cast(self.car.x, self.car.y, np.cos(angles), np.sin(angles), walls)
        ranges = ranges + self.noise * self.random.standard_normal(BEAMS)
        lost = self.random.random(BEAMS) < 0.01
        millimetres = np.where(lost | (ranges > 12.0), 0, np.clip(np.round(ranges * 1000), 20, 65535)).astype(int)
        return SCAN.pack(len(self.scanned), 1, *(int(r) for r in millimetres), 0, 0, 0)

    def _odometry(self) -> bytes:
        heading = int((self.car.heading + self.gyroscope) * TURN) % 2**32
        distance = int((self.car.distance + self.encoder) * ONE)
        return ODOMETRY.pack(len(self.scanned), 1, distance, int(self.car.speed * ONE), heading, 0)


def _cast(x: float, y: float, dx: np.ndarray, dy: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """How far a ray from (x, y) in each direction (dx, dy) goes until it meets a wall; infinite if it meets none."""
    ax, ay = walls[:, 0] - x, walls[:, 1] - y
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    across = dx[:, None] * ey - dy[:, None] * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (ax * ey - ay * ex) / across
        part = (ax * dy[:, None] - ay * dx[:, None]) / across
    met = (far > 0) & (part >= 0) & (part <= 1)
    return np.where(met, far, np.inf).min(axis=1)
