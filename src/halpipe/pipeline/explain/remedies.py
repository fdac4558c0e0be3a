"""The smallest change that helps: parameters of the model are relaxed until a schedule is found (MODEL 6).

A schedule that passes verify shows that a change suffices. That a smaller one does not is called proven only where a
witness still holds with it; otherwise no schedule was found with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Subject, about, tasks_named
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models import Status
from halpipe.pipeline.explain import changes, codes
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.parts import is_exact_model
from halpipe.pipeline.solve.exact import Effort, is_installed
from halpipe.pipeline.solve.quantise import quantise, restore
from halpipe.pipeline.solve.relay import solve_after
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.stable import broken
from halpipe.pipeline.validate import validate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, ModeSchedule, Precedence, Task, TaskModel

    Change = Callable[[int], TaskModel]
    """The model changed by a number of steps."""

NANOSECOND = Duration(1)

FINE, COARSE = 100, 20
"""Steps in which a slack is raised, and any parameter of a mode with many jobs: parts of the period or of the WCET."""

MOST_TICKS = 10**6
"""Ticks of a period up to which slacks are looked at on their own grid."""

FEW_JOBS = 500
"""Jobs up to which parameters are relaxed in steps of the tick."""

MAX_UNITS = 3
MAX_PIECES = 16
MAX_TASKS = 6
"""Tasks of a conflict whose own parameters are tried one by one."""

TRIALS = 300
WORK = 400_000
"""Searches for one explanation, and jobs placed in each of them, roughly."""

EXACT_JOBS, EXACT_WORK = 100, 0.5
"""Jobs up to which the exact engine is asked, and its deterministic seconds for each changed model."""

PARTS = 10
"""Parts of the grid in which a WCET is shortened that is too long even as one step of it."""

THOUSAND = 1000

LIMITS = {"max_reaction": "reaction time", "max_age": "data age", "max_latency": "latency"}
"""Limits of a chain, and the figures of a schedule that they bound."""


@dataclass(slots=True)
class Trials:
    """Tries changed models, with times on multiples of `tick`.

    `go_on` is called between searches, and ends them all when it returns False. With `exact`, the exact engine is used
    where the annealer finds nothing.
    """

    mode: str
    jobs: int
    go_on: Callable[[], bool]
    tick: Duration = NANOSECOND
    search: SearchOptions = field(default_factory=SearchOptions)
    exact: bool = True
    left: int = TRIALS

    def step(self, whole: Duration) -> Duration:
        """Return in what steps a time is relaxed by up to `whole`: the tick, or a multiple in a mode of many jobs."""
        return self.tick * (1 if self.jobs <= FEW_JOBS else max(1, -(-whole // (self.tick * COARSE))))

    def schedule(self, model: TaskModel) -> ModeSchedule | None:
        """Return a verified schedule of the mode in a changed model; None where none is found, or effort is spent."""
        if not self.go_on() or any(d.is_error for d in validate(model)):
            return None
        served = self._served(model)
        if served is None or self.is_refuted(model):
            return None
        self.left -= 1
        if self.left < 0:
            return None
        budget = max(20, min(2000, WORK // max(1, self.jobs)))
        try:
            tick = self.search.tick or self._grid(served)
            options = replace(self.search, budget=budget, modes=(self.mode,), tick=tick)
            tables = schedule_model(served, options, lambda *_: self.go_on()).schedule
        except HalpipeError:  # such as numbers that have become too large for the search
            return None
        is_found = all(table.status is Status.VALID for table in tables.modes) and not broken(served, tables)
        found = tables.modes[0] if tables.modes and is_found else self._exactly(served)
        if found is None or self.search.grid is None:
            return found
        return None if broken(model, restore(model, tables.alone((found,)))) else found

    def _served(self, model: TaskModel) -> TaskModel | None:
        """Return a changed model on the grid of the regulators, if any; None where it has no place there."""
        try:
            return model if self.search.grid is None else quantise(model, self.search.grid)
        except HalpipeError:
            return None

    def _exactly(self, model: TaskModel) -> ModeSchedule | None:
        """Return a schedule of the exact engine, whose answer does not depend on the luck of a short search."""
        is_plain = self.search.shipped is None and self.search.tick is None
        if not (self.exact and is_plain and self.jobs <= EXACT_JOBS and is_installed() and is_exact_model(model)):
            return None
        expansion = expand(model, model.mode(self.mode))
        jobs = solve_after(model, expansion, Effort(work=EXACT_WORK, go_on=self.go_on))
        return None if jobs is None else mode_report(model, expansion, jobs, Status.VALID)

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
        served = self._served(model)
        return served is not None and bool(find_witnesses(served, [self.mode]))

    def smallest(self, change: Change, most: int) -> tuple[int, ModeSchedule] | None:
        """Return the least number of steps from 1 to `most` with a schedule, by bisection, and that schedule."""
        found = self.schedule(change(most))
        if found is None:
            return None
        below, enough = 0, most
        while enough - below > 1:
            middle = (below + enough) // 2
            better = self.schedule(change(middle))
            if better is None:
                below = middle
            else:
                enough, found = middle, better
        return enough, found


@record(kw_only=True)
class Remedy:
    """A change with which a schedule was found; `smaller` is the model with one step less."""

    text: str
    subjects: tuple[Subject, ...]
    smaller: TaskModel | None = None
    steps: str = ""

    def reported(self, trials: Trials) -> Diagnostic:
        """Return the note, with what is known of the next smaller change."""
        status = f"found sufficient{f', in steps of {self.steps}' if self.steps else ''}"
        if self.smaller is not None:
            proven = trials.is_refuted(self.smaller)
            status += "; the next smaller step is proven not to suffice" if proven else "; with less, none was found"
        path, help = about(mode=trials.mode), "change the model so, if you can"
        return codes.REMEDY(f"{self.text} ({status})", path=path, help=help, subjects=self.subjects)


@record(kw_only=True)
class Relaxation:
    """A parameter that is relaxed in 1 to `most` steps: the changed model, and the text of a number of steps.

    If no number of steps suffices, `finer` ones are tried, which end where the parameter is next to nothing.
    """

    change: Change
    most: int
    text: Callable[[int], str]
    subjects: tuple[Subject, ...]
    steps: str = ""
    finer: Relaxation | None = None

    def tried(self, trials: Trials) -> Remedy | None:
        """Return the smallest number of steps that suffices; None if none does."""
        found = trials.smallest(self.change, self.most) if self.most > 0 else None
        if found is None:
            return None if self.finer is None else self.finer.tried(trials)
        smaller = self.change(found[0] - 1)
        return Remedy(text=self.text(found[0]), subjects=self.subjects, smaller=smaller, steps=self.steps)


def find_remedies(model: TaskModel, tasks: Sequence[str], trials: Trials) -> list[Diagnostic]:
    """Return what was found to help the mode, given the tasks of its conflict; a note if nothing was."""
    found = [remedy.reported(trials) for remedy in remedies(model, tasks, trials)]
    if not found:
        text = f"none of the single changes tried led to a schedule ({TRIALS - max(0, trials.left)} searches)"
        help = "combine several changes; start with what the findings above call necessary"
        found = [codes.NO_REMEDY(text, path=about(mode=trials.mode), help=help)]
    return found


def remedies(model: TaskModel, tasks: Sequence[str], trials: Trials) -> Iterator[Remedy]:
    """Yield what was found to help the mode, kind by kind."""
    running = {run.task for run in model.mode(trials.mode).runs}
    concerned = [task for task in model.tasks if task.name in (set(tasks) & running or running)]
    yield from _unfrozen(model, concerned, trials)
    yield from _units(model, concerned, trials)
    yield from _limits(model, running, trials)
    yield from _offsets(model, concerned, trials)
    for relaxation in _relaxations(model, concerned, running, trials):
        remedy = relaxation.tried(trials)
        if remedy is not None:
            yield remedy


# ------------------------------------------------------------------------------------------------ units


def _units(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Remedy]:
    """Add units of each kind that the tasks can run on; where no kind alone is enough, of all kinds of the mode."""
    alone = False
    for like, what in _kinds(model, tasks).items():
        change = partial(changes.more_units, model, like)
        for count in range(1, MAX_UNITS + 1):
            if trials.schedule(change(count)) is not None:
                smaller = change(count - 1) if count > 1 else None
                yield Remedy(text=_count(count, what), subjects=(Subject("unit", like),), smaller=smaller)
                alone = True
                break
    if not alone:
        yield from _several_units(model, trials)


def _several_units(model: TaskModel, trials: Trials) -> Iterator[Remedy]:
    """Add units of every kind of the mode, then take away what is not needed."""
    running = {run.task for run in model.mode(trials.mode).runs}
    kinds = _kinds(model, [task for task in model.tasks if task.name in running])

    def widened(added: dict[str, int]) -> TaskModel:
        wider = model
        for like, count in added.items():
            wider = changes.more_units(wider, like, count)
        return wider

    for each in range(1, MAX_UNITS + 1):
        added = dict.fromkeys(kinds, each)
        if trials.schedule(widened(added)) is None:
            continue
        for like in kinds:
            while added[like] and trials.schedule(widened({**added, like: added[like] - 1})):
                added[like] -= 1
        text = " and ".join(_count(count, kinds[like]) for like, count in added.items() if count)
        yield Remedy(text=text, subjects=tuple(Subject("unit", like) for like in kinds))
        return


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


def _count(count: int, what: str) -> str:
    return f"{count} more unit{'s' if count > 1 else ''} {what}"


# ------------------------------------------------------------------------------------------------ fixed jobs, offsets


def _unfrozen(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Remedy]:
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
            yield Remedy(text=f"jobs of {few(group)} that need not stay (freeze)", subjects=tasks_named(group))
            return


def _offsets(model: TaskModel, tasks: list[Task], trials: Trials) -> Iterator[Remedy]:
    """Move the offset of one task, no further than a schedule needs; where none helps alone, free all of them."""
    own = {t.name: t for t in tasks if t.offset is not None and t.period is not None}
    alone = False
    for task in own.values() if len(own) <= MAX_TASKS else ():
        table = trials.schedule(changes.with_task(model, [task.name], offset=None))
        if table is not None:
            alone = True
            free = Remedy(text=f'no fixed offset for "{task.name}"', subjects=tasks_named([task.name]))
            yield _offset(model, task, table, trials).tried(trials) or free
    if own and not alone and trials.schedule(changes.with_task(model, own, offset=None)) is not None:
        yield Remedy(text=f"no fixed offset for {few(list(own))}", subjects=tasks_named(own))


def _offset(model: TaskModel, task: Task, table: ModeSchedule, trials: Trials) -> Relaxation:
    """Move an offset towards where a schedule has the task, the shorter way round its period."""
    period, offset = task.period or ZERO, task.offset or ZERO
    delays = [
        (job.start - period * job.index - offset) % table.hyperperiod for job in table.jobs if job.task == task.name
    ]
    later = min(delays) % period
    earlier = period - later
    unit = trials.step(min(later, earlier))

    def moved(steps: int) -> Duration:
        if later <= earlier:
            return (offset + min(later, unit * steps)) % period
        return (offset - min(earlier, unit * steps)) % period

    return Relaxation(
        change=lambda steps: changes.with_task(model, [task.name], offset=moved(steps)),
        most=-(-min(later, earlier) // unit),
        text=lambda steps: f'offset of "{task.name}" of {moved(steps)} instead of {offset}',
        subjects=tasks_named([task.name]),
        steps=str(unit),
    )


# ------------------------------------------------------------------------------------------------ limits of chains


def _limits(model: TaskModel, running: set[str], trials: Trials) -> Iterator[Remedy]:
    """Take the limits of a chain away, then lower one after the other as far as a schedule keeps them."""
    for chain in model.chains:
        asked = {name: limit for name in LIMITS if (limit := getattr(chain, name)) is not None}
        if not asked or not running.issuperset(chain.tasks):
            continue
        # beyond all that occurs, but stated, so that schedules have the figures
        table = trials.schedule(changes.with_limits(model, chain.name, {n: t * 1000 for n, t in asked.items()}))
        kept = _kept(chain, asked, table)
        if kept is not None:
            yield _lowest(model, chain, asked, kept, trials)


def _kept(chain: Chain, asked: dict[str, Duration], table: ModeSchedule | None) -> dict[str, Duration] | None:
    """Return the least limits not below those asked for that a schedule keeps; None if no data arrives."""
    found = next((each for each in table.chains if each.name == chain.name), None) if table else None
    figures = {name: getattr(found, name.removeprefix("max_")) for name in asked} if found else {}
    return {n: max(asked[n], figures[n]) for n in asked} if figures and None not in figures.values() else None


def _lowest(
    model: TaskModel, chain: Chain, asked: dict[str, Duration], kept: dict[str, Duration], trials: Trials
) -> Remedy:
    """Lower each limit that is kept but higher than asked for, the others as they are."""
    limits, step, smaller = dict(kept), trials.tick, None
    for name, limit in kept.items():
        step = trials.step(limit - asked[name])

        def change(steps: int, name: str = name, limit: Duration = limit, step: Duration = step) -> TaskModel:
            return changes.with_limits(model, chain.name, {**limits, name: min(limit, asked[name] + step * steps)})

        found = trials.smallest(change, -(-(limit - asked[name]) // step)) if limit > asked[name] else None
        if found is not None:
            limits[name] = min(limit, asked[name] + step * found[0])
            smaller = change(found[0] - 1)
    parts = [f"{LIMITS[n]} {limits[n]} instead of {asked[n]}" for n in LIMITS if n in asked and limits[n] > asked[n]]
    text = f'limits of chain "{chain.name}" of {" and ".join(parts)}'
    return Remedy(text=text, subjects=(Subject("chain", chain.name),), smaller=smaller, steps=str(step))


# ------------------------------------------------------------------------------------------------ parameters of tasks


def _relaxations(model: TaskModel, tasks: list[Task], running: set[str], trials: Trials) -> Iterator[Relaxation]:
    """Yield the parameters of the tasks that can be relaxed: of all together, or of few tasks one by one."""
    periodic = [task for task in tasks if task.period is not None]
    yield from (_deadline(model, task, trials) for task in [t for t in periodic if t.deadline][:MAX_TASKS])
    loose = [task.name for task in periodic if task.slack < 1]
    groups = [loose] if len(loose) > 1 else []
    groups += [[name] for name in loose] if len(loose) <= MAX_TASKS else []
    yield from (_slack(model, group, trials) for group in groups)
    blocked = _blocked(model, trials)
    cut = [task for task in tasks if task.name in blocked and not any(v.split.anywhere for v in task.versions)]
    yield from (_pieces(model, task) for task in cut[:MAX_TASKS])
    limited = [t for t in tasks if any(v.split.is_allowed and v.split.max_gaps is not None for v in t.versions)]
    yield from (_gaps(model, task) for task in limited[:MAX_TASKS])
    rows = {(t.name, p.task): p for t in tasks for v in t.versions for p in v.precedences if p.task in running}
    for (task, _), row in list(rows.items())[:MAX_TASKS]:
        yield from _window(model, model.task(task), row, trials)
    if len(tasks) <= MAX_TASKS:
        yield from (_wcet(model, task, trials) for task in tasks)
    else:
        yield _wcets(model, [task.name for task in tasks])


def _deadline(model: TaskModel, task: Task, trials: Trials) -> Relaxation:
    """Move a stated deadline, up to where it no longer matters."""
    deadline, period, longest = task.deadline or ZERO, task.period or ZERO, _longest([task])
    is_split = any(version.split.is_allowed for version in task.versions)
    room = (max(period, longest) if is_split else longest) + period * task.slack - deadline
    unit = trials.step(max(ZERO, room))
    return Relaxation(
        change=lambda steps: changes.with_task(model, [task.name], deadline=deadline + unit * steps),
        most=-(-room // unit),
        text=lambda steps: f'deadline of "{task.name}" of {deadline + unit * steps} instead of {deadline}',
        subjects=tasks_named([task.name]),
        steps=str(unit),
    )


def _slack(model: TaskModel, names: list[str], trials: Trials) -> Relaxation:
    parts = FINE if trials.jobs <= FEW_JOBS else COARSE
    return Relaxation(
        change=lambda steps: changes.with_slack(model, names, Fraction(steps, parts)),
        most=parts,
        text=lambda steps: f"slack of {few(names)} >= {format_rational(Fraction(steps, parts))}",
        subjects=tasks_named(names),
        steps=f"1/{parts}",
    )


def _blocked(model: TaskModel, trials: Trials) -> set[str]:
    """Return the tasks of which a witness says that they find no gap that is long enough."""
    of_gaps = {codes.NO_GAP.id, codes.VERSION_NEVER_FITS.id}
    found = (d for hopeless in find_witnesses(model, [trials.mode]) for d in hopeless.diagnostics if d.code in of_gaps)
    return {next(s.name for s in d.subjects if s.kind == "task") for d in found}


def _pieces(model: TaskModel, task: Task) -> Relaxation:
    """Split a task that does not fit beside another, into as few pieces as possible."""
    return Relaxation(
        change=lambda steps: changes.with_pieces(model, [task.name], steps + 1) if steps else model,
        most=MAX_PIECES - 1,
        text=lambda steps: f'"{task.name}" cut into pieces of at most {_longest([task]) / (steps + 1)} (split)',
        subjects=tasks_named([task.name]),
    )


def _gaps(model: TaskModel, task: Task) -> Relaxation:
    """Allow a preemptive task with a limit of preemptions more of them."""
    limit = max(v.split.max_gaps for v in task.versions if v.split.max_gaps is not None)
    return Relaxation(
        change=partial(changes.with_more_gaps, model, task.name),
        most=MAX_PIECES,
        text=lambda steps: f'max-gaps of "{task.name}" of {limit + steps} instead of {limit}',
        subjects=tasks_named([task.name]),
    )


def _window(model: TaskModel, task: Task, row: Precedence, trials: Trials) -> Iterator[Relaxation]:
    """Open a window at either end: by up to a period of the predecessor, or down to zero."""
    period = model.task(row.task).period or task.period
    if period is None:
        return
    unit = trials.step(period)

    def opened(*, later: Duration = ZERO, earlier: Duration = ZERO) -> TaskModel:
        def widen(row: Precedence) -> Precedence:
            return replace(row, min=max(ZERO, row.min - earlier), max=row.max + later)

        return changes.with_window(model, task.name, row.task, widen)

    text = f'window of "{task.name}" on "{row.task}"'
    named = tasks_named([task.name, row.task])
    yield Relaxation(
        change=lambda steps: opened(later=unit * steps),
        most=-(-period // unit),
        text=lambda steps: f"{text} up to {row.max + unit * steps} instead of {row.max}",
        subjects=named,
        steps=str(unit),
    )
    yield Relaxation(
        change=lambda steps: opened(earlier=unit * steps),
        most=-(-row.min // unit),
        text=lambda steps: f"{text} from {max(ZERO, row.min - unit * steps)} instead of {row.min}",
        subjects=named,
        steps=str(unit),
    )


def _wcet(model: TaskModel, task: Task, trials: Trials) -> Relaxation:
    """Shorten one task to multiples of the grid; where all of them are too long, to parts of it."""
    return _shortened(model, task, trials.tick, _shortened(model, task, trials.tick / PARTS))


def _shortened(model: TaskModel, task: Task, unit: Duration, finer: Relaxation | None = None) -> Relaxation:
    """Shorten one task: its longest version to the next multiple of a unit, then by one unit more with each step."""
    longest = _longest([task])
    most = -(-longest // unit) - 1

    def shortened(steps: int) -> TaskModel:
        if not steps:
            return model
        return changes.with_wcet(model, [task.name], Fraction((unit * (most + 1 - steps)).ns) / longest.ns, unit)

    def text(steps: int) -> str:
        pairs = zip(shortened(steps).task(task.name).versions, task.versions, strict=True)
        return f'WCET of "{task.name}" at most ' + ", ".join(f"{new.wcet} instead of {old.wcet}" for new, old in pairs)

    return Relaxation(
        change=shortened, most=most, text=text, subjects=tasks_named([task.name]), steps=str(unit), finer=finer
    )


def _wcets(model: TaskModel, names: list[str]) -> Relaxation:
    """Shorten many tasks by one factor, which is a multiple of a thousandth."""
    return Relaxation(
        change=lambda steps: changes.with_wcet(model, names, 1 - Fraction(steps, THOUSAND)),
        most=THOUSAND - 1,
        text=lambda steps: f"WCETs of {len(names)} tasks times {format_rational(1 - Fraction(steps, THOUSAND))}",
        subjects=tasks_named(names),
        steps=f"1/{THOUSAND}",
    )


def _longest(tasks: list[Task]) -> Duration:
    return max((version.wcet or ZERO for task in tasks for version in task.versions), default=ZERO)
