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
                *('<entries numberOfOccurrences="2">', time("lowerTimeBorder", 6), "</entries>"),
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


@pytest.mark.parametrize(("length", "is_open"), [(4, False), (5, True)])
def test_a_burst_with_room_between_its_occurrences_warns(tmp_path, length, is_open):
    parts = (time("recurrence", 20), time("burstLength", length), time("occurrenceMinDistance", 2))
    stimuli = stimulus("s", "PeriodicBurstStimulus", *parts, occurrenceCount=3)
    imported = read(tmp_path, sw=task("T", ticks(5), stimuli="s?type=PeriodicBurstStimulus"), stimuli=stimuli)
    assert bool(found(imported.diagnostics, codes.JITTER)) == is_open


def test_a_row_of_triggers_is_followed_up_to_a_limit(tmp_path):
    def row(count):
        rest = (
            task(f"T{i}", TRIGGER.replace("go", f"g{i + 1}"), stimuli=f"g{i}?type=InterProcessStimulus")
            for i in range(1, count)
        )
        stimuli = "".join(stimulus(f"g{i}", "InterProcessStimulus") for i in range(count + 1))
        return {"sw": task("T0", TRIGGER.replace("go", "g1")) + "".join(rest), "stimuli": PLAIN_STIMULI + stimuli}

    assert len(read(tmp_path, **row(1000)).model.tasks) == 1000
    [error] = refusal(read, tmp_path, **row(1001)).diagnostics
    assert (error.code, error.path) == ("HAL0008", 'Task "T1000"')


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


def test_each_trigger_activates(tmp_path):
    sw = task("T", ticks(5), TRIGGER) + task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    sw += task("S", ticks(5), TRIGGER, TRIGGER, stimuli="p4?type=PeriodicStimulus")
    stimuli = PLAIN_STIMULI + GO + stimulus("p4", "PeriodicStimulus", time("recurrence", 4))
    imported = read(tmp_path, sw=sw, stimuli=stimuli)
    assert {n: a for n, a in activations(imported).items() if n[0] == "U"} == {
        "U@go": ("10ms", "None"),
        "U@go~2": ("4ms", "None"),
        "U@go~3": ("4ms", "None"),
    }
    assert windows(imported, "U@go") == [("T", "end", "0ms", "10ms")]
    assert windows(imported, "U@go~2") == windows(imported, "U@go~3") == [("S", "end", "0ms", "4ms")]


def triggered(tmp_path, step, calls="", counter="", source="p10?type=PeriodicStimulus", more=""):
    """The activations of a task U that T triggers by a step, or by calls of a runnable with that step."""
    sw = task("T", ticks(5), calls or step, stimuli=source) + runnable("R", ticks(1), step)
    sw += task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    stimuli = PLAIN_STIMULI + stimulus("go", "InterProcessStimulus", counter) + more
    imported = read(tmp_path, sw=sw, stimuli=stimuli)
    found_ones = sorted(a for name, a in activations(imported).items() if name.startswith("U"))
    return found_ones, [d.message for d in found(imported.diagnostics, codes.NOT_READ)]


def counting(prescaler, offset=0):
    return f'<counter prescaler="{prescaler}" offset="{offset}"/>'


def with_counter(step, counter):
    return step.replace("/>", f">{counter}</items>")


TWICE = '><statistic><statistic xsi:type="am:SingleValueStatistic" value="2.0"/></statistic></items>'
PLACED = stimulus("p4", "PeriodicStimulus", time("recurrence", 4), time("offset", 1))


@pytest.mark.parametrize(
    ("step", "calls", "counter", "expected"),
    [
        (TRIGGER, "", counting(5), [("50ms", "None")]),
        (with_counter(TRIGGER, counting(5)), "", "", [("50ms", "None")]),
        (with_counter(TRIGGER, counting(5)), "", counting(2), [("100ms", "None")]),
        (TRIGGER, with_counter(call("R"), counting(3)), "", [("30ms", "None")]),
        (TRIGGER, call("R") * 2, "", [("10ms", "None")] * 2),
        (TRIGGER, call("R") * 2, counting(2), [("10ms", "None")]),
        (TRIGGER, call("R") * 4, counting(2), [("10ms", "None")] * 2),
        (TRIGGER, call("R") * 2, counting(6), [("30ms", "None")]),
        (with_counter(TRIGGER, counting(2)), call("R") * 2, "", [("10ms", "None")]),
        (TRIGGER, call("R").replace("/>", TWICE), "", [("10ms", "None")] * 2),
    ],
)
def test_counters_let_every_nth_occurrence_through(tmp_path, step, calls, counter, expected):
    warnings = ['1 calls with counters work, read and write in each job: RunnableCall in Task "T"']
    assert triggered(tmp_path, step, calls, counter) == (expected, warnings if "<counter" in calls else [])


def test_a_counted_task_belongs_to_the_jobs_that_its_counter_lets_through(tmp_path):
    given = triggered(tmp_path, TRIGGER, "", counting(5, 10), source="p4?type=PeriodicStimulus", more=PLACED)
    assert given == ([("20ms", "1ms")], [])
    sw = task("T", ticks(5), TRIGGER) + task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    stimuli = PLAIN_STIMULI + stimulus("go", "InterProcessStimulus", counting(5))
    [window] = read(tmp_path, sw=sw, stimuli=stimuli).model.task("U").versions[0].precedences
    assert (window.task, str(window.match)) == ("T", "cycle")


def test_a_counter_that_begins_between_warns_and_lets_all_through(tmp_path):
    given = triggered(tmp_path, TRIGGER, "", counting(5, 2), source="p4?type=PeriodicStimulus", more=PLACED)
    assert given == (
        [("4ms", "None")],
        ['1 counters are not followed, so that all occurrences activate: InterProcessTrigger in Task "T"'],
    )


@pytest.mark.parametrize("times", [3, 4])
def test_a_counter_that_jobs_share_unevenly_warns_and_lets_all_through(tmp_path, times):
    given, warnings = triggered(tmp_path, TRIGGER, call("R") * times, counting(5))
    assert given == [("10ms", "None")] * times
    assert warnings == ["1 counters are not followed, so that all occurrences activate: go"]


def test_a_branch_triggers_as_often_as_its_densest_way(tmp_path):
    entry = "<entries><items xsi:type='am:Group'>{}</items></entries>"
    switch = f'<items xsi:type="am:ProbabilitySwitch">{entry.format(TRIGGER)}{entry.format(TRIGGER * 2)}</items>'
    assert triggered(tmp_path, switch) == ([("10ms", "None")] * 2, [])


def test_equal_stimuli_and_equal_times_activate_as_often_as_they_are_stated(tmp_path):
    both = PLAIN_STIMULI + PLAIN_STIMULI.replace("p10", "q10")
    sw = task("T", ticks(5), stimuli="p10?type=PeriodicStimulus q10?type=PeriodicStimulus")
    assert activations(read(tmp_path, sw=sw, stimuli=both)) == {"T@p10": ("10ms", "None"), "T@q10": ("10ms", "None")}
    times = stimulus("s", "PeriodicSyntheticStimulus", time("recurrence", 20), *[time("occurrenceTimes", 3)] * 2)
    imported = read(tmp_path, sw=task("T", ticks(5), stimuli="s?type=PeriodicSyntheticStimulus"), stimuli=times)
    assert list(activations(imported).values()) == [("20ms", "3ms")] * 2


def test_equal_stimuli_of_different_modes_are_one_activation(tmp_path):
    condition = (
        '<executionCondition><entries xsi:type="am:ModeValueCondition" label="L?type=ModeLabel" value="{}"/>'
        "</executionCondition>"
    )
    stimuli = stimulus("a", "PeriodicStimulus", time("recurrence", 10), condition.format("x"))
    stimuli += stimulus("b", "PeriodicStimulus", time("recurrence", 10), condition.format("y"))
    sw = task("T", ticks(5), stimuli="a?type=PeriodicStimulus b?type=PeriodicStimulus")
    sw += '<modes xsi:type="am:EnumMode" name="M"><literals name="x"/><literals name="y"/></modes>'
    imported = read(tmp_path, sw=sw + '<modeLabels name="L" mode="M?type=EnumMode"/>', stimuli=stimuli)
    assert activations(imported) == {"T": ("10ms", "None")}


def test_events_that_are_not_followed_warn_beside_others(tmp_path):
    fire = '<items xsi:type="am:CustomEventTrigger" event="E?type=CustomEvent"/>'
    sw = task("T", ticks(5), fire) + task("U", ticks(5), stimuli="s?type=EventStimulus") + '<labels name="L"/>'
    stimuli = stimulus("s", "EventStimulus", triggeringEvents="E?type=CustomEvent w?type=LabelEvent")
    events = '<events xsi:type="am:CustomEvent" name="E"/>'
    events += '<events xsi:type="am:LabelEvent" name="w" entity="L?type=Label" eventType="write"/>'
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + stimuli, events=events)
    assert windows(imported, "U") == [("T", "end", "0ms", "10ms")]
    [finding] = found(imported.diagnostics, codes.NOT_READ)
    assert finding.message == "1 events of other kinds trigger nothing: w"


def test_too_many_triggers_are_an_error(tmp_path):
    chain = "".join(
        task(f"T{i}", TRIGGER.replace("go", f"g{i}") * 4, stimuli=f"g{i - 1}?type=InterProcessStimulus")
        for i in range(1, 8)
    )
    sw = task("T0", TRIGGER.replace("go", "g0") * 4) + chain
    stimuli = PLAIN_STIMULI + "".join(stimulus(f"g{i}", "InterProcessStimulus") for i in range(8))
    [error] = refusal(read, tmp_path, sw=sw, stimuli=stimuli).diagnostics
    assert "is activated by, or stands behind more than 1000 triggers" in error.message
    often = '><statistic><statistic xsi:type="am:SingleValueStatistic" value="1001.0"/></statistic></items>'
    sw = task("T", call("R").replace("/>", often)) + runnable("R", TRIGGER)
    sw += task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    [error] = refusal(read, tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO).diagnostics
    assert "makes, is activated by, or stands behind more than 1000" in error.message


def test_many_calls_hide_no_trigger(tmp_path):
    sw = task("T", call("R") * 1500, TRIGGER) + runnable("R", ticks(1))
    sw += task("U", ticks(5), stimuli="go?type=InterProcessStimulus")
    assert activations(read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO))["U"] == ("10ms", "None")


def test_a_synthetic_stimulus_until_083_states_period_and_time_stamps(tmp_path):
    stamps = f"<triggerTimes>{time('timestamps', 0)}{time('timestamps', 5)}</triggerTimes>"
    stimuli = stimulus("s", "SyntheticStimulus", "<stimulusDeviation/>", time("period", 20), stamps)
    imported = read(tmp_path, sw=task("T", ticks(5), stimuli="s?type=SyntheticStimulus"), stimuli=stimuli)
    assert list(activations(imported).values()) == [("20ms", "0ms"), ("20ms", "5ms")]


def test_a_variable_rate_with_an_upper_bound_has_a_least_distance(tmp_path):
    rate = '<occurrencesPerStep xsi:type="am:ContinuousValueBoundaries" lowerBound="1.0" upperBound="4.0"/>'
    sw = task("T", ticks(5), stimuli="s?type=VariableRateStimulus")
    imported = read(tmp_path, sw=sw, stimuli=stimulus("s", "VariableRateStimulus", time("step", 40), rate))
    assert str(imported.model.task("T").distance) == "10ms"


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
    long = read(tmp_path, sw=OFFLOAD, stimuli=PLAIN_STIMULI + GO, constraints=LIMIT.replace('"8"', '"40"')).model
    assert (long.task("T").slack, str(long.chains[0].max_age)) == (1, "30ms")
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
    both = event("WaitEvent").replace("done?type=OsEvent", "done?type=OsEvent never?type=OsEvent")
    sw = OFFLOAD.replace(event("WaitEvent"), both) + '<events name="never"/>'
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO)
    assert len(imported.model.tasks) == 3
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
