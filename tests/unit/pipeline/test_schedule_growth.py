"""The work of a search grows with the model and not with its square; calls are counted, not time."""

from dataclasses import replace

import pytest

from growth import calls, half_way
from halpipe.core.diagnostics import Findings
from halpipe.models import Binding
from halpipe.pipeline import checked
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.solve import groups
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.schedule import SearchOptions, _common_units, schedule_model
from halpipe.pipeline.transitions.change import Pace
from halpipe.pipeline.verify import reading
from halpipe.pipeline.verify.jobs import check_complete
from support import access, after, mode, model, ms, task, version

FEW, MANY = 50, 400


def bound(count):
    """Tasks that keep to the one unit that they name, two on each."""
    names = [f"u{number // 2}" for number in range(count)]
    parts = [task(f"t{number}", 100, version("v", "1us", unit)) for number, unit in enumerate(names)]
    return model(*(replace(each, binding=Binding.SYSTEM) for each in parts), units=" ".join(dict.fromkeys(names)))


def measured(count):
    """Measure the cost of a schedule of bound tasks."""
    system = bound(count)
    found = schedule_model(system, SearchOptions(), lambda *_: True).schedule.modes[0]
    return lambda: mode_report(system, expand(system, system.modes[0]), found.jobs, found.status)


def narrowed(count):
    """Take a model of many units apart into its independent groups."""
    system = bound(count)
    found = groups.independent_groups(system, expand(system, system.modes[0]))
    assert len(found) == count // 2
    return lambda: groups._narrowed(system, found)


def claimed(count):
    """Turn a version with many access phases into rectangles."""
    phases = [access("bus", ms(k), ms(k) + ms("0.5ms"), "1/2") for k in range(count)]
    system = model(task("t", 1000, version("v", 500, "u1", *phases)), resources="bus")
    return lambda: build_problem(expand(system, system.modes[0]), system.units, ["bus"])


def demanded(count):
    """Verify a schedule of many tasks on demand that one version names."""
    names = [f"t{number}" for number in range(count)]
    rows = [after(name, 0, 1000) for name in names]
    served = [task(name, None, version("v", "1us")) for name in names]
    system = model(*served, task("all", 1000, version("v", "1us", "u1", *rows)))
    found = schedule_model(system, SearchOptions(), lambda *_: True).schedule
    read, clock = Findings(), reading.make_clock(system, found)
    modes = reading.active_modes(system, clock, read)
    [table] = reading.mode_tables(system, found, modes, clock, read).values()
    return lambda: list(check_complete(table))


def pinned(count):
    """Find the units of bound tasks that serve in every mode."""
    system = bound(count)
    return lambda: _common_units(system, 0)


@pytest.mark.parametrize("prepare", [measured, narrowed, claimed, demanded, pinned])
def test_calls_grow_with_the_model_and_not_with_its_square(prepare):
    assert calls(prepare(MANY)) / calls(prepare(FEW)) < half_way(MANY / FEW)


def test_lengths_of_a_table_are_judged_by_the_kinds_of_tasks(monkeypatch):
    """Tasks with the same distances of their starts rule out the same lengths."""
    tasks = [task(f"t{n}", 10, version("v", "1us", f"u{n}")) for n in range(20)]
    system = model(*tasks, units=" ".join(f"u{n}" for n in range(20)), modes=[mode("a", tasks), mode("b", tasks)])
    asked, can_be_kept = [], Pace.can_be_kept
    monkeypatch.setattr(Pace, "can_be_kept", lambda *pace: asked.append(pace) or can_be_kept(*pace))
    assert len(checked.schedule_model(system, SearchOptions(), lambda *_: True).schedule.transitions) == 2
    assert 0 < len(asked) < len(tasks) * len({length for _, length in asked})
