"""Coverage of an import: each element and attribute is read, harmless by a listed reason, or reported.

An element or attribute that stands in none of the lists is reported where it occurs, so a kind of a later release
warns. The page "AMALTHEA: what is read" is generated from the lists. Kinds are classes; elements without a class of
their own have their tag, which starts with a small letter. ``feature=a|b`` accepts these values only; APP4MC writes
``_undefined_`` for a value that is not stated.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.xmi import few

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.importers.amalthea.hardware import Memories
    from halpipe.importers.amalthea.parts import Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Coverage

_BOUNDS = "value values lowerBound upperBound average mean entries deviation distribution"
_GRAPH = "items graphEntries calls runnableItems"
_EVENT = "entity runnable process"
_LATENCIES = "readLatency writeLatency dataRate"

READ = {
    "Amalthea AMALTHEA": "commonElements swModel hwModel osModel stimuliModel eventModel constraintsModel "
    "propertyConstraintsModel mappingModel componentsModel configModel measurementModel customProperties",
    "CommonElements": "tags coreClassifiers memoryClassifiers namespaces",
    "SWModel": "tasks isrs runnables labels modeLabels modes channels processPrototypes sections activations events "
    "typeDefinitions customEntities processChains",
    "HWModel": "definitions featureCategories structures domains system systemTypes ecuTypes mcTypes coreTypes "
    "memoryTypes networkTypes accessPaths",
    "OSModel": "semaphores operatingSystems osOverheads schedulerDefinitions schedulingParameterDefinitions scheduler",
    "StimuliModel": "stimuli clocks",
    "EventModel": "events",
    "ConstraintsModel": "eventChains timingConstraints affinityConstraints runnableSequencingConstraints "
    "dataAgeConstraints requirements dataCoherencyGroups dataStabilityGroups physicalSectionConstraints",
    "PropertyConstraintsModel": "allocationConstraints mappingConstraints",
    "MappingModel": "schedulerAllocation taskAllocation isrAllocation runnableAllocation memoryMapping "
    "physicalSectionMapping coreAllocation executableAllocation",
    "OperatingSystem VendorOperatingSystem": "taskSchedulers interruptControllers osDataConsistency",
    "OsDataConsistency": "mode=noProtection|handledByModelElements",
    "ECU": "microcontrollers memories networks quartzes ports components",
    "Microcontroller": "cores memories networks quartzes ports components",
    "system": "ecus memories networks quartzes",
    # ------------------------------------------------------------------------------------------ software
    "Task": "stimuli activityGraph callGraph preemption=preemptive|cooperative|non_preemptive|nonpreemptive deadline",
    "ISR": "stimuli activityGraph callGraph deadline",
    "Runnable": "activityGraph callGraph runnableItems executionCondition",
    "activityGraph callGraph": _GRAPH,
    "Group CallSequence": f"{_GRAPH} interruptible ordered=true",
    "WhileLoop": f"{_GRAPH} condition",
    "ModeSwitch Switch RunnableModeSwitch ProbabilitySwitch RunnableProbabilitySwitch": "entries defaultEntry "
    "valueProvider",
    "entries": "condition items graphEntries calls runnableItems values value label label1 label2 relation "
    "valueProvider lowerBound upperBound time lowerTimeBorder numberOfOccurrences key",
    "defaultEntry": _GRAPH,
    "condition executionCondition enablingModeValueList disablingModeValueList setModeValueList": "entries",
    "ModeCondition ModeValueCondition ModeLabelCondition ModeValue": "label label1 label2 value relation valueProvider",
    "ConditionConjunction ModeConditionConjunction ModeValueConjunction": "entries",
    "RunnableCall TaskRunnableCall": "runnable statistic counter",
    "counter": "prescaler offset",
    "SynchronousServerCall": "serverRunnable",
    "Ticks": "default extended",
    "RunnableInstructions InstructionsDeviation InstructionsConstant": f"default extended {_BOUNDS}",
    "ExecutionNeed": "needs default",
    "needs extended": "key value",
    "LabelAccess": "data access=read|write statistic implementation=explicit|_explicit_|implicit|timed "
    "dataStability=inherited|noProtection buffered=notBuffered|inherited",
    "statistic LabelAccessStatistic RunEntityCallStatistic": "read write value statistic",
    "MinAvgMaxStatistic": "min avg max",
    "SingleValueStatistic": "value",
    "InterProcessTrigger InterProcessActivation": "stimulus counter",
    "CustomEventTrigger": "event counter",
    "SchedulePoint": "",
    "SemaphoreAccess": "semaphore access=request|exclusive|release",
    "Semaphore": "maxValue",
    "ModeLabelAssignment": "globalLabel",
    "WaitEvent": "eventMask maskType=AND waitingBehaviour",
    "SetEvent": "eventMask process",
    "eventMask": "events",
    "Section": "",
    "Label": "size section dataStability=noProtection buffered=notBuffered",
    "ModeLabel": "mode",
    "Mode EnumMode": "literals",
    "ProcessChain": "processes",
    "OsEvent": "communicationOverheadInBit=0",
    "ModeLiteral": "",
    # ------------------------------------------------------------------------------------------- stimuli
    "PeriodicStimulus Periodic": "recurrence offset jitter stimulusDeviation executionCondition enablingModeValueList "
    "disablingModeValueList setModeValueList deadline",
    "triggerTimes": "timestamps timeStamps",
    "PeriodicSyntheticStimulus PeriodicSynthetic SyntheticStimulus Synthetic": "recurrence offset occurrenceTimes "
    "period triggerTimes stimulusDeviation executionCondition "
    "enablingModeValueList disablingModeValueList setModeValueList",
    "PeriodicBurstStimulus PeriodicBurst": "recurrence offset burstLength occurrenceMinDistance occurrenceCount "
    "executionCondition enablingModeValueList disablingModeValueList setModeValueList",
    "RelativePeriodicStimulus SporadicStimulus Sporadic": "nextOccurrence stimulusDeviation executionCondition "
    "enablingModeValueList disablingModeValueList setModeValueList",
    "ArrivalCurveStimulus ArrivalCurve": "entries arrivalCurveEntries executionCondition enablingModeValueList "
    "disablingModeValueList setModeValueList",
    "VariableRateStimulus VariableRate": "step occurrencesPerStep scenario executionCondition enablingModeValueList "
    "disablingModeValueList setModeValueList",
    "InterProcessStimulus InterProcess": "counter executionCondition enablingModeValueList disablingModeValueList "
    "setModeValueList",
    "EventStimulus": "triggeringEvents counter executionCondition enablingModeValueList disablingModeValueList "
    "setModeValueList",
    "CustomStimulus SingleStimulus Single": "executionCondition enablingModeValueList disablingModeValueList "
    "setModeValueList",
    # ------------------------------------------------------------------------------------------ hardware
    "HwStructure": "structures modules connections",
    "ProcessingUnit": "definition frequencyDomain accessElements caches ports",
    "Core": "coreType prescaler networks memories ports",
    "Memory": "definition frequencyDomain ports",
    "HwPort": "bitWidth",
    "accessPath": "pathElements",
    "ConnectionHandler": "definition frequencyDomain ports internalConnections",
    "ConnectionHandlerDefinition": _LATENCIES,
    "HwConnection": f"{_LATENCIES} port1 port2",
    "HwAccessElement": f"accessPath destination {_LATENCIES}",
    "FrequencyDomain": "defaultValue",
    "ProcessingUnitDefinition": "features",
    "HwFeatureCategory": "features",
    "HwFeature": "value",
    "MemoryDefinition": "dataRate accessLatency",
    "Cache": "definition",
    "CacheDefinition": "lineSize accessLatency",
    "CoreType": "instructionsPerCycle",
    "Quartz": "frequency",
    "prescaler": "quartz clockRatio",
    # ------------------------------------------------------------------------------- mapping and requirements
    "SchedulerAllocation CoreAllocation": "scheduler responsibility core executingPU executingCore",
    "TaskAllocation ProcessAllocation ISRAllocation": "task process isr scheduler controller affinity coreAffinity",
    "RunnableAllocation": "entity scheduler",
    "MemoryMapping": "abstractElement memory",
    "PhysicalSectionMapping": "origin memory labels",
    "TaskScheduler InterruptController": "parentAssociation",
    "parentAssociation": "parent",
    "EventChain eventChain items segments strands": "stimulus response items segments strands eventChain itemType",
    "EventChainReference EventChainContainer": "eventChain",
    "EventChainLatencyConstraint AgeConstraint ReactionConstraint": "scope type minimum maximum",
    "DelayConstraint": "source target upper lower mappingType",
    "DataAgeConstraint": "runnable label dataAge",
    "DataAgeTime dataAge": "maximumTime",
    "ProcessRequirement": "process limit",
    "ProcessChainRequirement": "processChain limit",
    "TimeRequirementLimit limit": "limitType metric limitValue",
    "RunnableSequencingConstraint": "runnableGroups orderType=successor",
    "runnableGroups": "runnables",
    "ProcessPairingConstraint RunnablePairingConstraint ProcessSeparationConstraint "
    "RunnableSeparationConstraint": "group groups target",
    "ProcessEntityGroup": "processes",
    "TargetCore": "cores",
    "TargetScheduler": "schedulers",
    "ProcessEvent": f"eventType=activate|start|terminate {_EVENT}",
    "RunnableEvent": f"eventType=start|terminate {_EVENT}",
    "LabelEvent": f"eventType=read|write|_all_ {_EVENT}",
    "StimulusEvent": "entity",
    "CustomEvent": "",
    # ------------------------------------------------------------------------------------------- quantities
    "recurrence offset step occurrence timestamps timeStamps burstLength occurrenceMinDistance occurrenceTimes time "
    "lowerTimeBorder deadline period maximum minimum upper lower limitValue maximumTime size frequency defaultValue "
    "dataRate lineSize "
    "Time": "value unit numberBits",
    "DiscreteValueConstant DiscreteValueHistogram DiscreteValueBoundaries DiscreteValueStatistics "
    "DiscreteValueUniformDistribution DiscreteValueGaussDistribution DiscreteValueWeibullEstimatorsDistribution "
    "DiscreteValueBetaDistribution": _BOUNDS,
    "ContinuousValueConstant ContinuousValueHistogram ContinuousValueBoundaries ContinuousValueStatistics "
    "ContinuousValueUniformDistribution ContinuousValueGaussDistribution ContinuousValueBetaDistribution "
    "ContinuousValueWeibullEstimatorsDistribution": _BOUNDS,
    "TimeConstant TimeHistogram TimeBoundaries TimeStatistics TimeUniformDistribution TimeGaussDistribution "
    "TimeWeibullEstimatorsDistribution TimeBetaDistribution": _BOUNDS,
    "LatencyConstant LatencyDeviation Deviation UniformDistribution Boundaries GaussDistribution "
    "WeibullEstimators WeibullParameters BetaDistribution": f"{_BOUNDS} cycles",
    "IntegerObject LongObject FloatObject DoubleObject BooleanObject StringObject BigIntegerObject": "value",
    "default deviation distribution value lowerBound upperBound average mean nextOccurrence stimulusDeviation jitter "
    "occurrencesPerStep readLatency writeLatency read write min max": f"{_BOUNDS} unit min avg max",
}
"""The features that the import reads, by the kinds that have them."""

HARMLESS = {
    "names and texts for people": "*.name *.displayName *.description *.id *.shortName Tag *.tags *.namespace "
    "Namespace",
    "data of a tool or a user, without a meaning in AMALTHEA": "CustomProperty *.customProperties",
    "the schedule decides when jobs run, so priorities and algorithms of the scheduler do not": "*.priority "
    "*.schedulingParameters *.schedulingAlgorithm *.parameterExtensions *.schedulePriority SchedulerDefinition "
    "SchedulingParameterDefinition TaskScheduler.definition "
    "InterruptController.definition *.scheduleUnitPriority ISR.category",
    "the schedule runs every activation": "Task.multipleTaskActivationLimit",
    "room in memory takes no time": "Task.size ISR.size Runnable.size ModeLabel.size MemoryDefinition.size "
    "CacheDefinition.size *.memoryPositionAddress *.startAddress *.endAddress *.memOffset "
    "MappingModel.addressMappingType",
    "stated times contain what caches do": "CacheDefinition.cacheType CacheDefinition.writeStrategy "
    "CacheDefinition.nWays CacheDefinition.coherency CacheDefinition.exclusive CacheDefinition.hitRate "
    "Cache.frequencyDomain Cache.ports",
    "code in a memory takes no time that is stated": "Runnable.section PhysicalSectionMapping.runEntities",
    "the kind of hardware says nothing of times": "HwStructure.structureType ProcessingUnitDefinition.puType "
    "ProcessingUnitDefinition.classifiers MemoryDefinition.memoryType MemoryDefinition.classifiers "
    "CoreClassifier MemoryClassifier HwFeatureCategory.featureType "
    "HwPort.portType HwPort.portInterface HwStructure.ports *.powerDomain PowerDomain FrequencyDomain.clockGating "
    "HwAccessElement.source CoreType.bitWidth CoreType.attribute Quartz.type",
    "types and layouts of data take no time": "DataTypeDefinition BaseTypeDefinition "
    "*.dataType *.elementType Label.constant Label.bVolatile LabelAccess.dependsOn Runnable.parameters "
    "RunnableCall.arguments Channel.defaultElements Channel.maxElements",
    "safety and structure of the software do not decide times": "*.asilLevel Runnable.callback Runnable.service "
    "ComponentsModel SynchronousServerCall.port",
    "what a tracer records is no requirement": "ConfigModel EventConfig",
    "measurements are no requirements": "MeasurementModel",
    "how grave a broken requirement is does not change it": "*.severity",
    "the bounds of a distribution count, not its shape": "*.samplingType *.sd *.alpha *.beta *.pRemainPromille "
    "*.occurrences entries.probability entries.occurrences",
    "branches that data choose count with the longest one": "*.localLabels RunnableCall.context "
    "LocalModeLabelAssignment",
    "each way through parallel parts of a chain keeps its limits": "EventChain.minItemsCompleted "
    "eventChain.minItemsCompleted",
    "each mode has a schedule, whichever comes first": "ModeLabel.initialValue",
    "a table lets no job wait for a lock": "SemaphoreAccess.waitingBehaviour Semaphore.semaphoreType "
    "Semaphore.initialValue Semaphore.ownership Semaphore.priorityCeilingProtocol",
    "the server runs within the call, waiting or not": "SynchronousServerCall.waitingBehaviour",
    "arrivals at the least distance are the densest": "RelativePeriodicStimulus.offset VariableRateStimulus.offset "
    "entries.upperTimeBorder VariableRateStimulus.maxIncreasePerStep VariableRateStimulus.maxDecreasePerStep",
}
"""Kinds and features without influence on what a target may do, by the reason; ``*`` stands for every kind."""

UNREACHED = {
    "no task calls it": "Runnable",
    "no task runs it, or it has no upper bound": "Ticks RunnableInstructions InstructionsDeviation "
    "InstructionsConstant ExecutionNeed",
    "no task makes it": "RunnableCall TaskRunnableCall",
    "no mode takes the branch": "entries defaultEntry",
    "its label is in no memory, or no task makes it": "LabelAccess",
    "no access to it in a memory is known": "Label",
    "no access to it is known": "Memory MemoryDefinition Section",
    "no task accesses the label there": "MemoryMapping PhysicalSectionMapping",
    "no unit runs at it": "FrequencyDomain Quartz",
    "no unit is of its type": "ProcessingUnitDefinition HwFeatureCategory HwFeature CoreType",
    "no access takes its width": "HwPort",
    "stated times contain what it does": "Cache CacheDefinition",
    "no access takes its way": "HwConnection ConnectionHandler ConnectionHandlerDefinition HwAccessElement",
    "is responsible for no unit, or no task is allocated to it": "TaskScheduler InterruptController "
    "SchedulerAllocation CoreAllocation RunnableAllocation",
    "activates no task": "PeriodicStimulus Periodic PeriodicSyntheticStimulus PeriodicSynthetic "
    "PeriodicBurstStimulus PeriodicBurst RelativePeriodicStimulus SporadicStimulus Sporadic ArrivalCurveStimulus "
    "ArrivalCurve VariableRateStimulus VariableRate InterProcessStimulus InterProcess EventStimulus CustomStimulus "
    "SingleStimulus Single SyntheticStimulus Synthetic",
    "no stimulus that activates a task uses it": "ClockFunction ClockStepList ClockTriangleFunction ClockSinusFunction "
    "ClockMultiplierList",
    "activates no task, but runnables in design": "PeriodicActivation VariableRateActivation SporadicActivation "
    "SingleActivation EventActivation CustomActivation",
    "triggers no task": "InterProcessTrigger InterProcessActivation CustomEventTrigger",
    "no constraint uses it": "ProcessEvent RunnableEvent LabelEvent StimulusEvent CustomEvent EventSet ModeLabelEvent "
    "ChannelEvent SemaphoreEvent ComponentEvent ProcessChainEvent",
    "no task waits for it": "SetEvent OsEvent",
    "a part of a task starts after what it waits for": "ClearEvent",
    "is data of the tasks, not a mode of the system": "ModeLabel ModeLiteral EnumMode NumericMode Mode",
    "takes no time that is stated": "ModeLabelAccess",
    "no task accesses it": "Semaphore Channel",
    "names no task that is imported": "TaskAllocation ProcessAllocation ISRAllocation",
}
"""Kinds that are harmless where the import does not reach them, by the reason."""

_CONTAINERS = (
    "CommonElements SWModel HWModel OSModel StimuliModel EventModel ConstraintsModel PropertyConstraintsModel "
    "MappingModel OperatingSystem VendorOperatingSystem OsDataConsistency HwStructure ECU Microcontroller"
)
CONTAINERS = frozenset(_CONTAINERS.split())
"""Kinds that only hold others; these are looked at even where none of them is used."""

_PARTS = (
    "MinAvgMaxStatistic SingleValueStatistic LabelAccessStatistic RunEntityCallStatistic ModeCondition "
    "ModeValueCondition ModeLabelCondition ModeValue ConditionConjunction ModeConditionConjunction "
    "ModeValueConjunction ChannelFillCondition LocalModeCondition EventChainReference EventChainContainer DataAgeTime "
    "TimeRequirementLimit RunnableEntityGroup ProcessEntityGroup LabelEntityGroup TargetCore TargetScheduler "
    "TargetMemory Time LatencyConstant LatencyDeviation Deviation"
)
PARTS = frozenset(_PARTS.split())
_PART_ENDINGS = ("Distribution", "Histogram", "Boundaries", "Statistics", "Constant", "Object", "Estimators")


def is_part(kind: str) -> bool:
    """Return whether elements of a kind are values of the element that holds them, and counted with it."""
    is_value = kind.endswith(_PART_ENDINGS) and not kind.startswith("Instructions")
    return kind[:1].islower() or kind in PARTS or is_value


_UNSTATED = ("", "_undefined_")


@record
class Rules:
    """The lists by single kinds and features."""

    read: Mapping[str, Mapping[str, tuple[str, ...]]]
    harmless: Mapping[str, str]
    unreached: Mapping[str, str]

    def reads(self, kind: str, feature: str, value: str = "") -> bool:
        """Return whether the import reads a feature of a kind, with a value that it understands."""
        values = self.read.get(kind, {}).get(feature)
        return values is not None and (not values or value in values)

    def reason(self, kind: str, feature: str = "") -> str:
        """Return why a kind or a feature of it is harmless; empty if it is not on the list."""
        if not feature:
            return self.harmless.get(kind, "")
        return self.harmless.get(f"{kind}.{feature}") or self.harmless.get(f"*.{feature}", "")

    def is_understood(self, kind: str, feature: str, value: str) -> bool:
        """Return whether an attribute may stand without a warning."""
        return value in _UNSTATED or bool(self.reason(kind, feature)) or self.reads(kind, feature, value)


def _read() -> Iterator[tuple[str, dict[str, tuple[str, ...]]]]:
    for kinds, features in READ.items():
        parted = (feature.partition("=") for feature in features.split())
        found = {name: tuple(values.split("|")) if values else () for name, _, values in parted}
        for kind in kinds.split():
            yield kind, found


def _by_word(lists: Mapping[str, str]) -> dict[str, str]:
    return {word: reason for reason, words in lists.items() for word in words.split()}


def _rules() -> Rules:
    read: dict[str, dict[str, tuple[str, ...]]] = {}
    for kind, features in _read():
        read.setdefault(kind, {}).update(features)
    return Rules(read, _by_word(HARMLESS), _by_word(UNREACHED))


RULES = _rules()


_STATED = "has a warning of its own"
_UNKNOWN = "is not read, and not known to be harmless"
_HELP = "remove it, or state in an overlay what matters of it for the schedule"


def account(
    forest: Forest, drafts: Drafts, memories: Memories, accesses: Mapping[Item, Item], coverage: Coverage
) -> None:
    """Account for every element of all files; `accesses` are those that tasks make, with their labels."""
    for access, label in accesses.items():
        if label.is_used:
            access.use_all()
    accounting = _Accounting(forest, drafts, memories, coverage)
    accounting.made = {*accesses, *accesses.values()}
    for root in forest.roots:
        coverage.mapped("file")
        accounting.visit(root)
    accounting.report()


class _Accounting:
    def __init__(self, forest: Forest, drafts: Drafts, memories: Memories, coverage: Coverage) -> None:
        self.forest = forest
        self.coverage = coverage
        self.reasons = {**drafts.without, **dict.fromkeys(memories.unplaced, "is mapped to no memory")}
        self.kinds: defaultdict[str, list[Item]] = defaultdict(list)
        self.features: defaultdict[tuple[str, str, str], list[Item]] = defaultdict(list)
        tasks = forest.within("SWModel", "tasks", "isrs")
        self.made: set[Item] = set()
        """Accesses and labels that are looked into although no phase of a memory comes of them."""
        self.active = {stimulus for task in tasks for stimulus in forest.refs(task, "stimuli")}

    def visit(self, root: Item) -> None:
        """Account for an element and all within it."""
        rest = [root]
        while rest:
            item = rest.pop()
            if item is not root:
                reason = self.reason(item)
                if reason and item in self.made:
                    self.coverage.ignored(item.kind, item.name or item.path, reason, item.at)
                elif reason:
                    self.ignore(item, reason)
                    continue
                else:
                    self.count(item)
            self.attributes(item)
            for child in reversed(item.children):
                if reason := RULES.reason(item.kind, child.tag):
                    self.ignore(child, reason)
                elif RULES.reads(item.kind, child.tag):
                    rest.append(child)
                else:
                    self.unknown(child)

    def reason(self, item: Item) -> str:
        """Return why an element and all within it is ignored, empty if it is looked into."""
        if harmless := RULES.reason(item.kind):
            return harmless if not item.is_used else ""
        if item.is_used or item.kind in CONTAINERS or not _is_entity(item):
            return ""
        if reason := self.reasons.get(item) or self.unreached(item):
            return reason
        if item in self.forest.reported:
            return _STATED
        self.kinds[item.kind].append(item)
        return _UNKNOWN

    def unreached(self, item: Item) -> str:
        """Return why an element that is not used decides nothing; empty if it may."""
        if item in self.active:
            return ""
        if item.kind == "HwAccessElement":
            memory = self.forest.ref(item, "destination")
            return "" if memory is not None and memory.is_used else "no access takes its way"
        return RULES.unreached.get(item.kind, "")

    def attributes(self, item: Item) -> None:
        """Note the attributes that are neither read nor harmless."""
        for name, value in item.element.attrib.items():
            if not name.startswith("{") and not RULES.is_understood(item.kind, str(name), str(value)):
                shown = str(value) if name in RULES.read.get(item.kind, {}) else ""
                self.features[item.kind, str(name), shown].append(item)

    def unknown(self, item: Item) -> None:
        if item in self.forest.reported:
            self.ignore(item, _STATED)
            return
        self.kinds[item.kind].append(item)
        self.ignore(item, _UNKNOWN)

    def count(self, item: Item) -> None:
        if _is_entity(item):
            if item.is_used:
                self.coverage.mapped(item.kind)
            else:
                self.coverage.ignored(item.kind, item.name or item.path, "holds nothing of influence", item.at)

    def ignore(self, item: Item, reason: str) -> None:
        for inner in item.walk():
            if _is_entity(inner):
                self.coverage.ignored(inner.kind, inner.name or inner.path, reason, inner.at)

    def report(self) -> None:
        """Report what may decide times, by kind and by attribute."""
        for kind, items in self.kinds.items():
            message = f"{_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))
        for (kind, name, value), items in self.features.items():
            stated = f'{name}="{value}"' if value else name
            message = f"{stated} of {_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))


def _is_entity(item: Item) -> bool:
    """Return whether an element counts on its own; values and references count with what holds them."""
    return not is_part(item.kind) and not (item.get("href") and not item.children)


def _times(count: int, kind: str) -> str:
    return f"{kind} is" if count == 1 else f"{count} of {kind} are"


def _places(items: Sequence[Item]) -> str:
    return few([f"{item.name or item.path} (line {item.at.line})" for item in items])
