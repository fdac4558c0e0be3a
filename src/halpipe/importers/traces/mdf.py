"""Measurement files (MDF 3 and 4) by the library asammdf: tables of jobs, and signals that are 1 while a task runs.

A group with the channels task, start and end is a table of jobs, with the columns of the CSV reader. Any other channel
of whole numbers that is 0 or 1 only is the state of a task of its name. Times of MDF are seconds as binary fractions;
they are rounded to nanoseconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.importers.common.inputs import reason
from halpipe.importers.traces import codes, table
from halpipe.importers.traces.jobs import Jobs
from halpipe.models.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Iterator


_HEAD = 64
"""Bytes of the identification, behind which the header stands."""
_INSTALL = "install the library that reads MDF: pip install 'halpipe[mdf]'"


def read(stream: BinaryIO, file: str, findings: Findings) -> list[Trace]:
    """Return the tables of jobs, and a line of time of all signals."""
    try:
        from asammdf import MDF
    except ImportError:
        message = "this is a measurement file (MDF), which needs the library asammdf"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help=_INSTALL)) from None
    if not stream.read(_HEAD + 4)[_HEAD:].startswith((b"##HD", b"HD")):  # the library would print a traceback
        message = "this measurement file (MDF) has no header"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help="save it again"))
    stream.seek(0)
    try:
        opened: Any = stream
        with MDF(opened) as measured:
            return _read(measured, file, findings)
    except HalpipeError:
        raise
    except Exception as failure:  # noqa: BLE001 whatever the library raises on a damaged file
        message = f"the library asammdf cannot read it: {reason(failure)}"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, 1), help="save it again")) from None


def _read(measured: Any, file: str, findings: Findings) -> list[Trace]:
    found: list[Trace] = []
    jobs, others = Jobs(file, findings), list[str]()
    for index in range(len(measured.groups)):
        group = _group(measured, index)
        names = [str(name) for name in group.columns]
        if table.is_header(",".join(names)):
            found += table.read(_rows(group, names), file, findings)
        else:
            others += [name for name in names if not _state(jobs, name, group[name])]
    table.report_signals(others, file, findings)
    return [*found, Trace(name="", executions=jobs.result(), is_shared=True)]


def _group(measured: Any, index: int) -> Any:
    """Return a group as a frame, with the units of times in the names of its columns, as CSV has them."""
    frame = measured.get_group(index, time_from_zero=False)
    units = {
        channel.name: measured.get_channel_unit(channel.name, index) for channel in measured.groups[index].channels
    }
    return frame.rename(columns=lambda name: f"{name} [{units[name]}]" if table.is_time(name) and units[name] else name)


def _rows(group: Any, names: list[str]) -> Iterator[str]:
    yield ",".join(names) + "\n"
    for values in group.itertuples(index=False):
        yield ",".join(map(_cell, values)) + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if isinstance(value, str):
        return '"' + value.strip("\0 ").replace('"', "") + '"'
    number = float(value)
    return str(int(number)) if number.is_integer() else f"{number:.9f}"


def _state(jobs: Jobs, name: str, signal: Any) -> bool:
    if signal.dtype.kind not in "buif" or not set(signal.unique().tolist()) <= {0, 1}:
        return False
    for sample, (seconds, value) in enumerate(zip(signal.index.tolist(), signal.tolist(), strict=True)):
        jobs.state(name, round(seconds * 10**9), runs=bool(value), is_first=sample == 0)
    return True
