"""Tells files apart by content: AMALTHEA and its version, metamodels, compressed models, other XML, broken files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import parse_xml, read_bytes
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.common.inputs import read_inputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.core.diagnostics import Findings

_ITEA = re.compile(r"http://www\.amalthea\.itea2\.org/model/(?P<version>[0-9]+(?:\.[0-9]+)*)/[a-z]+")
_APP4MC = re.compile(r"http://app4mc\.eclipse\.org/amalthea/(?P<version>[0-9]+(?:\.[0-9]+)*)")
_KNOWN_ITEA = ("1.0.3", "1.1.0", "1.1.1", "1.3.0")
KNOWN = (
    *("0.7.0", "0.7.1", "0.7.2", "0.8.0", "0.8.1", "0.8.2", "0.8.3"),
    *(f"0.9.{patch}" for patch in range(10)),
    *("1.0.0", "1.1.0", "1.2.0", "2.0.0", "2.1.0", "2.2.0", "3.0.0", "3.1.0", "3.2.0", "3.3.0"),
)
_MODEL = re.compile(r"(?:[A-Za-z]+Model|CommonElements)")
_SUFFIX = ".amxmi"


@record
class Document:
    """A parsed AMALTHEA file, the name that the user gave it, and its version, such as ``ITEA 1.1.0`` or ``0.9.5``."""

    name: str
    root: etree._Element
    version: str


def load(paths: Sequence[str], findings: Findings) -> list[Document]:
    """Parse every file of `paths`; what a directory holds besides is skipped, what was named directly is an error.

    Raise `HalpipeError` if any file named directly cannot be used, if none is left, or if their versions differ.
    """
    documents = read_inputs(paths, (_SUFFIX,), read_file, codes.SKIPPED_FILE, codes.NO_INPUT, findings)
    _report_versions(documents, findings)
    findings.stop_on_errors()
    return documents


def _report_versions(documents: Sequence[Document], findings: Findings) -> None:
    for other in documents[1:]:
        if other.version != documents[0].version:
            findings.add(
                codes.MIXED_VERSIONS(
                    f'is AMALTHEA {other.version}, but "{documents[0].name}" is {documents[0].version}',
                    at=Location(other.name),
                    help="migrate the files to one version with APP4MC, or import the models one by one",
                )
            )
    for document in documents:
        number = document.version.removeprefix("ITEA ")
        if number not in (KNOWN if number == document.version else _KNOWN_ITEA):
            findings.add(
                codes.UNKNOWN_VERSION(
                    f"is AMALTHEA {document.version}, which the importer does not know",
                    at=Location(document.name),
                    help="check the result with care, or migrate the file with APP4MC",
                )
            )


def read_file(name: str) -> Document:
    """Parse a file as an AMALTHEA model; see `recognise`."""
    return recognise(read_bytes(name), name)


def recognise(data: bytes, name: str) -> Document:
    """Parse `data` if it is an AMALTHEA model; raise `HalpipeError` that says what it is otherwise."""
    if data.startswith(b"PK\x03\x04"):
        help = "unpack it and import the file inside"
        raise HalpipeError(codes.NOT_AMALTHEA("is a compressed file", at=Location(name), help=help))
    root = parse_xml(data, name)
    namespace, _, tag = str(root.tag).rpartition("}")
    namespace = namespace.lstrip("{")
    at = Location(name, root.sourceline or 1)
    version = _version(namespace)
    if version and (tag in ("Amalthea", "AMALTHEA") or _MODEL.fullmatch(tag)):
        return Document(name, root, version)
    help = f"name {_SUFFIX} files of APP4MC"
    if tag == "EPackage":
        raise HalpipeError(codes.NOT_AMALTHEA("is a metamodel (ecore), not a model", at=at, help=help))
    where = f'in the namespace "{namespace}"' if namespace else "without a namespace"
    raise HalpipeError(codes.NOT_AMALTHEA(f'has the root element "{tag}" {where}', at=at, help=help))


def _version(namespace: str) -> str:
    if (match := _ITEA.fullmatch(namespace)) is not None:
        return f"ITEA {match['version']}"
    match = _APP4MC.fullmatch(namespace)
    return match["version"] if match else ""
