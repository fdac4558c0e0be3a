"""halpipe: from vehicle software models to verified time-triggered schedules and what hardware loads.

The whole tool in six functions; each raises `halpipe.diagnostics.HalpipeError` with every finding when it cannot
go on. What they take and return are the frozen values of `halpipe.models`.

    model = halpipe.load("model.xml")
    schedule = halpipe.schedule(model, seed=1)
    assert not halpipe.verify(model, schedule)
    page = halpipe.export("report", model, schedule)[""]
"""

from __future__ import annotations

TYPE_CHECKING = False  # spares the start `typing`, during which Ctrl-C would still show as a traceback

if TYPE_CHECKING:
    from halpipe.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.explain.explanation import Explanation

__version__ = "0.1.0"

__all__ = ["__version__", "explain", "export", "load", "schedule", "validate", "verify"]


def load(path: str) -> TaskModel:
    """Read a task model XML file."""
    from halpipe.importers.native import read_model

    return read_model(path)


def validate(model: TaskModel) -> list[Diagnostic]:
    """Return everything that is wrong or odd with a model; it can be scheduled if none of it is an error."""
    from halpipe.pipeline.checked import validate_model

    return validate_model(model)


def schedule(model: TaskModel, *, seed: int = 1, budget: int | None = None) -> Schedule:
    """Return a verified schedule of every mode; raise `HalpipeError` if none is found in `budget` moves per task."""
    from halpipe.diagnostics import Exit, HalpipeError
    from halpipe.pipeline.checked import explain_failure, schedule_model
    from halpipe.pipeline.solve.schedule import SearchOptions

    options = SearchOptions(seed=seed, budget=budget)
    scheduled = schedule_model(model, options, lambda *progress: True)
    if not scheduled.is_complete:
        raise HalpipeError(*explain_failure(model, scheduled, interrupted=False), exit=Exit.NOT_FOUND)
    return scheduled.schedule


def verify(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return every violation that the independent check finds: none if the schedule is valid."""
    from halpipe.pipeline.checked import verify_schedule

    return [found for found in verify_schedule(model, schedule) if found.is_error]


def explain(model: TaskModel) -> Explanation:
    """Return why a model has no schedule, with a proof where there is one, and what would help."""
    from halpipe.pipeline.explain.explanation import explain as explain_model

    return explain_model(model)


def export(format: str, model: TaskModel, schedule: Schedule | None = None) -> dict[str, bytes]:
    """Return the files of an export by relative name, the main one as ``""``; refuse a schedule that is not valid."""
    from halpipe.exporters.base import ExportOptions
    from halpipe.flow.formats import export as export_stage

    return export_stage(format, model, schedule, ExportOptions())
