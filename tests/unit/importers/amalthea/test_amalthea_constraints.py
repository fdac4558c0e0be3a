"""Deadlines, windows, orders, chains and ages: what constraints come to."""

import pytest
from amalthea_case import Overlay, call, found, read, runnable, task, ticks, windows

from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.amalthea import codes

SW = (
    task("T", call("R"))
    + task("U", call("Q"))
    + task("V", ticks(9))
    + runnable("R", ticks(1), '<items xsi:type="am:LabelAccess" data="L?type=Label" access="write"/>')
    + runnable("Q", ticks(100_000), '<items xsi:type="am:LabelAccess" data="L?type=Label" access="read"/>')
    + '<labels name="L"/>'
)


def event(name, entity, kind="ProcessEvent", type="start"):
    target = {"ProcessEvent": "Task", "RunnableEvent": "Runnable", "LabelEvent": "Label"}[kind]
    return f'<events xsi:type="am:{kind}" name="{name}" eventType="{type}" entity="{entity}?type={target}"/>'


EVENTS = (
    event("T0", "T")
    + event("T1", "T", type="terminate")
    + event("U0", "U")
    + event("U1", "U", type="terminate")
    + event("V0", "V")
    + event("R0", "R", "RunnableEvent")
    + event("Lr", "L", "LabelEvent", "read")
    + '<events xsi:type="am:CustomEvent" name="none"/>'
)
KINDS = {"R0": "RunnableEvent", "Lr": "LabelEvent", "none": "CustomEvent"}


def ref(name):
    return f"{name}?type={KINDS.get(name, 'ProcessEvent')}"


def limit(metric, value, type="UpperLimit", process="T"):
    return f"""<requirements xsi:type="am:ProcessRequirement" name="q" process="{process}?type=Task">
<limit xsi:type="am:TimeRequirementLimit" limitType="{type}" metric="{metric}">
<limitValue value="{value}" unit="ms"/></limit></requirements>"""


def delay(source, target, low="1", high="4"):
    upper = f'<upper value="{high}" unit="ms"/>' if high else ""
    return f"""<timingConstraints xsi:type="am:DelayConstraint" name="d" source="{ref(source)}" target="{ref(target)}">
{upper}<lower value="{low}" unit="ms"/></timingConstraints>"""


def given(tmp_path, constraints, **options):
    return read(tmp_path, sw=SW, events=EVENTS, constraints=constraints, **options)


def test_the_least_limit_of_the_response_time_is_the_deadline(tmp_path):
    imported = given(tmp_path, limit("ResponseTime", 8) + limit("ResponseTime", 6))
    assert str(imported.model.task("T").deadline) == "6ms"
    assert imported.model.task("U").deadline is None


def test_the_distance_between_starts_bounds_the_slack(tmp_path):
    assert given(tmp_path, "").model.task("T").slack == 1
    assert given(tmp_path, limit("StartToStart", 12)).model.task("T").slack * 5 == 1
    assert given(tmp_path, limit("StartToStart", 10)).model.task("T").slack == 0


@pytest.mark.parametrize(
    "constraint",
    [
        limit("ResponseTime", 1, "LowerLimit"),
        limit("RunningTime", 9),
        '<timingConstraints xsi:type="am:RepetitionConstraint" name="r"/>',
        '<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="r" type="Age"/>',
        '<requirements xsi:type="am:ProcessChainRequirement" name="r"/>',
        '<dataAgeConstraints name="a"/>',
    ],
)
def test_what_the_model_has_nothing_for_is_told(tmp_path, constraint):
    assert len(found(given(tmp_path, constraint).diagnostics, codes.NOT_IMPORTED)) == 1


@pytest.mark.parametrize(
    ("source", "target", "expected"),
    [
        ("T0", "U0", [("T", "start", "1ms", "4ms")]),
        ("T1", "U0", [("T", "end", "1ms", "4ms")]),
        ("T0", "U1", [("T", "start", "1ms", "4ms")]),
        ("R0", "U0", [("T", "start", "1ms", "4ms")]),
        ("T1", "Lr", [("T", "end", "1ms", "4ms")]),
    ],
)
def test_delays_become_windows(tmp_path, source, target, expected):
    imported = given(tmp_path, delay(source, target))
    assert windows(imported, "U") == expected
    assert str(imported.model.task("U").versions[0].precedences[0].to) == ("start" if target == "U0" else "end")


def test_a_delay_without_an_upper_limit_has_a_window_of_one_period(tmp_path):
    imported = given(tmp_path, delay("T1", "U0", high=""))
    assert windows(imported, "U") == [("T", "end", "1ms", "11ms")]
    assert len(found(imported.diagnostics, codes.DEFAULT_WINDOW)) == 1


def test_orders_of_runnables_order_their_tasks(tmp_path):
    groups = "".join(f'<runnableGroups runnables="{name}?type=Runnable"/>' for name in "RQ")
    order = f'<runnableSequencingConstraints name="o">{groups}</runnableSequencingConstraints>'
    assert windows(given(tmp_path, order), "U") == [("T", "end", "0ms", "10ms")]


@pytest.mark.parametrize(
    "constraint",
    [
        delay("T0", "none"),
        delay("T0", "T1"),
        '<runnableSequencingConstraints name="o"><runnableGroups/></runnableSequencingConstraints>',
        f'<eventChains name="c" stimulus="{ref("T0")}" response="{ref("none")}"/>',
    ],
)
def test_constraints_between_what_is_no_task_are_told(tmp_path, constraint):
    assert len(found(given(tmp_path, constraint).diagnostics, codes.BAD_CHAIN)) == 1


def link(source, target, tag="items"):
    ends = f'stimulus="{ref(source)}" response="{ref(target)}"'
    return f'<{tag} xsi:type="am:EventChainContainer"><eventChain {ends}/></{tag}>'


def chain(*links, name="c", ends=("T0", "V0"), **attributes):
    stated = "".join(f' {key}="{value}"' for key, value in attributes.items())
    first, last = map(ref, ends)
    return f'<eventChains name="{name}" stimulus="{first}" response="{last}"{stated}>{"".join(links)}</eventChains>'


def latency(type, value, scope="c"):
    return f"""<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l" scope="{scope}?type=EventChain"
 type="{type}"><maximum value="{value}" unit="ms"/></timingConstraints>"""


def chains(imported):
    return {c.name: (c.tasks, str(c.max_latency), str(c.max_age)) for c in imported.model.chains}


def test_event_chains_and_their_limits(tmp_path):
    constraints = chain(link("T0", "U0"), link("U0", "V0")) + latency("Age", 30) + latency("Age", 20)
    imported = given(tmp_path, constraints + latency("Reaction", 40))
    assert chains(imported) == {"c": (("T", "U", "V"), "40ms", "20ms")}


def test_older_chains_have_segments_and_strands(tmp_path):
    imported = given(tmp_path, chain(link("T0", "U0", "segments"), link("U0", "V0", "segments")), version="0.9.5")
    assert chains(imported)["c"][0] == ("T", "U", "V")
    imported = given(tmp_path, chain(link("T0", "U0", "strands"), link("T0", "R0", "strands")), version="0.9.5")
    assert [(c.name, c.tasks) for c in imported.model.chains] == [("c.1", ("T", "U", "V")), ("c.2", ("T", "V"))]


@pytest.mark.parametrize(
    ("ends", "links"),
    [
        (("U0", "V0"), (("T0", "U0"), ("U0", "V0"))),  # begins elsewhere
        (("T0", "U0"), (("T0", "U0"), ("U0", "V0"))),  # ends elsewhere
        (("T0", "V0"), (("T0", "T1"), ("U0", "V0"))),  # its parts do not follow on each other
    ],
)
def test_a_chain_that_contradicts_its_parts_is_not_imported_but_told(tmp_path, ends, links):
    stated = chain(*(link(*one) for one in links), ends=ends) + latency("Age", 20)
    imported = given(tmp_path, stated)
    assert imported.model.chains == ()
    (warning,) = found(imported.diagnostics, codes.CONTRADICTION)
    assert warning.path.endswith('"c"') or "c" in warning.path
    rows = {kind: (mapped, ignored) for kind, _, mapped, ignored in imported.coverage.rows()}
    assert rows["EventChainLatencyConstraint"] == (0, 1)
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


def test_data_may_pass_from_one_part_to_the_next_by_a_label(tmp_path):
    events = EVENTS + event("Lw", "L", "LabelEvent", "write")
    KINDS["Lw"] = "LabelEvent"
    links = chain(link("T0", "Lw"), link("Lr", "U1"), ends=("T0", "U1"))
    assert chains(read(tmp_path, sw=SW, events=events, constraints=links))["c"][0] == ("T", "U")


@pytest.mark.parametrize(
    ("links", "ends", "tasks"),
    [
        ([("T0", "La"), ("La", "U0")], ("T0", "U0"), ("T", "U")),
        ([("La", "U0")], ("La", "U0"), ("T", "U")),
        ([("La", "U0"), ("U0", "V0")], ("La", "V0"), ("T", "U", "V")),
        ([("T0", "La")], ("T0", "La"), ("T", "U")),
    ],
)
def test_an_event_of_a_label_without_a_type_is_any_access(tmp_path, links, ends, tasks):
    """T writes L, U reads it: the neighbours on the chain say which of the two is meant."""
    events = EVENTS + event("La", "L", "LabelEvent").replace(' eventType="start"', "")
    KINDS["La"] = "LabelEvent"
    stated = chain(*(link(*one) for one in links), ends=ends)
    assert chains(read(tmp_path, sw=SW, events=events, constraints=stated))["c"][0] == tasks


def test_a_chain_of_processes_of_which_one_is_no_task_is_told(tmp_path):
    sw = (
        SW
        + task("Z", ticks(1), stimuli="")
        + '<processChains name="p" processes="T?type=Task Z?type=Task V?type=Task"/>'
    )
    end = limit("EndToEnd", 50).replace("ProcessRequirement", "ProcessChainRequirement")
    end = end.replace('process="T?type=Task"', 'processChain="p?type=ProcessChain"')
    imported = read(tmp_path, sw=sw, constraints=end)
    assert imported.model.chains == ()
    assert len(found(imported.diagnostics, codes.BAD_CHAIN)) == 1
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


def test_chains_may_refer_to_chains(tmp_path):
    inner = chain(link("T0", "U0"), name="inner", ends=("T0", "U0"))
    outer = chain('<items xsi:type="am:EventChainReference" eventChain="inner?type=EventChain"/>', link("U0", "V0"))
    assert chains(given(tmp_path, inner + outer))["c"][0] == ("T", "U", "V")


def includes(*names):
    items = (f'<items xsi:type="am:EventChainReference" eventChain="{name}?type=EventChain"/>' for name in names)
    return "".join(items)


@pytest.mark.parametrize("middle", ["", chain(includes("c", "c"), name="d")])
def test_a_chain_that_is_a_part_of_itself_is_not_imported(tmp_path, middle):
    imported = given(tmp_path, chain(includes("d" if middle else "c")) + middle)
    assert imported.model.chains == ()
    assert "part of itself" in found(imported.diagnostics, codes.CONTRADICTION)[0].message


@pytest.mark.parametrize(("levels", "says"), [(49, ""), (50, "is nested in more than 50 chains")])
def test_chains_nest_up_to_a_limit_and_are_refused_beyond(tmp_path, levels, says):
    nested = "".join(chain(includes(f"c{n + 1}"), name=f"c{n}") for n in range(levels))
    nested += chain(link("T0", "U0") + link("U0", "V0"), name=f"c{levels}")
    if not says:
        assert chains(given(tmp_path, nested))["c0"][0] == ("T", "U", "V")
        return
    with pytest.raises(HalpipeError, match=says):
        given(tmp_path, nested)


def test_chains_that_double_at_each_level_are_refused(tmp_path):
    doubled = "".join(chain(includes(*[f"c{n + 1}"] * 2), name=f"c{n}") for n in range(40))
    with pytest.raises(HalpipeError, match="more than 10000 ways and events"):
        given(tmp_path, doubled + chain(link("T0", "U0"), name="c40"))


def test_chains_of_processes_with_an_end_to_end_limit(tmp_path):
    sw = SW + '<processChains name="p" processes="T?type=Task V?type=Task"/>'
    end = limit("EndToEnd", 50).replace("ProcessRequirement", "ProcessChainRequirement")
    end = end.replace('process="T?type=Task"', 'processChain="p?type=ProcessChain"')
    assert chains(read(tmp_path, sw=sw, constraints=end)) == {"p": (("T", "V"), "50ms", "None")}


def test_ages_of_data_are_chains_from_writer_to_reader(tmp_path):
    age = """<dataAgeConstraints name="a" runnable="Q?type=Runnable" label="L?type=Label">
<dataAge xsi:type="am:DataAgeTime"><maximumTime value="15" unit="ms"/></dataAge></dataAgeConstraints>"""
    assert chains(given(tmp_path, age)) == {"a": (("T", "U"), "None", "15ms")}


def test_constraints_on_dropped_tasks_are_told(tmp_path):
    imported = given(tmp_path, delay("T0", "U0"), overlay=Overlay(drop=["T"]))
    assert len(found(imported.diagnostics, codes.BAD_CHAIN)) == 1
