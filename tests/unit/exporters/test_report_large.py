"""Data of reports: all jobs, few elements, figures of tasks, and what resources bear."""

import json
import re
from dataclasses import replace

import pytest

import halpipe
from halpipe.exporters.report import ReportOptions
from halpipe.exporters.report.page import format_page
from halpipe.exporters.report.scene import embedded, figures, scene
from halpipe.importers.native import parse_model
from halpipe.starters import first_model
from support import job, mode, model, ms, schedule, task, version


def system(count):
    tasks = [task(f"t{n}", "20ms", version("v", "1us")) for n in range(count)]
    return model(*tasks, modes=[mode("m", tasks)])


def data(page):
    return json.loads(re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)[1])


def test_a_report_has_every_job_as_data_and_few_elements():
    made = system(40)
    jobs = [job(made, f"t{n % 40}", n // 40, f"{2 * n}us", "u1") for n in range(2000)]
    page = format_page(made, schedule(made, "20ms", *jobs, mode_name="m"), ReportOptions())
    assert len(data(page)["modes"][0]["jobs"]) == 2000
    markup = re.sub(r"<script.*?</script>|<noscript>.*?</noscript>", "", page, flags=re.DOTALL)
    assert len(re.findall(r"<[a-z]", markup)) < 1000


def unscripted(page):
    """Rows of jobs of each chart, and the rest of its text, as a reader without scripts sees them."""
    found = []
    for part in re.findall(r"<noscript>(.*?)</noscript>", page, re.DOTALL):
        rows = re.findall(r"<tr>(<td>.*?)</tr>", part)
        found.append(([re.findall(r"<td>(.*?)</td>", row) for row in rows], part))
    return found


def test_without_scripts_the_first_jobs_are_listed_by_start_and_the_rest_is_counted():
    made = system(40)
    jobs = [job(made, f"t{n % 40}", n // 40, f"{2 * n}us", "u1") for n in range(2000)]
    plain = schedule(made, "20ms", *reversed(jobs), mode_name="m")
    ((rows, text),) = unscripted(format_page(made, plain, ReportOptions()))
    assert rows[0] == ["t0", "0", "0ms", "1us", "v", "u1", ""]
    assert [row[2] for row in rows] == [f"{2 * n}us" if n else "0ms" for n in range(100)]
    assert "1900 more" in text
    assert "show SCHEDULE --format csv" in text


def test_without_scripts_a_short_table_is_whole():
    made = system(3)
    jobs = [job(made, f"t{n}", 0, f"{2 * n}us", "u1") for n in range(3)]
    ((rows, text),) = unscripted(format_page(made, schedule(made, "20ms", *jobs, mode_name="m"), ReportOptions()))
    assert [row[0] for row in rows] == ["t0", "t1", "t2"]
    assert "left out" not in text


def test_tables_share_what_is_listed_without_scripts():
    tasks = [task(f"t{n}", "20ms", version("v", "1us")) for n in range(60)]
    made = model(*tasks, modes=[mode("one", tasks), mode("two", tasks)])
    jobs = [job(made, f"t{n}", 0, f"{2 * n}us", "u1") for n in range(60)]
    first = schedule(made, "20ms", *jobs, mode_name="one")
    second = schedule(made, "20ms", *jobs, mode_name="two")
    page = format_page(made, replace(first, modes=first.modes + second.modes), ReportOptions())
    assert [len(rows) for rows, _ in unscripted(page)] == [50, 50]


def test_names_cannot_leave_the_data():
    assert embedded({"a": "</script><script>alert(1)</script>&"}) == (
        '{"a":"\\u003c/script\\u003e\\u003cscript\\u003ealert(1)\\u003c/script\\u003e\\u0026"}'
    )


def figures_of(starts, offset=None):
    made = task("a", "10ms", version("v", "2ms"), slack=1, offset=offset)
    owner = model(made, modes=[mode("m", [made])])
    jobs = [job(owner, "a", index, start, "u1") for index, start in enumerate(starts)]
    return figures(made, jobs, ms("20ms"))


@pytest.mark.parametrize(
    ("starts", "offset", "response", "jitter"),
    [
        (("0ms", "10ms"), None, "2ms", "0ms"),
        (("1ms", "14ms"), None, "5ms", "3ms"),
        (("1ms", "14ms"), "0ms", "6ms", "3ms"),
        (("9ms", "1ms"), "9ms", "4ms", "2ms"),  # the second goes on at the beginning of the cycle
        (("9ms", "1ms"), None, "4ms", "2ms"),
    ],
)
def test_response_and_jitter_count_from_the_release(starts, offset, response, jitter):
    found = figures_of(starts, offset)
    assert (found["response"], found["jitter"]) == (response, jitter)


@pytest.mark.parametrize(("deadline", "margin"), [(None, "5ms"), ("6ms", "1ms"), ("4ms", "-1ms")])
def test_the_margin_is_what_is_left_of_the_deadline(deadline, margin):
    made = task("a", "10ms", version("v", "2ms"), slack=1, deadline=deadline)
    owner = model(made, modes=[mode("m", [made])])
    jobs = [job(owner, "a", index, start, "u1") for index, start in enumerate(("1ms", "14ms"))]
    assert figures(made, jobs, ms("20ms"))["margin"] == margin


@pytest.mark.parametrize(("starts", "response", "margin"), [((1, 14), "15ms", "15ms"), ((1, 4), "19ms", "11ms")])
def test_a_task_that_polls_responds_to_arrivals(starts, response, margin):
    """One that comes just after the start at 1 ms waits for the job at 14 ms; after 4 ms for that of the next cycle."""
    made = replace(task("a", "10ms", version("v", "2ms"), slack=1), distance=ms("30ms"))
    owner = model(made, modes=[mode("m", [made])])
    jobs = [job(owner, "a", index, start, "u1") for index, start in enumerate(starts)]
    found = figures(made, jobs, ms("20ms"))
    assert (found["response"], found["margin"]) == (response, margin)


@pytest.mark.parametrize(("offset", "drawn"), [(12, [2, 10, 5]), (None, [])])
def test_logical_execution_times_are_drawn_from_the_release(offset, drawn):
    made = replace(task("a", 10, version("v", 1), offset=offset), let=ms(5))
    assert [each["let"] for each in scene(model(made, task("b", 10, version("v", 1))), None)["tasks"]] == [drawn, []]


def test_a_scene_without_a_schedule_has_the_model():
    drawn = scene(system(2), None)
    assert (len(drawn["tasks"]), drawn["modes"]) == (2, [])


def test_meters_have_the_peaks_and_means_that_the_schedule_states():
    made = parse_model(first_model()["model.xml"], "model.xml")
    found = halpipe.schedule(made)
    for table, drawn in zip(found.modes, scene(made, found)["modes"], strict=True):
        for load in table.resource_loads:
            steps = next((m["steps"] for m in drawn["meters"] if m["name"] == load.resource), [[0, 0]])
            ends = [*(instant for instant, _ in steps[1:]), drawn["length"]]
            area = sum(level * (end - begin) for (begin, level), end in zip(steps, ends, strict=True))
            assert max(level for _, level in steps) == pytest.approx(float(load.peak))
            assert area / drawn["length"] == pytest.approx(float(load.mean))
    assert any(mode["meters"] for mode in scene(made, found)["modes"])


def test_a_schedule_of_another_state_of_the_model_has_no_meters():
    made = parse_model(first_model()["model.xml"], "model.xml")
    assert all(mode["meters"] == [] for mode in scene(made, halpipe.schedule(made), is_valid=False)["modes"])
