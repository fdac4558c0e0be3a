"""Tasks, versions and modes as halpipe's own export carries them: standard elements with exact values beside them."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_rational
from halpipe.core.records import record
from halpipe.importers.amalthea.graph import CALLS, everything, steps
from halpipe.importers.amalthea.names import legal
from halpipe.importers.amalthea.properties import (
    NONE,
    agrees,
    edited,
    optional_duration,
    stated_of,
    structure,
    text_of,
    value_of,
)
from halpipe.importers.amalthea.stimuli import PERIODIC, Activation, activations_of
from halpipe.models import (
    WHOLE,
    Access,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Mode,
    Run,
    Source,
    Split,
    Task,
    Transfer,
    Transition,
    Version,
)
from halpipe.models.attributes import read_attributes

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.xmi import Forest, Item

_PERIOD = "period"
_WITH_ELEMENTS = ("name", "period", "offset", "slack", "deadline")
"""Attributes of a task that are read together with the elements that AMALTHEA has for them."""
_VERSION = "version"
_NANOSECOND = Duration(1)


def is_own(forest: Forest) -> bool:
    """Return whether halpipe wrote the model."""
    return any(text_of(root, "name") is not None for root in forest.roots)


def is_carried(task: Item) -> bool:
    """Return whether a task was written by halpipe."""
    return text_of(task, _PERIOD) is not None


def activation_of(forest: Forest, task: Item, stimuli: Sequence[Item]) -> Activation | None:
    """Return the activation of a carried task, None on demand; its stimulus counts where it was edited."""
    period = value_of(forest, task, _PERIOD, optional_duration)
    offset = value_of(forest, task, "offset", optional_duration)
    stimulus = stimuli[0] if stimuli else None
    exact = None if period is None else Activation(period, offset, stimulus, distance_of(forest, task))
    if stimulus is None or any(text_of(found, "placed") is not None for found in stimuli):
        return exact
    stated = next(iter(activations_of(forest, stimulus)), None)
    same = stated is None if exact is None else stated is not None and agrees(exact.period, stated.period)
    if same and exact is not None and stated is not None and stimulus.kind in PERIODIC:
        same = agrees(exact.offset, stated.offset)
    if not same:
        edited(forest, task, _PERIOD, "differs from the stimulus")
        return stated
    return exact


# ------------------------------------------------------------------------------------------------ tasks


def distance_of(forest: Forest, task: Item) -> Duration | None:
    """Return how far the arrivals of a carried task are apart at least."""
    return value_of(forest, task, "distance", optional_duration)


def slack_of(forest: Forest, task: Item) -> Fraction:
    """Return the slack of a carried task."""
    return value_of(forest, task, "slack", parse_rational) or Fraction(0)


def attributes_of(forest: Forest, task: Item) -> dict[str, Any]:
    """Return the attributes of a carried task that AMALTHEA has no elements for, by field."""
    return stated_of(forest, task, Task, *_WITH_ELEMENTS)


def interrupts_of(unit: Item) -> tuple[Interrupt, ...]:
    """Return the interrupts that halpipe wrote to a unit; none if they cannot be read."""
    try:
        return tuple(
            Interrupt(**{**read_attributes(Interrupt, found), "name": legal(found["name"])})
            for found in structure(text_of(unit, "interrupts") or "[]")
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        return ()


@record
class Platform:
    """What versions may name, and the unit names that a unit item has."""

    units: Mapping[Item, str]
    resources: Collection[str]
    frequencies: Mapping[Item, Fraction | None]


def versions_of(forest: Forest, task: Item, platform: Platform, bound: Sequence[Item] | None) -> dict[Item, Version]:
    """Return the versions of a carried task by the runnable of each."""
    found: dict[Item, Version] = {}
    for step in everything(forest, steps(task)):
        runnable = forest.ref(step, CALLS[step.kind]) if step.kind in CALLS else None
        name = None if runnable is None else text_of(runnable, _VERSION)
        if runnable is not None and name is not None and runnable not in found:
            step.use()
            runnable.use_all()
            found[runnable] = _version(forest, runnable, name, platform)
    allowed = {unit for version in found.values() for unit in version.units}
    affinity = [platform.units[item] for item in bound or () if item in platform.units]
    if not set(affinity) <= allowed:
        edited(forest, task, "units", "of its runnables differs from the affinity")
        found = {runnable: replace(version, units=tuple(affinity)) for runnable, version in found.items()}
    return found


def _version(forest: Forest, runnable: Item, name: str, platform: Platform) -> Version:
    units = tuple((value_of(forest, runnable, "units", str) or "").split())
    known = set(platform.units.values())
    if not set(units) <= known:
        edited(forest, runnable, "units", "names units that are not there")
        units = tuple(unit for unit in units if unit in known)
    accesses = value_of(forest, runnable, "accesses", _accesses) or ()
    if any(access.resource not in platform.resources for access in accesses):
        edited(forest, runnable, "accesses", "names memories that are not there")
        accesses = tuple(access for access in accesses if access.resource in platform.resources)
    gang = value_of(forest, runnable, "gang", int)
    return Version(
        name=legal(name),
        wcet=_wcet(forest, runnable, platform),
        units=units,
        gang=1 if gang is None else gang,
        accesses=accesses,
        source=value_of(forest, runnable, "source", _source),
        split=value_of(forest, runnable, "split", _split) or WHOLE,
    )


def _wcet(forest: Forest, runnable: Item, platform: Platform) -> Duration | None:
    """Return the exact WCET if the ticks are the same in whole nanoseconds, else what the ticks come to."""
    exact = value_of(forest, runnable, "wcet", optional_duration)
    stated = [time for step in steps(runnable) for time in _times(forest, step, platform)]
    standard = max(stated) if stated else None
    rounded = None if exact is None else Duration(math.ceil(exact.ns))
    if rounded != standard and platform.units:
        edited(forest, runnable, "wcet", "differs from the ticks")
        return standard
    return exact


def _times(forest: Forest, step: Item, platform: Platform) -> Iterable[Duration]:
    if step.kind != "Ticks":
        return
    entries = [(forest.ref(entry, "key"), entry.one("value")) for entry in step.all("extended")]
    for type, value in [*entries, (None, step.one("default"))]:
        ticks = None if value is None else forest.number(value, "value")
        for unit, frequency in platform.frequencies.items():
            if ticks is not None and frequency and (type is None or forest.ref(unit, "definition") is type):
                yield _NANOSECOND * (ticks * 10**9 / frequency)


def _accesses(text: str) -> tuple[Access, ...]:
    return tuple(_access(found) for found in structure(text))


def _access(found: Mapping[str, Any]) -> Access:
    return Access(**read_attributes(Access, found), transfers=tuple(map(_transfer, found.get("transfers", ()))))


def _transfer(found: Mapping[str, Any]) -> Transfer:
    names = {field: legal(found[field]) for field in ("buffer", "symbol")}
    return Transfer(**{**read_attributes(Transfer, found), **names})


def _split(text: str) -> Split:
    found = structure(text)
    return Split(
        points=tuple(Duration.parse(point) for point in found.get("points", ())),
        anywhere=found.get("anywhere") is True,
        **read_attributes(Split, found),
    )


def _source(text: str) -> Source:
    found = structure(text)
    return Source(files=tuple(found["files"]), entry=found["entry"], defines=tuple(found["defines"]))


# ------------------------------------------------------------------------------------------------ modes


def modes_of(
    forest: Forest, modes: Sequence[SystemMode], active: Mapping[str, Collection[str]], tasks: Sequence[Task]
) -> tuple[Mode, ...] | None:
    """Return the modes as halpipe wrote them; None where it did not, or where stimuli were edited since.

    `active` gives for each mode the tasks whose stimuli are active in it.
    """
    root = next((root for root in forest.roots if text_of(root, "modes") is not None), None)
    if root is None:
        return None
    if text_of(root, "modes") == NONE:
        return ()
    found = []
    on_demand = {task.name for task in tasks if task.period is None}
    for mode in modes:
        runs = None if mode.origin is None else value_of(forest, mode.origin, "runs", structure)
        if runs is None or mode.origin is None or not _fit(runs, active[mode.name], on_demand, tasks):
            edited(forest, mode.origin or root, "runs", "differs from the stimuli")
            return None
        found.append(Mode(name=mode.name, runs=tuple(Run(task=task, versions=tuple(v)) for task, *v in runs)))
    return tuple(found)


def _fit(runs: Any, active: Collection[str], on_demand: Collection[str], tasks: Sequence[Task]) -> bool:
    """Return whether runs name tasks and versions that there are, and the same tasks as the stimuli do."""
    known = {task.name: {version.name for version in task.versions} for task in tasks}
    try:
        named = [(task, set(versions)) for task, *versions in runs]
    except (TypeError, ValueError):
        return False
    if not all(isinstance(task, str) and task in known and versions <= known[task] for task, versions in named):
        return False
    return {task for task, _ in named} - set(on_demand) == set(active) - set(on_demand)


def transitions_of(forest: Forest, modes: Sequence[Mode]) -> tuple[Transition, ...]:
    """Return the transitions that halpipe wrote, if they are between the modes that there are."""
    known = {mode.name for mode in modes}
    for root in forest.roots:
        found = value_of(forest, root, "transitions", _transitions) or ()
        if not all({transition.source, transition.target} <= known for transition in found):
            edited(forest, root, "transitions", "names modes that are not there")
        elif found:
            return found
    return ()


def _transitions(text: str) -> tuple[Transition, ...]:
    return tuple(Transition(**read_attributes(Transition, found)) for found in structure(text))


def rules_of(forest: Forest, tasks: Sequence[Task], modes: Sequence[Mode]) -> tuple[HealthRule, ...]:
    """Return the health rules that halpipe wrote, if their tasks and modes are there."""
    known, names = {task.name for task in tasks}, {mode.name for mode in modes} | {""}
    for root in forest.roots:
        found = value_of(forest, root, "health", _rules) or ()
        if not all(rule.task in known and rule.mode in names for rule in found):
            edited(forest, root, "health", "names tasks or modes that are not there")
        elif found:
            return found
    return ()


def _rules(text: str) -> tuple[HealthRule, ...]:
    return tuple(
        HealthRule(
            task=r["task"],
            event=HealthEvent(r["on"]),
            count=r["count"],
            cycles=r["cycles"],
            action=HealthAction(r["action"]),
            mode=r.get("mode", ""),
        )
        for r in structure(text)
    )
