"""How long a person waits in the workbench: from an edit to the schedule that is verified and drawn, in a real browser.

Usage: python benchmarks/workbench.py [--edits 20] [--tasks 60 500]. Chromium opens the page of `halpipe serve` for a
drawn model; WCETs of tasks in turn grow by 1 %, and the clock of the page runs from the order until the frame after the
chart was painted. Then each edit is undone. Needs chromium and its driver, and the extra [serve].
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

EDIT = """
const [task, wcet, done] = arguments, began = performance.now();
const version = state.tasks.find(each => each.name === task).versions[0].name;
order("edit", {kind: "version", name: task, inner: version, field: "wcet", value: wcet}).then(told =>
  requestAnimationFrame(() => requestAnimationFrame(() => done([performance.now() - began, told.valid,
    told.answered.stayed, told.answered.jobs]))));
"""
UNDO = "const done = arguments[0]; order('undo').then(() => done(0));"
WAIT = "const done = arguments[0]; (function look() { state && state.valid ? done(0) : setTimeout(look, 50); })();"
HEAD = "| tasks | jobs | edits with a schedule | edit to drawn, median | worst | jobs that stay, least |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--edits", type=int, default=20)
    options.add_argument("--tasks", type=int, nargs="+", default=[60, 500])
    options.add_argument("--seed", type=int, default=101)
    stated = options.parse_args()
    print(HEAD + "\n" + "|---:" * 6 + "|")
    for tasks in stated.tasks:
        with tempfile.TemporaryDirectory() as folder:
            print(row(tasks, stated.edits, stated.seed, Path(folder)), flush=True)


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


def measured(address: str, edits: int) -> str:
    """Make the edits one after the other in a browser at an address."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"):
        options.add_argument(word)
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver") or ""))
    try:
        browser.set_script_timeout(600)
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


def grown(wcet: str) -> str:
    """Return a WCET that is 1 % longer."""
    from halpipe.durations import Duration

    return str(Duration.parse(wcet) * 101 / 100)


if __name__ == "__main__":
    main()
