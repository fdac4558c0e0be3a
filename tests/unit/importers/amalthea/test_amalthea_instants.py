"""Requirements by their instants: responses to triggers, limits from activations, latencies, locks, timed accesses."""

import pytest
from amalthea_case import HARDWARE, PLAIN_STIMULI, call, found, read, refusal, runnable, stimulus, task, ticks

from halpipe.importers.amalthea import codes

TRIGGER = '<items xsi:type="am:InterProcessTrigger" stimulus="go?type=InterProcessStimulus"/>'
WHILE = f'<items xsi:type="am:WhileLoop">{ticks(400)}{TRIGGER}{ticks(100)}</items>'
TWICE = (
    '<items xsi:type="am:RunnableCall" runnable="R?type=Runnable">'
    '<statistic><statistic xsi:type="am:SingleValueStatistic" value="2"/></statistic></items>'
)
GO = stimulus("go", "InterProcessStimulus")
EVENTS = "".join(
    f'<events xsi:type="am:ProcessEvent" name="{task}{kind}" eventType="{kind}" entity="{task}?type=Task"/>'
    for task in "TU"
    for kind in ("activate", "start", "terminate", "preempt")
)


def response(value, task="U"):
    return f"""<requirements xsi:type="am:ProcessRequirement" name="q" process="{task}?type=Task">
<limit xsi:type="am:TimeRequirementLimit" limitType="UpperLimit" metric="ResponseTime">
<limitValue value="{value}" unit="ms"/></limit></requirements>"""


def windows(imported, name):
    return [
        (p.task, str(p.anchor), str(p.point), str(p.to), str(p.match), str(p.max))
        for p in imported.model.task(name).versions[0].precedences
    ]


def triggering(*steps):
    sw = task("T", *steps) + task("U", ticks(100), stimuli="go?type=InterProcessStimulus")
    return sw + runnable("R", ticks(300), TRIGGER)


# A tick of the units of type A, whose version comes first, is 10 ns; those of type B are twice as fast.
@pytest.mark.parametrize(
    ("steps", "first", "last"),
    [
        ([ticks(500), TRIGGER], ("end", "None"), ("end", "None")),
        ([TRIGGER, ticks(500)], ("start", "None"), ("start", "None")),
        ([ticks(200), TRIGGER, ticks(500)], ("point", "1us"), ("point", "2us")),
        ([ticks(200), call("R")], ("end", "None"), ("end", "None")),
        ([call("R"), ticks(500)], ("point", "1.5us"), ("point", "3us")),
        ([call("R"), ticks(10), call("R"), ticks(900)], ("point", "1.5us"), ("point", "3us")),
        ([ticks(10), TWICE, ticks(900)], ("point", "50ns"), ("point", "6.1us")),
        ([ticks(10), WHILE, ticks(900)], ("point", "50ns"), ("point", "5.1us")),
    ],
)
def test_a_response_time_counts_from_the_trigger_to_the_end(tmp_path, steps, first, last):
    """The task starts after the last instant at which the trigger may come, and ends in time after the first."""
    imported = read(tmp_path, sw=triggering(*steps), stimuli=PLAIN_STIMULI + GO, constraints=response(5))
    name = "U" if len(imported.model.tasks) == 2 else "U@go"
    assert windows(imported, name) == [
        ("T", *last, "start", "cycle", "5ms"),
        ("T", *first, "end", "cycle", "5ms"),
    ]
    assert imported.model.task(name).deadline is None


EVENT_STIMULUS = '<stimuli xsi:type="am:EventStimulus" name="go" triggeringEvents="T{0}?type=ProcessEvent"/>'


@pytest.mark.parametrize(("kind", "anchor"), [("activate", "release"), ("start", "start"), ("terminate", "end")])
def test_a_response_time_counts_from_the_event_that_activates(tmp_path, kind, anchor):
    sw = task("T", ticks(500)) + task("U", ticks(100), stimuli="go?type=EventStimulus")
    stimuli = PLAIN_STIMULI + EVENT_STIMULUS.format(kind)
    imported = read(tmp_path, sw=sw, stimuli=stimuli, events=EVENTS, constraints=response(5))
    assert windows(imported, "U") == [
        ("T", anchor, "None", "start", "cycle", "5ms"),
        ("T", anchor, "None", "end", "cycle", "5ms"),
    ]


def test_the_activation_of_a_triggered_task_is_that_of_its_trigger(tmp_path):
    sw = task("S", ticks(100), TRIGGER.replace("go", "first"), ticks(800))
    sw += task("T", ticks(500), stimuli="first?type=InterProcessStimulus")
    sw += task("U", ticks(100), stimuli="go?type=EventStimulus")
    stimuli = PLAIN_STIMULI + stimulus("first", "InterProcessStimulus") + EVENT_STIMULUS.format("activate")
    imported = read(tmp_path, sw=sw, stimuli=stimuli, events=EVENTS, constraints=response(5))
    assert windows(imported, "U") == [
        ("S", "point", "1us", "start", "cycle", "5ms"),
        ("S", "point", "500ns", "end", "cycle", "5ms"),
    ]


def test_a_response_time_from_an_arrival_that_is_polled_for_warns(tmp_path):
    sw = task("T", ticks(500), stimuli="s?type=SporadicStimulus") + task(
        "U", ticks(100), stimuli="go?type=EventStimulus"
    )
    stimuli = SPORADIC + EVENT_STIMULUS.format("activate")
    imported = read(tmp_path, sw=sw, stimuli=stimuli, events=EVENTS, constraints=response(5))
    [finding] = found(imported.diagnostics, codes.NOT_IMPORTED)
    assert "limits of tasks count from instants that the model does not have: U" in finding.message


MODES = (
    '<modes xsi:type="am:EnumMode" name="M"><literals name="x"/><literals name="y"/></modes>'
    '<modeLabels name="m" mode="M?type=EnumMode"/>'
)
IN_X = '<entries xsi:type="am:ModeValueCondition" label="m?type=ModeLabel" value="x"/>'
OTHER = TRIGGER.replace("go", "other")
BRANCHED = f"""<items xsi:type="am:Switch"><entries name="e">{TRIGGER}<condition>{IN_X}</condition></entries>
<defaultEntry>{OTHER}</defaultEntry></items>"""
GUARDED = f"""<runnables name="G"><executionCondition>{IN_X}</executionCondition>
<activityGraph>{TRIGGER}{ticks(1)}</activityGraph></runnables>"""


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ([BRANCHED], {"x": ["T", "U"], "y": ["T", "V"]}),
        ([call("G"), OTHER], {"x": ["T", "U", "V"], "y": ["T", "V"]}),
        ([BRANCHED, OTHER], {"x": ["T", "U", "V"], "y": ["T", "V", "V"]}),
        ([BRANCHED.replace("other", "go")], {"default": ["T", "U"]}),
    ],
)
def test_a_task_runs_in_the_modes_in_which_it_is_triggered(tmp_path, steps, expected):
    sw = task("T", ticks(500), *steps) + MODES + GUARDED
    sw += "".join(
        task(name, ticks(9), stimuli=f"{go}?type=InterProcessStimulus") for name, go in (("U", "go"), ("V", "other"))
    )
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO + stimulus("other", "InterProcessStimulus"))
    ran = {m.name: sorted(run.task.partition("@")[0] for run in m.runs) for m in imported.model.modes}
    assert ran == expected


SINGLE = HARDWARE[: HARDWARE.index(' <modules xsi:type="am:ProcessingUnit" name="b0"')] + (
    "</structures>" + HARDWARE[HARDWARE.index('<domains xsi:type="am:FrequencyDomain" name="slow"') :]
)
SYNTHETIC = stimulus(
    "p20",
    "PeriodicSyntheticStimulus",
    '<recurrence value="20" unit="ms"/>',
    '<occurrenceTimes value="3" unit="ms"/><occurrenceTimes value="8" unit="ms"/>',
)


def apart(limit):
    return response(limit, "T").replace("ResponseTime", "StartToStart")


@pytest.mark.parametrize(
    ("source", "limit", "slacks"),
    [
        ("p10?type=PeriodicStimulus", 10, ["0"]),
        ("p10?type=PeriodicStimulus", 14, ["2/5"]),
        ("p20?type=PeriodicSyntheticStimulus", 15, ["0", "0"]),
        ("p20?type=PeriodicSyntheticStimulus", 17, ["1/10", "1/10"]),
    ],
)
def test_starts_are_as_far_apart_as_the_longest_gap_of_activations_allows(tmp_path, source, limit, slacks):
    sw = task("T", ticks(500), stimuli=source)
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + SYNTHETIC, constraints=apart(limit))
    assert [str(found.slack) for found in imported.model.tasks] == slacks
    refused = refusal(read, tmp_path, sw=sw, stimuli=PLAIN_STIMULI + SYNTHETIC, constraints=apart(10 - 1))
    assert len(found(refused.diagnostics, codes.STARTS_APART)) == 1


@pytest.mark.parametrize("limit", [10, 14])
def test_starts_nearer_than_the_longest_gap_are_possible_and_warn(tmp_path, limit):
    """Activated at 3 and 8 of 20 ms, a task that starts at 8 and 18 keeps 10 ms."""
    sw = task("T", ticks(500), stimuli="p20?type=PeriodicSyntheticStimulus")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + SYNTHETIC, constraints=apart(limit))
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1
    assert [found.slack for found in imported.model.tasks] == [1, 1]


SPORADIC_10 = stimulus(
    "s10",
    "RelativePeriodicStimulus",
    '<nextOccurrence xsi:type="am:TimeBoundaries"><lowerBound value="10" unit="ms"/></nextOccurrence>',
)


@pytest.mark.parametrize("source", ["p10?type=PeriodicStimulus", "s10?type=RelativePeriodicStimulus"])
@pytest.mark.parametrize(("work", "warns"), [(100_000, False), (99_999, True)])
def test_a_response_time_beyond_a_period_is_stricter_and_warns(tmp_path, source, work, warns):
    """A job of 1 ms that starts within the 10 ms after its activation ends within 11 ms."""
    sw = task("T", ticks(work), stimuli=source)
    options = {"stimuli": PLAIN_STIMULI + SPORADIC_10, "hw": SINGLE}
    imported = read(tmp_path, sw=sw, constraints=response(11, "T"), **options)
    assert len(found(imported.diagnostics, codes.STRICTER)) == warns


def test_starts_of_a_task_that_waits_or_has_stimuli_of_several_periods_warn(tmp_path):
    sw = task("T", ticks(5), stimuli="p10?type=PeriodicStimulus p20?type=PeriodicSyntheticStimulus")
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + SYNTHETIC, constraints=apart(12))
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


def test_a_response_time_of_every_second_trigger_counts_from_the_job_of_that_cycle(tmp_path):
    stimuli = PLAIN_STIMULI + stimulus("go", "InterProcessStimulus", '<counter prescaler="2"/>')
    imported = read(tmp_path, sw=triggering(ticks(5), TRIGGER), stimuli=stimuli, constraints=response(5))
    assert windows(imported, "U") == [
        ("T", "end", "None", "start", "cycle", "5ms"),
        ("T", "end", "None", "end", "cycle", "5ms"),
    ]


def test_a_response_time_of_a_periodic_task_is_its_deadline(tmp_path):
    imported = read(tmp_path, sw=triggering(TRIGGER), stimuli=PLAIN_STIMULI + GO, constraints=response(5, "T"))
    assert str(imported.model.task("T").deadline) == "5ms"


def test_a_response_time_of_a_triggered_task_that_waits_is_a_window_and_an_age(tmp_path):
    wait = '<items xsi:type="am:WaitEvent"><eventMask events="e?type=OsEvent"/></items>'
    give = '<items xsi:type="am:SetEvent"><eventMask events="e?type=OsEvent"/></items>'
    sw = task("T", ticks(1), TRIGGER)
    sw += task("U", ticks(100_000), wait, ticks(100_000), stimuli="go?type=InterProcessStimulus")
    sw += task("G", ticks(100_000), give) + '<events name="e"/>'
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + GO, constraints=response(5))
    [chain] = imported.model.chains
    assert (chain.tasks, chain.anchor, str(chain.max_age)) == (("U", "G", "U.2"), None, "4ms")
    assert windows(imported, "U") == [
        ("T", "end", "None", "start", "cycle", "1ms"),
        ("T", "end", "None", "start", "cycle", "1ms"),
    ]


def limits(imported):
    def shown(chain):
        kinds = {"latency": chain.max_latency, "reaction": chain.max_reaction, "age": chain.max_age}
        return {kind: str(limit) for kind, limit in kinds.items() if limit is not None}

    return [(c.tasks, str(c.anchor), str(c.to), shown(c)) for c in imported.model.chains]


def chained(tmp_path, first, last, kind, stimuli=PLAIN_STIMULI, source="p10?type=PeriodicStimulus", **options):
    constraints = (
        f'<eventChains name="c" stimulus="{first}?type=ProcessEvent" response="{last}?type=ProcessEvent"/>'
        '<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l" scope="c?type=EventChain" '
        f'type="{kind}"><maximum value="20" unit="ms"/></timingConstraints>'
    )
    sw = options.pop("sw", task("T", ticks(5), stimuli=source) + task("U", ticks(5)))
    return read(tmp_path, sw=sw, stimuli=stimuli, events=EVENTS, constraints=constraints)


@pytest.mark.parametrize(
    ("first", "last", "anchor", "to"),
    [
        ("Tstart", "Uterminate", "None", "None"),
        ("Tactivate", "Uterminate", "release", "None"),
        ("Tterminate", "Uterminate", "end", "None"),
        ("Tstart", "Ustart", "None", "start"),
        ("Tterminate", "Uactivate", "end", "start"),
    ],
)
@pytest.mark.parametrize(("kind", "limit"), [("Age", "age"), ("Reaction", "latency")])
def test_limits_count_between_their_events(tmp_path, first, last, anchor, to, kind, limit):
    imported = chained(tmp_path, first, last, kind)
    assert limits(imported) == [(("T", "U"), anchor, to, {limit: "20ms"})]


def test_other_events_of_processes_are_not_instants_and_warn(tmp_path):
    [finding] = found(chained(tmp_path, "Tpreempt", "Uterminate", "Age").diagnostics, codes.NOT_READ)
    assert 'eventType="preempt" of ProcessEvent is not imported' in finding.message


SPORADIC = stimulus(
    "s", "SporadicStimulus", '<stimulusDeviation><lowerBound value="10" unit="ms"/></stimulusDeviation>'
)


def test_a_latency_from_an_arrival_that_is_polled_for_is_a_reaction_time(tmp_path):
    options = {"stimuli": PLAIN_STIMULI + SPORADIC, "source": "s?type=SporadicStimulus"}
    imported = chained(tmp_path, "Tactivate", "Uterminate", "Reaction", **options)
    assert limits(imported) == [(("T", "U"), "None", "None", {"reaction": "20ms"})]
    imported = chained(tmp_path, "Tactivate", "Uterminate", "Age", **options)
    assert limits(imported) == [(("T", "U"), "None", "None", {})]
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


@pytest.mark.parametrize("kind", ["Age", "Reaction"])
def test_a_limit_from_the_activation_of_a_triggered_task_warns(tmp_path, kind):
    sw = task("S", ticks(5), TRIGGER) + task("T", ticks(5), stimuli="go?type=InterProcessStimulus")
    sw += task("U", ticks(5))
    imported = chained(tmp_path, "Tactivate", "Uterminate", kind, stimuli=PLAIN_STIMULI + GO, sw=sw)
    assert limits(imported) == [(("T", "U"), "None", "None", {})]
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


def test_a_chain_has_one_path_for_each_activation_of_its_ends(tmp_path):
    both = PLAIN_STIMULI + PLAIN_STIMULI.replace("p10", "q10")
    imported = chained(
        tmp_path,
        "Tstart",
        "Uterminate",
        "Age",
        stimuli=both,
        source="p10?type=PeriodicStimulus q10?type=PeriodicStimulus",
    )
    assert [tasks for tasks, *_ in limits(imported)] == [("T@p10", "U"), ("T@q10", "U")]


def delay(first, last, more=""):
    return f"""<timingConstraints xsi:type="am:DelayConstraint" name="d" source="{first}?type=ProcessEvent"
target="{last}?type=ProcessEvent"{more}><upper value="4" unit="ms"/><lower value="1" unit="ms"/></timingConstraints>"""


def test_a_delay_may_count_from_an_activation_but_not_to_one(tmp_path):
    sw = task("T", ticks(5)) + task("U", ticks(5))
    imported = read(tmp_path, sw=sw, events=EVENTS, constraints=delay("Tactivate", "Ustart"))
    assert windows(imported, "U") == [("T", "release", "None", "start", "window", "4ms")]
    imported = read(tmp_path, sw=sw, events=EVENTS, constraints=delay("Tstart", "Uactivate"))
    assert len(found(imported.diagnostics, codes.BAD_CHAIN)) == 1
    more = ' mappingType="Reaction"'
    imported = read(tmp_path, sw=sw, events=EVENTS, constraints=delay("Tactivate", "Ustart", more))
    assert len(found(imported.diagnostics, codes.REACTION)) == 1


def test_a_delay_to_the_end_of_a_preemptive_task_is_a_window_to_the_end(tmp_path):
    sw = task("T", ticks(5)) + task("U", call("R"), call("R")).replace("<tasks ", '<tasks preemption="cooperative" ')
    imported = read(tmp_path, sw=sw + runnable("R", ticks(5)), events=EVENTS, constraints=delay("Tstart", "Uterminate"))
    assert windows(imported, "U") == [("T", "start", "None", "end", "window", "4ms")]


# --------------------------------------------------------------------------------------------------- locks


def lock(access, name="L"):
    return f'<items xsi:type="am:SemaphoreAccess" semaphore="{name}?type=Semaphore" access="{access}"/>'


def held(tmp_path, *steps, semaphore='<semaphores name="L" maxValue="1"/>', more="", **options):
    sw = task("T", *steps) + runnable("R", ticks(100), lock("request"), ticks(200), lock("release")) + more
    imported = read(tmp_path, sw=sw, os=semaphore, **options)
    [version, *_] = imported.model.task("T").versions
    kinds = {resource.name: str(resource.kind) for resource in imported.model.resources}
    spans = [(a.resource, str(a.start), str(a.end)) for a in version.accesses if kinds[a.resource] == "lock"]
    return spans, [d.message for d in found(imported.diagnostics, codes.NOT_READ)]


REQUEST, RELEASE = lock("request"), lock("release")


@pytest.mark.parametrize(
    ("steps", "spans"),
    [
        ([REQUEST, ticks(600), RELEASE], [("L", "0ms", "6us")]),
        ([ticks(100), REQUEST, ticks(600), RELEASE, ticks(300)], [("L", "1us", "7us")]),
        ([lock("exclusive"), ticks(600), RELEASE], [("L", "0ms", "6us")]),
        ([call("R"), call("R")], [("L", "1us", "3us"), ("L", "4us", "6us")]),
        ([REQUEST, ticks(100), RELEASE, REQUEST, ticks(100), RELEASE], [("L", "0ms", "2us")]),
        ([REQUEST, RELEASE, ticks(100)], []),
        (['<items xsi:type="am:Group">', REQUEST, ticks(100), RELEASE, "</items>", ticks(100)], [("L", "0ms", "1us")]),
        (
            [
                ticks(100),
                '<items xsi:type="am:ProbabilitySwitch"><entries>',
                *(ticks(50), REQUEST, ticks(100), RELEASE),
                f"</entries><entries>{ticks(300)}</entries></items>",
                ticks(100),
            ],
            [("L", "1us", "4us")],
        ),
    ],
)
def test_a_semaphore_is_a_lock_from_its_request_to_its_release(tmp_path, steps, spans):
    assert held(tmp_path, *steps) == (spans, [])


def test_requests_without_release_hold_to_the_end_and_warn(tmp_path):
    spans, warnings = held(tmp_path, ticks(100), REQUEST, ticks(100))
    assert spans == [("L", "1us", "2us")]
    assert len(warnings) == 1
    assert len(held(tmp_path, ticks(100), RELEASE)[1]) == 1


def test_a_semaphore_that_several_may_hold_is_no_lock_and_warns(tmp_path):
    spans, warnings = held(tmp_path, REQUEST, ticks(5), RELEASE, semaphore='<semaphores name="L" maxValue="2"/>')
    assert spans == []
    assert warnings == ["1 semaphores may be held several times, so they exclude nothing: L"]


def test_points_within_a_lock_stay_and_pieces_too(tmp_path):
    sw = task("T", REQUEST, call("R"), call("R"), RELEASE).replace("<tasks ", '<tasks preemption="cooperative" ')
    imported = read(tmp_path, sw=sw + runnable("R", ticks(100)), os='<semaphores name="L"/>')
    [version, *_] = imported.model.task("T").versions
    assert [str(p) for p in version.split.points] == ["1us"]
    assert [(str(a.start), str(a.end)) for a in version.accesses] == [("0ms", "2us")]


def test_calls_that_double_at_each_level_are_followed_only_so_far(tmp_path):
    levels = "".join(runnable(f"R{n}", call(f"R{n + 1}"), call(f"R{n + 1}")) for n in range(40))
    sw = task("T", call("R0")) + levels + runnable("R40", REQUEST, ticks(0), RELEASE)
    imported = read(tmp_path, sw=sw, os='<semaphores name="L"/>')
    assert [r.name for r in imported.model.resources] == ["L"]


# ------------------------------------------------------------------------------------------ timed accesses


def access(implementation, kind="read"):
    return f'<items xsi:type="am:LabelAccess" data="L?type=Label" access="{kind}" implementation="{implementation}"/>'


@pytest.mark.parametrize(("deadline", "let"), [(None, "10ms"), (8, "8ms"), (12, "10ms")])
def test_timed_accesses_make_a_logical_execution_time(tmp_path, deadline, let):
    sw = task("T", ticks(5), access("timed")) + '<labels name="L"/>'
    imported = read(tmp_path, sw=sw, constraints=response(deadline, "T") if deadline else "")
    assert str(imported.model.task("T").let) == let
    assert found(imported.diagnostics, codes.NOT_READ) == []


@pytest.mark.parametrize(("deadline", "lets"), [(None, ["5ms", "15ms"]), (7, ["5ms", "7ms"])])
def test_a_logical_execution_time_ends_at_the_next_activation_of_several(tmp_path, deadline, lets):
    sw = task("T", ticks(5), access("timed"), stimuli="p20?type=PeriodicSyntheticStimulus") + '<labels name="L"/>'
    stimuli = PLAIN_STIMULI + SYNTHETIC
    imported = read(tmp_path, sw=sw, stimuli=stimuli, constraints=response(deadline, "T") if deadline else "")
    assert [str(found.let) for found in imported.model.tasks] == lets


@pytest.mark.parametrize("other", ["q10", "p20"])
def test_timed_accesses_of_activations_that_meet_or_have_no_common_period_warn(tmp_path, other):
    both = PLAIN_STIMULI + PLAIN_STIMULI.replace("p10", "q10") + SYNTHETIC
    kind = "PeriodicSyntheticStimulus" if other == "p20" else "PeriodicStimulus"
    sw = task("T", ticks(5), access("timed"), stimuli=f"p10?type=PeriodicStimulus {other}?type={kind}")
    imported = read(tmp_path, sw=sw + '<labels name="L"/>', stimuli=both)
    assert {found.let for found in imported.model.tasks} == {None}
    assert len(found(imported.diagnostics, codes.NOT_READ)) == 1


def in_mode(name, period, mode):
    condition = "<executionCondition>" + IN_X.replace('value="x"', f'value="{mode}"') + "</executionCondition>"
    return stimulus(name, "PeriodicStimulus", condition, f'<recurrence value="{period}" unit="ms"/>')


def test_the_next_activation_is_one_of_the_same_mode(tmp_path):
    sw = task("T", ticks(5), access("timed"), stimuli="p?type=PeriodicStimulus q?type=PeriodicStimulus")
    stimuli = in_mode("p", 10, "x") + in_mode("q", 20, "y")
    imported = read(tmp_path, sw=sw + MODES + '<labels name="L"/>', stimuli=stimuli, constraints=apart(24))
    assert [(str(t.let), str(t.slack)) for t in imported.model.tasks] == [("10ms", "1"), ("20ms", "1/5")]
    assert found(imported.diagnostics, codes.NOT_READ) + found(imported.diagnostics, codes.NOT_IMPORTED) == []


@pytest.mark.parametrize(
    ("kind", "source", "target", "is_stricter"),
    [
        ("Age", "p20?type=PeriodicSyntheticStimulus", "p10?type=PeriodicStimulus", True),
        ("Reaction", "p20?type=PeriodicSyntheticStimulus", "p10?type=PeriodicStimulus", False),
        ("Age", "p10?type=PeriodicStimulus", "p20?type=PeriodicSyntheticStimulus", False),
        ("Reaction", "p10?type=PeriodicStimulus", "p20?type=PeriodicSyntheticStimulus", True),
        ("Age", "p?type=PeriodicStimulus q?type=PeriodicStimulus", "p10?type=PeriodicStimulus", False),
    ],
)
def test_limits_that_each_activation_keeps_alone_warn(tmp_path, kind, source, target, is_stricter):
    """Where another activation of the same mode could keep the limit instead; p and q have modes of their own."""
    sw = task("T", ticks(5), stimuli=source) + task("U", ticks(5), stimuli=target) + MODES
    stimuli = PLAIN_STIMULI + SYNTHETIC + in_mode("p", 10, "x") + in_mode("q", 20, "y")
    imported = chained(tmp_path, "Tstart", "Uterminate", kind, stimuli=stimuli, sw=sw)
    assert len(found(imported.diagnostics, codes.STRICTER)) == is_stricter


THROUGH = (
    '<events xsi:type="am:ProcessEvent" name="Vstart" eventType="start" entity="V?type=Task"/>'
    '<events xsi:type="am:ProcessEvent" name="Vterminate" eventType="terminate" entity="V?type=Task"/>'
)


def through(tmp_path, kind, source):
    """A chain from T to U through V, which `source` activates."""
    ends = (("a", "Tstart", "Vstart"), ("b", "Vterminate", "Uterminate"))
    chains = "".join(
        f'<eventChains name="{name}" stimulus="{first}?type=ProcessEvent" response="{last}?type=ProcessEvent"/>'
        for name, first, last in ends
    )
    items = "".join(
        f'<items xsi:type="am:EventChainReference" eventChain="{name}?type=EventChain"/>' for name, *_ in ends
    )
    chains += (
        f'<eventChains name="c" stimulus="Tstart?type=ProcessEvent" response="Uterminate?type=ProcessEvent">{items}'
        "</eventChains>"
    )
    limit = (
        f'<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l" type="{kind}" '
        'scope="c?type=EventChain">'
        '<maximum value="20" unit="ms"/></timingConstraints>'
    )
    sw = task("T", ticks(5)) + task("V", ticks(5), stimuli=source) + task("U", ticks(5)) + MODES
    stimuli = PLAIN_STIMULI + SYNTHETIC + in_mode("p", 10, "x") + in_mode("q", 20, "y")
    return read(tmp_path, sw=sw, stimuli=stimuli, events=EVENTS + THROUGH, constraints=chains + limit)


@pytest.mark.parametrize("kind", ["Age", "Reaction"])
def test_a_chain_passes_a_task_in_each_of_its_modes(tmp_path, kind):
    imported = through(tmp_path, kind, "p?type=PeriodicStimulus q?type=PeriodicStimulus")
    limited = [c.tasks for c in imported.model.chains if c.max_age or c.max_latency]
    assert limited == [("T", "V@p", "U"), ("T", "V@q", "U")]
    assert found(imported.diagnostics, codes.STRICTER) == []


@pytest.mark.parametrize("kind", ["Age", "Reaction"])
def test_a_chain_passes_one_activation_of_a_mode_and_warns(tmp_path, kind):
    imported = through(tmp_path, kind, "p20?type=PeriodicSyntheticStimulus")
    assert len([c for c in imported.model.chains if c.max_age or c.max_latency]) == 1
    assert len(found(imported.diagnostics, codes.STRICTER)) == 1


def test_a_limit_through_several_activations_of_a_task_that_waits_warns(tmp_path):
    """The chain has the parts of the first activation; without a limit nothing is lost."""
    wait, sets = (
        f'<items xsi:type="am:{kind}"><eventMask events="done?type=OsEvent"/></items>'
        for kind in ("WaitEvent", "SetEvent")
    )
    sw = task("T", ticks(5), wait, ticks(5), stimuli="p20?type=PeriodicSyntheticStimulus")
    sw += task("U", ticks(5), sets) + '<events name="done"/>'
    stimuli = PLAIN_STIMULI + SYNTHETIC
    for kind, warns in (("Age", 1), ("None", 0)):
        imported = chained(tmp_path, "Tstart", "Uterminate", kind, sw=sw, stimuli=stimuli)
        told = [d for d in found(imported.diagnostics, codes.NOT_IMPORTED) if "tasks that wait" in d.message]
        assert len(told) == warns


def test_an_age_of_several_writers_is_kept_by_each_and_warns(tmp_path):
    sw = "".join(task(name, ticks(5), access("explicit", "write")) for name in "TV") + task("U", call("R"))
    sw += runnable("R", access("explicit")) + '<labels name="L"/>'
    age = """<dataAgeConstraints name="a" runnable="R?type=Runnable" label="L?type=Label">
<dataAge xsi:type="am:DataAgeTime"><maximumTime value="20" unit="ms"/></dataAge></dataAgeConstraints>"""
    imported = read(tmp_path, sw=sw, constraints=age)
    assert [c.tasks for c in imported.model.chains] == [("T", "U"), ("V", "U")]
    assert len(found(imported.diagnostics, codes.STRICTER)) == 1


def test_other_accesses_beside_timed_ones_are_a_listed_default(tmp_path):
    sw = task("T", ticks(5), access("timed"), access("implicit")) + task("U", access("explicit")) + '<labels name="L"/>'
    imported = read(tmp_path, sw=sw)
    assert imported.model.task("U").let is None
    assert [d.what for d in imported.coverage.defaulted_values if d.element == 'task "T"'][-1] != "slack"
    assert "logical execution time" in [d.what for d in imported.coverage.defaulted_values]


def test_timed_accesses_of_a_triggered_task_warn(tmp_path):
    sw = task("T", ticks(5), TRIGGER) + task("U", access("timed"), stimuli="go?type=InterProcessStimulus")
    imported = read(tmp_path, sw=sw + '<labels name="L"/>', stimuli=PLAIN_STIMULI + GO)
    assert imported.model.task("U").let is None
    [finding] = found(imported.diagnostics, codes.NOT_READ)
    assert finding.message.startswith("1 timed accesses are made by tasks that wait")


def test_jobs_of_a_task_with_several_activations_never_overlap(tmp_path):
    both = PLAIN_STIMULI + PLAIN_STIMULI.replace("p10", "q10")
    sw = task("T", ticks(500), stimuli="p10?type=PeriodicStimulus q10?type=PeriodicStimulus")
    imported = read(tmp_path, sw=sw + task("U", ticks(500)), stimuli=both)
    held = {
        t.name: [(a.resource, str(a.start), str(a.end)) for a in t.versions[0].accesses] for t in imported.model.tasks
    }
    assert held == {"T@p10": [("T", "0ms", "5us")], "T@q10": [("T", "0ms", "5us")], "U": []}
    assert [(r.name, str(r.kind)) for r in imported.model.resources] == [("T", "lock")]
    bound = '<schedulerAllocation scheduler="S0?type=TaskScheduler" responsibility="a0?type=ProcessingUnit"/>'
    bound += '<taskAllocation task="T?type=Task" scheduler="S0?type=TaskScheduler"/>'
    os = '<operatingSystems name="O"><taskSchedulers name="S0"/></operatingSystems>'
    assert read(tmp_path, sw=sw, stimuli=both, mapping=bound, os=os).model.resources == ()


def often(tmp_path, count):
    """A limit between two tasks, each with as many activations at unlike distances."""
    times = "".join(f'<occurrenceTimes value="{3 * k + k % 2}" unit="ms"/>' for k in range(count))
    recurrence = '<recurrence value="1" unit="s"/>'
    stimuli = "".join(stimulus(name, "PeriodicSyntheticStimulus", recurrence, times) for name in "st")
    sw = "".join(
        task(name, ticks(5), stimuli=f"{source}?type=PeriodicSyntheticStimulus")
        for name, source in zip("TU", "st", strict=True)
    )
    return chained(tmp_path, "Tstart", "Uterminate", "Reaction", stimuli, sw=sw)


def test_activations_of_both_ends_of_a_chain_multiply_up_to_a_limit(tmp_path):
    imported = often(tmp_path, 30)
    assert len(imported.model.chains) == 900
    assert found(imported.diagnostics, codes.STRICTER)
    *_, error = refusal(often, tmp_path, 142).diagnostics
    assert (error.code, error.path) == ("HAL0008", 'EventChain "c"')


RUNS = "".join(
    f'<events xsi:type="am:RunnableEvent" name="{name}{kind}" eventType="{kind}" entity="{name}?type=Runnable"/>'
    for name in "QRI"
    for kind in ("start", "terminate")
)
CAME = '<events xsi:type="am:StimulusEvent" name="came" entity="p10?type=PeriodicStimulus"/>'
OWN = CAME + "".join(f"<events{text}" for text in EVENTS.split("<events") if 'entity="T?' in text)


@pytest.mark.parametrize(
    ("first", "last", "is_back"),
    [
        ("Tterminate", "Tstart", True),
        ("Tstart", "Tactivate", True),
        ("Tstart", "Tstart", True),
        ("Tactivate", "Tterminate", False),
        ("Rterminate", "Qstart", True),
        ("Qterminate", "Rstart", False),
        ("Rterminate", "Rstart", True),
        ("Rstart", "Rterminate", False),
        ("Iterminate", "Rterminate", False),  # R calls I
        ("Tterminate", "Rstart", True),
        ("Qstart", "Tterminate", False),
        ("Qstart", "Tstart", False),  # Q is what T begins with
        ("came", "Tstart", False),
    ],
)
def test_chains_that_return_to_an_earlier_event_of_a_job_are_not_read_as_one_job(tmp_path, first, last, is_back):
    def kind(name):
        kinds = {"T": "ProcessEvent", "c": "StimulusEvent"}
        return kinds.get(name[0], "RunnableEvent")

    constraints = (
        f'<eventChains name="c" stimulus="{first}?type={kind(first)}" response="{last}?type={kind(last)}"/>'
        '<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l" scope="c?type=EventChain" '
        'type="Reaction"><maximum value="20" unit="ms"/></timingConstraints>'
    )
    sw = task("T", call("Q"), call("R")) + runnable("Q", ticks(5)) + runnable("R", call("I")) + runnable("I", ticks(5))
    imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI, events=OWN + RUNS, constraints=constraints)
    assert bool(found(imported.diagnostics, codes.RETURNS)) == is_back
    assert bool(found(imported.diagnostics, codes.NOT_IMPORTED)) == is_back
    assert len(imported.model.chains) == (not is_back)
