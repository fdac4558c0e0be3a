"""The cost function F of the paper (section III), evaluated plainly and exactly.

F = w_ov p_ov + w_ac p_ac + w_pr p_pr + w_u p_u - w_oc p_oc - w_ty p_ty. Penalties are counted so that the
smallest one that is not zero is at least 1, and the bonuses together stay below 1: F <= 0 exactly when no rule
that the cost covers is broken. This is the reference that the kernel's incremental cost is held to.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.models import Anchor, CostTerms, Edge, Match, ModeSchedule, ResourceLoad, Status, UnitLoad
from halpipe.pipeline.jobs import demands_of, expand
from halpipe.pipeline.measure.latency import chain_latencies, members_of, worst_age, worst_latency, worst_reaction
from halpipe.pipeline.measure.margins import largest_margin, least_margin
from halpipe.pipeline.measure.placement import Instants, Interval, Placement, sweep
from halpipe.pipeline.measure.splitting import splitting_cost
from halpipe.pipeline.parts import interrupt_load

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.durations import Duration
    from halpipe.models import Job, Precedence, Schedule, TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.measure.placement import PlacedJob, Step

WEIGHT_OCCUPANCY = Fraction(2, 5)
WEIGHT_TIMELINESS = Fraction(1, 2)
TIMELINESS_DIGITS = 6


def cost_terms(model: TaskModel, placement: Placement) -> CostTerms:
    """Return every term of F; times in ticks, `access` in ticks times share of a resource."""
    overlap = _overlap(placement)
    access = _access_excess(placement)
    precedence = _window_distances(placement) + _missing_demands(placement) + _chain_excess(model, placement)
    precedence += splitting_cost(placement) + _edge_excess(placement)
    unit = _wrong_units(placement)
    occupancy = _empty_units(model, placement)
    timeliness = _timeliness(placement)
    penalty = overlap + access * placement.quanta + precedence + unit
    bonus = WEIGHT_OCCUPANCY * occupancy + WEIGHT_TIMELINESS * timeliness
    return CostTerms(
        total=penalty - bonus,
        overlap=Fraction(overlap),
        access=access,
        precedence=Fraction(precedence),
        unit=Fraction(unit),
        occupancy=occupancy,
        timeliness=timeliness,
    )


def _excess(steps: Iterable[Step], capacity: int) -> int:
    """Return the integral of (level - capacity)+ over the circle."""
    return sum((s.end - s.begin) * (s.level - capacity) for s in steps if s.level > capacity)


def _overlap(placement: Placement) -> int:
    """Return p_ov: on every unit, the time for which more than one job is on it, counted per job too many."""
    by_unit: dict[str, list[Interval]] = {}
    for job in placement.jobs:
        for unit in dict.fromkeys(job.units):
            intervals = by_unit.setdefault(unit, [])
            intervals += [Interval(start, end - start, 1) for start, end in job.occupations()]
    return sum(_excess(sweep(intervals, placement.hyperperiod), 1) for intervals in by_unit.values())


def _access_excess(placement: Placement) -> Fraction:
    """Return p_ac: the integral of (sum of bounds - 1)+ over all resources."""
    return Fraction(sum(_excess(steps, placement.quanta) for steps in placement.claims.values()), placement.quanta)


def _window_distances(placement: Placement) -> int:
    """Return the part of p_pr from precedence: how far the nearest predecessor job lies outside each window.

    Where a predecessor on demand has no job at all, its missing demands count instead.
    """
    anchors: dict[tuple[str, Anchor, Duration | None], Instants] = {}
    total = 0
    for job in placement.jobs:
        for constraint in job.version.precedences:
            if constraint.match is Match.CYCLE:
                total += _cycle_distance(placement, job, constraint)
                continue
            key = (constraint.task, constraint.anchor, constraint.point)
            if key not in anchors:
                anchors[key] = _anchor_instants(placement, *key)
            before = placement.expansion.by_name.get(constraint.task)
            if not anchors[key].times and before is not None and before.task.period is None:
                continue
            low, high = constraint.min // placement.tick, constraint.max // placement.tick
            reached = job.end if constraint.to is Anchor.END else job.start
            total += _distance(anchors[key], reached, low, high, placement.hyperperiod)
    return total


def _anchor_instants(placement: Placement, task: str, anchor: Anchor, point: Duration | None) -> Instants:
    jobs = placement.by_task.get(task, [])
    instants = ((placement.instant(job, anchor, point), n) for n, job in enumerate(jobs))
    return Instants.of(instants, placement.hyperperiod)


def _cycle_distance(placement: Placement, job: PlacedJob, row: Precedence) -> int:
    """Return how far the time from the job of the same cycle lies outside its window (MODEL 10.3)."""
    before, period = placement.expansion.by_name.get(row.task), job.active.task.period
    if before is None or before.task.period is None or period is None:
        return placement.hyperperiod
    index = period * job.index // before.task.period
    others = [other for other in placement.by_task[row.task] if other.index == index]
    low, high = row.min // placement.tick, row.max // placement.tick
    own = (job.end if row.to is Anchor.END else job.start) + placement.lap(job)
    gaps = [own - placement.instant(o, row.anchor, row.point) - placement.lap(o) for o in others]
    return min((max(0, low - gap, gap - high) for gap in gaps), default=placement.hyperperiod)


def _edge_excess(placement: Placement) -> int:
    """Return by how much jobs pass the end of a table with a closed edge, and phases of tasks their first period."""
    total = 0
    if placement.expansion.mode.edge is Edge.CLOSED:
        total += sum(max(0, job.end - placement.hyperperiod) for job in placement.jobs)
    free = [a for a in placement.expansion.tasks if a.task.offset is None and a.name in placement.expansion.in_first]
    return total + sum(_beyond_first(placement, active) for active in free)


def _beyond_first(placement: Placement, active: ActiveTask) -> int:
    """Return by how much the earliest phase that suits all jobs of a task lies beyond its first period."""
    task, jobs = active.task, placement.by_task[active.name]
    if task.period is None or not jobs:
        return 0
    period, slack = task.period // placement.tick, task.period * task.slack / placement.tick
    phase = placement.phases[active.name]
    if phase < period:
        return 0
    due = None if task.distance is not None else (task.deadline or task.period) / placement.tick
    rooms = ((placement.delay(job), slack if due is None else min(slack, due - job.length)) for job in jobs)
    earliest = max(phase + delay - room for delay, room in rooms)
    return max(0, math.floor(earliest) - period + 1) if task.let is None else phase - period + 1


def _distance(anchors: Instants, start: int, low: int, high: int, hyperperiod: int) -> int:
    """Return how far the nearest instant lies outside [start - high, start - low], modulo the hyperperiod."""
    if not anchors.times:
        return hyperperiod
    latest, earliest = start - low, start - high
    before, _ = anchors.at_or_before(latest)
    if before >= earliest:
        return 0
    after, _ = anchors.at_or_after(latest)
    return min(earliest - before, after - latest)


def _missing_demands(placement: Placement) -> int:
    """Return one mean WCET for every demand without its job, and for every demand job without its demand."""
    version_of = {(job.active.name, job.index): job.version for job in placement.jobs}
    counts = {id(version): demands_of(version) for version in version_of.values() if version.precedences}
    wrong = 0
    for active in placement.expansion.tasks:
        for index, demand in enumerate(active.demands):
            demander = version_of.get((demand.task, demand.index))
            wanted = id(demander) in counts and counts[id(demander)][active.name] > demand.slot
            wrong += wanted != ((active.name, index) in version_of)
    return wrong * placement.mean_wcet


def _chain_excess(model: TaskModel, placement: Placement) -> int:
    """Return the part of p_pr from chains: by how much their latencies pass their limits; if endless, one mean WCET."""
    total = 0
    for chain in model.chains:
        limits = (
            (chain.max_reaction, worst_reaction),
            (chain.max_age, worst_age),
            (chain.max_latency, worst_latency),
        )
        members = members_of(placement, chain) if any(limit is not None for limit, _ in limits) else None
        for limit, measure in limits:
            if limit is not None and members is not None:
                latency = measure(members, placement.hyperperiod)
                over = placement.mean_wcet if latency is None else latency - limit // placement.tick
                total += max(0, over)
    return total


def _wrong_units(placement: Placement) -> int:
    """Return p_u: jobs whose unit set their version does not allow, or interrupts fill."""
    return sum(not _allowed(job) for job in placement.jobs)


def _allowed(job: PlacedJob) -> bool:
    chosen = set(job.units)
    is_free = not job.service or interrupt_load(job.service) < 1
    return len(chosen) == len(job.units) == job.version.gang and chosen <= set(job.version.units) and is_free


def _empty_units(model: TaskModel, placement: Placement) -> Fraction:
    """Return p_oc: the share of units without any job."""
    used = {unit for job in placement.jobs for unit in job.units}
    return Fraction(sum(unit.name not in used for unit in model.units), max(1, len(model.units)))


def _timeliness(placement: Placement) -> Fraction:
    """Return p_ty: 1 for a job at its phase, 0 for one that uses all its slack, as mean over the periodic jobs.

    The mean is cut to `TIMELINESS_DIGITS`, because its exact denominator grows with every period and slack.
    """
    total: int | Fraction = 0
    jobs = 0
    for active in placement.expansion.tasks:
        if active.task.period is not None:
            total += _task_timeliness(active, placement)
            jobs += len(placement.by_task[active.name])
    mean = Fraction(total, jobs) if jobs else Fraction(1)
    return Fraction(math.floor(mean * 10**TIMELINESS_DIGITS), 10**TIMELINESS_DIGITS)


def _task_timeliness(active: ActiveTask, placement: Placement) -> int | Fraction:
    """Return the sum of the scores of a task's jobs."""
    jobs = placement.by_task[active.name]
    period = active.task.period
    if period is None or not jobs:
        return 0
    late = map(placement.delay, jobs)
    if not active.task.slack:
        return sum(delta == 0 for delta in late)
    slack = period * active.task.slack / placement.tick
    scores = (max(0, slack.numerator - delta * slack.denominator) for delta in late)
    return Fraction(sum(scores), slack.numerator)


# ------------------------------------------------------------------------------------------------ figures of a report


def mode_report(model: TaskModel, expansion: Expansion, jobs: Iterable[Job], status: Status) -> ModeSchedule:
    """Return the schedule of a mode with all its metrics; jobs by start, task and index."""
    ordered = tuple(sorted(jobs, key=lambda job: (job.start, job.task, job.index)))
    placement = Placement.of(expansion, ordered, model.units)
    is_valid = status is Status.VALID
    return ModeSchedule(
        name=expansion.mode.name,
        hyperperiod=expansion.hyperperiod,
        status=status,
        margin=least_margin(placement) if is_valid else None,
        margin_bound=largest_margin(expansion, model) if is_valid else None,
        jobs=ordered,
        cost=cost_terms(model, placement),
        unit_loads=_unit_loads(model, placement),
        resource_loads=_resource_loads(model, placement),
        chains=chain_latencies(placement, model.chains),
    )


def with_latencies(model: TaskModel, schedule: Schedule) -> Schedule:
    """Return a schedule of the model with all three figures of every chain, also those that it does not state."""
    modes = []
    for table in schedule.modes:
        placement = Placement.of(expand(model, model.mode(table.name)), table.jobs, model.units)
        modes.append(replace(table, chains=chain_latencies(placement, model.chains, complete=True)))
    return replace(schedule, modes=tuple(modes))


def _unit_loads(model: TaskModel, placement: Placement) -> tuple[UnitLoad, ...]:
    ticks = dict.fromkeys((unit.name for unit in model.units), 0)
    for job in placement.jobs:
        for unit in dict.fromkeys(job.units):
            ticks[unit] += sum(end - start for start, end in job.occupations())
    total = placement.expansion.hyperperiod
    busy = {name: placement.tick * count for name, count in ticks.items()}
    return tuple(
        UnitLoad(unit=name, busy=time, share=time / total if total else Fraction(0)) for name, time in busy.items()
    )


def _resource_loads(model: TaskModel, placement: Placement) -> tuple[ResourceLoad, ...]:
    loads = []
    for resource in model.resources:
        steps = placement.claims.get(resource.name, [])
        peak = Fraction(max((step.level for step in steps), default=0), placement.quanta)
        area = Fraction(sum((step.end - step.begin) * step.level for step in steps), placement.quanta)
        mean = area / placement.hyperperiod if steps else Fraction(0)
        loads.append(ResourceLoad(resource=resource.name, peak=peak, mean=mean))
    return tuple(loads)
