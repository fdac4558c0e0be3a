"""Premises of proofs by hand: facts of tasks, relaxed models, steps of changes, and least lengths of switches."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, points, split

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO
from halpipe.core.options import options_of
from halpipe.models import Anchor, Edge, Match, Resource, ResourceKind, Split
from halpipe.pipeline.explain import remedies
from halpipe.pipeline.explain.explanation import ExplainOptions
from halpipe.pipeline.explain.facts import longest_piece, mode_facts
from halpipe.pipeline.explain.remedies import COARSE, FEW_JOBS, Trials
from halpipe.pipeline.explain.switches import least_length
from halpipe.pipeline.explain.witnesses import relaxed
from halpipe.pipeline.validate.context import Context
from support import access, after, chain, job, mode, model, ms, schedule, task, version


def facts_of(system, name="a"):
    """Return the facts of a task with its times in milliseconds, and all facts of its mode."""
    context = Context(system)
    facts = mode_facts(context.active[0], context.units)
    return facts.tasks.get(name), facts


def times(facts, *ticks):
    return [Fraction(each, facts.scale) / 10**6 for each in ticks]


@pytest.mark.parametrize(
    ("changes", "late", "core"),
    [
        ({}, 0, 3),
        ({"slack": Fraction(1, 5)}, 2, 1),
        ({"slack": Fraction(1)}, 7, -4),
        ({"slack": Fraction(1), "deadline": ms(4)}, 1, 2),
        ({"slack": Fraction(1), "deadline": ms(4), "distance": ms(20)}, 10, -7),
    ],
)
def test_a_job_is_as_late_as_slack_and_deadline_allow(changes, late, core):
    """Of what is longer than its delay, some part certainly runs."""
    own, facts = facts_of(model(replace(task("a", 10, version("v", 3)), **changes)))
    assert times(facts, own.late, own.core, own.least, own.most) == [late, core, 3, 3]


def test_facts_are_those_of_all_versions_that_can_be_used():
    versions = [version("v", 3, "u1"), version("w", 5, "u1 u2"), version("x", 1, "u3", after("gone", 0, 1))]
    system = model(task("a", 10, *versions), task("gone", 10, version()), units="u1 u2 u3")
    alone = replace(system, modes=(replace(system.modes[0], runs=system.modes[0].runs[:1]),))
    own, facts = facts_of(alone)
    assert times(facts, own.least, own.most) == [3, 5]
    assert own.units == {"u1", "u2"}
    assert own.sure_units() == frozenset()
    only = own.without({"w"})
    assert only.sure_units() == {"u1"}
    assert own.without({"v", "w"}) is None


def test_a_version_that_never_ends_in_time_is_no_fact():
    own, _ = facts_of(model(task("a", 10, version("v", 3), version("w", 6), deadline=5)))
    assert [usable.version.name for usable in own.versions] == ["v"]
    exactly, _ = facts_of(model(task("a", 10, version("v", 5), deadline=5)))
    assert exactly is not None


def test_interrupts_and_gaps_stretch_jobs():
    system = interrupts(model(task("a", 20, version("v", 3, "u1 u2"), deadline=9), units="u1 u2"), "u1", (5, 1))
    own, facts = facts_of(system)
    assert times(facts, own.least, own.most) == [3, 4]
    cut = replace(system.tasks[0], versions=(split(version("v", 4, "u2"), points(1)),))
    own, facts = facts_of(replace(system, tasks=(cut,)))
    assert times(facts, own.least, own.most, own.core, own.versions[0].piece) == [4, 9, 0, 3]
    gang = replace(system.tasks[0], versions=(version("v", 3, "u1 u2", gang=2),))
    own, facts = facts_of(replace(system, tasks=(gang,)))
    assert times(facts, own.least, own.most) == [3, 9]


def test_tasks_on_demand_have_as_many_jobs_as_are_certain():
    both = (version("v", 1, "u1", after("h", 0, 5)), version("w", 1, "u1", after("h", 0, 5), after("g", 0, 5)))
    system = model(
        task("a", 10, *both), task("b", 20, version()), task("h", None, version()), task("g", None, version())
    )
    _, facts = facts_of(system)
    assert {name: own.jobs for name, own in facts.tasks.items()} == {"a": 2, "b": 1, "h": 2}
    periodic, _ = facts_of(model(*system.tasks[1:2]), "b")
    assert periodic.jobs == 1


@pytest.mark.parametrize(
    ("how", "piece"),
    [
        (Split(), 10),
        (points(2, 5), 5),
        (points(2, 5, max_gaps=0), 10),
        (points(1, 2, 3, 4, 5, 6, 7, 8, 9, max_gaps=1), 5),
        (Split(anywhere=True), 0),
        (Split(anywhere=True, max_gaps=3), 2.5),
    ],
)
def test_some_piece_of_every_job_is_this_long(how, piece):
    assert longest_piece(split(version("v", 10), how), 40, Fraction(4, 10**6)) == int(4 * piece)


def test_an_access_phase_is_one_piece():
    phased = split(version("v", 10, "u1", access("r", 1, 4)), Split(anywhere=True))
    assert longest_piece(phased, 10, Fraction(1, 10**6)) == 3


def test_a_model_without_refined_requirements_is_its_own_relaxation():
    plain = model(task("a", 10, version("v", 3, "u1", access("r", 0, 1))), resources="r", chains=[chain("c", "a", 90)])
    assert relaxed(plain) is plain
    assert relaxed(replace(plain, tasks=(replace(plain.tasks[0], let=ms(8)),))).tasks[0].let is None
    locked = replace(plain, resources=(Resource(name="r", kind=ResourceKind.LOCK),))
    assert relaxed(locked).resources[0].kind is ResourceKind.MEMORY


def test_a_relaxed_model_keeps_what_every_schedule_keeps():
    rows = [
        replace(after("b", 1, 2), match=Match.CYCLE),
        replace(after("b", 3, 4), to=Anchor.END),
        replace(after("b", 5, 6, "release")),
    ]
    held = split(version("v", 6, "u1", access("spin", 1, 5), access("mem", 0, 1), *rows), points(3))
    first = replace(task("a", 10, held, deadline=9), let=ms(8))
    chains = [chain("c", "a b", 90), replace(chain("d", "b", 90), anchor=Anchor.START), chain("e", "b", 90)]
    system = model(first, task("b", 10, version("v", 1)), resources="spin mem", chains=chains)
    locks = (Resource(name="spin", kind=ResourceKind.LOCK), system.resources[1])
    system = replace(system, resources=locks, modes=(replace(system.modes[0], edge=Edge.CLOSED),))
    found = relaxed(system)
    own = found.tasks[0]
    assert (own.let, own.deadline, found.modes[0].edge) == (None, ms(8), Edge.OPEN)
    assert [c.name for c in found.chains] == ["e"]
    assert [(a.resource, a.start, a.end) for a in own.versions[0].accesses] == [
        ("spin", ms(1), ms(3)),
        ("spin", ms(3), ms(5)),
        ("mem", ms(0), ms(1)),
    ]
    windows = own.versions[0].precedences
    assert [(w.anchor, w.to, w.match) for w in windows] == [(Anchor.START, Anchor.START, Match.WINDOW)] * 3
    assert [(w.min, w.max > ms(10**6)) for w in windows] == [(ms(1), False), (ZERO, True), (ZERO, True)]
    assert all(resource.kind is ResourceKind.MEMORY for resource in found.resources)


def test_parameters_are_relaxed_by_the_tick_or_in_few_steps_where_jobs_are_many():
    few, many = (Trials("all", jobs, lambda: True, ms(1)) for jobs in (FEW_JOBS, FEW_JOBS + 1))
    assert [few.step(ms(n)) for n in (0, 1, 1000)] == [ms(1)] * 3
    assert [many.step(ms(n)) for n in (0, COARSE, COARSE + 1, 3 * COARSE)] == [ms(1), ms(1), ms(2), ms(3)]


def tried(monkeypatch, system, jobs):
    """Return the options of the search of one try."""
    seen = []

    def search(_, chosen, *__):
        seen.append(chosen)
        raise HalpipeError

    monkeypatch.setattr(remedies, "schedule_model", search)
    assert Trials("all", jobs, lambda: True, exact=False).schedule(system) is None
    return seen[0]


@pytest.mark.parametrize(("jobs", "budget"), [(0, 2000), (1, 2000), (200, 2000), (400, 1000), (10**6, 20)])
def test_a_search_for_a_remedy_is_shorter_where_jobs_are_many(monkeypatch, jobs, budget):
    assert tried(monkeypatch, model(task("a", 10, version("v", 3))), jobs).budget == budget


@pytest.mark.parametrize(
    ("jobs", "periods", "tick"),
    [
        (FEW_JOBS, (10, 20), ms("0.1ms")),
        (FEW_JOBS + 1, (10, 20), None),
        (1, (10, ms(100_000)), None),
        (1, (10, ms(99_990)), ms("0.1ms")),
    ],
)
def test_slacks_are_tried_on_their_grid_where_it_is_not_too_fine(monkeypatch, jobs, periods, tick):
    """Of a period of 10 ms, a slack of 1/100 is 0.1 ms; a period has fewer than a million of them."""
    short, long = periods
    system = model(
        task("a", short, version("v", 3), slack="1/100"), task("b", long, version("v", 3, "u2")), units="u1 u2"
    )
    assert tried(monkeypatch, system, jobs).tick == tick


def test_only_tasks_without_a_gap_that_are_in_one_piece_are_split():
    """Beside 2 ms in every 6, no version of 5 ms has a place in one piece; two other tasks have no schedule at all."""
    hopeless = [task(name, 10, version("v", 6, "u2")) for name in "xy"]
    short, long = task("short", 6, version("v", 2)), task("long", 12, version("v", 5), version("w", 5))
    anywhere = replace(long.versions[1], split=Split(anywhere=True, max_gaps=2))

    def split_tasks(*tasks):
        system = model(*tasks, *hopeless, units="u1 u2")
        found = remedies._relaxations(system, [*tasks], {*"xy", "short", "long"}, Trials("all", 9, lambda: True))
        return [each.text(1) for each in found if "cut" in each.text(1)]

    assert split_tasks(short, long) == ['"long" cut into pieces of at most 2.5ms (split)']
    assert split_tasks(short, replace(long, versions=(long.versions[0], anywhere))) == []
    assert split_tasks(short, replace(long, versions=(version("v", 4),))) == []


def test_parameters_are_relaxed_up_to_where_they_no_longer_matter():
    first = task("a", 10, version("v", 4), version("w", "2.5ms"), slack="1/5", deadline=5)
    cut = task("b", 20, split(version("v", 6, "u1", after("a", 3, 7)), Split(anywhere=True, max_gaps=2)), slack=1)
    rows = [first, replace(cut, deadline=ms(9)), task("c", 20, version("v", 1))]
    found = [*remedies._relaxations(model(*rows), rows, {*"abc"}, Trials("all", 4, lambda: True, ms(1)))]
    assert [(each.most, each.text(1), each.text(each.most)) for each in found if each.most] == [
        (1, *['deadline of "a" of 6ms instead of 5ms'] * 2),  # the longest version, as late as slack allows
        (31, 'deadline of "b" of 10ms instead of 9ms', 'deadline of "b" of 40ms instead of 9ms'),  # a period and slack
        (100, 'slack of "a", "c" >= 0.01', 'slack of "a", "c" >= 1'),
        (100, 'slack of "a" >= 0.01', 'slack of "a" >= 1'),
        (100, 'slack of "c" >= 0.01', 'slack of "c" >= 1'),
        (16, 'max-gaps of "b" of 3 instead of 2', 'max-gaps of "b" of 18 instead of 2'),
        (10, 'window of "b" on "a" up to 8ms instead of 7ms', 'window of "b" on "a" up to 17ms instead of 7ms'),
        (3, 'window of "b" on "a" from 2ms instead of 3ms', 'window of "b" on "a" from 0ms instead of 3ms'),
        (3, 'WCET of "a" at most 3ms instead of 4ms, 1ms instead of 2.5ms',
         'WCET of "a" at most 1ms instead of 4ms, 625us instead of 2.5ms'),
        (5, 'WCET of "b" at most 5ms instead of 6ms', 'WCET of "b" at most 1ms instead of 6ms'),
    ]  # fmt: skip
    finer = found[-1].finer
    assert (found[-1].most, finer.most, finer.text(9)) == (0, 9, 'WCET of "c" at most 100us instead of 1ms')


@pytest.mark.parametrize(("deadline", "most", "step"), [(60, 20, "2ms"), (100, 0, "1ms"), (199, -99, "1ms")])
def test_a_deadline_is_moved_in_few_steps_where_jobs_are_many(deadline, most, step):
    own = task("a", 200, version("v", 100), deadline=deadline)
    found = remedies._deadline(model(own), own, Trials("all", FEW_JOBS + 1, lambda: True, ms(1)))
    assert (found.most, found.steps) == (most, step)


@pytest.mark.parametrize(("jobs", "step"), [(FEW_JOBS, "1ms"), (FEW_JOBS + 1, "2ms")])
def test_limits_of_chains_are_lowered_in_few_steps_where_jobs_are_many(jobs, step):
    """From 60 ms, which a schedule keeps, towards the 20 ms that are asked for."""
    limited = chain("c", "a", reaction=20)
    asked, kept = {"max_reaction": ms(20)}, {"max_reaction": ms(60)}
    system = model(task("a", 10, version("v", 3)), chains=[limited])
    found = remedies._lowest(system, limited, asked, kept, Trials("all", jobs, lambda: False, ms(1)))
    assert (found.steps, found.text) == (step, 'limits of chain "c" of reaction time 60ms instead of 20ms')


@pytest.mark.parametrize(("at", "most", "ways"), [
    (3, 2, ["2ms", "3ms"]),
    (6, 5, ["2ms", "3ms", "4ms", "5ms", "6ms"]),
    (9, 2, ["0ms", "9ms"]),  # the shorter way, round the period
    (1, 0, []),
])  # fmt: skip
def test_an_offset_moves_the_shorter_way_round(at, most, ways):
    own = task("a", 10, version("v", 3), offset=1)
    system = model(own, task("b", 20, version("v", 1)))
    jobs = [job(system, "a", n, at + 10 * n, "u1") for n in range(2)]
    table = schedule(system, 20, *jobs).modes[0]
    found = remedies._offset(system, own, table, Trials("all", 3, lambda: True, ms(1)))
    offsets = [found.change(steps).task("a").offset for steps in range(1, most + 1)]
    assert (found.most, offsets) == (most, [*map(ms, ways)])
    assert most == 0 or found.text(most) == f'offset of "a" of {offsets[-1]} instead of 1ms'


def test_as_many_searches_are_made_as_are_left():
    trials = Trials("all", 1, lambda: True, left=1)
    easy = model(task("a", 10, version("v", 3)))
    assert trials.schedule(easy) is not None
    assert trials.schedule(easy) is None


def test_files_of_an_explanation_are_relative_to_its_pipeline_file():
    files = {each.name for each in options_of(ExplainOptions) if each.is_path("x.xml")}
    assert files == {"schedule", "freeze", "near", "quantise"}
    (seed,) = (each for each in options_of(ExplainOptions) if each.name == "seed")
    assert seed.from_text("0") == 0


# ------------------------------------------------------------------------------------------------ least lengths


def need(*versions, slack=0, offset=3, helper=None, second=None):
    """Return the length and tasks that the entering task `late` needs of a table, and its latest first start."""
    stays = task("stays", 10, version("v", 1))
    late = task("late", 10, *versions, slack=slack, offset=offset)
    helper = helper or task("helper", 10, version("v", 2, "u1"), version("w", 4, "u1"))
    tasks = [stays, late, helper, *([second] if second else [])]
    system = model(*tasks, modes=[mode("m", [stays]), mode("n", tasks)], transitions=[("m", "n", 1)])
    found = least_length(system, system.transitions[0])
    return None if found is None else (found.length, found.tasks, found.latest)


def test_a_table_is_as_long_as_what_must_come_before_the_first_job():
    ahead = version("v", 1, "u1", after("helper", 8, 9))
    assert need(ahead) == (ms(5), ("helper", "late"), ms(3))
    assert need(ahead, slack=Fraction(1, 5)) == (ms(3), ("helper", "late"), ms(5))
    assert need(ahead, offset=14) == (ms(4), ("helper", "late"), ms(4))
    assert need(ahead, offset=8) is None
    assert need(ahead, offset=None) is None
    assert need(version("v", 1, "u1", after("helper", 8, 9, "end"))) == (ms(7), ("helper", "late"), ms(3))


def test_of_predecessors_that_need_as_much_the_first_is_named():
    rows, second = [after("helper", 8, 9), after("second", 8, 9)], task("second", 10, version("v", 1))
    assert need(version("v", 1, "u1", *rows), second=second) == (ms(5), ("helper", "late"), ms(3))
    assert need(version("v", 1, "u1", *rows[::-1]), second=second) == (ms(5), ("second", "late"), ms(3))


def test_the_longest_way_of_predecessors_counts():
    """By 5 ms at once, or by 4 ms and 4 ms more."""
    helper, second = task("helper", 10, version("v", 1, "u1", after("second", 4, 9))), task("second", 10, version("v"))
    rows = [after("second", 5, 9), after("helper", 4, 9)]
    found = need(version("v", 1, "u1", *rows), helper=helper, second=second)
    assert found == (ms(5), ("second", "helper", "late"), ms(3))


def test_only_what_all_versions_demand_of_entering_tasks_is_certain():
    ahead, later = version("v", 1, "u1", after("helper", 8, 9)), version("w", 1, "u1", after("helper", 6, 9))
    assert need(ahead, later) == (ms(3), ("helper", "late"), ms(3))
    assert need(ahead, version("w")) is None
    assert need(version("v", 1, "u1", after("stays", 8, 9))) is None
    assert need(version("v", 1, "u1", after("helper", 8, 9, "release"))) is None
    assert need(version("v", 1, "u1", replace(after("helper", 8, 9), match=Match.CYCLE))) is None
    both = version("v", 1, "u1", after("helper", 8, 9), after("helper", 5, 9, "end"))
    assert need(both) == (ms(5), ("helper", "late"), ms(3))


def test_what_must_come_before_adds_up_along_predecessors():
    helper = task("helper", 10, version("v", 2, "u1", after("second", 4, 9)))
    second = task("second", None, version("v", 1))
    found = need(version("v", 1, "u1", after("helper", 8, 9)), helper=helper, second=second)
    assert found == (ms(9), ("second", "helper", "late"), ms(3))
