"""AUTOSAR releases 2.x and 3.x in the words of release 4: elements are renamed and renested, lines are kept.

What differs beyond names: internal behaviours are elements of their own that refer to their component type
(COMPONENT-REF), which `swc` follows, like modes in which an event does not occur (MODE-DEPENDENCY) and variables
between runnables; and accesses to data and delegation connectors have fewer levels, which are added here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lxml import etree

_TAGS = {
    "TOP-LEVEL-PACKAGES": "AR-PACKAGES",
    "SUB-PACKAGES": "AR-PACKAGES",
    "APPLICATION-SOFTWARE-COMPONENT-TYPE": "APPLICATION-SW-COMPONENT-TYPE",
    "SENSOR-ACTUATOR-SOFTWARE-COMPONENT-TYPE": "SENSOR-ACTUATOR-SW-COMPONENT-TYPE",
    "COMPLEX-DEVICE-DRIVER-COMPONENT-TYPE": "COMPLEX-DEVICE-DRIVER-SW-COMPONENT-TYPE",
    "ECU-ABSTRACTION-COMPONENT-TYPE": "ECU-ABSTRACTION-SW-COMPONENT-TYPE",
    "SERVICE-COMPONENT-TYPE": "SERVICE-SW-COMPONENT-TYPE",
    "ATOMIC-SOFTWARE-COMPONENT-TYPE": "APPLICATION-SW-COMPONENT-TYPE",
    "CALPRM-COMPONENT-TYPE": "PARAMETER-SW-COMPONENT-TYPE",
    "COMPOSITION-TYPE": "COMPOSITION-SW-COMPONENT-TYPE",
    "COMPONENT-PROTOTYPE": "SW-COMPONENT-PROTOTYPE",
    "ASSEMBLY-CONNECTOR-PROTOTYPE": "ASSEMBLY-SW-CONNECTOR",
    "DELEGATION-CONNECTOR-PROTOTYPE": "DELEGATION-SW-CONNECTOR",
    "SOFTWARE-COMPOSITION": "ROOT-SW-COMPOSITION-PROTOTYPE",
    "TARGET-COMPONENT-PROTOTYPE-REF": "TARGET-COMPONENT-REF",
    "INTERNAL-BEHAVIOR": "SWC-INTERNAL-BEHAVIOR",
    "MODE-SWITCH-EVENT": "SWC-MODE-SWITCH-EVENT",
    "DATA-RECEIVE-POINTS": "DATA-RECEIVE-POINT-BY-ARGUMENTS",
    "MODULE-CONFIGURATION": "ECUC-MODULE-CONFIGURATION-VALUES",
    "CONTAINER": "ECUC-CONTAINER-VALUE",
    "INTEGER-VALUE": "ECUC-NUMERICAL-PARAM-VALUE",
    "BOOLEAN-VALUE": "ECUC-NUMERICAL-PARAM-VALUE",
    "FLOAT-VALUE": "ECUC-NUMERICAL-PARAM-VALUE",
    "ENUMERATION-VALUE": "ECUC-TEXTUAL-PARAM-VALUE",
    "STRING-VALUE": "ECUC-TEXTUAL-PARAM-VALUE",
    "FUNCTION-NAME-VALUE": "ECUC-TEXTUAL-PARAM-VALUE",
    "LINKER-SYMBOL-VALUE": "ECUC-TEXTUAL-PARAM-VALUE",
    "REFERENCE-VALUE": "ECUC-REFERENCE-VALUE",
    "INSTANCE-REFERENCE-VALUE": "ECUC-INSTANCE-REFERENCE-VALUE",
}
_ACCESSES = frozenset({"DATA-READ-ACCESS", "DATA-WRITE-ACCESS", "DATA-SEND-POINT", "DATA-RECEIVE-POINT"})
# Tags that mean different things in different places, by the tag of what holds them.
_INSIDE = {
    "PROVIDER-IREF": {
        "COMPONENT-PROTOTYPE-REF": "CONTEXT-COMPONENT-REF",
        "P-PORT-PROTOTYPE-REF": "TARGET-P-PORT-REF",
    },
    "REQUESTER-IREF": {
        "COMPONENT-PROTOTYPE-REF": "CONTEXT-COMPONENT-REF",
        "R-PORT-PROTOTYPE-REF": "TARGET-R-PORT-REF",
    },
    "DATA-IREF": {
        "R-PORT-PROTOTYPE-REF": "CONTEXT-R-PORT-REF",
        "DATA-ELEMENT-PROTOTYPE-REF": "TARGET-DATA-ELEMENT-REF",
    },
    "AUTOSAR-VARIABLE-IREF": {
        "R-PORT-PROTOTYPE-REF": "PORT-PROTOTYPE-REF",
        "P-PORT-PROTOTYPE-REF": "PORT-PROTOTYPE-REF",
        "DATA-ELEMENT-PROTOTYPE-REF": "TARGET-DATA-PROTOTYPE-REF",
    },
    "COMPONENT-IREF": {"COMPONENT-PROTOTYPE-REF": "TARGET-COMPONENT-REF"},
}
# Short names of ECU configuration definitions of the Rte before release 4.
_DEFINITIONS = {
    "SwComponentInstance": "RteSwComponentInstance",
    "SoftwareComponentPrototypeRef": "RteSoftwareComponentInstanceRef",
    "ServiceComponentPrototypeRef": "RteSoftwareComponentInstanceRef",
    "RunnableEntityMapping": "RteEventToTaskMapping",
    "RTEEventRef": "RteEventRef",
    "MappedToTaskRef": "RteMappedToTaskRef",
    "PositionInTask": "RtePositionInTask",
    "ActivationOffset": "RteActivationOffset",
    "UsedOSAlarmRef": "RteUsedOsAlarmRef",
    "UsedOSEventRef": "RteUsedOsEventRef",
    "UsedOsSchTblExpiryPointRef": "RteUsedOsSchTblExpiryPointRef",
}


def modernise(root: etree._Element, namespace: str) -> etree._Element:
    """Return the tree of a release 2.x or 3.x with the names, nesting and `namespace` of release 4.

    The tree itself is changed, so that every element keeps its line.
    """
    for element in list(root.iter("{*}*")):
        tag = _local(element)
        holder = element.getparent()
        inside = _INSIDE.get(_local(holder), {}) if holder is not None else {}
        dest = element.get("DEST")
        if dest in _TAGS:
            element.set("DEST", _TAGS[dest])
        if tag == "DEFINITION-REF":
            element.text = _definition(element.text or "")
        element.tag = f"{{{namespace}}}{inside.get(tag) or _renamed(tag, holder)}"
        if tag in _ACCESSES:
            _nest_access(element, namespace)
        if tag == "DELEGATION-CONNECTOR-PROTOTYPE":
            _nest_inner_port(element, namespace)
    return root


def _local(element: etree._Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _renamed(tag: str, holder: etree._Element | None) -> str:
    if tag in _ACCESSES:
        return "VARIABLE-ACCESS"
    if tag == "DATA-ELEMENT-IREF" and holder is not None and _local(holder) == "ACCESSED-VARIABLE":
        return "AUTOSAR-VARIABLE-IREF"
    return _TAGS.get(tag, tag)


def _definition(text: str) -> str:
    """Rename every step of a definition's path that was called otherwise before release 4."""
    return "/".join(_DEFINITIONS.get(step, step) for step in "".join(text.split()).split("/"))


def _wrap(child: etree._Element, tag: str, namespace: str) -> None:
    parent = child.getparent()
    if parent is not None:
        wrapper = parent.makeelement(f"{{{namespace}}}{tag}")
        parent.replace(child, wrapper)
        wrapper.append(child)


def _nest_access(element: etree._Element, namespace: str) -> None:
    for child in element.findall("{*}DATA-ELEMENT-IREF"):
        _wrap(child, "ACCESSED-VARIABLE", namespace)


def _nest_inner_port(connector: etree._Element, namespace: str) -> None:
    """Give the inner port of a delegation connector the level that tells provided from required ports."""
    for inner in connector.findall("{*}INNER-PORT-IREF"):
        port = inner.find("{*}PORT-PROTOTYPE-REF")
        kind = "R" if port is not None and port.get("DEST") == "R-PORT-PROTOTYPE" else "P"
        wrapper = inner.makeelement(f"{{{namespace}}}{kind}-PORT-IN-COMPOSITION-INSTANCE-REF")
        names = {"COMPONENT-PROTOTYPE-REF": "CONTEXT-COMPONENT-REF", "PORT-PROTOTYPE-REF": f"TARGET-{kind}-PORT-REF"}
        for child in list(inner.iterchildren("{*}*")):
            child.tag = f"{{{namespace}}}{names.get(_local(child), _local(child))}"
            wrapper.append(child)
        inner.append(wrapper)
