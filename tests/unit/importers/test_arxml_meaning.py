"""What elements of AUTOSAR mean for a schedule, where the plain values in the files say something else."""

import pytest
from arxml_case import (
    alarm,
    component,
    composition,
    configuration,
    container,
    core,
    counter,
    el,
    event,
    event_chain,
    every,
    extension,
    found,
    latency,
    mapped,
    module,
    named,
    observed,
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

from halpipe.core.diagnostics import Exit
from halpipe.flow.formats import import_model
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.models import ResourceKind
from support import ms


def autostart(kind="RELATIVE", value="0"):
    definition = "/Vendor/X/Os/OsScheduleTable/OsScheduleTableAutostart"
    return named(
        "ECUC-CONTAINER-VALUE",
        "Start",
        ref("DEFINITION-REF", definition),
        el(
            "PARAMETER-VALUES",
            el(
                "ECUC-TEXTUAL-PARAM-VALUE",
                ref("DEFINITION-REF", f"{definition}/OsScheduleTableAutostartType"),
                el("VALUE", kind),
            ),
            el(
                "ECUC-NUMERICAL-PARAM-VALUE",
                ref("DEFINITION-REF", f"{definition}/OsScheduleTableStartValue"),
                el("VALUE", value),
            ),
        ),
    )


def table(name, points, start="", counter="Ticks"):
    """A table of 20 ticks with an autostart."""
    text = schedule_table(name, "20", points).replace("/E/Os/Ticks", f"/E/Os/{counter}")
    head, tail = text.rsplit("</SUB-CONTAINERS>", 1)
    return f"{head}{start}</SUB-CONTAINERS>{tail}"


def system(tmp_path, *os):
    """The Os alone, with the OsTasks T and U."""
    return write(tmp_path, package("E", configuration("Os", counter(), os_task("T"), os_task("U"), *os)))


def offsets(imported):
    return {task.name: str(task.offset) if task.offset else "" for task in imported.model.tasks}


# ------------------------------------------------------------------------------------------- schedule tables


@pytest.mark.parametrize(
    ("kind", "start", "most", "is_told"),
    [
        ("ABSOLUTE", "0", "", True),
        ("ABSOLUTE", "0", "9", True),  # after 10 ticks, which is half a cycle
        ("ABSOLUTE", "0", "19", False),  # after 20 ticks, which is the same phase
        ("ABSOLUTE", "0", "39", False),
        ("ABSOLUTE", "1", "9", False),
        ("RELATIVE", "0", "9", False),
    ],
)
@pytest.mark.parametrize("of", ["an alarm", "a table"])
def test_a_start_at_0_is_now_or_after_all_values_of_the_counter(tmp_path, of, kind, start, most, is_told):
    if of == "a table":
        text = table("Plan", [("P", "3", "T")], autostart(kind, start))
    else:
        name = "OsAlarmAutostartType"
        value = el("VALUE", kind)
        stated = el("ECUC-TEXTUAL-PARAM-VALUE", ref("DEFINITION-REF", f"/Vendor/X/Os/OsAlarm/{name}"), value)
        text = alarm("Beat", "20", start=start, activates="T")
        text = text.replace("<ECUC-NUMERICAL-PARAM-VALUE>", f"{stated}<ECUC-NUMERICAL-PARAM-VALUE>", 1)
    limits = {"OsSecondsPerTick": "0.001", **({"OsCounterMaxAllowedValue": most} if most else {})}
    ticks = container("Os/OsCounter", "Ticks", params=limits)
    imported = read(write(tmp_path, package("E", configuration("Os", ticks, os_task("T"), text))))
    assert len(found(imported, codes.PHASE_UNKNOWN)) == is_told
    assert [task.period for task in imported.model.tasks] == [ms(20)]


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("RELATIVE", "7", {"T": "10ms", "U": "14ms"}),
        ("ABSOLUTE", "7", {"T": "10ms", "U": "14ms"}),
        ("RELATIVE", "19", {"T": "2ms", "U": "6ms"}),
        ("RELATIVE", "0", {"T": "3ms", "U": "7ms"}),
    ],
)
def test_a_table_begins_at_its_start_value(tmp_path, kind, value, expected):
    path = system(tmp_path, table("Plan", [("P", "3", "T"), ("Q", "7", "U")], autostart(kind, value)))
    assert offsets(read(path, strict=True)) == expected


def test_a_table_that_waits_for_its_counter_has_no_phase(tmp_path):
    path = system(tmp_path, table("Plan", [("P", "3", "T")], autostart("SYNCHRON", "7")))
    imported = read(path)
    assert offsets(imported) == {"T": "3ms"}
    (told,) = found(imported, codes.PHASE_UNKNOWN)
    assert told.code == "HAL0519"
    assert told.help
    assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


def test_an_adjustable_expiry_point_moves_its_table(tmp_path):
    adjusted = container("Os/OsScheduleTable/OsScheduleTableExpiryPoint/OsScheduleTblAdjustableExpPoint", "Moves")
    text = table("Plan", [("P", "3", "T")], autostart()).replace("</SUB-CONTAINERS>", f"{adjusted}</SUB-CONTAINERS>", 1)
    assert found(read(system(tmp_path, text)), codes.PHASE_UNKNOWN)


@pytest.mark.parametrize(
    ("points", "counter_of_second", "is_left_out"),
    [
        ([("P", "0", "U")], "Ticks", True),
        ([("P", "0", "T")], "Others", True),
        ([("P", "0", "U")], "Others", False),
    ],
    ids=["same counter", "same OsTask", "nothing in common"],
)
def test_a_table_of_another_mode_does_not_run_beside_the_one_that_is_started(
    tmp_path, points, counter_of_second, is_left_out
):
    first = table("Run", [("P", "3", "T")], autostart())
    second = table("Limp", points, counter=counter_of_second)
    path = system(tmp_path, first, second, counter(name="Others"))
    imported = read(path)
    told = found(imported, codes.UNSTARTED_TABLE)
    assert bool(told) == is_left_out
    assert list(periods(imported)) == (["T"] if is_left_out else ["T", "U"])
    if is_left_out:
        assert (told[0].code, told[0].path) == ("HAL0518", 'OsScheduleTable "/E/Os/Limp"')
        assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


def test_tables_that_code_starts_run_together(tmp_path):
    imported = read(system(tmp_path, table("A", [("P", "0", "T")]), table("B", [("P", "0", "U")])), strict=True)
    assert periods(imported) == {"T": "20ms", "U": "20ms"}


# --------------------------------------------------------------------------------------------- Rte and events


def pumped(tmp_path, mapping, event="0.01", more=()):
    pump = component("Pump", every(event, "Tick", "Pump/Step"), *more, runnables="Step Other")
    return write(tmp_path, package("T", pump), package("E", configuration("Os", os_task("Main")), mapping))


@pytest.mark.parametrize("bsw", [False, True])
def test_the_mapping_may_state_another_period(tmp_path, bsw):
    text = mapped("Pump/B/Tick", "Main", "1", bsw=bsw)
    name = "RteBswPeriod" if bsw else "RtePeriod"
    stated = text.replace("RteBswPositionInTask" if bsw else "RtePositionInTask", name).replace(
        "<VALUE>1</VALUE>", "<VALUE>0.05</VALUE>"
    )
    pump = (
        module("Pump", event("BSW-TIMING-EVENT", "Tick", "Pump/Step", el("PERIOD", "0.01")), entities="Step")
        if bsw
        else component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    )
    holder = container("Rte/RteBswModuleInstance", "Pump", stated) if bsw else rte(stated)
    parts = package("E", configuration("Os", os_task("Main")), configuration("Rte", holder))
    imported = read(write(tmp_path, package("T", pump), parts), strict=True)
    assert list(periods(imported).values()) == ["50ms"]
    (told,) = found(imported, codes.PERIOD_OF_MAPPING)
    assert (told.code, "instead of 0.01 s" in told.message) == ("HAL0516", True)


def test_an_event_that_the_rte_does_not_map_is_not_called(tmp_path):
    mapping = configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1")))
    path = pumped(tmp_path, mapping, more=[every("0.02", "Loose", "Pump/Other")])
    imported = read(path)
    assert list(periods(imported)) == ["Pump/Step"]
    (told,) = found(imported, codes.NOT_CALLED)
    assert "Pump/Other" in told.message
    assert "overlay" in told.help
    assert periods(read(path, sources={"Pump/Other": "20ms"}))["Pump/Other"] == "20ms"
    assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


@pytest.mark.parametrize(("interval", "period"), [("0.05", "50ms"), ("0.01", "10ms"), ("0.002", "10ms"), ("0", "10ms")])
def test_the_least_time_between_starts_bounds_the_period(tmp_path, interval, period):
    step = named("RUNNABLE-ENTITY", "Step", el("MINIMUM-START-INTERVAL", interval))
    path = write(tmp_path, package("T", component("Pump", every("0.01", "Tick", "Pump/Step"), runnables=[step])))
    imported = read(path)
    assert periods(imported) == {"Pump/Step": period}
    told = found(imported, codes.START_INTERVAL)
    assert [t.code for t in told] == (["HAL0517"] if period == "50ms" else [])


# ---------------------------------------------------------------------------------------------------- modules


def collection(*modules):
    refs = [
        el(
            "ECUC-MODULE-CONFIGURATION-VALUES-REF-CONDITIONAL",
            ref("ECUC-MODULE-CONFIGURATION-VALUES-REF", path, "ECUC-MODULE-CONFIGURATION-VALUES"),
        )
        for path in modules
    ]
    return named("ECUC-VALUE-COLLECTION", "All", el("ECUC-VALUES", *refs))


@pytest.mark.parametrize(
    ("absent", "is_told"),
    [("/E/Rte", True), ("/X/iRte", True), ("/X/MyEcu_EcuC", True), ("/E/Com", False), ("/E/DiagOs", False)],
)
def test_a_module_that_is_missing_is_named(tmp_path, absent, is_told):
    path = write(
        tmp_path,
        package("E", configuration("Os", counter(), os_task("T"), alarm("A", "10", activates="T"))),
        package("C", collection("/E/Os", absent)),
    )
    told = found(read(path), codes.ABSENT_MODULE)
    assert [t.code for t in told] == (["HAL0515"] if is_told else [])
    assert all(absent in t.message for t in told)
    if is_told:
        assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


def test_a_vendor_may_call_its_modules_anything(tmp_path):
    mapping = rte(mapped("Pump/B/Tick", "Main", "1")).replace("/Vendor/X/Rte/", "/Vendor/iRte/")
    os = configuration("Kernel", counter(), os_task("Main"), prefix="/Vendor").replace("/X/Os/", "/Kernel/")
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    text = package("T", pump), package("E", os, configuration("iRte", mapping, prefix="/Vendor"))
    path = write(tmp_path, *(part.replace("/E/Os/", "/E/Kernel/") for part in text))
    assert periods(read(path, granularity="ostask")) == {"Main": "10ms"}


# ---------------------------------------------------------------------------------------------- basic OsTasks


def hosting(tmp_path, *rates, offsets=(), waits=False, more=()):
    """An OsTask that runs R0, R1, ... with a period each."""
    names = [f"R{i}" for i in range(len(rates))]
    pump = component("Pump", *[every(p, f"E{i}", f"Pump/R{i}") for i, p in enumerate(rates)], runnables=" ".join(names))
    shifts = dict(enumerate(offsets))
    maps = [mapped(f"Pump/B/E{i}", "Main", str(i), offset=shifts.get(i, "")) for i in range(len(rates))]
    main = container("Os/OsTask", "Main", refs=[("OsTaskEventRef", "/E/Os/Go")] if waits else [])
    ecu = package("E", configuration("Os", main, container("Os/OsEvent", "Go")), configuration("Rte", rte(*maps)))
    return write(tmp_path, package("T", pump), ecu, *more)


@pytest.mark.parametrize(
    ("rates", "offsets", "expected"),
    [
        (["0.005", "0.02"], (), {"Main": ("5ms", "")}),
        (["0.01", "0.015"], (), {"Main": ("5ms", "")}),
        (["0.01", "0.01"], ("0.002", "0.006"), {"Main": ("2ms", "")}),
        (["0.01", "0.02"], ("0.003", "0.003"), {"Main": ("10ms", "3ms")}),
        (["0.01", "0.01"], (), {"Main": ("10ms", "")}),
    ],
)
def test_a_basic_os_task_is_activated_at_the_common_rate_of_its_calls(tmp_path, rates, offsets, expected):
    path = hosting(tmp_path, *rates, offsets=offsets)
    imported = read(path, granularity="ostask")
    assert {t.name: (str(t.period), str(t.offset or "")) for t in imported.model.tasks} == expected
    told = found(imported, codes.SEVERAL_RATES_OF_TASK)
    assert [t.code for t in told] == ([] if len(set(zip(rates, offsets or rates, strict=True))) == 1 else ["HAL0529"])
    if told:
        assert refusal(path, granularity="ostask", strict=True).exit is Exit.UNSUPPORTED
    assert len(read(path).model.tasks) == 2


def test_an_os_task_that_waits_for_events_is_woken_for_each_rate(tmp_path):
    imported = read(hosting(tmp_path, "0.005", "0.02", waits=True), granularity="ostask")
    assert periods(imported) == {"Main@5ms": "5ms", "Main@20ms": "20ms"}


@pytest.mark.parametrize(("limited", "is_lost"), [("R0", False), ("R1", True)])
def test_limits_of_calls_that_are_not_due_each_time_are_left_out(tmp_path, limited, is_lost):
    chain = [observed("S", f"Pump/{limited}", "STARTED"), observed("E", f"Pump/{limited}", "TERMINATED")]
    more = extension([*chain, event_chain("C", "S", "E")], latency("L", "C", 4000))
    imported = read(hosting(tmp_path, "0.005", "0.02", more=[more]), granularity="ostask")
    (task,) = imported.model.tasks
    assert (str(task.deadline or ""), bool(found(imported, codes.TIMING_LOST))) == ("" if is_lost else "4ms", is_lost)


def test_execution_budgets_are_offered_and_taken_when_asked(tmp_path):
    kind = "Os/OsTask/OsTaskTimingProtection"
    protection = container(kind, "P", params={"OsTaskExecutionBudget": "0.0005"})
    tasks = container("Os/OsTask", "Kept", protection), os_task("Free")
    alarms = alarm("A", "10", activates="Kept"), alarm("B", "10", activates="Free")
    path = write(tmp_path, package("E", configuration("Os", counter(), *tasks, *alarms)))
    plain, asked = read(path), read(path, wcet="budget")
    assert [t.versions[0].wcet for t in plain.model.tasks] == [None, None]
    assert "--wcet budget" in found(plain, codes.NO_WCET)[0].help
    assert [str(t.versions[0].wcet) for t in asked.model.tasks] == ["500us", "None"]
    (told,) = found(asked, codes.BUDGETS)
    assert (told.code, "Kept" in told.message, "Free" in told.message) == ("HAL0533", True, False)


# ------------------------------------------------------------------------------------------------------ locks


AREA_REFS = {
    "runs inside": ("RUNS-INSIDE-EXCLUSIVE-AREA-REFS", "RUNS-INSIDE-EXCLUSIVE-AREA-REF"),
    "may enter": ("CAN-ENTER-EXCLUSIVE-AREA-REFS", "CAN-ENTER-EXCLUSIVE-AREA-REF"),
}


def sharing(tmp_path, *, way="may enter", cores=("First", "Second"), wcet=True, schedule="NON", second="R1", more=()):
    """Runnables R0 and R1 of one component that share an area, each in an OsTask of its own."""
    outer, inner = AREA_REFS[way]
    refs = el(outer, ref(inner, "/T/Pump/B/Area", "EXCLUSIVE-AREA"))
    runnables = [
        named("RUNNABLE-ENTITY", "R0", refs),
        named("RUNNABLE-ENTITY", second, refs),
        named("EXCLUSIVE-AREA", "Area"),
    ]
    if second != "R1":
        runnables.insert(1, named("RUNNABLE-ENTITY", "R1"))
    pump = component("Pump", every("0.01", "E0", "Pump/R0"), every("0.02", "E1", "Pump/R1"), runnables=runnables)
    maps = rte(mapped("Pump/B/E0", "T0", "1"), mapped("Pump/B/E1", "T1", "1"), prototype="Car/p")
    kind = "/Vendor/X/Os/OsTask"
    mode = el("ECUC-TEXTUAL-PARAM-VALUE", ref("DEFINITION-REF", f"{kind}/OsTaskSchedule"), el("VALUE", schedule))
    tasks = [
        container("Os/OsTask", f"T{i}", refs=more).replace("<PARAMETER-VALUES>", f"<PARAMETER-VALUES>{mode}")
        for i in range(2)
    ]
    applications = [
        container(
            "Os/OsApplication",
            f"A{i}",
            refs=[("OsAppTaskRef", f"/E/Os/T{i}"), ("OsApplicationCoreRef", f"/E/EcuC/{core}")],
        )
        for i, core in enumerate(cores)
    ]
    os = configuration("Os", counter(), container("Os/OsResource", "Res"), *tasks, *applications)
    ecuc = configuration("EcuC", core("First", "0"), core("Second", "1"))
    path = write(
        tmp_path,
        package("T", pump, composition("Car", "p:Pump")),
        package("E", os, configuration("Rte", maps), ecuc),
    )
    text = 'halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n' if wcet else "halpipe-overlay: 1\ntasks: {}\n"
    (tmp_path / "o.yaml").write_text(text)
    return path, import_model("arxml", [str(path)], ArxmlImportOptions(overlays=(str(tmp_path / "o.yaml"),)))


def held(imported):
    return [
        (t.name, a.resource, str(a.start), str(a.end), a.bound)
        for t in imported.model.tasks
        for a in t.versions[0].accesses
    ]


@pytest.mark.parametrize("way", AREA_REFS)
def test_an_exclusive_area_is_a_lock_that_whole_jobs_hold(tmp_path, way):
    _, imported = sharing(tmp_path, way=way)
    assert held(imported) == [("p/R0", "p/Area", "0ms", "1ms", 1), ("p/R1", "p/Area", "0ms", "1ms", 1)]
    (resource,) = imported.model.resources
    assert (resource.kind, resource.origin.path) == (ResourceKind.LOCK, "/T/Pump/B/Area")
    (told,) = found(imported, codes.LOCKS_HELD)
    assert told.code == "HAL0534"
    assert len([d for d in imported.coverage.defaulted_values if d.value == "held by whole jobs"]) == 2


@pytest.mark.parametrize(
    "options",
    [{"cores": ("First", "First")}, {"second": "R2"}],
    ids=["on one core, whole", "entered by one runnable"],
)
def test_jobs_that_cannot_overlap_need_no_lock(tmp_path, options):
    _, imported = sharing(tmp_path, **options)
    assert (held(imported), imported.model.resources) == ([], ())


def test_an_os_resource_is_a_lock_of_its_os_tasks(tmp_path):
    _, imported = sharing(tmp_path, second="R2", more=[("OsTaskResourceRef", "/E/Os/Res")])
    assert [resource for _, resource, *_ in held(imported)] == ["Res", "Res"]


def test_a_lock_without_wcets_is_told(tmp_path):
    path, imported = sharing(tmp_path, wcet=False)
    (told,) = found(imported, codes.LOCK_LOST)
    assert (told.code, told.path) == ("HAL0535", 'EXCLUSIVE-AREA "/T/Pump/B/Area"')
    assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


@pytest.mark.parametrize(("cycle", "is_told"), [("5", False), ("10", False), ("20", True), ("4", True)])
def test_an_alarm_that_cannot_trigger_its_event_is_named(tmp_path, cycle, is_told):
    maps = mapped("Pump/B/Tick", "Main", more=[("RteUsedOsAlarmRef", "/E/Os/Al")])
    os = configuration("Os", os_task("Main"), counter(), alarm("Al", cycle, activates="Main"))
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    path = write(tmp_path, package("T", pump), package("E", os, configuration("Rte", rte(maps))))
    imported = read(path)
    assert periods(imported) == {"Pump/Step": "10ms"}
    told = [d.message for d in found(imported, codes.TRIGGERING_DIFFERS)]
    assert told == (
        [f'comes every {cycle}ms, but "Pump/Step", which it triggers, has the period 10ms'] if is_told else []
    )


def test_an_event_that_two_os_tasks_are_to_call_is_named(tmp_path):
    maps = [mapped("Pump/B/Tick", task).replace("Pump_B_Tick", task) for task in ("Main", "Other")]
    tasks = os_task("Main"), os_task("Other")
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    ecu = package("E", configuration("Os", *tasks), configuration("Rte", rte(*maps)))
    imported = read(write(tmp_path, package("T", pump), ecu), granularity="ostask")
    assert periods(imported) == {"Main": "10ms"}
    (told,) = found(imported, codes.SECOND_MAPPING)
    assert told.path == 'RteEventToTaskMapping "/E/Rte/instance/Other"'


@pytest.mark.parametrize(("category", "names"), [("BLUEPRINT", ["Pump/Step"]), ("STANDARD", ["Pump/Step", "Fan/Turn"])])
def test_blueprints_are_no_components(tmp_path, category, names):
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    fan = component("Fan", every("0.01", "Tick", "Fan/Turn"), runnables="Turn")
    pattern = named("AR-PACKAGE", "Patterns", el("CATEGORY", category), el("ELEMENTS", fan)).replace(
        "/T/", "/Patterns/"
    )
    imported = read(write(tmp_path, package("T", pump), pattern))
    assert list(periods(imported)) == names
    assert bool(found(imported, codes.BLUEPRINT)) == (category == "BLUEPRINT")
