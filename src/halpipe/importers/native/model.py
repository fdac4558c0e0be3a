"""Reader of the task model XML (schema task-model-1.xsd): hardened parse, schema check, hand-made binding."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.durations import ZERO
from halpipe.files import parse_xml, read_bytes, sha256
from halpipe.importers.native.binding import Binder
from halpipe.models import (
    Access,
    AccessKind,
    Anchor,
    Chain,
    Mode,
    Origin,
    Precedence,
    Resource,
    Run,
    Source,
    Task,
    TaskModel,
    Transfer,
    Transition,
    Unit,
    Version,
)
from halpipe.schemas import TASK_MODEL, check, namespace

if TYPE_CHECKING:
    from lxml import etree

ONE = Fraction(1)
NONE = Fraction(0)


def read_model(path: str) -> TaskModel:
    """Read a task model file (``-``: standard input); raise `HalpipeError` with everything wrong in its form.

    What the model means is not judged here: see `halpipe.pipeline.validate`.
    """
    return parse_model(read_bytes(path), path)


def parse_model(data: bytes, file: str) -> TaskModel:
    """Read a task model from the bytes of `file`."""
    root = parse_xml(data, file)
    violations = check(root, TASK_MODEL, file)
    if violations:
        raise HalpipeError(*violations)
    bind = _ModelBinder(file, namespace(TASK_MODEL))
    model = bind.model(root, sha256(data))
    bind.findings.stop_on_errors()
    return model


class _ModelBinder(Binder):
    """One method per element type, in the order of the schema."""

    def model(self, root: etree._Element, digest: str) -> TaskModel:
        return TaskModel(
            name=self.text(root, "name"),
            units=tuple(self.unit(e) for e in self._section(root, "platform", "unit")),
            resources=tuple(self.resource(e) for e in self._section(root, "platform", "resource")),
            tasks=tuple(self.task(e) for e in self._section(root, "tasks", "task")),
            chains=tuple(self.chain(e) for e in self._section(root, "chains", "chain")),
            modes=tuple(self.mode(e) for e in self._section(root, "modes", "mode")),
            transitions=tuple(self.transition(e) for e in self._section(root, "transitions", "transition")),
            origin=self.origin(root),
            digest=digest,
            at=self.at(root),
        )

    def _section(self, root: etree._Element, section: str, tag: str) -> list[etree._Element]:
        parent = self.child(root, section)
        return [] if parent is None else self.children(parent, tag)

    def origin(self, element: etree._Element) -> Origin | None:
        found = self.child(element, "origin")
        if found is None:
            return None
        return Origin(self.text(found, "file"), self.integer(found, "line"), self.text(found, "path"))

    def unit(self, e: etree._Element) -> Unit:
        return Unit(name=self.text(e, "name"), type=self.text(e, "type"), origin=self.origin(e), at=self.at(e))

    def resource(self, e: etree._Element) -> Resource:
        bandwidth = self.optional_bandwidth(e, "bandwidth")
        return Resource(name=self.text(e, "name"), bandwidth=bandwidth, origin=self.origin(e), at=self.at(e))

    def task(self, e: etree._Element) -> Task:
        return Task(
            name=self.text(e, "name"),
            period=self.optional_duration(e, "period"),
            slack=self.rational(e, "slack", NONE),
            offset=self.optional_duration(e, "offset"),
            deadline=self.optional_duration(e, "deadline"),
            versions=tuple(self.version(v) for v in self.children(e, "version")),
            origin=self.origin(e),
            at=self.at(e),
        )

    def version(self, e: etree._Element) -> Version:
        units = self.child(e, "units")
        source = self.child(e, "source")
        return Version(
            name=self.text(e, "name"),
            wcet=self.optional_duration(e, "wcet"),
            units=() if units is None else self.names(units, "names"),
            gang=1 if units is None else self.integer(units, "gang", 1),
            accesses=tuple(self.access(a) for a in self.children(e, "access")),
            precedences=tuple(self.precedence(p) for p in self.children(e, "precedence")),
            source=None if source is None else self.source(source),
            origin=self.origin(e),
            at=self.at(e),
        )

    def access(self, e: etree._Element) -> Access:
        kind = self.text(e, "kind")
        return Access(
            resource=self.text(e, "resource"),
            start=self.duration(e, "start", ZERO),
            end=self.duration(e, "end", ZERO),
            bound=self.rational(e, "bound", ONE),
            kind=AccessKind(kind.strip()) if kind else None,
            transfers=tuple(self.transfer(t) for t in self.children(e, "transfer")),
            at=self.at(e),
        )

    def transfer(self, e: etree._Element) -> Transfer:
        size = self.size(e, "size")
        return Transfer(buffer=self.text(e, "buffer"), symbol=self.text(e, "symbol"), size=size, at=self.at(e))

    def precedence(self, e: etree._Element) -> Precedence:
        return Precedence(
            task=self.text(e, "task"),
            min=self.duration(e, "min", ZERO),
            max=self.duration(e, "max", ZERO),
            anchor=Anchor((self.text(e, "from") or "start").strip()),
            origin=self.origin(e),
            at=self.at(e),
        )

    def source(self, e: etree._Element) -> Source:
        files, defines = self.names(e, "files"), self.names(e, "defines")
        return Source(files=files, entry=" ".join(self.names(e, "entry")), defines=defines, at=self.at(e))

    def chain(self, e: etree._Element) -> Chain:
        return Chain(
            name=self.text(e, "name"),
            tasks=self.names(e, "tasks"),
            max_reaction=self.optional_duration(e, "max-reaction"),
            max_age=self.optional_duration(e, "max-age"),
            origin=self.origin(e),
            at=self.at(e),
        )

    def mode(self, e: etree._Element) -> Mode:
        runs = tuple(self.run(r) for r in self.children(e, "run"))
        return Mode(name=self.text(e, "name"), runs=runs, origin=self.origin(e), at=self.at(e))

    def run(self, e: etree._Element) -> Run:
        return Run(task=self.text(e, "task"), versions=self.names(e, "versions"), at=self.at(e))

    def transition(self, e: etree._Element) -> Transition:
        return Transition(
            source=self.text(e, "from"),
            target=self.text(e, "to"),
            max_length=self.optional_duration(e, "max-length"),
            origin=self.origin(e),
            at=self.at(e),
        )
