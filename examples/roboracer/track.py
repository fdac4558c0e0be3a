"""The race track: its geometry, and what the car knows of it before the race (tasks/tables.c).

The centre line is a closed cubic B-spline through a few control points, with walls at a constant distance to both
sides. Lengths are in metres; s runs along the centre line from the start, d across it, positive to the left.

    python track.py        writes tasks/tables.c again, after a change of the track
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

CONTROL = (
    *((5.5, 1.35), (9.0, 1.4), (11.9, 1.75), (12.6, 3.6), (11.6, 5.9), (9.4, 6.35), (8.0, 5.3)),
    *((6.6, 4.5), (5.2, 5.3), (3.6, 6.4), (1.8, 5.9), (1.25, 3.6), (2.2, 1.6)),
)
HALF_WIDTH = 1.05
SIZE = (14.0, 8.0)  # of the ground, and of the map
FINE = 1024  # points of the centre line for the simulation
STATIONS = 128  # and for the car
CELL = 1 / 8  # of the map; as in tasks/track.h
STEP = 1 / 32  # of the distances in the map
ONE = 65536  # Q16.16


@dataclass(frozen=True)
class Track:
    """A closed centre line of `points` at equal distances, and walls at `half_width` to both sides."""

    points: np.ndarray
    half_width: float = HALF_WIDTH

    @cached_property
    def length(self) -> float:
        """Of the centre line."""
        return float(np.hypot(*(np.roll(self.points, -1, 0) - self.points).T).sum())

    @cached_property
    def tangents(self) -> np.ndarray:
        """The directions of travel, of length 1."""
        along = np.roll(self.points, -1, 0) - np.roll(self.points, 1, 0)
        return along / np.hypot(*along.T)[:, None]

    @cached_property
    def normals(self) -> np.ndarray:
        """To the left of the direction of travel."""
        return np.stack([-self.tangents[:, 1], self.tangents[:, 0]], axis=1)

    def wall(self, side: int) -> np.ndarray:
        """The left wall (1) or the right one (-1)."""
        return self.points + side * self.half_width * self.normals

    def at(self, s: float, d: float = 0.0) -> tuple[float, float, float]:
        """The place (x, y) and the direction of travel there, in radians."""
        count = len(self.points)
        place = (s / self.length * count) % count
        i, part = int(place), place - int(place)
        j = (i + 1) % count
        point = self.points[i] * (1 - part) + self.points[j] * part
        tangent = self.tangents[i] * (1 - part) + self.tangents[j] * part
        normal = np.array([-tangent[1], tangent[0]])
        x, y = point + d * normal / math.hypot(*tangent)
        return float(x), float(y), math.atan2(tangent[1], tangent[0])

    def locate(self, x: float, y: float) -> tuple[float, float]:
        """The place (s, d) on the track of a point of the plane."""
        away = np.array([x, y]) - self.points
        i = int(np.argmin((away**2).sum(axis=1)))
        s = i * self.length / len(self.points) + float(away[i] @ self.tangents[i])
        return s % self.length, float(away[i] @ self.normals[i])

    def wall_distance(self, points: np.ndarray) -> np.ndarray:
        """How far each point is from the nearest wall; negative outside the track."""
        away = points[:, None, :] - self.points[None, ::2, :]
        return self.half_width - np.sqrt((away**2).sum(axis=2).min(axis=1))


def circuit() -> Track:
    """The track of this example, at equal distances along the spline."""
    dense = _spline(np.array(CONTROL), 8 * FINE)
    return Track(_even(dense, FINE))


def _spline(control: np.ndarray, count: int) -> np.ndarray:
    """A closed uniform cubic B-spline."""
    place = np.arange(count) * len(control) / count
    i, u = place.astype(int), (place % 1)[:, None]
    p = [control[(i + k - 1) % len(control)] for k in range(4)]
    weights = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    return sum(w * q for w, q in zip(weights, p, strict=True)) / 6


def _even(points: np.ndarray, count: int) -> np.ndarray:
    """The same closed line by `count` points at equal distances."""
    closed = np.vstack([points, points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    wanted = np.arange(count) * along[-1] / count
    return np.stack([np.interp(wanted, along, closed[:, k]) for k in range(2)], axis=1)


def race_line(track: Track, margin: float = 0.35, rounds: int = 20) -> np.ndarray:
    """Offsets of the line that bends least: the integral of its squared curvature, within a margin from the walls.

    Damped Gauss-Newton steps, each clipped to the bounds. Rounded to 1/256 m, so that the last digits of a library's
    arithmetic do not show.
    """
    limit = track.half_width - margin
    offset = np.zeros(len(track.points))
    for _ in range(rounds):
        bending, slopes = _bending(track, offset), _slopes(track, offset)
        held = (np.abs(offset) >= limit) & (offset * (slopes.T @ bending) < 0)
        slopes[:, held] = 0
        step = np.linalg.solve(slopes.T @ slopes + 0.3 * np.eye(len(offset)), slopes.T @ bending)
        offset = np.clip(offset - step, -limit, limit)
    return np.round(offset * 256) / 256


def _bending(track: Track, offset: np.ndarray) -> np.ndarray:
    """The turn at each point of a line, over the root of the length: their squares add up to the integral."""
    line = track.points + offset[:, None] * track.normals
    to, back = np.roll(line, -1, 0) - line, line - np.roll(line, 1, 0)
    turn = np.arctan2(back[:, 0] * to[:, 1] - back[:, 1] * to[:, 0], (back * to).sum(axis=1))
    return turn / np.sqrt((np.hypot(*to.T) + np.hypot(*back.T)) / 2)


def _slopes(track: Track, offset: np.ndarray, small: float = 1e-6) -> np.ndarray:
    """The change of each turn with each offset. A turn has three points, so every fourth offset is tried at once."""
    count = len(offset)
    slopes = np.zeros((count, count))
    for first in range(4):
        tried = np.arange(first, count, 4)
        moved = offset.copy()
        moved[tried] += small
        change = (_bending(track, moved) - _bending(track, offset)) / small
        for turn in (tried - 1, tried, (tried + 1) % count):
            slopes[turn, tried] = change[turn]
    return slopes


def tables(track: Track) -> str:
    """tasks/tables.c: sine, powers of two, the map, the stations of the centre line with the race line."""
    coarse = Track(track.points[:: FINE // STATIONS], track.half_width)
    columns, rows = (round(extent / CELL) for extent in SIZE)
    x = (np.arange(columns) + 0.5) * CELL
    walls = [track.wall_distance(np.stack([x, np.full(columns, (row + 0.5) * CELL)], axis=1)) for row in range(rows)]
    cells = np.clip(np.round(np.array(walls) / STEP), -32, 127).astype(int)
    offsets = race_line(coarse)
    stations = [
        "{" + ", ".join(str(_q16(v)) for v in (x, y, tangent[1], tangent[0], offset)) + "}"
        for (x, y), tangent, offset in zip(coarse.points, coarse.tangents, offsets, strict=True)
    ]
    sines = [_q16(math.sin(math.pi / 2 * i / 256)) for i in range(257)]
    powers = [_q16(2 ** (-i / 64)) for i in range(64)]
    return "\n".join(
        [
            "/* Written by track.py. What the car knows of the track before the race. */",
            '#include "track.h"',
            "",
            f"const int32_t sine_table[257] = {{\n{_wrapped(sines)}}};",
            f"const uint32_t halving_table[64] = {{\n{_wrapped(powers)}}};",
            f"const q16 track_length = {_q16(track.length)}, half_width = {_q16(track.half_width)};",
            f"const struct station stations[STATIONS] = {{\n{_wrapped(stations)}}};",
            "const int8_t map[MAP_ROWS][MAP_COLUMNS] = {",
            *("  {" + ",".join(map(str, row)) + "}," for row in cells),
            "};",
            "",
        ]
    )


def _q16(value: float) -> int:
    return round(float(value) * ONE)


def _wrapped(values: list[int] | list[str], width: int = 110) -> str:
    lines = [""]
    for value in values:
        text = f" {value},"
        if len(lines[-1]) + len(text) > width:
            lines.append("")
        lines[-1] += text
    return "".join(f" {line}\n" for line in lines)


if __name__ == "__main__":
    (Path(__file__).parent / "tasks" / "tables.c").write_text(tables(circuit()), encoding="ascii")
