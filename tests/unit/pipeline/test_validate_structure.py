"""What is missing from a model, and what is never used."""

from dataclasses import replace

from validate_cases import alone, codes_of, found, the

from halpipe.models import Mode, Run
from halpipe.pipeline.validate import codes, validate
from support import access, after, mode, model, task, version

A = task("a", 25, version("v", 5))
ON_DEMAND = task("d", None, version("v", 5))


def test_empty_model_lacks_everything():
    empty = model(units="", modes=[])
    assert codes_of(empty) == {codes.NO_UNITS.id, codes.NO_TASKS.id, codes.NO_MODES.id}
    assert codes_of(alone()) == set()


def test_task_without_versions():
    assert the(model(A, task("b", 25), modes=[mode("m", [A])]), codes.NO_VERSIONS).path == 'task "b"'


def test_version_without_units():
    assert the(alone(units=""), codes.VERSION_WITHOUT_UNITS).path == 'task "a" version "v"'


def test_mode_without_runs():
    assert the(model(A, modes=[mode("m", [A]), mode("off", [])]), codes.EMPTY_MODE).path == 'mode "off"'


def test_run_without_versions():
    system = model(A, modes=[mode("m", [A]), Mode(name="n", runs=(Run(task="a", versions=()),))])
    assert the(system, codes.RUN_SELECTS_NOTHING).path == 'mode "n" task "a"'


def test_mode_without_a_period():
    assert the(model(ON_DEMAND), codes.NOTHING_PERIODIC).path == 'mode "all"'
    asks = task("a", 25, version("v", 5, "u1", after("d", 0, 20)))
    assert validate(model(asks, ON_DEMAND)) == ()


def test_mode_of_unknown_tasks_only_is_not_called_aperiodic():
    system = model(A, modes=[mode("m", [A]), mode("n", [ON_DEMAND])])
    assert found(system, codes.NOTHING_PERIODIC) == []


def test_unused_unit_and_resource_are_notes():
    system = model(A, units="u1 spare", resources="bus")
    assert the(system, codes.UNUSED_UNIT).path == 'unit "spare"'
    assert the(system, codes.UNUSED_RESOURCE).path == 'resource "bus"'
    assert not any(d.is_error for d in validate(system))
    used = model(task("a", 25, version("v", 5, "u1 spare", access("bus", 0, 1))), units="u1 spare", resources="bus")
    assert validate(used) == ()


def test_task_and_version_in_no_mode():
    both = task("a", 25, version("v", 5), version("w", 6))
    system = model(both, task("b", 25, version("v", 5)), modes=[Mode(name="m", runs=(Run(task="a", versions=("v",)),))])
    assert the(system, codes.TASK_NEVER_RUNS).path == 'task "b"'
    assert the(system, codes.VERSION_NEVER_RUNS).path == 'task "a" version "w"'


def test_missing_modes_are_reported_once_and_not_for_every_task():
    assert codes_of(replace(alone(), modes=())) == {codes.NO_MODES.id}
