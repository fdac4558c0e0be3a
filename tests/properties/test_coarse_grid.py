"""A mode on a coarser grid: easier keeps every schedule, harder invents none, and both say which grid it was."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration, milliseconds
from halpipe.models import Status
from halpipe.pipeline.explain import codes, conflict
from halpipe.pipeline.explain.conflict import as_stated, coarser_grid, easier, find_conflict, harder
from halpipe.pipeline.explain.explanation import ExplainOptions, Verdict, explain
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.solve.codes import TOO_LARGE
from halpipe.pipeline.solve.exact import Answer
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify
from profiles import examples
from support import model, task, version

SEEDS = st.integers(0, 2**32)
GRIDS = st.sampled_from([milliseconds(2), milliseconds(1), milliseconds(Fraction(3, 2))])


def on_grid(system, grid):
    """Tell whether the periods of a model are multiples of a grid, and its WCETs not below it."""
    periods = [t.period for t in system.tasks if t.period is not None]
    return not any(period % grid for period in periods) and all(
        v.wcet >= grid for t in system.tasks for v in t.versions
    )


@examples(150)
@given(SEEDS, GRIDS)
def test_starts_rounded_down_are_valid_where_all_is_easier(seed, grid):
    """The very argument of the proof, for a schedule that is valid by construction; the reference cost judges it."""
    system, plan = systems.valid_system(random.Random(seed))
    assume(on_grid(system, grid))
    loose = easier(system, grid)
    expansion = expand(loose, loose.modes[0])
    wcets = {(t.name, v.name): v.wcet for t in loose.tasks for v in t.versions}
    jobs = []
    for job in plan.modes[0].jobs:
        start = grid * (job.start // grid)
        jobs.append(replace(job, start=start, end=start + wcets[job.task, job.version]))
    report = mode_report(loose, expansion, jobs, Status.VALID)
    assert report.cost.total <= 0, (report.cost, grid)


@examples(100)
@given(SEEDS, GRIDS)
def test_what_is_found_where_all_is_harder_is_valid_as_stated(seed, grid):
    system, _ = systems.valid_system(random.Random(seed))
    assume(on_grid(system, grid))
    tight = harder(system, grid)
    assume(tight is not None and not any(d.is_error for d in validate(tight)))
    plan = schedule_model(tight, SearchOptions(budget=100), lambda *_: True).schedule
    assume(all(mode.status is Status.VALID for mode in plan.modes))
    (found,) = plan.modes
    stated = replace(found, jobs=as_stated(system, found.jobs), cost=None, chains=(), unit_loads=(), resource_loads=())
    schedule = replace(plan, modes=(stated,), model=system.name, model_sha256=system.digest)
    assert [d.message for d in verify(system, schedule) if d.is_error] == []


def fine(last):
    """Three units and six tasks of some 4 ms in single nanoseconds, which the exact engine is told not to count in."""
    lengths = [*["4000003ns"] * 5, last]
    return model(*(task(f"t{n}", "10ms", version("v", c, "u1 u2 u3")) for n, c in enumerate(lengths)), units="u1 u2 u3")


@pytest.mark.parametrize(("last", "verdict"), [("7000001ns", Verdict.INFEASIBLE), ("3999999ns", Verdict.SCHEDULABLE)])
def test_a_mode_too_fine_for_the_exact_engine_is_answered_on_a_coarser_grid(monkeypatch, last, verdict):
    pytest.importorskip("ortools")
    from halpipe.pipeline.solve import exact

    monkeypatch.setattr(exact, "MAX_TICKS", 2**16)
    monkeypatch.setattr(conflict, "TICKS", 2**14)
    system = fine(last)
    explanation = explain(system, ExplainOptions(remedies=False), budget=1)
    if verdict is Verdict.SCHEDULABLE:  # the search finds it at once, the engine is asked apart
        found = find_conflict(system, system.modes[0], lambda: True)
        assert found.answer is Answer.FEASIBLE
        assert found.grid == coarser_grid(expand(system, system.modes[0])) == Duration("1us")
    else:
        assert [v for _, v in explanation.verdicts] == [verdict]
        (note,) = (d for d in explanation.diagnostics if d.code == codes.COARSE_GRID.id)
        assert "rounded to 1us, so that it can only be easier" in note.message


def test_numbers_too_large_for_the_search_are_no_refusal():
    """Thirds and sevenths of 6 digits: the search alone refuses them."""
    parts = [Fraction(10**14, 3**12), Fraction(10**14, 7**8)]
    system = model(*(task(f"t{n}", 1000, version("v", Duration(wcet))) for n, wcet in enumerate(parts)))
    with pytest.raises(HalpipeError) as refused:
        schedule_model(system, SearchOptions(budget=10), lambda *_: True)
    assert [found.code for found in refused.value.diagnostics] == [TOO_LARGE.id]
    assert explain(system, ExplainOptions(remedies=False, exact=False)).verdicts == (("all", Verdict.SCHEDULABLE),)
