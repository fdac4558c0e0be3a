"""The report on paper: what is folded on the screen is there, and folded again afterwards."""

import base64
import re

import pytest

from halpipe.exporters.report import FORMAT, ReportOptions
from halpipe.pipeline.generate import SetParameters, generate_with_witness

pytestmark = pytest.mark.slow  # a browser starts

UNFOLDED = "return [...document.querySelectorAll('details')].filter(box => box.open).length"
ROWS = "return [...document.querySelectorAll('tbody tr')].filter(row => row.checkVisibility()).length"
WATCH = "addEventListener('beforeprint', () => {%s})"


def printed(browser, page):
    """Print a page; return how many sheets it takes, and how many rows were on them."""
    browser.get(page.as_uri())
    before = browser.execute_script(UNFOLDED)
    browser.execute_script(WATCH % ("window.rows = (() => {" + ROWS + "})()"))
    sheets = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {})["data"])
    assert browser.execute_script(UNFOLDED) == before
    return len(re.findall(rb"/Type\s*/Page\b", sheets)), browser.execute_script("return window.rows")


@pytest.mark.parametrize("tasks", [60, 1000])  # a table in the page, and one whose rows are made as they are looked at
def test_all_jobs_are_printed(browser, tmp_path, tasks):
    model, schedule = generate_with_witness(SetParameters(tasks=tasks, units=tasks // 10), 5)
    page = tmp_path / "report.html"
    (content,) = FORMAT.write(model, schedule, ReportOptions()).values()
    page.write_bytes(content)
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    sheets, rows = printed(browser, page)
    assert rows >= jobs
    assert sheets >= jobs // 60  # no more of them fit on one
