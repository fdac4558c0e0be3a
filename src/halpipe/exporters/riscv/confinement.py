"""Sources reach no file but those that are staged with them, whatever C and assembler offer for it.

What a compiler opens is decided by text: by directives of the preprocessor, and of the assembler, which C has by `asm`.
Before anything is assembled, each is looked for, and what cannot be decided by looking at it is refused: a compiler's
message would quote the other file, and the image would hold it.
"""

from __future__ import annotations

import posixpath
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_SPLICE = re.compile(rb"\\[ \t\f\v]*\r?\n")
_BLANK = rb"(?:\s|/\*.*?\*/)*"
_READING = re.compile(
    rb"(?:(?:#|%:)" + _BLANK + rb"(?:include_next|include|import|embed)\b|__has_(?:include_next|include|embed)" + _BLANK
    + rb"\()" + _BLANK + rb"(?P<name>\"[^\"\n]*\"|<[^>\n]*>)?",
    re.DOTALL,
)  # fmt: skip
_DEPENDENCY = re.compile(rb"\bGCC\W+dependency\b")


def outside_includes(name: str, content: bytes) -> Iterator[tuple[int, str]]:
    """Yield (line, what) for what would have the preprocessor read outside of the folder; `name` is relative to it."""
    joined, lines = _spliced(content)
    for found in _READING.finditer(joined):
        stated = (found["name"] or b"").decode("utf-8", "replace")
        if not stated:
            yield lines(found.start()), "includes a file whose name is computed"
        elif _leaves(stated[1:-1], "" if stated.startswith("<") else posixpath.dirname(name)):
            yield lines(found.start()), f"includes {stated}"
    for found in _DEPENDENCY.finditer(joined):
        yield lines(found.start()), "has a pragma that reads another file"


def _spliced(content: bytes) -> tuple[bytes, _Lines]:
    """Return a source with its continued lines joined, and what tells the line of a position in it."""
    joined = _SPLICE.sub(b"", content)
    return joined, _Lines(joined, is_exact=joined == content)


class _Lines:
    """Tells the line of a position, as far as no lines were joined before it."""

    def __init__(self, text: bytes, *, is_exact: bool) -> None:
        self._text = text
        self._is_exact = is_exact

    def __call__(self, position: int) -> int:
        return self._text.count(b"\n", 0, position) + 1 if self._is_exact else 0


def _leaves(path: str, folder: str) -> bool:
    """Return whether a path, from `folder` on, leads out of the sources."""
    if path.startswith("/") or "\\" in path or re.match(r"[A-Za-z]:", path):
        return True
    return posixpath.normpath(posixpath.join(folder, path)).split("/")[0] == ".."


_READS = re.compile(rb"incbin|\.\s*include\b|\.\s*altmacro|\.\s*mri\b", re.IGNORECASE)
_MACRO = re.compile(rb"\.\s*(?:macro|irpc?|rept)\b", re.IGNORECASE)
_STATEMENT = re.compile(rb"(?:^|[;\n])(?:[ \t]*[\w.$\\@]+:)*[ \t]*([^\s;:]+)")


def assembler_reads(text: bytes) -> str:
    """Return what in an assembler text, after the preprocessor, could read a file; empty if nothing does."""
    found = _READS.search(text)
    if found is not None:
        return f"has the directive {found[0].decode('ascii', 'replace')}"
    if _MACRO.search(text) is not None:
        for statement in _STATEMENT.finditer(text):
            if b"\\" in statement[1]:
                return "has a macro that puts the name of an instruction together"
    return ""
