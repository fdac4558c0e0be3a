"""The picture of a drive: the track from above, the driven line in the colour of the mode, switches and lap times."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

from track import SIZE
from world import CAR_LENGTH, CAR_WIDTH, REAR

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    from world import World

COLOURS = {"race": "#d55e00", "time-trial": "#0072b2", "safe-stop": "#009e73"}  # told apart by everybody (Okabe, Ito)
SCALE = 80  # pixels for a metre
INK, GREY, ROAD = "#222", "#888", "#f1f1ee"
LEFT, RIGHT, TOP, LINE, SHOWN = 250, 640, 320, 20, 5  # of the texts in the infield


def picture(world: World, modes: Sequence[str], laps: Sequence[tuple[str, float]]) -> str:
    """SVG of a drive: `modes` in force at each moment, `laps` with the mode and the time of each."""
    width, height = (round(extent * SCALE) for extent in SIZE)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="14">'
    )
    parts = [
        head,
        f"<title>{len(laps)} laps of the RoboRacer stack</title>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
        *_road(world),
        *_lines(world, modes),
        *_marks(world, modes),
        *_laps(laps),
        *_legend(world, modes),
        "</svg>",
        "",
    ]
    return "\n".join(parts)


def _at(x: float, y: float) -> tuple[str, str]:
    return f"{x * SCALE:.1f}", f"{(SIZE[1] - y) * SCALE:.1f}"


def _points(points: Iterable[Sequence[float]] | np.ndarray) -> str:
    return " ".join(",".join(_at(float(x), float(y))) for x, y in points)


def _road(world: World) -> Iterable[str]:
    outer, inner = (world.track.wall(side)[::4] for side in (-1, 1))
    yield f'<polygon points="{_points(outer)}" fill="{ROAD}" stroke="{INK}" stroke-width="3"/>'
    yield f'<polygon points="{_points(inner)}" fill="white" stroke="{INK}" stroke-width="3"/>'
    start = [world.track.at(0, d)[:2] for d in (-world.track.half_width, world.track.half_width)]
    yield f'<polyline points="{_points(start)}" stroke="{INK}" stroke-width="5" stroke-dasharray="5 5"/>'


def _lines(world: World, modes: Sequence[str]) -> Iterable[str]:
    others = [m.opponent for m in world.moments if m.opponent]
    if others:
        yield (
            f'<polyline points="{_points(others)}" fill="none" stroke="{GREY}" stroke-width="1.5" '
            'stroke-dasharray="6 5"/>'
        )
    for mode, run in groupby(range(len(modes)), key=lambda i: modes[i]):
        places = list(run)
        line = [(m.x, m.y) for m in world.moments[places[0] : places[-1] + 2]]
        yield (
            f'<polyline points="{_points(line)}" fill="none" stroke="{_colour(mode)}" stroke-width="2.2" '
            'stroke-opacity="0.85" stroke-linejoin="round"/>'
        )


def _switches(modes: Sequence[str]) -> list[int]:
    """The moments at which another mode comes into force."""
    return [i for i in range(1, len(modes)) if modes[i] != modes[i - 1]]


def _marks(world: World, modes: Sequence[str]) -> Iterable[str]:
    for i in world.overtakes:
        x, y = _at(world.moments[i].x, world.moments[i].y)
        yield f'<circle cx="{x}" cy="{y}" r="5" fill="white" stroke="{INK}" stroke-width="2"/>'
        yield (
            f'<text x="{x}" y="{float(y) - 13:.1f}" text-anchor="middle" fill="{INK}" stroke="{ROAD}" stroke-width="4" '
            f'paint-order="stroke">overtakes at {world.moments[i].time:.1f} s</text>'
        )
    for i in _switches(modes):
        x, y = _at(world.moments[i].x, world.moments[i].y)
        yield f'<circle cx="{x}" cy="{y}" r="6" fill="{_colour(modes[i])}" stroke="white" stroke-width="1.5"/>'
    end = world.moments[-1]
    x, y = _at(end.x, end.y)
    yield (
        f'<g transform="translate({x} {y}) rotate({-math.degrees(end.heading):.1f})"><rect x="{-REAR * SCALE:.0f}" '
        f'y="{-CAR_WIDTH * SCALE / 2:.0f}" width="{CAR_LENGTH * SCALE:.0f}" height="{CAR_WIDTH * SCALE:.0f}" rx="4" '
        f'fill="{INK}"/></g>'
    )


def _laps(laps: Sequence[tuple[str, float]]) -> Iterable[str]:
    """In the left half of the infield: the time of each lap, the best one bold."""
    best = min((time for _, time in laps), default=0)
    for i, (mode, time) in enumerate(laps[:SHOWN]):
        y, weight = TOP + LINE * i, ' font-weight="bold"' if time == best else ""
        yield f'<rect x="{LEFT}" y="{y - 8}" width="26" height="5" fill="{_colour(mode)}"/>'
        yield f'<text x="{LEFT + 36}" y="{y}" fill="{INK}"{weight}>lap {i + 1}</text>'
        yield f'<text x="{LEFT + 145}" y="{y}" fill="{INK}" text-anchor="end"{weight}>{time:.3f} s</text>'
    if len(laps) > SHOWN:
        y = TOP + LINE * SHOWN
        yield f'<text x="{LEFT + 36}" y="{y}" fill="{GREY}">and {len(laps) - SHOWN} more</text>'


def _legend(world: World, modes: Sequence[str]) -> Iterable[str]:
    """In the right half: what the lines mean, and when each mode began."""
    y = TOP
    for i in [0, *_switches(modes)]:
        yield f'<rect x="{RIGHT}" y="{y - 8}" width="26" height="5" fill="{_colour(modes[i])}"/>'
        yield f'<circle cx="{RIGHT + 13}" cy="{y - 5.5}" r="6" fill="{_colour(modes[i])}" stroke="white"/>'
        yield f'<text x="{RIGHT + 36}" y="{y}" fill="{INK}">{modes[i]} from {world.moments[i].time:.1f} s</text>'
        y += LINE
    if any(m.opponent for m in world.moments):
        yield f'<path d="M{RIGHT} {y - 5}h26" stroke="{GREY}" stroke-width="1.5" stroke-dasharray="6 5"/>'
        yield f'<text x="{RIGHT + 36}" y="{y}" fill="{INK}">opponent</text>'


def _colour(mode: str) -> str:
    return COLOURS.get(mode, GREY)
