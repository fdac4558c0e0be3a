"""No output over an input: what a command has read, it does not write to, by whatever name or link.

Nor do messages show lines of other files: a model may say of a task that it stands in any file of the machine.
"""

from __future__ import annotations

import os
import stat
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError, Location, error

if TYPE_CHECKING:
    from collections.abc import Iterator

OUTPUT_IS_INPUT = error(
    "HAL0005",
    "Output would replace an input",
    "An output has the name of a file that the same command reads, or of another of its outputs, be it through a link "
    "or another spelling of the path. Nothing is written, since one of the two would be lost.",
)

WRONG_ENDING = error(
    "HAL0009",
    "Name of an output states another format",
    "The name ends as those of files of another format do, so programs would open the file as what it is not. Nothing "
    "is written.",
)

ENDINGS = frozenset("amxmi arxml btf csv dot gif gv htm html jpeg jpg json pdf png svg xlsx xml yaml yml".split())  # noqa: SIM905
"""Endings that state a format; others say nothing, and may be of any output."""

STDIO = "-"
HELP = "name another file for the output"


class _Inputs:
    """The files that the command at hand has read, by device and inode; None where they are not recorded."""

    known: dict[tuple[int, int], str] | None = None
    last: dict[tuple[int, int], str] | None = None
    """Those of the command before, whose failure may still be told."""


@contextmanager
def protecting_inputs() -> Iterator[None]:
    """Refuse, until the end of the block, to write to a file that was read within it."""
    before, _Inputs.known = _Inputs.known, {}
    try:
        yield
    finally:
        _Inputs.last, _Inputs.known = _Inputs.known, before


def note_input(descriptor: int, name: str) -> None:
    """Remember an open file as an input; devices and pipes are not lost by being written to."""
    facts = os.fstat(descriptor)
    if _Inputs.known is not None and stat.S_ISREG(facts.st_mode):
        _Inputs.known.setdefault((facts.st_dev, facts.st_ino), name)


def refuse_inputs(*targets: str) -> None:
    """Stop if one of `targets` was read, if two of them are the same file, or if one lies in another."""
    found = [diagnostic for target in targets if (diagnostic := _input_at(target)) is not None]
    seen: dict[str, str] = {}
    for target in targets:
        place = target if target == STDIO or "\0" in target else os.path.realpath(target)
        if place in seen:
            found.append(OUTPUT_IS_INPUT(f'is also the output "{seen[place]}"', at=Location(target), help=HELP))
        elif target and not place.startswith("/dev/"):
            seen[place] = target
    for place, target in seen.items():
        if around := next((seen[str(folder)] for folder in Path(place).parents if str(folder) in seen), ""):
            found.append(OUTPUT_IS_INPUT(f'lies in the output "{around}"', at=Location(target), help=HELP))
    if found:
        raise HalpipeError(*found, exit=Exit.USAGE)


def refuse_name(target: str, *endings: str) -> None:
    """Stop if the name of an output states another format than `endings` do (none: any name is right)."""
    ending = os.path.splitext(target)[1]
    if endings and ending[1:].lower() in ENDINGS and ending.lower() not in endings:
        text = f'ends in "{ending}", but the file is one of those that end in "{endings[0]}"'
        help = f"name it {os.path.basename(target).removesuffix(ending)}{endings[0]}"
        raise HalpipeError(WRONG_ENDING(text, at=Location(target), help=help), exit=Exit.USAGE)


def is_input(target: str) -> bool:
    """Return whether a file was read, by whatever name."""
    return bool(_found_in(_Inputs.known, target))


def was_input(name: str) -> bool:
    """Return whether the command at hand, or the one that just failed, has read a file."""
    return bool(_found_in(_Inputs.last if _Inputs.known is None else _Inputs.known, name))


def _found_in(read: dict[tuple[int, int], str] | None, name: str) -> str:
    if not read or name == STDIO:
        return ""
    try:
        facts = os.stat(name)
    except (OSError, ValueError):
        return ""
    return read.get((facts.st_dev, facts.st_ino), "")


def _input_at(target: str) -> Diagnostic | None:
    name = _found_in(_Inputs.known, target)
    if not name:
        return None
    return OUTPUT_IS_INPUT(f'is also an input, "{name}", and is not replaced', at=Location(target), help=HELP)
