"""The exact engine rule by rule: what just fits is scheduled, a tick less is not. Verify sees every schedule."""

from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from random import Random

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.models import Anchor, Binding, Interrupt, Match, Mode, Run
from halpipe.pipeline import checked
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve import codes, exact, exactunits
from halpipe.pipeline.solve.exact import (
    PLAIN,
    Answer,
    Effort,
    ExactResult,
    is_small,
    solve_exact,
    solve_expansion,
    unknown_to_exact,
)
from halpipe.pipeline.solve.exactchains import Figures, TooLarge
from halpipe.pipeline.solve.exactmodel import build
from halpipe.pipeline.solve.exactunits import Groups, Line, Units, forms_of
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from support import access, after, chain, model, ms, small_model, task, version

pytest.importorskip("ortools")


def answer(system, effort=PLAIN):
    return solve_exact(system, system.modes[0], effort).status


def holds(system):
    return answer(system) is Answer.FEASIBLE


@pytest.mark.parametrize(("longest", "expected"), [("4ms", True), ("4.001ms", False)])
def test_exclusive_up_to_the_last_tick(longest, expected):
    system = model(task("a", "10ms", version("v", "6ms")), task("b", "10ms", version("v", longest)))
    assert holds(system) is expected


def test_jobs_wrap_round_the_hyperperiod():
    """63 ms of work in series in 25 ms: only as a pipeline over three hyperperiods (MODEL 3)."""
    units = "u1 u2 u3 u4"
    tasks = [task("t0", "25ms", version("v", "24ms", units))]
    for number, (wcet, before) in enumerate((("13ms", "24ms"), ("24ms", "13ms"), ("2ms", "24ms")), 1):
        follows = after(f"t{number - 1}", before, before)
        tasks.append(task(f"t{number}", "25ms", version("v", wcet, units, follows)))
    assert holds(model(*tasks, units=units))


@pytest.mark.parametrize(("slack", "expected"), [(Fraction(1, 4), True), (Fraction(6, 25), False), (0, False)])
def test_slack_with_a_free_phase(slack, expected):
    """Of the short task one job in three must give way to the long one, by up to 1 ms of 4."""
    short, long = task("s", "4ms", version("v", "1ms"), slack=slack), task("l", "12ms", version("v", "4ms"))
    assert holds(model(short, long)) is expected


def test_slack_that_is_no_whole_number_of_ticks_is_not_rounded():
    """4/3 ms of slack are enough for 4/3 ms of overlap, on a grid of 1 ms they would not be."""
    short = task("s", "4ms", version("v", "1ms"), slack=Fraction(1, 3))
    assert holds(model(short, task("l", "12ms", version("v", "13/3ms"))))


@pytest.mark.parametrize(("offset", "expected"), [("5ms", True), ("4ms", False)])
def test_offsets_fix_the_phase(offset, expected):
    first = task("a", "10ms", version("v", "5ms"), offset="0ms")
    assert holds(model(first, task("b", "10ms", version("v", "5ms"), offset=offset))) is expected


@pytest.mark.parametrize(("deadline", "expected"), [("2ms", True), ("1.999ms", False)])
def test_deadlines_bound_the_delay(deadline, expected):
    short = task("s", "4ms", version("v", "1ms"), slack=Fraction(1, 2), deadline=deadline)
    assert holds(model(short, task("l", "12ms", version("v", "4ms")))) is expected


def test_each_job_may_take_another_version():
    """Beside each of the long tasks only one of the two jobs has room."""
    choice = task("c", "10ms", version("fast", "6ms", "u1"), version("slow", "9ms", "u2"))
    long = (task("l", "20ms", version("v", "14ms", "u1")), task("m", "20ms", version("v", "11ms", "u2")))
    system = model(choice, *long, units="u1 u2")
    result = solve_exact(system, system.modes[0])
    assert {job.version for job in result.jobs if job.task == "c"} == {"fast", "slow"}


@pytest.mark.parametrize(("gang", "expected"), [(2, True), (3, False)])
def test_gangs_take_distinct_units_together(gang, expected):
    units = "u1 u2 u3"
    wide = task("w", "10ms", version("v", "6ms", units, gang=gang))
    assert holds(model(wide, task("n", "10ms", version("v", "5ms", units)), units=units)) is expected


@pytest.mark.parametrize(("bound", "expected"), [("1/3", True), ("0.334", False)])
def test_fractional_bounds_sum_exactly(bound, expected):
    tasks = [task(f"t{k}", "4ms", version("v", "4ms", f"u{k}", access("mem", 0, 4, "1/3"))) for k in (1, 2)]
    last = task("t3", "4ms", version("v", "4ms", "u3", access("mem", 0, 4, Fraction(bound))))
    assert holds(model(*tasks, last, units="u1 u2 u3", resources="mem")) is expected


@pytest.mark.parametrize(("anchor", "low", "high", "expected"), [("start", 5, 9, True), ("end", 6, 9, False)])
def test_windows_from_start_and_end(anchor, low, high, expected):
    """Both tasks fill the unit in turn: the second starts 5 ms after the start of the first, modulo 10 ms."""
    first = task("a", "10ms", version("v", "5ms"))
    assert holds(model(first, task("b", "10ms", version("v", "5ms", "u1", after("a", low, high, anchor))))) is expected


@pytest.mark.parametrize(("least", "expected"), [(0, False), (1, True), (9, True), (10, False)])
def test_a_task_with_a_free_phase_is_released_where_some_job_starts(least, expected):
    """However much slack it has, one of its jobs runs from there on, so that those of the other have to wait for it.

    With a follower in its cycle, its phase lies in the first period, and the release may be later than that.
    """
    follows = replace(after("a", least, least), anchor=Anchor.RELEASE)
    first = task("a", 10, version(), slack=Fraction(1, 2))
    second = task("b", 10, version("v", 1, "u1", follows))
    assert holds(model(first, second)) is expected
    counted = replace(after("a", 0, 20), match=Match.CYCLE)
    assert holds(model(first, second, task("c", 20, version("v", 1, "u2", counted)), units="u1 u2")) is expected


def test_a_window_may_reach_back_several_hyperperiods():
    first = task("a", "10ms", version("v", "2ms", "u1"), offset="0ms")
    second = task("b", "10ms", version("v", "2ms", "u1", after("a", "33ms", "33ms")))
    result = solve_exact(model(first, second), model(first, second).modes[0])
    assert {job.task: str(job.start) for job in result.jobs} == {"a": "0ms", "b": "3ms"}


def test_demands_follow_the_versions_chosen():
    """The version that demands a helper is the only one that fits, so both jobs of the helper are there."""
    helper = task("help", None, version("v", "1ms", "u2"))
    quick = version("quick", "2ms", "u1", after("help", 0, 20))
    owner = task("o", "5ms", version("slow", "4ms", "u1"), quick)
    system = model(owner, task("rest", "5ms", version("v", "3ms", "u1")), helper, units="u1 u2")
    result = solve_exact(system, system.modes[0])
    assert sorted(job.task for job in result.jobs) == ["help", "o", "rest"]
    alone = model(owner, helper, task("rest", "5ms", version("v", "1ms", "u1")), units="u1 u2")
    jobs = solve_exact(alone, alone.modes[0]).jobs
    assert ("help" in {j.task for j in jobs}) == ("quick" in {j.version for j in jobs})


def linked(count=24):
    """Tasks of several periods, some of them linked, on two kinds of units."""
    tasks = []
    for k in range(count):
        before = [after(f"t{k - 4}", 1, 40)] if k % 3 == 2 and k > 4 else []
        kind = "u1 u2 u3" if k % 2 else "v1 v2 v3"
        tasks.append(
            task(f"t{k}", (60, 120, 40)[k % 3 if not before else 1], version("v", 3 + 7 * k % 9, kind, *before))
        )
    return model(*tasks, units="u1 u2 u3 v1 v2 v3")


@pytest.mark.parametrize("work", [0.01, 3])
def test_the_number_of_workers_changes_nothing(work):
    system = linked()
    answers = [solve_exact(system, system.modes[0], Effort(work=work, workers=workers)) for workers in (1, 2, 8)]
    assert answers[0] == answers[1] == answers[2]


def test_units_are_dealt_when_all_starts_are_known(monkeypatch):
    """Both forms find a schedule, which verify accepts; where dealing fails, the other form answers."""
    system = linked()
    assert forms_of(expand(system, system.modes[0]), system.units) == [Groups, Units, Line]
    by_groups = solve_exact(system, system.modes[0]).jobs
    monkeypatch.setattr(exactunits.Groups, "deal", lambda self, solver: None)
    by_units = solve_exact(system, system.modes[0]).jobs
    assert len(by_groups) == len(by_units) > 0
    assert by_groups != by_units


@pytest.mark.parametrize(("count", "forms"), [(64, [Units, Line]), (65, [Units])])
def test_units_are_no_capacities_where_a_job_has_too_many_choices_of_them(count, forms):
    names = [f"u{n}" for n in range(count)]
    own = [task(f"t{n}", 10, version("v", 1, name)) for n, name in enumerate(names)]
    system = model(task("wide", 10, version("v", 1, " ".join(names))), *own, units=" ".join(names))
    assert forms_of(expand(system, system.modes[0]), system.units) == forms


def test_what_must_pass_the_end_is_not_called_infeasible_on_the_word_of_the_line(monkeypatch):
    """63 ms in a pipeline over 25 ms pass the end of the hyperperiod; on a line there is no room for them."""
    units = "u1 u2 u3"
    first = task("a", "25ms", version("v", "24ms", units), offset="10ms")
    system = model(first, task("b", "25ms", version("v", "13ms", units, after("a", "24ms", "24ms"))), units=units)
    monkeypatch.setattr(exactunits, "forms_of", lambda *_: [Line])
    assert answer(system, Effort(work=0.1)) is Answer.UNKNOWN
    monkeypatch.setattr(exactunits, "forms_of", lambda *_: [Groups])
    assert holds(system)


def board(seed):
    """Ten rectangles, cut out of a whole board: each is a job, and its height the bound on one resource."""
    rng = Random(seed)
    sides = [(1000, 60)]
    while len(sides) < 10:
        sides.sort(key=lambda side: side[0] * side[1])
        long, high = sides.pop()
        if high > 1 and rng.randrange(2):
            cut = rng.randrange(1, high)
            sides += [(long, cut), (long, high - cut)]
        else:
            cut = rng.randrange(long // 4, 3 * long // 4)
            sides += [(cut, high), (long - cut, high)]
    rng.shuffle(sides)
    tasks = [
        task(f"t{n}", 1000, version("v", long, f"u{n}", access("r", 0, long, Fraction(high, 60))))
        for n, (long, high) in enumerate(sides)
    ]
    return model(*tasks, units=" ".join(f"u{n}" for n in range(10)), resources="r")


def test_the_line_finds_boards_without_a_gap(monkeypatch):
    monkeypatch.setattr(exactunits, "forms_of", lambda *_: [Line])
    for seed in (1, 2, 3):
        assert answer(board(seed), Effort(work=3)) is Answer.FEASIBLE


def test_a_gang_may_take_units_of_several_kinds():
    """Two of three units, of which one is not like the others: they are shared out as a sum over the kinds."""
    wide = task("w", 10, version("v", 6, "u1 u2 u3", gang=2))
    own = task("n", 10, version("v", 7, "u3"))
    system = model(wide, own, task("m", 10, version("v", 4, "u1 u2 u3", gang=3)), units="u1 u2 u3")
    assert answer(system) is Answer.INFEASIBLE
    assert holds(model(wide, own, task("m", 10, version("v", 4, "u1 u2 u3", gang=2)), units="u1 u2 u3"))


@pytest.mark.parametrize(("age", "expected"), [("5ms", True), ("4.999ms", False)])
def test_chain_age(age, expected):
    tasks = (task("a", "10ms", version("v", "3ms")), task("b", "10ms", version("v", "2ms")))
    assert holds(model(*tasks, chains=[chain("c", "a b", age=age)])) is expected


@pytest.mark.parametrize(("reaction", "expected"), [("15ms", True), ("14.999ms", False)])
def test_chain_reaction(reaction, expected):
    """A stimulus that just misses a job waits 10 ms for the next, and is through 3 + 2 ms later."""
    tasks = (task("a", "10ms", version("v", "3ms")), task("b", "10ms", version("v", "2ms")))
    assert holds(model(*tasks, chains=[chain("c", "a b", reaction=reaction)])) is expected


def hard():
    """No two of the three fit on one unit."""
    return model(*(task(n, 10, version("v", c, "u1 u2")) for n, c in (("a", 7), ("b", 7), ("c", 6))), units="u1 u2")


def test_same_input_same_jobs():
    tasks = [task(f"t{k}", p, version("v", "1ms", "u1 u2"), slack=Fraction(1, 2)) for k, p in enumerate((4, 6, 6, 12))]
    system = model(*tasks, units="u1 u2")
    first = solve_exact(system, system.modes[0], Effort(seed=5))
    assert first.jobs
    assert solve_exact(system, system.modes[0], Effort(seed=5)) == first


def test_without_effort_the_answer_is_unknown_not_infeasible():
    assert answer(endless(), Effort(work=1e-9)) is Answer.UNKNOWN


def endless():
    """A set over which CP-SAT thinks for long: 48 tasks of all lengths fill twelve units to the last millisecond."""
    lengths = [150 + 37 * k * k % 201 for k in range(47)]
    units = " ".join(f"u{k}" for k in range(12))
    lengths.append(12 * 1000 - sum(lengths))
    tasks = [task(f"t{k}", 1000, version("v", length, units)) for k, length in enumerate(lengths)]
    return model(*tasks, units=units)


def test_it_stops_when_nobody_wants_more():
    result = solve_exact(endless(), endless().modes[0], Effort(work=None, go_on=lambda: False))
    assert result == ExactResult(Answer.UNKNOWN, stopped=True)
    assert not solve_exact(endless(), endless().modes[0], Effort(work=1e-9)).stopped


def test_the_search_can_be_stopped_in_the_exact_engine():
    with pytest.raises(HalpipeError) as failure:
        schedule_model(endless(), SearchOptions(engine="exact", effort=None), lambda *_: False)
    assert [d.code for d in failure.value.diagnostics] == [codes.INTERRUPTED.id]


def test_engine_of_the_search(monkeypatch):
    options = SearchOptions(engine="exact")
    tables = schedule_model(model(task("a", "4ms", version("v", "1ms"))), options, lambda *_: True).schedule
    assert tables.solver == "exact"
    with pytest.raises(HalpipeError) as failure:
        schedule_model(hard(), options, lambda *_: True)
    assert [d.code for d in failure.value.diagnostics] == [codes.EXACT_INFEASIBLE.id]
    assert int(failure.value.exit) == 3, "the solver's word alone is not called a proof"


@pytest.mark.parametrize(("stopped", "code", "exit"), [(True, codes.INTERRUPTED, 130), (False, codes.NOT_FOUND, 3)])
def test_an_unknown_answer_is_not_called_infeasible(monkeypatch, stopped, code, exit):
    monkeypatch.setattr(
        "halpipe.pipeline.solve.relay.solve_exact", lambda *_, **__: ExactResult(Answer.UNKNOWN, stopped=stopped)
    )
    with pytest.raises(HalpipeError) as failure:
        schedule_model(hard(), SearchOptions(engine="exact"), lambda *_: True)
    assert [d.code for d in failure.value.diagnostics] == [code.id]
    assert int(failure.value.exit) == exit


def test_a_tick_is_refused():
    from halpipe.core.durations import milliseconds

    with pytest.raises(HalpipeError) as failure:
        schedule_model(hard(), SearchOptions(engine="exact", tick=milliseconds(1)), lambda *_: True)
    assert [d.code for d in failure.value.diagnostics] == [codes.EXACT_TICK.id]


@pytest.mark.parametrize("how", ["shipped", "near"])
def test_it_is_refused_to_keep_what_it_would_move(how):
    before = checked.schedule_model(small_model(), SearchOptions(), lambda *_: True).schedule
    with pytest.raises(HalpipeError) as failure:
        checked.schedule_model(small_model(), SearchOptions(engine="exact", **{how: before}), lambda *_: True)
    assert {d.code for d in failure.value.diagnostics} == {codes.EXACT_KEEPS_NOTHING.id}


def test_the_install_line_where_ortools_is_missing(monkeypatch):
    monkeypatch.setattr(exact, "is_installed", lambda: False)
    with pytest.raises(HalpipeError) as failure:
        answer(hard())
    (found,) = failure.value.diagnostics
    assert found.code == codes.EXACT_MISSING.id
    assert "pip install ortools" in found.help


def test_large_modes_are_refused(monkeypatch):
    large = model(task("a", "1us", version("v", "0.5us")), task("b", "30ms", version("v", "0.1us")))
    assert not is_small(expand(large, large.modes[0]))
    with pytest.raises(HalpipeError) as failure:
        answer(large)
    assert [d.code for d in failure.value.diagnostics] == [codes.EXACT_TOO_LARGE.id]
    monkeypatch.setattr("halpipe.pipeline.solve.exactmodel.MAX_PARTS", 5)
    with pytest.raises(HalpipeError) as failure:
        answer(hard())
    assert [d.code for d in failure.value.diagnostics] == [codes.EXACT_TOO_LARGE.id]


def test_a_schedule_that_verify_refuses_does_not_get_out(monkeypatch):
    monkeypatch.setattr(exactunits.Units, "deal", lambda self, solver: {("a", 0): ("u2",)})
    with pytest.raises(HalpipeError) as failure:
        answer(model(task("a", "4ms", version("v", "1ms"))))
    assert failure.value.diagnostics[0].code == codes.EXACT_WRONG.id
    assert int(failure.value.exit) == 70


# ------------------------------------------------------------------------------------ preemption and interrupts


def interrupted(system, *names, wcet="1ms"):
    """Let an interrupt of 10 ms come to some units."""
    row = Interrupt(name="i", distance=ms("10ms"), wcet=ms(wcet))
    units = tuple(replace(u, interrupts=(row,) if u.name in names else ()) for u in system.units)
    return replace(system, units=units)


@pytest.mark.parametrize(("second", "expected"), [("3ms", True), ("3.001ms", False)])
def test_interrupts_lengthen_jobs(second, expected):
    """Each job of 3 ms takes 4 ms, that of a constraint from its end, too."""
    system = model(
        task("a", "8ms", version("v", "3ms")), task("b", "8ms", version("v", second, "u1", after("a", 0, 0, "end")))
    )
    assert holds(system)
    assert holds(interrupted(system, "u1")) is expected


def test_the_length_is_that_of_the_unit():
    """The job of 7 ms fits beside the other one only where no interrupt comes."""
    tasks = task("a", "8ms", version("v", "7ms", "u1 u2")), task("b", "8ms", version("v", "3ms", "u1 u2"))
    result = solve_exact(interrupted(model(*tasks, units="u1 u2"), "u1", wcet="2ms"), model(*tasks).modes[0])
    assert {(job.task, job.units) for job in result.jobs} == {("a", ("u2",)), ("b", ("u1",))}


def test_a_unit_on_which_a_job_would_be_late_leaves_the_others():
    """A job of 3 ms takes 4 ms beside the interrupt."""
    system = model(task("a", "8ms", version("v", "3ms", "u2 u1"), deadline="3ms"), units="u1 u2")
    assert holds(interrupted(system, "u1"))
    assert not holds(interrupted(system, "u1", "u2"))


def test_what_no_interrupt_leaves_time_for_is_not_placed():
    system = interrupted(model(task("a", "20ms", version("v", "1ms"))), "u1", wcet="10ms")
    assert answer(system) is Answer.INFEASIBLE


def spread(gang=1, anchor="start", binding=Binding.JOB, more=()):
    last = replace(after("a", 0, 8, anchor), point=ms("1ms") if anchor == "point" else None)
    tasks = [
        task("a", "8ms", version("v", "2ms", "u1 u2", gang=gang), *more),
        task("b", "8ms", version("v", "1ms", "u2", last)),
    ]
    tasks[0] = replace(tasks[0], binding=binding)
    system = interrupted(model(*tasks, units="u1 u2"), "u1")
    runs = system.modes[0].runs
    return replace(system, modes=(replace(system.modes[0], name="n1", runs=runs), replace(system.modes[0], runs=runs)))


@pytest.mark.parametrize(
    ("system", "element"),
    [
        (spread(gang=2), 'gang of task "a" over units with different interrupts'),
        (spread(gang=2, more=[version("w")]), 'gang of task "a" over units with different interrupts'),
        (spread(anchor="point"), 'point of task "a", which lies elsewhere with the interrupts of each unit'),
        (spread(binding=Binding.SYSTEM), 'binding of task "a" to the units of another mode'),
    ],
)
def test_a_refusal_names_the_element(system, element):
    with pytest.raises(HalpipeError) as refused:
        schedule_model(system, SearchOptions(engine="exact"), lambda *_: True)
    [found] = refused.value.diagnostics
    assert (found.code, found.message) == (codes.EXACT_ELEMENT.id, f"does not know: {element}")


@pytest.mark.parametrize(
    "system",
    [
        spread(),
        replace(spread(gang=2), units=interrupted(spread(), "u1", "u2").units),
        replace(spread(anchor="point"), units=interrupted(spread(), "u1", "u2").units),
        interrupted(model(task("a", 8, version("v", 2, "u1 u2", gang=2)), units="u1 u2"), "u1", "u2"),
    ],
)
def test_gangs_and_points_on_units_that_are_alike_and_single_units_that_are_not_are_known(system):
    assert list(unknown_to_exact(system, expand(system, system.modes[0]))) == []


def test_a_part_of_a_mode_is_decided_by_what_is_left_of_it():
    """Of two tasks that do not fit, one does; a chain through the other says nothing then; nothing always fits."""
    chains = [chain("c", "a b", reaction=1)]
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)), chains=chains)
    whole = expand(system, system.modes[0])
    for tasks, expected in ((2, Answer.INFEASIBLE), (1, Answer.FEASIBLE), (0, Answer.FEASIBLE)):
        assert solve_expansion(system, replace(whole, tasks=whole.tasks[:tasks])).status is expected


def test_jobs_of_a_bound_task_share_their_unit():
    choice = task("c", "10ms", version("v", "6ms", "u1 u2"))
    long = task("l", "20ms", version("v", "9ms", "u1 u2")), task("m", "20ms", version("v", "5ms", "u1 u2"))
    loose = model(choice, *long, units="u1 u2")
    assert holds(loose)
    bound = replace(loose, tasks=(replace(choice, binding=Binding.MODE), *long))
    result = solve_exact(bound, bound.modes[0])
    assert len({job.units for job in result.jobs if job.task == "c"}) == 1


def test_a_version_whose_predecessor_does_not_run_is_never_taken():
    """Nor one that is longer than the hyperperiod, of which no job would have an end."""
    needs = version("needs", 1, "u1", after("gone", 0, 9))
    tasks = task("a", 10, needs, version("long", 11), version("plain", 2), deadline=30), task("gone", 10, version())
    runs = (Run(task="a", versions=("needs", "long", "plain")),)
    system = model(*tasks, modes=[Mode(name="all", runs=runs)])
    [job] = solve_exact(system, system.modes[0]).jobs
    assert job.version == "plain"


@pytest.mark.parametrize(
    ("age", "offset", "expected"), [(7, 6, True), ("6.9ms", 6, False), ("25.9ms", 5, False), (26, 5, True)]
)
def test_a_let_writes_at_its_end_however_late_its_job_starts(age, offset, expected):
    """a is released at 0 and starts at 3 ms, writes at 6 ms, and b reads that at its offset, or 20 ms later."""
    busy, reads = task("busy", 20, version("v", 3), offset=0), task("b", 20, version("v", 1, "u2"), offset=offset)
    writes = replace(task("a", 20, version("v", 2), offset=0, slack="1/2"), let=ms(6))
    assert holds(model(busy, writes, reads, units="u1 u2", chains=[chain("c", "a b", age=age)])) is expected


@pytest.mark.parametrize("slack", [0, "1/2"])
@pytest.mark.parametrize(
    ("anchor", "to", "age", "reaction"),
    [
        (None, None, 9, 29),  # from 0, where a reads, to the end of c; just missed, from there on for 20 ms more
        (Anchor.START, Anchor.END, 9, 29),
        (Anchor.END, None, 7, 27),
        (Anchor.END, Anchor.START, 6, 26),
        (Anchor.START, Anchor.START, 8, 28),
    ],
)
def test_latencies_count_between_the_instants_that_a_chain_states(anchor, to, age, reaction, slack):
    """a runs to 2 ms, since its unit is full from there on, b from 5 to 6 ms and c from 8 to 9 ms."""
    full, first = task("full", 20, version("v", 18), offset=2), task("a", 20, version("v", 2), offset=0, slack=slack)
    others = [task(name, 20, version("v", 1, "u2"), offset=at) for name, at in (("b", 5), ("c", 8))]
    for limits, is_possible in (
        ((reaction, age), True),
        ((reaction, f"{age - 1}.9ms"), False),
        ((f"{reaction - 1}.9ms", age), False),
    ):
        for tasks in ("a b c", "a c"):
            counted = replace(chain("c", tasks, *limits), anchor=anchor, to=to)
            assert holds(model(full, first, *others, units="u1 u2", chains=[counted])) is is_possible, limits
    for latency, is_possible in ((age, True), (f"{age - 1}.9ms", False)):
        counted = replace(chain("c", "a b c"), anchor=anchor, to=to, max_latency=ms(latency))
        assert holds(model(full, first, *others, units="u1 u2", chains=[counted])) is is_possible, latency


@pytest.mark.parametrize(("age", "expected"), [(3, True), ("2.9ms", False)])
def test_of_a_let_an_age_may_count_from_the_start_of_its_job(age, expected):
    """a is released at 0 and starts at 3 ms at the latest, so that it ends within 5 ms; b ends at 6 ms."""
    writes = replace(task("a", 10, version("v", 2), offset=0, slack="1/2"), let=ms(5))
    reads = task("b", 10, version("v", 1, "u2"), offset=5)
    counted = replace(chain("c", "a b", age=age), anchor=Anchor.START)
    assert holds(model(writes, reads, task("z", 20, version()), units="u1 u2", chains=[counted])) is expected


def test_a_release_that_others_count_from_may_be_the_phase_itself():
    """b is at 3 ms, so that a is released at 0; the jobs of one cycle of a and c start together."""
    counted = replace(after("a", 3, 3), anchor=Anchor.RELEASE)
    system = model(
        task("a", 10, version(), slack="1/2"),
        task("b", 10, version("v", 1, "u2", counted), offset=3),
        task("c", 10, version("v", 1, "u3", replace(after("a", 0, 0), match=Match.CYCLE)), offset=0),
        task("z", 20, version("v", 1, "u4")),
        units="u1 u2 u3 u4",
    )
    assert holds(system)


@pytest.mark.parametrize(("most", "is_refused"), [(2**62 - 1, False), (2**62, True)])
def test_keys_by_which_jobs_of_a_chain_are_compared_stay_within_64_bits(most, is_refused):
    system = model(task("a", 10, version()))
    figures = Figures(build(expand(system, system.modes[0]), system, (), Groups), chain("c", "a"))
    with pytest.raises(TooLarge) if is_refused else nullcontext():
        figures._chosen([], [], [], 1, most)


@pytest.mark.parametrize(("age", "expected"), [(22, True), ("21.9ms", False)])
def test_data_that_is_written_while_a_job_runs_is_for_the_next_one(age, expected):
    """c runs from 1 to 4 ms, and a ends at 2 ms: what c has is that of the cycle before, even if ends are counted."""
    first, last = task("a", 20, version("v", 2), offset=0), task("c", 20, version("v", 3, "u2"), offset=1)
    counted = replace(chain("c", "a c", age=age), anchor=Anchor.END)
    assert holds(model(first, last, units="u1 u2", chains=[counted])) is expected


@pytest.mark.parametrize(
    ("anchor", "age", "expected"),
    [(Anchor.END, 1, True), (Anchor.START, 2, True), (Anchor.START, 1, False), (None, 2, True), (None, 1, False)],
)
def test_the_age_of_a_chain_of_one_task_is_that_between_its_own_instants(anchor, age, expected):
    counted = replace(chain("c", "a", age=age), anchor=anchor)
    assert holds(model(task("a", 20, version("v", 2)), chains=[counted])) is expected


@pytest.mark.parametrize(("age", "expected"), [(24, True), ("23.9ms", False)])
def test_data_of_a_task_of_several_versions_is_written_at_the_end_of_the_one_taken(age, expected):
    """Only the version of 4 ms has room; b reads at 3 ms what the job before that has written."""
    either = task("a", 20, version("v", 2, "u1"), version("w", 4, "u2"), offset=0)
    others = task("full", 20, version("v", 20)), task("b", 20, version("v", 1, "u3"), offset=3)
    assert holds(model(either, *others, units="u1 u2 u3", chains=[chain("c", "a b", age=age)])) is expected


@pytest.mark.parametrize(
    ("anchor", "to", "least"),
    [(None, None, 2), (Anchor.START, Anchor.END, 2), (Anchor.END, None, 0), (None, Anchor.START, 0)],
)
def test_the_latency_of_a_chain_of_one_task_is_that_between_its_own_instants(anchor, to, least):
    counted = replace(chain("c", "a"), anchor=anchor, to=to)
    system = model(task("a", 20, version("v", 2)), chains=[replace(counted, max_latency=ms(max(1, least)))])
    assert holds(system)
    if least:
        assert not holds(replace(system, chains=(replace(counted, max_latency=ms("1.9ms")),)))


@pytest.mark.parametrize(("slack", "expected"), [("2/5", True), ("3/10", False)])
def test_jobs_of_one_cycle_are_compared_where_they_really_start(slack, expected):
    """The second job of a waits until 23 ms, which is 3 ms of the next cycle, and that of c has to come 1 ms later."""
    full, first = task("full", 20, version("v", 5), offset=18), task("a", 10, version(), offset=8, slack="1/2")
    follows = task("c", 10, version("v", 1, "u2", replace(after("a", 0, 1), match=Match.CYCLE)), offset=9, slack=slack)
    assert holds(model(full, first, follows, units="u1 u2")) is expected
