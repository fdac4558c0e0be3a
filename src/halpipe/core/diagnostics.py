"""Coded diagnostics with file, line, element and remedy.

A `Code` is declared once, beside the code that reports it, and registers itself; the reference page of
all codes is generated from that register. Calling a `Code` makes a `Diagnostic`.
"""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class Severity(StrEnum):
    """Severity of a diagnostic: only an error stops the command."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


class Exit(IntEnum):
    """The exit codes of the command line; one table, see docs/reference/exit-codes.md."""

    OK = 0
    FINDINGS = 1
    USAGE = 2
    NOT_FOUND = 3
    INFEASIBLE = 4
    UNSUPPORTED = 5
    INTERNAL = 70
    INTERRUPTED = 130


@record
class Location:
    """A place in an input file; line 0 means the file as a whole."""

    file: str = ""
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


NOWHERE = Location()


class Subject(NamedTuple):
    """An element that a diagnostic is about: its kind, such as task or unit, and its name."""

    kind: str
    name: str


class Path(str):
    """Name of an element in messages, with the elements that it names as data beside the text.

    Checks make the path of each element that they look at, so it has to be cheap.
    """

    __slots__ = ("subjects",)
    subjects: tuple[Subject, ...]

    def __new__(cls, text: str, subjects: tuple[Subject, ...] = ()) -> Path:
        """Make a path of its text and the elements in it."""
        path = str.__new__(cls, text)
        path.subjects = subjects
        return path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path, (str(self), self.subjects)


_WORDS = {
    "precedence_on": ("precedence on", "task"),
    "access_to": ("access to", "resource"),
    "unit_load": ("unit-load", "unit"),
    "resource_load": ("resource-load", "resource"),
    "health_rule_of_task": ("health rule of task", "task"),
    "transition_from": ("transition from", "transition"),
    "on": ("on", "unit"),
    "publishing": ("publishing", "topic"),
    "subscribing": ("subscribing", "topic"),
    "reaction_to_task": ("reaction to task", "task"),
}
"""Keywords of `about` that are more than a kind: their words in messages, and the kind of what they name."""


def about(within: str = "", **elements: str | int | tuple[str, str]) -> Path:
    """Return the path of an element: ``about(mode="a", task="b", job=3)`` is ``mode "a" task "b" job 3``.

    A pair of names is an element between two others, as a transition is.
    """
    text, subjects = str(within), within.subjects if isinstance(within, Path) else ()
    for keyword, name in elements.items():
        words, kind = _WORDS.get(keyword) or (keyword, keyword)
        if type(name) is str:
            shown = f'"{name}"'
        elif isinstance(name, tuple):
            shown, name = " to ".join(f'"{end}"' for end in name), "->".join(name)
        else:
            shown = name = str(name)
        text = f"{text} {words} {shown}" if text else f"{words} {shown}"
        subjects = (*subjects, Subject(kind, name))
    return Path(text, subjects)


def named(kind: str, name: str) -> Path:
    """Return the path of an element whose kind is that of another format, such as ``OsTask "/ecu/os/main"``."""
    return Path(f'{kind} "{name}"', (Subject(kind, name),))


def version_of(task: str, version: str) -> Path:
    """Return the path of a version as exporters name it."""
    return Path(f'task "{task}", version "{version}"', about(task=task, version=version).subjects)


@record
class Fix:
    """A change that removes the fault: at a place, the text `old` becomes `new`."""

    at: Location
    old: str
    new: str


@record
class Code:
    """A kind of diagnostic: its number, weight, one-line title and a paragraph for the reference page."""

    id: str
    severity: Severity
    title: str
    explanation: str = ""

    def __post_init__(self) -> None:
        if REGISTER.setdefault(self.id, self) != self:
            raise ValueError(f"diagnostic code {self.id} is declared twice")

    def __call__(
        self,
        message: str,
        *,
        at: Location = NOWHERE,
        path: str = "",
        help: str = "",
        severity: Severity | None = None,
        subjects: Iterable[Subject] = (),
        places: Iterable[Location] = (),
        fix: Fix | None = None,
    ) -> Diagnostic:
        """Make the diagnostic: what is wrong, where, on which element, and what to do about it.

        It is about the elements that `path` names and further `subjects`, whose `places` may be given too.
        """
        named = path.subjects if isinstance(path, Path) else ()
        further = tuple(dict.fromkeys(place for place in places if place not in (at, NOWHERE))) if places else ()
        return Diagnostic(
            self.id,
            severity or self.severity,
            at,
            shortened(str(path)),
            shortened(message),
            shortened(help),
            _unique((*named, *subjects)),
            further,
            fix,
        )

    def instead_of(self, found: Diagnostic, help: str = "") -> Diagnostic:
        """Return a diagnostic of another code as one of this code."""
        return replace(found, code=self.id, severity=self.severity, help=help or found.help)


def _unique(subjects: Iterable[Subject]) -> tuple[Subject, ...]:
    whole = (s if len(s.name) <= MOST_CHARACTERS else Subject(s.kind, shortened(s.name)) for s in subjects)
    return tuple(dict.fromkeys(whole))


MOST_CHARACTERS = 2000
"""Characters of a text in a diagnostic; a longer one holds a value of the input, and is cut in the middle."""


def shortened(text: str) -> str:
    """Return a text without the middle of what is too long for anybody to read."""
    if len(text) <= MOST_CHARACTERS:
        return text
    return f"{text[: MOST_CHARACTERS // 2]}...{text[-MOST_CHARACTERS // 2 :]}"


REGISTER: dict[str, Code] = {}


def error(id: str, title: str, explanation: str = "") -> Code:
    """Declare a code that stops the work."""
    return Code(id, Severity.ERROR, title, explanation)


def warning(id: str, title: str, explanation: str = "") -> Code:
    """Declare a code that the user should look at."""
    return Code(id, Severity.WARNING, title, explanation)


def note(id: str, title: str, explanation: str = "") -> Code:
    """Declare a code that says what was done or assumed."""
    return Code(id, Severity.NOTE, title, explanation)


@record
class Diagnostic:
    """One finding: `path` names the element inside the file, `help` says what to do.

    `subjects` are the elements it is about, `places` where else to look, `fix` a change that removes the fault.
    """

    code: str
    severity: Severity
    at: Location
    path: str
    message: str
    help: str = ""
    subjects: tuple[Subject, ...] = ()
    places: tuple[Location, ...] = ()
    fix: Fix | None = None

    def __repr__(self) -> str:
        """Return the text that the command line shows: in a notebook, a list of findings is read as it stands."""
        return render_text(self)

    @property
    def is_error(self) -> bool:
        """Whether this finding stops the command."""
        return self.severity is Severity.ERROR

    def concerning(self, subjects: Iterable[Subject]) -> Diagnostic:
        """Return the same finding, which concerns further elements."""
        return replace(self, subjects=_unique((*self.subjects, *subjects)))


def tasks_named(names: Iterable[str]) -> tuple[Subject, ...]:
    """Return tasks as subjects."""
    return tuple(Subject("task", name) for name in names)


class HalpipeError(Exception):
    """Work that cannot go on; carries the diagnostics to show and the exit code to leave with."""

    def __init__(self, *diagnostics: Diagnostic, exit: Exit = Exit.FINDINGS) -> None:
        super().__init__(*diagnostics)
        self.diagnostics = diagnostics
        self.exit = exit

    def __str__(self) -> str:
        """Return the text that the command line shows, so that an uncaught error in Python says as much."""
        return "\n".join(map(render_text, self.diagnostics))


@contextmanager
def located(at: Location) -> Iterator[None]:
    """Give the findings of an error that have no place the one where the work is stated."""
    try:
        yield
    except HalpipeError as failure:
        failure.diagnostics = tuple(d if d.at != NOWHERE else replace(d, at=at) for d in failure.diagnostics)
        raise


@dataclass(slots=True)
class Findings:
    """Collects diagnostics during a command, so that all are reported and not only the first."""

    items: list[Diagnostic] = field(default_factory=list)

    def add(self, diagnostic: Diagnostic) -> None:
        """Keep one more finding."""
        self.items.append(diagnostic)

    def report(self, code: Code, message: str, at: Location = NOWHERE, path: str = "", help: str = "") -> None:
        """Add what calling a code makes."""
        self.add(code(message, at=at, path=path, help=help))

    def extend(self, diagnostics: Iterable[Diagnostic]) -> None:
        """Keep several findings."""
        self.items.extend(diagnostics)

    @property
    def has_errors(self) -> bool:
        """Whether any finding so far is an error."""
        return any(d.is_error for d in self.items)

    def stop_on_errors(self) -> None:
        """Raise `HalpipeError` with everything collected if any of it is an error."""
        if self.has_errors:
            raise HalpipeError(*self.items)


def sort_diagnostics(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Order by file, line, code and text, without duplicates, so that output never depends on discovery order."""
    ordered = sorted(diagnostics, key=_order)
    return [d for d, before in zip(ordered, [None, *ordered], strict=False) if d != before]


def _order(d: Diagnostic) -> tuple[Any, ...]:
    places = [(place.file, place.line) for place in d.places]
    return d.at.file, d.at.line, d.code, d.path, d.message, d.help, d.severity, d.subjects, places, repr(d.fix)


def printable(text: str) -> str:
    """Return `text` on one line with control characters escaped, so that no input can steer the user's terminal."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def render_text(diagnostic: Diagnostic, source_line: str = "") -> str:
    """Print as ``file:line: error[HAL0201] path: message``, then the source line and the help."""
    place = f"{diagnostic.at}: " if diagnostic.at.file or diagnostic.at.line else ""
    path = f"{diagnostic.path}: " if diagnostic.path else ""
    lines = [f"{place}{diagnostic.severity}[{diagnostic.code}] {path}{diagnostic.message}"]
    if source_line.strip():
        lines.append(f"    | {' '.join(source_line.split())}")
    if diagnostic.help:
        lines.append(f"    help: {diagnostic.help}")
    return "\n".join(map(printable, lines))


def render_json(diagnostics: Iterable[Diagnostic]) -> str:
    """Print as a JSON array of objects, one per diagnostic."""
    return _json([_as_data(d) for d in diagnostics])


def _as_data(d: Diagnostic) -> dict[str, Any]:
    data: dict[str, Any] = {
        "code": d.code,
        "severity": str(d.severity),
        "file": d.at.file,
        "line": d.at.line,
        "path": d.path,
        "message": d.message,
        "help": d.help,
        "subjects": [{"kind": subject.kind, "name": subject.name} for subject in d.subjects],
        "places": [{"file": place.file, "line": place.line} for place in d.places],
    }
    if d.fix is not None:
        data["fix"] = {"file": d.fix.at.file, "line": d.fix.at.line, "old": d.fix.old, "new": d.fix.new}
    return data


def _json(value: Any) -> str:
    text = json.dumps(value, indent=2, ensure_ascii=False)
    return text if text.isprintable() else "".join(c if c.isprintable() or c == "\n" else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    """Return a character as JSON has it in ASCII: a control, or what no stream can print, such as a lone surrogate."""
    return json.dumps(character)[1:-1]


def render_sarif(diagnostics: Iterable[Diagnostic], version: str) -> str:
    """Print as a SARIF 2.1.0 log, the form that code review systems read."""
    found = list(diagnostics)
    rules = [
        {"id": code, "shortDescription": {"text": REGISTER[code].title if code in REGISTER else code}}
        for code in sorted({d.code for d in found})
    ]
    driver = {"name": "halpipe", "version": version, "rules": rules}
    log = {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "results": [_sarif_result(d) for d in found]}],
    }
    return _json(log)


def _sarif_result(diagnostic: Diagnostic) -> dict[str, Any]:
    text = f"{diagnostic.path}: {diagnostic.message}" if diagnostic.path else diagnostic.message
    result: dict[str, Any] = {
        "ruleId": diagnostic.code,
        "level": str(diagnostic.severity),
        "message": {"text": f"{text}\n{diagnostic.help}".strip()},
    }
    if diagnostic.at.file:
        location: dict[str, Any] = {"physicalLocation": _sarif_place(diagnostic.at)}
        if diagnostic.subjects:
            location["logicalLocations"] = [{"name": s.name, "kind": s.kind} for s in diagnostic.subjects]
        result["locations"] = [location]
    if diagnostic.places:
        result["relatedLocations"] = [{"physicalLocation": _sarif_place(place)} for place in diagnostic.places]
    return result


def _sarif_place(at: Location) -> dict[str, Any]:
    from urllib.parse import quote

    place: dict[str, Any] = {"artifactLocation": {"uri": quote(os.fsencode(at.file))}}
    if at.line:
        place["region"] = {"startLine": at.line}
    return place
