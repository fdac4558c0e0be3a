"""Files that people do not edit: values by name and type, at their limits, and every fault with its path."""

from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.files import parse_json, parse_yaml
from halpipe.core.quantities import parse_rational, whole
from halpipe.core.settings import BAD_VALUE, MISSING_KEY, Fields


def read(text, use):
    """Return the value that a use of the mapping gives, and what was wrong: paths and messages."""
    findings = Findings()
    top = Fields.sealed(text.encode(), "t.json", findings, BAD_VALUE, "write it again")
    value = use(top)
    assert all((d.code, d.help, d.at.file) == (BAD_VALUE.id, "write it again", "t.json") for d in findings.items)
    return value, [(str(d.path), d.message) for d in findings.items]


@pytest.mark.parametrize("text", ["[1]", "7", '"a"', "null"])
def test_a_document_that_is_no_mapping(text):
    assert read(text, list) == ([], [("", "is no mapping")])


@pytest.mark.parametrize("text", ["{", "", "[" * 100_000])
def test_a_text_that_is_no_json(text):
    value, [(_, message)] = read(text, list)
    assert value == []
    assert message.startswith("is no JSON: ")


def test_bytes_that_are_no_text():
    with pytest.raises(ValueError, match="is no JSON"):
        parse_json(b"\xff")


def test_a_key_is_stated_once():
    assert read('{"a": 1, "b": [{"c": 1, "c": 1}]}', list)[1] == [("", 'is no JSON: the key "c" is repeated')]


def test_numbers_are_read_exactly():
    fractions = read('{"a": 0.1, "c": 3}', lambda top: [top.value(key, parse_rational, None) for key in "ac"])
    assert fractions == ([Fraction(1, 10), 3], [])
    assert read('{"b": NaN}', lambda top: top.value("b", parse_rational, 5))[0] == 5


@pytest.mark.parametrize(
    ("value", "wrong"),
    [
        ("3", ""),
        ("7", ""),
        ("2", "from 3 to 7"),
        ("8", "from 3 to 7"),
        ("5.5", "from 3 to 7"),
        ("-4", "from 3 to 7"),
        ("true", "is true or false; it must be a whole number from 3 to 7"),
        ('"5"', "is the text '5'; it must be a whole number from 3 to 7"),
        ("null", "is empty; it must be a whole number from 3 to 7"),
        ("[5]", "is a list; it must be a whole number from 3 to 7"),
        ("9" * 5000, "from 3 to 7"),
    ],
)
def test_a_whole_number_in_its_range(value, wrong):
    found, faults = read(f'{{"n": {value}}}', lambda top: top.number("n", 3, 7))
    assert found == (3 if wrong else int(value))
    assert [message.endswith(wrong) and len(message) < 200 for _, message in faults] == ([True] if wrong else [])


@pytest.mark.parametrize("use", ["number", "text", "part", "items", "texts", "entries"])
def test_a_member_that_is_not_there_is_reported_once(use):
    def run(top):
        found = getattr(top, use)(*(("n", str) if use == "texts" else ("n",)))
        return list(found) if use in ("items", "entries", "part") else found

    assert read("{}", run)[1] == [("", 'lacks the key "n"')]


def test_texts_and_mappings_of_the_wrong_type():
    text = '{"t": "a", "l": ["a", {}, "b"], "m": {}, "one": "x"}'
    assert read(text, lambda top: (top.text("t"), top.text("m")))[0] == ("a", "")
    found, faults = read(text, lambda top: [word.value for word in top.texts("l", str)])
    assert (found, faults) == (["a", "b"], [("", '"l" is a mapping; it must be a text')])
    assert read(text, lambda top: list(top.items("m")))[1] == [("", '"m" is a mapping; it must be a list')]
    assert read(text, lambda top: list(top.part("one")))[1][0][1].startswith("\"one\" is the text 'x'; it must be a ")


def test_faults_have_the_path_of_their_mapping():
    text = '{"units": [{"n": 1}, {"n": "x"}], "dma": {"n": "x", "in": {"n": "y"}}, "by": {"one": {"n": "x"}, "two": 5}}'
    assert read(text, lambda top: [each.number("n") for each in top.items("units")])[1][0][0] == "units[1]"
    assert read(text, lambda top: top.part("dma").number("n"))[1][0][0] == "dma"
    assert read(text, lambda top: top.part("dma").part("in").number("n"))[1][0][0] == "dma in"
    found, faults = read(text, lambda top: [(name, list(each)) for name, each, _ in top.entries("by")])
    assert (found, faults[0][0]) == ([("one", ["n"])], "by")
    assert "\"two\" is '5'; it must be a mapping" in faults[0][1]
    assert read(text, lambda top: [each.number("n") for _, each, _ in top.entries("by")])[1][0][0] == 'by "one"'


def test_a_text_of_json_and_what_is_not_there_have_no_lines():
    data = parse_json(b'\n{"l": [1, {}],\n"m": {}}')
    assert (data.line, data["l"].line, data["l"].lines, data["m"].line) == (0, 0, [0, 0], 0)
    findings = Findings()
    for file in ("t.json", "t.yaml"):
        part = Fields.sealed(b"{}", file, findings, BAD_VALUE, "write it again").part("m")
        part.number("n")
    assert [(d.at.file, d.at.line, str(d.path)) for d in findings.items] == [
        ("t.json", 0, ""),
        ("t.json", 0, "m"),
        ("t.yaml", 1, ""),
        ("t.yaml", 0, "m"),
    ]


@pytest.mark.parametrize(
    ("text", "help"),
    [
        ("a 3:\n", 'write "a: 3"'),
        ("c 3:\n", "put lists in brackets: [a, b]"),
        ("a:\nx:\n", "put lists in brackets: [a, b]"),
        ("other 3: 4\n", "it may have: a, bb"),
        ("n:\n", 'move it into "a": a: {n: ...}'),
    ],
)
def test_what_is_no_key_has_the_advice_that_fits(text, help):
    findings, data = Findings(), parse_yaml(text.encode(), "f.yaml")
    Fields("f.yaml", findings, data, "top", ("a", "bb"), {"a": ("n",)})
    assert [d.help for d in findings.items] == [help]


def test_a_long_value_is_cut():
    _, [(_, message)] = read('{"n": "%s"}' % ("x" * 500), lambda top: top.number("n"))
    assert len(message) < 200


def test_nothing_is_computed_from_required_values_with_faults():
    def total(top):
        one, other = (top.required(key, whole(0)) for key in "ab")
        top.stop_on_errors()
        return one + other

    assert read('{"a": 3, "b": 4}', total) == (7, [])
    with pytest.raises(HalpipeError) as caught:
        read('{"a": "x"}', total)
    wrong, lacking = (d.message for d in caught.value.diagnostics)
    assert "is no whole number" in wrong
    assert lacking == 'lacks the key "b"'


def test_faults_of_required_values_that_people_edit_are_collected():
    findings, data = Findings(), parse_yaml(b"a: x\nc: 3\n", "f.yaml")
    top = Fields("f.yaml", findings, data, "top")
    assert [top.required(key, whole(0)) for key in "abc"][2:] == [3]
    assert [(d.code, d.at.line) for d in findings.items] == [(BAD_VALUE.id, 1), (MISSING_KEY.id, 1)]
