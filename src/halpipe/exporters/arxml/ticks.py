"""Instants in ticks of a counter: the tick is chosen or checked, nothing is rounded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, about
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor, seconds
from halpipe.core.records import record
from halpipe.exporters.arxml.codes import BAD_COUNTER, NOT_ON_TICK
from halpipe.exporters.arxml.document import seconds_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.exporters.arxml.holds import Holds
    from halpipe.exporters.arxml.options import ArxmlOptions
    from halpipe.models import Job, Schedule

_LONGEST = seconds(1)
_DEFAULT = Duration(10**6)
_SHOWN = 3
_TRIED = 1000


@record
class Counter:
    """The counter of every core: its tick, OsCounterMinCycle, OsCounterMaxAllowedValue."""

    tick: Duration
    min_cycle: int
    max_value: int

    def ticks(self, time: Duration) -> int:
        """Return a time that is a multiple of the tick, in ticks."""
        count = time / self.tick
        assert count.denominator == 1
        return count.numerator


def choose_counter(schedule: Schedule, options: ArxmlOptions, holds: Holds) -> Counter:
    """Return the counter for all instants of a schedule; raise `HalpipeError` with all that does not fit a given one.

    Without a given tick it is the largest of which all instants are multiples, and at most a second.
    """
    _check(options)
    found = list(_instants(schedule, holds))
    largest = greatest_common_divisor(time for _, _, time in found) or _DEFAULT
    if largest > _LONGEST:
        largest = greatest_common_divisor([largest, _LONGEST])
    if options.tick is not None:
        _check_tick(options.tick, largest, found)
    tick = largest if options.tick is None else options.tick
    return Counter(tick, options.min_cycle, options.max_value)


def _check(options: ArxmlOptions) -> None:
    findings = Findings()
    tick = options.tick
    if tick is not None and not ZERO < tick <= _LONGEST:
        help = "choose a tick above 0 and up to 1s, such as 1us"
        findings.add(BAD_COUNTER(f"a tick of {tick} is impossible", help=help))
    if options.max_value >= 2**64:
        help = "take the value of the counter of your target, 1073741823 for most"
        findings.add(BAD_COUNTER(f"the maximal value {options.max_value} needs more than 64 bits", help=help))
    if options.max_points is not None and options.max_points < 1:
        help = "take the limit of your target, or none"
        findings.add(BAD_COUNTER(f"{options.max_points} expiry points are no table", help=help))
    if not 1 <= options.min_cycle <= options.max_value:
        findings.add(
            BAD_COUNTER(
                f"the minimal cycle {options.min_cycle} is not from 1 to the maximal value {options.max_value}",
                help="take the values of the counter of your target, 1 and 1073741823 for most",
            )
        )
    findings.stop_on_errors()


def _instants(schedule: Schedule, holds: Holds) -> Iterator[tuple[str, str, Duration]]:
    """Yield (table, what, time) for everything that must be a whole number of ticks."""
    for mode in schedule.modes:
        path = about(mode=mode.name)
        yield path, "the hyperperiod", mode.hyperperiod
        yield from _starts(path, mode.jobs, holds)
    for table in schedule.transitions:
        path = about(transition_from=(table.source, table.target))
        yield path, "the length", table.length
        yield from _starts(path, table.jobs, holds)


def _starts(path: str, jobs: tuple[Job, ...], holds: Holds) -> Iterator[tuple[str, str, Duration]]:
    for job in jobs:
        yield path, f'the start of job {job.index} of task "{job.task}"', job.start
        for hold, until in holds.instants(job):
            yield path, f'where job {job.index} of task "{job.task}" resumes at {hold.position}', until


def _check_tick(tick: Duration, largest: Duration, found: list[tuple[str, str, Duration]]) -> None:
    off: dict[str, list[str]] = {}
    for path, what, time in found:
        if time % tick:
            below = tick * (time // tick)
            text = f"{what}, {time}, is between {below} and {below + tick}"
            off.setdefault(path, []).append(text)
    help = f"the nearest tick that fits is {_nearest(tick, largest)}; or schedule again with --tick {tick}"
    problems = [
        NOT_ON_TICK(f"{_shown(texts)}: no multiple of the tick {tick}", path=path, help=help)
        for path, texts in off.items()
    ]
    if problems:
        raise HalpipeError(*problems)


def _nearest(tick: Duration, largest: Duration) -> Duration:
    """Return the longest tick up to `tick` that divides `largest`, of those that are decimals if there are any."""
    least = math.ceil(largest / tick)
    near = (largest / parts for parts in range(least, min(2 * least, least + _TRIED)))
    found = next(filter(_is_decimal, near), None)
    if found is None and _is_decimal(largest):
        found = largest / (1 << (least - 1).bit_length())
    return found or largest / least


def _is_decimal(time: Duration) -> bool:
    return seconds_text(time)[1]


def _shown(texts: list[str]) -> str:
    more = f"; and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else ""
    return "; ".join(texts[:_SHOWN]) + more
