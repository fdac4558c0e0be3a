"""``halpipe run``."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Verbose, WorkerCount
from halpipe.core.diagnostics import Exit


def run(
    pipeline: Annotated[
        str, typer.Argument(metavar="PIPELINE", help="YAML file that names sources, stages and exports.")
    ],
    workers: WorkerCount = None,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Run a whole pipeline from one file: import, validate, schedule, verify, export."""
    from halpipe.cli.export.writing import write_export
    from halpipe.cli.import_ import summarise
    from halpipe.cli.searching import find_schedule, workers_of
    from halpipe.core.files import refuse_inputs, refuse_name, write_output
    from halpipe.exporters.native import format_model
    from halpipe.flow import formats
    from halpipe.flow.plan import read_plan
    from halpipe.importers.native import read_model, read_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    plan = read_plan(pipeline)
    outputs = [step.output for step in plan.exports]
    refuse_inputs(*([plan.model] if plan.imports is not None else []), plan.schedule, *outputs)
    if plan.imports is not None:
        source = plan.imports
        imported = formats.import_model(source.format, source.inputs, source.options)
        output.report(imported.diagnostics)
        refuse_inputs(plan.model, plan.schedule, *outputs)  # the sources are known by now
        write_output(plan.model, format_model(imported.model))
        summarise(imported, plan.model, every=False)
    model = read_model(plan.model)
    refuse_inputs(plan.schedule, *outputs)  # before the search, not after it
    for step in plan.exports:
        refuse_name(step.output, *formats.endings_of(step.format, step.options))
    for file in (plan.model, plan.schedule):
        refuse_name(file, ".xml")
    code = find_schedule(model, replace(plan.search, workers=workers_of(workers)), plan.schedule)
    if code not in (Exit.OK, Exit.FINDINGS):
        return code
    schedule = read_schedule(plan.schedule)
    for step in plan.exports:
        write_export(formats.export_with_remarks(step.format, model, schedule, step.options), step.output)
    return code
