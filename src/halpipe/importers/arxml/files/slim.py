"""Filter for large inputs: elements that cannot matter to timing are dropped while reading, to bound memory.

Only what nothing else refers to, or is referred to by its path alone, may be left out; it is counted by kind.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.importers.arxml.files.words import NS, child_text, compiled, module_of, steps_of

if TYPE_CHECKING:
    from lxml import etree

_CONTAINER, _ADMIN, _PACKAGE = "ECUC-CONTAINER-VALUE", "ADMIN-DATA", "AR-PACKAGE"
_SHORT_NAME, _DEFINITION = NS + "SHORT-NAME", NS + "DEFINITION-REF"
_NUMERICAL = NS + "ECUC-NUMERICAL-PARAM-VALUE"
_PARAMETERS = ("ECUC-NUMERICAL-PARAM-VALUE", "ECUC-TEXTUAL-PARAM-VALUE")
# How the definitions of containers begin that say what runs, when and where, by their module; of parameters last.
_BEGINNINGS = {
    "Os": "OsAlarm OsApp OsCore OsCounter OsEvent OsIsr OsOS OsResource OsSched OsSpin OsTask",
    "Rte": "RteSwComponentInstance RteBswModuleInstance RteEventTo RteBswEventTo",
    "EcuC": "Ecuc",
    "": "Ecuc Os RteActivation RteBswActivation RteBswPeriod RteBswPosition RtePeriod RtePosition",
}
_KEPT = {module: tuple(names.split()) for module, names in _BEGINNINGS.items()}
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
ETHERNET-COMMUNICATION-CONNECTOR EXPLICIT-INTER-RUNNABLE-VARIABLES FIBEX-ELEMENTS
FLEXRAY-COMMUNICATION-CONNECTOR HEAP-USAGES IMPLICIT-INTER-RUNNABLE-VARIABLES INCLUDED-DATA-TYPE-SETS INIT-VALUE
INTRODUCTION LIN-COMMUNICATION-CONNECTOR LONG-NAME MEMORY-SECTIONS MODE-ACCESS-POINTS OPERATION-IREF PARAMETER-ACCESSS
PER-INSTANCE-MEMORYS PER-INSTANCE-PARAMETERS PORT-API-OPTIONS PROVIDED-COM-SPECS PROVIDED-ENTRYS REQUIRED-COM-SPECS
SENDER-RECEIVER-TO-SIGNAL-GROUP-MAPPING SYNCHRONOUS-SERVER-CALL-POINT SERVICE-DEPENDENCYS SHARED-PARAMETERS STACK-USAGES
STATIC-MEMORYS SW-DATA-DEF-PROPS
"""


def tags_to_drop(*, marks: bool = False) -> list[str]:
    """Return the tags, with their namespace, of what may be dropped or made smaller; not of `marks` to keep."""
    tags = (*_ELEMENTS.split(), *_PARTS.split(), *_PARAMETERS, _CONTAINER, _ADMIN, _PACKAGE)
    kept = ("ANNOTATIONS", _PACKAGE) if marks else ()
    return [NS + tag for tag in tags if tag not in kept]


# What is in a package, but in no package inside it, with attributes that nothing reads.
_marked = compiled("ar:ELEMENTS/descendant::*[@UUID or self::ar:DEFINITION-REF/@DEST]")


class Slimming:
    """Decides what of one file is dropped, and remembers what that was.

    `dropped` counts elements with a short name by kind; `symbols` has the values, with a line, of the floating point
    parameters of dropped containers by name, since a period may be the name of one. With `marks`, what an export onto
    the project needs is kept: UUIDs, classes of definitions, annotations, and every container of Os, Rte and EcuC.
    """

    def __init__(self, *, marks: bool = False) -> None:
        self._marks = marks
        self._special = {
            **dict.fromkeys((NS + tag for tag in _PARAMETERS), self._drops_parameter),
            NS + _CONTAINER: self._drops_container,
            NS + _ADMIN: self._drops_admin,
            NS + _PACKAGE: self._strips,
        }
        self.dropped: Counter[str] = Counter()
        self.symbols: dict[str, dict[str, int]] = {}

    def drops(self, element: etree._Element) -> bool:
        """Return whether a complete element is dropped, and count what is dropped with it."""
        special = self._special.get(element.tag)
        return self._count(element) if special is None else special(element)

    def _count(self, element: etree._Element) -> bool:
        """Count what is dropped with an element."""
        for name in element.iter(_SHORT_NAME):
            holder = name.getparent()
            if holder is not None:
                self.dropped[holder.tag.removeprefix(NS)] += 1
        return True

    def _strips(self, package: etree._Element) -> bool:
        """Remove the attributes that nothing reads from what is kept of a package; it stays."""
        for element in _marked(package):
            element.attrib.pop("UUID", None)
            element.attrib.pop("DEST", None)
        return False

    def _drops_container(self, container: etree._Element) -> bool:
        steps = steps_of(child_text(container, "DEFINITION-REF"))
        module = module_of(steps)
        kinds = _KEPT[module] if module else ()
        is_kept = bool(kinds) and (self._marks or steps[-1].startswith(kinds))
        return not is_kept and self._count(container)

    def _drops_admin(self, admin: etree._Element) -> bool:
        return not any((e.get("GID") or "").startswith(_OWN) for e in admin.iter(NS + "SDG"))

    def _drops_parameter(self, value: etree._Element) -> bool:
        """Drop a parameter that nothing reads; one that a symbolic period may be the name of is remembered."""
        definition = next(value.iterchildren(_DEFINITION), None)
        steps = steps_of("" if definition is None else definition.text or "")
        if steps[-1].startswith(_KEPT[""]) or (value.tag == _NUMERICAL and module_of(steps) == "Os"):
            return False
        is_float = definition is not None and definition.get("DEST") in (None, "ECUC-FLOAT-PARAM-DEF")
        if is_float and (text := child_text(value, "VALUE").strip()):
            self.symbols.setdefault(steps[-1], {}).setdefault(text, value.sourceline or 0)
        return True
