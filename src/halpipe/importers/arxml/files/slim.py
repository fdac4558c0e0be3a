"""What of a large input cannot matter to timing: it is left out while it is read, so that memory suffices.

Only what nothing else refers to, or is referred to by its path alone, may be left out; it is counted by kind.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lxml import etree

_CONTAINER, _ADMIN = "ECUC-CONTAINER-VALUE", "ADMIN-DATA"
_PARAMETERS = ("ECUC-NUMERICAL-PARAM-VALUE", "ECUC-TEXTUAL-PARAM-VALUE")
# How the definitions of containers begin that say what runs, when and where, by their module.
_KEPT = {
    "Os": ("OsAlarm", "OsApp", "OsCore", "OsCounter", "OsEvent", "OsIsr", "OsOS", "OsResource", "OsSched", "OsTask"),
    "Rte": ("RteSwComponentInstance", "RteBswModuleInstance", "RteEventTo", "RteBswEventTo"),
    "EcuC": ("Ecuc",),
}
_KEPT_PARAMETERS = (
    "Ecuc",
    "Os",
    "RteActivation",
    "RteBswActivation",
    "RteBswPeriod",
    "RteBswPosition",
    "RtePeriod",
    "RtePosition",
)
_OWN = "halpipe:"
# Elements of packages: types of data, communication, diagnostics, definitions of parameters.
_ELEMENTS = """
ALIAS-NAME-SET APPLICATION-ARRAY-DATA-TYPE APPLICATION-PRIMITIVE-DATA-TYPE APPLICATION-RECORD-DATA-TYPE
BSW-MODULE-ENTRY CAN-CLUSTER CAN-FRAME CAN-TP-CONFIG CLIENT-SERVER-INTERFACE COMPU-METHOD CONSTANT-SPECIFICATION
CONSTANT-SPECIFICATION-MAPPING-SET CONTAINER-I-PDU DATA-CONSTR DATA-TRANSFORMATION-SET DATA-TYPE-MAPPING-SET DCM-I-PDU
DIAGNOSTIC-CONTRIBUTION-SET DIAGNOSTIC-DATA-IDENTIFIER DIAGNOSTIC-TROUBLE-CODE-UDS DOCUMENTATION
ECUC-DEFINITION-COLLECTION ECUC-MODULE-DEF END-TO-END-PROTECTION-SET ETHERNET-CLUSTER ETHERNET-FRAME FLEXRAY-CLUSTER
FLEXRAY-FRAME GATEWAY GENERAL-PURPOSE-I-PDU GENERAL-PURPOSE-PDU I-SIGNAL I-SIGNAL-GROUP I-SIGNAL-I-PDU
I-SIGNAL-I-PDU-GROUP IMPLEMENTATION-DATA-TYPE KEYWORD-SET LIN-CLUSTER LIN-SPORADIC-FRAME LIN-TP-CONFIG
LIN-UNCONDITIONAL-FRAME MULTIPLEXED-I-PDU N-PDU NM-CONFIG NM-PDU NV-DATA-INTERFACE PARAMETER-INTERFACE
PHYSICAL-DIMENSION PORT-INTERFACE-MAPPING-SET SECURED-I-PDU SENDER-RECEIVER-INTERFACE SO-AD-ROUTING-GROUP
SOCKET-CONNECTION-IPDU-IDENTIFIER-SET SW-ADDR-METHOD SW-BASE-TYPE SW-RECORD-LAYOUT SYSTEM-SIGNAL SYSTEM-SIGNAL-GROUP
UNIT UNIT-GROUP USER-DEFINED-I-PDU USER-DEFINED-PDU XCP-PDU
"""
# Parts of elements that are kept: text for people, and what a call, a port or a variable is in detail.
_PARTS = """
ANNOTATIONS AR-TYPED-PER-INSTANCE-MEMORYS BSW-MODULE-DEPENDENCYS CAN-COMMUNICATION-CONNECTOR COMM-CONTROLLERS DESC
ETHERNET-COMMUNICATION-CONNECTOR EXCLUSIVE-AREAS EXPLICIT-INTER-RUNNABLE-VARIABLES FIBEX-ELEMENTS
FLEXRAY-COMMUNICATION-CONNECTOR HEAP-USAGES IMPLICIT-INTER-RUNNABLE-VARIABLES INCLUDED-DATA-TYPE-SETS INIT-VALUE
INTRODUCTION LIN-COMMUNICATION-CONNECTOR LONG-NAME MEMORY-SECTIONS MODE-ACCESS-POINTS OPERATION-IREF PARAMETER-ACCESSS
PER-INSTANCE-MEMORYS PER-INSTANCE-PARAMETERS PORT-API-OPTIONS PROVIDED-COM-SPECS PROVIDED-ENTRYS REQUIRED-COM-SPECS
SENDER-RECEIVER-TO-SIGNAL-GROUP-MAPPING SERVER-CALL-POINTS SERVICE-DEPENDENCYS SHARED-PARAMETERS STACK-USAGES
STATIC-MEMORYS SW-DATA-DEF-PROPS
"""


class Slimming:
    """Decides what of one file is dropped, and remembers what that was.

    `dropped` counts elements with a short name by kind; `symbols` has the values, with a line, of the floating point
    parameters of dropped containers by name, since a period may be the name of one.
    """

    def __init__(self, namespace: str) -> None:
        self._ns = f"{{{namespace}}}"
        self.tags = [self._ns + tag for tag in (*_ELEMENTS.split(), *_PARTS.split(), *_PARAMETERS, _CONTAINER, _ADMIN)]
        self.dropped: Counter[str] = Counter()
        self.symbols: dict[str, dict[str, int]] = {}

    def drops(self, element: etree._Element) -> bool:
        """Return whether a complete element is dropped, and count what is dropped with it."""
        tag = str(element.tag).removeprefix(self._ns)
        if tag in _PARAMETERS:
            return self._drops_parameter(element)
        if tag == _CONTAINER:
            if self._keeps_container(element):
                return False
        elif tag == _ADMIN and any((e.get("GID") or "").startswith(_OWN) for e in element.iter(self._ns + "SDG")):
            return False
        for name in element.iter(self._ns + "SHORT-NAME"):
            holder = name.getparent()
            if holder is not None:
                self.dropped[str(holder.tag).removeprefix(self._ns)] += 1
        return True

    def strip(self, root: etree._Element) -> None:
        """Remove the attributes that nothing reads from what was kept."""
        for element in root.iterfind(".//*[@UUID]"):
            del element.attrib["UUID"]
        for element in root.iter(self._ns + "DEFINITION-REF"):
            element.attrib.pop("DEST", None)

    def _keeps_container(self, container: etree._Element) -> bool:
        steps = self._definition(container)
        for module, kinds in _KEPT.items():
            if module in steps:
                return steps[-1].startswith(kinds)
        return False

    def _drops_parameter(self, value: etree._Element) -> bool:
        """Drop a parameter that nothing reads; one that a symbolic period may be the name of is remembered."""
        steps = self._definition(value)
        if steps[-1].startswith(_KEPT_PARAMETERS) or ("Os" in steps and value.tag == self._ns + _PARAMETERS[0]):
            return False
        definition = value.find(self._ns + "DEFINITION-REF")
        text = (value.findtext(self._ns + "VALUE") or "").strip()
        if definition is not None and text and definition.get("DEST") in (None, "ECUC-FLOAT-PARAM-DEF"):
            self.symbols.setdefault(steps[-1], {}).setdefault(text, value.sourceline or 0)
        return True

    def _definition(self, element: etree._Element) -> list[str]:
        return "".join((element.findtext(self._ns + "DEFINITION-REF") or "").split()).split("/")
