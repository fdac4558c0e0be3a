"""Small systems of which every schedule is looked at: proofs that there is none, and tables, held against that."""

import random
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import pytest
import verify_oracle as oracle
from split_exhaustive import TooManyError, first_schedule

from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.core.durations import milliseconds
from halpipe.models import Interrupt, Split, Unit
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.codes import PHASES_OVERLOAD
from halpipe.pipeline.verify import verify
from profiles import volume
from support import access, mode, model, task, version

PERIODS = ((3, 3), (4, 4), (3, 6), (4, 8), (2, 4), (4, 6))


def drawn(seed):
    """Two or three tasks, most of them split, on one or two units that serve interrupts now and then.

    They fill one unit where they meet on it; `apart` they may meet in their access phases alone.
    """
    rng = random.Random(seed)
    periods = rng.choice(PERIODS)
    apart = rng.random() < 0.3
    tasks, left = [], Fraction(1)
    for number in range(rng.choice((2, 2, 3))):
        period = periods[number] if number < 2 else rng.choice(periods)
        wcet = rng.randint(1, max(1, period - 1 if apart else int(left * period)))
        left -= Fraction(wcet, period)
        tasks.append(_task(rng, f"t{number}", period, wcet, "aba"[number] if apart else None))
    system = model(*tasks, units="a b", resources="r", modes=(mode("one", tasks),))
    return replace(system, units=tuple(_unit(rng, unit.name) for unit in system.units))


def drawn_apart(seed):
    """Two or three tasks, each alone on a unit, that meet in access phases whose bounds sum to more than 1.

    Most are strictly periodic and split, and some must resume, or serve interrupts: so where a phase lies is open.
    """
    rng = random.Random(seed)
    periods = rng.choice(PERIODS)
    tasks = []
    for number, unit in enumerate("abc"[: rng.choice((2, 2, 2, 3))]):
        period = rng.choice(periods)
        wcet = rng.randint(1, period)
        phases = _phases(rng, wcet)
        chosen = replace(version("v", wcet, unit, *phases), split=_split(rng, wcet, phases))
        slack = rng.choice((*[0] * 9, Fraction(1, period)))
        tasks.append(task(f"t{number}", period, chosen, slack=slack, offset=rng.choice((None, None, None, 0))))
    system = model(*tasks, units="a b c", resources="r", modes=(mode("one", tasks),))
    return replace(system, units=tuple(_unit(rng, unit.name) for unit in system.units))


def _phases(rng, wcet):
    """One phase, or two beside each other, each of most of the resource."""
    cut = rng.choice((wcet, wcet, rng.randint(1, wcet)))
    first = access("r", rng.randrange(cut), cut, rng.choice(("1", "2/3", "3/5", "2/5")))
    second = access("r", cut, wcet, rng.choice(("1", "2/3"))) if cut < wcet else None
    return [first, *([second] if second and rng.random() < 0.5 else [])]


def _task(rng, name, period, wcet, home):
    gang = rng.choice((1, 1, 1, 1, 2)) if home is None else 1
    units = home or ("a b" if gang == 2 else rng.choice(("a", "a", "a", "b", "a b")))
    phases = [_phase(rng, wcet)] if home or rng.random() < 0.3 else []
    chosen = version("v", wcet, units, *phases, gang=gang)
    return task(
        name,
        period,
        replace(chosen, split=_split(rng, wcet, phases)),
        slack=rng.choice((0, 0, 0, Fraction(1, period), 1)),
        offset=rng.choice((None, None, None, 0)),
        deadline=rng.choice((None, None, wcet, period + rng.randint(1, 3))),
    )


def _phase(rng, wcet):
    start = rng.randrange(wcet)
    return access("r", start, rng.randint(start + 1, wcet), rng.choice(("1", "2/3", "1/2")))


def _split(rng, wcet, phases):
    points = [p for p in range(1, wcet) if not any(a.start < milliseconds(p) < a.end for a in phases)]
    kind = rng.random()
    if kind < 0.4 and points:
        some = sorted(rng.sample(points, rng.randint(1, len(points))))
        gaps = rng.choice((None, 0, 1))
        return Split(points=tuple(map(milliseconds, some)), resume=milliseconds(rng.choice((0, 0, 1))), max_gaps=gaps)
    if kind < 0.7 and wcet > 1:
        return Split(anywhere=True, max_gaps=rng.choice((0, 1, 2)))
    return Split()


def _unit(rng, name):
    if rng.random() < 0.8:
        return Unit(name=name)
    return Unit(
        name=name, interrupts=(Interrupt(name="i", distance=milliseconds(rng.choice((4, 8))), wcet=milliseconds(1)),)
    )


def judged(seed, draw=drawn):
    """Return which proofs there are, whether there is a schedule, and whether it is found; None where that is open."""
    system = draw(seed)
    errors = {d.code for d in validate(system) if d.is_error}
    if errors - {PHASES_OVERLOAD.id}:
        return None
    try:
        plan = first_schedule(system)
    except TooManyError:
        return None
    if errors:
        assert plan is None, f"seed {seed} has a schedule, whatever validate says of its phases"
        return errors, False, False
    proofs = [d for hopeless in find_witnesses(system) for d in hopeless.diagnostics]
    told = "\n".join(map(render_text, proofs))
    assert plan is None or not proofs, f"seed {seed} has a schedule\n{told}"
    found = searched(system)
    if found is not None:
        wrong = [render_text(d) for d in verify(system, found) if d.is_error]
        assert not wrong, f"seed {seed}: {wrong}"
        assert oracle.broken(system, found) == set()
        assert plan is not None, f"seed {seed}: a schedule was found that is not among all there are"
    return {d.code for d in proofs}, plan is not None, found is not None


def searched(system):
    """Return the first valid schedule, in whole ticks; None where none is found, or a task can run nowhere."""
    try:
        found = schedule_model(system, SearchOptions(budget=60, optimise=()), lambda *_: True)
    except HalpipeError:
        return None
    return found.schedule if found.is_complete else None


def judge_all(seeds, draw=drawn):
    """Judge systems; return how often each proof was given, and how often there was a schedule, found or not.

    Of those without, ``proven`` counts how many a proof decides.
    """
    counted = Counter()
    for outcome in filter(None, (judged(seed, draw) for seed in seeds)):
        proofs, exists, is_found = outcome
        counted.update(proofs)
        counted[("exists" if exists else "none", is_found)] += 1
        counted["proven"] += bool(proofs)
    return counted


def test_no_proof_against_what_has_a_schedule():
    counted = judge_all(range(40))
    assert counted["exists", True] > 5, counted
    assert counted["none", False] > 5, counted


@pytest.mark.slow  # the same in small: above
def test_no_proof_against_what_has_a_schedule_at_length():
    counted = judge_all(range(volume(200)))
    assert min(counted["HAL0430"], counted["HAL0431"]) > 3, counted
    assert counted["HAL0432"] > 0, counted


@pytest.mark.slow
def test_no_proof_against_phases_that_can_lie_apart():
    counted = judge_all(range(30), drawn_apart)
    assert counted["HAL0432"] > 1, counted
    assert counted["exists", True] > 10, counted


@pytest.mark.slow  # the same in small: above
def test_no_proof_against_phases_that_can_lie_apart_at_length():
    """One system of five that have no table is proven so by what its phases need of the resource."""
    count = volume(130)
    counted = judge_all(range(count), drawn_apart)
    assert counted["HAL0432"] * 6 > counted["none", False] > count // 4, counted
    assert counted["HAL0243"] > 0, counted
    assert counted["exists", True] > count * 3 // 8, counted
