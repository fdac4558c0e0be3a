"""Detection of the form of a trace by its content, and the reading of one into executions.

Texts are read line by line, JSON event by event and binary traces packet by packet, so that only jobs are kept.
Any of them may be compressed by gzip, and texts may be UTF-16 with a mark of byte order.
"""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from itertools import chain
from typing import TYPE_CHECKING, BinaryIO, cast

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location
from halpipe.core.files import STDIO, TOO_LARGE, is_folder_without, open_input, read_bytes
from halpipe.core.records import record
from halpipe.importers.common.inputs import reason
from halpipe.importers.traces import codes
from halpipe.importers.traces.ctf import METADATA, folders
from halpipe.importers.traces.numbers import separator_of
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence


FORMS = "write CSV with the columns task, start and end, or record BTF or Trace Event JSON"
_HEAD = 4096
_CHUNK = 2**20
_MOST_TEXT = 2**28
MOST_COLUMNS = 20_000
"""Columns of a table: two for each callback in CARET's records, one for each signal."""

_PERFETTO = re.compile(rb"\n[^\0-\x08\x0e-\x1f]*[\0-\x08\x0e-\x1f]")
"""A packet; texts have no control characters but those of lines."""
_TRACE_DAT = b"\x17\x08Dtracing"
_MDF = (b"MDF     ", b"UnFinMF ")
_SEPARATOR = re.compile("sep=.$", re.IGNORECASE)
"""First line by which spreadsheets state the separator of a CSV; the header shows it, too."""
_GZIP = b"\x1f\x8b"
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_CTF = (b"CTF 1", b"\xc1\x1f\xfc\xc1", b"\xc1\xfc\x1f\xc1")


@record
class Recording:
    """The lines of time of one file, and the diagnostics of reading it."""

    traces: tuple[Trace, ...]
    diagnostics: tuple[Diagnostic, ...]


def read_traces(path: str) -> Recording:
    """Read the trace `path`, a file or a directory of CTF; raise `HalpipeError` with every row that cannot be read."""
    if folders(path):
        from halpipe.importers.traces.ctf_jobs import read_folder

        findings = Findings()
        return Recording((read_folder(path, findings),), tuple(findings.items))
    if is_folder_without(path, METADATA):
        help = "name a file, or the directory that lttng or `ros2 trace` wrote"
        raise HalpipeError(codes.NO_CTF("there is no file called metadata in it", at=Location(path), help=help))
    if path == STDIO:
        return parse_traces(read_bytes(path), path)
    with open_input(path) as stream:
        return _read(stream, path)


def parse_traces(data: bytes, file: str) -> Recording:
    """Read a trace from bytes; `file` names it in diagnostics."""
    return _read(io.BytesIO(data), file)


def _read(stream: BinaryIO, file: str) -> Recording:
    findings = Findings()
    head = stream.read(_HEAD)
    stream.seek(0)
    if head.startswith(_GZIP):
        packed = cast("BinaryIO", gzip.GzipFile(fileobj=stream))
        try:
            head = packed.read(_HEAD)
            packed.seek(0)
            traces = _of_form(head, packed, file, findings)
        except (EOFError, OSError, zlib.error) as failure:
            message = f"what gzip compressed cannot be read: {reason(failure)}"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file), help="copy the file again")) from None
    else:
        traces = _of_form(head, stream, file, findings)
    findings.stop_on_errors()
    if not any(len(trace.executions) for trace in traces):
        help = "record the start and the end of every job"
        raise HalpipeError(*findings.items, codes.NO_EXECUTIONS("no task runs in it", at=Location(file), help=help))
    return Recording(_joined([trace for trace in traces if len(trace.executions)]), tuple(findings.items))


def _joined(traces: Sequence[Trace]) -> tuple[Trace, ...]:
    """Return processes that have no task in common as one line of time, since one clock stamps them all.

    Those that name tables are pictures of halpipe, each with a time of its own; equal tasks are those of two computers.
    """
    columns = [trace.executions for trace in traces if trace.name and isinstance(trace.executions, Executions)]
    names = [{each.names[number] for number in each.task} for each in columns]
    is_stated = any(any(each.names[number] for number in {*each.table}) for each in columns)
    if len(columns) < 2 or len(columns) < len(traces) or is_stated or sum(map(len, names)) > len(set().union(*names)):
        return tuple(traces)
    found = columns[0]
    for each in columns[1:]:
        found.extend(each)
    found.sort()
    return (Trace(name="", executions=found),)


def _of_form(head: bytes, stream: BinaryIO, file: str, findings: Findings) -> list[Trace]:
    if head.startswith(_TRACE_DAT):
        from halpipe.importers.traces import tracedat

        return tracedat.read(stream, file, findings)
    if head.startswith(_MDF):
        from halpipe.importers.traces import mdf

        return mdf.read(stream, file, findings)
    if head.startswith(_CTF):
        help = "name the directory that holds its metadata"
        raise HalpipeError(codes.UNKNOWN_TRACE("this is a stream of CTF", at=Location(file, 1), help=help))
    if _PERFETTO.match(head):
        from halpipe.importers.traces import perfetto

        return perfetto.read(stream, file, findings)
    encoding = "utf-16" if head.startswith(_UTF_16) else "utf-8-sig"
    head = head.decode(encoding, "ignore").encode()
    if head.lstrip()[:1] in (b"{", b"["):
        from halpipe.importers.traces import slices

        return slices.read(_pieces(stream, file, encoding), file, findings)
    lines = _lines(_pieces(stream, file, encoding), file, findings)
    begin: list[str] = []
    for line in lines:
        line = "\n" if _SEPARATOR.match(line) else line
        begin.append(line)
        if line.strip():
            break
    return _reader(begin[-1].strip() if begin else "", head, file)(chain(begin, lines), file, findings)


def _pieces(stream: BinaryIO, file: str, encoding: str) -> Iterator[str]:
    decoder, number = codecs.getincrementaldecoder(encoding)(), 0
    while True:
        data = stream.read(_CHUNK)
        try:
            piece = decoder.decode(data, final=not data)
        except UnicodeDecodeError as failure:
            line = number + failure.object[: failure.start].decode(encoding, "ignore").count("\n") + 1
            message, help = f"line {line} is no text in UTF-8", "unpack it, or save it as UTF-8"
            raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, line), help=help)) from None
        number += piece.count("\n")
        if piece:
            yield piece
        if not data:
            return


def _lines(pieces: Iterator[str], file: str, findings: Findings) -> Iterator[str]:
    """Yield the lines of a text with their ends; one without an end is noted in `findings`: it may be cut off there."""
    rest, number = "", 0
    for piece in pieces:
        lines = (rest + piece).splitlines(keepends=True)
        rest = lines.pop() if lines else ""
        if len(rest) > _MOST_TEXT:
            raise HalpipeError(TOO_LARGE("has too long a line", at=Location(file, number + 1), help="split the file"))
        number += len(lines)
        yield from lines
    if rest:
        yield rest
    if rest[-1:] not in ("", "\n", "\r"):
        findings.add(codes.NO_END(f"line {number + 1} has no end", at=Location(file, number + 1)))


def _reader(first: str, head: bytes, file: str) -> Callable[[Iterable[str], str, Findings], list[Trace]]:
    from halpipe.importers.traces import btf, ftrace, table

    if ftrace.BEGIN.match(head):
        return ftrace.read
    if btf.is_begin(first, head):
        return btf.read
    if first.count(separator_of(first)) >= MOST_COLUMNS:
        help = "keep the columns of the tasks in question"
        raise HalpipeError(TOO_LARGE(f"has more than {MOST_COLUMNS} columns", at=Location(file, 1), help=help))
    if table.is_header(first):
        return table.read
    if table.is_states(first):
        return table.read_states
    if any(word in first.lower() for word in ("duration", "latency", "execution_time", "elapsed")):
        help = "export the starts and ends of callbacks: durations do not say when a job ran"
        message = "it has durations, but no starts and ends"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=help))
    if first.startswith("<"):
        help = "compare takes the schedule first, then the trace: `halpipe compare SCHEDULE TRACE`"
        raise HalpipeError(codes.UNKNOWN_TRACE("this is XML", at=Location(file, 1), help=help))
    message = f"it begins with {first[:60]!r}" + (" ..." if len(first) > 60 else "") if head else "it is empty"
    raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=FORMS))
