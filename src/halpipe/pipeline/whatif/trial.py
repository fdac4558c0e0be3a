"""One number in question: from where on it is proven possible, and from where on a schedule is found.

Numbers are counted in steps from the hardest (0). Nothing relies on schedules being found for everything easier than
what one was found for: the answer is what was found, together with what was tried without success.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.options import option, time_limit_of
from halpipe.core.quantities import parse_share, quoted, whole
from halpipe.core.records import record
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.explain import codes as explain_codes
from halpipe.pipeline.explain.changes import more_units
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.solve.codes import NO_OPTION
from halpipe.pipeline.validate import codes as validate_codes
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.context import place
from halpipe.pipeline.whatif import codes

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.models import Access, Split, Task, TaskModel, Version
    from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions

    Rebuild = Callable[[Task, Version], "Version | Unusable"]

LOADS = frozenset(
    code.id
    for code in (
        validate_codes.UNITS_OVERLOADED,
        validate_codes.RESOURCE_OVERLOADED,
        validate_codes.WCET_BEYOND_HYPERPERIOD,
        validate_codes.WCET_BEYOND_DEADLINE,
        validate_codes.BAD_GANG,
        validate_codes.CHAIN_LIMIT_TOO_LOW,
    )
)
"""Findings of validate that depend on the size of the system: they prove that no schedule exists."""

WINDOWS = frozenset((explain_codes.WINDOW_TOO_NARROW.id, explain_codes.WINDOWS_CONTRADICT.id))
"""Witnesses that a shorter WCET may bring about, as windows may count from the end of a job."""


BUDGET = 2_000
"""Moves per task: a tenth of what one schedule is worth: the searches that fail are many, and take the longest."""

TRIES = 5
"""Searches of `size` that fail, roughly: they take the longest."""


def _step(text: str) -> Fraction:
    """Read the grid of an answer: a share above 0 and up to 1."""
    step = parse_share(text)
    if not 0 < step <= 1:
        raise ValueError(f"{quoted(text)} is no step; write a share above 0 and at most 1")
    return step


@record(kw_only=True)
class TrialOptions:
    """Options of questions that are answered by searches."""

    step: Fraction = option(Fraction(1, 100), "Grid of shares and factors.", _step, metavar="SHARE")
    seed: int = option(1, "Same model, options and seed: same bytes.", whole(0), metavar="N")
    budget: int | None = option(
        None, "Moves per task before one search gives up.", whole(1), metavar="N", otherwise=str(BUDGET)
    )
    time_limit: Duration | None = option(
        None,
        "Time after which the answer is what was found by then, such as 30s.",
        time_limit_of,
        metavar="TIME",
        otherwise="none",
    )

    @property
    def is_open(self) -> bool:
        """Whether no end of the searches is stated."""
        return self.budget is None and self.time_limit is None


class TimeUpError(Exception):
    """The time for an answer is over."""


@record
class Search:
    """Search for schedules, and for proofs; with `switches`, tables between the modes must be found as well.

    `on_progress` may end a search, as `go_on` ends the proofs: with `TimeUpError`.
    """

    options: SearchOptions
    on_progress: OnProgress
    go_on: Callable[[], bool]
    switches: bool = False

    def finds(self, changed: Changed) -> bool:
        """Return whether a schedule is found and verified for every mode."""
        if changed.lost:
            return False
        names = tuple(mode.name for mode in changed.model.modes)
        groups = (names,) if self.switches else tuple((name,) for name in names)
        return all(self._finds(changed.model, group) for group in groups)

    def _finds(self, model: TaskModel, modes: tuple[str, ...]) -> bool:
        try:
            scheduled = schedule_model(model, replace(self.options, modes=modes), self.on_progress)
        except HalpipeError as failure:
            errors = {d.code for d in failure.diagnostics if d.is_error}
            if failure.exit is Exit.INFEASIBLE or (errors and errors <= LOADS | {NO_OPTION.id}):
                return False
            raise
        if scheduled.stopped:
            raise TimeUpError
        return scheduled.is_complete and not any(d.is_error for d in scheduled.diagnostics)

    def proves(self, changed: Changed, ignored: frozenset[str]) -> tuple[Diagnostic, ...]:
        """Return what `proofs` finds."""
        if not self.go_on():
            raise TimeUpError
        return proofs(changed, ignored)


def proofs(changed: Changed, ignored: frozenset[str] = frozenset()) -> tuple[Diagnostic, ...]:
    """Return the necessary conditions that a changed model breaks: each proves that it has no schedule."""
    if changed.lost:
        return changed.lost
    loads = tuple(d for d in validate(changed.model) if d.is_error and d.code in LOADS)
    if loads:
        return loads
    witnesses = (w.diagnostic for hopeless in find_witnesses(changed.model) for w in hopeless.witnesses)
    return tuple(d for d in witnesses if d.code not in ignored)


def check_otherwise(model: TaskModel) -> None:
    """Raise `HalpipeError` with the errors of a model that no size removes."""
    wrong = [d for d in validate(model) if d.is_error and d.code not in LOADS]
    if wrong:
        raise HalpipeError(*wrong)


@record
class Bracket:
    """Answer to a question, in steps from the hardest number.

    `possible` is the first that is not proven impossible (None: all are), `witness` the proof against the one before;
    `found` the first with a schedule; `failed` was tried without success. If it `is_cut` short, by its time, more of
    them may be impossible, and others have a schedule.
    """

    possible: int | None
    witness: tuple[Diagnostic, ...] = ()
    found: int | None = None
    failed: tuple[int, ...] = ()
    is_cut: bool = False


def bracket(
    last: int,
    prove: Callable[[int], tuple[Diagnostic, ...]],
    finds: Callable[[int], bool],
    known: int | None = None,
    likely: int = 0,
) -> Bracket:
    """Look for the first of the numbers 0 to `last` that works; of `known` it is known.

    Proofs begin at the number that is `likely` the first without one. `TimeUpError` ends both.
    """
    witnesses: dict[int, tuple[Diagnostic, ...]] = {-1: ()}

    def is_possible(number: int) -> bool:
        witnesses[number] = prove(number)
        return not witnesses[number]

    impossible, possible = neighbours(0, last, is_possible, min(likely, last))
    is_cut = possible - impossible > 1
    if impossible == last:
        return Bracket(None, witnesses[last])
    failed: list[int] = []

    def works(number: int) -> bool:
        if number == known or finds(number):
            return True
        failed.append(number)
        return False

    top = last if known is None else max(impossible + 1, known)
    below, found = (impossible, top + 1) if is_cut else neighbours(possible, top, works)
    return Bracket(
        impossible + 1,
        witnesses[impossible],
        found if found <= top else known,
        tuple(sorted(failed)),
        is_cut or found - below > 1,
    )


def neighbours(first: int, last: int, holds: Callable[[int], bool], likely: int | None = None) -> tuple[int, int]:
    """Return two neighbours in [first - 1, last + 1]: the first does not hold, or is before all; the second does.

    From `likely`, or `first`, steps double until the answer changes, then halve, so that few tries are far from it.
    Where `holds` raises `TimeUpError`, the two are as near as they were by then.
    """
    at, width = first if likely is None else likely, 1
    below, above = first - 1, last + 1
    with suppress(TimeUpError):
        while above - below > 1:
            below, above = (below, at) if holds(at) else (at, above)
            if below == first - 1:
                at = max(first, above - width)
            elif above == last + 1:
                at = min(last, below + width)
            else:
                at = (below + above) // 2
            width *= 2
    return below, above


# ------------------------------------------------------------------------------------------------ models of other sizes
# A version that cannot run at a size is taken out of every mode; it stays in its task, so that names remain known.


@record
class Unusable:
    """A version that cannot run at the size in question: why, and what keeps its place in the task."""

    reason: str
    instead: Version


@record
class Changed:
    """A changed model. `lost` names the tasks that no available version is left for: with any, nothing can work."""

    model: TaskModel
    lost: tuple[Diagnostic, ...] = ()


def with_units(model: TaskModel, type: str, count: int, *, alike: bool = False) -> Changed:
    """Leave or make `count` units of a type: the last are left out, further ones are copies of the first.

    With `alike`, all of them serve every version that may use any, and no interrupts: at least as much as any choice of
    `count` units.
    """
    own = [unit.name for unit in model.units if unit.type == type]
    if alike:
        model = _rebuilt(model, lambda _, v: _with_all(v, own)).model
        units = tuple(replace(unit, interrupts=()) if unit.type == type else unit for unit in model.units)
        model = replace(model, units=units)
    if count > len(own):
        return Changed(more_units(model, own[0], count - len(own)))
    gone = frozenset(own[count:])
    smaller = replace(model, units=tuple(unit for unit in model.units if unit.name not in gone))
    spare = tuple(unit.name for unit in smaller.units)[:1]

    def narrowed(_: Task, version: Version) -> Version | Unusable:
        left = tuple(name for name in version.units if name not in gone)
        if len(left) >= version.gang:
            return replace(version, units=left)
        reason = f"needs {version.gang} unit{'s' if version.gang > 1 else ''} and has {len(left)}"
        return Unusable(reason, replace(version, units=left or spare, gang=1))

    return _rebuilt(smaller, narrowed)


def _with_all(version: Version, names: list[str]) -> Version:
    if not set(names) & set(version.units):
        return version
    return replace(version, units=tuple(dict.fromkeys((*version.units, *names))))


def with_bandwidth(model: TaskModel, resource: str, share: Fraction) -> Changed:
    """Give a resource `share` of its bandwidth: every bound on it grows by 1 / share."""

    def grown(access: Access) -> Access:
        return replace(access, bound=access.bound / share) if access.resource == resource else access

    def rebuild(_: Task, version: Version) -> Version | Unusable:
        changed = replace(version, accesses=tuple(map(grown, version.accesses)))
        if peak_bound(changed, resource) > 1:
            return Unusable(f'claims more of "{resource}" than there is', version)
        return changed

    return _rebuilt(model, rebuild)


def peak_bound(version: Version, resource: str) -> Fraction | int:
    """Return the most that a job of the version claims of a resource at an instant."""
    own = [access for access in version.accesses if access.resource == resource]
    sums = (sum(other.bound for other in own if other.start <= access.start < other.end) for access in own)
    return max(sums, default=0)


def with_factor(model: TaskModel, factor: Fraction) -> Changed:
    """Scale every WCET, and the access phases and pieces with it."""

    def rebuild(task: Task, version: Version) -> Version | Unusable:
        scaled = tuple(replace(a, start=a.start * factor, end=a.end * factor) for a in version.accesses)
        return _if_in_time(task, version, scaled, version.split.scaled(factor), factor)

    return _rebuilt(model, rebuild)


def with_version_factor(model: TaskModel, task: str, version: str, factor: Fraction) -> Changed:
    """Scale the WCET of one version by a factor of at least 1; its access phases and split points stay."""

    def rebuild(owner: Task, own: Version) -> Version | Unusable:
        if (owner.name, own.name) != (task, version):
            return own
        return _if_in_time(owner, own, own.accesses, own.split, factor)

    return _rebuilt(model, rebuild)


def _if_in_time(
    task: Task, version: Version, accesses: tuple[Access, ...], split: Split, factor: Fraction
) -> Version | Unusable:
    wcet = (version.wcet or Duration(0)) * factor
    limit = time_limit(task)
    if limit is not None and wcet > limit:
        return Unusable(f"needs {wcet}, its deadline is {limit}", version)
    return replace(version, wcet=wcet, accesses=accesses, split=split)


def time_limit(task: Task) -> Duration | None:
    """Return the longest WCET that a deadline, or else the period, allows; None for a task on demand.

    Of a task that serves arrivals: what the deadline leaves when it is polled a period after the arrival.
    """
    if task.distance is not None and task.period is not None:
        return max(ZERO, (task.distance if task.deadline is None else task.deadline) - task.period)
    return task.deadline if task.period is not None and task.deadline is not None else task.period


def _rebuilt(model: TaskModel, rebuild: Rebuild) -> Changed:
    """Rebuild every version, and take those that are unusable out of the modes."""
    unusable: dict[tuple[str, str], str] = {}

    def kept(task: Task, version: Version) -> Version:
        made = rebuild(task, version)
        if isinstance(made, Unusable):
            unusable[task.name, version.name] = made.reason
            return made.instead
        return made

    tasks = tuple(replace(task, versions=tuple(kept(task, v) for v in task.versions)) for task in model.tasks)
    changed = replace(model, tasks=tasks)
    return _without(changed, unusable) if unusable else Changed(changed)


def _without(model: TaskModel, unusable: dict[tuple[str, str], str]) -> Changed:
    lost, modes = [], []
    for mode in model.modes:
        runs = []
        for run in mode.runs:
            left = tuple(name for name in run.versions if (run.task, name) not in unusable)
            runs.append(replace(run, versions=left))
            if not left:
                why = "; ".join(f'version "{name}" {unusable[run.task, name]}' for name in run.versions)
                path = about(mode=mode.name, task=run.task)
                lost.append(codes.LAST_VERSION(why, at=place(model.task(run.task)), path=path, help="see the others"))
        modes.append(replace(mode, runs=tuple(runs)))
    return Changed(replace(model, modes=tuple(modes)), tuple(lost))
