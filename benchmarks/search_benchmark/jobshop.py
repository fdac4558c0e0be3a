"""The same sets for PyJobShop, where it can express them: every task runs once, without windows, slack or offsets.

It has no circle: all jobs end by the end of the hyperperiod. Sets that were cut from a schedule in which none passes it
keep a solution. Units that are treated alike are one renewable resource, as the exact engine takes them, and resources
are others in the common denominator of their bounds. What it answers is dealt out to units and verified like all else.
"""

from __future__ import annotations

import math
from importlib.util import find_spec
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO
from halpipe.models import Job, ModeSchedule, Schedule, Status
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.kernel.assign_units import Arc, assign_units
from halpipe.pipeline.solve.lanes import interchangeable_units
from halpipe.pipeline.verify import verify

if TYPE_CHECKING:
    from halpipe.models import TaskModel, Version
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.lanes import UnitGroups

MISSING = "not installed: pip install pyjobshop"
OTHER_RULES = "has rules that it does not know"


def solve(model: TaskModel, seconds: int, workers: int) -> dict[str, Any]:
    """Return its answer and time, which depend on the machine, or why there is none."""
    if find_spec("pyjobshop") is None:
        return {"answer": "none", "reason": MISSING}
    expansion = expand(model, model.modes[0])
    groups = interchangeable_units(expansion, model.units, grouped=True)
    if not _is_expressible(model, expansion, groups):
        return {"answer": "none", "reason": OTHER_RULES}
    begin = perf_counter_ns()
    jobs = _solve(model, expansion, groups, seconds, workers)
    taken = perf_counter_ns() - begin
    if jobs is None:
        return {"answer": "unknown", "ns": taken}
    table = ModeSchedule(
        name=model.modes[0].name, hyperperiod=expansion.hyperperiod, status=Status.VALID, jobs=tuple(jobs)
    )
    schedule = Schedule(model=model.name, model_sha256=model.digest, modes=(table,))
    is_valid = not any(found.is_error for found in verify(model, schedule))
    return {"answer": "feasible" if is_valid else "invalid", "ns": taken}


def _is_expressible(model: TaskModel, expansion: Expansion, groups: UnitGroups) -> bool:
    """Tell whether every job is whole, alone, and free to go anywhere, and whether its versions take one group each."""
    group_of = {name: number for number, names in enumerate(groups) for name in names}
    return not model.chains and all(
        active.jobs == 1
        and active.task.offset is None
        and active.task.deadline is None
        and all(
            not version.precedences
            and not version.split.is_allowed
            and len({group_of[name] for name in version.units}) == 1
            and all(a.start == ZERO and a.end == version.wcet for a in version.accesses)
            for version in active.versions
        )
        for active in expansion.tasks
    )


def _solve(model: TaskModel, expansion: Expansion, groups: UnitGroups, seconds: int, workers: int) -> list[Job] | None:
    import pyjobshop

    tick = natural_tick(expansion)
    total = expansion.hyperperiod // tick
    shop = pyjobshop.Model()
    shop.set_objective(weight_makespan=0)
    capacities = [shop.add_renewable(capacity=len(names)) for names in groups]
    group_of = {name: number for number, names in enumerate(groups) for name in names}
    bounds = {resource.name: _denominator(expansion, resource.name) for resource in model.resources}
    shared = {name: shop.add_renewable(capacity=quanta) for name, quanta in bounds.items()}
    modes: list[tuple[str, Version]] = []
    for active in expansion.tasks:
        task = shop.add_task(latest_end=total)
        for version in active.versions:
            modes.append((active.name, version))
            wants = [(capacities[group_of[version.units[0]]], version.gang)]
            wants += [(shared[a.resource], int(a.bound * bounds[a.resource])) for a in version.accesses]
            length = (version.wcet or ZERO) // tick
            shop.add_mode(task, [want for want, _ in wants], duration=length, demands=[count for _, count in wants])
    found = shop.solve(solver="ortools", time_limit=seconds, display=False, num_workers=workers).best
    if not found.tasks:
        return None
    chosen = [(modes[task.mode], task.start) for task in found.tasks]
    arcs: list[list[Arc]] = [[] for _ in groups]
    for number, ((_, version), start) in enumerate(chosen):
        arcs[group_of[version.units[0]]].append(Arc(number, start, (version.wcet or ZERO) // tick, version.gang))
    units: dict[int, tuple[str, ...]] = {}
    for names, members in zip(groups, arcs, strict=True):
        for number, places in (assign_units(members, len(names), total) or {}).items():
            units[number] = tuple(names[place] for place in places)
    return [
        Job(
            task=name,
            index=0,
            start=tick * start,
            end=tick * start + (version.wcet or ZERO),
            version=version.name,
            units=units.get(number, ()),
        )
        for number, ((name, version), start) in enumerate(chosen)
    ]


def _denominator(expansion: Expansion, resource: str) -> int:
    claims = (a for active in expansion.tasks for version in active.versions for a in version.accesses)
    return math.lcm(*(access.bound.denominator for access in claims if access.resource == resource))
