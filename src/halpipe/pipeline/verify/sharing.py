"""Rules exclusive and access: one sweep over time for units among jobs and resources among phases (MODEL 3 and 5)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, TypeAlias

from halpipe.core.diagnostics import Code, Diagnostic, Location, about
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.modelfaults import is_phase
from halpipe.pipeline.verify.tables import MAX_BITS, TABLE, Clock, ModeTable, Placed, Rule, Switch, common_denominator

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Access, Version

    Claim: TypeAlias = tuple[int, int, int, Placed]

    """Start and end (half-open, start < end), weight, and whose it is."""


NAMED = 12
"""How many jobs a message names before it counts the rest."""


@dataclass(slots=True)
class Excess:
    """A maximal interval [start, end) in which the weights in force sum to more than the limit.

    `members` are the jobs to name, `parts` the parts of the line of all jobs that take part.
    """

    start: int
    end: int
    peak: int
    members: dict[int, Placed] = field(default_factory=dict)
    parts: set[str] = field(default_factory=set)

    def add(self, claims: Iterable[Claim]) -> None:
        """Note who has a part in it; one job beyond those named is enough to know that there are more."""
        for claim in claims:
            if len(self.members) > NAMED:
                break
            self.members[id(claim[3])] = claim[3]

    def names(self) -> str:
        """List the jobs that take part."""
        found = sorted(self.members.values(), key=lambda p: (p.job.task, p.job.index, p.where))
        more = [] if len(found) <= NAMED else ["others"]
        labels = [p.label for p in found[:NAMED]] + more
        return " and ".join([", ".join(labels[:-1]), labels[-1]] if len(labels) > 1 else labels)


def wrap(claims: Iterable[Claim], period: int) -> Iterator[Claim]:
    """Lay claims round a circle of `period`, cut at 0; what is longer than the circle weighs on itself."""
    for start, end, weight, owner in claims:
        turns, rest = divmod(end - start, period)
        start %= period
        if turns:
            yield 0, period, weight * turns, owner
        if not rest:
            continue
        if start + rest <= period:
            yield start, start + rest, weight, owner
        else:
            yield start, period, weight, owner
            yield 0, start + rest - period, weight, owner


def excesses(claims: Iterable[Claim], limit: int) -> list[Excess]:
    """Return every maximal interval of the line in which more than `limit` is claimed, in order of time."""
    found: list[Excess] = []
    current: Excess | None = None
    active: dict[int, Claim] = {}
    parts: Counter[str] = Counter()
    total = 0
    for instant, ending, starting in _events(claims):
        for key, claim in ending:
            total -= claim[2]
            parts[claim[3].where] -= 1
            del active[key]
        for key, claim in starting:
            total += claim[2]
            parts[claim[3].where] += 1
            active[key] = claim
        if total <= limit:
            if current is not None:
                current.end = instant
                found.append(current)
            current = None
        elif current is None:
            current = Excess(instant, instant, total)
            current.add(active.values())
            current.parts.update(+parts)
        else:
            current.peak = max(current.peak, total)
            current.add(claim for _, claim in starting)
            current.parts.update(claim[3].where for _, claim in starting)
    return found


Keyed: TypeAlias = "tuple[int, Claim]"


def _events(claims: Iterable[Claim]) -> Iterator[tuple[int, list[Keyed], list[Keyed]]]:
    """Yield every instant at which something changes, with the claims that end there and those that start there."""
    changes: dict[int, tuple[list[Keyed], list[Keyed]]] = {}
    for keyed in enumerate(claims):
        start, end = keyed[1][:2]
        changes.setdefault(start, ([], []))[1].append(keyed)
        changes.setdefault(end, ([], []))[0].append(keyed)
    for instant in sorted(changes):
        yield instant, *changes[instant]


def excesses_on_circle(claims: Iterable[Claim], limit: int, period: int) -> list[Excess]:
    """Return the same on a circle; an interval that passes the end of the circle is one, with end > period."""
    found = excesses(wrap(claims, period), limit)
    if len(found) > 1 and found[0].start == 0 and found[-1].end == period:
        first, last = found[0], found.pop()
        found[0] = Excess(last.start, period + first.end, max(first.peak, last.peak), last.members)
        found[0].members.update(first.members)
    return found


def check_exclusive(table: ModeTable | Switch) -> Iterator[Diagnostic]:
    """Sweep every unit; a job longer than the hyperperiod overlaps itself."""
    for unit, claims in unit_claims(table.meeting()).items():
        for excess in _excesses_of(table, claims, 1):
            yield _overlap(unit, excess, table.clock, table.path())


def check_access(table: ModeTable | Switch) -> Iterator[Diagnostic]:
    """Sweep every resource."""
    for resource, shared in resource_claims(table.meeting(), table.clock, table.mode.locks).items():
        if shared.scale is None:
            yield _too_fine(resource, table.path(), table.at)
            continue
        for excess in _excesses_of(table, shared.claims, shared.scale):
            yield _overload(resource, excess, shared.scale, table.clock, table.path())


def _excesses_of(table: ModeTable | Switch, claims: list[Claim], limit: int) -> list[Excess]:
    """Sweep the circle of a mode, or the line of a switch; what lies within one mode is for the rule of that mode."""
    if isinstance(table, ModeTable):
        return excesses_on_circle(claims, limit, table.period)
    return [excess for excess in excesses(claims, limit) if len(excess.parts) > 1 or TABLE in excess.parts]


# ------------------------------------------------------------------------------------------------ claims


def unit_claims(jobs: Iterable[Placed]) -> dict[str, list[Claim]]:
    """Return, for every unit used, when which job holds it: in its parts. A job of length 0 holds nothing."""
    claims: dict[str, list[Claim]] = {}
    for placed in jobs:
        held = [(placed.start + s, placed.start + t, 1, placed) for s, t, _, _ in placed.stretches if s < t]
        if held:
            for unit in dict.fromkeys(placed.job.units):
                claims.setdefault(unit, []).extend(held)
    return claims


@record
class Shared:
    """Claims on one resource, in parts of which the whole has `scale`: every bound is a whole number of them.

    `scale` is None, and nothing claimed, where the common denominator of the bounds is out of reach.
    """

    scale: int | None
    claims: list[Claim]


def resource_claims(jobs: Iterable[Placed], clock: Clock, locks: frozenset[str]) -> dict[str, Shared]:
    """Return what the phases of the chosen versions claim; phases that make no sense are the model's fault."""
    by_version: dict[int, tuple[Version, list[Placed]]] = {}
    for placed in jobs:
        if placed.version is not None and placed.version.accesses:
            by_version.setdefault(id(placed.version), (placed.version, []))[1].append(placed)
    used: dict[str, list[tuple[Access, list[Placed]]]] = {}
    for version, owners in by_version.values():
        for access in version.accesses:
            if is_phase(access, version):
                used.setdefault(access.resource, []).append((access, owners))
    shared: dict[str, Shared] = {}
    for resource, phases in used.items():
        scale = common_denominator({access.bound.denominator for access, _ in phases})
        shared[resource] = Shared(scale, _claims(phases, scale, clock, resource in locks) if scale else [])
    return shared


def _claims(phases: list[tuple[Access, list[Placed]]], scale: int, clock: Clock, is_lock: bool) -> list[Claim]:
    claims: list[Claim] = []
    for access, owners in phases:
        start, end, weight = clock.ticks(access.start), clock.ticks(access.end), int(access.bound * scale)
        for placed in owners:
            force = _in_force(placed, start, end, is_lock)
            if force is not None:
                claims.append((placed.start + force[0], placed.start + force[1], weight, placed))
    return claims


def _in_force(placed: Placed, start: int, end: int, is_lock: bool) -> tuple[int, int] | None:
    """Return when a phase of a job is in force, from the job's start: a lock also in gaps.

    None where a gap lies in a phase that is no lock (rule parts). A job of which the model does not say how long it
    takes holds nothing, as with units.
    """
    first: int | None = None
    last, lost = 0, 0
    for begin, _, done_from, done_to in placed.stretches:
        if first is None and done_from <= start < done_to:
            first = begin + lost + start - done_from
        if done_from < end <= done_to and (is_lock or done_from <= start):
            work = lost + end - done_from
            last = begin + (placed.service.length(work) or work)
        lost = placed.resume
    return None if first is None or last <= first else (first, last)


# ------------------------------------------------------------------------------------------------ findings


def _overlap(unit: str, excess: Excess, clock: Clock, path: str) -> Diagnostic:
    span = f"from {clock.text(excess.start)} to {clock.text(excess.end)}"
    span += f": {clock.text(excess.end - excess.start)} of overlap"
    text = f"is held by {excess.names()} {span}"
    if len(excess.members) == 1:
        text = f"is held twice by {excess.names()}, which is longer than the hyperperiod, {span}"
    help = "move one of the jobs, or use another unit"
    return _together(codes.OVERLAP, text, excess, about(path, unit=unit), help)


def _overload(resource: str, excess: Excess, scale: int, clock: Clock, path: str) -> Diagnostic:
    peak = format_rational(Fraction(excess.peak, scale))
    span = f"from {clock.text(excess.start)} to {clock.text(excess.end)}"
    text = (
        f"is claimed up to {peak} {span} by {excess.names()}: {format_rational(Fraction(excess.peak - scale, scale))}"
    )
    text += " too much"
    help = "move one of the jobs, or lower a bound"
    return _together(codes.OVERLOAD, text, excess, about(path, resource=resource), help)


def _together(code: Code, text: str, excess: Excess, path: str, help: str) -> Diagnostic:
    """Report what jobs do together; it concerns each of them."""
    first, *others = excess.members.values()
    subjects = [placed.subject for placed in (first, *others)]
    return code(text, at=first.job.at, path=path, help=help, subjects=subjects, places=[p.job.at for p in others])


def _too_fine(resource: str, path: str, at: Location) -> Diagnostic:
    text = f"the common denominator of its bounds has more than {MAX_BITS} bits"
    return codes.TOO_FINE(text, at=at, path=about(path, resource=resource), help="round the bounds up")


EXCLUSIVE = Rule(
    "exclusive",
    "On every unit, the parts of all jobs do not overlap, also round the end of the hyperperiod; a job in one piece is "
    "one part, from its start for the reserved length of its WCET.",
    check_exclusive,
)
ACCESS = Rule(
    "access",
    "At every instant, the bounds of all access phases in force on a resource sum to at most 1, exactly.",
    check_access,
)
