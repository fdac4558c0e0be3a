"""Configurations of the launch manager of Eclipse S-CORE: modes as run targets, health rules as recovery actions."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.extent import Extent
from halpipe.exporters.common.base import Exporter, ExportOptions
from halpipe.models.words import HealthAction, HealthEvent

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.models import HealthRule, Schedule, Task, TaskModel

FALLBACK = "fallback_run_target"
_NAME = re.compile("[a-zA-Z0-9_-]+")


class LifecycleExporter(Exporter):
    """Writes a component for each task and a run target for each mode; no schedule is needed."""

    name = "launch-manager"
    summary = "launch manager of Eclipse S-CORE (JSON): modes as run targets, health rules as recovery actions"
    help = "Write modes and health rules as a configuration of the launch manager of Eclipse S-CORE."
    extent = Extent(
        {
            "tasks": "components: `binary_name` is the name of the task",
            "timing": "`reporting_cycle` of tasks whose overruns a health rule counts: two periods",
            "modes": "run targets; the first is the initial one",
            "health": "`recovery_action` of the component; stop leads to the fallback run target",
        },
        (
            "The launch manager starts processes; it plays no schedule, and it allows every switch.",
            "Folders, users and time-outs of processes are of the deployment: add them as `defaults`.",
            "A component without a health rule leads to the fallback run target, the launch manager's default.",
        ),
    )
    suffix = ".json"

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the configuration; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.orchestrator import json_bytes
        from halpipe.models.modes import require_mode

        if options.mode:
            require_mode(options.mode, model.modes)
        modes = [mode for mode in model.modes if options.mode in ("", mode.name)]
        running = {run.task for mode in modes for run in mode.runs}
        tasks = [task for task in model.tasks if task.name in running]
        _check_names([task.name for task in tasks], [mode.name for mode in modes])
        rules = _rules(model, {mode.name for mode in modes})
        return {
            "": json_bytes(
                {
                    "schema_version": 1,
                    "components": {task.name: _component(task, rules.get(task.name)) for task in tasks},
                    "run_targets": {m.name: {"depends_on": [run.task for run in m.runs]} for m in modes},
                    "initial_run_target": modes[0].name,
                    FALLBACK: {"description": "Nothing runs", "depends_on": []},
                }
            )
        }

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return each health rule that is not written, or that the launch manager counts otherwise."""
        from halpipe.exporters.orchestrator import NOT_CARRIED

        written = _rules(model, {mode.name for mode in model.modes if options.mode in ("", mode.name)})
        found = []
        for rule in model.health:
            if written.get(rule.task) is not rule:
                text, help = f"health rule with action {rule.action} is not written", "add other means for it"
            elif rule.count > 1:
                text = f"counts {rule.count} events in {rule.cycles} tables; the launch manager, in consecutive cycles"
                help = "set the count to 1"
            else:
                continue
            found.append(NOT_CARRIED(text, at=rule.at, path=about(task=rule.task), help=help))
        return found


FORMAT = LifecycleExporter()


def _rules(model: TaskModel, modes: set[str]) -> dict[str, HealthRule]:
    """Return the rule of each task: the first whose action a component can take."""
    rules: dict[str, HealthRule] = {}
    for rule in model.health:
        if rule.action is HealthAction.STOP or (rule.action is HealthAction.SWITCH and rule.mode in modes):
            rules.setdefault(rule.task, rule)
    return rules


def _component(task: Task, rule: HealthRule | None) -> dict[str, Any]:
    """Return the component of a task, supervised where a rule counts overruns of a periodic task.

    Every window of two periods contains one whole period, and thus a job; it touches three, and thus at most three.
    """
    profile: dict[str, Any] = {"application_type": "Native"}
    if rule is not None and rule.event is not HealthEvent.FAULT and task.period is not None:
        window = (task.period * 2).in_unit("s")
        profile = {
            "application_type": "Reporting_And_Supervised",
            "alive_supervision": {
                "reporting_cycle": float(window),
                "failed_cycles_tolerance": rule.count - 1,
                "min_indications": 1,
                "max_indications": 3,
            },
        }
    component: dict[str, Any] = {"component_properties": {"binary_name": task.name, "application_profile": profile}}
    if rule is not None:
        target = rule.mode if rule.action is HealthAction.SWITCH else FALLBACK
        component["deployment_config"] = {"recovery_action": {"switch_run_target": {"run_target": target}}}
    return component


def _check_names(tasks: list[str], modes: list[str]) -> None:
    """Raise `HalpipeError` with each name that the launch manager refuses."""
    from halpipe.exporters.orchestrator import BAD_NAME

    findings = Findings()
    for name in (*tasks, *modes):
        if not _NAME.fullmatch(name):
            text = f'"{name}" has characters other than letters, digits, underscores and hyphens'
            findings.add(BAD_NAME(text, help="rename it in the model"))
    for name in sorted({*tasks, FALLBACK} & set(modes)):
        findings.add(BAD_NAME(f'mode "{name}" has the name of a component or of the fallback', help="rename the mode"))
    findings.stop_on_errors()
