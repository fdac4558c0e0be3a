"""Options of searches as command line, pipeline file and Python state them, with the files that they name read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.options import Values, refuse_unused

if TYPE_CHECKING:
    from halpipe.pipeline.explain.explanation import ExplainOptions
    from halpipe.pipeline.solve.schedule import SearchOptions

SCHEDULES, PLATFORM = ("shipped", "near", "schedule"), "grid"
"""Options that name files: of schedules, and of the platform of bandwidth regulators."""


def search_options(values: Values, **further: Any) -> SearchOptions:
    """Return the options that are stated; raise `HalpipeError` if a file is unusable or an option has no effect."""
    from halpipe.pipeline.solve.schedule import SearchOptions

    options = SearchOptions(**_opened(values), **further)
    refuse_unused(options, "schedule")
    return options.by_the_clock() if options.time_limit else options


def explain_options(values: Values) -> ExplainOptions:
    """Return the options of an explanation that are stated."""
    from halpipe.pipeline.explain.explanation import ExplainOptions

    return ExplainOptions(**_opened(values))


def _opened(values: Values) -> Values:
    """Return the values with the contents of files in the place of their names."""
    return {
        name: _read(name, value) if name in (*SCHEDULES, PLATFORM) and isinstance(value, str) else value
        for name, value in values.items()
    }


def _read(name: str, file: str) -> Any:
    if not file:
        return None
    if name == PLATFORM:
        from halpipe.flow.formats import burst_grid

        return burst_grid(file)
    from halpipe.importers.native import read_schedule

    return read_schedule(file)
