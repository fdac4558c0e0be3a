"""Reading of what is loaded, line by line, and the case of a device that executes it; only comments are skipped.

Each model of a device is written from its documentation and knows nothing of the exporter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol, cast

from halpipe.core.records import record
from halpipe.deploy.regulator.codes import NOT_UNDERSTOOD, OTHER_SCHEDULE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Code, Diagnostic
    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.reading import Facts, Tables


AGAIN = "export the bundle again; what is loaded was changed, or the exporter is wrong: report it"


@dataclass(slots=True)
class Case:
    """Load of a device, and the budgets that it must then grant; `findings` are collected, `steps` counted."""

    bundle: Bundle
    tables: Tables
    facts: Facts
    planned: Sequence[Planned]
    findings: list[Diagnostic] = field(default_factory=list)
    steps: int = 0
    caveat: str = ""
    """What a grant of this device depends on, for the line of the verdict; empty: nothing beside the tables."""

    @property
    def folder(self) -> str:
        """The folder of the bundle that is loaded."""
        return self.tables.backend

    def note(self, code: Code, name: str, text: str, *, line: int = 0, path: str = "", help: str = AGAIN) -> None:
        """Add a finding about a file of the folder."""
        at = self.bundle.at(f"{self.folder}/{name}", line) if line else self.bundle.at(f"{self.folder}/{name}")
        self.findings.append(code(text, at=at, path=path, help=help))


class Device(Protocol):
    """A model of a device: executes what is loaded and notes what is wrong in the case."""

    def __call__(self, case: Case) -> None:
        """Execute everything that the folder of the back-end has."""
        ...


def device(backend: str) -> Device | None:
    """Return the model of what a back-end writes for, None if its Verilog is simulated instead."""
    from halpipe.devices import DEVICES

    if backend not in DEVICES or find_spec(f"{__package__}.{DEVICES[backend].folder}") is None:
        return None
    return cast("Device", import_module(f"{__package__}.{DEVICES[backend].folder}").execute)


WORD = 2**32


@record
class Line:
    """A line that is no comment, with its number."""

    number: int
    text: str


@record
class Script:
    """A script: its name in the folder, its comments, and its other lines without the space at their ends."""

    name: str
    comments: tuple[Line, ...]
    lines: tuple[Line, ...]


def files_of(case: Case) -> dict[str, bytes]:
    """Return the files of the back-end's folder by their names in it."""
    prefix = f"{case.folder}/"
    return {name[len(prefix) :]: data for name, data in case.bundle.files.items() if name.startswith(prefix)}


def scripts_of(case: Case, suffix: str, *others: str) -> tuple[dict[str, Script], dict[int, Script]]:
    """Return the `others` by name, and the script of every table by its number; note what is missing or too much."""
    found = files_of(case)
    named: dict[str, Script] = {}
    numbered: dict[int, Script] = {}
    for name in sorted(found):
        match = re.fullmatch(r"([0-9]{1,3})-[A-Za-z0-9_.-]+" + re.escape(suffix), name)
        if name in others:
            named[name] = _script(case, name, found[name])
        elif match and int(match[1]) < len(case.tables.tables) and int(match[1]) not in numbered:
            numbered[int(match[1])] = _script(case, name, found[name])
        elif not name.endswith(".h"):
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
    comments = tuple(line for line in lines if line.text.startswith("#"))
    if not any(f"schedule {case.tables.schedule_sha256}" in line.text for line in comments):
        case.note(OTHER_SCHEDULE, name, "does not state the schedule of this bundle")
    return Script(name, comments, tuple(line for line in lines if line.text and not line.text.startswith("#")))


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


def check_loader(case: Case, script: Script, base: str) -> None:
    """Note where the script that loads the others does not write, read and stop as documented."""
    in_range = '[ $((least)) -le "$have" ] && [ "$have" -le $((most)) ]'
    fails = '{ echo "$1: register $offset is $have, not from $((least)) to $((most))" >&2; exit 1; }'
    expected = (
        "set -e",
        """sed '/^#/d' "$1" | while read -r what offset value least most; do""",
        f"  at=$(({base} + offset))",
        '  case "$what" in',
        '  -) devmem "$at" 32 "$value" ;;',
        r"  \?)",
        '    have=$(devmem "$at" 32)',
        "    have=$((have & value))",
        f"    {in_range} || {fails}",
        "    ;;",
        "  esac",
        "done",
    )
    for line in take(case, script, expected):
        case.note(NOT_UNDERSTOOD, script.name, f'has "{line.text[:60]}" after its end', line=line.number)


def load_functions(prefix: str) -> tuple[str, ...]:
    """Return the C functions that write registers and read ranges; words are one space apart."""
    return (
        (
            f"static inline void {prefix}_load(uintptr_t base, const struct {prefix}_write *write, uint32_t count) {{ "
            "for (uint32_t n = 0u; n < count; n++) "
            "{ *(volatile uint32_t *)(base + write[n].offset) = write[n].value; } }"
        ),
        (
            f"static inline uint32_t {prefix}_check(uintptr_t base, const struct {prefix}_range *range, "
            "uint32_t count) { for (uint32_t n = 0u; n < count; n++) { "
            "uint32_t have = *(volatile uint32_t *)(base + range[n].offset) & range[n].mask; "
            "if (have < range[n].least || have > range[n].most) { return n + 1u; } } return 0u; }"
        ),
    )


def hexadecimal(text: str) -> int | None:
    """Return a word of 32 bits written as ``0x...``, None if it is none."""
    if not re.fullmatch(r"0x[0-9a-f]{1,16}", text):
        return None
    return int(text, 16)


# ------------------------------------------------------------------------------------------------- C headers


@record
class Header:
    """A C header: what it defines and declares, the type of each array, and its rows; numbers as text."""

    name: str
    defines: dict[str, str]
    types: dict[str, str]
    kinds: dict[str, str]
    arrays: dict[str, list[list[str]]]

    def numbers(self, array: str) -> list[tuple[int, ...]]:
        """Return the rows of an array of numbers; no rows if it is not there, or a value is no number."""
        rows = self.arrays.get(array, [])
        try:
            return [tuple(int(word, 0) for word in row) for row in rows]
        except ValueError:
            return []


_DEFINE = re.compile(r'#define (\w+)(?: ("[^"\n]*"|\w+))?')
_ARRAY = re.compile(r"static const (struct \w+|struct \{[^}]*\}) (\w+)\[(\w+)\] = \{(.*?)\n\};", re.DOTALL)
_ROW = re.compile(r"\s*\{([^{}]*)\},")
_FUNCTION = re.compile(r"static inline [^{};]+\{\n.*?\n\}", re.DOTALL)
_TYPE = re.compile(r"(struct \w+) \{([^}]*)\};")
_VALUE = re.compile(r"(0x[0-9a-f]+|[0-9]+)u|0|[a-z]\w*")


def header_of(
    case: Case, name: str, types: dict[str, str], arrays: dict[str, str], digest: str, *functions: str
) -> Header | None:
    """Return the header `name`, which declares `types` (with members) and has the schedule in the macro `digest`.

    `arrays` gives the type of each array by its name, without the number of its table; `functions` are those that
    it defines, words apart by one space.
    """
    data = files_of(case).get(name)
    if data is None:
        case.note(NOT_UNDERSTOOD, name, "is missing")
        return None
    text = re.sub(r"/\*.*?\*/", "", data.decode("utf-8", "replace"), flags=re.DOTALL)
    header = Header(name, {}, {}, {}, {})
    if [" ".join(found.split()) for found in _FUNCTION.findall(text)] != [*functions]:
        case.note(NOT_UNDERSTOOD, name, "does not write and read back as documented")
    text = _FUNCTION.sub("", text)
    text = _ARRAY.sub(lambda match: _array(case, header, match), text)
    text = _TYPE.sub(lambda match: _declare(header, match), text)
    rest = [line.strip() for line in text.splitlines() if line.strip()]
    guard = name.upper().replace(".", "_")
    known = {f"#ifndef {guard}", f"#define {guard}", "#include <stdint.h>", "#endif"}
    for line in rest:
        match = _DEFINE.fullmatch(line)
        if line not in known and match is None:
            case.note(NOT_UNDERSTOOD, name, f'has "{line[:60]}"')
        elif match is not None and line not in known:
            if match[1] in header.defines:
                case.note(NOT_UNDERSTOOD, name, f"defines {match[1]} twice")
            header.defines[match[1]] = (match[2] or "").strip('"').removesuffix("u")
    if [line for line in rest if line in known] != [
        f"#ifndef {guard}",
        f"#define {guard}",
        "#include <stdint.h>",
        "#endif",
    ]:
        case.note(NOT_UNDERSTOOD, name, "is not guarded and closed as documented")
    if list(header.types.items()) != list(types.items()):
        case.note(NOT_UNDERSTOOD, name, f"declares {list(header.types)}, not {list(types)} as documented")
    for array, kind in header.kinds.items():
        if arrays.get(re.sub(r"_[0-9]+$", "", array)) != kind:
            case.note(NOT_UNDERSTOOD, name, f"has an array {array} of {kind}")
    if header.defines.get(digest) != case.tables.schedule_sha256:
        case.note(OTHER_SCHEDULE, name, "does not state the schedule of this bundle")
    return header


def _declare(header: Header, match: re.Match[str]) -> str:
    members = " ".join(match[2].split())
    header.types[match[1]] = members if match[1] not in header.types else f"{members} twice"
    return ""


def _array(case: Case, header: Header, match: re.Match[str]) -> str:
    type, name, size, body = match.groups()
    rows = [[word.strip() for word in row.split(",")] for row in _ROW.findall(body)]
    if _ROW.sub("", body).strip() or not all(_VALUE.fullmatch(word) for row in rows for word in row):
        case.note(NOT_UNDERSTOOD, header.name, f"{name} has more than rows of numbers")
    if name in header.arrays:
        case.note(NOT_UNDERSTOOD, header.name, f"{name} is there twice")
    stated = header_number(text) if (text := _lookup(case, header.name, size)) else header_number(size)
    if stated is not None and stated != len(rows):
        case.note(NOT_UNDERSTOOD, header.name, f"{name} has {len(rows)} rows, declared are {stated}")
    header.arrays[name] = [[word.removesuffix("u") for word in row] for row in rows]
    header.kinds[name] = type
    return ""


def _lookup(case: Case, name: str, size: str) -> str:
    """Return what a size stands for where it is a macro."""
    match = re.search(rf"#define {re.escape(size)} (\w+)", files_of(case)[name].decode("utf-8", "replace"))
    return match[1] if match else ""


def header_number(text: str) -> int | None:
    """Return a number of C, None if it is none."""
    plain = text.removesuffix("u")
    return int(plain, 0) if re.fullmatch(r"0x[0-9a-f]+|[0-9]+", plain) else None
