"""Figures and reactions that a schedule reports: each must follow from its jobs and from the rules of the model."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Diagnostic, Path, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.models import CostTerms, HealthAction, HealthRule, ModeSchedule, Reaction, Schedule, Status, TaskModel
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.chains import measured
from halpipe.pipeline.verify.sharing import Shared, excesses, resource_claims, unit_claims, wrap
from halpipe.pipeline.verify.tables import Clock, ModeTable, Rule, common_denominator

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.pipeline.verify.ticks import Found


def check_figures(table: ModeTable) -> Iterator[Diagnostic]:
    """Recompute every figure reported; figures that are not reported are not missed (D)."""
    if table.schedule.cost is not None:
        yield from _cost(table, table.schedule.cost)
    if table.schedule.margin is not None:
        yield from _margin(table, table.schedule.margin, table.schedule.margin_bound)
    yield from _unit_loads(table)
    yield from _resource_loads(table)
    yield from _chain_latencies(table)


def _inside(table: Path, element: str) -> Path:
    return Path(f"{table} {element}", (*table.subjects, *(element.subjects if isinstance(element, Path) else ())))


def _wrong(table: ModeTable, element: str, text: str) -> Diagnostic:
    help = "have the report made again from the jobs"
    return codes.WRONG_FIGURE(text, at=table.at, path=_inside(table.path(), element), help=help)


_PENALTIES: Mapping[str, frozenset[str]] = {
    "overlap": frozenset({"exclusive"}),
    "access": frozenset({"access"}),
    "unit": frozenset({"unit"}),
}


def _cost(table: ModeTable, cost: CostTerms) -> Iterator[Diagnostic]:
    """Check F <= 0 iff valid, that a penalty is zero iff its rule holds, and the shares (MODEL 4).

    (D) The weights are the solver's own, so the sum itself is not checked. The precedence penalty also covers chains,
    and may cover demands, releases, deadlines, parts, nesting and binding.
    """
    broken = ", ".join(sorted(table.broken))
    if cost.total <= 0 and broken:
        yield _wrong(table, "cost", f"the total {_number(cost.total)} claims a valid schedule, but it breaks: {broken}")
    if cost.total > 0 and not broken and table.sound:
        yield _wrong(
            table, "cost", f"the total {_number(cost.total)} claims an invalid schedule, but no rule is broken"
        )
    for name, rules in _PENALTIES.items():
        yield from _penalty(table, name, getattr(cost, name), rules, rules | {"parts"})
    timing = frozenset({"precedence", "chain"})
    others = {"complete", "periodic", "deadline", "parts", "nested", "binding", "edge"}
    if any(version.split.is_allowed for active in table.mode.tasks.values() for version in active.versions.values()):
        others |= {"exclusive"}  # jobs in one piece that overlap are not nested either
    yield from _penalty(table, "precedence", cost.precedence, timing, timing | others)
    used = {unit for placed in table.jobs for unit in placed.job.units}
    unused = [unit for unit in table.model.units if unit.name not in used]
    empty = Fraction(len(unused), len(table.model.units)) if unused else Fraction()
    if cost.occupancy != empty:
        yield _wrong(
            table, "cost", f"occupancy {_number(cost.occupancy)}, the share of empty units is {_number(empty)}"
        )
    if not 0 <= cost.timeliness <= 1:
        yield _wrong(table, "cost", f"timeliness {_number(cost.timeliness)} is not between 0 and 1")


def _penalty(
    table: ModeTable, name: str, value: Fraction, certain: frozenset[str], possible: frozenset[str]
) -> Iterator[Diagnostic]:
    if value < 0:
        yield _wrong(table, "cost", f"{name} {_number(value)} is below zero")
    if value <= 0 and certain & table.broken:
        rules = ", ".join(sorted(certain & table.broken))
        yield _wrong(table, "cost", f"{name} {_number(value)}, but the schedule breaks: {rules}")
    if value > 0 and not possible & table.broken and table.sound:
        yield _wrong(table, "cost", f"{name} {_number(value)}, but no rule of that kind is broken")


def _margin(table: ModeTable, stated: Fraction, bound: Fraction | None) -> Iterator[Diagnostic]:
    """Check the least share of its length by which a claim could last until the next one, 100 at most (D)."""
    found = Fraction(100)
    for claims in unit_claims(table.jobs).values():
        starts = sorted(start % table.period for start, _, _, _ in claims)
        for start, end, _, _ in claims:
            at = start % table.period
            later = bisect_left(starts, at) + 1  # behind one claim of this instant, however many there are
            following = starts[later] if later < len(starts) else starts[0] + table.period
            found = min(found, Fraction(following - at - (end - start), end - start))
    if stated != found:
        yield _wrong(table, "margin", f"{_number(stated)}; the jobs make it {_number(found)}")
    if bound is not None and bound < stated:
        yield _wrong(table, "margin", f"{_number(stated)} is more than its bound {_number(bound)}")


def _unit_loads(table: ModeTable) -> Iterator[Diagnostic]:
    """A unit is busy for the sum of the lengths of the parts on it: the time reserved, with interrupts and resuming."""
    claims = unit_claims(table.jobs) if table.schedule.unit_loads else {}
    units = {unit.name for unit in table.model.units}
    for load in table.schedule.unit_loads:
        if load.unit not in units:
            yield _wrong(table, about(unit_load=load.unit), "the unit does not exist")
            continue
        busy = sum(end - start for start, end, _, _ in claims.get(load.unit, ()))
        share = Fraction(busy, table.period)
        if load.busy * table.clock.scale != Duration(busy) or load.share != share:
            text = f"busy {load.busy}, share {_number(load.share)}; the jobs make {table.clock.text(busy)}, "
            yield _wrong(table, about(unit_load=load.unit), text + f"share {_number(share)}")


def _resource_loads(table: ModeTable) -> Iterator[Diagnostic]:
    claimed = resource_claims(table.jobs, table.clock, table.mode.locks) if table.schedule.resource_loads else {}
    resources = {resource.name for resource in table.model.resources}
    for load in table.schedule.resource_loads:
        if load.resource not in resources:
            yield _wrong(table, about(resource_load=load.resource), "the resource does not exist")
            continue
        shared = claimed.get(load.resource, Shared(common_denominator(()), []))
        if shared.scale is None:
            continue  # rule access has said that these bounds are out of reach
        claims = list(wrap(shared.claims, table.period))
        peak = Fraction(max((excess.peak for excess in excesses(claims, 0)), default=0), shared.scale)
        mean = Fraction(sum((end - start) * weight for start, end, weight, _ in claims), shared.scale * table.period)
        for name, stated, found in (("peak", load.peak, peak), ("mean", load.mean, mean)):
            if stated is not None and stated != found:
                text = f"{name} {_number(stated)}; the jobs make it {_number(found)}"
                yield _wrong(table, about(resource_load=load.resource), text)


def _chain_latencies(table: ModeTable) -> Iterator[Diagnostic]:
    chains = {chain.name: chain for chain in table.chains()}
    for given in table.schedule.chains:
        element = about(chain=given.name)
        chain = chains.get(given.name)
        if chain is None:
            yield _wrong(table, element, "the mode has no such chain")
            continue
        reports = ("latency", given.latency), ("reaction", given.reaction), ("age", given.age)
        for (what, reported), found in zip(reports, measured(table, chain), strict=True):
            if what == "latency" and reported is None:
                continue  # it is reported where the model refers to it
            if not _same(reported, found, table.clock):
                text = f"{what} {_told(reported)}, the jobs make {table.clock.text(found[0]) if found else 'none'}"
                yield _wrong(table, element, text)


def _same(reported: Duration | None, found: Found, clock: Clock) -> bool:
    if reported is None or found is None:
        return (reported is None) == (found is None)
    return reported * clock.scale == Duration(found[0])


def _told(reported: Duration | None) -> str:
    return "none" if reported is None else str(reported or ZERO)


def _number(value: Fraction) -> str:
    return format_rational(Fraction(value))


FIGURES = Rule(
    "figures",
    "Every cost, margin, load and latency that the schedule reports follows from its jobs; the cost is at most 0 if "
    "and only if no rule is broken.",
    check_figures,
)


@record
class Health:
    """A model and its schedule, for the rules that are about both as a whole."""

    model: TaskModel
    schedule: Schedule


def check_health(health: Health) -> Iterator[Diagnostic]:
    """Check that every rule has its reaction in every mode where it holds, and that there are no others."""
    stated = Counter(replace(given, at=NOWHERE) for given in health.schedule.reactions)
    running = {mode.name: {run.task for run in mode.runs if run.versions} for mode in health.model.modes}
    for mode in {mode.name: mode for mode in reversed(health.schedule.modes)}.values():
        for rule in health.model.health:
            if rule.mode == mode.name or rule.task not in running.get(mode.name, ()):
                continue
            path = about(mode=mode.name, health_rule_of_task=rule.task)
            within = _longest(health.schedule, mode, rule)
            if within is None and rule.action is not HealthAction.RESTART:
                text, help = f'there is no table to "{rule.mode}"', "schedule the transition, or change the rule"
                yield codes.REACTION_MISSING(text, at=mode.at, path=path, help=help)
                continue
            wanted = Reaction(
                mode=mode.name,
                task=rule.task,
                event=rule.event,
                count=rule.count,
                cycles=rule.cycles,
                action=rule.action,
                target=rule.mode,
                within=within,
            )
            if stated[wanted]:
                stated[wanted] -= 1
                continue
            took = "" if within is None else f" within {within}"
            text, help = f"its reaction, {rule.action}{took}, is not stated", "schedule the model again"
            yield codes.REACTION_MISSING(text, at=mode.at, path=path, help=help)
    places = {replace(given, at=NOWHERE): given.at for given in health.schedule.reactions}
    for given in stated.elements():
        path = about(mode=given.mode, reaction_to_task=given.task)
        after = f"{given.action} after {given.count} times {given.event} in {given.cycles} tables"
        to = f' to "{given.target}"' if given.target else ""
        took = "" if given.within is None else f" within {given.within}"
        text, help = f"{after}{to}{took} follows from no rule of the model", "schedule the model again"
        yield codes.WRONG_REACTION(text, at=places[given], path=path, help=help)


def _longest(schedule: Schedule, mode: ModeSchedule, rule: HealthRule) -> Duration | None:
    """Return how long a rule takes at most: an event just after an end of the hyperperiod waits for the next one."""
    if rule.action is HealthAction.STOP:
        return mode.hyperperiod
    for table in schedule.transitions:
        if (table.source, table.target) == (mode.name, rule.mode) and table.status is Status.VALID:
            return mode.hyperperiod + table.length
    return None


HEALTH: Rule[Health] = Rule(
    "health",
    "In every mode where a health rule of the model holds, the schedule states its reaction and the longest time that "
    "it takes, and has the table that it needs; it states no other reactions.",
    check_health,
)
