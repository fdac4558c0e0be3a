"""Detection of the form of a trace by its content, and the reading of one into executions."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import read_bytes
from halpipe.core.records import record
from halpipe.importers.traces import codes
from halpipe.importers.traces.ctf import folders

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models.trace import Trace

FORMS = "write CSV with the columns task, start and end, or record BTF or Trace Event JSON"


_OF_TASKS = "write its jobs as CSV with the columns task, start and end"
_KNOWN_FORMS = (
    (rb"\x17\x08Dtracing", "a trace.dat of trace-cmd", "print it with `trace-cmd report`, and " + _OF_TASKS),
    (rb"MDF     |UnFinMF ", "a measurement file (MDF)", "export its events, and " + _OF_TASKS),
    (rb"\n[^\0]{0,200}\0", "a trace of Perfetto in protobuf", "convert it with `traceconv json`"),
    (rb"CTF 1|\xc1\x1f\xfc\xc1|\xc1\xfc\x1f\xc1", "a stream of CTF", "name the directory that holds its metadata"),
    (rb"# tracer: |(#.*\n|\s)*.{1,32}-\d+ +(\(.{7}\) +)?\[\d+\] ", "the text of ftrace", _OF_TASKS),
    (rb"cpus=\d+\n|version = \d+\nCPU", "the text of ftrace", _OF_TASKS),
)
"""Forms that are recognised and not read: how they begin, what they are, and what to do instead."""


@record
class Recording:
    """The lines of time of one file, and the diagnostics of reading it."""

    traces: tuple[Trace, ...]
    diagnostics: tuple[Diagnostic, ...]


def read_traces(path: str) -> Recording:
    """Read the trace `path`, a file or a directory of CTF; raise `HalpipeError` with every row that cannot be read."""
    if folders(path):
        from halpipe.importers.traces.callbacks import executions_of

        findings = Findings()
        return Recording((executions_of(path, findings),), tuple(findings.items))
    return parse_traces(read_bytes(path), path)


def parse_traces(data: bytes, file: str) -> Recording:
    """Read a trace from bytes; `file` names it in diagnostics."""
    for begin, what, help in _KNOWN_FORMS:
        if re.match(begin, data[:4096]):
            message = f"this is {what}, which is not read"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=help))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        line = data[: failure.start].count(b"\n") + 1
        message = f"byte {failure.start} is no UTF-8"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, line), help=FORMS)) from None
    findings = Findings()
    traces = _reader(text, file)(text, file, findings)
    findings.stop_on_errors()
    if not any(trace.executions for trace in traces):
        help = "record the start and the end of every job"
        raise HalpipeError(*findings.items, codes.NO_EXECUTIONS("no task runs in it", at=Location(file), help=help))
    return Recording(tuple(trace for trace in traces if trace.executions), tuple(findings.items))


def _reader(text: str, file: str) -> Callable[[str, str, Findings], list[Trace]]:
    """Return the function that reads what `text` begins like."""
    from halpipe.importers.traces import btf, events, table

    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    if first.startswith(("{", "[")):
        return events.read
    if first.startswith("#") or btf.is_event(first):
        return btf.read
    if table.is_header(first):
        return table.read
    if any(word in first.lower() for word in ("duration", "latency", "execution_time", "elapsed")):
        help = "export the starts and ends of callbacks: durations do not say when a job ran"
        message = "it has durations, but no starts and ends"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=help))
    if first.startswith("<"):
        help = "compare takes the schedule first, then the trace: `halpipe compare SCHEDULE TRACE`"
        raise HalpipeError(codes.UNKNOWN_TRACE("this is XML", at=Location(file, 1), help=help))
    shown = first if len(first) <= 60 else first[:60] + "..."
    raise HalpipeError(codes.UNKNOWN_TRACE(f"it begins with {shown!r}", at=Location(file, 1), help=FORMS))
