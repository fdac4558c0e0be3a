"""Input files: AMALTHEA models recognised by content, and the native model of an export."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.embedding import joined, properties_hash
from halpipe.core.files import advice_for, parse_xml, read_bytes
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.xmi import Forest, Item, text_of
from halpipe.importers.common.inputs import read_inputs
from halpipe.importers.common.names import legal
from halpipe.importers.native import parse_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.importers.common.base import Coverage, ImportOptions
    from halpipe.models import TaskModel

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
    documents = read_inputs(paths, (_SUFFIX,), _read_file, codes.SKIPPED_FILE, codes.NO_INPUT, findings)
    _report_versions(documents, findings)
    findings.stop_on_errors()
    return documents


def _report_versions(documents: Sequence[Document], findings: Findings) -> None:
    for other in documents[1:]:
        if other.version != documents[0].version:
            message = f'is AMALTHEA {other.version}, but "{documents[0].name}" is {documents[0].version}'
            help = "migrate the files to one version with APP4MC, or import the models one by one"
            findings.add(codes.MIXED_VERSIONS(message, at=Location(other.name), help=help))
    for document in documents:
        number = document.version.removeprefix("ITEA ")
        if number not in (KNOWN if number == document.version else _KNOWN_ITEA):
            message = f"is AMALTHEA {document.version}, which the importer does not know"
            help = "check the result with care, or migrate the file with APP4MC"
            findings.add(codes.UNKNOWN_VERSION(message, at=Location(document.name), help=help))


def _read_file(name: str) -> Document:
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
    help = advice_for(f"<{tag} ".encode(), "amalthea", f"name {_SUFFIX} files of APP4MC")
    if tag == "EPackage":
        raise HalpipeError(codes.NOT_AMALTHEA("is a metamodel (ecore), not a model", at=at, help=help))
    where = f'in the namespace "{namespace}"' if namespace else "without a namespace"
    raise HalpipeError(codes.NOT_AMALTHEA(f'has the root element "{tag}" {where}', at=at, help=help))


def _version(namespace: str) -> str:
    if (match := _ITEA.fullmatch(namespace)) is not None:
        return f"ITEA {match['version']}"
    match = _APP4MC.fullmatch(namespace)
    return match["version"] if match else ""


def read_embedded(
    documents: Sequence[Document], options: ImportOptions, findings: Findings, coverage: Coverage
) -> TaskModel | None:
    """Return the native model of an export; None without one, and, with a warning, where files were changed."""
    roots = Forest(documents, Findings()).roots
    root = next((root for root in roots if text_of(root, "hash") is not None), None)
    if root is None:
        return None
    trouble, model = _read(root, is_alone=len(roots) == 1)
    if model is None:
        help = "nothing to do if the change was meant; otherwise export the model again"
        message = f"{trouble}; the standard elements are imported"
        findings.add(codes.EDITED(message, at=root.at, help=help))
        return None
    coverage.mapped("file")
    for item in root.walk():
        if item.name and item is not root:
            coverage.mapped(item.kind)
    return replace(model, name=legal(options.name)) if options.name else model


def _read(root: Item, *, is_alone: bool) -> tuple[str, TaskModel | None]:
    """Return why the native model does not count, or the model."""
    if not is_alone:
        return "other files stand beside an export of halpipe", None
    if text_of(root, "hash") != properties_hash(root.element):
        return "standard elements were changed after the export", None
    texts: list[str] = []
    while (text := text_of(root, f"model.{len(texts)}")) is not None:
        texts.append(text.replace("\n", " "))  # the whole value stands in one line of the file
    try:
        return "", parse_model(joined(texts, root.at.line), root.file)
    except HalpipeError as failure:
        return f"the native model cannot be read: {failure.diagnostics[0].message}", None
