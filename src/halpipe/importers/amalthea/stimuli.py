"""Activation of tasks: stimuli as the densest periodic activations that they allow, and triggers within graphs.

A counter lets every `prescaler`-th occurrence pass, the first after `offset` others. Counters stand at stimuli, at
triggers and at the calls of runnables that trigger.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import CALLS, SWITCHES, call_count, candidates, most, steps

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.amalthea.modes import Conditions
    from halpipe.importers.amalthea.xmi import Forest, Item

PERIODIC = ("PeriodicStimulus", "Periodic")
SYNTHETIC = ("PeriodicSyntheticStimulus", "PeriodicSynthetic", "SyntheticStimulus", "Synthetic")
BURST = ("PeriodicBurstStimulus", "PeriodicBurst")
SPORADIC = ("RelativePeriodicStimulus", "SporadicStimulus", "Sporadic")
CURVE = ("ArrivalCurveStimulus", "ArrivalCurve")
VARIABLE = ("VariableRateStimulus", "VariableRate")
TRIGGERED = ("InterProcessStimulus", "InterProcess", "EventStimulus")
_MOST_OCCURRENCES = 1000


@record
class Activation:
    """A periodic activation; `offset` is None where the stimulus states none.

    With `distance` it stands for sporadic arrivals at least so far apart; then the period is that of polling.
    """

    period: Duration
    offset: Duration | None
    stimulus: Item | None
    distance: Duration | None = None


def activations_of(forest: Forest, stimulus: Item) -> list[Activation]:
    """Return the periodic activations that cover what a stimulus does; none where it has no period."""
    if stimulus.kind in PERIODIC:
        found = _periodic(forest, stimulus)
    elif stimulus.kind in SYNTHETIC:
        found = _synthetic(forest, stimulus)
    elif stimulus.kind in BURST:
        found = _burst(forest, stimulus)
    elif stimulus.kind in SPORADIC:
        found = _densest(stimulus, _shortest(forest, stimulus.one("nextOccurrence", "stimulusDeviation")))
    elif stimulus.kind in CURVE:
        found = _densest(stimulus, _curve(forest, stimulus))
    elif stimulus.kind in VARIABLE:
        found = _densest(stimulus, _step(forest, stimulus))
    else:
        found = []
    if found:
        stimulus.use()
        _report_jitter(forest, stimulus)
    return found


def _recurrence(forest: Forest, stimulus: Item) -> Duration | None:
    return forest.time(stimulus.one("recurrence", "period")) or None  # until 0.8.3 a synthetic stimulus has a period


def _report_jitter(forest: Forest, stimulus: Item) -> None:
    """Report a deviation of periodic activations; that of sporadic ones is the distance of their arrivals."""
    jitter = stimulus.one("jitter", "stimulusDeviation")
    if stimulus.kind not in SPORADIC and jitter is not None and (jitter.children or stimulus.kind in PERIODIC):
        help = "state slack in an overlay, if starts may vary"
        forest.report(codes.JITTER, "states a jitter, which is not imported", stimulus, help)


def _periodic(forest: Forest, stimulus: Item) -> list[Activation]:
    period = _recurrence(forest, stimulus)
    return [Activation(period, forest.time(stimulus.one("offset")), stimulus)] if period else []


def _synthetic(forest: Forest, stimulus: Item) -> list[Activation]:
    """One activation for each occurrence in the recurrence, or one in all if they are equally far apart."""
    period = _recurrence(forest, stimulus)
    listed = [stamp for found in stimulus.all("triggerTimes") for stamp in found.all("timestamps", "timeStamps")]
    times = [forest.time(item) for item in (*stimulus.all("occurrenceTimes"), *listed)]
    if not period or not times or len(times) > _MOST_OCCURRENCES:
        return []
    first = forest.time(stimulus.one("offset")) or ZERO
    return _spread(period, [first + time for time in times if time is not None], stimulus)


def _burst(forest: Forest, stimulus: Item) -> list[Activation]:
    """A burst is so many occurrences at their least distance, at the start of every recurrence."""
    period, first = _recurrence(forest, stimulus), forest.time(stimulus.one("offset")) or ZERO
    stated = forest.number(stimulus, "occurrenceCount")
    count = 1 if stated is None else int(stated)
    if not period or not 0 < count <= _MOST_OCCURRENCES:
        return []
    length = forest.time(stimulus.one("burstLength")) or ZERO
    distance = forest.time(stimulus.one("occurrenceMinDistance")) or (length / count)
    if length > distance * (count - 1):
        message = f"states a burst of {length}, in which occurrences may come later than at their least distance"
        forest.report(codes.JITTER, message, stimulus, "state its activations in an overlay, or as sporadic ones")
    return _spread(period, [first + distance * index for index in range(count)], stimulus)


def _spread(period: Duration, times: Sequence[Duration], stimulus: Item) -> list[Activation]:
    offsets = sorted(time % period for time in times)  # equal times activate as often as they are stated
    if not offsets:
        return []
    step = period / len(offsets)
    if all(offset == offsets[0] + step * index for index, offset in enumerate(offsets)):
        return [Activation(step, offsets[0], stimulus)]
    return [Activation(period, offset, stimulus) for offset in offsets]


def _densest(stimulus: Item, distance: Duration | None) -> list[Activation]:
    """Return arrivals at their least distance; the period of polling follows from all others."""
    return [Activation(distance, None, stimulus, distance)] if distance else []


def _step(forest: Forest, stimulus: Item) -> Duration | None:
    """Return the least distance of the occurrences of a rate that no scenario changes; None where one does."""
    step, count = forest.time(stimulus.one("step")), stimulus.one("occurrencesPerStep")
    stated = most(forest, count) if count else forest.number(stimulus, "occurrencesPerStep")
    return step / stated if step and stated and stimulus.one("scenario") is None else None


def _shortest(forest: Forest, deviation: Item | None) -> Duration | None:
    """Return the least time of a constant or a distribution of times."""
    if deviation is None:
        return None
    if (found := deviation.one("lowerBound") or deviation.one("value")) is not None:
        return forest.time(found)
    entries = [_shortest(forest, entry) for entry in deviation.all("entries")]
    known = [entry for entry in entries if entry is not None]
    return min(known) if known else None


def _curve(forest: Forest, stimulus: Item) -> Duration | None:
    """Return the least distance of two occurrences."""
    entries = stimulus.all("entries", "arrivalCurveEntries")
    pairs = (entry for entry in entries if forest.number(entry, "numberOfOccurrences") == 2)
    found = (forest.time(entry.one("lowerTimeBorder")) for entry in pairs)
    return min((time for time in found if time is not None), default=None)


TRIGGERS = {"InterProcessTrigger": "stimulus", "InterProcessActivation": "stimulus", "CustomEventTrigger": "event"}
MOST = 1000
"""Activations of a task, and triggers of a job."""
_MOST_LEVELS = 100


@record
class Count:
    """Every `each`-th occurrence passes, the first after `first` others."""

    each: int = 1
    first: int = 0

    def then(self, inner: Count) -> Count:
        """Return what passes both counters, this one first."""
        return Count(self.each * inner.each, self.first + self.each * inner.first)


@record
class Occurrence:
    """A trigger of a stimulus or event, or a call of a runnable (`target`), within the step `top` of a job."""

    target: Item
    cause: Item
    top: Item
    count: Count = Count()


def thinned(number: int, count: Count) -> list[Count] | None:
    """Return what passes of `number` occurrences in each job; None if jobs differ in how many pass."""
    if count.each == 1:
        return [Count()] * number
    if number == 1:
        return [count]
    if number % count.each == 0:
        return [Count()] * (number // count.each)
    return [Count(count.each // number, count.first // number)] if count.each % number == 0 else None


class Triggers:
    """Finds the occurrences; `unread` collects the counters that are not followed, so that more occurrences pass.

    `counted` collects calls with counters: what they trigger is thinned, but their work counts in each job.
    """

    def __init__(self, forest: Forest) -> None:
        self._forest = forest
        self._of_runnable: dict[tuple[Item, Conditions], list[Occurrence]] = {}
        self._calling: set[Item] = set()
        self.unread: dict[Item, None] = {}
        self.counted: dict[Item, None] = {}
        self.is_too_much = False
        events = [e for s in forest.kinds("EventStimulus") for e in forest.refs(s, "triggeringEvents")]
        self._wanted = {forest.ref(event, "entity") for event in events if event.kind == "RunnableEvent"}

    def of(self, found: Iterable[Item], conditions: Conditions) -> list[Occurrence]:
        """Return what some steps of a job trigger and call in a mode, each as often as they do."""
        return self._followed(self._steps(found, conditions))

    def counter(self, item: Item) -> Count:
        """Return the counter of a stimulus or a step."""
        counter = item.one("counter")
        if counter is None:
            return Count()
        each, first = self._forest.number(counter, "prescaler"), self._forest.number(counter, "offset")
        return Count(max(1, int(each or 1)), int(first or 0))

    def _followed(self, made: Sequence[Occurrence]) -> list[Occurrence]:
        """Return the occurrences with counters that count all of one job together."""
        groups = grouped(((one.target, one.cause, one.count), one) for one in made)
        found = []
        for (target, cause, count), same in groups.items():
            passing = thinned(len(same), count)
            if passing is None:
                self.unread[cause] = None
                passing = [Count()] * len(same)
            found += [Occurrence(target, cause, same[0].top, each) for each in passing]
        return found

    def _step(self, step: Item, conditions: Conditions) -> list[Occurrence]:
        if step.kind in TRIGGERS:
            target = self._forest.ref(step, TRIGGERS[step.kind])
            return [] if target is None else [Occurrence(target, step, step, self.counter(step))]
        if step.kind in CALLS:
            called = self._forest.ref(step, CALLS[step.kind])
            return [] if called is None else self._call(step, called, conditions)
        if step.kind in SWITCHES:
            ways = [self._steps(steps(entry), conditions) for entry in candidates(step, conditions)]
            return self._densest(ways, step)
        return [Occurrence(o.target, o.cause, step, o.count) for o in self._steps(steps(step), conditions)]

    def _steps(self, found: Iterable[Item], conditions: Conditions) -> list[Occurrence]:
        made = [occurrence for step in found for occurrence in self._step(step, conditions)]
        self.is_too_much = self.is_too_much or len(made) > MOST
        return made[:MOST]

    def _call(self, step: Item, called: Item, conditions: Conditions) -> list[Occurrence]:
        if called in self._calling:
            return []  # which is an error wherever times are added up
        if len(self._calling) > _MOST_LEVELS:
            message = f"stands below more than {_MOST_LEVELS} calls"
            self._forest.refuse(message, called, "remove one of the calls", codes.RECURSION)
        if not conditions.allows(called):
            return []
        if (called, conditions) not in self._of_runnable:
            self._calling.add(called)
            self._of_runnable[called, conditions] = self._steps(steps(called), conditions)
            self._calling.remove(called)
        own = self.counter(step)
        if own.each > 1:
            self.counted[step] = None
        own_event = [Occurrence(called, step, step)] if called in self._wanted else []
        inner = [*own_event, *self._of_runnable[called, conditions]]
        times = min(MOST + 1, int(call_count(self._forest, step)))
        return [Occurrence(o.target, o.cause, step, own.then(o.count)) for _ in range(times) for o in inner]

    def _densest(self, ways: Sequence[Sequence[Occurrence]], step: Item) -> list[Occurrence]:
        """Return for each target the branch with most occurrences, since one branch is taken."""
        found = []
        for target in dict.fromkeys(o.target for way in ways for o in way):
            most = max(([o for o in way if o.target is target] for way in ways), key=len)
            found += [Occurrence(o.target, o.cause, step, o.count) for o in most]
        return found
