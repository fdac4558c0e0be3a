"""``halpipe schedule`` of many models: progress, Ctrl-C, and the table at the end."""

from __future__ import annotations

import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from halpipe.cli import output, streams
from halpipe.cli.stopping import Stop
from halpipe.core.diagnostics import Exit
from halpipe.core.files import STDIO, make_folder, read_bytes, refuse_inputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.flow.fleet import Ledger, Solved, Variant
    from halpipe.pipeline.solve.schedule import SearchOptions


def schedule_fleet(
    sources: Sequence[str],
    options: SearchOptions,
    folder: str,
    *,
    processes: int,
    cluster: str,
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
        run.all(variants, processes, cluster)
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
    """What is solved so far, by the name of its file."""

    def __init__(self, ledger: Ledger, stop: Stop, total: int) -> None:
        self.ledger, self.stop, self.total = ledger, stop, total
        self.solved: dict[str, Solved] = {}

    def share(self, variants: Sequence[Variant]) -> list[Variant]:
        """Solve the first that can be; let the schedules of the others share with it what they can."""
        from halpipe.flow.fleet import near_to

        for place, variant in enumerate(variants):
            if variant.options["near"] is not None:
                raise typer.BadParameter("give --near or --share, not both", param_hint="--share")
            self.all([variant], 1, "")
            content = self.solved[variant.target].content
            if content or self.stop.pressed:
                first, rest = variants[: place + 1], variants[place + 1 :]
                return [*first, *(near_to(other, content, variant.target) for other in rest if content)]
        return list(variants)

    def all(self, variants: Sequence[Variant], processes: int, cluster: str) -> None:
        """Solve what is not solved yet, in this process or elsewhere, and write each as soon as it is there."""
        from halpipe.pipeline.solve.run import map_tasks

        waiting = []
        for variant in variants:
            kept = self.ledger.kept(variant)
            if variant.target not in self.solved and kept is not None:
                self._take(variant, kept)
            elif variant.target not in self.solved:
                waiting.append(variant)
        results = map_tasks(partial(_solve, self.stop), waiting, jobs=processes, cluster=cluster)
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
        if not output.Settings.quiet and streams.is_terminal(sys.stderr):
            streams.write_remark(f"\r{_bar(len(self.solved), self.total)} {len(self.solved)} of {self.total}")
            if len(self.solved) == self.total:
                streams.write_remark("\n")

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


def _bar(done: int, total: int) -> str:
    filled = 20 * done // max(1, total)
    return f"[{'#' * filled}{'.' * (20 - filled)}]"
