"""Independent groups of tasks of a large mode, each searched alone, so that a hard one does not hold up the others.

Tasks are of one group that share a unit, a resource, a window, a demand or a chain with a limit. Every group first gets
a few moves, then those without a schedule the whole budget. What a group gets depends on the group alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import about
from halpipe.core.grouping import grouped
from halpipe.core.suggest import few
from halpipe.models import Status
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.solve.codes import GROUP_NOT_FOUND
from halpipe.pipeline.solve.construction import Groups

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, Task, TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.one_mode import Found
    from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions

    Search = Callable[[TaskModel, Expansion, SearchOptions, str, OnProgress], Found]

FIRST_BUDGET = 2000
"""Moves per task that each group gets at first."""

MOST_NAMED = 8
"""Tasks and units of a group that are named."""


def independent_groups(model: TaskModel, expansion: Expansion) -> list[Expansion]:
    """Return the groups of a mode as modes of their own, by their first tasks."""
    runs = {run.task: run for run in expansion.mode.runs}
    found = []
    for tasks in linked_tasks(expansion, model.chains).values():
        mode = replace(expansion.mode, runs=tuple(runs[active.name] for active in tasks))
        found.append(replace(expansion, mode=mode, tasks=tuple(tasks)))
    return found


def linked_tasks(expansion: Expansion, chains: Iterable[Chain] = ()) -> dict[str, list[ActiveTask]]:
    """Return the tasks of every group by the name of one of them."""
    groups = Groups[str]()
    owner: dict[tuple[str, str], str] = {}
    for active in expansion.tasks:
        for shared in _shared(active):
            groups.join(active.name, owner.setdefault(shared, active.name))
        for other in _linked(active, expansion):
            groups.join(active.name, other)
    for chain in filter(_is_limited, chains):
        if all(name in expansion.by_name for name in chain.tasks):
            for name in chain.tasks:
                groups.join(name, chain.tasks[0])
    return grouped((groups.root(active.name), active) for active in expansion.tasks)


def _shared(active: ActiveTask) -> Iterator[tuple[str, str]]:
    for version in active.versions:
        yield from (("unit", name) for name in version.units)
        yield from (("resource", access.resource) for access in version.accesses)


def _linked(active: ActiveTask, expansion: Expansion) -> Iterator[str]:
    for version in active.versions:
        yield from (row.task for row in version.precedences if row.task in expansion.by_name)
    yield from (demand.task for demand in active.demands)


def _is_limited(chain: Chain) -> bool:
    return (chain.max_latency, chain.max_reaction, chain.max_age) != (None, None, None)


def search_groups(
    model: TaskModel,
    expansion: Expansion,
    groups: list[Expansion],
    options: SearchOptions,
    on_progress: OnProgress,
    search: Search,
) -> Found:
    """Search every group and put the tables together; name the groups without a schedule."""
    progress = _Progress(on_progress, [options.moves(len(group.tasks)) for group in groups])
    # The first round is quickly repeated: to save the states of thousands of groups would take longer.
    few = replace(options, budget=min(FIRST_BUDGET, options.budget or FIRST_BUDGET), keeper=None)
    found: list[Found] = []
    models = _narrowed(model, groups)
    for key, chosen in (("first", few), ("group", options)):
        numbers = [n for n in range(len(groups)) if not found or found[n].table.status is not Status.VALID]

        def searched(number: int, key: str = key, chosen: SearchOptions = chosen) -> Found:
            its = replace(chosen, spare=chosen.spare // len(groups))
            return search(models[number], groups[number], its, f"{key}{number}", partial(progress.report, number))

        for number, each in zip(numbers, options.workers.each(searched, numbers), strict=True):
            before = found[number].moves if len(found) == len(groups) else 0
            found[number : number + 1] = [replace(each, moves=each.moves + before)]
        if progress.is_stopped or few.budget == options.budget:
            break
    return _together(model, expansion, groups, found)


def _narrowed(model: TaskModel, groups: list[Expansion]) -> list[TaskModel]:
    """Return the models of the groups alone: their tasks in their mode, their units and resources, their chains."""
    group_of = {("task", active.name): number for number, group in enumerate(groups) for active in group.tasks}
    for number, group in enumerate(groups):
        group_of |= {shared: number for active in group.tasks for shared in _shared(active)}
    owned: dict[tuple[str, int | None], list[Any]] = {}
    for kind, elements in (("unit", model.units), ("resource", model.resources)):
        for each in elements:
            owned.setdefault((kind, group_of.get((kind, each.name))), []).append(each)
    for chain in model.chains:
        numbers = {group_of.get(("task", name)) for name in chain.tasks}
        owned.setdefault(("chain", numbers.pop() if len(numbers) == 1 else None), []).append(chain)
    places = enumerate(model.tasks)
    idle = {task.name: (place, task) for place, task in places if ("task", task.name) not in group_of}
    return [
        replace(
            model,
            units=tuple(owned.get(("unit", number), ())),
            resources=tuple(owned.get(("resource", number), ())),
            tasks=(*(active.task for active in group.tasks), *_named_of(group, idle)),
            chains=tuple(owned.get(("chain", number), ())),
            modes=(group.mode,),
            transitions=(),
            health=(),
        )
        for number, group in enumerate(groups)
    ]


def _named_of(group: Expansion, idle: Mapping[str, tuple[int, Task]]) -> list[Task]:
    """Return the tasks, of those that do not run in the mode, that versions of a group name, in the model's order."""
    rows = (row.task for active in group.tasks for version in active.task.versions for row in version.precedences)
    found = {idle[name][0]: idle[name][1] for name in rows if name in idle}
    return [found[place] for place in sorted(found)]


class _Progress:
    """Reports of all groups as those of one search; what one of them is answered, all are."""

    def __init__(self, on_progress: OnProgress, allowed: list[int]) -> None:
        self._tell = on_progress
        self._lock = Lock()
        self._allowed = sum(allowed)
        self._made = [0] * len(allowed)
        self._costs = [-1] * len(allowed)
        self._moves, self._cost, self._open = 0, -len(allowed), len(allowed)
        self.is_stopped = False

    def report(self, number: int, mode: str, moves: int, _allowed: int, cost: int) -> bool:
        """Pass on the moves of all groups, and their cost once every group has one."""
        with self._lock:  # sums are kept, since there are as many reports as groups, and more
            self._moves += moves - self._made[number]
            self._cost += cost - self._costs[number]
            self._open += (cost < 0) - (self._costs[number] < 0)
            self._made[number], self._costs[number] = moves, cost
            made, whole = self._moves, -1 if self._open else self._cost
        if not self.is_stopped:
            self.is_stopped = not self._tell(mode, made, self._allowed, whole)
        return not self.is_stopped


def _together(model: TaskModel, expansion: Expansion, groups: list[Expansion], found: list[Found]) -> Found:
    failed = [group for group, each in zip(groups, found, strict=True) if each.table.status is not Status.VALID]
    jobs = tuple(job for each in found for job in each.table.jobs)
    notes = list({str(each): each for part in found for each in part.diagnostics}.values())
    stopped = any(each.stopped for each in found)
    notes += [] if len(failed) == len(groups) else [_named(expansion, group, len(groups)) for group in failed]
    return replace(
        found[0],
        table=mode_report(model, expansion, jobs, Status.NOT_FOUND if failed else Status.VALID),
        diagnostics=notes,
        moves=sum(each.moves for each in found),
        stopped=stopped,
        unimproved=any(each.unimproved for each in found),
        engine=", ".join(sorted({each.engine for each in found})),
    )


def _named(expansion: Expansion, group: Expansion, count: int) -> Diagnostic:
    """Name the tasks and units of a group without a schedule."""
    units = dict.fromkeys(unit for active in group.tasks for version in active.versions for unit in version.units)
    tasks = [active.name for active in group.tasks]
    text = f"one of {count} independent groups has no schedule yet: {_list('task', tasks)} on {_list('unit', [*units])}"
    help = "ask `halpipe explain`, or relax these tasks; all other groups have a schedule or are named, too"
    return GROUP_NOT_FOUND(text, at=group.tasks[0].task.at, path=about(mode=expansion.mode.name), help=help)


def _list(kind: str, names: list[str]) -> str:
    return f"{kind}{'s' if len(names) > 1 else ''} {few(names, MOST_NAMED, quote='')}"
