"""Start errors of a Linux bundle against those of a minimal loop with the same table, in turn on the same machine.

    python benchmarks/linux_starts.py --rounds 5 --seconds 4

Five tasks on two CPUs, 2067 jobs per second. The loop is a thread for each CPU that sleeps until each instant of the
table, takes the same processor time, and stores how late it woke up. Both ask for SCHED_FIFO and locked memory.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from halpipe.api import schedule
from halpipe.core.durations import milliseconds
from halpipe.core.files import write_directory
from halpipe.deploy.linux.judging import FAULTS
from halpipe.exporters.linux import FORMAT, LinuxOptions
from halpipe.models import Mode, Run, Task, TaskModel, Unit, Version

TASKS = (
    ("a", "c0", 1, "0.3"),
    ("b", "c0", 3, "0.6"),
    ("c", "c1", 2, "0.4"),
    ("d", "c1", 5, "0.5"),
    ("e", "c1", 30, "0.5"),
)
BUSY = 20
"""Percent of its WCET that each job takes."""

LOOP = r"""
#define _GNU_SOURCE
#include <pthread.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
static const struct row {int64_t start, busy;} rows0[] = {ROWS0}, rows1[] = {ROWS1};
static const struct {const struct row *rows; int n;} table[] = {
  {rows0, sizeof rows0 / sizeof *rows0}, {rows1, sizeof rows1 / sizeof *rows1}};
static int64_t origin, cycles, *errors[2];
static int64_t now(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}
static void *play(void *which) {
  const int cpu = (int)(intptr_t)which;
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(cpu, &set);
  sched_setaffinity(0, sizeof set, &set);
  const struct sched_param high = {.sched_priority = 50};
  pthread_setschedparam(pthread_self(), SCHED_FIFO, &high);
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
  int64_t *error = errors[cpu];
  for (int64_t cycle = 0; cycle < cycles; cycle++)
    for (int i = 0; i < table[cpu].n; i++) {
      const int64_t at = origin + cycle * LENGTH + table[cpu].rows[i].start;
      const struct timespec t = {at / 1000000000, at % 1000000000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
      *error++ = now(CLOCK_MONOTONIC) - at;
      const int64_t end = now(CLOCK_THREAD_CPUTIME_ID) + table[cpu].rows[i].busy;
      while (now(CLOCK_THREAD_CPUTIME_ID) < end) { }
    }
  return NULL;
}
int main(int argc, char **argv) {
  cycles = argc > 1 ? atoll(argv[1]) : 1;
  pthread_t threads[2];
  for (int cpu = 0; cpu < 2; cpu++) errors[cpu] = calloc((size_t)(cycles * table[cpu].n), sizeof **errors);
  mlockall(MCL_CURRENT | MCL_FUTURE);
  origin = now(CLOCK_MONOTONIC) + 200000000;
  for (int cpu = 0; cpu < 2; cpu++) pthread_create(&threads[cpu], NULL, play, (void *)(intptr_t)cpu);
  for (int cpu = 0; cpu < 2; cpu++) pthread_join(threads[cpu], NULL);
  for (int cpu = 0; cpu < 2; cpu++)
    for (int64_t i = 0; i < cycles * table[cpu].n; i++) printf("%lld\n", (long long)errors[cpu][i]);
}
"""


def main() -> None:
    """Build both, play them in turn, and print percentiles, their ratios, and the spread of these."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=int, default=4)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="halpipe-starts-") as name:
        folder = Path(name)
        length = _build(folder)
        cycles = chosen.seconds * 1000 // length
        players = [_dispatched, _looped]
        found: list[dict[Any, list[int]]] = []
        print(f"load average {os.getloadavg()[0]:.1f}; microseconds")
        for number in range(chosen.rounds):
            players.reverse()  # each is as often first, whatever the machine does meanwhile
            found.append({play: play(folder, cycles) for play in players})
            print(f"round {number + 1}: {_compared(found[-1])}")
        print(f"all: {_compared({play: [error for one in found for error in one[play]] for play in players})}")
        for share in (50, 99):
            ratios = sorted(_ratio(one, share) for one in found)
            middle, least, most = ratios[len(ratios) // 2], ratios[0], ratios[-1]
            print(f"p{share}: dispatcher / loop in a round: median {middle:.2f}, {least:.2f} to {most:.2f}")


def _build(folder: Path) -> int:
    """Build the bundle and the loop from one schedule; return the length of the table in milliseconds."""
    tasks = tuple(
        Task(
            name=name,
            period=milliseconds(period),
            versions=(Version(name="v", wcet=milliseconds(1) * _exact(wcet), units=(unit,)),),
        )
        for name, unit, period, wcet in TASKS
    )
    runs = tuple(Run(task=task.name, versions=("v",)) for task in tasks)
    units = (Unit(name="c0"), Unit(name="c1"))
    model = TaskModel(name="starts", units=units, tasks=tasks, modes=(Mode(name="all", runs=runs),))
    plan = schedule(model)
    options = LinuxOptions(cpus={"c0": 0, "c1": 1}, busy=BUSY)
    write_directory(str(folder / "bundle"), FORMAT.write(model, plan, options))
    subprocess.run(["make", "-s"], cwd=folder / "bundle", check=True)
    [mode] = plan.modes
    source = LOOP.replace("LENGTH", str(int(mode.hyperperiod.fraction)))
    for number, unit in enumerate(("c0", "c1")):
        rows = [(int(j.start.fraction), int((j.end - j.start).fraction)) for j in mode.jobs if unit in j.units]
        listed = ", ".join(f"{{{start}, {length * BUSY // 100}}}" for start, length in sorted(rows))
        source = source.replace(f"ROWS{number}", listed)
    (folder / "loop.c").write_text(source)
    subprocess.run(["cc", "-O2", "-o", "loop", "loop.c", "-pthread"], cwd=folder, check=True)
    return int(mode.hyperperiod.fraction) // 10**6


def _exact(text: str):
    from fractions import Fraction

    return Fraction(text)


def _dispatched(folder: Path, cycles: int) -> list[int]:
    command = ["build/dispatcher", "--degrade", "all", "--record", "run.csv", "--cycles", str(cycles)]
    ran = subprocess.run(command, cwd=folder / "bundle", check=False, capture_output=True, text=True)
    if ran.returncode not in (0, FAULTS):
        raise SystemExit(ran.stderr)
    with (folder / "bundle" / "run.csv").open() as file:
        return [int(row["start"]) - int(row["planned"]) for row in csv.DictReader(file)]


def _looped(folder: Path, cycles: int) -> list[int]:
    ran = subprocess.run(["./loop", str(cycles)], cwd=folder, check=True, capture_output=True, text=True)
    return [int(line) for line in ran.stdout.split()]


def _ratio(found: dict[Any, list[int]], share: int) -> float:
    return _percentile(found[_dispatched], share) / _percentile(found[_looped], share)


def _compared(found: dict[Any, list[int]]) -> str:
    ratios = ", ".join(f"p{share} {_ratio(found, share):.2f}" for share in (50, 99))
    return f"dispatcher {_shown(found[_dispatched])}; loop {_shown(found[_looped])}; ratio {ratios}"


def _percentile(errors: list[int], share: int) -> int:
    return sorted(errors)[-(-len(errors) * share // 100) - 1]


def _shown(errors: list[int]) -> str:
    p50, p99, most = (_percentile(errors, share) / 1000 for share in (50, 99, 100))
    return f"{len(errors)} jobs, p50 {p50:.1f}, p99 {p99:.1f}, max {most:.1f}"


if __name__ == "__main__":
    main()
