"""Reader of the task model XML (schema task-model-1.xsd): hardened parse, schema check, hand-made binding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import parse_xml, read_bytes, refuse_more_than, sha256
from halpipe.core.records import unchecked
from halpipe.importers.native.binding import Binder, Children, only
from halpipe.models import (
    WHOLE,
    Access,
    Chain,
    HealthRule,
    Interrupt,
    Mode,
    Origin,
    Precedence,
    Resource,
    Run,
    Source,
    Split,
    Task,
    TaskModel,
    Transfer,
    Transition,
    Unit,
    Version,
)
from halpipe.models.attributes import DURATIONS
from halpipe.schemas import TASK_MODEL, check, line_of, namespace

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.core.diagnostics import Diagnostic

# Of these there are many, and what reads their attributes has made the types that a class would else look at again.
new_task, new_run, new_version, new_split = unchecked(Task), unchecked(Run), unchecked(Version), unchecked(Split)
new_access, new_transfer, new_precedence = unchecked(Access), unchecked(Transfer), unchecked(Precedence)


def read_model(path: str) -> TaskModel:
    """Read a task model file (``-``: standard input); raise `HalpipeError` with everything wrong in its form.

    What the model means is not judged here: see `halpipe.pipeline.validate`.
    """
    return parse_model(read_bytes(path), path)


def parse_model(data: bytes, file: str, *, is_checked: bool = False) -> TaskModel:
    """Read a task model from the bytes of `file`; `is_checked`: our own writer has held them against the schema."""
    root = parse_xml(data, file)
    violations = [] if is_checked else check(root, TASK_MODEL, file)
    if violations:
        raise HalpipeError(*violations)
    return _model(root, file, sha256(data))


RESTRICTIONS = {"resume": "0ms", "min-part": "1ns", "max-gaps": "100"}
"""Attributes of a version that only restrict it, and values that do not: what else a model means can be judged."""

SPLIT = frozenset({"split", *RESTRICTIONS})
"""Attributes of a version that say how it is split."""


def read_what_is_well_formed(path: str) -> tuple[TaskModel, list[Diagnostic]]:
    """Read a task model of which nothing but restrictions may be malformed: those then restrict nothing.

    Return the model with the violations of the schema, so that all that is wrong can be told at once; raise
    `HalpipeError` if there are others.
    """
    data = read_bytes(path)
    root = parse_xml(data, path)
    violations = check(root, TASK_MODEL, path)
    lines = {violation.at.line for violation in violations}
    for element in root.iter(f"{{{namespace(TASK_MODEL)}}}version") if violations else ():
        for name in RESTRICTIONS.keys() & element.attrib.keys() if line_of(element) in lines else ():
            element.set(str(name), RESTRICTIONS[str(name)])
    if violations and check(root, TASK_MODEL, path):
        raise HalpipeError(*violations)
    return _model(root, path, sha256(data)), violations


def _model(root: etree._Element, file: str, digest: str) -> TaskModel:
    _bound(root, file)
    bind = _ModelBinder(file, namespace(TASK_MODEL))
    model = bind.model(root, digest)
    bind.findings.stop_on_errors()
    return model


MOST = (
    ("t:tasks", "task", 100_000),
    ("t:modes", "mode", 500),
    ("t:platform/t:unit", "interrupt", 200),
    ("t:tasks/t:task/t:version", "access", 20_000),
)
"""What holds what, and how many: modes are looked at in pairs, sums over interrupts and phases are exact fractions."""


def _bound(root: etree._Element, file: str) -> None:
    names = {"t": namespace(TASK_MODEL)}
    for holder, held, limit in MOST:
        for element in root.xpath(f"{holder}[t:{held}[{limit + 1}]]", namespaces=names):
            count, name = len(element.findall(f"t:{held}", names)), holder.rpartition("t:")[2]
            refuse_more_than(limit, count, f"<{held}> in one <{name}>", Location(file, line_of(element)))


class _ModelBinder(Binder):
    """One method per element type, in the order of the schema."""

    def model(self, root: etree._Element, digest: str) -> TaskModel:
        sections = self.children(root)
        platform = self.section(sections, "platform")
        return TaskModel(
            **self.values(TaskModel, root),
            units=tuple(map(self.unit, platform.get("unit", ()))),
            resources=tuple(map(self.resource, platform.get("resource", ()))),
            tasks=self.tasks(only(sections, "tasks")),
            chains=tuple(map(self.chain, self.section(sections, "chains").get("chain", ()))),
            modes=tuple(map(self.mode, self.section(sections, "modes").get("mode", ()))),
            transitions=tuple(map(self.transition, self.section(sections, "transitions").get("transition", ()))),
            health=tuple(map(self.rule, self.section(sections, "health").get("rule", ()))),
            origin=self.origin(sections),
            at=self.at(root),
        ).read_from(digest)

    def section(self, sections: Children, name: str) -> Children:
        found = only(sections, name)
        return {} if found is None else self.children(found)

    def origin(self, children: Children) -> Origin | None:
        found = only(children, "origin")
        return None if found is None else Origin(**self.values(Origin, found))

    def unit(self, e: etree._Element) -> Unit:
        parts = self.children(e)
        interrupts = tuple(map(self.interrupt, parts.get("interrupt", ())))
        return Unit(**self.values(Unit, e), interrupts=interrupts, origin=self.origin(parts), at=self.at(e))

    def interrupt(self, e: etree._Element) -> Interrupt:
        return Interrupt(**self.values(Interrupt, e), origin=self.origin(self.children(e)), at=self.at(e))

    def resource(self, e: etree._Element) -> Resource:
        return Resource(**self.values(Resource, e), origin=self.origin(self.children(e)), at=self.at(e))

    def tasks(self, e: etree._Element | None) -> tuple[Task, ...]:
        """Read the list of tasks; what it states itself holds for those that do not state their own."""
        if e is None:
            return ()
        common = self.values(Task, e)
        return tuple(self.task(task, common) for task in self.children(e).get("task", ()))

    def task(self, e: etree._Element, common: dict[str, Any]) -> Task:
        parts = self.children(e)
        versions = tuple(map(self.version, parts.get("version", ())))
        values = {**common, **self.values(Task, e)}
        return new_task(**values, versions=versions, origin=self.origin(parts), at=self.at(e))

    def version(self, e: etree._Element) -> Version:
        parts = self.children(e)
        source = only(parts, "source")
        return new_version(
            **self.values(Version, e),
            **self.values(Version, only(parts, "units"), "units"),
            accesses=tuple(map(self.access, parts.get("access", ()))),
            precedences=tuple(map(self.precedence, parts.get("precedence", ()))),
            source=None if source is None else Source(**self.values(Source, source), at=self.at(source)),
            split=self.split(e),
            origin=self.origin(parts),
            at=self.at(e),
        )

    def split(self, e: etree._Element) -> Split:
        """Read where jobs may be interrupted: points, or a word that says it."""
        if SPLIT.isdisjoint(e.keys()):
            return WHOLE
        stated = e.get("split", "none").strip()
        is_list = stated not in ("none", "anywhere")
        points = self.read(e, "split", stated, DURATIONS) if is_list else ()
        return new_split(**self.values(Split, e), points=points, anywhere=stated == "anywhere")

    def access(self, e: etree._Element) -> Access:
        transfers = tuple(map(self.transfer, self.children(e).get("transfer", ()))) if len(e) else ()
        return new_access(**self.values(Access, e), transfers=transfers, at=self.at(e))

    def transfer(self, e: etree._Element) -> Transfer:
        return new_transfer(**self.values(Transfer, e), at=self.at(e))

    def precedence(self, e: etree._Element) -> Precedence:
        return new_precedence(**self.values(Precedence, e), origin=self.origin(self.children(e)), at=self.at(e))

    def chain(self, e: etree._Element) -> Chain:
        return Chain(**self.values(Chain, e), origin=self.origin(self.children(e)), at=self.at(e))

    def mode(self, e: etree._Element) -> Mode:
        parts = self.children(e)
        runs = tuple(map(self.run, parts.get("run", ())))
        return Mode(**self.values(Mode, e), runs=runs, origin=self.origin(parts), at=self.at(e))

    def run(self, e: etree._Element) -> Run:
        return new_run(**self.values(Run, e), at=self.at(e))

    def transition(self, e: etree._Element) -> Transition:
        return Transition(**self.values(Transition, e), origin=self.origin(self.children(e)), at=self.at(e))

    def rule(self, e: etree._Element) -> HealthRule:
        return HealthRule(**self.values(HealthRule, e), origin=self.origin(self.children(e)), at=self.at(e))
