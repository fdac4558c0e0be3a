"""Every kind of witness on a file of its own, with the change that takes it away; and the arithmetic behind them."""

import re
from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import gcd, lcm
from pathlib import Path
from random import Random

import pytest

from halpipe.core.files import write_output
from halpipe.importers.native import read_model
from halpipe.models import Binding, Interrupt, Split, Status
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.explanation import ExplainOptions, Verdict, explain
from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.meetings import Budget, Part, find_meeting, meet
from halpipe.pipeline.explain.sharing import _cut, _Gap, packings
from halpipe.pipeline.explain.witnesses import _is_dead, find_witnesses
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.context import Context
from halpipe.pipeline.verify import verify
from support import access, after, model, ms, task, version

FOLDER = Path(__file__).parents[2] / "fixtures" / "explain"

NEIGHBOURS = {
    "HAL0430-tasks-meet.xml": ('wcet="1.5ms"', 'wcet="1ms"'),
    "HAL0430-three-tasks-meet.xml": ('wcet="5ms"', 'wcet="2ms"'),
    "HAL0430-slack-too-small.xml": ('slack="0.125"', 'slack="0.25"'),
    "HAL0431-no-gap.xml": ('slack="0.125"', 'slack="0.25"'),
    "HAL0432-phases-meet.xml": ('start="1ms" end="3ms"', 'start="1ms" end="2ms"'),
    "HAL0433-window-too-narrow.xml": ('max="4ms"', 'max="5ms"'),
    "HAL0434-windows-contradict.xml": ('min="1ms" max="4ms"', 'min="1ms" max="5ms"'),
    "HAL0434-window-and-unit.xml": ('min="0ms" max="2ms"', 'min="0ms" max="3ms"'),
    "HAL0434-offsets.xml": ('offset="3ms"', 'offset="4ms"'),
    "HAL0435-conflict.xml": ('wcet="6ms"', 'wcet="3ms"'),
    "HAL0446-unit-held.xml": ('wcet="18ms"', 'wcet="17ms"'),
    "HAL0438-version-never-fits.xml": ('wcet="3ms"', 'wcet="2ms"'),
    "HAL0448-bound-tasks.xml": ('wcet="9ms"', 'wcet="8ms"'),
}
"""For every fixture what to replace so that it has a schedule: where possible the very limit of the proof."""

FIXTURES = sorted(FOLDER.glob("*.xml"))


def found_in(path):
    """The findings of explain, without remedies, as (line, code)."""
    explanation = explain(read_model(str(path)), ExplainOptions(remedies=False))
    return explanation, {(d.at.line, d.code) for d in explanation.diagnostics}


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_fixture_has_the_findings_it_names(path):
    if "HAL0435" in path.name:
        pytest.importorskip("ortools")
    lines = path.read_text().splitlines()
    expected = {(n, code) for n, line in enumerate(lines, 1) for code in re.findall(r"<!-- (HAL\d{4}) -->", line)}
    explanation, found = found_in(path)
    assert found >= expected
    assert explanation.verdicts == (("all", Verdict.INFEASIBLE),)
    assert int(explanation.exit) == 4
    for diagnostic in explanation.diagnostics:
        assert diagnostic.path
        assert diagnostic.help


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_the_neighbour_has_a_schedule(path, tmp_path):
    old, new = NEIGHBOURS[path.name]
    text = path.read_text()
    assert old in text
    write_output(tmp_path / "model.xml", text.replace(old, new))
    system = read_model(str(tmp_path / "model.xml"))
    assert not find_witnesses(system)
    schedule = schedule_model(system, SearchOptions(), lambda *_: True).schedule
    assert schedule.modes[0].status is Status.VALID
    assert not [d for d in verify(system, schedule) if d.is_error]


def test_every_fixture_has_its_neighbour_and_every_witness_a_fixture():
    assert {path.name for path in FIXTURES} == set(NEIGHBOURS)
    proofs = {codes.TASKS_MEET, codes.NO_GAP, codes.PHASES_MEET, codes.WINDOW_TOO_NARROW, codes.WINDOWS_CONTRADICT}
    assert {code.id for code in proofs} <= {path.name[:7] for path in FIXTURES}


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_validate_alone_does_not_see_it(path):
    assert not [d for d in validate(read_model(str(path))) if d.is_error]


@pytest.mark.parametrize(("gang", "distance"), [(1, None), (2, None), (1, 100), (2, 100)])
def test_a_gang_is_over_when_one_job_would_be_unless_its_units_serve_interrupts(gang, distance):
    """One task starts 21 ms to 22 ms after the end of another of 2 ms, three times in its 24 ms."""
    system = model(
        task("t0", 24, version("v", 2, "u1 u2", gang=gang)),
        task("t2", 8, version("v", 1, "u3", after("t0", 21, 22, "end"))),
        units="u1 u2 u3",
    )
    interrupts = () if distance is None else (Interrupt(name="i", distance=ms(distance), wcet=ms("0.5ms")),)
    system = replace(system, units=tuple(replace(unit, interrupts=interrupts) for unit in system.units))
    proofs = {found.code for witness in find_witnesses(system, []) for found in witness.diagnostics}
    assert (codes.WINDOW_TOO_NARROW.id in proofs) is (gang == 1 or distance is None)


# ------------------------------------------------------------------------------------------------ arithmetic


def brute_meets(parts):
    """Whether the parts meet for every choice of whole phases, tried one by one."""
    total = lcm(*(part.period for part in parts))

    def busy(part, phase):
        starts = range(phase, phase + total, part.period)
        return {(start + t) % total for start in starts for t in range(part.length)}

    choices = product(*([busy(part, phase) for phase in range(part.period)] for part in parts))
    return all(set.intersection(*choice) for choice in choices)


def part(name, period, length, height=1):
    return Part(name, period, length, height)


@pytest.mark.parametrize("periods", [(4, 6), (6, 6), (3, 5), (4, 8)])
def test_two_parts_meet_exactly_if_they_are_longer_than_the_gcd(periods):
    for first in range(1, periods[0] + 1):
        for second in range(1, periods[1] + 1):
            pair = [part("a", periods[0], first), part("b", periods[1], second)]
            assert bool(meet(pair, Budget())) == brute_meets(pair)


@pytest.mark.parametrize("periods", [(4, 6, 3), (6, 6, 4), (2, 4, 8), (6, 4, 10)])
def test_three_parts_that_are_said_to_meet_do(periods):
    claimed = 0
    for lengths in (
        (a, b, c) for a in range(1, periods[0]) for b in range(1, periods[1]) for c in range(1, periods[2])
    ):
        three = [part(n, p, c) for n, p, c in zip("abc", periods, lengths, strict=True)]
        if meet(three, Budget()):
            claimed += 1
            assert brute_meets(three), three
    assert claimed


def test_only_what_is_needed_is_named():
    parts = [part("a", 10, 6), part("b", 10, 6), part("c", 10, 6, height=0)]
    assert [step.part.task for step in find_meeting(parts, 1, Budget())] == ["a", "b"]


def test_what_meets_within_the_capacity_is_no_witness():
    assert not find_meeting([part("a", 10, 6), part("b", 10, 6)], 2, Budget())


def test_parts_of_a_single_tick_meet_where_each_takes_all_of_it():
    assert find_meeting([part("a", 1, 1), part("b", 1, 1)], 1, Budget())
    assert not find_meeting([part("a", 2, 1), part("b", 2, 1)], 1, Budget())


def test_without_budget_nothing_is_claimed():
    assert not find_meeting([part("a", 10, 6), part("b", 10, 6)], 1, Budget(0))


# ------------------------------------------------------------------------------------------------ no false alarm


def test_jobs_of_a_task_may_go_to_different_units():
    """No two of the three share a unit in 10 ms, yet two units hold them: the jobs move round (hyperperiod 20 ms)."""
    units = "u1 u2"
    tasks = [task(n, "10ms", version("v", c, units)) for n, c in (("a", "7ms"), ("b", "7ms"), ("c", "6ms"))]
    system = model(*tasks, task("slow", "20ms", version("v", "1ms", "u3")), units="u1 u2 u3")
    assert not find_witnesses(system)
    assert explain(system, ExplainOptions(remedies=False)).verdicts == (("all", Verdict.SCHEDULABLE),)


def test_a_version_without_the_constraint_is_a_way_out():
    free, bound = version("free", "1ms", "u1"), version("bound", "1ms", "u1", after("slow", 0, 4))
    system = model(task("slow", 10, version("v", "1ms", "u2")), task("fast", 5, bound, free), units="u1 u2")
    assert not find_witnesses(system)


def test_modes_are_judged_one_by_one():
    from halpipe.models import Mode, Run

    a, b = task("a", 6, version("v", "2ms")), task("b", 15, version("v", "2ms"))
    runs = {"both": ("a", "b"), "one": ("a",)}
    modes = [Mode(name=n, runs=tuple(Run(task=t, versions=("v",)) for t in tasks)) for n, tasks in runs.items()]
    system = model(a, b, modes=modes)
    assert [hopeless.mode for hopeless in find_witnesses(system)] == ["both"]
    assert not find_witnesses(system, ["one"])
    assert set(find_witnesses(system)[0].tasks) == {"a", "b"}


def bound(name, period, wcet, units="u1 u2"):
    return replace(task(name, period, version("v", wcet, units)), binding=Binding.MODE)


def assignable(tasks):
    """Whether some assignment keeps every unit at most full, and no two tasks on one whose jobs must meet."""
    for units in product(*(each.versions[0].units for each in tasks)):
        held = {}
        for each, unit in zip(tasks, units, strict=True):
            held.setdefault(unit, []).append((each.period.ns, each.versions[0].wcet.ns))
        if all(
            sum(Fraction(wcet, period) for period, wcet in own) <= 1
            and all(c + d <= gcd(p, q) for n, (p, c) in enumerate(own) for q, d in own[n + 1 :])
            for own in held.values()
        ):
            return True
    return False


@pytest.mark.parametrize("seed", range(40))
def test_bound_tasks_have_a_witness_exactly_where_no_assignment_exists(seed):
    """Against all assignments, one by one; tasks on demand of any unit, and two tasks alone, have other witnesses."""
    draw = Random(seed)
    units = [("u1 u2", "u2 u3", "u1 u2 u3")[draw.randrange(3)] for _ in range(6)]
    tasks = [bound(f"t{n}", draw.choice((10, 20)), f"{draw.randrange(2, 9)}ms", own) for n, own in enumerate(units)]
    system = model(*tasks, units="u1 u2 u3")
    hopeless = find_witnesses(system)
    assert bool(hopeless) or assignable(tasks)
    named = {d.code for each in hopeless for d in each.diagnostics}
    if codes.NO_ASSIGNMENT.id in named:
        assert not assignable(tasks)


@pytest.mark.parametrize(("slack", "is_proven"), [("1/3", True), ("1/2", False)])
def test_slack_counts_for_what_it_takes_from_the_time_of_two_tasks(slack, is_proven):
    """A job of 7 ms in 12 leaves one of 2 ms in 6 no place if that may be late by 2 ms; by 3 ms it can wait."""
    late = replace(bound("late", 6, 2), slack=Fraction(slack))
    system = model(bound("a", 12, 7), bound("b", 12, 7), late, units="u1 u2")
    named = {d.code for each in find_witnesses(system) for d in each.diagnostics}
    assert named == ({codes.NO_ASSIGNMENT.id} if is_proven else set())
    if not is_proven:
        assert schedule_model(system, SearchOptions(optimise=()), lambda *_: True).is_complete


def test_no_task_is_named_without_which_the_others_do_not_fit_either():
    spare = bound("spare", 20, "1ms")
    system = model(bound("a", 20, "9ms"), bound("b", 20, "12ms"), bound("c", 20, "12ms"), spare, units="u1 u2")
    (hopeless,) = find_witnesses(system)
    assert set(hopeless.tasks) == {"a", "b", "c"}


def test_tasks_on_demand_have_no_rate_with_which_they_would_meet():
    rows = (after("a", 0, 10), after("b", 0, 10))
    demanded = [task(name, None, version("v", 2)) for name in "ab"]
    system = model(task("caller", 10, version("v", 2, "u2", *rows)), *demanded, units="u1 u2")
    assert not find_witnesses(system)
    assert schedule_model(system, SearchOptions(optimise=()), lambda *_: True).is_complete


@pytest.mark.parametrize("certain", [0, 1])
def test_a_nanosecond_that_slack_does_not_move_meets_what_fills_the_unit(certain):
    full, late = task("a", 10, version("v", 10)), task("b", 10, version("v", f"{3_000_000 + certain}ns"), slack="3/10")
    named = {d.code for each in find_witnesses(model(full, late)) for d in each.diagnostics}
    assert (codes.TASKS_MEET.id in named) == bool(certain)


def test_equal_units_are_no_effort_for_an_assignment():
    """Nine tasks for eight units: more than 40 000 assignments, all but one of which only name the units otherwise."""
    units = " ".join(f"u{n}" for n in range(8))
    context = Context(model(*(bound(f"t{n}", 10, 6, units) for n in range(9)), units=units))
    [witness] = packings(mode_facts(context.active[0]))
    assert len(witness.tasks) == 9


HALVES = [access("mem", 0, 2, Fraction(1, 2)), access("mem", 1, 3, Fraction(1, 2))]


@pytest.mark.parametrize(("limits", "works", "fails"), [
    ({}, version("v", 10), version("v", "10000001ns")),
    ({"period": None}, version("v", 99), None),
    ({"deadline": ms(9)}, version("v", 9), version("v", "9000001ns")),
    ({"let": ms(8)}, version("v", 8), version("v", "8000001ns")),
    ({"distance": ms(16)}, version("v", 6), version("v", "6000001ns")),
    ({"distance": ms(16), "deadline": ms(15)}, version("v", 5), version("v", "5000001ns")),
    ({}, version("v", 1, "u1 u2", gang=2), version("v", 1, "u1 u2", gang=3)),
    ({}, version("v", 1, "u1", after("b", 3, 3)), version("v", 1, "u1", after("b", 4, 3))),
    ({}, version("v", 9, "u1", *HALVES), version("v", 9, "u1", *HALVES, access("mem", 1, 2, Fraction(1, 9)))),
    ({}, version("v", 9, "u1", access("mem", 0, 2), access("mem", 2, 4), access("bus", 1, 3)),
     version("v", 9, "u1", access("mem", 0, 2), access("mem", 1, 4))),
])  # fmt: skip
def test_no_job_can_run_in_a_version_beyond_its_own_limits(limits, works, fails):
    own = replace(task("a", 10), **limits)
    assert not _is_dead({}, own, works)
    assert fails is None or _is_dead({}, own, fails)


@pytest.mark.parametrize(
    ("phases", "pieces"), [((), [0, 0, 0, 1, 2]), ([access("r", 1, 3), access("r", 4, 5)], [0, 0, 0, 0, 2])]
)
def test_a_piece_has_room_in_a_gap_beside_resumption_and_interrupts(phases, pieces):
    """Of a gap, 1 ms is lost when the job goes on, and 1 ms to an interrupt in each 4 ms; phases are not cut."""
    long = version("v", 9, "u1", *phases)
    system = model(task("a", 40, replace(long, split=Split(resume=ms(1)))), resources="r")
    often = Interrupt(name="i", distance=ms(4), wcet=ms(1))
    context = Context(replace(system, units=(replace(system.units[0], interrupts=(often,)),)))
    facts = mode_facts(context.active[0], context.units)
    own = facts.tasks["a"]
    found = [_cut(facts, own.versions[0], _Gap("u1", own, facts.ticks(ms(length)))) for length in range(5)]
    assert found == [facts.ticks(ms(piece)) for piece in pieces]
