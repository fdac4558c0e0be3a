"""validate stays linear: ten thousand tasks, sound and thoroughly broken."""

from dataclasses import replace

import pytest
from validate_cases import found

from growth import growth, half_way
from halpipe.pipeline.validate import codes, validate
from support import access, after, model, task, version

TASKS = 10_000
FEW = 500


def large(predecessor, tasks=TASKS):
    """Four access phases and one constraint for each task, on a platform that is just large enough."""
    count, tasks = tasks, []
    for i in range(count):
        phases = [access("bus", k, k + 1, f"1/{count}") for k in range(4)]
        rows = [after(predecessor(i), 0, 100)] if i else []
        parts = version("v", "5ms", f"u{i // 20} u{i // 20 + 1}", *phases, *rows)
        tasks.append(task(f"t{i}", (100, 200, 400)[i % 3], parts))
    return model(*tasks, units=" ".join(f"u{k}" for k in range(count // 20 + 1)), resources="bus")


def chained(count=TASKS):
    return large(lambda i: f"t{i - 1}", count)


def misspelt(count=TASKS):
    return large(lambda i: f"task{i}", count)


def circular(count=TASKS):
    system = chained(count)
    first = system.tasks[0]
    closed = replace(first, versions=(replace(first.versions[0], precedences=(after(f"t{count - 1}", 0, 100),)),))
    return replace(system, tasks=(closed, *system.tasks[1:]))


def starred(count=TASKS):
    """Tasks on demand that one version names, and as many versions that each name another one."""
    names = [f"t{i}" for i in range(count)]
    served = [task(name, None, version("v", "1ns", "u0")) for name in names]
    one = task("all", 100, version("v", "1ms", "u0", *(after(name, 0, 100) for name in names)))
    each = [version(f"v{i}", "1ms", "u0", after(name, 0, 100)) for i, name in enumerate(names)]
    return model(*served, one, task("any", 100, *each), units="u0")


@pytest.mark.parametrize("build", [chained, misspelt, circular, starred])
@pytest.mark.slow
def test_work_grows_with_the_model_and_not_with_its_square(build):
    def prepare(count):
        system = build(count)
        return lambda: validate(system)

    assert growth(prepare, FEW, TASKS) < half_way(TASKS / FEW)


@pytest.mark.slow
def test_large_sound_model():
    assert validate(chained()) == ()


@pytest.mark.slow
def test_large_model_in_which_every_reference_is_unknown():
    assert len(found(misspelt(), codes.UNKNOWN_TASK)) == TASKS - 1


@pytest.mark.slow
def test_large_model_that_is_one_cycle():
    assert [d.code for d in validate(circular())] == [codes.PRECEDENCE_CYCLE.id]
