"""Success and run time of searches on generated task sets: a table, a plot and every single result.

python benchmarks/bench.py table3 -o out/table3    the paper's four experiments: 64 cells with 20 sets each
python benchmarks/bench.py hard   -o out/hard      larger and fuller sets, with the goals of the project
python benchmarks/bench.py harder -o out/harder    sets beyond those goals
python benchmarks/bench.py real   -o out/real      systems like published ones
python benchmarks/bench.py tiny --seeds 2 -o out/tiny    a few seconds, to try the benchmark itself
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.cli.searching import processor_count
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import refuse_foreign, write_outputs
from halpipe.pipeline.solve.workers import map_tasks
from search_benchmark import SUITES, given_rows, measure, report
from search_benchmark.render import NAMES, RESULTS, duration_text, outputs
from search_benchmark.results import instances

if TYPE_CHECKING:
    from collections.abc import Sequence

    from search_benchmark import Report
    from search_benchmark.instance import Instance


def options() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("-o", "--output", required=True, metavar="FOLDER", help="for table, plot and results")
    parser.add_argument("--row", action="append", default=[], help="only rows with this in the name; repeatable")
    parser.add_argument("--model", action="append", default=[], help="a row for this native model; repeatable")
    parser.add_argument("--jobs", type=int, default=1, help="processes; more than one disturb each other's times")
    for name, default, text in (
        ("seeds", 20, "sets of each cell"),
        ("first-seed", 101, "seed of the first set"),
        ("budget", 20_000, "moves per task before a search gives up"),
        ("limit", 120, "seconds before a search is stopped (0: none); the outcome then depends on the machine"),
        ("workers", 1, "threads of each search; the schedule is the same"),
        ("exact-seconds", 0, "seconds of CP-SAT, and PyJobShop if installed, for each set"),
        ("exact-seeds", 1, "sets of each cell for CP-SAT"),
        ("exact-workers", 2, "threads of CP-SAT"),
    ):
        parser.add_argument(f"--{name}", type=int, default=default, help=f"{text} (default: {default})")
    return parser


def main(arguments: Sequence[str]) -> int:
    """Measure the sets of a suite and write the report; return 1 if a schedule did not verify."""
    parser = options()
    chosen = parser.parse_args(arguments)
    rows = [
        row for row in (*SUITES[chosen.suite], *given_rows(chosen.model))
        if not chosen.row or any(part in row.name for part in chosen.row)
    ]  # fmt: skip
    if not rows:
        names = "; ".join(row.name for row in SUITES[chosen.suite])
        parser.error(f"--row: no row has that in its name; the rows are: {names}")
    work = instances(
        rows, range(chosen.first_seed, chosen.first_seed + chosen.seeds), budget=chosen.budget, limit=chosen.limit,
        workers=chosen.workers, exact_seconds=chosen.exact_seconds, exact_seeds=chosen.exact_seeds,
        exact_workers=chosen.exact_workers,
    )  # fmt: skip
    _refuse_foreign(Path(chosen.output))
    done = _measure(work, chosen.jobs)
    found = report(chosen.suite, rows, done, _about(chosen, arguments))
    write_outputs({str(Path(chosen.output, name)): content for name, content in outputs(found).items()})
    return _summarise(found, chosen.output)


def _about(chosen: argparse.Namespace, arguments: Sequence[str]) -> dict[str, Any]:
    exact = f"{chosen.exact_seconds} s, {chosen.exact_workers} threads"
    return {
        "command": "benchmarks/bench.py " + " ".join(arguments),
        "version": __version__,
        "seeds": f"{chosen.first_seed}..{chosen.first_seed + chosen.seeds - 1}",
        "budget": chosen.budget,
        "limit": f"{chosen.limit} s",
        "workers": chosen.workers,
        "exact": exact if chosen.exact_seconds else "not run",
        "pyjobshop": _version_of("pyjobshop") if chosen.exact_seconds else "not run",
        "machine": {
            "processor": _processor(),
            "processors": processor_count(),
            "system": f"{platform.system()} {platform.machine()}",
            "python": platform.python_version(),
            "executor": f"{chosen.jobs} process{'es' if chosen.jobs > 1 else ''}",
        },
    }


def _refuse_foreign(folder: Path) -> None:
    """Stop before the first measurement if the results would replace files of another origin."""
    refuse_foreign(str(folder / RESULTS), lambda content: b'"results_sha256"' in content)
    for name in NAMES if not (folder / RESULTS).exists() else ():
        refuse_foreign(str(folder / name), lambda content: False)


def _version_of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return f"not installed: pip install {package}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def _measure(work: Sequence[Instance], jobs: int) -> dict[str, dict[str, Any]]:
    """Return the record of every instance by its key, in the order of `work`."""
    done, begin = {}, time.monotonic()
    for count, (_, record) in enumerate(map_tasks(measure, work, jobs=jobs), 1):
        done[record["key"]] = record
        left = (time.monotonic() - begin) / count * (len(work) - count)
        if sys.stderr.isatty():
            _say(f"{count}/{len(work)} {record['key']}: {record['result']['outcome']} ({left:.0f} s to go)")
    return {instance.key: done[instance.key] for instance in work}


def _summarise(found: Report, folder: str) -> int:
    for row in found.rows:
        median = "no times" if row.kernel_ns is None else f"kernel {duration_text(row.kernel_ns.median)}"
        _say(f"{row.row.name}: {row.solved} of {len(row.records)} solved, {median}")
    _say(f"{folder}: table.md, plot.svg, index.html, results.json; results {found.results_sha256[:16]}")
    for fault in found.faults:
        _say(f"fault: {fault}")
    return int(bool(found.faults))


def _say(text: str) -> None:
    print(text, file=sys.stderr)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except HalpipeError as failure:
        sys.exit("\n".join(f"error[{found.code}] {found}" for found in failure.diagnostics))
