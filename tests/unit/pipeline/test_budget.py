"""How much work a search may do: by moves, or by the clock."""

import pytest

from halpipe.cli import searching
from halpipe.pipeline.solve.checkpoint import Checkpoint
from halpipe.pipeline.solve.schedule import (
    DEFAULT_BUDGET,
    LEAST_MOVES,
    LEAST_TABLES,
    MOST_TABLED,
    UNBOUNDED,
    SearchOptions,
)
from halpipe.pipeline.solve.workers import Workers
from support import ms


@pytest.mark.parametrize(
    ("budget", "tasks", "moves"),
    [
        (None, 0, LEAST_MOVES),
        (None, 3, LEAST_MOVES),
        (None, LEAST_MOVES // DEFAULT_BUDGET, LEAST_MOVES),
        (None, 200, 200 * DEFAULT_BUDGET),
        (10, 3, 30),
        (10, 0, 10),
    ],
)
def test_small_sets_get_as_much_work_as_larger_ones_unless_a_budget_is_stated(budget, tasks, moves):
    assert SearchOptions(budget=budget).moves(tasks) == moves


@pytest.mark.parametrize(
    ("stated", "budget", "effort"),
    [
        ([], None, SearchOptions().effort),
        (["--time-limit", "30"], UNBOUNDED, None),
        (["--time-limit", "30", "--budget", "7"], 7, None),
        (["--budget", "7"], 7, SearchOptions().effort),
    ],
)
def test_a_time_limit_is_used_to_its_end_unless_a_budget_is_stated(tmp_path, monkeypatch, stated, budget, effort):
    from command_line import run_here
    from halpipe.exporters.native import format_model
    from support import model, task, version

    (tmp_path / "model.xml").write_bytes(format_model(model(task("t", 10, version("v", 1)))))
    asked = []
    monkeypatch.setattr(searching, "find_schedule", lambda system, options, *rest, **named: asked.append(options) or 0)
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "s.xml", *stated).returncode == 0
    assert [(options.budget, options.effort) for options in asked] == [(budget, effort)]


@pytest.mark.parametrize(("budget", "asked"), [(None, 1), (100, 0)])
def test_a_stated_budget_bounds_the_improvement_too(monkeypatch, budget, asked):
    """With it, no step takes more moves, and the exact engine is not asked for shorter chains."""
    from halpipe.pipeline.checked import schedule_model
    from halpipe.pipeline.measure.objectives import Objective
    from halpipe.pipeline.solve import exact_goals, one_mode
    from halpipe.pipeline.solve.optimise import POLISH_BUDGET
    from support import chain, model, task, version

    calls, budgets, polish_of = [], [], one_mode.polish_of
    bounded = lambda *rest: exact_goals.Shortest(exact_goals._sum(rest[4]))  # noqa: E731
    monkeypatch.setattr(exact_goals, "shortest_chains", lambda *rest: calls.append(rest) or bounded(*rest))
    monkeypatch.setattr(one_mode, "polish_of", lambda *rest: budgets.append(polish_of(*rest)) or budgets[-1])
    periods = {"a": 12, "b": 12, "c": 24}
    tasks = [task(name, period, version("v", 2, "u1"), slack=1) for name, period in periods.items()]
    system = model(*tasks, units="u1", chains=[chain("c", "a c b")])
    options = SearchOptions(budget=budget, optimise=(Objective.CHAINS,))
    assert schedule_model(system, options, lambda *_: True).is_complete
    assert len(calls) == asked
    assert [polish.budget for polish in budgets] == [budget or POLISH_BUDGET]


@pytest.mark.parametrize(
    ("transitions", "options", "work", "words"),
    [
        ((), {}, 18 + 2 * 2 * 18 // 4, "18 jobs in 3 modes with switches"),
        ((("m0", "m1", None),), {}, 18 + 7 // 4, "18 jobs in 3 modes with switches"),
        ((), {"switches": False}, 18, "18 jobs in 3 modes"),
        ((), {"modes": ("m1", "m2")}, 16 + 2 * 16 // 4, "16 jobs in 2 modes with switches"),
        ((("m0", "m1", None),), {"modes": ("m1", "m2")}, 16, "16 jobs in 2 modes"),
        ((("m0", "m1", None),), {"modes": ("m0", "m1")}, 7 + 7 // 4, "7 jobs in 2 modes with switches"),
        ((), {"switches": False, "searches": 3}, 54, "18 jobs in 3 modes, in 3 searches"),
        (
            (("m0", "m1", None), ("m1", "m0", None)),
            {"searches": 2},
            2 * (18 + 14 // 4),
            "18 jobs in 3 modes with switches, in 2 searches",
        ),
    ],
)
def test_a_search_without_a_stated_end_counts_the_jobs_of_modes_and_of_pairs(
    monkeypatch, transitions, options, work, words
):
    """Modes of 2, 5 and 11 jobs: four jobs of a pair take as long as one of a mode."""
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.pipeline.solve import limits
    from halpipe.pipeline.solve.limits import refuse_endless
    from support import mode, model, task, version

    tasks = [task(f"t{n}", period, version("v", "0.1ms")) for n, period in enumerate((20, 20, 5, 2))]
    modes = [mode(f"m{n}", [tasks[0], tasks[n + 1]]) for n in range(3)]
    system = model(*tasks, modes=modes, transitions=transitions)
    monkeypatch.setattr(limits, "MOST_UNLIMITED", 1)
    with pytest.raises(HalpipeError) as refused:
        refuse_endless(system, **options)
    assert refused.value.diagnostics[0].message.startswith(f"{words}, take as long as {work} jobs")


@pytest.mark.parametrize(
    ("budget", "tasks", "jobs", "placed"),
    [
        (None, 1, 1000, LEAST_TABLES * 1000),
        (None, 3, 10**9, MOST_TABLED),
        (None, 10**6, 10, DEFAULT_BUDGET * 10**6),
        (7, 3, 10, 21),
    ],
)
def test_preemptive_jobs_are_placed_for_so_many_tables_at_least_unless_a_budget_is_stated(budget, tasks, jobs, placed):
    assert SearchOptions(budget=budget).placements(tasks, jobs) == placed


def test_what_only_watches_a_search_or_serves_it_is_no_part_of_what_it_looks_for():
    """Plans are the same where the time that they may take, the workers and who is told differ; else they are not."""
    plain = SearchOptions(seed=3)
    watched = {
        "time_limit": ms(5),
        "keeper": Checkpoint("x", "y", lambda: 0),
        "on_better": print,
        "workers": Workers(3),
    }
    for name, value in watched.items():
        assert SearchOptions(seed=3, **{name: value}) == plain, name
        assert hash(SearchOptions(seed=3, **{name: value})) == hash(plain), name
    assert SearchOptions(seed=4) != plain
    assert SearchOptions(seed=3, budget=5) != plain


def test_a_model_that_is_not_valid_is_not_refused_for_its_size_unless_it_was_checked(monkeypatch):
    """What is wrong with it is found before any search."""
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.pipeline.solve import limits
    from halpipe.pipeline.solve.codes import ENDLESS
    from support import model, task, version

    monkeypatch.setattr(limits, "MOST_UNLIMITED", 1)
    wrong, valid = (model(task("a", 20, version("v", wcet)), task("b", 1, version("v", "0.1ms"))) for wcet in (30, 1))
    limits.refuse_endless(wrong)
    for system, checked in ((wrong, {"is_checked": True}), (valid, {})):
        with pytest.raises(HalpipeError) as refused:
            limits.refuse_endless(system, **checked)
        assert [found.code for found in refused.value.diagnostics] == [ENDLESS.id]
