"""Proofs word for word with their numbers, and the least changes that are proven to be the least ones."""

from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import pytest

from golden_answers import assert_answers, explained
from golden_file import assert_golden
from halpipe.importers.native import read_model
from halpipe.models import Interrupt, Split
from halpipe.pipeline.explain.codes import REMEDY, UNIT_HELD
from halpipe.pipeline.explain.explanation import explain
from halpipe.pipeline.explain.witnesses import find_witnesses
from support import access, after, chain, mode, model, ms, task, version

FIXTURES = sorted((Path(__file__).parents[2] / "fixtures" / "explain").glob("*.xml"))


def narrow_after_an_end():
    """b starts at most 3 ms after the end of a, which is over after 2 to 4 ms; both may slip."""
    rows = [after("a", 0, 3, "end")]
    first = task("a", 20, version("v", 2, "u1"), version("w", 4, "u2"), slack="1/20")
    return model(first, task("b", 8, version("v", 1, "u3", *rows), slack="1/8"), units="u1 u2 u3")


def windows_with_slack():
    """b follows a by 1 to 3 ms, c follows b by 2 to 3 ms and a by 9 to 12 ms, of 20 ms."""
    rows = (("a", (), 0), ("b", (after("a", 1, 3, "end"),), "1/20"), ("c", (after("b", 2, 3), after("a", 9, 12)), 0))
    return model(
        *(task(name, 20, version("v", 1, f"u{n}", *own), slack=slack) for n, (name, own, slack) in enumerate(rows)),
        units="u0 u1 u2",
    )


def window_against_offsets():
    """b has the offset 9 ms and follows by at most 3 ms a, which has the offset 2 ms."""
    late = task("b", 20, version("v", 1, "u2", after("a", 1, 3)), offset=9)
    return model(task("a", 10, version("v", 1, "u1"), offset=2), late, units="u1 u2")


def held_for_a_reaction(reaction=20):
    """See takes 3 ms on the unit that detect holds for 14 ms of 40."""
    rows = [("grab", 10, 1, "cpu"), ("see", 10, 3, "gpu"), ("detect", 40, 14, "gpu")]
    tasks = [task(name, period, version("v", wcet, unit), slack=1) for name, period, wcet, unit in rows]
    return model(*tasks, units="cpu gpu", chains=[chain("picture", "grab see", reaction=reaction)])


def interrupted():
    """With an interrupt of 1 ms in 5, the 3 ms of a take 4 and the 2 ms of b take 3, of gcd(10, 15) = 5 ms."""
    system = model(task("a", 10, version("v", 3)), task("b", 15, version("v", 2)))
    often = Interrupt(name="tick", distance=ms(5), wcet=ms(1))
    return replace(system, units=(replace(system.units[0], interrupts=(often,)),))


def no_two_on_one_unit():
    """No two of three tasks fit on one unit: 1.5 + 2 > gcd(6, 15), 1.5 + 3.5 > gcd(6, 10) and 2 + 3.5 > gcd(10, 15)."""
    rows = (("a", 6, "1.5ms"), ("b", 15, 2), ("c", 10, "3.5ms"))
    return model(*(task(name, period, version("v", wcet)) for name, period, wcet in rows))


def no_gap_beside_interrupts():
    """The jobs of short, 2 ms with an interrupt of 0.25 ms, leave 4.25 ms free, of which interrupts take 0.25 ms."""
    long = task("long", 24, version("v", "4.5ms"), version("w", 5), slack=1)
    system = model(task("short", 6, version("v", "1.75ms"), slack="1/24"), long)
    rare = Interrupt(name="tick", distance=ms(12), wcet=ms("0.25ms"))
    return replace(system, units=(replace(system.units[0], interrupts=(rare,)),))


SYSTEMS = {
    path.stem: path for path in FIXTURES if "HAL0435" not in path.name  # needs the exact engine
} | {
    "narrow-after-an-end": narrow_after_an_end,
    "windows-with-slack": windows_with_slack,
    "window-against-offsets": window_against_offsets,
    "held-for-a-reaction": held_for_a_reaction,
    "interrupted": interrupted,
    "no-gap-beside-interrupts": no_gap_beside_interrupts,
    "no-two-on-one-unit": no_two_on_one_unit,
}  # fmt: skip


@pytest.mark.parametrize("name", SYSTEMS)
def test_proofs_and_least_changes(name):
    made = SYSTEMS[name]
    found = explain(read_model(str(made)) if isinstance(made, Path) else made())
    lines = [
        f"{d.code} {d.path}: {d.message}\n    {d.help}\n"
        for d in found.diagnostics
        if d.code != REMEDY.id or "proven" in d.message
    ]
    assert_golden(f"explain-{name}.txt", "".join(lines), "pipeline")


def test_a_unit_may_be_held_for_as_long_as_the_reaction_leaves():
    assert explain(held_for_a_reaction(21)).exit == 0


@pytest.mark.parametrize(("see", "within"), [(11, "1ms"), ("11.5ms", "0ms"), (12, "0ms")])
def test_of_tasks_that_hold_a_unit_as_long_the_first_is_named(see, within):
    """The reaction leaves 24 ms less that of grab and twice what see takes; less than nothing is nothing."""
    rows = (("grab", 40, 1, "cpu"), ("see", 40, see, "gpu"), ("detect", 40, 13, "gpu"), ("again", 40, 13, "gpu"))
    tasks = [task(name, period, version("v", wcet, unit), slack=1) for name, period, wcet, unit in rows]
    (hopeless,) = find_witnesses(model(*tasks, units="cpu gpu", chains=[chain("picture", "grab see", reaction=24)]))
    (found,) = (proof.message for proof in hopeless.diagnostics if proof.code == UNIT_HELD.id)
    assert found.startswith('"detect" holds "gpu" for 13ms at a time')
    assert f"must start within {within} after one has ended" in found
    assert ("whatever holds the unit in between is too long" in found) == (within == "0ms")


def test_a_task_that_may_pause_is_not_kept_waiting_by_what_holds_its_unit():
    """Its job may begin before what holds the unit, and go on afterwards."""
    system = held_for_a_reaction()
    cut = replace(system.tasks[1].versions[0], split=Split(points=(ms(1), ms(2))))
    system = replace(system, tasks=(system.tasks[0], replace(system.tasks[1], versions=(cut,)), system.tasks[2]))
    assert not find_witnesses(system)
    either = replace(system.tasks[1], versions=(cut, version("w", 3, "gpu")))
    assert not find_witnesses(replace(system, tasks=(system.tasks[0], either, system.tasks[2])))
    elsewhere = replace(system.tasks[1], versions=(version("v", 3, "cpu"),))
    assert not find_witnesses(replace(system, tasks=(system.tasks[0], elsewhere, system.tasks[2])))


@pytest.mark.parametrize(("elsewhere", "is_held"), [(18, False), ("18.000001ms", True)])
def test_a_chain_may_run_elsewhere_if_that_is_just_quick_enough(elsewhere, is_held):
    """Of its 20 ms, grab takes one and misses one."""
    see = task("see", 20, version("gpu", 3, "gpu"), version("cpu", elsewhere, "cpu"), slack=1)
    others = task("grab", 20, version("v", 1, "cpu"), slack=1), task("detect", 40, version("v", 14, "gpu"), slack=1)
    system = model(*others, see, units="cpu gpu", chains=[chain("picture", "grab see", reaction=20)])
    named = {proof.code for hopeless in find_witnesses(system) for proof in hopeless.diagnostics}
    assert named == ({UNIT_HELD.id} if is_held else set())


# ------------------------------------------------------------------------------------------------ answers in full


def accelerator(held, choice="c", slack=0, longest=3, **more):
    """Two tasks that may use the core, or be quicker on the accelerator, which a third one holds for some time."""
    quick = version("quick", 1, "g")
    tasks = [
        task(name, 5, version("core", n, choice, **more), quick, slack=slack) for name, n in (("a", longest), ("b", 3))
    ]
    return model(*tasks, task("holder", 20, version("v", held, "g")), units=f"{choice} g")


def rates(*pairs, units="a b c d", slack=0):
    """Tasks of some rates that may run anywhere, by period and WCET."""
    tasks = [task(f"t{n}", period, version("v", wcet, units), slack=slack) for n, (period, wcet) in enumerate(pairs)]
    return model(*tasks, units=units)


def switching(limit, *, slack=0, offset=0, helper=6, ahead=6, least=3):
    """To reach `on`, where b starts just when a has run, a must run first, and h before a."""
    rows = (after("h", least, 9, "end"), after("h", 0, 30))
    tasks = (
        task("h", 10, version("v", 1, "u2")),
        task("a", 10, version("v", helper, "u1", *rows[: 1 + (least > 3)])),
        task("b", 10, version("v", 2, "u2", after("a", ahead, ahead)), offset=offset, slack=slack),
        task("c", 10, version("v", 9, "u1"), offset=0),
    )
    modes = [mode("on", tasks[:3]), mode("off", tasks[3:])]
    return model(*tasks, units="u1 u2", modes=modes, transitions=[("off", "on", limit)])


def phases(*rows, bound="2/3", slack=0):
    """Tasks on units of their own whose access phases meet, by period, WCET, begin and end."""
    tasks = [
        task(f"t{n}", period, version("v", wcet, f"u{n}", access("mem", begin, end, Fraction(bound))), slack=slack)
        for n, (period, wcet, begin, end) in enumerate(rows)
    ]
    return model(*tasks, units=" ".join(f"u{n}" for n in range(len(rows))), resources="mem")


def gaps_of_one_job():
    """Each of two units has one job of 8 ms in 12, beside which no version of 5 ms has a place, with whatever slack."""
    busy = (task(f"o{n}", 12, version("v", 8, f"u{n}")) for n in (1, 2))
    return model(*busy, task("x", 12, version("v", 5, "u1"), version("w", 6, "u2")), units="u1 u2")


BY_HAND = {
    "accelerator 9": lambda: accelerator(9),
    "accelerator 12": lambda: accelerator(12, slack="1/50"),
    "accelerator 17": lambda: accelerator(17, "c d", gang=2),
    "two rates": lambda: rates((66, "42.24ms"), (33, "27.82ms"), (33, "10.87ms"), (15, "12.44ms"), (15, "4.43ms")),
    "equal rates": lambda: rates((10, 7), (10, 6), (10, 6), units="a b", slack="1/20"),
    "gaps of one job": gaps_of_one_job,
    "gaps": lambda: rates((6, 2), (12, 5), units="a"),
    "two lengths": lambda: accelerator(14, longest=4),
    "one too many": lambda: rates((10, 4), (15, 3), (30, 2), units="a"),
    "switch 1": lambda: switching(1),
    "switch 5": lambda: switching(5, offset=2),
    "switch 7": lambda: switching(7, slack="1/10", least=4),
    "switch 12": lambda: switching(12, ahead=8),
    "phases": lambda: phases((10, 7, 1, 7), (15, 4, 0, 4)),
    "phases of three": lambda: phases((12, 9, 0, 9), (12, 9, 2, 9), (18, 6, 1, 5), bound="2/5"),
    "phases with slack": lambda: phases((10, 8, 1, 8), (15, 4, 0, 4), slack="1/20"),
}
"""Systems with a proof of each kind; those of switches are schedulable in each mode."""


@pytest.mark.parametrize("part", range(3))
def test_explanations_in_full(part):
    answers = {}
    for name in list(BY_HAND)[part::3]:
        answers[name] = partial(explained, BY_HAND[name]())
    assert_answers(f"explain-by-hand-{part}", answers)
