"""Checks of names, references and completeness, and of health rules (MODEL 2 and 9)."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Code, Diagnostic, Path, Subject, about
from halpipe.core.grouping import grouped
from halpipe.models import HealthAction, HealthRule, TaskModel
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Context, check, place, repeated, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator


@check("complete-model", codes.NO_UNITS, codes.NO_TASKS, codes.NO_MODES, codes.NO_VERSIONS, codes.VERSION_WITHOUT_UNITS)
def check_model(context: Context) -> Iterator[Diagnostic]:
    """The model has units, tasks and modes; every task has a version, and every version a unit."""
    model = context.model
    path, at = about(model=model.name), place(model)
    if not model.units:
        yield codes.NO_UNITS("has no unit", at=at, path=path, help="declare the units in the model or the overlay")
    if not model.tasks:
        yield codes.NO_TASKS("has no task", at=at, path=path, help="declare at least one task")
    if not model.modes:
        yield codes.NO_MODES("has no mode", at=at, path=path, help="declare a mode that lists the tasks that run in it")
    for task in model.tasks:
        if not task.versions:
            help = "give the task at least one version, in the model or the overlay"
            yield codes.NO_VERSIONS("has no version", at=place(task), path=task_path(task), help=help)
        for version in task.versions:
            if not version.units:
                help = "name the units it may run on, in the model or the overlay"
                at, path = place(version, task), version_path(task, version)
                yield codes.VERSION_WITHOUT_UNITS("names no unit", at=at, path=path, help=help)


@check("complete-modes", codes.EMPTY_MODE, codes.RUN_SELECTS_NOTHING, codes.NOTHING_PERIODIC)
def check_complete_modes(context: Context) -> Iterator[Diagnostic]:
    """In every mode a task with a period runs, and every task listed has an available version."""
    for mode in context.model.modes:
        path = about(mode=mode.name)
        if not mode.runs:
            help = "list the tasks that run in it, or remove the mode"
            yield codes.EMPTY_MODE("selects nothing: no task runs in it", at=place(mode), path=path, help=help)
        for run in mode.runs:
            if not run.versions:
                help = "list the available versions, or remove the task from the mode"
                at = place(run, mode)
                text = "none of its versions is available"
                yield codes.RUN_SELECTS_NOTHING(text, at=at, path=about(path, task=run.task), help=help)
    for active in context.active:
        if active.tasks and all(task.task.period is None for task in active.tasks.values()):
            text = "no task that runs in it has a period, so nothing demands the others and there is no hyperperiod"
            help = "give a period to at least one of its tasks"
            yield codes.NOTHING_PERIODIC(text, at=place(active.mode), path=active.path, help=help)


@check("unused", codes.UNUSED_UNIT, codes.UNUSED_RESOURCE, codes.TASK_NEVER_RUNS, codes.VERSION_NEVER_RUNS)
def check_unused(context: Context) -> Iterator[Diagnostic]:
    """Every unit and resource is used, and every task and version is available in some mode."""
    units = {name for _, version in context.versions_of_tasks for name in version.units}
    for unit in context.units.values():
        if unit.name not in units:
            text, help = "no version may run on it", "remove it, or add it to the units of a version"
            yield codes.UNUSED_UNIT(text, at=place(unit), path=about(unit=unit.name), help=help)
    resources = {access.resource for _, _, access in context.accesses_of_versions}
    for resource in context.resources.values():
        if resource.name not in resources:
            text, help = "no version accesses it", "remove it, or add the missing access phases"
            yield codes.UNUSED_RESOURCE(text, at=place(resource), path=about(resource=resource.name), help=help)
    if context.model.modes:
        yield from _never_run(context)


def _never_run(context: Context) -> Iterator[Diagnostic]:
    available: dict[str, set[str]] = {}
    for mode in context.model.modes:
        for run in mode.runs:
            available.setdefault(run.task, set()).update(run.versions)
    for task in context.tasks.values():
        if task.name not in available:
            help = "list it in a mode, or remove it"
            yield codes.TASK_NEVER_RUNS("runs in no mode", at=place(task), path=task_path(task), help=help)
            continue
        for version in context.versions[task.name].values():
            if version.name not in available[task.name]:
                at, path = place(version, task), version_path(task, version)
                help = "list it in a mode, or remove it"
                yield codes.VERSION_NEVER_RUNS("is available in no mode", at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ names and references

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


@check("names", codes.BAD_NAME)
def check_form(context: Context) -> Iterator[Diagnostic]:
    """Every name has at least one and only allowed characters."""
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


@check("unique-names", codes.DUPLICATE_NAME)
def check_duplicates(context: Context) -> Iterator[Diagnostic]:
    """No two units, resources, tasks, chains or modes, and no two versions of a task, have the same name."""
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


@check("lists", codes.DUPLICATE_RUN, codes.REPEATED_IN_LIST)
def check_lists(context: Context) -> Iterator[Diagnostic]:
    """A mode lists a task once, and no list of versions or units repeats a name."""
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


@check("unit-references", codes.UNKNOWN_UNIT)
def check_units(context: Context) -> Iterator[Diagnostic]:
    """The units of every version exist."""
    for task, version in context.versions_of_tasks:
        for name in dict.fromkeys(version.units):
            if name not in context.units:
                path = version_path(task, version)
                yield _unknown(codes.UNKNOWN_UNIT, context, "unit", name, context.units, path, version, task)


@check("resource-references", codes.UNKNOWN_RESOURCE)
def check_resources(context: Context) -> Iterator[Diagnostic]:
    """The resource of every access phase exists."""
    for task, version, access in context.accesses_of_versions:
        name = access.resource
        if name not in context.resources:
            path, around = version_path(task, version), (access, version, task)
            yield _unknown(codes.UNKNOWN_RESOURCE, context, "resource", name, context.resources, path, *around)


@check("task-references", codes.UNKNOWN_TASK)
def check_tasks(context: Context) -> Iterator[Diagnostic]:
    """The tasks named by precedence constraints, chains, modes and health rules exist."""
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


@check("version-references", codes.UNKNOWN_VERSION)
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


@check("mode-references", codes.UNKNOWN_MODE)
def check_modes(context: Context) -> Iterator[Diagnostic]:
    """The modes of every transition and health rule exist."""
    for transition in context.model.transitions:
        for name in dict.fromkeys((transition.source, transition.target)):
            if name not in context.modes:
                path = about(transition=(transition.source, transition.target))
                yield _unknown(codes.UNKNOWN_MODE, context, "mode", name, context.modes, path, transition)
    for rule in context.model.health:
        if rule.mode and rule.mode not in context.modes:
            path = about(health_rule_of_task=rule.task)
            yield _unknown(codes.UNKNOWN_MODE, context, "mode", rule.mode, context.modes, path, rule)


# ------------------------------------------------------------------------------------------------ health rules

MOST = 255
"""Events, and tables, that a rule may count: targets keep the events of each rule."""


def _rule_path(rule: HealthRule) -> str:
    return about(health_rule_of_task=rule.task)


@check("health", codes.BAD_RULE)
def check_rules(context: Context) -> Iterator[Diagnostic]:
    """Every health rule counts 1 to 255 events in 1 to 255 tables, and names a mode if and only if it switches."""
    for rule in context.model.health:
        at, path = place(rule), _rule_path(rule)
        if not (1 <= rule.count <= MOST and 1 <= rule.cycles <= MOST):
            text = f"counts {rule.count} events in {rule.cycles} tables"
            yield codes.BAD_RULE(text, at=at, path=path, help=f"write numbers from 1 to {MOST}")
        if (rule.action is HealthAction.SWITCH) != bool(rule.mode):
            text = f'names mode "{rule.mode}", but its action is {rule.action}' if rule.mode else "switches to no mode"
            yield codes.BAD_RULE(text, at=at, path=path, help='write action="switch" with a mode, or another without')


@check("health-switches", codes.RULE_WITHOUT_SWITCH, codes.RULE_NEVER_HOLDS)
def check_switches(context: Context) -> Iterator[Diagnostic]:
    """Every health rule holds in some mode, and its switch is allowed from every mode in which its task runs."""
    if not context.model.health:
        return
    allowed = {(t.source, t.target) for t in context.model.allowed_transitions()}
    running = grouped((run.task, mode.name) for mode in context.model.modes for run in mode.runs)
    for rule in context.model.health:
        if rule.task not in context.tasks or (rule.mode and rule.mode not in context.modes):
            continue
        target = rule.mode if rule.action is HealthAction.SWITCH else ""
        holds = [name for name in dict.fromkeys(running.get(rule.task, ())) if name != target]
        if not holds:
            help = "remove the rule, or let its task run in other modes"
            yield codes.RULE_NEVER_HOLDS("never holds", at=place(rule), path=_rule_path(rule), help=help)
        for source in holds if target else ():
            if (source, target) not in allowed:
                text = f'in mode "{source}" it leads to "{target}", but that switch is not allowed'
                help = f'list the transition from "{source}" to "{target}"'
                yield codes.RULE_WITHOUT_SWITCH(text, at=place(rule), path=_rule_path(rule), help=help)
