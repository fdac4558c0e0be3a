"""The files of one format among those that the user named."""

from __future__ import annotations

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
