"""Explanations with the grid of regulators (``--quantise``): the question that ``schedule --quantise`` asks."""

from dataclasses import replace

import pytest
from test_quantise import PLATFORM, platform, stack

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.flow.formats import burst_grid
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.explanation import ExplainOptions, Verdict, explain
from halpipe.pipeline.solve import codes as search_codes
from halpipe.pipeline.solve.schedule import SearchOptions
from support import access, model, ms, task, version


def crowded(folder):
    """Two tasks that fill memory exactly, a platform with no room to round up, and its grid."""
    first = task("first", 10, version("v", "4.6ms", "u1", access("mem", 0, "4.6ms", "0.55", "read")))
    second = task("second", 10, version("v", 10, "u2", access("mem", 0, 10, "0.45", "read")))
    tight = PLATFORM.replace("6.2MB/s", "6.4MB/s") + "overshoot: 64B\n"
    system = model(first, second, units="u1 u2", resources="mem")
    return system, burst_grid(platform(folder, tight))


def verdict(explanation):
    return explanation.verdicts[0][1]


def scheduled(system, grid):
    """Whether `schedule --quantise` finds one."""
    try:
        return schedule_model(system, SearchOptions(grid=grid), lambda *_: True).is_complete
    except HalpipeError:
        return False


def test_no_schedule_on_the_grid_is_proven_with_what_the_grid_does(tmp_path):
    system, grid = crowded(tmp_path)
    assert verdict(explain(system, ExplainOptions())) is Verdict.SCHEDULABLE
    found = explain(system, ExplainOptions(grid=grid, remedies=False))
    assert (verdict(found), found.exit) == (Verdict.INFEASIBLE, Exit.INFEASIBLE)
    assert found.diagnostics[0].code == search_codes.GRID_TIGHT.id
    assert len(found.diagnostics) > 1


def test_remedies_change_the_stated_model_and_help_on_the_grid(tmp_path):
    """Three jobs of 2.6 ms last 3 ms each on the grid, so that the third needs to be two windows shorter."""
    tasks = [task(name, 8, version("v", "2.6ms", "u1"), slack=1) for name in "abc"]
    system, grid = model(*tasks, units="u1", resources="mem"), burst_grid(platform(tmp_path))
    assert scheduled(system, None)
    assert not scheduled(system, grid)
    found = explain(system, ExplainOptions(grid=grid))
    texts = [each.message for each in found.diagnostics if each.code == codes.REMEDY.id]
    (text,) = (each for each in texts if each.startswith('WCET of "a"'))
    assert text.startswith('WCET of "a" at most 2ms instead of 2.6ms (found sufficient, in steps of 1ms')
    shorter = replace(system, tasks=(task("a", 8, version("v", 2, "u1"), slack=1), *tasks[1:]))
    assert scheduled(shorter, grid)


def test_the_placement_of_a_search_on_the_grid_is_explained_there(tmp_path):
    grid = burst_grid(platform(tmp_path))
    found = schedule_model(stack(), SearchOptions(grid=grid), lambda *_: True)
    given = ExplainOptions(grid=grid, schedule=found.schedule)
    assert {each for _, each in explain(stack(), given).verdicts} == {Verdict.SCHEDULABLE}
    table = found.schedule.modes[0]
    jobs = tuple(replace(job, start=table.jobs[0].start, end=table.jobs[0].end) for job in table.jobs)
    modes = (replace(table, jobs=jobs), *found.schedule.modes[1:])
    broken = ExplainOptions(grid=grid, schedule=replace(found.schedule, modes=modes), exact=False, remedies=False)
    assert verdict(explain(stack(), broken)) is Verdict.NOT_FOUND


def test_a_tick_off_the_grid_is_refused(tmp_path):
    options = ExplainOptions(grid=burst_grid(platform(tmp_path)), tick=ms("1.5ms"))
    with pytest.raises(HalpipeError) as refused:
        explain(stack(), options)
    assert [each.code for each in refused.value.diagnostics] == [search_codes.GRID_TICK.id]
