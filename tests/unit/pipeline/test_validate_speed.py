"""validate stays linear: ten thousand tasks, sound and thoroughly broken."""

import time
from dataclasses import replace

import pytest
from validate_cases import found

from halpipe.pipeline.validate import codes, validate
from support import access, after, model, task, version

TASKS = 10_000


def large(predecessor):
    """Four access phases and one constraint for each task, on a platform that is just large enough."""
    tasks = []
    for i in range(TASKS):
        phases = [access("bus", k, k + 1, f"1/{TASKS}") for k in range(4)]
        rows = [after(predecessor(i), 0, 100)] if i else []
        parts = version("v", "5ms", f"u{i // 20} u{i // 20 + 1}", *phases, *rows)
        tasks.append(task(f"t{i}", (100, 200, 400)[i % 3], parts))
    return model(*tasks, units=" ".join(f"u{k}" for k in range(TASKS // 20 + 1)), resources="bus")


def seconds(system):
    begin = time.process_time()
    findings = validate(system)
    return time.process_time() - begin, findings


@pytest.mark.slow
def test_large_sound_model():
    """Measured 0.3 s; the margin is for slow and busy machines, quadratic work would take minutes."""
    needed, findings = seconds(large(lambda i: f"t{i - 1}"))
    assert findings == ()
    assert needed < 3


@pytest.mark.slow
def test_large_model_in_which_every_reference_is_unknown():
    system = large(lambda i: f"task{i}")
    needed, _ = seconds(system)
    assert len(found(system, codes.UNKNOWN_TASK)) == TASKS - 1
    assert needed < 10


@pytest.mark.slow
def test_large_model_that_is_one_cycle():
    system = large(lambda i: f"t{i - 1}")
    first = system.tasks[0]
    closed = replace(first, versions=(replace(first.versions[0], precedences=(after(f"t{TASKS - 1}", 0, 100),)),))
    needed, findings = seconds(replace(system, tasks=(closed, *system.tasks[1:])))
    assert [d.code for d in findings] == [codes.PRECEDENCE_CYCLE.id]
    assert needed < 3
