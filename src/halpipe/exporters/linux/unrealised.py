"""Parts of a schedule that the dispatcher does not realise, in sentences for the bundle and its user."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.exporters.linux.codes import UNREALISED
from halpipe.exporters.linux.tables import is_followed

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.linux import LinuxOptions
    from halpipe.models import Schedule, TaskModel

_MOST_NAMES = 5


def unrealised(model: TaskModel, schedule: Schedule, options: LinuxOptions) -> list[Diagnostic]:
    """Return one warning for each kind of thing that the bundle leaves open."""
    path = about(model=model.name)
    return [UNREALISED(text, path=path, help=help) for text, help in sentences(model, schedule, options)]


def sentences(model: TaskModel, schedule: Schedule, options: LinuxOptions) -> Iterator[tuple[str, str]]:
    """Yield what is left open, and what to do about it."""
    jobs = [job for mode in schedule.modes for job in mode.jobs]
    jobs += [job for table in schedule.transitions for job in table.jobs]
    versions = {(job.task, job.version): model.task(job.task).version(job.version) for job in jobs}
    if gangs := dict.fromkeys(job.task for job in jobs if len(job.units) > 1):
        yield (
            f"programs run on one CPU, though they occupy several units: {_few(list(gangs))}",
            "let the program start helping threads on the CPUs of the units that are kept free for it",
        )
    if any(version.accesses for version in versions.values()):
        held = any(unit.interrupts for unit in model.units)
        held = held or any(version.split.is_allowed for task in model.tasks for version in task.versions)
        early = "" if held else ", and phases begin when the program comes to them"
        yield (
            f"bounds of access phases are not enforced{early}",
            "export the regulator format (memguard or resctrl) to enforce bounds",
        )
    if made_up := [f"{task}/{name}" for (task, name), version in versions.items() if version.source is None]:
        yield (
            f"programs that only take {options.busy} % of their WCET stand for: {_few(made_up)}",
            "name their sources in the model, or in an overlay",
        )
    if left := dict.fromkeys(rule.task for rule in model.health if not is_followed(rule)):
        yield (
            f"health rules are not followed, but for switches after one overrun: {_few(list(left))}",
            "a program that faults ends the dispatcher; let its supervisor start it in the mode that is meant",
        )
    if options.cpus is None:
        yield "CPUs are numbered in the order of the units of the model", "state them with --cpus unit=number,..."


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(f'"{name}"' for name in names[:_MOST_NAMES]) + more
