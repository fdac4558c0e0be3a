"""MemGuard on a model of the module: lines that its debugfs files take, and lines each core then gets in a period.

From the module's source (heechul/memguard): a line has one number for every core in order; cores that it does not reach
keep their limit; 0 is not taken; 255 characters of a line are read. Reads are counted as refills of cache lines, so a
written line counts as a read, too, where the cache allocates on writes. Only user mode is counted. The period times
2^20, in 32 bits, divides when limits are read.
"""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_rational, parse_size
from halpipe.deploy.regulator import rates
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, GRANTS_DIFFER, NOT_UNDERSTOOD
from halpipe.deploy.regulator.loading import Case, Line, Script, choices, scripts_of, take
from halpipe.deploy.regulator.promise import ZERO, rate_steps

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.reading import Table

PUT = (
    "put() {",
    "  core=0",
    '  echo "$2" > "$1"',
    "  for events in $2; do",
    '    grep -q "^CPU$core: $events " "$1" || { echo "$1: core $core did not take $events" >&2; exit 1; }',
    "    core=$((core + 1))",
    "  done",
    "}",
)
"""Writes a limit and reads it back, core by core."""

FOLDER = "cd /sys/kernel/debug/memguard"
LINE = re.compile(r"put (read|write)_limit '([0-9 ]+)'")
LONGEST = 255
SHORTEST_PERIOD, LONGEST_PERIOD = 1000, 10**6

BROUGHT = {"read": "write-refills", "write": "write-backs"}
"""The setting that says how many lines of a direction each line of the other one brings with it."""

OTHER = {"read": "write", "write": "read"}

Limits = dict[str, int]
"""Events per period, by owner: unit (or core) and direction."""


class Module:
    """The module: limits of every core and direction, none after loading."""

    def __init__(self, case: Case) -> None:
        stated = case.platform.number("memguard", "cores")
        numbers = {unit.name: case.platform.units[unit.name].get("core") for unit in case.tables.units}
        self.names = {int(core): unit for unit, core in numbers.items() if core is not None}
        self.cores = stated or max(self.names, default=-1) + 1
        settings = case.platform.settings["memguard"]
        self.line = parse_size(settings["line"])
        self.brings = {d: parse_rational(settings[name]) for d, name in BROUGHT.items()}
        period = settings["period"]
        self.period = Duration.parse(period).in_unit("us") if period else case.platform.window_ns / 1000
        self.limits: Limits = {}

    def owner(self, core: int, direction: str) -> str:
        """Return who has a limit."""
        return f"{self.names.get(core, f'core {core}')} {direction}"

    def write(self, direction: str, text: str) -> str:
        """Write a line of limits; return what the module does not take, empty if it takes all."""
        words = text.split(" ")
        if len(text) > LONGEST or len(words) != self.cores or not all(word.isdecimal() for word in words):
            return f"{len(words)} limits in {len(text)} characters; there are {self.cores} cores"
        for core, word in enumerate(words):
            if not 0 < int(word) < 2**31:
                return f"core {core} does not take {word}"
            self.limits[self.owner(core, direction)] = int(word)
        return ""

    def rate(self, events: int) -> Fraction:
        """Return the bytes per second of a limit."""
        return Fraction(events * self.line * 10**6) / self.period

    def events(self, rate: Fraction) -> int:
        """Return the least events that give a rate."""
        return ceil(rate * self.period / (self.line * 10**6))


def execute(case: Case) -> None:
    """Execute the set-up and every table."""
    named, numbered = scripts_of(case, ".sh", "setup.sh")
    module = Module(case)
    for unit in case.tables.units:
        core = case.platform.units[unit.name].get("core")
        if core is None or module.names.get(int(core)) != unit.name or int(core) >= module.cores:
            text = "has no core of its own in the machine"
            case.note(DEVICE_REFUSES, "setup.sh", text, path=about(unit=unit.name))
    case.caveat = "in user mode, which alone is counted"
    if module.period.denominator == 1 and int(module.period) << 20 & 0xFFFFFFFF == 0:
        case.note(DEVICE_REFUSES, "setup.sh", f"a period of {module.period} us is 0 in the divisor of the module")
    if module.period.denominator != 1 or not SHORTEST_PERIOD <= module.period <= LONGEST_PERIOD:
        case.note(DEVICE_REFUSES, "setup.sh", f"{module.period} us are no period")
        return
    if "setup.sh" in named:
        _set_up(case, module, named["setup.sh"])
    final = {index: _last(case, script) for index, script in numbered.items()}
    for plan in case.planned:
        script = numbered.get(plan.table.index)
        if script is None:
            continue
        formers = [final.get(t.index, {}) for t in case.tables.before(plan.table)]
        _table(case, module, plan, script, formers)


def _table(case: Case, module: Module, plan: Planned, script: Script, formers: list[Limits]) -> None:
    """Execute the settings of a table one after the other, and hold each against what is promised meanwhile."""
    name, table = script.name, plan.table
    settings = list(choices(case, script, list(take(case, script, ("set -e", FOLDER, *PUT)))))
    promised = _promised(case, module, plan)
    if [instant for instant, _ in settings] != [instant for instant, _ in promised]:
        have, want = (" ".join(str(instant) for instant, _ in found) for found in (settings, promised))
        case.note(
            GRANTS_DIFFER, name, f"has settings from {have} ns on, needed are {want}", path=about(table=table.name)
        )
    after, known = Module(case), [limits for _, limits in promised]
    for (_, block), wanted in zip(settings, known, strict=False):
        lines = _limits(case, script, block)
        for former in formers:
            rates.rise(case, name, table, former, _changes(case, lines), module.rate)
        writes: list[tuple[str, int]] = []
        for line, direction, text in lines:
            case.steps += 1
            before = dict(after.limits)
            refused = after.write(direction, text) or ("changes no limit" if after.limits == before else "")
            if refused:
                case.note(DEVICE_REFUSES, name, refused, line=line.number)
            writes += [(owner, n) for owner, n in after.limits.items() if owner.endswith(direction)]
        rates.fall_first(case, name, table, writes, formers)
        _compare(case, name, table, after, wanted)
        formers = [dict(after.limits)]
    if table.successor == table.index and known:
        known = [known[-1], *known]
    for one, other in pairwise(known):  # until a core's period ends, it has the limit of the setting before
        granted = {owner: module.rate(max(n, other[owner])) for owner, n in one.items()}
        rates.hold(case, name, table, granted, " while one setting follows the other")


def _promised(case: Case, module: Module, plan: Planned) -> list[tuple[int, Limits]]:
    """Return the limits that are needed and from when on: once, or (granularity: phase) whenever they change.

    A core takes a limit at the end of its period, whenever that is: between one setting and a period after the next.
    """
    if case.platform.settings["memguard"]["granularity"] != "phase":
        highest = {f"{u} {d}": rate for (u, d), rate in rates.peaks(case, plan).items()}
        return [(0, _wanted(module, highest))]
    span, period = plan.timeline.span, int(module.period * 1000)
    steps = {row: rate_steps(plan.timeline, phases) for row, phases in plan.timeline.by_row().items()}
    found: list[tuple[int, Limits]] = []
    for begin in range(0, ceil(span), period):
        end = min(Fraction(begin + period), span) + period
        needed = {}
        for (unit, direction), several in steps.items():
            ends = [*(instant for instant, _ in several[1:]), span]
            needed[f"{unit} {direction}"] = case.platform.guaranteed * max(
                (
                    rate
                    for (start, rate), stop in zip(several, ends, strict=True)
                    for turn in range(ceil(end / span) if plan.timeline.circular else 1)
                    if start + turn * span < end and stop + turn * span > begin
                ),
                default=ZERO,
            )
        limits = _wanted(module, needed)
        if not found or found[-1][1] != limits:
            found.append((begin, limits))
    return found


def _limits(case: Case, script: Script, lines: list[Line]) -> list[tuple[Line, str, str]]:
    found = []
    for line in lines:
        match = LINE.fullmatch(line.text.strip())
        if match is None:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}"', line=line.number)
        else:
            found.append((line, match[1], match[2]))
    return found


def _last(case: Case, script: Script) -> Limits:
    """Return the limits that a script leaves behind, as far as the module takes them."""
    module = Module(case)
    for match in filter(None, (LINE.fullmatch(line.text.strip()) for line in script.lines)):
        module.write(match[1], match[2])
    return module.limits


def _changes(case: Case, lines: list[tuple[Line, str, str]]) -> Iterator[tuple[str, Limits]]:
    """Yield the limits that each line sets."""
    for line, direction, text in lines:
        module = Module(case)
        module.write(direction, text)
        yield f" while limits change in line {line.number}", module.limits


def _wanted(module: Module, promised: dict[str, Fraction]) -> Limits:
    """Return the least limits: with the lines that those of the other direction bring; at least one."""
    wanted: Limits = {}
    for core in range(module.cores):
        own = {d: module.events(promised.get(module.owner(core, d), ZERO)) for d in BROUGHT}
        for direction, lines in own.items():
            brought = ceil(module.brings[direction] * own[OTHER[direction]])
            wanted[module.owner(core, direction)] = max(1, lines + brought)
    return wanted


def _compare(case: Case, name: str, table: Table, module: Module, wanted: Limits) -> None:
    path = about(table=table.name)
    for owner, events in wanted.items():
        have = module.limits.get(owner)
        if have != events:
            text = f"{owner}: {'no limit' if have is None else f'{have} lines a period'}, the promise takes {events}"
            case.note(GRANTS_DIFFER, name, text, path=path)
    rates.hold(case, name, table, {owner: module.rate(n) for owner, n in module.limits.items()}, "")


def _set_up(case: Case, module: Module, script: Script) -> None:
    cores = (
        f'[ "$(nproc --all)" = {module.cores} ] || {{ echo "there are $(nproc --all) cores, '
        f'the platform file says {module.cores}" >&2; exit 1; }}'
    )
    begin = ("set -e", cores, f"insmod memguard.ko g_period_us={module.period}", FOLDER, *PUT)
    switches = ("echo exclusive 0 > control", "echo reclaim 0 > control")
    for line, direction, text in _limits(case, script, list(take(case, script, (*begin, *switches)))):
        case.steps += 1
        former = dict(module.limits)
        refused = module.write(direction, text) or ("changes no limit" if module.limits == former else "")
        if refused:
            case.note(DEVICE_REFUSES, script.name, refused, line=line.number)
    free = int(rates.limit(case) * module.period / (module.line * 10**6)) - 2 * module.cores
    defaults = {unit.name: unit.default for unit in case.tables.units}
    wanted: Limits = {}
    for core in range(module.cores):
        default = defaults.get(module.names.get(core, ""), {"read": 0, "write": 0})
        share = {d: Fraction(max(0, free) * n, case.platform.capacity_bytes) for d, n in default.items()}
        own = {d: int(share[d] / (1 + module.brings[OTHER[d]])) for d in BROUGHT}
        for direction, lines in own.items():
            brought = int(module.brings[direction] * own[OTHER[direction]])
            wanted[module.owner(core, direction)] = 1 + lines + brought
    _compare(case, script.name, case.tables.tables[0], module, wanted)
    module.limits = {}
