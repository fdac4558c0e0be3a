"""Stimuli to periods and offsets; triggers, waits and loops between tasks."""

import pytest
from amalthea_case import (
    PLAIN_STIMULI,
    Overlay,
    call,
    found,
    read,
    reasons,
    refusal,
    runnable,
    stimulus,
    task,
    ticks,
    windows,
)

from halpipe.importers.amalthea import codes


def time(tag, value, unit="ms"):
    return f'<{tag} value="{value}" unit="{unit}"/>'


def activations(imported):
    return {t.name: (str(t.period), str(t.offset)) for t in imported.model.tasks}


@pytest.mark.parametrize(
    ("kind", "parts", "attributes", "expected"),
    [
        ("PeriodicStimulus", [time("recurrence", 20), time("offset", 3)], {}, {"T": ("20ms", "3ms")}),
        ("Periodic", [time("recurrence", 20), '<offset unit="ms"/>'], {}, {"T": ("20ms", "0ms")}),
        ("PeriodicStimulus", [time("recurrence", 33333, "ps")], {}, {"T": ("33.333ns", "None")}),
        (
            "PeriodicSyntheticStimulus",
            [time("recurrence", 20), time("offset", 1), time("occurrenceTimes", 0), time("occurrenceTimes", 10)],
            {},
            {"T": ("10ms", "1ms")},
        ),
        (
            "PeriodicSyntheticStimulus",
            [time("recurrence", 20), time("occurrenceTimes", 0), time("occurrenceTimes", 3)],
            {},
            {"T@s": ("20ms", "0ms"), "T@s~2": ("20ms", "3ms")},
        ),
        (
            "PeriodicBurstStimulus",
            [time("recurrence", 20), time("occurrenceMinDistance", 2)],
            {"occurrenceCount": 2},
            {"T@s": ("20ms", "0ms"), "T@s~2": ("20ms", "2ms")},
        ),
        (
            "RelativePeriodicStimulus",
            ['<nextOccurrence xsi:type="am:TimeBoundaries">', time("lowerBound", 7), "</nextOccurrence>"],
            {},
            {"T": ("5ms", "None")},
        ),
        (
            "ArrivalCurveStimulus",
            [
                *('<entries numberOfOccurrences="3">', time("lowerTimeBorder", 40), "</entries>"),
                *('<entries numberOfOccurrences="2">', time("lowerTimeBorder", 5), "</entries>"),
            ],
            {},
            {"T": ("4ms", "None")},
        ),
    ],
)
def test_stimuli_become_periods(tmp_path, kind, parts, attributes, expected):
    sw = task("T", ticks(5), stimuli=f"s?type={kind}")
    imported = read(tmp_path, sw=sw, stimuli=stimulus("s", kind, *parts, **attributes))
    assert activations(imported) == expected
    sporadic = kind in ("RelativePeriodicStimulus", "ArrivalCurveStimulus")
    assert bool(found(imported.diagnostics, codes.SPORADIC)) == sporadic
    assert bool(found(imported.diagnostics, codes.SEVERAL_ACTIVATIONS)) == (len(expected) > 1)


def test_interrupt_routines_that_activate_tasks_are_tasks(tmp_path):
    own = '<isrs name="I" stimuli="p10?type=PeriodicStimulus"><activityGraph>' + ticks(5) + TRIGGER
    sw = own + "</activityGraph></isrs>" + task("T", ticks(5), stimuli="go?type=InterProcessStimulus")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO)
    assert activations(imported) == {"I": ("10ms", "None"), "T": ("10ms", "None")}


def test_jitter_is_told(tmp_path):
    jitter = '<jitter xsi:type="am:TimeConstant"><value value="1" unit="ms"/></jitter>'
    stimuli = stimulus("p10", "PeriodicStimulus", time("recurrence", 10), jitter)
    imported = read(tmp_path, sw=task("T", ticks(5)), stimuli=stimuli)
    assert [d.path for d in found(imported.diagnostics, codes.JITTER)] == ['PeriodicStimulus "p10"']


@pytest.mark.parametrize("kind", ["SingleStimulus", "VariableRateStimulus", "CustomStimulus", "ArrivalCurveStimulus"])
def test_tasks_without_a_period_are_left_out_until_an_overlay_states_one(tmp_path, kind):
    sw = task("T", ticks(5)) + task("U", ticks(5), stimuli=f"s?type={kind}")
    stimuli = PLAIN_STIMULI + stimulus("s", kind)
    imported = read(tmp_path, sw=sw, stimuli=stimuli)
    assert list(activations(imported)) == ["T"]
    assert [d.message for d in found(imported.diagnostics, codes.NO_PERIOD)] == [
        "1 tasks have no period and are left out: U"
    ]
    assert kind in reasons(imported, "Task")["U"]
    for overlay in (Overlay(sources={"s": "30ms"}), Overlay(periods={"U": "30ms"})):
        again = read(tmp_path, sw=sw, stimuli=stimuli, overlay=overlay)
        assert activations(again)["U"] == ("30ms", "None")


def test_what_the_overlay_drops_is_not_read(tmp_path):
    imported = read(tmp_path, sw=task("T", ticks(5)) + task("U", ticks(5)), overlay=Overlay(drop=["U"]))
    assert list(activations(imported)) == ["T"]
    assert reasons(imported, "Task") == {"U": "left out by the overlay"}


def test_no_task_at_all_is_an_error(tmp_path):
    for sw in ("", task("T", ticks(5), stimuli="")):
        failure = refusal(read, tmp_path, sw=sw)
        assert len(found(failure.diagnostics, codes.NO_TASKS)) == 1


TRIGGER = '<items xsi:type="am:InterProcessTrigger" stimulus="go?type=InterProcessStimulus"/>'
GO = stimulus("go", "InterProcessStimulus")


def test_a_triggered_task_follows_and_has_the_period_of_its_trigger(tmp_path):
    sw = task("T", ticks(5), TRIGGER) + task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO)
    assert activations(imported)["U"] == ("10ms", "None")
    assert windows(imported, "U") == [("T", "end", "0ms", "10ms")]
    assert len(found(imported.diagnostics, codes.DEFAULT_WINDOW)) == 1


def test_of_several_triggers_the_fastest_counts(tmp_path):
    sw = task("T", ticks(5), TRIGGER) + task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    sw += task("S", ticks(5), TRIGGER, stimuli="p4?type=PeriodicStimulus")
    stimuli = PLAIN_STIMULI + GO + stimulus("p4", "PeriodicStimulus", time("recurrence", 4))
    imported = read(tmp_path, sw=sw, stimuli=stimuli)
    assert activations(imported)["U"] == ("4ms", "None")
    assert windows(imported, "U") == [("T", "end", "0ms", "10ms"), ("S", "end", "0ms", "4ms")]
    assert len(found(imported.diagnostics, codes.SEVERAL_TRIGGERS)) == 1


def test_events_trigger_too(tmp_path):
    fire = '<items xsi:type="am:CustomEventTrigger" event="E?type=CustomEvent"/>'
    sw = task("T", call("R")) + runnable("R", ticks(5), fire)
    sw += task("U", ticks(5), stimuli="s?type=EventStimulus") + task("V", ticks(5), stimuli="e?type=EventStimulus")
    stimuli = stimulus("s", "EventStimulus", triggeringEvents="E?type=CustomEvent")
    stimuli += stimulus("e", "EventStimulus", triggeringEvents="end?type=ProcessEvent")
    events = '<events xsi:type="am:CustomEvent" name="E"/>'
    events += '<events xsi:type="am:ProcessEvent" name="end" entity="U?type=Task" eventType="terminate"/>'
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + stimuli, events=events)
    assert windows(imported, "U") == [("T", "end", "0ms", "10ms")]
    assert windows(imported, "V") == [("U", "end", "0ms", "10ms")]


def test_a_loop_of_triggers_is_cut_where_the_period_is_known(tmp_path):
    back = '<items xsi:type="am:InterProcessTrigger" stimulus="back?type=InterProcessStimulus"/>'
    both = "p10?type=PeriodicStimulus back?type=InterProcessStimulus"
    sw = task("T", ticks(5), TRIGGER, stimuli=both) + task("U", ticks(5), back, stimuli="go?type=InterProcessStimulus")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO + stimulus("back", "InterProcessStimulus"))
    edges = {t.name: [p.task for p in t.versions[0].precedences] for t in imported.model.tasks}
    assert sorted(map(len, edges.values())) == [0, 1]
    assert len(found(imported.diagnostics, codes.FEEDBACK)) == 1


def event(kind, extra=""):
    return f'<items xsi:type="am:{kind}"{extra}><eventMask events="done?type=OsEvent"/></items>'


OFFLOAD = (
    task("T", call("pre"), TRIGGER, event("WaitEvent"), event("ClearEvent"), call("post"))
    + task("G", ticks(300_000), event("SetEvent", ' process="T?type=Task"'), stimuli="go?type=InterProcessStimulus")
    + runnable("pre", ticks(100_000))
    + runnable("post", ticks(200_000))
    + '<events name="done"/>'
)
LIMIT = """<requirements xsi:type="am:ProcessRequirement" process="T?type=Task">
<limit xsi:type="am:TimeRequirementLimit" limitType="UpperLimit" metric="ResponseTime">
<limitValue value="8" unit="ms"/></limit></requirements>"""


def test_a_task_that_waits_is_cut_and_its_response_time_is_the_age_of_a_chain(tmp_path):
    imported = read(tmp_path, sw=OFFLOAD, stimuli=PLAIN_STIMULI + GO, constraints=LIMIT)
    model = imported.model
    assert [t.name for t in model.tasks] == ["T", "T.2", "G"]
    assert windows(imported, "G") == [("T", "end", "0ms", "10ms")]
    assert windows(imported, "T.2") == [("T", "end", "0ms", "10ms"), ("G", "end", "0ms", "10ms")]
    # 1 + 3 + 2 ms of work in 8 ms: half of the rest for the start of the first part.
    assert [(c.name, c.tasks, str(c.max_age)) for c in model.chains] == [("T.response", ("T", "G", "T.2"), "7ms")]
    assert model.task("T").slack * model.task("T").period.fraction == 10**6
    assert model.task("T").deadline is None
    assert len(found(imported.diagnostics, codes.WAITING)) == 1


def test_a_wait_for_what_nobody_sets_or_inside_of_a_runnable_cuts_nothing(tmp_path):
    alone = (
        task("T", call("pre"), event("WaitEvent"), call("post"))
        + runnable("pre", ticks(1))
        + runnable("post", ticks(1))
    )
    imported = read(tmp_path, sw=alone + '<events name="done"/>')
    assert len(imported.model.tasks) == 1
    assert len(found(imported.diagnostics, codes.UNUSED_WAIT)) == 1
    inside = OFFLOAD.replace(event("WaitEvent"), "").replace(ticks(200_000), event("WaitEvent") + ticks(200_000))
    imported = read(tmp_path, sw=inside, stimuli=PLAIN_STIMULI + GO)
    assert len(imported.model.tasks) == 2
    assert len(found(imported.diagnostics, codes.UNUSED_WAIT)) == 1


@pytest.mark.parametrize(("stated", "told"), [("active", 1), ("passive", 0)])
def test_an_active_wait_that_leaves_its_unit_is_told(tmp_path, stated, told):
    wait = event("WaitEvent")
    sw = OFFLOAD.replace(wait, wait.replace(">", f' waitingBehaviour="{stated}">', 1))
    assert sw != OFFLOAD
    assert len(found(read(tmp_path, sw=sw).diagnostics, codes.ACTIVE_WAIT)) == told


def test_the_remedy_for_a_model_without_tasks_names_no_file_that_is_there(tmp_path):
    (error,) = found(refusal(read, tmp_path, sw=runnable("R", ticks(1))).diagnostics, codes.NO_TASKS)
    assert error.help.startswith("its software model defines no tasks")
