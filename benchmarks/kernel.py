"""Time the annealing kernel on random task sets: ``python benchmarks/kernel.py --tasks 60 120 --load 0.7``.

Prints one row per set size: solved sets, median moves, median seconds in the kernel, microseconds per move. Sets are
strictly periodic with memory phases at both ends of a job; they are not known to be schedulable.
"""

import argparse
import random
import statistics
import time
from fractions import Fraction

from halpipe.durations import milliseconds
from halpipe.models import Access, Anchor, Mode, Precedence, Resource, Run, Task, TaskModel, Unit, Version
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel.kernel import anneal
from halpipe.pipeline.solve.kernel.noise import gumbel_table
from halpipe.pipeline.solve.kernel.state import BEST, MOVES, new_state
from halpipe.pipeline.solve.problem import build_problem

HYPERPERIOD = 1200


def task_set(tasks: int, load: Fraction, slack: Fraction, linked: Fraction, seed: int) -> TaskModel:
    """Make a set of `tasks` tasks on `tasks` / 10 units, of which a share `linked` follows an earlier one."""
    rng = random.Random(seed)
    count = max(1, tasks // 10)
    units = tuple(Unit(name=f"u{n}") for n in range(count))
    resources = tuple(Resource(name=f"r{n}") for n in range(max(1, count // 3)))
    parts = [rng.random() + 0.2 for _ in range(tasks)]
    scale = float(load) * count / sum(parts)
    made: list[Task] = []
    for number, part in enumerate(parts):
        period = HYPERPERIOD // rng.choice((1, 2, 3))
        wcet = min(period, max(4, round(part * scale * period)))
        phase, where = max(1, wcet // 12), rng.choice(resources).name
        version = Version(
            name="v",
            wcet=milliseconds(wcet),
            units=tuple(unit.name for unit in units),
            accesses=(
                Access(resource=where, start=milliseconds(0), end=milliseconds(phase)),
                Access(resource=where, start=milliseconds(wcet - phase), end=milliseconds(wcet)),
            ),
            precedences=tuple(
                Precedence(task=other.name, anchor=Anchor.END, max=milliseconds(period // 4))
                for other in [t for t in made if t.period == milliseconds(period)][-1:]
                if rng.random() < linked
            ),
        )
        made.append(Task(name=f"t{number}", period=milliseconds(period), slack=slack, versions=(version,)))
    mode = Mode(name="all", runs=tuple(Run(task=task.name, versions=("v",)) for task in made))
    return TaskModel(name="bench", units=units, resources=resources, tasks=tuple(made), modes=(mode,))


def solve(model: TaskModel, budget: int) -> tuple[bool, int, float]:
    """Return whether the kernel found a schedule within `budget` moves per task, the moves and the seconds."""
    problem = build_problem(expand(model, model.modes[0]), model.units, [r.name for r in model.resources])
    state = new_state(problem.arrays, 1, problem.mean_wcet)
    begin = time.perf_counter()
    anneal(problem.arrays, state, gumbel_table(), budget * len(model.tasks))
    return int(state.register[BEST]) == 0, int(state.register[MOVES]), time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", type=int, nargs="+", default=[60, 120, 240])
    parser.add_argument("--load", type=Fraction, default=Fraction("0.7"), help="share of the units' time")
    parser.add_argument("--slack", type=Fraction, default=Fraction(0))
    parser.add_argument("--linked", type=Fraction, default=Fraction(0), help="share of tasks with a predecessor")
    parser.add_argument("--sets", type=int, default=5)
    parser.add_argument("--budget", type=int, default=1500, help="moves per task")
    chosen = parser.parse_args()
    print("tasks solved     moves   seconds  us/move")
    for tasks in chosen.tasks:
        sets = (task_set(tasks, chosen.load, chosen.slack, chosen.linked, seed) for seed in range(chosen.sets))
        found = [solve(model, chosen.budget) for model in sets]
        moves = statistics.median(made for _, made, _ in found)
        seconds = statistics.median(spent for _, _, spent in found)
        rate = 1e6 * sum(spent for _, _, spent in found) / sum(made for _, made, _ in found)
        solved = sum(ok for ok, _, _ in found)
        print(f"{tasks:5} {solved:2}/{len(found):<2} {moves:10.0f} {seconds:9.3f} {rate:8.1f}")


if __name__ == "__main__":
    main()
