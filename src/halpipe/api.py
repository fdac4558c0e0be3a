"""The whole tool from Python, for notebooks and servers: what the command line does, on values instead of files.

Each function raises `halpipe.core.diagnostics.HalpipeError` with every finding when it cannot go on. What they take and
return are the frozen values of `halpipe.models`, whose fields take ``"5ms"`` for a duration and lists for tuples.
Everything is imported where it is used, so that ``import halpipe`` costs nothing.
"""

from __future__ import annotations

import time
from dataclasses import fields
from fractions import Fraction
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.files import YamlMap
    from halpipe.importers.common.base import Imported
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.compare import Comparison
    from halpipe.pipeline.diff import Change, ScheduleDiff
    from halpipe.pipeline.explain.explanation import Explanation
    from halpipe.pipeline.whatif.sensitivity import Sensitivity
    from halpipe.pipeline.whatif.size import Answer

# ------------------------------------------------------------------------------------------------ in and out


def import_model(format: str, *paths: str, overlay: str | Sequence[str] = (), **options: Any) -> Imported:
    """Read sources of a format (``arxml``, ``ros``, ``amalthea``), with overlays on them.

    `options` are those of the format as on the command line: ``strict=True``, ``granularity="event"``, ``ecu="Body"``.
    Return the model with its account: ``.model``, ``.diagnostics``, ``.coverage``. Raise ``TypeError`` for an option
    that importers do not have.
    """
    from halpipe.flow.formats import import_model as read
    from halpipe.importers.common.base import ImportOptions

    known = {field.name for field in fields(ImportOptions)} - {"overlay"}
    _refuse_unknown("import_model", options, known)
    overlays = [overlay] if isinstance(overlay, str) else list(overlay)
    return read(format, paths, overlays, ImportOptions(**options))


def load(path: str) -> TaskModel:
    """Read a task model XML file."""
    from halpipe.importers.native import read_model

    return read_model(path)


def load_schedule(path: str) -> Schedule:
    """Read a schedule XML file; whether it is valid is for `verify` to say."""
    from halpipe.importers.native import read_schedule

    return read_schedule(path)


def save(value: TaskModel | Schedule, path: str) -> TaskModel | Schedule:
    """Write a model or a schedule as XML, all of it or nothing; return what `load` or `load_schedule` would return.

    Schedule the model that is returned: then the schedule says which file it belongs to.
    """
    from halpipe.core.files import write_output
    from halpipe.exporters.native import format_model, format_schedule
    from halpipe.importers.native import parse_model, parse_schedule
    from halpipe.models import Schedule

    if isinstance(value, Schedule):
        content = format_schedule(value)
        write_output(path, content)
        return parse_schedule(content, path)
    content = format_model(value)
    write_output(path, content)
    return parse_model(content, path)


def export(
    format: str, model: TaskModel, schedule: Schedule | None = None, *, mode: str = "", title: str = "", **options: Any
) -> dict[str, bytes]:
    """Return the files of an export by relative name, the main one as ``""``; refuse a schedule that is not valid.

    `options` are the settings that a pipeline file has for the format: ``platform="regulators.yaml"``.
    """
    from halpipe.core.diagnostics import Findings
    from halpipe.core.settings import Fields
    from halpipe.exporters.common.base import ExportOptions
    from halpipe.exporters.common.choices import keys_of, options_of
    from halpipe.flow.formats import export as write
    from halpipe.flow.formats import exporter

    writer = exporter(format)
    chosen = ExportOptions(title=title, mode=mode)
    if options:
        findings, keys = Findings(), keys_of(writer.options) or ("",)
        stated = _as_stated({name.replace("_", "-"): value for name, value in options.items()})
        chosen = options_of(writer.options, chosen, Fields("", findings, stated, f"export {format}", keys), ".")
        findings.stop_on_errors()
    return write(format, model, schedule, chosen)


def _as_stated(values: dict[str, Any]) -> YamlMap:
    """Return values as a settings file would state them."""
    from halpipe.core.files import YamlMap

    stated = YamlMap(0)
    for name, value in values.items():
        if isinstance(value, dict):
            stated[name] = _as_stated(value)
        else:
            stated[name] = value if isinstance(value, bool | list) else str(value)
    return stated


# ------------------------------------------------------------------------------------------------ find and check


def validate(model: TaskModel) -> list[Diagnostic]:
    """Return everything that is wrong or odd with a model; it can be scheduled if none of it is an error."""
    from halpipe.pipeline.checked import validate_model

    return validate_model(model)


def schedule(
    model: TaskModel,
    *,
    seed: int = 1,
    budget: int | None = None,
    optimise: Iterable[str] = (),
    target: Fraction | int | str | None = None,
    freeze: Schedule | None = None,
    near: Schedule | None = None,
    modes: Iterable[str] = (),
    tick: str = "",
    engine: str = "anneal",
    portfolio: int | None = None,
    workers: int = 1,
    time_limit: float = 0,
    progress: Callable[[str, int, int, int], bool | None] | None = None,
) -> Schedule:
    """Return a verified schedule of every mode, or of those named in `modes`; the options are those of the command.

    `optimise` names objectives, the most important first: ``("chains", "jitter", "margin", "preemptions", "cost")``.
    A cost F of at most `target` ends the improvement.
    `progress` is called with mode, moves made, moves allowed and the least cost so far, from several threads; it ends
    the search by returning False. A `time_limit` in seconds does, too; without a `budget` nothing else does, so that
    what is found depends on the machine. Raise `HalpipeError` if no schedule is found, with what the best placement
    still breaks.
    """
    from halpipe.core.diagnostics import Exit, HalpipeError
    from halpipe.core.durations import Duration
    from halpipe.pipeline.checked import explain_failure, schedule_model
    from halpipe.pipeline.solve.goals import check_target, objectives_of
    from halpipe.pipeline.solve.schedule import DEFAULT_PORTFOLIO, SearchOptions
    from halpipe.pipeline.solve.workers import Workers

    chosen = tuple(modes)
    for name in chosen:
        model.mode(name)
    objectives = objectives_of(",".join(optimise))
    end_cost = None if target is None else Fraction(target)
    check_target(end_cost, objectives)
    options = SearchOptions(
        seed=seed,
        budget=budget,
        optimise=objectives,
        target=end_cost,
        shipped=freeze,
        near=near,
        modes=chosen,
        tick=Duration.parse(tick) if tick else None,
        engine=engine,
        portfolio=DEFAULT_PORTFOLIO if portfolio is None else portfolio,
        workers=Workers(workers),
    )
    if time_limit:
        options = options.by_the_clock()
    end = time.monotonic() + time_limit if time_limit else None

    def go_on(*done: Any) -> bool:
        wanted = progress is None or progress(*done) is not False
        return wanted and (end is None or time.monotonic() < end)

    scheduled = schedule_model(model, options, go_on)
    if not scheduled.is_complete:
        found = explain_failure(model, scheduled, interrupted=scheduled.stopped)
        raise HalpipeError(*found, exit=Exit.INTERRUPTED if scheduled.stopped else Exit.NOT_FOUND)
    return scheduled.schedule


def verify(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return every violation that the independent check finds: none if the schedule is valid."""
    from halpipe.pipeline.checked import verify_schedule

    return [found for found in verify_schedule(model, schedule) if found.is_error]


# ------------------------------------------------------------------------------------------------ ask and compare


def explain(model: TaskModel, mode: str | None = None) -> Explanation:
    """Return why a model, or one of its modes, has no schedule: a proof where there is one, and what would help."""
    from halpipe.pipeline.explain.explanation import explain as explain_model

    return explain_model(model, mode)


def size(
    model: TaskModel, *, units: str = "", bandwidth: str = "", mode: str = "", seed: int = 1, budget: int = 2000
) -> Answer:
    """Return how few units of a type, or how little bandwidth of a resource, are enough; or how far WCETs may grow."""
    from halpipe.pipeline.solve.schedule import SearchOptions
    from halpipe.pipeline.whatif.size import ask, fewest_units, largest_factor, lowest_bandwidth, of_modes
    from halpipe.pipeline.whatif.trial import Search

    asked = of_modes(model, mode)
    if units:
        question = fewest_units(asked, units)
    else:
        question = lowest_bandwidth(asked, bandwidth) if bandwidth else largest_factor(asked)
    return ask(question, Search(SearchOptions(seed=seed, budget=budget), lambda *_: True))


def sensitivity(model: TaskModel, schedule: Schedule, tasks: Iterable[str] = ()) -> list[Sensitivity]:
    """Return how much the WCET of each version may grow before the schedule is no longer valid."""
    from halpipe.pipeline.checked import refuse_invalid
    from halpipe.pipeline.whatif.sensitivity import sensitivities

    refuse_invalid(model, schedule)
    return list(sensitivities(model, schedule, frozenset(tasks)))


def diff(before: TaskModel | Schedule, after: TaskModel | Schedule) -> tuple[Change, ...] | ScheduleDiff:
    """Return what differs between two models, or between two schedules."""
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.diff import diff_models, diff_schedules

    if isinstance(before, Schedule) and isinstance(after, Schedule):
        return diff_schedules(before, after)
    if isinstance(before, TaskModel) and isinstance(after, TaskModel):
        return diff_models(before, after)
    raise TypeError("diff: give two models or two schedules")


def compare(schedule: Schedule, trace: str, *, mode: str = "", tolerance: str = "0ms") -> list[Comparison]:
    """Compare what ran, as the file or directory `trace` recorded it, with the schedule; one answer for each line."""
    from halpipe.core.durations import Duration
    from halpipe.importers.traces import read_traces
    from halpipe.pipeline.compare import CompareOptions
    from halpipe.pipeline.compare import compare as compare_line

    options = CompareOptions(mode=mode, tolerance=Duration.parse(tolerance))
    return [compare_line(schedule, line, options) for line in read_traces(trace).traces]


# ------------------------------------------------------------------------------------------------ plain tables


def jobs(schedule: Schedule) -> list[dict[str, Any]]:
    """Return the jobs of all modes and tables as plain rows, a part of a job with gaps in a row of its own.

    Times are exact milliseconds (`Fraction`). ``pandas.DataFrame(halpipe.jobs(schedule))`` is a data frame.
    """
    from halpipe.flow.rows import job_rows

    return job_rows(schedule)


def loads(schedule: Schedule) -> list[dict[str, Any]]:
    """Return the loads of units and resources in every mode as plain rows; shares are exact."""
    from halpipe.flow.rows import load_rows

    return load_rows(schedule)


def latencies(schedule: Schedule) -> list[dict[str, Any]]:
    """Return reaction time and data age of the chains in every mode as plain rows, in exact milliseconds."""
    from halpipe.flow.rows import latency_rows

    return latency_rows(schedule)


def _refuse_unknown(function: str, options: dict[str, Any], known: set[str]) -> None:
    from halpipe.core.suggest import did_you_mean

    for name in options:
        if name not in known:
            hint = did_you_mean(name, sorted(known), "there are: " + ", ".join(sorted(known)))
            raise TypeError(f"{function}() has no option {name!r}; {hint}")
