"""Readers of published sets and their plain first fit, on small files in the same forms."""

from fractions import Fraction

import pytest

from halpipe.core.durations import Duration
from halpipe.models import Job, Schedule, Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify
from search_benchmark.published import Activity, System, co_scheduled, control, first_fit, scaled, streams

CONTROL = """nApps = 2
nRes = 3
nActs = 4
nNetworks = 1
assignmentToResources = [1,3,2,1];
processingTimes = [100,10,200,300];
periods = [1000,1000,1000,2000];
assignmentToClusters = [1,1,1,2];
precedenceAdjList = [[],[0],[1],[]];"""

CO_SCHEDULED = """numChains = 1;
numberOfTasksinChain = [3];
runnablesInChains = [1,2];
processingTimesOfMessages = [[7],[],[9]];
processingTimesRunnables = [60,50,30];
periods = [1000,1000,2000];
communicationTimeForOrderCriticalMessages = [5];
sizeOfRunnables = [1,1,1];
senderLabelReceiverOrderCriticalChains = [[1,4,0,0,2]];
senderLabelReceiverNonOrderCriticalChains = [[1,8,3],[3,8,1]];"""

TOPOLOGY = 'link,q_num,rate,t_proc,t_prop\n"(0, 1)",8,1,2000,0\n"(1, 2)",8,1,2000,500\n"(0, 3)",8,1,0,0\n'
STREAMS = "stream,src,dst,size,period,deadline,jitter\n0,0,[2],100,400000,1,1\n"


def test_tasks_are_strict_and_messages_free():
    system = control(CONTROL)
    assert [(each.unit, each.jitter, each.before) for each in system.activities] == [
        ("u1", 0, ()),
        ("u3", 1, (0,)),
        ("u2", 0, (1,)),
        ("u1", 0, ()),
    ]
    [chain] = system.model().chains
    assert chain.tasks == ("t0", "t1", "t2")
    assert str(chain.max_latency) == "2ms"


def test_labels_that_leave_a_core_are_messages_of_the_receivers_link():
    """Loads 0.06, 0.05, 0.015: the first runnable on one core, the others on the second."""
    system = co_scheduled(CO_SCHEDULED, 2, 5)
    assert [(each.unit, each.wcet, each.before) for each in system.activities] == [
        ("core0", 60, ()),
        ("core1", 50, (3,)),
        ("core1", 30, ()),
        ("link1", 5, (0,)),
        ("link1", 7, ()),
        ("link0", 9, ()),
    ]
    assert {each.jitter for each in system.activities} == {Fraction(1, 5)}
    loads = {}
    for each in scaled(system, 50).activities:
        loads[each.unit] = loads.get(each.unit, 0) + Fraction(each.wcet, each.period)
    assert all(Fraction(49, 100) < load <= Fraction(1, 2) for load in loads.values())


def test_frames_take_the_shortest_way_without_waiting():
    system = streams(TOPOLOGY, STREAMS)
    assert [(each.unit, each.wcet, each.lag) for each in system.activities] == [
        ("l0_1", 800, None),
        ("l1_2", 800, 2000),
    ]
    assert schedule_model(system.model(), SearchOptions(), lambda *_: True).is_complete


def test_every_pair_and_edge_is_on_a_chain():
    """Two ways from 0 to 3, and one from 4 to 3."""
    before = ((), (0,), (0,), (1, 2, 4), ())
    system = System(tuple(Activity("u", 1000, 1, Fraction(0), each) for each in before), 1000)
    assert sorted(system.chains()) == [[0, 1, 3], [0, 2, 3], [4, 3]]


@pytest.mark.parametrize("limit", [2, None])
def test_the_first_fit_overlaps_nowhere_and_keeps_the_limit(limit):
    before = ((), (0,), (1,), (), ())
    rows = zip(before, (6, 8, 8, 4, 4), (100, 100, 100, 50, 50), strict=True)
    system = System(tuple(Activity("u", period * 100, wcet, Fraction(0), b) for b, period, wcet in rows), 1000, limit)
    starts = first_fit(system)
    assert starts is not None
    busy = [
        (start + turn * each.period + tick) % 2400
        for start, each in zip(starts, system.activities, strict=True)
        for turn in range(2400 // each.period)
        for tick in range(each.wcet)
    ]
    assert len(busy) == len(set(busy))
    assert all(starts[b] + system.activities[b].wcet <= starts[n] for n, own in enumerate(before) for b in own)


def test_the_first_fit_of_streams_waits_nowhere_and_verifies():
    """Two streams meet on their second link, so that the later one starts later on its first; a third passes no end."""
    table = STREAMS + "1,3,[2],100,400000,1,1\n2,0,[2],100,200000,1,1\n"
    system = streams(TOPOLOGY + '"(3, 1)",8,1,2000,0\n', table)
    starts = first_fit(system)
    assert starts is not None
    model = system.model()
    jobs = [
        Job(
            task=each.name,
            index=index,
            start=Duration(start) + each.period * index,
            end=Duration(start) + each.period * index + each.versions[0].wcet,
            version="v",
            units=each.versions[0].units,
        )
        for start, each in zip(starts, model.tasks, strict=True)
        for index in range(400000 // each.period.ns)
    ]
    tables = (mode_report(model, expand(model, model.modes[0]), jobs, Status.VALID),)
    assert [d for d in verify(model, Schedule(model=model.name, model_sha256="", modes=tables)) if d.is_error] == []
    assert starts[2] > 0


def test_a_model_of_a_reader_has_a_schedule_where_the_first_fit_has_one():
    for system in (control(CONTROL), co_scheduled(CO_SCHEDULED, 2, 0)):
        assert first_fit(system) is not None
        assert schedule_model(system.model(), SearchOptions(), lambda *_: True).is_complete
