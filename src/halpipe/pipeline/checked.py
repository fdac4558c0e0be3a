"""Schedules that are checked before anyone sees them: validate, search, find the switches, verify.

Order matters: nothing is searched for that does not validate, and nothing leaves here as valid that does not verify.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Diagnostic, Exit, Findings, HalpipeError, about, error, warning
from halpipe.core.options import option, positive_duration
from halpipe.core.records import record
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Schedule, TaskModel, TransitionTable
    from halpipe.pipeline.solve.optimise import Reached
    from halpipe.pipeline.solve.quantise import BurstGrid
    from halpipe.pipeline.solve.schedule import OnProgress, Scheduled, SearchOptions
    from halpipe.pipeline.transitions.tables import Switched

INVALID_SOLUTION = error(
    "HAL0903",
    "Solver and checker disagree",
    "The search called a schedule valid that verify does not accept. This is a bug of halpipe; please report it "
    "with the model. No schedule was written.",
)
KEPT_FOR_SWITCHES = warning(
    "HAL1435",
    "Improvement loses a switch",
    "The schedule of a mode was improved by --optimise, and then a switch of the model had no transition table any "
    "more. The mode keeps the schedule with which the switch has one. Its objectives are those of that schedule.",
)
ATTEMPTS = 32
"""Placements of the modes that are tried for switches between all allowed pairs, within the budget of moves."""
ATTEMPTED_JOBS = 20_000
"""Jobs, times placements, that are tried for them: large systems get fewer placements."""
PATIENCE = 16
"""Progress reports, and moves per task, before a proof of infeasibility is looked for: large systems report often."""


@record(kw_only=True)
class ValidateOptions:
    """Options of a validation."""

    tick: Duration | None = option(
        None, "Grid of the start times; too coarse a one is an error.", positive_duration, metavar="TIME"
    )


def validate_model(model: TaskModel, tick: Duration | None = None) -> list[Diagnostic]:
    """Return everything that is wrong or odd with a model, in the order of its file; also beside a tick, if given."""
    from halpipe.pipeline.validate import validate

    found = list(validate(model))
    if tick is not None and not any(finding.is_error for finding in found):
        from halpipe.pipeline.solve.limits import check_starts

        found += check_starts(model, tick)
    return found


def schedule_model(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Validate, search and verify; a schedule that leaves here as valid has passed the independent check.

    The search for a mode that provably has no schedule is soon given up: raise `HalpipeError` with the proof.
    """
    for name in options.modes:
        require_mode(name, model.modes)
    findings = validate_model(model)
    if errors := [found for found in findings if found.is_error]:
        from halpipe.pipeline.explain.witnesses import proves_infeasible

        raise HalpipeError(*findings, exit=Exit.INFEASIBLE if proves_infeasible(model, errors) else Exit.FINDINGS)
    if options.shipped is not None:
        from halpipe.pipeline.shipped import check_shipped

        check_shipped(model, options.shipped, options.tick, options.modes)
    doubt = _Doubt(model, options.modes, on_progress)
    try:
        best = _schedule_validated(model, options, doubt.on_progress)
    except HalpipeError:
        doubt.settle()
        raise
    if not best.is_complete:
        doubt.settle()
    return replace(best, diagnostics=(*findings, *best.diagnostics))


class _Doubt:
    """Asks, once a search has not soon succeeded, whether it can: most searches are over before that takes effect."""

    def __init__(self, model: TaskModel, modes: Sequence[str], on_progress: OnProgress) -> None:
        from halpipe.pipeline.solve.workers import once

        self._model, self._modes, self._tell = model, modes, on_progress
        self._reports = 0
        self._found = once(self._look)  # reports come from several threads

    def on_progress(self, mode: str, moves: int, allowed: int, cost: int) -> bool:
        """Pass a report on; False also if the system is proven infeasible."""
        self._reports += cost != 0  # later ones are about a schedule that is valid
        is_long = self._reports > PATIENCE and moves > PATIENCE * len(self._model.tasks)
        if is_long and self._found():
            return False
        return self._tell(mode, moves, allowed, cost)

    def settle(self) -> None:
        """Raise with the proofs that some mode has no schedule, if there are any."""
        if proofs := self._found():
            raise HalpipeError(*proofs, exit=Exit.INFEASIBLE)

    def _look(self) -> tuple[Diagnostic, ...]:
        from halpipe.pipeline.explain.witnesses import find_witnesses

        hopeless = find_witnesses(self._model, self._modes)
        return tuple(proof for each in hopeless for proof in each.diagnostics)


def _schedule_validated(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    _refuse_crowded(model, options)
    if options.grid is not None:
        return _schedule_on_grid(model, options, options.grid, on_progress)
    if options.near is not None:
        from halpipe.pipeline.stable import schedule_near

        return schedule_near(model, options, options.near, lambda chosen: _search(model, chosen, on_progress))
    return _search(model, options, on_progress)


def _refuse_crowded(model: TaskModel, options: SearchOptions) -> None:
    """Raise with the proof that a tick leaves too few instants to start at, if there is one."""
    from halpipe.pipeline.solve.limits import check_starts

    if options.tick is None or options.engine == "exact":
        return
    wanted = options.modes or tuple(mode.name for mode in model.modes)
    chosen = replace(model, modes=tuple(mode for mode in model.modes if mode.name in wanted))
    if found := tuple(check_starts(chosen, options.tick)):
        raise HalpipeError(*found, exit=Exit.INFEASIBLE)


def _search(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Place the modes with their switches; an improvement that loses a switch is given up, mode by mode."""
    from halpipe.pipeline.health import with_reactions

    attempts = ATTEMPTS if options.optimise is not None else 1  # if that is not enough, the first schedules are tried
    found, is_whole = _with_switches(model, options, on_progress, attempts)
    if options.optimise != () and not is_whole and found.is_complete and not found.unimproved:
        plain, _ = _with_switches(model, replace(options, optimise=(), keeper=None), on_progress)
        if len(plain.schedule.transitions) > len(found.schedule.transitions):
            found = _improved_where_switched(model, plain, found, options, on_progress)
        elif plain.stopped:  # whether it has more switches is not known
            found = replace(found, stopped=True)
    return replace(found, schedule=with_reactions(model, found.schedule))


def _with_switches(
    model: TaskModel, options: SearchOptions, on_progress: OnProgress, attempts: int = ATTEMPTS
) -> tuple[Scheduled, bool]:
    """Place the modes, and find tables between them; where some are missing, try other placements of the modes.

    Return the schedule with the most tables, and whether it has all.
    """
    from halpipe.pipeline.solve.schedule import schedule_model as search

    best: Scheduled | None = None
    doubtful: tuple[tuple[str, str], ...] | None = None
    moves = 0
    for attempt in range(attempts):
        scheduled = search(model, replace(options, attempt=attempt), on_progress)
        _refuse_broken_claims(model, scheduled.schedule)
        moves += scheduled.moves
        if len(scheduled.schedule.modes) < 2:  # then there is no switch
            return replace(scheduled, moves=moves), True
        switched = _switched(model, scheduled, options, on_progress, doubtful)
        doubtful = switched.failed
        scheduled = replace(
            scheduled,
            schedule=replace(scheduled.schedule, transitions=switched.tables),
            diagnostics=(*scheduled.diagnostics, *switched.diagnostics),
            stopped=scheduled.stopped or switched.stopped,
        )
        if best is None or len(scheduled.schedule.transitions) > len(best.schedule.transitions):
            best = scheduled
        jobs = sum(len(mode.jobs) for mode in scheduled.schedule.modes)
        is_spent = moves > options.moves(len(model.tasks)) or (attempt + 1) * jobs > ATTEMPTED_JOBS
        if not scheduled.is_complete or scheduled.unimproved or not switched.failed or is_spent:
            break
    assert best is not None, "there is at least one attempt"
    return replace(best, moves=moves, stopped=scheduled.stopped), not switched.failed


def _improved_where_switched(
    model: TaskModel, plain: Scheduled, improved: Scheduled, options: SearchOptions, on_progress: OnProgress
) -> Scheduled:
    """Return the `plain` modes, of which there are more switches, with those `improved` that lose none of them."""
    kept = plain
    given_up = []
    for number, mode in enumerate(improved.schedule.modes):
        modes = (*kept.schedule.modes[:number], mode, *kept.schedule.modes[number + 1 :])
        other = replace(kept, schedule=kept.schedule.alone(modes))
        if not any(found.is_error for found in verify_schedule(model.alone(*(m.name for m in modes)), other.schedule)):
            tables = _switched(model, other, options, on_progress, None).tables
            if len(tables) >= len(kept.schedule.transitions):
                kept = replace(other, schedule=replace(other.schedule, transitions=tables))
                continue
        given_up.append(mode.name)
    text, help = "a switch has no table with the improved one", "relax the switch, or raise --budget"
    warnings = [
        KEPT_FOR_SWITCHES(f"keeps its first schedule: {text}", at=model.mode(name).at, path=about(mode=name), help=help)
        for name in (given_up if options.optimise else ())
    ]
    reached = tuple(_at_first(model, kept.schedule, row) if row.mode in given_up else row for row in improved.reached)
    return replace(kept, diagnostics=(*kept.diagnostics, *warnings), reached=reached)


def _at_first(model: TaskModel, schedule: Schedule, row: Reached) -> Reached:
    """Return what a mode reaches of an objective with its first schedule."""
    from halpipe.pipeline.jobs import expand
    from halpipe.pipeline.measure.objectives import Judge

    judge = Judge(model, expand(model, model.mode(row.mode)), (row.objective,))
    [value] = judge.worth(schedule.mode(row.mode).jobs).values
    return replace(row, first=value, value=value)


def _schedule_on_grid(model: TaskModel, options: SearchOptions, grid: BurstGrid, on_progress: OnProgress) -> Scheduled:
    """Schedule the model as bandwidth regulators serve it, and hold the result to the model as it is."""
    from halpipe.pipeline.solve.codes import GRID_BREAKS
    from halpipe.pipeline.solve.quantise import restore, served_model, too_tight

    served = served_model(model, grid, options.tick)
    try:
        scheduled = schedule_model(served, replace(options.on_grid(), grid=None), on_progress)
    except HalpipeError as failure:
        if failure.exit is not Exit.INFEASIBLE:
            raise
        raise HalpipeError(too_tight(model, grid), *failure.diagnostics, exit=failure.exit) from None
    schedule = restore(model, scheduled.schedule)
    if scheduled.is_complete:
        names = {mode.name for mode in schedule.modes}
        switches = tuple(each for each in model.transitions if {each.source, each.target} <= names)
        asked, tables = model.alone(*names, transitions=switches), schedule.alone(schedule.modes, schedule.transitions)
        broken = [found for found in verify_schedule(asked, tables) if found.is_error]
        if broken and not any(found.is_error for found in scheduled.diagnostics):
            help = "try another --seed, or a shorter window"
            text, path = f"verify finds {len(broken)} violations", about(model=model.name)
            breaks = GRID_BREAKS(text, at=model.at, path=path, help=help)
            raise HalpipeError(breaks, *broken, exit=Exit.NOT_FOUND)
    return replace(scheduled, schedule=schedule)


def _switched(
    model: TaskModel,
    scheduled: Scheduled,
    options: SearchOptions,
    on_progress: OnProgress,
    doubtful: tuple[tuple[str, str], ...] | None,
) -> Switched:
    """Find the transition tables between the modes that have a schedule.

    A search that was stopped while it improved them gets its tables nevertheless: then all is there to be used.
    """
    from halpipe.pipeline.solve.schedule import SWITCHES
    from halpipe.pipeline.transitions.tables import switch_tables

    def go_on(done: int, total: int) -> bool:
        return on_progress(SWITCHES, done, total, 0) or scheduled.unimproved

    settled = () if options.settled is None else options.settled.transitions
    return switch_tables(model, scheduled.schedule, _is_sound_switch, go_on, options.workers, doubtful, settled)


def _is_sound_switch(model: TaskModel, schedule: Schedule, table: TransitionTable) -> bool:
    """Ask verify about one table between two modes that it has accepted."""
    from halpipe.pipeline.verify import verify_switches

    return not any(d.is_error for d in verify_switches(model, replace(schedule, transitions=(table,))))


def _refuse_broken_claims(model: TaskModel, schedule: Schedule) -> None:
    """Stop with an internal error if verify finds fault with a mode that calls itself valid."""
    from halpipe.models import Status

    claimed = tuple(mode for mode in schedule.modes if mode.status is Status.VALID)
    names = {mode.name for mode in claimed}
    alone = model.alone(*names)
    wrong = [d for d in verify_schedule(alone, replace(schedule, modes=claimed)) if d.is_error] if claimed else []
    if wrong:
        raise HalpipeError(INVALID_SOLUTION(f"verify finds {len(wrong)} violations"), *wrong, exit=Exit.INTERNAL)


def explain_failure(model: TaskModel, scheduled: Scheduled, *, interrupted: bool) -> list[Diagnostic]:
    """Say of a search that did not finish which modes lack a schedule and what their best placement still breaks."""
    from halpipe.models import Status
    from halpipe.pipeline.solve.codes import INTERRUPTED, NOT_FOUND, STILL_BROKEN

    failed = tuple(mode for mode in scheduled.schedule.modes if mode.status is Status.NOT_FOUND)
    missing = [mode.name for mode in model.modes if mode.name not in {m.name for m in scheduled.schedule.modes}]
    code = INTERRUPTED if interrupted else NOT_FOUND
    found = []
    for mode in failed:
        cost = f", best cost {mode.cost.total}" if mode.cost else ""
        help = "raise --budget, try another --seed, or relax what is named below"
        found.append(
            code(f"no valid schedule yet{cost}", at=model.mode(mode.name).at, path=about(mode=mode.name), help=help)
        )
    if interrupted and missing:
        found.append(code(f"not searched: {', '.join(missing)}", at=model.at))
    if not failed and not missing:
        text = "every mode has a valid schedule, but not every mode pair was searched for its transition table"
        found.append(code(text, at=model.at, help="go on with --resume"))
    alone = model.alone(*(mode.name for mode in failed))
    claims = tuple(replace(mode, status=Status.VALID, cost=None, chains=()) for mode in failed)
    broken = verify_schedule(alone, replace(scheduled.schedule, modes=claims)) if failed else []
    found += [replace(STILL_BROKEN.instead_of(d), at=NOWHERE, places=(), help="") for d in broken if d.is_error]
    return found


def verify_schedule(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return every violation that the independent checker finds."""
    from halpipe.pipeline.verify import verify

    return list(verify(model, schedule))


def refuse_invalid(model: TaskModel, schedule: Schedule) -> None:
    """Stop unless the model validates and the schedule verifies."""
    findings = Findings(validate_model(model))
    findings.stop_on_errors()
    findings.extend(verify_schedule(model, schedule))
    findings.stop_on_errors()
