"""Preemption to split points, allocation to binding, interrupt routines to interrupts, sporadic stimuli to polling."""

from dataclasses import replace
from pathlib import Path

import pytest
from amalthea_case import HARDWARE, PLAIN_STIMULI, call, document, found, read, runnable, stimulus, ticks, write

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files import TOO_MUCH
from halpipe.exporters.amalthea import FORMAT as EXPORTER
from halpipe.exporters.amalthea import AmaltheaOptions
from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions, codes
from halpipe.models import WHOLE, Binding, Interrupt, Split

OS = (
    '<operatingSystems name="o"><taskSchedulers name="one"/><taskSchedulers name="two"/>'
    '<interruptControllers name="ic"/></operatingSystems>'
)


def ms(text):
    return Duration.parse(text)


def tasks(preemption, *steps, name="T"):
    stated = f' preemption="{preemption}"' if preemption else ""
    return f'<tasks name="{name}" stimuli="p10?type=PeriodicStimulus"{stated}><activityGraph>{"".join(steps)}</activityGraph></tasks>'  # noqa: E501


def isr(name, *steps, stimuli="p10?type=PeriodicStimulus"):
    return f'<isrs name="{name}" stimuli="{stimuli}"><activityGraph>{"".join(steps)}</activityGraph></isrs>'


RUNNABLES = runnable("r1", ticks(100_000)) + runnable("r2", ticks(700_000)) + runnable("r3", ticks(50_000))
"""At 100 MHz these take 1, 7 and 0.5 ms."""
CALLS = (call("r1"), call("r2"), call("r3"))


def split_of(folder, preemption, pieces="5ms", memory="within"):
    path = write(folder, document(hw=HARDWARE, stimuli=PLAIN_STIMULI, sw=RUNNABLES + tasks(preemption, *CALLS)))
    imported = FORMAT.read([path], AmaltheaImportOptions(pieces=ms(pieces), memory=memory))
    return {v.name: v.split for v in imported.model.task("T").versions}, imported


def test_as_many_pieces_as_nobody_can_use_are_refused_with_what_to_do(tmp_path):
    splits, _ = split_of(tmp_path, "preemptive", pieces="350ns")
    assert len(splits["A"].points) == 2857 + 19_999 + 1428 + 2  # of 1, 7 and 0.5 ms, and the ends of two of them
    with pytest.raises(HalpipeError) as refused:
        split_of(tmp_path, "preemptive", pieces="349ns")
    (told,) = refused.value.diagnostics
    assert (told.code, told.path) == (TOO_MUCH.id, 'task "T"')
    assert "20058 pieces of 349ns" in told.message
    assert "--pieces" in told.help


@pytest.mark.parametrize(
    ("preemption", "points"),
    [
        ("cooperative", "1ms 8ms"),
        ("preemptive", "1ms 6ms 8ms"),  # r2 is longer than 5 ms
        ("non_preemptive", ""),
        ("unknown", ""),
        ("", ""),
    ],
)
def test_runnables_end_at_split_points(tmp_path, preemption, points):
    splits, imported = split_of(tmp_path, preemption)
    assert splits["A"] == (Split(points=tuple(map(ms, points.split()))) if points else WHOLE)
    assert bool(found(imported.diagnostics, codes.CUT_RUNNABLES)) == (preemption == "preemptive")  # HAL1251
    unstated = [d.element for d in imported.coverage.defaulted_values if d.what == "preemption"]
    assert unstated == (['task "T"'] if preemption in ("unknown", "") else [])


def test_the_longest_piece_is_chosen(tmp_path):
    assert split_of(tmp_path, "preemptive", "3ms")[0]["A"].points == tuple(map(ms, ("1ms", "4ms", "7ms", "8ms")))
    assert split_of(tmp_path, "preemptive", "0ms")[0]["A"].points == (ms("1ms"), ms("8ms"))
    assert split_of(tmp_path, "preemptive", "3ms")[0]["B"].points == (ms("0.5ms"), ms("3.5ms"), ms("4ms"))


def test_no_point_lies_inside_an_access_phase(tmp_path):
    hw = HARDWARE.replace(
        'name="a0" frequencyDomain="slow?type=FrequencyDomain" definition="A?type=ProcessingUnitDefinition"/>',
        'name="a0" frequencyDomain="slow?type=FrequencyDomain" definition="A?type=ProcessingUnitDefinition">'
        '<accessElements name="m" destination="mem?type=Memory"><dataRate value="1000" unit="BPerSecond"/>'
        "</accessElements></modules>",
    ).replace(
        '<domains xsi:type="am:FrequencyDomain" name="slow">',
        '<structures name="X"><modules xsi:type="am:Memory" name="mem"/></structures>'
        '<domains xsi:type="am:FrequencyDomain" name="slow">',
    )
    label = '<labels name="L"><size value="2" unit="B"/></labels>'
    reads = '<items xsi:type="am:LabelAccess" data="L?type=Label" access="read"/>'
    sw = RUNNABLES + label + tasks("cooperative", reads, *CALLS)
    mapping = '<memoryMapping abstractElement="L?type=Label" memory="mem?type=Memory"/>'

    def versions(memory):
        path = write(tmp_path, document(hw=hw, stimuli=PLAIN_STIMULI, sw=sw, mapping=mapping))
        options = AmaltheaImportOptions(memory=memory)
        return [v for v in FORMAT.read([path], options).model.task("T").versions if v.accesses]

    (within,) = versions("within")
    assert [(a.start, a.end) for a in within.accesses] == [(ZERO, ms("2ms"))]
    assert within.split.points == (ms("8ms"),)  # r1 ends at 1 ms, while the label is read
    (added,) = versions("added")
    assert added.split.points == (ms("3ms"), ms("10ms"))  # all ends are 2 ms later


def allocated(kind, feature, name, scheduler):
    return f'<{kind} {feature}="{name}?type={"ISR" if feature == "isr" else "Task"}" {scheduler}/>'


MAPPING = (
    '<schedulerAllocation scheduler="one?type=TaskScheduler" responsibility="a0?type=ProcessingUnit"/>'
    '<schedulerAllocation scheduler="two?type=TaskScheduler" '
    'responsibility="a0?type=ProcessingUnit a1?type=ProcessingUnit"/>'
    '<schedulerAllocation scheduler="ic?type=InterruptController" responsibility="a1?type=ProcessingUnit"/>'
)


def test_a_task_allocated_to_one_unit_is_bound(tmp_path):
    sw = "".join(tasks("", ticks(5), name=name) for name in ("alone", "shared", "free"))
    mapping = MAPPING + allocated("taskAllocation", "task", "alone", 'scheduler="one?type=TaskScheduler"')
    mapping += allocated("taskAllocation", "task", "shared", 'scheduler="two?type=TaskScheduler"')
    model = read(tmp_path, sw=sw, os=OS, mapping=mapping).model
    bindings = {task.name: task.binding for task in model.tasks}
    assert bindings == {"alone": Binding.SYSTEM, "shared": Binding.JOB, "free": Binding.JOB}


def test_interrupt_routines_interrupt_their_unit(tmp_path):
    sporadic = stimulus(
        "s",
        "RelativePeriodicStimulus",
        '<nextOccurrence xsi:type="am:TimeBoundaries"><lowerBound value="2" unit="ms"/></nextOccurrence>',
    )
    sw = tasks("", ticks(5)) + isr("I", ticks(1000), stimuli="s?type=RelativePeriodicStimulus") + isr("J", ticks(2000))
    mapping = MAPPING + allocated("isrAllocation", "isr", "I", 'controller="ic?type=InterruptController"')
    mapping += allocated("isrAllocation", "isr", "J", 'controller="ic?type=InterruptController"')
    imported = read(tmp_path, sw=sw, os=OS, mapping=mapping, stimuli=PLAIN_STIMULI + sporadic)
    assert [task.name for task in imported.model.tasks] == ["T"]
    served = {unit.name: [replace(i, origin=None) for i in unit.interrupts] for unit in imported.model.units}
    first = Interrupt(name="I", distance=ms("2ms"), wcet=ms("10us"))
    second = Interrupt(name="J", distance=ms("10ms"), wcet=ms("20us"))
    assert served == {"a0": [], "a1": [first, second], "b0": []}
    assert not found(imported.diagnostics, codes.UNKNOWN_INTERRUPT)


def test_interrupt_routines_without_a_time_are_a_warning_that_names_them(tmp_path):
    routines = [isr(name) for name in "ABCDEFGHI"]
    sw = tasks("", ticks(5)) + "".join(routines) + isr("J", ticks(5), stimuli="")
    imported = read(tmp_path, sw=sw)
    (said,) = found(imported.diagnostics, codes.UNKNOWN_INTERRUPT)  # HAL1250
    assert said.severity == "warning"
    assert said.message.endswith(": A, B, C, D, E, F, G, H, I, J")
    assert not any(unit.interrupts for unit in imported.model.units)


def test_a_sporadic_task_keeps_its_distance_and_is_polled(tmp_path):
    sporadic = stimulus(
        "s",
        "RelativePeriodicStimulus",
        '<nextOccurrence xsi:type="am:TimeBoundaries"><lowerBound value="6660" unit="us"/></nextOccurrence>',
    )
    rate = stimulus("v", "VariableRateStimulus", '<step value="20" unit="ms"/><occurrencesPerStep value="2.5"/>')
    sw = tasks("", ticks(5)) + tasks("", ticks(5), name="S").replace("p10?type=Periodic", "s?type=RelativePeriodic")
    sw += tasks("", ticks(5), name="V").replace("p10?type=Periodic", "v?type=VariableRate")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + sporadic + rate)
    times = {task.name: (task.period, task.distance, task.deadline) for task in imported.model.tasks}
    assert times == {
        "T": (ms("10ms"), None, None),
        "S": (ms("5ms"), ms("6.66ms"), None),
        "V": (ms("5ms"), ms("8ms"), None),
    }
    assert "every 6.66ms" in found(imported.diagnostics, codes.SPORADIC)[0].message


def test_what_the_export_says_of_splitting_comes_back(tmp_path):
    from halpipe.importers.native import read_model

    example = read_model(str(Path(__file__).parents[3] / "fixtures" / "split" / "model.xml"))
    written = EXPORTER.write(example, None, AmaltheaOptions())[""]
    back = FORMAT.read([write(tmp_path, written.decode())], AmaltheaImportOptions()).model
    for task in example.tasks:
        other = back.task(task.name)
        assert (other.period, other.distance, other.binding) == (task.period, task.distance, task.binding)
        assert [v.split for v in other.versions] == [v.split for v in task.versions]
    assert [u.interrupts for u in back.units] == [u.interrupts for u in example.units]


@pytest.mark.parametrize(("limit", "longest"), [("20ms", "15ms"), ("15ms", "15ms"), ("14ms", "13ms"), ("4ms", "5ms")])
def test_the_limit_of_a_task_that_waits_counts_the_longest_versions_that_keep_it(limit, longest):
    from halpipe.importers.amalthea.tasks import _longest_within

    choices = [[ms("3ms")], [ms("10ms"), ms("0ms"), ms("8ms")], [ms("2ms")]]
    assert _longest_within(ms(limit), choices) == ms(longest)
