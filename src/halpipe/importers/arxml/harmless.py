"""The kinds of elements that cannot decide the timing of a schedule, each with the reason.

Whatever is not on this list, and is not used, is reported: it may decide timing (MODEL 10.9). A name that ends in `*`
stands for all kinds that begin so. What stands inside an element of such a kind is harmless, too.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.importers.arxml.files.tree import Node

_HOLDERS = ("", "AR-PACKAGE", "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE")
_REASONS = {
    "data types and values: what is computed, not when": """
        ARRAY-TYPE BOOLEAN-TYPE CALPRM-* CHAR-TYPE INTEGER-TYPE INTER-RUNNABLE-VARIABLE OPAQUE-TYPE REAL-TYPE
        RECORD-TYPE STRING-TYPE APPLICATION-*-DATA-TYPE APPLICATION-ERROR ARGUMENT-DATA-PROTOTYPE
        CALIBRATION-PARAMETER-VALUE-SET COMPU-METHOD CONSTANT-SPECIFICATION* CPP-IMPLEMENTATION-DATA-TYPE
        CUSTOM-CPP-IMPLEMENTATION-DATA-TYPE DATA-CONSTR DATA-PROTOTYPE-* DATA-TYPE-* IMPLEMENTATION-DATA-TYPE*
        PARAMETER-DATA-PROTOTYPE PHYSICAL-DIMENSION* STD-CPP-* SW-BASE-TYPE SW-RECORD-LAYOUT UNIT UNIT-GROUP
        VALUE-BASED-* VARIABLE-DATA-PROTOTYPE MC-FUNCTION* RAPID-PROTOTYPING-SCENARIO SW-AXIS-TYPE
        SW-CODE-SYNTAX INTERPOLATION-ROUTINE-MAPPING-SET PER-INSTANCE-MEMORY
    """,
    "interfaces and ports: which data, not when": """
        BSW-MODULE-ENTRY CLIENT-SERVER-INTERFACE* CLIENT-SERVER-OPERATION DATA-ELEMENT-PROTOTYPE
        OPERATION-PROTOTYPE MODE-DECLARATION-GROUP-PROTOTYPE MODE-DECLARATION-MAPPING-SET MODE-GROUP
        MODE-SWITCH-INTERFACE MODE-SWITCH-POINT NV-DATA-INTERFACE P-PORT-PROTOTYPE PARAMETER-ACCESS
        PARAMETER-INTERFACE PORT-INTERFACE-MAPPING* PORT-GROUP PR-PORT-PROTOTYPE R-PORT-PROTOTYPE
        SENDER-RECEIVER-INTERFACE SERVICE-INTERFACE TRIGGER-INTERFACE VARIABLE-ACCESS VARIABLE-AND-PARAMETER-*
        PERSISTENCY-* PLATFORM-HEALTH-* SYNCHRONIZED-TIME-BASE-* MODE-ACCESS-POINT
    """,
    "what is called at once runs within its caller": "SYNCHRONOUS-SERVER-CALL-POINT BSW-CALLED-ENTITY",
    "communication: when frames are sent is left to the network": """
        CAN-* COMMUNICATION-* CONTAINER-I-PDU DCM-I-PDU DATA-TRANSFORMATION* DDS-* DO-IP-* E2E-* END-TO-END-*
        ETHERNET-* FLEXRAY-* FRAME-PORT GATEWAY GENERAL-PURPOSE-* HW-PORT-* I-PDU-* I-SIGNAL* IP-SEC-* J-1939-*
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
        CONSISTENCY-NEEDS COLLECTION DOCUMENTATION* ECUC-DEFINITION-COLLECTION ECUC-MODULE-DEF
        ECUC-VALUE-COLLECTION EVALUATED-VARIANT-SET FLAT-INSTANCE-DESCRIPTOR FLAT-MAP KEYWORD* LIFE-CYCLE-* MC-*
        MEMORY-SECTION POST-BUILD-VARIANT-* PREDEFINED-VARIANT RESOURCE-CONSUMPTION SDG-* STACK-USAGE*
        HEAP-USAGE* STATIC-MEMORY SW-ADDR-METHOD SW-SYSTEMCONST* SWC-BSW-MAPPING SWC-IMPLEMENTATION
        SWC-TO-IMPL-MAPPING SYSTEM SYSTEM-MAPPING TD-EVENT-BSW-* TD-EVENT-COM* TD-EVENT-CYCLE-START
        TD-EVENT-FRAME* TD-EVENT-I-* TD-EVENT-MODE-* TD-EVENT-OPERATION TD-EVENT-SERVICE-* TD-EVENT-SWC-*
        TD-EVENT-TRIGGER TD-EVENT-VARIABLE-* TIMING-EXTENSION* SWC-TIMING BSW-MODULE-TIMING
        BSW-MODULE-DEPENDENCY BSW-DEBUG-INFO VFB-TIMING SYSTEM-TIMING ECU-TIMING EOC-EXECUTABLE-ENTITY-REF*
        EOC-EVENT-REF TIMING-CLOCK* ECU-INSTANCE ROOT-SW-COMPOSITION-PROTOTYPE VIEW-MAP-SET HW-*
        ECUC-MODULE-CONFIGURATION-VALUES
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
        OsDerivativeInformation OsDriver OsHardwareTimer* OsHooks OsImplementationInformation
        OsInterruptSupportedType OsIoc* OsMemoryRegion* OsOS OsOS* OsPeripheralArea OsPhysicalCore*
        OsPublishedInformation OsStack* OsSystemIntCtrl OsTimeConstant OsCounterTimeConstant ALL AUTO Automatic
        FALSE Standard TRUE
    """,
    "general settings of Rte and EcuC": """
        BswInitialization Ecuc* InitFunction Pdu* PostbuildLoadable RteBswExclusiveAreaImpl RteBswGeneral
        RteBswRequiredModeGroupConnection RteBswRequiredTriggerConnection PublishedInformation OsCORTEX*
        RteExclusiveAreaImplementation RteComponentTypeCalibration RteGeneration RteInitializationBehavior
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


def harmless_kinds() -> tuple[str, ...]:
    """Return every kind on the list, patterns as they are."""
    return tuple(kind for known in _REASONS.values() for kind in known.split())


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
