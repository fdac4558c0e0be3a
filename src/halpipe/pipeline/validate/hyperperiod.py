"""Checks that a mode stays within reach: its number of jobs, and its length in ticks (MODEL 1)."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor, least_common_multiple, milliseconds, seconds
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context, check, place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Unit, Version

MAX_JOBS = 10_000_000
MAX_TICKS = 2**62

MAX_DEMANDS = 10_000
"""Jobs of a task on demand where demands multiply them: a few lines of a model may ask for millions."""

MULTIPLIED = 16
"""Demands multiply the jobs of a task where it has more than so many for each job of a task with a period."""

_MAX_COMPARED = 100
"""The most used periods, against which every period is compared to see how well it fits."""

_MAX_COMPARISONS = 200_000
"""Of more than two thousand periods, each is compared with fewer than that."""

_MAX_MISFIT = 100
"""How many times longer than both a hyperperiod may become by a period that still fits it well."""

_MAX_SNAPPED = 50
"""Guilty periods up to which a choice is looked for that cures all of them."""

_MUCH_WORSE = 12
"""By how much a second proposal may be more awkward than the first."""

_NAMED = 5


# ------------------------------------------------------------------------------------------------ jobs


@check("hyperperiod-jobs", codes.TOO_MANY_JOBS, codes.MANY_PARTS)
def check_jobs(context: Context) -> Iterator[Diagnostic]:
    """Every mode has at most 10 000 000 jobs in its hyperperiod; it is pointed out where their parts can be more."""
    for mode in context.active:
        hyperperiod = mode.hyperperiod
        if not any(active.is_periodic for active in mode.tasks.values()):
            continue
        counts = mode.most_jobs
        jobs = None if hyperperiod is None else sum(counts.values())
        if jobs is not None and jobs <= MAX_JOBS:
            yield from _many_demands(mode, counts)
            yield from _many_parts(mode, counts)
            continue
        size = "is beyond all measure" if hyperperiod is None else f"of {hyperperiod} has {jobs} jobs"
        cause = _find_cause(mode)
        text = f"the hyperperiod {size}, {MAX_JOBS} are allowed; "
        text += f"the cause: {cause.describe()}" if cause.guilty and cause.base else "demands multiply its jobs"
        yield codes.TOO_MANY_JOBS(text, at=place(mode.mode), path=mode.path, help=cause.cure())


def _many_demands(mode: ActiveMode, counts: dict[str, int]) -> Iterator[Diagnostic]:
    """Refuse demands that multiply from task to task: the model is small, the table is not."""
    causes = sum(counts[name] for name, active in mode.tasks.items() if active.is_periodic)
    most = max(counts, key=lambda name: (counts[name], name))
    if counts[most] > max(MAX_DEMANDS, MULTIPLIED * causes):
        text = f'demands multiply: task "{most}" has {counts[most]} jobs for {causes} jobs of tasks with a period, '
        text += f"{MAX_DEMANDS} are allowed"
        help = "let fewer constraints name the same task: named twice by a task that is named twice, it runs four times"
        yield codes.TOO_MANY_JOBS(text, at=place(mode.mode), path=mode.path, help=help)


def _many_parts(mode: ActiveMode, counts: dict[str, int]) -> Iterator[Diagnostic]:
    """Warn where the parts that the splits allow are more than the limit."""
    most = {name: counts[name] * max(map(_most_parts, active.versions)) for name, active in mode.tasks.items()}
    if sum(most.values()) > MAX_JOBS:
        names = sorted(most, key=lambda name: (-most[name], name))[:3]
        text = (
            f"its jobs may have up to {sum(most.values())} parts in a hyperperiod, {MAX_JOBS} are allowed; the most: "
        )
        text += ", ".join(f'"{name}" {most[name]}' for name in names)
        help = "lower max-gaps, or give fewer split points"
        yield codes.MANY_PARTS(text, at=place(mode.mode), path=mode.path, help=help)


def _most_parts(version: Version) -> int:
    """Return how many parts a job of the version can have."""
    split = version.split
    if not split.is_allowed:
        return 1
    gaps = [] if split.anywhere else [len(split.points)]
    gaps += [] if split.max_gaps is None else [split.max_gaps]
    if split.anywhere and split.min_part and version.wcet:
        gaps.append(version.wcet // split.min_part - 1)
    return 1 + max(0, min(gaps, default=0))


@record
class _Cause:
    """Cause of a long hyperperiod: the `guilty` periods do not fit `base`, the hyperperiod of all others.

    `jobs` is the number of jobs without the guilty ones; `weights` that of all jobs that one job of each period
    causes, with those on demand, summed over its tasks. `most` is how long the period of tasks that poll for arrivals
    may become.
    """

    guilty: tuple[Duration, ...]
    base: Duration
    jobs: int
    weights: dict[Duration, int]
    tasks: dict[Duration, list[str]]
    most: dict[Duration, Duration]

    def describe(self) -> str:
        """Name the guilty periods with their tasks, and what the others make."""
        named = few((f"{p} (task {few(self.tasks[p], 2)})" for p in self.guilty), _NAMED, quote="")
        text = ("the period " if len(self.guilty) == 1 else "the periods ") + named
        return f"{text}; without {'it' if len(self.guilty) == 1 else 'them'} the hyperperiod is {self.base}"

    def cure(self) -> str:
        """Propose periods for every guilty one, if they bring the mode within the limit."""
        choices: list[str] = []
        base, jobs = self.base, self.jobs
        for period in self.guilty[:_MAX_SNAPPED] if base else ():
            weight = self.weights[period]
            proposed = periods_instead(period, base, self.most.get(period))
            allowed = [near for near in proposed if _extended(base, jobs, near, weight)[1] <= MAX_JOBS]
            if not allowed:
                break
            named = (f"{near} (hyperperiod {_extended(base, jobs, near, weight)[0]})" for near in allowed[:2])
            choices.append(f"{' or '.join(named)} instead of {period}")
            base, jobs = _extended(base, jobs, allowed[0], weight)
        if not choices or len(choices) < len(self.guilty):
            shortest, longest = min(self.weights), max(self.weights)
            return (
                f"make the periods multiples of each other and bring the shortest ({shortest}) and the longest "
                f"({longest}) closer together, or split the mode"
            )
        return f"use {few(choices, _NAMED, quote='')}; the mode then has {jobs} jobs"


def _find_cause(mode: ActiveMode) -> _Cause:
    """Keep the periods that fit each other, those that fit most tasks first, up to the limit; the rest is guilty."""
    caused = _jobs_caused(mode)
    weights: dict[Duration, int] = {}
    tasks: dict[Duration, list[str]] = {}
    for name, active in mode.tasks.items():
        if active.task.period is not None and active.is_periodic:
            weights[active.task.period] = weights.get(active.task.period, 0) + caused[name]
            tasks.setdefault(active.task.period, []).append(name)
    guilty: list[Duration] = []
    base, jobs = ZERO, 0
    for period in _by_fit({period: len(names) for period, names in tasks.items()}):
        longer, more = _extended(base, jobs, period, weights[period])
        fits = not base or longer // max(base, period) <= _MAX_MISFIT
        if fits and more <= MAX_JOBS:
            base, jobs = longer, more
        else:
            guilty.append(period)
    return _Cause(tuple(sorted(guilty)), base, jobs, weights, tasks, _longest_polls(mode))


def _longest_polls(mode: ActiveMode) -> dict[Duration, Duration]:
    """Return, for every period with which tasks poll for arrivals, the least distance of those."""
    tasks = [active.task for active in mode.tasks.values()]
    polls = grouped((t.period, t.distance) for t in tasks if t.period is not None and t.distance is not None)
    return {period: min(distances) for period, distances in polls.items()}


def _extended(base: Duration, jobs: int, period: Duration, weight: int) -> tuple[Duration, int]:
    """Return hyperperiod and number of jobs once tasks of `period` are added."""
    longer = least_common_multiple((base, period)) if base else period
    return longer, jobs * (longer // (base or longer)) + weight * (longer // period)


def _jobs_caused(mode: ActiveMode) -> dict[str, int]:
    """Return, for every task, how many jobs one of its jobs makes at most: itself and, transitively, those demanded."""
    caused: dict[str, int] = {}
    for name in mode.order or mode.tasks:
        demanded = (
            most * caused.get(other, 1)
            for other, (_, most) in mode.named[name].items()
            if mode.tasks[other].task.period is None
        )
        caused[name] = 1 + sum(demanded)
    return caused


def _by_fit(counts: dict[Duration, int]) -> list[Duration]:
    """Order periods by the number of tasks whose periods are multiples or divisors of theirs, most first.

    Of equals, the one that is shorter to write is the rounder, and comes first.
    """
    compared = min(_MAX_COMPARED, _MAX_COMPARISONS // len(counts))
    popular = sorted(counts, key=lambda period: (-counts[period], period))[:compared]
    fit = {
        period: sum(counts[other] for other in popular if not (period % other and other % period)) for period in counts
    }
    return sorted(counts, key=lambda period: (-fit[period], -counts[period], len(str(period)), period))


# ------------------------------------------------------------------------------------------------ other periods


def periods_instead(period: Duration, base: Duration, most: Duration | None = None) -> list[Duration]:
    """Return periods near to one that does not fit `base`, a hyperperiod, the best first; none is longer than `most`.

    Such as a person would write: of one or two digits, also in thirds (100/3ms), or what fits `base`.
    Those are best that are near, make the hyperperiod little longer, and are short to write. Behind the
    best come those only that are not much worse and make no longer hyperperiod than it does.
    """
    found = {*_round_periods(period), nearest_harmonic(period, base)}
    if most is not None:
        found |= {base / -(-base // most) if most < base else base * (most // base)}
    near = [choice for choice in found - {period} if choice and (most is None or choice <= most)]
    longer = {choice: least_common_multiple((base, choice)) for choice in near}
    cost = {choice: _awkwardness(choice, period, longer[choice] // base) for choice in near}
    near.sort(key=lambda choice: (cost[choice], choice))
    worst = cost[near[0]] + _MUCH_WORSE if near else 0
    return [choice for choice in near if longer[choice] <= longer[near[0]] and cost[choice] <= worst]


def _round_periods(period: Duration) -> Iterator[Duration]:
    """Yield times of one or two digits from two thirds to four thirds of a period, and thirds that it may stand for."""
    for thirds, spread in ((1, Fraction(1, 3)), (3, Fraction(1, 100))):
        unit = Duration(1)
        while unit * 100 <= period * thirds:
            unit = unit * 10
        while unit * 10 > period * thirds:
            unit = unit / 10
        low, high = period * (thirds * (1 - spread)), period * (thirds * (1 + spread))
        yield from (unit * count / thirds for count in range(-(-low // unit), high // unit + 1))


def _awkwardness(choice: Duration, period: Duration, times: int) -> Fraction:
    """Return how far a choice is from what is wanted: two percent count as a doubled hyperperiod, eight as a digit."""
    distance = abs(Fraction(choice.ns) - Fraction(period.ns)) / Fraction(period.ns)
    return 50 * distance + times.bit_length() + 4 * _digits(choice)


def _digits(time: Duration) -> int:
    """Return how hard a time is to write: its digits without zeros at the end; thirds count 1 more, others yet more."""
    value = Fraction(time.ns)
    while value.denominator % 2 == 0 or value.denominator % 5 == 0:
        value *= 10
    number, divisor = value.as_integer_ratio()
    fraction = {1: 0, 3: 1}.get(divisor, 3 + 2 * len(str(divisor)))
    return len(str(number).rstrip("0")) + fraction


def nearest_harmonic(period: Duration, base: Duration) -> Duration:
    """Return the divisor or multiple of `base` nearest to `period`, the shorter of two equally near."""
    if period >= base:
        below = base * (period // base)
        return min((below, below + base), key=lambda choice: (abs(period.ns - choice.ns), choice))
    parts = base // period
    return min((base / parts, base / (parts + 1)), key=lambda choice: (abs(period.ns - choice.ns), choice))


# ------------------------------------------------------------------------------------------------ ticks


@check("hyperperiod-ticks", codes.TOO_MANY_TICKS)
def check_ticks(context: Context) -> Iterator[Diagnostic]:
    """The hyperperiod of every mode is shorter than 2^62 of the largest tick that divides all its durations."""
    for mode in context.active:
        hyperperiod = mode.hyperperiod
        if hyperperiod is None:
            continue
        interrupts = [d for unit in context.units.values() for d, _ in _of_interrupts(unit)]
        times = {d.ns for active in mode.tasks.values() for d, _ in _durations(active)}
        tick = _tick(times | {d.ns for d in interrupts}, hyperperiod)
        if hyperperiod // tick < MAX_TICKS:
            continue
        finest: dict[Duration, str] = {}
        for unit in context.units.values():
            finest |= {d: f'the {what} {d} of unit "{unit.name}"' for d, what in _of_interrupts(unit)}
        for active in mode.tasks.values():
            for duration, what in _durations(active):
                if duration not in finest:
                    finest[duration] = f'the {what} {duration} of task "{active.task.name}"'
        guilty = sorted(finest, key=lambda d: (greatest_common_divisor((d, seconds(1))), finest[d]))[:3]
        text = f"the hyperperiod of {hyperperiod} has 2^62 ticks or more, because every duration of the mode must be "
        text += f"a whole number of ticks; the finest: {', '.join(finest[d] for d in guilty)}"
        help = f"round it to whole {_coarser(hyperperiod)}: WCETs and access phases outward, windows inward"
        yield codes.TOO_MANY_TICKS(text, at=place(mode.mode), path=mode.path, help=help)


def _durations(active: ActiveTask) -> Iterator[tuple[Duration, str]]:
    """Yield what the tick of a mode must divide; deadlines and limits are compared with, never added up."""
    task = active.task
    if task.period:
        yield task.period, "period"
    if task.offset:
        yield task.offset, "offset"
    for version in active.versions:
        if version.wcet:
            yield version.wcet, "WCET"
        for point in version.split.points:
            yield point, "split point"
        if version.split.resume:
            yield version.split.resume, "resume"
        if version.split.min_part:
            yield version.split.min_part, "min-part"
        for access in version.accesses:
            yield access.start, "access start"
            yield access.end, "access end"
        for constraint in version.precedences:
            yield constraint.min, "window minimum"
            yield constraint.max, "window maximum"


def _of_interrupts(unit: Unit) -> Iterator[tuple[Duration, str]]:
    for interrupt in unit.interrupts:
        if interrupt.distance:
            yield interrupt.distance, f'distance of interrupt "{interrupt.name}"'
        if interrupt.wcet:
            yield interrupt.wcet, f'wcet of interrupt "{interrupt.name}"'


def _tick(values: set[int | Fraction], hyperperiod: Duration) -> Duration:
    """Return the largest duration that divides all values, or some divisor that is already too small."""
    whole = math.gcd(*(value for value in values if isinstance(value, int)))
    tick = greatest_common_divisor((hyperperiod, Duration(whole)))
    for value in values:
        if not isinstance(value, int) and hyperperiod // tick < MAX_TICKS:
            tick = greatest_common_divisor((tick, Duration(value)))
    return tick


def _coarser(hyperperiod: Duration) -> Duration:
    """Return the smallest power of ten in milliseconds that makes few enough ticks."""
    unit = milliseconds(1)
    while hyperperiod // (unit / 10) < MAX_TICKS // 1000:
        unit = unit / 10
    return unit
