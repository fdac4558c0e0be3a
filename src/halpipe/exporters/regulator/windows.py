"""Windows that divide a schedule: which do, and which are nearest to the one that was asked for."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Location, about
from halpipe.core.durations import Duration, divisors, greatest_common_divisor, seconds
from halpipe.exporters.regulator.codes import DOES_NOT_FIT, WINDOW_DOES_NOT_DIVIDE
from halpipe.exporters.regulator.platform import LEAST_CYCLES, Platform

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.models import Schedule

MAX_WINDOWS = 2**20
"""Windows of one table; more say nothing more, and no regulator has the memory."""


def check_windows(schedule: Schedule, platform: Platform) -> list[Diagnostic]:
    """Return a finding for every hyperperiod and transition that is not a whole number of windows."""
    spans = [(about(mode=m.name), "hyperperiod", m.hyperperiod, m.at) for m in schedule.modes]
    spans += [(about(transition=t.name), "length", t.length, t.at) for t in schedule.transitions]
    window = platform.window
    found = []
    for path, what, span, at in spans:
        ratio = span / window
        stated = f"window of {platform.cycles_text} ({window})"
        if ratio.denominator != 1:
            message = f"{what} {span} is {_shown(ratio)} windows; the {stated} does not divide it"
            help = nearest_help(platform, [length for _, _, length, _ in spans])
            found.append(WINDOW_DOES_NOT_DIVIDE(message, at=at, path=path, help=help))
        elif ratio > MAX_WINDOWS:
            message = f"{what} {span} has {ratio} windows; at most {MAX_WINDOWS} can be exported"
            found.append(DOES_NOT_FIT(message, at=at, path=path, help=_longer_help(platform, spans)))
    return found


def cut(value: Fraction) -> str:
    """Return a number with two decimals, cut, for people."""
    hundredths = value.numerator * 100 // value.denominator
    return f"{hundredths // 100}.{hundredths % 100:02d}"


def _shown(value: Fraction) -> str:
    """Return a number with two decimals; one that would look whole, exactly."""
    whole, part = divmod(value.numerator, value.denominator)
    is_near = part * 100 < value.denominator
    return f"{whole} and {part}/{value.denominator}" if is_near else cut(value)


def _longer_help(platform: Platform, spans: Sequence[tuple[str, str, Duration, Location]]) -> str:
    """Name the shortest window that divides all spans and gives none of them too many windows."""
    lengths = [span for _, _, span, _ in spans if span]
    cycle = seconds(Fraction(1, platform.clock))
    for window in divisors(greatest_common_divisor(lengths), cycle):
        if max(lengths) / window <= MAX_WINDOWS and window / cycle >= LEAST_CYCLES:
            return f"use a window of at least {window / cycle} cycles"
    return "use another clock, period or transition length: no window divides them all and is long enough"


def nearest_help(platform: Platform, spans: Iterable[Duration]) -> str:
    """Say which windows near the platform's divide all `spans`."""
    lengths = [span for span in spans if span]
    near = nearest_windows(platform, lengths)
    if near:
        named = " or ".join(f"{cycles} cycles ({seconds(Fraction(cycles, platform.clock))})" for cycles in near)
        return f"the nearest windows that divide every hyperperiod and transition are {named}"
    common = greatest_common_divisor(lengths)
    parts = min(round(common / platform.window) or 1, int(common / platform.cycle) // platform.least_cycles)
    if not parts:
        return "no window that divides them carries a burst; choose another clock, period or transition length"
    exact = f'state "window: {common / parts}", which divides all of them'
    return f"{exact} and need not be whole cycles with the back-end table"


def nearest_windows(platform: Platform, spans: Iterable[Duration]) -> list[int]:
    """Return the nearest windows below and above the platform's, in cycles, that divide all `spans`.

    Of those that are whole bursts of the capacity if there are any, which lose nothing to rounding.
    """
    cycle = seconds(Fraction(1, platform.clock))
    counts = [int(window / cycle) for window in divisors(greatest_common_divisor(spans), cycle)]
    fitting = [n for n in counts if n >= platform.least_cycles]
    whole = [n for n in fitting if (platform.capacity * n) % (platform.burst * platform.clock) == 0]
    chosen = whole or fitting
    return [n for n in chosen if n < platform.cycles][-1:] + [n for n in chosen if n > platform.cycles][:1]
