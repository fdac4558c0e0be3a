"""One option through its three doors: command line, pipeline file, Python; and what users read of it."""

from dataclasses import fields
from fractions import Fraction
from pathlib import Path

import pytest

from halpipe.core.diagnostics import Exit, Findings, HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files.yaml import parse_yaml
from halpipe.core.options import (
    EMPTY,
    Form,
    OptionError,
    cpu_number,
    file_name,
    from_command,
    from_fields,
    from_keywords,
    one_line,
    option,
    options_of,
    positive_duration,
    specific,
    time_limit_of,
)
from halpipe.core.quantities import parse_share, whole
from halpipe.core.records import record
from halpipe.core.samples import quantile, quantile_of, with_margin
from halpipe.core.settings import Fields, Words


@record(kw_only=True)
class Common:
    """Options of every format."""

    name: str = option("", "Name.")
    rest: int = 3


@record(kw_only=True)
class Own(Common):
    """Options with every form."""

    depth: int = option(4, "Depth.", whole(1))
    share: Fraction = option(Fraction(1, 2), "Share.", parse_share, takes=(Fraction,))
    exact: bool = option(True, "Exact.", form=Form.SWITCH)
    quick: bool = option(False, "Quick.", form=Form.SWITCH)
    cpus: dict = option(None, "CPUs.", cpu_number, form=Form.NAMES)
    tasks: tuple = option((), "Tasks.", name="task", form=Form.LIST)
    parts: tuple = option(("a",), "Parts.", Words("a", "b", "c"), form=Form.LIST, splits=True)
    kinds: tuple = option(None, "Kinds.", Words("x", "y"), form=Form.LIST, splits=True, otherwise="all of them")
    folder: str = option("", "Folder.", file_name, is_path=True)
    beside: str = option("", "Own folder.", file_name, name="own-folder", is_path=True)


BY_NAME = {each.name: each for each in options_of(Own)}


def test_defaults_are_shown_as_users_read_them():
    assert {name: each.shown_default for name, each in BY_NAME.items()} == {
        "name": "",
        "depth": "4",
        "share": "1/2",
        "exact": "true",
        "quick": "",
        "cpus": "",
        "task": "",
        "parts": "('a',)",
        "kinds": "all of them",
        "folder": "",
        "own-folder": "",
    }


def test_keywords_of_python_have_the_plural_of_a_list():
    assert (BY_NAME["task"].keywords, BY_NAME["depth"].keywords) == (("tasks", "task"), ("depth",))
    assert (BY_NAME["parts"].keywords, BY_NAME["own-folder"].keywords) == (("parts",), ("own_folder",))
    assert (BY_NAME["parts"].words, BY_NAME["kinds"].words, BY_NAME["depth"].words) == (
        ("a", "b", "c"),
        ("x", "y", "none"),
        (),
    )


# ------------------------------------------------------------------------------------------------ three doors

ON_COMMAND = {each.attribute: None for each in options_of(Own)} | {"exact": True, "quick": False}


def test_what_the_command_line_does_not_state_is_the_default():
    assert from_command(Own, ON_COMMAND) == {each.attribute: each.default for each in options_of(Own)}


@pytest.mark.parametrize(
    ("attribute", "text", "value"),
    [
        ("depth", "7", 7),
        ("share", "25%", Fraction(1, 4)),
        ("exact", False, False),
        ("cpus", "u=2, w=3", {"u": 2, "w": 3}),
        ("cpus", "a=b=2", {"a=b": 2}),
        ("tasks", ["t", "s"], ("t", "s")),
        ("tasks", "t", ("t",)),
        ("parts", ["a, b", "c"], ("a", "b", "c")),
        ("kinds", ["none"], ()),
        ("folder", "a/b", "a/b"),
    ],
)
def test_a_text_of_the_command_line_is_read(attribute, text, value):
    assert from_command(Own, ON_COMMAND | {attribute: text})[attribute] == value


@pytest.mark.parametrize(
    ("attribute", "text", "said"),
    [
        ("depth", "0", "is too small"),
        ("depth", " ", EMPTY),
        ("name", "a\nb", "has control characters"),
        ("cpus", "u", "'u' is no name with its value; write core1=2,core2=3"),
        ("cpus", "=2", "is no name with its value"),
        ("cpus", "u=1,u=2", "'u' is named twice; name it once"),
        ("parts", ["a", "b,a"], "'a' is named twice; name it once"),
        ("parts", ["a,"], EMPTY),
        ("parts", ["none"], "'none' is not known"),
        ("kinds", ["x,none"], "'none' is not known"),
    ],
)
def test_a_text_that_an_option_cannot_have_names_it(attribute, text, said):
    with pytest.raises(OptionError) as refused:
        from_command(Own, ON_COMMAND | {attribute: text})
    assert refused.value.option.attribute == attribute
    assert said in str(refused.value)


def read(text):
    findings = Findings()
    stated = Fields("p.yaml", findings, parse_yaml(text.encode(), "p.yaml"), "step", tuple(BY_NAME))
    return from_fields(Own, stated, "base"), [(d.at.line, d.message) for d in findings.items]


def test_a_pipeline_file_states_values_and_paths_relative_to_it():
    text = "depth: 7\nexact: false\ncpus: {u: 2}\ntask: [t, s]\nparts: [b, c]\nkinds: none\nfolder: x\n"
    values, findings = read(text)
    assert findings == []
    assert {each.attribute: values[each.attribute] for each in options_of(Own)} == values
    stated = {"depth": 7, "exact": False, "cpus": {"u": 2}, "tasks": ("t", "s"), "parts": ("b", "c"), "kinds": ()}
    assert {name: values[name] for name in stated} == stated
    assert values["folder"] == str(Path("base", "x"))
    assert (values["quick"], values["name"], values["share"]) == (False, "", Fraction(1, 2))


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("name: a\ndepth: 0\n", 2, "too small"),
        ("name: ''\n", 1, "the text is empty"),
        ("parts: [a, a]\n", 1, "named twice"),
        ("quick: 3\n", 1, "quick"),
    ],
)
def test_a_value_of_a_pipeline_file_is_refused_at_its_line(text, line, said):
    values, ((at, message),) = read(text)
    assert at == line
    assert said in message
    assert values["depth"] == 4


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ({"depth": 7}, {"depth": 7}),
        ({"depth": "7", "name": None}, {"depth": 7, "name": ""}),
        ({"share": Fraction(1, 3)}, {"share": Fraction(1, 3)}),
        ({"share": 1}, {"share": Fraction(1)}),
        ({"cpus": {"u": 2}}, {"cpus": {"u": 2}}),
        ({"cpus": "u=2"}, {"cpus": {"u": 2}}),
        ({"tasks": ["t", "s"]}, {"tasks": ("t", "s")}),
        ({"task": "t"}, {"tasks": ("t",)}),
        ({"parts": iter("ab")}, {"parts": ("a", "b")}),
        ({"folder": Path("a")}, {"folder": "a"}),
        ({"quick": True}, {"quick": True}),
    ],
)
def test_python_gives_values_or_texts_that_stand_for_them(given, values):
    assert from_keywords("f", Own, given) == values


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"quick": 1}, "f(), quick: 1 is no switch"),
        ({"folder": 3}, "f(), folder: '3' is no file name but a int"),
        ({"depth": [1]}, "f(), depth: '[1]' is a list"),
        ({"depth": True}, "f(), depth: 'True' is a bool"),
        ({"depth": 0}, "f(), depth: '0' is too small"),
    ],
)
def test_a_value_of_python_that_an_option_cannot_have_is_refused(given, said):
    with pytest.raises(HalpipeError) as refused:
        from_keywords("f", Own, given)
    assert refused.value.exit is Exit.USAGE
    assert [d.message for d in refused.value.diagnostics] == [said]


def test_a_required_list_may_have_either_of_its_names():
    @record(kw_only=True)
    class Needs:
        files: tuple = option((), "Files.", name="file", form=Form.LIST, required=True)

    for name in ("file", "files"):
        assert from_keywords("f", Needs, {name: ["a"]}) == {"files": ("a",)}
    with pytest.raises(TypeError, match=r"f\(\) requires the option 'files'"):
        from_keywords("f", Needs, {})


def test_a_value_of_the_type_is_taken_as_it_is():
    share = Fraction(5, 4)
    assert from_keywords("f", Own, {"share": share})["share"] is share


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"dept": 1}, "f() has no option 'dept'; did you mean \"depth\"?"),
        ({"tasks": "a", "task": "b"}, "f() got tasks and task; give one"),
    ],
)
def test_a_keyword_that_is_none_is_refused_as_python_does(given, said):
    with pytest.raises(TypeError) as refused:
        from_keywords("f", Own, given)
    assert str(refused.value) == said


def test_common_options_become_those_of_a_format():
    own = Own(name="n", depth=9)
    assert specific(Own, own) is own
    made = specific(Own, Common(name="n", rest=5))
    assert (made.name, made.rest, made.depth) == ("n", 5, 4)
    assert len(fields(made)) == 12


# ------------------------------------------------------------------------------------------------ single values


@pytest.mark.parametrize(
    ("reader", "text", "value"),
    [
        (file_name, "a", "a"),
        (file_name, "", "the file name is empty"),
        (one_line, "a ~", "a ~"),
        (one_line, "a\x1f", "has control characters"),
        (one_line, "a\x7f", "has control characters"),
        (positive_duration, "1ns", Duration(1)),
        (positive_duration, "0ms", "must be longer than 0"),
        (time_limit_of, "2", Duration(2 * 10**9)),
        (time_limit_of, "2ms", Duration(2 * 10**6)),
        (time_limit_of, "0", None),
        (time_limit_of, "0ms", None),
        (cpu_number, "0", 0),
        (cpu_number, "9999", 9999),
        (cpu_number, "10000", "is too large"),
        (quantile_of, "1", Fraction(1)),
        (quantile_of, "0", "is no quantile"),
        (quantile_of, "101%", "is no quantile"),
    ],
)
def test_a_value_is_read_or_refused(reader, text, value):
    if not isinstance(value, str) or value == text:
        assert reader(text) == value
        return
    with pytest.raises(ValueError, match=value):
        reader(text)


@pytest.mark.parametrize(
    ("share", "sample"), [("0", 10), ("1/4", 10), ("0.26", 20), ("1/2", 20), ("3/4", 30), ("0.99", 40), ("1", 40)]
)
def test_a_quantile_is_the_smallest_sample_that_so_many_do_not_exceed(share, sample):
    assert quantile([10, 20, 30, 40], Fraction(share)) == sample


def test_a_margin_is_rounded_up_to_whole_nanoseconds():
    assert with_margin(10, Fraction(1, 10)) == Duration(11)
    assert with_margin(11, Fraction(1, 10)) == Duration(13)
    assert with_margin(Fraction(21, 2), Fraction(0)) == Duration(11)
