"""The margin of schedules for which no objective is stated: raised with little effort, stated, and switchable."""

from __future__ import annotations

import json
import random
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest
from split_helpers import interrupts, points, split

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.options import from_keywords
from halpipe.exporters.common.rows import as_json
from halpipe.exporters.native import format_schedule
from halpipe.importers.native import parse_schedule
from halpipe.models import ModeSchedule, Schedule, Split, Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import one_mode
from halpipe.pipeline.solve.codes import TOO_LARGE
from halpipe.pipeline.solve.kernel.search import Outcome
from halpipe.pipeline.solve.kernel.widen import NO_WIDER, ROUNDS, STEP, Wider
from halpipe.pipeline.solve.optimise import Reached
from halpipe.pipeline.solve.schedule import SPARE, SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.verify import verify
from support import access, after, chain, job, model, ms, task, version


def found(owner, **options):
    scheduled = schedule_model(owner, SearchOptions(**options), lambda *_: True)
    assert scheduled.is_complete
    assert [d for d in verify(owner, scheduled.schedule) if d.is_error] == []
    return scheduled


def margins(owner, **options):
    return [mode.margin for mode in found(owner, **options).schedule.modes]


DENSE = generate(SetParameters(tasks=30, units=4), 3)


@pytest.mark.parametrize("options", [{}, {"seed": 7}, {"tick": None, "budget": 400}])
def test_a_schedule_has_a_margin_that_the_first_one_does_not_have(options):
    assert margins(DENSE, optimise=(), **options) == [0]
    assert min(margins(DENSE, **options)) >= Fraction(1, 4)


def test_the_effort_is_a_number_of_moves():
    first, wider = found(DENSE, optimise=()), found(DENSE)
    jobs = len(first.schedule.modes[0].jobs)
    assert first.moves < wider.moves <= first.moves + SPARE * len(DENSE.tasks) // jobs


def test_no_shorter_version_is_chosen_for_a_margin():
    owner = model(task("a", 10, version("long", 8), version("short", 1)), task("b", 10, version("v", 1)))

    def chosen(**options):
        return [{job.version for job in found(owner, seed=n, **options).schedule.modes[0].jobs} for n in range(1, 9)]

    first = chosen(optimise=())
    assert {"long", "v"} in first
    assert chosen() == first


def test_what_is_proven_best_costs_nothing():
    """Two jobs that fill their unit cannot grow: the bound is 0, and nothing is searched for."""
    owner = model(task("a", 10, version("v", 4)), task("b", 10, version("v", 6)))
    scheduled = found(owner)
    (mode,) = scheduled.schedule.modes
    assert (mode.margin, mode.margin_bound, mode.margin_words) == (0, 0, "0 %, the best possible")
    assert scheduled.moves == found(owner, optimise=()).moves


@pytest.mark.parametrize(("others", "bound"), [((), 0), ((version("w", 4),), "3/2")])
def test_jobs_on_demand_take_their_share_of_the_bound(others, bound):
    """Where another version demands nothing, the jobs may do without."""
    needs = version("v", 4, "u1", after("d", 0, 10, "end"))
    owner = model(task("d", None, version("v", 6)), task("a", 10, needs, *others))
    (mode,) = found(owner, optimise=()).schedule.modes
    assert mode.margin_bound == Fraction(bound)


def test_the_words_name_the_bound():
    owner = model(task("a", 10, version("v", 4)), task("b", 20, version("v", 3)), task("c", 20, version("v", 3)))
    (mode,) = found(owner).schedule.modes
    assert mode.margin < mode.margin_bound == Fraction(3, 7)
    assert mode.margin_words == f"{float(int(mode.margin * 1000) / 10):g} %, at most 42.9 % is possible"


@pytest.mark.parametrize(
    ("margin", "bound", "words", "stands"),
    [
        (0, 0, "0 %, the best possible", "0 %, at first 0 %; the best possible"),
        (
            0,
            "1/9",
            "none found, at most 11.2 % is possible",
            "0 %, at first 0 %; not proven best; the best possible is at most 11.2 %",
        ),
        (0, None, "none found", "0 %, at first 0 %; how good it can be is not known"),
        (
            "1/20000",
            "1/9999",
            "less than 0.1 %, at most 0.1 % is possible",
            "less than 0.1 %, at first 0 %; the best possible is at most 0.1 %",
        ),
        ("1/4", None, "25 %", "25 %, at first 0 %; how good it can be is not known"),
    ],
)
def test_a_margin_of_zero_is_proven_or_said_not_to_be(margin, bound, words, stands):
    share, most = Fraction(margin), None if bound is None else Fraction(bound)
    mode = ModeSchedule(name="m", hyperperiod=ms(1), status=Status.VALID, margin=share, margin_bound=most, jobs=())
    assert mode.margin_words == words
    shown = json.loads(as_json(Schedule(model="m", modes=(mode,))))["modes"][0]
    assert shown["margin_words"] == words
    reached = Reached("m", Objective.MARGIN, Fraction(0), -share, None if most is None else -most)
    assert str(reached) == f"least margin of a WCET {stands}"


def preemptive(owner, seed):
    """The system with versions that may be preempted: at quarters, outside phases, or not at all."""
    rng = random.Random(seed)

    def changed(its):
        resume, cuts = rng.choice((ms(0), ms(1) / 100)), (its.wcet / 4, its.wcet / 2)
        free = tuple(cut for cut in cuts if not any(a.start < cut < a.end for a in its.accesses))
        points = Split(points=free, resume=resume) if free else Split()
        return replace(its, split=rng.choice((points, Split(anywhere=True, max_gaps=4, resume=resume), Split())))

    tasks = (replace(each, versions=tuple(map(changed, each.versions))) for each in owner.tasks)
    return replace(owner, tasks=tuple(tasks))


SETS = SetParameters(tasks=24, units=3, slack=Fraction(1, 2), access_windows=0), {1: 0, 2: 0, 3: 8, 7: 8}
PREEMPTIVE = [preemptive(generate(replace(SETS[0], access_windows=n), seed), seed) for seed, n in SETS[1].items()]


@pytest.mark.parametrize("owner", PREEMPTIVE)
def test_segments_of_preempted_jobs_have_a_margin_that_they_do_not_have_at_first(owner):
    assert margins(owner, optimise=()) == [0]
    (mode,) = found(owner).schedule.modes
    assert any(job.parts for job in mode.jobs)
    assert Fraction(1, 4) < mode.margin <= mode.margin_bound
    assert mode.margin_words.endswith("% is possible")


def test_a_margin_of_zero_is_worth_a_finer_grid():
    """On their tick of a millisecond, a job of one cannot last longer."""
    parts = replace(version("v", 12), split=Split(anywhere=True, max_gaps=8))
    owner = model(task("a", 20, parts), task("b", 5, version("v", 1)))
    assert margins(owner, optimise=(), tick=ms(1)) == margins(owner, tick=ms(1)) == [0]
    (mode,) = found(owner).schedule.modes
    assert any(job.parts for job in mode.jobs)
    assert mode.margin == mode.margin_bound == Fraction(1, 4)


def test_a_margin_that_is_asked_for_first_is_no_smaller_for_preempted_jobs():
    (least,) = margins(PREEMPTIVE[0])
    scheduled = found(PREEMPTIVE[0], optimise=(Objective.MARGIN, Objective.CHAINS), budget=200)
    assert scheduled.schedule.modes[0].margin >= least
    margin, chains = scheduled.reached
    assert (margin.first, margin.value) == (0, -scheduled.schedule.modes[0].margin)
    assert chains.value <= chains.first


def test_a_segment_ends_at_the_edge_of_its_phases():
    """Two phases of a whole resource that meet can be neither cut nor moved into each other by longer WCETs."""
    phases = (access("r", 0, "7/3", 1), access("r", "7/3", 5, 1))
    parts = replace(version("v", 12, "a", *phases), split=Split(anywhere=True, max_gaps=8, min_part=ms(1)))
    owner = model(task("a", 20, parts, slack=1), task("b", 5, version("v", 1, "a")), units="a", resources="r")
    (mode,) = found(owner).schedule.modes
    assert mode.margin > 0
    assert all(part.executed_to - part.executed_from >= ms(1) for job in mode.jobs for part in job.parts)


def test_a_start_that_must_follow_an_end_at_once_leaves_no_margin():
    parts = replace(version("v", 12, "a"), split=Split(anywhere=True, max_gaps=8))
    late = version("v", 2, "a", after("often", 0, 0, "end"))
    owner = model(
        task("a", 20, parts, slack=1), task("often", 20, version("v", 1, "a")), task("late", 20, late), units="a"
    )
    (mode,) = found(owner).schedule.modes
    assert (mode.margin, mode.margin_words) == (0, "0 %, the best possible")


def test_what_stays_at_zero_says_that_it_is_not_proven_best():
    """Both jobs begin at ticks, and the next tick is taken."""
    owner = model(task("a", 10, version("v", 5)), task("b", 10, version("v", 4)))
    (mode,) = found(owner, tick=ms(5)).schedule.modes
    assert (mode.margin, mode.margin_words) == (0, "none found, at most 11.2 % is possible")


IN_PARTS = Split(points=(ms(1),), resume=ms(1))


def parts(length, *rest):
    return replace(version("v", length, *rest), split=IN_PARTS)


HARD = {
    "a deadline of the WCET": model(
        task("a", 12, parts(2), slack=1), task("b", 6, version("v", 3), slack=1, deadline=3), task("c", 12, version())
    ),
    "alternate units": model(
        replace(task("a", 6, parts(6, "u1 u2"), deadline=12), distance=ms(6)),
        task("b", 12, version("v", 1, "u1 u2")),
        units="u1 u2",
    ),
    "a start at the end of another job": model(
        task("a", 12, parts(4, "u1 u2")),
        task("b", 12, version("v", 4, "u1 u2", after("a", 0, 0, "end"))),
        task("c", 12, version("v", 3, "u1"), offset=8),
        units="u1 u2",
    ),
    "sevenths of a millisecond": model(
        task("a", "12/7ms", version("v", "2/7ms"), slack=1),
        task("b", "12/7ms", version("v", "1/7ms"), slack=1),
        task("c", "6/7ms", version("v", "3/7ms"), slack=1),
    ),
}


@pytest.mark.parametrize("owner", HARD.values(), ids=HARD)
def test_a_margin_of_zero_is_worth_jobs_in_one_piece_and_finer_ticks(owner):
    (mode,) = found(owner).schedule.modes
    assert 0 < mode.margin <= mode.margin_bound


def test_a_margin_of_zero_is_worth_a_search_for_the_least_one():
    """The second late job begins so late that the first one of the next cycle cuts it."""
    late = parts(3, "u1", after("first", 10, 17, "end"))
    owner = model(
        task("first", 20, parts(2), offset=0, deadline=2),
        task("strict", 10, parts(2)),
        replace(task("late", 10, late, slack=1, deadline=18), distance=ms(16)),
        task("free", 20, parts(2), slack=1, deadline=21),
        chains=(chain("c", "first strict", 33, 18),),
    )
    (mode,) = found(owner).schedule.modes
    assert 0 < mode.margin < mode.margin_bound


def test_preemptive_jobs_beside_shipped_ones_have_the_margin_of_the_first_table():
    owner = PREEMPTIVE[0]
    first = found(owner, optimise=()).schedule
    (mode,) = first.modes
    kept = tuple(job for job in mode.jobs if job.task == owner.tasks[0].name)
    shipped = replace(first, modes=(replace(mode, jobs=kept),))
    (again,) = found(owner, shipped=shipped).schedule.modes
    assert {*kept} <= {*again.jobs}
    assert again.jobs == found(owner, shipped=shipped, optimise=()).schedule.modes[0].jobs


@pytest.mark.parametrize("owner", [DENSE, PREEMPTIVE[0]])
def test_the_number_of_workers_changes_no_byte(owner):
    one, two, eight = (format_schedule(found(owner, workers=Workers(count)).schedule) for count in (1, 2, 8))
    assert one == two == eight
    assert parse_schedule(one, "again.xml") == found(owner).schedule


def test_jobs_that_have_shipped_stay():
    first = found(DENSE, optimise=()).schedule
    (mode,) = first.modes
    kept = {job for job in mode.jobs if job.task in [each.name for each in DENSE.tasks[:3]]}
    shipped = replace(first, modes=(replace(mode, jobs=tuple(kept)),))
    assert kept <= set(found(DENSE, shipped=shipped).schedule.modes[0].jobs)


def test_no_job_moves_for_a_margin_beside_an_earlier_schedule():
    first = found(DENSE, optimise=()).schedule
    assert found(DENSE, near=first).schedule.modes[0].jobs == first.modes[0].jobs


@pytest.mark.parametrize("stated", ["none", ["none"], []])
def test_no_effort_can_be_asked_for(stated):
    assert from_keywords("schedule", SearchOptions, {"optimise": stated}) == {"optimise": ()}


def test_none_stands_alone():
    with pytest.raises(HalpipeError, match="'none' is not known"):
        from_keywords("schedule", SearchOptions, {"optimise": "none,chains"})


@pytest.mark.parametrize("owner", [DENSE, PREEMPTIVE[0]])
@pytest.mark.parametrize("granted", [0, 1, 2])
def test_a_search_that_is_stopped_keeps_what_was_found(owner, granted):
    """The first report of a cost of 0 comes while the margin is raised, or before."""
    costs = []
    scheduled = schedule_model(
        owner, SearchOptions(), lambda mode, made, most, cost: costs.append(cost) or costs.count(0) <= granted
    )
    assert scheduled.is_complete
    assert scheduled.unimproved
    assert scheduled.moves >= found(owner, optimise=()).moves
    assert [d for d in verify(owner, scheduled.schedule) if d.is_error] == []


def test_a_margin_on_a_finer_grid_that_cannot_be_stated_is_left_out(monkeypatch):
    """There is no margin on the grid of 2 ms, and one on a finer grid. Of the usual grid, it is an error."""
    either = task("a", 10, version("v", 4), version("long", 8))
    owner = model(either, task("b", 10, version("v", 4)))
    plain = one_mode._WholeJobs._stated

    def refusing(is_refused):
        def stated(search, tick, expansion=None, **form):
            if is_refused(tick, expansion):
                raise HalpipeError(TOO_LARGE("has too many ticks"))
            return plain(search, tick, expansion, **form)

        monkeypatch.setattr(one_mode._WholeJobs, "_stated", stated)
        return found(owner, budget=50).schedule.modes[0]

    assert refusing(lambda *_: False).margin > 0
    assert refusing(lambda tick, _: tick is not None).margin == 0
    with pytest.raises(HalpipeError):
        refusing(lambda tick, expansion: tick is None and expansion is not None)  # first the valid one is found


@pytest.mark.parametrize("aims", [(Objective.MARGIN,), (Objective.MARGIN, Objective.COST), (Objective.COST,), None, ()])
def test_jobs_start_at_multiples_of_a_tick_whatever_is_optimised(aims):
    """On the natural grid of 0.5 ms, the margin of these jobs is larger than on that of 2 ms."""
    owner = model(task("a", 20, version("v", 3)), task("b", 20, version("v", 4)), task("c", 20, version("v", "4.5ms")))
    mode = found(owner, budget=200, optimise=aims, tick=ms(2)).schedule.modes[0]
    assert [str(job.start) for job in mode.jobs if job.start % ms(2)] == []


@pytest.mark.parametrize(("spare", "efforts"), [(10**6, (25_000, 10**6, 30_000)), (1000, (100, 1000, 1000))])
def test_tries_for_the_margin_of_preemptive_jobs_have_their_efforts(monkeypatch, spare, efforts):
    """Of five jobs: a fortieth or twenty tables, on a finer tick all of it, and up to six thousand tables for any."""
    owner = model(task("short", 5, version("v", 1), slack=1), task("long", 20, split(version("v", 10), points(3, 6))))
    asked = []

    def note(_search, _begin, *given):
        asked.append(given)
        return NO_WIDER

    monkeypatch.setattr(one_mode._Search, "widened", note)
    monkeypatch.setattr(one_mode._SplitJobs, "_any_margin", note)
    whole = []
    monkeypatch.setattr(one_mode._WholeJobs, "raised", lambda *_, is_fine: whole.append(is_fine) or NO_WIDER)
    monkeypatch.setattr(one_mode, "least_margin", lambda _: Fraction(0))
    monkeypatch.setattr(one_mode, "largest_margin", lambda *_: Fraction(1))
    assert found(owner, budget=300, spare=spare).schedule.modes[0].status is Status.VALID
    plain, finer, any_of_them = asked
    assert whole == [True]  # in one piece, on the finer tick as well
    assert (plain[3:], finer[3:], any_of_them[0]) == ((1, efforts[0]), (5, efforts[1], "finer"), efforts[2])


@pytest.mark.parametrize(("cost", "jobs"), [(0, ("some",)), (3, None)])
def test_the_least_margin_is_tried_with_all_the_effort_while_a_schedule_is_known(cost, jobs):
    """What is told is that it costs nothing, as the schedule does that is there."""
    told, begun = [], []

    def begin(*given):
        begun.append(given)
        return lambda effort, tell: tell(7, 5) or Outcome(("some",), cost, effort, stopped=True)

    search = SimpleNamespace(kept=None, name="m", budget=99, on_progress=lambda *given: told.append(given))
    found = one_mode._SplitJobs._any_margin(search, begin, 40, 10)
    assert (begun, told) == ([(STEP, len(ROUNDS), None)], [("m", 17, 99, 0)])
    assert found == Wider(jobs, STEP, 40, stopped=True)


def test_a_margin_keeps_the_versions_that_were_chosen():
    """But for tasks that demand others, and those of which no job is there: their jobs depend on them."""
    both = version("long", 4), version("short", 2)
    owner = model(
        task("a", 20, *both),
        task("b", 10, *both),
        task("asks", 20, version("v", 1, "u1", after("h", 0, 9)), version("w", 2, "u1", after("h", 0, 9))),
        task("h", None, *both),
    )
    expansion = expand(owner, owner.modes[0])
    chosen = {("a", 0): "long", ("b", 0): "short", ("b", 1): "long", ("asks", 0): "v", ("h", 0): "short"}
    jobs = [job(owner, name, index, 0, "u1", made) for (name, index), made in chosen.items()]

    def left(jobs):
        kept = one_mode._with_versions_of(jobs, expansion)
        return {active.name: [version.name for version in active.versions] for active in kept.tasks}

    every = ["long", "short"]
    assert left(jobs) == {"a": ["long"], "b": every, "asks": ["v", "w"], "h": ["short"]}
    assert left(jobs[1:2]) == {"a": every, "b": ["short"], "asks": ["v", "w"], "h": every}
    assert one_mode._with_versions_of(jobs[1:3], expansion) is expansion
    alone = model(task("a", 20, *both))
    alone_kept = one_mode._with_versions_of(jobs[:1], expand(alone, alone.modes[0]))
    assert [version.name for active in alone_kept.tasks for version in active.versions] == ["long"]


def test_deadlines_of_longer_jobs_are_those_of_the_units_that_they_take():
    """On u2, where interrupts of 2 ms come, a longer job has more to give back than on u1: there it would be late."""
    first = task("a", 24, version("v", 4), slack=1)
    cut = replace(version("v", 2, "u1 u2"), split=Split(points=(ms(1),)))
    system = interrupts(model(first, task("b", 8, cut, slack=1, deadline=4), units="u1 u2"), "u2", (5, 2))
    assert margins(system, budget=60)
