"""From drafts, versions and constraints to the tasks and chains of the model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import everything
from halpipe.importers.amalthea.timing import Timing, Window
from halpipe.importers.amalthea.versions import Instant, VersionMaker, preemption_of
from halpipe.importers.common.names import legal
from halpipe.models import Anchor, Binding, Chain, Match, Origin, Task, Version

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.amalthea.hardware import Hardware, Pu
    from halpipe.importers.amalthea.mapping import Allocations
    from halpipe.importers.amalthea.parts import Draft, Drafts, Part, Trigger
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Coverage

_MICROSECOND = Duration(1000)
FREE = Fraction(1)
"""The slack of an imported task: a job may start any time within a period of its activation, within its deadline."""


@dataclass(slots=True)
class Built:
    """The tasks and chains, the versions of each task by mode, and the memories that are used."""

    tasks: tuple[Task, ...]
    chains: tuple[Chain, ...]
    by_mode: dict[str, Mapping[str, Sequence[str]]]
    resources: list[str]


_Limits = tuple[Fraction, "Duration | None"]
"""Slack and deadline of a draft."""


@dataclass(slots=True)
class TaskBuilder:
    """Builds tasks; every value that no file states goes to the coverage report as a default."""

    _forest: Forest
    _hardware: Hardware
    _mapping: Allocations | None
    _maker: VersionMaker
    _coverage: Coverage
    _untimed: list[Item] = field(default_factory=list)
    _next: dict[Draft, Duration | None] = field(default_factory=dict)
    """The time to the next activation of the task."""
    _spare: dict[Draft, Duration] = field(default_factory=dict)
    """How long after its trigger a task that waits starts."""
    _parts: Mapping[Item, Sequence[Part]] = field(default_factory=dict)
    _made: dict[Draft, tuple[Version, ...]] = field(default_factory=dict)
    _by_mode: dict[str, Mapping[str, Sequence[str]]] = field(default_factory=dict)
    _resources: dict[str, None] = field(default_factory=dict)
    _unbound: list[Item] = field(default_factory=list)
    _unlimited: list[Item] = field(default_factory=list)
    """Tasks with a limit that the model has no instant for."""
    _early: list[Item] = field(default_factory=list)
    """Tasks that may start later by their limit than the model lets them."""

    def build(self, drafts: Drafts, timing: Timing) -> Built:
        """Return the tasks in the order of the drafts, and the chains."""
        for draft in drafts.items:
            self._next[draft] = _to_next(draft, drafts)
            several = sum(other.part is draft.part for other in drafts.of(draft.task)) > 1
            self._versions(draft, several=several)
        if self._mapping is not None and len(self._hardware.units) > 1:
            help = "bind them under units: in an overlay, or leave the choice to the scheduler"
            what = f"of {len(drafts.items)} tasks are bound to no unit"
            self._forest.report_each(codes.UNMAPPED, what, self._unbound, help)
        chains = [self._chain(chain.name, chain.drafts, chain.item, **chain.stated) for chain in timing.chains]
        limits = {
            draft: (FREE, None) if draft.part.index else self._limits(draft, drafts, timing, chains)
            for draft in drafts.items
        }
        precedences = self._precedences(drafts, timing)
        self._parts = drafts.parts
        tasks = tuple(self._task(draft, limits[draft], precedences) for draft in drafts.items)
        help = "let a periodic task without waits make them, or state the LET in an overlay"
        what = "timed accesses are made by tasks that wait, are triggered or poll, or by activations that meet"
        self._forest.report_each(codes.NOT_READ, what, list(dict.fromkeys(self._untimed)), help)
        help = "state what matters of them as deadline, slack or precedence in an overlay"
        what = "limits of tasks count from instants that the model does not have"
        self._forest.report_each(codes.NOT_IMPORTED, what, list(dict.fromkeys(self._unlimited)), help)
        help = "let the limit be a period and the execution time at most, if a schedule is to use all of it"
        what = "response times may exceed a period, but jobs start within one of their activation"
        self._forest.report_each(codes.STRICTER, what, list(dict.fromkeys(self._early)), help)
        return Built(tasks, tuple(chains), self._by_mode, list(self._resources))

    # --------------------------------------------------------------------------------------- versions

    def _versions(self, draft: Draft, *, several: bool) -> None:
        """Make the versions of a draft; jobs of one task never overlap, so one with several activations is a lock."""
        bound = None if self._mapping is None else self._mapping.units(draft.task)
        candidates = self._candidates(draft, bound)
        made = self._maker.make(draft, candidates)
        alone = several and len(candidates) > 1
        self._made[draft] = tuple(map(self._maker.alone(draft), made.items) if alone else made.items)
        self._by_mode[draft.name] = made.by_mode
        self._resources |= {a.resource: None for v in self._made[draft] for a in v.accesses}

    def _candidates(self, draft: Draft, bound: Sequence[Item] | None) -> list[Pu]:
        if bound is not None:
            return [unit for unit in self._hardware.units if unit.item in bound]
        if draft.part.index == 0:
            self._unbound.append(draft.task)
        return list(self._hardware.units)

    # ------------------------------------------------------------------------------------------ limits

    def _limits(self, draft: Draft, drafts: Drafts, timing: Timing, chains: list[Chain]) -> _Limits:
        """Return the limits of a task, or of the first part of a task that waits."""
        deadline = timing.deadlines.get(draft.task)
        if draft.activation is None:
            return Fraction(0), None
        whole = self._whole(draft, drafts)
        if len(whole) > 1:
            if draft.task in timing.most_between_starts:
                self._unlimited.append(draft.task)
            return self._waiting(draft, whole, deadline, chains)
        latest = draft.activation.distance or draft.activation.period
        if deadline is not None and deadline > latest + min(v.wcet or ZERO for v in self._made[draft]):
            self._early.append(draft.task)
        deadline = None if draft.trigger is not None else deadline  # of a trigger, a window
        most = timing.most_between_starts.get(draft.task)
        if most is not None:
            return self._slack(draft, drafts, most), deadline
        at = draft.task.at
        self._coverage.defaulted(f'task "{draft.name}"', "slack", "1: starts within a period and the deadline", at)
        return FREE, deadline

    def _slack(self, draft: Draft, drafts: Drafts, most: Duration) -> Fraction:
        """Return by how much starts may be late, as a share of the period, so that they are at most so far apart."""
        gaps = [self._next[other] for other in drafts.of(draft.task) if other.modes & draft.modes]
        known = [gap for gap in gaps if gap is not None]
        assert draft.activation is not None
        if len(known) < len(gaps):
            self._unlimited.append(draft.task)
            return FREE
        mean = draft.activation.period / len(known)
        if most < mean:
            message = f"starts are to be at most {most} apart, but activations are {mean} apart on average"
            self._forest.report(codes.STARTS_APART, message, draft.task, f"set the limit to at least {mean}")
        elif most < max(known):  # a late start could keep it, but the slack of one activation alone cannot say so
            self._unlimited.append(draft.task)
            return FREE
        return min(FREE, max(Fraction(0), (most - max(known)) / draft.activation.period))

    def _whole(self, first: Draft, drafts: Drafts) -> list[Draft]:
        """Return the parts of a task from its first on, each after what it waits for."""
        path, last = [first], first
        for draft in drafts.of(first.task):
            if draft.part.index and last in draft.after:
                path += [source for source in draft.after if source not in path]
                path.append(draft)
                last = draft
        return path

    def _waiting(self, draft: Draft, whole: Sequence[Draft], deadline: Duration | None, chains: list[Chain]) -> _Limits:
        """Limit a task that waits: its first part starts within its slack, and the age of the whole takes the rest.

        Half of the time that is not spent working, in whole microseconds, is the slack of the first part, so that the
        response time of the whole, from activation to the end of the last part, is at most the deadline. Of several
        versions, the longest with which that can be counts.
        """
        assert draft.activation is not None
        name = f"{draft.name}.response"
        if deadline is None:
            chains.append(self._chain(name, whole, draft.task))
            return FREE, None
        work = _longest_within(deadline, [[v.wcet or ZERO for v in self._made[d]] for d in whole])
        spare = _MICROSECOND * (max(ZERO, deadline - work) / 2 // _MICROSECOND)
        if draft.trigger is None:
            spare = min(spare, draft.activation.period)  # no start is later; the rest is for the work
        what = f"{spare} for its start, {deadline - spare} from there to the end of its last part"
        self._coverage.defaulted(f'task "{draft.name}"', "deadline of a task that waits", what, draft.task.at)
        chains.append(self._chain(name, whole, draft.task, max_age=deadline - spare))
        if draft.trigger is not None:
            self._spare[draft] = spare
            return FREE, None
        return spare / draft.activation.period, None

    def _chain(self, name: str, drafts: Sequence[Draft], item: Item, **limits: Any) -> Chain:
        return Chain(name=name, tasks=tuple(d.name for d in drafts), origin=item.origin, **limits)

    # -------------------------------------------------------------------------------------- precedence

    def _precedences(self, drafts: Drafts, timing: Timing) -> dict[Draft, list[Window]]:
        found: dict[Draft, list[Window]] = {draft: [] for draft in drafts.items}
        for draft in drafts.items:
            found[draft] += self._orders(draft, self._response(draft, drafts, timing))
        for window in timing.windows:
            found[window.later].append(window)
        assumed = [window for windows in found.values() for window in windows if window.high is None]
        if assumed:
            at = assumed[0].cause.at
            message = f"{len(assumed)} precedence constraints have windows of one period"
            help = "state tighter windows under precedence: in an overlay"
            self._forest.findings.add(codes.DEFAULT_WINDOW(message, at=at, help=help))
        for window in assumed:
            value = f"from the end of {window.earlier.name}: {window.low} to {window.end}"
            self._coverage.defaulted(f'task "{window.later.name}"', "precedence window", value, window.cause.at)
        return found

    def _orders(self, draft: Draft, response: Window | None) -> list[Window]:
        """Return the windows after what activates a draft, each job after the one that triggers it where that matters.

        It does where a response time counts from it, and where a counter says which jobs trigger.
        """
        trigger = draft.trigger
        if trigger is None:
            return [Window(source, draft, cause) for source, cause in draft.after.items()]
        source, _, (anchor, point) = self._instants(trigger)
        order = Window(source, draft, trigger.cause, anchor=anchor, point=point)
        if response is None:
            return [order if trigger.count.each == 1 else replace(order, match=Match.CYCLE)]
        return [replace(order, high=response.high, match=Match.CYCLE), response]

    def _instants(self, trigger: Trigger) -> tuple[Draft, Instant, Instant]:
        """Return the first and the last instant of a trigger, and the draft that they are instants of.

        The activation of a triggered task is that of its trigger. That of a polled task is no instant of the model: the
        start, which is later, serves for the order.
        """
        kind = trigger.cause.get("eventType")
        while trigger.step is None and kind == "activate" and trigger.source.trigger is not None:
            trigger = trigger.source.trigger
            kind = trigger.cause.get("eventType")
        source = trigger.source
        if trigger.step is not None:
            return source, *self._maker.instants(trigger)
        anchor = {"activate": Anchor.RELEASE, "terminate": Anchor.END}.get(kind, Anchor.START)
        if anchor is Anchor.RELEASE and source.release is None:
            anchor = Anchor.START
        return source, (anchor, None), (anchor, None)

    def _response(self, draft: Draft, drafts: Drafts, timing: Timing) -> Window | None:
        """Return the window of a response time that counts from the trigger: to the end, for the job of its cycle."""
        limit, trigger = timing.deadlines.get(draft.task), draft.trigger
        is_whole = len(self._whole(draft, drafts)) == 1  # else the rest of the limit is that of a chain
        if limit is None or trigger is None or (not is_whole and draft not in self._spare):
            return None
        source, (anchor, point), _ = self._instants(trigger)
        if trigger.cause.get("eventType") == "activate" and source.release is None:
            self._unlimited.append(draft.task)  # of a polled task: the arrival
        high = limit if is_whole else self._spare[draft]
        return Window(
            source, draft, draft.task, high=high, anchor=anchor, to_end=is_whole, point=point, match=Match.CYCLE
        )

    def _binding(self, draft: Draft) -> Binding:
        """Return `system` for a task that is allocated to one unit: a job of it never runs elsewhere."""
        bound = None if self._mapping is None else self._mapping.units(draft.task)
        return Binding.SYSTEM if bound is not None and len(bound) == 1 else Binding.JOB

    def _let(self, draft: Draft, deadline: Duration | None) -> Duration | None:
        """Return the logical execution time of a task with timed accesses: up to its deadline or next activation.

        A task that waits, is triggered or polls has none in the model. Other accesses of the task are taken as timed,
        too, which makes data older, never younger.
        """
        steps = [s for s in everything(self._forest, draft.part.steps) if s.kind == "LabelAccess"]
        timed = [step for step in steps if step.get("implementation") == "timed"]
        if not timed:
            return None
        longest = self._next[draft]
        if draft.release is None or len(self._parts[draft.task]) > 1 or not longest:
            self._untimed += timed
            return None
        if len(timed) < len(steps):
            at = draft.task.at
            self._coverage.defaulted(f'task "{draft.name}"', "logical execution time", "all accesses are timed", at)
        return longest if deadline is None else min(longest, deadline)

    def _task(self, draft: Draft, limits: _Limits, windows: Mapping[Draft, Sequence[Window]]) -> Task:
        at = draft.task.at
        rows = tuple(window.precedence() for window in windows[draft])
        versions = tuple(replace(version, precedences=rows) for version in self._made[draft])
        if not preemption_of(draft.task):
            self._coverage.defaulted(f'task "{draft.name}"', "preemption", "none: jobs run in one piece", at)
        return Task(
            name=draft.name,
            period=None if draft.activation is None else draft.activation.period,
            slack=limits[0],
            offset=None if draft.activation is None else draft.activation.offset,
            deadline=limits[1],
            distance=None if draft.activation is None else draft.activation.distance,
            binding=self._binding(draft),
            let=self._let(draft, limits[1]),
            versions=versions,
            origin=Origin(at.file, at.line, legal(draft.task.name)),
        )


def _to_next(draft: Draft, drafts: Drafts) -> Duration | None:
    """Return the time from an activation to the next one of the task; None where the model does not say it."""
    others = [d for d in drafts.of(draft.task) if d.part is draft.part and (d is draft or d.modes & draft.modes)]
    own = draft.activation
    if own is None or own.distance is not None:
        return None
    if len(others) == 1:
        return own.period
    offsets = []
    for other in others:
        known = other.activation
        if known is None or other.modes != draft.modes or known.period != own.period or known.offset is None:
            return None
        offsets.append(known.offset % known.period)
    first = (own.offset or ZERO) % own.period
    later = [(offset - first) % own.period for offset in offsets]
    return ZERO if later.count(ZERO) > 1 else min((gap for gap in later if gap), default=own.period)


def _longest_within(limit: Duration, choices: Sequence[Sequence[Duration]]) -> Duration:
    """Return the longest sum of one time of each list that is within a limit; the shortest, if none is."""
    sums = {ZERO}
    for times in choices:
        sums = {known + time for known in sums for time in times or (ZERO,)}
    return max((found for found in sums if found <= limit), default=min(sums))
