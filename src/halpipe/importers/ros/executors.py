"""Reader of executor configurations as halpipe writes them: the model that a launcher realises, read back.

Executors, callback groups and timers repeat what the schedule says; a model is what it was made from, so they are
accounted for as ignored. Resources, access phases and sources are not in the file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import Location, about, named
from halpipe.core.quantities import quoted
from halpipe.core.settings import Fields
from halpipe.core.suggest import did_you_mean
from halpipe.importers.common.stated import complete_attributes, keys_of, stated_attributes
from halpipe.importers.common.stated import name as name_text
from halpipe.importers.ros import codes
from halpipe.models import (
    Chain,
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

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.files import YamlMap
    from halpipe.importers.common.base import Coverage

E = TypeVar("E", Unit, Task, Chain, Mode, Version)

KEY = "halpipe-executors"
VERSION = "1"
_ELEMENTS = ("units", "tasks", "chains", "transitions", "health", "modes")
_TOP = (KEY, "model", "model-sha256", "scheduling", *_ELEMENTS, "not-realised")
_NOT_WRITTEN = ("distance", "binding")
"""Attributes of tasks that an executors file does not have; nothing in it could realise them."""
_TASK = (*keys_of(Task, *_NOT_WRITTEN), "versions")
_VERSION = (*keys_of(Version), "after")
_MODE = ("name", "runs", "cycle-ns", "executors")
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
                (Unit(**self._stated(f, Unit), origin=self._origin(f)), f)
                for f in self.top.items("units", (*keys_of(Unit), "cpu"), "unit")
            ),
        )
        tasks = self._unique("task", ((self._task(f), f) for f in self.top.items("tasks", _TASK, "task")))
        chains = self._unique("chain", ((self._chain(f), f) for f in self.top.items("chains", keys_of(Chain), "chain")))
        modes = self._unique("mode", ((self._mode(f), f) for f in self.top.items("modes", _MODE, "mode")))
        transitions = self.top.items("transitions", keys_of(Transition), "transition")
        rules = self.top.items("health", keys_of(HealthRule), "health rule")
        model = TaskModel(
            name=self.top.value("model", name_text, "ros"),
            units=units,
            tasks=tasks,
            chains=chains,
            modes=modes,
            transitions=tuple(found for f in transitions if (found := self._transition(f))),
            health=tuple(rule for f in rules if (rule := self._rule(f))),
            origin=Origin(self.file),
        )
        self._check_references(model)
        return model

    def _origin(self, fields: Fields) -> Origin:
        return Origin(self.file, fields.at().line, fields.value("name", name_text, ""))

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
        stated = self._stated(fields, Task, *_NOT_WRITTEN)
        path = about(task=stated["name"])
        versions = ((self._version(f, path), f) for f in fields.items("versions", _VERSION, path))
        return Task(**stated, versions=self._unique("version", versions), origin=self._origin(fields))

    def _version(self, fields: Fields, path: str) -> Version:
        rows = (self._precedence(f) for f in fields.items("after", keys_of(Precedence), f"{path} after"))
        after = tuple(row for row in rows if row)
        return Version(**self._stated(fields, Version), precedences=after, origin=self._origin(fields))

    def _precedence(self, fields: Fields) -> Precedence | None:
        self.coverage.mapped("precedence")
        found = complete_attributes(fields, Precedence)
        return None if found is None else Precedence(**found, origin=Origin(self.file, fields.at().line))

    def _chain(self, fields: Fields) -> Chain:
        fields.require("tasks")
        return Chain(**{"tasks": (), **self._stated(fields, Chain)}, origin=self._origin(fields))

    def _stated(self, fields: Fields, kind: type, *without: str) -> dict[str, Any]:
        """Return what is stated of an element by field; what has no name is reported where the elements are listed."""
        found = stated_attributes(fields, kind, *without)
        return {"name": "", **{field: stated.value for field, stated in found.items()}}

    def _mode(self, fields: Fields) -> Mode:
        name = fields.value("name", name_text, "")
        rows = (complete_attributes(f, Run) for f in fields.items("runs", keys_of(Run), f'mode "{name}" run'))
        runs = tuple(Run(**row) for row in rows if row is not None)
        for executor in fields.items("executors", (), f'mode "{name}" executor'):
            shown = executor.value("name", str, "")
            self.coverage.ignored("executor", f"{name} {shown}", _OF_THE_SCHEDULE, executor.at())
        return Mode(name=name, runs=runs, origin=self._origin(fields))

    def _transition(self, fields: Fields) -> Transition | None:
        self.coverage.mapped("transition")
        found = complete_attributes(fields, Transition)
        return None if found is None else Transition(**found, origin=Origin(self.file, fields.at().line))

    def _rule(self, fields: Fields) -> HealthRule | None:
        self.coverage.mapped("health rule")
        found = complete_attributes(fields, HealthRule)
        return None if found is None else HealthRule(**found, origin=Origin(self.file, fields.at().line))

    # -------------------------------------------------------------------------------------------- references

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


def _format_version(text: str) -> str:
    if text != VERSION:
        raise ValueError(f"{quoted(text)} is no version of the format; this halpipe reads version {VERSION}")
    return text
