"""Where labels lie, what way an access takes, how often it is made, and where groups must not be interrupted."""

import pytest
from amalthea_case import call, found, read, runnable, task, ticks, wcets

from halpipe.core.durations import Duration
from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions, codes

# A tick is 1 us; 8 bytes are one access.
HARDWARE = """
<definitions xsi:type="am:ProcessingUnitDefinition" name="A"/>
<definitions xsi:type="am:MemoryDefinition" name="D">
 <accessLatency xsi:type="am:DiscreteValueConstant" value="{memory}"/></definitions>
<definitions xsi:type="am:ConnectionHandlerDefinition" name="H">
 <readLatency xsi:type="am:DiscreteValueConstant" value="3"/><dataRate value="{rate}" unit="MBPerSecond"/>
</definitions>
<structures name="S">
 <connections name="wire">
  <readLatency xsi:type="am:DiscreteValueBoundaries" lowerBound="1" upperBound="2"/></connections>
 <modules xsi:type="am:ProcessingUnit" name="a0" frequencyDomain="F?type=FrequencyDomain"
  definition="A?type=ProcessingUnitDefinition">
  <accessElements name="way" destination="M?type=Memory">{way}</accessElements>
 </modules>
 <modules xsi:type="am:ConnectionHandler" name="bus" definition="H?type=ConnectionHandlerDefinition"
  frequencyDomain="half?type=FrequencyDomain"/>
 <modules xsi:type="am:Memory" name="M" definition="D?type=MemoryDefinition" frequencyDomain="F?type=FrequencyDomain"/>
</structures>
<domains xsi:type="am:FrequencyDomain" name="F"><defaultValue value="1.0" unit="MHz"/></domains>
<domains xsi:type="am:FrequencyDomain" name="half"><defaultValue value="0.5" unit="MHz"/></domains>
"""
LATENCY = '<readLatency xsi:type="am:DiscreteValueConstant" value="10"/>'
PATH = '<accessPath name="p" pathElements="wire?type=HwConnection bus?type=ConnectionHandler"/>'
MAPPING = '<memoryMapping abstractElement="L?type=Label" memory="M?type=Memory"/>'
SECTION = '<physicalSectionMapping name="m" origin="X?type=Section" memory="M?type=Memory"/>'


def given(tmp_path, access="", way=LATENCY, mapping=MAPPING, section="", memory=5, rate=0, **options):
    sw = task("T", ticks(100), f'<items xsi:type="am:LabelAccess" data="L?type=Label" access="read">{access}</items>')
    sw += f'<labels name="L"{section}><size value="64" unit="bit"/></labels><sections name="X"/>'
    hw = HARDWARE.format(way=way, memory=memory, rate=rate)
    if not rate:
        hw = hw.replace('<dataRate value="0" unit="MBPerSecond"/>', "")
    return read(tmp_path, sw=sw, hw=hw, mapping=mapping, memory="added", **options)


def counted(kind, **numbers):
    stated = " ".join(f'{name}="{number}"' for name, number in numbers.items())
    return f'<statistic><value xsi:type="am:{kind}" {stated}/></statistic>'


OLD = '<statistic><read xsi:type="am:{}" {}/></statistic>'


@pytest.mark.parametrize(
    ("access", "wcet"),
    [
        ("", "110us"),
        (counted("SingleValueStatistic", value="4.0"), "140us"),
        (counted("SingleValueStatistic", value="3.1"), "140us"),  # an average: some job makes four
        (counted("MinAvgMaxStatistic", min=1, avg="2.0", max=3), "130us"),
        (OLD.format("SingleValueStatistic", 'value="4"'), "140us"),
        (OLD.format("MinAvgMaxStatistic", 'min="1" avg="2.0" max="3"'), "130us"),
    ],
)
def test_accesses_are_counted_in_every_spelling(tmp_path, access, wcet):
    imported = given(tmp_path, access)
    assert wcets(imported) == {"T": {"A": wcet}}
    assert found(imported.diagnostics, codes.NOT_READ) == []


def test_a_call_that_is_made_several_times_counts_as_often(tmp_path):
    again = call("R").replace("/>", f">{counted('MinAvgMaxStatistic', max=3).replace('value', 'statistic', 1)}</items>")
    again = again.replace("<value", "<statistic").replace("</value", "</statistic")
    imported = read(tmp_path, sw=task("T", again) + runnable("R", ticks(100)))
    assert wcets(imported)["T"] == {"A": "3us", "B": "1.5us"}


@pytest.mark.parametrize(
    ("mapping", "section"),
    [
        (SECTION, ' section="X?type=Section"'),
        (SECTION.replace('origin="X?type=Section"', 'labels="L?type=Label"'), ""),
        (MAPPING + SECTION.replace("M?type", "N?type"), ' section="X?type=Section"'),
    ],
)
def test_a_label_lies_where_its_section_does(tmp_path, mapping, section):
    assert wcets(given(tmp_path, mapping=mapping, section=section)) == {"T": {"A": "110us"}}


def test_the_latencies_along_an_access_path_add_up_with_that_of_the_memory(tmp_path):
    # 2 cycles of the wire, 3 of the bus at half the frequency, 5 of the memory.
    assert wcets(given(tmp_path, way=PATH)) == {"T": {"A": "113us"}}


def test_the_least_rate_along_an_access_path_counts(tmp_path):
    # 13 us of latency, and 8 bytes at 1 MB/s.
    assert wcets(given(tmp_path, way=PATH, rate=1)) == {"T": {"A": "121us"}}


def test_own_latencies_of_an_access_element_count_before_its_path(tmp_path):
    assert wcets(given(tmp_path, way=LATENCY + PATH)) == {"T": {"A": "110us"}}


def test_a_way_without_times_warns(tmp_path):
    imported = given(tmp_path, way="")
    assert [d.message for d in found(imported.diagnostics, codes.NO_WAY)] == [
        "1 processing units state no way to a memory that they access: a0"
    ]
    assert wcets(imported) == {"T": {"A": "100us"}}


def split(tmp_path, *steps, preemption="preemptive"):
    sw = task("T", *steps).replace("<tasks ", f'<tasks preemption="{preemption}" ')
    sw += runnable("R", ticks(1_000_000)) + runnable("Q", ticks(2_000_000))
    sw += runnable("G", '<items xsi:type="am:Group" interruptible="false">' + ticks(1_000_000) + "</items>")
    from amalthea_case import HARDWARE as CORES
    from amalthea_case import document, write

    stimuli = '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="100" unit="ms"/></stimuli>'
    bound = '<schedulerAllocation scheduler="S0?type=TaskScheduler" responsibility="a0?type=ProcessingUnit"/>'
    bound += '<taskAllocation task="T?type=Task" scheduler="S0?type=TaskScheduler"/>'
    os = '<operatingSystems name="O"><taskSchedulers name="S0"/></operatingSystems>'
    path = write(tmp_path, document(sw=sw, hw=CORES, stimuli=stimuli, mapping=bound, os=os))
    imported = FORMAT.read([path], AmaltheaImportOptions(pieces=Duration.parse("5ms")))
    [version] = imported.model.task("T").versions
    return [str(point) for point in version.split.points]


def group(*steps, free="false"):
    return f'<items xsi:type="am:Group" interruptible="{free}">{"".join(steps)}</items>'


def test_groups_that_must_not_be_interrupted_are_one_piece(tmp_path):
    assert split(tmp_path, call("R"), call("Q")) == ["5ms", "10ms", "15ms", "20ms", "25ms"]
    assert split(tmp_path, group(call("R"), call("Q"), free="true")) == ["5ms", "10ms", "15ms", "20ms", "25ms"]
    assert split(tmp_path, group(call("R"), call("Q"))) == []
    assert split(tmp_path, call("R"), group(call("Q")), call("R")) == ["5ms", "10ms", "30ms", "35ms"]
    assert split(tmp_path, call("G"), call("R")) == ["10ms", "15ms"]
    assert split(tmp_path, group(call("R")), group(call("R")), preemption="cooperative") == ["10ms"]


def test_a_schedule_point_is_a_split_point(tmp_path):
    point = '<items xsi:type="am:SchedulePoint"/>'
    assert split(tmp_path, ticks(300_000), point, ticks(300_000), preemption="cooperative") == ["3ms"]


ORDER = """<runnableSequencingConstraints name="Q" orderType="{}">
<runnableGroups runnables="{}?type=Runnable"/><runnableGroups runnables="{}?type=Runnable"/>
</runnableSequencingConstraints>"""


@pytest.mark.parametrize(("first", "second", "warnings"), [("R", "Q", 0), ("Q", "R", 1)])
def test_an_order_against_the_calls_of_a_task_warns(tmp_path, first, second, warnings):
    sw = task("T", call("R"), call("Q")) + runnable("R", ticks(1)) + runnable("Q", ticks(1))
    imported = read(tmp_path, sw=sw, constraints=ORDER.format("successor", first, second))
    assert len(found(imported.diagnostics, codes.CALL_ORDER)) == warnings
    assert found(imported.diagnostics, codes.NOT_READ) == []


def test_an_order_that_wants_more_than_succession_warns(tmp_path):
    sw = task("T", call("R"), call("Q")) + runnable("R", ticks(1)) + runnable("Q", ticks(1))
    imported = read(tmp_path, sw=sw, constraints=ORDER.format("immediateSuccessorStartSequence", "R", "Q"))
    assert len(found(imported.diagnostics, codes.NOT_READ)) == 1


def test_accesses_of_interrupt_routines_warn(tmp_path):
    sw = '<isrs name="I" stimuli="p10?type=PeriodicStimulus"><activityGraph>' + ticks(5)
    sw += '<items xsi:type="am:LabelAccess" data="L?type=Label"/></activityGraph></isrs><labels name="L"/>'
    imported = read(tmp_path, sw=sw + task("T", ticks(5)))
    [finding] = found(imported.diagnostics, codes.NOT_READ)
    assert finding.message.startswith("1 interrupt routines access labels")


def test_stimuli_of_an_interrupt_routine_may_coincide(tmp_path):
    sw = '<isrs name="I" stimuli="p10?type=PeriodicStimulus q?type=PeriodicStimulus"><activityGraph>' + ticks(5)
    stimuli = '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="10" unit="ms"/></stimuli>'
    stimuli += '<stimuli xsi:type="am:PeriodicStimulus" name="q"><recurrence value="15" unit="ms"/></stimuli>'
    imported = read(tmp_path, sw=sw + "</activityGraph></isrs>" + task("T", ticks(5)), stimuli=stimuli)
    assert [str(i.distance) for i in imported.model.units[0].interrupts] == ["10ms", "15ms"]


def test_an_event_is_set_for_the_task_that_its_step_names(tmp_path):
    wait = '<items xsi:type="am:WaitEvent"><eventMask events="e?type=OsEvent"/></items>'
    give = '<items xsi:type="am:SetEvent"{}><eventMask events="e?type=OsEvent"/></items>'
    sw = task("A", ticks(1), wait, ticks(1)) + task("B", ticks(1), wait, ticks(1)) + '<events name="e"/>'
    for process, after in (("", ["B", "C"]), (' process="B?type=Task"', ["B", "C"]), (' process="A?type=Task"', ["B"])):
        imported = read(tmp_path, sw=sw + task("C", ticks(1), give.format(process)))
        assert [p.task for p in imported.model.task("B.2").versions[0].precedences] == after
