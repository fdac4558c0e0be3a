"""Names that a model uses, and does not define: formats that refer from element to element cannot write them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about, version_of
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.common.codes import DANGLING_NAME

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from halpipe.models import TaskModel


def refuse_dangling(model: TaskModel) -> None:
    """Raise `HalpipeError` with every name that the model does not define."""
    findings = Findings()

    def check(kind: str, names: Iterable[str], known: Collection[str], path: str) -> None:
        for name in names:
            if name not in known:
                help = did_you_mean(name, sorted(known), "define it, or remove what names it")
                findings.report(DANGLING_NAME, f'there is no {kind} "{name}"', path=path, help=help)

    units = {unit.name for unit in model.units}
    resources = {resource.name for resource in model.resources}
    versions = {task.name: {version.name for version in task.versions} for task in model.tasks}
    modes = {mode.name for mode in model.modes}
    for task in model.tasks:
        for version in task.versions:
            path = version_of(task.name, version.name)
            check("unit", version.units, units, path)
            check("resource", (access.resource for access in version.accesses), resources, path)
            check("task", (precedence.task for precedence in version.precedences), versions, path)
    for chain in model.chains:
        check("task", chain.tasks, versions, about(chain=chain.name))
    for mode in model.modes:
        for run in mode.runs:
            path = about(mode=mode.name)
            check("task", [run.task], versions, path)
            check("version", run.versions, versions.get(run.task, run.versions), f'{path}, task "{run.task}"')
    for transition in model.transitions:
        path = about(transition_from=(transition.source, transition.target))
        check("mode", (transition.source, transition.target), modes, path)
    for rule in model.health:
        check("task", [rule.task], versions, "health rule")
        check("mode", [rule.mode] if rule.mode else [], modes, "health rule")
    findings.stop_on_errors()
