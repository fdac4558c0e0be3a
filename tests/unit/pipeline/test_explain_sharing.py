"""Tasks that need too many units, or too much of a resource, at one time: who counts, and how the sums are spelled."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import points, split

from halpipe.models import Binding
from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.sharing import _classes, _Item, _items, packings, resources_met, units_met
from halpipe.pipeline.validate.context import Context
from support import access, model, ms, task, version


def facts_of(*tasks, units="u1 u2 u3", resources="", types=()):
    system = model(*tasks, units=units, resources=resources)
    if types:
        system = replace(system, units=tuple(replace(u, type=t) for u, t in zip(system.units, types, strict=True)))
    context = Context(system)
    return mode_facts(context.active[0], context.units), system


def plain(name, period, wcet, units="u1", **more):
    return task(name, period, version("v", wcet, units), **more)


def proofs(*tasks, **more):
    return [witness.diagnostic for witness in units_met(*facts_of(*tasks, **more))]


def test_tasks_count_in_every_set_of_units_that_holds_theirs():
    tasks = [plain("a", 10, 3), plain("b", 10, 3, "u2 u3"), plain("c", 10, 3, "u1 u2"), plain("d", 10, 3)]
    late, never = plain("late", 10, 3, slack="3/10"), plain("never", 10, 3, slack="4/10")
    facts, _ = facts_of(*tasks, late, never)
    found = [("".join(sorted(units)), [each.name for each in own]) for units, own in _classes(facts)]
    assert found == [
        ("u1", ["a", "d"]),
        ("u1u2", ["a", "d", "c"]),
        ("u2u3", ["b"]),
        ("u1u2u3", ["a", "d", "b", "c"]),
    ]


def test_a_task_counts_with_the_fewest_units_that_it_may_take():
    either = task("either", 10, version("v", 6, "u1 u2", gang=2), version("w", 6, "u1 u2"))
    assert not proofs(either, plain("other", 10, 6, "u1 u2"), units="u1 u2")
    both = task("both", 10, version("v", 6, "u1 u2", gang=2))
    assert proofs(both, plain("other", 10, 6, "u1 u2"), units="u1 u2")


def test_two_tasks_that_meet_have_their_sum_beside_the_gcd():
    (found,) = proofs(plain("a", 6, 3), plain("b", 15, 2))
    assert found.message.endswith(
        '"a", "b" can run only on 1 unit "u1" and need 2 of them at the same time, whatever their phases: '
        '2ms of "b" + 3ms of "a" > 3ms = gcd(15ms, 6ms)'
    )
    assert found.help == (
        "necessary: 1 more unit for them, 2ms less of WCET or more of slack, of the two together, "
        "or jobs that may be split"
    )


def test_of_three_tasks_the_second_sum_is_of_those_together():
    rows = [plain(name, 10, wcet, "u1 u2") for name, wcet in (("a", 9), ("b", 8), ("c", 7))]
    (found,) = proofs(*rows, units="u1 u2", types=("core", "core"))
    assert found.message.endswith(
        '"a", "b", "c" can run only on 2 units "u1", "u2" and need 3 of them at the same time, whatever their phases: '
        '8ms of "b" + 9ms of "a" > 10ms = gcd(10ms, 10ms), so they are together for at least 3.5ms; '
        '7ms of "c" + 3.5ms of those together > 10ms = gcd(10ms, 10ms)'
    )
    assert found.help == (
        'necessary: 1 more unit of type "core" for them, less WCET or more slack, such as 500us of "c", '
        "or jobs that may be split"
    )


def test_of_slack_only_what_it_does_not_move_is_counted():
    (found,) = proofs(plain("a", 10, 7), plain("b", 10, 6, slack="1/5"))
    assert '4ms of "b" + 7ms of "a" > 10ms' in found.message
    assert found.message.endswith('(of "b" only what slack does not move is counted)')


@pytest.mark.parametrize(("count", "ends"), [(12, "is named"), (13, "is not")])
def test_a_dozen_tasks_are_named(count, ends):
    """Full jobs of any number meet, half as long with each more."""
    names = [f"t{n:02}" for n in range(count)]
    units = " ".join(f"u{n}" for n in range(count - 1))
    (found,) = proofs(*(plain(name, 10, 10, units) for name in names), units=units)
    before = found.message[: found.message.index("can run")]
    assert (f'"{names[-1]}"' in before) == (ends == "is named")
    phased = [
        plain(
            name,
            10,
            10,
            f"u{n}",
        )
        for n, name in enumerate(names)
    ]
    share = access("bus", 0, 10, Fraction(1, count - 1))
    phased = [replace(t, versions=(replace(t.versions[0], accesses=(share,)),)) for t in phased]
    (found,) = resources_met(facts_of(*phased, units=units + f" u{count - 1}", resources="bus")[0])
    before = found.diagnostic.message[: found.diagnostic.message.index("on resource")]
    assert (f'"{names[-1]}"' in before) == (ends == "is named")


# ------------------------------------------------------------------------------------------------ access phases


def phase(name, unit, start, end, *, bound=Fraction(3, 4), **more):
    return task(name, 10, version("v", 9, unit, access("bus", start, end, bound)), **more)


def on_bus(*tasks):
    facts, _ = facts_of(*tasks, resources="bus")
    return [witness.diagnostic for witness in resources_met(facts)]


def test_phases_that_meet_have_the_sum_of_their_bounds():
    fine = plain("fine", 10, 1, "u3", slack="1/3")  # by which times are no whole nanoseconds
    (found,) = on_bus(phase("a", "u1", 1, 8), phase("b", "u2", 2, 6), fine)
    assert found.message.endswith(
        'access phases of "a", "b" on resource "bus" meet, whatever the phases of the tasks, and their bounds sum '
        'to 1.5: 4ms of "b" + 7ms of "a" > 10ms = gcd(10ms, 10ms)'
    )
    assert "1ms less of access time or more of slack" in found.help
    assert not on_bus(phase("a", "u1", 1, 8), phase("b", "u2", 2, 5))
    assert not on_bus(phase("a", "u1", 1, 8, bound=Fraction(1, 4)), phase("b", "u2", 2, 6))


@pytest.mark.parametrize(("end", "is_proven"), [("2000000ns", False), ("2000001ns", True)])
def test_a_phase_counts_for_what_slack_does_not_move(end, is_proven):
    """The other holds its bound all the time, so that any rest of the phase meets it; slack moves 1 ms."""
    full = task("full", 10, version("v", 10, "u1", access("bus", 0, 10, Fraction(3, 4))))
    assert bool(on_bus(full, phase("late", "u2", 1, ms(end), slack="1/10"))) == is_proven


def test_phases_of_jobs_that_may_pause_or_take_another_version_are_not_certain():
    sure, other = phase("a", "u1", 0, 8), phase("b", "u2", 0, 8)
    assert on_bus(sure, other)
    way_out = replace(other, versions=(*other.versions, version("w", 9, "u2")))
    assert not on_bus(sure, way_out)
    cut = replace(other, versions=(split(other.versions[0], points(8)),))
    assert not on_bus(sure, cut)


# ------------------------------------------------------------------------------------------------ bound tasks


def test_bound_tasks_are_looked_at_by_their_load():
    units = "u1 u2"
    either = task("either", 10, version("v", 9, units), version("w", 9, units, gang=2))
    tasks = [
        replace(each, binding=Binding.MODE)
        for each in (plain("a", 10, 3, units), plain("b", 20, 5, units), plain("c", 40, 13, units), either)
    ]
    facts, _ = facts_of(*tasks, plain("free", 10, 8, units), plain("single", 10, 2, "u2"))
    found = [(item.task.name, item.load, item.units) for item in _items(facts)]
    assert found == [
        ("c", Fraction(13, 40), ("u1", "u2")),
        ("a", Fraction(3, 10), ("u1", "u2")),
        ("b", Fraction(1, 4), ("u1", "u2")),
        ("single", Fraction(1, 5), ("u2",)),
    ]


def test_tasks_share_no_unit_where_their_jobs_must_meet():
    facts, _ = facts_of(plain("a", 10, 3), plain("b", 15, 2), plain("c", 15, 3))
    a, b, c = (_Item(own, Fraction(1, 9), ("u1",)) for own in facts.tasks.values())
    assert (a.excludes(b), a.excludes(c), c.excludes(a)) == (False, True, True)


def test_two_tasks_have_witnesses_of_their_own():
    two = [replace(plain(name, 10, 6, "u1 u2"), binding=Binding.MODE) for name in "ab"]
    three = [*two, replace(plain("c", 10, 6, "u1 u2"), binding=Binding.MODE)]
    assert not [*packings(facts_of(plain("a", 10, 6), plain("b", 10, 6))[0])]
    assert not [*packings(facts_of(*two)[0])]
    (found,) = packings(facts_of(*three)[0])
    assert found.tasks == ("a", "b", "c")
    assert "(3 pairs share no unit: their times exceed the gcd of their periods)" in found.diagnostic.message
