"""Linux resctrl on a model of its file system: its groups, and the value that it makes of a schemata line.

From the kernel's sources: a value below min_bandwidth or above the largest is refused, others are rounded up to the
next multiple of bandwidth_gran, from 0 on (bw_validate). AMD has the least 0 and the step 1 in eighths of a GB/s. With
MPAM a part is 1/2^width of the component's maximum: the least is one part in percent, to the nearest, the step one part
rounded up, and a percentage takes the part whose upper end is nearest, in a field of `width` bits. A new group, and
the root group, have everything until they are written; every domain has a value of its own.
"""

from __future__ import annotations

import re
from fractions import Fraction
from math import ceil, floor

from halpipe.core.diagnostics import about
from halpipe.core.quantities import parse_bandwidth
from halpipe.deploy.regulator import rates
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, NOT_UNDERSTOOD
from halpipe.deploy.regulator.loading import Case, Script, scripts_of, take
from halpipe.deploy.regulator.promise import ZERO

ROOT, REST = ".", "everything else"
EIGHTH = 125_000_000
PUT = re.compile(r"put (\.|[A-Za-z0-9_][A-Za-z0-9_.-]*) 'MB:([0-9=;]+)' 'MB:([0-9=;]+)'")
GROUP = re.compile(r"mkdir -p ([A-Za-z0-9_][A-Za-z0-9_.-]*)")


class FileSystem:
    """The groups with the value of every domain; what was not written has everything."""

    def __init__(self, case: Case) -> None:
        settings = case.platform.settings["resctrl"]
        self.kind = settings["kind"]
        self.peak = case.platform.capacity if case.platform.peak is None else case.platform.peak
        self.width = int(settings["width"])
        bands = 1 << self.width
        if self.kind == "mpam":
            least, step = round_half_up(Fraction(100, bands)), ceil(Fraction(100, bands))
        else:
            least, step = (0, 1) if self.kind == "amd" else (10, 10)
        self.least, self.step = int(settings["min"] or least), int(settings["step"] or step)
        self.most = int(settings["max"] or (2048 if self.kind == "amd" else 100))
        words = (word.split("=") for word in settings["levels"].split())
        self.levels = {int(n): Fraction(parse_bandwidth(rate)) for n, rate in words}
        self.domain = settings["domain"]
        self.domains = sorted([int(self.domain), *map(int, settings["others"].split())])
        self.others = [str(domain) for domain in self.domains if str(domain) != self.domain]
        self.groups: dict[str, dict[str, int]] = {ROOT: {}}

    def write(self, group: str, line: str, shown: str = "") -> str:
        """Write an MB line; return why it is refused, or not read back as `shown`; empty if all is well."""
        if group not in self.groups:
            return f"there is no group {group}"
        for item in line.split(";"):
            domain, _, value = item.partition("=")
            if domain not in (self.domain, *self.others) or not value.isdecimal():
                return f'"{item[:40]}": there is no such domain or value'
            if not self.least <= int(value) <= self.most:
                return f"{value} is out of range, {self.least} to {self.most}"
            self.groups[group][domain] = ceil(Fraction(int(value), self.step)) * self.step
        have = self.schemata(group)
        return f"schemata reads {have}, the script expects {shown}" if shown and have != shown else ""

    def schemata(self, group: str) -> str:
        """Return the values of a group as its file shows them."""
        have = self.groups[group]
        return ";".join(f"{d}={self._percent(have.get(str(d), self.most))}" for d in self.domains)

    def _percent(self, value: int) -> int:
        if self.kind != "mpam":
            return value
        return round_half_up(Fraction((self.band(value) + 1) * 100, 1 << self.width))

    def band(self, value: int) -> int:
        """Return the field that MPAM's driver makes of a percentage."""
        return (max(round_half_up(Fraction(value << self.width, 100)), 1) - 1) & ((1 << self.width) - 1)

    def rate(self, value: int) -> Fraction:
        """Return the bytes per second that a value in force stands for; a level that is not stated is unknown."""
        if self.kind == "amd":
            return Fraction(value * EIGHTH)
        if self.kind == "mpam":
            return Fraction((self.band(value) + 1) * self.peak, 1 << self.width)
        if self.levels:
            return self.levels.get(value, Fraction(self.peak))
        return Fraction(value * self.peak, 100)

    def least_for(self, rate: Fraction) -> int:
        """Return the value in force that gives a rate and least more, or the one that gives most."""
        lowest = self.least if self.kind == "mpam" else max(self.least, 1)
        taken = {ceil(Fraction(n, self.step)) * self.step for n in range(lowest, self.most + 1)}
        known = [
            n for n in sorted(taken) if (n in self.levels if self.levels else self.kind == "mpam" or n <= self.most)
        ]
        return min((n for n in known if self.rate(n) >= rate), key=self.rate, default=max(known, key=self.rate))


def round_half_up(value: Fraction) -> int:
    """Return the nearest integer, of two the larger, as the kernel's DIV_ROUND_CLOSEST does."""
    return floor(value + Fraction(1, 2))


def execute(case: Case) -> None:
    """Execute the script of every table, after each that may come before it."""
    _, numbered = scripts_of(case, ".sh")
    groups = {unit.name: case.platform.units[unit.name].get("group", "") for unit in case.tables.units}
    if len(set(groups.values())) != len(groups) or "" in groups.values():
        case.note(DEVICE_REFUSES, "", "every unit must have a group of its own, and two have the same or none")
        return
    names = {group: unit for unit, group in groups.items()} | {ROOT: REST}
    nothing = FileSystem(case)
    if nothing.kind == "intel" and not nothing.levels:
        case.caveat = "approximately: percentages of MBA were not measured"
    elif nothing.kind == "mpam" and case.platform.peak is None:
        case.caveat = "if the component's maximum is the capacity"
    lowest = nothing.least_for(ZERO)
    final: dict[int, FileSystem] = {}
    for index, script in numbered.items():
        final[index] = FileSystem(case)
        _run(case, final[index], script, is_noted=False)
    for plan in case.planned:
        loaded = numbered.get(plan.table.index)
        if loaded is None:
            continue
        script, system, table = loaded, FileSystem(case), plan.table
        made = _run(case, system, script)
        formers = [final[t.index] for t in case.tables.before(table) if t.index in final]
        befores = [{g: d.get(system.domain, system.most) for g, d in former.groups.items()} for former in formers]
        rates.fall_first(case, script.name, table, made, befores)
        for before in befores:
            changes = [(f" while {group} changes", {group: value}) for group, value in made]
            rates.rise(case, script.name, table, before, changes, system.rate)
        have = {
            names.get(g, g): domains[system.domain] for g, domains in system.groups.items() if system.domain in domains
        }
        promised = {REST: ZERO, **rates.unit_peaks(case, plan)}
        rates.compare(case, script.name, table, have, promised, system.least_for, system.rate)
        for group, domains in system.groups.items():
            for domain in system.others:
                if domains.get(domain) != lowest:
                    text = f"domain {domain} of {names.get(group, group)} is not at the least, {lowest}"
                    case.note(DEVICE_REFUSES, script.name, text, path=about(table=table.name))


def _run(case: Case, system: FileSystem, script: Script, *, is_noted: bool = True) -> list[tuple[str, int]]:
    """Execute a script; return the groups with the values that came into force, in order."""
    known = len(case.findings)
    made: list[tuple[str, int]] = []
    count = len(case.tables.units)
    for line in take(case, script, _begin(system, count)):
        put, group = PUT.fullmatch(line.text), GROUP.fullmatch(line.text)
        case.steps += is_noted
        if group and group[1] in system.groups:
            case.note(NOT_UNDERSTOOD, script.name, f"makes group {group[1]} again", line=line.number)
        elif group:
            system.groups[group[1]] = {}
        elif put:
            before = dict(system.groups.get(put[1], {}))
            refused = system.write(put[1], put[2], put[3])
            refused = refused or ("changes nothing" if system.groups[put[1]] == before else "")
            made.append((put[1], system.groups.get(put[1], {}).get(system.domain, system.most)))
            if refused:
                case.note(DEVICE_REFUSES, script.name, refused, line=line.number)
        else:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}"', line=line.number)
    if not is_noted:
        del case.findings[known:]
    return made


def _begin(system: FileSystem, groups: int) -> tuple[str, ...]:
    """Return the lines that a script begins with: it looks at the kernel first, and reads every write back."""
    fails = '{ echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }'
    closids = "$(cat info/MB/num_closids)"
    return (
        "set -e",
        "cd /sys/fs/resctrl",
        "expect() {",
        '  [ "$2" = "$3" ] || { echo "$1 is $2, the platform file says $3" >&2; exit 1; }',
        "}",
        "shown() {",
        """  sed -n 's/^ *MB:/MB:/p' "$1/schemata" | tr -d ' '""",
        "}",
        "put() {",
        f'  echo "$2" > "$1/schemata" || {fails}',
        f'  [ "$(cat info/last_cmd_status)" = ok ] || {fails}',
        '  [ "$(shown "$1")" = "$3" ] || { echo "$1: $2 became $(shown "$1"), not $3" >&2; exit 1; }',
        "}",
        """expect mba_MBps "$(grep -c ' /sys/fs/resctrl resctrl [^ ]*mba_MBps' /proc/mounts)" 0""",
        f'expect min_bandwidth "$(cat info/MB/min_bandwidth)" {system.least}',
        f'expect bandwidth_gran "$(cat info/MB/bandwidth_gran)" {system.step}',
        f"""expect domains "$(shown . | sed 's/MB://; s/=[0-9]*//g')" '{";".join(map(str, system.domains))}'""",
        f'[ "{closids}" -gt {groups} ] || {{ echo "num_closids is {closids}, needed are {groups + 1}" >&2; exit 1; }}',
    )
