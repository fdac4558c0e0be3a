"""JSON by name and type: what is there, at its limits, and every fault with its path."""

from fractions import Fraction

import pytest

from halpipe.core.durations import ZERO, milliseconds
from halpipe.core.objects import JsonObject, parse_json


def read(data, use):
    """Return the value that a use of the object gives, and what was wrong."""
    faults = []
    top = JsonObject(data, "", lambda path, message: faults.append((path, message)))
    return use(top), faults


@pytest.mark.parametrize("text", [b"[1]", b"7", b'"a"', b"null"])
def test_a_document_that_is_no_object(text):
    faults = []
    assert parse_json(text, lambda *fault: faults.append(fault)).names() == []
    assert faults == [("", "is no object")]


@pytest.mark.parametrize("text", [b"{", b"\xff", b"[" * 100_000])
def test_a_text_that_is_no_json(text):
    faults = []
    assert parse_json(text, lambda path, message: faults.append(message)).names() == []
    assert len(faults) == 1
    assert faults[0].startswith("is no JSON: ")


def test_numbers_with_a_point_are_read_exactly():
    top = parse_json(b'{"a": 0.1, "b": NaN, "c": 3}', lambda *fault: None)
    assert (top.rational("a"), top.rational("c"), top.text("b")) == (Fraction(1, 10), 3, "NaN")


@pytest.mark.parametrize(
    ("value", "wrong"),
    [(3, False), (7, False), (2, True), (8, True), (True, True), ("5", True), (5.5, True), (None, True)],
)
def test_a_whole_number_in_its_range(value, wrong):
    found, faults = read({"n": value}, lambda top: top.number("n", 3, 7))
    assert (found, bool(faults)) == (3 if wrong else value, wrong)
    assert faults == ([("", f'"n" is {value!r}, no whole number from 3 to 7')] if wrong else [])


@pytest.mark.parametrize(
    ("value", "low", "high", "said"),
    [
        (12, None, None, ""),
        ("1/3", 0, 1, ""),
        ("0.5", "1/2", "1/2", ""),
        (0, 1, None, "no number from 1 to None"),
        (2, 1, 2, ""),
        (3, None, 2, "no number from None to 2"),
        ("x", None, None, 'no number such as 12, "0.5" or "1/3"'),
        (None, None, None, 'no number such as 12, "0.5" or "1/3"'),
    ],
)
def test_a_rational_in_its_range(value, low, high, said):
    low, high = (Fraction(bound) if isinstance(bound, str) else bound for bound in (low, high))
    found, faults = read({"n": value}, lambda top: top.rational("n", low, high))
    assert found == (Fraction(low or 0) if said else Fraction(value))
    assert [message.partition(", ")[2] for _, message in faults] == ([said] if said else [])


@pytest.mark.parametrize(("text", "value"), [("0", 0), ("80000000", 1 << 31), (f"{(1 << 56) - 1:x}", (1 << 56) - 1)])
def test_an_address(text, value):
    assert read({"a": text, "b": [text]}, lambda top: (top.address("a"), top.addresses("b"))) == ((value, (value,)), [])


@pytest.mark.parametrize("text", [f"{1 << 56:x}", "-1", "g", "", 5, None])
def test_what_is_no_address(text):
    found, faults = read({"a": text}, lambda top: top.address("a"))
    assert (found, len(faults)) == (0, 1)
    assert faults[0][1].endswith(", no address")


def test_a_member_that_is_not_there_is_reported_once():
    for use in ("number", "rational", "address", "text", "duration", "object", "addresses", "objects"):
        _, faults = read({}, lambda top, use=use: getattr(top, use)("n"))
        assert faults == ([] if use == "object" else [("", 'lacks "n"')]), use
    assert read({}, lambda top: list(top.named("n"))) == ([], [("", 'lacks "n"')])


def test_texts_and_durations():
    data = {"t": "a", "d": "5ms", "e": "5", "l": ["a", 1, "b"], "n": 1}
    assert read(data, lambda top: (top.text("t"), top.duration("d"), top.texts("l"))) == (
        ("a", milliseconds(5), ("a", "b")),
        [],
    )
    assert read(data, lambda top: top.text("n")) == ("", [("", '"n" is 1, no text')])
    found, faults = read(data, lambda top: top.duration("e"))
    assert (found, faults[0][1].startswith("\"e\": '5' is not a duration")) == (ZERO, True)


def test_faults_have_the_path_of_their_object():
    data = {"units": [{"n": 1}, {"n": "x"}], "dma": {"n": "x"}, "by": {"one": {"n": "x"}, "two": 5}}
    assert read(data, lambda top: [each.number("n") for each in top.objects("units")])[1][0][0] == "units[1]"
    assert read(data, lambda top: top.object("dma").number("n"))[1][0][0] == "dma"
    found, faults = read(data, lambda top: [(name, each.names()) for name, each in top.named("by")])
    assert (found, faults) == ([("one", ["n"]), ("two", [])], [('by "two"', "is no object")])
    assert read(data, lambda top: (top.is_object("dma"), top.is_object("units"), top.has("units"), top.has("x"))) == (
        (True, False, True, False),
        [],
    )


def test_a_long_value_is_cut():
    _, faults = read({"n": "x" * 100}, lambda top: top.number("n"))
    assert faults[0][1] == f'"n" is \'{"x" * 39}, no whole number from 0 to {1 << 62}'
