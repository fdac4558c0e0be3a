"""Schedule of one mode: choice of the engine, fixed jobs and options, and the reported result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, about
from halpipe.core.durations import greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.models import WHOLE, Binding, ModeSchedule, Status
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.measure.margins import largest_margin, least_margin
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.parts import has_whole_jobs
from halpipe.pipeline.solve.codes import CANNOT_STAY, EXACT_ABSENT, EXACT_KEEPS_NOTHING, OTHER_ANSWERED, TOO_LARGE
from halpipe.pipeline.solve.limits import check_tick, cut_options, refuse_stuck, stated_problem
from halpipe.pipeline.solve.optimise import POLISH_BUDGET, Finished, polish_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule, TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.edf.plans import Plan
    from halpipe.pipeline.solve.edf.search import Found as Tabled
    from halpipe.pipeline.solve.edf.works import Mode
    from halpipe.pipeline.solve.kernel.search import Outcome, Search, Turns
    from halpipe.pipeline.solve.kernel.slices import OnSlice
    from halpipe.pipeline.solve.kernel.warmstart import Earlier
    from halpipe.pipeline.solve.kernel.widen import Begin, Run, Wider
    from halpipe.pipeline.solve.lanes import Pins
    from halpipe.pipeline.solve.optimise import Polish, Reached
    from halpipe.pipeline.solve.problem import Problem
    from halpipe.pipeline.solve.relay import Turn
    from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions

ANNEAL, EXACT = "anneal", "exact"
"""The engines by their names in a schedule."""

CONSTRUCTING = -1
"""Stands for the best cost while there is no whole placement yet."""

EXACT_JOBS = 200
"""Jobs of a mode up to which the exact engine, where it is installed, takes turns with the annealer."""

TURN_SEED = 1000
"""Between the seeds of the turns of an engine; within one, it counts on from its own."""

FEW_TASKS = 200
"""Tasks of a mode up to which its independent groups are searched together: a few moves more."""

MOST_PARTS = 8
"""Parts of a tick at which jobs may start where `margin` is the first objective."""

SHARE = 20
"""A margin takes so many times fewer moves than the search for the valid schedule, if that was long."""

THOROUGH = 100
"""A margin that is asked for takes so many times more placements than one for which no objective is stated."""

POLISH_TABLES, MARGIN_TABLES, ANY_TABLES = 4000, 20, 6000
"""Whole tables of preemptive jobs tried to improve a valid one, for a margin with little effort, and for any at all."""

SOON = 8
"""Part of the preemptive jobs that are placed before a table that splits no job is looked for."""

WHOLE_BUDGET = 2000
"""Moves per task to look for such a table."""

TABLED_SHARE, TABLED_UNIT = 40, 10
"""For a margin, so many times fewer preemptive jobs are placed than others; a tenth of a table stands for a move."""


@record
class Found:
    """Result of one mode."""

    table: ModeSchedule
    diagnostics: list[Diagnostic]
    moves: int = 0
    stopped: bool = False
    unimproved: bool = False
    engine: str = ANNEAL
    reached: tuple[Reached, ...] = ()


def schedule_mode(
    model: TaskModel,
    expansion: Expansion,
    options: SearchOptions,
    number: int,
    on_progress: OnProgress,
    earlier: Earlier,
) -> Found:
    """Search a schedule for a mode, the `number`-th of the search; `earlier` says where other modes have its tasks."""
    of_mode: type[_Search] = _WholeJobs
    if options.engine == EXACT:
        of_mode = _Exact
    elif any(version.split.is_allowed for active in expansion.tasks for version in active.versions):
        of_mode = _SplitJobs

    def search(its: TaskModel, part: Expansion, chosen: SearchOptions, key: str, tell: OnProgress) -> Found:
        return of_mode(its, part, chosen, number, tell, earlier, key).found()

    if options.engine != EXACT and not options.optimise and len(expansion.tasks) > FEW_TASKS:
        from halpipe.pipeline.solve.groups import independent_groups, search_groups

        groups = independent_groups(model, expansion)
        if len(groups) > 1:
            return search_groups(model, expansion, groups, options, on_progress, search)
    return search(model, expansion, options, "", on_progress)


@dataclass(frozen=True)
class _Search:
    """One mode, and all that its search depends on."""

    model: TaskModel
    expansion: Expansion
    options: SearchOptions
    number: int
    on_progress: OnProgress
    earlier: Earlier
    part: str = ""
    """Of a mode that is searched in groups, which of them this is."""

    def found(self) -> Found:
        """Search."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """The mode's name."""
        return self.expansion.mode.name

    @property
    def seed(self) -> int:
        """A seed for this mode and attempt alone."""
        return self.options.seed + self.number * 0x5DEECE66D + self.options.attempt * 0x2545F4914F

    @cached_property
    def start_tick(self) -> Duration | None:
        """The tick that is asked for, or the window of a grid on which some time of the mode does not lie."""
        tick, window = self.options.tick, self.options.window
        if tick is not None or window is None:
            return tick
        from halpipe.pipeline.solve.exactmodel import exact_tick

        return window if exact_tick(self.expansion) % window else None

    @cached_property
    def pinned(self) -> dict[str, Pins]:
        """The units that tasks bound in the whole system may use, where other modes narrow them and some are left."""
        found = [(active, self.earlier.pins.get(active.name, {})) for active in self.expansion.tasks]
        return {
            active.name: pins
            for active, pins in found
            if any(len(pins[v.gang].intersection(v.units)) >= v.gang for v in active.versions if v.gang in pins)
        }

    @cached_property
    def shipped(self) -> dict[tuple[str, int], Job]:
        """The jobs of this mode that have shipped and may stay, by task and index; of tasks that still run here."""
        return {key: job for key, job in self._all_shipped.items() if job.task not in self.unkept}

    @cached_property
    def _all_shipped(self) -> dict[tuple[str, int], Job]:
        modes = self.options.shipped.modes if self.options.shipped is not None else ()
        jobs = (job for mode in modes if mode.name == self.name for job in mode.jobs)
        return {(job.task, job.index): job for job in jobs if job.task in self.expansion.by_name}

    @cached_property
    def unkept(self) -> dict[str, str]:
        """The tasks that have shipped and cannot stay for a reason outside of the mode, with the reason."""
        tick, bound = self.options.tick, units_of_bound(self.model, self.options.shipped)
        names = dict.fromkeys(task for task, _ in self._all_shipped)
        found = {name: "it is bound to one unit set in all modes" for name in names if not bound.get(name, {name})}
        jobs = (job for job in self._all_shipped.values() if tick is not None and job.start % tick)
        return found | {job.task: "it starts between the ticks" for job in jobs}

    @cached_property
    def polish(self) -> Polish | None:
        """The improvement of a valid schedule; None without objectives."""
        if not self.options.optimise:
            return None
        options, tell = self.options, partial(self.options.on_better, self.name)
        goals = self.options.optimise
        return polish_of(self.model, self.expansion, goals, options.target, self.seed + 1, tell, options.budget)

    @property
    def kept(self) -> Kept | None:
        """The part of a checkpoint that has this search."""
        keeper = self.options.keeper
        return None if keeper is None else keeper.stage(f"{self.options.attempt}/{self.number}{self.part}")

    def finished(self, jobs: tuple[Job, ...], seed: int, go_on: Callable[[], bool], *, is_free: bool) -> Finished:
        """Return valid jobs with what they reach of the objectives, or better ones; see `optimise.finish`."""
        if self.polish is None:
            return Finished(jobs)
        from halpipe.pipeline.solve.optimise import finish

        return finish(self.polish, jobs, seed, go_on, is_free=is_free)

    def bettered(self, jobs: tuple[Job, ...], notes: list[Diagnostic], engine: str, moves: int = 0) -> Found:
        """Return what became of the mode where another engine than the annealer has found valid jobs: these or better.

        The annealer continues from them, on a grid on which they all lie, as it does from those of its own.
        """
        better = self._annealed(jobs) if self.polish is not None else None
        is_cut = better is not None and better.unimproved
        jobs, moves = (jobs, moves) if better is None else (better.jobs, moves + better.moves)
        go_on = lambda: self.on_progress(self.name, moves, moves + 1, 0)  # noqa: E731
        end = self.finished(jobs, self.seed, go_on, is_free=not is_cut)
        return Found(
            self.report(end.jobs, Status.VALID), notes, moves, False, is_cut or end.stopped, engine, end.reached
        )

    def _annealed(self, jobs: tuple[Job, ...]) -> Outcome | None:
        """Let the annealer improve the jobs; None where it cannot hold them."""
        from halpipe.pipeline.solve.kernel.search import improved

        assert self.polish is not None
        starts = (job.start for job in jobs)
        tick = self.start_tick or greatest_common_divisor([natural_tick(self.expansion), *starts])
        try:
            problem = stated_problem(self.model, self.expansion, tick, every_chain=True, pinned=self.pinned)
        except HalpipeError as failure:
            if [found.code for found in failure.diagnostics] == [TOO_LARGE.id]:
                return None
            raise
        on_slice = lambda made, best: self.on_progress(self.name, made, made + 1, best)  # noqa: E731
        return improved(problem, jobs, self.polish, on_slice, self.earlier, self.kept)

    @property
    def widens(self) -> bool:
        """Whether the margin is raised first; jobs that have shipped stay when no objectives are stated, too."""
        stated = self.options.optimise
        return stated is None or (stated[:1] == (Objective.MARGIN,) and not self.shipped)

    @property
    def spare(self) -> int:
        """Placements of jobs for the margin."""
        return self.options.spare * (1 if self.polish is None else THOROUGH)

    def widened(
        self, begin: Begin, jobs: tuple[Job, ...], moves: int, allowed: int, unit: int, effort: int, stage: str = ""
    ) -> Wider:
        """Search for jobs with a larger margin than these, which were found in so many of the `allowed` moves.

        A try gets some moves for each `unit`, all of them the `effort` or a share of the moves before. What is kept of
        it is kept in a `stage`.
        """
        from halpipe.pipeline.solve.kernel.widen import LATER_ROUNDS, ROUNDS, widened

        later = () if self.polish is None else LATER_ROUNDS
        rounds = *ROUNDS, *(each for each in later if each <= (self.options.budget or each))
        wanted = self.margin_of(jobs), self.most_margin
        tell = lambda made, best: self.on_progress(self.name, moves + made, allowed, best)  # noqa: E731
        kept = self.kept.stage(stage) if self.kept is not None and stage else self.kept
        return widened(begin, unit, wanted, max(effort, moves // SHARE), tell, kept, rounds)

    def first_wider(self, jobs: tuple[Job, ...], placed: int, tries: Iterable[Callable[[int], Wider]]) -> Wider:
        """Try to raise a margin that is not proven best; where it is 0, with the next effort, too."""
        from halpipe.pipeline.solve.kernel.widen import NO_WIDER

        made, wider, margin = 0, NO_WIDER, self.margin_of(jobs)
        for number, each in enumerate(tries):
            if margin >= self.most_margin or (number and (wider.jobs or wider.stopped or self.polish or margin)):
                break
            wider = each(placed + made)
            made += wider.moves
        return replace(wider, moves=made)

    @cached_property
    def most_margin(self) -> Fraction:
        """The bound of the margin of every table."""
        return largest_margin(self.expansion, self.model)

    def margin_of(self, jobs: Iterable[Job]) -> Fraction:
        """Return the margin of valid jobs."""
        return least_margin(Placement.of(self.expansion, jobs, self.model.units))

    def better_of(self, jobs: tuple[Job, ...], others: Iterable[tuple[Job, ...] | None]) -> tuple[Job, ...]:
        """Return the best of the jobs found first and others, none of whose objectives are worse than at first."""
        assert self.polish is not None
        judge = self.polish.judge
        self.polish.first[:] = [first] = [judge.worth(jobs)]
        best = first
        for other in filter(None, others):
            worth = judge.worth(other)
            if judge.keeps(first, worth) and worth.values <= best.values:
                jobs, best = other, worth
                self.polish.on_better(best)
        return jobs

    def report(self, jobs: tuple[Job, ...], status: Status) -> ModeSchedule:
        """Return the jobs with their figures; those of a group are measured with the other groups."""
        if self.part:
            return ModeSchedule(name=self.name, hyperperiod=self.expansion.hyperperiod, status=status, jobs=jobs)
        return mode_report(self.model, self.expansion, jobs, status)

    def changed(self, tasks: tuple[str, ...], what: str) -> list[Diagnostic]:
        """Say of tasks that have shipped why they cannot stay."""
        path = about(mode=self.name)
        reasons = self.unkept | dict.fromkeys(tasks, f"{what} have changed")
        by_name = self.expansion.by_name
        return [
            CANNOT_STAY(
                f"cannot stay as shipped: {reason}; it was placed anew",
                at=by_name[task].task.at,
                path=about(path, task=task),
            )
            for task, reason in reasons.items()
        ]


class _Exact(_Search):
    """The exact engine alone, asked for by name."""

    def found(self) -> Found:
        from halpipe.pipeline.solve.exact import Effort
        from halpipe.pipeline.solve.relay import solve_alone

        if self.options.shipped is not None or self.options.like is not None:
            mode, help = self.expansion.mode, "use --engine anneal, or omit --freeze and --near"
            text = "cannot keep jobs of an earlier schedule"
            raise HalpipeError(EXACT_KEEPS_NOTHING(text, at=mode.at, path=about(mode=mode.name), help=help))
        effort = Effort(
            work=self.options.effort,
            workers=self.options.workers.count,
            seed=self.seed,
            go_on=lambda: self.on_progress(self.name, 0, 1, CONSTRUCTING),
        )
        jobs = solve_alone(self.model, self.expansion, self.start_tick, effort)
        return self.bettered(jobs, [], EXACT)


class _SplitJobs(_Search):
    """A mode in which jobs may be split: by earliest deadline first over their parts (MODEL 8.3)."""

    def found(self) -> Found:
        from halpipe.pipeline.solve.edf.fixed import fix

        check_tick(self.expansion, self.options.tick)
        mode = self._mode(self.expansion, Fraction(1))
        fixed, changed = fix(mode, self.shipped)
        mode = replace(mode, fixed=fixed)
        refuse_stuck(self.expansion, [work.name for work in mode.works if not work.ways])
        notes = self.changed(changed, "number of jobs, slack, version, units or parts")
        polish = None if self.widens else self.polish
        found = self._searched(mode, polish, self.kept, self.soon)
        if found.excess and not found.stopped:
            whole = None if fixed.jobs else self._in_one_piece(notes, found.placed)
            if whole is not None:
                return whole
            later = self._searched(mode, polish, self.kept and self.kept.stage("later"), self.budget)
            is_worse = later.excess > found.excess
            found = replace(found, placed=later.placed, stopped=later.stopped) if is_worse else later
        self.on_progress(self.name, found.placed, self.budget, found.excess)
        if found.excess:
            return Found(self.report(found.jobs, Status.NOT_FOUND), notes, found.placed, found.stopped)
        if self.widens and not found.stopped and not fixed.jobs:
            found = self._wider(found)
        end = self.finished(found.jobs, 0, lambda: True, is_free=False)
        table, is_cut = self.report(end.jobs, Status.VALID), found.stopped or found.unimproved
        return Found(table, notes, found.placed, unimproved=is_cut, reached=end.reached)

    @cached_property
    def budget(self) -> int:
        """Jobs that may be placed."""
        return self.options.placements(max(1, len(self.expansion.tasks)), self.expansion.job_count)

    @cached_property
    def soon(self) -> int:
        """Jobs that may be placed before a table that splits no job is looked for, whatever time there is."""
        usual = replace(self, options=replace(self.options, budget=None))
        return min(self.budget, usual.budget) // SOON

    @cached_property
    def whole(self) -> _WholeJobs:
        """The search that splits no job."""
        tasks = (replace(a, versions=tuple(replace(v, split=WHOLE) for v in a.versions)) for a in self.expansion.tasks)
        expansion = replace(self.expansion, tasks=tuple(tasks))
        return _WholeJobs(self.model, expansion, self.options, self.number, self.on_progress, self.earlier, self.part)

    def _in_one_piece(self, notes: list[Diagnostic], placed: int) -> Found | None:
        """Search for a table that splits no job: there it is easy to let a job end where another one starts."""
        options = replace(self.options, budget=min(self.options.budget or WHOLE_BUDGET, WHOLE_BUDGET))
        try:
            found = replace(self.whole, options=options, part=f"{self.part}/whole").found()
        except HalpipeError:  # a job may be too long in one piece
            return None
        if found.table.status is not Status.VALID:
            return None
        table = self.report(found.table.jobs, Status.VALID)
        return replace(found, table=table, diagnostics=[*notes, *found.diagnostics], moves=placed + found.moves)

    def _mode(self, expansion: Expansion, growth: Fraction, *, is_fine: bool = False) -> Mode:
        from halpipe.pipeline.solve.edf.works import finer, lenient, works_of

        tick = natural_tick(expansion)
        expansion = replace(expansion, tasks=tuple(active for active in expansion.tasks if active.jobs))
        mode = works_of(self.model, expansion, self.options.tick or (finer(tick) if is_fine else tick), growth)
        return lenient(mode) if is_fine else mode

    def _searched(self, mode: Mode, polish: Polish | None, kept: Kept | None, budget: int) -> Tabled:
        from halpipe.pipeline.solve.edf.search import Search
        from halpipe.pipeline.solve.edf.trials import Effort

        tell = lambda placed, excess: self.on_progress(self.name, placed, self.budget, excess)  # noqa: E731
        least = max(POLISH_BUDGET * len(mode.works), POLISH_TABLES * self.expansion.job_count)
        effort = Effort(budget, least if self.options.is_open else self.budget, tell)
        return Search(mode, self.model, self.seed, self.pinned, effort, polish, kept).run()

    def _wider(self, plain: Tabled) -> Tabled:
        """Raise the margin of a table by others in which every part has more time than it takes."""
        expansion = self.expansion if self.polish is not None else _with_versions_of(plain.jobs, self.expansion)
        jobs, spare = self.expansion.job_count, self.spare
        effort = max(spare // TABLED_SHARE, MARGIN_TABLES * jobs)
        plain_begin, unit = self._lengthened(expansion, plain.plan), max(1, jobs // TABLED_UNIT)
        fine_begin = self._lengthened(expansion, None, is_fine=True)
        tries = (
            lambda made: self.widened(plain_begin, plain.jobs, made, self.budget, unit, effort),
            lambda made: self.widened(fine_begin, plain.jobs, made, self.budget, jobs, spare, "finer"),
            lambda made: self.whole.raised(plain.jobs, made, is_fine=True),
            lambda made: self._any_margin(fine_begin, min(ANY_TABLES * jobs, spare), made),
        )
        wider = self.first_wider(plain.jobs, plain.placed, tries)
        found = replace(plain, placed=plain.placed + wider.moves, unimproved=wider.stopped)
        if self.polish is None:
            return replace(found, jobs=max((plain.jobs, wider.jobs or plain.jobs), key=self.margin_of))
        if not wider.stopped:  # what else counts is improved where the segments keep their time
            mode = self._mode(expansion, 1 + wider.margin if wider.jobs else Fraction(1))
            last = self._searched(mode, self.polish, self.kept and self.kept.stage("wider"), self.budget)
            found = replace(last, placed=found.placed + last.placed)
        return replace(found, jobs=self.better_of(plain.jobs, [wider.jobs, None if found.excess else found.jobs]))

    def _any_margin(self, begin: Begin, effort: int, made: int) -> Wider:
        """Search in all the `effort` for the least margin alone."""
        from halpipe.pipeline.solve.kernel.widen import ROUNDS, STEP, Wider

        run = begin(STEP, len(ROUNDS), self.kept and self.kept.stage("any"))
        end = run(effort, lambda now, _: self.on_progress(self.name, made + now, self.budget, 0))
        return Wider(None if end.cost else end.jobs, STEP, end.moves, end.stopped)

    def _lengthened(self, expansion: Expansion, plan: Plan | None, *, is_fine: bool = False) -> Begin:
        """Return the search for a margin: from a plan, if there is one, or on a finer tick."""
        from halpipe.pipeline.solve.edf.search import Search
        from halpipe.pipeline.solve.edf.trials import Effort
        from halpipe.pipeline.solve.kernel.search import NOT_BEGUN, Outcome

        plans = [plan]

        def begin(margin: Fraction, number: int, kept: Kept | None) -> Run:
            def run(placed: int, tell: OnSlice) -> Outcome:
                try:
                    mode = self._mode(expansion, 1 + margin, is_fine=is_fine)
                    if not all(work.ways for work in mode.works):
                        return NOT_BEGUN
                    effort = Effort(placed, 0, tell)
                    seed, before = self.seed + number, plans[-1]
                    found = Search(mode, self.model, seed, self.pinned, effort, kept=kept, before=before).run()
                except HalpipeError:  # too many ticks, or parts
                    return NOT_BEGUN
                if not found.excess:
                    plans.append(found.plan)
                return Outcome(found.jobs, found.excess, found.placed, stopped=found.stopped)

            return run

        return begin


class _WholeJobs(_Search):
    """A mode of jobs in one piece: by the annealer, and in a small mode by the exact engine in turns with it."""

    @cached_property
    def tick(self) -> Duration | None:
        """A tick that was asked for, or one on which the shipped jobs lie; None for the natural one."""
        if self.start_tick or not self.shipped:
            return self.start_tick
        return greatest_common_divisor([natural_tick(self.expansion), *(job.start for job in self.shipped.values())])

    @cached_property
    def budget(self) -> int:
        """Moves that the annealer may make."""
        return self.options.moves(len(self.expansion.tasks))

    @cached_property
    def least(self) -> int:
        """Moves that it may make where no budget is stated."""
        return replace(self.options, budget=None).moves(len(self.expansion.tasks))

    @cached_property
    def may_ask(self) -> bool:
        """Whether the exact engine may look for a schedule, too."""
        is_free = self.options.is_open and self.tick is None
        return is_free and self.expansion.job_count <= EXACT_JOBS and has_whole_jobs(self.model)

    @cached_property
    def problem(self) -> Problem:
        """The mode in arrays; jobs that have shipped stay on their units, so that no group of units is one lane."""
        return self._stated(self.tick, grouped=not self.shipped)

    def _stated(self, tick: Duration | None, expansion: Expansion | None = None, **form: bool) -> Problem:
        return stated_problem(self.model, expansion or self.expansion, tick, pinned=self.pinned | self.settled, **form)

    @cached_property
    def settled(self) -> dict[str, Pins]:
        """The units of the tasks all of whose jobs have shipped, and can stay: no others need to be looked at."""
        if not self.shipped:
            return {}
        from halpipe.pipeline.shipped import staying_in_time

        units = {unit.name: unit for unit in self.model.units}
        stays = grouped((job.task, job) for job in staying_in_time(self.expansion, self.shipped.values(), units))
        return {
            name: {len(job.units): frozenset(unit for each in jobs for unit in each.units) for job in jobs}
            for name, jobs in stays.items()
        }

    def found(self) -> Found:
        from halpipe.pipeline.solve.exact import is_installed
        from halpipe.pipeline.solve.relay import relay

        answer: tuple[Job, ...] | None = None
        if self.may_ask and is_installed():
            outcome, answer = relay(self._anneal, self._solve, self.least, self.budget, self.expansion.job_count)
        else:
            outcome = self._anneal(self.budget)
        notes = cut_options(self.problem) + self.changed(outcome.changed, "number of jobs, slack, version or units")
        path, at = about(mode=self.name), self.expansion.mode.at
        if answer is not None:
            notes.append(OTHER_ANSWERED(f"the answer is that of: {EXACT}", at=at, path=path))
            return self._wider(answer, notes, EXACT, outcome.moves)
        if self.may_ask and not is_installed() and outcome.cost:
            help = "pip install ortools"
            notes.append(EXACT_ABSENT("the exact engine was not asked", at=at, path=path, help=help))
        goes_on = self.on_progress(self.name, outcome.moves, self.budget, outcome.cost)
        if outcome.cost:
            table = self.report(outcome.jobs, Status.NOT_FOUND)
            return Found(table, notes, outcome.moves, outcome.stopped)
        if self.widens and not goes_on:
            return Found(self.report(outcome.jobs, Status.VALID), notes, outcome.moves, unimproved=True)
        if self.widens:
            return self._wider(outcome.jobs, notes, ANNEAL, outcome.moves)
        is_cut = outcome.unimproved
        is_free = not (self.shipped or self.pinned or is_cut) and self.tick is None and self.options.is_open
        end = self.finished(outcome.jobs, self.seed, self._go_on(outcome), is_free=is_free)
        table = self.report(end.jobs, Status.VALID)
        unimproved = is_cut or end.stopped
        return Found(table, notes, outcome.moves, outcome.stopped, unimproved, reached=end.reached)

    def _wider(self, jobs: tuple[Job, ...], notes: list[Diagnostic], engine: str, moves: int) -> Found:
        """Raise the margin of valid jobs with little effort before their improvement, if any is stated."""
        if not self.widens:
            return self.bettered(jobs, notes, engine, moves)
        wider = self.first_wider(jobs, moves, (partial(self.raised, jobs, is_fine=fine) for fine in (False, True)))
        jobs = wider.jobs or jobs if self.polish is None else self.better_of(jobs, [wider.jobs])
        if wider.stopped:
            return Found(self.report(jobs, Status.VALID), notes, moves + wider.moves, unimproved=True, engine=engine)
        return self.bettered(jobs, notes, engine, moves + wider.moves)

    def raised(self, jobs: tuple[Job, ...], moves: int, *, is_fine: bool = False) -> Wider:
        """Search for a larger margin than that of valid jobs, which were found in so many moves."""
        from halpipe.pipeline.solve.edf.works import finer
        from halpipe.pipeline.solve.kernel.search import Search
        from halpipe.pipeline.solve.kernel.widen import NO_WIDER, reserved

        tick, expansion, is_free = self.tick, self.expansion, self.options.window is None
        if is_fine and not is_free:
            return NO_WIDER
        if self.polish is None:
            expansion = _with_versions_of(jobs, self.expansion)
            tick = tick or (finer(natural_tick(expansion)) if is_fine else None)
        elif tick is None and is_free:  # then starts may lie between the ticks, so that the bound is met
            tick = natural_tick(expansion) / min(MOST_PARTS, self.most_margin.denominator)

        @cache  # of a large system, stating the problem takes longer than the search for one margin
        def plain(*, grouped: bool) -> Problem:
            is_stated = grouped and tick == self.tick and expansion is self.expansion
            return self.problem if is_stated else self._stated(tick, expansion, grouped=grouped)

        def begin(margin: Fraction, number: int, kept: Kept | None) -> Run:
            def stated(*, grouped: bool) -> Problem:
                problem = plain(grouped=grouped and not self.shipped)
                return reserved(problem, margin, problem.arrays)

            separate = partial(stated, grouped=False)
            seed = self.seed + number
            return Search(stated(grouped=True), separate, seed, self.earlier, shipped=self.shipped, kept=kept).run

        tasks = len(self.expansion.tasks)
        effort = self.spare * tasks // max(1, self.expansion.job_count)
        try:
            return self.widened(begin, jobs, moves, self.budget, tasks, effort, "whole" if is_fine else "")
        except HalpipeError:  # a finer grid, or jobs in one piece, may be too much
            if is_fine:
                return NO_WIDER
            raise

    def _anneal(self, moves: int) -> Outcome:
        """Let the annealer continue to so many moves in all."""
        return self.annealer.run(moves, lambda made, best: self.on_progress(self.name, made, self.budget, best))

    @cached_property
    def annealer(self) -> Turns:
        """The annealer, and how far it is; that which a clock ends begins anew now and then."""
        from halpipe.pipeline.solve.kernel.search import Turns

        return Turns(self._begun, self.least if self.options.is_open else self.budget)

    def _begun(self, number: int) -> Search:
        """Begin the annealer's search of a number, of which the first is kept."""
        from halpipe.pipeline.solve.kernel.search import Search

        return Search(
            self.problem,
            lambda: self.problem if self.shipped else self._stated(self.tick, grouped=False),
            self.seed + number * TURN_SEED,
            self.earlier,
            None
            if self.polish is None or self.widens
            else (self.polish, lambda: self._stated(self.tick, every_chain=True)),
            self.shipped,
            None if number else self.kept,
        )

    def _solve(self, outcome: Outcome, turn: Turn) -> tuple[Job, ...] | None:
        """Run the exact engine in one of its turns."""
        from halpipe.pipeline.solve.exact import Effort
        from halpipe.pipeline.solve.relay import solve_after

        workers, go_on = self.options.workers.count, self._go_on(outcome)
        seed = self.seed + turn.number * TURN_SEED
        effort = Effort(work=turn.work, seed=seed, go_on=go_on, workers=workers)
        return solve_after(self.model, self.expansion, effort)

    def _go_on(self, outcome: Outcome) -> Callable[[], bool]:
        return lambda: self.on_progress(self.name, outcome.moves, self.budget, outcome.cost)


def units_of_bound(model: TaskModel, shipped: Schedule | None) -> dict[str, frozenset[str]]:
    """Return the unit set of each shipped task that is bound in the whole system; none if its jobs cannot have one."""
    bound = {task.name: task for task in model.tasks if task.binding is Binding.SYSTEM}
    jobs = (job for mode in (shipped.modes if shipped else ()) for job in mode.jobs if job.task in bound)
    sets = {name: {*each} for name, each in grouped((job.task, frozenset(job.units)) for job in jobs).items()}
    found = {name: each.pop() if len(each) == 1 else frozenset() for name, each in sets.items()}
    for run in (run for mode in model.modes for run in mode.runs if run.task in found):
        units, versions = found[run.task], map(bound[run.task].version, run.versions)
        if not any(len(units) == version.gang and units <= {*version.units} for version in versions):
            found[run.task] = frozenset()
    return found


def _with_versions_of(jobs: Iterable[Job], expansion: Expansion) -> Expansion:
    """Return the expansion without the versions that no job has: a margin is no reason to choose a shorter one.

    A task that demands others keeps its versions, since their jobs depend on them.
    """
    used = {(job.task, job.version) for job in jobs}
    demanders = {demand.task for active in expansion.tasks for demand in active.demands}

    def kept(active: ActiveTask) -> ActiveTask:
        found = tuple(v for v in active.versions if (active.name, v.name) in used)
        is_less = 0 < len(found) < len(active.versions) and active.name not in demanders
        return replace(active, versions=found) if is_less else active

    tasks = tuple(map(kept, expansion.tasks))
    is_same = all(new is old for new, old in zip(tasks, expansion.tasks, strict=True))
    return expansion if is_same else replace(expansion, tasks=tasks)
