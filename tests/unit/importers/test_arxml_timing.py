"""The timing extension: triggerings, deadlines, chains, distances, ages, nested orders; and execution times."""

from fractions import Fraction

import pytest
from arxml_case import (
    assembly,
    component,
    composition,
    configuration,
    container,
    core,
    cse,
    data_observed,
    el,
    event_chain,
    every,
    execution_time,
    extension,
    found,
    hardware,
    implementation,
    in_port,
    latency,
    named,
    observed,
    on_data,
    orders,
    out_port,
    package,
    periods,
    read,
    ref,
    refusal,
    runnable,
    triggering,
    write,
)

from halpipe.core.durations import Duration
from halpipe.importers.arxml import codes
from halpipe.models import Anchor

PUMP = component(
    "Pump", every("0.01", "A", "Pump/First"), every("0.01", "B", "Pump/Second"), runnables="First Second Third"
)
BEGIN, END = observed("Begin", "Pump/First", "ACTIVATED"), observed("End", "Pump/First", "TERMINATED")
LAST = observed("Last", "Pump/Second", "TERMINATED")
START = observed("Start", "Pump/Second", "STARTED")


def pump(tmp_path, *timing, types=(PUMP,), **options):
    return read(write(tmp_path, package("T", *types), *timing), **options)


def first(imported):
    return imported.model.task("Pump/First")


# ------------------------------------------------------------------------------------------------ triggerings


def test_a_periodic_triggering_gives_a_runnable_without_events_its_period(tmp_path):
    third = observed("E", "Pump/Third", "ACTIVATED")
    imported = pump(tmp_path, extension([third], triggering("PERIODIC", "P", "E", cse("PERIOD", 20, code=3))))
    assert periods(imported)["Pump/Third"] == "20ms"
    assert ("PERIODIC-EVENT-TRIGGERING", 1, 1, 0) in imported.coverage.rows()


def test_jitter_is_slack_and_the_whole_period_at_most(tmp_path):
    for jitter, slack in ((0, 0), (2_500, Fraction(1, 4)), (10_000, 1), (10_001, 1)):
        wanted = triggering("PERIODIC", "P", "Begin", cse("JITTER", jitter), cse("PERIOD", 10_000))
        imported = pump(tmp_path, extension([BEGIN], wanted))
        assert first(imported).slack == slack
        assert bool(found(imported, codes.TIMING_PART_LOST)) == (jitter > 10_000)


def test_a_triggering_that_contradicts_the_event_is_reported_and_does_not_count(tmp_path):
    imported = pump(tmp_path, extension([BEGIN], triggering("PERIODIC", "P", "Begin", cse("PERIOD", 9_999))))
    assert str(first(imported).period) == "10ms"
    assert "9.999ms" in found(imported, codes.TRIGGERING_DIFFERS)[0].message


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("SPORADIC", cse("MINIMUM-INTER-ARRIVAL-TIME", 4_000)),
        ("BURST-PATTERN", cse("MINIMUM-INTER-ARRIVAL-TIME", 4_000)),
        ("ARBITRARY", el("MINIMUM-DISTANCES", cse("MULTIDIMENSIONAL-TIME", 4_000))),
    ],
)
def test_unforeseen_arrivals_are_polled_within_their_least_distance(tmp_path, kind, content):
    third = observed("E", "Pump/Third", "ACTIVATED")
    imported = pump(tmp_path, extension([third], triggering(kind, "P", "E", content)))
    third = imported.model.task("Pump/Third")
    assert (str(third.distance), str(third.period)) == ("4ms", "2.5ms")  # of the 10 ms of the others
    assert found(imported, codes.SPORADIC)


def test_a_concrete_pattern_gives_one_task_for_each_offset(tmp_path):
    third = observed("E", "Pump/Third", "ACTIVATED")
    pattern = [
        el("OFFSETS", *(cse("MULTIDIMENSIONAL-TIME", offset) for offset in (0, 3_000))),
        cse("PATTERN-PERIOD", 10_000),
    ]
    imported = pump(tmp_path, extension([third], triggering("CONCRETE-PATTERN", "P", "E", *pattern)))
    tasks = [task for task in imported.model.tasks if task.name.startswith("Pump/Third")]
    assert [(str(task.period), str(task.offset)) for task in tasks] == [("10ms", "0ms"), ("10ms", "3ms")]


@pytest.mark.parametrize("second", [3_000, 4_000])
def test_a_pattern_in_two_files_counts_once_or_contradicts_itself(tmp_path, second):
    def part(offset):
        offsets = el("OFFSETS", *(cse("MULTIDIMENSIONAL-TIME", each) for each in (0, offset)))
        pattern = triggering("CONCRETE-PATTERN", "P", "E", offsets, cse("PATTERN-PERIOD", 10_000))
        return extension([observed("E", "Pump/Third", "ACTIVATED")], pattern)

    paths = [write(tmp_path, package("T", PUMP), part(3_000)), write(tmp_path, part(second), name="two.arxml")]
    if second == 3_000:
        assert len([task for task in read(*paths).model.tasks if task.name.startswith("Pump/Third")]) == 2
    else:
        (told,) = {d for d in refusal(*paths).diagnostics if d.code == codes.CONFLICT.id}
        assert (told.message.partition(" ")[0], told.at.file) == ("OFFSETS", str(paths[1]))


def test_data_that_arrives_sporadically_starts_its_reader(tmp_path):
    reader = component("Reader", on_data("E", "Reader/Read", "Reader/in"), runnables="Read", ports=[in_port("in")])
    arrival = triggering("SPORADIC", "S", "Data", cse("MINIMUM-INTER-ARRIVAL-TIME", 30, code=3))
    timing = extension([data_observed("Data", "Reader/in", "RECEIVED")], arrival)
    imported = pump(tmp_path, timing, types=(reader,))
    assert periods(imported) == {"Reader/Read": "20ms"}
    assert str(imported.model.tasks[0].distance) == "30ms"


# ------------------------------------------------------------------------------------------- limits and chains


def test_latency_from_begin_to_end_of_a_runnable_is_its_deadline(tmp_path):
    imported = pump(
        tmp_path,
        extension([BEGIN, END, event_chain("C", "Begin", "End")], latency("L", "C", 8_000), latency("M", "C", 9_000)),
    )
    assert str(first(imported).deadline) == "8ms"
    assert imported.model.chains == ()
    assert ("LATENCY-TIMING-CONSTRAINT", 2, 2, 0) in imported.coverage.rows()


def test_latency_between_runnables_is_a_chain_with_its_limits(tmp_path):
    chain = event_chain("C", "Begin", "Last")
    imported = pump(
        tmp_path, extension([BEGIN, LAST, chain], latency("R", "C", 30_000), latency("A", "C", 25_000, "AGE"))
    )
    (chain,) = imported.model.chains
    assert (chain.name, chain.tasks) == ("C", ("Pump/First", "Pump/Second"))
    assert (str(chain.max_latency), chain.max_reaction, str(chain.max_age)) == ("30ms", None, "25ms")


EVENTS = {
    ("ACTIVATED", "TERMINATED"): (Anchor.RELEASE, None),
    ("STARTED", "TERMINATED"): (None, None),
    ("TERMINATED", "STARTED"): (Anchor.END, Anchor.START),
    ("TERMINATED", "ACTIVATED"): (Anchor.END, Anchor.START),
    ("STARTED", "STARTED"): (None, Anchor.START),
}


@pytest.mark.parametrize(("ends", "expected"), EVENTS.items())
def test_a_reaction_between_runnables_is_a_latency_between_their_events(tmp_path, ends, expected):
    """R2 within 50 ms after the end of R1, both every 100 ms, is no matter of a stimulus that just missed R1."""
    begin, end = ends
    parts = [observed("B", "Pump/First", begin), observed("E", "Pump/Second", end), event_chain("C", "B", "E")]
    (chain,) = pump(tmp_path, extension(parts, latency("R", "C", 50_000))).model.chains
    assert (chain.anchor, chain.to) == expected
    assert (str(chain.max_latency), chain.max_reaction) == ("50ms", None)


def test_what_comes_at_a_port_may_just_miss_the_first_job(tmp_path):
    reader = component(
        "Reader",
        every("0.02", "E", "Reader/Read"),
        every("0.02", "F", "Reader/Act"),
        runnables=[runnable("Read", reads=["Reader/in"]), named("RUNNABLE-ENTITY", "Act")],
        ports=[in_port("in")],
    )
    parts = [data_observed("B", "Reader/in", "RECEIVED"), observed("E", "Reader/Act", "TERMINATED")]
    timing = extension([*parts, event_chain("C", "B", "E")], latency("R", "C", 50_000))
    (chain,) = pump(tmp_path, timing, types=(reader,)).model.chains
    assert (str(chain.max_reaction), chain.max_latency, chain.tasks) == ("50ms", None, ("Reader/Read", "Reader/Act"))


def test_a_chain_that_ends_before_it_begins_is_told(tmp_path):
    parts = [observed("B", "Pump/First", "TERMINATED"), observed("E", "Pump/First", "STARTED")]
    imported = pump(tmp_path, extension([*parts, event_chain("C", "B", "E")], latency("R", "C", 50_000)))
    assert imported.model.chains == ()
    assert found(imported, codes.TIMING_LOST)


def test_segments_are_the_steps_of_a_chain(tmp_path):
    third = component("Valve", every("0.02", "E", "Valve/Move"), runnables="Move")
    steps = [BEGIN, END, START, LAST, observed("M", "Valve/Move", "STARTED"), observed("N", "Valve/Move", "TERMINATED")]
    chains = [event_chain("One", "Begin", "End"), event_chain("Two", "Start", "Last"), event_chain("Three", "M", "N")]
    whole = event_chain("All", "Begin", "N", "One", "Two", "Three")
    imported = pump(tmp_path, extension([*steps, *chains, whole], latency("L", "All", 90_000)), types=(PUMP, third))
    assert [chain.tasks for chain in imported.model.chains] == [("Pump/First", "Pump/Second", "Valve/Move")]


@pytest.mark.parametrize(
    "chains",
    [
        [event_chain("C0", "Begin", "Last", "C1"), event_chain("C1", "Begin", "End", "C0")],
        [event_chain("C0", "Begin", "Last", "A0", "B0")]
        + [event_chain(f"{x}{n}", "Begin", "Last", f"A{n + 1}", f"B{n + 1}") for n in range(40) for x in "AB"],
    ],
    ids=["through-another", "doubled"],
)
def test_a_chain_without_end_is_reported_and_so_are_its_limits(tmp_path, chains):
    imported = pump(tmp_path, extension([BEGIN, END, LAST, *chains], latency("L", "C0", 90_000)))
    assert "C0" not in [chain.name for chain in imported.model.chains]
    lost = {d.path for d in found(imported, codes.TIMING_LOST) if "part of itself, or has more than" in d.message}
    assert {path.rpartition("/")[2].strip('"') for path in lost} >= {"C0", "L"}


def test_chains_nest_as_deep_as_they_are_stated(tmp_path):
    chains = [event_chain(f"C{n}", "Begin", "Last", f"C{n + 1}") for n in range(1200)]
    imported = pump(tmp_path, extension([BEGIN, LAST, *chains, event_chain("C1200", "Begin", "Last")]))
    assert found(imported, codes.TIMING_LOST) == []


def test_a_chain_without_limit_is_kept(tmp_path):
    (chain,) = pump(tmp_path, extension([BEGIN, LAST, event_chain("C", "Begin", "Last")])).model.chains
    assert chain.max_reaction is None


def test_instances_of_one_type_have_a_chain_each_and_a_named_one_its_own(tmp_path):
    root = composition("Root", "left:Pump right:Pump")
    types = (PUMP, root)
    both = pump(tmp_path, extension([BEGIN, LAST, event_chain("C", "Begin", "Last")]), types=types)
    assert {chain.tasks for chain in both.model.chains} == {
        ("left/First", "left/Second"),
        ("right/First", "right/Second"),
    }
    ends = [observed("Begin", "Pump/First", "ACTIVATED", "Root/right"), LAST, event_chain("C", "Begin", "Last")]
    one = pump(tmp_path, extension(ends), types=types)
    assert [chain.tasks for chain in one.model.chains] == [("right/First", "right/Second")]


def test_guarantees_require_nothing(tmp_path):
    parts = [BEGIN, END, event_chain("C", "Begin", "End")]
    imported = pump(tmp_path, extension(parts, guarantees=[latency("L", "C", 8_000)]))
    assert first(imported).deadline is None
    assert ("LATENCY-TIMING-CONSTRAINT", 1, 0, 1) in imported.coverage.rows()


def test_the_age_of_data_is_a_chain_from_each_sender(tmp_path):
    reader = component(
        "Reader",
        every("0.02", "E", "Reader/Read"),
        runnables=[runnable("Read", reads=["Reader/in"])],
        ports=[in_port("in")],
    )
    sender = component(
        "Sender",
        every("0.01", "E", "Sender/Send"),
        runnables=[runnable("Send", writes=["Sender/out"])],
        ports=[out_port("out")],
    )
    root = composition("Root", "s:Sender r:Reader", assembly("k", "Root/s Sender/out", "Root/r Reader/in"))
    scope = ref("SCOPE-REF", "/Timing/X/Data")
    timing = extension(
        [data_observed("Data", "Reader/in", "RECEIVED")],
        named("AGE-CONSTRAINT", "Fresh", scope, cse("MAXIMUM", 50_000)),
    )
    (chain,) = pump(tmp_path, timing, types=(sender, reader, root)).model.chains
    assert (chain.name, chain.tasks, str(chain.max_age)) == ("Fresh", ("s/Send", "r/Read"), "50ms")


# ------------------------------------------------------------------------------------------ distances and orders


def distance(low, high, source="Begin", target="Start", name="O"):
    ends = [ref("SOURCE-REF", f"/Timing/X/{source}"), ref("TARGET-REF", f"/Timing/X/{target}")]
    limits = [cse("MINIMUM", low)] if low else []
    return named("OFFSET-TIMING-CONSTRAINT", name, *ends, *limits, *([cse("MAXIMUM", high)] if high else []))


@pytest.mark.parametrize(
    ("source", "low", "high", "window"),
    [
        ("Begin", 1_000, 3_000, ("1ms", "3ms", Anchor.RELEASE)),
        ("End", 1_000, 3_000, ("1ms", "3ms", Anchor.END)),
        ("Begin", 0, 3_000, ("0ms", "3ms", Anchor.RELEASE)),
        ("Started", 1_000, 3_000, ("1ms", "3ms", Anchor.START)),
        ("Begin", 1_000, 0, ("1ms", "11ms", Anchor.RELEASE)),
    ],
)
def test_an_offset_constraint_is_a_window(tmp_path, source, low, high, window):
    """What is activated is released; it starts no sooner, so that a window from its start is a weaker demand."""
    started = observed("Started", "Pump/First", "STARTED")
    imported = pump(tmp_path, extension([BEGIN, started, END, START], distance(low, high, source)))
    (precedence,) = imported.model.task("Pump/Second").versions[0].precedences
    assert (str(precedence.min), str(precedence.max), precedence.anchor) == window
    assert precedence.task == "Pump/First"


@pytest.mark.parametrize(("low", "high", "warnings"), [(1_000, 3_000, 1), (0, 3_000, 0)])
def test_a_least_distance_to_an_activation_is_reported(tmp_path, low, high, warnings):
    """A job starts at its release at the earliest, so that its start keeps a distance that its release may not."""
    activated = observed("Released", "Pump/Second", "ACTIVATED")
    imported = pump(tmp_path, extension([BEGIN, activated], distance(low, high, target="Released")))
    assert len(found(imported, codes.TIMING_PART_LOST)) == warnings


def test_an_offset_to_the_end_of_a_runnable_is_lost_and_said_so(tmp_path):
    imported = pump(tmp_path, extension([BEGIN, LAST], distance(0, 5_000, target="Last")))
    assert found(imported, codes.TIMING_LOST)
    assert orders(imported) == set()


def eoc(*elements, events=(), also=()):
    constraint = named("EXECUTION-ORDER-CONSTRAINT", "O", el("ORDERED-ELEMENTS", *elements))
    return extension(list(events), constraint, *also)


def entity(name, path, *after, prototype=""):
    where = el("COMPONENT-IREF", ref("TARGET-COMPONENT-REF", f"/T/{prototype}")) if prototype else ""
    owner, runnable_name = path.split("/")
    return named(
        "EOC-EXECUTABLE-ENTITY-REF",
        name,
        where,
        ref("EXECUTABLE-REF", f"/T/{owner}/B/{runnable_name}"),
        el("DIRECT-SUCCESSOR-REFS", *(ref("DIRECT-SUCCESSOR-REF", f"/Timing/X/O/{n}") for n in after)),
    )


@pytest.mark.parametrize(
    ("source", "windows"),
    [
        ("Started", [("1ms", "3ms", Anchor.START), ("0ms", "10ms", Anchor.END)]),
        ("End", [("1ms", "3ms", Anchor.END)]),
    ],
)
def test_an_order_holds_beside_a_window_that_does_not_demand_it(tmp_path, source, windows):
    """Second may start 1 ms after the start of First only where First has ended by then."""
    order = [entity("f", "Pump/First", "s"), entity("s", "Pump/Second")]
    started = observed("Started", "Pump/First", "STARTED")
    content = eoc(*order, events=(started, END, START), also=[distance(1_000, 3_000, source, name="D")])
    precedences = pump(tmp_path, content).model.task("Pump/Second").versions[0].precedences
    assert [(str(p.min), str(p.max), p.anchor) for p in precedences] == windows


def nest(name, inner, *after):
    return named(
        "EOC-EXECUTABLE-ENTITY-REF-GROUP",
        name,
        el("NESTED-ELEMENT-REFS", *(ref("NESTED-ELEMENT-REF", f"/Timing/X/O/{n}") for n in inner.split())),
        el("SUCCESSOR-REFS", *(ref("SUCCESSOR-REF", f"/Timing/X/O/{n}") for n in after)),
    )


FIVE = component("P", *(every("0.01", f"E{n}", f"P/{n}") for n in "ABCDE"), runnables="A B C D E")


def test_nested_groups_are_ordered_from_their_last_to_the_first_of_the_next(tmp_path):
    constraint = eoc(
        entity("a", "P/A", "b"),
        entity("b", "P/B"),
        entity("c", "P/C"),
        entity("d", "P/D", "e"),
        entity("e", "P/E"),
        nest("inner", "a b"),
        nest("outer", "inner c", "late"),
        nest("late", "d e"),
    )
    assert orders(pump(tmp_path, constraint, types=(FIVE,))) == {"P/A > P/B", "P/D > P/E", "P/B > P/D", "P/C > P/D"}


def test_a_group_inside_itself_does_not_hang_the_import(tmp_path):
    constraint = eoc(entity("a", "P/A"), entity("b", "P/B"), nest("g", "g a", "b"))
    assert orders(pump(tmp_path, constraint, types=(FIVE,))) == {"P/A > P/B"}


def test_groups_nest_as_deep_as_they_are_stated_and_may_share_groups(tmp_path):
    groups = [nest(f"g{n}", f"g{n + 1} g{n + 1}") for n in range(1200)]
    constraint = eoc(entity("a", "P/A"), entity("b", "P/B"), nest("g", "g0", "b"), *groups, nest("g1200", "a"))
    assert orders(pump(tmp_path, constraint, types=(FIVE,))) == {"P/A > P/B"}


def test_an_order_of_one_component_instance_leaves_the_others_alone(tmp_path):
    root = composition("Root", "left:P right:P")
    constraint = eoc(entity("a", "P/A", "b", prototype="Root/left"), entity("b", "P/B", prototype="Root/left"))
    assert orders(pump(tmp_path, constraint, types=(FIVE, root))) == {"left/A > left/B"}


def test_a_synchronisation_point_separates_before_from_after(tmp_path):
    elements = [entity("a", "P/A"), entity("b", "P/B"), entity("c", "P/C"), nest("g", "a b")]
    point = named(
        "SYNCHRONIZATION-POINT-CONSTRAINT",
        "S",
        el("SOURCE-EEC-REFS", ref("SOURCE-EEC-REF", "/Timing/X/O/g")),
        el("TARGET-EEC-REFS", ref("TARGET-EEC-REF", "/Timing/X/O/c")),
    )
    constraint = named("EXECUTION-ORDER-CONSTRAINT", "O", el("ORDERED-ELEMENTS", *elements))
    imported = pump(tmp_path, extension([], constraint, point), types=(FIVE,))
    assert orders(imported) == {"P/A > P/C", "P/B > P/C"}


# ----------------------------------------------------------------------------------------------- execution times


def timed(tmp_path, *times, extra=()):
    step = component("P", every("0.01", "E", "P/A"), runnables="A")
    (task,) = pump(tmp_path, types=(step, implementation(*times), *extra)).model.tasks
    return task


@pytest.mark.parametrize(
    ("code", "factor", "wcet"),
    [
        (0, "1500", "1.5ms"),
        (3, "2", "2ms"),
        (26, "750", "750ns"),
        (1, "7", "70us"),
        (6, "0.001", "1ms"),
        (20, "1", "1/1000000ns"),
    ],
)
def test_codes_of_time_are_exact(tmp_path, code, factor, wcet):
    time = execution_time("ANALYZED", "T", "P/A", "WORST-CASE-EXECUTION-TIME", factor, code=code)
    assert timed(tmp_path, time).versions[0].wcet == Duration.parse(wcet)


def test_the_most_trustworthy_kind_counts_and_of_it_the_longest(tmp_path):
    times = [
        execution_time("ROUGH-ESTIMATE-OF", "R", "P/A", "ESTIMATED-EXECUTION-TIME", 90),
        execution_time("SIMULATED", "S", "P/A", "MAXIMUM-EXECUTION-TIME", 80),
        execution_time("MEASURED", "M1", "P/A", "MAXIMUM-EXECUTION-TIME", 50),
        execution_time("MEASURED", "M2", "P/A", "MAXIMUM-EXECUTION-TIME", 60),
    ]
    version = timed(tmp_path, *times).versions[0]
    assert str(version.wcet) == "60us"
    assert version.origin.path == "/T/Impl/Used/M2"


def test_a_required_execution_time_is_the_last_resort(tmp_path):
    step = component("P", every("0.01", "E", "P/A"), runnables="A")
    budget = named("EXECUTION-TIME-CONSTRAINT", "B", ref("EXECUTABLE-REF", "/T/P/B/A"), cse("MAXIMUM", 400))
    assert str(pump(tmp_path, extension([], budget), types=(step,)).model.tasks[0].versions[0].wcet) == "400us"


def test_hardware_with_times_of_its_own_makes_versions(tmp_path):
    times = [
        execution_time("ANALYZED", "B", "P/A", "WORST-CASE-EXECUTION-TIME", 300, "Big"),
        execution_time("ANALYZED", "L", "P/A", "WORST-CASE-EXECUTION-TIME", 900, "Little"),
        execution_time("ANALYZED", "M", "P/A", "WORST-CASE-EXECUTION-TIME", 900, "Other"),
    ]
    task = timed(tmp_path, *times, extra=(hardware("Big", "Little", "Other"),))
    versions = [(version.name, str(version.wcet), version.units) for version in task.versions]
    assert versions == [("Big", "300us", ("Big",)), ("Little", "900us", ("Little", "Other"))]


def test_a_time_holds_for_all_hardware_that_is_nested_where_it_is_stated(tmp_path):
    """That of the nearest element counts, of two as near the longest; a circle of elements ends."""
    stated = {"Chip": 900, "Fast": 300, "Warm": 400, "Three": 200}
    times = [
        execution_time("ANALYZED", name, "P/A", "WORST-CASE-EXECUTION-TIME", time, name)
        for name, time in stated.items()
    ]
    holders = {"Fast": "One Two", "Warm": "Two", "Chip": "Fast Warm Three Four", "Board": "Chip Board"}
    task = timed(tmp_path, *times, extra=(hardware("One", "Two", "Three", "Four", **holders),))
    assert [(v.name, str(v.wcet), v.units) for v in task.versions] == [
        ("Fast", "300us", ("One",)),
        ("Warm", "400us", ("Two",)),
        ("Three", "200us", ("Three",)),
        ("Chip", "900us", ("Four",)),
    ]


def test_a_nested_element_that_is_not_there_is_reported(tmp_path):
    time = execution_time("ANALYZED", "B", "P/A", "WORST-CASE-EXECUTION-TIME", 300, "Chip")
    step = component("P", every("0.01", "E", "P/A"), runnables="A")
    found = read(write(tmp_path, package("T", step, implementation(time), hardware("One", Chip="One Gone"))))
    assert [d.code for d in found.diagnostics if "/T/Gone" in d.message] == ["HAL0511"]
    assert [version.units for version in found.model.tasks[0].versions] == [("One",)]


def test_cores_of_the_configuration_say_what_hardware_they_are(tmp_path):
    cores = [
        container("EcuC/EcucHardware/EcucCoreDefinition", "C0", refs=[("EcucCoreHwRef", "/T/Big")]),
        container("EcuC/EcucHardware/EcucCoreDefinition", "C1", refs=[("EcucCoreHwRef", "/T/Little")]),
    ]
    step = component("P", every("0.01", "E", "P/A"), runnables="A")
    times = implementation(
        execution_time("ANALYZED", "B", "P/A", "WORST-CASE-EXECUTION-TIME", 300, "Big"),
        execution_time("ANALYZED", "L", "P/A", "WORST-CASE-EXECUTION-TIME", 900),
    )
    path = write(
        tmp_path, package("T", step, times, hardware("Big", "Little")), package("E", configuration("EcuC", *cores))
    )
    (task,) = read(path).model.tasks
    assert [(v.name, str(v.wcet), v.units) for v in task.versions] == [
        ("Big", "300us", ("C0",)),
        ("default", "900us", ("C1",)),
    ]


def test_without_knowing_the_hardware_of_a_core_the_longest_time_counts(tmp_path):
    times = implementation(
        execution_time("ANALYZED", "B", "P/A", "WORST-CASE-EXECUTION-TIME", 300, "Big"),
        execution_time("ANALYZED", "L", "P/A", "WORST-CASE-EXECUTION-TIME", 900, "Little"),
    )
    step = component("P", every("0.01", "E", "P/A"), runnables="A")
    path = write(
        tmp_path,
        package("T", step, times, hardware("Big", "Little")),
        package("E", configuration("EcuC", core("C0", "0"))),
    )
    assert str(read(path).model.tasks[0].versions[0].wcet) == "900us"
