"""Containers of an ECU configuration with their parameters, in the order that the schema demands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import NAMESPACE, add, named, ref

if TYPE_CHECKING:
    from lxml import etree

CONTAINER = "ECUC-CONTAINER-VALUE"
_REFERENCE, _FOREIGN = "ECUC-REFERENCE-DEF", "ECUC-FOREIGN-REFERENCE-DEF"


class Module:
    """The configuration of one module; `prefix` is where the definitions of modules are, `base` its package."""

    def __init__(self, elements: etree._Element, name: str, prefix: str, base: str) -> None:
        self._definition = f"{prefix}/{name}"
        self._path = f"{base}/{name}"
        element = named(elements, "ECUC-MODULE-CONFIGURATION-VALUES", name)
        ref(element, "DEFINITION-REF", "ECUC-MODULE-DEF", self._definition)
        add(element, "IMPLEMENTATION-CONFIG-VARIANT", "VARIANT-PRE-COMPILE")
        self._containers = add(element, "CONTAINERS")

    def container(self, kind: str, short_name: str) -> Container:
        """Append a container of the definition `kind`."""
        element = named(self._containers, CONTAINER, short_name)
        return Container(element, f"{self._path}/{short_name}", f"{self._definition}/{kind}")


class Container:
    """A container; whatever is appended must come in the order special data, parameters, references, containers.

    `definition` is the class of the definition that a value or reference has beside the one expected.
    """

    def __init__(self, element: etree._Element, path: str, definition: str) -> None:
        self.element = element
        self.path = path
        self._definition = definition

    def define(self) -> None:
        """Append the definition; special data stand before it."""
        ref(self.element, "DEFINITION-REF", "ECUC-PARAM-CONF-CONTAINER-DEF", self._definition)

    def integer(self, name: str, value: int) -> None:
        """Append an integer parameter."""
        self._value("NUMERICAL", "INTEGER", name, str(value))

    def number(self, name: str, text: str) -> None:
        """Append a floating point parameter."""
        self._value("NUMERICAL", "FLOAT", name, text)

    def flag(self, name: str, *, value: bool) -> None:
        """Append a boolean parameter."""
        self._value("NUMERICAL", "BOOLEAN", name, "true" if value else "false")

    def choice(self, name: str, value: str) -> None:
        """Append an enumeration parameter."""
        self._value("TEXTUAL", "ENUMERATION", name, value)

    def text(self, name: str, value: str) -> None:
        """Append a string parameter."""
        self._value("TEXTUAL", "STRING", name, value)

    def refer(self, name: str, path: str, *, definition: str = _REFERENCE, dest: str = CONTAINER) -> None:
        """Append a reference to another container."""
        element = add(self._list("REFERENCE-VALUES"), "ECUC-REFERENCE-VALUE")
        ref(element, "DEFINITION-REF", definition, f"{self._definition}/{name}")
        ref(element, "VALUE-REF", dest, path)

    def refer_outside(self, name: str, path: str, dest: str) -> None:
        """Append a reference to an element of the system."""
        self.refer(name, path, definition=_FOREIGN, dest=dest)

    def inside(self, kind: str, short_name: str, *, defined: bool = True) -> Container:
        """Append a container inside this one, with its definition unless special data are to come before."""
        element = named(self._list("SUB-CONTAINERS"), CONTAINER, short_name)
        inner = Container(element, f"{self.path}/{short_name}", f"{self._definition}/{kind}")
        if defined:
            inner.define()
        return inner

    def _value(self, form: str, kind: str, name: str, text: str) -> None:
        element = add(self._list("PARAMETER-VALUES"), f"ECUC-{form}-PARAM-VALUE")
        ref(element, "DEFINITION-REF", f"ECUC-{kind}-PARAM-DEF", f"{self._definition}/{name}")
        add(element, "VALUE", text)

    def _list(self, tag: str) -> etree._Element:
        last = self.element[-1]
        return last if last.tag == f"{{{NAMESPACE}}}{tag}" else add(self.element, tag)
