"""Coverage of an ARXML import, and the kinds of elements that cannot decide the timing of a schedule.

Whatever is not on the list of harmless kinds, and is not used, is reported: it may decide timing (MODEL 10.9). A name
that ends in `*` stands for all kinds that begin so. What stands inside an element of such a kind is harmless, too."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.arxml.codes import UNUSED_KIND
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.system.components import COMPOSITION, place_of
from halpipe.importers.arxml.system.timing import CONSTRAINTS, KINDS, SYNCHRONISATION, is_guarantee, is_requirement
from halpipe.importers.common.base import Coverage

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.arxml.files.tree import Node, Tree
    from halpipe.importers.arxml.system.values import Place, System
    from halpipe.importers.arxml.tasks.activation import Activation, Draft
    from halpipe.importers.arxml.tasks.dataflow import DataFlow

_HOLDERS = ("", "AR-PACKAGE", "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE")
_REASONS = {
    "data types and values: what is computed, not when": """
        ARRAY-TYPE BOOLEAN-TYPE CALPRM-* CHAR-TYPE INTEGER-TYPE INTER-RUNNABLE-VARIABLE OPAQUE-TYPE REAL-TYPE
        INTEGER-LITERAL RECORD-TYPE STRING-TYPE APPLICATION-*-DATA-TYPE APPLICATION-ERROR ARGUMENT-DATA-PROTOTYPE
        CALIBRATION-PARAMETER-VALUE-SET COMPU-METHOD CONSTANT-SPECIFICATION* CPP-IMPLEMENTATION-DATA-TYPE
        CUSTOM-CPP-IMPLEMENTATION-DATA-TYPE DATA-CONSTR DATA-PROTOTYPE-* DATA-TYPE-* IMPLEMENTATION-DATA-TYPE*
        PARAMETER-DATA-PROTOTYPE PHYSICAL-DIMENSION* STD-CPP-* SW-BASE-TYPE SW-RECORD-LAYOUT UNIT UNIT-GROUP
        VALUE-BASED-* VARIABLE-DATA-PROTOTYPE MC-FUNCTION* RAPID-PROTOTYPING-SCENARIO SW-AXIS-TYPE
        SW-CODE-SYNTAX INTERPOLATION-ROUTINE-MAPPING-SET PER-INSTANCE-MEMORY
    """,
    "interfaces and ports: which data, not when": """
        BSW-ENTRY-* BSW-MODULE-*ENTRY CLIENT-SERVER-INTERFACE* CLIENT-SERVER-OPERATION DATA-ELEMENT-PROTOTYPE
        OPERATION-PROTOTYPE MODE-DECLARATION-GROUP-PROTOTYPE MODE-DECLARATION-MAPPING-SET MODE-GROUP
        MODE-SWITCH-INTERFACE MODE-SWITCH-POINT NV-DATA-INTERFACE P-PORT-PROTOTYPE PARAMETER-ACCESS
        PARAMETER-INTERFACE PORT-INTERFACE-MAPPING* PORT-GROUP PR-PORT-PROTOTYPE R-PORT-PROTOTYPE
        SENDER-RECEIVER-INTERFACE SERVICE-INTERFACE TRIGGER-INTERFACE VARIABLE-ACCESS VARIABLE-AND-PARAMETER-*
        PERSISTENCY-* PLATFORM-HEALTH-* SYNCHRONIZED-TIME-BASE-* MODE-ACCESS-POINT
    """,
    "what is called at once runs within its caller": "SYNCHRONOUS-SERVER-CALL-POINT BSW-CALLED-ENTITY",
    "communication: when frames are sent is left to the network": """
        CAN-* COMMUNICATION-* CONTAINER-I-PDU DCM-I-PDU DATA-TRANSFORMATION* DDS-* DO-IP-* E2E-* END-TO-END-*
        ETHERNET-* FLEXRAY-* FRAME FRAME-PORT GATEWAY GENERAL-PURPOSE-* HW-PORT-* I-PDU-* I-SIGNAL* IP-SEC-* J-1939-*
        J1939-* LIN-* MAC-* MULTIPLEXED-I-PDU N-PDU NETWORK-* NM-* PDU-* PDUR-* SECURED-I-PDU SECURE-* SO-AD-*
        SOCKET-* SOME-IP-* SOMEIP-* SERVICE-DISCOVERY-* SERVICE-INSTANCE-* SYSTEM-SIGNAL* TCP-* TLS-* TP-*
        TTCAN-* UDP-* USER-DEFINED-* VLAN-* XCP-PDU PROVIDED-*-SERVICE-INSTANCE REQUIRED-*-SERVICE-INSTANCE
        *-SERVICE-INTERFACE-DEPLOYMENT ALLOWED-* CYCLIC-* GLOBAL-TIME-* SIGNAL-* TRANSFORMER-* TRANSFORMATION-*
        SENDER-RECEIVER-TO-SIGNAL*
    """,
    "diagnosis, security and non-volatile memory": """
        CRYPTO-* DIAGNOSTIC-* DLT-* DTC-* FM-* IDS-* KEY-* LOG-* NV-BLOCK-* SECURITY-* SWC-SERVICE-DEPENDENCY
        BSW-SERVICE-DEPENDENCY *-NEEDS SERVICE-NEEDS* UCM-* VEHICLE-PACKAGE SOFTWARE-CLUSTER* SOFTWARE-PACKAGE
    """,
    "text, structure and sources: holds or describes others": """
        ALIAS-NAME-SET AR-PACKAGE BLUEPRINT-MAPPING-SET BUILD-* BSW-COMPOSITION-* BSW-IMPLEMENTATION CODE
        CONSISTENCY-NEEDS COLLECTION DOCUMENTATION* ECU-PARAMETER-DEFINITION ECU-SW-COMPOSITION
        ECUC-DEFINITION-COLLECTION ECUC-MODULE-DEF MODULE-DEF
        ECUC-VALUE-COLLECTION EVALUATED-VARIANT-SET FLAT-INSTANCE-DESCRIPTOR FLAT-MAP KEYWORD* LIFE-CYCLE-* MC-*
        MEMORY-SECTION POST-BUILD-VARIANT-* PREDEFINED-VARIANT RESOURCE-CONSUMPTION SDG-* STACK-USAGE*
        HEAP-USAGE* STATIC-MEMORY SW-ADDR-METHOD SW-SYSTEMCONST* SWC-BSW-MAPPING SWC-IMPLEMENTATION
        SWC-TO-IMPL-MAPPING SYSTEM SYSTEM-MAPPING TD-EVENT-BSW-* TD-EVENT-COM* TD-EVENT-CYCLE-START
        TD-EVENT-FRAME* TD-EVENT-I-* TD-EVENT-MODE-* TD-EVENT-OPERATION TD-EVENT-SERVICE-* TD-EVENT-SWC-*
        TD-EVENT-TRIGGER TD-EVENT-VARIABLE-* TIMING-EXTENSION* SWC-TIMING BSW-MODULE-TIMING
        BSW-MODULE-DEPENDENCY BSW-DEBUG-INFO BSW-SCHEDULER-NAME-PREFIX VFB-TIMING SYSTEM-TIMING ECU-TIMING
        EOC-EXECUTABLE-ENTITY-REF* EOC-EVENT-REF TIMING-CLOCK* ECU-INSTANCE ROOT-SW-COMPOSITION-PROTOTYPE
        VIEW-MAP-SET HW-* ECUC-MODULE-CONFIGURATION-VALUES
    """,
    "configures another module than Os, Rte and EcuC": "ECUC-CONTAINER-VALUE",
    "part of an alarm, table or OsTask: counted with it": """
        OsAlarmAction OsAlarmActivateTask OsAlarmAutostart OsAlarmCallback OsAlarmIncrementCounter
        OsAlarmSetEvent OsEvent OsScheduleTableAutostart OsScheduleTableEventSetting
        OsScheduleTableTaskActivation OsTaskAutostart OsIsrTimingProtection RteSwComponentInstance
        RteBswModuleInstance RteOsInteraction RteUsedOsActivation OsScheduleTblAdjustableExpPoint
    """,
    "the OS itself: its hooks, modes, memory and timers": """
        ArcOs* OsAppMode OsApplicationHooks OsApplicationTrustedFunction OsCore OsCoreStacks
        OsDerivativeInformation OsDriver OsHardwareTimer* OsHook* OsImplementationInformation
        OsInterruptSupportedType OsIoc* OsMemoryRegion* OsOS OsOS* OsPeripheralArea OsPhysicalCore*
        OsPublishedInformation OsStack* OsSystemIntCtrl* OsSystemMpu OsModeEntryModule OsDSMCModule OsTimeConstant
        OsCounterTimeConstant OsInclude OsOsStack ALL AUTO Automatic FALSE Standard TRUE
        OsCoreXSignalChannel OsInterruptRouting OsMemoryProtection OsMicrokernel MkFunction MkMemoryProtection MkStack
        OsDebug OsIsrXSignalReceiver OsPeripheralRegion
    """,
    "general settings of Rte and EcuC": """
        BswInitialization Ecuc* EcuCGeneral InitFunction Pdu* PostbuildLoadable RteBswExclusiveAreaImpl RteBswGeneral
        RteBswRequiredModeGroupConnection RteBswRequiredTriggerConnection PublishedInformation OsCORTEX*
        RteExclusiveAreaImplementation RteComponentTypeCalibration RteGeneration RteInitialization*
        RteNvRamAllocation RtePostBuildVariantConfiguration RteSwComponentType VectorCommonData
        CommonPublishedInformation BswConfiguration
    """,
    "Adaptive Platform: state of processes and machines": """
        FUNCTION-GROUP-SET OS-MODULE-INSTANTIATION PROCESS-STATE-MACHINE STARTUP-CONFIG-SET
        *-MODULE-INSTANTIATION STATE-DEPENDENT-* MACHINE-DESIGN EXECUTABLE PROCESS-DESIGN*
        ROOT-SW-COMPONENT-PROTOTYPE
    """,
}


@cache
def reason_of(kind: str) -> str:
    """Return why a kind is harmless, empty if it is not on the list."""
    return next((reason for reason, known in _REASONS.items() if any(_fits(kind, k) for k in known.split())), "")


def _fits(kind: str, known: str) -> bool:
    head, star, tail = known.partition("*")
    return kind == known if not star else kind.startswith(head) and kind.endswith(tail)


def is_harmless(node: Node, kind: str) -> bool:
    """Whether an element, or one that holds it other than its package or module, is harmless."""
    if reason_of(kind):
        return True
    holder = node.parent
    while holder is not None and holder.tag not in _HOLDERS:
        if reason_of(holder.tag):
            return True
        holder = holder.parent
    return False


_NO_INFLUENCE = "no influence on timing"
_UNDEFINED = "container without DEFINITION-REF"
_UNUSED = {
    "OsTask": "runs no task of the model",
    "OsAlarm": "gives no task its period",
    "OsScheduleTable": "gives no task its period",
    "OsScheduleTableExpiryPoint": "gives no task its period",
    "OsCounter": "its ticks are not needed",
    "OsApplication": "runs no task of the model",
    "EXCLUSIVE-AREA": "no two tasks enter it",
    "OsResource": "no two tasks take it",
    "RUNNABLE-ENTITY": "no event starts it",
    "BSW-SCHEDULABLE-ENTITY": "no event starts it",
    "ASSEMBLY-SW-CONNECTOR": "carries no data between runnables",
    "DELEGATION-SW-CONNECTOR": "carries no data between runnables",
    "SW-COMPONENT-PROTOTYPE": "its component has no task",
    "MODE-DECLARATION-GROUP": "switches no task off",
    "MODE-DECLARATION": "switches no task off",
    "MODE-TRANSITION": "switches no task off",
    "EXECUTION-ORDER-CONSTRAINT": "orders no tasks",
    "SYNCHRONIZATION-POINT-CONSTRAINT": "orders no tasks",
    "TIMING-DESCRIPTION-EVENT-CHAIN": "its events belong to no task, or to several",
    "MACHINE": "no process runs on it",
    "PROCESS": "left out by the overlay",
    "EXECUTABLE": "what a process starts, not when or where",
    "STARTUP-CONFIG": "priorities and policies of the operating system do not count in a time-triggered schedule",
    "RESOURCE-GROUP": "budgets of the operating system do not count in a time-triggered schedule",
    COMPOSITION: "none of its components has a task",
}


_REMEDIES = {
    "OsSpinlock": "state which tasks take it in the overlay, as accesses to a lock",
    "OsTaskTimingProtection": "take its execution budgets as WCETs (--wcet budget), or see that WCETs are below them",
}


class Ledger:
    """Notes what became of elements, known by path and kind; the first word on an element counts."""

    def __init__(self) -> None:
        self._mapped: set[tuple[str, str]] = set()
        self._reasons: dict[tuple[str, str], str] = {}

    def mapped(self, *places: Place) -> None:
        """Note elements that shaped the model."""
        self._mapped.update((place.path, place.kind) for place in places)

    def ignored(self, place: Place, reason: str) -> None:
        """Note why an element did not; this yields to being mapped elsewhere."""
        self._reasons.setdefault((place.path, place.kind), reason)

    def close(self, tree: Tree, kinds: dict[str, str]) -> Coverage:
        """Account for every node of the tree; `kinds` gives the kinds of configuration containers by path.

        Report the kinds that are not used for no known reason, and that are not known to be harmless.
        """
        coverage = Coverage()
        for tag, count in tree.dropped.items():
            coverage.dropped(tag, count)
        for removed in tree.removed:
            coverage.ignored(removed.tag, removed.path, "not in the chosen variant", removed.at)
        for tag, at in tree.nameless:
            coverage.ignored(tag, "(no name)", "has no SHORT-NAME", at)
        nodes = [
            (node, kinds.get(node.path, node.tag) or _UNDEFINED if node.tag == "ECUC-CONTAINER-VALUE" else node.tag)
            for node in tree.nodes()
        ]
        mapped = _with_holders(node for node, kind in nodes if (node.path, kind) in self._mapped)
        unused: dict[str, list[Node]] = {}
        told = {finding.path for finding in tree.findings.items}
        for node, kind in nodes:
            if node in mapped:
                coverage.mapped(kind)
            else:
                usual = "starts no runnable that is known" if kind.endswith("-EVENT") else _NO_INFLUENCE
                reason = self._reasons.get((node.path, kind)) or _UNUSED.get(kind, usual)
                is_lost = _is_demand(node) and named(node.tag, node.path) not in told
                if is_lost or (reason == _NO_INFLUENCE and not is_harmless(node, kind)):
                    unused.setdefault(kind, []).append(node)
                    reason = "not used, though it may decide timing"
                coverage.ignored(kind, node.path, reason, node.at)
        for kind, found in unused.items():
            message = f"{len(found)} {kind} are not used, and may decide timing: {listed([n.path for n in found])}"
            help = _REMEDIES.get(kind, "state in the overlay what they demand, or that they demand nothing")
            tree.findings.report(UNUSED_KIND, message, at=found[0].at, path=named(kind, found[0].path), help=help)
        return coverage


def _is_demand(node: Node) -> bool:
    """Whether an element states what is required of tasks, of whatever kind it is."""
    return node.parent is not None and node.parent.tag.endswith("-TIMING") and is_requirement(node)


def _with_holders(nodes: Iterable[Node]) -> set[Node]:
    """Return the nodes and everything that holds them: packages, behaviours, module configurations."""
    found: set[Node] = set()
    for start in nodes:
        node: Node | None = start
        while node is not None and node not in found:
            found.add(node)
            node = node.parent
    return found


def note_timing(ledger: Ledger, system: System, tree: Tree) -> None:
    """Note why elements of the timing extension, and execution times, are not used."""
    for node in tree.tagged(
        *CONSTRAINTS, SYNCHRONISATION, "EXECUTION-ORDER-CONSTRAINT", "SYNCHRONIZATION-POINT-CONSTRAINT"
    ):
        if is_guarantee(node):
            ledger.ignored(place_of(node), "guarantee: states what is fulfilled, not what is required")
        elif node.tag in (*CONSTRAINTS, SYNCHRONISATION):
            ledger.ignored(place_of(node), "timing constraint that has no counterpart, or is about no task")
    for node in tree.tagged(*KINDS):
        ledger.ignored(place_of(node), "a longer or more trustworthy time counts, or its runnable makes no task")
    for arrival in system.timing.arrivals:
        ledger.ignored(arrival.place, "its event has a period from elsewhere, or is of no task")


def note_activations(ledger: Ledger, activations: Iterable[Activation], drafts: Iterable[Draft]) -> None:
    """Note events, runnables, OS tasks and mappings, by whether a task came of them."""
    for draft in drafts:
        for member in draft.members:
            ledger.mapped(member.place, *member.used)
            if member.process is not None:
                ledger.mapped(*member.process.parts)
            causes = (member.arrival, member.event, member.os_task and member.mapping, member.os_task)
            ledger.mapped(*(cause.place for cause in causes if cause is not None))
    for activation in activations:
        reason = activation.reason or "left out by the overlay"
        ledger.ignored(activation.event.place if activation.event else activation.place, reason)
        if activation.runnable is not None:
            ledger.ignored(activation.runnable.place, f"started by {activation.kind} only: {reason}")
        if activation.mapping is not None:
            ledger.ignored(activation.mapping.place, f"its event makes no task: {reason}")


def note_mappings(ledger: Ledger, system: System) -> None:
    """Note why event mappings map nothing: their event, OsTask or component instance is in no file, or is not named."""
    known = {prototype for instance in system.instances for prototype in instance.context} | set(system.configured)
    for mapping in system.configuration.mappings:
        if mapping.event is None:
            reason = "its event is in no file"
        elif mapping.prototype is not None and mapping.prototype not in known:
            reason = "its component instance is in no file"
        elif mapping.task is None:
            reason = "its OsTask is in no file" if mapping.is_called else "names no OsTask"
        else:
            reason = "another mapping of its event counts, or no runnable is started by it"
        ledger.ignored(mapping.place, reason)


def note_structure(ledger: Ledger, system: System, drafts: Sequence[Draft], dataflow: DataFlow) -> None:
    """Note what gives tasks their place: components, prototypes, compositions, connectors, applications, cores."""
    used = {path for draft in drafts for member in draft.members for path in member.context}
    instantiated = {instance.component.place.path for instance in system.instances}
    for component in system.components:
        if component.place.path not in instantiated:
            inner = [*(e.place for e in component.events), *(r.place for r in component.runnables)]
            for place in inner:
                ledger.ignored(place, "its component type is no part of the system")
        for place in (component.place, *component.behaviors):
            ledger.ignored(place, "has no periodic runnable")
    type_paths = {p.place.path: p.type for c in system.compositions for p in c.prototypes}
    used |= {type_paths[path] or "" for path in used if path in type_paths}
    for composition in system.compositions:
        if composition.place.path in used:
            ledger.mapped(composition.place)
        if composition.place.path in system.copies:
            ledger.ignored(composition.place, "copy of a composition that the Rte configuration names")
        ledger.mapped(*(p.place for p in composition.prototypes if p.place.path in used))
        ledger.mapped(*(c.place for c in composition.connectors if c.place.path in dataflow.connectors))
    os_tasks = {m.os_task.place.path for draft in drafts for m in draft.members if m.os_task}
    for application in system.configuration.applications:
        if any(path in os_tasks for path in application.tasks):
            ledger.mapped(application.place)
    ledger.mapped(*(core.place for core in system.configuration.cores if core.place))
    ledger.mapped(*(place for machine in system.machines for place in (machine.place, *machine.cores)))
    if not system.configuration.cores:
        ledger.mapped(*system.hardware)
    for ecu in system.ecus:
        if not system.configuration.cores and used & set(ecu.prototypes):
            ledger.mapped(ecu.place, *ecu.mappings)
