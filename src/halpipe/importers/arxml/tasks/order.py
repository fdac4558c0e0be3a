"""Order of tasks: precedence edges from constraints, positions and received data, without cycles."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.tasks.activation import Activation, Draft, are_in_order
from halpipe.importers.arxml.tasks.periods import senders_of
from halpipe.importers.arxml.tasks.requirements import Requirements, Spacing, paths_of, report_inner
from halpipe.models import Anchor, Match

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from halpipe.importers.arxml.system.values import Order, Ordered, Place, Synchronisation, System
    from halpipe.importers.arxml.tasks.dataflow import DataFlow


@record
class Edge:
    """`first` before `second` (task names), because of the element at `cause`.

    `spacing` states the window where an offset constraint does; `also` are elements that state the same order.
    """

    first: str
    second: str
    cause: Place
    spacing: Spacing | None = None
    also: tuple[Place, ...] = ()


def find_edges(
    system: System, drafts: Sequence[Draft], dataflow: DataFlow, required: Requirements, findings: Findings
) -> list[Edge]:
    """Return the precedence between tasks, strongest source first, each pair once, free of cycles."""
    edges = [
        *(Edge(spacing.first, spacing.second, spacing.cause, spacing) for spacing in required.spacings),
        *_from_constraints(system, drafts, findings),
        *_from_positions(drafts, findings),
        *_from_received_data(drafts, dataflow),
    ]
    alike: dict[tuple[str, str], list[Edge]] = {}
    for edge in edges:
        if edge.first == edge.second:
            required.used.append(edge.cause)
        else:
            alike.setdefault((edge.first, edge.second), []).append(edge)
    kept = without_cycles([e for found in alike.values() for e in _joined(found)], findings)
    return [*kept, *_synchronised(required.together, kept, drafts, findings)]


def _synchronised(
    together: Sequence[tuple[Synchronisation, Mapping[str, tuple[Anchor, ...]]]],
    edges: Sequence[Edge],
    drafts: Sequence[Draft],
    findings: Findings,
) -> Iterator[Edge]:
    """Let all others follow the first of some tasks within the tolerance, in the order that the edges have.

    The constraint does not state who is first; a window does, which demands more than the constraint.
    """
    sorter: TopologicalSorter[str] = TopologicalSorter({draft.name: () for draft in drafts})
    for edge in edges:
        sorter.add(edge.second, edge.first)
    rank = {name: number for number, name in enumerate(sorter.static_order())}
    for cause, instants in together:
        first, *others = sorted(instants, key=rank.__getitem__)
        for other in others:
            for to in instants[other]:
                begin, most = instants[first][0], cause.tolerance
                window = Spacing(first, other, ZERO, most, begin, cause.place, to, Match.CYCLE)
                yield Edge(first, other, cause.place, window)
        message = f'{listed(others)} follow "{first}" within {cause.tolerance}'
        help = "state another order in the overlay (precedence), if this one cannot be kept"
        cause.place.report(findings, codes.SYNCHRONISED, message, help=help)


def _joined(alike: list[Edge]) -> Iterator[Edge]:
    """Yield every window between two tasks, and the strongest order unless a window demands it; others are noted."""
    stated = [edge for edge in alike if edge.spacing]
    orders = [edge for edge in alike if edge.spacing is None]
    is_demanded = any(edge.spacing.is_order for edge in stated if edge.spacing)
    kept = stated if is_demanded else [*stated, *orders[:1]]
    also = tuple(dict.fromkeys(edge.cause for edge in orders if edge not in kept))
    yield replace(kept[0], also=also)
    yield from kept[1:]


# ------------------------------------------------------------------------------------------------- sources


def _from_constraints(system: System, drafts: Sequence[Draft], findings: Findings) -> Iterator[Edge]:
    """Execution order constraints; two runnables of one component type are ordered within each instance only."""
    members = [(draft, member) for draft in drafts for member in draft.members]
    by_path = grouped((path, (draft, member)) for draft, member in members for path in paths_of(member))
    _report_lost(system, by_path.keys(), findings)
    inner: dict[Place, list[Draft]] = {}
    for order in system.orders:
        same_type = order.first.path.rpartition("/")[0] == order.second.path.rpartition("/")[0]
        is_named = bool(order.first.prototype or order.second.prototype)
        for draft, first in _in_context(by_path, order.first):
            for other, second in _in_context(by_path, order.second):
                is_meant = is_named or not same_type or first.context == second.context
                if is_meant and (draft is not other or _is_kept_inside(order, draft, first, second, findings)):
                    ends = [(draft, first, True), (other, second, False)] if draft is not other else []
                    inner.setdefault(order.place, []).extend(t for t, m, end in ends if t.is_within([m], end=end))
                    yield Edge(draft.name, other.name, order.place)
    for place, found in inner.items():
        report_inner(place, found, findings)


def _is_kept_inside(order: Order, draft: Draft, first: Activation, second: Activation, findings: Findings) -> bool:
    """Whether the positions in one OsTask state an order, too; report one that they contradict, or leave open."""
    if are_in_order([first], [second]):
        return True
    order.place.report(
        findings,
        codes.ORDER_LOST,
        f'orders "{first.name}" before "{second.name}", which "{draft.name}" runs '
        + ("the other way round" if are_in_order([second], [first]) else "in no stated order"),
        help="correct RtePositionInTask, or the constraint",
    )
    return False


def _in_context(by_path: dict[str, list[tuple[Draft, Activation]]], end: Ordered) -> Iterator[tuple[Draft, Activation]]:
    """Yield the tasks of what an order names, with the activations; those of the named prototype if it names one."""
    for draft, member in by_path.get(end.path, ()):
        if end.prototype is None or end.prototype in member.context:
            yield draft, member


def _report_lost(system: System, known: Collection[str], findings: Findings) -> None:
    """Report, once per constraint, what it orders that is no task."""
    lost: dict[Place, dict[str, None]] = {}
    for order in system.orders:
        for path in (order.first.path, order.second.path):
            if path not in known:
                lost.setdefault(order.place, {})[path] = None
    for place, paths in lost.items():
        message = f"orders what is no periodic task: {listed(list(paths))}"
        help = "give it a period in the overlay (sources) if the order matters"
        place.report(findings, codes.ORDER_LOST, message, help=help)


def _from_positions(drafts: Sequence[Draft], findings: Findings) -> Iterator[Edge]:
    """RtePositionInTask orders what one OsTask runs; equal positions are not ordered.

    What is released together runs in this order, also across periods: each position follows the last one before it,
    and the last one with its own period and offset.
    """
    hosted = grouped((draft.os_task.place.path, draft) for draft in drafts if draft.os_task is not None)
    for found in hosted.values():
        slots = grouped((draft.position, draft) for draft in found if draft.position is not None)
        _report_positions(found, slots, findings)
        yield from _in_turn(slots)


def _in_turn(slots: dict[int, list[Draft]]) -> Iterator[Edge]:
    last_of_rate: dict[tuple[Duration | None, Duration | None], list[Draft]] = {}
    last: list[Draft] = []
    for position in sorted(slots):
        for second in slots[position]:
            before = {id(first): first for first in (*last, *last_of_rate.get((second.period, second.offset), ()))}
            for first in before.values():
                if _meet(first, second):
                    mapping = second.members[0].mapping
                    assert mapping is not None
                    yield Edge(first.name, second.name, mapping.place)
        last = slots[position]
        last_of_rate |= grouped(((draft.period, draft.offset), draft) for draft in last)


def _meet(first: Draft, second: Draft) -> bool:
    """Whether releases of two tasks coincide, which they do iff their offsets agree modulo the common divisor."""
    if first.period is None or second.period is None:
        return first.period == second.period
    common = greatest_common_divisor((first.period, second.period))
    return not ((first.offset or ZERO) - (second.offset or ZERO)) % common


def _report_positions(found: Sequence[Draft], slots: dict[int, list[Draft]], findings: Findings) -> None:
    """Report what one OsTask runs in an order that no input states."""
    unordered = [draft for draft in found if draft.position is None]
    groups = [*slots.values(), [*unordered, *found[:1]] if unordered else []]
    for group in groups:
        names = list(dict.fromkeys(draft.name for draft in group))
        if len(names) > 1 and group[0].os_task is not None:
            message = f"runs in no stated order: {listed(names)}"
            at, path = group[0].place.at, named("OsTask", group[0].os_task.place.path)
            findings.report(codes.SAME_POSITION, message, at=at, path=path)


def _from_received_data(drafts: Sequence[Draft], dataflow: DataFlow) -> Iterator[Edge]:
    """A task that data starts comes after the tasks of the same period that send the data."""
    senders = grouped(((member.actor, draft.period), draft) for draft in drafts for member in draft.members)
    for draft in drafts:
        for member in draft.members:
            if member.event is None:
                continue
            for actor in senders_of(member, dataflow):
                for sender in senders.get((actor, draft.period), ()):
                    yield Edge(sender.name, draft.name, member.event.place)


# -------------------------------------------------------------------------------------------------- cycles


def without_cycles(edges: list[Edge], findings: Findings) -> list[Edge]:
    """Keep edges in order of strength, leaving out and reporting every one that would close a cycle."""
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for edge in edges:
        sorter.add(edge.second, edge.first)
    with suppress(CycleError):
        sorter.prepare()
        return edges
    kept: list[Edge] = []
    successors: dict[str, list[str]] = {}
    for edge in edges:
        way = _way(successors, edge.second, edge.first)
        if way:
            edge.cause.report(
                findings,
                codes.CYCLE,
                f'the order "{edge.first}" before "{edge.second}" is left out, because it contradicts '
                + " before ".join(f'"{name}"' for name in way),
                help="correct one of them in the source, or state the order in the overlay (precedence)",
            )
            continue
        kept.append(edge)
        successors.setdefault(edge.first, []).append(edge.second)
    return kept


def _way(successors: dict[str, list[str]], start: str, end: str) -> list[str]:
    """Return a shortest way from `start` to `end`, empty if there is none."""
    came_from = {start: ""}
    todo = [start]
    for name in todo:
        if name == end:
            way = [end]
            while came_from[way[-1]]:
                way.append(came_from[way[-1]])
            return way[::-1]
        for following in successors.get(name, ()):
            if following not in came_from:
                came_from[following] = name
                todo.append(following)
    return []
