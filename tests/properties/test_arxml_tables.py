"""The schedule tables of an export start the jobs of the schedule, and keep the rules of AUTOSAR; guarantees hold."""

import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from verify_systems import switching_system, valid_system

from arxml_reading import NS, by_path, containers, name_of, names, seconds_per_tick, special, tables, text, write
from halpipe.core.durations import seconds
from halpipe.exporters.arxml import RELEASES
from profiles import examples

FAST = examples(40)
SYSTEMS = pytest.mark.parametrize("make", [valid_system, switching_system])


def works(root):
    """What each OsTask executes, by the names in the file: the task, its version, the unit."""
    found, called = {}, names(root)
    for name, container in containers(root, "OsTask").items():
        data = dict(special(container, "work") or ())
        if data:
            runnable, implementation, unit = (by_path(root, path) for path in data.values())
            found[name] = tuple(called[element] for element in (runnable, implementation, unit))
    return found


def starts_in(jobs):
    """(task, version, unit, start) of jobs, each as often as it occurs."""
    return sorted((j.task, j.version, unit, j.start) for j in jobs for unit in j.units)


@SYSTEMS
@FAST
@given(seed=st.integers(0, 10**6))
def test_tables_start_the_jobs_of_the_schedule(make, seed):
    model, plan = make(random.Random(seed))
    root = write(model, plan)
    tick, known = seconds(seconds_per_tick(root)), works(root)
    played = {}
    for table in tables(root).values():
        jobs = played.setdefault((table.of, tick * table.duration), [])
        jobs += [(*known[n], tick * offset) for offset, started in table.points for n in started if n in known]
    expected = {((m.name,), m.hyperperiod): starts_in(m.jobs) for m in plan.modes}
    expected |= {((t.source, t.target), t.length): starts_in(t.jobs) for t in plan.transitions if t.length}
    assert {key: sorted(jobs) for key, jobs in played.items()} == expected


@SYSTEMS
@FAST
@given(seed=st.integers(0, 10**6))
def test_tables_keep_the_rules_of_autosar(make, seed):
    """SWS_Os_00401, 00407, 00408, 00427, 00442; one counter for all tables of a core (00330); followers exist."""
    root = write(*make(random.Random(seed)))
    found = tables(root)
    for table in found.values():
        offsets = [offset for offset, _ in table.points]
        assert offsets
        assert all(names for _, names in table.points)
        assert all(a < b for a, b in pairwise([*offsets, table.duration]))
        assert table.repeating == (len(table.of) == 1)
        for path, goal in table.following:
            follower = found[path.rpartition("/")[2]]
            assert follower.counter == table.counter
            assert follower.of in ((goal,), (*table.of[:1], goal))


@FAST
@given(seed=st.integers(0, 10**6))
def test_guarantees_keep_the_demands_and_no_smaller_jitter_could_be_guaranteed(seed):
    """Of all phases at which a task might be released, none delays its jobs less than the guarantee says."""
    model, plan = valid_system(random.Random(seed))
    root = write(model, plan)
    proven = by_path(
        root, f"/{text(root.find(f'.//{NS}AR-PACKAGE'), 'SHORT-NAME')}/Timing/Guarantees_{plan.modes[0].name}"
    )
    jitters = {
        name_of(e).removesuffix("_period"): int(text(e, "JITTER/CSE-CODE-FACTOR"))
        for e in proven.iter(NS + "PERIODIC-EVENT-TRIGGERING")
    }
    responses = {
        name_of(e).removesuffix("_response"): int(text(e, "MAXIMUM/CSE-CODE-FACTOR"))
        for e in proven.iter(NS + "LATENCY-TIMING-CONSTRAINT")
    }
    for task in model.tasks:
        total = plan.modes[0].hyperperiod
        jobs = [job for job in plan.modes[0].jobs if job.task == task.name]
        if task.period is None or not jobs:
            continue
        firsts = {(job.start - task.period * job.index) % total for job in jobs}
        phases = firsts if task.offset is None else {task.offset % task.period}
        delays = [[(first - phase) % total for first in firsts] for phase in phases]
        assert jitters[task.name] <= (task.period * task.slack).in_unit("us")
        assert responses[task.name] <= (task.deadline or task.period).in_unit("us")
        least = min(max(d) - min(d) for d in delays)
        assert jitters[task.name] == least.in_unit("us")


@examples(10)
@given(seed=st.integers(0, 10**6), release=st.sampled_from(list(RELEASES)))
def test_exports_are_valid(tmp_path_factory, seed, release):
    autosar_data = pytest.importorskip("autosar_data", reason="autosar-data is not installed")
    from halpipe.exporters.arxml import FORMAT, ArxmlOptions

    path = tmp_path_factory.mktemp("valid") / "a.arxml"
    path.write_bytes(FORMAT.write(*switching_system(random.Random(seed)), ArxmlOptions(release=release))[""])
    assert autosar_data.AutosarModel().load_file(str(path), True)[1] == []
