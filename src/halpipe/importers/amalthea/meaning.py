"""Kinds and attributes of AMALTHEA by what the import makes of them: read, harmless, or harmless while unreached.

Whatever stands in none of these lists is reported by `account` where it occurs, so a kind of a later release warns. The
page "AMALTHEA: what is read" is generated from the lists. Kinds are classes; elements without a class of their own have
their tag, which starts with a small letter. ``feature=a|b`` accepts these values only; APP4MC writes ``_undefined_``
for a value that is not stated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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
