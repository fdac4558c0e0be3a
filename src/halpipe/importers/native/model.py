"""Reader of the task model XML (schema task-model-1.xsd): hardened parse, schema check, hand-made binding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location
from halpipe.core.files import parse_xml, read_bytes, refuse_more_than, sha256
from halpipe.importers.native.binding import Binder
from halpipe.models import WHOLE, Split, Task, TaskModel, Version
from halpipe.models.attributes import DURATIONS
from halpipe.schemas import TASK_MODEL, check, line_of, namespace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lxml import etree


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
    model: TaskModel = bind.element(TaskModel, root)
    bind.findings.stop_on_errors()
    return model.read_from(digest)


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
    """Adds what is no plain attribute of an element: where versions may be split, and what all tasks have in common."""

    _common: Mapping[str, Any]

    def values(self, kind: type, element: etree._Element, within: str = "") -> dict[str, Any]:
        """Return the attributes of a class that an element has, by field; what cannot be read is a finding."""
        found = super().values(kind, element, within)
        if kind is Task:
            return {**self._common, **found}
        if kind is TaskModel:
            tasks = element.find(self.tag("tasks"))
            self._common = {} if tasks is None else super().values(Task, tasks)
        elif kind is Version and not within:
            units = element.find(self.tag("units"))
            found |= {} if units is None else super().values(Version, units, "units")
            found["split"] = self._split(element)
        return found

    def _split(self, e: etree._Element) -> Split:
        """Read where jobs may be interrupted: points, or a word that says it."""
        if SPLIT.isdisjoint(e.keys()):
            return WHOLE
        stated = e.get("split", "none").strip()
        is_list = stated not in ("none", "anywhere")
        points = self.read(e, "split", stated, DURATIONS) if is_list else ()
        return Split(**self.values(Split, e), points=points, anywhere=stated == "anywhere")
