"""Limits at runnables within a job: taken over the whole job, which is pointed out."""

import pytest
from amalthea_case import PLAIN_STIMULI, call, found, read, runnable, task, ticks, windows

from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.amalthea import codes

SWITCH = (
    '<items xsi:type="am:Switch"><entries name="one"><condition xsi:type="am:ConditionConjunction"/>{}</entries>'
    "<defaultEntry>{}</defaultEntry></items>"
)
GROUP = '<items xsi:type="am:Group" name="g">{}</items>'
TRIGGER = '<items xsi:type="am:SetEvent" process="U?type=Task"/>'
SW = (
    task("T", TRIGGER, GROUP.format(call("A") + call("B")), call("C"), TRIGGER)
    + task("U", call("D"), call("E"))
    + task("W", call("F"), call("G"), call("F"))
    + runnable("A", ticks(5))
    + runnable("B", ticks(5))
    + runnable("C", call("I"))
    + "".join(runnable(name, ticks(5)) for name in "DEFGI")
)
EVENTS = "".join(
    f'<events xsi:type="am:RunnableEvent" name="{name}{kind[0]}" eventType="{kind}" entity="{name}?type=Runnable"/>'
    for name in "ABCDEFGI"
    for kind in ("start", "terminate")
)


def chain(first, last):
    return (
        f'<eventChains name="c" stimulus="{first}?type=RunnableEvent" response="{last}?type=RunnableEvent"/>'
        '<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l" scope="c?type=EventChain" '
        'type="Reaction"><maximum value="20" unit="ms"/></timingConstraints>'
    )


def delay(first, last, upper=True):
    limit = '<upper value="4" unit="ms"/>' if upper else ""
    return (
        f'<timingConstraints xsi:type="am:DelayConstraint" name="d" source="{first}?type=RunnableEvent" '
        f'target="{last}?type=RunnableEvent">{limit}<lower value="1" unit="ms"/></timingConstraints>'
    )


def order(first, last):
    groups = "".join(
        '<runnableGroups runnables="{}"/>'.format(" ".join(f"{name}?type=Runnable" for name in names))
        for names in (first, last)
    )
    return f'<runnableSequencingConstraints name="o">{groups}</runnableSequencingConstraints>'


def given(tmp_path, constraints, **options):
    return read(tmp_path, sw=SW, stimuli=PLAIN_STIMULI, events=EVENTS, constraints=constraints, **options)


@pytest.mark.parametrize(
    ("first", "last", "is_inner"),
    [
        ("As", "Ct", False),  # all of a job
        ("As", "It", False),  # C ends with I
        ("As", "Bt", True),
        ("Bs", "Bt", True),  # between two instants of one job
        ("Bs", "Ct", True),
        ("At", "Ct", True),
        ("As", "Et", False),
        ("As", "Dt", True),
        ("Bs", "Et", True),
        ("Fs", "Ft", True),  # called twice
    ],
)
def test_a_chain_at_a_runnable_within_a_job_counts_over_the_job(tmp_path, first, last, is_inner):
    imported = given(tmp_path, chain(first, last))
    assert str(imported.model.chains[0].max_latency) == "20ms"
    assert len(found(imported.diagnostics, codes.WHOLE_JOB)) == is_inner


def test_a_chain_without_a_limit_says_nothing(tmp_path):
    unlimited = chain("Bs", "Bt").partition("<timingConstraints")[0]
    assert found(given(tmp_path, unlimited).diagnostics, codes.WHOLE_JOB) == []


@pytest.mark.parametrize(
    ("first", "last", "upper", "anchors"),
    [
        ("Ct", "Ds", True, None),  # the end of T, the start of U
        ("Bt", "Ds", True, ("start", "start")),
        ("Ct", "Dt", True, ("end", "end")),
        ("Bt", "Es", True, ("start", "end")),
        ("Bt", "Es", False, ("end", "start")),
    ],
)
def test_an_upper_delay_counts_over_the_whole_jobs_and_a_lower_one_between_them(tmp_path, first, last, upper, anchors):
    imported = given(tmp_path, delay(first, last, upper))
    assert len(found(imported.diagnostics, codes.WHOLE_JOB)) == (anchors is not None)
    [row] = imported.model.task("U").versions[0].precedences
    assert (row.anchor.value, row.to.value) == (anchors or ("end", "start"))


def test_a_delay_between_accesses_of_a_label_counts_over_the_whole_jobs(tmp_path):
    """T writes L at its end: from the starts of both jobs alone, U could read it later than the limit."""
    access = '<items xsi:type="am:LabelAccess" data="L?type=Label" access="{}"/>'
    sw = task("T", ticks(5), access.format("write")) + task("U", ticks(5), access.format("read")) + '<labels name="L"/>'
    events = "".join(
        f'<events xsi:type="am:LabelEvent" name="{kind}" eventType="{kind}" entity="L?type=Label"/>'
        for kind in ("read", "write")
    )
    for upper, anchors in ((True, ("start", "end")), (False, ("end", "start"))):
        constraint = delay("write", "read", upper).replace("RunnableEvent", "LabelEvent")
        imported = read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI, events=events, constraints=constraint)
        assert len(found(imported.diagnostics, codes.WHOLE_JOB)) == 1
        [row] = imported.model.task("U").versions[0].precedences
        assert (row.anchor.value, row.to.value) == anchors


def test_an_event_of_no_stated_type_may_be_any_instant_of_a_job(tmp_path):
    events = EVENTS.replace('name="Ds" eventType="start"', 'name="Ds"')
    imported = read(tmp_path, sw=SW, stimuli=PLAIN_STIMULI, events=events, constraints=delay("Ct", "Ds"))
    assert len(found(imported.diagnostics, codes.WHOLE_JOB)) == 1
    [row] = imported.model.task("U").versions[0].precedences
    assert (row.anchor.value, row.to.value) == ("end", "end")


@pytest.mark.parametrize(
    ("first", "last", "is_inner"),
    [("C", "D", False), ("BC", "DE", False), ("B", "D", True), ("C", "E", True), ("I", "D", False), ("B", "C", False)],
)
def test_an_order_of_runnables_within_jobs_orders_the_jobs(tmp_path, first, last, is_inner):
    imported = given(tmp_path, order(first, last))
    assert len(found(imported.diagnostics, codes.WHOLE_JOB)) == is_inner
    assert len(windows(imported, "U")) == (first + last != "BC")


@pytest.mark.parametrize("constraint", [chain("Bs", "Bt"), delay("Bt", "Ds"), order("B", "D")])
def test_strict_refuses_what_counts_over_the_whole_job(tmp_path, constraint):
    with pytest.raises(HalpipeError) as refusal:
        given(tmp_path, constraint, strict=True)
    assert refusal.value.exit == 5


def test_a_version_that_a_switch_chooses_is_a_whole_job(tmp_path):
    sw = task("T", SWITCH.format(call("A"), call("B"))) + runnable("A", ticks(5)) + runnable("B", ticks(5))
    for name in "AB":
        imported = read(
            tmp_path, sw=sw, stimuli=PLAIN_STIMULI, events=EVENTS, constraints=chain(f"{name}s", f"{name}t")
        )
        assert found(imported.diagnostics, codes.WHOLE_JOB) == []
