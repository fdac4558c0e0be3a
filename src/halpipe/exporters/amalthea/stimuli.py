"""The stimuli of tasks: as the model states them, or as a schedule places the jobs, mode by mode."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.exporters.amalthea.document import Unique, add, add_property, add_time, named, ref

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule, Task, TaskModel

MODE_LABEL = "mode"


def version_label(task: str) -> str:
    """Return the name of the mode label, and of its enumeration, that selects the version of a task."""
    return f"{task}/version"


@record
class Stimulus:
    """One stimulus: a recurrence with an offset, or with several instants; the modes it is active in (none: all)."""

    name: str
    recurrence: Duration
    times: tuple[Duration, ...]
    modes: tuple[str, ...] = ()
    version: str = ""
    units: tuple[str, ...] = ()

    @property
    def is_placed(self) -> bool:
        """Whether a schedule gave its instants."""
        return bool(self.units)


def stimuli_of(model: TaskModel, schedule: Schedule | None) -> dict[str, list[Stimulus]]:
    """Return the stimuli of every task."""
    names = Unique()
    tables = {} if schedule is None else {mode.name: mode for mode in schedule.modes}
    runs: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for played in model.modes:
        for run in played.runs:
            runs[run.task][played.name] = None
    jobs: defaultdict[tuple[str, str], list[Job]] = defaultdict(list)
    for name, table in tables.items():
        for job in table.jobs:
            jobs[name, job.task].append(job)
    found: dict[str, list[Stimulus]] = {}
    for task in model.tasks:
        stimuli = found.setdefault(task.name, [])
        for mode in [mode for mode in runs[task.name] if mode in tables]:
            only = () if len(model.modes) == 1 else (mode,)
            stimuli += _placed(task, jobs[mode, task.name], tables[mode].hyperperiod, only, names)
        rest = [mode for mode in runs[task.name] if mode not in tables]
        if task.period is not None and (rest or not model.modes):
            modes = () if len(rest) == len(model.modes) else tuple(rest)
            offset = () if task.offset is None else (task.offset,)
            stimuli.append(Stimulus(names(task.name), task.period, offset, modes))
    return found


def _placed(
    task: Task, jobs: Sequence[Job], hyperperiod: Duration, modes: tuple[str, ...], names: Unique
) -> list[Stimulus]:
    """Return a stimulus for each version and set of units that jobs of a task have in a mode."""
    groups: dict[tuple[str, tuple[str, ...]], list[Duration]] = {}
    for job in sorted(jobs, key=lambda job: job.start):
        groups.setdefault((job.version, job.units), []).append(job.start)
    base = "@".join((task.name, *modes))
    found = []
    for (version, units), starts in groups.items():
        recurrence = hyperperiod
        step = hyperperiod / len(starts)
        if all(start == starts[0] + step * index for index, start in enumerate(starts)):
            recurrence, starts = step, starts[:1]
        found.append(Stimulus(names(base), recurrence, tuple(starts), modes, version, units))
    return found


def write_stimuli(parent: etree._Element, model: TaskModel, stimuli: dict[str, list[Stimulus]]) -> None:
    """Append the stimuli of all tasks."""
    for task in model.tasks:
        for stimulus in stimuli[task.name]:
            _write(parent, task, stimulus)


def _write(parent: etree._Element, task: Task, stimulus: Stimulus) -> None:
    kind = kind_of(stimulus)
    element = named(parent, "stimuli", kind, stimulus.name, typed=True)
    if stimulus.is_placed:
        add_property(element, "units", " ".join(stimulus.units))
    if stimulus.version and len(task.versions) > 1:
        label = ref("ModeLabel", version_label(task.name))
        add(add(element, "setModeValueList"), "entries", label=label, value=stimulus.version)
    if stimulus.modes:
        condition = add(element, "executionCondition")
        for mode in stimulus.modes:
            equals(condition, MODE_LABEL, mode)
    add_time(element, "recurrence", stimulus.recurrence)
    if kind == "PeriodicStimulus":
        for offset in stimulus.times:
            add_time(element, "offset", offset)
    else:
        for time in stimulus.times:
            add_time(element, "occurrenceTimes", time)


def kind_of(stimulus: Stimulus) -> str:
    """Return the class of a stimulus: several instants in a recurrence need a synthetic one."""
    return "PeriodicStimulus" if len(stimulus.times) <= 1 else "PeriodicSyntheticStimulus"


def equals(condition: etree._Element, label: str, value: str) -> None:
    """Append a comparison of a mode label to a condition."""
    entry = add(condition, "entries", "ModeValueCondition", label=ref("ModeLabel", label), value=value)
    entry.set("relation", "EQUAL")
