"""Loads of units and resources, and the order of a report."""

from fractions import Fraction

from placed_cases import place, roborace, roborace_jobs

from halpipe.models import ResourceLoad, Status, UnitLoad
from halpipe.pipeline.measure.cost import mode_report
from support import access, job, model, ms, task, version


def report(system, *jobs, status=Status.VALID):
    return mode_report(system, place(system).expansion, jobs, status)


def test_the_papers_stack():
    system = roborace()
    found = report(system, *roborace_jobs(system))
    assert [load.share for load in found.unit_loads] == [
        Fraction(24, 25),
        Fraction(13, 25),
        Fraction(24, 25),
        Fraction(2, 25),
    ]
    assert found.resource_loads == (ResourceLoad(resource="memory", peak=Fraction(1), mean=Fraction(3, 25)),)
    assert found.chains[0].reaction == ms(88)
    assert found.cost.total == -Fraction(1, 2)
    assert (found.name, found.hyperperiod, found.status) == ("all", ms(25), Status.VALID)


def test_jobs_are_listed_by_start_task_and_index():
    system = model(task("b", 10, version("v", 1, "u1 u2")), task("a", 5, version("v", 1, "u1 u2")), units="u1 u2")
    jobs = [job(system, "b", 0, 2, "u2"), job(system, "a", 1, 7, "u1"), job(system, "a", 0, 2, "u1")]
    assert [(j.task, j.index) for j in report(system, *jobs).jobs] == [("a", 0), ("b", 0), ("a", 1)]


def test_all_units_and_resources_are_listed_busy_or_not():
    system = model(task("a", 10, version("v", 3, "u1 u2", gang=2)), units="idle u2 u1", resources="r")
    found = report(system, job(system, "a", 0, 9, "u1 u2"))
    half = UnitLoad(unit="u2", busy=ms(3), share=Fraction(3, 10))
    assert found.unit_loads == (
        UnitLoad(unit="idle", busy=ms(0), share=Fraction(0)),
        half,
        UnitLoad(unit="u1", busy=ms(3), share=Fraction(3, 10)),
    )
    assert found.resource_loads == (ResourceLoad(resource="r", peak=Fraction(0), mean=Fraction(0)),)


def test_resource_loads_add_up_round_the_end_of_the_hyperperiod():
    system = model(
        task("a", 10, version("v", 4, "u1", access("r", 0, 4, "1/2"))),
        task("b", 10, version("v", 4, "u2", access("r", 1, 3, "1/3"))),
        units="u1 u2",
        resources="r",
    )
    found = report(system, job(system, "a", 0, 8, "u1"), job(system, "b", 0, 0, "u2"))
    assert found.resource_loads == (
        ResourceLoad(resource="r", peak=Fraction(5, 6), mean=Fraction(2 * 3 + 2 * 2, 6 * 5 * 2) + Fraction(1, 10)),
    )
