"""Tasks that all run at one instant: for every choice of phases, as a brute force over all of them confirms."""

from itertools import product
from math import lcm

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.meetings import Budget, Part, _parts, _without, find_meeting, meet_in_groups
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.solve.exact import Answer, solve_exact
from halpipe.pipeline.validate.context import Context
from profiles import examples
from support import model, task, version

TICKS = 2
"""The bounds are cut to whole numbers, so that times are counted in halves."""


def parts_of(pairs):
    return [Part(f"t{n}", period * TICKS, length * TICKS, 1) for n, (period, length) in enumerate(pairs)]


def always_meet(parts):
    """Whether for all phases, in whole ticks, some tick is in all of the parts; the first may start at 0."""
    total = lcm(*(part.period for part in parts))
    for phases in product([0], *(range(part.period) for part in parts[1:])):
        shared = set(range(total))
        for part, phase in zip(parts, phases, strict=True):
            shared &= {tick for tick in shared if (tick - phase) % part.period < part.length}
        if not shared:
            return False
    return True


PAIRS = st.sampled_from([1, 2, 3, 4, 6]).flatmap(lambda period: st.tuples(st.just(period), st.integers(1, period)))


@examples(150)
@given(st.lists(PAIRS, min_size=2, max_size=4))
def test_parts_that_are_said_to_meet_do_so_in_all_phases(pairs):
    parts = parts_of(pairs)
    group = meet_in_groups(parts, Budget())
    if group is not None:
        assert sorted(group.names) == sorted(part.task for part in parts)
        assert always_meet(parts)


def test_groups_find_what_a_chain_of_parts_does_not():
    """Two rates: within each the tasks just meet, and only together do they fill the gcd of 3."""
    pairs = [(66, "42.24ms"), (33, "27.82ms"), (33, "10.87ms"), (15, "12.44ms"), (15, "4.43ms")]
    tasks = [task(f"t{n}", period, version("v", wcet, "a b c d")) for n, (period, wcet) in enumerate(pairs)]
    system = model(*tasks, units="a b c d")
    parts = [Part(t.name, int(t.period.ns), int(t.versions[0].wcet.ns), 1) for t in tasks]
    assert not find_meeting(parts, 4, Budget())
    (hopeless,) = find_witnesses(system)
    (witness,) = hopeless.witnesses
    assert witness.diagnostic.code == codes.TASKS_MEET.id
    assert "390us" in witness.diagnostic.message
    with_five = [task(t.name, t.period, version("v", t.versions[0].wcet, "a b c d e")) for t in tasks]
    assert not find_witnesses(model(*with_five, units="a b c d e"))


def shared_accelerator(held):
    """Two tasks that may use the core, or be quicker on the accelerator, which a third one holds for some time."""
    choice = (version("core", 3, "c"), version("quick", 1, "g"))
    tasks = [task("a", 5, *choice), task("b", 5, *choice), task("holder", 20, version("v", held, "g"))]
    return model(*tasks, units="c g")


@pytest.mark.parametrize("held", range(1, 18, 2))
def test_while_a_unit_is_held_the_others_do_without_it(held):
    """Sound against the exact engine: what has a schedule is not called hopeless."""
    pytest.importorskip("ortools")
    system = shared_accelerator(held)
    proven = any(w.diagnostic.code == codes.TASKS_MEET.id for h in find_witnesses(system) for w in h.witnesses)
    answer = solve_exact(system, system.modes[0]).status
    assert answer is not Answer.UNKNOWN
    if proven:
        assert answer is Answer.INFEASIBLE
    assert proven == (held >= 9), "the limit of the argument: held - 3 + 0.5 > 5"


def test_the_argument_names_who_holds_what_and_what_is_left_of_it():
    (hopeless,) = find_witnesses(shared_accelerator(15))
    (message,) = [d.message for d in hopeless.diagnostics if d.code == codes.TASKS_MEET.id]
    assert 'while "holder" has "g", "a", "b" cannot start there' in message
    assert "12ms of it are left" in message
    assert '3ms of "a" + 3ms of "b" > 5ms' in message


def test_slack_counts_for_what_it_takes_from_the_parts():
    """Half a millisecond of slack for each leaves 2.5 ms of each job in its place: they need not meet in 5 ms."""
    choice = (version("core", 3, "c"), version("quick", 1, "g"))
    tasks = [task(name, 5, *choice, slack="0.1") for name in "ab"]
    system = model(*tasks, task("holder", 20, version("v", 15, "g")), units="c g")
    assert not find_witnesses(system)


@pytest.mark.parametrize(("others", "left", "elsewhere"), [("c d", 12, ()), ("c g", 9, ("a", "b", "e"))])
def test_of_a_holder_counts_what_others_cannot_spend_elsewhere(others, left, elsewhere):
    """Three tasks of up to 3 ms on two units, while a third unit is held for 12 ms."""
    tasks = [task(name, 5, version("v", wcet, others)) for name, wcet in (("a", 3), ("b", 3), ("e", 2))]
    context = Context(model(*tasks, task("holder", 20, version("v", 12, "g")), units="c d g"))
    facts = mode_facts(context.active[0])
    own = list(facts.tasks.values())
    held, parts = _parts(own, frozenset("cdg"), facts.tasks["holder"])
    assert (held.elsewhere, facts.text(parts[0].length)) == (elsewhere, f"{left}ms")
    assert _without(facts, held).startswith('while "holder" has "g", "a", "b", "e" cannot') == bool(elsewhere)
    assert bool(_without(facts, held)) == bool(elsewhere)
