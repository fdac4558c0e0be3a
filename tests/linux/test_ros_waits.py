"""Jobs that wait for their messages: what verify accepts holds wherever within the wait the job begins."""

import random
from dataclasses import replace

import pytest
from test_ros_package import BINDINGS

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.ros import RosOptions, codes
from halpipe.exporters.ros.waits import with_late_starts
from halpipe.flow.formats import export_with_remarks
from halpipe.models import Anchor, Chain, Precedence, Transfer
from halpipe.models.trace import BoundCallback
from halpipe.pipeline.verify import broken_rules
from support import access, job, model, ms, schedule, task, version

WAIT = {"/sink": ms(1)}


def system(*rows, accesses=(), other=(), wcet=3, sink=2, after=(), beside=6, chain=None):
    """/source ends at 1 ms after its start, /sink waits; /other runs on another unit beside it."""
    windows = tuple(Precedence(max=ms(most), **stated) for most, stated in rows)
    back = tuple(Precedence(task="/sink", max=ms(most), **stated) for most, stated in after)
    waiting = replace(version("v", f"{wcet}ms", "u1", *accesses), precedences=windows)
    following = replace(version("v", "2ms", "u2", *other), precedences=back)
    tasks = [
        task("/source", 10, version("v", "1ms", "u1"), slack=1),
        task("/sink", 10, waiting, slack=1),
        task("/other", 10, following, slack=1),
    ]
    owner = model(*tasks, units="u1 u2", resources="memory", name="waiting")
    owner = replace(owner, chains=(chain,) if chain else ())
    starts = (("/source", 0, "u1"), ("/sink", sink, "u1"), ("/other", beside, "u2"))
    return owner, schedule(owner, 10, *(job(owner, name, 0, start, unit) for name, start, unit in starts))


def refused(owner, tables, wait=WAIT, **chosen):
    bindings = {**BINDINGS, "/other": BoundCallback(node="/other", kind="timer", period=10_000_000)}
    options = RosOptions(package=True, bindings=bindings, wait=wait, cpus={"u1": 0, "u2": 1}, **chosen)
    try:
        assert export_with_remarks("ros", owner, tables, options).contents
    except HalpipeError as failure:
        return {d.code for d in failure.diagnostics}
    return set()


SOURCE = {"task": "/source", "anchor": Anchor.END}
FROM_SINK = {"anchor": Anchor.START, "min": ms(3)}
CASES = [
    ({"rows": [(2, SOURCE)]}, True),  # from the end of /source at 1 ms to the latest begin at 3 ms
    ({"rows": [("1.999999ms", SOURCE)]}, False),
    ({"rows": [(4, {**SOURCE, "to": Anchor.END, "min": ms(4)})]}, True),
    ({"after": [(9, FROM_SINK)]}, True),  # /other starts at 6 ms, and the latest begin is at 3 ms
    ({"after": [(9, {**FROM_SINK, "min": ms("3.000001ms")})]}, False),
    ({"after": [(1, {"anchor": Anchor.END, "min": ms(1)})]}, True),
    ({"accesses": [access("memory", 0, 3)]}, True),  # the whole job, until 5 ms
    ({"accesses": [access("memory", 0, 3)], "other": [access("memory", 0, 1)]}, True),
    ({"wcet": 8, "accesses": [access("memory", 0, 3)], "other": [access("memory", 0, 1)]}, True),  # until 6 ms
    ({"wcet": 8, "accesses": [access("memory", 0, "3.000001ms")], "other": [access("memory", 0, 1)]}, False),
    ({"chain": Chain(name="c", tasks=("/source", "/sink"), max_latency=ms(3), to=Anchor.START)}, True),
    ({"chain": Chain(name="c", tasks=("/source", "/sink"), max_latency=ms("2.999999ms"), to=Anchor.START)}, False),
    ({"chain": Chain(name="c", tasks=("/source", "/sink"), max_latency=ms(5))}, True),
]


@pytest.mark.parametrize(("stated", "holds"), CASES)
def test_a_schedule_holds_for_the_latest_begin_or_is_refused(stated, holds):
    owner, tables = system(*stated.pop("rows", ()), **stated)
    assert refused(owner, tables) == (set() if holds else {codes.LATE_START.id})
    assert refused(owner, tables, wait=None) == set()


def test_a_wait_longer_than_the_limit_of_a_chain_to_the_start_is_refused():
    limited = Chain(name="c", tasks=("/source", "/sink"), max_latency=ms("0.5ms"), anchor=Anchor.END, to=Anchor.START)
    owner, tables = system(chain=limited, sink=1)
    assert refused(owner, tables, wait=None) == set()
    assert refused(owner, tables) == {codes.NO_EVENT.id}
    assert refused(owner, tables, wait={"/sink": ms("0.5ms")}) == set()


@pytest.mark.parametrize(("wcet", "fits"), [("1ms", False), ("1.000001ms", True)])
def test_a_wait_is_shorter_than_the_shortest_version(wcet, fits):
    """Even one that the schedule does not choose: the mode may."""
    owner, tables = system()
    sink = owner.task("/sink")
    both = replace(sink, versions=(*sink.versions, version("w", wcet, "u1")))
    owner = replace(owner, tasks=tuple(both if each is sink else each for each in owner.tasks))
    assert refused(owner, tables) == (set() if fits else {codes.NO_EVENT.id})


@pytest.mark.parametrize("row", [(2, {"min": ms(2)}), ("1.5ms", {"min": ms(1)})])
def test_a_window_that_is_narrower_than_the_wait_is_kept_by_no_schedule(row):
    most, stated = row
    owner, tables = system((most, {**SOURCE, **stated}), sink=3 if most == 2 else 2)
    assert refused(owner, tables, wait=None) == set()
    assert refused(owner, tables) == {codes.LATE_START.id}


def begun_late(owner, tables, by):
    """The system in which every job of /sink begins late, and is as much shorter."""
    sink = owner.task("/sink")
    [old] = sink.versions
    end = old.wcet - by
    accesses = tuple(replace(a, end=min(a.end, end)) for a in old.accesses if a.start < end)
    shorter = replace(sink, versions=(replace(old, wcet=end, accesses=accesses),))
    [table] = tables.modes
    jobs = tuple(replace(j, start=j.start + by) if j.task == "/sink" else j for j in table.jobs)
    tasks = tuple(shorter if t.name == "/sink" else t for t in owner.tasks)
    return replace(owner, tasks=tasks), replace(tables, modes=(replace(table, jobs=jobs),))


def test_verify_agrees_with_every_begin_played():
    """Brute force: all begins of random systems in steps of a quarter of the wait, each verified on its own."""
    dice, verdicts = random.Random(38), []
    for _ in range(200):
        window = {"task": "/source", "anchor": dice.choice([Anchor.START, Anchor.END]), "min": ms(dice.randint(0, 2))}
        back = {"anchor": dice.choice([Anchor.START, Anchor.END]), "min": ms(dice.randint(0, 2))}
        begin, middle, end = sorted(dice.sample(range(5), 3))
        bounds = dice.sample(["1/2", "1"], 2)
        phases = [access("memory", begin, middle, bounds[0]), access("memory", middle, end, bounds[1])]
        at = dice.choice([2, 3, 4, 6])
        owner, tables = system(
            (dice.randint(2, 4), window),
            after=[(dice.randint(3, 6), back)] if at == 6 else (),
            beside=at,
            accesses=phases,
            other=[access("memory", 0, 1, dice.choice(["1/2", "1"]))],
            wcet=4,
            sink=dice.randint(1, 2),
        )
        wait = dice.choice([ms("0.5ms"), ms(1), ms(2)])
        played = [begun_late(owner, tables, wait * k / 4) for k in range(5)]
        every = all(not broken_rules(*one) for one in played)
        late = not broken_rules(with_late_starts(owner, {"/sink": wait}), tables)
        assert late == every
        verdicts.append(late)
    assert 30 < sum(verdicts) < 170


@pytest.mark.parametrize(("wait", "wcet"), [("1ms", None), ("0ms", "4ms")])
def test_phases_stay_as_they_are_where_nothing_waits_or_no_time_is_known(wait, wcet):
    moved = Transfer(buffer="b", symbol="s", size=4)
    phases = (replace(access("memory", 0, 2), transfers=(moved,)), access("memory", 1, 3, "1/2"))
    waiting = replace(version("v", "4ms", "u1", *phases), wcet=ms(wcet))
    owner = model(task("/sink", 10, waiting), resources="memory")
    assert with_late_starts(owner, {"/sink": ms(wait)}).tasks[0].versions[0].accesses == phases
