"""Systems with end-to-end limits at vehicle scale: how many are scheduled, and the processor time of the whole command.

    python benchmarks/chained.py --tasks 150 400 2000 --seeds 1 2 3 --time-limit 20

Tasks have the usual periods of engine control on three cores. Each chain has eight tasks of one period, and its data
may be one period old. Nothing shows beforehand that a schedule exists.
"""

from __future__ import annotations

import argparse
import random
import resource
import statistics
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

PERIODS, SHARES = (1, 2, 5, 10, 20, 50, 100), (3, 2, 2, 25, 25, 3, 20)
CORES, LENGTH, TASKS_PER_CHAIN = 3, 8, 25


def system(tasks: int, seed: int, load: float) -> str:
    """Return a task model as XML."""
    draw = random.Random(seed)
    periods = draw.choices(PERIODS, SHARES, k=tasks)
    works = [draw.uniform(0.5, 1.5) for _ in range(tasks)]
    loads = [sum(works[n] / periods[n] for n in range(core, tasks, CORES)) for core in range(CORES)]
    wcets = [max(1, int(works[n] * load / loads[n % CORES] * 1000)) for n in range(tasks)]
    alike = {period: [n for n in range(tasks) if periods[n] == period] for period in PERIODS}
    periods_of_chains = [period for period in PERIODS if len(alike[period]) >= LENGTH]
    chains = []
    for _ in range(max(1, tasks // TASKS_PER_CHAIN)):
        period = draw.choices(periods_of_chains, [len(alike[period]) for period in periods_of_chains])[0]
        chains.append((period, sorted(draw.sample(alike[period], LENGTH))))
    return "\n".join(
        [
            '<task-model xmlns="urn:halpipe:task-model:1" name="chained"><platform>',
            *(f'<unit name="u{core}"/>' for core in range(CORES)),
            "</platform><tasks>",
            *(
                f'<task name="t{n}" period="{period}ms"><version name="v" wcet="{wcet}us">'
                f'<units names="u{n % CORES}"/></version></task>'
                for n, (period, wcet) in enumerate(zip(periods, wcets, strict=True))
            ),
            "</tasks><chains>",
            *(
                f'<chain name="c{number}" tasks="{" ".join(f"t{n}" for n in steps)}" max-age="{period}ms"/>'
                for number, (period, steps) in enumerate(chains)
            ),
            '</chains><modes><mode name="all">',
            *(f'<run task="t{n}" versions="v"/>' for n in range(tasks)),
            "</mode></modes></task-model>",
        ]
    )


def main() -> None:
    """Schedule the systems asked for, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", type=int, nargs="+", default=[150, 250, 400, 700, 1000, 2000])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--load", type=float, default=0.8)
    parser.add_argument("--time-limit", default="40")
    options = parser.parse_args()
    seconds, found = [], 0
    with TemporaryDirectory() as folder:
        model = Path(folder, "model.xml")
        command = [sys.executable, "-m", "halpipe", "schedule", str(model), "-o", str(Path(folder, "schedule.xml"))]
        for tasks in options.tasks:
            for seed in options.seeds:
                model.write_text(system(tasks, seed, options.load))
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                ended = subprocess.run([*command, "--time-limit", options.time_limit], capture_output=True, check=False)
                used = resource.getrusage(resource.RUSAGE_CHILDREN)
                seconds.append(used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime)
                found += ended.returncode == 0
                print(f"{tasks} tasks, seed {seed}: {seconds[-1]:.2f} s, exit code {ended.returncode}", flush=True)
    print(f"{found} of {len(seconds)}, median {statistics.median(seconds):.2f} s, at most {max(seconds):.2f} s")


if __name__ == "__main__":
    main()
