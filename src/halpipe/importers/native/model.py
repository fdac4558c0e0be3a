"""Reader of the task model XML (schema task-model-1.xsd): hardened parse, schema check, hand-made binding."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.durations import ZERO
from halpipe.files import parse_xml, read_bytes, sha256
from halpipe.importers.native.binding import Binder, Children, duration, durations, only, rational
from halpipe.models import (
    Access,
    AccessKind,
    Anchor,
    Binding,
    Chain,
    HealthAction,
    HealthEvent,
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
from halpipe.quantities import parse_bandwidth, parse_size
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
        sections = self.children(root)
        platform = self.section(sections, "platform")
        return TaskModel(
            name=root.get("name", ""),
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
        if found is None:
            return None
        return Origin(found.get("file", ""), self.read(found, "line", int, 0), found.get("path", ""))

    def unit(self, e: etree._Element) -> Unit:
        parts = self.children(e)
        return Unit(
            name=e.get("name", ""),
            type=e.get("type", ""),
            interrupts=tuple(map(self.interrupt, parts.get("interrupt", ()))),
            origin=self.origin(parts),
            at=self.at(e),
        )

    def interrupt(self, e: etree._Element) -> Interrupt:
        return Interrupt(
            name=e.get("name", ""),
            distance=self.read(e, "distance", duration, ZERO),
            wcet=self.read(e, "wcet", duration, ZERO),
            origin=self.origin(self.children(e)),
            at=self.at(e),
        )

    def resource(self, e: etree._Element) -> Resource:
        bandwidth, origin = self.read(e, "bandwidth", parse_bandwidth, None), self.origin(self.children(e))
        return Resource(name=e.get("name", ""), bandwidth=bandwidth, origin=origin, at=self.at(e))

    def tasks(self, e: etree._Element | None) -> tuple[Task, ...]:
        if e is None:
            return ()
        binding = Binding(e.get("binding", Binding.JOB).strip())
        return tuple(self.task(task, binding) for task in self.children(e).get("task", ()))

    def task(self, e: etree._Element, binding: Binding) -> Task:
        parts = self.children(e)
        return Task(
            name=e.get("name", ""),
            period=self.read(e, "period", duration, None),
            slack=self.read(e, "slack", rational, NONE),
            offset=self.read(e, "offset", duration, None),
            deadline=self.read(e, "deadline", duration, None),
            distance=self.read(e, "distance", duration, None),
            binding=Binding(e.get("binding", binding).strip()),
            versions=tuple(map(self.version, parts.get("version", ()))),
            origin=self.origin(parts),
            at=self.at(e),
        )

    def version(self, e: etree._Element) -> Version:
        parts = self.children(e)
        units, source = only(parts, "units"), only(parts, "source")
        return Version(
            name=e.get("name", ""),
            wcet=self.read(e, "wcet", duration, None),
            units=() if units is None else self.names(units, "names"),
            gang=1 if units is None else self.read(units, "gang", int, 1),
            accesses=tuple(map(self.access, parts.get("access", ()))),
            precedences=tuple(map(self.precedence, parts.get("precedence", ()))),
            source=None if source is None else self.source(source),
            split=self.split(e),
            origin=self.origin(parts),
            at=self.at(e),
        )

    def split(self, e: etree._Element) -> Split:
        stated = e.get("split", "none").strip()
        is_list = stated not in ("none", "anywhere")
        return Split(
            points=self.read(e, "split", durations, ()) if is_list else (),
            anywhere=stated == "anywhere",
            resume=self.read(e, "resume", duration, ZERO),
            max_gaps=self.read(e, "max-gaps", int, None),
            min_part=self.read(e, "min-part", duration, None),
        )

    def access(self, e: etree._Element) -> Access:
        kind = e.get("kind", "")
        return Access(
            resource=e.get("resource", ""),
            start=self.read(e, "start", duration, ZERO),
            end=self.read(e, "end", duration, ZERO),
            bound=self.read(e, "bound", rational, ONE),
            kind=AccessKind(kind.strip()) if kind else None,
            transfers=tuple(map(self.transfer, self.children(e).get("transfer", ()))),
            at=self.at(e),
        )

    def transfer(self, e: etree._Element) -> Transfer:
        size = self.read(e, "size", parse_size, 0)
        return Transfer(buffer=e.get("buffer", ""), symbol=e.get("symbol", ""), size=size, at=self.at(e))

    def precedence(self, e: etree._Element) -> Precedence:
        return Precedence(
            task=e.get("task", ""),
            min=self.read(e, "min", duration, ZERO),
            max=self.read(e, "max", duration, ZERO),
            anchor=Anchor(e.get("from", "start").strip()),
            origin=self.origin(self.children(e)),
            at=self.at(e),
        )

    def source(self, e: etree._Element) -> Source:
        files, defines = self.names(e, "files"), self.names(e, "defines")
        return Source(files=files, entry=" ".join(self.names(e, "entry")), defines=defines, at=self.at(e))

    def chain(self, e: etree._Element) -> Chain:
        return Chain(
            name=e.get("name", ""),
            tasks=self.names(e, "tasks"),
            max_reaction=self.read(e, "max-reaction", duration, None),
            max_age=self.read(e, "max-age", duration, None),
            origin=self.origin(self.children(e)),
            at=self.at(e),
        )

    def mode(self, e: etree._Element) -> Mode:
        parts = self.children(e)
        runs = tuple(map(self.run, parts.get("run", ())))
        return Mode(name=e.get("name", ""), runs=runs, origin=self.origin(parts), at=self.at(e))

    def run(self, e: etree._Element) -> Run:
        return Run(task=e.get("task", ""), versions=self.names(e, "versions"), at=self.at(e))

    def transition(self, e: etree._Element) -> Transition:
        return Transition(
            source=e.get("from", ""),
            target=e.get("to", ""),
            max_length=self.read(e, "max-length", duration, None),
            origin=self.origin(self.children(e)),
            at=self.at(e),
        )

    def rule(self, e: etree._Element) -> HealthRule:
        return HealthRule(
            task=e.get("task", ""),
            event=HealthEvent(e.get("on", HealthEvent.ANY).strip()),
            count=self.read(e, "count", int, 1),
            cycles=self.read(e, "cycles", int, 1),
            action=HealthAction(e.get("action", "").strip()),
            mode=e.get("mode", ""),
            origin=self.origin(self.children(e)),
            at=self.at(e),
        )
