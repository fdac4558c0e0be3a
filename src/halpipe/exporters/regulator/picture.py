"""Pictures of bandwidth over time: the bounds of the units, stacked, table by table, under the line of the capacity."""

from __future__ import annotations

import math
from bisect import bisect_right
from importlib import resources
from itertools import accumulate, groupby, pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_bandwidth, format_rational
from halpipe.core.records import record
from halpipe.exporters.common.palette import FILLS, INK
from halpipe.exporters.common.templates import environment
from halpipe.exporters.common.timeline import Window
from halpipe.exporters.regulator.frames import Frame, Framer, Grid, Row, grid_of
from halpipe.exporters.regulator.platform import DIRECTIONS, READ
from halpipe.exporters.regulator.rates import segments
from halpipe.exporters.report.axis import Tick, ticks

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.models import Schedule, TaskModel

COLUMNS = 900
"""Steps that one panel shows; of more, each column shows the mean."""

WIDTH, HEIGHT = 900, 120
_TONES = 8  # the first of the fills, and the same darkened from 16 on


@record
class Steps:
    """A step function in ticks: `values[i]` holds from `instants[i]` on, the first of which is 0."""

    instants: Sequence[int]
    values: Sequence[int]

    def areas(self, edges: Iterable[int]) -> list[int]:
        """Return the area under it from 0 to each of `edges`."""
        lengths = (b - a for a, b in pairwise(self.instants))
        before = [0, *accumulate(v * n for v, n in zip(self.values, lengths, strict=False))]
        found = []
        for edge in edges:
            i = bisect_right(self.instants, edge) - 1
            found.append(before[i] + self.values[i] * (edge - self.instants[i]))
        return found


@record
class Panel:
    """One table: `full` is the value at the capacity line."""

    title: str
    span: int
    length: Duration
    full: int
    rows: dict[Row, Steps]


@record
class Drawing:
    """A panel as the template needs it: `y` is its top; an area has a name, a fill and a closed path."""

    title: str
    note: str
    y: int
    areas: tuple[tuple[str, str, str], ...]
    marks: tuple[Tick, ...]


def draw_bounds(model: TaskModel, schedule: Schedule) -> dict[str, str]:
    """Return for every resource with a bandwidth the bounds of a schedule as SVG; none where nothing uses it.

    Reports may embed the pictures as they are. `schedule` must fit `model`, see `selection.select`.
    """
    pictures = {}
    grid = grid_of(model, schedule, ZERO)
    for resource in model.resources:
        if resource.bandwidth is None:
            continue
        frames = Framer(model, schedule, resource.name, grid, READ).frames()
        panels = [_bounds(frame, grid) for frame in frames]
        if any(panel.rows for panel in panels):
            title = f"{resource.name}: bounds, capacity {format_bandwidth(resource.bandwidth)}"
            pictures[resource.name] = _svg(panels, [unit.name for unit in model.units], title)
    return pictures


def _bounds(frame: Frame, grid: Grid) -> Panel:
    found = segments(frame)
    full = math.lcm(*(bound.denominator for segment in found for bound in segment.bounds.values()))
    used = sorted({row for segment in found for row in segment.bounds})
    instants = [segment.begin for segment in found]
    rows = {row: Steps(instants, [int(s.bounds.get(row, 0) * full) for s in found]) for row in used}
    return Panel(f"{frame.kind} {frame.name}", frame.span, Duration(grid.ns(frame.span)), full, rows)


# ------------------------------------------------------------------------------------------------ drawing


def _svg(panels: Sequence[Panel], units: Sequence[str], title: str) -> str:
    used = {row for panel in panels for row in panel.rows}
    colours = {
        row: FILLS[units.index(row.unit) % _TONES + 2 * _TONES * (row.direction != READ)] for row in sorted(used)
    }
    order = [Row(unit, d) for unit in units for d in DIRECTIONS if Row(unit, d) in used]
    top = 62 + 18 * (-(-len(order) // 4))
    pitch = HEIGHT + 70
    templates = environment(resources.files(__package__), autoescape=True)
    templates.filters["decimal"] = format_rational
    return templates.get_template("bandwidth.svg.j2").render(
        title=title,
        legend=[(i % 4, i // 4, f"{row.unit} {row.direction}", colours[row]) for i, row in enumerate(order)],
        panels=[_draw(panel, order, colours, top + pitch * i) for i, panel in enumerate(panels)],
        width=WIDTH,
        height=HEIGHT,
        total=top + pitch * len(panels),
        ink=INK,
    )


def _draw(panel: Panel, order: Sequence[Row], colours: dict[Row, str], y: int) -> Drawing:
    rows = [row for row in order if row in panel.rows]
    changes = sorted({0, panel.span, *(at for row in rows for at in panel.rows[row].instants)})
    is_thinned = len(changes) - 1 > COLUMNS
    edges = [panel.span * i // COLUMNS for i in range(COLUMNS + 1)] if is_thinned else changes
    xs = [edge * WIDTH * 100 // panel.span for edge in edges]
    levels = [0] * (len(edges) - 1)  # areas below, column by column
    areas = []
    for row in rows:
        below = levels
        totals = panel.rows[row].areas(edges)
        levels = [a + later - earlier for a, (earlier, later) in zip(below, pairwise(totals), strict=True)]
        if levels != below:
            path = _path(xs, _heights(edges, below, panel.full), _heights(edges, levels, panel.full))
            areas.append((f"{row.unit} {row.direction}", colours[row], path))
    note = f"each step is the mean of 1/{COLUMNS} of the time" if is_thinned else ""
    marks = tuple(ticks(Window(ZERO, panel.length)))
    return Drawing(panel.title, note, y, tuple(areas), marks)


def _heights(edges: Sequence[int], areas: Sequence[int], full: int) -> list[int]:
    """Return heights in hundredths of a unit of the picture."""
    steps = zip(areas, pairwise(edges), strict=True)
    return [area * HEIGHT * 100 // (full * (end - begin)) for area, (begin, end) in steps]


def _path(xs: Sequence[int], low: Sequence[int], high: Sequence[int]) -> str:
    """Return the area between two step functions, leaving out the columns in which it is empty."""
    parts = []
    for is_filled, run in groupby(range(len(low)), key=lambda k: low[k] != high[k]):
        columns = list(run) if is_filled else []
        upper, lower = ([(x, side[k]) for k in columns for x in xs[k : k + 2]] for side in (high, low))
        points = [point for point, _ in groupby([*upper, *reversed(lower)])]
        parts += ["M" + "L".join(f"{_number(x)} {_number(HEIGHT * 100 - y)}" for x, y in points) + "Z"] * is_filled
    return "".join(parts)


def _number(hundredths: int) -> str:
    whole, rest = divmod(hundredths, 100)
    return f"{whole}.{rest:02d}".rstrip("0").rstrip(".") if rest else str(whole)
