"""Events of a JSON document, a list or the list ``traceEvents`` of an object, one at a time.

The decoder of the standard library reads each event from a buffer that is filled as it is used up, so that only the
largest event has to fit into memory.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import json_decoder
from halpipe.importers.traces import codes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from halpipe.core.diagnostics import Findings

LARGEST_VALUE = 2**28
"""Characters of one event, or of one value beside the list."""
_DELIMITERS = frozenset(",:]} \t\r\n")
_decode = json_decoder(str).raw_decode
_scan: Callable[[str, int], tuple[Any, int]] = vars(json_decoder(str))["scan_once"]
"""Numbers with a point stay texts, of which readers make exact numbers."""
_blank = re.compile("[ \t\r\n]*").match
_comma = re.compile("[ \t\r\n]*,[ \t\r\n]*").match


def events(pieces: Iterable[str], file: str, findings: Findings) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield each event with its line; raise `HalpipeError` where the text is no JSON or has no list of events.

    A list without its closing bracket is noted in `findings`: recorders may omit it, or the file is cut off.
    """
    text, has_list = _Text(pieces), False
    try:
        if text.next() == "[":
            has_list = True
            yield from text.elements()
        else:
            for key in text.entries():
                is_list = key == "traceEvents" and text.next() == "["
                has_list = has_list or is_list
                if is_list:
                    yield from text.elements()
                else:
                    text.value()
        if text.is_closed and text.next():
            raise ValueError(f"after its end comes {text.next()!r}")
    except (ValueError, RecursionError) as failure:
        message = f"it is no JSON: {getattr(failure, 'msg', failure)}"
        help = "give a file in the Trace Event Format; record it again if its JSON is only cut off"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, text.line), help=help)) from None
    if not has_list:
        help = "record in the Trace Event Format"
        raise HalpipeError(codes.UNKNOWN_TRACE("it has no list traceEvents", at=Location(file), help=help))
    if not text.is_closed:
        findings.add(codes.NO_END("the list of events has no closing bracket", at=Location(file)))


class _Text:
    def __init__(self, pieces: Iterable[str]) -> None:
        self._pieces = iter(pieces)
        self._text, self._at = "", 0
        self._line, self._counted = 1, 0
        self.is_closed = True
        """Whether every list and object had its bracket."""

    @property
    def line(self) -> int:
        """Return the line of the next character."""
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at
        return self._line

    def _more(self) -> bool:
        """Read at least as much again as there is, so that the cost of a large value grows with it."""
        left = len(self._text) - self._at
        if left > LARGEST_VALUE:
            raise ValueError(f"an event has more than {LARGEST_VALUE} characters")
        found = []
        for piece in self._pieces:
            found.append(piece)
            left -= len(piece)
            if left <= 0:
                break
        self._line = self.line
        self._text = "".join((self._text[self._at :], *found))
        self._at = self._counted = 0
        return bool(found)

    def next(self) -> str:
        """Return the next character that is not blank, without using it; empty at the end."""
        while True:
            self._at = _blank(self._text, self._at).end()  # type: ignore[union-attr]
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more():
                return ""

    def _take(self, signs: str) -> str:
        """Use the next character, one of `signs`; at the end of the text nothing."""
        sign = self.next()
        if sign and sign not in signs:
            raise ValueError(f"{sign!r} stands where one of {signs} is due")
        self._at += len(sign)
        return sign

    def value(self) -> Any:
        """Use one value and return it."""
        self.next()
        while True:
            try:
                value, end = _decode(self._text, self._at)
            except json.JSONDecodeError:
                if not self._more():
                    raise
                continue
            if self._text[end : end + 1] in _DELIMITERS or not self._more():  # a number may go on in the next piece
                self._at = end
                return value

    def elements(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Use a list, and yield each object in it with its line."""
        self._take("[")
        while self.next() not in ("]", ""):
            line, value = self.line, self.value()
            if type(value) is dict:
                yield line, value
            if self.next() == ",":
                self._take(",")
                yield from self._whole()
            elif self.next() != "]":
                break
        self.is_closed = bool(self._take("]"))

    def _whole(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Use the elements of a list that are in the text with the comma after them, as most are."""
        self.next()
        text, at, line = self._text, self._at, self.line
        while True:
            try:
                value, end = _scan(text, at)
            except (StopIteration, json.JSONDecodeError):
                return
            between = _comma(text, end)
            if between is None or (begin := between.end()) == len(text):
                return
            self._at = begin
            if type(value) is dict:
                yield line, value
            line += text.count("\n", at, begin)
            at = begin

    def entries(self) -> Iterator[str]:
        """Use an object, and yield each key; its value is to be used before the next."""
        self._take("{")
        used = set()
        while self.next() not in ("}", ""):
            key = self.value()
            if key in used:
                raise ValueError(f'the key "{str(key)[:80]}" is repeated')
            used.add(key)
            self._take(":")
            yield key
            if not self.is_closed or self._take(",}") != ",":
                return
        self._take("}")
