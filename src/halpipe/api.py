"""The whole tool from Python, for notebooks and servers: what the command line does, on values instead of files.

Each function raises `HalpipeError` with every finding when it cannot go on; its text is what the command line shows.
What they take and return are the frozen values of `halpipe.models`, whose fields take ``"5ms"`` for a duration and
lists for tuples. All else is imported where it is used, so that ``import halpipe`` costs nothing.
"""

from __future__ import annotations

import functools
import os
import time
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, overload

from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError
from halpipe.core.options import from_keywords, refuse_unused

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.durations import Duration
    from halpipe.deploy.base import Checked
    from halpipe.importers.common.base import Imported
    from halpipe.models import DurationLike, Schedule, TaskModel
    from halpipe.pipeline.compare import CompareOptions, Comparison
    from halpipe.pipeline.compare.learning import Learned
    from halpipe.pipeline.diff import Change, ScheduleDiff
    from halpipe.pipeline.explain.explanation import Explanation
    from halpipe.pipeline.whatif.sensitivity import Sensitivity
    from halpipe.pipeline.whatif.size import Answer

    FileName = str | os.PathLike[str]

P = ParamSpec("P")
R = TypeVar("R")


def _of_values(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function refuse what is no model or schedule where it takes one: most often the name of a file."""
    positional = function.__code__.co_varnames[: function.__code__.co_argcount]

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        from halpipe.models import Schedule, TaskModel

        kinds = {"model": (TaskModel, "load"), "schedule": (Schedule, "load_schedule")}
        for name, value in (*zip(positional, args, strict=False), *kwargs.items()):
            kind, reader = kinds.get(name, (object, ""))
            if name in positional and value is not None and not isinstance(value, kind):
                given = repr(value)[:60] if isinstance(value, str) else f"a {type(value).__name__}"
                message = f"{function.__name__}(), {name}: a {kind.__name__} is wanted, not {given}"
                raise TypeError(f"{message}; halpipe.{reader} reads one from a file")
        return function(*args, **kwargs)

    return call


# ------------------------------------------------------------------------------------------------ in and out


def import_model(format: str, *paths: FileName, **options: Any) -> Imported:
    """Read sources of a format (``arxml``, ``ros``, ``amalthea``), with overlays on them.

    `options` are those of the format as on the command line: ``strict=True``, ``overlay="o.yaml"``, ``ecu="Body"``.
    Return the model with its account: ``.model``, ``.diagnostics``, ``.coverage``. Raise ``TypeError`` for an option
    that the format does not have.
    """
    from halpipe.flow.formats import import_model as read
    from halpipe.flow.formats import importer

    kind = importer(format).options
    chosen = kind(**from_keywords(f"import_model {format}", kind, options))
    return read(format, [os.fspath(path) for path in paths], chosen)


def load(path: FileName) -> TaskModel:
    """Read a task model XML file."""
    from halpipe.importers.native import read_model

    return read_model(os.fspath(path))


def load_schedule(path: FileName) -> Schedule:
    """Read a schedule XML file; whether it is valid is for `verify` to say."""
    from halpipe.importers.native import read_schedule

    return read_schedule(os.fspath(path))


@overload
def save(value: TaskModel, path: FileName) -> TaskModel: ...
@overload
def save(value: Schedule, path: FileName) -> Schedule: ...
def save(value: TaskModel | Schedule, path: FileName) -> TaskModel | Schedule:
    """Write a model or a schedule as XML, all of it or nothing; return what `load` or `load_schedule` would return.

    Schedule the model that is returned: then the schedule says which file it belongs to.
    """
    from halpipe.core.files import write_output
    from halpipe.exporters.native import format_model, format_schedule
    from halpipe.importers.native import parse_model, parse_schedule
    from halpipe.models import Schedule, TaskModel

    if not isinstance(value, Schedule | TaskModel):
        raise TypeError("save: give a model or a schedule, then the name of a file")
    name = os.fspath(path)
    content = format_schedule(value) if isinstance(value, Schedule) else format_model(value)
    write_output(name, content)
    return parse_schedule(content, name) if isinstance(value, Schedule) else parse_model(content, name)


@_of_values
def export(format: str, model: TaskModel, schedule: Schedule | None = None, **options: Any) -> dict[str, bytes]:
    """Return the files of an export by relative name, the main one as ``""``; refuse a schedule that is not valid.

    `options` are those of the format as on the command line: ``platform="regulators.yaml"``, ``mode="drive"``. Raise
    ``TypeError`` for an option that the format does not have.
    """
    from halpipe.flow.formats import export as write
    from halpipe.flow.formats import exporter

    kind = exporter(format).options
    return write(format, model, schedule, kind(**from_keywords(f"export {format}", kind, options)))


# ------------------------------------------------------------------------------------------------ find and check


@_of_values
def validate(model: TaskModel, tick: DurationLike | None = None) -> list[Diagnostic]:
    """Return everything that is wrong or odd with a model; it can be scheduled if none of it is an error.

    With a `tick`, the grid of the start times, that includes a proof that it is too coarse.
    """
    from halpipe.pipeline.checked import ValidateOptions, validate_model

    return validate_model(model, **from_keywords("validate", ValidateOptions, {"tick": tick}))


@_of_values
def schedule(
    model: TaskModel,
    *,
    workers: int = 1,
    progress: Callable[[str, int, int, int], bool | None] | None = None,
    **options: Any,
) -> Schedule:
    """Return a verified schedule of every mode, or of those named in `modes`; the options are those of the command.

    `optimise` names objectives, the most important first: ``["chains", "jitter", "margin", "preemptions", "cost"]``;
    `freeze` and `near` are schedules, or files. `progress` is called with mode, moves made, moves allowed and the least
    cost so far, from several threads; it ends the search by returning False. A `time_limit` (``"30s"``, or seconds)
    does, too; without a `budget` nothing else does, so that what is found depends on the machine. Raise `HalpipeError`
    if no schedule is found, with what the best placement still breaks.
    """
    from halpipe.flow.searching import search_options
    from halpipe.pipeline.checked import explain_failure, schedule_model
    from halpipe.pipeline.solve.schedule import SearchOptions
    from halpipe.pipeline.solve.workers import WorkerOptions, Workers

    count = from_keywords("schedule", WorkerOptions, {"workers": workers})
    chosen = search_options(from_keywords("schedule", SearchOptions, options), workers=Workers(**count))
    has_time = _clock(chosen.time_limit)

    def go_on(*done: Any) -> bool:
        return (progress is None or progress(*done) is not False) and has_time()

    scheduled = schedule_model(model, chosen, go_on)
    if not scheduled.is_complete:
        found = explain_failure(model, scheduled, interrupted=scheduled.stopped)
        raise HalpipeError(*found, exit=Exit.INTERRUPTED if scheduled.stopped else Exit.NOT_FOUND)
    return scheduled.schedule


def _clock(limit: Duration | None) -> Callable[..., bool]:
    """Return a function that says whether to go on, whatever it is given: until `limit` has passed from now on."""
    end = None if limit is None else time.monotonic() + float(limit.in_unit("s"))
    return lambda *_: end is None or time.monotonic() < end


@_of_values
def verify(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return every violation that the independent check finds: none if the schedule is valid."""
    from halpipe.pipeline.checked import verify_schedule

    return [found for found in verify_schedule(model, schedule) if found.is_error]


# ------------------------------------------------------------------------------------------------ ask and compare


@_of_values
def explain(model: TaskModel, **options: Any) -> Explanation:
    """Return why a model, or one of its modes, has no schedule: a proof where there is one, and what would help.

    `options` are those of the command: ``mode="drive"``, ``remedies=False``, ``schedule=best``.
    """
    from halpipe.flow.searching import explain_options
    from halpipe.pipeline.explain.explanation import ExplainOptions
    from halpipe.pipeline.explain.explanation import explain as explain_model

    chosen = explain_options(from_keywords("explain", ExplainOptions, options))
    return explain_model(model, chosen, _clock(chosen.time_limit))


@_of_values
def size(model: TaskModel, **options: Any) -> Answer:
    """Return how few units of a type, or how little bandwidth of a resource, are enough; or how far WCETs may grow.

    `options` are those of the command: ``units="cpu"``, ``bandwidth="dram"``, ``mode="drive"``.
    """
    from halpipe.pipeline.whatif.size import SizeOptions, answer_of, question_of

    chosen = SizeOptions(**from_keywords("size", SizeOptions, options))
    has_time = _clock(chosen.time_limit)
    return answer_of(question_of(model, chosen), chosen, has_time, has_time)


@_of_values
def sensitivity(model: TaskModel, schedule: Schedule, **options: Any) -> list[Sensitivity]:
    """Return how much the WCET of each version may grow before the schedule is no longer valid.

    `options` are those of the command: ``tasks=["a"]``, ``search=True``.
    """
    from halpipe.pipeline.checked import refuse_invalid
    from halpipe.pipeline.whatif.sensitivity import SensitivityOptions, sensitivities, with_searches

    chosen = SensitivityOptions(**from_keywords("sensitivity", SensitivityOptions, options))
    refuse_unused(chosen, "sensitivity without search")
    refuse_invalid(model, schedule)
    rows = list(sensitivities(model, schedule, frozenset(chosen.tasks)))
    has_time = _clock(chosen.time_limit)
    return with_searches(model, rows, chosen, has_time, has_time) if chosen.search else rows


@overload
def diff(before: TaskModel, after: TaskModel) -> tuple[Change, ...]: ...
@overload
def diff(before: Schedule, after: Schedule) -> ScheduleDiff: ...
def diff(before: TaskModel | Schedule, after: TaskModel | Schedule) -> tuple[Change, ...] | ScheduleDiff:
    """Return what differs between two models, or between two schedules."""
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.diff import diff_models, diff_schedules

    if isinstance(before, Schedule) and isinstance(after, Schedule):
        return diff_schedules(before, after)
    if isinstance(before, TaskModel) and isinstance(after, TaskModel):
        return diff_models(before, after)
    raise TypeError("diff: give two models or two schedules")


@_of_values
def compare(schedule: Schedule, trace: FileName, model: TaskModel | None = None, **options: Any) -> list[Comparison]:
    """Compare what ran, as the file or directory `trace` recorded it, with the schedule; one answer for each line.

    With the `model`, its WCETs stand beside the run times, and the chains are measured.
    `options` are those of the command: ``mode="drive"``, ``tolerance="10us"``, ``origin="3ms"``.
    """
    from halpipe.pipeline.compare import CompareOptions

    chosen = CompareOptions(**from_keywords("compare", CompareOptions, options))
    return _compared(schedule, os.fspath(trace), chosen, model)


def _compared(schedule: Schedule, trace: str, options: CompareOptions, model: TaskModel | None) -> list[Comparison]:
    from halpipe.importers.traces import read_traces
    from halpipe.pipeline.compare import compare as compare_line

    return [compare_line(schedule, line, options, model) for line in read_traces(trace).traces]


@_of_values
def learn(schedule: Schedule, trace: FileName, model: TaskModel | None = None, **options: Any) -> Learned:
    """Return what a recording teaches of WCETs and periods: as `compare`, with the options ``quantile`` and ``margin``.

    ``.corrected(model)`` is the model with it, ``.overlay("run.btf")`` the text of an overlay.
    """
    from halpipe.pipeline.compare.learning import LearnOptions
    from halpipe.pipeline.compare.learning import learn as learn_from

    chosen = LearnOptions(**from_keywords("learn", LearnOptions, options))
    return learn_from(_compared(schedule, os.fspath(trace), chosen, model), chosen, model)


def check(bundle: FileName, **options: Any) -> Checked:
    """Play a bundle that an export wrote, and compare what runs with its schedule.

    `options` are those of ``halpipe deploy check``: ``engine="cosim"``, ``cycles=3``. The bundle is sound if no finding
    of ``.diagnostics`` is an error.
    """
    from halpipe.deploy.base import CheckOptions
    from halpipe.flow.formats import check_bundle

    return check_bundle(os.fspath(bundle), CheckOptions(**from_keywords("check", CheckOptions, options)))


# ------------------------------------------------------------------------------------------------ plain tables


@_of_values
def jobs(schedule: Schedule, *, exact: bool = False) -> list[dict[str, Any]]:
    """Return the jobs of all modes and tables as plain rows, each execution segment in a row of its own.

    Times are in milliseconds, as floats for data frames and plots: ``pandas.DataFrame(halpipe.jobs(schedule))``. With
    `exact`, every number is a `Fraction` or an integer.
    """
    from halpipe.exporters.common.rows import as_floats, job_rows

    return job_rows(schedule) if exact else as_floats(job_rows(schedule))


@_of_values
def utilisation(schedule: Schedule, *, exact: bool = False) -> list[dict[str, Any]]:
    """Return the loads of units and resources in every mode as plain rows; numbers as in `jobs`."""
    from halpipe.exporters.common.rows import as_floats, load_rows

    return load_rows(schedule) if exact else as_floats(load_rows(schedule))


@_of_values
def latencies(schedule: Schedule, model: TaskModel | None = None, *, exact: bool = False) -> list[dict[str, Any]]:
    """Return reaction time, data age and latency of the chains in every mode as plain rows; numbers as in `jobs`.

    Without the model, latencies are those that the schedule states: where the model refers to them.
    """
    from halpipe.exporters.common.rows import as_floats, latency_rows

    if model is not None:
        from halpipe.pipeline.checked import refuse_invalid
        from halpipe.pipeline.measure.cost import with_latencies

        refuse_invalid(model, schedule)
        schedule = with_latencies(model, schedule)
    return latency_rows(schedule) if exact else as_floats(latency_rows(schedule))
