"""What is asked for beyond a valid schedule: shorter chains, few moved jobs, many variants at once.

    python benchmarks/beyond_valid.py chains --seeds 5 --first-seed 1
    python benchmarks/beyond_valid.py near --seeds 24 --first-seed 7200 [-- --precedence 30%]
    python benchmarks/beyond_valid.py margin --seeds 10 --first-seed 7300
    python benchmarks/beyond_valid.py fleet --variants 100

Whole commands, each in a process of its own; times are of the processor (user), and by the clock. `chains` draws sets
like engine control: 16 strictly periodic tasks on four cores at 60 % load, with four chains. `near` makes one to three
WCETs of a generated set of 100 tasks 5, 20 or 50 % longer, at a load of 60, 70 or 80 % in turn. `margin` compares what
`--optimise margin` reaches on sets of 20 tasks on two units with the bound that it proves. `fleet` schedules variants
of one set, with 90 to 100 % of each WCET. What stands after ``--`` is for `halpipe generate`.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.durations import Duration, milliseconds
from halpipe.exporters.native import format_model
from halpipe.importers.native import read_model
from halpipe.models import Chain, Mode, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Sequence

PERIODS = (5, 10, 10, 10, 20, 20, 20, 20, 50, 50, 100, 100, 10, 20, 50, 100)
"""Of the sets with chains, in milliseconds."""

CORES = ("core0", "core1", "core2", "core3")
LOAD = Fraction(60, 100)
MICROSECOND = 1000
QUICK = 0.5
"""Seconds in which the fewest moves are to be found."""
NEAR_CODE = "HAL0414"
"""The note on how many jobs stay."""


class Took(NamedTuple):
    """What a command said, and the seconds that it took: of the processor, and by the clock."""

    said: str
    user: float
    clock: float


def main() -> None:
    """Measure one of the four."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("chains", "near", "margin", "fleet"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--variants", type=int, default=100)
    words = sys.argv[1:]
    split = words.index("--") if "--" in words else len(words)
    chosen, options = parser.parse_args(words[:split]), words[split + 1 :]
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.seeds)
    with tempfile.TemporaryDirectory(prefix="halpipe-beyond-") as folder:
        if chosen.what == "chains":
            chains(Path(folder), seeds)
        elif chosen.what == "near":
            near(Path(folder), seeds, options)
        elif chosen.what == "margin":
            margins(Path(folder), seeds, options)
        else:
            fleet(Path(folder), chosen.variants, options)


def halpipe(*words: str, fails: bool = False) -> Took:
    """Run a command; unless it may fail, end with what it said if it does."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, time.monotonic()
    command = [sys.executable, "-m", "halpipe", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and not fails:
        sys.exit(f"{' '.join(words)}: {done.returncode}\n{done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    return Took(done.stdout + done.stderr, after - before, time.monotonic() - began)


# ---------------------------------------------------------------------------------------------- chains


def with_chains(seed: int) -> TaskModel:
    """Draw a set."""
    rng = random.Random(seed)
    shares = [Fraction(rng.randint(200, 1200)) for _ in PERIODS]
    scale = LOAD * len(CORES) / sum(shares)
    tasks = []
    for number, (period, share) in enumerate(zip(PERIODS, shares, strict=True)):
        wcet = Duration(int(milliseconds(period).ns * share * scale) // MICROSECOND * MICROSECOND)
        version = Version(name="v", wcet=wcet, units=CORES)
        tasks.append(Task(name=f"t{number}", period=milliseconds(period), versions=(version,)))
    names = [task.name for task in tasks]
    drawn = [Chain(name=f"c{n}", tasks=tuple(rng.sample(names, rng.choice((3, 4))))) for n in range(4)]
    runs = tuple(Run(task=name, versions=("v",)) for name in names)
    units = tuple(Unit(name=name) for name in CORES)
    modes = (Mode(name="run", runs=runs),)
    return TaskModel(name=f"chains{seed}", units=units, tasks=tuple(tasks), chains=tuple(drawn), modes=modes)


def chains(folder: Path, seeds: range) -> None:
    """Optimise the chains of drawn sets, and say what is known of the best possible."""
    model, tables = folder / "model.xml", folder / "schedule.xml"
    for seed in seeds:
        model.write_bytes(format_model(with_chains(seed)))
        took = halpipe("schedule", str(model), "-o", str(tables), "--optimise", "chains")
        [line] = re.findall(r"weighted sum of reaction times.*", took.said)
        print(f"seed {seed}: {line}; {took.user:.1f} s of processor, {took.clock:.1f} s")


# ------------------------------------------------------------------------------------------------ near


def near(folder: Path, seeds: range, options: Sequence[str]) -> None:
    """Edit each set, print what moves, and count the sets whose minimum is proven."""
    rows = [nearby(folder, seed, options) for seed in seeds]
    proven, used = [row[0] for row in rows], sorted(row[1] for row in rows)
    within = sum(seconds <= QUICK for seconds in used)
    print(f"{sum(proven)} of {len(rows)} proven the fewest; {within} within {QUICK} s of processor, median "
          f"{statistics.median(used):.2f} s, at most {used[-1]:.2f} s")  # fmt: skip


def nearby(folder: Path, seed: int, options: Sequence[str]) -> tuple[bool, float]:
    """Return whether the number of jobs of one set that move is proven the least, and the seconds of processor."""
    model, changed, before, after = (folder / name for name in ("m.xml", "c.xml", "before.xml", "after.xml"))
    load = ("60%", "70%", "80%")[seed % 3]
    halpipe("generate", "--seed", str(seed), "--tasks", "100", "--utilisation", load, *options, "-o", str(model))
    halpipe("schedule", str(model), "-o", str(before), "--time-limit", "300")
    owner, draw = read_model(str(model)), random.Random(seed)
    chosen = draw.sample(range(len(owner.tasks)), draw.randint(1, 3))
    tasks = list(owner.tasks)
    for number in chosen:
        factor = 1 + Fraction(draw.choice((5, 20, 50)), 100)
        tasks[number] = replace(
            tasks[number], versions=tuple(scaled(v, factor, up=True) for v in tasks[number].versions)
        )
    changed.write_bytes(format_model(replace(owner, tasks=tuple(tasks))))
    took = halpipe("schedule", str(changed), "-o", str(after), "--near", str(before), "--verbose", fails=True)
    line = next((line for line in took.said.splitlines() if NEAR_CODE in line), took.said.strip()[:100])
    print(f"seed {seed}, {load}, {len(chosen)} edited: {took.user:.2f} s; {line}", flush=True)
    is_least = NEAR_CODE in line and ("fewer: " not in line or "fewer: proven" in line)
    return is_least, took.user


def scaled(version: Version, factor: Fraction, *, up: bool = False) -> Version:
    """Return a version with another WCET, in whole microseconds, that still holds its access phases."""
    assert version.wcet is not None
    count = version.wcet.fraction * factor / MICROSECOND
    wcet = Duration((-(-count // 1) if up else count // 1) * MICROSECOND)
    return replace(version, wcet=max([wcet, *(access.end for access in version.accesses)]))


# ---------------------------------------------------------------------------------------------- margin


def margins(folder: Path, seeds: range, options: Sequence[str]) -> None:
    """Print the share of the proven bound that the margin of each set reaches."""
    model, shares = folder / "m.xml", []
    for seed in seeds:
        words = ("--tasks", "20", "--units", "2", "--unit-types", "1", "--utilisation", ("60%", "70%", "80%")[seed % 3])
        halpipe("generate", "--seed", str(seed), *words, *options, "-o", str(model))
        took = halpipe("schedule", str(model), "-o", str(folder / "s.xml"), "--optimise", "margin")
        [line] = re.findall(r"least margin of a WCET .*at first.*", took.said)
        reached, *bound = (Fraction(value) for value in re.findall(r"([0-9.]+) %", re.sub("at first[^;]*", "", line)))
        shares.append(reached / bound[0] if bound and bound[0] else Fraction(1))
        print(f"seed {seed}: {line}; {took.user:.1f} s of processor", flush=True)
    print(f"{len(shares)} sets: margins are {float(min(shares)):.2f} of the bound at least, median "
          f"{float(statistics.median(shares)):.2f}")  # fmt: skip


# ----------------------------------------------------------------------------------------------- fleet


def fleet(folder: Path, variants: int, options: Sequence[str]) -> None:
    """Schedule variants of one set in one process, and then again, when all are kept."""
    halpipe("generate", "--seed", "7", *options, "-o", str(folder / "base.xml"))
    base = read_model(str(folder / "base.xml"))
    files = []
    for seed in range(variants):
        rng = random.Random(seed)
        tasks = [
            replace(task, versions=tuple(scaled(v, Fraction(rng.randint(900, 1000), 1000)) for v in task.versions))
            for task in base.tasks
        ]
        files.append(folder / f"v{seed}.xml")
        files[-1].write_bytes(format_model(replace(base, tasks=tuple(tasks))))
    command = ["schedule", *map(str, files), "-o", str(folder / "out")]
    for what in ("first", "again"):
        took = halpipe(*command)
        print(f"{what}: {variants} variants, {took.user:.2f} s of processor, {took.clock:.2f} s")
    assert len(os.listdir(folder / "out")) >= variants


if __name__ == "__main__":
    main()
