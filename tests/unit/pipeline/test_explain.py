"""explain as a whole: what it says of invalid, hopeless, hard and easy models, and what it proposes."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Subject
from halpipe.core.durations import Duration, milliseconds
from halpipe.models import Anchor, Chain, Edge, Match, Mode, Precedence, Split, Status, Unit
from halpipe.pipeline.explain import changes, codes, conflict
from halpipe.pipeline.explain.conflict import find_conflict
from halpipe.pipeline.explain.explanation import BUDGET, ExplainOptions, Verdict, explain
from halpipe.pipeline.explain.remedies import Trials, find_remedies
from halpipe.pipeline.explain.witnesses import tasks_of
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.shipped import EXCLUDED
from halpipe.pipeline.solve import codes as search_codes
from halpipe.pipeline.solve.exact import Answer
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.stable import NEAR
from halpipe.pipeline.transitions.tables import NO_TABLE
from halpipe.pipeline.verify import verify
from support import access, after, chain, job, mode, model, ms, schedule, task, version

CORES = "c1 c2"

NEITHER = ExplainOptions(exact=False, remedies=False)


def packing(*extra, last="6ms"):
    """Three tasks of which no two fit on one unit, and two units."""
    wcets = (("a", "7ms"), ("b", "7ms"), ("c", last))
    return model(*(task(n, "10ms", version("v", c, CORES)) for n, c in wcets), *extra, units="c1 c2 c3")


def verdicts(explanation):
    return [verdict for _, verdict in explanation.verdicts]


def found_codes(explanation):
    return {d.code for d in explanation.diagnostics}


def remedies(system, tasks=(), go_on=lambda: True):
    """The texts of what helps the only mode."""
    trials = Trials(system.modes[0].name, 5, go_on, natural_tick(expand(system, system.modes[0])))
    return [d.message for d in find_remedies(system, tasks, trials)]


# ------------------------------------------------------------------------------------------------ verdicts


def test_a_mode_with_a_schedule():
    explanation = explain(packing(last="3ms"))
    assert verdicts(explanation) == [Verdict.SCHEDULABLE]
    assert found_codes(explanation) == {codes.SCHEDULABLE.id}
    assert int(explanation.exit) == 0


def test_the_search_that_is_explained_is_no_short_one():
    """Twenty moves for each task are too few, which a stated budget shows."""
    system = generate(SetParameters(tasks=24, units=4, utilisation=Fraction(4, 5), unlike_units=True), 1)
    assert verdicts(explain(system, NEITHER)) == [Verdict.SCHEDULABLE]
    assert verdicts(explain(system, NEITHER, budget=20)) == [Verdict.NOT_FOUND]


@pytest.mark.parametrize(("work", "budget"), [(50, 20), (10_000, 2000), (10**9, BUDGET)])
def test_the_search_that_is_explained_is_shorter_where_jobs_are_many(monkeypatch, work, budget):
    """Of five jobs, each has a fifth of the work; twenty moves at least."""
    seen = []

    def search(system, chosen, on_progress):
        seen.append(chosen.budget)
        return schedule_model(system, chosen, on_progress)

    monkeypatch.setattr("halpipe.pipeline.explain.explanation.WORK", work)
    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_model", search)
    system = model(task("a", 10, version("v", 3)), task("b", 40, version("v", 1, "u2")), units="u1 u2")
    assert verdicts(explain(system, NEITHER)) == [Verdict.SCHEDULABLE]
    assert seen == [budget]


def test_not_found_is_never_called_infeasible():
    explanation = explain(packing(), NEITHER, budget=50)
    assert verdicts(explanation) == [Verdict.NOT_FOUND]
    assert found_codes(explanation) == {search_codes.NOT_FOUND.id, search_codes.STILL_BROKEN.id}
    first = explanation.diagnostics[0].message
    assert "best cost" in first
    assert "no proof" in first
    assert int(explanation.exit) == 3


def test_the_best_placement_given_is_the_one_that_is_explained():
    best = schedule_model(packing(), SearchOptions(budget=10), lambda *_: True).schedule
    explanation = explain(packing(), replace(NEITHER, schedule=best))
    broken = [d for d in explanation.diagnostics if d.code == search_codes.STILL_BROKEN.id]
    assert broken
    valid = schedule_model(packing(last="3ms"), SearchOptions(), lambda *_: True).schedule
    assert verdicts(explain(packing(last="3ms"), ExplainOptions(schedule=valid))) == [Verdict.SCHEDULABLE]


def test_jobs_of_a_placement_that_end_too_early_are_not_put_right():
    system = packing(last="3ms")
    jobs = [job(system, name, 0, at, unit) for name, at, unit in (("a", 0, "c1"), ("b", 0, "c2"), ("c", 7, "c2"))]
    short = replace(jobs[2], end=ms(9))
    given = schedule(system, 10, *jobs[:2], short, status=Status.NOT_FOUND)
    assert verdicts(explain(system, replace(NEITHER, schedule=given))) == [Verdict.NOT_FOUND]
    whole = schedule(system, 10, *jobs, status=Status.NOT_FOUND)
    assert verdicts(explain(system, replace(NEITHER, schedule=whole))) == [Verdict.SCHEDULABLE]


def test_an_invalid_model_is_explained_by_what_validate_finds():
    system = model(task("a", "10ms", version("v", None)))
    explanation = explain(system)
    assert verdicts(explanation) == [Verdict.INVALID]
    assert int(explanation.exit) == 1


def test_a_model_without_modes_is_invalid():
    explanation = explain(replace(packing(), modes=()))
    assert explanation.diagnostics
    assert int(explanation.exit) == 1


@pytest.mark.parametrize(
    "system",
    [
        model(task("a", "10ms", version("v", "11ms"))),
        model(task("a", "10ms", version("v", "6ms")), task("b", "10ms", version("v", "5ms"))),
        model(task("a", "10ms", version("v", "1ms", "u1", gang=2))),
        model(task("a", "4ms", version("v", "1ms")), chains=[chain("c", "a", age="0.5ms")]),
        model(task("a", 9, version("v", 1)), task("b", 9, version("v", 1, "u1", after("a", 3, 2)))),
        model(task("a", 9, version("v", 2, "u1", access("m", 0, 1, "2/3"), access("m", 0, 1, "1/2"))), resources="m"),
        model(replace(task("a", 10, version("v", 9), slack=1), distance=ms(18))),
        model(replace(task("a", 10, version("v", 3), slack=1, deadline=12), distance=ms(18))),
        model(replace(task("a", 10, version("v", 5)), let=ms(4))),
    ],
    ids=["deadline", "load", "gang", "chain", "window", "phases", "distance", "deadline of arrivals", "let"],
)
def test_errors_of_validate_that_are_proofs(system):
    explanation = explain(system)
    assert verdicts(explanation) == [Verdict.INFEASIBLE]
    assert int(explanation.exit) == 4


def test_a_version_too_long_beside_one_that_is_not_proves_nothing():
    system = model(task("a", "10ms", version("long", "11ms"), version("short", "2ms")))
    assert verdicts(explain(system)) == [Verdict.SCHEDULABLE]


def test_a_version_with_a_fault_beside_one_without_proves_nothing():
    both = version("v", 1, "u1", after("a", 3, 2)), version("w", 1)
    system = model(task("a", 9, version("v", 1)), task("b", 9, *both))
    assert verdicts(explain(system)) == [Verdict.INVALID]


def test_nothing_is_proven_of_a_model_that_is_wrong_otherwise():
    system = model(task("a", "10ms", version("v", "11ms")), task("b", "10ms", version("v", None)))
    assert verdicts(explain(system)) == [Verdict.INVALID]


def test_modes_are_explained_one_by_one():
    system = packing()
    runs = system.modes[0].runs
    system = replace(system, modes=(Mode(name="all", runs=runs), Mode(name="two", runs=runs[:2])))
    both = explain(system, NEITHER, budget=50)
    assert both.verdicts == (("all", Verdict.NOT_FOUND), ("two", Verdict.SCHEDULABLE))
    assert explain(system, ExplainOptions(mode="two")).verdicts == (("two", Verdict.SCHEDULABLE),)


# ------------------------------------------------------------------------------------------------ conflicts


def names(found):
    return [active.name for active in found.kept.tasks]


def test_the_conflict_is_minimal_and_leaves_the_rest_out():
    pytest.importorskip("ortools")
    others = [task(f"t{k}", "5ms", version("v", "1ms", "c3", after("a", 0, 20))) for k in range(2)]
    found = find_conflict(packing(*others), packing(*others).modes[0], lambda: True)
    assert found.answer is Answer.INFEASIBLE
    assert names(found) == ["a", "b", "c"]
    assert found.is_minimal
    text = conflict.describe(packing(*others).modes[0], found)
    assert text.code == codes.NO_SCHEDULE_FOR.id
    assert "minimal" in text.message
    assert text.help.endswith("without any single one of them a schedule exists")


def test_constraints_that_play_no_part_are_left_out():
    pytest.importorskip("ortools")
    system = packing()
    decorated = replace(system.tasks[2], versions=(version("v", "6ms", CORES, after("a", 0, 50), access("m", 0, 1)),))
    system = replace(
        system,
        tasks=(*system.tasks[:2], decorated),
        chains=(Chain(name="c", tasks=("a", "c"), max_age=milliseconds(90)),),
        resources=model(resources="m").resources,
    )
    kept = find_conflict(system, system.modes[0], lambda: True).kept
    assert [len(active.versions[0].precedences) for active in kept.tasks] == [0, 0, 0]
    assert not any(active.versions[0].accesses for active in kept.tasks)
    assert not kept.chains


def test_tasks_on_demand_stay_with_those_who_demand_them():
    """Each of four tasks demands, by way of another, a helper of 4ms; in 10ms there is room for two."""
    pytest.importorskip("ortools")
    inner = task("inner", None, version("v", "4ms", "c3"))
    outer = task("outer", None, version("v", "1ms", "c2", after("inner", 0, 9)))
    tasks = [task(f"t{k}", "10ms", version("v", "1ms", "c1", after("outer", 0, 9))) for k in range(4)]
    system = model(inner, outer, *tasks, units="c1 c2 c3")
    found = find_conflict(system, system.modes[0], lambda: True)
    assert (found.answer, found.is_minimal) == (Answer.INFEASIBLE, True)
    assert names(found) == ["inner", "outer", "t1", "t2", "t3"]
    assert {active.name: active.jobs for active in found.kept.tasks}["inner"] == 3


def test_leaving_out_the_only_task_with_jobs_leaves_a_schedule():
    """Nobody demands the helper, so it has no job, and without the other task there is not even a grid."""
    pytest.importorskip("ortools")
    late = task("late", 8, version("v", 2, "c1"), offset=5)
    system = model(late, task("helper", None, version("v", 1, "c2")), chains=[chain("c", "late helper", reaction=19)])
    found = find_conflict(system, system.modes[0], lambda: True)
    assert found.answer is Answer.INFEASIBLE
    assert names(found) == ["late"]


def test_a_conflict_that_is_stopped_is_not_called_minimal():
    pytest.importorskip("ortools")
    found = find_conflict(packing(), packing().modes[0], lambda: False)
    assert (found.answer, found.is_minimal) == (Answer.INFEASIBLE, False)
    told = conflict.describe(packing().modes[0], found)
    assert "perhaps not minimal" in told.message
    assert told.help == "relax one of these tasks or constraints"


def test_without_the_exact_engine_there_is_no_conflict(monkeypatch):
    monkeypatch.setattr(conflict, "is_installed", lambda: False)
    assert find_conflict(packing(), packing().modes[0], lambda: True).answer is Answer.UNKNOWN
    explanation = explain(packing(), ExplainOptions(remedies=False), budget=50)
    assert verdicts(explanation) == [Verdict.NOT_FOUND]


# ------------------------------------------------------------------------------------------------ remedies


@pytest.mark.parametrize(("let", "edge"), [(8, Edge.OPEN), (3, Edge.CLOSED)])
def test_a_conflict_names_windows_lets_and_edges_only_where_they_count(let, edge):
    """a takes the first 4 ms of each cycle, so that b ends 6 ms after its release at the earliest."""
    row = replace(after("a", 0, 1 if let == 8 else 9, "release"), match=Match.CYCLE, to=Anchor.END)
    last = replace(task("b", 10, version("v", 2, "u1", row), slack=1), let=ms(let), offset=ms(0))
    system = model(task("a", 10, version("v", 4), offset=0), last, task("z", 10, version("v", 1)))
    closed = replace(system.modes[0], edge=edge)
    found = find_conflict(replace(system, modes=(closed,)), closed, lambda: True)
    [text] = [conflict.describe(closed, found).message.partition("what it takes: ")[2]]
    expected = '"a" 4ms every 10ms from 0ms on "u1"; "b" 2ms every 10ms'
    assert text.startswith(expected)
    assert ("of the same cycle" in text, "execution time of 3ms" in text) == (let == 8, let == 3)
    assert "closed edge" not in text


def test_units_and_wcets():
    texts = remedies(packing(), ["a", "b", "c"])
    assert any(t.startswith('1 more unit like "c1"') for t in texts)
    assert any(t.startswith('WCET of "c" at most 3ms instead of 6ms') for t in texts)


def test_the_smallest_steps_and_which_are_proven():
    """2ms + 1.5ms are half a millisecond more than gcd(6ms, 15ms) = 3ms; slack counts like WCET: 0.5/6 = 0.083."""
    system = model(task("a", "6ms", version("v", "1.5ms")), task("b", "15ms", version("v", "2ms")))
    texts = remedies(system, ["a", "b"])
    proven = "; the next smaller step is proven not to suffice)"
    assert f'slack of "a" >= 0.09 (found sufficient, in steps of 1/100{proven}' in texts
    assert f'WCET of "a" at most 1ms instead of 1.5ms (found sufficient, in steps of 500us{proven}' in texts
    assert f'WCET of "b" at most 1.5ms instead of 2ms (found sufficient, in steps of 500us{proven}' in texts


def test_many_tasks_are_shortened_by_one_factor():
    """Four of 2.6 ms, one after the other, fit into 10 ms times 0.9615."""
    system = model(*(task(f"t{n}", "10ms", version("v", "2600us", CORES)) for n in range(8)), units=CORES)
    (text,) = (t for t in remedies(system) if t.startswith("WCETs"))
    assert text.startswith("WCETs of 8 tasks times 0.961 (found sufficient, in steps of 1/1000")


@pytest.mark.slow
def test_windows_offsets_and_limits():
    late = task("b", "10ms", version("v", "1ms", "u2", after("a", 0, 2)), offset="5ms")
    system = model(task("a", "10ms", version("v", "3ms", "u1"), offset="0ms"), late, units="u1 u2")
    texts = remedies(system, ["a", "b"])
    assert any(t.startswith('offset of "a" of 3ms instead of 0ms (found sufficient, in steps of 1ms') for t in texts)
    assert any(t.startswith('offset of "b" of 2ms instead of 5ms (found sufficient, in steps of 1ms') for t in texts)
    assert any(t.startswith('window of "b" on "a" up to 5ms instead of 2ms') for t in texts)
    ends = (task("a", 10, version("v", 3), offset="0ms"), task("b", 10, version("v", 2), offset="5ms"))
    slow = model(*ends, chains=[chain("c", "a b", age="6ms")])
    limits = 'limits of chain "c" of data age 7ms instead of 6ms (found sufficient, in steps of 1ms; with less'
    assert any(t.startswith(limits) for t in remedies(slow, ["a", "b"]))


def test_the_lower_end_of_a_window_is_tried_too():
    """b follows a by 1 to 2 ms and c follows b so: 2 to 4 ms in sum, where c asks for 7 to 8 ms after a."""
    rows = (("a", ()), ("b", (after("a", 1, 2),)), ("c", (after("b", 1, 2), after("a", 7, 8))))
    system = model(
        *(task(name, 20, version("v", 1, f"u{n}", *own)) for n, (name, own) in enumerate(rows)), units="u0 u1 u2"
    )
    texts = remedies(system, ["a", "b", "c"])
    assert any(t.startswith('window of "c" on "a" from 4ms instead of 7ms (found sufficient, in steps') for t in texts)
    assert any(t.startswith('window of "c" on "b" up to 5ms instead of 2ms (found sufficient, in steps') for t in texts)


@pytest.mark.slow
def test_a_split_task_may_need_one_more_gap():
    """Two jobs of a lie in the 10 ms of b, which ends in time only with a gap for each."""
    long = replace(version("v", 6, "u1"), split=Split(points=(ms(1), ms(4)), max_gaps=1))
    system = model(task("a", 5, version("v", 2, "u1"), offset=1), task("b", 10, long, offset=0))
    texts = remedies(system, ["a", "b"])
    assert any(t.startswith('max-gaps of "b" of 2 instead of 1 (found sufficient') for t in texts)


def test_slack_below_the_grid_of_the_other_times_is_of_use():
    """7 and 10 ms have gcd 1: with 1/4 of slack on each, 0.36 is the least found, where whole ticks need 0.4."""
    system = model(task("a", 7, version("v", 3), slack="1/5"), task("b", 10, version("v", 4), slack="3/10"))
    assert any(t.startswith('slack of "a", "b" >= 0.36') for t in remedies(system, ["a", "b"]))


def switching(limit):
    """To reach `on`, where b starts at 0 just when a has run for 6 ms, a must run first: the table takes 6 ms."""
    tasks = (
        task("a", 10, version("v", 6)),
        task("b", 10, version("v", 4, "u1", after("a", 6, 6)), offset=0),
        task("c", 10, version("v", 9), offset=0),
    )
    modes = [mode("on", tasks[:2]), mode("off", tasks[2:])]
    return model(*tasks, modes=modes, transitions=[("off", "on", limit)])


def test_a_switch_that_a_table_is_too_short_for_is_proven_to_be_impossible():
    found = explain(switching(1), ExplainOptions())
    assert found.switches == found.hopeless == (("off", "on"),)
    assert int(found.exit) == 4
    [proof] = [d for d in found.diagnostics if d.is_error]
    assert proof.code == codes.TABLE_TOO_SHORT.id
    assert '"a" starts 6ms before the mode begins' in proof.message
    [remedy] = [d for d in found.diagnostics if d.code == codes.REMEDY.id]
    assert remedy.message.startswith("max-length 6ms instead of 1ms (found sufficient: less is proven not to suffice)")


def test_a_switch_without_a_table_or_a_proof_is_explained_as_schedule_reports_it():
    """Without the offset of b, a may run at the begin of the mode, and only the search finds no table."""
    system = switching(1)
    tasks = (system.tasks[0], replace(system.tasks[1], offset=None), replace(system.tasks[2], slack=0))
    found = explain(replace(system, tasks=tasks), ExplainOptions())
    assert not found.hopeless
    assert codes.TABLE_TOO_SHORT.id not in found_codes(found)
    if found.switches:
        assert NO_TABLE.id in found_codes(found)


def test_switches_with_tables_have_no_findings():
    found = explain(switching(6), ExplainOptions())
    assert (found.switches, int(found.exit)) == ((), 0)
    assert {d.code for d in found.diagnostics} == {codes.SCHEDULABLE.id}


def test_jobs_that_stay_are_explained_as_with_schedule():
    """b fits anywhere but where the jobs of a, which stay, leave no gap that is long enough."""
    b = task("b", 20, version("v", 9))
    spread = task("a", 10, version("v", 2), slack=1)
    assert explain(model(spread, b), ExplainOptions()).exit == 0
    before = model(spread, task("b", 20, version("v", 1)))
    jobs = [job(before, "a", 0, 0, "u1"), job(before, "a", 1, 10, "u1")]
    found = explain(model(spread, b), ExplainOptions(shipped=schedule(before, 20, *jobs)))
    assert found.verdicts == (("all", Verdict.NOT_FOUND),)
    texts = [d.message for d in found.diagnostics if d.code == codes.REMEDY.id]
    assert any(text.startswith('jobs of "a" that need not stay') for text in texts)


def test_jobs_that_stay_and_exclude_each_other_are_a_proof():
    before = model(task("a", 10, version("v", 2), slack=1), task("b", 10, version("v", 2), slack=1))
    jobs = [job(before, "a", 0, 0, "u1"), job(before, "b", 0, 2, "u1")]
    longer = model(task("a", 10, version("v", 4), slack=1), task("b", 10, version("v", 2), slack=1))
    found = explain(longer, ExplainOptions(shipped=schedule(before, 10, *jobs)))
    assert (verdicts(found), int(found.exit)) == ([Verdict.INFEASIBLE], 4)
    assert {EXCLUDED.id, codes.REMEDY.id} <= found_codes(found)


def test_a_tick_that_is_too_coarse_is_a_proof():
    system = model(*(task(f"t{n}", 10, version("v", "50us")) for n in range(13)))
    found = explain(system, ExplainOptions(tick=ms(1), remedies=False))
    assert (verdicts(found), int(found.exit)) == ([Verdict.INFEASIBLE], 4)
    assert found_codes(found) == {search_codes.TOO_MANY_STARTS.id}
    assert verdicts(explain(system, ExplainOptions(tick=ms("500us")))) == [Verdict.SCHEDULABLE]


def test_jobs_that_cannot_stay_near_an_earlier_schedule_are_named_with_the_reason():
    before = model(task("a", 10, version("v", 2), slack=1), task("b", 10, version("v", 2), slack=1))
    jobs = [job(before, "a", 0, 0, "u1"), job(before, "b", 0, 2, "u1")]
    longer = model(task("a", 10, version("v", 4), slack=1), task("b", 10, version("v", 2), slack=1))
    found = explain(longer, ExplainOptions(near=schedule(before, 10, *jobs)))
    assert verdicts(found) == [Verdict.SCHEDULABLE]
    [near] = [d for d in found.diagnostics if d.code == NEAR.id]
    assert "a (has another WCET)" in near.message


def test_the_smallest_limit_is_searched_for():
    """Free, the search leaves the chain as long as it comes; c stands between a and b."""
    busy = task("c", 40, version("v", 3, "u1"), offset="5ms")
    ends = (task("a", 40, version("v", 5, "u1"), offset="0ms"), task("b", 40, version("v", 4, "u1")))
    system = model(*ends, busy, units="u1", chains=[chain("long", "a b", reaction="45ms", age="6ms")])
    (text,) = (t for t in remedies(system, ["a", "b"]) if t.startswith("limits"))
    assert "reaction time 52ms instead of 45ms and data age 12ms instead of 6ms" in text
    assert "with less, none was found" in text


def test_a_deadline_is_moved_no_further_than_it_must_be():
    """b waits for the 3ms of a, which are fixed; its jobs are of 4ms, and may slip by half their period."""
    fixed = task("a", 20, version("v", 3, "u1"), offset="0ms")
    late = task("b", 20, version("v", 4, "u1"), offset="0ms", deadline="5ms", slack=Fraction(1, 2))
    texts = remedies(model(fixed, late, units="u1"), ["b"])
    assert any(t.startswith('deadline of "b" of 7ms instead of 5ms (found sufficient, in steps of 1ms') for t in texts)


def test_several_kinds_of_units_together():
    """Two conflicts at once: neither kind of unit alone helps."""
    cpu = [task(f"a{k}", "10ms", version("v", "7ms", "cpu")) for k in range(2)]
    gpu = [task(f"b{k}", "10ms", version("v", "8ms", "gpu")) for k in range(2)]
    system = replace(model(*cpu, *gpu), units=(Unit(name="cpu", type="core"), Unit(name="gpu", type="gpu")))
    texts = remedies(system)
    assert texts[0].startswith('1 more unit of type "core" and 1 more unit of type "gpu"')
    bare = replace(system, units=(Unit(name="cpu"), Unit(name="gpu")))
    assert remedies(bare)[0].startswith('1 more unit like "cpu" and 1 more unit like "gpu"')


def test_no_more_units_of_a_kind_are_proposed_than_are_needed():
    cpu = [task(f"a{k}", "10ms", version("v", "7ms", "cpu")) for k in range(3)]
    gpu = [task(f"b{k}", "10ms", version("v", "8ms", "gpu")) for k in range(2)]
    system = replace(model(*cpu, *gpu), units=(Unit(name="cpu", type="core"), Unit(name="gpu", type="gpu")))
    assert remedies(system)[0].startswith('2 more units of type "core" and 1 more unit of type "gpu"')
    late = model(*(task(f"a{k}", 30, version("v", 7, "cpu"), offset=k) for k in range(3)), units="cpu")
    assert remedies(late)[0] == '2 more units like "cpu" (found sufficient; with less, none was found)'


def test_a_task_that_is_called_like_a_unit_is_not_taken_for_it():
    """What is broken on the unit `gpu` concerns the jobs that meet there, not the task of this name."""
    tasks = [task(name, "10ms", version("v", "4ms", "gpu cpu")) for name in ("a", "b", "gpu", "u job 0")]
    system = model(*tasks, units="gpu cpu")
    jobs = [job(system, name, 0, at, unit) for name, at, unit in (("a", 0, "gpu"), ("b", 1, "gpu"))]
    others = [job(system, name, 0, at, "cpu") for name, at in (("gpu", 0), ("u job 0", 5))]
    broken = [d for d in verify(system, schedule(system, "10ms", *jobs, *others)) if d.is_error]
    assert broken
    assert tasks_of(system, broken) == ("a", "b")


def test_witnesses_and_remedies_say_which_elements_they_are_about():
    """No two of three tasks fit on one of two units: the proof names all three, and changes what they change."""
    findings = explain(packing()).diagnostics
    proofs = [d for d in findings if d.is_error]
    assert proofs
    for proof in proofs:
        assert {Subject("task", name) for name in "abc"} <= set(proof.subjects)
    helping = [d for d in findings if d.code == codes.REMEDY.id]
    assert helping
    assert all({s.kind for s in d.subjects} & {"task", "unit", "chain"} for d in helping)


def test_a_mode_with_too_many_parts_has_no_conflict(monkeypatch):
    pytest.importorskip("ortools")

    monkeypatch.setattr("halpipe.pipeline.solve.exactmodel.MAX_PARTS", 3)
    assert find_conflict(packing(), packing().modes[0], lambda: True).answer is Answer.UNKNOWN


def test_a_change_that_the_search_refuses_is_no_remedy():
    """A period of 2^50 ns over a WCET of a billionth fills 64 bits."""
    tiny = Fraction(1, 10**9)
    system = model(
        task("a", Duration(2**50), version("v", Duration(7))), task("b", Duration(2**50), version("v", "1ms"))
    )
    trials = Trials("all", 2, lambda: True)
    assert trials.schedule(system) is not None
    assert trials.schedule(changes.with_wcet(system, ["a"], tiny)) is None


def test_where_nothing_helps_it_says_so():
    system = packing()
    (found,) = find_remedies(system, (), Trials("all", 5, lambda: False))
    assert found.code == codes.NO_REMEDY.id


def test_every_remedy_is_a_model_with_a_verified_schedule():
    explanation = explain(packing(), ExplainOptions(exact=False), budget=50)
    assert codes.REMEDY.id in found_codes(explanation)
    shorter = changes.with_wcet(packing(), ["c"], Fraction(1, 2))
    assert verdicts(explain(shorter)) == [Verdict.SCHEDULABLE]
    assert verdicts(explain(changes.more_units(packing(), "c1", 1))) == [Verdict.SCHEDULABLE]


def test_changes_touch_what_they_name_only():
    system = packing(task("d", "10ms", version("v", "1ms", "c3", access("m", 0, 1))))
    widened = changes.more_units(system, "c1", 2)
    assert [unit.name for unit in widened.units] == ["c1", "c2", "c3", "c1+1", "c1+2"]
    assert widened.task("a").versions[0].units == ("c1", "c2", "c1+1", "c1+2")
    assert widened.task("d") == system.task("d")
    again = changes.more_units(widened, "c1", 1)
    assert again.units[-1].name == "c1+1+"
    halved = changes.with_wcet(system, ["d"], Fraction(1, 2))
    assert halved.task("d").versions[0].accesses[0].end == Duration.parse("0.5ms")
    assert halved.task("a") == system.task("a")


def test_a_latency_limit_is_raised_to_what_a_schedule_keeps():
    """a writes at 20 and keeps the unit from 0 to 4 ms of every cycle, so that b starts at 24 and ends at 28 ms."""
    first = replace(task("a", "20ms", version("v", "4ms"), offset="0ms"), let=ms("20ms"))
    second = task("b", "20ms", version("v", "4ms"), slack=1)
    limited = Chain(name="stop", tasks=("a", "b"), max_latency=ms("25ms"))
    explanation = explain(replace(model(first, second), chains=(limited,)))
    assert any("latency 28ms instead of 25ms" in d.message for d in explanation.diagnostics)


def test_proofs_are_sound_where_requirements_refer_to_cycles_and_locks():
    """What a proof ignores, it must not take for a plain window: the model has a schedule."""
    row = Precedence(task="a", anchor=Anchor.END, to=Anchor.END, match=Match.CYCLE, max=ms("2ms"))
    first, second = task("a", "10ms", version("v", "4ms")), task("b", "10ms", version("v", "5ms", "u2", row))
    assert verdicts(explain(model(first, second, units="u1 u2"))) == [Verdict.SCHEDULABLE]


def test_a_remedy_that_the_annealer_misses():
    """On one unit: b after each second job of a, c within 4 to 7 ms of the end of a, and d every 12 ms at 8 ms."""
    pytest.importorskip("ortools")
    half = Fraction(1, 2)
    rows = [
        task("a", 12, version("v", 4), slack=half / 2),
        task("b", 24, version("v", 4, "u1", after("a", 3, 6, "end")), slack=half),
        task("c", 6, version("v", 1, "u1", after("a", 4, 7, "end")), slack=half),
        task("d", 12, version("v", 3), offset=ms(8)),
    ]
    shorter = [text for text in remedies(model(*rows)) if 'WCET of "b"' in text]
    assert [text.split(" (")[0] for text in shorter] == ['WCET of "b" at most 2ms instead of 4ms']
