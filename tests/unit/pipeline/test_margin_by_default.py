"""The margin of schedules for which no objective is stated: raised with little effort, stated, and switchable."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.options import from_keywords
from halpipe.exporters.native import format_schedule
from halpipe.importers.native import parse_schedule
from halpipe.models import Split
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.solve.schedule import SPARE, SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.verify import verify
from support import model, task, version


def found(owner, **options):
    scheduled = schedule_model(owner, SearchOptions(**options), lambda *_: True)
    assert scheduled.is_complete
    assert [d for d in verify(owner, scheduled.schedule) if d.is_error] == []
    return scheduled


def margins(owner, **options):
    return [mode.margin for mode in found(owner, **options).schedule.modes]


DENSE = generate(SetParameters(tasks=30, units=4), 3)


@pytest.mark.parametrize("options", [{}, {"seed": 7}, {"tick": None, "budget": 400}])
def test_a_schedule_has_a_margin_that_the_first_one_does_not_have(options):
    assert margins(DENSE, optimise=(), **options) == [0]
    assert min(margins(DENSE, **options)) >= Fraction(1, 4)


def test_the_effort_is_a_number_of_moves():
    first, wider = found(DENSE, optimise=()), found(DENSE)
    jobs = len(first.schedule.modes[0].jobs)
    assert first.moves < wider.moves <= first.moves + SPARE * len(DENSE.tasks) // jobs


def test_no_shorter_version_is_chosen_for_a_margin():
    owner = model(task("a", 10, version("long", 8), version("short", 1)), task("b", 10, version("v", 1)))

    def chosen(**options):
        return [{job.version for job in found(owner, seed=n, **options).schedule.modes[0].jobs} for n in range(1, 9)]

    first = chosen(optimise=())
    assert {"long", "v"} in first
    assert chosen() == first


def test_what_is_proven_best_costs_nothing():
    """Two jobs that fill their unit cannot grow: the bound is 0, and nothing is searched for."""
    owner = model(task("a", 10, version("v", 4)), task("b", 10, version("v", 6)))
    scheduled = found(owner)
    (mode,) = scheduled.schedule.modes
    assert (mode.margin, mode.margin_bound, mode.margin_words) == (0, 0, "0 %, the best possible")
    assert scheduled.moves == found(owner, optimise=()).moves


def test_the_words_name_the_bound():
    owner = model(task("a", 10, version("v", 4)), task("b", 20, version("v", 3)), task("c", 20, version("v", 3)))
    (mode,) = found(owner).schedule.modes
    assert mode.margin < mode.margin_bound == Fraction(3, 7)
    assert mode.margin_words == f"{float(int(mode.margin * 1000) / 10):g} %, at most 42.8 % is possible"


def test_the_words_state_that_the_margin_of_preempted_jobs_was_not_raised():
    parts = replace(version("v", 12), split=Split(anywhere=True, max_gaps=8))
    owner = model(task("a", 20, parts), task("b", 5, version("v", 1)))
    (mode,) = found(owner).schedule.modes
    assert any(job.parts for job in mode.jobs)
    assert mode.margin < mode.margin_bound
    assert mode.margin_words.endswith("is possible; not raised between the segments of preempted jobs")


def test_the_number_of_workers_changes_no_byte():
    one, two, eight = (format_schedule(found(DENSE, workers=Workers(count)).schedule) for count in (1, 2, 8))
    assert one == two == eight
    assert parse_schedule(one, "again.xml") == found(DENSE).schedule


def test_jobs_that_have_shipped_stay():
    first = found(DENSE, optimise=()).schedule
    (mode,) = first.modes
    kept = {job for job in mode.jobs if job.task in [each.name for each in DENSE.tasks[:3]]}
    shipped = replace(first, modes=(replace(mode, jobs=tuple(kept)),))
    assert kept <= set(found(DENSE, shipped=shipped).schedule.modes[0].jobs)


def test_no_job_moves_for_a_margin_beside_an_earlier_schedule():
    first = found(DENSE, optimise=()).schedule
    assert found(DENSE, near=first).schedule.modes[0].jobs == first.modes[0].jobs


@pytest.mark.parametrize("stated", ["none", ["none"], []])
def test_no_effort_can_be_asked_for(stated):
    assert from_keywords("schedule", SearchOptions, {"optimise": stated}) == {"optimise": ()}


def test_none_stands_alone():
    with pytest.raises(HalpipeError, match="'none' is not known"):
        from_keywords("schedule", SearchOptions, {"optimise": "none,chains"})


def test_a_search_that_is_stopped_keeps_what_was_found():
    """The first report of a cost of 0 comes while the margin is raised."""
    scheduled = schedule_model(DENSE, SearchOptions(), lambda mode, made, most, cost: cost != 0)
    assert scheduled.is_complete
    assert scheduled.unimproved
    assert [d for d in verify(DENSE, scheduled.schedule) if d.is_error] == []
