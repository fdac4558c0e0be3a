"""The events of the trace (Trace Event Format): M metadata, X slices, s/f flows, C counters, i instants.

Times are microseconds, printed exactly where a decimal terminates; times that have none are rounded to 1 ns, and
``otherData`` says how many. The exact start and end of every job stand in its ``args``.
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_rational
from halpipe.exporters.common.timeline import (
    Link,
    Placement,
    Window,
    links,
    resource_steps,
    shows_context,
    unroll,
    unroll_switch,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import ModeSchedule, Schedule, TaskModel

# Constraints that reach back further than this are left out of the flows, so that the trace stays small.
MAX_CYCLES = 8


class _Number(str):
    """A JSON number as it is to be printed."""

    __slots__ = ()


def format_trace(model: TaskModel, schedule: Schedule, title: str) -> str:
    """Return the trace of every mode and every switch of `schedule`, one event per line."""
    writer = _TraceWriter(model, schedule)
    for table in schedule.modes:
        writer.mode(table)
    for position in range(len(schedule.transitions)):
        writer.transition(position)
    other = {
        "title": title or f"{model.name} schedule",
        "model": model.name,
        "model-sha256": schedule.model_sha256,
        "generator": schedule.generator,
        "time": "ts and dur are microseconds, exact unless counted as rounded; args hold the exact times",
        "rounded-to-1ns": writer.rounded,
        "rounded-counter-values": writer.rounded_values,
        "flows-left-out": writer.left_out,
    }
    events = ",\n".join(map(_json, writer.events))
    return f'{{"displayTimeUnit":"ns","otherData":{_json(other)},"traceEvents":[\n{events}\n]}}\n'


def _json(value: Any) -> str:
    if isinstance(value, _Number):
        return str(value)
    if isinstance(value, dict):
        return "{" + ",".join(f"{_json(key)}:{_json(item)}" for key, item in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False)


class _TraceWriter:
    """Collects events; a process is one mode or one switch, a thread is one unit."""

    def __init__(self, model: TaskModel, schedule: Schedule) -> None:
        self.model = model
        self.schedule = schedule
        self.threads = {unit.name: number for number, unit in enumerate(model.units, 1)}
        self.context = shows_context(schedule)
        self.events: list[dict[str, Any]] = []
        self.process = 0
        self.flow = 0
        self.rounded = 0
        self.rounded_values = 0
        self.left_out = 0

    def mode(self, table: ModeSchedule) -> None:
        """Write the repeated cycle of a mode as often as its precedence constraints reach back, plus one."""
        found = links(self.model, table)
        shown = [link for link in found if link.cycles < MAX_CYCLES]
        self.left_out += len(found) - len(shown)
        cycles = 1 + max((link.cycles for link in shown), default=0)
        window = Window(ZERO, table.hyperperiod * cycles)
        placements = unroll(table, cycles)
        self._process(f"mode {table.name}")
        for cycle in range(cycles):
            self._instant(f"cycle {cycle}", table.hyperperiod * cycle)
        self._slices(placements, window)
        for link in shown:
            self._flows(link, table, cycles)
        self._counters(placements, window)

    def transition(self, position: int) -> None:
        """Write one switch with the modes around it, shifted so that the trace starts at 0."""
        table = self.schedule.transitions[position]
        source, target = self.schedule.mode(table.source), self.schedule.mode(table.target)
        window, placements = unroll_switch(table, source, target, context=self.context)
        self._process(f"switch {table.source} to {table.target}")
        self._instant(f"switch from {table.source}", ZERO - window.start)
        self._instant(f"start of {table.target}", table.length - window.start)
        self._slices(placements, window, table.name)
        self._counters(placements, window)

    def _process(self, name: str) -> None:
        self.process += 1
        self._metadata("process_name", 0, {"name": name})
        self._metadata("process_sort_index", 0, {"sort_index": self.process})
        for unit, thread in self.threads.items():
            self._metadata("thread_name", thread, {"name": unit})
            self._metadata("thread_sort_index", thread, {"sort_index": thread})

    def _metadata(self, name: str, thread: int, args: dict[str, Any]) -> None:
        self.events.append({"name": name, "ph": "M", "pid": self.process, "tid": thread, "args": args})

    def _instant(self, name: str, at: Duration) -> None:
        self.events.append({"name": name, "ph": "i", "s": "p", "ts": self._us(at), "pid": self.process, "tid": 0})

    def _slices(self, placements: Iterable[Placement], window: Window, switch: str | None = None) -> None:
        """Write the slices of a line; `switch` names the table between two modes, where there is one."""
        for placement in placements:
            if not window.shows(placement):
                continue
            played = placement.cycle if switch is None else _number_at_switch(placement)
            arguments = _arguments(placement, placement.part or switch or "", played, window)
            for number, (start, end) in enumerate(placement.stretches()):
                if window.meets(start, end):
                    begin, last = max(start, window.start), min(end, window.end)
                    times = self._span(begin - window.start, last - window.start)
                    part = {"part": number, "parts": len(placement.job.parts)} if placement.job.parts else {}
                    event = {"name": placement.job.task, "cat": "job", "ph": "X", "ts": times[0], "dur": times[1]}
                    for unit in placement.job.units:
                        place = {"pid": self.process, "tid": self.threads[unit], "args": arguments | part}
                        self.events.append(event | place)

    def _flows(self, link: Link, table: ModeSchedule, cycles: int) -> None:
        """Tie the slice of the predecessor to that of the job; the arrow is drawn between the slices' ends."""
        for cycle in range(link.cycles, cycles):
            self.flow += 1
            before = link.predecessor.start + table.hyperperiod * (cycle - link.cycles)
            after = link.job.start + table.hyperperiod * cycle
            anchors = [("s", before, link.predecessor), ("f", after, link.job)]
            for phase, at, job in anchors:
                event = {"name": link.precedence.task, "cat": "precedence", "ph": phase, "id": self.flow}
                event |= {"bp": "e"} if phase == "f" else {}
                place = {"ts": self._us(at), "pid": self.process, "tid": self.threads[job.units[0]]}
                self.events.append(event | place)

    def _counters(self, placements: list[Placement], window: Window) -> None:
        for resource, steps in resource_steps(self.model, placements, window).items():
            for at, total in [*steps, (window.end, Fraction(0))]:
                event = {"name": resource, "ph": "C", "ts": self._us(at - window.start), "pid": self.process}
                self.events.append(event | {"args": {"sum of bounds": self._share(total)}})

    def _span(self, begin: Duration, end: Duration) -> tuple[_Number, _Number]:
        """Return ts and dur such that slices which abut still do when rounded."""
        ts = self._us(begin)
        return ts, _Number(format_rational(Fraction(self._us(end)) - Fraction(ts)))

    def _us(self, at: Duration) -> _Number:
        found = format_rational(at.in_unit("us"))
        self.rounded += (is_rounded := "/" in found)
        return _Number(format_rational(Fraction(round(at.fraction), 1000)) if is_rounded else found)

    def _share(self, value: Fraction) -> _Number:
        found = format_rational(value)
        self.rounded_values += (is_rounded := "/" in found)
        return _Number(format_rational(Fraction(round(value * 10**9), 10**9)) if is_rounded else found)


def _number_at_switch(placement: Placement) -> int:
    """Count the tables around a switch: the source's cycles -2 and -1 are 0 and 1, the table 2, the target's 0 is 3."""
    if not placement.part:
        return 2
    return placement.cycle + (2 if placement.cycle < 0 else 3)


def _arguments(placement: Placement, table: str, played: int, window: Window) -> dict[str, Any]:
    """Return what the viewer shows for a slice; start and end are the job's own, in its mode or table.

    `table` and `played`, the number of the table on this line, tell a comparison which job it is.
    """
    job = placement.job
    args: dict[str, Any] = {"job": job.index, "version": job.version, "start": str(job.start), "end": str(job.end)}
    args |= {"table": table, "played": played}
    if placement.part:
        args |= {"cycle": placement.cycle}
    if placement.start < window.start:
        args |= {"began": "before this trace"}
    if placement.end > window.end:
        args |= {"ends": "after this trace"}
    return args
