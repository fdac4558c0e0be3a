"""What the writers write, the readers read back: equal values, the same bytes again, valid for two validators."""

import inspect
from functools import cache
from importlib import resources
from io import BytesIO

import pytest
import xmlschema
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

import strategies
from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models.system import Element
from profiles import examples

FAST = examples(40)
FEW = examples(10)


def schema_root(kind):
    """The schema without its keys: names dangle and repeat in arbitrary models."""
    root = etree.fromstring(resources.files("halpipe.schemas").joinpath(f"{kind}-1.xsd").read_bytes())
    for constraint in list(root.iter("{*}key", "{*}keyref")):
        constraint.getparent().remove(constraint)
    return root


@cache
def libxml2(kind):
    return etree.XMLSchema(schema_root(kind))


@cache
def independent(kind):
    return xmlschema.XMLSchema10(etree.tostring(schema_root(kind), encoding="unicode"))


def form_errors(kind, data):
    """What both validators find."""
    schema = libxml2(kind)
    schema.validate(etree.fromstring(data))
    return [e.message for e in schema.error_log] + [e.reason for e in independent(kind).iter_errors(BytesIO(data))]


@FAST
@given(strategies.task_models)
def test_a_model_comes_back_as_it_was(model):
    data = format_model(model)
    again = parse_model(data, "m.xml")
    assert again == model
    assert format_model(again) == data


@FAST
@given(strategies.schedules)
def test_a_schedule_comes_back_as_it_was(schedule):
    data = format_schedule(schedule)
    again = parse_schedule(data, "s.xml")
    assert again == schedule
    assert format_schedule(again) == data


@FEW
@given(strategies.task_models)
def test_both_validators_accept_a_written_model(model):
    assert form_errors("task-model", format_model(model)) == []


@FEW
@given(strategies.schedules)
def test_both_validators_accept_a_written_schedule(schedule):
    assert form_errors("schedule", format_schedule(schedule)) == []


def made_anew(value):
    """Return a value whose elements were made by their classes, which give their fields the types that they state."""
    if isinstance(value, tuple):
        return tuple(map(made_anew, value))
    if not isinstance(value, Element):
        return value
    return type(value)(**{name: made_anew(getattr(value, name)) for name in inspect.signature(type(value)).parameters})


@FAST
@given(strategies.task_models)
def test_what_is_read_has_the_types_that_its_class_states(model):
    """The reader makes elements without asking their classes. `repr` tells 1 from Fraction(1), a text from a word."""
    again = parse_model(format_model(model), "m.xml")
    assert repr(made_anew(again)) == repr(again)


def places(value):
    """Yield the place of every element of a model or schedule that has one."""
    if isinstance(value, tuple):
        for item in value:
            yield from places(item)
    elif hasattr(value, "__dataclass_fields__") and not isinstance(value, Location):
        yield from (getattr(value, name) for name in value.__dataclass_fields__ if name == "at")
        for name in value.__dataclass_fields__:
            yield from places(getattr(value, name))


@FAST
@given(strategies.task_models, st.sampled_from([b"", b"\n" * 70_000]))
def test_every_element_knows_the_line_it_stands_on(model, blank_lines):
    """With blank lines before the tasks, all that follows stands where libxml2 alone is off by a line or more."""
    data = format_model(model).replace(b"  <tasks", blank_lines + b"  <tasks", 1)
    lines = data.decode().split("\n")
    again = parse_model(data, "m.xml")
    tags = {
        "units": "<unit ",
        "resources": "<resource ",
        "tasks": "<task ",
        "chains": "<chain ",
        "modes": "<mode ",
        "transitions": "<transition ",
    }
    for section, tag in tags.items():
        for element in getattr(again, section):
            line = lines[element.at.line - 1].lstrip()
            assert line.startswith(tag)
            assert f'"{element.name if hasattr(element, "name") else element.source}"' in line
    assert all(lines[place.line - 1].lstrip().startswith("<") for place in places(again))


def refusal(data):
    """Why a file is refused; None where it is read. Any other exception fails the test."""
    try:
        parse_model(data, "m.xml")
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
        return refused.diagnostics
    return None


@examples(60)
@given(strategies.task_models, st.data())
def test_a_damaged_file_is_refused_or_read_but_never_fails(model, data):
    """Bytes of a good file are replaced, dropped or doubled; the reader either accepts or explains."""
    content = bytearray(format_model(model))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    for found in refusal(bytes(content)) or ():
        assert (found.at.file, bool(found.message)) == ("m.xml", True)
        assert found.at.line > 0


@pytest.mark.parametrize("attribute", ["name", "period"])
@FEW
@given(value=strategies.xml_texts)
def test_any_text_in_an_attribute_is_read_or_explained(attribute, value):
    root = etree.Element("{urn:halpipe:task-model:1}task-model", name="m")
    for section in ("platform", "tasks", "modes"):
        etree.SubElement(root, "{urn:halpipe:task-model:1}" + section)
    etree.SubElement(root[1], "{urn:halpipe:task-model:1}task", {"name": "t", attribute: value})
    for found in refusal(etree.tostring(root)) or ():
        assert found.code == "HAL0102"
        assert found.at.line == 1
