"""The stages of the tool chain and the registry that wires them: the one place where formats and pipeline meet.

    sources --import--> model --validate--> model --schedule--> schedule --verify--> schedule --export--> files

Each stage is a function of its inputs and options. Order matters: nothing is scheduled that does not validate,
and nothing is exported that does not verify.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from halpipe.diagnostics import Diagnostic, Exit, Findings, HalpipeError, Severity, error, warning
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.base import Checked, CheckOptions, Deployment, Target
    from halpipe.exporters.base import Exporter, ExportOptions
    from halpipe.exporters.riscv import RiscvOptions
    from halpipe.exporters.riscv.prepare import Prepared
    from halpipe.importers.base import Imported, Importer, ImportOptions
    from halpipe.models import Schedule, TaskModel, TransitionTable
    from halpipe.pipeline.solve.quantise import BurstGrid
    from halpipe.pipeline.solve.schedule import OnProgress, Scheduled, SearchOptions
    from halpipe.pipeline.solve.workers import Workers
    from halpipe.pipeline.transitions import Switched

UNKNOWN_FORMAT = error(
    "HAL0901", "Unknown format", "No importer or exporter, or no check of bundles, of that name is installed."
)
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
DEPLOYMENTS = "halpipe.deployments"


def formats(group: str) -> list[str]:
    """Return the names of the installed importers, exporters or kinds of bundles, in order."""
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


def deployment(name: str) -> Deployment:
    """Return the check of the kind of bundles called `name`."""
    return _registered(DEPLOYMENTS, name)  # type: ignore[return-value]


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

    return list(validate(model))


def schedule_model(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Validate, search and verify; a schedule that leaves here as valid has passed the independent check.

    A mode that provably has no schedule is not searched for one: raise `HalpipeError` with the proof.
    """
    findings = Findings(validate_model(model))
    findings.stop_on_errors()
    refuse_hopeless(model, options.modes)
    if options.grid is not None:
        return _schedule_on_grid(model, options, options.grid, on_progress)
    best = _search(model, options, on_progress)
    return replace(best, diagnostics=(*findings.items, *best.diagnostics))


def _search(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Place the modes, and find tables between them; where some are missing, try other placements of the modes."""
    from halpipe.pipeline.solve.schedule import schedule_model as search

    best: Scheduled | None = None
    doubtful: tuple[tuple[str, str], ...] | None = None
    moves = 0
    for attempt in range(ATTEMPTS):
        scheduled = search(model, replace(options, attempt=attempt), on_progress)
        _refuse_broken_claims(model, scheduled.schedule)
        moves += scheduled.moves
        switched = _switched(model, scheduled, options.workers, on_progress, doubtful)
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
        is_spent = moves > options.budget * len(model.tasks) or (attempt + 1) * jobs > ATTEMPTED_JOBS
        if not scheduled.is_complete or scheduled.unimproved or not switched.failed or is_spent:
            break
    assert best is not None, "there is at least one attempt"
    return replace(best, moves=moves, stopped=scheduled.stopped)


def _schedule_on_grid(model: TaskModel, options: SearchOptions, grid: BurstGrid, on_progress: OnProgress) -> Scheduled:
    """Schedule the model as bandwidth regulators serve it, and hold the result to the model as it is."""
    from halpipe.pipeline.solve.codes import GRID_BREAKS, GRID_TICK, GRID_TIGHT
    from halpipe.pipeline.solve.quantise import describe, quantise, restore

    path = f'model "{model.name}"'
    if options.tick is not None and options.tick % grid.window:
        near = grid.window * max(1, round(options.tick / grid.window))
        message = f"the tick {options.tick} is not a multiple of the window {grid.window} of platform {grid.name}"
        raise HalpipeError(GRID_TICK(message, at=model.at, path=path, help=f"leave it away, or use {near}"))
    served = quantise(model, grid)
    try:
        scheduled = schedule_model(served, replace(options, grid=None), on_progress)
    except HalpipeError as failure:
        if failure.exit is not Exit.INFEASIBLE:
            raise
        help = "use longer windows, less overshoot, lower bounds, or leave --quantise away"
        tight = GRID_TIGHT(describe(model, grid), at=model.at, path=path, help=help)
        raise HalpipeError(tight, *failure.diagnostics, exit=failure.exit) from None
    schedule = restore(model, scheduled.schedule)
    if scheduled.is_complete:
        asked = replace(
            model, modes=tuple(mode for mode in model.modes if mode.name in {m.name for m in schedule.modes})
        )
        broken = [found for found in verify_schedule(asked, schedule) if found.is_error]
        lacking = {found.path for found in scheduled.diagnostics if found.is_error}
        if broken and not lacking:
            help = "try another --seed, or a shorter window"
            breaks = GRID_BREAKS(f"verify finds {len(broken)} violations", at=model.at, path=path, help=help)
            raise HalpipeError(breaks, *broken, exit=Exit.NOT_FOUND)
    return replace(scheduled, schedule=schedule)


def burst_grid(platform_file: str) -> BurstGrid:
    """Return the grid of a regulator platform, for `SearchOptions`."""
    from halpipe.exporters.regulator.backends import backend
    from halpipe.exporters.regulator.platform import WRITE, read_platform
    from halpipe.exporters.regulator.tables import reserve_of
    from halpipe.pipeline.solve.quantise import BurstGrid

    platform = read_platform(platform_file)
    return BurstGrid(
        name=platform.name,
        window=platform.window,
        cycle=platform.window / platform.cycles,
        resource=platform.resource,
        promise=platform.promise,
        capacity=platform.window_capacity,
        burst=platform.burst,
        reserve=reserve_of(platform, backend(platform.backend)),
        writes=platform.unspecified == WRITE,
    )


def refuse_hopeless(model: TaskModel, modes: Sequence[str]) -> None:
    """Stop with the witnesses if some mode (of those named, or all) certainly has no schedule; takes an instant."""
    from halpipe.pipeline.explain.witnesses import find_witnesses

    proofs = [found for hopeless in find_witnesses(model, modes) for found in hopeless.diagnostics]
    if proofs:
        raise HalpipeError(*proofs, exit=Exit.INFEASIBLE)


def _switched(
    model: TaskModel,
    scheduled: Scheduled,
    workers: Workers,
    on_progress: OnProgress,
    doubtful: tuple[tuple[str, str], ...] | None,
) -> Switched:
    """Find the transition tables between the modes that have a schedule.

    A search that was stopped while it improved them gets its tables nevertheless: then all is there to be used.
    """
    from halpipe.pipeline.solve.schedule import SWITCHES
    from halpipe.pipeline.transitions import switch_tables

    def go_on(done: int, total: int) -> bool:
        return on_progress(SWITCHES, done, total, 0) or scheduled.unimproved

    return switch_tables(model, scheduled.schedule, _is_sound_switch, go_on, workers, doubtful)


def _is_sound_switch(model: TaskModel, schedule: Schedule, table: TransitionTable) -> bool:
    """Ask verify about one table between two modes that it has accepted."""
    from halpipe.pipeline.verify import verify_switches

    return not any(d.is_error for d in verify_switches(model, replace(schedule, transitions=(table,))))


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
    from halpipe.pipeline.solve.codes import INTERRUPTED, NOT_FOUND, STILL_BROKEN

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
    if not failed and not missing:
        text = "every mode has a valid schedule, but not every mode pair was searched for its transition table"
        found.append(code(text, at=model.at, help="go on with --resume"))
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
        _refuse_invalid(model, schedule)
    return writer.write(model, schedule, options)


def _refuse_invalid(model: TaskModel, schedule: Schedule) -> None:
    """Stop unless the model validates and the schedule verifies."""
    findings = Findings(validate_model(model))
    findings.stop_on_errors()
    findings.extend(verify_schedule(model, schedule))
    findings.stop_on_errors()


def open_target(path: str) -> Target:
    """Open a bundle with the model and the schedule that it carries, which must verify."""
    from halpipe.bundles import MODEL, SCHEDULE, open_bundle
    from halpipe.deploy.base import Target
    from halpipe.importers.native import parse_model, parse_schedule

    bundle = open_bundle(path)
    model = parse_model(bundle.files[MODEL], bundle.at(MODEL).file)
    schedule = parse_schedule(bundle.files[SCHEDULE], bundle.at(SCHEDULE).file)
    _refuse_invalid(model, schedule)
    return Target(bundle=bundle, model=model, schedule=schedule)


def prepare_model(model: TaskModel, options: RiscvOptions, *, dummy: bool) -> Prepared:
    """Give a model the memory phases that it needs on a target; it must validate before and after."""
    from halpipe.exporters.riscv.prepare import prepare

    Findings(validate_model(model)).stop_on_errors()
    prepared = prepare(model, options, dummy=dummy)
    findings = Findings([*prepared.diagnostics])
    findings.extend(found for found in validate_model(prepared.model) if found.is_error)
    findings.stop_on_errors()
    return prepared


def check_bundle(path: str, options: CheckOptions) -> Checked:
    """Open a bundle, verify the schedule it carries, and have its kind played and held against it."""
    target = open_target(path)
    return deployment(target.bundle.kind).check(target, options)
