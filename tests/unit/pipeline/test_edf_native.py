"""The structs that the simulation in C and Python share have the same fields, in the same order."""

import re

import pytest

from halpipe.core.libraries import words
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.edf import native
from halpipe.pipeline.solve.edf.plans import allowed_ways, first_plan
from halpipe.pipeline.solve.edf.works import works_of
from support import model, task, version

HEADER = (native.SOURCES / "system.h").read_text()


def fields_of(struct):
    """The names of the fields that the header declares."""
    [body] = re.findall(r"typedef struct \{([^}]*)\} " + struct + ";", HEADER)
    declared = re.sub(r"/\*.*?\*/", "", body, flags=re.DOTALL).replace("*", " ").split(";")
    return [name.split()[-1] for line in declared for name in line.split(",") if name.strip()]


@pytest.fixture(scope="module")
def sides():
    owner = model(task("a", 5, version("v", 1), slack=1), task("b", 20, version("w", 10), slack=1))
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, natural_tick(expansion))
    system = native.System(mode, 8)
    told = native.Told(system, first_plan(mode, allowed_ways(mode, {})), 1)
    return {"System": system, "Plan": told, "Memory": native.Memory(system, told, native.FIRST_ROOM)}


@pytest.mark.parametrize("struct", ["System", "Plan", "Memory"])
def test_both_sides_have_the_same_fields(sides, struct):
    assert list(sides[struct].fields) == fields_of(struct)


def test_what_python_reads_is_where_it_looks(sides):
    names = list(sides["Memory"].fields)
    places = {"lack": native.LACK, "begin": native.BEGIN, "end": native.END, "part_count": native.PART_COUNT}
    assert {name: names.index(name) for name in places} == places


@pytest.mark.parametrize(
    ("struct", "size"),
    [
        ("Job", native.JOB_WORDS),
        ("Event", native.EVENT_WORDS),
        ("Part", native.PART_WORDS),
        ("Held", native.CLAIM_WORDS),
    ],
)
def test_records_are_as_long_as_python_thinks(struct, size):
    assert len(fields_of(struct)) == size


def test_what_lacks_has_a_bit_for_each_room(sides):
    [bits] = re.findall(r"enum \{ (EVENTS[^}]*) \}", HEADER)
    named = [(name.strip().lower(), int(value)) for name, value in (bit.split("=") for bit in bits.split(","))]
    assert named == [(name, 1 << place) for place, name in enumerate(native.FIRST_ROOM)]
    memory = sides["Memory"]
    memory.words[native.LACK] = 5
    assert memory.lacks_room == ("events", "parts")


def test_no_field_is_left_out_of_the_words(sides):
    for side in sides.values():
        assert len(words(side.fields.values())) == len(side.fields)
