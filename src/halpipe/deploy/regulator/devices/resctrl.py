"""Linux resctrl on a model of its file system: which groups there are, and what it makes of a schemata line.

From the kernel's Documentation/filesystems/resctrl.rst: a value below the least or above the largest is refused,
others go up to the next step (none is written that does); a new group, and the root group, have everything until they
are written; every domain has a value of its own. Arm's driver takes the nearest of its parts for a percentage.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, NOT_UNDERSTOOD
from halpipe.deploy.regulator.devices import rates
from halpipe.deploy.regulator.devices.loading import scripts_of, take
from halpipe.deploy.regulator.promise import ZERO

if TYPE_CHECKING:
    from halpipe.deploy.regulator.devices import Case
    from halpipe.deploy.regulator.devices.loading import Script

ROOT, REST = ".", "everything else"
EIGHTH = 125_000_000
PUT = re.compile(r"put (\.|[A-Za-z0-9_][A-Za-z0-9_.-]*) 'MB:([0-9=;]+)'")
GROUP = re.compile(r"mkdir -p ([A-Za-z0-9_][A-Za-z0-9_.-]*)")


class FileSystem:
    """The groups with the value of every domain; what was not written has everything."""

    def __init__(self, case: Case) -> None:
        settings = case.facts.settings["resctrl"]
        self.kind, self.capacity = settings["kind"], case.facts.capacity
        self.parts = 2 ** int(settings["width"])
        grain = {"intel": 10, "amd": 1, "mpam": max(1, 100 // self.parts)}[self.kind]
        self.least, self.step = int(settings["min"] or grain), int(settings["step"] or grain)
        self.most = 2048 if self.kind == "amd" else 100
        self.domain, self.others = settings["domain"], settings["others"].split()
        self.groups: dict[str, dict[str, int]] = {ROOT: {}}

    def write(self, group: str, line: str) -> str:
        """Write an MB line; return why it is refused, empty if it is not."""
        if group not in self.groups:
            return f"there is no group {group}"
        for item in line.split(";"):
            domain, _, value = item.partition("=")
            if domain not in (self.domain, *self.others) or not value.isdecimal():
                return f'"{item[:40]}": there is no such domain or value'
            if not self.least <= int(value) <= self.most:
                return f"{value} is out of range, {self.least} to {self.most}"
            if (int(value) - self.least) % self.step:
                return f"{value} is no step: the kernel takes the next, {self.least} and multiples of {self.step} above"
            self.groups[group][domain] = int(value)
        return ""

    def rate(self, value: int) -> Fraction:
        """Return the bytes per second that a value stands for."""
        if self.kind == "amd":
            return Fraction(value * EIGHTH)
        if self.kind == "intel":
            return Fraction(value * self.capacity, 100)
        return Fraction(max(1, (2 * value * self.parts + 100) // 200) * self.capacity, self.parts)

    def least_for(self, rate: Fraction) -> int:
        """Return the smallest step that gives a rate, or the largest there is."""
        values = range(self.least, self.most + 1, self.step)
        return next((value for value in values if self.rate(value) >= rate), values[-1])


def execute(case: Case) -> None:
    """Execute the script of every table, after each that may come before it."""
    _, numbered = scripts_of(case, ".sh")
    groups = {unit.name: case.facts.units[unit.name].get("group", "") for unit in case.tables.units}
    if len(set(groups.values())) != len(groups) or "" in groups.values():
        case.note(DEVICE_REFUSES, "", "every unit must have a group of its own, and two have the same or none")
        return
    names = {group: unit for unit, group in groups.items()} | {ROOT: REST}
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
        values = [(group, int(line.split(";")[0].partition("=")[2] or 0)) for group, line in made]
        befores = [{g: d.get(system.domain, system.most) for g, d in former.groups.items()} for former in formers]
        rates.fall_first(case, script.name, table, values, befores)
        for before in case.tables.before(table):
            _rise(case, final, before.index, script, names, table.index)
        have = {
            names.get(g, g): domains[system.domain] for g, domains in system.groups.items() if system.domain in domains
        }
        promised = {REST: ZERO, **rates.unit_peaks(case, plan)}
        rates.compare(case, script.name, table, have, promised, system.least_for, system.rate)
        for group, domains in system.groups.items():
            for domain in system.others:
                if domains.get(domain) != system.least:
                    text = f"domain {domain} of {names.get(group, group)} is not at the least, {system.least}"
                    case.note(DEVICE_REFUSES, script.name, text, path=about(table=table.name))


def _run(case: Case, system: FileSystem, script: Script, *, is_noted: bool = True) -> list[tuple[str, str]]:
    """Execute a script; return its writes."""
    known = len(case.findings)
    made: list[tuple[str, str]] = []
    for line in take(case, script, _begin(system)):
        put, group = PUT.fullmatch(line.text), GROUP.fullmatch(line.text)
        case.steps += is_noted
        if group and group[1] in system.groups:
            case.note(NOT_UNDERSTOOD, script.name, f"makes group {group[1]} again", line=line.number)
        elif group:
            system.groups[group[1]] = {}
        elif put:
            before = dict(system.groups.get(put[1], {}))
            refused = system.write(put[1], put[2])
            refused = refused or ("changes nothing" if system.groups[put[1]] == before else "")
            made.append((put[1], put[2]))
            if refused:
                case.note(DEVICE_REFUSES, script.name, refused, line=line.number)
        else:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}"', line=line.number)
    if not is_noted:
        del case.findings[known:]
    return made


def _rise(
    case: Case, final: dict[int, FileSystem], before: int, script: Script, names: dict[str, str], index: int
) -> None:
    """Note the first write after which all shares together are above the capacity."""
    if before not in final:
        return
    system, table = FileSystem(case), case.tables.tables[index]
    system.groups = {group: dict(domains) for group, domains in final[before].groups.items()}
    known = len(case.findings)
    for group, line in _run(case, FileSystem(case), script, is_noted=False):
        system.write(group, line)
        values = {names.get(g, g): d[system.domain] for g, d in system.groups.items() if system.domain in d}
        granted = {owner: system.rate(value) for owner, value in values.items()}
        rates.hold(case, script.name, table, granted, f" while {group} changes")
        if len(case.findings) > known:
            return


def _begin(system: FileSystem) -> tuple[str, ...]:
    """Return the lines that a script begins with: it looks at the steps, and reads the status of every write back."""
    fails = '{ echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }'
    differs = '{ echo "$1 is $(cat "$1"), the platform file says $2" >&2; exit 1; }'
    return (
        "set -e",
        "cd /sys/fs/resctrl",
        "expect() {",
        f'  [ "$(cat "$1")" = "$2" ] || {differs}',
        "}",
        "put() {",
        f'  echo "$2" > "$1/schemata" || {fails}',
        f'  [ "$(cat info/last_cmd_status)" = ok ] || {fails}',
        "}",
        f"expect info/MB/min_bandwidth {system.least}",
        f"expect info/MB/bandwidth_gran {system.step}",
    )
