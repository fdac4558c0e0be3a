"""Constraints of the timing extension of AUTOSAR hold for the events of the schedules that they lead to.

The oracle knows events alone: starts and ends of runnables over some hyperperiods. What a constraint demands of them is
what its monitor demands in TeSSLa-Autosar-Timing-Extensions by H. Streichhahn, a formal definition by other people.
In a time-triggered schedule an activation is a start.
"""

import pytest
from arxml_case import (
    component,
    cse,
    el,
    event_chain,
    every,
    execution_time,
    extension,
    latency,
    named,
    observed,
    package,
    read,
    ref,
    triggering,
    write,
)
from hypothesis import given
from hypothesis import strategies as st

from halpipe import api
from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.arxml import codes
from profiles import examples

US = 1000
CYCLES = 6


def events_of(directory, periods, wcets, constraints, chains=()):
    """Import runnables R0, R1 and so on with constraints on their events S0 and T0 (start and end of R0) and so on.

    Return the sorted instants of each event in a schedule, in nanoseconds over some hyperperiods, and the hyperperiod;
    nothing where the constraints are not imported, or no schedule is found.
    """
    timed = [every(str(period / 1000), f"E{i}", f"P/R{i}") for i, period in enumerate(periods) if period]
    runnables = " ".join(f"R{i}" for i in range(len(periods)))
    times = [
        execution_time("ANALYZED", f"X{i}", f"P/R{i}", "WORST-CASE-EXECUTION-TIME", w) for i, w in enumerate(wcets)
    ]
    used = named("SWC-IMPLEMENTATION", "I", named("RESOURCE-CONSUMPTION", "U", el("EXECUTION-TIMES", *times)))
    words = ("ACTIVATED", "STARTED", "TERMINATED")
    seen = [observed(f"{what[0]}{i}", f"P/R{i}", what) for i in range(len(periods)) for what in words]
    types = package("T", component("P", *timed, runnables=runnables), used)
    imported = read(write(directory, types, extension([*seen, *chains], *constraints)))
    if any(found.code == codes.TIMING_LOST.id for found in imported.diagnostics):
        return None
    try:
        (mode,) = api.schedule(imported.model, budget=20_000).modes
    except HalpipeError:
        return None
    found = {}
    for job in mode.jobs:
        number = job.task.rpartition("R")[2]
        for name, at in ((f"S{number}", job.start), (f"A{number}", job.start), (f"T{number}", job.end)):
            found.setdefault(name, []).extend(at.ns + cycle * mode.hyperperiod.ns for cycle in range(CYCLES))
    return {name: sorted(instants) for name, instants in found.items()}, mode.hyperperiod.ns


def amid(instants, hyperperiod):
    """Those that have other instants before and after them."""
    return [at for at in instants if 2 * hyperperiod <= at < 4 * hyperperiod]


PERIODS = st.lists(st.sampled_from([5, 10, 20]), min_size=2, max_size=3)
WCETS = st.lists(st.sampled_from([200, 500, 1000]), min_size=3, max_size=3)


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    return tmp_path_factory.mktemp("timing")


@examples(8)
@given(PERIODS, WCETS, st.sampled_from("AST"), st.sampled_from("AS"), st.integers(0, 3000), st.integers(0, 5000))
def test_each_target_of_an_offset_has_a_source_within_its_limits(directory, periods, wcets, source, target, low, more):
    ends = [ref("SOURCE-REF", f"/Timing/X/{source}0"), ref("TARGET-REF", f"/Timing/X/{target}1")]
    limits = [cse("MINIMUM", low), cse("MAXIMUM", low + more)]
    constraint = named("OFFSET-TIMING-CONSTRAINT", "O", *ends, *limits)
    if found := events_of(directory, periods, wcets, [constraint]):
        events, hyperperiod = found
        for at in amid(events[f"{target}1"], hyperperiod):
            assert any(low * US <= at - before <= (low + more) * US for before in events[f"{source}0"])


@examples(8)
@given(PERIODS, WCETS, st.sampled_from("ST"), st.sampled_from("ST"), st.sampled_from([2000, 4000, 8000, 15_000]))
def test_a_reaction_follows_each_stimulus_and_each_response_has_its_age(directory, periods, wcets, begin, end, most):
    begin, end, chain = f"{begin}0", f"{end}1", [event_chain("C", f"{begin}0", f"{end}1")]
    if found := events_of(directory, periods, wcets, [latency("L", "C", most)], chain):
        events, hyperperiod = found
        for at in amid(events[begin], hyperperiod):
            assert any(0 <= after - at <= most * US for after in events[end])
    if found := events_of(directory, periods, wcets, [latency("L", "C", most, "AGE")], chain):
        events, hyperperiod = found
        for at in amid(events[end], hyperperiod):
            assert any(0 <= at - before <= most * US for before in events[begin])


@examples(8)
@given(WCETS, st.lists(st.sampled_from("ST"), min_size=2, max_size=3), st.sampled_from([0, 300, 700, 1500, 3000]))
def test_synchronised_events_come_in_clusters_of_their_tolerance(directory, wcets, kinds, tolerance):
    names = [f"{kind}{number}" for number, kind in enumerate(kinds)]
    refs = [ref("SCOPE-EVENT-REF", f"/Timing/X/{name}") for name in names]
    constraint = named(
        "SYNCHRONIZATION-TIMING-CONSTRAINT", "S", el("SCOPE-EVENT-REFS", *refs), cse("TOLERANCE", tolerance)
    )
    if found := events_of(directory, [10] * len(names), wcets, [constraint]):
        clusters = zip(*(found[0][name] for name in names), strict=True)
        assert all(max(cluster) - min(cluster) <= tolerance * US for cluster in clusters)


@examples(5)
@given(WCETS, st.sampled_from([5, 20]), st.integers(0, 9000))
def test_periodic_events_deviate_by_their_jitter_at_most(directory, wcets, other, jitter):
    constraint = triggering("PERIODIC", "Tr", "A0", cse("PERIOD", 10_000), cse("JITTER", jitter))
    if found := events_of(directory, [None, other, 5], wcets, [constraint]):
        deviations = [at - number * 10_000 * US for number, at in enumerate(found[0]["S0"])]
        assert max(deviations) - min(deviations) <= jitter * US
