"""The smallest change that helps: parameters of the model are relaxed until a schedule is found (MODEL 6).

That a change suffices is shown by a schedule that passes verify. That a smaller one does not is called proven only
where a witness still holds with it; otherwise no schedule was found with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Subject, about, tasks_named
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.quantities import format_rational
from halpipe.models import Schedule, Status
from halpipe.pipeline.explain import changes, codes
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.jobs import expand, natural_tick, released_by_offset
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.context import quoted
from halpipe.pipeline.verify import verify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, ModeSchedule, Task, TaskModel

    Change = Callable[[int], TaskModel]
    """The model changed by a number of steps."""

NANOSECOND = Duration(1)

FINE, COARSE = 100, 20
"""Steps in which a slack, a WCET or a window is relaxed: parts of the period or of the WCET."""

TENTHS = 10
"""Parts of a step of the grid in which a WCET is shortened at last."""

MOST_TICKS = 10**6
"""Ticks of a period up to which slacks are looked at on their own grid."""

FEW_JOBS = 500
"""Jobs up to which the steps are fine."""

MAX_UNITS = 3
MAX_PIECES = 16
MAX_TASKS = 6
"""Tasks of a conflict whose own parameters are tried one by one."""

TRIALS = 90
WORK = 400_000
"""Searches for one explanation, and jobs placed in each of them, roughly."""


@dataclass(slots=True)
class Trials:
    """Tries changed models, with times on multiples of `tick`.

    `go_on` is asked between searches, and ends them all when it says no.
    """

    mode: str
    jobs: int
    go_on: Callable[[], bool]
    tick: Duration = NANOSECOND
    search: SearchOptions = field(default_factory=SearchOptions)
    left: int = TRIALS

    @property
    def steps(self) -> int:
        """In how many steps a parameter is relaxed."""
        return FINE if self.jobs <= FEW_JOBS else COARSE

    def step(self, whole: Duration) -> Duration:
        """Return in what steps a time is relaxed by up to `whole`: multiples of the tick."""
        return self.tick * max(1, -(-whole // (self.tick * self.steps)))

    def schedule(self, model: TaskModel) -> ModeSchedule | None:
        """Return a verified schedule of the mode in a changed model; None where none is found, or effort is spent."""
        if not self.go_on() or any(d.is_error for d in validate(model)):
            return None
        if self.is_refuted(model):
            return None
        self.left -= 1
        if self.left < 0:
            return None
        budget = max(20, min(2000, WORK // max(1, self.jobs)))
        try:
            tick = self.search.tick or self._grid(model)
            options = replace(self.search, budget=budget, modes=(self.mode,), tick=tick)
            tables = schedule_model(model, options, lambda *_: self.go_on()).schedule
        except HalpipeError:  # such as numbers that have become too large for the search
            return None
        table = tables.modes[0] if tables.modes else None
        return table if table is not None and _is_valid(model, tables) else None

    def _grid(self, model: TaskModel) -> Duration | None:
        """Return the grid that also divides slacks and deadlines, on which a small one is of use; None if too fine."""
        from halpipe.pipeline.solve.exactmodel import exact_tick

        expansion = expand(model, model.mode(self.mode))
        tick = greatest_common_divisor([exact_tick(expansion), natural_tick(expansion)])
        return (
            tick if self.jobs <= FEW_JOBS and max(t.period or ZERO for t in model.tasks) < tick * MOST_TICKS else None
        )

    def is_refuted(self, model: TaskModel) -> bool:
        """Tell whether a witness proves that a changed model has no schedule."""
        return bool(find_witnesses(model, [self.mode]))

    def blocked(self, model: TaskModel) -> set[str]:
        """Return the tasks of which a witness says that they find no gap that is long enough."""
        of_gaps = {codes.NO_GAP.id, codes.VERSION_NEVER_FITS.id}
        found = (
            d for hopeless in find_witnesses(model, [self.mode]) for d in hopeless.diagnostics if d.code in of_gaps
        )
        return {next(s.name for s in d.subjects if s.kind == "task") for d in found}

    def smallest(self, change: Change, most: int, coarse: int = 1) -> tuple[int, ModeSchedule] | None:
        """Return the least number of steps from 1 to `most` with a schedule, by bisection, and that schedule.

        So many `coarse` steps, of which `most` is a multiple, are tried at once at first.
        """
        found = self.schedule(change(most))
        if found is None:
            return None
        below, enough = 0, most
        for size in dict.fromkeys((coarse, 1)):
            while enough - below > size:
                middle = below + (enough - below) // (2 * size) * size
                better = self.schedule(change(middle))
                if better is None:
                    below = middle
                else:
                    enough, found = middle, better
        return enough, found


def _is_valid(model: TaskModel, schedule: Schedule) -> bool:
    if any(table.status is not Status.VALID for table in schedule.modes):
        return False
    alone = model.alone(*(table.name for table in schedule.modes))
    return not any(d.is_error for d in verify(alone, schedule.alone(schedule.modes)))


def find_remedies(model: TaskModel, tasks: Sequence[str], trials: Trials) -> list[Diagnostic]:
    """Return what was found to help the mode, given the tasks of its conflict; a note if nothing was."""
    running = {run.task for run in model.mode(trials.mode).runs}
    concerned = [task for task in model.tasks if task.name in (set(tasks) & running or running)]
    found = [
        *_unfrozen(model, concerned, trials),
        *_units(model, concerned, trials),
        *_limits(model, running, trials),
        *_offsets(model, concerned, trials),
        *_deadlines(model, concerned, trials),
        *_slack(model, concerned, trials),
        *_pieces(model, concerned, trials),
        *_gaps(model, concerned, trials),
        *_windows(model, concerned, running, trials),
        *_wcets(model, concerned, trials),
    ]
    if not found:
        text = f"none of the single changes tried led to a schedule ({TRIALS - max(0, trials.left)} searches)"
        help = "combine several changes; start with what the findings above call necessary"
        found = [codes.NO_REMEDY(text, path=about(mode=trials.mode), help=help)]
    return found


def _remedy(
    trials: Trials, what: str, subjects: Iterable[Subject], smaller: TaskModel | None, steps: str = ""
) -> Diagnostic:
    """Report a change of some elements; `smaller` is the next smaller one that was tried, in `steps`."""
    status = f"found sufficient{f', {steps}' if steps else ''}"
    if smaller is not None:
        proven = trials.is_refuted(smaller)
        status += "; the next smaller step is proven not to suffice" if proven else "; with less, none was found"
    path, help = about(mode=trials.mode), "change the model so, if you can"
    return codes.REMEDY(f"{what} ({status})", path=path, help=help, subjects=subjects)


# ------------------------------------------------------------------------------------------------ kinds of changes


def _units(model: TaskModel, tasks: list[Task], trials: Trials) -> list[Diagnostic]:
    """Add units of each kind that the tasks can run on; where no kind alone is enough, of several kinds."""
    found = []
    for like, what in _kinds(model, tasks).items():
        for count in range(1, MAX_UNITS + 1):
            if trials.schedule(changes.more_units(model, like, count)) is not None:
                smaller = changes.more_units(model, like, count - 1) if count > 1 else None
                found.append(
                    _remedy(trials, _count_text({like: count}, {like: what}), [Subject("unit", like)], smaller)
                )
                break
    return found or _several_units(model, trials)


def _several_units(model: TaskModel, trials: Trials) -> list[Diagnostic]:
    """Add units of every kind of the mode, then take away what is not needed."""
    running = {run.task for run in model.mode(trials.mode).runs}
    kinds = _kinds(model, [task for task in model.tasks if task.name in running])
    for each in range(1, MAX_UNITS + 1):
        added = dict.fromkeys(kinds, each)
        if trials.schedule(_with(model, added)) is None:
            continue
        for like in kinds:
            while added[like] and trials.schedule(_with(model, {**added, like: added[like] - 1})):
                added[like] -= 1
        return [_remedy(trials, _count_text(added, kinds), [Subject("unit", like) for like in kinds], None)]
    return []


def _with(model: TaskModel, added: dict[str, int]) -> TaskModel:
    for like, count in added.items():
        model = changes.more_units(model, like, count)
    return model


def _kinds(model: TaskModel, tasks: list[Task]) -> dict[str, str]:
    """Return, for every kind of unit that the tasks can run on, one of its units and what to call the kind."""
    used = {name for task in tasks for version in task.versions for name in version.units}
    kinds: dict[object, tuple[str, str]] = {}
    for unit in model.units:
        if unit.name in used:
            users = tuple((t.name, v.name) for t in model.tasks for v in t.versions if unit.name in v.units)
            what = f'of type "{unit.type}"' if unit.type else f'like "{unit.name}"'
            kinds.setdefault(unit.type or users, (unit.name, what))
    return dict(kinds.values())


def _count_text(added: dict[str, int], kinds: dict[str, str]) -> str:
    return " and ".join(
        f"{count} more unit{'s' if count > 1 else ''} {kinds[like]}" for like, count in added.items() if count
    )


def _slack(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Raise the slack of all the tasks together, then of single ones."""
    periodic = [task.name for task in tasks if task.period is not None and task.slack < 1]
    groups = [periodic] if len(periodic) > 1 else []
    groups += [[name] for name in periodic] if len(periodic) <= MAX_TASKS else []
    for names in groups:

        def loosen(step: int, names: list[str] = names) -> TaskModel:
            return changes.with_slack(model, names, Fraction(step, trials.steps))

        found = trials.smallest(loosen, trials.steps)
        if found:
            text = f"slack of {quoted(names)} >= {format_rational(Fraction(found[0], trials.steps))}"
            yield _remedy(trials, text, tasks_named(names), loosen(found[0] - 1), f"in steps of 1/{trials.steps}")


def _pieces(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Split the tasks one by one, into as few pieces as possible; only those that do not fit beside another."""
    blocked = trials.blocked(model)
    concerned = [t for t in tasks if t.name in blocked and not any(v.split.anywhere for v in t.versions)]
    for task in concerned[:MAX_TASKS]:

        def cut(step: int, name: str = task.name) -> TaskModel:
            return changes.with_pieces(model, [name], step + 1)

        found = trials.smallest(cut, MAX_PIECES - 1)
        if found:
            longest = max((v.wcet or ZERO for v in task.versions), default=ZERO) / (found[0] + 1)
            smaller = cut(found[0] - 1) if found[0] > 1 else model
            text = f'"{task.name}" cut into pieces of at most {longest} (split)'
            yield _remedy(trials, text, tasks_named([task.name]), smaller)


def _wcets(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Shorten the tasks one by one, or all of them where they are many."""
    groups = [[task] for task in tasks] if len(tasks) <= MAX_TASKS else [tasks]
    for group in groups:
        names = [task.name for task in group]

        longest = max(v.wcet or ZERO for task in group for v in task.versions)
        unit = trials.step(longest)
        most = (-(-longest // unit) - 1) * TENTHS
        if not most:
            continue

        def factor(step: int, longest: Duration = longest, unit: Duration = unit) -> Fraction:
            return 1 - Fraction((unit * step).ns) / (longest.ns * TENTHS)

        def shorten(step: int, names: list[str] = names, factor: Callable[[int], Fraction] = factor) -> TaskModel:
            return changes.with_wcet(model, names, factor(step))

        found = trials.smallest(shorten, most, TENTHS)
        if found:
            text = _wcet_text(group, factor(found[0]))
            steps = f"in steps of {unit / TENTHS}"
            yield _remedy(trials, text, tasks_named(names), shorten(found[0] - 1), steps)


def _wcet_text(group: list[Task], factor: Fraction) -> str:
    if len(group) > 1:
        return f"WCETs of {len(group)} tasks times {format_rational(factor)}"
    task = group[0]
    times = [f"{(v.wcet or ZERO) * factor} instead of {v.wcet}" for v in task.versions]
    return f'WCET of "{task.name}" at most ' + ", ".join(times)


def _windows(model: TaskModel, tasks: list[Task], running: set[str], trials: Trials) -> Iterator[Diagnostic]:
    """Open the windows of the tasks one by one, by up to a period of the predecessor."""
    rows = {(t.name, p.task): p for t in tasks for v in t.versions for p in v.precedences if p.task in running}
    for (task, predecessor), row in list(rows.items())[:MAX_TASKS]:
        period = model.task(predecessor).period or model.task(task).period
        if period is None:
            continue

        unit, named = trials.step(period), tasks_named([task, predecessor])
        ends = [(changes.with_wider_windows, -(-period // unit), "up to", row.max, unit)]
        if row.min > ZERO:
            ends.append((changes.with_earlier_windows, -(-row.min // unit), "from", row.min, -unit))
        for change, most, which, end, by in ends:
            widen = partial(_widened, model, task, predecessor, unit, change)
            found = trials.smallest(widen, most)
            if found:
                wider = max(ZERO, end + by * found[0])
                text = f'window of "{task}" on "{predecessor}" {which} {wider} instead of {end}'
                yield _remedy(trials, text, named, widen(found[0] - 1), f"in steps of {unit}")


def _widened(
    model: TaskModel,
    task: str,
    predecessor: str,
    unit: Duration,
    change: Callable[[TaskModel, str, str, Duration], TaskModel],
    steps: int,
) -> TaskModel:
    return change(model, task, predecessor, unit * steps)


def _gaps(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Allow split tasks with a limit of gaps more of them, one by one."""
    limited = [t for t in tasks if any(v.split.is_allowed and v.split.max_gaps is not None for v in t.versions)]
    for task in limited[:MAX_TASKS]:
        allow = partial(changes.with_more_gaps, model, task.name)
        found = trials.smallest(allow, MAX_PIECES)
        if found:
            limits = [v.split.max_gaps for v in task.versions if v.split.max_gaps is not None]
            text = f'max-gaps of "{task.name}" of {max(limits) + found[0]} instead of {max(limits)}'
            yield _remedy(trials, text, tasks_named([task.name]), allow(found[0] - 1))


def _unfrozen(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Let the jobs of tasks that have shipped move, one task after the other, then all of the conflict."""
    shipped = trials.search.shipped
    if shipped is None:
        return
    frozen = {job.task for mode in shipped.modes if mode.name == trials.mode for job in mode.jobs}
    names = [task.name for task in tasks if task.name in frozen]
    for group in [*([name] for name in names[:MAX_TASKS]), names]:
        modes = (replace(m, jobs=tuple(job for job in m.jobs if job.task not in group)) for m in shipped.modes)
        freer = replace(trials, search=replace(trials.search, shipped=shipped.alone(tuple(modes))))
        if group and freer.schedule(model) is not None:
            yield _remedy(trials, f"jobs of {quoted(group)} that need not stay (freeze)", tasks_named(group), None)
            return


def _offsets(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    fixed = released_by_offset(model)
    names = [task.name for task in tasks if task.offset is not None and task.name not in fixed]
    groups = [[name] for name in names] if len(names) <= MAX_TASKS else []
    for group in (*groups, names):
        if group and trials.schedule(changes.without_offset(model, group)) is not None:
            yield _remedy(trials, f"no fixed offset for {quoted(group)}", tasks_named(group), None)
            return


def _limits(model: TaskModel, running: set[str], trials: Trials) -> Iterator[Diagnostic]:
    """Take the limits of a chain away, then put them back as close to what is asked as a schedule keeps them."""
    for chain in model.chains:
        limited = (chain.max_reaction, chain.max_age, chain.max_latency) != (None, None, None)
        if not limited or not running.issuperset(chain.tasks):
            continue
        table = trials.schedule(changes.without_limits(model, chain.name))
        found = _kept(chain, table) if table else None
        if found is not None:
            found, step, below = _closest(model, chain, found, trials)
            parts = [f"{what} {limit} instead of {asked}" for what, asked, limit in _raised(chain, found)]
            text = f'limits of chain "{chain.name}" of {" and ".join(parts)}'
            smaller = changes.with_limits(model, chain.name, *below)
            yield _remedy(trials, text, [Subject("chain", chain.name)], smaller, f"in steps of {step}")


Limits = tuple["Duration | None", "Duration | None", "Duration | None"]
"""Of reaction time, data age and latency; None where there is none."""


def _kept(chain: Chain, table: ModeSchedule) -> Limits | None:
    """Return the least limits not below those of the chain that a schedule keeps; None if no data arrives."""
    latency = next((found for found in table.chains if found.name == chain.name), None)
    if latency is None or latency.reaction is None or latency.age is None:
        return None
    if chain.max_latency is not None and latency.latency is None:
        return None
    return (
        None if chain.max_reaction is None else max(chain.max_reaction, latency.reaction),
        None if chain.max_age is None else max(chain.max_age, latency.age),
        None if chain.max_latency is None or latency.latency is None else max(chain.max_latency, latency.latency),
    )


def _closest(model: TaskModel, chain: Chain, found: Limits, trials: Trials) -> tuple[Limits, Duration, Limits]:
    """Halve the way between what is asked and what was found; return what is left, the step, and what is too close."""
    below = asked = (chain.max_reaction, chain.max_age, chain.max_latency)
    steps = [trials.step(far - near) for near, far in zip(asked, found, strict=True) if near and far and far > near]
    step = max(steps, default=trials.tick)
    while (middle := _between(below, found, trials.tick)) not in (below, found) and _is_apart(below, found, step):
        table = trials.schedule(changes.with_limits(model, chain.name, *middle))
        kept = _kept(chain, table) if table else None
        if kept is None:
            below = middle
        else:
            found = kept
            below = tuple(min(one, two) if one and two else None for one, two in zip(below, kept, strict=True))  # type: ignore[assignment]
    return found, step, below


def _between(near: Limits, far: Limits, tick: Duration) -> Limits:
    reaction, age, latency = (
        None if one is None or two is None else one + tick * (((two - one) / 2) // tick)
        for one, two in zip(near, far, strict=True)
    )
    return reaction, age, latency


def _is_apart(near: Limits, far: Limits, step: Duration) -> bool:
    return any(two - one > step for one, two in zip(near, far, strict=True) if one is not None and two is not None)


def _raised(chain: Chain, found: Limits) -> Iterator[tuple[str, Duration, Duration]]:
    """Name the limits that are higher than asked for."""
    asked = (chain.max_reaction, chain.max_age, chain.max_latency)
    for what, one, two in zip(("reaction time", "data age", "latency"), asked, found, strict=True):
        if one is not None and two is not None and two > one:
            yield what, one, two


def _deadlines(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Diagnostic]:
    """Move the stated deadlines of the tasks one by one, up to where they no longer matter."""
    for task in [task for task in tasks if task.deadline is not None and task.period is not None][:MAX_TASKS]:
        deadline, period = task.deadline or ZERO, task.period or ZERO
        longest = max((v.wcet or ZERO for v in task.versions), default=ZERO)
        is_split = any(v.split.is_allowed for v in task.versions)
        room = max(period, longest) + period * task.slack if is_split else period * task.slack + longest
        if room <= deadline:
            continue

        unit = trials.step(room - deadline)

        def later(step: int, name: str = task.name, start: Duration = deadline, by: Duration = unit) -> TaskModel:
            return changes.with_deadline(model, name, start + by * step)

        found = trials.smallest(later, -(-(room - deadline) // unit))
        if found:
            text = f'deadline of "{task.name}" of {deadline + unit * found[0]} instead of {deadline}'
            step = f"in steps of {unit}"
            yield _remedy(trials, text, tasks_named([task.name]), later(found[0] - 1), step)
