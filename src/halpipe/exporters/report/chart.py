"""Geometry of a Gantt chart: lanes of units with bars, then lanes of resources with a step area; axis and numbers.

Horizontal places are per cent of the time shown, so a chart keeps its text size at every width and zoom. What has
a free shape (access phases, step areas) is a path over `GRID` columns that the page stretches. Numbers are exact, and
ticks of the axis are round steps that nest, so that zooming in only adds some.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.exporters.common.palette import RESOURCES, tone
from halpipe.exporters.common.timeline import PhaseTimes, resource_steps

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.common.timeline import Placement, Steps, Window
    from halpipe.exporters.report.beside import Strip
    from halpipe.models import TaskModel

GRID = 100_000
AXIS_HEIGHT = 26
METER_HEIGHT = 60
METER_GAP = 14
REGION_HEIGHT = 18
# Height of the second row of a lane, and the distance to the first.
STRIP_HEIGHT = 9
STRIP_GAP = 2
# A chart with more rows than this repeats its axis at the foot.
MANY_ROWS = 20
NAME_WIDTH = 190
# The chart is never drawn narrower than this many pixels; a label that fits a bar then always fits it.
BASE_WIDTH = 780
ZOOM_LEVELS = 5
CHARACTER = Fraction(66, 10)
# What differs is drawn over what does not.
MARKS = ("missing", "", "off", "extra", "delay", "over")
# From this many units on, lanes without any job are listed rather than drawn.
MANY_LANES = 24


@record
class Bar:
    """An occurrence of a job on a lane. `label` fits from zoom `level` on, `short` stands in for it before."""

    x: str
    width: str
    tone: int
    title: str
    label: str
    level: int
    short: str
    cut_left: bool
    cut_right: bool


@record
class Gap:
    """The thin line between two parts of a job."""

    x: str
    width: str
    tone: int


@record
class SeenBar:
    """A box in the second row of a lane; see `halpipe.exporters.report.beside.Seen`."""

    x: str
    width: str
    tone: int
    mark: str
    title: str


@record
class Lane:
    """A unit: its bars, the gaps between those of one job, and a path of access phases per resource, by position.

    `seen` is the second row: what ran, or the jobs of another schedule.
    """

    name: str
    caption: str
    load: str
    y: int
    bars: tuple[Bar, ...]
    phases: tuple[tuple[int, str], ...]
    gaps: tuple[Gap, ...] = ()
    seen: tuple[SeenBar, ...] = ()


@record
class Meter:
    """A resource: the sum of bounds as a path, the part above capacity 1 as another, and the capacity line."""

    name: str
    caption: str
    peak: str
    y: int
    tone: int
    area: str
    excess: str
    capacity: str


@record
class Region:
    """A stretch of the line with a caption: a mode or a transition table."""

    x: str
    width: str
    caption: str
    kind: str


@record
class Chart:
    """Everything the template needs to draw one chart."""

    name: str
    title: str
    description: str
    height: int
    top: int
    low_axis: bool
    bar_height: int
    lanes: tuple[Lane, ...]
    meters: tuple[Meter, ...]
    ticks: tuple[Tick, ...]
    regions: tuple[Region, ...]
    idle: tuple[str, ...]
    tones: tuple[tuple[int, str], ...]
    wraps: bool
    strip: str


@record(kw_only=True)
class Caption:
    """Caption of a chart; `fine` asks for the ticks that zooming shows."""

    name: str
    title: str
    description: str
    loads: dict[str, Fraction]
    regions: tuple[Region, ...] = ()
    fine: bool = True


def region(window: Window, start: Duration, end: Duration, caption: str, kind: str) -> Region:
    """Return the stretch [start, end) of the line, placed within `window`."""
    low, high = _place(start, window), _place(end, window)
    return Region(decimal(low, 4), decimal(high - low, 4), caption, kind)


def build_chart(
    model: TaskModel, placements: Sequence[Placement], window: Window, caption: Caption, strip: Strip | None = None
) -> Chart:
    """Return the chart of `placements` over `window`, with a second row in each lane for a `strip`."""
    shown = [placement for placement in placements if window.shows(placement)]
    tones = {task.name: tone(number) for number, task in enumerate(model.tasks)}
    used = {placement.job.task for placement in shown}
    by_unit = _by_unit(model, shown)
    seen = _seen(strip, window, tones) if strip else {}
    idle = {name for name, found in by_unit.items() if not (found or seen.get(name)) and len(by_unit) > MANY_LANES}
    drawn = [name for name in by_unit if name not in idle]
    lane_height, bar_height = _heights(len(drawn))
    lane_height += STRIP_HEIGHT + STRIP_GAP if strip else 0
    top = AXIS_HEIGHT + (REGION_HEIGHT if caption.regions else 0)
    lanes = _Lanes(model, window, tones, bar_height, caption.loads)
    meters = _meters(resource_steps(model, shown, window), window, top + lane_height * len(drawn) + METER_GAP)
    low_axis = len(drawn) > MANY_ROWS
    bottom = top + lane_height * len(drawn) + METER_GAP + len(meters) * (METER_HEIGHT + METER_GAP)
    return Chart(
        name=caption.name,
        title=caption.title,
        description=caption.description,
        height=bottom + (AXIS_HEIGHT // 2 if low_axis else 0),
        top=top,
        low_axis=low_axis,
        bar_height=bar_height,
        lanes=tuple(
            lanes.lane(name, by_unit[name], top + lane_height * row, tuple(seen.get(name, ())))
            for row, name in enumerate(drawn)
        ),
        meters=meters,
        ticks=tuple(ticks(window, fine=caption.fine)),
        regions=caption.regions,
        idle=tuple(name for name in by_unit if name in idle),
        tones=tuple((tones[task.name], task.name) for task in model.tasks if task.name in used),
        wraps=any(p.start < window.start or p.end > window.end for p in shown),
        strip=strip.caption if strip else "",
    )


def _seen(strip: Strip, window: Window, tones: dict[str, int]) -> dict[str, list[SeenBar]]:
    """Return the boxes of the second rows by unit; what is marked comes last, over the others."""
    found: dict[str, list[SeenBar]] = {}
    for box in sorted(strip.boxes, key=lambda box: MARKS.index(box.mark)):
        low, high = _place(box.start, window), _place(box.end, window)
        if window.meets(box.start, box.end):
            bar = SeenBar(decimal(low, 4), decimal(high - low, 4), tones[box.task], box.mark, box.title)
            for unit in box.units:
                found.setdefault(unit, []).append(bar)
    return found


def _by_unit(model: TaskModel, placements: Sequence[Placement]) -> dict[str, list[Placement]]:
    found: dict[str, list[Placement]] = {unit.name: [] for unit in model.units}
    for placement in placements:
        for unit in placement.job.units:
            found[unit].append(placement)
    return found


def _heights(lanes: int) -> tuple[int, int]:
    """Return the pitch of lanes and the height of bars: many lanes are drawn lower."""
    if lanes <= 16:
        return 28, 22
    return (22, 16) if lanes <= 48 else (16, 13)


class _Lanes:
    """Draws the lanes of one chart."""

    def __init__(
        self, model: TaskModel, window: Window, tones: dict[str, int], height: int, loads: dict[str, Fraction]
    ) -> None:
        self.window = window
        self.tones = tones
        self.height = height
        self.loads = loads
        self.times = PhaseTimes(model)
        self.resources = {resource.name: number for number, resource in enumerate(model.resources)}

    def lane(self, name: str, placements: Sequence[Placement], y: int, seen: tuple[SeenBar, ...]) -> Lane:
        """Return the lane of one unit."""
        load = percent(self.loads[name]) if name in self.loads else ""
        bars = tuple(
            self._bar(placement, start, end)
            for placement in placements
            for start, end in placement.stretches()
            if self.window.meets(start, end)
        )
        gaps = tuple(gap for placement in placements for gap in self._gaps(placement))
        return Lane(name, elide(name, 24 - len(load)), load, y, bars, self._phases(placements), gaps, seen)

    def _gaps(self, placement: Placement) -> Iterator[Gap]:
        for (_, end), (start, _) in pairwise(placement.stretches()):
            low, high = _place(end, self.window), _place(start, self.window)
            if low < high:
                yield Gap(decimal(low, 4), decimal(high - low, 4), self.tones[placement.job.task])

    def _bar(self, placement: Placement, start: Duration, end: Duration) -> Bar:
        job, window = placement.job, self.window
        low, high = _place(start, window), _place(end, window)
        cut_left, cut_right = start < window.start, end > window.end
        room = (high - low) * BASE_WIDTH / 100 - 8 - 8 * (cut_left + cut_right)
        label, level, short = _fit(job.task, room) if self.height > 14 else ("", 0, "")
        return Bar(
            x=decimal(low, 4),
            width=decimal(high - low, 4),
            tone=self.tones[job.task],
            title=_describe(placement, cut_left, cut_right),
            label=label,
            level=level,
            short=short,
            cut_left=cut_left,
            cut_right=cut_right,
        )

    def _phases(self, placements: Sequence[Placement]) -> tuple[tuple[int, str], ...]:
        paths: dict[int, list[str]] = {}
        stripe = 4 if self.height > 14 else 3
        for placement in placements:
            for access, begin, end in self.times.of(placement.job):
                low = _column(placement.start + begin, self.window)
                high = _column(placement.start + end, self.window)
                number = self.resources.get(access.resource)
                if number is not None and low < high:
                    y = self.height - stripe * (1 + number % 3)
                    part = f"M{low} {y}h{high - low}v{stripe}h{low - high}z"
                    paths.setdefault(number % len(RESOURCES), []).append(part)
        return tuple((number, "".join(parts)) for number, parts in sorted(paths.items()))


def _meters(steps: dict[str, Steps], window: Window, top: int) -> tuple[Meter, ...]:
    return tuple(
        _meter(name, found, window, number, top + number * (METER_HEIGHT + METER_GAP))
        for number, (name, found) in enumerate(steps.items())
    )


def _meter(name: str, steps: Steps, window: Window, number: int, y: int) -> Meter:
    peak = max(total for _, total in steps)
    scale = Fraction(METER_HEIGHT) / max(peak, Fraction(1)) * Fraction(9, 10)
    return Meter(
        name=name,
        caption=elide(name, 16),
        peak=percent(peak),
        y=y,
        tone=number % len(RESOURCES),
        area=_area([(at, min(total, Fraction(1)) * scale) for at, total in steps], window, Fraction(0)),
        excess=_area([(at, max(total, Fraction(1)) * scale) for at, total in steps], window, scale),
        capacity=decimal(METER_HEIGHT - scale, 2),
    )


def _area(steps: Steps, window: Window, base: Fraction) -> str:
    """Return the closed path between the height `base` and the steps; empty where no step rises above it."""
    if all(height <= base for _, height in steps):
        return ""
    floor = decimal(METER_HEIGHT - base, 2)
    parts = [f"M0 {floor}"]
    for at, height in steps:
        parts.append(f"H{_column(at, window)}V{decimal(METER_HEIGHT - height, 2)}")
    return "".join(parts) + f"H{GRID}V{floor}z"


def _place(at: Duration, window: Window) -> Fraction:
    """Return where an instant lies, in per cent, clipped to the chart."""
    clipped = min(max(at, window.start), window.end)
    return position((clipped - window.start).ns, window.length.ns)


def _column(at: Duration, window: Window) -> int:
    return round(_place(at, window) * GRID / 100)


def _describe(placement: Placement, cut_left: bool, cut_right: bool) -> str:
    job = placement.job
    lines = [
        f"{job.task} #{job.index}",
        f"{job.start} – {job.end} ({job.end - job.start})",
        f"version {job.version} on {', '.join(job.units)}",
    ]
    if job.parts:
        times = ", ".join(f"{start} – {end}" for start, end in job.occupations())
        lines.append(f"in {len(job.parts)} parts: {times}")
    if cut_left:
        lines.append("began in the cycle before")
    if cut_right:
        lines.append("continues in the next cycle")
    return "\n".join(lines)


def _fit(name: str, room: Fraction) -> tuple[str, int, str]:
    """Return the label, the zoom level from which it fits, and a shortened label for the levels before."""
    for level in range(ZOOM_LEVELS):
        if len(name) * CHARACTER <= room * 2**level:
            letters = int(room / CHARACTER)
            return name, level, elide(name, letters) if level and letters >= 4 else ""
    return "", 0, ""


# ------------------------------------------------------------------------------------------------ time axis and numbers

MAX_TICKS = 10
# Into how many parts a step of 1, 2 or 5 is divided to reach the next finer round step.
_FINER = {1: 5, 2: 4, 5: 5}
# How near (per cent of the width) to either end of the axis no inner label may stand.
_MARGIN = 7


@record
class Tick:
    """A mark at `x` per cent; shown from zoom `level` on; `anchor` is how its text hangs on the mark."""

    x: Fraction
    text: str
    level: int
    anchor: str = "middle"


def ticks(window: Window, *, fine: bool) -> list[Tick]:
    """Return the marks of the axis over `window`: round ones, with `fine` also those for zooming, and both ends."""
    unit = _unit(window.length)
    mantissa, step = _coarse_step(window.length)
    found: dict[int | Fraction, int] = {}
    _mark(found, window, step, 0)
    if fine:
        for level in (2, 4):
            parts = _FINER[mantissa]
            step, mantissa = step / parts, {1: 2, 2: 5, 5: 1}[mantissa]
            _mark(found, window, step, level)
    inner = [
        Tick(x, _text(Duration(at), unit), level)
        for at, level in sorted(found.items())
        if (x := position(at - window.start.ns, window.length.ns)) and _fits(x, level)
    ]
    first = Tick(Fraction(0), _text(window.start, unit), 0, "start")
    last = Tick(Fraction(100), _text(window.end, unit), 0, "end")
    return [first, *inner, last]


def _fits(x: Fraction, level: int) -> bool:
    margin = Fraction(_MARGIN, 2**level)
    return margin < x < 100 - margin


def _unit(length: Duration) -> str:
    return next((unit for unit in ("s", "ms", "us") if length.in_unit(unit) >= 2), "ns")


def _coarse_step(length: Duration) -> tuple[int, Fraction]:
    """Return the smallest step of 1, 2 or 5 times a power of ten ns that gives at most `MAX_TICKS`."""
    power = Fraction(1)
    while length.fraction / power < MAX_TICKS:
        power /= 10
    while True:
        for mantissa in (1, 2, 5):
            if length.fraction / (mantissa * power) <= MAX_TICKS:
                return mantissa, mantissa * power
        power *= 10


def _mark(found: dict[int | Fraction, int], window: Window, step: Fraction, level: int) -> None:
    number = -(-window.start.fraction // step)
    while number * step < window.end.fraction:
        found.setdefault(number * step, level)
        number += 1


def _text(at: Duration, unit: str) -> str:
    return format_rational(at.in_unit(unit)) + unit


def decimal(value: Fraction, digits: int) -> str:
    """Return `value` rounded to `digits` decimals, without trailing zeros."""
    scale = 10**digits
    return format_rational(Fraction(round(value * scale), scale))


def approximate(value: Fraction, digits: int = 4) -> str:
    """Return `value` exactly where `digits` decimals suffice, else rounded and marked ``≈``."""
    text = decimal(value, digits)
    return text if Fraction(text) == value else f"≈ {text}"


def percent(share: Fraction) -> str:
    """Return a share as per cent with one decimal."""
    return decimal(share * 100, 1) + "%"


def position(offset: int | Fraction, span: int | Fraction) -> Fraction:
    """Return the place of `offset` within `span` in per cent, on the grid that charts print (1e-4)."""
    return Fraction(round(Fraction(offset) * 10**6 / span), 10**4)


def elide(name: str, letters: int) -> str:
    """Return a name cut to so many letters."""
    return name if len(name) <= letters else name[: max(letters - 1, 1)] + "…"
