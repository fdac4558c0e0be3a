"""Time the annealing kernel, and ask what each of its parts is worth.

    python benchmarks/kernel.py                          microseconds per move, on six kinds of sets
    python benchmarks/kernel.py --without AIM_AT_GAP     the same search without one of its parts
    python benchmarks/kernel.py --each                   with every part off in turn: solved sets and moves

Sets are generated, so each has a schedule. A part is a bit of `Part`.
"""

import argparse
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel.kernel import ALL_PARTS, BEST, MOVES, Part, anneal, gumbel_table, new_state
from halpipe.pipeline.solve.problem import Problem, build_problem

PLAIN = SetParameters(tasks=60, utilisation=Fraction(7, 10))
SHARE = Fraction(3, 10)
KINDS = {
    "120 tasks": replace(PLAIN, tasks=120, units=12),
    "precedence": replace(PLAIN, precedence=2 * SHARE),
    "versions": replace(PLAIN, multi_version=SHARE),
    "gang": replace(PLAIN, gang=SHARE / 2),
    "fractional": replace(PLAIN, fractional=True, resource_fill=Fraction(7, 10)),
    "mixed": replace(PLAIN, precedence=SHARE, multi_version=SHARE, gang=SHARE / 2, fractional=True, slack=SHARE / 6),
}


@dataclass(frozen=True)
class Found:
    """What became of one set: whether it was solved, in how many moves, and the time of the processor."""

    solved: bool
    moves: int
    nanoseconds: int


def problems(parameters: SetParameters, sets: int) -> Iterator[Problem]:
    """Return the arrays of some sets of a kind."""
    for seed in range(1, sets + 1):
        model = generate(parameters, seed)
        resources = [resource.name for resource in model.resources]
        yield build_problem(expand(model, model.modes[0]), model.units, resources, model.chains)


def solve(problem: Problem, parts: Part, budget: int) -> Found:
    """Search for at most `budget` moves per task."""
    state = new_state(problem.arrays, 1, problem.mean_wcet, parts)
    begin = time.process_time_ns()
    anneal(problem.arrays, state, gumbel_table(), budget * len(problem.expansion.tasks))
    spent = time.process_time_ns() - begin
    return Found(state.register[BEST] == 0, state.register[MOVES], spent)


def line(name: str, found: list[Found]) -> str:
    """Return one row of the table."""
    solved = sum(each.solved for each in found)
    moves = statistics.median(each.moves for each in found)
    rate = sum(each.nanoseconds for each in found) / sum(each.moves for each in found) / 1000
    return f"{name:32} {solved:3}/{len(found):<3} {moves:10.0f} {rate:8.2f}"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, action="append", help="one of the kinds; repeatable")
    parser.add_argument("--sets", type=int, default=8)
    parser.add_argument("--budget", type=int, default=1000, help="moves per task")
    parser.add_argument("--without", choices=[part.name for part in Part], action="append", default=[])
    parser.add_argument("--each", action="store_true", help="switch off one part after the other")
    chosen = parser.parse_args()
    without = Part(sum(Part[name] for name in set(chosen.without)))
    variants = {"": ALL_PARTS & ~without}
    if chosen.each:
        variants |= {f"without {part.name}": ALL_PARTS & ~without & ~part for part in Part}
    print(f"{'':32} {'solved':>7} {'moves':>10} {'us/move':>8}")
    for name in chosen.kind or KINDS:
        made = list(problems(KINDS[name], chosen.sets))
        for label, parts in variants.items():
            print(line(f"{name} {label}", [solve(problem, parts, chosen.budget) for problem in made]), flush=True)


if __name__ == "__main__":
    main()
