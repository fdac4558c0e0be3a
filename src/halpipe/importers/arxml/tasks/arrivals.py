"""Periods from event triggerings: how often a runnable is activated, or its data arrives, by the timing extension."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.arxml import codes
from halpipe.importers.common.polling import polling_period

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.system.values import Arrival, Observable, System
    from halpipe.importers.arxml.tasks.activation import Activation

_BEGINNINGS = ("activated", "started")


class Arrivals:
    """The event triggerings of the timing extension, by what they are about."""

    def __init__(self, system: System) -> None:
        observables = {observable.place.path: observable for observable in system.timing.observables}
        self._by_subject: dict[str, list[tuple[Observable, Arrival]]] = {}
        for arrival in system.timing.arrivals:
            observable = observables.get(arrival.event)
            if observable is not None:
                self._by_subject.setdefault(observable.subject, []).append((observable, arrival))

    @property
    def subjects(self) -> Iterable[str]:
        """The runnables and data elements (paths) that arrivals are stated for."""
        return self._by_subject.keys()

    def of(self, activation: Activation) -> Arrival | None:
        """Return how often the work of an activation begins, or the data that starts it arrives; None if unstated."""
        data = activation.event.data if activation.event else None
        found = list(self._by_subject.get(activation.place.path, ()))
        if data is not None:
            found += self._by_subject.get(data.element, ())
        for observable, arrival in found:
            if observable.prototype is not None and observable.prototype not in activation.context:
                continue
            arrives = data is not None and observable.what == "received" and observable.port == data.port
            if arrives or observable.what in _BEGINNINGS:
                return arrival
        return None


def slack_of(activation: Activation, findings: Findings) -> Fraction | None:
    """Return the jitter that a triggering allows, as a share of the period; None if none is stated.

    A triggering with jitter J lets every occurrence lie up to J after its regular instant, which is what slack is
    (MODEL, section 3: 0 <= delta <= gamma D).
    """
    arrival = activation.arrival
    if arrival is None or not arrival.jitter or not activation.period:
        return None
    if arrival.jitter <= activation.period:
        return Fraction(arrival.jitter / activation.period)
    findings.add(
        codes.TIMING_PART_LOST(
            f"JITTER {arrival.jitter} is longer than the period {activation.period}; a slack of one period is imported",
            at=arrival.place.at,
            path=named(arrival.place.kind, arrival.place.path),
            help="correct the jitter, or state the slack in the overlay",
        )
    )
    return Fraction(1)


def compare(activation: Activation, findings: Findings) -> None:
    """Report a periodic triggering that contradicts the period which an activation has from elsewhere."""
    arrival = activation.arrival
    if arrival is None or arrival.offsets is None or arrival.place in activation.used or activation.period is None:
        return
    occurrences = len(arrival.offsets)
    if arrival.period != activation.period * occurrences:
        findings.add(
            codes.TRIGGERING_DIFFERS(
                f'states the period {arrival.period / occurrences} for "{activation.name}", which has '
                f"{activation.period}",
                at=arrival.place.at,
                path=named(arrival.place.kind, arrival.place.path),
                help="make them agree; the period of the event, or of the OS, counts",
            )
        )


def polled(activations: Sequence[Activation]) -> list[Activation]:
    """Give sporadic work, which recurs at its least distance so far, the period at which it is looked for."""
    periods = [a.period for a in activations if a.period is not None and not _is_sporadic(a)]
    return [
        replace(a, distance=a.period, period=polling_period(a.period, periods), offset=None)
        if a.period is not None and _is_sporadic(a)
        else a
        for a in activations
    ]


def _is_sporadic(activation: Activation) -> bool:
    """Whether the period of an activation is the least distance of a triggering without a period."""
    arrival = activation.arrival
    return arrival is not None and arrival.offsets is None and arrival.place in activation.used


def report_sporadic(activations: Iterable[Activation], findings: Findings) -> None:
    """Report every triggering without a period, and how often it is looked for."""
    for activation in activations:
        arrival = activation.arrival
        if arrival is not None and activation.distance is not None:
            what = f"looks every {activation.period} for what comes every {activation.distance} at most"
            findings.add(
                codes.SPORADIC(
                    f'"{activation.name}" {what}',
                    at=arrival.place.at,
                    path=named(arrival.place.kind, arrival.place.path),
                    help="give another period in the overlay (sources), if occurrences so dense cannot be",
                )
            )
