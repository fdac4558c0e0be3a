"""Independent groups of a large mode: what binds them, the same bytes for any number of threads, failures named."""

from __future__ import annotations

from dataclasses import replace

import pytest

from halpipe.core.diagnostics import Location
from halpipe.models import Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve import exact, one_mode, relay
from halpipe.pipeline.solve.codes import GROUP_NOT_FOUND
from halpipe.pipeline.solve.groups import _named, _narrowed, _Progress, independent_groups, search_groups
from halpipe.pipeline.solve.one_mode import Found
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.verify import verify
from support import access, after, chain, mode, model, ms, task, version


@pytest.fixture(autouse=True)
def small_modes_are_cut(monkeypatch):
    monkeypatch.setattr(one_mode, "FEW_TASKS", 1)


def names(*tasks, **parts):
    system = model(*tasks, units="u1 u2 u3 u4", **parts)
    found = independent_groups(system, expand(system, system.modes[0]))
    return ["".join(active.name for active in group.tasks) for group in found]


def alone(name, unit, *parts):
    return task(name, 10, version("v", 1, unit, *parts))


def test_tasks_with_nothing_in_common_are_groups_of_their_own():
    assert names(alone("a", "u1"), alone("b", "u2"), alone("c", "u1")) == ["ac", "b"]


def test_a_version_binds_all_units_that_it_may_run_on():
    assert names(alone("a", "u1 u2"), alone("b", "u2 u3"), alone("c", "u3"), alone("d", "u4")) == ["abc", "d"]


def test_resources_windows_chains_and_demands_bind():
    bus = access("bus", 0, 1, "1/4")
    assert names(alone("a", "u1", bus), alone("b", "u2", bus), alone("c", "u3"), resources="bus") == ["ab", "c"]
    assert names(alone("a", "u1"), alone("b", "u2", after("a", 0, 5)), alone("c", "u3")) == ["ab", "c"]
    served = task("s", None, version("v", 1, "u2"))
    assert names(alone("a", "u1", after("s", 1, 5)), served, alone("c", "u3")) == ["as", "c"]
    limited, free = replace(chain("l", "a b"), max_latency=ms(40)), chain("f", "b c")
    assert names(alone("a", "u1"), alone("b", "u2"), alone("c", "u3"), chains=[limited, free]) == ["ab", "c"]


def test_a_chain_through_a_task_that_does_not_run_binds_nothing():
    tasks = alone("a", "u1"), alone("b", "u2"), alone("gone", "u3")
    system = model(*tasks, units="u1 u2 u3", chains=[chain("c", "a gone b", 40)], modes=[mode("all", tasks[:2])])
    assert len(independent_groups(system, expand(system, system.modes[0]))) == 2


def test_a_group_has_its_own_units_resources_and_chains_and_the_tasks_that_it_names():
    """Version w of `a` names `idle`, which does not run; `other` does not either, and nobody names it."""
    idle, other = alone("idle", "u4"), alone("other", "u4")
    a = replace(
        alone("a", "u1", access("r", 0, 1)), versions=(version("w", 1, "u1", access("r", 0, 1), after("idle", 0, 9)),)
    )
    a = replace(a, versions=(version("v", 1, "u1", access("r", 0, 1)), *a.versions))
    b, c = alone("b", "u1"), alone("c", "u2 u3", access("s", 0, 1))
    chains = [chain("own", "a b", 40), chain("free", "b c"), chain("gone", "c idle")]
    modes = [mode("all", [replace(a, versions=a.versions[:1]), b, c])]
    system = model(other, a, idle, b, c, units="u1 u2 u3 u4", resources="r s t", chains=chains, modes=modes)
    cut = _narrowed(system, independent_groups(system, expand(system, system.modes[0])))

    def named(rows):
        return " ".join(row.name for row in rows)

    found = [tuple(map(named, (m.tasks, m.units, m.resources, m.chains))) for m in cut]
    assert found == [("a b idle", "u1", "r", "own"), ("c", "u2 u3", "s", "")]
    assert [[run.task for run in m.modes[0].runs] for m in cut] == [["a", "b"], ["c"]]


def test_what_groups_report_is_passed_on_as_the_progress_of_one_search():
    """Until each has a placement, there is no cost; a no to one of them is one to all."""
    told = []
    progress = _Progress(lambda *given: told.append(given) or len(told) < 5, [100, 50])
    assert progress.report(0, "m", 10, 100, -1)
    assert progress.report(1, "m", 5, 50, 0)
    assert progress.report(0, "m", 20, 100, 7)
    assert progress.report(1, "m", 6, 50, 2)
    assert not progress.report(0, "m", 30, 100, 0)
    assert not progress.report(1, "m", 9, 50, 0)
    assert told == [("m", 10, 150, -1), ("m", 15, 150, -1), ("m", 25, 150, 7), ("m", 26, 150, 9), ("m", 36, 150, 2)]


def test_a_limited_chain_of_one_task_is_that_of_its_group():
    assert names(alone("a", "u1"), alone("b", "u2"), chains=[chain("c", "b", 40)]) == ["a", "b"]


@pytest.mark.parametrize(("units", "words"), [("u1", "task a on unit u1"), ("u1 u2", "task a on units u1, u2")])
def test_a_group_of_one_is_named_as_one_where_it_stands(units, words):
    system = model(replace(alone("a", units), at=Location("x.xml", 7)), alone("b", "u3"), units="u1 u2 u3")
    expansion = expand(system, system.modes[0])
    found = _named(expansion, independent_groups(system, expansion)[0], 2)
    assert (found.at, found.message.rpartition(": ")[2]) == (Location("x.xml", 7), words)


def test_a_small_mode_is_not_cut(monkeypatch):
    monkeypatch.setattr(one_mode, "FEW_TASKS", 7)
    result = found(corners(hard=True), budget=500)
    assert GROUP_NOT_FOUND.id not in {d.code for d in result.diagnostics}


def corners(hard):
    """Three groups, of which the second one has three tasks that share two units of which each holds one only."""
    easy = [task(f"{name}{n}", 10, version("v", 2, unit)) for name, unit in (("a", "u1"), ("d", "u4")) for n in (1, 2)]
    wcets = ("7ms", "7ms", "6ms" if hard else "2ms")
    return model(
        *easy, *(task(f"h{n}", 10, version("v", wcet, "u2 u3")) for n, wcet in enumerate(wcets)), units="u1 u2 u3 u4"
    )


def found(system, **options):
    return schedule_model(system, SearchOptions(**options), lambda *_: True)


@pytest.mark.parametrize("count", [2, 8])
def test_the_same_schedule_for_any_number_of_threads(count):
    system = corners(hard=False)
    first = found(system, workers=Workers(1))
    assert [d.message for d in verify(system, first.schedule) if d.is_error] == []
    assert found(system, workers=Workers(count)).schedule == first.schedule


def test_a_group_without_a_schedule_is_named_and_the_others_have_one():
    result = found(corners(hard=True), budget=500)
    assert result.schedule.modes[0].status is Status.NOT_FOUND
    [named] = [d for d in result.diagnostics if d.code == GROUP_NOT_FOUND.id]
    assert "one of 3 independent groups" in named.message
    assert "tasks h0, h1, h2 on units u2, u3" in named.message
    assert len(result.schedule.modes[0].jobs) == 7


@pytest.mark.parametrize(
    ("budget", "asked"),
    [
        (5000, [("first", 2000), ("group", 5000)]),
        (None, [("first", 2000), ("group", None)]),
        (2000, [("first", 2000)]),
        (500, [("first", 500)]),
    ],
)
def test_groups_without_a_schedule_are_searched_once_more_with_the_whole_budget(budget, asked):
    """The first two of three find nothing at first, the second one never does: no other group is touched then."""
    system, made = corners(hard=False), []
    expansion, whole = expand(system, system.modes[0]), found(system).schedule.modes[0]

    def search(its, part, options, key, _tell):
        made.append((key, options.budget, options.spare))
        is_valid = key in ("first2", "group0")
        table = replace(whole, jobs=tuple(job for job in whole.jobs if job.task in part.by_name))
        status, is_cut = Status.VALID if is_valid else Status.NOT_FOUND, key == "first2"
        return Found(replace(table, status=status), [], moves=len(made), unimproved=is_cut)

    options = SearchOptions(budget=budget, spare=90)
    result = search_groups(system, expansion, independent_groups(system, expansion), options, lambda *_: True, search)
    expected = [(f"{key}{n}", moves, 30) for key, moves in asked for n in range(3 if key == "first" else 2)]
    assert made == expected
    assert (result.moves, result.unimproved) == (sum(range(1, len(expected) + 1)), True)
    assert sorted(job.task for job in result.table.jobs) == sorted(job.task for job in whole.jobs)
    failed = [each.message for each in result.diagnostics if each.code == GROUP_NOT_FOUND.id]
    assert len(failed) == (1 if len(asked) == 2 else 2)


def test_a_stop_reaches_all_groups():
    result = schedule_model(corners(hard=True), SearchOptions(), lambda *_: False)
    assert result.stopped
    assert len(result.schedule.modes[0].jobs) == 7


def test_the_exact_engine_decides_a_group_alone(monkeypatch):
    """It once had the whole mode to solve for each group that the annealer had not found yet."""
    pytest.importorskip("ortools")
    asked = []

    def solve(system, mode, effort):
        asked.append(([each.name for each in system.tasks], [run.task for run in mode.runs]))
        return exact.solve_exact(system, mode, effort)

    monkeypatch.setattr(relay, "solve_exact", solve)
    schedule_model(corners(hard=True), SearchOptions(), lambda *_: not asked)
    assert asked[0] == (["h0", "h1", "h2"], ["h0", "h1", "h2"])
