"""Schedules near an earlier one: who stays, who moves, and what is said of it."""

from dataclasses import replace
from fractions import Fraction
from zlib import crc32

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.models import Binding, Split, Status, TransitionTable
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.shipped import excluded_jobs
from halpipe.pipeline.solve.codes import CANNOT_STAY
from halpipe.pipeline.solve.exact import Effort
from halpipe.pipeline.solve.exact_goals import fewest_moved, is_same
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.stable import COVERS, NEAR, _covers, _displaced, _in_the_way, settled
from halpipe.pipeline.verify import verify
from support import chain, job, mode, model, ms, schedule, task, version


def scheduled(owner, near=None):
    found = schedule_model(owner, SearchOptions(near=near, optimise=()), lambda *_: True)
    assert found.is_complete
    assert not [d for d in verify(owner, found.schedule) if d.is_error]
    return found


def moved(before, after):
    places = {(j.task, j.index): (j.start, j.units, j.version) for j in before.modes[0].jobs}
    return sum(places.get((j.task, j.index)) != (j.start, j.units, j.version) for j in after.modes[0].jobs)


def with_longer(owner, name, factor):
    """The model with the first version of a task longer."""
    old = owner.task(name)
    first = replace(old.versions[0], wcet=old.versions[0].wcet * factor)
    changed = replace(old, versions=(first, *old.versions[1:]))
    return replace(owner, tasks=tuple(changed if t.name == name else t for t in owner.tasks))


def test_what_may_stay_stays():
    owner = generate(SetParameters(tasks=40, units=6), 3)
    first = scheduled(owner).schedule
    assert moved(first, scheduled(owner, near=first).schedule) == 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_task_that_takes_a_little_longer_moves_few(seed):
    owner = generate(SetParameters(tasks=60, units=6), seed)
    first = scheduled(owner).schedule
    longer = with_longer(owner, owner.tasks[7].name, Fraction(101, 100))
    near = scheduled(longer, near=first).schedule
    assert moved(first, near) * 20 <= len(near.modes[0].jobs)
    assert moved(first, scheduled(longer).schedule) > moved(first, near)


def test_how_many_stay_is_said():
    owner = model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))
    first = scheduled(owner).schedule
    found = scheduled(with_longer(owner, "b", 1), near=first)
    [note] = [d for d in found.diagnostics if d.code == NEAR.id]
    assert note.message == "2 of 2 jobs stay where they were"


def test_a_new_task_finds_its_place_among_the_others():
    owner = model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))
    first = scheduled(owner).schedule
    more = model(*owner.tasks, task("c", 10, version("v", 2)))
    found = scheduled(more, near=first)
    assert moved(first, found.schedule) == 1
    [note] = [d for d in found.diagnostics if d.code == NEAR.id]
    assert note.message == "2 of 3 jobs stay where they were; not those of c (is new); no schedule moves fewer: proven"


@pytest.mark.slow
@pytest.mark.parametrize("utilisation", [Fraction(3, 5), Fraction(4, 5)])
@pytest.mark.parametrize("seed", range(1, 21))
def test_one_per_cent_of_one_wcet_moves_no_more_than_one_job_in_twenty(seed, utilisation):
    owner = generate(SetParameters(tasks=60, units=6, utilisation=utilisation), seed)
    first = scheduled(owner).schedule
    longer = with_longer(owner, owner.tasks[seed].name, Fraction(101, 100))
    near = scheduled(longer, near=first).schedule
    assert moved(first, near) * 20 <= len(near.modes[0].jobs)


def test_who_makes_room_is_told_from_who_has_changed():
    """Three tasks fill a unit but for 1 ms, in any order; b takes 1 ms more, so that what comes after it moves."""
    rows = (("a", 3), ("b", 4), ("c", 2))
    owner = model(*(task(name, 10, version("v", wcet)) for name, wcet in rows))
    first = scheduled(owner).schedule
    found = scheduled(with_longer(owner, "b", Fraction(5, 4)), near=first)
    [note] = [d for d in found.diagnostics if d.code == NEAR.id]
    stay = len(rows) - moved(first, found.schedule)
    assert note.message.startswith(f"{stay} of 3 jobs stay where they were")
    if moved(first, found.schedule):
        assert "not those of" in note.message
    for name in ("a", "c"):
        assert f"{name} (has" not in note.message


def test_where_nothing_can_stay_everything_moves():
    owner = model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))
    first = scheduled(owner).schedule
    slower = model(task("a", 20, version("v", 9)), task("b", 20, version("v", 10)))
    assert all(job.end - job.start >= milliseconds(9) for job in scheduled(slower, near=first).schedule.modes[0].jobs)


def test_no_more_jobs_move_than_have_to_and_that_is_proven():
    """The changed task keeps its start, and one other has to make room: its whole row, or one of two others."""
    owner = model(
        task("a", 12, version("v", 3), offset=0),
        task("b", 12, version("v", 2)),
        task("c", 6, version("v", 1)),
        task("d", 12, version("v", 1)),
    )
    jobs = [("a", 0, 0), ("b", 0, 3), ("c", 0, 5), ("c", 1, 11), ("d", 0, 7)]
    before = schedule(owner, 12, *(job(owner, name, index, start, "u1") for name, index, start in jobs))
    near = scheduled(with_longer(owner, "b", Fraction(3, 2)), near=before)
    assert moved(before, near.schedule) == 1
    [note] = [d for d in near.diagnostics if d.code == NEAR.id]
    assert note.message.endswith("not those of b (has another WCET); no schedule moves fewer: proven")


def test_a_longer_task_stays_where_it_was_if_it_has_room():
    """As with --freeze; a search that frees what has changed need not find the same place again."""
    owner = model(task("a", 10, version("v", 3)), task("b", 10, version("v", 3)))
    before = schedule(owner, 10, job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, 5, "u1"))
    found = scheduled(with_longer(owner, "a", Fraction(5, 3)), near=before)
    assert moved(before, found.schedule) == 0


def test_jobs_that_exclude_each_other_prove_the_least_number_that_moves(monkeypatch):
    """Each such pair has a job that moves; where so few have moved, no engine is asked."""
    monkeypatch.setattr("halpipe.pipeline.solve.exact_goals.fewest_moved", lambda *_: pytest.fail("is asked"))
    rows = [("a", 20, 2, 0), ("b", 20, 3, 2), ("c", 10, 1, 6), ("d", 20, 2, 12)]
    owner = model(*(task(name, period, version("v", wcet)) for name, period, wcet, _ in rows))
    places = [(name, n, start + n * period) for name, period, _, start in rows for n in range(20 // period)]
    before = schedule(owner, 20, *(job(owner, name, index, start, "u1") for name, index, start in places))
    longer = with_longer(with_longer(owner, "a", Fraction(3, 2)), "d", Fraction(5, 2))
    assert len(excluded_jobs(longer, before)) == 2
    near = scheduled(longer, near=before)
    [note] = [d for d in near.diagnostics if d.code == NEAR.id]
    assert moved(before, near.schedule) == 2
    assert note.message.endswith("no schedule moves fewer: proven")


def test_the_bound_on_what_must_move_counts_no_job_twice():
    """One long job over three others of its unit: it may move alone."""
    owner = model(
        task("a", 20, version("v", 2, "u1 u2")), *(task(f"t{n}", 20, version("v", 2)) for n in range(3)), units="u1 u2"
    )
    places = [("a", 0, 0), ("t0", 0, 2), ("t1", 0, 4), ("t2", 0, 6)]
    before = schedule(owner, 20, *(job(owner, name, index, start, "u1") for name, index, start in places))
    near = scheduled(with_longer(owner, "a", Fraction(7, 2)), near=before)
    assert moved(before, near.schedule) == 1
    [note] = [d for d in near.diagnostics if d.code == NEAR.id]
    assert note.message.endswith("no schedule moves fewer: proven")


def test_sets_of_tasks_to_free_are_few_however_many_conflicts_there_are():
    """The cost law: choices double with every conflict, and many are not looked at."""
    tasks = [task(f"t{n:03}", 1000, version("v", 1)) for n in range(300)]
    owner = model(*tasks)
    before = schedule(owner, 1000, *(job(owner, t.name, 0, n, "u1") for n, t in enumerate(tasks)))
    pairs = [frozenset([(f"t{n:03}", 0), (f"t{n + 1:03}", 0)]) for n in range(0, 298, 2)]
    assert _covers(before, frozenset(), [pairs]) == []
    covers = _covers(before, frozenset(), [pairs[:50]])
    assert len(covers) == COVERS
    assert all(len(cover) == 50 for cover in covers)


def test_sets_of_tasks_to_free_do_not_depend_on_hashes():
    """Same bytes in every process: names hash in another way in each."""

    def found(salt):
        class Name(str):
            __slots__ = ()

            def __hash__(self):
                return crc32(f"{salt}{self}".encode())

        pairs = [(Name(f"t{n}"), Name(f"t{n * n * 5 % 23}")) for n in range(2, 22)]
        sets = [frozenset([(one, 0), (two, 0)]) for one, two in pairs if one != two]
        return _covers(schedule(model(), 1), frozenset(), [sets])

    expected = [sorted(cover) for cover in found(0)]
    assert len(expected) == COVERS
    assert all([sorted(cover) for cover in found(salt)] == expected for salt in range(1, 5))


def test_the_searches_of_near_are_not_saved(tmp_path):
    """A checkpoint has one state for each mode; another set of jobs that stay is another problem."""
    from itertools import count

    from halpipe.pipeline.solve.checkpoint import Checkpoint

    owner = generate(SetParameters(tasks=30, units=4, utilisation=Fraction(4, 5)), 5)
    first = scheduled(owner).schedule
    longer = with_longer(owner, owner.tasks[3].name, Fraction(3, 2))
    clock = count(0, 10)
    keeper = Checkpoint(str(tmp_path / "x.resume"), "same", lambda: next(clock))
    kept = schedule_model(longer, SearchOptions(near=first, keeper=keeper), lambda *_: True)
    assert kept.schedule == schedule_model(longer, SearchOptions(near=first), lambda *_: True).schedule


def test_without_the_exact_engine_tasks_are_put_back(monkeypatch):
    monkeypatch.setattr("halpipe.pipeline.solve.exact_goals.is_installed", lambda: False)
    owner = generate(SetParameters(tasks=30, units=4), 3)
    first = scheduled(owner).schedule
    found = scheduled(with_longer(owner, owner.tasks[7].name, Fraction(11, 10)), near=first)
    [note] = [d for d in found.diagnostics if d.code == NEAR.id]
    assert moved(first, found.schedule) == 2
    assert note.message.endswith("no schedule moves fewer: at least 1 must")


def test_never_more_move_than_with_freeze():
    compared = 0
    for seed in range(1, 16):
        owner = generate(SetParameters(tasks=20, units=3, utilisation=Fraction(3, 10)), seed)
        first = scheduled(owner).schedule
        longer = with_longer(owner, owner.tasks[seed].name, Fraction(21, 20))
        try:
            frozen = schedule_model(longer, SearchOptions(shipped=first), lambda *_: True)
        except HalpipeError:  # proven to be impossible
            continue
        assert moved(first, scheduled(longer, near=first).schedule) <= moved(first, frozen.schedule)
        compared += 1
    assert compared >= 5


def without_exact_engine(monkeypatch):
    monkeypatch.setattr("halpipe.pipeline.solve.exact_goals.is_installed", lambda: False)


def test_a_changed_task_stays_where_another_has_fewer_jobs_to_move(monkeypatch):
    """Both jobs of a would have to move, or the one job of b behind the first of them."""
    without_exact_engine(monkeypatch)
    owner = model(task("a", 5, version("v", 1)), task("b", 10, version("v", 1), slack=1))
    places = (("a", 0, 0), ("b", 0, 1), ("a", 1, 5))
    first = schedule(owner, 10, *(job(owner, name, index, start, "u1") for name, index, start in places))
    found = scheduled(with_longer(owner, "a", 2), near=first)
    assert moved(first, found.schedule) == 1


def test_a_whole_job_of_a_preemptive_mode_stays_with_another_length():
    preemptive = replace(version("v", 2), split=Split(anywhere=True, max_gaps=3))
    owner = model(task("a", 10, version("v", 3)), task("b", 10, preemptive))
    first = scheduled(owner).schedule
    found = scheduled(with_longer(owner, "a", Fraction(2, 3)), near=first)
    assert moved(first, found.schedule) == 0
    assert not [d for d in found.diagnostics if d.code == CANNOT_STAY.id]


def test_a_limit_on_the_moves_is_decided_where_an_objective_is_not():
    """That one job moves is known, that two must took an objective more than the work here, and a limit less."""
    owner = generate(SetParameters(tasks=100, utilisation=Fraction(7, 10)), 7118)
    first = scheduled(owner).schedule
    longer = with_longer(owner, "t085", Fraction(3, 2))
    expansion = expand(longer, longer.modes[0])
    earlier = {(each.task, each.index): each for each in first.modes[0].jobs}
    near = scheduled(longer, near=first).schedule.modes[0].jobs
    assert sum(not is_same(each, earlier) for each in near) == 2
    assert fewest_moved(longer, expansion, earlier, {}, near, 1, Effort(work=0.05)).bound == 2


def test_what_has_changed_is_named_before_what_makes_room():
    """z is longer and has to start at 2 ms, where its unit is full: d, behind it, moves, and new tasks come first."""
    rows = [("a", 2, 0), ("z", 3, 2), ("d", 2, 5), ("e", 1, 8)]
    owner = model(*(task(name, 10, version("v", wcet), offset=2 if name == "z" else None) for name, wcet, _ in rows))
    first = schedule(owner, 10, *(job(owner, name, 0, start, "u1") for name, _, start in rows))
    longer = with_longer(owner, "z", Fraction(4, 3))
    near = scheduled(model(*longer.tasks, task("y", 10, version("v", "0.5ms"))), near=first)
    [note] = [d for d in near.diagnostics if d.code == NEAR.id]
    assert "not those of y (is new), d (makes room); no schedule" in note.message


def test_objectives_are_improved_beside_an_earlier_schedule():
    owner = model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))
    first = scheduled(owner).schedule
    options = SearchOptions(near=first, optimise=(Objective.COST,))
    found = schedule_model(owner, options, lambda *_: True)
    assert [row.objective for row in found.reached] == [Objective.COST]
    assert schedule_model(owner, SearchOptions(near=first), lambda *_: True).reached == ()


def test_tasks_in_broken_rules_are_freed_first_and_else_those_on_the_same_units():
    rows = [("a", "u1"), ("b", "u1"), ("c", "u2"), ("d", "u2")]
    owner = model(*(task(name, 10, version("v", 4, unit)) for name, unit in rows), units="u1 u2")
    apart = [job(owner, name, 0, start, unit) for (name, unit), start in zip(rows, (0, 5, 0, 5), strict=True)]
    assert _in_the_way(owner, schedule(owner, 10, *apart), frozenset("a")) == {"b"}
    meeting = [*apart[:3], replace(apart[3], start=ms(2), end=ms(6))]
    assert _in_the_way(owner, schedule(owner, 10, *meeting), frozenset("a")) == {"c"}
    assert _in_the_way(owner, schedule(owner, 10, *meeting), frozenset("ab")) == {"c", "d"}
    assert _in_the_way(owner, schedule(owner, 10, *meeting), frozenset("c")) == {"d"}
    assert _in_the_way(owner, schedule(owner, 10, *apart), frozenset("abcd")) == frozenset()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t: replace(t, versions=(replace(t.versions[0], name="w"),)), 'has no version "v"'),
        (lambda t: replace(t, versions=(replace(t.versions[0], units=("u2",)),)), "has other units"),
        (lambda t: replace(t, versions=(replace(t.versions[0], gang=2),)), "has other units"),
        (lambda t: replace(t, versions=(replace(t.versions[0], units=("u2", "u3")),)), "has other units"),
        (lambda t: replace(t, name="new"), "is new"),
    ],
)
def test_the_note_says_why_a_task_has_moved(change, reason):
    owner = model(task("a", 10, version("v", 3, "u1 u2")), task("b", 10, version("v", 3, "u1 u2")), units="u1 u2")
    first = schedule(owner, 10, job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, 3, "u1"))
    changed = change(owner.tasks[0])
    near = scheduled(model(changed, owner.tasks[1], units="u1 u2 u3"), near=first)
    [note] = [d for d in near.diagnostics if d.code == NEAR.id]
    assert f"{changed.name} ({reason})" in note.message


def test_a_task_that_may_not_start_there_any_more_is_named_in_the_note_alone():
    """No option has frozen it, so it has no warning that it cannot stay as shipped."""
    rows = task("b", 20, version("v", 2, "u1"))
    was, now = (model(task("a", 10, version("v", 2, "u1"), slack=slack), rows) for slack in (1, Fraction(1, 10)))
    first = schedule(was, 20, job(was, "a", 0, 0, "u1"), job(was, "a", 1, 14, "u1"), job(was, "b", 0, 6, "u1"))
    [note] = scheduled(now, near=first).diagnostics
    assert note.code == NEAR.id
    assert "a (may not stay there)" in note.message
    twice = replace(now, modes=(*now.modes, replace(now.modes[0], name="other")))
    both = replace(first, modes=(*first.modes, replace(first.modes[0], name="other")))
    assert {found.code for found in scheduled(twice, near=both).diagnostics} == {NEAR.id}


def three_modes(**changes):
    """x runs in two modes, y and z in one each; with a chain of z."""
    x, y, z = (task(name, 10, version("v", 2, "u1 u2")) for name in "xyz")
    modes = [mode("m", [x]), mode("n", [x, y]), mode("o", [z])]
    return replace(model(x, y, z, units="u1 u2", modes=modes, chains=[chain("c", "z", age=10)]), **changes)


def kept(system, changed=()):
    """Return the modes and switches that stay if the system of three modes becomes this one."""
    before = three_modes()
    tables = [schedule(before, 10, mode_name=each.name).modes[0] for each in before.modes]
    limits = {"length": ms(0), "worst_latency": ms(10), "status": Status.VALID, "jobs": ()}
    pairs = [TransitionTable(source=p.source, target=p.target, **limits) for p in before.allowed_transitions()]
    plan = replace(schedule(before, 10), modes=tuple(tables), transitions=tuple(pairs))
    found = settled(before, system, plan, changed)
    return "".join(t.name for t in found.modes), " ".join(sorted(t.source + t.target for t in found.transitions))


def with_task(system, name, **changes):
    return replace(system, tasks=tuple(replace(t, **changes) if t.name == name else t for t in system.tasks))


def test_a_gang_of_which_one_unit_is_no_longer_allowed_has_other_units():
    owner = model(task("a", 10, version("v", 3, "u1 u2", gang=2)), units="u1 u2 u3")
    first = schedule(owner, 10, job(owner, "a", 0, 0, "u1 u2"))
    changed = model(task("a", 10, version("v", 3, "u1 u3", gang=2)), units="u1 u2 u3")
    [note] = [d for d in scheduled(changed, near=first).diagnostics if d.code == NEAR.id]
    assert "a (has other units)" in note.message


def test_modes_are_settled_where_nothing_that_they_depend_on_differs():
    same = three_modes()
    assert kept(same) == ("mno", "mn mo nm no om on")
    assert kept(same, ["n"]) == ("mo", "mo om")
    assert kept(with_task(same, "y", slack=1)) == ("mo", "mo om")
    assert kept(with_task(same, "x", slack=1)) == ("o", "")
    assert kept(replace(same, chains=())) == ("mn", "mn nm")
    assert kept(replace(same, units=same.units[:1])) == ("", "")
    renamed = replace(same, modes=(*same.modes[:2], replace(same.modes[2], name="p")))
    assert kept(renamed) == ("mn", "mn nm")


def test_tasks_without_migration_tie_their_modes_together():
    bound = with_task(three_modes(), "x", binding=Binding.SYSTEM)
    assert kept(bound)[0] == "o"
    assert kept(with_task(three_modes(), "y", binding=Binding.SYSTEM))[0] == "mo"
    both = replace(bound, modes=(*bound.modes[:2], mode("o", [bound.tasks[0]])))
    assert kept(both)[0] == ""


def test_a_bound_task_that_is_held_in_one_mode_goes_with_it_in_the_others():
    a, b = (task(name, 10, version("v", 2, "u1 u2"), slack=1) for name in "ab")
    bound = replace(a, binding=Binding.SYSTEM)
    system = model(bound, b, units="u1 u2", modes=[mode("one", [bound, b]), mode("two", [bound, b])])
    jobs = job(system, "a", 0, 1, "u1"), job(system, "b", 0, 5, "u1")
    one, two = (schedule(system, 10, *jobs, mode_name=name) for name in ("one", "two"))
    near = replace(one, modes=(*one.modes, *two.modes))
    held = schedule(system, 10, job(system, "a", 0, 3, "u2"), mode_name="two")
    found = schedule_model(system, SearchOptions(near=near, shipped=held, budget=50), lambda *_: True)
    assert found.is_complete
    places = {(table.name, j.task): (j.start, j.units) for table in found.schedule.modes for j in table.jobs}
    assert places["two", "a"] == (ms(3), ("u2",))
    assert places["one", "a"] == (ms(1), ("u2",))
    assert {places["one", "b"], places["two", "b"]} == {(ms(5), ("u1",))}
    assert CANNOT_STAY.id not in {each.code for each in found.diagnostics}


def test_tasks_that_held_jobs_would_meet_are_displaced_and_those_beside_them_are_not():
    rows = [("held", 4, "u1"), ("before", 2, "u1"), ("behind", 2, "u1"), ("inside", 2, "u1"), ("apart", 2, "u2")]
    owner = model(*(task(name, 10, version("v", wcet, unit)) for name, wcet, unit in rows), units="u1 u2")
    places = {"before": 9, "behind": 5, "inside": 4, "apart": 2}
    earlier = schedule(
        owner, 10, *(job(owner, name, 0, at, unit) for name, _, unit in rows[1:] for at in [places[name]])
    )
    held = schedule(owner, 10, job(owner, "held", 0, 1, "u1"))
    assert _displaced(earlier, held) == {"held", "inside"}
    assert _displaced(earlier, None) == frozenset()
    assert _displaced(replace(earlier, modes=()), held) == {"held"}
