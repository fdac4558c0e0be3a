"""How long a person waits in the workbench and in a large report, in a real browser.

Usage: python benchmarks/workbench.py [--edits 20] [--tasks 60 500] [--loads 9]. Chromium opens the page of `halpipe
serve` for a drawn model; WCETs of tasks in turn grow by 1 %, and the clock of the page runs from the order until the
frame after the chart was painted. Then each edit is undone. Thereafter it opens the report of 8001 jobs so many times,
each time until the frame after the chart was painted, and pans through it, a step in every frame. Needs chromium and
its driver, and the extra [serve].
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver

EDIT = """
const [task, wcet, done] = arguments, began = performance.now();
const version = state.tasks.find(each => each.name === task).versions[0].name;
order("edit", {kind: "version", name: task, inner: version, field: "wcet", value: wcet}).then(told =>
  requestAnimationFrame(() => requestAnimationFrame(() => done([performance.now() - began, told.valid,
    told.answered.stayed, told.answered.jobs]))));
"""
UNDO = "const done = arguments[0]; order('undo').then(() => done(0));"
WAIT = "const done = arguments[0]; (function look() { state && state.valid ? done(0) : setTimeout(look, 50); })();"
SEEN = """
const done = arguments[0], end = () => done(performance.now());
const painted = () => requestAnimationFrame(() => requestAnimationFrame(end));
document.readyState === "complete" ? painted() : addEventListener("load", painted);
"""
PAN = """
const [share, done] = arguments, viewer = viewers.values().next().value, spans = [], paints = [];
viewer.zoom(share, viewer.mode.length / 2);
let last = performance.now(), step = (viewer.to - viewer.from) / 100;
requestAnimationFrame(function frame(now) {
  spans.push(now - last); last = now;
  if (viewer.to >= viewer.mode.length) step = -Math.abs(step);
  if (viewer.from <= 0) step = Math.abs(step);
  viewer.pan(step);
  const began = performance.now(); viewer.paint(); paints.push(performance.now() - began);
  spans.length < 200 ? requestAnimationFrame(frame) : done([spans.slice(1), paints]);
});
"""
REPORT = "--units 4 --unit-types 1 --resources 1 --utilisation 0.5 --period 1s" + 8 * " --period 1ms"
HEAD = "| tasks | jobs | edits with a schedule | edit to drawn, median | worst | jobs that stay, least |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--edits", type=int, default=20)
    options.add_argument("--tasks", type=int, nargs="+", default=[60, 500])
    options.add_argument("--loads", type=int, default=9)
    options.add_argument("--seed", type=int, default=101)
    stated = options.parse_args()
    print(HEAD + "\n" + "|---:" * 6 + "|")
    for tasks in stated.tasks:
        with tempfile.TemporaryDirectory() as folder:
            print(row(tasks, stated.edits, stated.seed, Path(folder)), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        report(stated.loads, stated.seed, Path(folder))


def row(tasks: int, edits: int, seed: int, folder: Path) -> str:
    """Return the line of the table for a model of so many tasks."""
    size = ["--tasks", str(tasks), "--units", str(tasks // 10), "--access-windows", "20", "--utilisation", "0.4"]
    command = [sys.executable, "-m", "halpipe"]
    model = folder / "model.xml"
    subprocess.run([*command, "generate", *size, "--seed", str(seed), "-o", model, "-q"], check=True)
    with subprocess.Popen([*command, "serve", model], stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            return measured(server.stdout.readline().strip(), edits)
        finally:
            server.terminate()


def report(loads: int, seed: int, folder: Path) -> None:
    """Print how fast the report of 8001 jobs loads and pans, and how many elements it has."""
    command = [sys.executable, "-m", "halpipe"]
    model, schedule, page = folder / "model.xml", folder / "schedule.xml", folder / "report.html"
    subprocess.run([*command, "generate", *REPORT.split(), "--seed", str(seed), "-o", model, "-q"], check=True)
    subprocess.run([*command, "schedule", model, "-o", schedule, "-q"], check=True)
    subprocess.run([*command, "export", "report", model, schedule, "-o", page, "-q"], check=True)
    browser = chromium()
    try:
        seen = []
        for _ in range(loads):
            browser.get(page.as_uri())
            seen.append(browser.execute_async_script(SEEN))
        nodes = browser.execute_script("return document.getElementsByTagName('*').length")
        print(f"report of 8001 jobs, {page.stat().st_size} bytes, {nodes} elements: ", end="")
        print(f"drawn after {statistics.median(seen):.0f} ms (median of {loads}, worst {max(seen):.0f} ms)")
        for share in (1.0, 0.1, 0.01):
            frames, paints = browser.execute_async_script(PAN, share)
            shown = f"{1000 / statistics.mean(frames):.0f} frames per second, the longest {max(frames):.0f} ms"
            print(f"pan, {share:.0%} of the hyperperiod in sight: {shown}; painting {statistics.median(paints):.1f} ms")
            browser.refresh()
    finally:
        browser.quit()


def measured(address: str, edits: int) -> str:
    """Make the edits one after the other in a browser at an address."""
    browser = chromium()
    try:
        browser.get(address)
        browser.execute_async_script(WAIT)
        tasks = browser.execute_script("return state.tasks.map(task => [task.name, task.versions[0].wcet])")
        times, stays, jobs = [], [], 0
        for name, wcet in (tasks[number % len(tasks)] for number in range(edits)):
            spent, valid, stayed, jobs_now = browser.execute_async_script(EDIT, name, grown(wcet))
            if valid:
                times.append(spent)
                stays.append(stayed / jobs_now)
                jobs = jobs_now
            browser.execute_async_script(UNDO)
    finally:
        browser.quit()
    if not times:
        return f"| {len(tasks)} | | 0 of {edits} | | | |"
    median, worst = statistics.median(times), max(times)
    return f"| {len(tasks)} | {jobs} | {len(times)} of {edits} | {median:.0f} ms | {worst:.0f} ms | {min(stays):.1%} |"


def chromium() -> WebDriver:
    """Return a browser without a screen."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"):
        options.add_argument(word)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver") or ""))
    browser.set_script_timeout(600)
    return browser


def grown(wcet: str) -> str:
    """Return a WCET that is 1 % longer."""
    from halpipe.core.durations import Duration

    return str(Duration.parse(wcet) * 101 / 100)


if __name__ == "__main__":
    main()
