"""Files that are not release 4, in its words: releases 2.x and 3.x, and EB tresos project data (``.xdm``).

Every element keeps its line. In the old releases, internal behaviours are elements of their own that refer to their
component type (COMPONENT-REF), which `components` follows, like modes in which an event does not occur
(MODE-DEPENDENCY) and variables between runnables; accesses to data and delegation connectors have fewer levels, which
are added here. In project data, a list of the type MAP holds the containers of one definition by their names, other
lists several values of one definition; what has ``ENABLE=false`` is not set, whatever value is printed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lxml import etree

from halpipe.importers.arxml.files.words import NAMESPACE, NS, module_with

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    "SERVICE-COMPONENT-PROTOTYPE": "SW-COMPONENT-PROTOTYPE",
    "SERVICE-COMPONENT-TREF": "TYPE-TREF",
    "ASSEMBLY-CONNECTOR-PROTOTYPE": "ASSEMBLY-SW-CONNECTOR",
    "DELEGATION-CONNECTOR-PROTOTYPE": "DELEGATION-SW-CONNECTOR",
    "SOFTWARE-COMPOSITION": "ROOT-SW-COMPOSITION-PROTOTYPE",
    "TARGET-COMPONENT-PROTOTYPE-REF": "TARGET-COMPONENT-REF",
    "INTERNAL-BEHAVIOR": "SWC-INTERNAL-BEHAVIOR",
    "MODE-SWITCH-EVENT": "SWC-MODE-SWITCH-EVENT",
    "DATA-RECEIVE-POINTS": "DATA-RECEIVE-POINT-BY-ARGUMENTS",
    "ECU-CONFIGURATION": "ECUC-VALUE-COLLECTION",
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
    "ECUC-VALUE-COLLECTION": {"MODULE-REFS": "ECUC-VALUES"},
    "ECUC-VALUES": {"MODULE-REF": "ECUC-MODULE-CONFIGURATION-VALUES-REF"},
}
_TIMES = ("/OsAlarmAlarmTime", "/OsAlarmCycleTime", "/OsScheduleTableLength", "/OsScheduleTblActionOffset")
# Short names of ECU configuration definitions of the Rte before release 4.
_DEFINITIONS = {
    "SwComponentInstance": "RteSwComponentInstance",
    "SoftwareComponentInstanceRef": "RteSoftwareComponentInstanceRef",
    "SoftwareComponentPrototypeRef": "RteSoftwareComponentInstanceRef",
    "ServiceComponentPrototypeRef": "RteSoftwareComponentInstanceRef",
    "RunnableEntityMapping": "RteEventToTaskMapping",
    "RTEEventRef": "RteEventRef",
    "MappedToTaskRef": "RteMappedToTaskRef",
    "PositionInTask": "RtePositionInTask",
    "ActivationOffset": "RteActivationOffset",
    "UsedOSAlarmRef": "RteUsedOsAlarmRef",
    "UsedOSEventRef": "RteUsedOsEventRef",
    "UsedOsEventRef": "RteUsedOsEventRef",
    "UsedOsSchTblExpiryPointRef": "RteUsedOsSchTblExpiryPointRef",
}


def modernise(root: etree._Element) -> etree._Element:
    """Return the tree of a release 2.x or 3.x with the names, nesting and namespace of release 4.

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
        element.tag = f"{NS}{inside.get(tag) or _renamed(tag, holder)}"
        if tag in _ACCESSES:
            for child in element.findall("{*}DATA-ELEMENT-IREF"):
                _wrap(child, "ACCESSED-VARIABLE")
        if tag == "DELEGATION-CONNECTOR-PROTOTYPE":
            _nest_inner_port(element)
    return root


def drop_seconds(root: etree._Element) -> int:
    """Remove the times of an OS configuration of release 2, which are in seconds; return how many they were."""
    found = [
        e
        for e in root.iter(NS + "DEFINITION-REF")
        if e.get("DEST") == "FLOAT-PARAM-DEF" and (e.text or "").endswith(_TIMES)
    ]
    for value in (definition.getparent() for definition in found):
        if value is not None and (holder := value.getparent()) is not None:
            holder.remove(value)
    return len(found)


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


def _wrap(child: etree._Element, tag: str) -> None:
    parent = child.getparent()
    if parent is not None:
        wrapper = parent.makeelement(NS + tag)
        parent.replace(child, wrapper)
        wrapper.append(child)


def _nest_inner_port(connector: etree._Element) -> None:
    """Give the inner port of a delegation connector the level that tells provided from required ports."""
    for inner in connector.findall("{*}INNER-PORT-IREF"):
        port = inner.find("{*}PORT-PROTOTYPE-REF")
        kind = "R" if port is not None and port.get("DEST") == "R-PORT-PROTOTYPE" else "P"
        wrapper = inner.makeelement(f"{NS}{kind}-PORT-IN-COMPOSITION-INSTANCE-REF")
        names = {"COMPONENT-PROTOTYPE-REF": "CONTEXT-COMPONENT-REF", "PORT-PROTOTYPE-REF": f"TARGET-{kind}-PORT-REF"}
        for child in list(inner.iterchildren("{*}*")):
            child.tag = f"{NS}{names.get(_local(child), _local(child))}"
            wrapper.append(child)
        inner.append(wrapper)


_PATH = "ASPath:"
_MARK = re.compile(r"halpipe\((.*)\)")
_NUMBERS = ("INTEGER", "FLOAT", "BOOLEAN")


def _modules(root: etree._Element) -> Iterator[tuple[etree._Element, etree._Element, etree._Element]]:
    """Yield the package, the element and the configuration of every module."""
    for package in root.iter("{*}ctr"):
        if package.get("type") != "AR-PACKAGE":
            continue
        for elements in package.iterchildren("{*}lst"):
            for choice in elements.iterchildren("{*}chc"):
                for module in choice.iterchildren("{*}ctr"):
                    if module.get("type") == "MODULE-CONFIGURATION":
                        yield package, choice, module


def is_set(element: etree._Element) -> bool:
    """Whether a value or container is set at all."""
    return _attribute(element, "ENABLE").lower() != "false"


def _attribute(element: etree._Element, name: str) -> str:
    """Return what the tool notes beside a value or container, empty where it has no such note."""
    return next((a.get("value") or "" for a in element.iterchildren("{*}a") if a.get("name") == name), "")


def imported_files(root: etree._Element) -> tuple[str, ...]:
    """Return the patterns of the files that the importers of a project read, relative to its root, from settings."""
    lists = (each for each in root.iter("{*}lst") if each.get("name") == "InputFiles")
    names = (var.get("value") or "" for each in lists for var in each.iter("{*}var") if var.get("name") == "FileName")
    return tuple(name.replace("\\", "/") for name in names if name)


def translate(root: etree._Element) -> etree._Element:
    """Return the configurations of a file as an AUTOSAR document; every element keeps its line.

    Of modules other than Os, Rte and EcuC, the containers are left out.
    """
    result = etree.Element(NS + "AUTOSAR", nsmap={None: NAMESPACE})
    packages = _add(result, root, "AR-PACKAGES")
    for package, choice, module in _modules(root):
        definition = _attribute(module, "DEF").removeprefix(_PATH)
        holder = _named(packages, package, "AR-PACKAGE", package.get("name") or "")
        elements = _add(holder, package, "ELEMENTS")
        name = choice.get("name") or definition.rpartition("/")[2]
        values = _named(elements, choice, "ECUC-MODULE-CONFIGURATION-VALUES", name)
        _add(values, module, "DEFINITION-REF", definition)
        if is_set(module) and module_with(definition, (part.get("name") or "" for part in module)):
            _parts(_add(values, module, "CONTAINERS"), module, definition)
    return result


def _add(parent: etree._Element, source: etree._Element, tag: str, text: str = "") -> etree._Element:
    element = etree.SubElement(parent, NS + tag)
    element.sourceline = source.sourceline
    if text:
        element.text = text
    return element


def _named(parent: etree._Element, source: etree._Element, tag: str, name: str) -> etree._Element:
    element = _add(parent, source, tag)
    _add(element, source, "SHORT-NAME", name)
    return element


def _container(parent: etree._Element, source: etree._Element, name: str, definition: str) -> None:
    """Append a container with its values and what is in it; nothing if it is not set."""
    if not is_set(source):
        return
    element = _named(parent, source, "ECUC-CONTAINER-VALUE", name)
    _mark(element, source)
    _add(element, source, "DEFINITION-REF", definition)
    _values(element, source, definition)
    inside = _add(element, source, "SUB-CONTAINERS")
    if _local(source) == "chc":
        chosen = source.get("value") or ""
        for part in source.iterchildren("{*}ctr"):
            if part.get("name") == chosen:
                _container(inside, part, chosen, f"{definition}/{chosen}")
    else:
        _parts(inside, source, definition)


def _mark(element: etree._Element, source: etree._Element) -> None:
    """Say of a container that an export of halpipe put it there, as in ARXML, with the alarms that it stopped."""
    match = _MARK.fullmatch(_attribute(source, "IMPORTER_INFO"))
    if match is None:
        return
    data = _add(_add(_add(element, source, "ADMIN-DATA"), source, "SDGS"), source, "SDG")
    data.set("GID", "halpipe:delta")
    for entry in filter(None, match[1].split(";")):
        path, _, times = entry.partition(",")
        cycle, _, start = times.partition(",")
        inner = _add(data, source, "SDG")
        inner.set("GID", "halpipe:stopped")
        for key, text in (("cycle", cycle), ("start", start)):
            _add(inner, source, "SD", text).set("GID", key)
        _add(inner, source, "SDX-REF", path).set("DEST", "ECUC-CONTAINER-VALUE")


def _parts(parent: etree._Element, source: etree._Element, definition: str) -> None:
    """Append the containers inside one: single ones by their definition, those of lists by their names."""
    for part in source:
        name = part.get("name") or ""
        if _local(part) in ("ctr", "chc") and name:
            _container(parent, part, name, f"{definition}/{name}")
        elif _local(part) == "lst" and name and is_set(part):
            for number, each in enumerate(part):
                if _local(each) in ("ctr", "chc"):
                    _container(parent, each, each.get("name") or f"{name}_{number}", f"{definition}/{name}")


def _values(element: etree._Element, source: etree._Element, definition: str) -> None:
    parameters = _add(element, source, "PARAMETER-VALUES")
    references = _add(element, source, "REFERENCE-VALUES")
    for name, value in _each_value(source):
        text = value.get("value") or ""
        if not text or not is_set(value):
            continue
        path = f"{definition}/{name}"
        if _local(value) == "ref":
            entry = _add(references, value, "ECUC-REFERENCE-VALUE")
            _add(entry, value, "DEFINITION-REF", path)
            if _attribute(value, "IMPORTER_INFO").startswith("@CALC"):
                notes = _add(_add(entry, value, "ANNOTATIONS"), value, "ANNOTATION")
                _add(notes, value, "ANNOTATION-ORIGIN", "@CALC")
            _add(entry, value, "VALUE-REF", text.removeprefix(_PATH))
        else:
            kind = "NUMERICAL" if value.get("type") in _NUMBERS else "TEXTUAL"
            entry = _add(parameters, value, f"ECUC-{kind}-PARAM-VALUE")
            _add(entry, value, "DEFINITION-REF", path)
            _add(entry, value, "VALUE", text)


def _each_value(source: etree._Element) -> Iterator[tuple[str, etree._Element]]:
    """Yield the values of a container with their definition, also those of lists."""
    for part in source:
        name = part.get("name") or ""
        if _local(part) in ("var", "ref"):
            yield name, part
        elif _local(part) == "lst" and is_set(part):
            yield from ((name, each) for each in part if _local(each) in ("var", "ref"))
