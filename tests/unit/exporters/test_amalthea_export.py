"""What an export to AMALTHEA holds: releases, offsets and mapping of a schedule, modes, rounded and exact values."""

from dataclasses import replace
from fractions import Fraction

import pytest
from exporter_samples import roboracer
from lxml import etree

from golden_file import assert_golden
from growth import growth, half_way
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.amalthea import FORMAT, RELEASES, AmaltheaOptions
from halpipe.exporters.amalthea.stimuli import stimuli_of
from halpipe.exporters.common.codes import DANGLING_NAME, FOREIGN_SCHEDULE
from halpipe.exporters.common.names import refuse_dangling
from halpipe.importers.amalthea import FORMAT as IN
from halpipe.importers.amalthea import AmaltheaImportOptions
from halpipe.models import Anchor, Chain, ModeSchedule, Precedence, Resource, ResourceKind, Status
from halpipe.models.modes import UNKNOWN_MODE
from stated_options import stated
from support import access, after, chain, job, mode, model, ms, schedule, task, version

XSI = "{http://www.w3.org/2001/XMLSchema-instance}type"
FAST, SLOW = version("fast", "2ms", "u1 u2"), version("slow", "4ms", "u1 u2")
PUMP = task("pump", "10ms", FAST, SLOW)
VALVE = task("valve", "20ms", version("v", "1/3ms", "u2", after("pump", 0, 8, "end")), deadline="15ms", offset="5ms")
SYSTEM = model(PUMP, VALVE, units="u1 u2", chains=[chain("c", "pump valve", reaction="40ms", age="30ms")])
JOBS = (
    job(SYSTEM, "pump", 0, "1ms", "u1", "fast"),
    job(SYSTEM, "pump", 1, "11ms", "u1", "fast"),
    job(SYSTEM, "valve", 0, "5ms", "u2"),
)
PLAN = schedule(SYSTEM, "20ms", *JOBS)


def write(system=SYSTEM, plan=None, **options):
    return etree.fromstring(FORMAT.write(system, plan, AmaltheaOptions(**options))[""])


def stimuli(root):
    """Name to (class, recurrence, offset or instants, modes, versions set)."""
    return {
        s.get("name"): (
            s.get(XSI).removeprefix("am:"),
            times(s, "recurrence")[0],
            times(s, "offset") + times(s, "occurrenceTimes"),
            [e.get("value") for e in s.iterfind("executionCondition/entries")],
            [e.get("value") for e in s.iterfind("setModeValueList/entries")],
        )
        for s in root.iter("stimuli")
    }


def times(element, tag):
    return [child.get("value") + child.get("unit") for child in element.iterchildren(tag)]


def affinities(root):
    return {a.get("task"): a.get("affinity").split() for a in root.iter("taskAllocation")}


def properties(element):
    return {p.get("key"): p[0].get("value") for p in element.iterchildren("customProperties")}


def refusal(*arguments, **options):
    with pytest.raises(HalpipeError) as refused:
        write(*arguments, **options)
    return [(d.code, d.path) for d in refused.value.diagnostics]


@pytest.mark.parametrize("release", RELEASES)
def test_each_release_has_its_namespace_and_its_own_switch(release):
    root = write(release=release)
    assert root.tag == f"{{http://app4mc.eclipse.org/amalthea/{release}}}Amalthea"
    kinds = {item.get(XSI) for item in root.iterfind("swModel/tasks/activityGraph/items")}
    assert kinds == {"am:RunnableCall", "am:ModeSwitch" if release == "1.2.0" else "am:Switch"}
    assert (root.find("osModel/schedulerDefinitions") is None) == (release == "1.2.0")


def test_without_a_schedule_the_model_speaks_for_itself():
    root = write()
    assert stimuli(root) == {
        "pump": ("PeriodicStimulus", "10ms", [], [], []),
        "valve": ("PeriodicStimulus", "20ms", ["5ms"], [], []),
    }
    assert affinities(root)["pump?type=Task"] == ["u1?type=ProcessingUnit", "u2?type=ProcessingUnit"]


def test_a_schedule_gives_offsets_versions_and_units():
    root = write(plan=PLAN)
    assert stimuli(root) == {
        "pump": ("PeriodicStimulus", "10ms", ["1ms"], [], ["fast"]),
        "valve": ("PeriodicStimulus", "20ms", ["5ms"], [], []),
    }
    assert affinities(root) == {
        "pump?type=Task": ["u1?type=ProcessingUnit"],
        "valve?type=Task": ["u2?type=ProcessingUnit"],
    }


def test_jobs_that_are_not_equally_far_apart_are_instants_of_a_synthetic_stimulus():
    jobs = (JOBS[0], replace(JOBS[1], start=ms("12ms"), end=ms("14ms")), JOBS[2])
    found = stimuli(write(plan=schedule(SYSTEM, "20ms", *jobs)))
    assert found["pump"] == ("PeriodicSyntheticStimulus", "20ms", ["1ms", "12ms"], [], ["fast"])


def test_jobs_of_different_versions_or_units_have_stimuli_of_their_own():
    other = job(SYSTEM, "pump", 1, "11ms", "u2", "slow")
    root = write(plan=schedule(SYSTEM, "20ms", JOBS[0], other, JOBS[2]))
    found = stimuli(root)
    assert found["pump"] == ("PeriodicStimulus", "20ms", ["1ms"], [], ["fast"])
    assert found["pump~2"] == ("PeriodicStimulus", "20ms", ["11ms"], [], ["slow"])
    assert affinities(root)["pump?type=Task"] == ["u1?type=ProcessingUnit", "u2?type=ProcessingUnit"]
    tasks = {t.get("name"): t.get("stimuli") for t in root.iter("tasks")}
    assert tasks["pump"] == "pump?type=PeriodicStimulus pump%7E2?type=PeriodicStimulus"


def two_modes():
    system = replace(SYSTEM, modes=(mode("run", [PUMP, VALVE]), mode("stop", [PUMP])))
    stop = ModeSchedule(
        name="stop",
        hyperperiod=ms("10ms"),
        status=Status.VALID,
        jobs=(replace(JOBS[0], start=ms("3ms"), end=ms("5ms")),),
    )
    return system, replace(PLAN, modes=(replace(PLAN.modes[0], name="run"), stop))


def test_in_several_modes_stimuli_have_conditions():
    system, plan = two_modes()
    assert {name: rest[2:4] for name, (*rest,) in stimuli(write(system, plan)).items()} == {
        "pump@run": [["1ms"], ["run"]],
        "pump@stop": [["3ms"], ["stop"]],
        "valve@run": [["5ms"], ["run"]],
    }
    assert {name: modes for name, (_, _, _, modes, _) in stimuli(write(system)).items()} == {
        "pump": [],
        "valve": ["run"],
    }


def test_one_mode_only():
    system, plan = two_modes()
    root = write(system, plan, mode="stop")
    assert [e.get("name") for e in root.iterfind("swModel/modes[@name='SystemMode']/literals")] == ["stop"]
    assert list(stimuli(root)) == ["pump"]
    assert refusal(system, plan, mode="halt") == [(UNKNOWN_MODE.id, "")]


def test_a_schedule_of_another_model_is_refused():
    codes = refusal(model(PUMP, units="u1 u2"), PLAN)
    assert {code for code, _ in codes} == {FOREIGN_SCHEDULE.id}


def test_ticks_are_nanoseconds_rounded_up_for_each_kind_of_unit():
    units = (replace(SYSTEM.units[0], type="big"), replace(SYSTEM.units[1], type="little"))
    root = write(replace(SYSTEM, units=units))
    runnables = {r.get("name"): r for r in root.iter("runnables")}
    stated = {e.get("key"): e[0].get("value") for e in runnables["valve/v"].iter("extended")}
    assert stated == {"little?type=ProcessingUnitDefinition": "333334"}
    assert len(list(runnables["pump/fast"].iter("extended"))) == 2
    assert [d.get("value") + d.get("unit") for d in root.iter("defaultValue")] == ["1.0GHz"]


def test_limits_windows_and_chains_are_standard_elements():
    root = write()
    (window,) = root.iterfind("constraintsModel/timingConstraints[@source]")
    events = {e.get("name"): (e.get("eventType"), e.get("entity")) for e in root.iter("events")}
    assert (window.get("source"), window.get("target")) == (
        "pump%2Fterminate?type=ProcessEvent",
        "valve%2Fstart?type=ProcessEvent",
    )
    assert events["pump/terminate"] == ("terminate", "pump?type=Task")
    assert times(window, "upper") + times(window, "lower") == ["8ms", "0s"]
    (found,) = root.iter("eventChains")
    assert [link[0].get("response") for link in found.iter("items")] == ["valve%2Fterminate?type=ProcessEvent"]
    limits = {c.get("type"): times(c, "maximum") for c in root.iterfind("constraintsModel/timingConstraints[@scope]")}
    assert limits == {"Reaction": ["30ms"], "Age": ["30ms"]}
    (deadline,) = root.iter("requirements")
    assert (deadline.get("process"), times(deadline[0], "limitValue")) == ("valve?type=Task", ["15ms"])


def test_what_amalthea_rounds_stands_exact_in_the_native_model():
    odd = task("odd", "1/30s", version("v", "1ms", "u1"), deadline="1/60s")
    root = write(model(odd))
    (stimulus,) = root.iter("stimuli")
    assert times(stimulus, "recurrence") == ["33333333333ps"]
    (stated,) = etree.fromstring(properties(root)["halpipe:model.0"]).iter("{*}task")
    assert (stated.get("period"), stated.get("deadline")) == (str(odd.period), str(odd.deadline))


def test_memories_have_their_bandwidth():
    reader = task("t", "10ms", version("v", "1ms", "u1", access("ram", 0, 1)))
    system = model(reader, resources="ram")
    system = replace(system, resources=(replace(system.resources[0], bandwidth=10**9),))
    (rate,) = write(system).iter("dataRate")
    assert (rate.get("value"), rate.get("unit")) == ("1000000000", "BPerSecond")


def test_names_of_what_is_not_there_are_all_refused():
    bad = version("v", "1ms", "u9", access("rom", 0, 1), after("ghost", 0, 1))
    lone = replace(task("t", "10ms", bad))
    system = model(lone, chains=[chain("c", "t nobody")], transitions=[("all", "none", None)])
    assert refusal(system) == [
        (DANGLING_NAME.id, path)
        for path in (*['task "t", version "v"'] * 3, 'chain "c"', 'transition from "all" to "none"')
    ]
    with_version = replace(system.modes[0].runs[0], versions=("w",))
    fine = model(task("t", "10ms", version("v", "1ms", "u1")))
    assert refusal(replace(fine, modes=(replace(fine.modes[0], runs=(with_version,)),))) == [
        (DANGLING_NAME.id, 'mode "all", task "t"')
    ]


def test_the_same_input_gives_the_same_bytes():
    assert FORMAT.write(SYSTEM, PLAN, AmaltheaOptions()) == FORMAT.write(SYSTEM, PLAN, AmaltheaOptions())


def test_pipeline_files_may_state_the_release():
    assert stated(FORMAT, "release: 2.1.0", mode="run") == (AmaltheaOptions(mode="run", release="2.1.0"), [])


def test_the_export_of_the_paper_is_the_golden_one():
    assert_golden("roboracer.amxmi", FORMAT.write(*roboracer(), AmaltheaOptions())[""].decode())


# Without the native model, the standard elements alone say the same demands, or stronger ones.


def standard(tmp_path, system):
    """What the import makes of the standard elements of an export."""
    root = etree.fromstring(FORMAT.write(system, None, AmaltheaOptions())[""])
    for element in list(root.iter("customProperties")):
        element.getparent().remove(element)
    path = tmp_path / "standard.amxmi"
    path.write_bytes(etree.tostring(root))
    imported = IN.read([str(path)], AmaltheaImportOptions()).completed()
    assert found_codes(imported) == set()
    return imported.model


def found_codes(imported):
    return {d.code for d in imported.diagnostics if d.code == "HAL1252"}


def requirements(let=None, slack=0, **chain_limits):
    first = replace(task("a", "20ms", version("v", "2ms", "u1"), offset="0ms", slack=slack), let=let)
    second = task("b", "20ms", version("v", "2ms", "u1"), offset="0ms", slack=1)
    whole = Chain(name="c", tasks=("a", "b"), **chain_limits)
    return model(first, second, chains=[whole])


@pytest.mark.parametrize(
    ("stated", "slack", "limit"),
    [
        ({"max_latency": ms("30ms")}, 0, "30ms"),
        ({"max_reaction": ms("50ms")}, 0, "30ms"),
        ({"max_reaction": ms("50ms")}, Fraction(1, 4), "25ms"),
        ({"max_reaction": ms("50ms"), "max_latency": ms("28ms")}, 0, "28ms"),
    ],
)
def test_a_limit_that_is_written_is_at_least_the_demand_of_the_model(tmp_path, stated, slack, limit):
    [chain] = standard(tmp_path, requirements(slack=slack, **stated)).chains
    assert str(chain.max_latency) == limit


def test_events_of_chains_come_out_again(tmp_path):
    stated_model = requirements(max_age=ms("30ms"), anchor=Anchor.RELEASE, to=Anchor.START)
    [chain] = standard(tmp_path, stated_model).chains
    assert (chain.anchor, chain.to, str(chain.max_age)) == (Anchor.RELEASE, Anchor.START, "30ms")


def test_a_logical_execution_time_comes_out_again(tmp_path):
    assert str(standard(tmp_path, requirements(let=ms("8ms"))).task("a").let) == "8ms"


def test_locks_come_out_again(tmp_path):
    held = [access("spin", "1ms", "2ms"), access("spin", "2500us", "4ms")]
    held_model = model(task("a", "20ms", version("v", "5ms", "u1", *held)))
    held_model = replace(held_model, resources=(Resource(name="spin", kind=ResourceKind.LOCK),))
    again = standard(tmp_path, held_model)
    assert [(r.name, r.kind) for r in again.resources] == [("spin", ResourceKind.LOCK)]
    spans = [(str(a.start), str(a.end)) for a in again.task("a").versions[0].accesses]
    assert spans == [("1ms", "2ms"), ("2.5ms", "4ms")]


@pytest.mark.parametrize(("anchor", "to"), [(Anchor.RELEASE, Anchor.START), (Anchor.END, Anchor.END)])
def test_windows_come_out_again(tmp_path, anchor, to):
    row = Precedence(task="a", anchor=anchor, to=to, min=ms("1ms"), max=ms("9ms"))
    first = task("a", "20ms", version("v", "2ms", "u1"), offset="0ms")
    second = task("b", "20ms", replace(version("v", "2ms", "u1"), precedences=(row,)), slack=1)
    [again] = standard(tmp_path, model(first, second)).task("b").versions[0].precedences
    assert (again.task, again.anchor, again.to, str(again.max)) == ("a", anchor, to, "9ms")


def test_the_time_of_an_export_grows_with_the_model_alone():
    """Runs, versions and jobs of a task are looked up, never searched for; the rest is one element after the other."""

    def prepare(count):
        tasks = [
            task(f"t{n}", "10ms", version("v", "1us", "u1", *([after("t0", "0ms", "10ms")] if n else [])))
            for n in range(count)
        ]
        chains = [chain(f"c{n}", f"t0 t{n}", "30ms") for n in range(1, count)]
        system = model(*tasks, chains=chains)
        jobs = (job(system, f"t{n}", 0, f"{n}us", "u1") for n in range(count))
        plan = schedule(system, "10ms", *jobs)
        return lambda: (refuse_dangling(system), stimuli_of(system, plan))

    assert growth(prepare, 300, 2400) < half_way(8)


@pytest.mark.parametrize("many", [1, 3, 10**6])
def test_what_is_written_as_it_is_made_is_the_same(tmp_path, monkeypatch, many):
    """The bytes, and the hash by which an import knows that nothing was edited, are those of a whole tree."""
    system, plan = roboracer()
    monkeypatch.setattr("halpipe.exporters.amalthea.document._AT_A_TIME", 64)
    expected = FORMAT.write(system, plan, AmaltheaOptions())[""]
    monkeypatch.setattr("halpipe.exporters.amalthea.document._AT_A_TIME", many)
    assert FORMAT.write(system, plan, AmaltheaOptions())[""] == expected
    path = tmp_path / "m.amxmi"
    path.write_bytes(expected)
    assert not IN.read([str(path)], AmaltheaImportOptions()).diagnostics
