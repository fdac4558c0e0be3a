"""The graph of modes: nodes on an ellipse, an arrow for each allowed switch with the length of its table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.exporters.report.axis import elide
from halpipe.models import Schedule, Status, TaskModel, TransitionTable

if TYPE_CHECKING:
    Point = tuple[int, int]

MOST_MODES = 12
"""More modes than this make an illegible graph; the table of switches has them all."""

WIDTH, HEIGHT = 760, 330
NODE_WIDTH, NODE_HEIGHT = 144, 40
_CHARACTERS = 19
_ASIDE = 22

# Points of the unit circle in 1/1000, clockwise from the left, for each number of modes; no floating point, so that
# the same model has the same picture on every machine. Made from cos and sin, rounded.
_HALF = (0, 383, 707, 924, 1000, 924, 707, 383)
_SINES = (*_HALF, *(-sine for sine in _HALF))


def build_mode_graph(model: TaskModel, schedule: Schedule) -> dict[str, Any] | None:
    """Return the graph of the modes that `schedule` has; None where there is nothing to see, or too much.

    Nodes are placed by the middles of their boxes. The kind of an arrow is ``ok``, ``missing`` or ``bad``.
    """
    names = [mode.name for mode in schedule.modes]
    if not 2 <= len(names) <= MOST_MODES:
        return None
    at = dict(zip(names, _places(len(names)), strict=True))
    nodes = [
        {"id": f"mode-{number}", "title": mode.name, "caption": elide(mode.name, _CHARACTERS)}
        | {"x": at[mode.name][0], "y": at[mode.name][1], "valid": mode.status is Status.VALID}
        for number, mode in enumerate(schedule.modes, 1)
    ]
    tables = {(table.source, table.target): table for table in schedule.transitions}
    allowed = [(pair.source, pair.target) for pair in model.allowed_transitions()]
    pairs = [pair for pair in dict.fromkeys([*allowed, *tables]) if set(pair) <= set(names)]
    arrows = [_bent(at[a], at[b]) | _label(a, b, tables.get((a, b))) for a, b in pairs]
    kinds = {arrow["kind"] for arrow in arrows}
    meanings = (
        ("ok", "switch with the length of its table; 0 means that the modes fit end to end"),
        ("missing", "allowed, but this schedule has no table for it"),
        ("bad", "no valid table was found"),
    )
    legend = [entry for entry in meanings if entry[0] in kinds]
    return {"nodes": nodes, "arrows": arrows, "height": HEIGHT if len(names) > 2 else 150, "legend": legend}


def _places(count: int) -> list[Point]:
    """Return the middles of the nodes, in the order of the modes, clockwise from the left."""
    if count == 2:
        return [(NODE_WIDTH, 75), (WIDTH - NODE_WIDTH, 75)]
    reach_x, reach_y = WIDTH // 2 - NODE_WIDTH // 2 - 5, HEIGHT // 2 - NODE_HEIGHT
    places = []
    for number in range(count):
        sixteenth, rest = divmod(16 * number, count)
        across, down = (_between(sixteenth + shift, rest, count) for shift in (4, 0))
        places.append((WIDTH // 2 - reach_x * across // 1000, HEIGHT // 2 - reach_y * down // 1000))
    return places


def _between(sixteenth: int, rest: int, count: int) -> int:
    """Return the sine of `sixteenth` + `rest` / `count` sixteenths of a turn, in thousandths, between the two known."""
    low, high = _SINES[sixteenth % 16], _SINES[(sixteenth + 1) % 16]
    return low + (high - low) * rest // count


def _bent(start: Point, end: Point) -> dict[str, Any]:
    """Return the curve from one node to another, bent to its left, so that the way back does not lie on it."""
    (ax, ay), (bx, by) = _edge(start, end, 1), _edge(end, start, -1)
    middle_x, middle_y = (ax + bx) // 2 + (by - ay) // 7, (ay + by) // 2 - (bx - ax) // 7
    label_x, label_y = (ax + bx + 2 * middle_x) // 4, (ay + by + 2 * middle_y) // 4 + 4
    if abs(by - ay) > abs(bx - ax):  # beside a steep arrow, clear of the label of the way back
        label_x += _ASIDE if by > ay else -_ASIDE
    return {"path": f"M{ax} {ay}Q{middle_x} {middle_y} {bx} {by}", "x": label_x, "y": label_y}


def _label(source: str, target: str, table: TransitionTable | None) -> dict[str, Any]:
    if table is None:
        return {"label": "no table", "title": f"{source} to {target}: allowed, but without a table", "kind": "missing"}
    title = f"{source} to {target}: table of {table.length}, at worst {table.worst_latency} from the request"
    kind = "ok" if table.status is Status.VALID else "bad"
    return {"label": str(table.length) if table.length else "0", "title": title, "kind": kind}


def _edge(start: Point, end: Point, side: int) -> Point:
    """Return where the line from one node to another leaves its box, turned to one side by the bend of the curve."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    dx, dy = dx + side * dy // 4, dy - side * dx // 4
    half_width, half_height = NODE_WIDTH // 2 + 3, NODE_HEIGHT // 2 + 3
    if abs(dx) * half_height > abs(dy) * half_width:
        return start[0] + (half_width if dx > 0 else -half_width), start[1] + dy * half_width // abs(dx)
    return start[0] + dx * half_height // abs(dy), start[1] + (half_height if dy > 0 else -half_height)
