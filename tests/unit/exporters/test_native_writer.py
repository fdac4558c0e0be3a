"""The writers of halpipe's own XML: canonical bytes, defaults left out, and nothing that could not be read back."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.native import format_model, format_schedule
from halpipe.exporters.native.document import UNWRITABLE
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models import Access, Chain, Origin, Run, Source, TaskModel, Transfer, Unit, Version
from support import access, after, chain, job, model, schedule, task, version

FIXTURES = Path(__file__).parents[1] / "importers" / "native_fixtures"
TASK = task("t", "25ms", version("v", "5ms", "u1", access("r", 0, 1), after("t", 1, 2)))
SYSTEM = model(TASK, resources="r", chains=[chain("c", "t t", reaction="9ms")])


def refusal(write, value):
    with pytest.raises(HalpipeError) as refused:
        write(value)
    assert all(d.code == UNWRITABLE.id and d.help for d in refused.value.diagnostics)
    return refused.value.diagnostics


def with_version(**changes):
    return replace(SYSTEM, tasks=(replace(TASK, versions=(replace(TASK.versions[0], **changes),)),))


def test_the_bytes_of_a_model_are_canonical():
    assert format_model(SYSTEM).decode() == (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<task-model xmlns="urn:halpipe:task-model:1" name="m">\n'
        "  <platform>\n"
        '    <unit name="u1"/>\n'
        '    <resource name="r"/>\n'
        "  </platform>\n"
        "  <tasks>\n"
        '    <task name="t" period="25ms">\n'
        '      <version name="v" wcet="5ms">\n'
        '        <units names="u1"/>\n'
        '        <access resource="r" start="0ms" end="1ms" bound="1"/>\n'
        '        <precedence task="t" from="start" min="1ms" max="2ms"/>\n'
        "      </version>\n"
        "    </task>\n"
        "  </tasks>\n"
        "  <chains>\n"
        '    <chain name="c" tasks="t t" max-reaction="9ms"/>\n'
        "  </chains>\n"
        "  <modes>\n"
        '    <mode name="all">\n'
        '      <run task="t" versions="v"/>\n'
        "    </mode>\n"
        "  </modes>\n"
        "</task-model>\n"
    )


def test_the_bytes_of_a_schedule_are_canonical():
    plan = schedule(SYSTEM, "25ms", job(SYSTEM, "t", 0, "1/3ms", "u1"))
    assert format_schedule(plan).decode() == (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<schedule xmlns="urn:halpipe:schedule:1" model="m" model-sha256="">\n'
        '  <mode name="all" hyperperiod="25ms" status="valid">\n'
        '    <job task="t" index="0" start="1000/3us" end="16/3ms" version="v" units="u1"/>\n'
        "  </mode>\n"
        "</schedule>\n"
    )


@pytest.mark.parametrize(
    ("file", "parse", "write"),
    [
        ("everything.model.xml", parse_model, format_model),
        ("everything.schedule.xml", parse_schedule, format_schedule),
    ],
)
def test_every_element_and_attribute_is_written(file, parse, write):
    """The fixtures hold every element and attribute of the schemas (test_native_model.py sees to that)."""
    value = parse((FIXTURES / file).read_bytes(), file)
    data = write(value)
    assert parse(data, file) == value
    assert write(parse(data, file)) == data


def test_the_smallest_model_is_written():
    assert parse_model(format_model(TaskModel(name="m")), "m.xml") == TaskModel(name="m")


def test_a_gang_without_units_is_kept():
    again = parse_model(format_model(with_version(units=(), gang=4)), "m.xml")
    assert (again.tasks[0].versions[0].units, again.tasks[0].versions[0].gang) == ((), 4)


def test_texts_keep_every_character_that_xml_has():
    origin = Origin("a\tb\nc\rd <&>\"' ü\u00a0\u2028\U0001f600.arxml", 3, " /x  y/ ")
    assert parse_model(format_model(replace(SYSTEM, origin=origin)), "m.xml").origin == origin


@pytest.mark.parametrize("character", ["\x00", "\x1b", "\udce9", "\uffff"])
def test_characters_that_xml_lacks_are_replaced_in_texts(character):
    """A file name may hold them; the model must not be lost for that."""
    written = format_model(replace(SYSTEM, origin=Origin(f"caf{character}.arxml", 1, character)))
    assert parse_model(written, "m.xml").origin == Origin("caf\ufffd.arxml", 1, "\ufffd")


@pytest.mark.parametrize("name", ["", "a b", "tab\t", "ü", "x" * 1001, "a*", "\x00", "\udce9"])
def test_what_is_no_name_is_not_written(name):
    found = refusal(format_model, replace(SYSTEM, units=(Unit(name=name), *SYSTEM.units)))
    assert "Element 'unit', attribute 'name'" in found[0].message


@pytest.mark.parametrize(
    "broken",
    [
        pytest.param(with_version(units=("u 1",)), id="unit with a blank"),
        pytest.param(with_version(units=("",)), id="empty unit"),
        pytest.param(with_version(source=Source(files=("my file.c",), entry="f")), id="file with a blank"),
        pytest.param(with_version(source=Source(files=(), entry="f")), id="no files"),
        pytest.param(with_version(source=Source(files=("f.c",), entry="f", defines=("A=\nB",))), id="line feed"),
        pytest.param(with_version(gang=-1), id="negative gang"),
        pytest.param(with_version(wcet=Duration(-1)), id="negative time"),
        pytest.param(with_version(wcet=Duration(Fraction(1, 10**31 + 1))), id="too many digits"),
        pytest.param(with_version(accesses=(access("r", 0, 1, Fraction(-1, 3)),)), id="negative bound"),
        pytest.param(replace(SYSTEM, chains=(Chain(name="c", tasks=()),)), id="chain without tasks"),
        pytest.param(
            replace(SYSTEM, modes=(replace(SYSTEM.modes[0], runs=(Run(task="t", versions=()),)),)), id="empty run"
        ),
        pytest.param(
            with_version(
                accesses=(
                    Access(
                        resource="r",
                        start=Duration(0),
                        end=Duration(1),
                        transfers=(Transfer(buffer="b", symbol="s", size=-1),),
                    ),
                )
            ),
            id="negative size",
        ),
    ],
)
def test_what_could_not_be_read_back_is_not_written(broken):
    assert refusal(format_model, broken)


def test_everything_that_cannot_be_written_is_told():
    broken = replace(with_version(gang=-1), units=(Unit(name="a b"), Unit(name="c d")))
    messages = [d.message for d in refusal(format_model, broken)]
    assert [any(words in m for m in messages) for words in ("'a b'", "'c d'", "'gang'")] == [True] * 3


def test_a_schedule_that_could_not_be_read_back_is_not_written():
    plan = schedule(SYSTEM, "25ms", job(SYSTEM, "t", 0, "1ms", "u1"))
    assert refusal(format_schedule, replace(plan, model="a b"))
    assert refusal(format_schedule, replace(plan, model_sha256="beef"))
    assert refusal(format_schedule, schedule(SYSTEM, Duration(Fraction(1, 3**2200)), *plan.modes[0].jobs))
    assert refusal(format_schedule, schedule(SYSTEM, "25ms", replace(plan.modes[0].jobs[0], units=("u1 u2",))))


def test_the_digest_and_the_places_are_no_part_of_the_file():
    read = parse_model(format_model(SYSTEM), "somewhere/else.xml")
    assert format_model(read) == format_model(SYSTEM)
    assert read.digest != SYSTEM.digest


def test_a_version_without_anything_is_written():
    bare = replace(SYSTEM, tasks=(replace(TASK, versions=(Version(name="v"),)),))
    assert b'<version name="v"/>' in format_model(bare)
