"""Tables of preemptive jobs: how late their jobs are, what is executed of them in exact time, and their chains."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest
from split_helpers import interrupts, points, split

from halpipe.core.diagnostics import HalpipeError
from halpipe.models import Anchor, ResourceKind, Split
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.codes import TOO_LARGE
from halpipe.pipeline.solve.edf import trials
from halpipe.pipeline.solve.edf.fixed import fix
from halpipe.pipeline.solve.edf.native import System, Told
from halpipe.pipeline.solve.edf.plans import Table, allowed_ways, first_plan
from halpipe.pipeline.solve.edf.trials import (
    MOST_CYCLES,
    NEVER,
    ChainTimes,
    Effort,
    Simulator,
    Trials,
    earliest_expected,
    followed,
    lateness,
    missed_by_fixed,
    named,
)
from halpipe.pipeline.solve.edf.works import works_of
from halpipe.pipeline.solve.integers import ints
from support import access, after, chain, job, model, ms, task, version


def mode_of(owner, *shipped, growth=1, tick=1):
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, ms(tick), Fraction(growth))
    return replace(mode, fixed=fix(mode, {(each.task, each.index): each for each in shipped})[0])


def plan_of(mode):
    return first_plan(mode, allowed_ways(mode, {}))


def table_of(*tasks, late=None):
    """A table: of each task a list of jobs, each its release and its parts; a job without parts has not started."""
    rows = [(index, release, parts) for jobs in tasks for index, (release, *parts) in enumerate(jobs)]
    flat = [part for _, _, parts in rows for part in parts]
    places = [sum(map(len, tasks[:number])) for number in range(len(tasks) + 1)]
    counts = [len(parts) for _, _, parts in rows]
    return Table(
        ints(places),
        ints(index for index, _, _ in rows),
        ints(release for _, release, _ in rows),
        ints(parts[0][0] if parts else 0 for _, _, parts in rows),
        ints(parts[-1][1] if parts else 0 for _, _, parts in rows),
        ints(sum(counts[:number]) for number in range(len(counts))),
        ints(counts),
        ints(word for part in flat for word in part),
        tuple(late or [0] * len(tasks)),
        closed=True,
    )


def whole(release, start, end):
    return release, (start, end, 0, end - start)


# ------------------------------------------------------------------------------------------------ how late


TWO_JOBS = [whole(0, 1, 4), whole(10, 15, 21)]


@pytest.mark.parametrize(
    ("changes", "late"),
    [
        ({}, 2 + 2),  # from 1 ms after the releases on: 5 ms of 1 + 2 ms, and the end after 11 of 1 + 8 ms
        ({"offset": ms(0)}, 3 + 3),
        ({"slack": Fraction(1, 2)}, 2),
        ({"deadline": ms(10)}, 2),
        ({"slack": Fraction(1, 2), "deadline": ms(10)}, 0),
        ({"distance": ms(14), "deadline": ms(14)}, 2 + 6),  # its slack, and 20 ms of 14 from a start to the next end
        ({"distance": ms(13), "deadline": ms(20), "slack": Fraction(1)}, 1),
        ({"distance": ms(14), "deadline": ms(20), "slack": Fraction(1)}, 0),
    ],
)
def test_jobs_are_late_by_what_is_beyond_their_slack_and_their_deadline(changes, late):
    polled = replace(task("a", 10, version("v", 3), deadline=8), slack=Fraction(1, 5))
    mode = mode_of(model(replace(polled, **changes), task("b", 20, version())))
    table = table_of(TWO_JOBS, [whole(0, 0, 1)])
    assert lateness(mode, table) == [late, 0]


def test_the_first_start_of_an_arrival_follows_the_last_of_the_cycle_before():
    """From 1 ms to 21 ms are 20 ms where the second job comes at once, and 5 ms less where it comes late."""
    polled = replace(task("a", 10, version("v", 3), slack=1, deadline=40), distance=ms(14))
    mode = mode_of(model(polled, task("b", 20, version())))
    early = table_of([whole(0, 4, 7), whole(10, 5, 8)], [whole(0, 0, 1)])
    assert lateness(mode, early)[0] == 20 + 4 - 5 - 14


def test_of_jobs_that_did_not_start_and_of_those_on_demand_the_simulation_says_how_late_they_are():
    asks = version("v", 1, "u1", after("h", 0, 9))
    mode = mode_of(model(task("a", 10, version("v", 3)), task("h", None, version()), task("b", 20, asks)))
    table = table_of([whole(0, 1, 4), (10,)], [whole(0, 15, 16)], [whole(0, 0, 1)], late=[7, 5, 3])
    assert lateness(mode, table) == [7, 5, 0]


def test_free_phases_follow_the_first_start():
    owner = model(task("a", 10, version("v", 1)), task("b", 10, version("v", 1), offset=2), task("c", 20, version()))
    mode = mode_of(owner)
    plan = replace(plan_of(mode), phases=(3, 2, 5))
    found = followed(mode, plan, table_of([whole(3, 5, 6), whole(13, 14, 15)], [whole(2, 4, 5)], [(5,)]))
    assert found == (4, 2, 5)


@pytest.mark.parametrize(
    ("row", "instant"),
    [(after("a", 3, 9), 4 + 3), (after("a", 3, 9, "end"), 4 + 2 + 3), (after("a", 0, 9, "end"), 0)],
)
def test_no_job_expects_a_predecessor_before_its_first_can_have_been(row, instant):
    owner = model(task("a", 20, version("v", 2), offset=4), task("b", 20, version("v", 1, "u1", row)))
    mode = mode_of(owner)
    plan = plan_of(mode)
    told = Told(System(mode, 8), plan, 1)
    [window] = plan.ways[1].windows
    assert earliest_expected(plan, told, window) == instant
    kept = mode_of(owner, job(owner, "a", 0, 4, "u1"))
    assert earliest_expected(plan, Told(System(kept, 8), plan_of(kept), 1), window) == 0


def test_windows_of_jobs_that_stay_are_missed_by_the_jobs_of_a_table_and_by_each_other():
    rows = after("moves", 2, 4), after("other", 1, 3, "end")
    owner = model(
        task("stays", 20, version("v", 1, "u1", *rows)), task("moves", 20, version()), task("other", 20, version())
    )
    mode = mode_of(owner, job(owner, "stays", 0, 10, "u1"), job(owner, "other", 0, 3, "u1"))
    assert missed_by_fixed(mode, table_of([], [whole(0, 5, 6)], [])) == {1: 1, 2: 3}
    assert missed_by_fixed(mode, table_of([], [whole(0, 7, 8)], [])) == {1: 0, 2: 3}
    assert missed_by_fixed(mode_of(owner, job(owner, "other", 0, 3, "u1")), table_of([], [], [])) == {}


def test_a_table_is_looked_at_once_each_window_has_a_predecessor_to_look_back_at():
    """From 4 ms on, 37 ms later: that is in the third cycle of 20 ms, whatever the other window says."""
    rows = after("a", 1, 9), after("a", 37, 39)
    mode = mode_of(model(task("a", 20, version("v", 2), offset=4), task("b", 20, version("v", 1, "u1", *rows))))
    plan = plan_of(mode)
    assert Simulator(mode)._start_up(plan, Told(System(mode, 8), plan, 1)) == 3


def test_a_mode_whose_times_have_too_many_ticks_is_refused():
    with pytest.raises(HalpipeError) as refused:
        Simulator(mode_of(model(task("a", 10**9, version("v", 10**8))), tick="1/1000000ns"))
    assert [each.code for each in refused.value.diagnostics] == [TOO_LARGE.id]


class Scripted:
    """A simulation that says beforehand which hyperperiods repeat, are quiescent, or find too little room."""

    def __init__(self, repeats=(), quiescent=(), lacks=()):
        self.memory, self.turns, self.finished = self, [], None
        self.script = repeats, quiescent, lacks

    def turn(self, begin, end):
        self.turns.append((begin, end))

    def run(self, end):
        assert end == self.turns[-1][1]

    def is_like_before(self, now, turn):
        assert turn == len(self.turns)
        return turn in self.script[0]

    def is_quiescent(self, now):
        return len(self.turns) in self.script[1]

    @property
    def lacks_room(self):
        return ("events",) if len(self.turns) in self.script[2] else ()

    def finish(self, end):
        self.finished = end


ALWAYS = range(100)


@pytest.mark.parametrize(
    ("start_up", "script", "last", "closed"),
    [
        (0, {"repeats": {3, 5}}, 3, True),
        (0, {"repeats": {MOST_CYCLES}}, MOST_CYCLES, True),
        (2, {"repeats": {MOST_CYCLES + 2}}, MOST_CYCLES + 2, True),
        (2, {"repeats": ALWAYS, "quiescent": ALWAYS}, 3, True),  # before, not every window looks back
        (0, {"quiescent": ALWAYS}, 1, True),  # nothing is in progress: the second will be like the first
        (0, {"quiescent": {2}, "repeats": {4}}, 4, True),
        (0, {}, MOST_CYCLES, False),
        (2, {}, MOST_CYCLES + 2, False),
        (0, {"repeats": {5}, "lacks": {2}}, 2, False),
    ],
)
def test_a_table_closes_with_the_first_hyperperiod_that_repeats_the_one_before(start_up, script, last, closed):
    simulation = Scripted(**script)
    assert Simulator(mode_of(model(task("a", 20, version()))))._close(simulation, start_up) == closed
    assert simulation.turns == [(20 * turn, 20 * turn + 20) for turn in range(last)]
    assert simulation.finished == 20 * last


# ------------------------------------------------------------------------------------------------ exact time


def parts_of(made, *parts, growth=1, tick=1, **more):
    """Return the start of each part in exact time, and what it executes, from and to."""
    mode = mode_of(model(task("a", 40, made, slack=1), resources="r", **more), growth=growth, tick=tick)
    [found] = named(mode, plan_of(mode), table_of([(0, *parts)]))
    return [(str(part.start), str(part.executed_from), str(part.executed_to)) for part in found.parts], found


def test_parts_between_points_execute_what_lies_between_them():
    made = split(version("v", "6.5ms"), points("2.2ms", 4, resume=ms("0.3ms")))
    found, whole_job = parts_of(made, (2, 7, 0, 5), (9, 13, 5, 8))
    assert found == [("2ms", "0ms", "4ms"), ("9ms", "4ms", "6.5ms")]
    assert (str(whole_job.start), str(whole_job.end)) == ("2ms", "11.8ms")


def test_a_job_in_one_piece_lasts_as_long_as_it_takes():
    _, found = parts_of(version("v", "2.5ms"), (2, 5, 0, 3))
    assert (found.parts, str(found.start), str(found.end)) == ((), "2ms", "4.5ms")


def test_parts_anywhere_execute_whole_ticks_and_the_last_the_rest():
    made = split(version("v", "6.5ms"), Split(anywhere=True, max_gaps=2))
    assert parts_of(made, (0, 3, 0, 3), (5, 9, 3, 7))[0] == [("0ms", "0ms", "3ms"), ("5ms", "3ms", "6.5ms")]


def test_what_grew_is_shortened_to_a_fraction_of_the_tick_or_to_the_edge_of_a_phase():
    """Of 6 ms in 9 ticks, 4 are 8/3 ms: 2.625 ms in eighths, unless a phase ends behind the tick before."""
    how = Split(anywhere=True, max_gaps=2)
    cut = (0, 4, 0, 4), (5, 10, 4, 9)

    def second(*edges):
        made = split(version("v", 6, "u1", *(access("r", begin, end) for begin, end in edges)), how)
        return parts_of(made, *cut, growth=Fraction(3, 2))[0]

    assert second() == [("0ms", "0ms", "2.625ms"), ("5ms", "2.625ms", "6ms")]
    assert second((0, "2.1ms"))[0][2] == "2.1ms"  # beyond 2 ms, which are 3 ticks
    assert second((0, 2))[0][2] == "2.625ms"
    assert second(("2.3ms", 5))[0][2] == "2.3ms"
    assert second(("2.65ms", 5))[0][2] == "2.65ms"
    assert second((0, "2.7ms"))[0][2] == "2.625ms"
    assert second((0, "8/3ms"))[0][2] == "8/3ms"


def test_interrupts_of_all_units_lengthen_the_parts():
    owner = interrupts(model(task("a", 40, version("v", 3, "u1 u2", gang=2), slack=1), units="u1 u2"), "u2", (40, 1))
    mode = mode_of(owner)
    [found] = named(mode, plan_of(mode), table_of([(0, (2, 6, 0, 3))]))
    assert (str(found.start), str(found.end), found.units) == ("2ms", "6ms", ("u1", "u2"))


def test_jobs_that_stay_are_named_as_they_are_behind_the_others():
    owner = model(task("stays", 20, version()), task("a", 20, version()))
    kept = job(owner, "stays", 0, 7, "u1")
    mode = mode_of(owner, kept)
    assert [each.task for each in named(mode, plan_of(mode), table_of([], [whole(0, 2, 3)]))] == ["a", "stays"]


# ------------------------------------------------------------------------------------------------ chains


def chained(**options):
    owner = model(
        task("a", 10, version("v", 2), offset=0),
        task("b", 20, version("v", 3), offset=2),
        chains=[chain("c", "a b", **options), chain("d", "b gone")],
    )
    return owner, mode_of(owner)


def test_latencies_are_in_ticks_and_the_same_however_they_are_measured(monkeypatch):
    """Jobs of a end at 2 and 12 ms; b reads at 2 ms, so that the second waits until 22 ms, and b ends at 25 ms."""
    owner, mode = chained()
    table = table_of([whole(0, 0, 2), whole(10, 10, 12)], [whole(2, 2, 5)])
    times = ChainTimes(mode, owner.chains)
    assert [each.name for each in times.chains] == ["c"]
    assert times.of(plan_of(mode), table) == [(25, 5)]
    finer = mode_of(owner, tick="0.5ms")
    halves = table_of([whole(0, 0, 4), whole(20, 20, 24)], [whole(4, 4, 10)])
    assert ChainTimes(finer, owner.chains).of(plan_of(finer), halves) == [(50, 10)]
    coarse = mode_of(owner, tick=2)  # b really ends a millisecond before its last tick does
    rounded = table_of([whole(0, 0, 1), whole(5, 5, 6)], [whole(1, 1, 3)])
    assert ChainTimes(coarse, owner.chains).of(plan_of(coarse), rounded) == [(Fraction(25, 2), Fraction(5, 2))]
    grown = mode_of(owner, growth=Fraction(3, 2))  # measured by the jobs as they are named
    found = table_of([(0, (0, 3, 0, 3)), (10, (10, 13, 0, 3))], [(2, (3, 8, 0, 5))])
    assert ChainTimes(grown, owner.chains).of(plan_of(grown), found) == [(10 + 16, 6)]
    twice = mode_of(owner, growth=2)
    found = table_of([(0, (0, 4, 0, 4)), (10, (10, 14, 0, 4))], [(2, (4, 10, 0, 6))])
    assert ChainTimes(twice, owner.chains).of(plan_of(twice), found) == [(10 + 17, 7)]


def test_a_chain_without_a_job_carries_no_data():
    owner, mode = chained()
    assert ChainTimes(mode, owner.chains).of(plan_of(mode), table_of([(0,), (10,)], [])) == [(NEVER, NEVER)]


# ------------------------------------------------------------------------------------------------ tries


def tried(owner, plan=None, go_on=lambda placed, excess: True):
    mode = mode_of(owner)
    found = Trials(mode, owner, Effort(100, 0, go_on))
    return found, found.evaluate(plan or plan_of(mode))


def test_a_try_counts_its_jobs_and_what_is_late():
    told = []
    owner = model(task("a", 10, version("v", 6), offset=0), task("b", 20, version("v", 6), offset=0, slack="1/5"))
    found, first = tried(owner, go_on=lambda *given: told.append(given) or len(told) < 2)
    assert (found.placed, found.stopped, first.excess > 0, sum(first.late) <= first.excess) == (3, False, True, True)
    found.evaluate(first.plan)
    assert (found.placed, found.stopped) == (6, True)
    assert told == [(3, first.excess), (6, first.excess)]


@pytest.mark.parametrize(
    ("limits", "excess", "slow"),
    [
        ((25, 5), 0, ()),
        ((25, None), 0, ()),
        ((24, None), 1, (0, 1)),
        ((None, 3), 2, (0, 1)),
        ((24, 5), 1, (0, 1)),
        ((25, 3), 2, (0, 1)),
    ],
)
def test_a_valid_table_is_beyond_the_limits_of_its_chains_by_so_much(limits, excess, slow):
    owner, _ = chained(reaction=limits[0], age=limits[1])
    _, found = tried(owner)
    assert (found.excess, found.slow, found.late) == (excess, slow, (0, 0))


def test_a_job_is_late_by_what_misses_the_window_of_one_that_stays():
    owner = model(
        task("stays", 20, version("v", 1, "u1", after("moves", 2, 4))), task("moves", 20, version("v", 2), offset=0)
    )
    mode = mode_of(owner, job(owner, "stays", 0, 10, "u1"))
    found = Trials(mode, owner, Effort(100, 0, lambda *_: True)).evaluate(plan_of(mode))
    assert (found.late, found.excess) == ((0, 6), 6)


def test_a_table_without_jobs_counts_as_one_job():
    owner = model(task("a", 20, version("v", 2)))
    mode = mode_of(owner, job(owner, "a", 0, 3, "u1"))
    found = Trials(mode, owner, Effort(100, 0, lambda *_: True))
    found.evaluate(plan_of(mode))
    assert found.placed == 1


def test_parts_are_counted_before_they_are_too_many(monkeypatch):
    owner = model(task("a", 10, version("v", 2)), task("b", 20, version("v", 2)))
    monkeypatch.setattr(trials, "MAX_PARTS", 3)
    assert tried(owner)[1].excess == 0


def one(wcet, *parts, lock=False):
    """A task of which another one keeps away, with a resource."""
    owner = model(task("a", 20, version("v", wcet, "u1", *parts), slack=1), task("z", 20, version()), resources="r")
    kind = ResourceKind.LOCK if lock else owner.resources[0].kind
    return replace(owner, resources=(replace(owner.resources[0], kind=kind),))


FROM_RELEASE = replace(after("z", 0, 20), anchor=Anchor.RELEASE)


@pytest.mark.parametrize(
    ("owner", "options", "is_asked"),
    [
        (one(2), {}, False),
        (one(2, access("r", 0, 1), after("z", 0, 19)), {}, False),
        (one(2), {"growth": 2}, False),
        (one(2, access("r", 0, 1)), {"growth": 2}, True),
        (one(2, after("z", 0, 19)), {"growth": 2}, True),
        (one("2.5ms"), {}, False),
        (one("2.5ms", access("r", 0, 1)), {}, True),
        (one("2.5ms", after("z", 0, 19)), {}, True),
        (one(2, access("r", 0, 1), lock=True), {}, True),
        (one(2, FROM_RELEASE), {}, True),
        (one(2), {"is_lenient": True}, True),
        (one(2), {"stays": True}, True),
    ],
)
@pytest.mark.parametrize("cost", [Fraction(13, 2), Fraction(-3)])
def test_what_no_simulation_keeps_is_asked_of_the_cost_of_the_table(monkeypatch, owner, options, is_asked, cost):
    """Where jobs stay, or lie otherwise in exact time than on the grid, and where locks or other rules are."""
    monkeypatch.setattr(trials, "cost_terms", lambda *_: SimpleNamespace(total=cost))
    given = dict(options)
    shipped = [job(owner, "z", 0, 15, "u1")] if given.pop("stays", False) else []
    is_lenient = given.pop("is_lenient", False)
    mode = replace(mode_of(owner, *shipped, **given), is_lenient=is_lenient)
    found = Trials(mode, owner, Effort(100, 0, lambda *_: True)).evaluate(plan_of(mode))
    assert found.excess == (7 if is_asked and cost > 0 else 0)
