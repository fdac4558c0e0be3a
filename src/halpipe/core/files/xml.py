"""Hostile XML: parsed without DTD, entities or network, and within the depth that libxml2 allows."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location, error

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

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


def parse_xml(data: bytes, name: str, *, long_texts: bool = False) -> etree._Element:
    """Parse hostile XML and return its root; raise `HalpipeError` with every syntax error and its line.

    Comments and processing instructions are left out: they may stand inside a value, which is what is round them.
    A text, comment or attribute of more than 10 MB is refused unless the format is known to have such (`long_texts`).
    """
    from lxml import etree

    _refuse_doctype(data, name)
    parser = _xml_parser(huge=False)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as failure:
        found = _syntax_errors(parser, failure, name, data, is_xml=_begins_as_xml(data))
        is_plain = _PLAIN_ENCODING.match(data) is not None  # one in which a DOCTYPE would have been seen
        if not (long_texts and is_plain) or not any(_LONG_TEXT.search(entry.message) for entry in parser.error_log):
            raise HalpipeError(*found) from None
        root = _parse_long_texts(data, name)
    docinfo: Any = root.getroottree().docinfo
    if docinfo.doctype:  # in an encoding that hid it from the look at the bytes
        raise _doctype(name, 1)
    return root


class LargeXmlParser:
    """Parses hostile XML in parts, leaving out elements of `tags` that are dropped as soon as they are complete.

    As `parse_xml`, but the memory grows with what is kept only, and no text has more than 10 MB. Every tree keeps its
    parser, so one should read all files.
    """

    def __init__(self, tags: Collection[str]) -> None:
        self._tags = tuple(tags)
        self._parser: etree.XMLPullParser | None = None

    def parse(
        self,
        stream: BinaryIO,
        name: str,
        is_dropped: Callable[[etree._Element], bool],
        on_read: Callable[[int], None] | None = None,
    ) -> etree._Element:
        """Return the root of what is kept; `on_read` receives the bytes read so far."""
        from lxml import etree

        parser, self._parser = self._parser or self._new_parser(), None  # one that failed is of no more use
        done = 0
        try:
            for chunk in iter(partial(stream.read, _CHUNK_BYTES), b""):
                if not done:
                    _refuse_doctype(chunk, name)
                done += len(chunk)
                parser.feed(chunk)
                for _, element in parser.read_events():
                    holder = element.getparent()
                    if holder is not None and is_dropped(element):
                        holder.remove(element)
                if on_read:
                    on_read(done)
            root: etree._Element = parser.close()
        except (etree.XMLSyntaxError, ValueError) as failure:
            raise HalpipeError(*_syntax_errors(parser, failure, name)) from None
        docinfo: Any = root.getroottree().docinfo
        if docinfo.doctype:
            raise _doctype(name, 1)
        self._parser = parser
        return root

    def _new_parser(self) -> etree.XMLPullParser:
        from lxml import etree

        return etree.XMLPullParser(events=("end",), tag=self._tags, remove_blank_text=True, **_HARDENED)


_HARDENED: dict[str, Any] = {"resolve_entities": False, "no_network": True, "load_dtd": False}
_HARDENED |= {"remove_comments": True, "remove_pis": True}
_CHUNK_BYTES = 2**18  # of which the first has the whole prolog
_LONG_TEXT = re.compile("Text node too long|huge text node|Buffer size limit|too big found")
_PLAIN_ENCODING = re.compile(
    rb"""(?:\xef\xbb\xbf)?\s*<(?!\?xml(?![^>]*encoding=["'](?i:utf-8|us-ascii|iso-8859-1|windows-1252)["'])[^>]*encoding)"""
)
_MAX_XML_DEPTH = 256


def _xml_parser(*, huge: bool) -> etree.XMLParser:
    from lxml import etree

    return etree.XMLParser(huge_tree=huge, **_HARDENED)


def _parse_long_texts(data: bytes, name: str) -> etree._Element:
    """Parse a file with a text beyond libxml2's limit of 10 MB; without it, only the limit of depth is left to check.

    Entities, the third thing that is limited, cannot be declared without a DOCTYPE.
    """
    from lxml import etree

    parser = _xml_parser(huge=True)
    depth = 0
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as failure:
        raise HalpipeError(*_syntax_errors(parser, failure, name)) from None
    for event, element in etree.iterwalk(root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        if depth > _MAX_XML_DEPTH:
            message = f"nests deeper than {_MAX_XML_DEPTH} elements"
            at = Location(name, element.sourceline or 0)
            raise HalpipeError(BROKEN_XML(message, at=at, help="repair the file"))
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


def _begins_as_xml(data: bytes) -> bool:
    """Return whether there is a tag where a document begins, in any encoding that a byte order mark may tell."""
    return b"<" in data[:200].replace(b"\0", b"").removeprefix(b"\xef\xbb\xbf").lstrip()[:4]


_ADVICE_TO_PROGRAMMERS = re.compile(r",? (?:use|try|see) xml\w+(?: option)?\.?$", re.IGNORECASE)


_ADVICE = (
    ("EntityRef", 'write "&amp;" for "&"'),
    ("AttValue", 'put the value of every attribute in quotes, as in name="value"'),
    ("ending tag mismatch", "close each element with the name that opens it"),
    ("allowed only at the start", "remove what stands before <?xml ...?>: blanks and empty lines, too"),
    ("parsing XML declaration", 'declare the encoding that the file has, such as encoding="UTF-8"'),
    ("Premature end", "the end of the file is missing: write or copy it again"),
    ("not terminated", "the end of the file is missing: write or copy it again, or close what is open"),
)
"""Advice by a part of the parser's messages, which name what is expected, not what to write."""


_HEAD = r"(<\?[^>]*>\s*|<!--(?s:.*?)-->\s*)*<(\w+:)?"
KINDS = (
    (r"\Z", "the file is empty: write or copy it again"),
    (_HEAD + r"AUTOSAR\b", "import it: `halpipe import arxml FILE -o model.xml`"),
    (_HEAD + r"Amalthea\b", "import it: `halpipe import amalthea FILE -o model.xml`"),
    (r"PK\x03\x04", "unpack it; a workbook is imported as it is: `halpipe import table FILE -o model.xml`"),
    (r"[^\n:<{]*\b(period|wcet)\b[^\n:]*[,;\t]", "import it: `halpipe import table FILE -o model.xml`"),
    (
        r"#version|\[\s*\{|\{\s*\"|[^\n:]*\b(task|start|end)\b[^\n:]*[,;\t]",
        "a trace comes second: `halpipe compare SCHEDULE TRACE`",
    ),
    (r"(strict\s+)?(di)?graph\b", "import the graph first: `halpipe import ros FILE -o model.xml`"),
    (
        r"[^\n:<{,;\t.]{0,30}([,;\t][^\n:<{,;\t.]{0,30})+(\n|\Z)",
        "name a sheet of tasks with the columns task, period and wcet to `halpipe import table`",
    ),
    (r"halpipe-pipeline:", "run the pipeline file: `halpipe run FILE`"),
    (r"halpipe-overlay:", "give the overlay to an import: `halpipe import FORMAT SOURCE --overlay FILE -o model.xml`"),
    (r"(---\s+)?[\w\"'-]+:(\s|\Z)", "it has the form of YAML: name the XML file, or use `halpipe import ros`"),
)
"""Beginnings of files of other kinds, and what to do with these."""


_OTHER = "`halpipe import` makes a model of other sources"


def advice_for(data: bytes, format: str = "?", otherwise: str = _OTHER) -> str:
    """Return what to do with a file of another kind than that of an imported `format`, by its beginning."""
    begin = re.sub(r"\A(\s*(#(?!version)|//)[^\n]*\n)*\s*", "", data[:2000].decode("utf-8-sig", "replace"))
    found = next((advice for form, advice in KINDS if re.match(form, begin, re.IGNORECASE)), otherwise)
    return otherwise if f"import {format}" in found else found


def _syntax_errors(
    parser: Any, failure: Exception, name: str, data: bytes = b"", *, is_xml: bool = True
) -> list[Diagnostic]:
    said = "".join(entry.message for entry in parser.error_log)
    help = next((advice for sign, advice in _ADVICE if sign in said), "repair the file")
    help = help if is_xml else f"this is no XML; {advice_for(data)}"
    entries = [(entry.line, entry.message) for entry in parser.error_log if entry.level_name in ("ERROR", "FATAL")]
    unique = list(dict.fromkeys(entries))[:MAX_SYNTAX_ERRORS] or [(getattr(failure, "lineno", 0) or 0, str(failure))]
    return [
        BROKEN_XML(_ADVICE_TO_PROGRAMMERS.sub("", message.strip()), at=Location(name, line), help=help)
        for line, message in unique
    ]
