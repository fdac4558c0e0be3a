"""Requirements on several tasks at once: synchronised events, LET intervals, spinlocks; and what else must be told."""

import pytest
from arxml_case import (
    component,
    configuration,
    container,
    core,
    counter,
    cse,
    el,
    event_chain,
    every,
    extension,
    found,
    latency,
    mapped,
    named,
    observed,
    order,
    os_task,
    package,
    periods,
    read,
    ref,
    rte,
    schedule_table,
    timing,
    write,
)

from halpipe.core.durations import Duration
from halpipe.flow.formats import import_model
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.models import Match

PUMP = component(
    "Pump",
    every("0.01", "A", "Pump/First"),
    every("0.01", "B", "Pump/Second"),
    every("0.02", "C", "Pump/Third"),
    runnables="First Second Third",
)
EVENTS = [
    observed(f"{name}{what.title()}", f"Pump/{name}", what)
    for name in ("First", "Second", "Third")
    for what in ("ACTIVATED", "STARTED", "TERMINATED")
]


def together(*events, scope="SCOPE-EVENT-REF", tolerance=5):
    """A synchronisation of observed events, in microseconds."""
    refs = [ref(scope, f"/Timing/X/{event}") for event in events]
    return named("SYNCHRONIZATION-TIMING-CONSTRAINT", "Together", el(f"{scope}S", *refs), cse("TOLERANCE", tolerance))


def required(tmp_path, *constraints, more=()):
    return read(write(tmp_path, package("T", PUMP), extension([*EVENTS, *more], *constraints)))


def windows(imported):
    return [
        (p.task, str(p.anchor), task.name, str(p.to), str(p.min), str(p.max), p.match)
        for task in imported.model.tasks
        for p in task.versions[0].precedences
    ]


# ------------------------------------------------------------------------------------------- synchronisation


@pytest.mark.parametrize(("what", "instant"), [("Started", "start"), ("Terminated", "end")])
def test_synchronised_events_are_within_the_tolerance_of_the_first(tmp_path, what, instant):
    imported = required(tmp_path, together(f"Second{what}", f"First{what}"))
    assert windows(imported) == [
        ("Pump/First", instant, "Pump/Second", instant, "0ms", "5us", Match.CYCLE),
    ]
    (told,) = found(imported, codes.SYNCHRONISED)
    assert told.message == 'Pump/Second follow "Pump/First" within 5us'
    assert not found(imported, codes.UNUSED_KIND)


def test_synchronised_tasks_follow_the_order_that_is_stated(tmp_path):
    """First comes after Second by an order, so Second is the first of the two."""
    parts = [package("T", PUMP), timing(order("O", "Pump/Second Pump/First"))]
    both = extension(EVENTS, together("FirstStarted", "SecondStarted"))
    imported = read(write(tmp_path, *parts, both))
    assert windows(imported) == [
        ("Pump/Second", "end", "Pump/First", "start", "0ms", "10ms", Match.WINDOW),
        ("Pump/Second", "start", "Pump/First", "start", "0ms", "5us", Match.CYCLE),
    ]


@pytest.mark.parametrize(
    ("constraint", "why"),
    [
        (together("FirstStarted", "ThirdStarted"), "different periods: Pump/First, Pump/Third"),
        (together("FirstActivated", "SecondStarted"), "no start or end of just one task"),
        (together("FirstStarted", "FirstTerminated"), 'all its events are of the task "Pump/First"'),
    ],
)
def test_a_synchronisation_that_no_window_states_is_lost_with_the_reason(tmp_path, constraint, why):
    imported = required(tmp_path, constraint)
    (told,) = found(imported, codes.TIMING_LOST)
    assert why in told.message
    assert not windows(imported)


def test_a_synchronisation_of_chains_is_not_imported(tmp_path):
    chain = event_chain("Chain", "FirstStarted", "SecondTerminated")
    imported = required(tmp_path, together("Chain", scope="SCOPE-REF"), more=[chain])
    assert [told.message for told in found(imported, codes.TIMING_IGNORED)] == [
        "is not imported: it names event chains"
    ]


# ------------------------------------------------------------------------------------------------- intervals


def interval(*members, name="Let"):
    """A group of runnables that executes in the LET interval of the event chain `name`."""
    elements = [
        named("EOC-EXECUTABLE-ENTITY-REF", member, ref("EXECUTABLE-REF", f"/T/Pump/B/{member}")) for member in members
    ]
    nested = [ref("NESTED-ELEMENT-REF", f"/Timing/X/Lets/{member}") for member in members]
    group = named(
        "EOC-EXECUTABLE-ENTITY-REF-GROUP",
        "Group",
        el("LET-INTERVAL-REFS", ref("LET-INTERVAL-REF", f"/Timing/X/{name}")),
        el("NESTED-ELEMENT-REFS", *nested),
    )
    return named("EXECUTION-ORDER-CONSTRAINT", "Lets", el("ORDERED-ELEMENTS", *elements, group))


CHAIN = event_chain("Let", "FirstActivated", "SecondTerminated")


def test_the_tasks_of_a_let_interval_have_its_length(tmp_path):
    limit = latency("Length", "Let", 8000).replace("<MAXIMUM>", cse("MINIMUM", 8000) + "<MAXIMUM>")
    imported = required(tmp_path, interval("First", "Second"), limit, more=[CHAIN])
    lets = {task.name: task.let for task in imported.model.tasks}
    assert lets == {"Pump/First": Duration.parse("8ms"), "Pump/Second": Duration.parse("8ms"), "Pump/Third": None}
    assert not [*found(imported, codes.TIMING_PART_LOST), *found(imported, codes.ORDER_LOST)]


def test_a_let_interval_without_a_length_is_lost(tmp_path):
    imported = required(tmp_path, interval("First"), more=[CHAIN])
    (told,) = found(imported, codes.TIMING_LOST)
    assert told.message.endswith("the length of its interval is not stated")
    assert all(task.let is None for task in imported.model.tasks)


# ------------------------------------------------------------------------------------------------- the OS


def two_cores(tmp_path, *os, rtes=(), tasks="Main Aid"):
    """First and Second run on two cores, each in the OsTask of an OsApplication of its own."""
    names = tasks.split()
    applications = [
        container(
            "Os/OsApplication",
            f"App{number}",
            params={"OsApplicationCoreAssignment": str(number)},
            refs=[("OsAppTaskRef", f"/E/Os/{name}") for name in names[number::2]],
        )
        for number in (0, 1)
    ]
    calls = [mapped("Pump/B/A", "Main", "1"), mapped("Pump/B/B", "Aid", "1"), mapped("Pump/B/C", "Aid", "2")]
    parts = [
        configuration("Os", counter(), *map(os_task, names), *applications, *os),
        configuration("Rte", rte(*calls), *rtes),
        configuration("EcuC", core("C0", "0"), core("C1", "1")),
    ]
    return write(tmp_path, package("T", PUMP), package("E", *parts))


def completed(path, tmp_path):
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 50us}\n')
    return import_model("arxml", [str(path)], ArxmlImportOptions(overlays=(str(overlay),)))


SPINLOCK = container(
    "Os/OsSpinlock", "Spin", refs=[("OsSpinlockAccessingApplication", f"/E/Os/App{n}") for n in (0, 1)]
)


def test_a_spinlock_is_held_by_the_only_task_of_each_application(tmp_path):
    imported = completed(two_cores(tmp_path, SPINLOCK), tmp_path)
    holders = {
        task.name
        for task in imported.model.tasks
        if {a.resource for v in task.versions for a in v.accesses} == {"Spin"}
    }
    assert holders == {"Pump/First", "Pump/Second", "Pump/Third"}
    assert not [d for d in imported.diagnostics if d.code == codes.UNUSED_KIND.id]


def test_a_spinlock_that_any_of_several_tasks_may_take_is_told(tmp_path):
    imported = completed(two_cores(tmp_path, SPINLOCK, tasks="Main Aid Other"), tmp_path)
    assert not imported.model.resources
    assert [d.path for d in imported.diagnostics if d.code == codes.UNUSED_KIND.id] == ['OsSpinlock "/E/Os/Spin"']


def test_a_linked_resource_is_the_one_that_it_is_linked_to(tmp_path):
    linked = container("Os/OsResource", "Alias", refs=[("OsResourceLinkedResourceRef", "/E/Os/Real")])
    path = two_cores(tmp_path, container("Os/OsResource", "Real"), linked)
    text = path.read_text()
    for name, resource in (("Main", "Real"), ("Aid", "Alias")):
        definition = ref("DEFINITION-REF", "/Vendor/X/Os/OsTask/OsTaskResourceRef")
        value = el("ECUC-REFERENCE-VALUE", definition, ref("VALUE-REF", f"/E/Os/{resource}"))
        begin = text.index(f"<SHORT-NAME>{name}</SHORT-NAME>")
        text = text[:begin] + text[begin:].replace("<REFERENCE-VALUES>", f"<REFERENCE-VALUES>{value}", 1)
    path.write_text(text)
    assert [resource.name for resource in completed(path, tmp_path).model.resources] == ["Real"]


def in_mode(table, mode):
    """A table that the OS starts in an application mode."""
    start = container(
        "Os/OsScheduleTable/OsScheduleTableAutostart",
        "Begin",
        refs=[("OsScheduleTableAppModeRef", f"/E/Os/{mode}")],
    )
    return table.replace("<SUB-CONTAINERS>", f"<SUB-CONTAINERS>{start}", 1)


@pytest.mark.parametrize("modes", ["OSDEFAULTAPPMODE Limp", "Limp OSDEFAULTAPPMODE"])
def test_tables_of_two_application_modes_do_not_run_at_once(tmp_path, modes):
    first, second = modes.split()
    os = [
        *(container("Os/OsAppMode", mode) for mode in (first, second)),
        counter(),
        os_task("Lone"),
        os_task("Other"),
        in_mode(schedule_table("One", "10", [("P", "0", "Lone")]), first),
        in_mode(schedule_table("Two", "50", [("P", "0", "Other")]), second),
    ]
    imported = read(write(tmp_path, package("E", configuration("Os", *os))))
    is_first = first == "OSDEFAULTAPPMODE"
    assert periods(imported) == ({"Lone": "10ms"} if is_first else {"Other": "50ms"})
    assert [told.path for told in found(imported, codes.OTHER_START)] == [
        f'OsScheduleTable "/E/Os/{"Two" if is_first else "One"}"'
    ]


def test_an_rte_that_maps_no_event_is_told(tmp_path):
    parts = [configuration("Os", counter(), os_task("Main")), configuration("Rte", rte())]
    imported = read(write(tmp_path, package("T", PUMP), package("E", *parts)))
    assert [told.path for told in found(imported, codes.MAPS_NOTHING)] == ['ECUC-MODULE-CONFIGURATION-VALUES "/E/Rte"']
