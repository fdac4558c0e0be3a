"""The XML schemas, one per artefact, and the check of a document against its schema.

libxml2 validates, because it is fast; only when it finds something is the same tree handed to the xmlschema
package, whose reasons are easier to read, and the two are merged by line.
"""

from __future__ import annotations

import re
from bisect import bisect
from collections import Counter
from contextlib import suppress
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Diagnostic, Location, error
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

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
_LAST_EXACT_LINE = 65535

MAX_REPORTED = 1000
"""Violations that are listed before the rest is counted."""

MAX_EXPLAINED = 50
"""Violations for which xmlschema is asked too."""

MAX_EXPLAINED_ELEMENTS = 20_000
"""Elements of a document up to which it is asked at all."""

MAX_ATTRIBUTES = 100
"""Attributes of one element up to which it is asked at all: for each one that is wrong, it prints them all."""

MAX_STEPS = 3_000_000
"""Siblings that may be passed by to say where elements are: it is done for each violation, and one may have eight."""

MAX_ELEMENTS = 100_000
"""Elements of a document that is checked at once: libxml2 remembers every violation."""

MANY = 100
"""Violations after which no more are looked for while parsing: libxml2 would remember each of a million."""

_FED_BYTES = 65_536


def namespace(kind: str) -> str:
    """Return the XML namespace of an artefact, version 1."""
    return f"urn:halpipe:{kind}:1"


def check(root: etree._Element, kind: str, name: str) -> list[Diagnostic]:
    """Hold a document against the schema of its kind; return every violation with its line."""
    expected = f"{{{namespace(kind)}}}{kind}"
    if root.tag != expected:
        uri, _, tag = str(root.tag).rpartition("}")
        text = f'has the root element "{tag}" in ' + (f'the namespace "{uri[1:]}"' if uri else "no namespace")
        return [WRONG_ROOT(text, at=Location(name, line_of(root)), help=_instead(kind, uri[1:]))]
    entries, line_of_entry, is_whole = _in_bulk(root, kind) if _could_be_slow(root) else _in_tree(root, kind)
    listed = entries[: MAX_REPORTED * 2]  # a bad value is reported twice
    violations = {_subject(e): (line_of_entry(e), _plain(e.message, kind)) for e in reversed(listed)}
    found = _reported(list(reversed(violations.values()))[:MAX_REPORTED], root, kind, name)
    if not is_whole or len(entries) > len(listed) or len(violations) > MAX_REPORTED:
        remark = "there may be more of them further down; correct these first"
        found.append(SCHEMA_VIOLATION("was looked at in part", at=Location(name), help=remark))
    return found


_IMPORTED = {"http://autosar.org/": "arxml", "http://app4mc.eclipse.org/": "amalthea"}
"""How the namespaces of what is imported begin."""


def _instead(kind: str, uri: str) -> str:
    """Say what to do with a document of another kind, by the namespace of its root."""
    for begin, format in _IMPORTED.items():
        if uri.startswith(begin):
            return f"make a model of it first: halpipe import {format} FILE -o model.xml"
    other = SCHEDULE if kind == TASK_MODEL else TASK_MODEL
    if uri == namespace(other):
        here, wanted = ("schedule", "model") if kind == TASK_MODEL else ("model", "schedule")
        return f"this is a {here}, where a {wanted} is expected; commands take MODEL first, then SCHEDULE"
    return f'expected <{kind} xmlns="{namespace(kind)}">'


def _could_be_slow(root: etree._Element) -> bool:
    """Return whether naming the place of every element would pass more siblings by than there is time for."""
    count = int(root.xpath("count(//*)"))
    if count**2 <= MAX_STEPS or count > MAX_ELEMENTS:
        return count > MAX_ELEMENTS
    steps, waiting = 0, [(root, 0)]
    while waiting and steps <= MAX_STEPS:
        element, so_far = waiting.pop()
        for index, child in enumerate(element, so_far + 1):
            steps += index
            waiting.append((child, index))
    return steps > MAX_STEPS


class _Nothing:
    """Parser target that builds no tree, for a document that is parsed for its violations alone."""

    def close(self) -> None:
        """Return what was made."""


def _in_tree(root: etree._Element, kind: str) -> tuple[list[Any], Callable[[Any], int], bool]:
    """Return the messages of libxml2 on a tree, a function that returns their lines, and that they are all."""
    schema = _libxml2_schema(kind)
    return ([] if schema.validate(root) else list(schema.error_log)), partial(_line, root), True


class _Message(NamedTuple):
    """Message of a parser that builds no tree, and the line in which it has found it."""

    message: str
    line: int
    path: str = ""


def _in_bulk(root: etree._Element, kind: str) -> tuple[list[Any], Callable[[Any], int], bool]:
    """Return messages found while parsing, a function that returns their lines, and whether they are all."""
    from lxml import etree

    text = etree.tostring(root)
    if not _fed(_pieces([text]), kind):
        return [], int, True
    found = _fed(_pieces(text.splitlines(keepends=True)), kind)  # slower, but what is found is found in its line
    return found, _lines_of(root), len(found) < MANY


def _pieces(lines: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    """Yield short pieces with the numbers of their lines: the parser remembers what is wrong in a whole piece."""
    for number, line in enumerate(lines, 1):
        yield from ((number, line[start : start + _FED_BYTES]) for start in range(0, len(line), _FED_BYTES))


def _fed(pieces: Iterable[tuple[int, bytes]], kind: str) -> list[_Message]:
    """Parse a text in pieces, each with a line, and return the first `MANY` messages with their lines."""
    from lxml import etree

    etree.clear_error_log()  # it holds the last messages of this thread, of other documents too
    parser = etree.XMLParser(schema=_libxml2_schema(kind), target=_Nothing())  # of a text without a DTD
    found: list[_Message] = []
    number, is_broken = 0, False
    for number, piece in pieces:
        try:
            parser.feed(piece)
        except etree.XMLSyntaxError:
            is_broken = True
        found += [_Message(entry.message, number) for entry in islice(parser.feed_error_log, len(found), MANY)]
        if is_broken or len(found) >= MANY:
            break
    try:
        parser.close()
    except etree.XMLSyntaxError as failure:  # no document is taken for valid that the parser did not end with
        return found or [_Message(str(failure), number)]
    return found


def _lines_of(root: etree._Element) -> Callable[[Any], int]:
    """Return a function that gives the line of a message about the text that `etree.tostring` makes of a tree.

    There, attributes of an element are on one line, and comments are absent. What an element lacks is found at its end
    tag, and belongs to its start tag.
    """
    from lxml import etree

    written, read, line = [1], [line_of(root)], 1
    begun: list[int] = []
    starts: dict[tuple[int, str], int] = {}
    for event, element in etree.iterwalk(root, events=("start", "end")):
        if event == "start":
            if line > written[-1] and _has_line(element):
                written.append(line)
                read.append(line_of(element))
            begun.append(line)
        elif (start := begun.pop()) < line:
            starts[line, etree.QName(element).localname] = start
        line += ((element.text if event == "start" else element.tail) or "").count("\n")

    def line_of_message(entry: Any) -> int:
        lacks = _LACKS.search(entry.message)
        at = starts.get((entry.line, lacks["name"]), entry.line) if lacks else entry.line
        place = bisect(written, at) - 1
        return int(read[place] + at - written[place])

    return line_of_message


def _reported(violations: list[tuple[int, str]], root: etree._Element, kind: str, name: str) -> list[Diagnostic]:
    reasons = _explain(root, kind) if violations else {}
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


def _has_line(element: etree._Element) -> bool:
    """Return whether `line_of` is exact: libxml2 counts no further than line 65534 where no text follows."""
    if (element.sourceline or 0) < _LAST_EXACT_LINE or element.text:
        return True
    return _has_line(element[0]) if len(element) else bool(element.tail)


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
    from lxml import etree

    try:
        found = root.getroottree().xpath(entry.path)
    except etree.XPathEvalError:  # the path has prefixes that only the document knows
        found = []
    return line_of(found[0]) if found else int(entry.line)


@cache
def _libxml2_schema(kind: str) -> etree.XMLSchema:
    from lxml import etree

    return etree.XMLSchema(_grammar(kind))


def _grammar(kind: str) -> etree._Element:
    """Return a schema without its identity constraints."""
    from lxml import etree

    schema = etree.fromstring(_schema_bytes(kind))
    etree.strip_elements(schema, *(_XSD + constraint for constraint in _IDENTITY_CONSTRAINTS))
    return schema


def _schema_bytes(kind: str) -> bytes:
    return Path(__file__).with_name(f"{kind}-1.xsd").read_bytes()


def _explain(root: etree._Element, kind: str) -> dict[int, str]:
    """Return, by line, why xmlschema finds the document wrong."""
    import xmlschema
    from lxml import etree

    is_large = root.xpath("count(//*)") > MAX_EXPLAINED_ELEMENTS
    if is_large or any(len(element.attrib) > MAX_ATTRIBUTES for element in root.iter()):
        return {}
    schema = xmlschema.XMLSchema10(etree.tostring(_grammar(kind), encoding="unicode"))
    reasons: dict[int, str] = {}
    # What xmlschema cannot digest, such as an unknown xsi:type, stays without its explanation.
    with suppress(xmlschema.XMLSchemaException):
        for failure in islice(schema.iter_errors(root), MAX_EXPLAINED):
            if failure.reason and failure.sourceline and "match any pattern" not in failure.reason:
                reason = _shortened(" ".join(str(failure.reason).split()))
                reasons.setdefault(failure.sourceline, reason.replace(f"{{{namespace(kind)}}}", "").replace("'t:", "'"))
    return reasons


_UNKNOWN_ATTRIBUTE = re.compile(r"The attribute '(?P<name>[^']*)' is not allowed")
_LACKS = re.compile(r"^Element '(?:\{[^}]*\})?(?P<name>[^']*)': Missing child")
_LONG_VALUE = re.compile(r"(['\"])([^'\"]{60})[^'\"]{60,}(?:\1|$)")
_MOST_SHOWN, _END_SHOWN = 400, 150


def _shortened(text: str) -> str:
    """Cut quoted values that are so long that they would hide the message, whatever quotes are in them."""
    if len(text) > _MOST_SHOWN * 4:
        text = f"{text[: _MOST_SHOWN * 2]}...{text[-_MOST_SHOWN * 2 :]}"
    text = _LONG_VALUE.sub(r"\1\2...\1", text)
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - _END_SHOWN]}...{text[-_END_SHOWN:]}"


def _meant(attribute: str, kind: str) -> str:
    """Return which attribute of the schema was probably meant, or where it belongs if there is one of that name."""
    owners = _owners(kind, attribute)
    if owners:
        return f'"{attribute}" belongs to ' + " or ".join(f"<{owner}>" for owner in owners)
    return did_you_mean(attribute, _attributes(kind), "remove it")


@cache
def _attributes(kind: str) -> tuple[str, ...]:
    from lxml import etree

    names = etree.fromstring(_schema_bytes(kind)).xpath("//*[local-name() = 'attribute']/@name")
    return tuple(sorted(set(map(str, names))))


@cache
def _owners(kind: str, attribute: str) -> tuple[str, ...]:
    """Return the elements that have an attribute of this name: those that declare it, or whose type does."""
    from lxml import etree

    schema = etree.fromstring(_schema_bytes(kind))
    found: set[str] = set()
    for declared in schema.xpath("//*[local-name() = 'attribute'][@name = $name]", name=attribute):
        for around in declared.iterancestors():
            name = etree.QName(around).localname
            if name == "element":
                found.add(str(around.get("name")))
                break
            if name == "complexType" and around.get("name"):
                users = "//*[local-name() = 'element'][@type = $type or substring-after(@type, ':') = $type]/@name"
                found |= set(map(str, schema.xpath(users, type=around.get("name"))))
                break
    return tuple(sorted(found))


_PATTERN_FACET = re.compile(
    r"\[facet 'pattern'\] The value '(?P<value>.*)' is not accepted by the pattern '(?P<pattern>.*)'\."
)

_DECIMAL_COMMA = re.compile(r"^[^,]*[0-9],[0-9][^,]*$")
_SEPARATORS = re.compile(r"[,;]|->|=>")
_FACET = re.compile(r"\[facet '\w+'\] ")


@cache
def _forms(kind: str) -> dict[str, str]:
    """Return what the schema says in words of each of its patterns."""
    from lxml import etree

    xs = "{http://www.w3.org/2001/XMLSchema}"
    forms: dict[str, str] = {}
    for simple_type in etree.fromstring(_schema_bytes(kind)).iter(f"{xs}simpleType"):
        words = simple_type.findtext(f"{xs}annotation/{xs}documentation")
        for pattern in simple_type.iter(f"{xs}pattern") if words else ():  # of a list, that of its items
            forms.setdefault(pattern.get("value"), words)
    return forms


def _plain(message: str, kind: str) -> str:
    """Take the namespace braces out of a libxml2 message, and say in words which form a value should have."""
    message = _shortened(message.replace(f"{{{namespace(kind)}}}", ""))
    facet = _PATTERN_FACET.search(message)
    if facet and facet["pattern"] in _forms(kind):
        value, form = facet["value"], _forms(kind)[facet["pattern"]]
        point, names = value.replace(",", "."), _SEPARATORS.split(value)
        if _DECIMAL_COMMA.search(value) and re.fullmatch(facet["pattern"], point):
            form += f"; write {point}, with a decimal point"
        elif len(names) > 1 and all(not each or re.fullmatch(facet["pattern"], each) for each in names):
            form += f'; blanks alone separate names: "{" ".join(filter(None, names)) or "a b"}"'
        message = message[: facet.start()] + f"the value '{value}' is not {form}"
    return _FACET.sub("", message)
