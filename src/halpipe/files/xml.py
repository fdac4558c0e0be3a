"""Hostile XML: parsed without DTD, entities or network, and within the depth that libxml2 allows."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.diagnostics import Diagnostic, HalpipeError, Location, error

if TYPE_CHECKING:
    from lxml import etree

MAX_SYNTAX_ERRORS = 20

BROKEN_XML = error(
    "HAL0010",
    "XML is not well-formed",
    "The file is not XML, or ends too early, or nests deeper than 256 elements.",
)
HAS_DOCTYPE = error(
    "HAL0011",
    "XML has a DOCTYPE",
    "Document type declarations can read other files and expand without bound, and no format that halpipe "
    "reads needs one. Files with a DOCTYPE are refused.",
)


def parse_xml(data: bytes, name: str) -> etree._Element:
    """Parse hostile XML and return its root; raise `HalpipeError` with every syntax error and its line."""
    from lxml import etree

    _refuse_doctype(data, name)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as failure:
        raise HalpipeError(*_syntax_errors(parser, failure, name)) from None
    docinfo: Any = root.getroottree().docinfo
    if docinfo.doctype:  # in an encoding that hid it from the look at the bytes
        raise _doctype(name, 1)
    return root


_PROLOG = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s++|<\?.*?\?>|<!--.*?-->)*+", re.DOTALL)


def _refuse_doctype(data: bytes, name: str) -> None:
    """Refuse a DOCTYPE before any parser works on what it declares."""
    prolog = _PROLOG.match(data)
    end = prolog.end() if prolog else 0
    if data.startswith(b"<!DOCTYPE", end):
        raise _doctype(name, data.count(b"\n", 0, end) + 1)


def _doctype(name: str, line: int) -> HalpipeError:
    help = "remove the <!DOCTYPE ...> declaration"
    return HalpipeError(HAS_DOCTYPE("declares a DOCTYPE", at=Location(name, line), help=help))


_ADVICE_TO_PROGRAMMERS = re.compile(r",? (?:use|try|see) xml\w+(?: option)?\.?$", re.IGNORECASE)


def _syntax_errors(parser: Any, failure: Exception, name: str) -> list[Diagnostic]:
    entries = [(entry.line, entry.message) for entry in parser.error_log if entry.level_name in ("ERROR", "FATAL")]
    unique = list(dict.fromkeys(entries))[:MAX_SYNTAX_ERRORS] or [(getattr(failure, "lineno", 0) or 0, str(failure))]
    return [
        BROKEN_XML(_ADVICE_TO_PROGRAMMERS.sub("", message.strip()), at=Location(name, line), help="repair the file")
        for line, message in unique
    ]
