"""What a task leaves free on its unit, which versions have no place there, and what would give them one."""

from fractions import Fraction

import pytest
from split_helpers import interrupts, points, split

from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.sharing import _blocked, _gap, _needed, _version, _ways_out
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.validate.context import Context
from support import after, model, ms, task, version


def blocked(*tasks, served=(), units="u1 u2"):
    """Return the facts of tasks, and the gaps in which versions have no place."""
    system = model(*tasks, units=units)
    context = Context(interrupts(system, "u1", served) if served else system)
    facts = mode_facts(context.active[0], context.units)
    return facts, _blocked(facts)


def short(period=6, wcet=2, **more):
    return task("short", period, version("v", wcet), **more)


def long(*wcets, period=12):
    return task("long", period, *(version(name, wcet) for name, wcet in zip("vw", wcets, strict=False)))


@pytest.mark.parametrize(("own", "free", "sum_text"), [
    (short(), 4, "6ms - 2ms"),
    (short(slack="1/6"), 5, "6ms + 1ms of slack - 2ms"),
    (short(12), 10, "12ms - 2ms"),
    (short(12, slack="1/6"), 10, "12ms - 2ms"),  # its one job recurs with the same delay
])  # fmt: skip
def test_a_task_leaves_its_period_and_slack_without_its_job(own, free, sum_text):
    assert not blocked(own, long(free))[1]
    facts, found = blocked(own, long(f"{free * 10**6 + 1}ns"))
    gap = found["long"]["v"]
    assert (gap.unit, gap.owner.name, gap.length) == ("u1", "short", facts.ticks(ms(free)))
    assert _gap(facts, gap) == f'the jobs of "short" leave at most {free}ms free ({sum_text})'


def test_the_least_of_several_gaps_counts_and_a_task_is_not_in_its_own_way():
    tasks = [short(6, 2), task("shorter", 6, version("v", 3)), task("loose", 6, version("v", 1))]
    _, found = blocked(*tasks, long(5))
    assert {name: found[name]["v"].owner.name for name in found} == {"long": "shorter"}
    _, found = blocked(task("tight", 6, version("v", 4)), short(6, 3), units="u1")
    assert {name: found[name]["v"].owner.name for name in found} == {"tight": "short", "short": "tight"}


def test_a_version_that_may_run_elsewhere_has_a_place():
    assert not blocked(short(), task("long", 12, version("v", 5, "u1 u2")))[1]
    facts, found = blocked(short(), task("long", 12, version("v", 5), version("w", 5, "u2")))
    assert [*found["long"]] == ["v"]
    assert _version(facts.tasks["long"], "v") == 'version "v"'
    assert blocked(short(), task("long", 12, version("v", 5, "u1 u2", gang=2)))[1]


@pytest.mark.parametrize(("own", "wcet", "slack"), [
    (short(), 5, "1/6"),
    (short(), 8, "2/3"),
    (short(), 9, None),  # beyond its deadline
    (short(deadline=3), 5, "1/6"),
    (short(deadline=3), 6, None),
    (short(deadline=20), 10, "1"),
    (short(deadline=20), 11, None),  # more than a period
    (short(slack="1/6"), 6, "1/3"),
    (short(12), 11, None),  # slack is no use where there is one job
])  # fmt: skip
def test_slack_is_a_way_out_as_far_as_the_deadline_has_room_for_it(own, wcet, slack):
    facts, found = blocked(own, long(wcet))
    text = _ways_out(facts, facts.tasks["long"], "v", found["long"]["v"])
    more = wcet - found["long"]["v"].length // facts.ticks(ms(1))
    assert text.startswith(f'{more}ms less WCET of "long" or of "short", ')
    stated = [part for part in text.split(", ") if part.startswith("a slack")]
    assert [Fraction(part.rsplit(" ", 1)[1]).limit_denominator(9) for part in stated] == (
        [Fraction(slack)] if slack else []
    )


def test_ways_out_name_the_version_where_there_are_several():
    facts, found = blocked(short(), long(5, 6))
    for name, more, slack in (("v", 1, "1/6"), ("w", 2, "1/3")):
        assert _ways_out(facts, facts.tasks["long"], name, found["long"][name]) == (
            f'{more}ms less WCET of "{name}" of "long" or of "short", a slack of "short" of {slack}, '
            f'"{name}" of "long" cut into pieces of at most 4ms (split), or another unit for one of them'
        )


def test_ways_out_name_interrupts_and_pieces():
    facts, found = blocked(short(), long(5), served=(12, 1))
    text = _ways_out(facts, facts.tasks["long"], "v", found["long"]["v"])
    assert 'less WCET or interrupts of "long" or of "short"' in text
    facts, found = blocked(short(), task("long", 12, split(version("v", 6), points(1))))
    text = _ways_out(facts, facts.tasks["long"], "v", found["long"]["v"])
    assert text.startswith('1ms less in one piece of "long", or less WCET of "short"')
    assert _needed(facts, facts.tasks["long"].versions[0]) == "5ms in one go"
    assert _version(facts.tasks["long"], "v") == "it"
    assert _needed(facts, facts.tasks["short"].versions[0]) == "2ms"


@pytest.mark.parametrize(("latest", "is_proven"), [(4, True), (5, False)])
def test_two_tasks_that_fill_a_unit_start_exactly_so_far_apart(latest, is_proven):
    """Each takes 5 of 10 ms, so that b starts 5 ms after a, and not within 4 ms."""
    follows = task("b", 10, version("v", 5, "u1", after("a", 0, latest)))
    proven = {
        d.code for each in find_witnesses(model(task("a", 10, version("v", 5)), follows)) for d in each.diagnostics
    }
    assert (codes.WINDOWS_CONTRADICT.id in proven) == is_proven
