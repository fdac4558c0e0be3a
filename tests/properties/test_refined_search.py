"""The search keeps the requirements of MODEL 10: kernel, reference cost and verify agree on every placement."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scheduler_systems import random_model
from test_kernel_cost import dealt_jobs, is_complete, reference_cost, walk

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, milliseconds
from halpipe.models import Anchor, Edge, Match, ModeSchedule, Precedence, ResourceKind, Schedule, Status
from halpipe.pipeline.checked import schedule_model, validate_model
from halpipe.pipeline.jobs import expand, released
from halpipe.pipeline.solve.kernel.kernel import COST, total_cost
from halpipe.pipeline.solve.limits import stated_problem
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import verify
from profiles import examples, volume
from support import mode, model, ms, task, version

SEEDS = st.integers(0, 2**32)


def refined(seed, grain=1):
    """A random model with requirements on instants, cycles, locks, edges and LET, schedulable or not."""
    rng = random.Random(seed)
    system = random_model(seed, grain)
    lock = rng.choice((None, "r"))
    tasks = {t.name: t for t in system.tasks}

    def offset(task):
        return task if task.offset is not None or task.period is None else replace(task, offset=milliseconds(0))

    def window(task, row):
        before = tasks[row.task]
        anchor = rng.choice((Anchor.START, Anchor.END, Anchor.POINT, *([Anchor.RELEASE] if before.period else [])))
        shortest = min(v.wcet for v in before.versions)
        point = shortest * Fraction(rng.randrange(5), 4) if anchor is Anchor.POINT else None
        has_cycle = task.period is not None and before.period is not None and rng.random() < 0.5
        match = Match.CYCLE if has_cycle else Match.WINDOW
        return replace(row, anchor=anchor, point=point, to=rng.choice((Anchor.START, Anchor.END)), match=match)

    def change(task):
        versions = []
        for v in task.versions:
            accesses = [replace(a, bound=Fraction(1)) if a.resource == lock else a for a in v.accesses]
            rows = [window(task, p) for p in v.precedences]
            versions.append(replace(v, accesses=tuple(accesses), precedences=tuple(rows)))
        deadline = task.deadline or task.period
        let = deadline if task.period is not None and rng.random() < 0.3 else None
        return replace(task, versions=tuple(versions), let=let)

    changed = [change(t) for t in system.tasks]
    chains = []
    for c in system.chains:
        anchors = [None, Anchor.START, Anchor.END, *([Anchor.RELEASE] if tasks[c.tasks[0]].period else [])]
        latency = c.max_reaction if rng.random() < 0.5 else None
        found = replace(
            c, anchor=rng.choice(anchors), to=rng.choice((None, Anchor.START, Anchor.END)), max_latency=latency
        )
        chains.append(found)
    released = {p.task for t in changed for v in t.versions for p in v.precedences if p.anchor is Anchor.RELEASE}
    released |= {t.name for t in changed if t.let} | {c.tasks[0] for c in chains if c.anchor is Anchor.RELEASE}
    resources = [replace(r, kind=ResourceKind.LOCK) if r.name == lock else r for r in system.resources]
    modes = [replace(m, edge=rng.choice((Edge.OPEN, Edge.OPEN, Edge.CLOSED))) for m in system.modes]
    return replace(
        system,
        tasks=tuple(offset(t) if t.name in released else t for t in changed),
        chains=tuple(chains),
        resources=tuple(resources),
        modes=tuple(modes),
    )


def loosened(seed, grain=1):
    """The same with slack and without most offsets, so that the search chooses phases and releases."""
    rng, system = random.Random(seed), refined(seed, grain)

    def change(task):
        if task.period is None or rng.random() < 0.3:
            return task
        slack = rng.choice((task.slack, Fraction(1, 2), Fraction(1)))
        return replace(task, offset=None, slack=slack, deadline=task.deadline if slack < 1 else None)

    return replace(system, tasks=tuple(map(change, system.tasks)))


def usable(seed, grain=1, drawn=refined):
    system = drawn(seed, grain)
    assume(not any(d.is_error for d in validate_model(system)))
    return system


@examples(150)
@given(SEEDS)
def test_kernel_reference_and_verify_agree_on_every_placement(seed):
    system = usable(seed)
    expansion = expand(system, system.modes[0])
    try:
        problem = stated_problem(system, expansion, None, grouped=False, pinned={})
    except HalpipeError:
        assume(False)
    for number, state in enumerate(walk(problem, seed, 60)):
        assert state.register[COST] == total_cost(problem.arrays, state)
        if is_complete(problem, state) and number % 8 == 0:
            expected, terms = reference_cost(system, problem, state.start, state.option)
            assert state.register[COST] == expected
            assert (state.register[COST] == 0) == (terms.total <= 0)
            jobs = tuple(dealt_jobs(problem, state.start, state.option))
            table = ModeSchedule(name="one", hyperperiod=expansion.hyperperiod, status=Status.VALID, jobs=jobs)
            found = verify(system, Schedule(model=system.name, modes=(table,)))
            assert (state.register[COST] == 0) == (not any(d.is_error for d in found)), found


def outcome(system, options):
    """The first code of a refusal; "" for a schedule, which verify has accepted, or none."""
    try:
        found = schedule_model(system, options, lambda *_: True)
    except HalpipeError as failure:
        return failure.diagnostics[0].code
    errors = [d for d in verify(system, found.schedule) if d.is_error]
    return "HAL0903" if errors and found.is_complete else ""


@examples(60)
@given(SEEDS, st.sampled_from([1, 4]), st.sampled_from([None, "1ms"]))
def test_what_the_search_calls_valid_verifies(seed, grain, tick):
    options = SearchOptions(budget=100, tick=None if tick is None else Duration.parse(tick))
    for drawn in refined, loosened:
        assert outcome(usable(seed, grain, drawn), options) != "HAL0903"


def test_a_cycle_counts_from_jobs_whose_starts_all_lie_a_period_later():
    """The consumer has its phase in its first period, and slack that takes every start into the second."""
    source = task("source", 10, version("v", 1, "u1"), offset=8)
    row = Precedence(task="source", anchor=Anchor.END, match=Match.CYCLE, max=ms(5))
    follower = task("follower", 10, version("v", 2, "u2", row), slack=1)
    rest = task("rest", 20, version("v", 1, "u2"), offset=10)
    system = model(source, follower, rest, units="u1 u2")
    for seed in range(1, 9):
        assert schedule_model(system, SearchOptions(seed=seed), lambda *_: True).is_complete


@pytest.mark.slow  # the same with many more; above, a few
def test_what_the_search_calls_valid_of_many_systems_verifies():
    valid, count = 0, volume(500)
    for seed in range(count):
        system = loosened(seed, 1 + seed % 2 * 3)
        if not any(d.is_error for d in validate_model(system)):
            found = outcome(system, SearchOptions(budget=100))
            assert found != "HAL0903", f"seed {seed}"
            valid += 1
    assert valid > count // 2


@pytest.mark.parametrize("change", [{"let": ms(9)}, {}], ids=["let", "release"])
def test_the_search_chooses_releases_that_no_offset_fixes(change):
    """The jobs start at them; a window and a chain from a release are met."""
    before = replace(task("before", 10, version("v", 4, "u1"), slack=1), **change)
    row = Precedence(task="before", anchor=Anchor.RELEASE, max=ms(5))
    after = task("after", 20, version("v", 7, "u1 u2", row))
    system = model(before, after, units="u1 u2")
    assert released(system) == {"before"}
    found = schedule_model(system, SearchOptions(), lambda *_: True)
    assert found.is_complete
    starts = {(job.start - ms(10) * job.index) % ms(20) for job in found.schedule.modes[0].jobs if job.task == "before"}
    assert len(starts) == 1


def test_shipped_jobs_that_leave_their_releases_are_placed_anew():
    """Their releases are no longer those that an offset had fixed."""
    before = task("before", 10, version("v", 4, "u1"), slack=1, offset=0)
    other = task("other", 20, version("v", 5, "u1"), offset=0)
    row = Precedence(task="before", anchor=Anchor.RELEASE, max=ms(19))
    after = task("after", 20, version("v", 7, "u2", row))
    system = model(before, other, after, units="u1 u2")
    shipped = schedule_model(system, SearchOptions(), lambda *_: True).schedule
    free = replace(system, tasks=(replace(before, offset=None), other, after))
    found = schedule_model(free, SearchOptions(shipped=shipped), lambda *_: True)
    assert found.is_complete
    assert any("before" in str(d) for d in found.diagnostics)


@examples(30)
@given(SEEDS)
def test_switches_between_two_modes_verify(seed):
    system = usable(seed)
    (only,) = system.modes
    other = replace(only, name="two", runs=tuple(run for run in only.runs if run.task != system.tasks[0].name))
    both = replace(system, modes=(only, other))
    assume(not any(d.is_error for d in validate_model(both)))
    assert outcome(both, SearchOptions(budget=100)) != "HAL0903"


SENSOR = task("sensor", 20, version("v", 4, "u1"), offset=5)


@pytest.mark.parametrize(
    "row",
    [
        Precedence(task="sensor", anchor=Anchor.END, to=Anchor.END, max=ms(7)),
        Precedence(task="sensor", anchor=Anchor.RELEASE, max=ms(7)),
        Precedence(task="sensor", anchor=Anchor.POINT, point=ms(2), to=Anchor.END, max=ms(9)),
        Precedence(task="sensor", match=Match.CYCLE, min=ms(4), max=ms(9)),
    ],
    ids=["end", "release", "point", "cycle"],
)
@pytest.mark.parametrize("edge", list(Edge))
def test_a_mode_with_refined_windows_is_entered(row, edge):
    """The other mode has a job in progress at its end, and neither the sensor nor the actor."""
    actor = task("actor", 20, version("v", 3, "u2", row), slack=1)
    busy = task("busy", 20, version("v", 6, "u1"), offset=17, deadline=20)
    modes = [mode("one", (busy,)), replace(mode("two", (SENSOR, actor)), edge=edge)]
    system = model(SENSOR, actor, busy, units="u1 u2", modes=modes, transitions=(("one", "two", 30),))
    found = schedule_model(system, SearchOptions(), lambda *_: True)
    assert not any(d.is_error for d in verify(system, found.schedule))
    assert (found.schedule.transitions[0].length >= ms(3)) or edge is Edge.OPEN
