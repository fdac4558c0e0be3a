"""How commands speak: results on standard output, everything else on standard error, colour only for people."""

from __future__ import annotations

import os
import sys
from collections import Counter
from enum import StrEnum
from typing import TYPE_CHECKING, TextIO

from halpipe.diagnostics import Severity, render_json, render_sarif, render_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.diagnostics import Diagnostic

SHOWN_PER_CODE = {Severity.ERROR: 20, Severity.WARNING: 4, Severity.NOTE: 0}
"""Diagnostics of one code shown in text before the rest is only counted; JSON, SARIF and --verbose have all."""

_COLOURS = {Severity.ERROR: "31;1", Severity.WARNING: "33;1", Severity.NOTE: "36"}


class Format(StrEnum):
    """The forms in which diagnostics can be had."""

    TEXT = "text"
    JSON = "json"
    SARIF = "sarif"


class Settings:
    """What the options chose; there is one command per process."""

    format: Format = Format.TEXT
    quiet: bool = False
    verbose: bool = False


def choose(format: Format | None, *, quiet: bool, verbose: bool) -> None:
    """Take over the options that every verb has."""
    Settings.format, Settings.quiet, Settings.verbose = format or Format.TEXT, quiet, verbose


def is_text() -> bool:
    """Return whether diagnostics are shown as text, so that a sentence may follow them."""
    return Settings.format is Format.TEXT


def say(text: str) -> None:
    """Tell the user something that is not the result."""
    print(text, file=sys.stderr)  # noqa: T201


def inform(text: str) -> None:
    """Tell the user something that --quiet silences."""
    if not Settings.quiet:
        say(text)


def result(text: str) -> None:
    """Print a result."""
    print(text)  # noqa: T201


def report(diagnostics: Sequence[Diagnostic], stream: TextIO | None = None) -> None:
    """Show diagnostics in the chosen form, by default on standard error."""
    from halpipe import __version__

    stream = stream or sys.stderr
    if Settings.format is Format.JSON:
        print(render_json(diagnostics), file=stream)
    elif Settings.format is Format.SARIF:
        print(render_sarif(diagnostics, __version__), file=stream)
    else:
        for line in _text(diagnostics, _wants_colour(stream)):
            print(line, file=stream)


def _text(diagnostics: Sequence[Diagnostic], colour: bool) -> list[str]:
    from halpipe.files import SourceLines

    source = SourceLines()
    lines: list[str] = []
    for severity in (Severity.ERROR, Severity.WARNING, Severity.NOTE):
        if Settings.quiet and severity is not Severity.ERROR:
            continue
        found = [d for d in diagnostics if d.severity is severity]
        shown = _selection(found, SHOWN_PER_CODE[severity])
        for diagnostic in shown:
            text = render_text(diagnostic, source(diagnostic.at))
            lines.append(_coloured(text, diagnostic) if colour else text)
        hidden = len(found) - len(shown)
        if hidden:
            plural = "s" if hidden > 1 else ""
            lines.append(f"{hidden} {'more ' if shown else ''}{severity}{plural}; --verbose shows all")
    return lines


def _selection(diagnostics: Sequence[Diagnostic], most: int) -> list[Diagnostic]:
    """Return the first `most` diagnostics of every code, so that many of one kind do not hide one of another."""
    if Settings.verbose:
        return list(diagnostics)
    counts: Counter[str] = Counter()
    chosen = []
    for diagnostic in diagnostics:
        counts[diagnostic.code] += 1
        if counts[diagnostic.code] <= most:
            chosen.append(diagnostic)
    return chosen


def _coloured(text: str, diagnostic: Diagnostic) -> str:
    label = f"{diagnostic.severity}[{diagnostic.code}]"
    return text.replace(label, f"\x1b[{_COLOURS[diagnostic.severity]}m{label}\x1b[0m", 1)


def _wants_colour(stream: TextIO) -> bool:
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
