"""The system of an ARXML export: components, versions, hardware, modes, demands and guarantees, by release."""

from dataclasses import replace

import pytest
from exporter_samples import hostile, roboracer, thirds, two_modes
from lxml import etree

from arxml_reading import NS, all_of, by_path, name_of, names, native, q, text, texts, write
from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml import FORMAT, RELEASES, ArxmlOptions, export
from halpipe.exporters.arxml.codes import BAD_PREFIX, NO_LATENCY, WEAKER_WINDOW
from halpipe.exporters.arxml.onto import Change, Onto
from halpipe.exporters.arxml.software import ShortNames
from halpipe.exporters.common.codes import DANGLING_NAME, FOREIGN_SCHEDULE, NEEDS_SCHEDULE
from halpipe.exporters.native.document import UNWRITABLE
from halpipe.models import Anchor, ChainLatency, Match, ModeSchedule, Precedence, Status
from halpipe.models.modes import UNKNOWN_MODE
from stated_options import stated
from support import access, after, chain, job, mode, model, ms, schedule, task, version

PUMP = task("/pump", "10ms", version("fast", "2ms", "u1 u2"), version("slow", "1/3ms", "u2"))
VALVE = task(
    "valve", "20ms", version("v", "1ms", "u2", after("/pump", 1, 8, "end")), deadline="15.0005ms", offset="5ms"
)
SYSTEM = model(PUMP, VALVE, units="u1 u2", chains=[chain("c", "/pump valve", reaction="40ms", age="100/3ms")])
JOBS = (
    job(SYSTEM, "/pump", 0, "1ms", "u1", "fast"),
    job(SYSTEM, "/pump", 1, "13ms", "u1", "fast"),
    job(SYSTEM, "valve", 0, "6ms", "u2"),
)
PLAN = schedule(SYSTEM, "20ms", *JOBS)
PLAN = replace(PLAN, modes=(replace(PLAN.modes[0], chains=(ChainLatency(name="c", reaction=ms("20.1us"), age=None),)),))


def refusal(*arguments, **options):
    with pytest.raises(HalpipeError) as refused:
        write(*arguments, **options)
    return [(d.code, d.path) for d in refused.value.diagnostics]


def event_ends(root, chain_element):
    """The (task, kind) of stimulus and response of an event chain."""
    ends = []
    for end in ("STIMULUS-REF", "RESPONSE-REF"):
        event = by_path(root, text(chain_element, end))
        kind = text(event, "TD-EVENT-SWC-INTERNAL-BEHAVIOR-TYPE").rpartition("-")[2].lower()
        ends.append((text(event, "RUNNABLE-REF").rpartition("/")[2], kind))
    return tuple(ends)


def latencies(root, place):
    """Name to (kind, ends of the chain, minimum and maximum in microseconds) of the latency constraints of a place."""
    return {
        name_of(e): (
            text(e, "LATENCY-CONSTRAINT-TYPE"),
            event_ends(root, by_path(root, text(e, "SCOPE-REF"))),
            text(e, "MINIMUM/CSE-CODE-FACTOR"),
            text(e, "MAXIMUM/CSE-CODE-FACTOR"),
        )
        for e in place.iter(NS + "LATENCY-TIMING-CONSTRAINT")
    }


# ------------------------------------------------------------------------------------------------------ header


@pytest.mark.parametrize(("release", "schema"), RELEASES.items())
def test_each_release_names_its_schema_and_has_only_what_it_knows(release, schema):
    system, _ = two_modes()
    root = write(replace(system, tasks=(replace(system.tasks[0], offset=ms(3)), *system.tasks[1:])), release=release)
    location = root.get("{http://www.w3.org/2001/XMLSchema-instance}schemaLocation")
    assert location == f"http://autosar.org/schema/r4.0 {schema}"
    assert bool(all_of(root, "MODE-TRANSITION")) == (release != "4.0.3")
    assert (root.find(f".//{NS}TIMING-EVENT/{NS}OFFSET") is not None) == (release not in ("4.0.3", "4.2.2"))


def test_the_file_has_no_identifiers_or_dates_that_change():
    first, second = (FORMAT.write(*two_modes(), ArxmlOptions())[""] for _ in range(2))
    assert first == second
    assert b"UUID" not in first


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"ecuc_prefix": "MICROSAR"}, BAD_PREFIX),
        ({"ecuc_prefix": "/Vendor/ X"}, BAD_PREFIX),
        ({"part": "ecuc"}, NEEDS_SCHEDULE),
        ({"mode": "race"}, UNKNOWN_MODE),
    ],
)
def test_impossible_options_are_refused(options, code):
    assert refusal(SYSTEM, **options) == [(code.id, "")]


def test_a_schedule_of_another_model_is_refused():
    other = schedule(SYSTEM, "20ms", replace(JOBS[0], task="fan"))
    assert refusal(SYSTEM, other)[0][0] == FOREIGN_SCHEDULE.id


def test_names_that_dangle_are_all_reported():
    broken = model(
        task("a", 10, version("v", 1, "ghost", access("ghost", 0, 1), after("ghost", 0, 1))),
        units="u1",
        chains=[chain("c", "a ghost")],
        transitions=[("all", "ghost", None)],
    )
    broken = replace(broken, modes=(*broken.modes, mode("m", (task("a", 10, version("other")), task("b", 10)))))
    path = 'task "a", version "v"'
    assert refusal(broken) == [
        (DANGLING_NAME.id, where)
        for where in (
            path,
            path,
            path,
            'chain "c"',
            'mode "m", task "a"',
            'mode "m"',
            'transition from "all" to "ghost"',
        )
    ]


def test_a_pipeline_file_states_the_options():
    text = "release: 4.2.2\npart: system\necuc-prefix: /V\ntick: 5us\nmin-cycle: 2\nmax-value: 65535\n"
    options, found = stated(FORMAT, text, mode="m")
    expected = {"release": "4.2.2", "part": "system", "ecuc_prefix": "/V", "min_cycle": 2, "max_value": 65535}
    assert options == ArxmlOptions(mode="m", tick=ms("5us"), **expected)
    assert found == []
    assert [d.code for d in stated(FORMAT, "min-cycle: -1")[1]] == ["HAL0023"]


# ------------------------------------------------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("name", "expected"),
    [("/a/b", "a_b"), ("__x__", "x"), ("9lives", "x_9lives"), ("%", "x"), ("n" * 300, "n" * 100), ("käse", "k_se")],
)
def test_names_become_identifiers(name, expected):
    assert ShortNames()(name) == expected


def test_identifiers_differ_in_more_than_case():
    short = ShortNames("Memory")
    assert [short(name) for name in ("memory", "MEMORY", "a b", "a_b", "a/b", "a_b_2")] == [
        "memory_2",
        "MEMORY_3",
        "a_b",
        "a_b_2",
        "a_b_3",
        "a_b_2_2",
    ]


def test_names_that_no_native_model_can_have_are_refused():
    assert {code for code, _ in refusal(*hostile())} == {UNWRITABLE.id}


# ---------------------------------------------------------------------------------------------------- software


def test_a_task_is_a_component_with_a_runnable_and_its_event():
    root = write(SYSTEM)
    runnable = by_path(root, "/m/Components/pump/Behavior/pump")
    assert runnable.tag == NS + "RUNNABLE-ENTITY"
    assert names(root)[runnable] == "/pump"
    event = by_path(root, "/m/Components/valve/Behavior/Every")
    assert text(event, "PERIOD") == "0.02"
    assert text(event, "OFFSET") == "0.005"
    assert text(event, "START-ON-EVENT-REF") == "/m/Components/valve/Behavior/valve"


def test_periods_that_no_decimal_ends_are_rounded_to_what_a_double_holds_and_kept_exactly():
    root = write(*thirds())
    event = by_path(root, "/camera/Components/camera/Behavior/Every")
    assert text(event, "PERIOD") == "0.0333333333333333"
    assert {task.get("period") for task in native(root).iter("{*}task")} == {"100/3ms"}


def test_a_task_on_demand_has_no_event():
    system, _ = two_modes()
    assert by_path(write(system), "/roboracer/Components/diagnostics/Behavior/Every") is None


def test_each_version_is_an_implementation_with_one_execution_time():
    root = write(SYSTEM)
    found = {}
    for name, element in all_of(root, "SWC-IMPLEMENTATION").items():
        times = element.iter(NS + "ANALYZED-EXECUTION-TIME")
        path = "WORST-CASE-EXECUTION-TIME/CSE-CODE-FACTOR"
        found[name] = [(text(t, "HW-ELEMENT-REF"), text(t, path)) for t in times]
    assert found == {
        "pump_fast": [(None, "2000")],
        "pump_slow": [("/m/Platform/u2", "334")],
        "valve_v": [("/m/Platform/u2", "1000")],
    }
    assert [v.get("wcet") for v in native(root).iter("{*}version") if v.get("name") == "slow"] == ["1000/3us"]


def test_units_with_the_same_time_are_nested_in_one_element_called_like_their_type():
    tasks = [task(f"t{n}", "10ms", version("v", "1ms", units)) for n, units in enumerate(("a b", "b a", "b c", "c d"))]
    system = model(*tasks, units="a b c d")
    system = replace(system, units=tuple(replace(u, type="big" if u.name in "ab" else "") for u in system.units))
    root = write(system)
    path = "NESTED-ELEMENTS/HW-ELEMENT-REF-CONDITIONAL/HW-ELEMENT-REF"
    nested = {name: texts(e, path) for name, e in all_of(root, "HW-ELEMENT").items()}
    assert {name: "".join(ref[-1] for ref in refs) for name, refs in nested.items() if refs} == {
        "big": "ab",
        "Units": "bc",
        "Units_2": "cd",
    }
    times = all_of(root, "SWC-IMPLEMENTATION").values()
    assert [text(e, "*/*/*/HW-ELEMENT-REF").rpartition("/")[2] for e in times] == ["big", "big", "Units", "Units_2"]


def test_units_and_resources_are_hardware_of_two_categories():
    root = write(*roboracer())
    categories = {
        name: text(e, "HW-CATEGORY-REFS/HW-CATEGORY-REF").rpartition("/")[2]
        for name, e in all_of(root, "HW-ELEMENT").items()
    }
    assert categories == {f"core{n}": "ProcessingUnit" for n in (1, 2, 3, 4)} | {"main_memory": "Memory"}


# ------------------------------------------------------------------------------------------------------- modes


def test_events_are_disabled_in_the_modes_in_which_their_tasks_do_not_run():
    system, _ = two_modes()
    root = write(system)
    path = "DISABLED-MODE-IREFS/DISABLED-MODE-IREF/TARGET-MODE-DECLARATION-REF"
    found = {
        name: texts(by_path(root, f"/roboracer/Components/{name}/Behavior/Every"), path)
        for name in ("particle_filter", "opponent_detection", "path_planner", "pure_pursuit")
    }
    assert found == {
        "particle_filter": [],
        "opponent_detection": ["/roboracer/Modes/Mode/safe_stop"],
        "path_planner": [],
        "pure_pursuit": [],
    }


def test_transitions_are_mode_transitions_with_their_limits():
    system, _ = two_modes()
    root = write(system)
    assert {
        name: (text(e, "EXITED-MODE-REF")[-9:], text(e, "ENTERED-MODE-REF")[-9:])
        for name, e in all_of(root, "MODE-TRANSITION").items()
    } == {"race_to_safe_stop": ("Mode/race", "safe_stop"), "safe_stop_to_race": ("safe_stop", "Mode/race")}
    assert [found.get("max-length") for found in native(root).iter("{*}transition")] == ["100ms", None]


def test_one_mode_alone_may_be_written():
    system, plan = two_modes()
    root = write(system, plan, mode="race")
    assert list(all_of(root, "MODE-DECLARATION")) == ["race"]
    assert not all_of(root, "MODE-TRANSITION")


# ------------------------------------------------------------------------------------------------------ timing


def test_demands_are_requirements_rounded_to_the_safe_side():
    root = write(SYSTEM)
    demands = by_path(root, "/m/Timing/Requirements")
    assert latencies(root, demands.find(NS + "TIMING-REQUIREMENTS")) == {
        "valve_deadline": ("REACTION", (("valve", "activated"), ("valve", "terminated")), None, "15000"),
        "c_reaction": ("REACTION", (("pump", "started"), ("valve", "terminated")), None, "30000"),
        "c_age": ("AGE", (("pump", "started"), ("valve", "terminated")), None, "33333"),
    }
    periods = {n: text(e, "PERIOD/CSE-CODE-FACTOR") for n, e in all_of(demands, "PERIODIC-EVENT-TRIGGERING").items()}
    assert periods == {"pump_period": "10000", "valve_period": "20000"}
    assert demands.find(NS + "TIMING-GUARANTEES") is None


def windows(root):
    """(from, to, minimum and maximum in microseconds) of the offset constraints, and all pairs that are ordered."""
    found = []
    for e in all_of(root, "OFFSET-TIMING-CONSTRAINT").values():
        ends = [text(by_path(root, text(e, f"{end}-REF")), "SHORT-NAME") for end in ("SOURCE", "TARGET")]
        found.append((*ends, text(e, "MINIMUM/CSE-CODE-FACTOR"), text(e, "MAXIMUM/CSE-CODE-FACTOR")))
    ordered = {
        (name, path.rpartition("/")[2])
        for name, e in all_of(root, "EOC-EXECUTABLE-ENTITY-REF").items()
        for path in texts(e, "SUCCESSOR-REFS/SUCCESSOR-REF")
    }
    return found, ordered


def test_windows_are_distances_from_an_instant_of_the_predecessor():
    assert windows(write(SYSTEM)) == ([("pump_terminated", "valve_started", "1000", "8000")], {("pump", "valve")})


def test_only_what_every_version_keeps_is_demanded():
    """b always comes after a's start, within 1 to 9 ms, which is no order; after ends only in one version each."""
    versions = (
        version("v", 1, "u1", after("a", 1, "5.0005ms"), after("a", 0, 2, "end")),
        version("w", 1, "u1", after("a", 2, 9), after("c", 0, 3)),
    )
    system = model(task("a", 10, version()), task("b", 10, *versions), task("c", 10, version()))
    assert windows(write(system)) == ([("a_started", "b_started", "1000", "9000")], set())


def test_the_order_names_each_successor():
    demands = by_path(write(SYSTEM), "/m/Timing/Requirements/Order")
    successors = {
        name_of(e): texts(e, "SUCCESSOR-REFS/SUCCESSOR-REF") for e in demands.iter(NS + "EOC-EXECUTABLE-ENTITY-REF")
    }
    assert successors == {"pump": ["/m/Timing/Requirements/Order/valve"], "valve": []}


def test_segments_tell_the_tasks_of_a_chain_in_order():
    root = write(*roboracer())
    element = by_path(root, "/roboracer/Timing/Requirements/lidar_to_steering")
    segments = [event_ends(root, by_path(root, path)) for path in texts(element, "SEGMENT-REFS/SEGMENT-REF")]
    names = ["particle_filter", "opponent_detection", "path_planner", "pure_pursuit"]
    assert [start for start, _ in segments] == [(name, "started") for name in names]
    assert [end for _, end in segments] == [*((name, "started") for name in names[1:]), (names[-1], "terminated")]


def test_a_reaction_time_is_demanded_as_the_latency_that_it_leaves():
    """A stimulus may just miss a job of /pump, and waits for the next one, 10 ms later."""

    def demanded(**limits):
        system = replace(SYSTEM, chains=(replace(SYSTEM.chains[0], max_age=None, max_reaction=None, **limits),))
        demands = by_path(write(system), "/m/Timing/Requirements").find(NS + "TIMING-REQUIREMENTS")
        found = latencies(write(system), demands)
        told = FORMAT.remarks(system, None, ArxmlOptions(), FORMAT.write(system, None, ArxmlOptions()))
        return {key: value for key, value in found.items() if key != "valve_deadline"}, [d.code for d in told]

    ends = ("pump", "started"), ("valve", "terminated")
    assert demanded(max_latency=ms("25ms")) == ({"c_reaction": ("REACTION", ends, None, "25000")}, [])
    ends = ("pump", "activated"), ("valve", "started")
    events = {"anchor": Anchor.RELEASE, "to": Anchor.START}
    assert demanded(max_latency=ms("25ms"), **events) == ({"c_reaction": ("REACTION", ends, None, "25000")}, [])
    ends = ("pump", "terminated"), ("valve", "terminated")
    assert demanded(max_latency=ms("25ms"), anchor=Anchor.END)[0] == {"c_reaction": ("REACTION", ends, None, "25000")}


def test_a_reaction_time_that_leaves_nothing_is_told():
    system = replace(SYSTEM, chains=(replace(SYSTEM.chains[0], max_age=None, max_reaction=ms("10ms")),))
    (told,) = FORMAT.remarks(system, None, ArxmlOptions(), FORMAT.write(system, None, ArxmlOptions()))
    assert (told.code, told.path) == (NO_LATENCY.id, 'chain "c"')
    assert "c_reaction" not in latencies(write(system), by_path(write(system), "/m/Timing/Requirements"))


@pytest.mark.parametrize(
    ("anchor", "to", "events"),
    [
        (Anchor.START, Anchor.START, ("pump_started", "valve_started")),
        (Anchor.END, Anchor.END, ("pump_terminated", "valve_terminated")),
        (Anchor.RELEASE, Anchor.END, ("pump_activated", "valve_terminated")),
    ],
)
def test_a_window_lies_between_the_events_of_its_instants(anchor, to, events):
    window = Precedence(task="/pump", anchor=anchor, to=to, min=ms("1ms"), max=ms("8ms"))
    late = task("valve", "20ms", version("v", "1ms", "u2", window))
    root = write(replace(SYSTEM, tasks=(PUMP, late)))
    (offset,) = root.iter(NS + "OFFSET-TIMING-CONSTRAINT")
    ends = (offset.findtext(NS + tag).rpartition("/")[2] for tag in ("SOURCE-REF", "TARGET-REF"))
    assert tuple(ends) == events
    assert not FORMAT.remarks(replace(SYSTEM, tasks=(PUMP, late)), None, ArxmlOptions(), {})


@pytest.mark.parametrize("stated", [{"anchor": Anchor.POINT, "point": ms("1ms")}, {"match": Match.CYCLE}])
def test_a_window_that_is_weaker_in_arxml_is_reported(stated):
    window = Precedence(task="/pump", min=ms("1ms"), max=ms("8ms"), **stated)
    system = replace(SYSTEM, tasks=(PUMP, task("valve", "20ms", version("v", "1ms", "u2", window))))
    (told,) = FORMAT.remarks(system, None, ArxmlOptions(), {})
    assert (told.code, told.path) == (WEAKER_WINDOW.id, 'task "valve"')
    assert len(list(write(system).iter(NS + "OFFSET-TIMING-CONSTRAINT"))) == ("match" in stated)


def test_what_a_schedule_proves_is_guaranteed_rounded_to_the_safe_side():
    """/pump starts at 1 and 13 ms of 10 ms periods: 2 ms apart; valve is released at 5 ms and starts at 6 ms."""
    root = write(SYSTEM, PLAN)
    proven = by_path(root, "/m/Timing/Guarantees_all").find(NS + "TIMING-GUARANTEES")
    assert latencies(root, proven) == {
        "pump_response": ("REACTION", (("pump", "activated"), ("pump", "terminated")), None, "4000"),
        "valve_response": ("REACTION", (("valve", "activated"), ("valve", "terminated")), None, "2000"),
        "c_reaction": ("REACTION", (("pump", "started"), ("valve", "terminated")), None, "21"),
    }
    jitters = {name_of(e): text(e, "JITTER/CSE-CODE-FACTOR") for e in proven.iter(NS + "PERIODIC-EVENT-TRIGGERING")}
    assert jitters == {"pump_period": "2000", "valve_period": "0"}


def test_a_job_that_starts_when_the_next_is_released_counts_as_late_as_it_is():
    """With slack 1 a job may be a whole period late; modulo the period that would look punctual."""
    system = model(task("t", 10, version("v", "2ms", "u1"), slack=1, offset="0ms", deadline="15ms"))
    plan = schedule(system, 20, job(system, "t", 0, 10, "u1"), job(system, "t", 1, 12, "u1"))
    proven = by_path(write(system, plan), "/m/Timing/Guarantees_all")
    assert text(all_of(proven, "PERIODIC-EVENT-TRIGGERING")["t_period"], "JITTER/CSE-CODE-FACTOR") == "8000"
    assert text(all_of(proven, "LATENCY-TIMING-CONSTRAINT")["t_response"], "MAXIMUM/CSE-CODE-FACTOR") == "12000"


def test_a_mode_in_which_nothing_runs_has_no_guarantees():
    empty = ModeSchedule(name="all", hyperperiod=ms(20), status=Status.VALID, jobs=())
    root = write(SYSTEM, replace(PLAN, modes=(empty,)))
    assert len(by_path(root, "/m/Timing/Guarantees_all").find(NS + "TIMING-GUARANTEES")) == 0


# ------------------------------------------------------------------------------------------------------- parts


def test_parts_hold_what_their_names_say():
    whole, system, ecuc = (
        [
            name_of(p)
            for p in write(SYSTEM, PLAN, part=part).iterfind(q("AR-PACKAGES/AR-PACKAGE/AR-PACKAGES/AR-PACKAGE"))
        ]
        for part in ("all", "system", "ecuc")
    )
    assert system == ["Platform", "Modes", "Components", "Implementations", "System", "Timing"]
    assert ecuc == ["Ecu"]
    assert whole == system + ecuc


def test_golden_file():
    assert_golden("pump.arxml", FORMAT.write(SYSTEM, PLAN, ArxmlOptions())[""].decode())


def test_references_lead_to_elements_of_the_class_that_they_name():
    root = write(*two_modes())
    broken = [
        (e.tag, e.text)
        for e in root.iter(NS + "*")
        if e.get("DEST") and e.tag != NS + "DEFINITION-REF"
        if (found := by_path(root, e.text)) is None or etree.QName(found).localname != e.get("DEST")
    ]
    # The prototype of a mode group is called by its role in the interface.
    assert {tag for tag, _ in broken} == {NS + "CONTEXT-MODE-DECLARATION-GROUP-PROTOTYPE-REF"}


def test_a_document_is_written_as_it_is_made(monkeypatch):
    """What is complete is text: the tree at the end has a small part of the elements of the document."""
    kept = []
    serialise = export.serialise

    def counted(root, texts):
        kept.append(sum(1 for _ in root.iter()))
        return serialise(root, texts)

    monkeypatch.setattr(export, "serialise", counted)
    tasks = [task(f"t{number}", "10ms", version("v", "1ms", "u1"), deadline="9ms") for number in range(100)]
    document = FORMAT.write(model(*tasks), None, ArxmlOptions())[""]
    assert kept[0] * 5 < sum(1 for _ in etree.fromstring(document).iter())


def test_places_of_a_pipeline_file_are_those_beside_it():
    text = "ecuc-definitions: [v.arxml, /d]\nonto: p\necu: e\nvariant: x\ncondition: [a=1]\n"
    options, found = stated(FORMAT, text, "/base")
    assert found == []
    assert (options.ecuc_definitions, options.onto) == (("/base/v.arxml", "/d"), "/base/p")
    assert (options.ecu, options.variant, options.conditions) == ("e", "x", ("a=1",))


def test_a_new_container_stands_for_all_that_is_in_it():
    new, inner, deeper = (
        Change("f", "/P/New" + more, name, None, "1") for more, name in (("", ""), ("", "V"), ("/I", "W"))
    )
    known, gone = Change("f", "/P/Old", "V", "1", "2"), Change("f", "/P/Gone", "", "Os", None)
    of_gone = Change("f", "/P/Gone", "V", "1", None)
    found = Onto({}, b"", (new, inner, known, gone, deeper, of_gone), ())
    assert found.summary == [new, known, gone, of_gone]


def test_what_is_guaranteed_of_thirds_is_on_the_safe_side():
    """Periods are cut, and what jobs take is rounded up, to whole microseconds."""
    system = model(task("t", "100/3us", version("v", "10/3us", "u1"), offset="0ms"))
    proven = by_path(
        write(system, schedule(system, "100/3us", job(system, "t", 0, 0, "u1"))), "/m/Timing/Guarantees_all"
    )
    assert text(all_of(proven, "PERIODIC-EVENT-TRIGGERING")["t_period"], "PERIOD/CSE-CODE-FACTOR") == "33"
    assert text(all_of(proven, "LATENCY-TIMING-CONSTRAINT")["t_response"], "MAXIMUM/CSE-CODE-FACTOR") == "4"
