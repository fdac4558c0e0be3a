"""The XML schemas, one per artefact, and the check of a document against its schema.

libxml2 validates, because it is fast; only when it finds something is the same tree handed to the xmlschema
package, whose reasons are easier to read, and the two are merged by line.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from halpipe.diagnostics import Diagnostic, Location, error

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

# Dangling names are left to the semantic checks, which suggest what was meant.
_IDENTITY_VIOLATIONS = ("SCHEMAV_CVC_IDC",)
_MAX_EXPLAINED = 50


def namespace(kind: str) -> str:
    """Return the XML namespace of an artefact, version 1."""
    return f"urn:halpipe:{kind}:1"


def check(root: etree._Element, kind: str, name: str) -> list[Diagnostic]:
    """Hold a document against the schema of its kind; return every violation with its line."""
    expected = f"{{{namespace(kind)}}}{kind}"
    if root.tag != expected:
        found = f'has the root element "{root.tag}"'
        help = f'expected "{expected}"'
        return [WRONG_ROOT(found, at=Location(name, root.sourceline or 0), help=help)]
    schema = _libxml2_schema(kind)
    if schema.validate(root):
        return []
    entries = [(e.line, e.message) for e in schema.error_log if e.type_name not in _IDENTITY_VIOLATIONS]
    if not entries:
        return []
    reasons = _explain(root, kind)
    return [
        SCHEMA_VIOLATION(_plain(message, kind), at=Location(name, line), help=reasons.get(line, ""))
        for line, message in dict.fromkeys(entries)
    ]


@cache
def _libxml2_schema(kind: str) -> etree.XMLSchema:
    from lxml import etree

    return etree.XMLSchema(etree.fromstring(_schema_bytes(kind)))


def _schema_bytes(kind: str) -> bytes:
    return resources.files(__package__).joinpath(f"{kind}-1.xsd").read_bytes()


def _explain(root: etree._Element, kind: str) -> dict[int, str]:
    """Return, by line, why xmlschema finds the document wrong."""
    from itertools import islice

    import xmlschema

    schema = xmlschema.XMLSchema10(_schema_bytes(kind).decode())
    reasons: dict[int, str] = {}
    for failure in islice(schema.iter_errors(root), _MAX_EXPLAINED):
        if failure.reason and failure.sourceline and "match any pattern" not in failure.reason:
            reasons.setdefault(failure.sourceline, " ".join(str(failure.reason).split()))
    return reasons


_PATTERN_FACET = re.compile(
    r"\[facet 'pattern'\] The value '(?P<value>.*)' is not accepted by the pattern '(?P<pattern>.*)'\."
)


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
        return message[: facet.start()] + f"the value '{facet['value']}' is not {_forms(kind)[facet['pattern']]}"
    return message
