"""Health rules: what they lead to in a schedule, and that verify decides it by itself."""

from dataclasses import replace

import pytest
from verify_helpers import codes_found, errors, messages, plan_of, switch, table

from halpipe.models import HealthAction, HealthEvent, HealthRule, Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.health import with_reactions
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import codes as validate_codes
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import codes
from support import job, mode, model, ms, task, version

A = task("a", 10, version("v", 4, "u1"))
B = task("b", 20, version("v", 4, "u1"))
TO_TWO = HealthRule(task="a", event=HealthEvent.OVERRUN, count=2, cycles=3, mode="two")
STOP = HealthRule(task="a", action=HealthAction.STOP)
AGAIN = HealthRule(task="a", action=HealthAction.RESTART)


def system(*rules):
    modes = [mode("one", (A,)), mode("two", (B,))]
    return replace(model(A, B, units="u1", modes=modes, transitions=[("one", "two", 20)]), health=rules)


def plan(of, length=0):
    one, two = (table(n, t, job(of, name, 0, 0, "u1")) for n, t, name in (("one", 10, "a"), ("two", 20, "b")))
    return switch(plan_of(of, one, two), length)


@pytest.mark.parametrize(
    ("rule", "target", "within"),
    [(TO_TWO, "two", ms(15)), (STOP, "", ms(10)), (AGAIN, "", None)],
    ids=["switch", "stop", "restart"],
)
def test_a_rule_has_a_reaction_in_the_mode_in_which_it_holds(rule, target, within):
    of = system(rule)
    found = with_reactions(of, plan(of, 5))
    (reaction,) = found.reactions
    stated = reaction.mode, reaction.task, reaction.event, reaction.count, reaction.cycles, reaction.action
    assert stated == ("one", "a", rule.event, rule.count, rule.cycles, rule.action)
    assert (reaction.target, reaction.within) == (target, within)
    assert not errors(of, found)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda r: [], [codes.REACTION_MISSING.id]),
        (lambda r: [replace(r, within=ms(14))], [codes.REACTION_MISSING.id, codes.WRONG_REACTION.id]),
        (lambda r: [replace(r, count=3)], [codes.REACTION_MISSING.id, codes.WRONG_REACTION.id]),
        (lambda r: [replace(r, event=HealthEvent.ANY)], [codes.REACTION_MISSING.id, codes.WRONG_REACTION.id]),
        (lambda r: [r, r], [codes.WRONG_REACTION.id]),
        (lambda r: [r, replace(r, mode="two", target="one")], [codes.WRONG_REACTION.id]),
    ],
    ids=["none", "too short", "another count", "another event", "twice", "one more"],
)
def test_verify_finds_what_a_schedule_states_otherwise(change, expected):
    of = system(TO_TWO)
    found = with_reactions(of, plan(of, 5))
    changed = replace(found, reactions=tuple(change(found.reactions[0])))
    assert sorted(codes_found(of, changed)) == expected


@pytest.mark.parametrize(
    ("rule", "stated"),
    [(TO_TWO, "switch{} within 15ms"), (STOP, "stop{} within 10ms"), (AGAIN, "restart{}")],
    ids=["switch", "stop", "restart"],
)
def test_messages_say_how_long_a_reaction_takes_where_it_takes_time(rule, stated):
    of = system(rule)
    without = messages(of, plan(of, 5), codes.REACTION_MISSING)
    assert [text.split(": ")[1] for text in without] == [f"its reaction, {stated.format('')}, is not stated"]
    found = with_reactions(of, plan(of, 5))
    (more,) = messages(of, replace(found, reactions=found.reactions * 2), codes.WRONG_REACTION)
    after = f" after {rule.count} times {rule.event} in {rule.cycles} tables" + (' to "two"' if rule.mode else "")
    assert more.split(": ")[1] == f"{stated.format(after)} follows from no rule of the model"


def test_a_rule_whose_switch_has_no_table_makes_the_schedule_invalid():
    of = system(TO_TWO)
    found = with_reactions(of, replace(plan(of), transitions=()))
    assert found.reactions == ()
    assert codes.REACTION_MISSING.id in codes_found(of, found)
    not_found = with_reactions(of, switch(replace(plan(of), transitions=()), 0, status=Status.NOT_FOUND))
    assert not_found.reactions == ()
    assert codes.REACTION_MISSING.id in codes_found(of, not_found)


def test_a_search_states_the_reactions_of_its_schedule():
    of = system(TO_TWO, STOP)
    scheduled = schedule_model(of, SearchOptions(seed=1), lambda *_: True)
    assert [(r.mode, r.action) for r in scheduled.schedule.reactions] == [
        ("one", HealthAction.SWITCH),
        ("one", HealthAction.STOP),
    ]
    assert not errors(of, scheduled.schedule)


@pytest.mark.parametrize("numbers", [(0, 1), (1, 0), (256, 1), (1, 256)])
def test_numbers_that_no_target_can_count_are_errors(numbers):
    count, cycles = numbers
    found = validate(system(replace(STOP, count=count, cycles=cycles)))
    assert validate_codes.BAD_RULE.id in [d.code for d in found]


def test_a_switch_without_a_mode_is_an_error():
    assert validate_codes.BAD_RULE.id in [d.code for d in validate(system(HealthRule(task="a")))]


def test_names_that_are_not_there_are_errors():
    found = validate(system(replace(STOP, task="c"), replace(TO_TWO, mode="three")))
    assert {d.code for d in found if d.is_error} == {
        validate_codes.UNKNOWN_TASK.id,
        validate_codes.UNKNOWN_MODE.id,
    }
