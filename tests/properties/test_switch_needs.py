"""No valid transition table is shorter than what explain proves that the entering tasks need."""

import random

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.explain.switches import least_length
from halpipe.pipeline.solve.schedule import SearchOptions
from support import after, mode, model, task, version


def system(rng):
    """A mode of one task, and another one that three entering tasks with windows upon each other join."""
    stays = task("stays", 10, version("v", rng.randint(1, 4)))
    tasks = [stays]
    for number in range(3):
        rows = [
            after(other.name, low := rng.randint(0, 8), low + rng.randint(2, 12), rng.choice(("start", "end")))
            for other in tasks
            if rng.random() < 0.6
        ]
        versions = [version(f"v{k}", rng.randint(1, 4), f"u{number}", *rows[k:]) for k in range(rng.randint(1, 2))]
        offset = rng.randrange(4) if rng.random() < 0.8 else None
        tasks.append(task(f"t{number}", 10, *versions, slack=rng.choice((0, 0, "1/5")), offset=offset))
    modes = [mode("before", tasks[:1]), mode("after", tasks)]
    return model(*tasks, units="u0 u1 u2", modes=modes, transitions=[("before", "after", None)])


@pytest.mark.slow
def test_tables_are_as_long_as_entering_tasks_need():
    tight = tables = 0
    for seed in range(60):
        drawn = system(random.Random(seed))
        try:
            found = schedule_model(drawn, SearchOptions(budget=200), lambda *_: True).schedule.transitions
        except HalpipeError:  # one of the modes has no schedule
            continue
        for table in found:
            need = least_length(drawn, drawn.transitions[0])
            tables += 1
            assert table.length >= (ZERO if need is None else need.length), seed
            tight += need is not None and table.length == need.length
    assert tables > 10
    assert tight > 3
