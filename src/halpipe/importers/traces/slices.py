"""Trace Event Format (JSON) of Perfetto and Chrome: slices on threads, which are the units.

Slices are complete (``X``), or begin and end: ``B`` and ``E`` nested on a thread, ``b`` and ``e`` (before: ``S`` and
``F``) by their id. Each process is a line of time of its own. The arguments of halpipe's own slices (table, cycle, job)
are used; slices that lie across the edge of the picture are left out.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.durations import ZERO, Duration
from halpipe.importers.traces import codes
from halpipe.importers.traces.numbers import SCALES_NS
from halpipe.models.trace import Execution, Trace

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Findings

_MAX_EXPONENT = 30
_ENDS = {"E": "B", "e": "b", "F": "S"}


def read(text: str, file: str, findings: Findings) -> list[Trace]:
    """Return one line of time for each process, in their order."""
    try:
        document = json.loads(_closed(text, file, findings), parse_float=Decimal)
    except (ValueError, RecursionError, ArithmeticError) as failure:
        line = getattr(failure, "lineno", 1)
        message = f"it is no JSON: {failure}"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, line), help="record it again")) from None
    events = document.get("traceEvents") if isinstance(document, dict) else document
    if not isinstance(events, list):
        raise HalpipeError(codes.UNKNOWN_TRACE("it has no list traceEvents", at=Location(file), help="record it again"))
    return _Reader(file, findings).traces([event for event in events if isinstance(event, dict)])


def _closed(text: str, file: str, findings: Findings) -> str:
    """Return the text with the bracket that recorders may omit at the end of a plain list."""
    bare = text.strip()
    if not bare.startswith("[") or bare.endswith("]"):
        return text
    findings.add(codes.NO_END("the list of events has no closing bracket", at=Location(file)))
    return bare.removesuffix(",") + "]"


class _Reader:
    """Collects slices by process; one job is one slice on each of its units."""

    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.processes: dict[Any, str] = {}
        self.threads: dict[tuple[Any, Any], str] = {}
        self.open: dict[Any, list[tuple[dict[str, Any], int]]] = {}
        self.others: Counter[str] = Counter()

    def traces(self, events: list[dict[str, Any]]) -> list[Trace]:
        """Return the lines of all processes."""
        for event in events:
            if event.get("ph") == "M":
                self._name(event)
        jobs: dict[Any, dict[Any, Execution]] = {}
        for number, event in self._in_order(events):
            phase = str(event.get("ph"))
            of_process = jobs.setdefault(_key(event.get("pid")), {})
            if phase == "X":
                self._complete(event, number, of_process)
            elif phase in _ENDS.values():
                self.open.setdefault(_pair(event, phase), []).append((event, number))
            elif phase in _ENDS:
                self._end(event, number, _ENDS[phase], of_process)
            elif phase != "M":
                self.others[f"of phase {phase[:20]}"] += 1
        self._unfinished(jobs)
        if self.others:
            kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.others.items()))
            self.findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(self.file)))
        return [
            Trace(
                name=self.processes.get(process, str(process)),
                executions=tuple(sorted(found.values(), key=lambda execution: execution.start.ns)),
            )
            for process, found in jobs.items()
        ]

    def _name(self, event: dict[str, Any]) -> None:
        arguments = event.get("args")
        name = arguments.get("name") if isinstance(arguments, dict) else None
        if isinstance(name, str) and event.get("name") == "process_name":
            self.processes[_key(event.get("pid"))] = name
        elif isinstance(name, str) and event.get("name") == "thread_name":
            self.threads[_key(event.get("pid")), _key(event.get("tid"))] = name

    def _in_order(self, events: list[dict[str, Any]]) -> list[tuple[int, dict[str, Any]]]:
        """Return the events with their numbers; where slices begin and end, by time."""
        numbered = list(enumerate(events))
        if not any(event.get("ph") in ("B", "E", "b", "e", "S", "F") for event in events):
            return numbered
        times = [_microseconds(event.get("ts")) for event in events]
        return sorted(numbered, key=lambda item: (times[item[0]] or ZERO).ns)

    def _end(self, event: dict[str, Any], number: int, begin: str, jobs: dict[Any, Execution]) -> None:
        begun = self.open.get(_pair(event, begin))
        end = _microseconds(event.get("ts"))
        if end is None:
            self._broken(number)
        elif not begun:
            help = "check the recorder for lost events"
            message = f"event {number} ends a slice that did not begin"
            self.findings.add(codes.ODD_SEQUENCE(message, at=Location(self.file), help=help))
        else:
            first, position = begun.pop()
            self._slice(first, position, _microseconds(first.get("ts")), end, jobs)

    def _unfinished(self, jobs: dict[Any, dict[Any, Execution]]) -> None:
        left = [begun for found in self.open.values() for begun in found]
        for event, number in left:
            self._slice(event, number, _microseconds(event.get("ts")), None, jobs[_key(event.get("pid"))])
        if left:
            self.findings.add(codes.UNFINISHED(f"{len(left)} slices have no end", at=Location(self.file)))

    def _broken(self, number: int) -> None:
        message = f"event {number} has no name, ts or dur that can be read"
        self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file), help="record it again"))

    def _complete(self, event: dict[str, Any], number: int, jobs: dict[Any, Execution]) -> None:
        start, length = _microseconds(event.get("ts")), _microseconds(event.get("dur"))
        if start is None or length is None or length < ZERO:
            self._broken(number)
        else:
            self._slice(event, number, start, start + length, jobs)

    def _slice(
        self,
        event: dict[str, Any],
        number: int,
        start: Duration | None,
        end: Duration | None,
        jobs: dict[Any, Execution],
    ) -> None:
        stated = event.get("args")
        arguments: dict[str, Any] = stated if isinstance(stated, dict) else {}
        if "began" in arguments or "ends" in arguments:
            self.others["slices across the edge of the picture"] += 1
            return
        task = event.get("name")
        if start is None or not isinstance(task, str) or not task:
            self._broken(number)
            return
        process, thread = _key(event.get("pid")), _key(event.get("tid"))
        unit = self.threads.get((process, thread), str(thread))
        job, table = arguments.get("job"), arguments.get("table")
        cycle = arguments.get("played", arguments.get("cycle"))
        execution = Execution(
            task=task,
            units=(unit,),
            start=start,
            end=end,
            table=table if isinstance(table, str) else "",
            cycle=cycle if isinstance(cycle, int) else None,
            job=job if isinstance(job, int) else None,
            at=Location(self.file),
        )
        if job is None:
            jobs[number] = execution
        elif "part" in arguments:
            whole = (task, "in parts", execution.table, _key(job), _key(cycle))
            jobs[whole] = _with_part(jobs.get(whole), execution)
        else:
            key = (task, start.ns, _key(job), _key(cycle))
            jobs[key] = replace(execution, units=(*jobs[key].units, unit)) if key in jobs else execution


def _with_part(known: Execution | None, part: Execution) -> Execution:
    """Return the execution with one more of the stretches, or of the units, that its slices show."""
    times = (part.start, part.end or part.start)
    stretches = sorted({*(known.stretches if known else ()), times}, key=lambda stretch: stretch[0].ns)
    return replace(
        part,
        units=tuple(dict.fromkeys((*(known.units if known else ()), *part.units))),
        start=stretches[0][0],
        end=max(end for _, end in stretches),
        busy=sum((end - start for start, end in stretches), ZERO),
        stretches=tuple(stretches),
    )


def _pair(event: dict[str, Any], begin: str) -> Any:
    """Return what the begin and the end of a slice share: their thread, or their category and id."""
    pair = (event.get("tid"),) if begin == "B" else (event.get("cat"), event.get("id", str(event.get("id2"))))
    return (begin, _key(event.get("pid")), *map(_key, pair))


def _key(value: Any) -> Any:
    """Return an identifier that can be looked up, whatever the JSON has."""
    return value if isinstance(value, int | str) else str(value)


def _microseconds(value: Any) -> Duration | None:
    if isinstance(value, bool) or not isinstance(value, int | Decimal):
        return None
    if isinstance(value, Decimal) and (not value.is_finite() or abs(value.adjusted()) > _MAX_EXPONENT):
        return None
    return Duration(Fraction(value) * SCALES_NS["us"])
