"""The reader of task models: every element and attribute, and human words for what is wrong."""

from fractions import Fraction
from importlib import resources
from pathlib import Path

import pytest
from lxml import etree

from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.core.durations import Duration
from halpipe.core.files import sha256
from halpipe.importers.native import parse_model, read_model
from halpipe.models import (
    Access,
    AccessKind,
    Anchor,
    Binding,
    Chain,
    Edge,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Match,
    Mode,
    Origin,
    Precedence,
    Resource,
    ResourceKind,
    Run,
    Source,
    Split,
    Task,
    TaskModel,
    Transfer,
    Transition,
    Unit,
    Version,
)

FIXTURE = Path(__file__).parent / "native_fixtures" / "everything.model.xml"
EMPTY = b'<task-model xmlns="urn:halpipe:task-model:1" name="m"><platform/><tasks/><modes/></task-model>'


def time(text):
    return Duration.parse(text)


SHUTTLE = TaskModel(
    name="shuttle",
    units=(
        Unit(
            name="a72.0",
            type="cortex-a72",
            interrupts=(
                Interrupt(
                    name="can_rx",
                    distance=time("5ms"),
                    wcet=time("500us"),
                    origin=Origin("board.arxml", 9, "/Board/A72/0/CanRx"),
                ),
                Interrupt(name="tick", distance=time("1ms"), wcet=time("10us")),
            ),
            origin=Origin("board.arxml", 7, "/Board/A72/0"),
        ),
        Unit(name="dsp"),
    ),
    resources=(
        Resource(name="ddr", bandwidth=19_200_000_000, origin=Origin("board.arxml")),
        Resource(name="can"),
        Resource(name="spin", kind=ResourceKind.LOCK),
    ),
    tasks=(
        Task(
            name="lidar",
            period=time("100ms"),
            slack=Fraction(1, 3),
            offset=time("500us"),
            deadline=time("80ms"),
            distance=time("120ms"),
            let=time("75ms"),
            binding=Binding.SYSTEM,
            versions=(
                Version(
                    name="full",
                    wcet=time("31250us"),
                    units=("a72.0", "dsp"),
                    gang=2,
                    accesses=(
                        Access(
                            resource="ddr",
                            start=time("0ms"),
                            end=time("2ms"),
                            bound=Fraction(35, 100),
                            kind=AccessKind.LOAD,
                        ),
                        Access(
                            resource="ddr",
                            start=time("2ms"),
                            end=time("100/3ms"),
                            bound=Fraction(1, 3),
                            kind=AccessKind.READ,
                            transfers=(
                                Transfer(buffer="cloud", symbol="lidar_cloud", size=1_500_000),
                                Transfer(buffer="pose", symbol="lidar_pose", size=64),
                            ),
                        ),
                        Access(resource="can", start=time("30ms"), end=time("31ms"), bound=Fraction(1), kind=None),
                    ),
                    precedences=(
                        Precedence(
                            task="odometry",
                            min=time("1ms"),
                            max=time("40ms"),
                            anchor=Anchor.END,
                            origin=Origin("launch.yaml", 12, "/lidar/odometry"),
                        ),
                        Precedence(task="odometry", min=time("0ms"), max=time("90ms"), anchor=Anchor.START),
                        Precedence(
                            task="odometry",
                            max=time("95ms"),
                            anchor=Anchor.POINT,
                            point=time("10us"),
                            to=Anchor.END,
                            match=Match.CYCLE,
                        ),
                    ),
                    source=Source(files=("lidar.c", "filter.c"), entry="lidar_step", defines=("N=4", "FAST")),
                    split=Split(points=(time("4ms"), time("9ms")), resume=time("100us"), max_gaps=2),
                    origin=Origin("timing.csv", 3, "lidar"),
                ),
                Version(
                    name="stub",
                    wcet=None,
                    units=(),
                    gang=1,
                    split=Split(anywhere=True, max_gaps=3, min_part=time("1ms")),
                ),
            ),
            origin=Origin("launch.yaml", 10, "/lidar"),
        ),
        Task(
            name="odometry",
            period=None,
            slack=Fraction(0),
            binding=Binding.MODE,
            versions=(
                Version(
                    name="only",
                    wcet=time("40us"),
                    gang=3,
                    source=Source(files=("odometry.c",), entry="odometry_step"),
                ),
            ),
        ),
    ),
    chains=(
        Chain(
            name="scan-to-pose",
            tasks=("lidar", "odometry"),
            max_latency=time("150ms"),
            max_reaction=time("250ms"),
            max_age=time("200ms"),
            anchor=Anchor.RELEASE,
            to=Anchor.END,
            weight=Fraction(1, 4),
            origin=Origin("limits.yaml", 4, "chains/0"),
        ),
        Chain(name="unlimited", tasks=("odometry",)),
    ),
    modes=(
        Mode(
            name="drive",
            edge=Edge.CLOSED,
            runs=(Run(task="lidar", versions=("full", "stub")), Run(task="odometry", versions=("only",))),
            origin=Origin("modes.arxml", 20, "/Modes/Drive"),
        ),
        Mode(name="park", runs=()),
    ),
    transitions=(
        Transition(
            source="drive", target="park", max_length=time("50ms"), origin=Origin("modes.arxml", 31, "/Modes/0")
        ),
        Transition(source="park", target="drive"),
    ),
    health=(
        HealthRule(
            task="lidar",
            event=HealthEvent.OVERRUN,
            count=2,
            cycles=4,
            mode="park",
            origin=Origin(file="limits.yaml", line=9, path="health/0"),
        ),
        HealthRule(task="odometry", action=HealthAction.STOP),
    ),
    origin=Origin("shuttle.arxml", 2, "/Shuttle"),
)


def test_every_element_and_attribute_is_read():
    assert read_model(str(FIXTURE)) == SHUTTLE


@pytest.mark.parametrize("kind", ["model", "schedule"])
def test_the_fixture_has_every_element_and_attribute_of_its_schema(kind):
    """So that nothing can be added to a schema and forgotten by the reader, the writer and their tests."""
    artefact = {"model": "task-model", "schedule": "schedule"}[kind]
    schema = etree.fromstring(resources.files("halpipe.schemas").joinpath(f"{artefact}-1.xsd").read_bytes())
    fixture = etree.parse(FIXTURE.parent / f"everything.{kind}.xml")
    xs = "{http://www.w3.org/2001/XMLSchema}"
    assert {e.get("name") for e in schema.iter(xs + "element")} == {
        etree.QName(e).localname for e in fixture.iter(etree.Element)
    }
    types = {t.get("name"): t for t in schema.iter(xs + "complexType")}
    for element in schema.iter(xs + "element"):
        declared = types[element.get("type")] if element.get("type") else element.find(xs + "complexType")
        used = {name for e in fixture.iter(f"{{*}}{element.get('name')}") for name in e.attrib}
        assert {a.get("name") for a in declared.findall(xs + "attribute")} <= used, element.get("name")


def test_every_element_knows_its_line():
    model = read_model(str(FIXTURE))
    task = model.task("lidar")
    full = task.version("full")
    lines = FIXTURE.read_text().splitlines()
    for element, tag in [
        (model, "<task-model "),
        (model.units[1], '<unit name="dsp"'),
        (model.resources[0], '<resource name="ddr"'),
        (task, '<task name="lidar"'),
        (full, '<version name="full"'),
        (full.accesses[1], '<access resource="ddr" start="2ms"'),
        (full.accesses[1].transfers[1], '<transfer buffer="pose"'),
        (full.precedences[1], '<precedence task="odometry" max="90ms"'),
        (full.source, '<source files="lidar.c'),
        (model.chains[1], '<chain name="unlimited"'),
        (model.modes[1], '<mode name="park"'),
        (model.modes[0].runs[1], '<run task="odometry"'),
        (model.transitions[1], '<transition from="park"'),
        (model.health[1], '<rule task="odometry"'),
    ]:
        assert element.at.file == str(FIXTURE)
        assert lines[element.at.line - 1].strip().startswith(tag)


def test_the_digest_is_that_of_the_file():
    assert read_model(str(FIXTURE)).digest == sha256(FIXTURE.read_bytes())


def test_the_smallest_model_is_read():
    assert parse_model(EMPTY, "m.xml") == TaskModel(name="m")


def test_comments_and_processing_instructions_are_passed_over():
    data = FIXTURE.read_bytes().replace(b"<version", b"<!-- x --><?y?><version").replace(b"<run", b"<!-- x --><run")
    assert parse_model(data, "m.xml") == SHUTTLE


def test_space_that_xml_ignores_is_ignored():
    text = '<task-model xmlns="urn:halpipe:task-model:1" name="m"><platform/><tasks><task name="t" period=" 5ms\n">'
    text += '<version name="v"><units names=" u&#9;v&#10; w " gang=" +2 "/><access resource="r" start="0ms" end="1ms"'
    text += ' bound=" 1/2 " kind=" read "/><source files=" a.c\u00a0b  c.c " entry=" f  g "/></version></task>'
    text += "</tasks><modes/></task-model>"
    (version,) = parse_model(text.encode(), "m.xml").task("t").versions
    assert (version.units, version.gang) == (("u", "v", "w"), 2)
    assert (version.accesses[0].bound, version.accesses[0].kind) == (Fraction(1, 2), AccessKind.READ)
    assert version.source == Source(files=("a.c\u00a0b", "c.c"), entry="f g"), "only XML white space separates"


# ------------------------------------------------------------------------------------------------ violations

VERSION = '<task name="a"><version name="v">{}</version></task>'
ACCESS = VERSION.format('<access resource="r" start="0ms" end="1ms"{}</access>')
TASKS = """\
<task-model xmlns="urn:halpipe:task-model:1" name="m">
<platform/>
<tasks>
{}
</tasks>
<modes/>
</task-model>"""


def refusal(document):
    with pytest.raises(HalpipeError) as refused:
        parse_model(document.encode(), "m.xml")
    return refused.value.diagnostics


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ('<task name="a" period="25"/>', "'period': the value '25' is not a duration: a number and a unit, such as"),
        ('<task name="a" period="-1ms"/>', "the value '-1ms' is not a duration"),
        ('<task name="a" period="1/0ms"/>', "the value '1/0ms' is not a duration"),
        (f'<task name="a" period="{"1" * 31}ms"/>', "is not a duration"),
        (f'<task name="a" period="1.{"1" * 31}ms"/>', "is not a duration"),
        (f'<task name="a" period="{"1" * 50000}"/>', "'111"),
        ('<task name="a" slack="much"/>', "the value 'much' is not a number such as 1, 0.35 or 1/3"),
        ('<task name="a b"/>', "the value 'a b' is not a name: letters, digits and"),
        ('<task name=""/>', "the value '' is not a name"),
        ('<task name="t*"/>', "the value 't*' is not a name"),
        (f'<task name="{"n" * 1001}"/>', "length of '1001'"),
        ("<task/>", "attribute 'name' is required but missing"),
        ('<task name="a" perid="1ms"/>', "attribute 'perid' is not allowed"),
        ('<tsk name="a"/>', "Element 'tsk': This element is not expected. Expected is ( task )"),
        ('<x:task xmlns:x="urn:x" name="a"/>', "Element '{urn:x}task': This element is not expected"),
        ('<task name="a">text</task>', "Character content other than whitespace is not allowed"),
        ('<task name="a"><version name="v"><units names=""/></version></task>', "'names'"),
        ('<task name="a"><version name="v"><units names="u" gang="0.5"/></version></task>', "'gang'"),
        ('<task name="a"><version name="v"><units names="u" gang="1000001"/></version></task>', "maximum value"),
        ('<task name="a"><version name="v"><precedence task="b"/></version></task>', "'max' is required"),
        ('<task name="a"><version name="v"><source files="a.c"/></version></task>', "'entry' is required"),
        (
            ACCESS.format(' kind="fetch">'),
            "'fetch' is not an element of the set {'load', 'read', 'write'}",
        ),
        (
            ACCESS.format('><transfer buffer="b" symbol="s" size="4 TB"/>'),
            "the value '4 TB' is not a size such as 4320B, 64KiB or 1.5MB",
        ),
        ('<task name="a"><origin file="f" line="-1"/></task>', "'-1' is not a valid value"),
        (
            '<task name="a" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:type="my"/>',
            "does not resolve to a type",
        ),
    ],
)
def test_a_violation_is_told_with_its_line_in_plain_words(task, words):
    (found,) = refusal(TASKS.format(task))
    assert (found.code, found.at.file, found.at.line) == ("HAL0102", "m.xml", 4)
    assert words in found.message
    text = render_text(found)
    assert "facet" not in text
    assert "urn:halpipe" not in text
    assert len(text) < 1500


def test_a_misspelt_attribute_is_answered_with_the_one_meant():
    (found,) = refusal(TASKS.format('<task name="a" perid="1ms"/>'))
    assert '"period"' in found.help


def test_all_violations_are_told():
    tasks = '<task name="a" period="x" slack="y" bogus="1"/>\n<task/>\n<task name="b" deadline="z"/>'
    found = refusal(TASKS.format(tasks))
    assert [d.at.line for d in found] == [4, 4, 4, 5, 6]
    assert ["period" in found[0].message, "slack" in found[1].message, "bogus" in found[2].message] == [True] * 3


def test_violations_far_down_a_long_file_keep_their_line():
    found = refusal(TASKS.format("\n" * 70_000 + '<task name="a"\nperiod="x"/>\n<task name="b">\n<tsk/></task>\n'))
    assert [d.at.line for d in found] == [70_005, 70_007]


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("<schedule/>", 'root element "schedule" in no namespace'),
        ('<task-model name="m"/>', 'root element "task-model" in no namespace'),
        ('<task-model xmlns="urn:halpipe:task-model:2" name="m"/>', 'in the namespace "urn:halpipe:task-model:2"'),
        ('<schedule xmlns="urn:halpipe:schedule:1"/>', 'root element "schedule" in the namespace'),
        ("<AUTOSAR/>", 'root element "AUTOSAR"'),
    ],
)
def test_another_kind_of_file_is_told_as_such(document, words):
    (found,) = refusal("\n" + document)
    assert (found.code, found.at.line) == ("HAL0101", 2)
    assert words in found.message
    swapped = "urn:halpipe:schedule:1" in document
    assert ("MODEL first" if swapped else 'expected <task-model xmlns="urn:halpipe:task-model:1">') in found.help


@pytest.mark.parametrize(
    ("document", "line", "expected"),
    [
        ("<platform/>\n<tasks/>\n<chains/>", 1, "modes"),
        ("<tasks/>\n<modes/>", 2, "platform"),
        ("<platform/>\n<modes/>\n<tasks/>", 3, "tasks"),
    ],
)
def test_missing_and_misplaced_sections_are_named(document, line, expected):
    (found,) = refusal(f'<task-model xmlns="urn:halpipe:task-model:1" name="m">\n{document}\n</task-model>')
    assert (found.code, found.at.line) == ("HAL0102", line)
    assert expected in found.message


def test_a_value_of_the_right_form_can_still_be_useless():
    transfer = '<transfer buffer="b" symbol="s" size="0.3B"/>\n<transfer buffer="b" symbol="s" size="0.0001kB"/>'
    found = refusal(TASKS.format(ACCESS.format(f">{transfer}")))
    assert [(d.code, d.at.line, d.path) for d in found] == [
        ("HAL0103", 4, 'transfer attribute "size"'),
        ("HAL0103", 5, 'transfer attribute "size"'),
    ]
    assert "'0.3B' is not a whole number of bytes" in found[0].message


def test_names_that_dangle_or_repeat_are_left_to_validate():
    """Its messages say what was probably meant (HAL0202, HAL0205 to HAL0209)."""
    tasks = '<task name="a"/><task name="a"><version name="v"><units names="nowhere"/>'
    tasks += '<access resource="nothing" start="0ms" end="1ms"/><precedence task="nobody" max="1ms"/></version></task>'
    model = parse_model(TASKS.format(tasks).encode(), "m.xml")
    assert [task.name for task in model.tasks] == ["a", "a"]


def test_an_invalid_file_with_dangling_names_is_refused_for_its_form_only():
    tasks = '<task name="a"><version name="v"><precedence task="nobody" max="1ms"/></version></task>\n<task/>'
    assert [d.at.line for d in refusal(TASKS.format(tasks))] == [5]


def test_what_is_wrong_is_not_explained_by_a_name_that_repeats():
    (finding,) = refusal(TASKS.format('<task name="a"/>\n<task name="a" period="1"/>'))
    assert "not a duration" in finding.message
    assert "duplicate" not in finding.help


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(HalpipeError, match="No such file"):
        read_model(str(tmp_path / "none.xml"))


def test_each_element_knows_its_line():
    from halpipe.starters import first_model

    found = parse_model(first_model()["model.xml"], "m.xml")
    assert (found.at.file, found.tasks[0].at.file) == ("m.xml", "m.xml")
    lines = [each.at.line for each in (*found.units, *found.tasks, *found.modes)]
    assert lines[0] > 0
    assert lines == sorted(set(lines))
