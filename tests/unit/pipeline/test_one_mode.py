"""Search of one mode: its tries for a margin, with how much effort, and which of several results it keeps."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest

from halpipe.models import ModeSchedule, Schedule, Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import one_mode
from halpipe.pipeline.solve.kernel import widen
from halpipe.pipeline.solve.kernel.warmstart import Earlier
from halpipe.pipeline.solve.kernel.widen import LATER_ROUNDS, NO_WIDER, ROUNDS, Wider
from halpipe.pipeline.solve.optimise import POLISH_BUDGET
from halpipe.pipeline.solve.schedule import LEAST_MOVES, UNBOUNDED, SearchOptions
from support import job, mode, model, ms, task, version

MARGIN, COST = Objective.MARGIN, Objective.COST


def search_of(system, kind=one_mode._WholeJobs, earlier=None, number=0, **options):
    """The search of the first mode of a system."""
    chosen, expansion = SearchOptions(**options), expand(system, system.modes[0])
    return kind(system, expansion, chosen, number, lambda *_: True, earlier or Earlier())


def pair(*more, **parts):
    return model(task("a", 10, version("v", 2, "u1 u2")), task("b", 20, version("v", 4)), *more, units="u1 u2", **parts)


# ------------------------------------------------------------------------------------------------ margins


def tried(results, margin=0, most=1, polish=None):
    """Return what comes of tries with these results, and what each was told to be the jobs placed before."""
    told = []

    def trying(result):
        return lambda placed: told.append(placed) or result

    search = SimpleNamespace(margin_of=lambda _: Fraction(margin), most_margin=Fraction(most), polish=polish)
    return one_mode._Search.first_wider(search, (), 100, map(trying, results)), told


NONE, SOME = Wider(None, Fraction(0), 5, stopped=False), Wider(("job",), Fraction(1, 4), 7, stopped=False)


@pytest.mark.parametrize(
    ("results", "options", "found", "told"),
    [
        ([NONE, NONE, SOME, NONE], {}, replace(SOME, moves=17), [100, 105, 110]),
        ([NONE, NONE], {}, replace(NONE, moves=10), [100, 105]),
        ([SOME, NONE], {}, SOME, [100]),
        ([NONE, SOME], {"margin": "1/2"}, NONE, [100]),  # some margin is enough
        ([SOME, NONE], {"margin": 1}, NO_WIDER, []),  # the best possible
        ([NONE, SOME], {"polish": "wanted"}, NONE, [100]),
        ([replace(NONE, stopped=True), SOME], {}, replace(NONE, stopped=True), [100]),
    ],
)
def test_a_margin_of_zero_is_tried_to_be_raised_again_with_the_next_effort(results, options, found, told):
    assert tried(results, **options) == (found, told)


@pytest.mark.parametrize(
    ("options", "rounds"),
    [
        ({}, ROUNDS),
        ({"optimise": (MARGIN,)}, (*ROUNDS, *LATER_ROUNDS)),
        ({"optimise": (MARGIN,), "budget": 3000}, (*ROUNDS, 3000)),
        ({"optimise": (MARGIN,), "budget": 2999}, ROUNDS),
    ],
)
@pytest.mark.parametrize(("moves", "effort"), [(19, 50), (1000, 50), (1020, 51)])
def test_a_margin_that_is_asked_for_has_more_rounds_up_to_the_budget(monkeypatch, options, rounds, moves, effort):
    """Its effort is what is stated, or the twentieth part of the moves before."""
    given = []
    monkeypatch.setattr(widen, "widened", lambda *each: given.append(each) or NO_WIDER)
    system = pair()
    told, search = [], search_of(system, **options)
    search = replace(search, on_progress=lambda *each: told.append(each))
    jobs = tuple(job(system, *each) for each in (("a", 0, 0, "u1"), ("a", 1, 10, "u1"), ("b", 0, 4, "u1")))
    assert search.widened("begin", jobs, moves, 99, 3, 50) is NO_WIDER
    [(begin, unit, (margin, most), its, tell, kept, its_rounds)] = given
    assert (begin, unit, its, kept, its_rounds) == ("begin", 3, effort, None, rounds)
    assert (margin, most) == (Fraction(1, 2), search.most_margin)  # of b, which has 6 ms up to the next job of a
    tell(8, 2)
    assert told == [("all", moves + 8, 99, 2)]


def test_of_several_results_the_last_of_the_best_is_kept_unless_it_is_worse_than_the_first():
    told = []
    judge = SimpleNamespace(
        worth=lambda jobs: SimpleNamespace(values=jobs), keeps=lambda first, worth: worth.values[1] < 9
    )
    polish = SimpleNamespace(judge=judge, first=[], on_better=lambda worth: told.append(worth.values))
    search = SimpleNamespace(polish=polish)
    others = [(4, 9), None, (5, 4), (6, 0), (5, 4), (), (4, 8)]
    assert one_mode._Search.better_of(search, (5, 5), others) == (4, 8)
    assert told == [(5, 4), (5, 4), (4, 8)]
    assert [worth.values for worth in polish.first] == [(5, 5)]
    assert one_mode._Search.better_of(search, (5, 5), [None, (6, 1)]) == (5, 5)


@pytest.mark.parametrize(
    ("optimise", "shipped", "widens", "spare"),
    [
        (None, False, True, 80),
        (None, True, True, 80),
        ((), False, False, 80),
        ((MARGIN, COST), False, True, 8000),
        ((MARGIN,), True, False, 8000),
        ((COST, MARGIN), False, False, 8000),
    ],
)
def test_the_margin_is_raised_first_where_it_comes_first_and_nothing_has_to_stay(optimise, shipped, widens, spare):
    system = pair()
    table = ModeSchedule(name="all", hyperperiod=ms(20), status=Status.VALID, jobs=(job(system, "b", 0, 0, "u1"),))
    plan = Schedule(model="m", modes=(table,)) if shipped else None
    search = search_of(system, optimise=optimise, shipped=plan, spare=80)
    assert (search.widens, search.spare) == (widens, spare)


# ------------------------------------------------------------------------------------------------ what it depends on


def test_each_mode_and_attempt_has_a_seed_of_its_own():
    seeds = {
        search_of(pair(), seed=seed, attempt=attempt, number=number).seed
        for seed in (1, 2)
        for attempt in (0, 1, 2)
        for number in (0, 1, 2)
    }
    assert len(seeds) == 18
    assert search_of(pair(), seed=5).seed == 5


def test_units_of_other_modes_count_where_enough_of_them_are_left_for_some_version():
    gang = task("g", 10, version("v", 1, "u1 u2 u3", gang=2))
    system = pair(gang, task("c", 10, version("v", 1, "u2")))
    pins = {
        "a": {1: frozenset({"u2", "u9"})},
        "b": {1: frozenset({"u2"})},  # which it cannot use here
        "c": {2: frozenset({"u2"})},  # of another gang
        "g": {1: frozenset({"u1"}), 2: frozenset({"u1", "u3"})},
        "gone": {1: frozenset({"u1"})},
    }
    search = search_of(replace(system, units=model(units="u1 u2 u3").units), earlier=Earlier(pins=pins))
    assert search.pinned == {name: pins[name] for name in ("a", "g")}
    few = search_of(system, earlier=Earlier(pins={"g": {2: frozenset({"u1", "u9"})}}))
    assert few.pinned == {}


def test_shipped_jobs_count_in_their_mode_and_of_tasks_that_run():
    system = pair(modes=[mode("all", pair().tasks[:1]), mode("other", pair().tasks)])
    jobs = [job(system, "a", 0, 3, "u1"), job(system, "b", 0, 5, "u1"), job(system, "a", 1, 15, "u2")]
    tables = [
        ModeSchedule(name=name, hyperperiod=ms(20), status=Status.VALID, jobs=found)
        for name, found in (("all", tuple(jobs[:2])), ("other", tuple(jobs[2:])))
    ]
    search = search_of(system, shipped=Schedule(model="m", modes=tuple(tables)))
    assert search.shipped == {("a", 0): jobs[0]}
    assert str(search.tick) == "1ms"  # the start of the shipped job, which does not lie on the grid of 2 ms
    assert search_of(system).tick is None
    assert search_of(system, tick=ms(5), shipped=Schedule(model="m", modes=tuple(tables))).tick == ms(5)


@pytest.mark.parametrize(
    ("options", "budget", "soon"),
    [({}, 40_000, 5000), ({"budget": 80}, 160, 20), ({"budget": UNBOUNDED}, 2 * UNBOUNDED, 5000)],
)
def test_a_table_that_splits_no_job_is_looked_for_after_an_eighth_of_the_usual_effort(options, budget, soon):
    search = search_of(pair(), one_mode._SplitJobs, **options)
    assert (search.budget, search.soon) == (budget, soon)


@pytest.mark.parametrize(
    ("options", "least"),
    [({}, LEAST_MOVES), ({"budget": 7}, LEAST_MOVES), ({"budget": UNBOUNDED}, LEAST_MOVES)],
)
def test_the_least_moves_are_those_without_a_stated_budget(options, least):
    search = search_of(pair(), **options)
    assert (search.least, search.budget) == (least, 2 * options["budget"] if options else LEAST_MOVES)


@pytest.mark.parametrize(
    ("options", "job_count", "may_ask"),
    [
        ({}, 200, True),
        ({}, 201, False),
        ({"budget": 5}, 3, False),
        ({"budget": UNBOUNDED}, 3, True),
        ({"tick": ms(1)}, 3, False),
    ],
)
def test_the_exact_engine_takes_turns_in_small_modes_whose_end_and_grid_are_not_stated(options, job_count, may_ask):
    tasks = [task(f"t{n}", 10, version("v", "10us")) for n in range(job_count)]
    assert search_of(model(*tasks), **options).may_ask is may_ask


@pytest.mark.parametrize(
    ("options", "polish"), [({}, 4000 * 3), ({"budget": 50}, 100), ({"budget": UNBOUNDED}, 4000 * 3)]
)
def test_a_table_is_improved_for_so_many_tables_or_moves_of_its_tasks(monkeypatch, options, polish):
    """Of two tasks with three jobs, unless a budget is stated."""
    made = []

    def begun(*given):
        made.append(given[4])
        return SimpleNamespace(run=lambda: None)

    monkeypatch.setattr("halpipe.pipeline.solve.edf.search.Search", begun)
    search = search_of(pair(), one_mode._SplitJobs, **options)
    search._searched(SimpleNamespace(works=[1, 2]), None, None, 77)
    assert (made[0].budget, made[0].polish) == (77, polish)
    search._searched(SimpleNamespace(works=[1] * 100), None, None, 77)
    assert made[1].polish == (polish if options.get("budget") == 50 else POLISH_BUDGET * 100)
