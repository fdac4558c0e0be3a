"""Tells files apart by content: AUTOSAR R4, older releases, vendor formats, other XML, broken files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError, Location
from halpipe.files import find_inputs, parse_xml, read_bytes
from halpipe.importers.arxml import codes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.diagnostics import Findings

NAMESPACE = "http://autosar.org/schema/r4.0"
_OLD = re.compile(r"http://(?:www\.)?autosar\.org/(?:schema/)?r?(?P<release>[23](?:\.[0-9A-Za-z]+)*)/?")
_BARE = re.compile(r"(?:http://(?:www\.)?autosar\.org/?)?")


@dataclass(frozen=True, slots=True)
class Document:
    """A parsed AUTOSAR R4 file and the name that the user gave it."""

    name: str
    root: etree._Element


def load(paths: Sequence[str], findings: Findings) -> list[Document]:
    """Parse every file of `paths`; what a directory holds besides is skipped, what was named directly is an error.

    Raise `HalpipeError` if any file named directly cannot be used, or if none is left.
    """
    documents = []
    for name in dict.fromkeys(find_inputs(paths, (".arxml",))):
        try:
            documents.append(Document(name, recognise(read_bytes(name), name)))
        except HalpipeError as failure:
            if name in paths:
                findings.extend(failure.diagnostics)
                continue
            findings.extend(
                codes.SKIPPED_FILE(f"skipped: {cause.message}", at=cause.at, help=cause.help)
                for cause in failure.diagnostics
            )
    if not documents and not findings.has_errors:
        findings.add(
            codes.NO_INPUT(
                "holds no usable .arxml file" if paths else "no input was named",
                at=Location(paths[0] if paths else ""),
                help="name .arxml files, or directories that hold them",
            )
        )
    findings.stop_on_errors()
    return documents


def recognise(data: bytes, name: str) -> etree._Element:
    """Parse `data` and return its root if it is AUTOSAR R4; raise `HalpipeError` that says what it is otherwise."""
    root = parse_xml(data, name)
    namespace, tag = _split(root.tag)
    at = Location(name, root.sourceline or 1)
    if tag == "AUTOSAR" and namespace == NAMESPACE:
        return root
    if tag == "datamodel":
        raise HalpipeError(
            codes.EB_XDM("is EB tresos project data (root element datamodel)", at=at, help="export it as ARXML")
        )
    if tag != "AUTOSAR":
        raise HalpipeError(
            codes.NOT_ARXML(
                f'has the root element "{tag}", not AUTOSAR', at=at, help="name ARXML files of release 4.x only"
            )
        )
    release = _release(root, namespace)
    if release:
        raise HalpipeError(
            codes.OLD_RELEASE(
                f'is AUTOSAR {release} (namespace "{namespace}")',
                at=at,
                help="export it as release 4.x; only those are read",
            )
        )
    what = f'is in the namespace "{namespace}"' if namespace else "has no namespace"
    raise HalpipeError(codes.NOT_ARXML(f"{what}, not {NAMESPACE}", at=at, help="export it as AUTOSAR release 4.x"))


def _release(root: etree._Element, namespace: str) -> str:
    """Return "3.2.3" or such for an old namespace, and for no release in it when old elements follow."""
    match = _OLD.fullmatch(namespace)
    if match:
        return match["release"]
    if _BARE.fullmatch(namespace) and any(_split(child.tag)[1] == "TOP-LEVEL-PACKAGES" for child in root.iter("{*}*")):
        return "2.x or 3.x"
    return ""


def _split(tag: str) -> tuple[str, str]:
    namespace, _, local = tag.rpartition("}")
    return namespace.lstrip("{"), local
