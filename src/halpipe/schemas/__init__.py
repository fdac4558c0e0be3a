"""The XML schemas, one per artefact, and the check of a document against its schema.

libxml2 validates, because it is fast; only when it finds something is the same tree handed to the xmlschema
package, whose reasons are easier to read, and the two are merged by line.
"""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from halpipe.diagnostics import Diagnostic, Location, error
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from lxml import etree

TASK_MODEL = "task-model"
SCHEDULE = "schedule"

WRONG_ROOT = error(
    "HAL0101",
    "Not the expected kind of file",
    "The root element or its namespace is not that of the artefact asked for: a task model has "
    "<task-model xmlns='urn:halpipe:task-model:1'>, a schedule <schedule xmlns='urn:halpipe:schedule:1'>.",
)
SCHEMA_VIOLATION = error(
    "HAL0102",
    "Document does not follow its schema",
    "An element or attribute is missing, misplaced, unknown, or its value has the wrong form. "
    "The schemas are in src/halpipe/schemas.",
)

# Repeated and dangling names are left to the semantic checks, which suggest what was meant. For other tools the schemas
# state them too; libxml2 would spend two thirds of its time on them.
_IDENTITY_CONSTRAINTS = ("key", "keyref", "unique")
_XSD = "{http://www.w3.org/2001/XMLSchema}"
_MAX_EXPLAINED = 50
_LAST_EXACT_LINE = 65535


def namespace(kind: str) -> str:
    """Return the XML namespace of an artefact, version 1."""
    return f"urn:halpipe:{kind}:1"


def check(root: etree._Element, kind: str, name: str) -> list[Diagnostic]:
    """Hold a document against the schema of its kind; return every violation with its line."""
    expected = f"{{{namespace(kind)}}}{kind}"
    if root.tag != expected:
        uri, _, tag = str(root.tag).rpartition("}")
        found = f'has the root element "{tag}" in ' + (f'the namespace "{uri[1:]}"' if uri else "no namespace")
        help = f'expected <{kind} xmlns="{namespace(kind)}">'
        return [WRONG_ROOT(found, at=Location(name, line_of(root)), help=help)]
    schema = _libxml2_schema(kind)
    if schema.validate(root):
        return []
    entries = reversed(list(schema.error_log))
    violations = {_subject(e): (_line(root, e), _plain(e.message, kind)) for e in entries}
    return _reported(list(reversed(violations.values())), root, kind, name)


def _reported(violations: list[tuple[int, str]], root: etree._Element, kind: str, name: str) -> list[Diagnostic]:
    reasons = _explain(root, kind)
    crowded = {line for line, count in Counter(line for line, _ in violations).items() if count > 1}
    reported = []
    for line, message in dict.fromkeys(violations):
        unknown = _UNKNOWN_ATTRIBUTE.search(message)
        # A reason is known by its line only, so it is no help where several things are wrong on one line.
        help = "" if line in crowded else reasons.get(line, "")
        if unknown:
            help = _meant(unknown["name"], kind)
        reported.append(SCHEMA_VIOLATION(message, at=Location(name, line), help=help))
    return reported


def _subject(entry: Any) -> tuple[int, str, str]:
    """Return what a violation is about: libxml2 reports a bad attribute once for every facet and once for its type."""
    about = entry.message.partition(": ")[0]
    return entry.line, entry.path or "", about if "', attribute '" in about else entry.message


def line_of(element: etree._Element) -> int:
    """Return the line of an element's start tag, also beyond line 65534.

    There libxml2 only tells the line at which the text after the start tag, or after the element, ends
    (xmlGetLineNo). What follows from that is exact where white space surrounds elements, and near otherwise.
    """
    line: int = element.sourceline or 0
    if line < _LAST_EXACT_LINE:
        return line
    if element.text:
        return line - str(element.text).count("\n")
    if len(element):
        return line_of(element[0])
    return line - (element.tail or "").count("\n")


def _line(root: etree._Element, entry: Any) -> int:
    """Return the line of a violation; libxml2 does not know lines beyond 65534 exactly."""
    if entry.line < _LAST_EXACT_LINE or not entry.path:
        return int(entry.line)
    found = root.getroottree().xpath(entry.path)
    return line_of(found[0]) if found else int(entry.line)


@cache
def _libxml2_schema(kind: str) -> etree.XMLSchema:
    from lxml import etree

    return etree.XMLSchema(_grammar(kind))


def _grammar(kind: str) -> etree._Element:
    """Return a schema without its identity constraints."""
    from lxml import etree

    schema = etree.fromstring(_schema_bytes(kind))
    etree.strip_elements(schema, *(_XSD + constraint for constraint in _IDENTITY_CONSTRAINTS), with_tail=False)
    return schema


def _schema_bytes(kind: str) -> bytes:
    return resources.files(__package__).joinpath(f"{kind}-1.xsd").read_bytes()


def _explain(root: etree._Element, kind: str) -> dict[int, str]:
    """Return, by line, why xmlschema finds the document wrong."""
    from itertools import islice

    import xmlschema
    from lxml import etree

    schema = xmlschema.XMLSchema10(etree.tostring(_grammar(kind), encoding="unicode"))
    reasons: dict[int, str] = {}
    # What xmlschema cannot digest, such as an unknown xsi:type, stays without its explanation.
    with suppress(xmlschema.XMLSchemaException):
        for failure in islice(schema.iter_errors(root), _MAX_EXPLAINED):
            if failure.reason and failure.sourceline and "match any pattern" not in failure.reason:
                reason = _shortened(" ".join(str(failure.reason).split()))
                reasons.setdefault(failure.sourceline, reason.replace(f"{{{namespace(kind)}}}", "").replace("'t:", "'"))
    return reasons


_UNKNOWN_ATTRIBUTE = re.compile(r"The attribute '(?P<name>[^']*)' is not allowed")
_LONG_VALUE = re.compile(r"(['\"])([^'\"]{60})[^'\"]{60,}(?:\1|$)")


def _shortened(text: str) -> str:
    """Cut quoted values that are so long that they would hide the message."""
    return _LONG_VALUE.sub(r"\1\2...\1", text)


@cache
def _meant(attribute: str, kind: str) -> str:
    """Return which attribute of the schema was probably meant."""
    from lxml import etree

    names = etree.fromstring(_schema_bytes(kind)).xpath("//*[local-name() = 'attribute']/@name")
    return did_you_mean(attribute, sorted(set(map(str, names))), "remove it")


_PATTERN_FACET = re.compile(
    r"\[facet 'pattern'\] The value '(?P<value>.*)' is not accepted by the pattern '(?P<pattern>.*)'\."
)

_FACET = re.compile(r"\[facet '\w+'\] ")


@cache
def _forms(kind: str) -> dict[str, str]:
    """Return what the schema says in words of each of its patterns."""
    from lxml import etree

    xs = "{http://www.w3.org/2001/XMLSchema}"
    forms = {}
    for simple_type in etree.fromstring(_schema_bytes(kind)).iter(f"{xs}simpleType"):
        words = simple_type.findtext(f"{xs}annotation/{xs}documentation")
        pattern = simple_type.find(f"{xs}restriction/{xs}pattern")
        if words and pattern is not None:
            forms[pattern.get("value")] = words
    return forms


def _plain(message: str, kind: str) -> str:
    """Take the namespace braces out of a libxml2 message, and say in words which form a value should have."""
    message = message.replace(f"{{{namespace(kind)}}}", "")
    facet = _PATTERN_FACET.search(message)
    if facet and facet["pattern"] in _forms(kind):
        message = message[: facet.start()] + f"the value '{facet['value']}' is not {_forms(kind)[facet['pattern']]}"
    return _shortened(_FACET.sub("", message))
