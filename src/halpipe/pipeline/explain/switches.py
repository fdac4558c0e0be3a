"""Switches between modes that have schedules: proofs and findings where a table is missing, and the least length."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about, tasks_named
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models import Anchor, Match
from halpipe.pipeline.explain import codes
from halpipe.pipeline.transitions.tables import NO_IMPLIED_TABLE, NO_TABLE

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Task, TaskModel, Transition, Version
    from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions

Pair = tuple[str, str]
Path = tuple[tuple[str, ...], "Duration"]


@record
class Switches:
    """The listed pairs without a table, those of them that are proven to have none, and the findings."""

    missing: tuple[Pair, ...]
    hopeless: tuple[Pair, ...]
    diagnostics: tuple[Diagnostic, ...]


def failed_switches(model: TaskModel, options: SearchOptions, go_on: Callable[[], bool], *, remedies: bool) -> Switches:
    """Schedule all modes and switches as `schedule` does; first prove of which no table is long enough."""
    needs = {(each.source, each.target): need for each in model.transitions if (need := least_length(model, each))}
    short = {pair: need for pair, need in needs.items() if need.is_short}
    scheduled = _scheduled(model, options, go_on)
    found = {(table.source, table.target) for table in scheduled.schedule.transitions}
    missing = [each for each in model.transitions if (each.source, each.target) not in found]
    if scheduled.stopped:  # nothing is known of the others
        missing = [each for each in missing if (each.source, each.target) in short]
    findings = [each for each in scheduled.diagnostics if each.code in (NO_TABLE.id, NO_IMPLIED_TABLE.id)]
    if (scheduled.stopped or not findings) and not short:
        return Switches((), (), ())
    proofs = [need.reported() for need in short.values()]
    findings = [*proofs, *(each for each in findings if each.path not in {proof.path for proof in proofs})]
    for transition in missing if remedies else ():
        if transition.max_length is not None:
            need = needs.get((transition.source, transition.target))
            findings.append(_remedy(model, transition, need, options, go_on))
    return Switches(tuple((each.source, each.target) for each in missing), tuple(short), tuple(findings))


def _scheduled(model: TaskModel, options: SearchOptions, go_on: Callable[[], bool]) -> Scheduled:
    from halpipe.pipeline.checked import schedule_model

    return schedule_model(model, options, lambda *_: go_on())


def _remedy(
    model: TaskModel, transition: Transition, need: Need | None, options: SearchOptions, go_on: Callable[[], bool]
) -> Diagnostic:
    """Look for the shortest table of any length."""
    free = replace(transition, max_length=None)
    others = tuple(free if each is transition else each for each in model.transitions)
    path = about(transition=(transition.source, transition.target))
    tables = _scheduled(replace(model, transitions=others), options, go_on).schedule.transitions
    for table in tables:
        if (table.source, table.target) == (transition.source, transition.target):
            is_least = need is not None and need.length == table.length
            what = "less is proven not to suffice" if is_least else "the shortest table that was found"
            text = f"max-length {table.length} instead of {transition.max_length} (found sufficient: {what})"
            return codes.REMEDY(text, at=transition.at, path=path, help="change the model so, if you can")
    text, help = "no table of any length was found", "allow more slack or wider windows"
    return codes.NO_REMEDY(text, at=transition.at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ proofs


@record
class Need:
    """Least length of every table of a switch, since the first of `tasks`, which enters, must start before the mode."""

    transition: Transition
    length: Duration
    tasks: tuple[str, ...]
    latest: Duration

    @property
    def is_short(self) -> bool:
        """Whether no table of an allowed length is so long."""
        return self.transition.max_length is not None and self.length > self.transition.max_length

    def reported(self) -> Diagnostic:
        """Return the proof that the tables that are allowed are too short."""
        source, target, limit = self.transition.source, self.transition.target, self.transition.max_length
        last = self.tasks[-1]
        text = f'the first job of "{last}" starts at most {self.latest} after mode "{target}" begins; before it run '
        text += f'{few(self.tasks[:-1])}, new in this mode, so that "{self.tasks[0]}" starts '
        text += f"{self.length} before the mode begins at the latest; the table takes at most {limit}"
        help = f'set max-length to at least {self.length}, or give "{last}" a later offset or a shorter window'
        path = about(transition=(source, target))
        return codes.TABLE_TOO_SHORT(
            text, at=self.transition.at, path=path, help=help, subjects=tasks_named(self.tasks)
        )


def least_length(model: TaskModel, transition: Transition) -> Need | None:
    """Return the longest table that entering tasks certainly need; None where they need none.

    The first job of a task with a period starts at most (offset or D) + slack * D after the mode begins. What its
    windows demand of a task that does not run in the mode before has no other jobs than those of table and mode.
    """
    before = {run.task for run in model.mode(transition.source).runs}
    runs = {run.task: frozenset(run.versions) for run in model.mode(transition.target).runs}
    paths: dict[str, Path] = {}
    needs = []
    for task in model.tasks:
        if task.name in runs and task.period is not None and task.distance is None:
            phase = task.period if task.offset is None else task.offset % task.period
            latest = phase + task.period * task.slack
            names, early = _earliest(model, runs, before, task, paths)
            if early > latest:
                needs.append(Need(transition, early - latest, names, latest))
    return max(needs, key=lambda need: need.length, default=None)


def _earliest(
    model: TaskModel, runs: dict[str, frozenset[str]], before: set[str], task: Task, paths: dict[str, Path]
) -> Path:
    """Return the path of entering predecessors to a task that begins longest before its job, and how long."""
    if task.name not in paths:
        found: Path = (task.name,), ZERO
        versions = [version for version in task.versions if version.name in runs[task.name]]
        entering = dict.fromkeys(row.task for v in versions for row in v.precedences if row.task not in before)
        for other in (model.task(name) for name in entering if name in runs):
            least = min((v.wcet or ZERO for v in other.versions if v.name in runs[other.name]), default=ZERO)
            aheads = [_ahead(version, other.name, least) for version in versions]
            if None in aheads:  # a version does without this predecessor
                continue
            ahead = min(time for time in aheads if time is not None)
            names, early = _earliest(model, runs, before, other, paths)
            if ahead + early > found[1]:
                found = (*names, task.name), ahead + early
        paths[task.name] = found
    return paths[task.name]


def _ahead(version: Version, predecessor: str, least: Duration) -> Duration | None:
    """Return how long before a job of this version one of the predecessor starts; None where nothing is certain."""
    plain = [
        row.min + (least if row.anchor is Anchor.END else ZERO)
        for row in version.precedences
        if row.task == predecessor
        and row.to is Anchor.START
        and row.match is Match.WINDOW
        and row.anchor in (Anchor.START, Anchor.END)
    ]
    return max(plain, default=None)
