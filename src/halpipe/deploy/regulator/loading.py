"""Reading of what is loaded, line by line, and the case of a device that executes it; only comments are skipped.

Each model of a device is written from its documentation and knows nothing of the exporter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, NOT_UNDERSTOOD, OTHER_SCHEDULE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Code, Diagnostic
    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.reading import Platform, Tables


AGAIN = "export the bundle again; what is loaded was changed, or the exporter is wrong: report it"


@dataclass(slots=True)
class Case:
    """Load of a device, and the budgets that it must then grant; `findings` are collected, `steps` counted."""

    bundle: Bundle
    tables: Tables
    planned: Sequence[Planned]
    findings: list[Diagnostic] = field(default_factory=list)
    steps: int = 0
    caveat: str = ""
    """What a grant of this device depends on, for the line of the verdict; empty: nothing beside the tables."""

    @property
    def platform(self) -> Platform:
        """The facts of the platform."""
        return self.tables.platform

    def note(self, code: Code, name: str, text: str, *, line: int = 0, path: str = "", help: str = AGAIN) -> None:
        """Add a finding about a file of the folder."""
        at = self.bundle.at(f"{self.tables.backend}/{name}", line)
        self.findings.append(code(text, at=at, path=path, help=help))


WORD = 2**32


@record
class Line:
    """A line that is no comment, with its number."""

    number: int
    text: str


@record
class Script:
    """A script: its name in the folder, and its lines but for comments, without the space at their ends."""

    name: str
    lines: tuple[Line, ...]


def scripts_of(case: Case, suffix: str, *others: str) -> tuple[dict[str, Script], dict[int, Script]]:
    """Return the `others` by name, and the script of every table by its number; note what is missing or too much."""
    prefix = f"{case.tables.backend}/"
    found = {name[len(prefix) :]: data for name, data in case.bundle.files.items() if name.startswith(prefix)}
    named: dict[str, Script] = {}
    numbered: dict[int, Script] = {}
    for name in sorted(found):
        match = re.fullmatch(r"([0-9]{1,3})-[A-Za-z0-9_.-]+" + re.escape(suffix), name)
        if name in others:
            named[name] = _script(case, name, found[name])
        elif match and int(match[1]) < len(case.tables.tables) and int(match[1]) not in numbered:
            numbered[int(match[1])] = _script(case, name, found[name])
        else:
            case.note(NOT_UNDERSTOOD, name, "belongs to no table and to no part of the set-up")
    for name in others:
        if name not in named:
            case.note(NOT_UNDERSTOOD, name, "is missing")
    for table in case.tables.tables:
        if table.index not in numbered:
            case.note(NOT_UNDERSTOOD, f"{table.index}-...{suffix}", f'there is no script of table "{table.name}"')
    return named, numbered


def _script(case: Case, name: str, data: bytes) -> Script:
    lines = [Line(n, text.rstrip()) for n, text in enumerate(data.decode("utf-8", "replace").splitlines(), 1)]
    comments = [line for line in lines if line.text.startswith(("#", "//"))]
    if not any(f"schedule {case.tables.schedule_sha256}" in line.text for line in comments):
        case.note(OTHER_SCHEDULE, name, "does not state the schedule of this bundle")
    return Script(name, tuple(line for line in lines if line.text and line not in comments))


def take(case: Case, script: Script, begin: Sequence[str]) -> Iterator[Line]:
    """Yield the lines after those that every such script begins with; note where it does not begin so."""
    for number, (line, want) in enumerate(zip(script.lines, begin, strict=False)):
        if line.text != want:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", expected "{want[:60]}"', line=line.number)
            return
        if number + 1 == len(begin):
            yield from script.lines[len(begin) :]
            return
    case.note(NOT_UNDERSTOOD, script.name, f'ends before "{begin[len(script.lines)]}"')


def choices(case: Case, script: Script, lines: Sequence[Line]) -> Iterator[tuple[int, list[Line]]]:
    """Yield the settings of a script with the nanosecond from which on each holds; without choices there is one."""
    if not lines or lines[0].text != 'case "$1" in':
        yield 0, list(lines)
        return
    number = 0
    block: tuple[int, list[Line]] | None = None
    for place, line in enumerate(lines[1:-2]):
        begins = re.fullmatch(r"(\d{1,9})\) # from (\d{1,18})(?:/\d+|\.\d+)? ns on", line.text)
        if begins and block is None and int(begins[1]) == number:
            block, number = (int(begins[2]), []), number + 1
        elif line.text == "  ;;" and block is not None:
            yield block
            block = None
        elif block is not None:
            block[1].append(line)
        else:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}" at {place}', line=line.number)
    closing = [f'*) echo "usage: $0 0..{number - 1}" >&2; exit 2 ;;', "esac"]
    if block is not None or [line.text for line in lines[-2:]] != closing:
        case.note(NOT_UNDERSTOOD, script.name, "does not end as documented")


SETUP, LOADER = "setup.txt", "load.sh"


def check_loader(case: Case, named: Mapping[str, Script], base: str) -> None:
    """Note where the script that loads the others does not write, read and stop as documented."""
    in_range = '[ $((c)) -le "$have" ] && [ "$have" -le $((d)) ]'
    fails = '{ echo "$1: register $a is $have, not from $((c)) to $((d))" >&2; exit 1; }'
    expected = (
        "set -e",
        """grep -v '^//' "$1" | tr '(,)' '   ' | while read -r what a b c d; do""",
        '  case "$what $a" in',
        f'  "WRITE -1") devmem $(({base} + b)) 32 "$c" ;;',
        "  READ*)",
        f"    have=$(devmem $(({base} + a)) 32)",
        "    have=$((have & b))",
        f"    {in_range} || {fails}",
        "    ;;",
        "  esac",
        "done",
    )
    for line in take(case, named[LOADER], expected) if LOADER in named else ():
        case.note(NOT_UNDERSTOOD, LOADER, f'has "{line.text[:60]}" after its end', line=line.number)


@record
class Write:
    """A register write and its line; `at` is its window or nanosecond, -1 before the first."""

    at: int
    offset: int
    value: int
    line: int


@record
class Range:
    """A read and its line: the bits of `mask` are from `least` to `most`."""

    offset: int
    mask: int
    least: int
    most: int
    line: int


_HEX = "(0x[0-9a-f]{1,16})"
_WRITE = re.compile(rf"WRITE\((-1|[0-9]{{1,18}}), {_HEX}, {_HEX}\)")
_READ = re.compile(rf"READ\({_HEX}, {_HEX}, {_HEX}, {_HEX}\)")


def steps_of(case: Case, script: Script) -> list[Write | Range]:
    """Return the writes and reads of a register script; note the lines that are neither, and instants that fall."""
    found: list[Write | Range] = []
    last = -1
    for line in script.lines:
        write, read = _WRITE.fullmatch(line.text), _READ.fullmatch(line.text)
        if read:
            offset, mask, least, most = (int(word, 16) for word in read.groups())
            found.append(Range(offset, mask, least, most, line.number))
        elif not write:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", no write and no read', line=line.number)
        elif int(write[1]) < last:
            case.note(DEVICE_REFUSES, script.name, f"{write[1]} is over by then", line=line.number)
        else:
            last = int(write[1])
            found.append(Write(last, int(write[2], 16), int(write[3], 16), line.number))
    return found
