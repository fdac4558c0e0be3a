"""Reasons for which a file cannot be read, in words about the file and not about objects of Python."""

from __future__ import annotations

import zlib

_LONGEST = 200
_REASONS: dict[type[Exception], str] = {
    IndexError: "a number is cut off, or stands for what is not there",
    KeyError: "a name stands for what is not there",
    TypeError: "a number stands where a text or a message is due",
    AttributeError: "a value is of another kind than is due",
    OverflowError: "a number does not fit into 64 bits",
    EOFError: "it is cut off",
    zlib.error: "what it holds compressed is damaged",
    UnicodeDecodeError: "a text is not UTF-8",
}
_OF_PYTHON = {"builtins", "struct", "zlib"}
"""Modules whose exceptions state what happened in a program; a plain ValueError is raised by readers of files."""


def reason(failure: Exception) -> str:
    """Return why a file cannot be read: the first line of what a reader or a library says, or a reason of our own."""
    kind, lines = type(failure), str(failure).splitlines()
    if lines and (kind is ValueError or kind.__module__ not in _OF_PYTHON):
        return lines[0][:_LONGEST]
    return next((text for each, text in _REASONS.items() if issubclass(kind, each)), "it is cut off, or damaged")
