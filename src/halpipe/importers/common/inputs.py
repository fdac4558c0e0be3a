"""The files of one format among those that the user named, and reasons for which one cannot be read."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Code, Findings, HalpipeError, Location
from halpipe.core.files import find_inputs, input_size

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


Document = TypeVar("Document")


def read_inputs(
    paths: Sequence[str],
    suffixes: tuple[str, ...],
    read: Callable[[str], Document],
    skipped: Code,
    no_input: Code,
    findings: Findings,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Document]:
    """Read every file of `paths`, and in directories those with one of `suffixes`; the first is the usual one.

    `read` raises `HalpipeError` for a file of another kind: that is an error if the file was named directly, and a
    note of the code `skipped` if it was found in a directory. `no_input` reports that no file is left. `on_progress`
    gets the bytes of the files that have been read, and of all.
    """
    documents = []
    names = list(dict.fromkeys(find_inputs(paths, suffixes)))
    total, done = sum(map(input_size, names)) if on_progress else 0, 0
    for name in names:
        if on_progress:
            on_progress(done, total)
            done += input_size(name)
        try:
            documents.append(read(name))
        except HalpipeError as failure:
            if name in paths:
                findings.extend(failure.diagnostics)
                continue
            findings.extend(
                skipped(f"skipped: {cause.message}", at=cause.at, help=cause.help) for cause in failure.diagnostics
            )
    if not documents and not findings.has_errors:
        what = f"holds no usable {suffixes[0]} file" if paths else "no input was named"
        help = f"name {suffixes[0]} files, or directories that hold them"
        findings.add(no_input(what, at=Location(paths[0] if paths else ""), help=help))
    return documents


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
