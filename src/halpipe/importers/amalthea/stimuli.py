"""Activation of tasks: each stimulus as the densest periodic activations that it allows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.values import most

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
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


def _time(forest: Forest, item: Item, *tags: str) -> Duration | None:
    child = item.one(*tags)
    return None if child is None else forest.time(child)


def _recurrence(forest: Forest, stimulus: Item) -> Duration | None:
    return _time(forest, stimulus, "recurrence", "period") or None  # until 0.8.3 a synthetic stimulus has a period


def _report_jitter(forest: Forest, stimulus: Item) -> None:
    """Report a deviation of periodic activations; that of sporadic ones is the distance of their arrivals."""
    jitter = stimulus.one("jitter", "stimulusDeviation")
    if stimulus.kind not in SPORADIC and jitter is not None and (jitter.children or stimulus.kind in PERIODIC):
        help = "state slack in an overlay, if starts may vary"
        forest.report(codes.JITTER, "states a jitter, which is not imported", stimulus, help)


def _periodic(forest: Forest, stimulus: Item) -> list[Activation]:
    period = _recurrence(forest, stimulus)
    return [Activation(period, _time(forest, stimulus, "offset"), stimulus)] if period else []


def _synthetic(forest: Forest, stimulus: Item) -> list[Activation]:
    """One activation for each occurrence in the recurrence, or one in all if they are equally far apart."""
    period = _recurrence(forest, stimulus)
    listed = [stamp for found in stimulus.all("triggerTimes") for stamp in found.all("timestamps", "timeStamps")]
    times = [forest.time(item) for item in (*stimulus.all("occurrenceTimes"), *listed)]
    if not period or not times or len(times) > _MOST_OCCURRENCES:
        return []
    first = _time(forest, stimulus, "offset") or ZERO
    return _spread(period, [first + time for time in times if time is not None], stimulus)


def _burst(forest: Forest, stimulus: Item) -> list[Activation]:
    """A burst is so many occurrences at their least distance, at the start of every recurrence."""
    period, first = _recurrence(forest, stimulus), _time(forest, stimulus, "offset") or ZERO
    stated = forest.number(stimulus, "occurrenceCount")
    count = 1 if stated is None else int(stated)
    if not period or not 0 < count <= _MOST_OCCURRENCES:
        return []
    length = _time(forest, stimulus, "burstLength") or ZERO
    distance = _time(forest, stimulus, "occurrenceMinDistance") or (length / count)
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
    step, count = _time(forest, stimulus, "step"), stimulus.one("occurrencesPerStep")
    stated = forest.number(stimulus, "occurrencesPerStep") if count is None else most(forest, count)
    return step / stated if step and stated and stimulus.one("scenario") is None else None


def _shortest(forest: Forest, deviation: Item | None) -> Duration | None:
    """Return the least time of a constant or a distribution of times."""
    if deviation is None:
        return None
    for tag in ("lowerBound", "value"):
        if (found := deviation.one(tag)) is not None:
            return forest.time(found)
    entries = [_shortest(forest, entry) for entry in deviation.all("entries")]
    known = [entry for entry in entries if entry is not None]
    return min(known) if known else None


def _curve(forest: Forest, stimulus: Item) -> Duration | None:
    """Return the least distance of two occurrences."""
    for entry in stimulus.all("entries", "arrivalCurveEntries"):
        if forest.number(entry, "numberOfOccurrences") == 2:
            return _time(forest, entry, "lowerTimeBorder")
    return None
