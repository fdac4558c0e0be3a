"""Earliest deadline first over parts: the tables that it makes, what verify says of them, and what it refuses."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from edf_reference_jobs import Resources
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, milliseconds
from halpipe.importers.native import read_model
from halpipe.models import Anchor, Binding, Interrupt, Split, Status, Unit
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve import codes, one_mode
from halpipe.pipeline.solve import schedule as solve
from halpipe.pipeline.solve.edf.fixed import Claim
from halpipe.pipeline.solve.edf.plans import Moves
from halpipe.pipeline.solve.edf.search import Search
from halpipe.pipeline.solve.edf.trials import Effort
from halpipe.pipeline.solve.edf.works import works_of
from halpipe.pipeline.solve.integers import Draws
from halpipe.pipeline.solve.kernel.widen import NO_WIDER
from halpipe.pipeline.solve.optimise import polish_of
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify
from support import access, after, chain, model, ms, task, version

EXAMPLE = Path(__file__).parents[2] / "fixtures" / "split"


def split(made, *points, **rest):
    """Let a version be interrupted at points in milliseconds, or anywhere."""
    times = tuple(milliseconds(Fraction(str(p))) for p in points if p != "anywhere")
    return replace(made, split=Split(points=times, anywhere="anywhere" in points, **rest))


def scheduled(owner, optimise=(), **options):
    """Return the first valid schedule: the margin, which is raised by default, has tests of its own."""
    found = schedule_model(owner, SearchOptions(budget=2000, optimise=optimise, **options), lambda *_: True)
    assert not [d for d in verify(owner, found.schedule) if d.is_error] or not found.is_complete
    return found


def parts(found, name, index=0):
    [job] = [j for j in found.schedule.modes[0].jobs if (j.task, j.index) == (name, index)]
    return [(str(start), str(end)) for start, end in job.occupations()]


def short_beside_long(*points, **rest):
    """A short task that a long one in one piece excludes."""
    return model(
        task("short", 5, version("v", 1), slack=1),
        task("long", 20, split(version("v", 10), *points, **rest), slack=1),
    )


def test_a_long_job_makes_room_at_its_split_points():
    found = scheduled(short_beside_long(3, 6))
    assert found.is_complete
    assert parts(found, "long") == [("1ms", "7ms"), ("8ms", "12ms")]


def test_in_one_piece_it_has_no_room():
    with pytest.raises(HalpipeError) as refused:
        scheduled(short_beside_long())
    assert "HAL0431" in {d.code for d in refused.value.diagnostics}


def test_a_piece_that_would_keep_another_from_its_latest_start_waits():
    """The core is idle before the long piece, as in the example of MODEL 8."""
    owner = model(
        task("short", 10, version("v", 3), slack=Fraction(1, 5)),
        task("long", 40, split(version("v", 12), 6), slack=1),
    )
    assert scheduled(owner).is_complete


def test_anywhere_is_cut_where_the_other_comes():
    owner = short_beside_long("anywhere", max_gaps=3)
    found = scheduled(owner)
    assert found.is_complete
    assert len(parts(found, "long")) > 1


def test_gaps_are_counted():
    """Between two short jobs there are at most 8 ms, so that 17 ms need three parts."""

    def beside_short(gaps):
        long = split(version("v", 17), "anywhere", max_gaps=gaps, min_part=milliseconds(1))
        return model(task("short", 5, version("v", 1), slack=1), task("long", 40, long, slack=1))

    assert len(parts(scheduled(beside_short(2)), "long")) == 3
    with pytest.raises(HalpipeError, match="in one go"):
        scheduled(beside_short(1))


def test_no_part_is_shorter_than_stated():
    owner = short_beside_long("anywhere", max_gaps=4, min_part=milliseconds(2))
    found = scheduled(owner)
    [job] = [j for j in found.schedule.modes[0].jobs if j.task == "long"]
    assert all(p.executed_to - p.executed_from >= milliseconds(2) for p in job.parts)


def test_going_on_costs_what_it_costs():
    found = scheduled(short_beside_long(5, resume=milliseconds(Fraction(1, 2))))
    [job] = [j for j in found.schedule.modes[0].jobs if j.task == "long"]
    lengths = [end - start for start, end in job.occupations()]
    assert lengths == [milliseconds(5), milliseconds(Fraction(11, 2))]


def test_interrupts_make_parts_longer():
    owner = model(task("short", 5, version("v", 1), slack=1), task("long", 20, split(version("v", 6), 2, 4), slack=1))
    unit = Unit(name="u1", interrupts=(Interrupt(name="i", distance=milliseconds(10), wcet=milliseconds(1)),))
    found = scheduled(replace(owner, units=(unit,)))
    assert found.is_complete
    assert {
        end - start for j in found.schedule.modes[0].jobs if j.task == "short" for start, end in j.occupations()
    } == {milliseconds(2)}


def test_a_phase_of_one_keeps_the_others_from_the_resource():
    owner = model(
        task("a", 10, split(version("v", 4, "u1", access("m", 0, 2)), 2), slack=1),
        task("b", 10, split(version("v", 4, "u2", access("m", 0, 2)), 2), slack=1),
        units="u1 u2",
        resources="m",
    )
    found = scheduled(owner)
    starts = sorted(j.start for j in found.schedule.modes[0].jobs)
    assert found.is_complete
    assert starts[1] - starts[0] >= milliseconds(2)


def test_a_gang_pauses_together():
    owner = model(
        task("short", 5, version("v", 1, "u1"), slack=1),
        task("both", 20, split(version("v", 8, "u1 u2", gang=2), 3, 6), slack=1),
        units="u1 u2",
    )
    found = scheduled(owner)
    [job] = [j for j in found.schedule.modes[0].jobs if j.task == "both"]
    assert found.is_complete
    assert sorted(job.units) == ["u1", "u2"]


def test_windows_hold_in_a_pipeline():
    owner = model(
        task("a", 10, split(version("v", 6, "u1"), 3), slack=1),
        task("b", 10, split(version("v", 6, "u2", after("a", 0, 2, "end")), 3), slack=1),
        task("c", 10, version("v", 3, "u1", after("b", 0, 5, "end")), slack=1),
        units="u1 u2",
    )
    assert scheduled(owner).is_complete


def test_bound_tasks_stay_on_their_units_in_all_modes():
    tasks = [task(f"t{n}", 10, split(version("v", 3, "u1 u2"), 1), slack=1) for n in range(4)]
    owner = model(*(replace(t, binding=Binding.SYSTEM) for t in tasks), units="u1 u2")
    one, two = replace(owner.modes[0], name="one"), replace(owner.modes[0], name="two", runs=owner.modes[0].runs[1:])
    found = scheduled(replace(owner, modes=(one, two)))
    units = {(j.task, j.units) for table in found.schedule.modes for j in table.jobs}
    assert found.is_complete
    assert len(units) == 4
    assert {used for _, used in units} == {("u1",), ("u2",)}


def test_shorter_chains_together():
    owner = model(
        task("a", 10, split(version("v", 4), 2), slack=1),
        task("b", 20, split(version("v", 4), 2), slack=1),
        task("c", 10, version("v", 1), slack=1),
        chains=(chain("a-c", "a b c"), chain("c-b", "c b")),
    )
    first, better = scheduled(owner), scheduled(owner, optimise=(Objective.CHAINS, Objective.COST))
    before, after_ = first.schedule.modes[0].chains, better.schedule.modes[0].chains
    sums = [sum(found.reaction.ns + found.age.ns for found in chains) for chains in (before, after_)]
    assert sums[1] < sums[0]
    assert better.schedule.modes[0].cost.total <= first.schedule.modes[0].cost.total


def test_a_window_longer_than_the_hyperperiod_is_met():
    """b starts 37 ms after a start of a, which is two hyperperiods before it, or three."""
    owner = model(
        task("a", 20, split(version("v", 6, "u1"), "anywhere", max_gaps=1), slack=1, offset=6),
        task("b", 20, split(version("v", 4, "u2", after("a", 37, 37)), "anywhere", max_gaps=1), offset=10),
        units="u1 u2",
    )
    assert scheduled(owner).is_complete


def test_a_poll_may_slip_as_far_as_its_arrivals_allow():
    """One poll in each hyperperiod: it is never further from the one before, wherever in its slack it starts."""
    poll = replace(task("poll", 24, split(version("v", 4, "u1"), 2), slack=1, offset=22), distance=milliseconds(25))
    late = task("late", 24, version("v", 2, "u2", after("poll", 24, 25, "end")), offset=17)
    assert scheduled(model(replace(poll, deadline=milliseconds(32)), late, units="u1 u2")).is_complete


def test_a_job_that_had_to_wait_for_the_one_before_it_is_not_begun_in_the_past():
    """Both jobs of `often` want to start within 1 ms of each other, and there is one unit."""
    owner = model(
        task("rare", 20, version("v", 1, "b"), offset=0),
        task("often", 10, split(version("v", 2, "a", after("rare", 1, 2, "end")), 1), deadline=15, slack=1),
        units="a b",
    )
    found = solve.schedule_model(owner, SearchOptions(budget=300), lambda *_: True)
    assert not found.is_complete, [d.message for d in verify(owner, found.schedule)]


def test_the_example_is_found():
    owner = read_model(str(next(EXAMPLE.glob("*model*.xml"))))
    assert scheduled(owner).is_complete


def test_same_bytes_for_any_number_of_workers():
    from halpipe.exporters.native import format_schedule
    from halpipe.pipeline.solve.workers import Workers

    owner = short_beside_long(3, 6)
    made = [format_schedule(scheduled(owner, workers=Workers(n)).schedule) for n in (1, 2, 8)]
    assert made[0] == made[1] == made[2]


@pytest.mark.parametrize("tick", ["1ms", "0.5ms"])
def test_a_coarser_grid_is_to_the_safe_side(tick):
    owner = model(
        task("short", 5, version("v", "0.9ms"), slack=1),
        task("long", 20, split(version("v", "8.3ms"), "2.7", "5.4"), slack=1),
    )
    assert scheduled(owner, tick=Duration.parse(tick)).is_complete


def test_a_task_on_demand_that_nothing_demands_needs_no_option():
    """Its window has no whole tick in it, which would be refused of a task that runs."""
    asked = task("h", None, version("v", 1, "u1", after("short", "1.2ms", "1.8ms")))
    owner = short_beside_long(3, 6)
    found = scheduled(model(asked, *owner.tasks), tick=ms(1))
    assert found.is_complete
    assert {job.task for job in found.schedule.modes[0].jobs} == {"short", "long"}


# ------------------------------------------------------------------------------------------------- what it refuses


def refused(owner, **options):
    with pytest.raises(HalpipeError) as failure:
        scheduled(owner, **options)
    return [d.code for d in failure.value.diagnostics]


def placed(found):
    return {(j.task, j.index): j for table in found.schedule.modes for j in table.jobs}


def test_split_jobs_stay_as_they_shipped_and_others_are_placed_around_them():
    owner = short_beside_long(3, 6)
    shipped = scheduled(owner)
    grown = model(*owner.tasks, task("new", 10, split(version("v", 2), 1), slack=1))
    for seed in (5, 6):
        found = scheduled(grown, shipped=shipped.schedule, seed=seed)
        assert found.is_complete
        assert placed(shipped).items() <= placed(found).items()


def test_a_split_task_that_has_changed_is_placed_anew_and_reported():
    owner = short_beside_long(3, 6)
    shipped = scheduled(owner)
    longer = model(owner.task("short"), task("long", 20, split(version("v", 11), 3, 6), slack=1))
    found = scheduled(longer, shipped=shipped.schedule)
    assert found.is_complete
    assert [d.path for d in found.diagnostics if d.code == codes.CANNOT_STAY.id] == ['mode "all" task "long"']
    assert {k: j for k, j in placed(found).items() if k[0] == "short"}.items() <= placed(shipped).items()


def test_what_begins_in_a_gap_of_a_job_that_stays_ends_in_it():
    """The core is free in [1, 3) ms beside the gap of 2 ms only, so that the new job must fit one of them."""
    long = task("long", 20, split(version("v", 10), 5), slack=1)
    shipped = scheduled(model(long, task("mid", 20, version("v", 3, "u1"), slack=1)))
    (table,) = shipped.schedule.modes
    left = replace(table, jobs=tuple(job for job in table.jobs if job.task == "long"))
    found = scheduled(
        model(long, task("new", 20, split(version("v", 4), 2), slack=1)),
        shipped=replace(shipped.schedule, modes=(left,)),
    )
    assert found.is_complete
    assert placed(found)["long", 0] == placed(shipped)["long", 0]


def test_split_jobs_that_collide_where_they_stay_are_not_found():
    owner = short_beside_long(3, 6)
    shipped = scheduled(owner).schedule
    [table] = shipped.modes
    there = next(job for job in table.jobs if job.task == "long")
    moved = [
        replace(j, start=there.start, end=there.start + (j.end - j.start)) if j.index == 0 else j for j in table.jobs
    ]
    jobs = tuple(there if job.task == "long" else job for job in moved)
    found = scheduled(owner, shipped=replace(shipped, modes=(replace(table, jobs=jobs),)))
    assert not found.is_complete


def test_a_search_that_was_stopped_goes_on_to_the_same_bytes():
    """Stopped at every so many tables, and gone on with each time, as the one that was never stopped."""
    from halpipe.exporters.native import format_schedule
    from halpipe.pipeline.solve.schedule import schedule_model as search

    owner = model(
        task("a", 10, split(version("v", 4, "u1 u2"), 2), slack=1),
        task("b", 20, split(version("v", 4, "u1 u2"), 2), slack=1),
        task("c", 10, version("v", 1, "u1 u2"), slack=1),
        chains=(chain("a-c", "a b c"), chain("c-b", "c b")),
        units="u1 u2",
    )
    whole = search(owner, SearchOptions(budget=4000, optimise=(Objective.CHAINS, Objective.COST)), lambda *_: True)
    kept = Keeper()
    for tables in (2, 5, 30, 10**9):
        left = iter(range(tables))
        options = SearchOptions(budget=4000, optimise=(Objective.CHAINS, Objective.COST), keeper=kept)
        found = search(owner, options, lambda *_, left=left: next(left, None) is not None)
        assert found.unimproved == (tables < 10**9)
    assert kept.notes > 30
    assert format_schedule(found.schedule) == format_schedule(whole.schedule)


class Keeper:
    """Keeps in memory what a checkpoint keeps in its file, of one search."""

    def __init__(self):
        self.facts = {}
        self.notes = 0

    def stage(self, _):
        return self

    def note(self, facts):
        self.notes += 1
        self.facts = {name: values[:] for name, values in facts.items()}

    def noted(self):
        return self.facts


def test_what_is_near_is_searched_for_where_it_cannot_stay():
    owner = short_beside_long(3, 6)
    first = scheduled(owner).schedule
    longer = model(owner.task("short"), task("long", 20, split(version("v", 11), 3, 6), slack=1))
    assert scheduled(owner, near=first).schedule.modes[0].jobs == first.modes[0].jobs
    assert scheduled(longer, near=first).is_complete


def test_more_parts_than_are_allowed_are_refused_as_they_are_made(monkeypatch):
    owner = short_beside_long(3, 6)
    made = sum(max(1, len(job.parts)) for job in scheduled(owner).schedule.modes[0].jobs)
    monkeypatch.setattr("halpipe.pipeline.solve.edf.trials.MAX_PARTS", made)
    assert scheduled(owner).is_complete
    monkeypatch.setattr("halpipe.pipeline.solve.edf.trials.MAX_PARTS", made - 1)
    assert refused(owner) == [codes.TOO_MANY_PARTS.id]


def test_the_exact_engine_places_preemptive_jobs_in_one_piece_and_proves_nothing_without_preemption():
    assert refused(short_beside_long(3, 6), engine="exact") == [codes.NOT_FOUND.id]


def test_the_grid_of_regulators_is_for_whole_jobs():
    from halpipe.pipeline.solve.quantise import BurstGrid

    fields = dict.fromkeys(BurstGrid.__dataclass_fields__)
    grid = BurstGrid(**fields | {"name": "g", "window": milliseconds(1)})
    assert refused(short_beside_long(3, 6), grid=grid) == [codes.GRID_WHOLE.id]


# ------------------------------------------------------------------------------------------------- its parts


def test_resources_say_until_when_there_is_no_room():
    taken = Resources((2,))
    taken.take([Claim(0, 0, 10, 1), Claim(0, 4, 6, 1)])
    assert taken.collision([Claim(0, 0, 4, 1)]) is None
    assert taken.collision([Claim(0, 3, 5, 1)]) == 6
    assert taken.collision([Claim(0, 0, 4, 2)]) == 10
    taken.give_back([Claim(0, 4, 6, 1)])
    assert taken.collision([Claim(0, 3, 5, 1)]) is None


def test_claims_of_one_piece_must_leave_each_other_room():
    """Interrupts stretch phases beyond the begin of the next ones of the same job; others come first or last."""
    free = Resources((2, 1))
    assert free.collision([Claim(0, 0, 5, 1), Claim(0, 4, 8, 1)]) is None
    assert free.collision([Claim(0, 0, 5, 2), Claim(0, 4, 8, 1)]) == 5
    assert free.collision([Claim(0, 0, 5, 2), Claim(1, 4, 8, 1)]) is None


def test_draws_are_the_same_everywhere():
    """The first number of splitmix64 from zero is published: 0xE220A8397B1DCDAF."""
    assert Draws(0).below(2**64) == 0xE220A8397B1DCDAF


def test_pieces_are_rounded_up_one_by_one():
    owner = model(task("a", 10, split(version("v", "2.5ms"), "1.2"), slack=1))
    expansion = expand(owner, owner.modes[0])
    ticks = natural_tick(expansion), milliseconds(1)
    [exact], [coarse] = (works_of(owner, expansion, tick).works for tick in ticks)
    assert ticks[0] == milliseconds(Fraction(1, 10))
    assert exact.ways[0].ends == (12, 25)
    assert coarse.ways[0].ends == (2, 4)


def ends_where_it_begins(*points):
    """A job that only fits before its predecessor, and there only where it ends as that one begins."""
    row = replace(after("first", 0, 8), to=Anchor.END)
    return model(
        task("first", 30, version("v", 6), slack=1),
        task("second", 30, split(version("v", 3, "u1", row), *points), slack=1),
    )


@pytest.mark.parametrize("limits", [{"budget": 20}, {"budget": None}, {"budget": solve.UNBOUNDED}])
def test_what_splitting_makes_hard_to_find_is_found_in_one_piece(limits):
    owner = ends_where_it_begins(1, 2)
    found = schedule_model(owner, SearchOptions(optimise=(), **limits), lambda *_: True)
    assert found.is_complete
    jobs = {job.task: job for job in found.schedule.modes[0].jobs}
    assert jobs["second"].end == jobs["first"].start
    assert found.schedule.modes[0].margin_bound is not None


def test_of_two_searches_the_better_placement_is_kept(monkeypatch):
    """Both without a valid one: what is saved is the one with less excess."""
    owner = ends_where_it_begins(1, 2)
    first, second = owner.tasks
    late = replace(owner, tasks=(replace(first, offset=ms(0), slack=0), replace(second, offset=ms(15), slack=0)))
    plain, made = one_mode._SplitJobs._searched, []

    def searched(*given):
        made.append(replace(plain(*given), excess=len(made) + 1))
        return made[-1]

    monkeypatch.setattr(one_mode._SplitJobs, "_searched", searched)
    found = solve.schedule_model(late, SearchOptions(optimise=(), budget=100), lambda *_: True)
    assert found.schedule.modes[0].jobs == made[0].jobs
    assert found.moves == made[1].placed


def test_what_one_piece_does_not_find_is_searched_on():
    """With a clock alone the search of what cannot be ends when the clock says so."""
    owner = ends_where_it_begins(1, 2)
    first, second = owner.tasks
    late = replace(owner, tasks=(replace(first, offset=ms(0), slack=0), replace(second, offset=ms(15), slack=0)))
    asked = []

    def go_on(*done):
        asked.append(done)
        return len(asked) < 4000

    found = solve.schedule_model(late, SearchOptions(optimise=(), budget=solve.UNBOUNDED), go_on)
    assert (found.stopped, len(asked) >= 4000) == (True, True)
    assert found.schedule.modes[0].status is Status.NOT_FOUND


def test_what_cannot_be_stated_in_one_piece_is_searched_on_with_splits(monkeypatch):
    def found(_):
        raise HalpipeError(codes.NO_OPTION("cannot run in one piece"))

    monkeypatch.setattr(one_mode._WholeJobs, "found", found)
    late = ends_where_it_begins(1, 2)
    first, second = late.tasks
    late = replace(late, tasks=(replace(first, offset=ms(0), slack=0), replace(second, offset=ms(15), slack=0)))
    missed = solve.schedule_model(late, SearchOptions(optimise=(), budget=100), lambda *_: True)
    assert missed.schedule.modes[0].status is Status.NOT_FOUND


def test_a_margin_for_which_there_are_too_many_parts_is_not_granted(monkeypatch):
    """Nor one for which a task has no option left; the valid table stays."""
    owner, plain = short_beside_long(3, 6), one_mode._SplitJobs._mode
    first = schedule_model(owner, SearchOptions(budget=50, optimise=()), lambda *_: True).schedule

    def refused(search, expansion, growth, **fine):
        if growth > 1:
            raise HalpipeError(codes.TOO_MANY_PARTS("has too many parts"))
        return plain(search, expansion, growth, **fine)

    def stuck(search, expansion, growth, **fine):
        mode = plain(search, expansion, growth, **fine)
        return mode if growth == 1 else replace(mode, works=tuple(replace(work, ways=()) for work in mode.works))

    for instead in (refused, stuck):
        monkeypatch.setattr(one_mode._SplitJobs, "_mode", instead)
        monkeypatch.setattr(one_mode._WholeJobs, "raised", lambda *_, **__: NO_WIDER)
        found = schedule_model(owner, SearchOptions(budget=50), lambda *_: True)
        assert found.schedule.modes[0].jobs == first.modes[0].jobs


@pytest.mark.parametrize(
    ("aim", "polish", "tries"),
    [(Objective.JITTER, 0, 0), (Objective.JITTER, 5, 5), (Objective.CHAINS, 100, 100), (Objective.CHAINS, 101, 150)],
)
def test_a_valid_table_is_improved_until_the_effort_is_spent(monkeypatch, aim, polish, tries):
    """A plan that is the one before counts as a job placed; where chains come first, fifty are tried in a row."""
    owner = replace(short_beside_long(3, 6), chains=(chain("c", "short long"),))
    mode = works_of(owner, expand(owner, owner.modes[0]), ms(1))
    tried = []
    monkeypatch.setattr(Moves, "varied", lambda _, plan: tried.append(plan) or plan)
    wanted = polish_of(owner, mode.expansion, (aim,), None, 1, lambda _: None, None)
    plain = Search(mode, owner, 1, {}, Effort(100, 0, lambda *_: True)).run()
    found = Search(mode, owner, 1, {}, Effort(100, polish, lambda *_: True), wanted).run()
    assert (len(tried), found.jobs, found.stopped, found.unimproved) == (tries, plain.jobs, False, False)
