"""Tells input files apart by content, since their names say little: unrelated architecture.yaml files abound."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location, Severity
from halpipe.core.files import YamlMap, advice_for, find_inputs, parse_yaml, read_bytes
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.structure import FORMAT_KEY
from halpipe.importers.traces.ctf import folders

if TYPE_CHECKING:
    from collections.abc import Sequence

_SUFFIXES = (".yaml", ".yml", ".dot", ".gv")
_DOT_START = re.compile(rb"\xef\xbb\xbf|\s+|//[^\n]*|#[^\n]*|/\*.*?\*/", re.DOTALL)
_DOT_WORD = re.compile(rb"(strict|graph|digraph)\b(?!\s*:)", re.IGNORECASE)
EXECUTORS_KEY = "halpipe-executors"
"""First key of an executor configuration as halpipe writes it."""
_PATH_KEYS = ("named_paths", "path_name_aliases")
_OTHER_FORMATS = {
    "launch": "a launch file",
    "services": "a compose file",
}
_PARAMETERS = "ros__parameters"
"""Key of a parameter file, below the name of a node and its namespace."""
_READS = "the importer reads CARET's architecture.yaml, DOT graphs, Autoware System Design and rosbag2's metadata.yaml"


class FileKind(Enum):
    """Kind of an input file."""

    CARET = "architecture.yaml"
    DOT = "DOT graph"
    BAG = "rosbag2 metadata"
    DESIGN = "Autoware System Design"
    EXECUTORS = "executors file of halpipe"


@record
class Input:
    """A recognised file; `content` is text for DOT and a parsed mapping for YAML."""

    name: str
    kind: FileKind
    content: Any


@dataclass(slots=True)
class Inputs:
    """Inputs of an import: one graph or any number of design files count; `skipped` are other files."""

    graphs: list[Input] = field(default_factory=list)
    designs: list[Input] = field(default_factory=list)
    bags: list[Input] = field(default_factory=list)
    traces: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    findings: list[Diagnostic] = field(default_factory=list)


def find(paths: Sequence[str]) -> Inputs:
    """Recognise every file of `paths`; raise `HalpipeError` unless one of them is a graph, or some are a design."""
    inputs = Inputs(traces=[path for path in dict.fromkeys(paths) if folders(path)])
    for name in dict.fromkeys(find_inputs(paths, _SUFFIXES)):
        try:
            found = recognise(name, read_bytes(name))
        except HalpipeError as failure:
            _refuse(inputs, name, failure, named=name in paths)
            continue
        {FileKind.BAG: inputs.bags, FileKind.DESIGN: inputs.designs}.get(found.kind, inputs.graphs).append(found)
    _check_graphs(inputs, paths)
    if any(finding.is_error for finding in inputs.findings):
        raise HalpipeError(*inputs.findings)
    return inputs


def _refuse(inputs: Inputs, name: str, failure: HalpipeError, named: bool) -> None:
    if named:
        inputs.findings.extend(failure.diagnostics)
        return
    inputs.skipped.append(name)
    for cause in failure.diagnostics:
        foreign = cause.code == codes.UNRECOGNISED.id
        help = cause.help if foreign else "repair it if it belongs to the graph"
        severity = Severity.NOTE if foreign else Severity.WARNING
        inputs.findings.append(
            codes.SKIPPED_FILE(f"skipped: {cause.message}", at=cause.at, help=help, severity=severity)
        )


def _check_graphs(inputs: Inputs, paths: Sequence[str]) -> None:
    graphs = [*inputs.graphs, *inputs.designs[:1]]
    if len(inputs.traces) > 1:
        help = "name one; further ones may go to --calibrate"
        text = f"is one of {len(inputs.traces)} traces"
        inputs.findings.extend(codes.TWO_GRAPHS(text, at=Location(trace), help=help) for trace in inputs.traces)
    if len(graphs) > 1:
        names = ", ".join(graph.name for graph in graphs)
        inputs.findings.extend(
            codes.TWO_GRAPHS(f"is one of {len(graphs)} graphs: {names}", at=Location(graph.name), help="name one")
            for graph in graphs
        )
    if not graphs and not inputs.traces and not any(f.severity is Severity.ERROR for f in inputs.findings):
        inputs.findings.append(
            codes.NO_GRAPH(
                "holds no graph" if paths else "no input was named",
                at=Location(paths[0] if paths else ""),
                help="name an architecture.yaml (CARET), a DOT file (rqt_graph), Autoware System Design or a trace",
            )
        )


def recognise(name: str, data: bytes) -> Input:
    """Tell what `data` is and parse it as far as that takes; raise `HalpipeError` for anything else."""
    if _DOT_WORD.match(data, _skip_comments(data)):
        return Input(name, FileKind.DOT, data.decode("utf-8", "replace"))
    if os.path.splitext(name)[1].lower() in (".dot", ".gv"):
        raise HalpipeError(_not_dot(name, data))
    if name.lower().endswith(".py"):
        raise _unrecognised(name, 1, "is a program of Python: a launch file starts nodes and has no graph of them")
    if data.lstrip()[:1] == b"<":
        raise _unrecognised(name, 1, "is a launch file" if b"<launch" in data else "is XML or HTML", data)
    document = parse_yaml(data, name)
    if not isinstance(document, YamlMap):
        raise _unrecognised(name, 0, "is empty" if document is None else "is not a mapping of keys to values", data)
    if isinstance(document.get("rosbag2_bagfile_information"), YamlMap):
        return Input(name, FileKind.BAG, document)
    if FORMAT_KEY in document:
        return Input(name, FileKind.DESIGN, document)
    if EXECUTORS_KEY in document:
        return Input(name, FileKind.EXECUTORS, document)
    if "nodes" in document and ("executors" in document or any(key in document for key in _PATH_KEYS)):
        return Input(name, FileKind.CARET, document)
    for key, what in _OTHER_FORMATS.items():
        if key in document:
            raise _unrecognised(name, document.line_of(key), f"is {what}")
    below = [document, *(value for value in document.values() if isinstance(value, YamlMap))]
    below += [value for outer in below[1:] for value in outer.values() if isinstance(value, YamlMap)]
    if any(_PARAMETERS in value for value in below):
        raise _unrecognised(name, document.line, "is a ROS parameter file")
    missing = [key for key in ("nodes", "executors", "named_paths") if key not in document]
    raise _unrecognised(name, document.line, f"has no {', '.join(missing)}: not the architecture.yaml of CARET")


def _skip_comments(data: bytes) -> int:
    position = 0
    while match := _DOT_START.match(data, position):
        position = match.end()
    return position


def _not_dot(name: str, data: bytes) -> Diagnostic:
    start = _skip_comments(data)
    words = data[start : start + 80].split()
    first = "".join(c if c.isprintable() else "?" for c in words[0].decode("utf-8", "replace")[:40]) if words else ""
    return codes.NOT_DOT(
        f'begins with "{first}", not with digraph' if first else "is empty",
        at=Location(name, data.count(b"\n", 0, start) + 1),
        help="save the graph as DOT in rqt_graph, or name the file after what it is",
    )


def _unrecognised(name: str, line: int, what: str, data: bytes = b"?") -> HalpipeError:
    return HalpipeError(codes.UNRECOGNISED(what, at=Location(name, line), help=advice_for(data, "ros", _READS)))
