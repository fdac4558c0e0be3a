"""What the jobs of a version meet as they grow, and the edges that their ends come to, against looking at each."""

from dataclasses import replace
from random import Random

import pytest

from halpipe.models import Anchor, Schedule, Status, TransitionTable
from halpipe.pipeline.whatif.excerpt import Sections
from support import after, job, mode, model, ms, schedule, task, version

UNITS = ("u1", "u2")


def drawn(rng):
    """A mode of 40 ms, a switch, and a mode of 10 ms: on each unit a task of either mode, and a job of the table."""
    pairs = [(f"{name}{unit}", unit, period) for name, period in (("m", 40), ("n", 10)) for unit in UNITS]
    tasks = [task(name, period, version("v", rng.randint(1, period - 1), unit)) for name, unit, period in pairs]
    modes = [mode(name, [each for each in tasks if each.name[0] == name]) for name in "mn"]
    system = model(*tasks, units=" ".join(UNITS), modes=modes)
    tables = []
    for name, period in (("m", 40), ("n", 10)):
        own = [job(system, f"{name}{unit}", 0, rng.randrange(period), unit) for unit in UNITS]
        tables.append(schedule(system, period, *own, mode_name=name).modes[0])
    between = TransitionTable(
        source="m", target="n", length=ms(rng.randrange(6)), worst_latency=ms(50), status=Status.VALID,
        jobs=(job(system, "nu1", 0, 0, "u1"),),
    )  # fmt: skip
    return system, Schedule(model="m", model_sha256="", modes=tuple(tables), transitions=(between,))


@pytest.mark.parametrize("seed", range(20))
def test_the_room_of_jobs_ends_at_the_next_start_on_their_unit(seed):
    """Jobs of the mode before may last for several cycles of the mode after."""
    system, plan = drawn(Random(seed))
    [section] = Sections(system, plan, ms(1)).switches()
    (before, after), [table] = plan.modes, plan.transitions
    parts = [(-40, before.jobs), (0, table.jobs), *((table.length // ms(1) + 10 * n, after.jobs) for n in range(9))]
    placed = [(begin + each.start // ms(1), each) for begin, jobs in parts[:3] for each in jobs]
    starts = [(begin + each.start // ms(1), each) for begin, jobs in parts for each in jobs]
    for name in (each.name for each in system.tasks):
        ends = [(start + (own.end - own.start) // ms(1), own) for start, own in placed if own.task == name]
        on_units = [at - end for end, own in ends for at, other in starts if other.units == own.units and at >= end]
        room = section.room(name, "v")
        assert room.units == room.free == min(on_units)
        assert {at for _, at in room.met} <= {at for at, _ in starts}


def test_an_end_in_the_cycle_before_a_switch_comes_to_the_edges_of_its_own_mode():
    """b must end at most 20 ms after a, which is over at 4 ms of 40; b is over at 9 ms. The mode after has 10 ms."""
    row = replace(after("a", 0, 20, "end"), to=Anchor.END)
    tasks = [task("a", 40, version("v", 4)), task("b", 40, version("v", 3, "u2", row)), task("c", 10, version("v", 1))]
    modes = [mode("m", tasks[:2]), mode("n", tasks[2:])]
    system = model(*tasks, units="u1 u2", modes=modes)
    rows = {"m": [("a", 0, 0, "u1"), ("b", 0, 6, "u2")], "n": [("c", 0, 0, "u1")]}
    own = [
        schedule(system, period, *(job(system, *each) for each in rows[name]), mode_name=name).modes[0]
        for name, period in (("m", 40), ("n", 10))
    ]
    table = TransitionTable(source="m", target="n", length=ms(0), worst_latency=ms(40), status=Status.VALID)
    plan = Schedule(model="m", model_sha256="", modes=tuple(own), transitions=(table,))
    [section] = Sections(system, plan, ms(1)).switches()
    assert section.turns("b", "v", 40) == [15]
