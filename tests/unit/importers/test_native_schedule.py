"""The reader of schedules: every element and attribute, and human words for what is wrong."""

from fractions import Fraction
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.importers.native import parse_schedule, read_schedule
from halpipe.models import (
    ChainLatency,
    CostTerms,
    HealthAction,
    HealthEvent,
    Job,
    ModeSchedule,
    Part,
    Reaction,
    ResourceLoad,
    Schedule,
    Status,
    TransitionTable,
    UnitLoad,
)

FIXTURE = Path(__file__).parent / "native_fixtures" / "everything.schedule.xml"


def time(text):
    return Duration.parse(text)


SHUTTLE = Schedule(
    model="shuttle",
    model_sha256="0123456789abcdef" * 4,
    generator="by hand",
    solver="pencil",
    seed=42,
    tick=time("250us"),
    modes=(
        ModeSchedule(
            name="drive",
            hyperperiod=time("100ms"),
            status=Status.VALID,
            margin=Fraction(1, 8),
            margin_bound=Fraction(3, 4),
            jobs=(
                Job(
                    task="lidar",
                    index=0,
                    start=time("500us"),
                    end=time("31750us"),
                    version="full",
                    units=("a72.0", "dsp"),
                ),
                Job(
                    task="odometry",
                    index=1,
                    start=time("99990us"),
                    end=time("102040us"),
                    version="only",
                    units=("dsp",),
                    parts=(
                        Part(
                            start=time("99990us"),
                            end=time("100020us"),
                            executed_from=time("0ms"),
                            executed_to=time("30us"),
                        ),
                        Part(
                            start=time("102030us"),
                            end=time("102040us"),
                            executed_from=time("30us"),
                            executed_to=time("40us"),
                        ),
                    ),
                ),
            ),
            cost=CostTerms(
                total=Fraction(-3, 5),
                overlap=Fraction(1),
                access=Fraction(2, 3),
                precedence=Fraction(3),
                unit=Fraction(4),
                occupancy=Fraction(1, 4),
                timeliness=Fraction(999_999, 10**6),
            ),
            unit_loads=(
                UnitLoad(unit="a72.0", busy=time("31250us"), share=Fraction(3125, 10_000)),
                UnitLoad(unit="dsp", busy=time("31290us"), share=Fraction(3129, 10_000)),
            ),
            resource_loads=(ResourceLoad(resource="ddr", peak=Fraction(41, 60), mean=Fraction(1, 8)),),
            chains=(
                ChainLatency(name="scan-to-pose", reaction=time("100/3ms"), age=time("31ms"), latency=time("30ms")),
                ChainLatency(name="unlimited", reaction=None, age=None),
            ),
        ),
        ModeSchedule(name="park", hyperperiod=time("0ms"), status=Status.NOT_FOUND, jobs=()),
    ),
    transitions=(
        TransitionTable(
            source="drive",
            target="park",
            length=time("1500us"),
            worst_latency=time("101.5ms"),
            status=Status.VALID,
            jobs=(Job(task="odometry", index=0, start=time("0ms"), end=time("40us"), version="only", units=("dsp",)),),
        ),
        TransitionTable(
            source="park",
            target="drive",
            length=time("0ms"),
            worst_latency=time("0ms"),
            status=Status.NOT_FOUND,
        ),
    ),
    reactions=(
        Reaction(
            mode="drive",
            task="lidar",
            event=HealthEvent.OVERRUN,
            count=2,
            cycles=4,
            action=HealthAction.SWITCH,
            target="park",
            within=time("101.5ms"),
        ),
        Reaction(mode="drive", task="odometry", event=HealthEvent.ANY, count=1, cycles=1, action=HealthAction.RESTART),
    ),
)


def test_every_element_and_attribute_is_read():
    assert read_schedule(str(FIXTURE)) == SHUTTLE


def test_tables_and_jobs_know_their_lines():
    schedule = read_schedule(str(FIXTURE))
    lines = FIXTURE.read_text().splitlines()
    for element, tag in [
        (schedule, "<schedule "),
        (schedule.modes[0], '<mode name="drive"'),
        (schedule.modes[0].jobs[1], '<job task="odometry" index="1"'),
        (schedule.transitions[0], '<transition from="drive"'),
        (schedule.transitions[0].jobs[0], '<job task="odometry" index="0"'),
    ]:
        assert element.at.file == str(FIXTURE)
        assert lines[element.at.line - 1].strip().startswith(tag)


def test_the_smallest_schedule_is_read():
    data = b'<schedule xmlns="urn:halpipe:schedule:1" model="m"/>'
    assert parse_schedule(data, "s.xml") == Schedule(model="m", model_sha256="")


MODE = """\
<schedule xmlns="urn:halpipe:schedule:1" model="m">
<mode name="a" hyperperiod="1ms" status="valid">
{}
</mode>
</schedule>"""


def refusal(document):
    with pytest.raises(HalpipeError) as refused:
        parse_schedule(document.encode(), "s.xml")
    return refused.value.diagnostics


def table(**changes):
    attributes = {"name": "a", "hyperperiod": "1ms", "status": "valid"} | changes
    text = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f'<schedule xmlns="urn:halpipe:schedule:1" model="m">\n<mode {text}/>\n</schedule>'


@pytest.mark.parametrize(
    ("document", "line", "words"),
    [
        (table(status="maybe"), 2, "'maybe' is not an element of the set {'valid', 'not-found'}"),
        (table(hyperperiod="1"), 2, "the value '1' is not a duration: a number and a unit"),
        (table(hyperperiod="1/" + "0" * 500 + "ms"), 2, "is not a duration"),
        (table(hyperperiod="1" * 999 + "ms"), 2, "1000"),
        (table(name="a b"), 2, "the value 'a b' is not a name"),
        (table(speed="fast"), 2, "attribute 'speed' is not allowed"),
        (MODE.format('<job task="t" index="0" start="0ms" end="1ms" version="v"/>'), 3, "'units' is required"),
        (MODE.format('<job task="t" index="-1" start="0ms" end="1ms" version="v" units="u"/>'), 3, "'-1'"),
        (MODE.format('<unit-load unit="u" busy="1ms" share="0.5.5"/>'), 3, "the value '0.5.5' is not a number"),
        (MODE.format('<cost total="1"/>'), 3, "'overlap' is required"),
        (MODE.format('<chain name="c"/>\n<job/>'), 4, "Element 'job': This element is not expected"),
        ('<schedule xmlns="urn:halpipe:schedule:1"/>', 1, "attribute 'model' is required"),
        ('<schedule xmlns="urn:halpipe:schedule:1" model="m" model-sha256="abc"/>', 1, "'abc'"),
        ('<schedule xmlns="urn:halpipe:schedule:1" model="m" seed="x"/>', 1, "'x' is not a valid value"),
    ],
)
def test_a_violation_is_told_with_its_line_in_plain_words(document, line, words):
    found = refusal(document)
    assert {(d.code, d.at.file, d.at.line) for d in found} == {("HAL0102", "s.xml", line)}
    assert words in found[0].message
    assert all(len(d.message) < 400 for d in found)


def test_a_model_is_not_taken_for_a_schedule():
    (found,) = refusal('<task-model xmlns="urn:halpipe:task-model:1" name="m"/>')
    assert found.code == "HAL0101"
    assert "a schedule is expected" in found.help


def test_numbers_of_metrics_may_be_long_and_negative():
    long = f"-{10**200}/{3**300}"
    load = f'<resource-load resource="r" peak="{long}" mean="-0.5"/>'
    (found,) = parse_schedule(MODE.format(load).encode(), "s.xml").modes[0].resource_loads
    assert (found.peak, found.mean) == (Fraction(long), Fraction(-1, 2))


def test_a_count_too_long_for_any_computer_is_told():
    found = refusal(MODE.format(f'<job task="t" index="{"9" * 5000}" start="0ms" end="1ms" version="v" units="u"/>'))
    assert {(d.code in ("HAL0102", "HAL0103"), d.at.line) for d in found} == {(True, 3)}
