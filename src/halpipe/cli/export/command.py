"""The command of an exporter: the arguments of every format, then what may be chosen of this one."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import output
from halpipe.cli.export import callbacks, onto
from halpipe.cli.export.request import Request, parameter
from halpipe.cli.export.writing import Folder, ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, ScheduleFile, Verbose
from halpipe.exporters.common.choices import Choice, Form, choices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.exporters.common.base import Exporter


def command_of(exporter: Exporter) -> Callable[..., int]:
    """Return the function that typer makes the command of."""
    further, answer = _further(exporter.name)
    parameters = [*_common(exporter), *map(_parameter, choices(exporter.options)), *further, *_forms()]

    def export(**given: Any) -> int:
        output.choose(given.pop("format"), quiet=given.pop("quiet"), verbose=given.pop("verbose"))
        common = {name: given.pop(name) for name in ("mode", "title") if name in given}
        chosen = {each.attribute: _value(each, given.pop(each.attribute)) for each in choices(exporter.options)}
        options = exporter.options(**common, **chosen)
        model, schedule, target = (given.pop(name) for name in ("model", "schedule", "output_file"))
        return answer(Request(exporter, model, schedule, target, options, given))

    signature = inspect.Signature([p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters])
    export.__signature__ = signature  # type: ignore[attr-defined]
    export.__annotations__ = {p.name: p.annotation for p in parameters}
    export.__doc__ = exporter.help or f"Write: {exporter.summary}."
    return export


def _further(name: str) -> tuple[list[inspect.Parameter], Callable[[Request], int]]:
    """Return what the command of a format takes beyond what the exporter states, and what it then does."""
    if name == "arxml":
        return onto.PARAMETERS, onto.export
    if name == "ros":
        return callbacks.PARAMETERS, callbacks.export
    return [], export_files


def _common(exporter: Exporter) -> Iterator[inspect.Parameter]:
    yield parameter("model", ModelFile)
    if exporter.suffix:  # where a model alone is not enough, the exporter says why
        yield parameter("schedule", OptionalSchedule, "")
    else:
        yield parameter("schedule", ScheduleFile)
    yield parameter("output_file", Output if exporter.suffix else Folder)
    yield parameter("mode", ModeName, "")
    if exporter.titled:
        yield parameter("title", Title, "")


def _forms() -> Iterator[inspect.Parameter]:
    yield parameter("format", DiagnosticFormat, None)
    yield parameter("quiet", Quiet, False)
    yield parameter("verbose", Verbose, False)


def _parameter(each: Choice) -> inspect.Parameter:
    option = f"--{each.name}"
    if each.form is Form.SWITCH:
        return parameter(each.attribute, Annotated[bool, typer.Option(option, help=each.help)], each.default)
    annotation = Annotated[str, typer.Option(option, metavar=each.metavar or None, help=each.help)]
    if each.required:
        return parameter(each.attribute, annotation)
    return parameter(each.attribute, annotation, "" if each.default is None else str(each.default))


def _value(each: Choice, given: Any) -> Any:
    if each.form is Form.SWITCH:
        return given
    try:
        return each.value_of(given)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint=f"--{each.name}") from None
