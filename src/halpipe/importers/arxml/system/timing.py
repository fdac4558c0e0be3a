"""The timing extension: what can be observed, event chains, how often events arrive, and what is required of them.

Read are requirements. Guarantees state what is fulfilled already, so they constrain nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import named
from halpipe.core.durations import ZERO, Duration
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.numbers import parse_cse
from halpipe.importers.arxml.system.constraints import PROTOTYPE, is_guarantee
from halpipe.importers.arxml.system.execution_times import cse_time
from halpipe.importers.arxml.system.swc import RUNNABLES, place_of
from halpipe.importers.arxml.system.values import Arrival, Distance, EventChain, Limit, Observable, Timing

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.importers.arxml.files.tree import Node, Tree

T = TypeVar("T")

CHAIN = "TIMING-DESCRIPTION-EVENT-CHAIN"
LATENCY = "LATENCY-TIMING-CONSTRAINT"
AGE = "AGE-CONSTRAINT"
OFFSET = "OFFSET-TIMING-CONSTRAINT"
_PERIODIC = "PERIODIC-EVENT-TRIGGERING"
_SPORADIC = "SPORADIC-EVENT-TRIGGERING"
_BURST = "BURST-PATTERN-EVENT-TRIGGERING"
_CONCRETE = "CONCRETE-PATTERN-EVENT-TRIGGERING"
_ARBITRARY = "ARBITRARY-EVENT-TRIGGERING"
_ARRIVALS = (_PERIODIC, _SPORADIC, _BURST, _CONCRETE, _ARBITRARY)
CONSTRAINTS = (LATENCY, AGE, OFFSET, *_ARRIVALS)
NOT_READ = ("SYNCHRONIZATION-TIMING-CONSTRAINT",)
_RUNNABLE_EVENTS = {
    "TD-EVENT-SWC-INTERNAL-BEHAVIOR": "RUNNABLE-REF",
    "TD-EVENT-BSW-INTERNAL-BEHAVIOR": "BSW-MODULE-ENTITY-REF",
}
_DATA_EVENT = "TD-EVENT-VARIABLE-DATA-PROTOTYPE"
_HAPPENINGS = ("activated", "started", "terminated", "sent", "received")


def read_timing(tree: Tree) -> Timing:
    """Read everything of the timing extension that has a counterpart in the model; report the rest."""
    for node in required(tree, *CONSTRAINTS, *NOT_READ):
        _report_lost_parts(tree, node)
    return Timing(
        observables=_present(_observable(tree, node) for node in tree.tagged(*_RUNNABLE_EVENTS, _DATA_EVENT)),
        chains=tuple(_chain(tree, node) for node in tree.tagged(CHAIN)),
        arrivals=_present(_arrival(tree, node) for node in required(tree, *_ARRIVALS)),
        limits=_present(_limit(tree, node) for node in required(tree, LATENCY, AGE)),
        distances=_present(_distance(tree, node) for node in required(tree, OFFSET)),
    )


def _present(found: Iterable[T | None]) -> tuple[T, ...]:
    return tuple(item for item in found if item is not None)


def required(tree: Tree, *tags: str) -> list[Node]:
    """Return the constraints of the given kinds that are no guarantees."""
    return [node for node in tree.tagged(*tags) if not is_guarantee(node)]


def report_not_read(tree: Tree) -> None:
    """Report the kinds of constraints that have no counterpart in the model, one finding for each kind."""
    for tag in NOT_READ:
        found = required(tree, tag)
        if found:
            tree.findings.add(
                codes.TIMING_IGNORED(
                    f"{len(found)} {tag} elements are not imported",
                    at=found[0].at,
                    path=named(tag, found[0].path),
                    help="state the order and the window in the overlay (precedence)",
                )
            )


# ------------------------------------------------------------------------------------------------ observables


def _observable(tree: Tree, node: Node) -> Observable | None:
    stated = tree.text(node, f"{node.tag}-TYPE")
    words = (stated.value if stated else "").lower().split("-")
    what = words[-1]
    if what not in _HAPPENINGS:
        return None
    ref = tree.ref(node, PROTOTYPE)
    prototype = ref.path if ref else None
    if node.tag == _DATA_EVENT:
        data, port = tree.ref(node, "DATA-ELEMENT-REF"), tree.ref(node, "PORT-REF")
        if data is None or port is None:
            return None
        return Observable(place=place_of(node), what=what, subject=data.path, port=port.path, prototype=prototype)
    ref = tree.ref(node, _RUNNABLE_EVENTS[node.tag])
    runnable = tree.find(ref, f'{node.tag} "{node.path}"', RUNNABLES) if ref else None
    return Observable(place=place_of(node), what=what, subject=runnable.path, prototype=prototype) if runnable else None


def _chain(tree: Tree, node: Node) -> EventChain:
    what = f'{CHAIN} "{node.path}"'
    ends = []
    for tag in ("STIMULUS-REF", "RESPONSE-REF"):
        ref = tree.ref(node, tag)
        target = tree.find(ref, what) if ref else None
        ends.append(target.path if target else None)
    segments = (tree.find(ref, what, (CHAIN,)) for ref in tree.refs(node, "SEGMENT-REFS/SEGMENT-REF"))
    return EventChain(
        place=place_of(node),
        stimulus=ends[0],
        response=ends[1],
        segments=tuple(segment.path for segment in segments if segment is not None and segment is not node),
    )


# ------------------------------------------------------------------------------------------------ constraints


def _target(tree: Tree, node: Node, tag: str) -> str | None:
    ref = tree.ref(node, tag)
    target = tree.find(ref, f'{node.tag} "{node.path}"') if ref else None
    return target.path if target else None


def _time(tree: Tree, node: Node, child: str) -> Duration | None:
    return cse_time(tree, node, child, codes.BAD_TIME)


def _arrival(tree: Tree, node: Node) -> Arrival | None:
    event = _target(tree, node, "EVENT-REF")
    period = _time(tree, node, _period_tag(node.tag))
    offsets: tuple[Duration, ...] | None = None
    if node.tag == _PERIODIC:
        offsets = (ZERO,)
    elif node.tag == _CONCRETE:
        offsets = tuple(_times(node, "OFFSETS/MULTIDIMENSIONAL-TIME"))
    elif node.tag == _ARBITRARY:
        period = next(_times(node, "MINIMUM-DISTANCES/MULTIDIMENSIONAL-TIME"), None)
    if event is None:
        return None
    if not period or offsets == ():
        tree.findings.add(
            codes.BAD_TIME(
                "states no time between occurrences that can be used",
                at=node.at,
                path=named(node.tag, node.path),
                help="state a positive period, or the least time between two occurrences",
            )
        )
        return None
    jitter = _time(tree, node, "JITTER") if node.tag == _PERIODIC else _time(tree, node, "PATTERN-JITTER")
    return Arrival(place=place_of(node), event=event, period=period, offsets=offsets, jitter=jitter)


def _period_tag(tag: str) -> str:
    if tag == _PERIODIC:
        return "PERIOD"
    return "PATTERN-PERIOD" if tag == _CONCRETE else "MINIMUM-INTER-ARRIVAL-TIME"


def _times(node: Node, path: str) -> Iterator[Duration]:
    for element, _ in node.elements(path):
        texts = {str(child.tag).rpartition("}")[2]: child.text or "" for child in element.iterchildren("*")}
        time = parse_cse(texts.get("CSE-CODE", ""), texts.get("CSE-CODE-FACTOR", ""))
        if time is not None:
            yield time


def _limit(tree: Tree, node: Node) -> Limit | None:
    scope = _target(tree, node, "SCOPE-REF")
    maximum = _time(tree, node, "MAXIMUM")
    if scope is None or not maximum:
        return None
    kind = tree.text(node, "LATENCY-CONSTRAINT-TYPE")
    is_age = node.tag == AGE or (kind is not None and kind.value.upper() == "AGE")
    return Limit(place=place_of(node), scope=scope, maximum=maximum, is_age=is_age)


def _distance(tree: Tree, node: Node) -> Distance | None:
    source, target = _target(tree, node, "SOURCE-REF"), _target(tree, node, "TARGET-REF")
    if source is None or target is None:
        return None
    low, high = _time(tree, node, "MINIMUM"), _time(tree, node, "MAXIMUM")
    return Distance(place=place_of(node), source=source, target=target, minimum=low, maximum=high)


def _report_lost_parts(tree: Tree, node: Node) -> None:
    """Report the parts of a constraint that nothing is made of: lower and nominal limits, conditions."""
    lost = [tag for tag in ("MINIMUM", "NOMINAL") if node.tag in (LATENCY, AGE) and _time(tree, node, tag)]
    lost += [tag for tag in ("TIMING-CONDITION-REF",) if any(True for _ in node.elements(tag))]
    if lost:
        tree.findings.add(
            codes.TIMING_PART_LOST(
                f"{', '.join(lost)} of the constraint is not imported",
                at=node.at,
                path=named(node.tag, node.path),
                help="state it in the overlay, if the schedule has to keep it",
            )
        )
