"""How the least change is searched for, with a judge of our own in the place of the search for schedules."""

from functools import partial
from types import SimpleNamespace

import pytest
from split_helpers import points, split

from halpipe.pipeline.explain import remedies
from halpipe.pipeline.explain.remedies import MAX_UNITS, TRIALS, Relaxation, Remedy, Trials, find_remedies
from support import after, chain, model, ms, task, version


class Judge(Trials):
    """Trials in which `suffices` tells of what there is a schedule, and `refutes` what is proven to have none."""

    suffices = staticmethod(lambda changed: False)
    refutes = staticmethod(lambda changed: False)

    def schedule(self, model):
        self.left -= 1
        return model if self.suffices(model) else None

    def is_refuted(self, model):
        return self.refutes(model)


def judge(suffices, refutes=lambda changed: False, **more):
    found = Judge("all", 9, lambda: True, ms(1), **more)
    found.suffices, found.refutes = suffices, refutes
    return found


def number(steps):
    """A change that is seen as its number of steps."""
    return steps


@pytest.mark.parametrize("most", [1, 2, 3, 7, 8, 100])
def test_the_smallest_number_of_steps_is_found_in_few_searches(most):
    for least in range(1, most + 1):
        trials = judge(lambda steps, least=least: steps >= least)
        assert trials.smallest(number, most) == (least, least)
        assert TRIALS - trials.left <= 1 + most.bit_length()
    assert judge(lambda steps: False).smallest(number, most) is None


def relaxed(most, finer=None, name="x"):
    return Relaxation(change=number, most=most, text=lambda n: f"{name}{n}", subjects=(), steps="1ms", finer=finer)


def test_finer_steps_are_tried_where_no_number_of_steps_suffices():
    found = relaxed(9, relaxed(50, name="y")).tried(judge(lambda steps: steps >= 4))
    assert (found.text, found.smaller, found.steps) == ("x4", 3, "1ms")
    found = relaxed(9, relaxed(50, name="y")).tried(judge(lambda steps: steps >= 40))
    assert (found.text, found.smaller) == ("y40", 39)
    assert relaxed(1).tried(judge(lambda steps: True)).text == "x1"
    assert relaxed(0).tried(judge(lambda steps: True)) is None
    assert relaxed(9).tried(judge(lambda steps: False)) is None


@pytest.mark.parametrize(
    ("steps", "smaller", "status"),
    [
        ("", None, "found sufficient"),
        ("1ms", None, "found sufficient, in steps of 1ms"),
        ("1ms", 3, "found sufficient, in steps of 1ms; the next smaller step is proven not to suffice"),
        ("", 4, "found sufficient; with less, none was found"),
    ],
)
def test_a_remedy_says_what_is_known_of_less(steps, smaller, status):
    remedy = Remedy(text="x", subjects=(), smaller=smaller, steps=steps)
    assert remedy.reported(judge(lambda _: True, lambda changed: changed == 3)).message.endswith(f"x ({status})")


def test_where_nothing_helps_the_searches_are_counted():
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)))
    trials = judge(lambda changed: False)
    (found,) = find_remedies(system, ["a"], trials)
    assert f"({TRIALS - trials.left} searches)" in found.message
    (found,) = find_remedies(system, ["a"], judge(lambda changed: False, left=0))
    assert f"({TRIALS} searches)" in found.message


def added(changed, system):
    return len(changed.units) - len(system.units)


@pytest.mark.parametrize("count", range(1, MAX_UNITS + 2))
def test_as_few_units_are_added_as_suffice(count):
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)))
    found = [*remedies._units(system, [*system.tasks], judge(lambda changed: added(changed, system) >= count))]
    assert [each.text for each in found] == (
        [f'{count} more unit{"s" * (count > 1)} like "u1"'] if count <= MAX_UNITS else []
    )
    for each in found:
        assert (each.smaller and added(each.smaller, system)) == (count - 1 or None)


def of_each(changed):
    """How many units the versions of each task may run on."""
    return [len(each.versions[0].units) for each in changed.tasks]


@pytest.mark.parametrize(
    ("needed", "text"),
    [
        ([2, 2], '1 more unit like "u1" and 1 more unit like "u2"'),
        ([2, 3], '1 more unit like "u1" and 2 more units like "u2"'),
        ([4, 2], '3 more units like "u1" and 1 more unit like "u2"'),
        ([4, 4], '3 more units like "u1" and 3 more units like "u2"'),
        ([5, 2], None),
    ],
)
def test_units_of_several_kinds_are_added_where_one_kind_does_not_suffice(needed, text):
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6, "u2")), units="u1 u2")
    suffices = partial(lambda least, changed: all(map(int.__ge__, of_each(changed), least)), needed)
    found = [*remedies._units(system, [*system.tasks], judge(suffices))]
    assert [each.text for each in found] == ([text] if text else [])


def test_of_kinds_each_that_suffices_alone_is_stated():
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6, "u2")), units="u1 u2 u3")
    found = remedies._units(system, [*system.tasks], judge(lambda changed: added(changed, system) >= 2))
    assert [each.text for each in found] == ['2 more units like "u1"', '2 more units like "u2"']
    assert remedies._kinds(system, [system.tasks[1]]) == {"u2": 'like "u2"'}


def test_only_tasks_of_the_conflict_are_changed_where_any_run():
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6, "u2")), units="u1 u2")
    trials = judge(lambda changed: added(changed, system) == 1)
    assert [each.text for each in remedies.remedies(system, ["b", "gone"], trials)] == ['1 more unit like "u2"']
    assert len([*remedies.remedies(system, ["gone"], trials)]) == 2


def test_of_a_changed_parameter_as_much_changes_as_the_text_says():
    """A window opens at either end, not below zero; a deadline moves; pieces and preemptions become more."""
    rows = [task("a", 10, version("v", 4), deadline=5), task("b", 10, version("v", 4, "u1", after("a", 2, 6)))]
    system, trials = model(*rows), judge(lambda changed: True)
    later, earlier = remedies._window(system, rows[1], rows[1].versions[0].precedences[0], trials)

    def window(changed):
        row = changed.task("b").versions[0].precedences[0]
        return row.min, row.max

    assert [window(later.change(n)) for n in (1, 3)] == [(ms(2), ms(7)), (ms(2), ms(9))]
    assert [window(earlier.change(n)) for n in (1, 2, 3)] == [(ms(1), ms(6)), (ms(0), ms(6)), (ms(0), ms(6))]
    moved = remedies._deadline(system, rows[0], trials)
    assert [moved.change(n).task("a").deadline for n in (1, 3)] == [ms(6), ms(8)]
    cut = remedies._pieces(system, rows[0])
    assert cut.change(0) is system
    assert (cut.most, cut.text(1), cut.text(cut.most)) == (
        15,
        '"a" cut into pieces of at most 2ms (split)',
        '"a" cut into pieces of at most 250us (split)',
    )
    assert [len(cut.change(n).task("a").versions[0].split.points) for n in (1, 3)] == [1, 3]


def test_many_tasks_are_shortened_by_one_factor():
    rows = [task(f"t{n}", 10, version("v", 4)) for n in range(7)]
    running = {each.name for each in rows}
    many, few = (
        [each.text(1) for each in remedies._relaxations(model(*own), own, running, judge(lambda _: False))]
        for own in (rows, rows[:6])
    )
    assert [text for text in many if "WCET" in text] == ["WCETs of 7 tasks times 0.999"]
    assert len([text for text in few if "WCET" in text]) == 6
    assert (len([text for text in many if "slack" in text]), len([text for text in few if "slack" in text])) == (1, 7)
    shorter = remedies._wcets(model(*rows), ["t0", "t3"])
    assert (shorter.most, shorter.text(999)) == (999, "WCETs of 2 tasks times 0.001")
    found = shorter.change(250)
    assert [each.versions[0].wcet for each in found.tasks] == [ms(n) for n in (3, 4, 4, 3, 4, 4, 4)]


def test_one_task_alone_has_its_slack_raised_once():
    rows = [task("a", 10, version("v", 4)), task("b", 10, version("v", 4), slack=1)]
    found = remedies._relaxations(model(*rows), rows, {*"ab"}, judge(lambda _: False))
    assert [each.text(1) for each in found if "slack" in each.text(1)] == ['slack of "a" >= 0.01']


@pytest.mark.parametrize(("count", "searches"), [(6, 7), (7, 1)])
def test_offsets_are_freed_one_by_one_where_they_are_few(count, searches):
    rows = [task(f"t{n}", 10, version("v", 1), offset=n) for n in range(count)]
    plain = [task("plain", 10, version("v", 1)), task("demanded", None, version("v", 1))]
    trials = judge(lambda changed: all(each.offset is None for each in changed.tasks))
    found = [*remedies._offsets(model(*rows, *plain), [*rows, *plain], trials)]
    assert [each.text.split(" for ")[0] for each in found] == ["no fixed offset"]
    assert (len(found[0].subjects), TRIALS - trials.left) == (count, searches)
    assert not [*remedies._offsets(model(*plain), plain, trials)]
    assert TRIALS - trials.left == searches


def test_limits_are_lowered_one_after_the_other_to_what_suffices():
    limited = chain("c", "a", reaction=20)
    system = model(task("a", 10, version("v", 3)), chains=[limited])
    asked, kept = {"max_reaction": ms(20), "max_age": ms(30)}, {"max_reaction": ms(26), "max_age": ms(30)}
    trials = judge(lambda changed: changed.chains[0].max_reaction >= ms(23))
    found = remedies._lowest(system, limited, asked, kept, trials)
    assert found.text == 'limits of chain "c" of reaction time 23ms instead of 20ms'
    assert (found.smaller.chains[0].max_reaction, found.smaller.chains[0].max_age) == (ms(22), ms(30))


def test_limits_are_looked_at_of_chains_that_run_and_state_any():
    tasks = [task("a", 10, version("v", 3)), task("b", 10, version("v", 3))]
    chains = [chain("c", "a", reaction=20), chain("d", "a b", reaction=20), chain("e", "a")]
    seen = []
    trials = judge(lambda changed: seen.append([each.max_reaction for each in changed.chains]))
    assert not [*remedies._limits(model(*tasks, chains=chains), {"a"}, trials)]
    assert seen == [[ms(20_000), ms(20), None]]


@pytest.mark.parametrize(
    ("reaction", "age", "kept"),
    [(15, 40, (20, 40)), (25, 30, (25, 30)), (None, 40, None), (25, None, None)],
)
def test_limits_are_not_lowered_below_what_is_asked_for(reaction, age, kept):
    asked = {"max_reaction": ms(20), "max_age": ms(30)}
    figures = {"reaction": None if reaction is None else ms(reaction), "age": None if age is None else ms(age)}
    other = SimpleNamespace(name="other", reaction=ms(99), age=ms(99))
    table = SimpleNamespace(chains=[other, SimpleNamespace(name="c", **figures)])
    found = remedies._kept(chain("c", "a"), asked, table)
    assert (found and tuple(found.values())) == (kept and tuple(map(ms, kept)))
    assert remedies._kept(chain("gone", "a"), asked, table) is None
    assert remedies._kept(chain("c", "a"), asked, None) is None


def test_one_version_that_may_pause_is_enough_to_relax_how_it_does():
    some = [
        version("v", 4),
        split(version("w", 4), points(1, max_gaps=1)),
        split(version("x", 4), points(1, 2, max_gaps=2)),
    ]
    rows = [
        task("some", 10, *some, deadline=6),
        task("freely", 10, split(version("v", 4), points(1)), deadline=6),
        task("never", 10, version("v", 4), deadline=6),
    ]
    found = [*remedies._relaxations(model(*rows), rows, {"some"}, judge(lambda _: False))]
    assert [each.text(1) for each in found if "gaps" in each.text(1)] == ['max-gaps of "some" of 3 instead of 2']
    assert [each.most for each in found if each.text(1).startswith("deadline")] == [4, 4, -2]
