"""The stages of the tool chain and the registry that wires them: the one place where formats and pipeline meet.

    sources --import--> model --validate--> model --schedule--> schedule --verify--> schedule --export--> files

Each stage is a function of its inputs and options. Order matters: nothing is scheduled that does not validate,
and nothing is exported that does not verify.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from halpipe.diagnostics import Diagnostic, Exit, Findings, HalpipeError, Severity, error, sort_diagnostics, warning
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.exporters.base import Exporter, ExportOptions
    from halpipe.importers.base import Imported, Importer, ImportOptions
    from halpipe.models import Schedule, TaskModel, TransitionTable
    from halpipe.pipeline.schedule import OnProgress, Scheduled, SearchOptions

UNKNOWN_FORMAT = error("HAL0901", "Unknown format", "No importer or exporter of that name is installed.")
LOST_UNDER_STRICT = error(
    "HAL0902",
    "Loss under --strict",
    "With --strict, whatever an importer would only warn about stops the import.",
)
INVALID_SOLUTION = error(
    "HAL0903",
    "Solver and checker disagree",
    "The search called a schedule valid that verify does not accept. This is a bug of halpipe; please report it "
    "with the model. No schedule was written.",
)
UNSCHEDULABLE_YET = warning(
    "HAL0905",
    "Imported model cannot be scheduled yet",
    "The model was written, but validation finds errors in it; most often WCETs are missing, which no source "
    "format states. Give them in an overlay.",
)

ATTEMPTS = 32
"""Placements of the modes that are tried for switches between all allowed pairs, within the budget of moves."""

ATTEMPTED_JOBS = 20_000
"""Jobs, times placements, that are tried for them: large systems get fewer placements."""

IMPORTERS = "halpipe.importers"
EXPORTERS = "halpipe.exporters"


def formats(group: str) -> list[str]:
    """Return the names of the installed importers or exporters, in order."""
    return sorted(point.name for point in entry_points(group=group))


def _registered(group: str, name: str) -> object:
    points = {point.name: point for point in entry_points(group=group)}
    if name not in points:
        known = sorted(points)
        help = did_you_mean(name, known, "installed: " + ", ".join(known))
        raise HalpipeError(UNKNOWN_FORMAT(f'no {group.removeprefix("halpipe.")[:-1]} "{name}"', help=help))
    return points[name].load()


def importer(name: str) -> Importer:
    """Return the importer called `name`."""
    return _registered(IMPORTERS, name)  # type: ignore[return-value]


def exporter(name: str) -> Exporter:
    """Return the exporter called `name`."""
    return _registered(EXPORTERS, name)  # type: ignore[return-value]


# ------------------------------------------------------------------------------------------------ stages


def import_model(format: str, paths: Sequence[str], overlays: Sequence[str], options: ImportOptions) -> Imported:
    """Read sources, put the overlay onto the result, and say whether it can be scheduled."""
    from halpipe.importers.overlay import read_overlays

    reader = importer(format)
    overlay = read_overlays(overlays).begin()
    imported = reader.read(paths, replace(options, overlay=overlay))
    model, changes = overlay.apply(imported.model, imported.coverage)
    findings = Findings([*imported.diagnostics, *changes])
    if options.strict:
        _refuse_losses(findings)
    findings.stop_on_errors()
    findings.extend(_readiness(model))
    return replace(imported, model=model, diagnostics=tuple(findings.items))


def _refuse_losses(findings: Findings) -> None:
    lost = [d for d in findings.items if d.severity is not Severity.NOTE]
    if lost:
        strict = LOST_UNDER_STRICT(f"{len(lost)} findings are errors under --strict")
        raise HalpipeError(*findings.items, strict, exit=Exit.UNSUPPORTED)


def _readiness(model: TaskModel) -> list[Diagnostic]:
    errors = [d for d in validate_model(model) if d.is_error]
    if not errors:
        return []
    counts: dict[str, int] = {}
    for found in errors:
        counts[found.message] = counts.get(found.message, 0) + 1
    most = max(counts, key=lambda message: counts[message])
    others = f" and {len(errors) - counts[most]} others" if len(errors) > counts[most] else ""
    return [
        UNSCHEDULABLE_YET(
            f"it cannot be scheduled yet: {counts[most]} times: {most}{others}",
            path=f'model "{model.name}"',
            help="complete it with --overlay; `halpipe validate` lists every finding",
        )
    ]


def validate_model(model: TaskModel) -> list[Diagnostic]:
    """Return everything that is wrong or odd with a model, in the order of its file."""
    from halpipe.pipeline.validate import validate

    return sort_diagnostics(validate(model))


def schedule_model(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Validate, search and verify; a schedule that leaves here as valid has passed the independent check.

    A mode that provably has no schedule is not searched for one: raise `HalpipeError` with the proof.
    """
    from halpipe.pipeline.schedule import schedule_model as search

    findings = Findings(validate_model(model))
    findings.stop_on_errors()
    refuse_hopeless(model, options.modes)
    best: Scheduled | None = None
    moves = 0
    for attempt in range(ATTEMPTS):
        scheduled = search(model, replace(options, attempt=attempt), on_progress)
        _refuse_broken_claims(model, scheduled.schedule)
        scheduled = _with_transitions(model, scheduled, all_or_none=attempt > 0)
        if best is None or len(scheduled.schedule.transitions) > len(best.schedule.transitions):
            best = scheduled
        moves += scheduled.moves
        jobs = sum(len(mode.jobs) for mode in scheduled.schedule.modes)
        is_spent = moves > options.budget * len(model.tasks) or (attempt + 1) * jobs > ATTEMPTED_JOBS
        if scheduled.stopped or not scheduled.lacks_only_transitions or is_spent:
            break
    assert best is not None, "there is at least one attempt"
    return replace(best, diagnostics=(*findings.items, *best.diagnostics), moves=moves)


def refuse_hopeless(model: TaskModel, modes: Sequence[str]) -> None:
    """Stop with the witnesses if some mode (of those named, or all) certainly has no schedule; takes an instant."""
    from halpipe.pipeline.explain.witnesses import find_witnesses

    proofs = [found for hopeless in find_witnesses(model, modes) for found in hopeless.diagnostics]
    if proofs:
        raise HalpipeError(*proofs, exit=Exit.INFEASIBLE)


def _with_transitions(model: TaskModel, scheduled: Scheduled, *, all_or_none: bool) -> Scheduled:
    """Add the transition tables between the modes that have a schedule."""
    from halpipe.pipeline.transitions import switch_tables

    schedule = scheduled.schedule
    switched = switch_tables(
        model, schedule, lambda table: not _broken_switch(model, schedule, table), all_or_none=all_or_none
    )
    return replace(
        scheduled,
        schedule=replace(schedule, transitions=switched.tables),
        diagnostics=(*scheduled.diagnostics, *switched.diagnostics),
        lacks_only_transitions=scheduled.is_complete and bool(switched.diagnostics),
    )


def _broken_switch(model: TaskModel, schedule: Schedule, table: TransitionTable) -> list[Diagnostic]:
    """Return what verify finds in one table, on its own with its two modes."""
    pair = (table.source, table.target)
    modes = tuple(mode for mode in model.modes if mode.name in pair)
    listed = tuple(t for t in model.allowed_transitions() if (t.source, t.target) == pair)
    alone = replace(model, modes=modes, transitions=listed)
    tables = tuple(mode for mode in schedule.modes if mode.name in pair)
    return [d for d in verify_schedule(alone, replace(schedule, modes=tables, transitions=(table,))) if d.is_error]


def _refuse_broken_claims(model: TaskModel, schedule: Schedule) -> None:
    """Stop with an internal error if verify finds fault with a mode that calls itself valid."""
    from halpipe.models import Status

    claimed = tuple(mode for mode in schedule.modes if mode.status is Status.VALID)
    names = {mode.name for mode in claimed}
    alone = replace(model, modes=tuple(mode for mode in model.modes if mode.name in names), transitions=())
    wrong = [d for d in verify_schedule(alone, replace(schedule, modes=claimed)) if d.is_error] if claimed else []
    if wrong:
        raise HalpipeError(INVALID_SOLUTION(f"verify finds {len(wrong)} violations"), *wrong, exit=Exit.INTERNAL)


def explain_failure(model: TaskModel, scheduled: Scheduled, *, interrupted: bool) -> list[Diagnostic]:
    """Say of a search that did not finish which modes lack a schedule and what their best placement still breaks."""
    from halpipe.models import Status
    from halpipe.pipeline.codes import INTERRUPTED, NOT_FOUND, STILL_BROKEN

    failed = tuple(mode for mode in scheduled.schedule.modes if mode.status is Status.NOT_FOUND)
    missing = [mode.name for mode in model.modes if mode.name not in {m.name for m in scheduled.schedule.modes}]
    code = INTERRUPTED if interrupted else NOT_FOUND
    found = []
    for mode in failed:
        cost = f", best cost {mode.cost.total}" if mode.cost else ""
        help = "raise --budget, try another --seed, or relax what is named below"
        found.append(
            code(f"no valid schedule yet{cost}", at=model.mode(mode.name).at, path=f'mode "{mode.name}"', help=help)
        )
    if interrupted and missing:
        found.append(code(f"not searched: {', '.join(missing)}", at=model.at))
    alone = replace(model, modes=tuple(model.mode(mode.name) for mode in failed), transitions=())
    claims = tuple(replace(mode, status=Status.VALID, cost=None, chains=()) for mode in failed)
    broken = verify_schedule(alone, replace(scheduled.schedule, modes=claims)) if failed else []
    found += [STILL_BROKEN(d.message, path=d.path) for d in broken if d.is_error]
    return found


def verify_schedule(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return every violation that the independent checker finds."""
    from halpipe.pipeline.verify import verify

    return list(verify(model, schedule))


def export(format: str, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
    """Verify, then write; return the contents by relative file name, the main output as ``""``."""
    writer = exporter(format)
    if schedule is not None:
        findings = Findings(validate_model(model))
        findings.stop_on_errors()
        findings.extend(verify_schedule(model, schedule))
        findings.stop_on_errors()
    return writer.write(model, schedule, options)
