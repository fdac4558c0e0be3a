"""Checks of names: well-formed, defined once, and defined at all where they are used."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Path, Subject, about
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, repeated, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from halpipe.core.diagnostics import Code, Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.validate.context import Context

_NAME = re.compile(r"[A-Za-z0-9_./:~+@$%-]{1,1000}")
_FORM = "use only A-Z a-z 0-9 _ . / : ~ + @ $ % -"


def _named_elements(context: Context) -> Iterator[tuple[str, list[Any]]]:
    """Yield the kinds of elements whose names are unique in the model."""
    model = context.model
    yield "unit", list(model.units)
    yield "resource", list(model.resources)
    yield "task", list(model.tasks)
    yield "chain", list(model.chains)
    yield "mode", list(model.modes)


def check_form(context: Context) -> Iterator[Diagnostic]:
    """Names have the form that the schema gives them, also in models that were never XML."""
    yield from _form("", "model", context.model.name, context.model)
    for kind, elements in _named_elements(context):
        for element in elements:
            yield from _form("", kind, element.name, element)
    for unit in context.model.units:
        if unit.type:
            yield from _form(about(unit=unit.name), ": type", unit.type, unit)
        for interrupt in unit.interrupts:
            yield from _form(about(unit=unit.name), "interrupt", interrupt.name, interrupt, unit)
    for task, version in context.versions_of_tasks:
        if not _NAME.fullmatch(version.name):  # asked first: the path of each version would take longer than all checks
            yield from _form(about(task=task.name), "version", version.name, version, task)
    for task, version, access in context.accesses_of_versions:
        for transfer in access.transfers:
            path = version_path(task, version)
            yield from _form(path, ": buffer", transfer.buffer, transfer, access, version, task)
            yield from _form(path, ": symbol", transfer.symbol, transfer, access, version, task)


def _form(within: str, kind: str, name: str, *elements: Any) -> Iterator[Diagnostic]:
    if _NAME.fullmatch(name):
        return
    shown = name if len(name) <= 60 else f"{name[:60]}..."
    text = "is not a name" if name else "has no name"
    yield codes.BAD_NAME(text, at=place(*elements), path=_within(within, kind, shown), help=_FORM)


def _within(within: str, kind: str, name: str) -> Path:
    """Return the path of an element or, after a colon, of a name inside one."""
    subjects = within.subjects if isinstance(within, Path) else ()
    text = f'{within}{"" if kind.startswith(":") or not within else " "}{kind} "{name}"'
    return Path(text, (*subjects, Subject(kind.strip(": "), name)))


def check_duplicates(context: Context) -> Iterator[Diagnostic]:
    """Every name is defined once."""
    for kind, elements in _named_elements(context):
        yield from _duplicates("", kind, elements)
    for unit in context.model.units:
        if len(unit.interrupts) > 1:
            yield from _duplicates(about(unit=unit.name), "interrupt", list(unit.interrupts), unit)
    for task in context.model.tasks:
        if len(task.versions) > 1:
            yield from _duplicates(task_path(task), "version", list(task.versions), task)


def _duplicates(within: str, kind: str, elements: list[Any], *owners: Any) -> Iterator[Diagnostic]:
    first: dict[str, Any] = {}
    for element in elements:
        if element.name not in first:
            first[element.name] = element
        else:
            before = place(first[element.name])
            text = f"is defined twice, first in line {before.line}" if before.line else "is defined twice"
            at = place(element, *owners)
            path, help = _within(within, kind, element.name), "rename one of the two"
            yield codes.DUPLICATE_NAME(text, at=at, path=path, help=help, places=[before])


def check_lists(context: Context) -> Iterator[Diagnostic]:
    """A mode lists a task once, and no list of units or versions repeats a name."""
    for mode in context.model.modes:
        tasks: set[str] = set()
        for run in mode.runs:
            if run.task in tasks:
                at, path = place(run, mode), about(mode=mode.name, task=run.task)
                help = "merge the two lists of versions"
                yield codes.DUPLICATE_RUN("is listed twice in the mode", at=at, path=path, help=help)
            tasks.add(run.task)
            for name in repeated(run.versions) if len(run.versions) > 1 else ():
                at, path = place(run, mode), about(mode=mode.name, task=run.task)
                text = f'lists version "{name}" more than once'
                yield codes.REPEATED_IN_LIST(text, at=at, path=path, help="list it once")
    for task, version in context.versions_of_tasks:
        if len(set(version.units)) == len(version.units):
            continue
        for name in repeated(version.units):
            at = place(version, task)
            text = f'lists unit "{name}" more than once'
            yield codes.REPEATED_IN_LIST(text, at=at, path=version_path(task, version), help="list it once")


def check_units(context: Context) -> Iterator[Diagnostic]:
    """The units of a version exist."""
    for task, version in context.versions_of_tasks:
        for name in dict.fromkeys(version.units):
            if name not in context.units:
                path = version_path(task, version)
                yield _unknown(codes.UNKNOWN_UNIT, context, "unit", name, context.units, path, version, task)


def check_resources(context: Context) -> Iterator[Diagnostic]:
    """The resource of an access phase exists."""
    for task, version, access in context.accesses_of_versions:
        name = access.resource
        if name not in context.resources:
            path, around = version_path(task, version), (access, version, task)
            yield _unknown(codes.UNKNOWN_RESOURCE, context, "resource", name, context.resources, path, *around)


def check_tasks(context: Context) -> Iterator[Diagnostic]:
    """The tasks that precedence constraints, chains, modes and health rules name exist."""
    for name, path, around in _unknown_tasks(context.model, context.tasks.keys()):
        yield _unknown(codes.UNKNOWN_TASK, context, "task", name, context.tasks, path, *around)


def _unknown_tasks(model: TaskModel, known: Collection[str]) -> Iterator[tuple[str, str, tuple[Any, ...]]]:
    """Yield every name that no task has, the path of what names it, and the elements around it."""
    for task in model.tasks:
        for version in task.versions:
            for constraint in version.precedences:
                if constraint.task not in known:
                    yield constraint.task, version_path(task, version), (constraint, version, task)
    for chain in model.chains:
        for name in dict.fromkeys(chain.tasks):
            if name not in known:
                yield name, about(chain=chain.name), (chain,)
    for mode in model.modes:
        for run in mode.runs:
            if run.task not in known:
                yield run.task, about(mode=mode.name), (run, mode)
    for rule in model.health:
        if rule.task not in known:
            yield rule.task, "health rule", (rule,)


def _unknown(
    code: Code, context: Context, kind: str, name: str, known: Collection[str], path: str, *elements: Any
) -> Diagnostic:
    """Report a name that nothing has, with the one that was probably meant."""
    at, subject = place(*elements), kind.partition(" ")[0]
    return code(
        f'{subject} "{name}" does not exist',
        at=at,
        path=path,
        help=context.suggest(kind, name, known),
        subjects=[Subject(subject, name)],
        fix=context.fix(kind, name, known, at),
    )


def check_versions(context: Context) -> Iterator[Diagnostic]:
    """The versions that a mode lists exist."""
    for mode in context.model.modes:
        for run in mode.runs:
            known = context.versions.get(run.task)
            if known is None:
                continue
            for name in dict.fromkeys(run.versions):
                if name not in known:
                    path, kind = about(mode=mode.name, task=run.task), f'version of task "{run.task}"'
                    yield _unknown(codes.UNKNOWN_VERSION, context, kind, name, known, path, run, mode)


def check_modes(context: Context) -> Iterator[Diagnostic]:
    """The modes of transitions and health rules exist."""
    for transition in context.model.transitions:
        for name in dict.fromkeys((transition.source, transition.target)):
            if name not in context.modes:
                path = about(transition=(transition.source, transition.target))
                yield _unknown(codes.UNKNOWN_MODE, context, "mode", name, context.modes, path, transition)
    for rule in context.model.health:
        if rule.mode and rule.mode not in context.modes:
            path = about(health_rule_of_task=rule.task)
            yield _unknown(codes.UNKNOWN_MODE, context, "mode", rule.mode, context.modes, path, rule)


CHECKS = (
    Check("names", "Every name has at least one and only allowed characters.", (codes.BAD_NAME,), check_form),
    Check(
        "unique-names",
        "No two units, resources, tasks, chains or modes, and no two versions of a task, have the same name.",
        (codes.DUPLICATE_NAME,),
        check_duplicates,
    ),
    Check(
        "lists",
        "A mode lists a task once, and no list of versions or units repeats a name.",
        (codes.DUPLICATE_RUN, codes.REPEATED_IN_LIST),
        check_lists,
    ),
    Check("unit-references", "The units of every version exist.", (codes.UNKNOWN_UNIT,), check_units),
    Check(
        "resource-references",
        "The resource of every access phase exists.",
        (codes.UNKNOWN_RESOURCE,),
        check_resources,
    ),
    Check(
        "task-references",
        "The tasks named by precedence constraints, chains, modes and health rules exist.",
        (codes.UNKNOWN_TASK,),
        check_tasks,
    ),
    Check(
        "version-references",
        "The versions that a mode lists exist.",
        (codes.UNKNOWN_VERSION,),
        check_versions,
    ),
    Check(
        "mode-references",
        "The modes of every transition and health rule exist.",
        (codes.UNKNOWN_MODE,),
        check_modes,
    ),
)
