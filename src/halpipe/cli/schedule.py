"""``halpipe schedule`` and ``halpipe run``: one model, several, or a whole pipeline."""

from __future__ import annotations

import os
import sys
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.options import WorkerCount, takes
from halpipe.cli.searching import Stop
from halpipe.core.diagnostics import Exit, located
from halpipe.core.files import STDIO, make_folder, read_bytes, refuse_inputs
from halpipe.core.options import Values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.flow.fleet import Ledger, Solved, Variant
    from halpipe.pipeline.solve.schedule import SearchOptions


@takes("halpipe.pipeline.solve.schedule:SearchOptions")
def schedule(
    model: Annotated[list[str], typer.Argument(metavar="MODEL...", help="Task models XML; - is standard input.")],
    output_file: Annotated[
        str, typer.Option("--output", "-o", metavar="FILE", help="Where to write, of several models a folder.")
    ],
    options: Values,
    share: Annotated[
        bool, typer.Option("--share", help="Of several models: be --near the schedule of the first that has one.")
    ] = False,
    workers: WorkerCount = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a stopped search; the result is the same.")
    ] = False,
) -> int:
    """Find a schedule for every mode and write it once it has passed the independent check.

    Several models, or a folder to write to: each is solved as if it were alone, and what is finished is kept.

    Ctrl-C, or a search that fails, saves the best placement so far beside the output, as NAME.best.xml.
    """
    from halpipe.cli.searching import find_schedule, workers_of
    from halpipe.flow.searching import search_options
    from halpipe.importers.native import read_model

    chosen = search_options(options, workers=workers_of(workers))
    if len(model) > 1 or share or output_file.endswith("/") or os.path.isdir(output_file):
        if resume:
            raise typer.BadParameter("several models are resumed without it; omit it", param_hint="--resume")
        return schedule_fleet(model, chosen, output_file, processes=workers or 1, share=share)
    return find_schedule(read_model(model[0]), chosen, output_file, resume=resume)


@takes()
def run(
    pipeline: Annotated[
        str, typer.Argument(metavar="PIPELINE", help="YAML file that names sources, stages and exports.")
    ],
    workers: WorkerCount = None,
) -> int:
    """Run a whole pipeline from one file: import, validate, schedule, verify, export."""
    from halpipe.cli.export import write_export
    from halpipe.cli.import_ import summarise
    from halpipe.cli.searching import find_schedule, workers_of
    from halpipe.core.files import refuse_inputs, refuse_name, write_output
    from halpipe.exporters.native import format_model
    from halpipe.flow import formats
    from halpipe.flow.plan import read_plan
    from halpipe.importers.native import read_model, read_schedule

    plan = read_plan(pipeline)
    outputs = [step.output for step in plan.exports]
    refuse_inputs(*([plan.model] if plan.imports is not None else []), plan.schedule, *outputs)
    if plan.imports is not None:
        source = plan.imports
        with located(source.at):
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
    with located(plan.at):
        code = find_schedule(model, replace(plan.search, workers=workers_of(workers)), plan.schedule)
    if code not in (Exit.OK, Exit.FINDINGS):
        return code
    schedule = read_schedule(plan.schedule)
    for step in plan.exports:
        with located(step.at):
            write_export(formats.export_with_remarks(step.format, model, schedule, step.options), step.output)
    return code


def schedule_fleet(
    sources: Sequence[str],
    options: SearchOptions,
    folder: str,
    *,
    processes: int,
    share: bool,
) -> int:
    """Solve every model, each as if it were alone; return the exit code of the worst."""
    from halpipe.flow.fleet import EXITS, Ledger, Variant, plain_options

    plain = plain_options(options)
    _refuse_twins(sources)
    variants = [Variant(source, read_bytes(source), plain) for source in sources]
    target = Path(folder)
    make_folder(folder)
    refuse_inputs(*(str(target / variant.target) for variant in variants))
    stop = Stop("stopping; finished schedules are kept", options.time_limit)
    run = _Run(Ledger(target), stop, len(variants))
    with stop.listening():
        if share:
            variants = run.share(variants)
        run.all(variants, processes)
    run.show(variants)
    for outcome, code in EXITS.items():
        if any(solved.outcome is outcome for solved in run.solved.values()):
            return code
    return Exit.OK


def _refuse_twins(sources: Sequence[str]) -> None:
    if STDIO in sources:
        raise typer.BadParameter("a folder of schedules takes files only, not standard input", param_hint="MODEL")
    count = Counter(Path(source).stem for source in sources)
    twins = sorted({source for source in sources if count[Path(source).stem] > 1})
    if twins:
        raise typer.BadParameter(f"their schedules would have one name: {', '.join(twins)}", param_hint="MODEL")


class _Run:
    """Solved schedules so far, by the names of their files."""

    def __init__(self, ledger: Ledger, stop: Stop, total: int) -> None:
        self.ledger, self.stop, self.total = ledger, stop, total
        self.solved: dict[str, Solved] = {}

    def share(self, variants: Sequence[Variant]) -> list[Variant]:
        """Solve the first that can be; let the schedules of the others share with it what they can."""
        from halpipe.flow.fleet import near_to

        for place, variant in enumerate(variants):
            if variant.options["near"] is not None:
                raise typer.BadParameter("give --near or --share, not both", param_hint="--share")
            self.all([variant], 1)
            content = self.solved[variant.target].content
            if content or self.stop.pressed:
                first, rest = variants[: place + 1], variants[place + 1 :]
                return [*first, *(near_to(other, content, variant.target) for other in rest if content)]
        return list(variants)

    def all(self, variants: Sequence[Variant], processes: int) -> None:
        """Solve what is not solved yet, in this process or elsewhere, and write each as soon as it is there."""
        from halpipe.pipeline.solve.workers import map_tasks

        waiting = []
        for variant in variants:
            kept = self.ledger.kept(variant)
            if variant.target not in self.solved and kept is not None:
                self._take(variant, kept)
            elif variant.target not in self.solved:
                waiting.append(variant)
        results = map_tasks(partial(_solve, self.stop), waiting, jobs=processes)
        try:
            for number, solved in results:
                self._take(waiting[number], solved)
                if self.stop.pressed:
                    break
        finally:
            results.close()

    def _take(self, variant: Variant, solved: Solved) -> None:
        from halpipe.flow.fleet import Outcome

        self.solved[variant.target] = solved
        if solved.content and solved.outcome is not Outcome.KEPT:
            self.ledger.keep(variant, solved)
        errors = [found for found in solved.diagnostics if found.is_error or output.Settings.verbose]
        output.report(errors)
        for remark in solved.remarks:
            output.inform(f"{variant.target}: {remark}")
        if not output.Settings.quiet and output.is_terminal(sys.stderr):
            output.write_remark(f"\r{len(self.solved)} of {self.total}")
            if len(self.solved) == self.total:
                output.write_remark("\n")

    def show(self, variants: Sequence[Variant]) -> None:
        """Print what became of each."""
        rows = []
        for variant in variants:
            solved = self.solved.get(variant.target)
            if solved is not None:
                rows.append((variant.source, str(solved.outcome), str(solved.jobs), str(solved.moves)))
        output.table(("model", "outcome", "jobs", "moves"), rows, right=(2, 3))
        if len(rows) < self.total:
            output.inform(f"{self.total - len(rows)} of {self.total} were not begun; repeat the command to continue")


def _solve(stop: Stop, variant: Variant) -> Solved:
    from halpipe.flow.fleet import solve

    return solve(variant, stop.clock(), lambda: stop.pressed)
