"""The exact engine with an objective: the shortest chains, or the fewest jobs that leave an earlier schedule.

Each states a bound, too: how short all chains together can be, how many jobs must move.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, greatest_common_divisor
from halpipe.core.records import record
from halpipe.pipeline.jobs import Expansion
from halpipe.pipeline.measure.objectives import NEVER, whole_weights
from halpipe.pipeline.parts import is_exact_model
from halpipe.pipeline.solve.exact import FOUND, IMPOSSIBLE, UNDECIDED, Effort, is_installed, is_small, run

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from halpipe.models import Chain, Job, TaskModel
    from halpipe.pipeline.solve.exactmodel import JobVars, Program

    Jobs = Mapping[tuple[str, int], Job]


CHAINS_WORK = 5
"""Deterministic seconds for all chains together."""

ALONE = 1
"""Deterministic seconds for each chain without the other tasks, and for each pair of chains."""

PAIRS = 8
"""Pairs of chains that are looked at."""

CHAINS_JOBS = 400
"""Jobs of a mode up to which it is asked."""


@record
class Shortest:
    """Bound on the weighted sum of latencies, in nanoseconds, and the jobs of a better schedule, if any.

    `stopped` states that the caller stopped it before the effort was spent.
    """

    bound: Fraction
    jobs: tuple[Job, ...] = ()
    stopped: bool = False


def shortest_chains(
    model: TaskModel,
    expansion: Expansion,
    jobs: tuple[Job, ...],
    now: Fraction,
    least: dict[Chain, Fraction],
    effort: Effort,
) -> Shortest:
    """Look for a schedule with a lower sum than `now`, that of `jobs`, and for a bound above the `least` of each chain.

    The bound is that of each chain, then of pairs, then of all together, where what is known of the former helps.
    """
    is_asked = is_installed() and is_exact_model(model) and expansion.job_count <= CHAINS_JOBS and is_small(expansion)
    if not is_asked or now >= NEVER:  # a chain that carries no data to its end has no latency in ticks
        return Shortest(_sum(least))
    for chain in least:
        alone = _solve(model, _part(expansion, chain.tasks), [chain], (), None, replace(effort, work=ALONE))
        least[chain] = max(least[chain], alone.bound / chain.weight if chain.weight else Fraction(0))
        if alone.stopped or not effort.go_on():
            return Shortest(_sum(least), stopped=True)
    bound = _sum(least)
    if bound >= now:
        return Shortest(bound)
    pairs = _pairs(model, expansion, least, effort)
    bound += _best_gain(pairs, least)
    if not effort.go_on():
        return Shortest(bound, stopped=True)
    floors = {(chain,): chain.weight * times for chain, times in least.items()} | pairs
    together = _solve(model, expansion, list(least), jobs, now, replace(effort, work=CHAINS_WORK), floors)
    return Shortest(max(bound, together.bound), together.jobs, together.stopped)


def _pairs(
    model: TaskModel, expansion: Expansion, least: dict[Chain, Fraction], effort: Effort
) -> dict[tuple[Chain, ...], Fraction]:
    """Bound the sums of pairs of chains with a task in common, which cannot be where it is best for both.

    Each pair is without the other tasks. Those with the most in common come first.
    """
    common = {pair: len(set(pair[0].tasks) & set(pair[1].tasks)) for pair in combinations(least, 2)}
    found: dict[tuple[Chain, ...], Fraction] = {}
    for pair in sorted(filter(common.__getitem__, common), key=common.__getitem__, reverse=True)[:PAIRS]:
        part = _part(expansion, {task for chain in pair for task in chain.tasks})
        both = _solve(model, part, list(pair), (), None, replace(effort, work=ALONE))
        if both.stopped:
            break
        found[pair] = max(both.bound, _sum({chain: least[chain] for chain in pair}))
    return found


def _best_gain(pairs: dict[tuple[Chain, ...], Fraction], least: dict[Chain, Fraction]) -> Fraction:
    """Return by how much pairs raise the bound, each chain being in one at most; those that gain most come first."""
    gains = {pair: bound - _sum({chain: least[chain] for chain in pair}) for pair, bound in pairs.items()}
    total, left = Fraction(0), set(least)
    for pair in sorted(gains, key=gains.__getitem__, reverse=True):
        if left.issuperset(pair):
            total += gains[pair]
            left.difference_update(pair)
    return total


def _sum(least: dict[Chain, Fraction]) -> Fraction:
    return sum((chain.weight * times for chain, times in least.items()), Fraction(0))


def _part(expansion: Expansion, names: Collection[str]) -> Expansion:
    """Leave out all other tasks, and what the windows say of them: whatever then is best, it is no worse."""
    own = (active for active in expansion.tasks if active.name in names)
    tasks = tuple(active.with_windows(lambda row: row.task in names) for active in own)
    return Expansion(expansion.mode, expansion.hyperperiod, tasks)


def _solve(
    model: TaskModel,
    expansion: Expansion,
    chains: list[Chain],
    jobs: tuple[Job, ...],
    now: Fraction | None,
    effort: Effort,
    floors: Mapping[tuple[Chain, ...], Fraction] = MappingProxyType({}),
) -> Shortest:
    """Minimise the weighted sum of some chains; `floors` bound that of groups of them, as is known already."""
    from halpipe.pipeline.solve.exactchains import TooLarge
    from halpipe.pipeline.solve.exactmodel import build
    from halpipe.pipeline.solve.exactunits import forms_of

    form: Any = next(iter(forms_of(expansion, model.units)))
    if any(active.demands for active in expansion.tasks) and not jobs:
        return Shortest(Fraction(0))
    program = build(expansion, model, chains, form)
    if program is None:
        return Shortest(Fraction(0))
    weights = whole_weights(chains)
    scale = next((Fraction(w) / chain.weight for w, chain in zip(weights, chains, strict=True) if w), Fraction(1))
    unit = Fraction(program.tick.ns) / scale  # what a tick of the sum counts
    most = 2**50 if now is None else math.floor(now / unit)
    try:
        known = [(group, math.ceil(floor / unit)) for group, floor in floors.items()]
        program.minimise(dict(zip(chains, weights, strict=True)), most, known)
    except TooLarge:
        return Shortest(Fraction(0))
    program.suggest(jobs)
    solver, status, is_stopped = run(program, effort)
    if status not in (*FOUND, UNDECIDED):
        return Shortest(Fraction(0), stopped=is_stopped)
    bound = unit * max(0, math.floor(solver.best_objective_bound))  # a whole number, well below 2^53
    is_better = status != UNDECIDED and now is not None and unit * int(solver.objective_value) < now
    return Shortest(bound, tuple(program.jobs(solver) or ()) if is_better else (), is_stopped)


MOVED_WORK = 3
"""Deterministic seconds for one mode."""

MOVED_JOBS = 2000
"""Jobs of a mode up to which it is asked."""


@record
class Fewest:
    """The jobs of a schedule in which fewer have moved, if there are any; at least `bound` must."""

    bound: int = 0
    jobs: tuple[Job, ...] = ()


def counts_moves(model: TaskModel, expansion: Expansion) -> bool:
    """Whether the exact engine is there, and takes a mode with a limit on its moves."""
    return is_installed() and is_exact_model(model) and is_small(expansion) and expansion.job_count <= MOVED_JOBS


def fewest_moved(
    model: TaskModel,
    expansion: Expansion,
    earlier: Jobs,
    held: Jobs,
    known: tuple[Job, ...],
    least: int,
    effort: Effort,
) -> Fewest:
    """Look for a schedule in which fewer jobs have moved than in the `known` one, where the `held` jobs stay.

    Programs with a limit on the moves raise the bound from `least` on: a limit propagates, an objective hardly does
    (0.1 s in place of 18 s for two jobs of 200). Once one has no answer, the others halve what is left.
    """
    if not counts_moves(model, expansion):
        return Fewest()
    if not all(_is_numbered(expansion, job) for job in (*earlier.values(), *held.values(), *known)):
        return Fewest()
    best = Fewest(least)
    floor, most, left = least, _moved(known, earlier), math.inf if effort.work is None else effort.work
    while floor < most and left > 0:
        is_proving = floor == best.bound
        limit = most - 1 if most - floor <= FEW_LIMITS else floor if is_proving else (floor + most) // 2
        program = _limited(model, expansion, earlier, held, limit, best.jobs or known)
        if program is None:
            break
        solver, status, stopped = run(program, replace(effort, work=left if limit == most - 1 else left / 2))
        left -= solver.response_proto.deterministic_time
        if status in FOUND:
            best = Fewest(best.bound, tuple(program.jobs(solver) or ()))
            most = _moved(best.jobs, earlier)
        else:
            floor = limit + 1  # without an answer, no lower limit has one soon
            best = Fewest(floor, best.jobs) if is_proving and status == IMPOSSIBLE else best
        if stopped:
            break
    return best


FEW_LIMITS = 4
"""Numbers of moves in question up to which the greatest of them comes first: the known schedule is often the best."""


def _moved(jobs: Iterable[Job], earlier: Jobs) -> int:
    return sum(not is_same(job, earlier) for job in jobs)


def _limited(
    model: TaskModel, expansion: Expansion, earlier: Jobs, held: Jobs, limit: int, hint: tuple[Job, ...]
) -> Program | None:
    """Return the program of a mode in which at most `limit` jobs move."""
    from halpipe.pipeline.solve.exactmodel import build, exact_tick
    from halpipe.pipeline.solve.exactunits import NamedUnits

    starts = (job.start for jobs in (earlier.values(), held.values(), hint) for job in jobs)
    tick = greatest_common_divisor([exact_tick(expansion), *starts])
    program = build(expansion, model, model.chains, NamedUnits, tick)
    if program is not None:
        for literal in _stay(program, held):
            program.cp.add(literal == 1)
        program.cp.add(expansion.job_count - sum(_stay(program, earlier)) <= limit)
    return program


def is_same(job: Job, earlier: Jobs) -> bool:
    """Return whether a job is where the earlier schedule has it: start, units and version."""
    other = earlier.get((job.task, job.index))
    return other is not None and place(other) == place(job)


def place(job: Job) -> tuple[object, ...]:
    """Return what of a job must be the same for it to stay."""
    return job.start, job.version, frozenset(job.units), job.parts


def _is_numbered(expansion: Expansion, job: Job) -> bool:
    """Return whether a job of a periodic task lies in the periods that its number says, as those of the program do."""
    active = expansion.by_name.get(job.task)
    if active is None or active.task.period is None:
        return True
    period = active.task.period
    late = (job.start - period * job.index) % expansion.hyperperiod
    return ZERO <= late < period + period * active.task.slack


def _stay(program: Program, jobs: Jobs) -> Iterator[Any]:
    """Yield a literal for each job that a schedule has: that the program has it in the same place."""
    units: dict[tuple[str, int], dict[str, list[Any]]] = {}
    form: Any = program.placement
    for job, name, literal in form.units:
        units.setdefault((job.active.name, job.index), {}).setdefault(name, []).append(literal)
    for own in program.tasks.values():
        for job in own:
            before = jobs.get((job.active.name, job.index))
            if before is not None:
                yield _stays(program, job, before, units.get((job.active.name, job.index), {}))


def _stays(program: Program, job: JobVars, before: Job, units: Mapping[str, list[Any]]) -> Any:
    stays = program.literal()
    chosen = [chosen for version, chosen in job.versions if version.name == before.version]
    if not chosen or not all(name in units for name in before.units):
        program.cp.add(stays == 0)
        return stays
    program.cp.add(job.theta == before.start // program.tick).only_enforce_if(stays)
    program.cp.add(chosen[0] == 1).only_enforce_if(stays)
    for name in before.units:
        program.cp.add(sum(units[name]) == 1).only_enforce_if(stays)
    return stays
