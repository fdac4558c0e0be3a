"""Answers other than a schedule (MODEL 6): why a mode has none, or what stood in the way, and what would help.

First the proofs that a person can check, then a minimal conflicting set from the exact engine, then the smallest change
with which a schedule is found. "Infeasible" is never said because a search gave up.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, Subject, about
from halpipe.core.options import Form, option, time_limit_of
from halpipe.core.records import record
from halpipe.models.modes import require_mode
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.conflict import describe, find_conflict
from halpipe.pipeline.explain.remedies import Trials, find_remedies
from halpipe.pipeline.explain.witnesses import find_witnesses, proves_infeasible, tasks_of
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.codes import NOT_FOUND, STILL_BROKEN
from halpipe.pipeline.solve.exact import Answer
from halpipe.pipeline.solve.quantise import restore, served_model, too_tight, with_ends
from halpipe.pipeline.solve.schedule import PlacementOptions, SearchOptions, schedule_option
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Mode, Schedule, TaskModel
    from halpipe.pipeline.solve.schedule import Scheduled

BUDGET = 5_000
"""Moves per task of the search that is explained where no schedule is given, in modes of up to 400 jobs."""

WORK = 2_000_000
"""Jobs placed in that search for each task, roughly, in larger modes: what would help needs its time too."""


class Verdict(StrEnum):
    """Verdict on whether a mode has a schedule."""

    SCHEDULABLE = "schedulable"
    INFEASIBLE = "infeasible"
    NOT_FOUND = "not found"
    INVALID = "invalid"


@record(kw_only=True)
class ExplainOptions(PlacementOptions):
    """Options of an explanation; see `explain`."""

    schedule: Schedule | None = schedule_option("Best placement of a failed search, to explain instead of a new one.")
    mode: str = option("", "Explain this mode only.", metavar="NAME", completes="modes", otherwise="all")
    exact: bool = option(True, "Look for a minimal conflict with the exact engine, if installed.", form=Form.SWITCH)
    remedies: bool = option(True, "Look for the smallest changes that help.", form=Form.SWITCH)
    time_limit: Duration | None = option(
        None, "Time after which no new search begins, such as 30s.", time_limit_of, metavar="TIME", otherwise="none"
    )

    def search(self) -> SearchOptions:
        """Return the options of the searches that are explained."""
        return SearchOptions(
            seed=self.seed, tick=self.tick, shipped=self.shipped, near=self.near, grid=self.grid, optimise=()
        ).on_grid()


EXITS = {
    Verdict.SCHEDULABLE: Exit.OK,
    Verdict.INFEASIBLE: Exit.INFEASIBLE,
    Verdict.NOT_FOUND: Exit.NOT_FOUND,
    Verdict.INVALID: Exit.FINDINGS,
}


@record
class Explanation:
    """The verdict on each mode, all findings (witnesses first, what would help last), and switches without a table."""

    verdicts: tuple[tuple[str, Verdict], ...]
    diagnostics: tuple[Diagnostic, ...]
    switches: tuple[tuple[str, str], ...] = ()
    """Listed switches between modes with schedules for which no table was found, or which have none for certain."""
    hopeless: tuple[tuple[str, str], ...] = ()
    """Those of them that are proven to have no table."""
    is_cut: bool = False
    """Whether time ended it before every mode and switch had an answer."""

    @property
    def exit(self) -> Exit:
        """The exit code: that of an invalid model, else of the worst mode."""
        found = {verdict for _, verdict in self.verdicts}
        for verdict in (Verdict.INVALID, Verdict.INFEASIBLE, Verdict.NOT_FOUND):
            if verdict in found:
                return EXITS[verdict]
        if self.switches:
            return Exit.INFEASIBLE if self.hopeless else Exit.NOT_FOUND
        if self.is_cut:
            return Exit.NOT_FOUND
        return Exit.OK if found else Exit.FINDINGS  # a model without modes is invalid


def explain(
    model: TaskModel,
    options: ExplainOptions = ExplainOptions(),  # noqa: B008 - it is frozen
    go_on: Callable[[], bool] = lambda: True,
    budget: int | None = None,
) -> Explanation:
    """Explain why a mode (or every mode) of a model has no schedule, or what stood in the way of finding one.

    `options.schedule` is the best placement of an earlier search; without it one is made, with `budget` moves per task
    (by default as many as the size of the mode allows). The exact engine takes part where it is installed and the mode
    small. `go_on` is asked now and then and may end it all.
    """
    if options.mode:
        require_mode(options.mode, model.modes)
    findings = validate(model)
    errors = [d for d in findings if d.is_error]
    if errors:
        verdict = Verdict.INFEASIBLE if proves_infeasible(model, errors) else Verdict.INVALID
        return Explanation(tuple((m.name, verdict) for m in model.modes), tuple(errors))
    served = model if options.grid is None else served_model(model, options.grid, options.tick)
    verdicts: list[tuple[str, Verdict]] = []
    diagnostics: list[Diagnostic] = []
    for chosen in model.modes:
        if options.mode in ("", chosen.name):
            verdict, found = _Question(model, served, chosen, options, options.search(), budget, go_on).answer()
            verdicts.append((chosen.name, verdict))
            diagnostics += found
    missing: tuple[tuple[str, str], ...] = ()
    hopeless = missing
    is_answered = {verdict for _, verdict in verdicts} == {Verdict.SCHEDULABLE}
    if len(verdicts) > 1 and is_answered:
        from halpipe.pipeline.explain.switches import failed_switches

        search = replace(options.search(), grid=None)
        switches = failed_switches(served, search, go_on, remedies=options.remedies)
        diagnostics += switches.diagnostics
        missing, hopeless, is_answered = switches.missing, switches.hopeless, False
    is_cut = not is_answered and not go_on()
    if is_cut:
        help = "give it more time, or ask for one --mode"
        diagnostics.append(codes.CUT_SHORT("not all was looked at", path=about(model=model.name), help=help))
    return Explanation(tuple(verdicts), tuple(diagnostics), missing, hopeless, is_cut)


@record
class _Question:
    """One mode to explain, and how; with a grid, `model` is on it, while remedies change the `stated` one."""

    stated: TaskModel
    model: TaskModel
    mode: Mode
    options: ExplainOptions
    search: SearchOptions
    budget: int | None
    go_on: Callable[[], bool]

    def answer(self) -> tuple[Verdict, list[Diagnostic]]:
        """Try the instant proofs, then the search, then the exact engine; end with what would help."""
        from halpipe.pipeline.stable import broken as broken_rules

        for hopeless in find_witnesses(self.model, [self.mode.name]):
            return Verdict.INFEASIBLE, self._infeasible(hopeless.diagnostics, hopeless.tasks)
        if proofs := self._of_options():
            tasks = tuple(task.name for task in self.model.tasks if Subject("task", task.name) in proofs[0].subjects)
            return Verdict.INFEASIBLE, self._infeasible(proofs, tasks)
        best, notes = self._best()
        broken = broken_rules(self.model, best) or self._broken_off_grid(best)
        if not broken:
            return Verdict.SCHEDULABLE, [*notes, self._schedulable("the search finds one")]
        found = self._not_found(best, broken)
        conflict = find_conflict(self.model, self.mode, self.go_on) if self.options.exact else None
        is_asked_as_is = self.search.shipped is None and self.search.tick is None
        if conflict is not None and conflict.answer is Answer.FEASIBLE and is_asked_as_is:
            help = "schedule it without --budget, or with --engine exact"
            return Verdict.SCHEDULABLE, [self._schedulable("the exact engine finds one", help)]
        if conflict is not None and conflict.kept is not None:
            tasks = tuple(active.name for active in conflict.kept.tasks)
            return Verdict.INFEASIBLE, self._infeasible([describe(self.mode, conflict)], tasks)
        return Verdict.NOT_FOUND, [*found, *self._remedies(tasks_of(self.model, broken))]

    def _schedulable(self, how: str, help: str = "nothing to do") -> Diagnostic:
        text = f"has a valid schedule; {how}"
        return codes.SCHEDULABLE(text, at=place(self.mode), path=about(mode=self.mode.name), help=help)

    def _infeasible(self, proofs: Iterable[Diagnostic], tasks: tuple[str, ...]) -> list[Diagnostic]:
        """Return proofs, after what the grid makes of the model, and what would help."""
        grid = self.search.grid
        return [*([] if grid is None else [too_tight(self.stated, grid)]), *proofs, *self._remedies(tasks)]

    def _broken_off_grid(self, best: Schedule) -> list[Diagnostic]:
        """Return what verify finds where jobs end as in the stated model."""
        from halpipe.pipeline.stable import broken as broken_rules

        return [] if self.search.grid is None else broken_rules(self.stated, restore(self.stated, best))

    def _remedies(self, tasks: tuple[str, ...]) -> list[Diagnostic]:
        if not self.options.remedies:
            return []
        expansion = expand(self.model, self.mode)
        tick = self.search.tick or natural_tick(expansion)
        search = replace(self.search, near=None)
        trials = Trials(self.mode.name, expansion.job_count, self.go_on, tick, search, self.options.exact)
        return find_remedies(self.stated, tasks, trials)

    def _of_options(self) -> list[Diagnostic]:
        """Return the proofs that the options leave no schedule: jobs that stay exclude each other, or a coarse tick."""
        from halpipe.pipeline.shipped import excluded_jobs, refuse_unmatched
        from halpipe.pipeline.solve.limits import check_starts

        proofs: list[Diagnostic] = []
        if self.search.shipped is not None:
            own = tuple(table for table in self.search.shipped.modes if table.name == self.mode.name)
            refuse_unmatched(self.model, self.search.shipped)
            proofs += excluded_jobs(self.model, self.search.shipped.alone(own), self.search.tick)
        if self.search.tick is not None:
            proofs += check_starts(replace(self.model, modes=(self.mode,)), self.search.tick)
        return proofs

    def _best(self) -> tuple[Schedule, tuple[Diagnostic, ...]]:
        """Return the placement to explain, the mode's of the schedule given or that of a search, and its notes."""
        schedule = self.options.schedule
        tables = [t for t in schedule.modes if t.name == self.mode.name] if schedule else []
        if schedule is not None and tables:
            served = (replace(table, jobs=with_ends(self.model, table.jobs)) for table in tables)
            return schedule.alone(tuple(tables if self.search.grid is None else served)), ()
        jobs = max(1, expand(self.model, self.mode).job_count)
        budget = self.budget or max(20, min(BUDGET, WORK // jobs))
        options = replace(self.search, budget=budget, modes=(self.mode.name,))
        from halpipe.pipeline.solve.schedule import schedule_model
        from halpipe.pipeline.stable import schedule_near

        def solve(chosen: SearchOptions) -> Scheduled:
            return schedule_model(self.model, chosen, lambda *_: self.go_on())

        if options.near is None:
            return solve(options).schedule, ()
        own = tuple(table for table in options.near.modes if table.name == self.mode.name)
        found = schedule_near(self.model, options, options.near.alone(own), solve)
        return found.schedule, found.diagnostics

    def _not_found(self, best: Schedule, broken: list[Diagnostic]) -> list[Diagnostic]:
        """Say how far the search came: the best cost, the rules still broken with counts, and the first jobs."""
        path, at = about(mode=self.mode.name), place(self.mode)
        cost = best.modes[0].cost if best.modes else None
        reached = f", best cost {float(cost.total):.6g}" if cost else ""
        rules = Counter(d.code for d in broken)
        listed = ", ".join(f"{code} {count} time{'s' if count > 1 else ''}" for code, count in sorted(rules.items()))
        text = f"no valid schedule found{reached}; that is no proof that there is none. Still broken: {listed}"
        help = (
            "see below what would help; or search longer: `halpipe schedule` with a larger --budget or another --seed"
        )
        found = [NOT_FOUND(text, at=at, path=path, help=help)]
        shown: Counter[str] = Counter()
        for violation in broken:
            shown[violation.code] += 1
            if shown[violation.code] <= 3:
                found.append(STILL_BROKEN.instead_of(violation, f"{violation.code}: {violation.help}"))
        return found
