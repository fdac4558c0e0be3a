"""Witnesses about work that holds a unit in one piece while a chain with a limit needs that unit.

Let X hold the unit for c at a time. A chain's limit leaves its task t no time for the versions that run elsewhere, so
the job of t that the chain goes through runs on the unit, before X or after it. If before, the chain's data come from
too long ago for its readers after X; and no reader may be missing for longer than two of its jobs are apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import Witness
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, TaskModel
    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts, Usable


@record
class _Need:
    """That a chain goes through a job of `task` on `unit` so often that the unit is never without one for `room`.

    Elsewhere the chain would take `elsewhere` at least, or None where the task cannot run elsewhere at all.
    """

    chain: Chain
    limit: str
    task: TaskFacts
    unit: str
    room: int
    elsewhere: int | None


def blockings(facts: ModeFacts, model: TaskModel) -> Iterator[Witness]:
    """Find tasks that hold a unit for longer at a time than a chain can do without it."""
    holders = _holders(facts)
    for chain in model.chains:
        if not all(name in facts.tasks and facts.tasks[name].period for name in chain.tasks):
            continue
        members = [facts.tasks[name] for name in chain.tasks]
        for unit, (holder, length) in holders.items():
            for need in (*_by_age(facts, chain, members, unit), *_by_reaction(facts, chain, members, unit)):
                if need.task is not holder and length > need.room:
                    yield _blocked(facts, holder, length, need)


def _holders(facts: ModeFacts) -> dict[str, tuple[TaskFacts, int]]:
    """Return for every unit the task that certainly holds it longest in one piece."""
    holders: dict[str, tuple[TaskFacts, int]] = {}
    for task in facts.tasks.values():
        length = min(version.piece for version in task.versions)
        for unit in task.sure_units():
            if unit not in holders or length > holders[unit][1]:
                holders[unit] = (task, length)
    return dict(sorted(holders.items()))


def _by_age(facts: ModeFacts, chain: Chain, members: Sequence[TaskFacts], unit: str) -> Iterator[_Need]:
    """Let the last task read data that are at most so old; its jobs are at most D + slack * D apart."""
    if chain.max_age is None:
        return
    limit, last = facts.ticks(chain.max_age), members[-1]
    others = sum(task.least for task in members)
    for task in members[:-1]:
        rest = others - task.least
        there = _there(task, unit, limit - rest)
        if there is not None:
            apart = last.period + (last.late if last.jobs > 1 else 0)
            room = limit + apart - 2 * there - rest
            yield _Need(chain, _text("data age", chain.max_age), task, unit, room, _elsewhere(task, unit, rest))


def _by_reaction(facts: ModeFacts, chain: Chain, members: Sequence[TaskFacts], unit: str) -> Iterator[_Need]:
    """Let the first task write: what it misses is seen by its next job, and must have had its effect in time."""
    if chain.max_reaction is None:
        return
    limit, first = facts.ticks(chain.max_reaction), members[0]
    others = sum(task.least for task in members)
    for task in members[1:]:
        rest = others - task.least
        missed = first.period - first.late
        there = _there(task, unit, limit - rest - missed)
        if there is not None:
            room = limit - 2 * there - rest
            yield _Need(
                chain,
                _text("reaction time", chain.max_reaction),
                task,
                unit,
                room,
                _elsewhere(task, unit, rest + missed),
            )


def _there(task: TaskFacts, unit: str, most: int) -> int | None:
    """Return the least time of a job on the unit; None unless all versions elsewhere take longer than `most`.

    Nor where a job may pause on it: then it may begin before, and end after, what holds the unit.
    """
    on_unit = [version for version in task.versions if _is_on(version, unit)]
    if not on_unit or any(version.pauses for version in on_unit):
        return None
    if any(version.wcet <= most for version in task.versions if not _is_on(version, unit)):
        return None
    return min(version.wcet for version in on_unit)


def _elsewhere(task: TaskFacts, unit: str, rest: int) -> int | None:
    away = [version.wcet for version in task.versions if not _is_on(version, unit)]
    return min(away) + rest if away else None


def _is_on(version: Usable, unit: str) -> bool:
    return unit in version.units and len(version.units) == version.version.gang


def _text(what: str, limit: Duration) -> str:
    return f"{what} of {limit}"


def _blocked(facts: ModeFacts, holder: TaskFacts, length: int, need: _Need) -> Witness:
    held, room = facts.text(length), facts.text(max(0, need.room))
    text = f'"{holder.name}" holds "{need.unit}" for {held} at a time; chain "{need.chain.name}" with its {need.limit} '
    text += f'goes through jobs of "{need.task.name}" on "{need.unit}"'
    if need.elsewhere is not None:
        text += f", since elsewhere it would take {facts.text(need.elsewhere)} at least"
    text += f"; so the next of them must start within {room} after one has ended"
    if need.room <= 0:
        text += ", and whatever holds the unit in between is too long"
    over = facts.text(length - need.room)
    help = (
        f'necessary: {over} less in one piece of "{holder.name}" or more for chain "{need.chain.name}", or another unit'
    )
    path = f'{facts.mode.path} task "{holder.name}"'
    found = codes.UNIT_HELD(text, at=place(holder.task), path=path, help=help)
    return Witness(found, tuple(dict.fromkeys((holder.name, *need.chain.tasks))))
