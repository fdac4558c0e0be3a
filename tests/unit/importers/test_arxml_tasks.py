"""What becomes a task: granularity, names, periods, offsets, execution times, what is left out and why."""

from fractions import Fraction

import pytest
from arxml_case import (
    alarm,
    component,
    configuration,
    container,
    counter,
    el,
    event,
    every,
    found,
    mapped,
    module,
    named,
    on_data,
    os_task,
    package,
    periods,
    read,
    ref,
    refusal,
    rte,
    schedule_table,
    write,
)

from halpipe.core.durations import Duration
from halpipe.importers.arxml import codes

TWO_RATES = component("Pump", every("0.01", "Fast", "Pump/Step"), every("0.02", "Slow", "Pump/Step"), runnables="Step")


def ms(text):
    return Duration.parse(text)


def test_each_period_of_a_runnable_is_a_task(tmp_path):
    imported = read(write(tmp_path, package("T", TWO_RATES)))
    assert periods(imported) == {"Pump/Step@10ms": "10ms", "Pump/Step@20ms": "20ms"}


def test_equal_events_of_a_runnable_are_one_task_unless_cut_by_event(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/Step"), every("1E-2", "B", "Pump/Step"), runnables="Step")
    path = write(tmp_path, package("T", pump))
    assert periods(read(path)) == {"Pump/Step": "10ms"}
    assert periods(read(path, granularity="event")) == {"Pump/Step@A": "10ms", "Pump/Step@B": "10ms"}


def test_tasks_cut_by_os_task_keep_the_order_of_their_runnables(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "A", "Pump/Last"),
        every("0.01", "B", "Pump/First"),
        every("0.005", "C", "Pump/Quick"),
        every("0.02", "D", "Pump/Loose"),
        runnables="Last First Quick Loose",
    )
    os = configuration("Os", container("Os/OsTask", "Main", refs=[("OsTaskEventRef", "/E/Os/Go")]))
    mappings = rte(mapped("Pump/B/A", "Main", "7"), mapped("Pump/B/B", "Main", "3"), mapped("Pump/B/C", "Main", "1"))
    path = write(tmp_path, package("T", pump), package("E", os, configuration("Rte", mappings)))
    imported = read(path, granularity="ostask")
    assert periods(imported) == {"Main@10ms": "10ms", "Main@5ms": "5ms"}
    assert imported.model.task("Main@10ms").origin.path == "/E/Os/Main: Pump/First, Pump/Last"


def test_modules_are_named_apart_from_components(tmp_path):
    com = module("Com", event("BSW-TIMING-EVENT", "T", "Com/Main", el("PERIOD", "0.005")), entities="Main")
    imported = read(write(tmp_path, package("T", com)))
    assert periods(imported) == {"BSW/Com/Main": "5ms"}
    assert imported.model.tasks[0].origin.path == "/T/Com/B/Main"


def test_mapped_twins_of_component_and_module_are_one_task(tmp_path):
    com = component("ComSwc", every("0.005", "T", "ComSwc/Main"), runnables="Main")
    bsw = module("Com", event("BSW-TIMING-EVENT", "T", "Com/Main", el("PERIOD", "0.005")), entities="Main")
    twin = named(
        "SWC-BSW-MAPPING",
        "M",
        el(
            "RUNNABLE-MAPPINGS",
            el(
                "SWC-BSW-RUNNABLE-MAPPING",
                ref("BSW-ENTITY-REF", "/T/Com/B/Main"),
                ref("SWC-RUNNABLE-REF", "/T/ComSwc/B/Main"),
            ),
        ),
    )
    assert periods(read(write(tmp_path, package("T", com, bsw, twin)))) == {"ComSwc/Main": "5ms"}
    assert len(periods(read(write(tmp_path, package("T", com, bsw))))) == 2


# ------------------------------------------------------------------------------------------------- periods


def with_os(period, *os, refs=(), task="Main", offset="", event_offset=()):
    """A pump whose event states `period` and is mapped to an OsTask."""
    pump = component("Pump", every(period, "Tick", "Pump/Step", *event_offset), runnables="Step")
    mapping = rte(mapped("Pump/B/Tick", task, more=refs, offset=offset))
    return package("T", pump), package(
        "E", configuration("Os", counter(), os_task("Main"), *os), configuration("Rte", mapping)
    )


@pytest.mark.parametrize(
    ("period", "os", "refs", "expected"),
    [
        ("0.04", [alarm("Al", "20")], [("RteUsedOsAlarmRef", "/E/Os/Al")], "40ms"),
        (
            "0.0",
            [alarm("Other", "20", activates="Main"), alarm("Al", "40")],
            [("RteUsedOsAlarmRef", "/E/Os/Al")],
            "40ms",
        ),
        ("0.0", [alarm("Al", "20", activates="Main")], [("RteUsedOsAlarmRef", "/E/Os/Al")], "20ms"),
        ("0.0", [alarm("Al", "20", activates="Main")], [], "20ms"),
        (
            "0.0",
            [alarm("Al", "0x14", sets="Ev"), container("Os/OsEvent", "Ev")],
            [("RteUsedOsEventRef", "/E/Os/Ev")],
            "20ms",
        ),
        (
            "0.0",
            [schedule_table("Tab", "40", [("P", "0", "Main")]), alarm("Al", "20", activates="Main")],
            [("RteUsedOsSchTblExpiryPointRef", "/E/Os/Tab/P"), ("RteUsedOsAlarmRef", "/E/Os/Al")],
            "40ms",
        ),
        ("0.0", [schedule_table("Tab", "40", [("P", "5", "Main"), ("Q", "25", "Main")])], [], "20ms"),
    ],
    ids=[
        "event first",
        "its alarm first",
        "its alarm",
        "alarm of the task",
        "alarm of its OS event",
        "expiry point",
        "even points",
    ],
)
def test_sources_of_a_period(tmp_path, period, os, refs, expected):
    imported = read(write(tmp_path, *with_os(period, *os, refs=refs)), strict=True)
    assert periods(imported) == {"Pump/Step": expected}
    assert bool(found(imported, codes.OS_PERIOD)) == (period == "0.0")


def test_the_period_of_the_os_task_comes_last(tmp_path):
    pump = component("Pump", every("0.0", "Tick", "Pump/Step"), runnables="Step")
    rte_config = configuration("Rte", rte(mapped("Pump/B/Tick", "Main")))
    os = configuration("Os", os_task("Main", OsTaskPeriod="0.05"))
    assert periods(read(write(tmp_path, package("T", pump), package("E", os, rte_config)))) == {"Pump/Step": "50ms"}


def test_one_shot_triggers_give_no_period(tmp_path):
    os = [alarm("Al", "0", activates="Main"), schedule_table("Tab", "40", [("P", "0", "Main")], repeating="false")]
    assert codes.NO_TASKS.id in {d.code for d in refusal(write(tmp_path, *with_os("0.0", *os))).diagnostics}


def test_ticks_may_come_from_the_frequency_of_the_system(tmp_path):
    os = configuration(
        "Os",
        container("Os/OsOS", "Os", params={"ArcOsTickFrequency": "500"}),
        container("Os/OsCounter", "Ticks"),
        os_task("Main"),
        alarm("Al", "5", activates="Main"),
    )
    assert periods(read(write(tmp_path, package("E", os)))) == {"Main": "10ms"}


@pytest.mark.parametrize("name", ["OsTickFrequency", "ArcOsTickFrequency"])
def test_ticks_belong_to_the_module_of_their_counter(tmp_path, name):
    def module(package_name, frequency):
        parts = [
            container("Os/OsOS", "Os", params={name: frequency}),
            container("Os/OsCounter", "Ticks"),
            os_task(f"Main{package_name}"),
            alarm("Al", "5", activates=f"Main{package_name}"),
        ]
        return package(package_name, configuration("Os", *parts)).replace("/E/Os", f"/{package_name}/Os")

    tag = "ECUC-MODULE-CONFIGURATION-VALUES-REF"
    refs = [el(f"{tag}-CONDITIONAL", ref(tag, f"/{name}/Os")) for name in "EF"]
    one = package("C", named("ECUC-VALUE-COLLECTION", "One", el("ECUC-VALUES", *refs)))
    imported = read(write(tmp_path, module("E", "100"), module("F", "1000"), one))
    assert periods(imported) == {"MainE": "50ms", "MainF": "5ms"}


def test_a_counter_that_an_alarm_drives_has_the_cycle_of_the_alarm_as_its_tick(tmp_path):
    kind = "Os/OsAlarm/OsAlarmAction"
    drive = container(f"{kind}/OsAlarmIncrementCounter", "i", refs=[("OsAlarmIncrementCounterRef", "/E/Os/Slow")])
    cycling = container("Os/OsAlarm/OsAlarmAutostart", "s", params={"OsAlarmCycleTime": "20", "OsAlarmAlarmTime": "1"})
    driver = container(
        "Os/OsAlarm", "Driver", cycling, container(kind, "act", drive), refs=[("OsAlarmCounterRef", "/E/Os/Ticks")]
    )
    slow = container("Os/OsCounter", "Slow")
    driven = alarm("Al", "5", activates="Main").replace("/E/Os/Ticks", "/E/Os/Slow")
    path = write(tmp_path, package("E", configuration("Os", counter(), slow, driver, driven, os_task("Main"))))
    assert periods(read(path)) == {"Main": "100ms"}


@pytest.mark.parametrize("names_task", [True, False])
@pytest.mark.parametrize("by_table", [True, False])
def test_os_tasks_are_woken_by_the_events_that_alarms_and_expiry_points_set(tmp_path, names_task, by_table):
    kind = "OsScheduleTable" if by_table else "OsAlarm"
    refs = [(f"{kind}SetEventRef", "/E/Os/Go")]
    refs += [(f"{kind}SetEventTaskRef", "/E/Os/Main")] if names_task else []
    counts = [(f"{kind}CounterRef", "/E/Os/Ticks")]
    if by_table:
        inside = container("Os/T/P/OsScheduleTableEventSetting", "e", refs=refs)
        point = container("Os/T/OsScheduleTableExpiryPoint", "p", inside, params={"OsScheduleTblExpPointOffset": "3"})
        length = {"OsScheduleTableDuration": "20", "OsScheduleTableRepeating": "true"}
        waker = container("Os/OsScheduleTable", "Tab", point, params=length, refs=counts)
    else:
        action = container("Os/OsAlarm/OsAlarmAction", "act", container("Os/A/OsAlarmSetEvent", "e", refs=refs))
        start = {"OsAlarmCycleTime": "20", "OsAlarmAlarmTime": "3"}
        waker = container(
            "Os/OsAlarm", "Al", action, container("Os/OsAlarm/OsAlarmAutostart", "s", params=start), refs=counts
        )
    main = container("Os/OsTask", "Main", refs=[("OsTaskEventRef", "/E/Os/Go")])
    path = write(tmp_path, package("E", configuration("Os", counter(), container("Os/OsEvent", "Go"), waker, main)))
    (task,) = read(path).model.tasks
    assert (task.name, str(task.period), str(task.offset)) == ("Main", "20ms", "3ms")


def test_the_ecu_configuration_alone_is_a_model_with_periods_of_the_overlay(tmp_path):
    mappings = configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1")))
    path = write(tmp_path, package("E", configuration("Os", os_task("Main"), os_task("Idle")), mappings))
    imported = read(path, sources={"Main": "5ms"})
    assert periods(imported) == {"Main": "5ms"}
    assert not any("did you mean" in d.help for d in found(imported, codes.DANGLING))


def test_os_tasks_without_runnables_are_tasks_when_something_activates_them(tmp_path):
    os = configuration(
        "Os",
        counter("2.5E-4"),
        os_task("Main"),
        os_task("Idle"),
        os_task("Slow", OsTaskPeriod="1"),
        schedule_table("Tab", "20", [("P2", "7", "Main"), ("P1", "2", "Main")]),
    )
    imported = read(write(tmp_path, package("E", os)))
    assert {(t.name, str(t.period), str(t.offset)) for t in imported.model.tasks} == {
        ("Main+500us", "5ms", "500us"),
        ("Main+1.75ms", "5ms", "1.75ms"),
        ("Slow", "1s", "None"),
    }
    assert ("OsScheduleTableExpiryPoint", 2, 2, 0) in imported.coverage.rows()
    assert ("OsCounter", 1, 1, 0) in imported.coverage.rows()
    assert ("OsTask", 3, 2, 1) in imported.coverage.rows()


def test_an_instance_may_override_the_period(tmp_path):
    from arxml_case import composition

    props = el(
        "INSTANTIATION-RTE-EVENT-PROPSS",
        el(
            "INSTANTIATION-TIMING-EVENT-PROPS",
            el(
                "REFINED-EVENT-IREF",
                ref("CONTEXT-COMPONENT-REF", "/T/Car/left"),
                ref("TARGET-EVENT-REF", "/T/Pump/B/Tick"),
            ),
            el("PERIOD", "0.5"),
        ),
    )
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    car = composition("Car", "left:Pump right:Pump", extra=[props])
    assert periods(read(write(tmp_path, package("T", pump, car)))) == {"left/Step": "500ms", "right/Step": "10ms"}


# ------------------------------------------------------------------------------------------------- offsets


@pytest.mark.parametrize(
    ("event_offset", "mapping_offset", "expected"),
    [
        ("0.002", "", "2ms"),
        ("0.002", "0.003", "3ms"),
        ("0.002", "0.0", "2ms"),
        ("0.0", "", None),
        ("0.012", "", "2ms"),
        ("0.01", "", None),
    ],
    ids=["event", "mapping first", "zero is not stated", "zero", "within the period", "a whole period"],
)
def test_offsets(tmp_path, event_offset, mapping_offset, expected):
    packages = with_os("0.01", event_offset=[el("OFFSET", event_offset)], offset=mapping_offset)
    (task,) = read(write(tmp_path, *packages)).model.tasks
    assert task.offset == (ms(expected) if expected else None)


def test_an_alarm_gives_its_offset_with_its_period(tmp_path):
    packages = with_os("0.0", alarm("Al", "20", start="5"), refs=[("RteUsedOsAlarmRef", "/E/Os/Al")])
    (task,) = read(write(tmp_path, *packages)).model.tasks
    assert (task.period, task.offset) == (ms("20ms"), ms("5ms"))


def test_an_offset_is_that_of_an_activation(tmp_path):
    """Alarms activate two OsTasks of one core at one instant; one that is activated unevenly starts at once."""
    activated = alarm("Al", "20", start="5", activates="One"), alarm("Be", "20", start="5", activates="Two")
    uneven = schedule_table("Tab", "40", [("P", "5", "Twice"), ("Q", "15", "Twice")])
    tasks = map(os_task, ("One", "Two", "Twice", "Free"))
    os = configuration("Os", counter(), *activated, alarm("Ga", "20", activates="Free"), uneven, *tasks)
    imported = read(write(tmp_path, package("E", os)))
    slacks = {task.name: task.slack for task in imported.model.tasks}
    assert slacks == {"One": 1, "Two": 1, "Twice+5ms": 0, "Twice+15ms": 0, "Free": 0}
    assert [d.element for d in imported.coverage.defaulted_values if d.what == "slack"] == ['task "One"', 'task "Two"']


def test_offsets_cut_tasks_apart(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "A", "Pump/Step"),
        every("0.01", "B", "Pump/Step", el("OFFSET", "0.005")),
        runnables="Step",
    )
    assert set(periods(read(write(tmp_path, package("T", pump))))) == {"Pump/Step", "Pump/Step+5ms"}


# ------------------------------------------------------------------------------------- overlay and left out


def test_the_overlay_gives_periods_and_drops_tasks(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "A", "Pump/Step"),
        event("OPERATION-INVOKED-EVENT", "Call", "Pump/Serve"),
        event("BACKGROUND-EVENT", "Idle", "Pump/Serve"),
        runnables="Step Serve",
    )
    path = write(tmp_path, package("T", pump))
    imported = read(path, sources={"Pump/Serve": "1/30s"}, drop={"Pump/Step"})
    assert imported.model.task("Pump/Serve").period.fraction == Fraction(10**9, 30)
    assert set(periods(imported)) == {"Pump/Serve"}
    reasons = {e.name: e.reason for e in imported.coverage.ignored_elements}
    assert reasons["/T/Pump/B/A"] == "left out by the overlay"


def test_the_period_of_the_overlay_goes_to_the_event_that_an_os_task_runs(tmp_path):
    pump = component(
        "Pump",
        event("OPERATION-INVOKED-EVENT", "Call", "Pump/Step"),
        event("SWC-MODE-SWITCH-EVENT", "Switch", "Pump/Step"),
        runnables="Step",
    )
    os = configuration("Os", os_task("Main"), configuration_of_core("Main"))
    mapping = configuration("Rte", rte(mapped("Pump/B/Switch", "Main")))
    path = write(tmp_path, package("T", pump), package("E", os, mapping))
    (task,) = read(path, sources={"Pump/Step": "7ms"}, granularity="ostask").model.tasks
    assert (task.name, task.period) == ("Main", ms("7ms"))


def configuration_of_core(task):
    params = {"OsApplicationCoreAssignment": "3"}
    return container("Os/OsApplication", "App", params=params, refs=[("OsAppTaskRef", f"/E/Os/{task}")])


def test_of_two_mappings_the_one_to_an_os_task_counts(tmp_path):
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    unmapped = container(
        "Rte/RteSwComponentInstance/RteEventToTaskMapping", "U", refs=[("RteEventRef", "/T/Pump/B/Tick")]
    )
    os = configuration("Os", os_task("Main"))
    mapping = configuration("Rte", rte(unmapped, mapped("Pump/B/Tick", "Main")))
    path = write(tmp_path, package("T", pump), package("E", os, mapping))
    assert periods(read(path, granularity="ostask")) == {"Main": "10ms"}


def test_data_received_without_sender_takes_the_period_of_the_overlay(tmp_path):
    pump = component("Pump", on_data("D", "Pump/Step", "Pump/in"), runnables="Step")
    assert periods(read(write(tmp_path, package("T", pump)), sources={"Pump/Step": "7ms"})) == {"Pump/Step": "7ms"}


def test_events_without_a_period_are_reported_by_kind(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "A", "Pump/Step"),
        event("INIT-EVENT", "I", "Pump/Init"),
        event("SWC-MODE-SWITCH-EVENT", "M", "Pump/Switch"),
        event("SWC-MODE-SWITCH-EVENT", "N", "Pump/Switch"),
        runnables="Step Init Switch",
    )
    imported = read(write(tmp_path, package("T", pump)))
    (lost,) = found(imported, codes.NO_PERIOD)
    assert "2 SWC-MODE-SWITCH-EVENT" in lost.message
    (expected,) = found(imported, codes.NOT_SCHEDULED)
    assert "1 INIT-EVENT" in expected.message


def test_every_bad_period_is_reported_and_the_import_goes_on(tmp_path):
    bad = ["0", "-1", "INF", "NaN", "x y", ""]
    events = [every(period, f"E{index}", f"Pump/R{index}") for index, period in enumerate(bad)]
    names = " ".join(f"R{index}" for index in range(len(bad)))
    pump = component("Pump", *events, every("0.01", "Good", "Pump/Step"), runnables=f"{names} Step")
    imported = read(write(tmp_path, package("T", pump)))
    assert periods(imported) == {"Pump/Step": "10ms"}
    assert len(found(imported, codes.BAD_PERIOD)) == len(bad)


# ------------------------------------------------------------------------------------------ execution times


def execution_time(kind, value, runnable_path, microseconds, name="X"):
    time = el(value, el("CSE-CODE", "0"), el("CSE-CODE-FACTOR", microseconds))
    return named(kind, name, ref("EXECUTABLE-ENTITY-REF", f"/T/{runnable_path}"), time)


def consumption(*times):
    return named("SWC-IMPLEMENTATION", "Impl", named("RESOURCE-CONSUMPTION", "R", el("EXECUTION-TIMES", *times)))


def test_the_most_trustworthy_execution_time_counts(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/Step"), runnables="Step")
    times = consumption(
        execution_time("ROUGH-ESTIMATE-OF-EXECUTION-TIME", "ESTIMATED-EXECUTION-TIME", "Pump/B/Step", "900", "Guess"),
        execution_time("ANALYZED-EXECUTION-TIME", "WORST-CASE-EXECUTION-TIME", "Pump/B/Step", "250", "One"),
        execution_time("ANALYZED-EXECUTION-TIME", "WORST-CASE-EXECUTION-TIME", "Pump/B/Step", "300", "Two"),
    )
    imported = read(write(tmp_path, package("T", pump, times)))
    assert imported.model.tasks[0].versions[0].wcet == ms("300us")
    assert not found(imported, codes.NO_WCET)


def test_an_os_task_takes_the_sum_of_its_runnables_if_all_are_known(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/One"), every("0.01", "B", "Pump/Two"), runnables="One Two")
    os = package(
        "E",
        configuration("Os", os_task("Main")),
        configuration("Rte", rte(mapped("Pump/B/A", "Main", "1"), mapped("Pump/B/B", "Main", "2"))),
    )
    one = execution_time("ANALYZED-EXECUTION-TIME", "WORST-CASE-EXECUTION-TIME", "Pump/B/One", "250", "One")
    two = execution_time("ANALYZED-EXECUTION-TIME", "WORST-CASE-EXECUTION-TIME", "Pump/B/Two", "300", "Two")
    both = read(write(tmp_path, package("T", pump, consumption(one, two)), os), granularity="ostask")
    assert both.model.task("Main").versions[0].wcet == ms("550us")
    half = read(write(tmp_path, package("T", pump, consumption(one)), os), granularity="ostask")
    assert half.model.task("Main").versions[0].wcet is None
