"""Time whole commands against the goals of the project: ``python benchmarks/commands.py --runs 3``.

Everything that the commands read is generated first. Wall-clock time and processor time are the medians of the runs,
each a process of its own with the start of Python in it; memory is the peak. ``--only TEXT`` chooses rows by name.
"""

import argparse
import multiprocessing
import multiprocessing.queues
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "unit" / "importers"), str(TESTS / "unit" / "exporters" / "regulator")]
sys.path.insert(0, str(TESTS / "unit" / "pipeline"))

HALPIPE = (sys.executable, "-m", "halpipe")
# An installed package has its bytecode; where Python may not write it, every start would compile the sources again.
SURROUNDINGS = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


@dataclass(frozen=True)
class Row:
    """A command, its goal in seconds, and what it needs: called once, it returns the arguments."""

    name: str
    goal: float
    prepare: Callable[[Path], list[str]]
    needs: str = ""


@dataclass(frozen=True)
class Figures:
    """Seconds by the clock and of the processor, and megabytes."""

    wall: float
    processor: float
    peak: float


def run(arguments: list[str], folder: Path) -> Figures:
    """Run a command once; children that it starts count, too."""
    begin = time.perf_counter()
    process = subprocess.Popen(
        [*HALPIPE, *arguments], cwd=folder, env=SURROUNDINGS, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, used = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"halpipe {' '.join(arguments)}\n{said}")
    return Figures(time.perf_counter() - begin, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def prepared(row: Row, folder: Path) -> list[str]:
    """Prepare a row in a process of its own: Linux counts the memory of the process that starts a command to it."""
    processes = multiprocessing.get_context("fork")
    answers: multiprocessing.queues.SimpleQueue[list[str]] = processes.SimpleQueue()
    helper = processes.Process(target=lambda: answers.put(row.prepare(folder)))
    helper.start()
    helper.join()
    if helper.exitcode:
        raise SystemExit(helper.exitcode)
    return answers.get()


def rows() -> Iterator[Row]:
    """Return what is timed."""
    yield Row("--help", 0.15, lambda _: ["--help"])
    yield Row("import of a 21 MB ARXML extract", 10, _extract)
    yield Row("validate of 10 000 tasks", 1, _ten_thousand)
    yield Row("schedule of 60 tasks, Table III", 1, lambda folder: _table3(folder, 60))
    yield Row("schedule of 120 tasks, Table III", 1, lambda folder: _table3(folder, 120))
    yield Row("verify of 10 000 jobs", 1, _many_jobs)
    yield Row("verify of 20 000 parts", 1, _many_parts)
    yield Row("export regulator, 120 tasks, 8 units, 4 modes, 12 switches", 2, _regulator)
    yield Row("export riscv, 120 tasks, 4 cores, zig", 15, lambda folder: _bundle(folder, "zig"))
    yield Row(
        "export riscv, 120 tasks, 4 cores, gcc", 5, lambda folder: _bundle(folder, "gcc"), "riscv64-unknown-elf-gcc"
    )
    yield Row("compare with a trace of 100 000 events", 5, _trace)


def _extract(folder: Path) -> list[str]:
    from test_arxml_size import extract

    return ["import", "arxml", str(extract(folder, 5_500)), "-o", "imported.xml"]


def _ten_thousand(folder: Path) -> list[str]:
    from test_validate_speed import chained

    from halpipe.exporters.native import format_model

    (folder / "large.xml").write_bytes(format_model(chained()))
    return ["validate", "large.xml"]


def _table3(folder: Path, tasks: int) -> list[str]:
    """Take the last cell of Table III with so many tasks: the fullest of them."""
    from halpipe.exporters.native import format_model
    from halpipe.pipeline.generate import generate
    from table_iii import TABLE_III

    cells = [cell for experiment in TABLE_III for cell in experiment.cells if cell.tasks == tasks]
    (folder / "set.xml").write_bytes(format_model(generate(cells[-1], 1)))
    return ["schedule", "set.xml", "-o", "schedule.xml"]


def _many_jobs(folder: Path) -> list[str]:
    periods = ["5ms", "10ms", "11ms", "20ms", "25ms", "33ms", "66ms", "400ms"]
    chosen = [part for period in periods for part in ("--period", period)]
    run(["generate", "--units", "2", "--unit-types", "1", "--resources", "1", *chosen, "-o", "rates.xml"], folder)
    run(["schedule", "rates.xml", "-o", "rates.schedule.xml"], folder)
    return ["verify", "rates.xml", "rates.schedule.xml"]


def _many_parts(folder: Path) -> list[str]:
    from test_verify_speed import many_parts

    from halpipe.exporters.native import format_model, format_schedule

    system, plan = many_parts()
    (folder / "parts.xml").write_bytes(format_model(system))
    (folder / "parts.schedule.xml").write_bytes(format_schedule(plan))
    return ["verify", "parts.xml", "parts.schedule.xml"]


def _regulator(folder: Path) -> list[str]:
    from test_regulator_speed import PLATFORM

    from halpipe.exporters.native import format_model
    from halpipe.models import Transition
    from halpipe.pipeline.generate import SetParameters, generate
    from support import mode

    base = generate(SetParameters(tasks=120, units=8, unit_types=1, resources=1, fractional=True), 1)
    managers = "".join(f"  {unit.name}: {{manager: {number}}}\n" for number, unit in enumerate(base.units))
    (folder / "platform.yaml").write_text(
        f"resource: r1\ncapacity: 3.6GB/s\n{PLATFORM.partition('units:')[0]}units:\n{managers}"
    )
    names = ("a", "b", "c", "d")
    modes = tuple(mode(name, [t for n, t in enumerate(base.tasks) if n % 4 != k]) for k, name in enumerate(names))
    pairs = tuple(Transition(source=x, target=y) for x in names for y in names if x != y)
    (folder / "model.xml").write_bytes(format_model(replace(base, modes=modes, transitions=pairs)))
    run(["schedule", "model.xml", "--quantise", "platform.yaml", "-o", "schedule.xml"], folder)
    return ["export", "regulator", "model.xml", "schedule.xml", "--platform", "platform.yaml", "-o", "tables"]


def _bundle(folder: Path, toolchain: str) -> list[str]:
    shape = "--tasks 120 --units 4 --unit-types 1 --resources 1 --utilisation 40% --seed 1"
    run(["generate", *shape.split(), "-o", "set.xml"], folder)
    run(["deploy", "prepare", "set.xml", "-o", "prepared.xml", "--dummy", "--toolchain", toolchain], folder)
    run(["schedule", "prepared.xml", "-o", "prepared.schedule.xml"], folder)
    return ["export", "riscv", "prepared.xml", "prepared.schedule.xml", "--toolchain", toolchain, "-o", "bundle"]


def _trace(folder: Path) -> list[str]:
    import csv

    from halpipe.core.durations import Duration
    from halpipe.importers.native import read_schedule

    run(_table3(folder, 120), folder)
    (mode,) = read_schedule(str(folder / "schedule.xml")).modes
    nanosecond = Duration(1)
    cycles = 50_000 // len(mode.jobs) + 1
    with (folder / "trace.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["task", "units", "start", "end"])
        for cycle in range(cycles):
            begin = mode.hyperperiod * cycle
            for job in mode.jobs:
                times = ((begin + time) // nanosecond for time in (job.start, job.end))
                table.writerow([job.task, " ".join(job.units), *times])
    return ["compare", "schedule.xml", "trace.csv"]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    print(f"{options.runs} runs each, Python {platform.python_version()}, {_processor()}, {os.cpu_count()} cores\n")
    print("| command | goal | by the clock | least, most | processor | memory |\n|---|---|---|---|---|---|")
    for row in rows():
        if options.only.lower() not in row.name.lower():
            continue
        if row.needs and not shutil.which(row.needs):
            print(f"| {row.name} | {row.goal:g} s | skipped: {row.needs} is not installed | | | |")
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            arguments = prepared(row, folder)
            run(arguments, folder)  # what every later run finds in its caches
            found = [run(arguments, folder) for _ in range(options.runs)]
        walls = [figures.wall for figures in found]
        processor = statistics.median(figures.processor for figures in found)
        peak = max(figures.peak for figures in found)
        print(
            f"| {row.name} | {row.goal:g} s | {statistics.median(walls):.2f} s "
            f"| {min(walls):.2f}, {max(walls):.2f} s | {processor:.2f} s | {peak:.0f} MB |",
            flush=True,
        )


def _processor() -> str:
    """Return the name of the processor, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown processor"
    )


if __name__ == "__main__":
    main()
