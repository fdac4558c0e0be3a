"""The ECU configuration of an ARXML export: cores, OsTasks, counters, schedule tables, and how the Rte uses them."""

from dataclasses import replace

import pytest
from exporter_samples import thirds, two_modes

from arxml_reading import (
    NS,
    by_path,
    containers,
    parameters,
    q,
    references,
    seconds_per_tick,
    special,
    tables,
    target,
    text,
    write,
)
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml.codes import (
    ACTIVATED_TWICE,
    BAD_COUNTER,
    COUNTER_RANGE,
    MIN_CYCLE,
    NOT_ON_TICK,
    TOO_MANY_POINTS,
)
from halpipe.exporters.arxml.ticks import Counter, begin_of
from halpipe.models import ModeSchedule, Status, TransitionTable
from support import job, mode, model, ms, schedule, task, version

FAST, SLOW = task("fast", 10, version("v", "2ms", "u1 u2")), task("slow", 20, version("v", "3ms", "u1 u2"))
RUN, STOP = mode("run", (FAST, SLOW)), mode("stop", (FAST,))
SYSTEM = model(
    FAST, SLOW, units="u1 u2 spare", modes=[RUN, STOP], transitions=[("run", "stop", None), ("stop", "run", None)]
)


def table(name, hyperperiod, *jobs):
    return ModeSchedule(name=name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)


def switch(source, goal, length, *jobs):
    return TransitionTable(
        source=source, target=goal, length=ms(length), worst_latency=ms(0), status=Status.VALID, jobs=jobs
    )


PLAN = replace(
    schedule(SYSTEM, 20),
    modes=(
        table(
            "run",
            20,
            job(SYSTEM, "fast", 0, "0.5ms", "u1"),
            job(SYSTEM, "fast", 1, "10.5ms", "u1"),
            job(SYSTEM, "slow", 0, 5, "u2"),
        ),
        table("stop", 10, job(SYSTEM, "fast", 0, 3, "u1")),
    ),
    transitions=(switch("run", "stop", 4, job(SYSTEM, "fast", 0, 2, "u1")), switch("stop", "run", 0)),
)


def one_mode(*jobs, hyperperiod=20, wcet="2ms"):
    """A system of one mode on one unit whose jobs of the task "fast" start at the given instants."""
    fast = task("fast", hyperperiod, version("v", wcet, "u1"))
    system = model(fast)
    return system, schedule(system, hyperperiod, *(job(system, "fast", i, at, "u1") for i, at in enumerate(jobs)))


def refusals(*arguments, **options):
    with pytest.raises(HalpipeError) as refused:
        write(*arguments, **options)
    return [(d.code, d.path, d.message, d.help) for d in refused.value.diagnostics]


# ------------------------------------------------------------------------------------------------------ tables


def test_each_mode_and_each_switch_is_a_table_on_every_core_that_is_used():
    root = write(SYSTEM, PLAN)
    assert seconds_per_tick(root) * 10**6 == 500
    found = {name: (t.of, t.duration, t.repeating, t.points) for name, t in tables(root).items()}
    assert found == {
        "Mode_run_u1": (("run",), 40, True, [(1, ["fast"]), (21, ["fast"])]),
        "Mode_stop_u1": (("stop",), 20, True, [(6, ["fast"])]),
        "Switch_run_to_stop_u1": (("run", "stop"), 8, False, [(4, ["fast"])]),
        "Mode_run_u2": (("run",), 40, True, [(10, ["slow"])]),
        "Mode_stop_u2": (("stop",), 20, True, [(0, ["Idle_u2"])]),
        "Switch_run_to_stop_u2": (("run", "stop"), 8, False, [(0, ["Idle_u2"])]),
    }


def test_tables_tell_what_follows_them():
    following = {name: t.following for name, t in tables(write(SYSTEM, PLAN)).items() if name.endswith("u1")}
    assert following == {
        "Mode_run_u1": [("/m/Ecu/Os/Switch_run_to_stop_u1", "stop")],
        "Mode_stop_u1": [("/m/Ecu/Os/Mode_run_u1", "run")],
        "Switch_run_to_stop_u1": [("/m/Ecu/Os/Mode_stop_u1", "stop")],
    }


def test_the_os_begins_with_the_first_mode_or_with_the_one_that_it_is_told():
    starts = {name: t.autostart for name, t in tables(write(SYSTEM, PLAN, tick=ms("0.25ms"))).items()}
    assert starts["Mode_run_u1"] == starts["Mode_run_u2"] == ("40", "OSDEFAULTAPPMODE", "Start_run")
    assert starts["Mode_stop_u2"] == ("40", "Start_stop")
    assert starts["Switch_run_to_stop_u1"] == ()
    assert containers(write(SYSTEM, PLAN), "OsAppMode").keys() == {"OSDEFAULTAPPMODE", "Start_run", "Start_stop"}


@pytest.mark.parametrize(
    ("counters", "begin"),
    [
        (["1ms", 1, 255], "10ms"),  # a counter may run before its OS starts the tables
        (["1ms", 11, 255], "11ms"),  # never in less than the minimal cycle
        (["3ms", 1, 255], "12ms"),
        (["1us", 1, 255], "255us"),  # as late as the range allows
        (["1ms", 1, 255, "1.5ms", 1, 6], "9ms"),  # one instant for all of them
        (["1ms", 1, 255, "1.5ms", 9, 255], "15ms"),
        (["16ms", 1, 255], "16ms"),
    ],
)
def test_tables_begin_after_10_ms_if_their_counters_tell_them(counters, begin):
    found = [Counter(ms(tick), least, most) for tick, least, most in zip(*[iter(counters)] * 3, strict=True)]
    assert begin_of(found) == begin_of(found[::-1]) == ms(begin)


def test_jobs_that_start_at_one_instant_share_an_expiry_point():
    first, second = task("a", 10, version("v", "0ms", "u1")), task("b", 10, version("v", "1ms", "u1"))
    system = model(first, second)
    plan = schedule(system, 10, job(system, "a", 0, 2, "u1"), job(system, "b", 0, 2, "u1"))
    assert tables(write(system, plan))["Mode_all_u1"].points == [(1, ["a", "b"])]


def test_jobs_on_several_units_activate_a_task_on_each():
    root = write(*thirds())
    assert {name: t.points for name, t in tables(root).items()} == {
        "Mode_all_isp": [(0, ["camera"])],
        "Mode_all_gpu0": [(3, ["stereo_gpu0"])],
        "Mode_all_gpu1": [(3, ["stereo_gpu1"])],
    }
    # The greatest common divisor of 100/3 ms and 10 ms: no decimal, so that the exact value stands beside it.
    counter = next(iter(containers(root, "OsCounter").values()))
    assert parameters(counter)["OsSecondsPerTick"] == "0.00333333333333333"
    assert special(counter, "counter") == [("tick", "10/3ms")]


# ----------------------------------------------------------------------------------------------- tasks and cores


def test_os_tasks_run_one_version_on_one_core_to_its_end():
    system, plan = two_modes()
    root = write(system, plan)
    found = containers(root, "OsTask")
    assert special(found["path_planner_coarse_core4"], "work") == [
        ("RUNNABLE-ENTITY", "/roboracer/Components/path_planner/Behavior/path_planner"),
        ("SWC-IMPLEMENTATION", "/roboracer/Implementations/path_planner_coarse"),
        ("HW-ELEMENT", "/roboracer/Platform/core4"),
    ]
    settings = {"OsTaskActivation": "1", "OsTaskPriority": "1", "OsTaskSchedule": "NON"}
    assert all(parameters(container) == settings for container in found.values())
    assert {"opponent_detection", "pure_pursuit_core1", "pure_pursuit_core4", "Idle_core2"} < found.keys()
    assert "Idle_core1" not in found


def test_every_object_belongs_to_the_application_of_its_core():
    root = write(SYSTEM, PLAN)
    owned = {name: sorted(references(c)) for name, c in containers(root, "OsApplication").items()}
    assert owned.keys() == {"Application_u1", "Application_u2"}
    assert owned["Application_u2"] == [
        ("OsAppCounterRef", "/m/Ecu/Os/Counter_u2"),
        ("OsAppScheduleTableRef", "/m/Ecu/Os/Mode_run_u2"),
        ("OsAppScheduleTableRef", "/m/Ecu/Os/Mode_stop_u2"),
        ("OsAppScheduleTableRef", "/m/Ecu/Os/Switch_run_to_stop_u2"),
        ("OsAppTaskRef", "/m/Ecu/Os/Idle_u2"),
        ("OsAppTaskRef", "/m/Ecu/Os/slow"),
        ("OsApplicationCoreRef", "/m/Ecu/EcuC/EcucHardware/u2"),
    ]
    assert {t.counter for t in tables(root).values() if t.name.endswith("u2")} == {"Counter_u2"}
    assert parameters(by_path(root, "/m/Ecu/EcuC/EcucHardware/u2")) == {"EcucCoreId": "1"}


def test_release_4_0_3_numbers_cores_in_the_application():
    application = containers(write(SYSTEM, PLAN, release="4.0.3"), "OsApplication")["Application_u2"]
    assert parameters(application)["OsApplicationCoreAssignment"] == "1"
    assert "OsApplicationCoreRef" not in dict(references(application))


def test_the_rte_maps_events_to_tasks_and_their_expiry_points():
    root = write(SYSTEM, PLAN)
    mapping = by_path(root, "/m/Ecu/Rte/fast/fast")
    assert references(mapping) == [
        ("RteEventRef", "/m/Components/fast/Behavior/Every"),
        ("RteMappedToTaskRef", "/m/Ecu/Os/fast"),
        ("RteUsedOsSchTblExpiryPointRef", "/m/Ecu/Os/Mode_run_u1/At_1"),
    ]
    instance = containers(root, "RteSwComponentInstance")["fast"]
    assert target(instance, "RteSoftwareComponentInstanceRef") == "/m/System/Composition/fast"


def test_the_prefix_of_definitions_is_the_users():
    root = write(SYSTEM, PLAN, ecuc_prefix="/MICROSAR")
    definition = text(containers(root, "OsScheduleTable")["Mode_run_u1"], "DEFINITION-REF")
    assert definition == "/MICROSAR/Os/OsScheduleTable"


# ------------------------------------------------------------------------------------------------------- ticks


def test_the_tick_is_the_largest_that_divides_every_instant():
    assert seconds_per_tick(write(*one_mode(0, 10))) * 1000 == 10
    assert seconds_per_tick(write(*one_mode("1.25ms", 10))) * 10**6 == 1250


def test_a_tick_is_at_most_a_second():
    root = write(*one_mode(0, hyperperiod=2500, wcet="2ms"))
    assert parameters(containers(root, "OsCounter")["Counter_u1"])["OsSecondsPerTick"] == "0.5"
    assert tables(root)["Mode_all_u1"].duration == 5


def test_a_given_tick_must_divide_every_instant():
    assert seconds_per_tick(write(SYSTEM, PLAN, tick=ms("0.1ms"))) * 10**4 == 1
    message = (
        'the start of job 0 of task "fast", 500us, is between 0ms and 1ms; the start of job 1 of task "fast", '
        "10.5ms, is between 10ms and 11ms: no multiple of the tick 1ms"
    )
    help = "the nearest tick that fits is 500us; or schedule again with --tick 1ms"
    assert refusals(SYSTEM, PLAN, tick=ms(1)) == [(NOT_ON_TICK.id, 'mode "run"', message, help)]


@pytest.mark.parametrize(
    ("tick", "nearest"),
    [("0.4ms", "250us"), ("0.3ms", "250us"), ("0.2001ms", "125us"), ("7us", "6.25us"), ("1.0001us", "1us")],
)
def test_the_nearest_tick_that_fits_is_named(tick, nearest):
    help = refusals(SYSTEM, PLAN, tick=ms(tick))[0][3]
    assert help.startswith(f"the nearest tick that fits is {nearest};")
    write(SYSTEM, PLAN, tick=ms(nearest))


def test_all_tables_are_checked_against_a_given_tick():
    paths = [path for _, path, _, _ in refusals(SYSTEM, PLAN, tick=ms(7))]
    assert paths == ['mode "run"', 'mode "stop"', 'transition from "run" to "stop"']


@pytest.mark.parametrize(
    "options",
    [
        {"tick": ms(0)},
        {"tick": ms(1001)},
        {"min_cycle": 0},
        {"min_cycle": 6, "max_value": 5},
        {"max_value": 0},
        {"max_value": 2**64},
        {"max_points": 0},
    ],
)
def test_impossible_counters_are_refused(options):
    assert [found[0] for found in refusals(SYSTEM, PLAN, **options)] == [BAD_COUNTER.id]


def test_the_counter_holds_no_more_than_every_os_counts():
    (value,) = {
        parameters(c)["OsCounterMaxAllowedValue"] for c in containers(write(SYSTEM, PLAN), "OsCounter").values()
    }
    assert int(value) < 2**31


def test_what_generators_demand_of_system_and_applications_is_stated():
    root = write(SYSTEM, PLAN)
    (system,) = containers(root, "OsOS").values()
    flags = {"OsStackMonitoring", "OsUseGetServiceId", "OsUseParameterAccess", "OsUseResScheduler"}
    assert flags <= parameters(system).keys()
    (hooks,) = containers(root, "OsHooks").values()
    assert {"OsErrorHook", "OsPostTaskHook", "OsPreTaskHook", "OsShutdownHook", "OsStartupHook"} <= parameters(
        hooks
    ).keys()
    assert len(list(system.iterfind(q("SUB-CONTAINERS/*")))) == 1
    for application in containers(root, "OsApplication").values():
        assert len(list(application.iterfind(q("SUB-CONTAINERS/*")))) == 1


def test_a_collection_names_the_modules_and_their_system():
    root = write(SYSTEM, PLAN)
    (collection,) = root.iter(NS + "ECUC-VALUE-COLLECTION")
    paths = [collection.findtext(NS + "ECU-EXTRACT-REF"), *(e.text for e in collection.iterfind(q("ECUC-VALUES/*/*")))]
    assert len(paths) == 4
    assert all(by_path(root, path) is not None for path in paths)


# ----------------------------------------------------------------------------------------------- rules of the OS


def test_a_table_has_no_more_expiry_points_than_the_os_allows():
    system, plan = one_mode(2, 8)
    write(system, plan, max_points=2)
    ((code, path, message, _),) = refusals(system, plan, max_points=1)
    assert (code, path) == (TOO_MANY_POINTS.id, 'mode "all" on "u1"')
    assert message == "has 2 expiry points, but the OS allows 1"


def test_a_table_must_fit_into_its_counter():
    system, plan = one_mode(0)
    assert tables(write(system, plan, tick=ms("0.1ms"), max_value=199))["Mode_all_u1"].duration == 200
    message = "lasts 20ms, 200 ticks of 100us, but the counter has only 199 values"
    help = "set the maximal value to 199 or more, or schedule again with a tick of 200us or more"
    found = refusals(system, plan, tick=ms("0.1ms"), max_value=198)
    assert found == [(COUNTER_RANGE.id, 'mode "all" on "u1"', message, help)]


@pytest.mark.parametrize(
    ("starts", "gap"),
    [
        ((2, 8), "the first expiry point is at 2 ticks (2ms)"),
        ((0, 3), "after 0ms the next expiry point follows in 3 ticks (3ms)"),
        ((0, 17), "after 17ms the table ends in 3 ticks (3ms)"),
    ],
)
def test_expiry_points_keep_the_minimal_cycle(starts, gap):
    system, plan = one_mode(*starts)
    least = int(gap.split(" ticks")[0].rsplit(" ", 1)[1])
    write(system, plan, tick=ms(1), min_cycle=least)
    ((code, path, message, help),) = refusals(system, plan, tick=ms(1), min_cycle=least + 1)
    assert (code, path) == (MIN_CYCLE.id, 'mode "all" on "u1"')
    assert message == f"{gap}, fewer than the minimal cycle {least + 1}"
    assert help.startswith(f"a minimal cycle of {least} would do for this table")


def test_every_gap_that_is_too_small_is_reported():
    assert len(refusals(*one_mode(1, 3, 19), tick=ms(1), min_cycle=5)) == 3


def test_a_task_is_not_activated_twice_at_one_instant():
    ((code, path, message, _),) = refusals(*one_mode(4, 4, wcet="0ms"))
    assert (code, path) == (ACTIVATED_TWICE.id, 'mode "all" on "u1"')
    assert message == 'OsTask "fast" is activated 2 times at 4ms'


@pytest.mark.parametrize(
    ("starts", "wcet", "activations"),
    [((0, 2), "2ms", 2), ((0, 3), "2ms", 1), ((1, 19), "2ms", 2), ((1, 18), "2ms", 1), ((5,), "0ms", 1)],
)
def test_a_job_that_starts_where_another_one_ends_finds_its_os_task_running(starts, wcet, activations):
    """A job that takes its whole WCET has not terminated when the OS activates its OsTask for the next one."""
    (found,) = containers(write(*one_mode(*starts, wcet=wcet)), "OsTask").values()
    assert parameters(found)["OsTaskActivation"] == str(activations)


@pytest.mark.parametrize(
    ("before", "between", "after", "length", "activations"),
    [
        (18, 0, 8, 4, 2),  # from the mode to the switch
        (17, 0, 8, 4, 1),
        (8, 2, 0, 4, 2),  # from the switch to the mode
        (8, 1, 0, 4, 1),
        (8, 0, 8, 4, 1),
        (18, None, 0, 0, 2),  # from mode to mode
        (17, None, 0, 0, 1),
        (18, None, 0, 4, 1),
    ],
)
def test_over_a_switch_jobs_meet_as_well(before, between, after, length, activations):
    fast = task("fast", 20, version("v", 2, "u1"))
    modes = [mode("run", (fast,)), mode("stop", (fast,))]
    system = model(fast, units="u1", modes=modes, transitions=[("run", "stop", None)])
    own = () if between is None else (job(system, "fast", 0, between, "u1"),)
    plan = replace(
        schedule(system, 20),
        modes=tuple(
            table(name, 20, job(system, "fast", 0, at, "u1")) for name, at in (("run", before), ("stop", after))
        ),
        transitions=(switch("run", "stop", length, *own),),
    )
    found = containers(write(system, plan), "OsTask")["fast"]
    assert parameters(found)["OsTaskActivation"] == str(activations)


def test_os_tasks_come_in_the_order_of_tasks_versions_and_units():
    both = task("t", 10, version("b", 1, "u1 u2"), version("a", 1, "u1 u2"))
    system = model(task("z", 10, version("v", 1, "u2")), both, units="u1 u2")
    jobs = [
        job(system, "t", n, 10 * n, unit, name)
        for n, (unit, name) in enumerate((u, v) for u in ("u2", "u1") for v in ("b", "a"))
    ]
    root = write(system, schedule(system, 40, *jobs, job(system, "z", 0, 5, "u2")))
    assert [name for name in containers(root, "OsTask") if name[0] in "tz"] == [
        "z",
        *(f"t_{v}_u{n}" for v in "ab" for n in (1, 2)),
    ]
