"""The account of every element: each is mapped or ignored, once, with a reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.importers.amalthea.memory import Memories
    from halpipe.importers.amalthea.parts import Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Coverage

# Elements that are a value, or a part, of the element that holds them: they are accounted for with it.
_PARTS = frozenset(
    (
        *("recurrence", "offset", "nextOccurrence", "jitter", "minDistance", "stimulusDeviation", "occurrenceTimes"),
        *("time", "shift", "period", "scenario", "occurrence", "burstLength", "occurrenceMinDistance", "step"),
        *("value", "values", "key", "default", "extended", "needs", "deviation", "distribution", "mean", "statistic"),
        *("lowerBound", "upperBound", "lowerTimeBorder", "upperTimeBorder", "read", "write", "size", "frequency"),
        *("defaultValue", "limit", "limitValue", "lower", "upper", "minimum", "maximum", "dataAge", "maximumTime"),
        *("minimumTime", "readLatency", "writeLatency", "accessLatency", "dataRate", "accessPath", "lineSize"),
        *("prescaler", "delay", "latencies", "attribute", "definition", "deadline", "min", "max", "schedulingUnit"),
        *("entries", "defaultEntry", "condition", "executionCondition", "enablingModeValueList", "eventMask"),
        *("disablingModeValueList", "setModeValueList", "valueProvider", "activityGraph", "callGraph", "eventChain"),
        *("schedulingAlgorithm", "schedulingParameters", "parameterExtensions", "parentAssociation", "parameter"),
        *(
            "group",
            "groups",
            "target",
            "runnableGroups",
            "process",
            "data",
            "stimuli-ref",
            "maxBudget",
            "replenishment",
        ),
    )
)

_REASONS = {
    "Task": "has no period",
    "ISR": "has no period",
    "Runnable": "no task calls it",
    "Label": "no access to it in a memory is known",
    "LabelAccess": "its label is in no memory that the unit reaches, or no task makes it",
    "PeriodicStimulus": "activates no task",
    "RunnableCall": "no task makes it",
    "TaskRunnableCall": "no task makes it",
    "Ticks": "no task runs it, or it has no upper bound",
    "ModeLabel": "is data of the tasks, not a mode of the system",
    "ModeLiteral": "is data of the tasks, not a mode of the system",
    "EnumMode": "is data of the tasks, not a mode of the system",
    "NumericMode": "is data of the tasks, not a mode of the system",
    "Mode": "is data of the tasks, not a mode of the system",
    "ModeLabelAccess": "takes no time that is stated",
    "SemaphoreAccess": "a schedule needs no locks between tasks on one unit, and knows none between units",
    "SetEvent": "no task waits for it",
    "ClearEvent": "a schedule starts a part after what it waits for",
    "WaitEvent": "no task sets its event",
    "OsEvent": "no task waits for it",
    "Memory": "no access to it is known",
    "MemoryMapping": "no task accesses the label there",
    "TaskScheduler": "is responsible for no unit, or no task is allocated to it",
    "ProcessRequirement": "has no counterpart in the model",
    "RunnableRequirement": "has no counterpart in the model",
    "EventChain": "names no tasks",
    "ProcessPrototype": "is a task in design; tasks are read",
    "Tag": "has no influence on timing",
    "CustomProperty": "is not one of halpipe",
    "FrequencyDomain": "no unit runs at it",
    "Quartz": "no unit runs at it",
}
_BY_MODEL = {
    "CommonElements": "has no influence on timing",
    "ComponentsModel": "has no influence on timing",
    "ConfigModel": "has no influence on timing",
    "MeasurementModel": "measurements are not requirements",
    "PropertyConstraintsModel": "limits mappings yet to be made",
    "EventModel": "no constraint uses it",
    "HWModel": "has no influence on the times of tasks",
    "OSModel": "has no influence on a static schedule",
    "StimuliModel": "activates no task",
    "ConstraintsModel": "has no counterpart in the model",
    "MappingModel": "binds no task",
}


def account(
    forest: Forest, drafts: Drafts, memories: Memories, accesses: Mapping[Item, Item], coverage: Coverage
) -> None:
    """Account for every element of all files; `accesses` are those that tasks make, with their labels."""
    for access, label in accesses.items():
        if label.is_used:
            access.use_all()
    for root in forest.roots:
        coverage.mapped("file")
        for item in root.walk():
            if item is root or item.tag in _PARTS or (item.get("href") and not item.children):
                continue
            if item.is_used:
                coverage.mapped(item.kind)
            else:
                coverage.ignored(item.kind, item.name or item.path, _reason(item, drafts, memories), item.at)


def _reason(item: Item, drafts: Drafts, memories: Memories) -> str:
    if item in drafts.without:
        return drafts.without[item]
    if item in memories.unplaced:
        return "is mapped to no memory"
    return _REASONS.get(item.kind) or _BY_MODEL.get(_model(item)) or "has no influence on timing"


def _model(item: Item) -> str:
    owner: Item | None = item
    while owner is not None and owner.kind not in _BY_MODEL:
        owner = owner.owner
    return "" if owner is None else owner.kind
