"""The processes of node instances as callbacks: what triggers them, how often, and what they publish.

A process that another one triggers reads an inner topic, called ``<node>~<process>``, which the other publishes. Of
several triggers, whichever comes counts: like the format's own tool, the importer takes the highest rate of all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import Duration, seconds
from halpipe.core.files import YamlList, YamlMap
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.design.structure import PUBLISHER, SUBSCRIBER, Port
from halpipe.importers.ros.names import printable
from halpipe.importers.ros.sources.graph import Callback, Kind, Publication, Subscription

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.design.entities import Catalogue
    from halpipe.importers.ros.design.structure import Instance, Structure

_RATE = re.compile(r"[0-9]{1,9}(?:\.[0-9]{1,9})?")
_VARIABLE = re.compile(r"\$\((?:var|param|parameter) ([\w./-]+)\)|\$\{(?:parameter |var )?([\w./-]+)\}")
_OUTPUTS = ("to_output", "to_output_topic")
_HINTS = ("warn_rate", "error_rate", "timeout", "name")


@dataclass(slots=True)
class _Triggers:
    """What starts a process: rates, ports and other processes; `once` are ports that it only waits for at first."""

    period: Duration | None = None
    ports: dict[str, None] = field(default_factory=dict)
    processes: dict[str, None] = field(default_factory=dict)
    once: dict[str, None] = field(default_factory=dict)


@dataclass(slots=True)
class NodeProcesses:
    """Reads the processes of one node instance; the lists hold what was found."""

    instance: Instance
    structure: Structure
    catalogue: Catalogue
    values: Mapping[str, str]
    callbacks: list[Callback] = field(default_factory=list)
    publications: list[Publication] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)

    def read(self, coverage: Coverage) -> None:
        """Read all processes, then the ports that they use and those that none uses."""
        body, path = self.instance.body, self.instance.path
        reader = self.catalogue.reader(body)
        where = f'node "{path}"'
        ports = {side: self._ports(side) for side in (PUBLISHER, SUBSCRIBER)}
        entries = {}
        for entry in reader.entries(body, "processes", where):
            name = reader.text(entry, "name", where)
            if name in entries:
                help = "rename one of the two"
                at = self.catalogue.at(entry)
                self.catalogue.findings.add(
                    codes.DUPLICATE("is declared again", at=at, path=f'{where} process "{name}"', help=help)
                )
            elif name:
                entries[name] = entry
        triggers = {name: self._triggers(entry, f'{where} process "{name}"') for name, entry in entries.items()}
        published = self._outcomes(entries, triggers, ports[PUBLISHER])
        asked = dict.fromkeys(name for found in triggers.values() for name in found.processes if name in entries)
        self.publications += [
            Publication(
                node=path, topic=f"{path}~{name}", callbacks=(f"{path}/{name}",), at=self.catalogue.at(entries[name])
            )
            for name in asked
        ]
        read: set[str] = set()
        for name, entry in entries.items():
            read |= self._callback(name, entry, triggers[name], ports[SUBSCRIBER])
        self._unused(ports, published, read, coverage)

    def _ports(self, side: str) -> dict[str, YamlMap]:
        reader = self.catalogue.reader(self.instance.body)
        keys = ("publishers", "outputs") if side == PUBLISHER else ("subscribers", "inputs")
        key = next((key for key in keys if key in self.instance.body), keys[0])
        return {str(e.get("name")): e for e in reader.entries(self.instance.body, key, "ports")}

    # -------------------------------------------------------------------------------------------- triggers

    def _triggers(self, entry: YamlMap, where: str) -> _Triggers:
        found = _Triggers()
        self._gather(entry.get("trigger_conditions"), entry, where, found, 0)
        return found

    def _gather(self, value: Any, entry: YamlMap, where: str, into: _Triggers, depth: int) -> None:
        """Read conditions, however ``and`` and ``or`` nest them."""
        reader = self.catalogue.reader(entry)
        if value is None:
            return
        if isinstance(value, YamlList):
            for item in value:
                self._gather(item, entry, where, into, depth + 1)
            return
        if not isinstance(value, YamlMap):
            reader.malformed("trigger_conditions lists something that is no condition", entry.line, where)
            return
        for key, inner in value.items():
            text = printable(inner) if isinstance(inner, str) else ""
            if key in ("and", "or"):
                self._gather(inner, entry, where, into, depth + 1)
            elif key == "periodic":
                period = self._period(text, value, where)
                into.period = min((p for p in (into.period, period) if p is not None), default=None)
            elif key == "on_input" and text:
                into.ports[text] = None
            elif key == "on_trigger" and text:
                into.processes[text] = None
            elif key == "once":
                into.once.update({text: None} if text else {})
            elif key not in _HINTS:
                reader.check_keys(_only(value, key), where, ("periodic", "on_input", "on_trigger", "once", "and", "or"))

    def _period(self, text: str, condition: YamlMap, where: str) -> Duration | None:
        """Return the period of a rate in Hz, exactly; variables have the value that the instance or its node gives."""
        match = _VARIABLE.fullmatch(text)
        shown, name = text, ""
        if match is not None:
            name = match[1] or match[2]
            text = self.values.get(name, "")
        at = self.catalogue.at(condition)
        if _RATE.fullmatch(text) and Fraction(text):
            return seconds(1 / Fraction(text))
        what = f'"{shown}" has the value "{text}"' if name and text else f'"{shown}" has no value' if name else shown
        problem = f"periodic: {what or 'nothing'}; it must be a rate in Hz above 0"
        help = "state the rate as a number, or give the parameter a default in param_values"
        self.catalogue.findings.add(codes.NO_RATE(problem, at=at, path=where, help=help))
        return None

    # -------------------------------------------------------------------------------------------- data flow

    def _outcomes(
        self, entries: Mapping[str, YamlMap], triggers: Mapping[str, _Triggers], ports: Mapping[str, YamlMap]
    ) -> set[str]:
        """Add what every process publishes; let those it triggers know of it; return the ports that are used."""
        path, used = self.instance.path, set()
        for name, entry in entries.items():
            reader = self.catalogue.reader(entry)
            where = f'node "{path}" process "{name}"'
            at = self.catalogue.at(entry)
            me = (f"{path}/{name}",)
            for outcome in reader.entries(entry, "outcomes", where):
                for key, value in outcome.items():
                    target = printable(value) if isinstance(value, str) else ""
                    if key in _OUTPUTS:
                        topic = self.structure.topic(Port(path, PUBLISHER, target))
                        self.publications.append(Publication(node=path, topic=topic, callbacks=me, at=at))
                        used.add(target)
                        self._known("publisher", target, ports, where, outcome)
                    elif key == "to_trigger":
                        if self._known("process", target, triggers, where, outcome) and not triggers[target].period:
                            triggers[target].processes[name] = None
                    elif key != "terminal":
                        reader.check_keys(_only(outcome, key), where, ("to_output", "to_trigger", "terminal"))
        return used

    def _callback(self, name: str, entry: YamlMap, triggers: _Triggers, ports: Mapping[str, YamlMap]) -> set[str]:
        """Add the callback of a process; return the ports that it reads."""
        path, at = self.instance.path, self.catalogue.at(entry)
        where = f'node "{path}" process "{name}"'
        inputs: dict[str, None] = {}
        for port in triggers.ports:
            self._known("subscriber", port, ports, where, entry)
            for topic in self.structure.topics(Port(path, SUBSCRIBER, port)):
                inputs[topic] = None
                self.subscriptions.append(
                    Subscription(node=path, topic=topic, callback=f"{path}/{name}", at=at),
                )
        siblings = [
            str(e.get("name")) for e in self.catalogue.reader(entry).entries(self.instance.body, "processes", "")
        ]
        for process in triggers.processes:
            if self._known("process", process, dict.fromkeys(siblings), where, entry):
                inputs[f"{path}~{process}"] = None
        self.callbacks.append(
            Callback(
                name=f"{path}/{name}",
                node=path,
                kind=Kind.PROCESS,
                period=triggers.period,
                inputs=tuple(inputs),
                at=at,
            )
        )
        return set(triggers.ports) | set(triggers.once)

    def _unused(
        self, ports: Mapping[str, Mapping[str, YamlMap]], published: set[str], read: set[str], coverage: Coverage
    ) -> None:
        path = self.instance.path
        for name, entry in ports[PUBLISHER].items():
            if name not in published:
                coverage.ignored("publisher", f"{path} {name}", "no process states it as its output", self._at(entry))
        for name, entry in ports[SUBSCRIBER].items():
            if name not in read:
                coverage.ignored("subscription", f"{path} {name}", "it triggers no process", self._at(entry))

    def _at(self, entry: YamlMap) -> Any:
        return self.catalogue.at(entry)

    def _known(self, kind: str, name: str, known: Mapping[str, Any], where: str, element: YamlMap) -> bool:
        if name in known:
            return True
        help = did_you_mean(name, known, f"declare the {kind}, or remove its name here")
        at = self.catalogue.at(element)
        self.catalogue.findings.add(codes.LOOSE_CONNECTION(f'no {kind} "{name}"', at=at, path=where, help=help))
        return False


def _only(element: YamlMap, key: str) -> YamlMap:
    one = YamlMap(element.line)
    one[key] = element[key]
    one.lines[key] = element.line_of(key)
    return one
