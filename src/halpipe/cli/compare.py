"""``halpipe compare``."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.options import takes
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.options import WITHOUT_EFFECT, Values, refuse_unused

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.compare import CompareOptions, Comparison
    from halpipe.pipeline.compare.learning import LearnOptions

COLUMNS = ("task", "jobs", "missing", "extra", "start: least", "median", "worst", "end: worst", "longest")
CHAINS = ("chain", "figure", "count", "least", "median", "p99", "worst", "verified", "limit")


@takes("halpipe.pipeline.compare.learning:LearnOptions")
def compare(
    schedule: Annotated[
        str, typer.Argument(metavar="SCHEDULE", help="Schedule XML, or a bundle of regulators; - is standard input.")
    ],
    trace: Annotated[
        str,
        typer.Argument(
            metavar="TRACE",
            help="CSV, BTF, Trace Event JSON, Perfetto, ftrace, trace.dat, MDF, CTF; of regulators a CSV of bytes.",
        ),
    ],
    options: Values,
    model: Annotated[
        str, typer.Option(metavar="FILE", help="Model of the schedule, for its WCETs and chains.", show_default=False)
    ] = "",
    learn: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="Write what the trace shows of WCETs and periods: an overlay, or the corrected model (.xml).",
            show_default=False,
        ),
    ] = "",
    histogram: Annotated[
        bool, typer.Option("--histogram", help="Show how start errors, responses, run times and jitter are spread.")
    ] = False,
) -> int:
    """Compare what ran with the schedule: lateness, overruns, order, missing and extra jobs of every task."""
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.importers.traces import read_traces
    from halpipe.pipeline.compare import compare as compare_line
    from halpipe.pipeline.compare.learning import LearnOptions

    chosen = LearnOptions(**options)
    if not learn:
        refuse_unused(chosen, "compare without --learn", ("quantile", "margin"))
    if os.path.isdir(schedule):
        for name, value in (("model", model), ("learn", learn), ("histogram", histogram)):
            if value:
                help = "omit it: a bundle of regulators has budgets of bytes, and no jobs"
                raise HalpipeError(WITHOUT_EFFECT(f'compare: "{name}" has no effect here', help=help), exit=Exit.USAGE)
        return _counters(schedule, trace, chosen)
    tables = read_schedule(schedule)
    recording = read_traces(trace)
    system = read_model(model) if model else None
    lines = [compare_line(tables, line, chosen, system) for line in recording.traces]
    found = [*recording.diagnostics, *(d for line in lines for d in line.diagnostics)]
    if output.is_text():
        _show(lines, has_model=system is not None)
        if histogram:
            _show_histograms(lines, system)
    output.report(found, as_result=True)
    if learn:
        _learn(lines, chosen, system, trace, learn)
    return Exit.FINDINGS if any(d.is_error for d in found) else Exit.OK


def _learn(lines: list[Comparison], options: LearnOptions, model: TaskModel | None, source: str, target: str) -> None:
    """Write what a recording teaches: a corrected model where `target` is XML, else an overlay."""
    from halpipe.core.files import write_output
    from halpipe.exporters.native import format_model
    from halpipe.pipeline.compare.learning import described, learn

    learned = learn(lines, options, model)
    if not target.endswith(".xml"):
        write_output(target, learned.overlay(described(options, source)))
    elif model is None:
        help = "give the model with --model, or name a .yaml file for an overlay"
        raise HalpipeError(
            WITHOUT_EFFECT('compare: "learn" writes a corrected model of --model', help=help), exit=Exit.USAGE
        )
    else:
        write_output(target, format_model(learned.corrected(model)))


USAGE = ("table", "unit", "direction", "samples", "promised", "granted", "used")


def _counters(bundle: str, file: str, options: CompareOptions) -> int:
    from halpipe.core.files import read_bytes
    from halpipe.deploy.regulator.counters import compare_counters
    from halpipe.flow.formats import open_target

    refuse_unused(options, "compare with a bundle of regulators", ("tolerance", "origin"))
    counted = compare_counters(open_target(bundle), read_bytes(file).decode("utf-8-sig", "replace"), file, options.mode)
    if output.is_text():
        rows = [
            (*place, str(u.samples), str(round(u.promised)), str(u.granted), str(u.used))
            for place, u in sorted(counted.usage.items())
        ]
        output.table(USAGE, rows, right=range(3, len(USAGE)))
    output.report(counted.diagnostics, as_result=True)
    return Exit.FINDINGS if any(d.is_error for d in counted.diagnostics) else Exit.OK


def _show(lines: list[Comparison], *, has_model: bool) -> None:
    columns = (*COLUMNS, "reserved", *(("WCET",) if has_model else ()))
    for line in lines:
        if line.name:
            output.result(line.name)
        rows = []
        for row in line.rows:
            spans = [row.least, row.median, row.worst, row.worst_end, row.longest, row.reserved]
            spans += [row.wcet] if has_model else []
            rows.append((row.task, str(row.seen), str(row.missing), str(row.extra), *map(_text, spans)))
        output.table(columns, rows, right=range(1, len(columns)))
        if line.chains:
            chains = [
                (c.chain, c.figure, str(c.count), *map(_text, (c.least, c.median, c.p99, c.worst, c.verified, c.limit)))
                for c in line.chains
            ]
            output.table(CHAINS, chains, right=range(2, len(CHAINS)))


SPREAD = ("task", "figure", "least", "worst", "bin")


def _show_histograms(lines: list[Comparison], model: TaskModel | None) -> None:
    from halpipe.pipeline.compare.histograms import BINS, histograms

    columns = (*SPREAD, *(f"#{number}" for number in range(1, BINS + 1)))
    for line in lines:
        rows = [(h.task, h.figure, *map(str, (h.least, h.worst, h.width, *h.counts))) for h in histograms(line, model)]
        output.table(columns, rows, right=range(2, len(columns)))


def _text(span: Duration | None) -> str:
    return "" if span is None else str(span)
