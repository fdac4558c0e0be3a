"""Sources reach no file but those that are staged with them, whatever C and assembler offer for it.

What a compiler opens is decided by text: by directives of the preprocessor, and of the assembler, to which C comes by
`asm` and by attributes. Before anything is assembled, each is looked for, and what cannot be decided by looking at it
is refused: a compiler's message would quote the other file, and the image would hold it.
"""

from __future__ import annotations

import posixpath
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_SPLICE = re.compile(rb"\\[ \t\f\v\0]*(?:\r?\n|\r)")
# Compilers pass over more than blanks: NUL, carriage returns by themselves, blanks of Unicode. What could be a comment
# in the head of a directive is refused: where one ends depends on all that is before it.
_BLANK = rb"[^\w\"'\n/#%(<]*"
_NAME = rb"(?P<name>\"[^\"\n]*\"|<[^>\n]*>)?"
_READING = re.compile(
    rb"(?:#|%:)" + _BLANK + rb"(?:(?:include_next|include|import|embed)\b" + _BLANK + _NAME + rb"|/\*)"
)
_ASKING = re.compile(
    rb"(?P<harmless>\b(?:ifn?def\b|defined\b" + _BLANK + rb"\(?)" + _BLANK + rb")?"
    rb"__has_(?:include_next|include|embed)\b" + _BLANK + rb"\(?" + _BLANK + _NAME
)
_DEPENDENCY = re.compile(rb"\bGCC" + _BLANK + rb"(?:dependency\b|/\*)")


def outside_includes(name: str, content: bytes) -> Iterator[tuple[int, str]]:
    """Yield (line, what) for what would have the preprocessor read outside of the folder; `name` is relative to it.

    The line is 0 where lines are continued, since they are joined to look at them.
    """
    joined = _SPLICE.sub(b"", content)
    asking = (found for found in _ASKING.finditer(joined) if found["harmless"] is None)
    suspects = [*_READING.finditer(joined), *asking, *_DEPENDENCY.finditer(joined)]
    line, counted = 1, 0
    for found in sorted(suspects, key=lambda found: found.start()):
        line, counted = line + joined.count(b"\n", counted, found.start()), found.start()
        what = _reads(found, name)
        if what:
            yield (line if len(joined) == len(content) else 0), what


def _reads(found: re.Match[bytes], name: str) -> str:
    """Return what a suspect would have read from outside; empty if nothing."""
    if found.re is _DEPENDENCY:
        return "has a pragma that reads another file"
    stated = (found["name"] or b"").decode("utf-8", "replace")
    if not stated:
        return "includes a file whose name is computed, or stands behind a comment"
    if _leaves(stated[1:-1], "" if stated.startswith("<") else posixpath.dirname(name)):
        return f"includes {stated}"
    return ""


def _leaves(path: str, folder: str) -> bool:
    """Return whether a path, from `folder` on, leads out of the sources."""
    if path.startswith("/") or "\\" in path or re.match(r"[A-Za-z]:", path):
        return True
    return posixpath.normpath(posixpath.join(folder, path)).split("/")[0] == ".."


_READS = re.compile(rb"incbin|(?<![\w.$])\.\s*(?:include|altmacro|mri)\b", re.IGNORECASE)
_MACRO = re.compile(rb"(?<![\w.$])\.\s*(?:macro|irpc?|irepc?|rept?)\b", re.IGNORECASE)


def assembler_reads(text: bytes) -> str:
    """Return what in an assembler text, after the preprocessor, could read a file; empty if nothing does.

    Of macros, a parameter may bring half a directive, a separator or a quote: nothing short of what an assembler does
    tells what comes of it. So they have none.
    """
    found = _READS.search(text)
    if found is not None:
        return f"has the directive {found[0].decode('ascii', 'replace')}"
    if b"\\" in text and _MACRO.search(text) is not None:
        return "has an assembler macro with parameters (or another backslash beside a macro)"
    return ""
