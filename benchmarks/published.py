"""Rows for sets that others have published: found by first fit, by CP-SAT and by halpipe, and their own figure.

    python benchmarks/published.py pscp DIR/set3/*.dat --seconds 60
    python benchmarks/published.py cc DIR/set1/*.dat --jitter 5        average maximum utilisation, in steps of 1 %
    python benchmarks/published.py ems DIR/ems_case_study.dat
    python benchmarks/published.py tsn TOPOLOGY.csv STREAMS.csv

With --exact-seconds, CP-SAT alone gets each system in all forms of the exact engine.

The data are not part of the project. `search_benchmark/published.py` states what is read of them. Each search has a
process and a limit of its own. Its time is that of the whole command, from the model file on.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from halpipe.exporters.native import format_model
from search_benchmark.published import PUBLISHED, System, co_scheduled, control, first_fit, scaled, streams

if TYPE_CHECKING:
    from collections.abc import Callable


def searched(system: System, seconds: float, *options: str) -> tuple[bool, float]:
    """Return whether `halpipe schedule` finds a schedule, and the processor time of the command."""
    import resource

    with TemporaryDirectory() as folder:
        model = Path(folder, "model.xml")
        model.write_bytes(format_model(system.model()))
        words = [
            "schedule",
            str(model),
            "-o",
            str(Path(folder, "s.xml")),
            "--time-limit",
            f"{seconds:g}s",
            "-q",
            *options,
        ]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        code = subprocess.run([sys.executable, "-m", "halpipe", *words], capture_output=True, check=False).returncode
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return code == 0, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def fitted(system: System, _: float) -> tuple[bool, float]:
    """Return whether the plain first fit finds a schedule, and its processor time."""
    begin = time.process_time()
    return first_fit(system) is not None, time.process_time() - begin


def exactly(system: System, seconds: float) -> tuple[bool, float]:
    """Return whether CP-SAT alone finds a schedule, and the processor time of the command."""
    return searched(system, seconds, "--engine", "exact")


def found(name: str, systems: list[System], seconds: float, exact_seconds: float) -> None:
    """Print how many systems each finds."""
    for who, search, limit in (
        ("first fit", fitted, 0),
        ("CP-SAT", exactly, exact_seconds),
        ("halpipe", searched, seconds),
    ):
        if search is exactly and not exact_seconds:
            continue
        results = [search(system, limit) for system in systems]
        times = [spent for _, spent in results]
        number = sum(is_found for is_found, _ in results)
        print(f"{name}: {who} {number} of {len(results)}, median {statistics.median(times):.2f} s, at most "
              f"{max(times):.2f} s", flush=True)  # fmt: skip
    print(f"{name}: published {PUBLISHED[name]}", flush=True)


def greatest(
    system: System, search: Callable[[System, float], tuple[bool, float]], seconds: float, least: int, step: int
) -> int:
    """Return the greatest utilisation in percent up to which every step has a schedule, as the paper counts."""
    percent = least
    while percent + step <= 100 and search(scaled(system, percent + step), seconds)[0]:
        percent += step
    return percent


def main() -> None:
    """Print the rows of one publication."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("row", choices=sorted(PUBLISHED))
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=60, help="limit of each search")
    parser.add_argument("--exact-seconds", type=float, default=0, help="limit of CP-SAT for each system; 0: not run")
    parser.add_argument("--jitter", type=int, default=5, help="start jitter as a part of the period; 0 for none")
    parser.add_argument("--cores", type=int, default=3)
    parser.add_argument("--least", type=int, default=40, help="percent at which the steps begin")
    parser.add_argument("--step", type=int, default=1, help="percent of a step")
    chosen = parser.parse_args()
    texts = [path.read_text(encoding="utf-8") for path in chosen.files]
    if chosen.row == "pscp":
        found("pscp", [control(text) for text in texts], chosen.seconds, chosen.exact_seconds)
    elif chosen.row == "tsn":
        found("tsn", [streams(*texts)], chosen.seconds, chosen.exact_seconds)
    elif chosen.row == "ems":
        found("ems", [co_scheduled(text, chosen.cores, 0) for text in texts], chosen.seconds, chosen.exact_seconds)
    else:
        systems = [co_scheduled(text, chosen.cores, chosen.jitter) for text in texts]
        for who, search, limit in (
            ("first fit", fitted, 1),
            ("CP-SAT", exactly, chosen.exact_seconds),
            ("halpipe", searched, chosen.seconds),
        ):
            if not limit:
                continue
            most = [greatest(each, search, limit, chosen.least, chosen.step) for each in systems]
            print(f"cc: {who} {statistics.mean(most):.1f} %, {most}", flush=True)
        print(f"cc: published {PUBLISHED['cc']}")


if __name__ == "__main__":
    main()
