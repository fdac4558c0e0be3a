"""Names, numbers and module names as AUTOSAR writes them, read exactly.

Vendors put their own names before the module name of a definition (/MICROSAR/Os), and some rename the module (iRte),
but a definition refined from the standard keeps the short names of the standard's containers."""

from __future__ import annotations

import re
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from lxml import etree

from halpipe.core.durations import Duration, seconds
from halpipe.core.suggest import few

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

NAMESPACE = "http://autosar.org/schema/r4.0"
NS = f"{{{NAMESPACE}}}"


def compiled(path: str) -> Callable[[etree._Element], list[etree._Element]]:
    """Return a query for elements, in which ``ar:`` stands for the namespace of AUTOSAR."""
    # lxml types the result of a query as anything that XPath can return.
    query: Any = etree.XPath(path, namespaces={"ar": NAMESPACE})
    finds_elements: Callable[[etree._Element], list[etree._Element]] = query
    return finds_elements


def listed(items: Iterable[object]) -> str:
    """Return the first few items for a message, and how many more there are."""
    return few(items, quote="")


_DOUBLE = re.compile(r"[+-]?(?:[0-9]{1,40}(?:\.[0-9]{0,40})?|\.[0-9]{1,40})(?:[eE](?P<exp>[+-]?[0-9]{1,3}))?")
_SPECIAL = re.compile(r"[+-]?INF|NaN", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_PREFIXED = re.compile(
    r"(?P<sign>[+-]?)(?:0[xX](?P<hex>[0-9A-Fa-f]{1,32})|0[bB](?P<bin>[01]{1,128})|0(?P<oct>[0-7]{1,40}))"
)
_MAX_EXPONENT = 40
# Nanoseconds of one step, by CSE-CODE (ASAM: codes for scaling units). Codes from 100 on count angles and events.
_CSE_NS: dict[int, Fraction] = {
    **{code: Fraction(10 ** (3 + code)) for code in range(8)},  # 1 us, 10 us, ... 10 s
    8: Fraction(60 * 10**9),
    9: Fraction(3_600 * 10**9),
    10: Fraction(86_400 * 10**9),
    **{code: Fraction(10) ** (code - 26) for code in range(20, 29)},  # 1 fs, 10 fs, ... 100 ns
}


def parse_number(text: str) -> Fraction | None:
    """Read an ECU configuration number (``20``, ``0x14``, ``0b10100``, ``024``, ``2.5E-8``); None if it is none."""
    stripped = text.strip()
    match = _PREFIXED.fullmatch(stripped)
    if match is None:
        return parse_double(stripped)
    for group, base in (("hex", 16), ("bin", 2), ("oct", 8)):
        if match[group]:
            value = int(match[group], base)
            return Fraction(-value if match["sign"] == "-" else value)
    return None


@lru_cache(maxsize=4096)  # an extract has thousands of events, and few different periods
def parse_double(text: str) -> Fraction | None:
    """Read an xsd:double other than INF and NaN exactly, never through a binary float; None if it is none."""
    match = _DOUBLE.fullmatch(text.strip())
    return None if match is None or abs(int(match["exp"] or 0)) > _MAX_EXPONENT else Fraction(match[0])


def parse_seconds(text: str) -> Duration | None:
    """Read a time in seconds; None if it is negative, infinite or no number at all."""
    value = parse_double(text)
    return seconds(value) if value is not None and value >= 0 else None


def parse_cse(code: str, factor: str) -> Duration | None:
    """Read a MULTIDIMENSIONAL-TIME (CSE-CODE and CSE-CODE-FACTOR); None if it is negative or counts no time."""
    unit, count = parse_number(code), parse_number(factor)
    if unit is None or unit.denominator != 1 or count is None or count < 0:
        return None
    step = _CSE_NS.get(unit.numerator)
    return Duration(step * count) if step is not None else None


def is_symbolic(text: str) -> bool:
    """Whether `text` is a name in place of a number."""
    stripped = text.strip()
    return _NAME.fullmatch(stripped) is not None and _SPECIAL.fullmatch(stripped) is None


MODULES = ("Os", "Rte", "EcuC")
# Containers that stand directly in the module, and in no other.
_NAMES = {
    "Rte": "RteSwComponentInstance RteBswModuleInstance RteOsInteraction",
    "EcuC": "EcucHardware EcucPartitionCollection",
    "Os": "OsAlarm OsAppMode OsApplication OsCounter OsEvent OsIsr OsOS OsResource OsScheduleTable OsSpinlock OsTask",
}
_CONTAINERS = {name: module for module, names in _NAMES.items() for name in names.split()}


def child_text(element: etree._Element, tag: str) -> str:
    """Return the text of the first child of a tag, empty for none; `findtext` takes three times as long."""
    return next((child.text or "" for child in element.iterchildren(NS + tag)), "")


def path_of(element: etree._Element) -> str:
    """Return the AUTOSAR path of an element: the short names down to it."""
    names = [each.findtext(NS + "SHORT-NAME") for each in (element, *element.iterancestors())]
    return "/" + "/".join("".join(name.split()) for name in reversed(names) if name)


@lru_cache(maxsize=4096)  # an extract has thousands of containers, and few definitions
def steps_of(definition: str) -> tuple[str, ...]:
    """Return the short names of the path of a definition."""
    return tuple("".join(definition.split()).split("/"))


@lru_cache(maxsize=4096)
def module_of(steps: tuple[str, ...]) -> str:
    """Return the standard module of a definition, empty for any other."""
    named = next((module for module in MODULES if module in steps), "")
    return named or next((_CONTAINERS[step] for step in steps if step in _CONTAINERS), "")


def module_with(definition: str, containers: Iterable[str]) -> str:
    """Return the standard module of a module configuration, by its definition, else by those of its containers."""
    named = module_of(steps_of(definition)[-1:])
    return named or next((_CONTAINERS[name] for name in containers if name in _CONTAINERS), "")
