"""Times of the workbench and of a large report in a real browser.

Usage: python benchmarks/workbench.py [--edits 20] [--tasks 60 500] [--models FILE ...] [--loads 9]. Chromium opens the
page of `halpipe serve` for a drawn model, or for a file; WCETs of tasks in turn grow by 1 %, and then first jobs of
tasks in turn are dragged by 100 us. The clock of the page runs from the order until the frame after the chart was
painted, and then until the frame after the verified answer; of both, median and worst, and the processor time that the
server and the page took, median and worst. Each step is undone. Thereafter it opens the report of 8001 jobs so many
times, each time until the frame after the chart was painted, and pans through it, a step in every frame. Needs chromium
and its driver, and the extra [serve].
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from statistics import mean, median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from selenium.webdriver.chrome.webdriver import WebDriver

BEGIN = """
const [name, what, done] = arguments, task = state.tasks.find(each => each.name === name);
const number = state.tasks.indexOf(task), mode = state.modes[0], version = task.versions[0].name;
const job = mode.jobs.find(each => each[0] === number), plain = show, asked = fetch, began = performance.now();
const frame = act => requestAnimationFrame(() => requestAnimationFrame(act));
window.goOn = () => 0; // an order that is answered at once needs no gate
fetch = (...words) => words[0] !== "/api/settle" ? asked(...words)
  : new Promise(open => { window.goOn = () => open(asked(...words)); });
show = (...told) => { plain(...told); show = plain; frame(() => done(performance.now() - began)); };
const drag = () => order("pin", {mode: mode.name, task: name, index: job[1], start: `${(job[4] + .1).toFixed(6)}ms`});
if (what === "drag" && !job) { show = plain; fetch = asked; done(null); }
else window.answer = (what === "drag" ? drag()
  : order("edit", {kind: "version", name, inner: version, field: "wcet", value: what}));
if (window.answer) window.answer = window.answer.finally(() => { fetch = asked; });
"""
END = """
const done = arguments[0], began = performance.now();
const frame = act => requestAnimationFrame(() => requestAnimationFrame(act));
window.goOn();
window.answer.then(({valid, answered: {stayed, jobs}}) =>
  frame(() => done([performance.now() - began, valid, stayed, jobs])));
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
HEAD = "| steps | jobs | valid | painted | worst | server | page | verified | worst | server | page | jobs that stay |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--edits", type=int, default=20)
    options.add_argument("--tasks", type=int, nargs="*", default=[60, 500])
    options.add_argument("--models", type=Path, nargs="*", default=[])
    options.add_argument("--loads", type=int, default=9)
    options.add_argument("--seed", type=int, default=101)
    stated = options.parse_args()
    print(HEAD + "\n" + "|---:" * 12 + "|")
    with tempfile.TemporaryDirectory() as folder:
        copies = [Path(shutil.copy(model, folder)) for model in stated.models]
        drawn = [generated(tasks, stated.seed, Path(folder)) for tasks in stated.tasks]
        for model in [*copies, *drawn]:
            for line in rows(model, stated.edits):
                print(line, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        report(stated.loads, stated.seed, Path(folder))


def generated(tasks: int, seed: int, folder: Path) -> Path:
    """Write a model of so many tasks."""
    size = ["--tasks", str(tasks), "--units", str(tasks // 10), "--access-windows", "20", "--utilisation", "0.4"]
    model = folder / f"{tasks}.xml"
    command = [sys.executable, "-m", "halpipe", "generate", *size, "--seed", str(seed), "-o", str(model), "-q"]
    subprocess.run(command, check=True)
    return model


def rows(model: Path, edits: int) -> Iterator[str]:
    """Yield the lines of the table for a model: edits, and drags."""
    with subprocess.Popen(
        [sys.executable, "-m", "halpipe", "serve", model], stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            assert server.stdout is not None
            yield from measured(server.stdout.readline().strip(), server.pid, edits)
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
        print(f"drawn after {median(seen):.0f} ms (median of {loads}, worst {max(seen):.0f} ms)")
        for share in (1.0, 0.1, 0.01):
            frames, paints = browser.execute_async_script(PAN, share)
            shown = f"{1000 / mean(frames):.0f} frames per second, the longest {max(frames):.0f} ms"
            print(f"pan, {share:.0%} of the hyperperiod in sight: {shown}; painting {median(paints):.1f} ms")
            browser.refresh()
    finally:
        browser.quit()


def measured(address: str, server: int, edits: int) -> Iterator[str]:
    """Make the edits, then the drags, one after the other in a browser at an address."""
    browser = chromium()
    try:
        browser.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
        browser.get(address)
        browser.execute_async_script(WAIT)
        tasks = browser.execute_script("return state.tasks.map(task => [task.name, task.versions[0].wcet])")
        chosen = [tasks[number % len(tasks)] for number in range(edits)]
        for what in ("edits", "drags"):
            found = [each for name, wcet in chosen if (each := step(browser, server, what, name, wcet)) is not None]
            yield line(f"{len(found)} {what}", found)
    finally:
        browser.quit()


def step(browser: WebDriver, server: int, what: str, name: str, wcet: str) -> tuple[Any, ...] | None:
    """Make a step and undo it; return times until painted and verified, each with processor times, and the answer."""
    clocks = [clock(browser, server)]
    painted = browser.execute_async_script(BEGIN, name, "drag" if what == "drags" else grown(wcet))
    if painted is None:
        return None
    clocks.append(clock(browser, server))
    verified, *answer = browser.execute_async_script(END)
    clocks.append(clock(browser, server))
    browser.execute_async_script(UNDO)
    used = [[after - before for before, after in zip(*pair, strict=True)] for pair in pairwise(clocks)]
    return painted, *used[0], verified, *used[1], *answer


def line(what: str, found: list[tuple[Any, ...]]) -> str:
    """Return a line of the table."""
    *times, valid, stayed, jobs = zip(*found, strict=True)
    cells: list[str] = []
    for number, each in enumerate(times):
        both = f"{median(each):.0f} ms", f"{max(each):.0f} ms"
        cells += both if number % 3 == 0 else ["; ".join(both)]
    stays = [stay / of for stay, of, is_valid in zip(stayed, jobs, valid, strict=True) if is_valid]
    return f"| {what} | {max(jobs)} | {sum(valid)} | {' | '.join(cells)} | {min(stays, default=0):.1%} |"


def clock(browser: WebDriver, server: int) -> tuple[float, float]:
    """Return the processor times of the server and of the thread of the page in milliseconds."""
    rows = browser.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    page = next(row["value"] for row in rows if row["name"] == "TaskDuration")
    return spent(server), page * 1000


def spent(process: int) -> float:
    """Return the processor time of a process in milliseconds."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * 1000 / os.sysconf("SC_CLK_TCK")


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
