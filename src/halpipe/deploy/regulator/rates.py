"""Promised rates of back-ends with one rate per unit, and their comparison with the rates of the device."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.deploy.regulator.codes import DEVICE_OVER_CAPACITY, GRANTS_DIFFER
from halpipe.deploy.regulator.promise import ZERO, Phase, Row, rate_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from fractions import Fraction

    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.loading import Case
    from halpipe.deploy.regulator.reading import Table


def peaks(case: Case, plan: Planned) -> dict[Row, Fraction]:
    """Return the highest rate promised to every row in a table, in bytes per second; only rows that have any."""
    highest = {row: _highest(case, plan, phases) for row, phases in plan.timeline.by_row().items()}
    return {row: rate for row, rate in highest.items() if rate}


def unit_peaks(case: Case, plan: Planned) -> dict[str, Fraction]:
    """Return for every unit its highest rates of reads and of writes together, in bytes per second."""
    phases = plan.timeline.phases
    return {u.name: _highest(case, plan, [p for p in phases if p.row[0] == u.name]) for u in case.tables.units}


def _highest(case: Case, plan: Planned, phases: Sequence[Phase]) -> Fraction:
    return max((rate for _, rate in rate_steps(plan.timeline, phases)), default=ZERO) * case.platform.guaranteed


def limit(case: Case) -> Fraction:
    """Return what all may have together, in bytes per second: the capacity less what passes above budgets."""
    reserve = sum(unit.overshoot[d] for unit in case.tables.units for d in ("read", "write"))
    return case.platform.capacity - reserve * 10**9 / case.platform.window_ns


def compare(
    case: Case,
    name: str,
    table: Table,
    have: Mapping[str, int],
    promised: Mapping[str, Fraction],
    least: Callable[[Fraction], int],
    given: Callable[[int], Fraction],
) -> None:
    """Note every owner whose setting is not the least that gives what was promised, and sums above the capacity."""
    for owner, rate in promised.items():
        want = least(rate)
        if have.get(owner) != want:
            setting = have.get(owner)
            is_given = "nothing is set" if setting is None else f"{text(given(setting))} are granted"
            message = f"{owner}: {is_given}, promised are {text(rate)}, for which {text(given(want))} are the least"
            case.note(GRANTS_DIFFER, name, message, path=about(table=table.name))
    for owner in sorted(have.keys() - promised.keys()):
        case.note(GRANTS_DIFFER, name, f"{owner} belongs to no unit of the platform", path=about(table=table.name))
    hold(case, name, table, {owner: given(setting) for owner, setting in have.items()}, "")


def hold(case: Case, name: str, table: Table, granted: Mapping[str, Fraction], when: str) -> bool:
    """Note a sum above the capacity, and return whether it is; `when` is the instant, empty for the whole table."""
    total = sum(granted.values(), ZERO)
    if total > limit(case):
        message = f"{text(total)} are granted together{when}, there is room for {text(limit(case))}"
        case.note(DEVICE_OVER_CAPACITY, name, message, path=about(table=table.name))
    return total > limit(case)


def rise(
    case: Case,
    name: str,
    table: Table,
    before: Mapping[str, int],
    changes: Iterable[tuple[str, Mapping[str, int]]],
    rate: Callable[[int], Fraction],
) -> None:
    """Note the first of the changes (instant and settings) after which all settings together exceed the capacity."""
    state = dict(before)
    for when, settings in changes:
        state |= settings
        if hold(case, name, table, {owner: rate(setting) for owner, setting in state.items()}, when):
            return


def fall_first(
    case: Case, name: str, table: Table, writes: Sequence[tuple[str, int]], before: Sequence[Mapping[str, int]]
) -> None:
    """Note a value on the way that is not what `before` and the table's own value have in common.

    A setting is reached in at most two steps: down to the least of all that may be in force, then to its value.
    """
    final = dict(writes)
    left = Counter(owner for owner, _ in writes)
    for owner, value in writes:
        left[owner] -= 1
        common = min([final[owner], *(setting[owner] for setting in before if owner in setting)])
        if left[owner] and value != common:
            message = f"{owner} is {value} on its way to {final[owner]}; {common} is what all settings before have"
            case.note(GRANTS_DIFFER, name, message, path=about(table=table.name))


def text(rate: Fraction) -> str:
    """Return a rate for people."""
    return f"{rate.numerator // rate.denominator} B/s"
