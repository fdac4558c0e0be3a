"""Histograms of a recording: exact counts, by figures that are worked out by hand."""

from halpipe.core.durations import Duration
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from halpipe.pipeline.compare.histograms import histograms
from support import job, model, ms, schedule, task, version

LATE = (0, 1, 1, 16, 3)


def measured(offset):
    """Five jobs of a task, released at 2 ms and scheduled at 5 ms of every 10 ms, that start late by `LATE` us."""
    system = model(task("a", 10, version("v", 3), offset=offset))
    planned = schedule(system, 10, job(system, "a", 0, 5, "u1"))
    seen = []
    for cycle, late in enumerate(LATE):
        start = ms(10 * cycle + 5) + Duration(late * 1000)
        seen.append(Execution(task="a", units=("u1",), start=start, end=start + ms(2)))
    trace = Trace(name="", executions=tuple(seen))
    found = histograms(compare(planned, trace, CompareOptions(origin=Duration(0)), system), system)
    return {h.figure: (str(h.least), str(h.worst), str(h.width), h.counts) for h in found}


def test_each_figure_has_exact_counts():
    found = measured(2)
    assert found["start error"] == ("0ms", "16us", "2us", (3, 1, 0, 0, 0, 0, 0, 1))
    assert found["response"] == ("5ms", "5.016ms", "2us", (3, 1, 0, 0, 0, 0, 0, 1))
    assert found["execution"] == ("2ms", "2ms", "1ns", (5, 0, 0, 0, 0, 0, 0, 0))
    assert found["jitter"] == ("-13us", "15us", "3.5us", (1, 0, 0, 1, 1, 0, 0, 1))


def test_a_response_is_counted_from_the_release_of_each_of_three_jobs():
    """Scheduled 1, 2 and 4 ms after their releases, at 7, 17 and 27 ms; the last is over in the next table."""
    system = model(task("a", 10, version("v", 3), offset=7), task("b", 30, version("v", 1)))
    jobs = [job(system, "a", k, 8 + 11 * k + (k == 2), "u1") for k in range(3)]
    planned = schedule(system, 30, *jobs, job(system, "b", 0, 0, "u1"))
    seen = tuple(
        Execution(task=j.task, units=("u1",), start=j.start + ms(30 * n), end=j.start + ms(30 * n) + ms(1))
        for n in range(2)
        for j in sorted(planned.modes[0].jobs, key=lambda j: j.start)
    )
    answer = compare(planned, Trace(name="", executions=seen), CompareOptions(origin=Duration(0)), system)
    [found] = [h for h in histograms(answer, system) if (h.task, h.figure) == ("a", "response")]
    assert (str(found.least), str(found.worst), found.counts) == ("2ms", "5ms", (2, 0, 2, 0, 0, 0, 0, 2))


def test_a_response_needs_a_release():
    assert set(measured(None)) == {"start error", "execution", "jitter"}


def test_a_job_that_is_scheduled_at_its_release_responds_in_its_own_time():
    assert measured(5)["response"] == ("2ms", "2.016ms", "2us", (3, 1, 0, 0, 0, 0, 0, 1))
