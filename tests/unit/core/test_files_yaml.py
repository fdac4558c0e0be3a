"""The YAML reader: exact text, lines of everything, and bounds on hostile files."""

import subprocess
import sys

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import YamlList, YamlMap, parse_json, parse_yaml
from halpipe.core.files import yaml as files
from halpipe.core.files.yaml import is_shaped


def refusal(data):
    with pytest.raises(HalpipeError) as refused:
        parse_yaml(data, "hostile.yaml")
    (found,) = refused.value.diagnostics
    return found


@pytest.mark.parametrize(
    ("data", "line", "words"),
    [
        pytest.param(b"a: 1\nb: 2\na: 3", 3, 'repeats the key "a"', id="key twice"),
        pytest.param(b"- x\n- {b: 1,\n   b: 2}", 3, 'repeats the key "b"', id="key twice in a flow mapping"),
        pytest.param(b"a: 1\n1: x\n'1': y", 3, 'repeats the key "1"', id="number and text are the same key"),
        pytest.param(b"a:\n\tb: 1", 2, "a tab indents the line", id="tab"),
        pytest.param(b"\n? [a]\n: b", 2, "not plain text", id="list as key"),
        pytest.param(b"\n? {a: b}\n: b", 2, "not plain text", id="mapping as key"),
        pytest.param(b"a: 1\nb: *x", 2, "undefined alias", id="unknown alias"),
        pytest.param(b"a: 1\n---\nb: 2", 2, "another document", id="two documents"),
        pytest.param(b"a: 1\nb: \xe9", 2, "is not text", id="Latin-1"),
        pytest.param(b"\nb: \xe9", 2, "is not text", id="Latin-1 behind an empty line"),
        pytest.param(b"a: 1\nb: \0", 2, "is not text", id="NUL"),
        pytest.param(b"a: 1\nb: \x1b", 2, "is not text", id="control character"),
        pytest.param(b"\n\n<a>\nb: c: d", 1, "is XML", id="XML"),
        pytest.param(b"a: [1,\n", 2, "", id="cut off"),
        pytest.param(b'a: "\n', 2, "unexpected end of stream", id="cut off in a string"),
        pytest.param(b'a: "\\ud800"', 1, "invalid Unicode", id="surrogate"),
        pytest.param(b"\n\n" + b"[" * 70 + b"]" * 70, 3, "nests too deep", id="70 deep"),
        pytest.param(b"a: &a\n  - *a", 1, "nests too deep", id="alias of itself"),
        pytest.param(b"a: &a {b: *a}", 1, "nests too deep", id="mapping of itself"),
    ],
)
def test_broken_yaml_is_refused_at_its_line(data, line, words):
    found = refusal(data)
    assert (found.code, found.at.file, found.at.line) == (files.BROKEN_YAML.id, "hostile.yaml", line)
    assert words in found.message
    assert found.help


@pytest.mark.parametrize(
    ("data", "help"),
    [
        (b"a: 1\na: 2", "remove one of the two"),
        (b"a: *x", "quote names that begin with *"),
        (b"a: [1 2\nb: 3", "close the bracket"),
        (b"a: b: c", 'put one "key: value" in a line'),
        (b"a: \xe9", "save it as UTF-8"),
        (b"a: \x1b", "remove them; a workbook"),
        (b"<a>\nb: c: d", "name a YAML file"),
        (b"? [a]\n: b", "repair the file"),
    ],
)
def test_the_advice_follows_from_the_fault(data, help):
    assert refusal(data).help.startswith(help)


@pytest.mark.parametrize("escape", [b"\\UFFFFFFFF", b"\\U00110000"])
def test_without_libyaml_a_character_that_there_is_not_is_refused_too(monkeypatch, escape):
    monkeypatch.delattr("yaml.CSafeLoader", raising=False)
    files._bounded_loader.cache_clear()
    try:
        found = refusal(b'a: "' + escape + b'"')
        assert parse_yaml(b"a: [x]", "m.yaml") == {"a": ["x"]}
    finally:
        files._bounded_loader.cache_clear()
    assert (found.at.line, found.at.file) == (0, "hostile.yaml")


def test_the_deepest_nesting_allowed_is_read():
    deepest = files.MAX_YAML_DEPTH
    value = parse_yaml(b"[" * deepest + b"x" + b"]" * deepest, "m.yaml")
    for _ in range(deepest):
        (value,) = value
    assert value == "x"
    assert "deep" in refusal(b"[" * (deepest + 1) + b"x" + b"]" * (deepest + 1)).message


@pytest.mark.parametrize("opening", ["[", "{a: ", "- ", "? ", "[{"])
def test_nesting_without_end_neither_crashes_nor_takes_long(opening):
    """In a process of its own, because what is tested is that the process survives."""
    program = "import sys; from halpipe.core.files import parse_yaml\n"
    program += "try: parse_yaml(sys.argv[1].encode() * 300_000, 'f')\n"
    program += "except Exception as e: print(e)"
    command = [sys.executable, "-c", program, opening]
    run = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert (run.returncode, run.stderr) == (0, "")
    assert "nests too deep" in run.stdout


def test_aliases_expand_within_bounds(monkeypatch):
    monkeypatch.setattr(files, "MAX_YAML_NODES", 5000)
    bomb = "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n"
    bomb += "".join(f"a{n}: &a{n} [{','.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 6))
    assert "too many values" in refusal(bomb.encode()).message
    assert parse_yaml(b"a: &a [x, y]\nb: *a", "m.yaml")["b"] == ["x", "y"]


def test_values_are_counted_while_they_are_read(monkeypatch):
    monkeypatch.setattr(files, "MAX_YAML_NODES", 100)
    assert len(parse_yaml(b"- a\n" * 99, "m.yaml")) == 99
    monkeypatch.setattr(files, "_YamlBuilder", None)  # what comes after reading is not reached
    assert "too many values" in refusal(b"- a\n" * 100).message


def test_tags_construct_nothing(tmp_path):
    trace = tmp_path / "trace"
    document = f'a: !!python/object/apply:os.system ["touch {trace}"]\nb: !!python/name:os.system\nc: !mine x'
    value = parse_yaml(document.encode(), "m.yaml")
    assert value == {"a": [f"touch {trace}"], "b": "", "c": "x"}
    assert not trace.exists()


def test_numbers_and_dates_stay_text_as_written():
    document = b"[0.35, 1_000, 0x10, 1e3, .inf, 2020-01-01, 12:30:00, 0.10]"
    assert parse_yaml(document, "m.yaml") == ["0.35", "1_000", "0x10", "1e3", ".inf", "2020-01-01", "12:30:00", "0.10"]


def test_truth_and_nothing_are_told_from_text():
    value = parse_yaml(b"[true, off, 'true', y, ~, null, , 'null', \"~\"]".replace(b", ,", b","), "m.yaml")
    assert value == [True, False, "true", "y", None, None, "null", "~"]


def test_an_empty_document_is_nothing():
    assert parse_yaml(b"", "m.yaml") is None
    assert parse_yaml(b"# only a comment\n", "m.yaml") is None


@pytest.mark.parametrize("data", ["a: é".encode(), b"\xef\xbb\xbf" + "a: é".encode(), "a: é".encode("utf-16")])
def test_unicode_is_read_in_any_of_its_encodings(data):
    assert parse_yaml(data, "m.yaml") == {"a": "é"}


def test_everything_knows_its_line():
    value = parse_yaml(b"# c\ntop:\n  - x\n\n  - y: 1\n    z: 2\nlast: {a: 1,\n  b: 2}\n", "m.yaml")
    assert isinstance(value, YamlMap)
    assert (value.line, value.line_of("top"), value.line_of("last")) == (2, 2, 7)
    items = value["top"]
    assert isinstance(items, YamlList)
    assert (items.line, items.lines) == (3, [3, 5])
    assert (items[1].line_of("y"), items[1].line_of("z")) == (5, 6)
    assert value["last"].line_of("b") == 8
    assert value["last"].line_of("absent") == value["last"].line == 7


def test_only_a_tab_that_indents_is_blamed():
    for text, is_tab in ((b"a: [1\n\tb: 2", True), (b"a: 'x\ty'\nb: [", False)):
        with pytest.raises(HalpipeError) as refused:
            parse_yaml(text, "f.yaml")
        assert ("a tab indents" in refused.value.diagnostics[0].message) is is_tab


def test_of_a_key_that_is_repeated_80_characters_are_quoted():
    for key in ("k" * 80, "k" * 81):
        with pytest.raises(ValueError, match=f'the key "{"k" * 80}" is repeated'):
            parse_json(f'{{"{key}": 1, "{key}": 2}}'.encode())


@pytest.mark.parametrize(
    ("value", "is_right"),
    [
        ({"a": 1, "b": "x"}, True),
        ({"a": 1}, False),
        ({"a": 1, "b": "x", "c": 0}, False),
        ({"a": True, "b": "x"}, False),
        (["a", "b"], False),
        (None, False),
    ],
)
def test_the_shape_of_a_mapping_is_its_keys_and_their_types(value, is_right):
    assert is_shaped(value, {"a": int, "b": str}) == is_right
