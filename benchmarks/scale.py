"""Systems as large as a vehicle's: ten ECUs with frames and chains, and many groups of tasks of which one is hard.

    python benchmarks/scale.py ecus --seeds 3 --first-seed 1      10 ECUs, 500 runnables each, 200 frames, 200 chains
    python benchmarks/scale.py corner --groups 2500 --load 93%    100 000 tasks at 60 % of three units each, 40 at 93 %

Whole commands, each in a process of its own; times are of the processor, user and system.
"""

from __future__ import annotations

import argparse
import random
import resource
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, milliseconds
from halpipe.core.quantities import parse_share
from halpipe.exporters.native import format_model
from halpipe.models import Chain, Mode, Run, Task, TaskModel, Unit, Version
from halpipe.pipeline.generate import SetParameters, generate

if TYPE_CHECKING:
    from collections.abc import Iterator

ECUS, RUNNABLES, FRAMES = 10, 500, 200
PERIODS, SHARES = (1, 2, 5, 10, 20, 50, 100), (3, 2, 2, 25, 25, 3, 20)
FRAME = Duration(60_000)
"""Transmission time of a frame."""
LOAD = Fraction(6, 10)
KINDS = 20
"""Sets of which the groups are copies."""


def ecus(seed: int) -> TaskModel:
    """Return runnables of the usual periods on ten units at 60 % load; each chain passes one frame on a bus."""
    draw = random.Random(seed)
    homes = [n % ECUS for n in range(ECUS * RUNNABLES)]
    periods = draw.choices(PERIODS, SHARES, k=len(homes))
    works = [Fraction(draw.randint(50, 150)) for _ in homes]
    loads: Counter[int] = Counter()
    for home, period, work in zip(homes, periods, works, strict=True):
        loads[home] += work / period
    tasks = [
        task(f"r{n}", periods[n], Duration(max(1, int(works[n] * LOAD / loads[homes[n]] * 1_000_000))), f"e{homes[n]}")
        for n in range(len(homes))
    ]
    slow = [n for n, period in enumerate(periods) if period >= 10]
    alike = {period: [n for n in slow if periods[n] == period] for period in PERIODS if period >= 10}
    chains = []
    for number in range(FRAMES):
        sender = draw.choice(slow)
        receiver = draw.choice([n for n in alike[periods[sender]] if homes[n] != homes[sender]])
        tasks.append(task(f"f{number}", periods[sender], FRAME, "bus"))
        names = (f"r{sender}", f"f{number}", f"r{receiver}")
        chains.append(Chain(name=f"c{number}", tasks=names, max_age=milliseconds(2 * periods[sender])))
    return system("ecus", tasks, [*(f"e{n}" for n in range(ECUS)), "bus"], chains)


def task(name: str, period: int, wcet: Duration, unit: str) -> Task:
    """Return a strictly periodic task on a unit."""
    return Task(name=name, period=milliseconds(period), versions=(Version(name="v", wcet=wcet, units=(unit,)),))


def system(name: str, tasks: list[Task], units: list[str], chains: list[Chain]) -> TaskModel:
    """Return a model of one mode in which all tasks run."""
    runs = tuple(Run(task=each.name, versions=tuple(v.name for v in each.versions)) for each in tasks)
    modes = (Mode(name="all", runs=runs),)
    named = tuple(Unit(name=unit) for unit in units)
    return TaskModel(name=name, units=named, tasks=tuple(tasks), chains=tuple(chains), modes=modes)


def corner(groups: int, load: Fraction, seed: int) -> TaskModel:
    """Return groups of 40 tasks on three units of their own, all at 60 % but one in the middle."""
    plain = SetParameters(tasks=40, units=3, unit_types=1, resources=0, access_windows=0, utilisation=LOAD)
    kinds = [generate(plain, seed + kind) for kind in range(KINDS)]
    hard = generate(replace(plain, utilisation=load), seed)
    tasks: list[Task] = []
    for group in range(groups):
        tasks += renamed(hard if group == groups // 2 else kinds[group % KINDS], group)
    return system("corner", tasks, [f"g{group}u{unit}" for group in range(groups) for unit in (1, 2, 3)], [])


def renamed(model: TaskModel, group: int) -> Iterator[Task]:
    """Yield the tasks of a model as those of a group."""
    for each in model.tasks:
        versions = tuple(replace(v, units=tuple(f"g{group}{unit}" for unit in v.units)) for v in each.versions)
        yield replace(each, name=f"g{group}{each.name}", versions=versions)


def main() -> None:
    """Schedule each system, and print what the command used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("ecus", "corner"))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--groups", type=int, default=2500)
    parser.add_argument("--load", type=parse_share, default=Fraction(93, 100), help="of the hard group")
    parser.add_argument("--time-limit", default="300s")
    chosen = parser.parse_args()
    with TemporaryDirectory(prefix="halpipe-scale-") as folder:
        path = Path(folder, "model.xml")
        command = [sys.executable, "-m", "halpipe", "schedule", str(path), "-o", str(Path(folder, "schedule.xml"))]
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
            made = ecus(seed) if chosen.what == "ecus" else corner(chosen.groups, chosen.load, seed)
            path.write_bytes(format_model(made))
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run([*command, "--time-limit", chosen.time_limit], capture_output=True, check=False)
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
            print(
                f"{chosen.what}, seed {seed}, {len(made.tasks)} tasks: exit code {done.returncode}, {seconds:.1f} s of "
                f"processor, {used.ru_maxrss / 1024:.0f} MiB",
                flush=True,
            )


if __name__ == "__main__":
    main()
