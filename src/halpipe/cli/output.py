"""Output of commands: results on standard output, all else on standard error, colour only on terminals.

Whatever is printed passes `printable` here, line by line: names and messages may come from anybody's files. The shell
may leave the streams closed, full, or without a reader: a remark on standard error never stops the work. A result that
cannot be printed does, unless its reader has had enough.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections import Counter
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TextIO

from halpipe.core.diagnostics import HalpipeError, Severity, printable, render_json, render_sarif, render_text

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic


def prepare() -> None:
    """Make closed streams harmless: else the next file that is opened would take their place, and their output."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what an encoding lacks is escaped
            stream.reconfigure(errors="backslashreplace")


def write_result(text: str) -> None:
    """Print to standard output; raise `BrokenPipeError` if its reader has gone, `HalpipeError` if it takes no more."""
    with _refusals_told():
        _open(sys.stdout).write(text)


def flush_results() -> None:
    """Have results reach their reader, or raise as `write_result` does."""
    if sys.stdout is not None:
        with _refusals_told():
            sys.stdout.flush()


def can_print(text: str) -> bool:
    """Return whether standard output has these characters, so that they need not be escaped."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


def write_remark(text: str) -> None:
    """Print to standard error, if that is possible."""
    try:
        _open(sys.stderr).write(text)
        sys.stderr.flush()
    except (OSError, ValueError):
        silence(sys.stderr)


def silence(stream: TextIO | None) -> None:
    """Let a stream go nowhere from now on, so that Python itself does not complain of it in the end."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        target = os.open(os.devnull, os.O_WRONLY)
        os.dup2(target, stream.fileno())  # type: ignore[union-attr]
        os.close(target)


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether people read a stream."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:
        return False


def _open(stream: TextIO | None) -> Any:
    if stream is None:
        import errno

        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return stream


@contextlib.contextmanager
def _refusals_told() -> Any:
    from halpipe.core.files.writing import cannot_write

    try:
        yield
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as failure:
        silence(sys.stdout)
        raise HalpipeError(*cannot_write("-", failure).diagnostics) from None


SHOWN_PER_CODE = {Severity.ERROR: 20, Severity.WARNING: 4, Severity.NOTE: 0}
"""Diagnostics of one code shown in text before the rest is only counted; JSON, SARIF and --verbose have all."""

_COLOURS = {Severity.ERROR: "31;1", Severity.WARNING: "33;1", Severity.NOTE: "36"}


class Format(StrEnum):
    """The forms in which diagnostics can be had."""

    TEXT = "text"
    JSON = "json"
    SARIF = "sarif"


class Settings:
    """Settings from the options; there is one command per process."""

    format: Format = Format.TEXT
    quiet: bool = False
    verbose: bool = False


def choose(format: Format | None, *, quiet: bool, verbose: bool) -> None:
    """Take over the options that every verb has."""
    Settings.format, Settings.quiet, Settings.verbose = format or Format.TEXT, quiet, verbose


def is_text() -> bool:
    """Return whether diagnostics are shown as text, so that a sentence may follow them."""
    return Settings.format is Format.TEXT


def is_brief() -> bool:
    """Return whether people read it, who have not asked for everything."""
    return is_text() and not Settings.verbose


def say(text: str) -> None:
    """Tell the user something in one line that is not the result."""
    write_remark(printable(text) + "\n")


def inform(text: str) -> None:
    """Tell the user something that --quiet silences."""
    if not Settings.quiet:
        say(text)


def result(text: str = "") -> None:
    """Print a line of the result."""
    write_result(printable(text) + "\n")


def text(block: str) -> None:
    """Print a result of several lines."""
    for line in block.splitlines():
        result(line)


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: Collection[int] = ()) -> None:
    """Print a result in columns; those of `right`, counted from 0, are aligned there."""
    for line in columns(headings, rows, right=right):
        result(line)


def columns(headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: Collection[int] = ()) -> Iterator[str]:
    """Yield the lines of a table."""
    from rich.cells import cell_len

    cells = [[printable(cell) for cell in row] for row in (headings, *rows)]
    widths = [max(map(cell_len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        blanks = [" " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=True)]
        sized = enumerate(zip(row, blanks, strict=True))
        yield "  ".join(blank + cell if number in right else cell + blank for number, (cell, blank) in sized).rstrip()


def report(diagnostics: Sequence[Diagnostic], *, as_result: bool = False) -> None:
    """Show diagnostics in the chosen form on standard error, or on standard output where they are the result."""
    from halpipe import __version__

    if Settings.format is Format.JSON:
        shown = render_json(diagnostics)
    elif Settings.format is Format.SARIF:
        shown = render_sarif(diagnostics, __version__)
    else:
        shown = "\n".join(_text(diagnostics, _wants_colour(sys.stdout if as_result else sys.stderr)))
    if shown and as_result:
        write_result(shown + "\n")
    elif shown:
        write_remark(shown + "\n")


def _text(diagnostics: Sequence[Diagnostic], colour: bool) -> list[str]:
    from halpipe.core.files import SourceLines

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


def _wants_colour(stream: TextIO | None) -> bool:
    return is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
