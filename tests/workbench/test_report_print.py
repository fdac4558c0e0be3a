"""The report on paper: short tables are unfolded, long ones are counted or printed where the reader unfolds them."""

import base64
import re
from dataclasses import replace

import pytest

from halpipe.exporters.report import FORMAT, ReportOptions
from halpipe.pipeline.generate import SetParameters, generate_with_witness

pytestmark = pytest.mark.slow  # a browser starts

UNFOLDED = "return [...document.querySelectorAll('details')].filter(box => box.open).length"
ROWS = "return [...document.querySelectorAll('tbody tr')].filter(row => row.checkVisibility()).length"
WATCH = "addEventListener('beforeprint', () => {%s})"
JOBS = (
    "for (const box of document.querySelectorAll('details')) if (box.textContent.includes('Version')) box.open = true"
)


def printed(browser, page, *, unfold=""):
    """Print a page; return how many sheets it takes, and how many rows were on them."""
    browser.get(page.as_uri())
    browser.execute_script(unfold)
    before = browser.execute_script(UNFOLDED)
    browser.execute_script(WATCH % ("window.rows = (() => {" + ROWS + "})()"))
    sheets = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    assert browser.execute_script(UNFOLDED) == before
    return len(re.findall(rb"/Type\s*/Page\b", sheets)), browser.execute_script("return window.rows")


def written(folder, model, schedule):
    page = folder / "report.html"
    (content,) = FORMAT.write(model, schedule, ReportOptions()).values()
    page.write_bytes(content)
    return page


def three_modes(jobs=1680, tasks=35, units=6):
    """A schedule of so many jobs in three modes."""
    model, schedule = generate_with_witness(SetParameters(tasks=tasks, units=units), 5)
    (mode,) = schedule.modes
    copies = -(-jobs // (3 * len(mode.jobs)))
    tables = []
    for name in ("drive", "charge", "limp"):
        jobs = tuple(
            replace(job, index=copy * 1000 + job.index, start=job.start + shift, end=job.end + shift)
            for copy in range(copies)
            for shift in [mode.hyperperiod * copy]
            for job in mode.jobs
        )
        tables.append(replace(mode, name=name, hyperperiod=mode.hyperperiod * copies, jobs=jobs))
    modes = tuple(replace(model.modes[0], name=table.name) for table in tables)
    return replace(model, modes=modes), replace(schedule, modes=tuple(tables), transitions=())


def test_a_report_of_many_jobs_takes_few_sheets(browser, tmp_path):
    model, schedule = three_modes()
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    assert jobs >= 1680
    page = written(tmp_path, model, schedule)
    sheets, rows = printed(browser, page)
    assert sheets <= 10
    assert 3 * len(model.tasks) <= rows < jobs  # tasks, but no jobs
    heads = browser.execute_script("return [...document.querySelectorAll('summary')].map(head => head.textContent)")
    assert f"Jobs by start: {len(schedule.modes[0].jobs)}" in heads
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    after = "return getComputedStyle([...document.querySelectorAll('summary')].at(-1), '::after').content"
    assert "not printed" in browser.execute_script(after)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


@pytest.mark.parametrize(("jobs", "tasks", "units"), [(10_000, 35, 6), (10_000, 500, 40), (1400, 450, 10)])
def test_ten_thousand_jobs_take_at_most_ten_sheets(browser, tmp_path, jobs, tasks, units):
    model, schedule = three_modes(jobs, tasks, units)
    assert sum(len(mode.jobs) for mode in schedule.modes) >= jobs
    page = written(tmp_path, model, schedule)
    assert printed(browser, page)[0] <= 10
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.get(page.as_uri())
        sheets = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})["data"])
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert len(re.findall(rb"/Type\s*/Page\b", sheets)) <= 10


def test_short_tables_are_printed(browser, tmp_path):
    model, schedule = generate_with_witness(SetParameters(tasks=20, units=2), 5)
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    assert 12 < jobs <= 50
    assert printed(browser, written(tmp_path, model, schedule))[1] >= jobs + len(model.tasks)


@pytest.mark.parametrize("tasks", [60, 1000])  # a table in the page, and one whose rows are made as they are looked at
def test_all_jobs_are_printed_where_they_are_unfolded(browser, tmp_path, tasks):
    model, schedule = generate_with_witness(SetParameters(tasks=tasks, units=tasks // 10), 5)
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    sheets, rows = printed(browser, written(tmp_path, model, schedule), unfold=JOBS)
    assert rows >= jobs
    assert sheets >= jobs // 60  # no more of them fit on one
