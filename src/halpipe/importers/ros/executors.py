"""Reader of executor configurations as halpipe writes them: the model that a launcher realises, read back.

Executors, callback groups and timers repeat what the schedule says; a model is what it was made from, so they are
accounted for as ignored. Resources, access phases and sources are not in the file.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from halpipe.diagnostics import Location, about, named
from halpipe.durations import ZERO, Duration
from halpipe.importers.ros import codes
from halpipe.models import (
    Anchor,
    Chain,
    HealthAction,
    HealthEvent,
    HealthRule,
    Mode,
    Origin,
    Precedence,
    Run,
    Task,
    TaskModel,
    Transition,
    Unit,
    Version,
)
from halpipe.quantities import parse_rational, quoted
from halpipe.settings import Fields
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.diagnostics import Findings
    from halpipe.files import YamlMap
    from halpipe.importers.base import Coverage

E = TypeVar("E", Unit, Task, Chain, Mode, Version)

KEY = "halpipe-executors"
VERSION = "1"
_ELEMENTS = ("units", "tasks", "chains", "transitions", "health", "modes")
_TOP = (KEY, "model", "model-sha256", "scheduling", *_ELEMENTS, "not-realised")
_TASK = ("name", "period", "slack", "offset", "deadline", "versions")
_VERSION = ("name", "wcet", "units", "gang", "after")
_AFTER = ("task", "from", "min", "max")
_CHAIN = ("name", "tasks", "max-reaction", "max-age", "weight")
_RULE = ("task", "on", "count", "cycles", "action", "mode")
_MODE = ("name", "runs", "cycle-ns", "executors")
_NAME = re.compile(r"[A-Za-z0-9_./:~+@$%-]{1,1000}")
_OF_THE_SCHEDULE = "is what the schedule says, not the model"


def read_executors(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> TaskModel:
    """Return the model of a recognised document; findings name every value that cannot be read."""
    return _Reader(document, file, findings, coverage).model()


class _Reader:
    def __init__(self, document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> None:
        self.file = file
        self.findings = findings
        self.coverage = coverage
        self.top = Fields(file, findings, document, "executors file", _TOP)

    def model(self) -> TaskModel:
        """Read the whole file."""
        self.top.value(KEY, _format_version, "")
        self.top.require("model", "units", "tasks", "modes")
        units = self._unique(
            "unit",
            (
                (Unit(name=f.value("name", _name, ""), type=f.value("type", _name, ""), origin=self._origin(f)), f)
                for f in self.top.items("units", ("name", "type", "cpu"), "unit")
            ),
        )
        tasks = self._unique("task", ((self._task(f), f) for f in self.top.items("tasks", _TASK, "task")))
        chains = self._unique("chain", ((self._chain(f), f) for f in self.top.items("chains", _CHAIN, "chain")))
        modes = self._unique("mode", ((self._mode(f), f) for f in self.top.items("modes", _MODE, "mode")))
        model = TaskModel(
            name=self.top.value("model", _name, "ros"),
            units=units,
            tasks=tasks,
            chains=chains,
            modes=modes,
            transitions=tuple(
                self._transition(f) for f in self.top.items("transitions", ("from", "to", "max-length"), "transition")
            ),
            health=tuple(self._rule(f) for f in self.top.items("health", _RULE, "health rule")),
            origin=Origin(self.file),
        )
        self._check_references(model)
        return model

    def _origin(self, fields: Fields) -> Origin:
        return Origin(self.file, fields.at().line, fields.value("name", _name, ""))

    def _unique(self, kind: str, found: Iterable[tuple[E, Fields]]) -> tuple[E, ...]:
        """Return the elements; report what has no name or one that is taken."""
        first: dict[str, tuple[E, Location]] = {}
        for element, fields in found:
            self.coverage.mapped(kind)
            if not fields.require("name") or not element.name:
                continue
            if element.name in first:
                text = f"is declared again, first on line {first[element.name][1].line}"
                path, help = named(kind, element.name), "rename one of the two, or remove it"
                self.findings.add(codes.DUPLICATE(text, at=fields.at(), path=path, help=help))
            first.setdefault(element.name, (element, fields.at()))
        return tuple(element for element, _ in first.values())

    def _task(self, fields: Fields) -> Task:
        path = about(task=fields.value("name", _name, ""))
        versions = ((self._version(f, path), f) for f in fields.items("versions", _VERSION, path))
        return Task(
            name=fields.value("name", _name, ""),
            period=fields.value("period", _positive, None),
            slack=fields.value("slack", _share, Fraction(0)),
            offset=fields.value("offset", Duration.parse, None),
            deadline=fields.value("deadline", _positive, None),
            versions=self._unique("version", versions),
            origin=self._origin(fields),
        )

    def _version(self, fields: Fields, path: str) -> Version:
        return Version(
            name=fields.value("name", _name, ""),
            wcet=fields.value("wcet", Duration.parse, None),
            units=_names(fields, "units"),
            gang=fields.value("gang", _count, 1),
            precedences=tuple(
                found for f in fields.items("after", _AFTER, f"{path} after") if (found := self._precedence(f))
            ),
            origin=self._origin(fields),
        )

    def _precedence(self, fields: Fields) -> Precedence | None:
        self.coverage.mapped("precedence")
        latest = fields.value("max", Duration.parse, None)
        if not fields.require("task", "max") or latest is None:
            return None
        return Precedence(
            task=fields.value("task", _name, ""),
            min=fields.value("min", Duration.parse, ZERO),
            max=latest,
            anchor=fields.value("from", _anchor, Anchor.START),
            origin=Origin(self.file, fields.at().line),
        )

    def _chain(self, fields: Fields) -> Chain:
        fields.require("tasks")
        return Chain(
            name=fields.value("name", _name, ""),
            tasks=_names(fields, "tasks"),
            max_reaction=fields.value("max-reaction", Duration.parse, None),
            max_age=fields.value("max-age", Duration.parse, None),
            weight=fields.value("weight", parse_rational, Fraction(1)),
            origin=self._origin(fields),
        )

    def _mode(self, fields: Fields) -> Mode:
        name = fields.value("name", _name, "")
        runs = tuple(
            Run(task=f.value("task", _name, ""), versions=_names(f, "versions"))
            for f in fields.items("runs", ("task", "versions"), f'mode "{name}" run')
            if f.require("task", "versions")
        )
        for executor in fields.items("executors", (), f'mode "{name}" executor'):
            shown = executor.value("name", str, "")
            self.coverage.ignored("executor", f"{name} {shown}", _OF_THE_SCHEDULE, executor.at())
        return Mode(name=name, runs=runs, origin=self._origin(fields))

    def _transition(self, fields: Fields) -> Transition:
        self.coverage.mapped("transition")
        fields.require("from", "to")
        return Transition(
            source=fields.value("from", _name, ""),
            target=fields.value("to", _name, ""),
            max_length=fields.value("max-length", Duration.parse, None),
            origin=Origin(self.file, fields.at().line),
        )

    # -------------------------------------------------------------------------------------------- references

    def _rule(self, fields: Fields) -> HealthRule:
        self.coverage.mapped("health rule")
        fields.require("task", "action")
        return HealthRule(
            task=fields.value("task", _name, ""),
            event=fields.value("on", HealthEvent, HealthEvent.ANY),
            count=fields.value("count", _count, 1),
            cycles=fields.value("cycles", _count, 1),
            action=fields.value("action", HealthAction, HealthAction.STOP),
            mode=fields.value("mode", _name, ""),
            origin=Origin(self.file, fields.at().line),
        )

    def _check_references(self, model: TaskModel) -> None:
        tasks = {task.name: [version.name for version in task.versions] for task in model.tasks}
        units = [unit.name for unit in model.units]
        for task in model.tasks:
            for version in task.versions:
                path = about(task=task.name, version=version.name)
                for unit in version.units:
                    self._known("unit", unit, units, version.origin, path)
                for precedence in version.precedences:
                    self._known("task", precedence.task, list(tasks), precedence.origin, path)
        for chain in model.chains:
            for name in chain.tasks:
                self._known("task", name, list(tasks), chain.origin, f'chain "{chain.name}"')
        for mode in model.modes:
            for run in mode.runs:
                path = about(mode=mode.name)
                if self._known("task", run.task, list(tasks), mode.origin, path):
                    for name in run.versions:
                        self._known("version", name, tasks[run.task], mode.origin, f'{path} task "{run.task}"')

        modes = [mode.name for mode in model.modes]
        for transition in model.transitions:
            path = about(transition=(transition.source, transition.target))
            for name in (transition.source, transition.target):
                self._known("mode", name, modes, transition.origin, path)
        for rule in model.health:
            self._known("task", rule.task, list(tasks), rule.origin, "health rule")
            if rule.mode:
                self._known("mode", rule.mode, modes, rule.origin, "health rule")

    def _known(self, kind: str, name: str, known: Sequence[str], origin: Origin | None, path: str) -> bool:
        if name in known:
            return True
        at = origin.location if origin else Location(self.file)
        help = did_you_mean(name, known, f"declare the {kind}, or remove its name here")
        self.findings.add(codes.DANGLING(f'no {kind} "{name}"', at=at, path=path, help=help))
        return False


def _names(fields: Fields, key: str) -> tuple[str, ...]:
    stated = fields.texts_of(key, _name)
    return () if stated is None else stated.value


def _format_version(text: str) -> str:
    if text != VERSION:
        raise ValueError(f"{quoted(text)} is no version of the format; this halpipe reads version {VERSION}")
    return text


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise ValueError(f"{quoted(text)} is not a name; use letters, digits and _ . / : ~ + @ $ % -")
    return text


def _positive(text: str) -> Duration:
    duration = Duration.parse(text)
    if not duration:
        raise ValueError(f"{quoted(text)} is not above zero; write a positive duration")
    return duration


def _share(text: str) -> Fraction:
    value = parse_rational(text)
    if value > 1:
        raise ValueError(f"{quoted(text)} is above 1; write a share between 0 and 1")
    return value


def _count(text: str) -> int:
    if not re.fullmatch(r"[1-9][0-9]{0,5}", text):
        raise ValueError(f"{quoted(text)} is not a count; write a whole number from 1 to 999999")
    return int(text)


def _anchor(text: str) -> Anchor:
    if text not in tuple(Anchor):
        raise ValueError(f"{quoted(text)} is no anchor; write start or end")
    return Anchor(text)
