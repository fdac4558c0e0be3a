"""Timing extension: observable events, event chains, requirements, orders of execution and execution times.

Read are requirements. Guarantees state what is fulfilled already, so they constrain nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, named
from halpipe.core.durations import ZERO, Duration
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.tree import Node, Stated, Tree, local, place
from halpipe.importers.arxml.files.words import parse_cse
from halpipe.importers.arxml.system.components import RUNNABLES, place_of
from halpipe.importers.arxml.system.values import (
    Arrival,
    Distance,
    EventChain,
    ExecutionTime,
    LetGroup,
    Limit,
    Observable,
    Order,
    Ordered,
    Synchronisation,
    Timing,
)

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Iterator


# Where a worst-case time stands in each kind of execution time, the most trustworthy kind first.
KINDS = {
    "ANALYZED-EXECUTION-TIME": "WORST-CASE-EXECUTION-TIME",
    "MEASURED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "SIMULATED-EXECUTION-TIME": "MAXIMUM-EXECUTION-TIME",
    "ROUGH-ESTIMATE-OF-EXECUTION-TIME": "ESTIMATED-EXECUTION-TIME",
    "EXECUTION-TIME-CONSTRAINT": "MAXIMUM",
}
ANALYSED = "ANALYZED-EXECUTION-TIME"
CSE_HELP = "write it with a CSE-CODE that counts time (0: microseconds, 26: nanoseconds), or state it in the overlay"


def read_execution_times(tree: Tree) -> tuple[ExecutionTime, ...]:
    """Read execution times: for each runnable and hardware element the largest of the most trustworthy kind."""
    best: dict[tuple[str, str | None], ExecutionTime] = {}
    for tag in KINDS:
        for node in tree.tagged(tag):
            found = _execution_time(tree, node)
            if found is None:
                continue
            key = found.runnable, found.hardware
            known = best.get(key)
            if known is None or (known.place.kind == tag and known.time < found.time):
                best[key] = found
    return tuple(best.values())


def _execution_time(tree: Tree, node: Node) -> ExecutionTime | None:
    what = f'{node.tag} "{node.path}"'
    ref = tree.ref(node, "EXECUTABLE-ENTITY-REF") or tree.ref(node, "EXECUTABLE-REF")
    runnable = tree.find(ref, what, RUNNABLES) if ref else None
    hardware = tree.ref(node, "HW-ELEMENT-REF")
    if hardware is not None:
        tree.find(hardware, what, ("HW-ELEMENT",))
    if runnable is None:
        return None
    time = cse_time(tree, node, KINDS[node.tag], codes.BAD_EXECUTION_TIME)
    if not time:
        return None
    return ExecutionTime(place_of(node), runnable.path, time, hardware.path if hardware else None)


def cse_time(tree: Tree, node: Node, child: str, code: Code) -> Duration | None:
    """Return the MULTIDIMENSIONAL-TIME in a child element; report with `code` one that is there but is no time."""
    if not node.elements(child):
        return None
    parts = [tree.text(node, f"{child}/{tag}") for tag in ("CSE-CODE", "CSE-CODE-FACTOR")]
    unit, factor = (part.text if part else "" for part in parts)
    time = parse_cse(unit, factor)
    if time is None or (not time and code is codes.BAD_EXECUTION_TIME):
        message = f'{child} with CSE-CODE "{unit}" and factor "{factor}" is not read'
        at, path = parts[0].at if parts[0] else node.at, named(node.tag, node.path)
        tree.findings.report(code, message, at=at, path=path, help=CSE_HELP)
    return time


_EOC = "EXECUTION-ORDER-CONSTRAINT"
_POINT = "SYNCHRONIZATION-POINT-CONSTRAINT"
_ENTITY = "EOC-EXECUTABLE-ENTITY-REF"
_EVENT = "EOC-EVENT-REF"
_GROUP = "EOC-EXECUTABLE-ENTITY-REF-GROUP"
_ELEMENTS = (_ENTITY, _EVENT, _GROUP)
_SUCCESSORS = ("SUCCESSOR-REFS/SUCCESSOR-REF", "DIRECT-SUCCESSOR-REFS/DIRECT-SUCCESSOR-REF")
# What a group states beyond an order and its LET interval: how data is exchanged, and slots of a cycle.
_NOT_READ = ("LET-DATA-EXCHANGE-PARADIGM", "MAX-CYCLES", "MAX-SLOTS", "MAX-SLOTS-PER-CYCLE")
GUARANTEES, REQUIREMENTS = "TIMING-GUARANTEES", "TIMING-REQUIREMENTS"
_OF_NETWORK = ("TD-EVENT-FRAME", "TD-EVENT-I-PDU", "TD-EVENT-I-SIGNAL")
PROTOTYPE = "COMPONENT-IREF/TARGET-COMPONENT-REF"


def is_guarantee(node: Node) -> bool:
    """Whether a constraint states what is fulfilled already, rather than what is required."""
    return _holder(node) == GUARANTEES


def is_requirement(node: Node) -> bool:
    """Whether an element of the timing extension, of any kind, states what is required of tasks.

    When frames, protocol data units and signals are sent is left to the network.
    """
    if _holder(node) != REQUIREMENTS or node.tag in KINDS:
        return False
    refs = [ref for tag in ("EVENT-REF", "SOURCE-REF", "TARGET-REF") for ref, _ in node.elements(tag)]
    return not refs or not all((ref.get("DEST") or "").startswith(_OF_NETWORK) for ref in refs)


def _holder(node: Node) -> str:
    element = node.parts[0].element.getparent() if node.parts else None
    return "" if element is None else local(element)


def read_orders(tree: Tree) -> tuple[Order, ...]:
    """Read execution order and synchronisation point constraints as pairs of runnables or events."""
    found: list[Order] = []
    for node in tree.tagged(_EOC, _POINT):
        if not is_guarantee(node):
            found += _Constraint(tree, node).orders() if node.tag == _EOC else _point_orders(tree, node)
    return tuple(dict.fromkeys(found))


class _Constraint:
    """One execution order constraint: its elements, which groups hold which, and who comes before whom."""

    def __init__(self, tree: Tree, node: Node) -> None:
        self._tree = tree
        self._node = node
        self._what = f'{node.tag} "{node.path}"'
        self._elements = [child for child in node.inside() if child.tag in _ELEMENTS]
        self._after = {element: list(self._successors(element)) for element in self._elements}
        self._nested = {e: self._targets(e, "NESTED-ELEMENT-REFS/NESTED-ELEMENT-REF") for e in self._elements}

    def orders(self) -> Iterator[Order]:
        """Yield the order of every element and its successors; of groups, the last of one and the first of the next."""
        for element in self._elements:
            self._report_lost(element)
            for successor in self._after[element]:
                for first in self._edge_of(element, last=True):
                    for second in self._edge_of(successor, last=False):
                        yield Order(place_of(self._node), first, second)

    def _successors(self, element: Node) -> Iterator[Node]:
        for path in _SUCCESSORS:
            yield from self._targets(element, path)

    def _targets(self, element: Node, path: str) -> list[Node]:
        found = (self._tree.find(ref, self._what, _ELEMENTS) for ref in self._tree.refs(element, path))
        return [node for node in found if node is not None]

    def _edge_of(self, element: Node, *, last: bool) -> list[Ordered]:
        """Return what has no successor (`last`) or no predecessor among the leaves of an element."""
        leaves = self.leaves(element)
        if len(leaves) == 1 or element.tag != _GROUP:
            return list(ordered_by(self._tree, leaves))
        inner = [(a, b) for a in leaves for b in self._after.get(a, ()) if b in leaves]
        bound = {a for a, _ in inner} if last else {b for _, b in inner}
        return list(ordered_by(self._tree, [leaf for leaf in leaves if leaf not in bound]))

    def leaves(self, element: Node) -> list[Node]:
        """Return what a group holds, groups in it unfolded, each once."""
        found: dict[Node, None] = {}
        rest = [element]
        while rest:
            node = rest.pop()
            rest += reversed(self._nested.get(node, [])) if node not in found else []
            found[node] = None
        return [node for node in found if node.tag != _GROUP]

    def lets(self) -> Iterator[LetGroup]:
        """Yield the groups that execute in a LET interval."""
        for element in self._elements:
            for ref in self._tree.refs(element, "LET-INTERVAL-REFS/LET-INTERVAL-REF"):
                chain = self._tree.find(ref, self._what, (CHAIN,))
                if chain is not None:
                    members = ordered_by(self._tree, self.leaves(element))
                    yield LetGroup(place_of(self._node), chain.path, tuple(members))

    def _report_lost(self, element: Node) -> None:
        for tag in _NOT_READ:
            for found, file in element.elements(tag):
                message = f"{tag} is not imported"
                help = "state what it means for the tasks in the overlay (offset, precedence)"
                self._tree.findings.report(codes.ORDER_LOST, message, at=place(found, file), path=self._what, help=help)


def ordered_by(tree: Tree, elements: Iterable[Node]) -> Iterator[Ordered]:
    """Yield the runnables or events that elements of an execution order name."""
    for element in elements:
        ref = tree.ref(element, "EXECUTABLE-REF") or tree.ref(element, "EVENT-REF")
        target = tree.find(ref, f'{element.tag} "{element.path}"') if ref else None
        prototype = tree.ref(element, PROTOTYPE)
        if target is not None:
            yield Ordered(target.path, prototype.path if prototype else None)


def _point_orders(tree: Tree, node: Node) -> Iterator[Order]:
    """Yield an order of everything before a synchronisation point and everything after it."""
    ends: list[list[Ordered]] = []
    for side in ("SOURCE", "TARGET"):
        elements = tree.targets(node, f"{side}-EEC-REFS/{side}-EEC-REF", _ELEMENTS)
        events = tree.targets(node, f"{side}-EVENT-REFS/{side}-EVENT-REF")
        leaves = [leaf for element in elements for leaf in _unfolded(tree, element)]
        ends.append([*ordered_by(tree, leaves), *(Ordered(event.path) for event in events)])
    for first in ends[0]:
        for second in ends[1]:
            yield Order(place_of(node), first, second)


def _unfolded(tree: Tree, element: Node) -> list[Node]:
    constraint = element.parent
    if element.tag != _GROUP or constraint is None:
        return [element]
    return _Constraint(tree, constraint).leaves(element)


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
SYNCHRONISATION = "SYNCHRONIZATION-TIMING-CONSTRAINT"
_RUNNABLE_EVENTS = {
    "TD-EVENT-SWC-INTERNAL-BEHAVIOR": "RUNNABLE-REF",
    "TD-EVENT-BSW-INTERNAL-BEHAVIOR": "BSW-MODULE-ENTITY-REF",
}
_DATA_EVENT = "TD-EVENT-VARIABLE-DATA-PROTOTYPE"
_HAPPENINGS = ("activated", "started", "terminated", "sent", "received")


def read_timing(tree: Tree) -> Timing:
    """Read everything of the timing extension that has a counterpart in the model; report the rest."""
    lets = [let for node in required(tree, _EOC) for let in _Constraint(tree, node).lets()]
    for node in required(tree, *CONSTRAINTS):
        _report_lost_parts(tree, node, {let.interval for let in lets})
    return Timing(
        observables=tuple(filter(None, (_observable(tree, n) for n in tree.tagged(*_RUNNABLE_EVENTS, _DATA_EVENT)))),
        chains=tuple(_chain(tree, node) for node in tree.tagged(CHAIN)),
        arrivals=tuple(filter(None, (_arrival(tree, node) for node in required(tree, *_ARRIVALS)))),
        limits=tuple(filter(None, (_limit(tree, node) for node in required(tree, LATENCY, AGE)))),
        distances=tuple(filter(None, (_distance(tree, node) for node in required(tree, OFFSET)))),
        synchronisations=tuple(filter(None, (_synchronisation(tree, n) for n in required(tree, SYNCHRONISATION)))),
        lets=tuple(lets),
    )


def required(tree: Tree, *tags: str) -> list[Node]:
    """Return the constraints of the given kinds that are no guarantees."""
    return [node for node in tree.tagged(*tags) if not is_guarantee(node)]


# ------------------------------------------------------------------------------------------------ observables


def _observable(tree: Tree, node: Node) -> Observable | None:
    stated = tree.text(node, f"{node.tag}-TYPE")
    words = (stated.text if stated else "").lower().split("-")
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
    runnable = tree.target(node, _RUNNABLE_EVENTS[node.tag], RUNNABLES)
    return Observable(place=place_of(node), what=what, subject=runnable.path, prototype=prototype) if runnable else None


def _chain(tree: Tree, node: Node) -> EventChain:
    return EventChain(
        place=place_of(node),
        stimulus=tree.path_at(node, "STIMULUS-REF"),
        response=tree.path_at(node, "RESPONSE-REF"),
        segments=tuple(s.path for s in tree.targets(node, "SEGMENT-REFS/SEGMENT-REF", (CHAIN,)) if s is not node),
    )


# ------------------------------------------------------------------------------------------------ constraints


def _time(tree: Tree, node: Node, child: str) -> Duration | None:
    return cse_time(tree, node, child, codes.BAD_TIME)


def _arrival(tree: Tree, node: Node) -> Arrival | None:
    event = tree.path_at(node, "EVENT-REF")
    stated = {_PERIODIC: "PERIOD", _CONCRETE: "PATTERN-PERIOD"}.get(node.tag, "MINIMUM-INTER-ARRIVAL-TIME")
    period = _time(tree, node, stated)
    offsets: tuple[Duration, ...] | None = None
    if node.tag == _PERIODIC:
        offsets = (ZERO,)
    elif node.tag == _CONCRETE:
        offsets = _times(tree, node, "OFFSETS")
    elif node.tag == _ARBITRARY:
        period = next(iter(_times(tree, node, "MINIMUM-DISTANCES") or ()), None)
    if event is None:
        return None
    if not period or (node.tag == _CONCRETE and not offsets):
        message = "states no time between occurrences that can be used"
        help = "state a positive period, or the least time between two occurrences"
        node.report(tree.findings, codes.BAD_TIME, message, help=help)
        return None
    jitter = _time(tree, node, "JITTER") if node.tag == _PERIODIC else _time(tree, node, "PATTERN-JITTER")
    return Arrival(place=place_of(node), event=event, period=period, offsets=offsets, jitter=jitter)


def _times(tree: Tree, node: Node, path: str) -> tuple[Duration, ...] | None:
    """Return the times of a list, None if one of them cannot be read; report parts that state different ones."""
    lists = (Stated(" ".join(" ".join(e.itertext()).split()), place(e, file), e) for e, file in node.elements(path))
    stated = tree.agreed(node, path, lists)
    found = []
    for element in stated.element if stated is not None and stated.element is not None else ():
        texts = {local(child): child.text or "" for child in element.iterchildren("*")}
        found.append(parse_cse(texts.get("CSE-CODE", ""), texts.get("CSE-CODE-FACTOR", "")))
    times = tuple(time for time in found if time is not None)
    return times if len(times) == len(found) else None


def _limit(tree: Tree, node: Node) -> Limit | None:
    scope = tree.path_at(node, "SCOPE-REF")
    maximum = _time(tree, node, "MAXIMUM")
    if scope is None or not maximum:
        return None
    kind = tree.text(node, "LATENCY-CONSTRAINT-TYPE")
    is_age = node.tag == AGE or (kind is not None and kind.text.upper() == "AGE")
    return Limit(place=place_of(node), scope=scope, maximum=maximum, is_age=is_age)


def _distance(tree: Tree, node: Node) -> Distance | None:
    source, target = tree.path_at(node, "SOURCE-REF"), tree.path_at(node, "TARGET-REF")
    if source is None or target is None:
        return None
    low, high = _time(tree, node, "MINIMUM"), _time(tree, node, "MAXIMUM")
    if low is None and high is None:
        return None
    return Distance(place=place_of(node), source=source, target=target, minimum=low, maximum=high)


def _synchronisation(tree: Tree, node: Node) -> Synchronisation | None:
    """Read which events are to occur together; report what has no counterpart in the model."""
    events = tuple(event.path for event in tree.targets(node, "SCOPE-EVENT-REFS/SCOPE-EVENT-REF"))
    tolerance = _time(tree, node, "TOLERANCE")
    if len(events) > 1 and tolerance is not None:
        return Synchronisation(place_of(node), events, tolerance)
    why = "it names event chains" if tree.refs(node, "SCOPE-REFS/SCOPE-REF") else "it lacks events or a tolerance"
    message = f"is not imported: {why}"
    help = "state the order and the window in the overlay (precedence)"
    node.report(tree.findings, codes.TIMING_IGNORED, message, help=help)
    return None


def _report_lost_parts(tree: Tree, node: Node, intervals: Container[str]) -> None:
    """Report the parts of a constraint that nothing is made of: lower and nominal limits, conditions.

    The length of a LET interval (a path of `intervals`) has the same lower and upper limit.
    """
    lost = [tag for tag in ("MINIMUM", "NOMINAL") if node.tag in (LATENCY, AGE) and _time(tree, node, tag)]
    scope = tree.ref(node, "SCOPE-REF")
    if scope is not None and scope.path in intervals and _time(tree, node, "MINIMUM") == _time(tree, node, "MAXIMUM"):
        lost = [tag for tag in lost if tag != "MINIMUM"]
    lost += [tag for tag in ("TIMING-CONDITION-REF",) if node.elements(tag)]
    if node.tag == _PERIODIC and (least := _time(tree, node, "MINIMUM-INTER-ARRIVAL-TIME")):
        period, jitter = _time(tree, node, "PERIOD") or ZERO, _time(tree, node, "JITTER") or ZERO
        lost += ["MINIMUM-INTER-ARRIVAL-TIME"] if least + jitter > period else []
    if lost:
        message = f"{', '.join(lost)} of the constraint is not imported"
        help = "state it in the overlay, if the schedule has to keep it"
        node.report(tree.findings, codes.TIMING_PART_LOST, message, help=help)
