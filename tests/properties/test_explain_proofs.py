"""Proofs for many small systems in full, of each kind from its own family, and the systems for which there is none."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
from explain_systems import random_system

from golden_answers import assert_answers, assert_seeds, findings
from halpipe.models import Binding, Interrupt, Match
from halpipe.pipeline.explain.meetings import Budget, Part, find_meeting, meet_in_groups
from halpipe.pipeline.explain.switches import least_length
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.validate import validate
from support import access, after, chain, mode, model, ms, task, version

UNITS = ("a", "b", "c")
SLACKS = (Fraction(0),) * 4 + (Fraction(1, 20), Fraction(1, 6), Fraction(1, 4))


def bound(rng):
    """Tasks that each stay on one of two or three units, which together are nearly full."""
    units, period = UNITS[: rng.randint(2, 3)], rng.choice((12, 20, 24))
    tasks = []
    for number in range(rng.randint(3, 6)):
        own = period // rng.choice((1, 1, 2))
        places = " ".join(sorted(rng.sample(units, rng.choice((1, 2, len(units), len(units))))))
        made = task(
            f"t{number}", own, version("v", rng.randint(own // 4, own * 2 // 3), places), slack=rng.choice(SLACKS)
        )
        tasks.append(replace(made, binding=rng.choice((Binding.MODE, Binding.MODE, Binding.SYSTEM, Binding.JOB))))
    return model(*tasks, units=" ".join(units))


def windowed(rng):
    """Tasks with windows on several others, offsets and slack, often on units of their own."""
    periods = rng.choice(((12,), (10,), (12,), (24, 24, 12), (8, 12), (10, 15, 30)))
    tasks = []
    for number in range(rng.randint(2, 4)):
        rows = []
        for other in rng.sample(tasks, min(len(tasks), rng.randint(1, 2))):
            low = rng.randint(0, 9)
            rows.append(after(other.name, low, low + rng.choice((0, 1, 3, 6)), rng.choice(("start", "end"))))
        units = rng.choice((f"u{number}", "u0", "u0 u1"))
        more = [version("w", rng.randint(1, 3), units, *rows)] if rng.random() < 0.25 else []
        own = version("v", rng.randint(1, 4), units, *rows)
        offset = rng.randrange(12) if rng.random() < 0.3 else None
        tasks.append(task(f"t{number}", rng.choice(periods), own, *more, slack=rng.choice(SLACKS), offset=offset))
    return model(*tasks, units="u0 u1 u2 u3")


def crowded(rng):
    """Tasks that run on cores or on an accelerator, which another one holds for some time."""
    cores = " ".join(UNITS[: rng.randint(1, 2)])
    tasks = []
    for number in range(rng.randint(2, 4)):
        period, wcet = rng.choice((5, 6, 10)), rng.randint(2, 4)
        gang = 2 if len(cores) > 1 and rng.random() < 0.2 else 1
        quick = [version("quick", rng.randint(1, wcet), "g")] if rng.random() < 0.7 else []
        tasks.append(
            task(f"t{number}", period, version("core", wcet, cores, gang=gang), *quick, slack=rng.choice(SLACKS))
        )
    held = [task(f"h{n}", 20 * (n + 1), version("v", rng.randint(6, 18), "g")) for n in range(rng.randint(0, 2))]
    system = model(*tasks, *held, units=f"{cores} g")
    if rng.random() < 0.3:
        served = (Interrupt(name="i", distance=ms(rng.choice((5, 8))), wcet=ms("0.5ms")),)
        system = replace(system, units=(replace(system.units[0], interrupts=served), *system.units[1:]))
    return system


def phased(rng):
    """Tasks on units of their own with access phases on one of two resources."""
    tasks = []
    for number in range(rng.randint(2, 4)):
        period, wcet = rng.choice((10, 12, 15, 20)), rng.randint(3, 9)
        begin = rng.randrange(wcet)
        phase = access(rng.choice("rs"), begin, rng.randint(begin + 1, wcet), rng.choice(("1/3", "1/2", "2/3", "1")))
        tasks.append(task(f"t{number}", period, version("v", wcet, f"u{number}", phase), slack=rng.choice(SLACKS)))
    return model(*tasks, units="u0 u1 u2 u3", resources="r s")


def held(rng):
    """A chain with limits over tasks that need a unit which another task holds in long pieces."""
    period = rng.choice((10, 20))
    see = [version("gpu", rng.choice((1, 2, 3, 4, 7)), "gpu")]
    see += [version("cpu", rng.randint(5, 2 * period // 2), "cpu")] if rng.random() < 0.6 else []
    tasks = [
        task("grab", period, version("v", 1, "cpu"), slack=rng.choice((0, 1))),
        task("see", period, *see, slack=1),
        task("act", rng.choice((period, 40)), version("v", 1, "dsp"), slack=rng.choice((0, "1/8", 1))),
        task("detect", 40, version("v", rng.randint(6, 30), "gpu"), slack=1),
    ]
    if rng.random() < 0.3:  # another one that holds it as long
        tasks.append(replace(tasks[-1], name="also"))
    limits = {kind: rng.randint(8, 32) for kind in rng.choice((("reaction",), ("age",), ("reaction", "age")))}
    return model(*tasks, units="cpu gpu dsp", chains=[chain("picture", "grab see act", **limits)])


FAMILIES = {
    "hard": (random_system, 90),
    "bound": (bound, 350),
    "windowed": (windowed, 120),
    "crowded": (crowded, 90),
    "phased": (phased, 120),
    "held": (held, 120),
}
"""How a system is drawn, and how many are."""


def proofs(system):
    return findings(d for hopeless in find_witnesses(system, ()) for d in hopeless.diagnostics)


@pytest.mark.parametrize("family", FAMILIES)
def test_proofs_are_what_they_were_before(family):
    """A system that no proof is found for is named as well; those that are invalid are left out."""
    drawn, count = FAMILIES[family]
    systems = ((seed, drawn(random.Random(seed))) for seed in range(count))
    valid = ((seed, each) for seed, each in systems if not any(found.is_error for found in validate(each)))
    assert_seeds(f"proofs-{family}", ((seed, proofs(each)) for seed, each in valid), "no proof")


def test_parts_that_meet_are_what_they_were_before():
    """The parts one after the other, with what all have in common, or the groups; and the effort that is left."""
    lines = []
    for seed in range(150):
        rng = random.Random(seed)
        periods = rng.choice(((6, 10, 12, 15, 30), (4, 8, 12, 16), (6, 9, 18), (20, 30)))
        parts = []
        for number in range(rng.randint(2, 6)):
            period = rng.choice(periods)
            length = rng.randint(1, max(1, period * 4 // 5)) * rng.choice((1, 1, 1, -1))
            parts.append(Part(f"t{number}", period, length, rng.choice((1, 1, 1, 2, Fraction(1, 2)))))
        one, other = Budget(40), Budget(20)
        steps = find_meeting(parts, rng.choice((1, 2, 2, 3)), one)
        text = ", ".join(f"{step.part.task} {step.gcd} {step.together}" for step in steps)
        group = meet_in_groups([part for part in parts if part.length > 0], other) if parts[0].length > 0 else None
        whole = "" if group is None else f"{' '.join(group.names)} for {group.length} of {group.period}"
        lines.append(f"{seed}: {text}; {whole}; left {one.steps} {other.steps}")
    assert_answers("proofs-meetings", {"parts": lambda: lines})


def test_least_lengths_of_tables_are_what_they_were_before():
    """Modes that entering tasks can only begin after others of theirs have run."""
    lines = []
    for seed in range(120):
        rng = random.Random(seed)
        tasks = []
        for number in range(rng.randint(2, 4)):
            rows = []
            for other in rng.sample(tasks, min(len(tasks), rng.randint(1, 2))):
                low, anchor = rng.randint(0, 9), rng.choice(("start", "start", "end", "release"))
                match = rng.choice((Match.WINDOW, Match.WINDOW, Match.WINDOW, Match.CYCLE))
                rows.append(replace(after(other.name, low, low + 9, anchor), match=match))
            versions = [version("v", rng.randint(1, 3), "u1", *rows)]
            versions += [version("w", rng.randint(1, 3), "u1", *rows[:1])] if rng.random() < 0.3 else []
            period = rng.choice((10, 10, 20)) if rng.random() < 0.8 else None
            offset = rng.choice((0, 1, 3, 14)) if period and rng.random() < 0.8 else None
            slack = rng.choice((0, 0, Fraction(1, 10), Fraction(1, 2))) if period else 0
            tasks.append(task(f"t{number}", period, *versions, slack=slack, offset=offset))
        before = [t for t in tasks if rng.random() < 0.2]
        most = rng.choice((None, 3, 8))
        system = model(*tasks, modes=[mode("m", before), mode("n", tasks)], transitions=[("m", "n", most)])
        need = least_length(system, system.transitions[0])
        if need is not None:
            lines.append(f"{seed}: {need.length} for {' '.join(need.tasks)} from {need.latest}, {need.is_short}")
            lines += findings([need.reported()]) if need.is_short else []
    assert_answers("proofs-switches", {"lengths": lambda: lines})
