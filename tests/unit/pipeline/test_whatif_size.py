"""The smallest platform: what is found is enough and verified, what is proven holds, and nothing else is claimed."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.models import Interrupt, Unit
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.whatif import codes
from halpipe.pipeline.whatif.size import (
    SizeOptions,
    _most_at_once,
    ask,
    complaint,
    fewest_units,
    largest_factor,
    lowest_bandwidth,
    of_modes,
    question_of,
)
from halpipe.pipeline.whatif.trial import (
    Bracket,
    Search,
    TimeUpError,
    bracket,
    neighbours,
    peak_bound,
    proofs,
    time_limit,
    with_bandwidth,
    with_factor,
    with_units,
)
from support import access, after, chain, mode, model, ms, task, version


def typed(system, **types):
    """Give the units types: ``core="a b"``."""
    type_of = {name: type for type, names in types.items() for name in names.split()}
    units = tuple(Unit(name=unit.name, type=type_of.get(unit.name, "")) for unit in system.units)
    return replace(system, units=units)


def search(**options):
    return Search(SearchOptions(**{"budget": 200} | options), lambda *_: True, lambda: True)


def cores(count):
    return " ".join(f"c{n}" for n in range(1, count + 1))


def parallel(number, units):
    """Tasks that each need more than half of a unit, so that every one needs its own."""
    tasks = [task(f"t{n}", 10, version("v", 6, cores(units))) for n in range(number)]
    return typed(model(*tasks, units=cores(units)), core=cores(units))


# ------------------------------------------------------------------------------------------------ units


@pytest.mark.parametrize("present", [1, 2, 3, 6])
def test_fewest_units_whatever_the_model_has(present):
    answer = ask(fewest_units(parallel(3, present), "core"), search())
    assert (answer.found, answer.bound, answer.failed) == (3, 2, (2,))
    assert answer.question.now == present
    assert complaint(answer) is None
    assert answer.witness


def test_no_unit_of_a_type_is_needed_where_others_do():
    tasks = [task("a", 10, version("v", 2, "c1 d1"))]
    answer = ask(fewest_units(typed(model(*tasks, units="c1 d1"), core="c1", dsp="d1"), "core"), search())
    assert (answer.found, answer.bound, answer.witness) == (0, 0, ())


def test_a_gang_keeps_its_units():
    tasks = [task("a", 10, version("v", 2, cores(3), gang=2))]
    answer = ask(fewest_units(typed(model(*tasks, units=cores(3)), core=cores(3)), "core"), search())
    assert (answer.found, answer.bound) == (2, 2)
    assert [d.code for d in answer.witness] == [codes.LAST_VERSION.id]
    assert "needs 2 units and has 1" in answer.witness[0].message


def test_no_number_of_units_helps_a_task_beside_its_type():
    tasks = [task("a", 10, version("v", 6, "d1")), task("b", 10, version("v", 6, "d1"))]
    tasks += [task("c", 10, version("v", 1, "c1"))]
    answer = ask(fewest_units(typed(model(*tasks, units="c1 d1"), core="c1", dsp="d1"), "core"), search())
    assert (answer.found, answer.bound) == (None, None)
    assert complaint(answer).code == codes.IMPOSSIBLE.id
    assert [d.code for d in answer.witness] == ["HAL0280"]


def test_units_that_are_not_alike_are_pointed_out_and_the_bound_holds_for_any_choice():
    """Leaving out the last unit leaves task b none, but the model could do with c2 alone."""
    tasks = [task("a", 10, version("v", 2, cores(2))), task("b", 10, version("v", 2, "c2"))]
    system = typed(model(*tasks, units=cores(2)), core=cores(2))
    placed = (replace(unit, at=Location("model.xml", line)) for line, unit in enumerate(system.units, 1))
    question = fewest_units(replace(system, units=tuple(placed)), "core")
    assert [(d.code, d.at.line) for d in question.warnings] == [(codes.UNLIKE_UNITS.id, 1)]
    answer = ask(question, search())
    assert (answer.found, answer.bound) == (2, 1)
    assert answer.failed == (1,)


def test_modes_one_by_one_and_alone():
    """Mode busy needs two units, mode idle one; a task that does not run in the mode keeps its names known."""
    a, b = task("a", 10, version("v", 6, cores(2))), task("b", 10, version("v", 6, cores(2)))
    modes = [mode("idle", [a]), mode("busy", [a, b])]
    system = typed(model(a, b, units=cores(2), modes=modes), core=cores(2))
    assert ask(fewest_units(of_modes(system, ""), "core"), search()).found == 2
    assert ask(fewest_units(of_modes(system, "idle"), "core"), search()).found == 1


def test_switches_count_where_they_are_asked_for():
    """One unit is enough for both modes, but the only switch must take no time, which offsets forbid."""
    first = task("a", 10, version("v", 4, cores(2)), offset=8)
    second = task("b", 10, version("v", 4, cores(2)), offset=0)
    modes = [mode("one", [first]), mode("two", [second])]
    system = model(first, second, units=cores(2), modes=modes, transitions=[("one", "two", 0)])
    question = fewest_units(typed(system, core=cores(2)), "core")
    assert ask(question, search()).found == 1
    strict = Search(SearchOptions(budget=200), lambda *_: True, lambda: True, switches=True)
    answer = ask(question, strict)
    assert answer.found != 1
    assert 1 in answer.failed


@pytest.mark.parametrize(
    ("gang", "units", "reason", "left"),
    [(1, "c2", "needs 1 unit and has 0", "u"), (2, "c1 c2", "needs 2 units and has 1", "c1")],
)
def test_a_version_without_its_units_says_how_many_and_stays_well_formed(gang, units, reason, left):
    a = task("a", 10, version("v", 6, units, gang=gang))
    system = typed(model(a, task("b", 10, version("v", 1, "u")), units="u c1 c2"), core="c1 c2")
    changed = with_units(system, "core", 1)
    [lost] = changed.lost
    assert reason in lost.message
    own = changed.model.task("a").versions[0]
    assert (own.units, own.gang) == ((left,), 1)


@pytest.mark.parametrize(("stated", "limit"), [({}, 15), ({"deadline": ms(8)}, 3), ({"deadline": ms(2)}, 0)])
def test_a_task_that_polls_has_the_time_that_the_deadline_leaves_after_a_period(stated, limit):
    polls = replace(task("a", 5, version()), distance=ms(20), **stated)
    assert time_limit(polls) == ms(limit)


def test_a_job_that_polls_may_have_begun_a_period_before():
    """So one more of its jobs may need a unit at one instant."""
    counts = {}
    for distance in (None, ms(20)):
        active = SimpleNamespace(task=replace(task("a", 5, version()), distance=distance, deadline=ms(8)))
        counts[distance] = _most_at_once(SimpleNamespace(most_jobs={"a": 9}, tasks={"a": active}), lambda _: 1)
    assert counts == {None: 2, ms(20): 2}


# ------------------------------------------------------------------------------------------------ bandwidth, factor


def test_lowest_bandwidth_of_phases_side_by_side():
    """Strictly periodic phases of 6 ms in 10 ms overlap on two units; their bounds of 0.2 sum to 0.4."""
    tasks = [task(name, 10, version("v", 6, "c1 c2", access("mem", 0, 6, "0.2"))) for name in "ab"]
    answer = ask(lowest_bandwidth(model(*tasks, units="c1 c2", resources="mem"), "mem"), search())
    assert (answer.found, answer.bound) == (Fraction(2, 5), Fraction(2, 5))


def test_more_bandwidth_than_there_is():
    tasks = [task(name, 10, version("v", 6, "c1 c2", access("mem", 0, 6, "0.75"))) for name in "ab"]
    answer = ask(lowest_bandwidth(model(*tasks, units="c1 c2", resources="mem"), "mem", Fraction(1, 4)), search())
    assert (answer.found, answer.bound) == (Fraction(3, 2), Fraction(3, 2))


@pytest.mark.parametrize(
    ("phases", "most"),
    [
        ((), "0"),
        (((0, 2, "0.2"), (1, 3, "0.5"), (3, 4, "0.6")), "0.7"),
        (((0, 2, "0.5"), (2, 4, "0.25")), "0.5"),
        (((0, 1, "0.1"), (2, 4, "0.25")), "0.25"),
    ],
)
def test_a_version_claims_at_most_what_its_phases_claim_at_one_instant(phases, most):
    own = [access("mem", start, end, bound) for start, end, bound in phases]
    assert peak_bound(version("v", 4, "u", *own, access("other", 0, 4, 1)), "mem") == Fraction(most)


def test_a_version_that_claims_too_much_gives_way_to_another():
    fast, slow = version("fast", 2, "c1", access("mem", 0, 2, 1)), version("slow", 5, "c1", access("mem", 0, 5, "0.1"))
    system = model(task("a", 10, fast, slow), units="c1", resources="mem")
    assert ask(lowest_bandwidth(system, "mem"), search()).found == Fraction(1, 10)
    assert [run.versions for run in with_bandwidth(system, "mem", Fraction(1, 2)).model.modes[0].runs] == [("slow",)]


def test_answers_are_hundredths_where_nothing_else_is_asked_for():
    system = model(task("a", 10, version("v", 3, "c1", access("mem", 0, 3, "0.5"))), units="c1", resources="mem")
    for asked in (SizeOptions(wcet_factor=True), SizeOptions(bandwidth="mem")):
        assert question_of(system, asked).step == Fraction(1, 100)
    assert largest_factor(system).step == lowest_bandwidth(system, "mem").step == Fraction(1, 100)
    assert question_of(system, SizeOptions(wcet_factor=True, step=Fraction(1, 8))).step == Fraction(1, 8)


@pytest.mark.parametrize(("step", "found"), [(Fraction(1, 100), "1.66"), (Fraction(1, 3), "5/3"), (Fraction(1), "1")])
def test_largest_factor_is_exact_on_its_grid(step, found):
    tasks = [task("a", 10, version("v", 6, "c1")), task("b", 10, version("v", 3, "c2"))]
    answer = ask(largest_factor(model(*tasks, units="c1 c2"), step), search())
    assert (answer.found, answer.bound) == (Fraction(found), Fraction(found))


def test_a_version_that_cannot_be_chosen_any_more_bounds_no_factor():
    system = model(task("a", 10, version("fast", 2), version("slow", 6)))
    answer = ask(largest_factor(system), search())
    assert (answer.found, answer.bound) == (Fraction(5), Fraction(5))


def test_a_factor_below_one_where_the_model_has_too_much_work():
    tasks = [task(name, 10, version("v", 8, "c1")) for name in "ab"]
    answer = ask(largest_factor(model(*tasks, units="c1")), search())
    assert (answer.found, answer.bound) == (Fraction(62, 100), Fraction(62, 100))


def test_a_chain_limit_bounds_the_factor():
    tasks = [task("a", 100, version("v", 6, "c1")), task("b", 100, version("v", 4, "c1"))]
    system = model(*tasks, units="c1", chains=[chain("c", "a b", age=20)])
    answer = ask(largest_factor(system), search())
    assert (answer.found, answer.bound) == (2, 2)
    assert [d.code for d in answer.witness] == ["HAL0265"]


def test_windows_from_the_end_prove_nothing_of_factors():
    """A shorter WCET can break such a window, so that a witness of that kind says nothing of larger factors."""
    tasks = [
        task("a", 10, version("v", 2, "c1"), offset=0),
        task("b", 10, version("v", 2, "c2", after("a", 2, 2, "end")), offset=6),
    ]
    system = model(*tasks, units="c1 c2")
    answer = ask(largest_factor(system, Fraction(1)), search())
    assert (answer.found, answer.bound, answer.failed) == (2, 5, (5, 4, 3))
    assert proofs(with_factor(system, Fraction(1)))  # the witness exists all the same


def test_the_scale_of_a_factor_takes_the_phases_along():
    system = model(task("a", 10, version("v", 4, "c1", access("mem", 1, 2))), units="c1", resources="mem")
    changed = with_factor(system, Fraction(3, 2)).model.tasks[0].versions[0]
    assert (changed.wcet, changed.accesses[0].start, changed.accesses[0].end) == (ms(6), ms("1.5"), ms(3))


# ------------------------------------------------------------------------------------------------ trouble


def test_what_interrupts_make_too_long_bounds_the_factor():
    """An interrupt takes 4 of every 10 ms; at 7/4 of its WCET the job would be over after 11 ms."""
    system = model(task("a", 10, version("v", 4)))
    served = (Interrupt(name="i", distance=ms(10), wcet=ms(4)),)
    system = replace(system, units=(replace(system.units[0], interrupts=served),))
    assert ask(largest_factor(system, Fraction(1, 4)), search()).found == Fraction(3, 2)


def test_what_no_size_mends_is_refused_at_once():
    with pytest.raises(HalpipeError) as failed:
        of_modes(model(task("a", 10, version("v", 1, "nowhere"))), "")
    assert {d.code for d in failed.value.diagnostics} == {"HAL0205"}


def test_none_found_is_not_impossible():
    """Three tasks that each need a unit of their own have two, which no witness shows; more cores do not help them."""
    tasks = [task(f"t{n}", 10, version("v", 6, "d1 d2")) for n in range(3)]
    system = model(*tasks, task("x", 10, version("v", 1, "c1")), units="d1 d2 c1")
    answer = ask(fewest_units(typed(system, core="c1"), "core"), search())
    assert (answer.found, answer.bound) == (None, 1)
    assert answer.failed[0] == 1
    assert complaint(answer).code == codes.NONE_FOUND.id


def test_a_search_that_time_ends_is_no_failure():
    ended = Search(SearchOptions(budget=10**6), lambda *_: False, lambda: True)
    with pytest.raises(TimeUpError):
        ended.finds(with_units(parallel(3, 2), "core", 2))


@pytest.mark.parametrize("tries", range(12))
def test_what_time_leaves_of_an_answer_is_true(tries):
    """Whenever time is over: what is found has a schedule, what is proven impossible has none, the rest is open."""
    left = iter(range(tries))

    def in_time(answer):
        def ask(number):
            if next(left, None) is None:
                raise TimeUpError
            return answer(number)

        return ask

    found = bracket(9, in_time(lambda n: ("proof",) if n < 3 else ()), in_time(lambda n: n >= 6))
    assert found.possible in range(4)
    assert found.found in (None, *range(6, 10))
    assert set(found.failed) <= {3, 4, 5}
    assert found.is_cut == ((found.possible, found.found) != (3, 6) or 5 not in found.failed)
    assert bool(found.witness) == (found.possible > 0)


@pytest.mark.parametrize("tries", [0, 1, 100])
def test_what_the_model_has_is_an_answer_before_time_is_over(tries):
    """The first try is the model as it is; with enough of them, the answer is that without a limit."""
    system = parallel(3, 6)
    left = iter(range(tries))

    class Timed(Search):
        def finds(self, changed):
            if next(left, None) is None:
                raise TimeUpError
            return super().finds(changed)

    timed = Timed(SearchOptions(budget=200), lambda *_: True, lambda: True)
    answer = ask(largest_factor(system), timed, is_timed=True)
    whole = ask(largest_factor(system), search())
    assert answer.is_cut == (tries < 100)
    assert answer.found == (None if tries == 0 else whole.found if tries == 100 else 1)
    assert answer.bound == whole.bound


def test_what_is_known_needs_no_time():
    def over(_):
        raise TimeUpError

    assert bracket(9, over, over, known=6) == Bracket(0, (), 6, (), is_cut=True)


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 60), st.integers(0, 60) | st.none())
def test_the_edge_is_found_wherever_the_search_begins(first, length, edge, likely):
    last = first + length
    likely = None if likely is None else min(last, first + likely)
    asked = []

    def holds(number):
        asked.append(number)
        return number >= edge

    expected = min(max(first, edge), last + 1)
    assert neighbours(first, last, holds, likely) == (expected - 1, expected)
    assert len(asked) == len(set(asked))
    assert len(asked) <= 2 * length.bit_length() + 2


def test_neighbours_are_so_without_an_edge():
    """Whatever holds: the answer does, and the one before was asked and did not."""
    for pattern in range(256):
        asked = {}

        def holds(number, pattern=pattern, asked=asked):
            asked[number] = bool(pattern >> number & 1)
            return asked[number]

        below, found = neighbours(0, 7, holds)
        assert below == found - 1
        assert found == 8 or asked[found]
        assert below == -1 or asked[below] is False


def test_a_known_number_is_not_searched():
    tried = []
    result = bracket(9, lambda n: ("proof",) if n < 3 else (), lambda n: tried.append(n) or n >= 6, known=6)
    assert result == Bracket(3, ("proof",), 6, (3, 4, 5))
    assert 6 not in tried


@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_found_is_found_again_by_schedule(seed):
    system = parallel(3, 6)
    answer = ask(fewest_units(system, "core"), search(seed=seed))
    smaller = with_units(system, "core", int(answer.found)).model
    assert schedule_model(smaller, SearchOptions(seed=seed, budget=200), lambda *_: True).is_complete


def test_no_bound_is_drawn_from_interrupts_of_units_that_may_be_left_out():
    """Of two units the first is filled to 90 % by interrupts: one alone is enough if it is the other."""
    system = model(task("a", 10, version("v", 5, "u1 u2")), units="u1 u2")
    served = (Interrupt(name="i", distance=ms(10), wcet=ms(9)),)
    first, second = (replace(unit, type="core") for unit in system.units)
    system = replace(system, units=(replace(first, interrupts=served), second))
    question = fewest_units(system, "core")
    assert not proofs(question.relaxed(question.value(1)), question.ignored)


@pytest.mark.parametrize(("budget", "seconds", "is_open"), [(None, None, True), (5, None, False), (None, 1, False)])
def test_searches_are_open_where_no_end_of_them_is_stated(budget, seconds, is_open):
    limit = None if seconds is None else Duration(seconds * 10**9)
    assert SizeOptions(wcet_factor=True, budget=budget, time_limit=limit).is_open == is_open
