"""Transition tables for the allowed mode pairs: the shortest length for which the search finds one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about, error, note, warning
from halpipe.core.records import record
from halpipe.models import Job, Mode, Part, Schedule, Status, Task, TaskModel, Transition, TransitionTable
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.transitions.change import Change, Pace
from halpipe.pipeline.transitions.line import LineJob, on_common_grid
from halpipe.pipeline.transitions.search import Blocked, Table

if TYPE_CHECKING:
    from halpipe.core.durations import Duration

NO_TABLE = error(
    "HAL0410",
    "No transition table found",
    "For a mode pair that the model lists, no table of an allowed length was found. The finding names the task and "
    "the rule that stood in the way of the longest table tried.",
)
NO_IMPLIED_TABLE = warning(
    "HAL0411",
    "Mode pair has no transition table",
    "The model lists no transitions, so every pair may be switched; for this one no table was found, and the switch "
    "must not be performed.",
)

LENGTHS = 400
"""Lengths that are considered for one pair."""

WORK = 60_000
"""Jobs that are placed for one pair, over all lengths, before it is given up."""

MOST_WORK = 400_000
"""Jobs that are placed for one pair, over all lengths, before no shorter table is looked for."""

LEAST_TRIES = 8
"""Lengths that are tried however large the modes are."""

FEW = 64
STEP = 16
"""Of more than a few lengths, only every so many are tried at first."""

ORDERS = 4
"""Times that each job is placed for one length, roughly."""

SPREAD = 4_000
"""Jobs of all pairs together from which processes are worth their start; a job takes about a millisecond."""

FEW_PAIRS = 2
"""Pairs up to which all are searched here: to hand over both modes takes as long as to find an easy table."""

MAY_BE_LONG = note(
    "HAL0416",
    "Transition table may be longer than necessary",
    "The search for a shorter table of this mode pair ended at its limit of work. The table is valid.",
)

Check = Callable[["TaskModel", "Schedule", TransitionTable], bool]
"""Decides whether a table is valid: the independent check of the stages. It may be sent to another process."""

GoOn = Callable[[int, int], bool]
"""Told how many of how many pairs are done; says whether to go on."""


@record
class Switched:
    """The tables found, a finding for every pair without one, and whether the search was stopped before the last."""

    tables: tuple[TransitionTable, ...]
    diagnostics: tuple[Diagnostic, ...]
    failed: tuple[tuple[str, str], ...]
    stopped: bool


@record
class _Cut:
    """A table for which the search of a shorter one ended with the work that it may take."""

    table: TransitionTable


_Result = TransitionTable | Blocked | _Cut | None


@record
class _Pair:
    """One switch to find a table for: the model and the schedule are cut down to its two modes."""

    model: TaskModel
    schedule: Schedule
    transition: Transition
    check: Check

    @property
    def name(self) -> tuple[str, str]:
        return self.transition.source, self.transition.target

    @property
    def jobs(self) -> int:
        return sum(len(mode.jobs) for mode in self.schedule.modes)


def switch_tables(
    model: TaskModel,
    schedule: Schedule,
    check: Check,
    go_on: GoOn = lambda done, total: True,
    workers: Workers | None = None,
    doubtful: tuple[tuple[str, str], ...] | None = None,
    settled: tuple[TransitionTable, ...] = (),
) -> Switched:
    """Find a table for every allowed pair of scheduled modes but the `settled`; `check` has the last word on each.

    If `doubtful` pairs are given, tables for some pairs only are of no use: these are tried first, and the first pair
    without a table ends the search, with no tables at all.
    """
    pairs = _pairs(model, schedule, check)
    kept = {(table.source, table.target): table for table in settled}
    found: dict[int, TransitionTable | Blocked] = {n: kept[p.name] for n, p in enumerate(pairs) if p.name in kept}
    order = [number for number in range(len(pairs)) if number not in found]
    order.sort(key=lambda number: pairs[number].name not in (doubtful or ()))
    is_stopped, notes = False, list[Diagnostic]()
    for number, result in zip(order, _results([pairs[n] for n in order], go_on, workers or Workers()), strict=False):
        if result is None:
            is_stopped = True
            break
        if isinstance(result, _Cut):
            result = result.table
            pair, help = pairs[number], f"state a max-length below {result.length}"
            text = f"the search for one shorter than {result.length} ended after {MOST_WORK} placed jobs"
            notes.append(MAY_BE_LONG(text, at=pair.transition.at, path=about(transition=pair.name), help=help))
        found[number] = result
        if isinstance(result, Blocked) and doubtful is not None:
            break
    tables = tuple(table for _, table in sorted(found.items()) if isinstance(table, TransitionTable))
    blocked = {number: result for number, result in sorted(found.items()) if isinstance(result, Blocked)}
    return Switched(
        () if blocked and doubtful is not None else tables,
        (*notes, *(_failure(model, pairs[number].transition, result) for number, result in blocked.items())),
        tuple(pairs[number].name for number in blocked),
        is_stopped,
    )


def _pairs(model: TaskModel, schedule: Schedule, check: Check) -> list[_Pair]:
    scheduled = {mode.name: mode for mode in schedule.modes if mode.status is Status.VALID}
    tasks = {task.name: task for task in model.tasks}
    named = {mode.name: _named_in(tasks, mode) for mode in model.modes}
    pairs = []
    for pair in model.allowed_transitions():
        if pair.source in scheduled and pair.target in scheduled:
            tables = (scheduled[pair.source], scheduled[pair.target])
            names = named[pair.source] | named[pair.target]
            alone = replace(
                model.alone(pair.source, pair.target, transitions=(pair,)),
                tasks=tuple(task for task in model.tasks if task.name in names),
                chains=tuple(chain for chain in model.chains if names.issuperset(chain.tasks)),
            )
            pairs.append(_Pair(alone, schedule.alone(tables), pair, check))
    return pairs


def _named_in(tasks: dict[str, Task], mode: Mode) -> set[str]:
    """Return the tasks that run in a mode, and those that their constraints name."""
    names, waiting = set[str](), [run.task for run in mode.runs]
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting += (row.task for version in tasks[name].versions for row in version.precedences)
    return names


def _results(pairs: list[_Pair], go_on: GoOn, workers: Workers) -> Iterator[_Result]:
    """Yield what comes of every pair; None for the first that is not finished."""
    total = len(pairs)
    is_spread = workers.count > 1 and total > FEW_PAIRS and sum(pair.jobs for pair in pairs) >= SPREAD
    if is_spread:
        yield from workers.spread(_shortest, pairs, lambda done: go_on(done, total))
        return
    for number in range(total):
        if not go_on(number, total):
            yield None
            return
        yield _shortest(pairs[number], partial(go_on, number, total))


def _shortest(pair: _Pair, go_on: Callable[[], bool] = lambda: True) -> _Result:
    """Return the shortest table that is found: where one length works, most longer ones do.

    So some lengths are tried from short to long, then some just below the first that works; the rest only if none
    does.
    """
    search = _Search(pair, go_on)
    lengths = search.possible()
    coarse = range(0, len(lengths), _step(len(lengths), pair.jobs))
    rest = [index for index in range(len(lengths)) if index not in coarse]
    index = next((index for index in (*coarse, *rest) if search.tries(lengths[index])), -1)
    if search.table is None or search.is_stopped:
        return None if search.is_stopped else search.blocked
    is_shortest = coarse.step == 1 or search.shorten(lengths[max(0, index - coarse.step) : index + 1])
    return None if search.is_stopped else search.table if is_shortest else _Cut(search.table)


def _step(lengths: int, jobs: int) -> int:
    """Return which lengths to try at first, every so many: as many of them as can be afforded."""
    if lengths <= FEW:
        return 1
    affordable = max(LEAST_TRIES, WORK // (ORDERS * max(1, jobs)))
    return max(STEP, -(-lengths // affordable))


class _Search:
    """The lengths tried for one pair, and what came of them; `table` is the shortest that was found and checked."""

    def __init__(self, pair: _Pair, go_on: Callable[[], bool]) -> None:
        self._pair = pair
        self._go_on = go_on
        self._change = Change(*on_common_grid(pair.model, *pair.schedule.modes))
        self._count = self._work = 0
        self.is_stopped = False
        self.table: TransitionTable | None = None
        self.blocked = Blocked("", "no length is allowed")

    def possible(self) -> list[int]:
        """Return the lengths with which no task must starve."""
        lengths = []
        kinds: dict[tuple[int, int, int], Pace] = {}
        for pace in self._change.paces:  # thousands of tasks have few kinds, and lengths are many
            kinds.setdefault((pace.first - pace.last, pace.most, pace.shortest), pace)
        for length in _lengths(self._pair.transition, self._change):
            starving = next((pace.task for pace in kinds.values() if not pace.can_be_kept(length)), None)
            if starving is None:
                lengths.append(length)
            else:
                self.blocked = Blocked(starving, "would not start often enough")
        return lengths

    def tries(self, length: int) -> bool:
        """Try to find a table of a length that passes the check, unless enough was tried; return whether it worked."""
        is_spent = self._count >= LEAST_TRIES and self._work > WORK
        table = None if is_spent else self._table(length)
        return table is not None and self._takes(table)

    def shorten(self, lengths: list[int]) -> bool:
        """Look for a table between the last of `lengths`, which works, and the first, by halves; have it checked.

        Return whether that was finished with the work that one pair may take.
        """
        found: list[TransitionTable] = []
        below, works = 0, len(lengths) - 1
        while works - below > 1 and self._work <= MOST_WORK:
            middle = (below + works) // 2
            table = self._table(lengths[middle])
            if table is None:
                below = middle
            else:
                found, works = [table, *found], middle
        any(self._takes(table) for table in found)
        return works - below <= 1

    def _table(self, length: int) -> TransitionTable | None:
        self.is_stopped = self.is_stopped or not self._go_on()
        if self.is_stopped:
            return None
        attempt = Table(self._change, length)
        jobs = attempt.fill()
        self._count, self._work = self._count + 1, self._work + attempt.work
        if isinstance(jobs, Blocked):
            self.blocked = jobs if jobs.progress >= self.blocked.progress else self.blocked
            return None
        return _named(self._pair.transition, self._change, length, jobs)

    def _takes(self, table: TransitionTable) -> bool:
        if not self._pair.check(self._pair.model, self._pair.schedule, table):
            self.blocked = Blocked("", "a chain limit or another rule that only the whole line shows", progress=2)
            return False
        self.table = table
        return True


def _lengths(pair: Transition, change: Change) -> list[int]:
    """Return the lengths to try: those at which something begins or ceases to fit, and an even grid up to the limit."""
    last = _longest(pair.max_length, change)
    least = change.least[0]
    if least > last:
        return [last]  # the one that says what is in the way
    exact = {least}
    for pace in change.paces:
        gap = pace.first - pace.last
        parts = gap // pace.most + 1
        exact.update((parts * pace.most - gap, (parts + 1) * pace.most - gap))
        exact.update(number * pace.shortest - pace.first for number in (1, 2, 3))
    starts = sorted({job.start for job in change.after.jobs})[:LENGTHS]
    for end in sorted({job.end for job in change.tail}, reverse=True)[: LENGTHS // 4]:
        exact.update(end - start for start in starts)
    for job, window in change.open_windows[:LENGTHS]:
        at = change.newest_before(window)
        if at is not None:  # the least and the greatest length for which that predecessor lies in the window
            exact.update((at + window.low - job.start, at + window.high - job.start))
    wanted = sorted(length for length in exact if least <= length <= last)[:LENGTHS]
    step = max(1, (last - least) // LENGTHS)
    return sorted({*wanted, *range(least, last + 1, step)})


def _longest(limit: Duration | None, change: Change) -> int:
    """Return the stated limit in ticks; without one, room for a cycle of each mode and its longest job."""
    before, after = change.before, change.after
    if limit is not None:
        return limit // before.tick
    longest = max((shape.length for shapes in after.shapes.values() for shape in shapes), default=0)
    return before.hyperperiod + after.hyperperiod + longest


def _named(pair: Transition, change: Change, length: int, jobs: tuple[LineJob, ...]) -> TransitionTable:
    tick = change.after.tick
    return TransitionTable(
        source=pair.source,
        target=pair.target,
        length=tick * length,
        worst_latency=tick * (change.before.hyperperiod + length),
        status=Status.VALID,
        jobs=tuple(_job(job, tick) for job in sorted(jobs)),
    )


def _job(job: LineJob, tick: Duration) -> Job:
    parts = (
        Part(
            start=tick * (job.start + part.start),
            end=tick * (job.start + part.end),
            executed_from=tick * part.begun,
            executed_to=tick * part.done,
        )
        for part in job.shape.parts
    )
    return Job(
        task=job.task,
        index=job.index,
        start=tick * job.start,
        end=tick * job.end,
        version=job.shape.version,
        units=job.units,
        parts=tuple(parts),
    )


def _failure(model: TaskModel, pair: Transition, blocked: Blocked) -> Diagnostic:
    code = NO_TABLE if model.transitions else NO_IMPLIED_TABLE
    who = f'task "{blocked.task}": ' if blocked.task else "of "
    return code(
        f"no table found; the closest try failed because {who}{blocked.rule}",
        at=pair.at,
        path=about(transition=(pair.source, pair.target)),
        help="allow a longer table, more slack or wider windows, or another --seed",
    )
