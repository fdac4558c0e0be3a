"""Formulas of variation points: references to system constants and numbers, with the operators of C.

Text and references are mixed, with line breaks anywhere. `&&` and `||` evaluate their right side only where it
matters, so that ``defined(A) && A == 1`` needs no value of A.
"""

from __future__ import annotations

import operator
import re
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.arxml.files.words import parse_number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lxml import etree

    Value = Fraction | str
    Lookup = Callable[[str], Value | None]

_TOKEN = re.compile(
    r"\s*(?:(?P<number>0[xX][0-9A-Fa-f]+|0[bB][01]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<text>\"[^\"]*\")"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<operator>\|\||&&|==|!=|<=|>=|<<|>>|[-+*/%<>!~&|^()]))"
)
_WORDS = {"true": Fraction(1), "false": Fraction(0)}
_MAX_DEPTH = 40
_MAX_SHIFT = 256


class FormulaError(ValueError):
    """Fault of a formula."""


class UnsetError(Exception):
    """A constant (path) that has no value."""


@record
class _Token:
    kind: str
    text: str


def evaluate(element: etree._Element, lookup: Lookup) -> Value:
    """Return the value of a formula; raise `FormulaError`, or `UnsetError` for a constant that it needs.

    `lookup` has the value of a system constant by its path, None if it has none.
    """
    return _Formula(list(_tokens(element)), lookup).value()


def is_true(value: Value) -> bool:
    """Whether a condition of this value holds."""
    return value not in (Fraction(0), "")


def _tokens(element: etree._Element) -> Iterator[_Token]:
    yield from _words(element.text or "")
    for child in element:
        yield _Token("ref", "".join((child.text or "").split()))
        yield from _words(child.tail or "")


def _words(text: str) -> Iterator[_Token]:
    position = 0
    while text[position:].strip():
        match = _TOKEN.match(text, position)
        if match is None:
            raise FormulaError(f'"{text[position:].strip()[:20]}" is no part of a formula')
        assert match.lastgroup is not None
        yield _Token(match.lastgroup, match[match.lastgroup])
        position = match.end()


def _divided(left: Fraction, right: Fraction) -> Fraction:
    """Divide as C does: integers toward zero."""
    if not right:
        raise FormulaError("divides by zero")
    if left.denominator == right.denominator == 1:
        quotient = abs(left.numerator) // abs(right.numerator)
        return Fraction(quotient if (left < 0) == (right < 0) else -quotient)
    return left / right


def _bits(function: Callable[[int, int], int]) -> Callable[[Fraction, Fraction], Fraction]:
    def apply(left: Fraction, right: Fraction) -> Fraction:
        return Fraction(function(_whole(left), _whole(right)))

    return apply


def _whole(value: Fraction) -> int:
    if value.denominator != 1:
        raise FormulaError(f"{value} is no whole number")
    return value.numerator


def _shifted(left: int, right: int, function: Callable[[int, int], int] = operator.lshift) -> int:
    if not 0 <= right <= _MAX_SHIFT:
        raise FormulaError(f"shifts by {right}")
    return function(left, right)


_LEVELS: tuple[dict[str, Callable[[Fraction, Fraction], Fraction]], ...] = (
    {"|": _bits(operator.or_)},
    {"^": _bits(operator.xor)},
    {"&": _bits(operator.and_)},
    {"==": lambda a, b: Fraction(a == b), "!=": lambda a, b: Fraction(a != b)},
    {
        "<": lambda a, b: Fraction(a < b),
        "<=": lambda a, b: Fraction(a <= b),
        ">": lambda a, b: Fraction(a > b),
        ">=": lambda a, b: Fraction(a >= b),
    },
    {"<<": _bits(_shifted), ">>": _bits(partial(_shifted, function=operator.rshift))},
    {"+": operator.add, "-": operator.sub},
    {"*": operator.mul, "/": _divided, "%": lambda a, b: a - _divided(a, b) * b},
)
"""Operators of two sides that both are needed, the weakest first."""


class _Formula:
    """A recursive descent; what does not matter is read, not evaluated."""

    def __init__(self, tokens: list[_Token], lookup: Lookup) -> None:
        self._tokens = tokens
        self._lookup = lookup
        self._at = 0
        self._depth = 0

    def value(self) -> Value:
        if not self._tokens:
            return Fraction(1)
        found = self._or(matters=True)
        if self._at < len(self._tokens):
            raise FormulaError(f'"{self._tokens[self._at].text}" is not expected')
        return found

    def _take(self, *texts: str) -> str:
        """Return the operator that comes next and go on, empty if it is none of these."""
        if self._at < len(self._tokens):
            token = self._tokens[self._at]
            if token.kind == "operator" and token.text in texts:
                self._at += 1
                return token.text
        return ""

    def _or(self, *, matters: bool) -> Value:
        found = self._and(matters=matters)
        while self._take("||"):
            right = self._and(matters=matters and not is_true(found))
            found = Fraction(is_true(found) or is_true(right))
        return found

    def _and(self, *, matters: bool) -> Value:
        found = self._binary(0, matters=matters)
        while self._take("&&"):
            right = self._binary(0, matters=matters and is_true(found))
            found = Fraction(is_true(found) and is_true(right))
        return found

    def _binary(self, level: int, *, matters: bool) -> Value:
        if level == len(_LEVELS):
            return self._unary(matters=matters)
        found = self._binary(level + 1, matters=matters)
        while sign := self._take(*_LEVELS[level]):
            right = self._binary(level + 1, matters=matters)
            found = self._apply(level, sign, found, right) if matters else Fraction(0)
        return found

    def _apply(self, level: int, sign: str, left: Value, right: Value) -> Value:
        if isinstance(left, str) or isinstance(right, str):
            if sign in ("==", "!="):
                return Fraction((str(left) == str(right)) == (sign == "=="))
            raise FormulaError(f'"{sign}" is not for texts')
        return _LEVELS[level][sign](left, right)

    def _unary(self, *, matters: bool) -> Value:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise FormulaError("is nested too deep")
        try:
            sign = self._take("!", "~", "-", "+")
            if not sign:
                return self._primary(matters=matters)
            value = self._unary(matters=matters)
            if sign == "!":
                return Fraction(not is_true(value))
            if isinstance(value, str):
                raise FormulaError(f'"{sign}" is not for texts')
            if sign == "~":
                return Fraction(~_whole(value)) if matters else Fraction(0)
            return -value if sign == "-" else value
        finally:
            self._depth -= 1

    def _primary(self, *, matters: bool) -> Value:
        if self._take("("):
            found = self._or(matters=matters)
            self._close()
            return found
        if self._at == len(self._tokens):
            raise FormulaError("ends too early")
        token = self._tokens[self._at]
        self._at += 1
        if token.kind == "ref":
            value = self._lookup(token.text)
            if value is None and matters:
                raise UnsetError(token.text)
            return Fraction(0) if value is None else value
        if token.kind == "text":
            return token.text[1:-1]
        if token.kind == "word" and token.text == "defined":
            return self._defined()
        number = _WORDS.get(token.text) if token.kind == "word" else parse_number(token.text)
        if number is None:
            raise FormulaError(f'"{token.text}" is not expected')
        return number

    def _defined(self) -> Value:
        if not self._take("(") or self._at == len(self._tokens) or self._tokens[self._at].kind != "ref":
            raise FormulaError("defined() needs a system constant")
        value = self._lookup(self._tokens[self._at].text)
        self._at += 1
        self._close()
        return Fraction(value is not None)

    def _close(self) -> None:
        if not self._take(")"):
            raise FormulaError('")" is missing')
